// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light traced through a vial face by face: walls that are not round, rods that bend light or send it back.
/// For what closed forms (vial.hpp) do not know.
///
/// Faces are upright, so n kz stays the same through all of them, kz being the z part of a ray's direction.
/// Seen from above, a ray that rises goes as a level one does where each index n is n' = sqrt(n² - (n_outside
/// kz)²) (`index_across`), and by the sum of its ways over n' times n_outside kz it rises on the way.
///
/// Places are across the axis, in the frame of the part, in mm. Light is refracted at each face, dimmed
/// along its way in resin, and loses what faces reflect (Fresnel, both polarisations by themselves), which
/// is not followed: but what a metal rod reflects is, once, and all that a glass rod reflects as a whole.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::tomo::detail {

/// A straight piece of a ray, in the resin.
struct TracedPiece {
  FlatPoint from, along;  ///< `along` has length 1
  double length_mm = 0;
  double power = 0;   ///< of what the ray had in air, at its beginning
  double way_mm = 0;  ///< in resin before it, seen from above
  /// Ways, seen from above, over n', to its beginning from where the ray crossed the plane of the axis or
  /// would have: z there is the line's and n_outside kz times this.
  double rise_mm = 0;
};

/// What became of a ray.
struct TracedRay {
  std::vector<TracedPiece> pieces;
  /// Which faces it passed: rays with the same are bent by the same faces, one after another.
  std::uint64_t history = 0;
  bool reflected = false;  ///< a wall sent it back as a whole, before it came to the resin
  double rise_per_mm = 1;  ///< by which a piece's rise grows with the way, 1/n'
  double stretch = 1;      ///< length of its way in resin over that seen from above
};

/// A pixel's ray next to the vial, in the machine's frame: it passes the plane of the axis at x_mm.
struct TracedLine {
  double x_mm = 0, angle_rad = 0;  ///< of its projection along z, from +Y towards +X
  double z_mm = 0, kz = 0;         ///< where it passes, and the z part of its unit direction
  double transmittance = 1;        ///< of a bath's window
};

class VialTrace {
 public:
  VialTrace(const Vial& vial, double n_resin, double alpha_per_mm);

  /// A ray of power 1 while the vial stands turned by `th`. `ray` is filled anew.
  void trace(double th, const TracedLine& line, TracedRay& ray) const;
  double outside_mm() const { return outside_mm_; }
  double n_outside() const { return n_outside_; }
  double alpha_per_mm() const { return alpha_; }

 private:
  struct Meeting;
  struct Travelling;
  /// A wall's face: a cylinder about the axis, or edges.
  struct Face {
    double radius_mm = 0;            ///< 0: edges
    std::vector<FlatPoint> corners;  ///< counterclockwise
    std::vector<FlatPoint> normals;  ///< outwards, at the beginning and at the end of each edge
    std::vector<int> curves;         ///< which curve, or flat side, an edge belongs to
    double n_behind = 1;
  };
  static Face face_of(const std::vector<FlatPoint>& corners, double n_behind);
  static Meeting meet(const Face& face, const FlatPoint& from, const FlatPoint& along,
                      bool inwards);
  static Meeting meet(const Rod& rod, const FlatPoint& from, const FlatPoint& along, bool inwards);
  void trace(Travelling& now, TracedRay& ray) const;
  void in_resin(Travelling& now, TracedRay& ray) const;

  std::vector<Face> faces_;  ///< from outside to the resin
  std::vector<Rod> rods_;
  double n_outside_ = 1, n_resin_ = 1.5, alpha_ = 0;
  double outside_mm_ = 1;
};

}  // namespace slicecorr::tomo::detail
