// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/uneven_slices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// Heights are told to tenths of micrometres.
constexpr double kPerUm = 10;
constexpr double kMostHeightUm = 1000;

std::int64_t tenths(double um) { return std::llround(um * kPerUm); }

}  // namespace

double thin_slice_um(const LayerHeights& heights) {
  std::int64_t measure = 0;
  for (std::size_t n = 0; n < heights.um().size(); ++n) {
    const double um = heights.um()[n];
    if (!(um >= 1 && um <= kMostHeightUm)) {
      throw InputError(
          fmt::format("layer {} is {:g} um high; expected 1 to {:g} um", n, um, kMostHeightUm));
    }
    measure = std::gcd(measure, tenths(um));
  }
  const double um = static_cast<double>(measure) / kPerUm;
  if (!(um >= 2)) {
    throw InputError(fmt::format(
        "heights of layers have {:g} um as their greatest common measure; expected 2 um or "
        "more, as of 20, 50 and 100 um",
        um));
  }
  return um / 2;
}

UnevenSlices::UnevenSlices(const MeshSlices& thin, LayerHeights heights, double usual_um)
    : thin_(thin), heights_(std::move(heights)), grid_(thin.grid()) {
  const double thin_um = thin.grid().layer_um;
  grid_.layer_um = usual_um > 0 ? usual_um : heights_.um().back();
  for (int n = 0;; ++n) {
    const auto middle = std::llround(heights_.place_um(n + 0.5, grid_.layer_um) / thin_um);
    if (middle >= thin.grid().layers) break;
    cut_.push_back(static_cast<int>(middle));
  }
  if (cut_.empty()) {
    throw InputError(fmt::format("the part is thinner than half of its first layer of {:g} um",
                                 heights_.um().front()));
  }
  grid_.layers = static_cast<int>(cut_.size());
}

void UnevenSlices::read_band(const PixelBox& band, const Sink& sink) const {
  read_slices(band, 0, grid_.layers, sink);
}

void UnevenSlices::read_slices(const PixelBox& band, int first, int past, const Sink& sink) const {
  first = std::max(0, first);
  past = std::min(past, grid_.layers);
  if (first >= past) return;
  // One by one where few of the thin ones are wanted.
  constexpr int many = 8;
  const int begin = cut_[static_cast<std::size_t>(first)],
            end = cut_[static_cast<std::size_t>(past) - 1] + 1;
  if (end - begin > many * (past - first)) {
    for (int n = first; n < past; ++n) {
      const int at = cut_[static_cast<std::size_t>(n)];
      thin_.read_slices(band, at, at + 1, [&](int, const std::uint8_t* rows) { sink(n, rows); });
    }
    return;
  }
  int n = first;
  thin_.read_slices(band, begin, end, [&](int slice, const std::uint8_t* rows) {
    if (n < past && slice == cut_[static_cast<std::size_t>(n)]) sink(n++, rows);
  });
}

MeshInLayers::MeshInLayers(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
                           const LayerHeights& heights, const ExecutionContext& context,
                           const EdgeDefects* edge_defects) {
  SliceOptions how = options;
  if (!heights.alike()) {
    how.layer_um = thin_slice_um(heights);
    how.raised_um = 0.5 * how.layer_um;
    how.edge_heights = false;
  }
  cuts_ = std::make_unique<const MeshSlices>(std::move(mesh), printer, how, context, edge_defects);
  if (!heights.alike()) {
    uneven_ = std::make_unique<const UnevenSlices>(*cuts_, heights, options.layer_um);
  }
}

const SliceSource& MeshInLayers::operator*() const {
  return uneven_ ? static_cast<const SliceSource&>(*uneven_) : *cuts_;
}

LayerHeights adaptive_heights(const TriangleMesh& mesh, double least_um, double most_um) {
  const double ratio = most_um / least_um;
  if (!(least_um >= 2 && most_um <= kMostHeightUm && ratio >= 1) ||
      std::abs(ratio - std::round(ratio)) > 1e-9 || tenths(least_um) < 2 * kPerUm) {
    throw InputError(fmt::format(
        "layers of {:g} to {:g} um; expected at least 2 um, at most {:g} um, and the most a "
        "multiple of the least",
        least_um, most_um, kMostHeightUm));
  }
  if (mesh.triangles.empty()) throw InputError("there is no triangle to slice");
  const auto most = static_cast<std::size_t>(std::llround(ratio));
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Point3& v : mesh.vertices) {
    low = std::min(low, v[2]);
    high = std::max(high, v[2]);
  }
  const double unit_mm = least_um * 1e-3;
  constexpr double most_units = 1e6;
  const double all = std::ceil((high - low) / unit_mm);
  if (!(all <= most_units)) {
    throw InputError(fmt::format(
        "the part needs {:.0f} layers of {:g} um; expected at most 1000000", all, least_um));
  }
  const auto units = std::max<std::size_t>(1, static_cast<std::size_t>(all));
  std::vector<float> steepness(units, 0);  // greatest |n_z| of what is in a unit
  std::vector<bool> level(units + 1, false);
  constexpr double near = 1e-3;  // of a unit
  for (const auto& t : mesh.triangles) {
    const Point3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const double from = (std::min({a[2], b[2], c[2]}) - low) / unit_mm,
                 to = (std::max({a[2], b[2], c[2]}) - low) / unit_mm;
    double normal[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
      normal[k] = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
    }
    const double length = std::hypot(normal[0], normal[1], normal[2]);
    if (!(length > 0)) continue;
    const double nearest = std::round(from);
    if (to - from < near && std::abs(from - nearest) < near) {
      level[std::min(units, static_cast<std::size_t>(std::max(0.0, nearest)))] = true;
      continue;
    }
    const auto n_z = static_cast<float>(std::abs(normal[2]) / length);
    const auto first = static_cast<std::size_t>(std::max(0.0, std::floor(from + near)));
    const auto past =
        std::min(units, static_cast<std::size_t>(std::max(0.0, std::ceil(to - near))));
    for (std::size_t u = std::min(first, units - 1); u < std::max(past, first + 1) && u < units;
         ++u) {
      steepness[u] = std::max(steepness[u], n_z);
    }
  }
  std::vector<double> um;
  for (std::size_t u = 0; u < units;) {
    std::size_t count = 1;
    float most_here = steepness[u];
    while (count < most && u + count < units && !level[u + count]) {
      const float with = std::max(most_here, steepness[u + count]);
      // The next one, too, may lie no further from its steps than a unit.
      if (static_cast<double>(with) * static_cast<double>(count + 1) > 1 + 1e-6) break;
      most_here = with;
      ++count;
    }
    um.push_back(static_cast<double>(count) * least_um);
    u += count;
  }
  return LayerHeights(std::move(um));
}

}  // namespace slicecorr
