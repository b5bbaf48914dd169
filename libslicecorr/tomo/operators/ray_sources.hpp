// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where in the projector's image the light of a place in the resin comes from, for rays that rise or
/// spread: found backwards, from the place to the pixel. Judges what `make_ray_projector` computes
/// forwards, and shares nothing with it but Snell's law.
///
/// In the frame of the turned vial, in which the ray runs along u, through (t, u, z): light of the pixel
/// at (column, row), shown when the vial stood `turn_rad` less, adds per angle
///   I share,  share = w T e^(-alpha l) sqrt(1 + slope^2) / |d(t, z)/d(X, Z)|,
/// w the ray's share of the pixel, l the way in the resin, the derivatives taken at u: how far rays
/// are apart there.
#pragma once

#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/rays.hpp"

namespace slicecorr::tomo::detail {

struct RaySource {
  double column = 0, row = 0;
  double turn_rad = 0;
  double along = 0, up = 0;  ///< columns a mm of t, rows a mm of z
  double slope = 0;          ///< dz/du
  double way_mm = 0;         ///< l
  double spread = 0;         ///< the share without absorption
  double share = 0;          ///< 0: no light of this ray comes there
};

class RaySources {
 public:
  /// For places between these heights.
  RaySources(const Printer& printer, double n_resin, double alpha_per_mm, double lowest_mm,
             double highest_mm, const ExecutionContext& context);

  int rays() const { return static_cast<int>(points_.size()); }
  /// Solved for this place alone. `near`: a guess of column and row, or null.
  RaySource solve(int ray, double t_mm, double u_mm, double z_mm,
                  const RaySource* near = nullptr) const;
  /// Sources of a line of places along z, first_mm + k step_mm; by tables where rays are smooth there.
  void along_z(int ray, double t_mm, double u_mm, double first_mm, double step_mm,
               std::vector<RaySource>& places) const;

 private:
  struct Table {
    std::vector<RaySource> nodes;  ///< [t][u][z]
  };
  double t_mm(int i) const;  ///< of a node
  std::size_t at(int t, int u, int z) const;

  const Printer& printer_;
  double n_, alpha_;
  std::vector<AperturePoint> points_;
  double reach_ = 0;    ///< slope of an aperture's edge
  double most_mm_ = 0;  ///< |t| up to which there is light
  double u_step_mm_ = 1;
  int heights_ = 2;
  double lowest_mm_ = 0, height_step_mm_ = 1;
  std::vector<Table> tables_;  ///< per ray
};

}  // namespace slicecorr::tomo::detail
