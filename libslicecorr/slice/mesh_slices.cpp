// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <span>
#include <string>
#include <utility>

#include "mesh/clip_to_box.hpp"
#include "mesh/half_edges.hpp"
#include "parallel/silent.hpp"
#include "slice/bridges.hpp"
#include "slice/edge_heights.hpp"
#include "slice/placing.hpp"
#include "slice/raster.hpp"
#include "slice/solid_rule.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {

using detail::box_of;
using detail::check_fits;
using detail::chunks_of;
using detail::in_chunks;
using detail::layers_of;
using detail::PartBox;
using detail::Placing;
using detail::placing_of;
using detail::Segment;

namespace {

/// Share of the volume from which on missing surface shows in the print: 1 % of a part 50 pixels
/// wide is half a pixel on one side.
constexpr double kMuch = 0.01;

/// A corner of the mesh on the printer: x and y in pixels of the image, z in layers so that slice n
/// is cut at z = n.
using Corner = Point3;
constexpr std::size_t kX = 0, kY = 1, kZ = 2;

struct Span {
  int first, last;
};

struct Entry {
  std::uint32_t triangle;
  Span span;  ///< the slices that cut it; none (the first after the last) where edges need it
};

/// A triangle while slices cut it: its edge that rises through the slice, and the one that falls.
struct Cut {
  double x[2], y[2], z[2];     ///< where they begin
  double dx[2], dy[2], dz[2];  ///< from there to their ends
  int until;                   ///< the last slice that cuts these two edges
  int last;                    ///< the last slice that cuts the triangle
  std::uint32_t triangle;

  Segment at(int slice) const {
    double end[4];
    for (std::size_t way = 0; way < 2; ++way) {
      const double t = (slice - z[way]) / dz[way];
      end[2 * way] = x[way] + t * dx[way];
      end[2 * way + 1] = y[way] + t * dy[way];
    }
    return {end[0], end[1], end[2], end[3]};
  }
};

/// Slices that cut something between these heights, in layers: z < n counts as below slice n,
/// z >= n as above.
Span cut_by(double z_low, double z_high, int layers) {
  const double first = std::floor(z_low) + 1;
  const double last = std::floor(z_high);
  return {static_cast<int>(std::clamp(first, 0.0, static_cast<double>(layers))),
          static_cast<int>(std::clamp(last, -1.0, static_cast<double>(layers - 1)))};
}

/// In words how far the volume can be trusted where surface is missing; empty: it can.
std::string doubt_of(const SliceReport& r) {
  const double share = r.bridged_volume_mm3 / r.volume_mm3;
  if (!(share < 1)) return "so much surface is missing that the volume is a guess";
  if (share < 1e-4) return "less than 0.01 % of the volume depends on them";
  return fmt::format("up to {:.2g} % of the volume depends on them{}", 100 * share,
                     share < kMuch ? "" : ": close the mesh first");
}

}  // namespace

struct MeshSlices::Impl {
  Grid grid;
  bool antialias = true;
  std::unique_ptr<const Heights> heights;  ///< null: not asked for
  PixelBox bounds;
  SliceReport report;
  std::array<Point3, 2> box_mm{};
  std::vector<Corner> corners;                          ///< in place of the mesh's vertices
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< turned where needed
  std::vector<EdgeDefects::OpenEdge> open;
  std::vector<std::vector<Segment>> bridges;  ///< per slice
  // Where volumes are taken away; else empty, and the rule is plain.
  detail::SolidRule rule;
  std::vector<detail::SolidRule::Tag> tags;                      ///< per triangle
  std::vector<std::vector<detail::SolidRule::Tag>> bridge_tags;  ///< beside `bridges`
  int rows_per_bin = 1;
  std::vector<std::size_t> bin_begin;  ///< per bin of rows: where its triangles begin in `binned`
  std::unique_ptr<Entry[]> binned;

  void place(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
             const ExecutionContext& context);
  void divide_solids(const std::vector<TriangleMesh::Share>& shares);
  void close_contours(const ExecutionContext& context);
  void measure_bridges();
  void bin_triangles(const ExecutionContext& context);

  /// Where the edge from corner a to corner b meets slice n. Both triangles of an edge get the same
  /// bits.
  detail::LooseEnds::Point meet(std::uint32_t a, std::uint32_t b, double n) const {
    if (a > b) std::swap(a, b);
    const Corner& p = corners[a];
    const Corner& q = corners[b];
    const double t = (n - p[kZ]) / (q[kZ] - p[kZ]);
    return {p[kX] + t * (q[kX] - p[kX]), p[kY] + t * (q[kY] - p[kY])};
  }
  void set_edges(Cut& cut, int slice) const;
  std::size_t bin_of(double y) const {
    return std::min(static_cast<std::size_t>(y) / static_cast<std::size_t>(rows_per_bin),
                    bin_begin.size() - 2);
  }
  std::pair<std::size_t, std::size_t> bins_of(const std::array<std::uint32_t, 3>& t) const {
    const auto [low, high] = std::minmax({corners[t[0]][kY], corners[t[1]][kY], corners[t[2]][kY]});
    return {bin_of(low), bin_of(high)};
  }
  /// Whether the centres of some row lie on the triangle, as seen along x.
  bool meets_centres(const std::array<std::uint32_t, 3>& t) const {
    const auto [low, high] = std::minmax({corners[t[0]][kY], corners[t[1]][kY], corners[t[2]][kY]});
    return detail::first_centre(low) < detail::first_centre(high);
  }
  Span slices_of(const std::array<std::uint32_t, 3>& t) const {
    const auto [low, high] = std::minmax({corners[t[0]][kZ], corners[t[1]][kZ], corners[t[2]][kZ]});
    return cut_by(low, high, grid.layers);
  }
  /// Those slices of `all` that may cut the triangle in rows [y0, y1).
  Span slices_of(const std::array<std::uint32_t, 3>& t, const Span& all, double y0,
                 double y1) const {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    const auto see = [&](double z) { low = std::min(low, z), high = std::max(high, z); };
    for (std::size_t k = 0; k < 3; ++k) {
      const Corner &a = corners[t[k]], &b = corners[t[k == 2 ? 0 : k + 1]];
      if (a[kY] >= y0 && a[kY] <= y1) see(a[kZ]);
      for (const double y : {y0, y1}) {
        if ((a[kY] < y) == (b[kY] < y)) continue;
        see(a[kZ] + (y - a[kY]) / (b[kY] - a[kY]) * (b[kZ] - a[kZ]));
      }
    }
    // One slice more on either side, which rounding may have hidden.
    const Span inside = cut_by(low - 1, high + 1, grid.layers);
    return {std::max(all.first, inside.first), std::min(all.last, inside.last)};
  }
  std::vector<Entry> entries_of(int y0, int y1, int first, int past) const;
  detail::BandEdges edges_of(const PixelBox& band) const;
};

/// The edge heights of all columns. Lies beside the slices that it belongs to.
class MeshSlices::Heights final : public SliceSource {
 public:
  explicit Heights(const Impl& slices) : slices_(slices), grid_(slices.grid) { ++grid_.layers; }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return slices_.bounds; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    read_slices(band, 0, grid_.layers, sink);
  }
  void read_slices(const PixelBox& band, int first, int past, const Sink& sink) const override {
    const detail::BandEdges edges = slices_.edges_of(band);
    std::vector<std::uint8_t> rows(band.empty() ? 0
                                                : static_cast<std::size_t>(band.width()) *
                                                      static_cast<std::size_t>(band.height()));
    for (int n = first; n < past; ++n) {
      for (const auto& e : edges.at(n)) rows[e.column] = e.height;
      sink(n, edges.at(n).empty() ? nullptr : rows.data());
      for (const auto& e : edges.at(n)) rows[e.column] = 0;
    }
  }

 private:
  const Impl& slices_;
  Grid grid_;
};

/// The two edges of a triangle that this slice cuts. Edges begin at the corner with the lower
/// index, so that both triangles of an edge get the same bits; `meet` gives these, too.
void MeshSlices::Impl::set_edges(Cut& cut, int slice) const {
  const auto& t = triangles[cut.triangle];
  const double n = slice;
  double least_above = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < 3; ++k) {
    std::uint32_t a = t[k], b = t[k == 2 ? 0 : k + 1];
    const bool a_above = corners[a][kZ] >= n, b_above = corners[b][kZ] >= n;
    if (a_above) least_above = std::min(least_above, corners[a][kZ]);
    if (a_above == b_above) continue;
    const int way = b_above ? 0 : 1;
    if (a > b) std::swap(a, b);
    const Corner &p = corners[a], &q = corners[b];
    cut.x[way] = p[kX], cut.y[way] = p[kY], cut.z[way] = p[kZ];
    cut.dx[way] = q[kX] - p[kX], cut.dy[way] = q[kY] - p[kY], cut.dz[way] = q[kZ] - p[kZ];
  }
  cut.until = static_cast<int>(std::min(std::floor(least_above), static_cast<double>(cut.last)));
}

void MeshSlices::Impl::place(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
                             const ExecutionContext& context) {
  const PartBox box = box_of(mesh, context);
  box_mm = {box.low, box.high};
  const Grid plate = plate_grid(printer);
  const Placing at = placing_of(plate, options);
  check_fits(box, at, plate, printer);
  const int layers = layers_of(box, printer, options);
  grid = {plate.width_px,   plate.height_px,  layers,
          plate.pixel_x_um, plate.pixel_y_um, options.layer_um};

  const double px = plate.pixel_x_um * 1e-3, py = plate.pixel_y_um * 1e-3;
  const double layer_mm = options.layer_um * 1e-3;
  const double cx = at.cx, cy = at.cy, display_y = at.display_y;
  const double mid_x = box.middle(0), mid_y = box.middle(1);
  const double platform_z = detail::platform_z_mm(box, options);
  const double half_x = 0.5 * box.size(0), half_y = 0.5 * box.size(1);
  const auto inside = [](double v, int most) { return std::clamp(static_cast<int>(v), 0, most); };
  bounds = {inside(std::floor((cx - half_x) / px + 1e-9), plate.width_px),
            inside(std::floor((display_y - cy - half_y) / py + 1e-9), plate.height_px),
            inside(std::ceil((cx + half_x) / px - 1e-9), plate.width_px),
            inside(std::ceil((display_y - cy + half_y) / py - 1e-9), plate.height_px)};
  bounds.x1 = std::max(bounds.x1, std::min(bounds.x0 + 1, plate.width_px));
  bounds.y1 = std::max(bounds.y1, std::min(bounds.y0 + 1, plate.height_px));
  corners = std::move(mesh.vertices);
  // What is not added may reach beyond the part; it is cut there later.
  std::vector<std::uint8_t> reaches(mesh.shares.empty() ? 0 : corners.size(), 0);
  for (std::size_t t = 0; t < mesh.triangles.size() && !reaches.empty(); ++t) {
    if (mesh.adds(t)) continue;
    for (const std::uint32_t v : mesh.triangles[t]) reaches[v] = 1;
  }
  in_chunks(corners.size(), context, [&](std::size_t, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Point3 v = corners[i];
      if (!reaches.empty() && reaches[i]) {
        corners[i] = {(v[0] - mid_x + cx) / px, (mid_y - v[1] + display_y - cy) / py,
                      (v[2] - platform_z) / layer_mm - 0.5};
        continue;
      }
      const double x = std::clamp((v[0] - mid_x + cx) / px, 0.0, 1.0 * plate.width_px);
      const double y = std::clamp((mid_y - v[1] + display_y - cy) / py, 0.0, 1.0 * plate.height_px);
      corners[i] = {std::clamp(x, static_cast<double>(bounds.x0), static_cast<double>(bounds.x1)),
                    std::clamp(y, static_cast<double>(bounds.y0), static_cast<double>(bounds.y1)),
                    (v[2] - platform_z) / layer_mm - 0.5};
    }
  });
  triangles = std::move(mesh.triangles);
}

/// Gives triangles their tags, and cuts volumes that are taken away, or kept within, at the part's
/// box.
void MeshSlices::Impl::divide_solids(const std::vector<TriangleMesh::Share>& shares) {
  rule = detail::SolidRule(shares);
  if (rule.plain()) return;
  constexpr double infinity = std::numeric_limits<double>::infinity();
  Point3 low{infinity, infinity, infinity}, high{-infinity, -infinity, -infinity};
  std::vector<std::array<std::uint32_t, 3>> all;
  std::vector<std::uint8_t> cut_corners(corners.size(), 0);
  const auto part_of = [&](std::size_t share) {
    const auto end = share + 1 < shares.size() ? shares[share + 1].first : triangles.size();
    return std::span(triangles).subspan(shares[share].first, end - shares[share].first);
  };
  for (std::size_t share = 0; share < shares.size(); ++share) {
    for (const auto& t : part_of(share)) {
      for (const std::uint32_t v : t) {
        if (shares[share].role != SolidRole::added) {
          cut_corners[v] = 1;
          continue;
        }
        for (std::size_t k = 0; k < 3; ++k) {
          low[k] = std::min(low[k], corners[v][k]);
          high[k] = std::max(high[k], corners[v][k]);
        }
      }
    }
  }
  for (const EdgeDefects::OpenEdge& edge : open) {
    if (!cut_corners[edge.low]) continue;
    throw InputError(
        "a volume that is taken away from the part, or that the part is kept within, has open edges; "
        "expected a closed one: close its mesh first");
  }
  for (std::size_t share = 0; share < shares.size(); ++share) {
    const auto part = part_of(share);
    std::vector<std::array<std::uint32_t, 3>> its(part.begin(), part.end());
    if (shares[share].role != SolidRole::added) detail::clip_to_box(corners, its, low, high);
    all.insert(all.end(), its.begin(), its.end());
    tags.resize(all.size(), rule.tag_of_share(share));
  }
  triangles = std::move(all);
}

void MeshSlices::Impl::close_contours(const ExecutionContext& context) {
  bridges.resize(static_cast<std::size_t>(grid.layers));
  bridge_tags.resize(bridges.size());
  if (open.empty()) return;
  std::vector<detail::SolidRule::Tag> tag_of_corner;
  if (!rule.plain()) {
    tag_of_corner.resize(corners.size(), 0);
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      for (const std::uint32_t v : triangles[t]) tag_of_corner[v] = tags[t];
    }
  }

  std::vector<std::vector<std::uint32_t>> open_of(bridges.size());
  for (std::uint32_t e = 0; e < open.size(); ++e) {
    const double a = corners[open[e].low][kZ], b = corners[open[e].high][kZ];
    const Span span = cut_by(std::min(a, b), std::max(a, b), grid.layers);
    for (int n = span.first; n <= span.last; ++n) open_of[static_cast<std::size_t>(n)].push_back(e);
  }
  std::mutex mutex;
  parallel_for(context, "close contours", bridges.size(), [&](std::size_t n) {
    if (open_of[n].empty()) return;
    // Each tag's contours close by themselves.
    std::map<detail::SolidRule::Tag, detail::LooseEnds> loose_of_tag;
    for (const std::uint32_t e : open_of[n]) {
      const auto place = meet(open[e].low, open[e].high, static_cast<double>(n));
      // Cuts begin where a triangle's edge rises through the slice: a surplus of rising edges
      // leaves beginnings that no cut leads to.
      const bool rises = corners[open[e].low][kZ] < corners[open[e].high][kZ];
      detail::LooseEnds& loose = loose_of_tag[rule.plain() ? 0 : tag_of_corner[open[e].low]];
      auto& places = rises == (open[e].surplus > 0) ? loose.beginnings : loose.ends;
      places.insert(places.end(), static_cast<std::size_t>(std::abs(open[e].surplus)), place);
    }
    double longest = 0;
    for (auto& [tag, loose] : loose_of_tag) {
      double its_longest = 0;
      const std::vector<Segment> its =
          detail::bridge(loose, grid.pixel_x_um * 1e-3, grid.pixel_y_um * 1e-3, its_longest);
      bridges[n].insert(bridges[n].end(), its.begin(), its.end());
      bridge_tags[n].resize(bridges[n].size(), tag);
      longest = std::max(longest, its_longest);
    }
    const std::lock_guard lock(mutex);
    report.bridged_slices += !bridges[n].empty();
    report.bridges += bridges[n].size();
    report.longest_bridge_mm = std::max(report.longest_bridge_mm, longest);
  });
  if (report.bridges) measure_bridges();
}

/// The volume that contours enclose: the area within a contour is the integral of x dy along it, so
/// a triangle contributes its mean x times its area as seen along x.
void MeshSlices::Impl::measure_bridges() {
  double volume = 0, half_circles = 0;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    if (!tags.empty() && rule.role(tags[i]) != SolidRole::added) continue;
    const auto& t = triangles[i];
    const Corner &a = corners[t[0]], &b = corners[t[1]], &c = corners[t[2]];
    const double area =
        0.5 * ((b[kY] - a[kY]) * (c[kZ] - a[kZ]) - (c[kY] - a[kY]) * (b[kZ] - a[kZ]));
    volume -= (a[kX] + b[kX] + c[kX]) / 3 * area;
  }
  const double px = grid.pixel_x_um * 1e-3, py = grid.pixel_y_um * 1e-3;
  for (const auto& its : bridges) {
    for (const Segment& s : its) {
      volume += 0.5 * (s.ax + s.bx) * (s.by - s.ay);
      const double dx = (s.bx - s.ax) * px, dy = (s.by - s.ay) * py;
      half_circles += std::numbers::pi / 8 * (dx * dx + dy * dy);
    }
  }
  report.volume_mm3 = std::abs(volume) * px * py * grid.layer_um * 1e-3;
  report.bridged_volume_mm3 = half_circles * grid.layer_um * 1e-3;
}

/// Sorts the triangles into bins of rows; their numbers rise within a bin.
void MeshSlices::Impl::bin_triangles(const ExecutionContext& context) {
  rows_per_bin = band_rows(grid);
  const auto bins = static_cast<std::size_t>((grid.height_px + rows_per_bin - 1) / rows_per_bin);
  bin_begin.assign(bins + 1, 0);
  /// The bins of a triangle (none where the first is after the last), and the slices that cut it.
  struct Bins {
    std::uint32_t first, last;
    Span span;
  };
  const auto bins_by_triangle = std::make_unique_for_overwrite<Bins[]>(triangles.size());
  // For each chunk and bin: the number of triangles, later where they begin.
  std::vector<std::size_t> at(chunks_of(triangles.size()) * bins, 0);
  in_chunks(triangles.size(), context, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Bins& its = bins_by_triangle[i];
      its = {1, 0, slices_of(triangles[i])};
      if (its.span.first > its.span.last && !(heights && meets_centres(triangles[i]))) continue;
      const auto [first, last] = bins_of(triangles[i]);
      its.first = static_cast<std::uint32_t>(first);
      its.last = static_cast<std::uint32_t>(last);
      for (std::size_t b = first; b <= last; ++b) ++at[chunk * bins + b];
    }
  });
  std::size_t sum = 0;
  for (std::size_t b = 0; b < bins; ++b) {
    bin_begin[b] = sum;
    for (std::size_t k = b; k < at.size(); k += bins) sum += std::exchange(at[k], sum);
  }
  bin_begin[bins] = sum;
  binned = std::make_unique_for_overwrite<Entry[]>(sum);
  in_chunks(triangles.size(), context, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Bins its = bins_by_triangle[i];
      for (std::size_t b = its.first; b <= its.last; ++b) {
        binned[at[chunk * bins + b]++] = {static_cast<std::uint32_t>(i), its.span};
      }
    }
  });
}

/// The triangles of these rows and slices, sorted by the first of the slices that cuts them.
std::vector<Entry> MeshSlices::Impl::entries_of(int y0, int y1, int first, int past) const {
  const std::size_t first_bin = bin_of(y0), last_bin = bin_of(y1 - 1);
  std::vector<Entry> found;
  found.reserve(bin_begin[last_bin + 1] - bin_begin[first_bin]);
  std::vector<std::size_t> at(static_cast<std::size_t>(past - first) + 1, 0);
  for (std::size_t b = first_bin; b <= last_bin; ++b) {
    for (std::size_t i = bin_begin[b]; i < bin_begin[b + 1]; ++i) {
      Entry e = binned[i];
      e.span = {std::max(e.span.first, first), std::min(e.span.last, past - 1)};
      if (e.span.first > e.span.last) continue;
      const auto& t = triangles[e.triangle];
      if (b > first_bin && bins_of(t).first < b) continue;  // found in an earlier bin
      const Span span = slices_of(t, e.span, y0, y1);
      if (span.first > span.last) continue;
      found.push_back({e.triangle, span});
      ++at[static_cast<std::size_t>(span.first - first) + 1];
    }
  }
  for (std::size_t n = 1; n < at.size(); ++n) at[n] += at[n - 1];
  std::vector<Entry> sorted(found.size());
  for (const Entry& e : found) sorted[at[static_cast<std::size_t>(e.span.first - first)]++] = e;
  return sorted;
}

/// The edges of a band's columns; rows that no bin has are empty.
detail::BandEdges MeshSlices::Impl::edges_of(const PixelBox& band) const {
  std::vector<std::uint32_t> candidates;
  if (!band.empty()) {
    const std::size_t first_bin = bin_of(band.y0), last_bin = bin_of(band.y1 - 1);
    candidates.reserve(bin_begin[last_bin + 1] - bin_begin[first_bin]);
    for (std::size_t b = first_bin; b <= last_bin; ++b) {
      for (std::size_t i = bin_begin[b]; i < bin_begin[b + 1]; ++i) {
        const std::uint32_t t = binned[i].triangle;
        if (b > first_bin && bins_of(triangles[t]).first < b) continue;  // found in an earlier bin
        candidates.push_back(t);
      }
    }
  }
  return detail::edges_of_columns(
      {corners, triangles, grid.layers, tags, rule.plain() ? nullptr : &rule}, candidates, band);
}

MeshSlices::MeshSlices(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
                       const ExecutionContext& context, const EdgeDefects* edge_defects)
    : impl_(std::make_unique<Impl>()) {
  if (!(options.layer_um >= 1.0) || !(options.layer_um <= 1000.0)) {
    throw InputError(fmt::format("slice height {:g} um; expected 1 to 1000", options.layer_um));
  }
  if (mesh.triangles.empty()) throw InputError("there is no triangle to slice");
  impl_->antialias = options.antialias;
  const EdgeDefects defects = edge_defects ? *edge_defects : detail::edge_defects_of(mesh, context);
  const std::vector<TriangleMesh::Share> shares = mesh.shares;
  impl_->place(std::move(mesh), printer, options, context);
  for (const std::uint32_t t : defects.flipped) {
    std::swap(impl_->triangles[t][1], impl_->triangles[t][2]);
  }
  impl_->report.turned_triangles = defects.flipped.size();
  impl_->open = defects.open;
  impl_->divide_solids(shares);
  context.check_cancelled();
  impl_->close_contours(context);
  if (options.edge_heights) impl_->heights = std::make_unique<const Heights>(*impl_);
  impl_->bin_triangles(context);
  const SliceReport& r = impl_->report;
  if (r.turned_triangles) {
    context.tell(
        fmt::format("{} triangles face the wrong way; cut as if turned", r.turned_triangles));
  }
  if (r.bridges) {
    context.tell(
        fmt::format("open contours in {} slices closed by {} bridges, the longest {:.3f} mm; {}",
                    r.bridged_slices, r.bridges, r.longest_bridge_mm, doubt_of(r)));
  }
}

MeshSlices::~MeshSlices() = default;
MeshSlices::MeshSlices(MeshSlices&&) noexcept = default;
const Grid& MeshSlices::grid() const { return impl_->grid; }
PixelBox MeshSlices::bounds() const { return impl_->bounds; }
bool MeshSlices::ends_below_last_node() const {
  if (!edge_heights()) return false;
  double highest = 0;
  for (const Corner& c : impl_->corners) highest = std::max(highest, c[kZ]);
  // In slices from the platform; nearer to the node than half a step of the byte is at it.
  return highest + 0.5 - impl_->grid.layers > 0.5 / 254;
}
const std::array<Point3, 2>& MeshSlices::box_mm() const { return impl_->box_mm; }
const SliceReport& MeshSlices::report() const { return impl_->report; }
const SliceSource* MeshSlices::edge_heights() const { return impl_->heights.get(); }

ThinFeatures MeshSlices::thin_features(const ExecutionContext& context) const {
  const Impl& s = *impl_;
  ThinFeatures sum;
  if (!s.heights) return sum;
  const int rows = s.rows_per_bin;
  const int first = s.bounds.y0 / rows;
  const auto bands = static_cast<std::size_t>((s.bounds.y1 + rows - 1) / rows - first);
  // Added up in order: sums of doubles depend on it.
  std::vector<detail::BandEdges> of_bands(bands);
  parallel_for(context, "thin features", bands, [&](std::size_t i) {
    const int y0 = (first + static_cast<int>(i)) * rows;
    detail::BandEdges edges =
        s.edges_of({s.bounds.x0, y0, s.bounds.x1, std::min(y0 + rows, s.grid.height_px)});
    edges.edges = {};
    edges.begin = {};
    // Of the part's rows.
    edges.thickest_column += static_cast<std::uint32_t>((y0 - s.bounds.y0) * s.bounds.width());
    of_bands[i] = std::move(edges);
  });
  double slices = 0, thickest_slices = 0;
  for (const detail::BandEdges& edges : of_bands) {
    sum.columns += edges.thin_columns;
    sum.of_columns += edges.columns;
    slices += edges.thin_slices;
    if (edges.thickest_slices <= thickest_slices) continue;
    thickest_slices = edges.thickest_slices;
    const auto width = static_cast<std::uint32_t>(s.bounds.width());
    const std::uint32_t x = edges.thickest_column % width, y = edges.thickest_column / width;
    const PlatePlace place =
        place_on_plate(s.grid, {}, s.bounds.x0 + 0.5 + x, s.bounds.y0 + 0.5 + y);
    sum.x_mm = place.x_mm;
    sum.y_mm = place.y_mm;
    sum.z_mm = (edges.thickest_from + 0.5) * s.grid.layer_um * 1e-3;
  }
  sum.volume_mm3 = slices * s.grid.pixel_x_um * s.grid.pixel_y_um * s.grid.layer_um * 1e-9;
  sum.thickest_um = thickest_slices * s.grid.layer_um;
  return sum;
}

void MeshSlices::read_band(const PixelBox& band, const Sink& sink) const {
  read_slices(band, 0, impl_->grid.layers, sink);
}

void MeshSlices::read_slices(const PixelBox& band, int first, int past, const Sink& sink) const {
  const Impl& s = *impl_;
  const std::vector<Entry> entries = s.entries_of(band.y0, band.y1, first, past);
  // Drawn over the part's full width, because windings are summed from the left, and cropped where
  // less is asked for.
  const PixelBox full = {s.bounds.x0, band.y0, s.bounds.x1, band.y1};
  detail::Raster raster(full.x0, full.y0, full.x1, full.y1, s.antialias);
  std::vector<std::uint8_t> cropped;
  const bool crop = band.x0 != full.x0 || band.x1 != full.x1;
  if (crop) {
    cropped.resize(static_cast<std::size_t>(band.width()) *
                   static_cast<std::size_t>(band.height()));
  }
  std::vector<Cut> active;
  std::vector<Segment> segments;
  std::vector<detail::SolidRule::Tag> tags;
  std::size_t next = 0;
  for (int n = first; n < past; ++n) {
    const auto& bridges = s.bridges[static_cast<std::size_t>(n)];
    segments.clear();
    tags.clear();
    for (std::size_t i = 0; i < active.size();) {
      Cut& cut = active[i];
      if (n > cut.until) {
        if (n > cut.last) {
          cut = active.back();  // order does not matter
          active.pop_back();
          continue;
        }
        s.set_edges(cut, n);
      }
      segments.push_back(cut.at(n));
      if (!s.tags.empty()) tags.push_back(s.tags[cut.triangle]);
      ++i;
    }
    for (; next < entries.size() && entries[next].span.first <= n; ++next) {
      Cut& cut = active.emplace_back();
      cut.triangle = entries[next].triangle;
      cut.last = entries[next].span.last;
      s.set_edges(cut, n);
      segments.push_back(cut.at(n));
      if (!s.tags.empty()) tags.push_back(s.tags[cut.triangle]);
    }
    segments.insert(segments.end(), bridges.begin(), bridges.end());
    const std::uint8_t* rows = nullptr;
    if (!segments.empty() && s.tags.empty()) rows = raster.draw(segments);
    if (!segments.empty() && !s.tags.empty()) {
      const auto& its = s.bridge_tags[static_cast<std::size_t>(n)];
      tags.insert(tags.end(), its.begin(), its.end());
      rows = raster.draw(segments, tags, s.rule);
    }
    if (rows == nullptr || !crop) {
      sink(n, rows);
      continue;
    }
    const int from = std::max(band.x0, full.x0), to = std::min(band.x1, full.x1);
    std::fill(cropped.begin(), cropped.end(), std::uint8_t{0});
    for (int y = 0; y < band.height() && from < to; ++y) {
      const auto* source = rows + static_cast<std::ptrdiff_t>(y) * full.width();
      std::copy(source + (from - full.x0), source + (to - full.x0),
                cropped.data() + static_cast<std::ptrdiff_t>(y) * band.width() + (from - band.x0));
    }
    sink(n, cropped.data());
  }
}

}  // namespace slicecorr
