// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What mesh slices hold: the mesh on the printer, its bridges, and its triangles by rows. mesh_slices_make.cpp
/// makes it, mesh_slices.cpp reads slices from it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "slice/bridges.hpp"
#include "slice/edge_heights.hpp"
#include "slice/raster.hpp"
#include "slice/solid_rule.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {

namespace detail::slicing {

/// A corner of the mesh on the printer: x and y in pixels of the image, z in layers so that slice n
/// is cut at z = n.
using Corner = Point3;
inline constexpr std::size_t kX = 0, kY = 1, kZ = 2;

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

  detail::Segment at(int slice) const {
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
inline Span cut_by(double z_low, double z_high, int layers) {
  const double first = std::floor(z_low) + 1;
  const double last = std::floor(z_high);
  return {static_cast<int>(std::clamp(first, 0.0, static_cast<double>(layers))),
          static_cast<int>(std::clamp(last, -1.0, static_cast<double>(layers - 1)))};
}

}  // namespace detail::slicing

struct MeshSlices::Impl {
  using Corner = detail::slicing::Corner;
  using Cut = detail::slicing::Cut;
  using Entry = detail::slicing::Entry;
  using Segment = detail::Segment;
  using Span = detail::slicing::Span;
  static constexpr std::size_t kX = detail::slicing::kX, kY = detail::slicing::kY,
                               kZ = detail::slicing::kZ;

  ~Impl();

  Grid grid;
  bool antialias = true;
  Shrinkage made_for;
  double raised_um = 0;
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

  /// How far the outlines of a slice move inwards, um.
  double inset_um(int slice) const {
    return made_for.grows()
               ? made_for.growth_at_um(std::max(0.0, (slice + 0.5) * grid.layer_um - raised_um))
               : 0;
  }
  void place(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
             const ExecutionContext& context);
  /// The same where pixels do not lie on an even grid.
  void place_distorted(const std::array<double, 2>& shift_mm, const Printer& printer,
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
    return detail::slicing::cut_by(low, high, grid.layers);
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
    const Span inside = detail::slicing::cut_by(low - 1, high + 1, grid.layers);
    return {std::max(all.first, inside.first), std::min(all.last, inside.last)};
  }
  std::vector<Entry> entries_of(int y0, int y1, int first, int past) const;
  detail::BandEdges edges_of(const PixelBox& band) const;
};

}  // namespace slicecorr
