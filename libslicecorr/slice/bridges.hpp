// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Closing the contours of open meshes, slice by slice.
#pragma once

#include <cstddef>
#include <vector>

#include "slice/raster.hpp"

namespace slicecorr::detail {

/// Loose ends of the contours of one slice, in pixels: where chains of segments end and where they
/// begin. There are as many ends as beginnings.
struct LooseEnds {
  struct Point {
    double x, y;
  };
  std::vector<Point> ends, beginnings;
};

/// Joins every end with a beginning, nearest pairs first (greedily; ties by order). `scale_x`,
/// `scale_y` turn pixels into mm. Returns the joints that have a length; `longest_mm` is raised.
std::vector<Segment> bridge(const LooseEnds& loose, double scale_x, double scale_y,
                            double& longest_mm);

}  // namespace slicecorr::detail
