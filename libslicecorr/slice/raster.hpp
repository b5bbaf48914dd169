// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Coverage of pixels by the region that directed segments enclose, non-zero winding rule.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "slice/solid_rule.hpp"

namespace slicecorr::detail {

/// A directed piece of a contour, in pixels; y grows with the image row.
struct Segment {
  double ax, ay, bx, by;
};

/// What the fragments in a pixel add up to; a whole row of height is 2^46.
struct PixelSums {
  std::int64_t cover;  ///< their heights; going down (y grows) counts as positive
  std::int64_t area;   ///< their heights, each times the share of the pixel right of the fragment
};

/// Draws the segments of one slice into the rows of a band. Reused from slice to slice, so that
/// nothing is allocated per slice. One object for one thread.
///
/// Every segment leaves in the pixels that it crosses by how much the winding grows there (`cover`)
/// and the share of it right of the segment (`area`), and marks them. Running sums along a row then
/// give the covered area wherever contours neither overlap nor cross within a pixel: that is known
/// for certain where neighbouring marked pixels hold fragments of one direction that together
/// change the winding by one. Elsewhere (tips of contours, walls thinner than a pixel, bodies that
/// overlap) the fragments of these few pixels are cut into scanbeams in which no two cross.
///
/// Sums are whole numbers, so neither the order of the segments nor the band changes a bit of a
/// row.
class Raster {
 public:
  /// Rows [y0, y1), columns [x0, x1), none negative. No segment may leave the columns.
  Raster(int x0, int y0, int x1, int y1, bool antialias);

  /// The region's levels: (y1 - y0) * (x1 - x0) bytes, row by row, that stay until the next call.
  /// Null when all are 0. The contours of the segments must be closed.
  const std::uint8_t* draw(std::span<const Segment> segments);
  /// The same where volumes are taken away: a tag for each segment, and what tags do. Rows that no
  /// segment crosses whose tag needs the rule are those of the first `draw`, bit for bit.
  const std::uint8_t* draw(std::span<const Segment> segments, std::span<const SolidRule::Tag> tags,
                           const SolidRule& rule);

 private:
  /// A fragment within one row; y from 0 to 1 in the row and y0 < y1; x from the band's left side.
  struct EdgeFragment {
    double x0, y0, x1, y1;
    double slope;
    int winding;             ///< +1: the contour goes down here, -1: up
    SolidRule::Tag tag = 0;  ///< where a rule is drawn by
    double at(double y) const {
      // Exact at the ends, so that fragments that meet there meet exactly.
      if (y <= y0) return x0;
      if (y >= y1) return x1;
      const double x = x0 + (y - y0) * slope;  // rounding must not lead out of the fragment
      return x0 < x1 ? std::clamp(x, x0, x1) : std::clamp(x, x1, x0);
    }
  };
  struct Active {
    const EdgeFragment* fragment;
    double x;      ///< at the upper side of the scanbeam; before it is drawn already
    double x_end;  ///< at its lower side
  };
  /// A run of marked pixels of a row in which fragments may overlap.
  struct OverlapSpan {
    int row, first, last;
    int winding;               ///< left of it
    std::uint32_t begin, end;  ///< its segments in `overlap_segments_`
  };
  struct BandLayout;
  struct Line;
  struct OneWinding;
  struct ManyWindings;

  void add_areas(const BandLayout& f);
  void add_centres(const BandLayout& f);
  void add_horizontal(const Segment& s, const BandLayout& f);
  bool draw_area_row(int row, const BandLayout& f);
  bool draw_centre_row(int row, const BandLayout& f);
  void find_overlap_spans(int row, std::size_t count);
  unsigned draw_overlap_spans(const BandLayout& f);
  void find_segments();
  unsigned draw_overlap_span(const OverlapSpan& span, const BandLayout& f);
  template <class Winding>
  void draw_scanbeam(PixelSums* sums, std::uint64_t* marks, double from, double to,
                     Winding& winding, const BandLayout& f);
  void collect_fragments(const OverlapSpan& span, const BandLayout& f);
  template <class Winding>
  void draw_fragments(const OverlapSpan& span, Winding& winding, const BandLayout& f);
  unsigned write_levels(const OverlapSpan& span, bool inside);
  bool pairs();
  bool find_ruled_rows();
  void find_ruled_spans(int row, const BandLayout& f);
  unsigned draw_ruled_span(const OverlapSpan& span, const BandLayout& f);
  void add_ruled_centres(const BandLayout& f);
  bool draw_ruled_centres();

  int x0_, y0_, x1_, y1_;
  bool antialias_;
  std::size_t width_, words_;  ///< columns; words of 64 marks for these and one more
  std::vector<std::uint8_t> pixels_;
  std::vector<std::uint8_t> touched_;  ///< rows that a segment of this slice crosses
  std::vector<std::uint8_t> drawn_;    ///< rows of `pixels_` that may not be black
  /// Marked pixels, all 0 between slices: 2 * words_ words per row, those crossed downwards before
  /// those crossed upwards. By centres: words_ words per row.
  std::vector<std::uint64_t> marks_;
  std::vector<PixelSums> sums_;  ///< per pixel; all 0 between slices
  std::vector<std::int32_t>
      steps_;  ///< per pixel, how the winding changes before its centre; all 0 between slices

  std::span<const Segment> segments_;  ///< of this slice
  // Where volumes are taken away; else empty.
  std::span<const SolidRule::Tag> tags_;
  const SolidRule* rule_ = nullptr;
  std::vector<std::uint8_t> ruled_;       ///< rows that the rule draws; empty: none
  std::vector<SolidWindings> windings_;   ///< one, where the row's drawing has come to
  std::vector<std::int64_t> heights_;     ///< per tag: of an overlap span's fragments
  int ruled_row_ = 0, ruled_column_ = 0;  ///< where that is
  /// A change of a winding before a pixel's centre.
  struct CentreStep {
    int row, column;
    SolidRule::Tag tag;
    std::int8_t step;
  };
  std::vector<CentreStep> centre_steps_;
  /// A segment in some rows.
  struct Crossings {
    std::uint32_t row;  ///< the first
    int count;
    std::uint32_t segment;
    int columns[4];  ///< of the left end in these rows
  };
  std::vector<Crossings> crossings_;  ///< all of this slice: the first crossing_count_
  std::size_t crossing_count_ = 0;
  // What is known of the row that is being drawn.
  std::vector<std::uint32_t> columns_;  ///< of marked pixels
  std::vector<std::uint8_t> levels_;    ///< of these
  std::vector<std::int64_t> areas_;     ///< of these, when nothing overlaps
  std::vector<std::int64_t> begins_;    ///< the running sum where the run of each begins
  std::vector<std::uint64_t> gaps_;     ///< marks where pixels that are inside begin; later unused
  std::vector<std::uint32_t>
      doubts_;  ///< marked pixels that are to be looked at closely, by index in `columns_`
  std::vector<OverlapSpan> overlap_spans_;  ///< of this slice
  /// Per column 1 more than the index of the overlap span there, 0: none; one such row for each
  /// image row with overlap spans. The first stays 0, for rows without. All 0 between slices.
  std::vector<std::uint32_t> span_of_;
  std::vector<std::uint32_t> span_row_;  ///< per row: where its row in `span_of_` begins
  std::vector<std::uint8_t>
      spans_near_;  ///< per row: whether it or one of the three below has overlap spans
  struct SpanSegment {
    std::uint32_t span, segment;
  };
  std::vector<SpanSegment> found_;               ///< segments of all overlap spans
  std::vector<std::uint32_t> overlap_segments_;  ///< these, span by span
  std::vector<EdgeFragment> fragments_;
  std::vector<double> events_, lower_ends_;
  std::vector<Active> active_;
};

}  // namespace slicecorr::detail
