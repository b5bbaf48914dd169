// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Whether a mesh can be the design of a stack, by their sizes.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/solid.hpp"
#include "solid/on_plate.hpp"

namespace slicecorr {

namespace {

/// The factor between the sides of two boxes in the order of their lengths; 0 where there is none.
double scale_if_turned(const Point3& low, const Point3& high, const std::array<Point3, 2>& shown) {
  Point3 mine, theirs;
  for (std::size_t k = 0; k < 3; ++k) {
    mine[k] = high[k] - low[k];
    theirs[k] = shown[1][k] - shown[0][k];
  }
  std::sort(mine.begin(), mine.end());
  std::sort(theirs.begin(), theirs.end());
  std::array<double, 3> factor{};
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(mine[k] > 0)) return 0;
    factor[k] = theirs[k] / mine[k];
  }
  std::sort(factor.begin(), factor.end());
  return factor[2] < 1.15 * factor[0] ? factor[1] : 0;
}

}  // namespace

void check_design_size(const SliceSource& stack, double height_mm, const TriangleMesh& design) {
  if (design.triangles.empty() || stack.bounds().empty()) return;
  Point3 low, high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  for (const auto& triangle : design.triangles) {
    for (const std::uint32_t v : triangle) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], design.vertices[v][k]);
        high[k] = std::max(high[k], design.vertices[v][k]);
      }
    }
  }
  const std::array<Point3, 2> shown = detail::shown_box(stack, height_mm);
  const Grid& g = stack.grid();
  const double step_mm[3] = {std::max(g.pixel_x_um, g.pixel_y_um) * 1e-3,
                             std::max(g.pixel_x_um, g.pixel_y_um) * 1e-3, g.layer_um * 1e-3};
  bool larger = false, smaller = true, beside = false;
  double factor[3];
  for (std::size_t k = 0; k < 3; ++k) {
    const double mine = high[k] - low[k], theirs = shown[1][k] - shown[0][k];
    factor[k] = mine > 0 ? theirs / mine : 1;
    larger = larger || mine > 1.25 * theirs + 4 * step_mm[k];
    smaller = smaller && theirs > 1.2 * mine + 4 * step_mm[k];
    const double margin = 0.25 * theirs + 4 * step_mm[k];
    beside = beside || low[k] < shown[0][k] - margin || high[k] > shown[1][k] + margin;
  }
  const auto [least, most] = std::minmax_element(factor, factor + 3);
  // The middle one: a slice more or less does not count.
  const double middle = factor[0] + factor[1] + factor[2] - *least - *most;
  const bool alike = *most < 1.15 * *least;
  // Supports make no stack so much larger than its part along all axes: the part is turned besides.
  const bool tiny = *least > 3;
  if (!larger && !beside && !(smaller && (alike || tiny))) return;
  const auto size = [](const Point3& from, const Point3& to) {
    return fmt::format("{:.2f} x {:.2f} x {:.2f} mm", to[0] - from[0], to[1] - from[1],
                       to[2] - from[2]);
  };
  std::string text = fmt::format("the design is {}, but the stack shows {}", size(low, high),
                                 size(shown[0], shown[1]));
  if (beside && !larger && !smaller) {
    text = fmt::format(
        "the design lies beside what the stack shows: around x = {:.2f}, y = {:.2f} mm of the "
        "plate, the stack around x = {:.2f}, y = {:.2f} mm",
        0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (shown[0][0] + shown[1][0]),
        0.5 * (shown[0][1] + shown[1][1]));
  } else if (alike) {
    text += fmt::format(" (a scale of about {:.3g} would fit)", middle);
  } else if (const double scale = scale_if_turned(low, high, shown); scale > 0) {
    text += fmt::format(" (turned, and with a scale of about {:.3g}, it would fit)", scale);
  }
  throw InputError(text +
                   "; expected the meshes with the units, scale, turn and place with which they "
                   "were sliced");
}

}  // namespace slicecorr
