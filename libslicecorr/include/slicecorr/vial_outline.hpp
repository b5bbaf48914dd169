// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file vial_outline.hpp
/// Walls of vials that are not round, and what stands in the resin: outlines across the axis of
/// rotation, in the frame of the part, in mm. At the first frame x is to the right and y goes away from
/// the projector. Walls are upright: nothing changes along z.
///
/// Plain functions, thread-safe.
#pragma once

#include <optional>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr {

/// Corners of a vial's outer and inner face, counterclockwise, seen from above; empty for round ones. The
/// round corners of a square are 24 chords each.
std::vector<FlatPoint> outer_outline(const Vial& vial);
std::vector<FlatPoint> inner_outline(const Vial& vial);

/// Corners at which an outline turns by less than this belong to a curve, whose normals change evenly.
inline constexpr double kSmoothCornerDeg = 15;

/// Fills `outer_mm` and `inner_mm` of a vial that is not round: the farthest corners from the axis.
void set_radii(Vial& vial);

/// What is wrong with shape, outline or rods: a key and words; nothing where all go with each other.
std::optional<WrongVial> wrong_outline(const Vial& vial);

/// Where resin is: within the inner face, and in no rod.
class ResinArea {
 public:
  explicit ResinArea(const Vial& vial);
  /// Distance of the nearest wall or rod from a place in the resin, mm; below 0 elsewhere.
  double within_mm(const FlatPoint& place) const;
  /// On the wall is within, however places were rounded.
  bool has(const FlatPoint& place) const { return within_mm(place) > -1e-9; }

 private:
  double radius_mm_ = 0;  ///< of a round one
  std::vector<FlatPoint> corners_,
      normals_;  ///< of other ones: edges and what lies outwards of them
  std::vector<Rod> rods_;
};

/// Columns of an n x n grid of voxels about the axis, [y][x], whose middles lie beyond the inner face of a
/// vial that is not round; empty of a round one.
std::vector<bool> beyond_walls(const Vial& vial, int n, double voxel_mm);

/// Distance of the inner face from the axis where it is nearest, mm.
double nearest_wall_mm(const Vial& vial);

/// As files say them: "round", "square", "outline".
const char* name_of(VialShape shape);

/// Most corners of an outline, and most rods.
inline constexpr int kMostCorners = 2000, kMostRods = 64;

}  // namespace slicecorr
