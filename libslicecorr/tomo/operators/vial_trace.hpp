// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Level light traced through a vial face by face: walls that are not round, rods that bend light or
/// send it back. For what closed forms (vial.hpp) do not know.
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
  double way_mm = 0;  ///< in resin before it
};

/// What became of a ray.
struct TracedRay {
  std::vector<TracedPiece> pieces;
  /// Which faces it passed: rays with the same are bent by the same faces, one after another.
  std::uint64_t history = 0;
  bool reflected = false;  ///< a wall sent it back as a whole, before it came to the resin
};

class VialTrace {
 public:
  VialTrace(const Vial& vial, double n_resin, double alpha_per_mm);

  /// A ray of power 1 from outside of the vial; `along` has length 1. `ray` is filled anew.
  void trace(const FlatPoint& from, const FlatPoint& along, TracedRay& ray) const;
  double outside_mm() const { return outside_mm_; }
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
  void in_resin(Travelling& now, TracedRay& ray) const;

  std::vector<Face> faces_;  ///< from outside to the resin
  std::vector<Rod> rods_;
  double n_outside_ = 1, n_resin_ = 1.5, alpha_ = 0;
  double outside_mm_ = 1;
};

}  // namespace slicecorr::tomo::detail
