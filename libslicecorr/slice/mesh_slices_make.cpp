// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A mesh comes onto the printer: placed, its volumes divided, its contours closed, its triangles sorted into
// bins of rows.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <span>
#include <utility>

#include "mesh/clip_to_box.hpp"
#include "slice/mesh_slices_parts.hpp"
#include "slice/placing.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

using detail::box_of;
using detail::check_fits;
using detail::chunks_of;
using detail::in_chunks;
using detail::layers_of;
using detail::PartBox;
using detail::Placing;
using detail::placing_of;

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
  if (printer.distortion) {
    triangles = std::move(mesh.triangles);
    const double bottom_mm = platform_z;
    in_chunks(corners.size(), context, [&](std::size_t, std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i)
        corners[i][kZ] = (corners[i][kZ] - bottom_mm) / layer_mm - 0.5;
    });
    place_distorted({cx - mid_x, cy - mid_y}, printer, context);
    return;
  }
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

void MeshSlices::Impl::place_distorted(const std::array<double, 2>& shift_mm,
                                       const Printer& printer, const ExecutionContext& context) {
  const double width = grid.width_px, height = grid.height_px;
  std::vector<PixelBox> boxes(chunks_of(corners.size()));
  std::vector<std::uint8_t> used(corners.size(), 0);
  for (const auto& t : triangles) {
    for (const std::uint32_t v : t) used[v] = 1;
  }
  in_chunks(corners.size(), context, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
    double low[2] = {width, height}, high[2] = {0, 0};
    for (std::size_t i = begin; i < end; ++i) {
      if (!used[i]) continue;
      const double x_mm = corners[i][kX] + shift_mm[0], y_mm = corners[i][kY] + shift_mm[1];
      const auto place = image_place(*printer.distortion, printer, x_mm, y_mm);
      // Of rounding alone a part may reach over the edge.
      constexpr double kNothing = 1e-6;
      if (!place || !((*place)[0] >= -kNothing && (*place)[0] <= width + kNothing &&
                      (*place)[1] >= -kNothing && (*place)[1] <= height + kNothing)) {
        throw InputError(fmt::format(
            "no pixel of printer '{}' lands at {:.2f}, {:.2f} mm, where its display is distorted; expected a "
            "part that is smaller, or nearer to the middle",
            printer.name, x_mm, y_mm));
      }
      corners[i][kX] = std::clamp((*place)[0], 0.0, width);
      corners[i][kY] = std::clamp((*place)[1], 0.0, height);
      for (std::size_t k = 0; k < 2; ++k) {
        low[k] = std::min(low[k], corners[i][k]);
        high[k] = std::max(high[k], corners[i][k]);
      }
    }
    const auto down = [](double v, double most) {
      return static_cast<int>(std::min(std::floor(v), most - 1));
    };
    boxes[chunk] = {down(low[0], width), down(low[1], height),
                    std::max(down(low[0], width) + 1, static_cast<int>(std::ceil(high[0]))),
                    std::max(down(low[1], height) + 1, static_cast<int>(std::ceil(high[1])))};
  });
  bounds = {};
  for (const PixelBox& box : boxes) bounds = bounds.united(box);
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
    const Span span = detail::slicing::cut_by(std::min(a, b), std::max(a, b), grid.layers);
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

}  // namespace slicecorr
