// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What scans are asked for, and what a print is when they are so.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstddef>

#include "slicecorr/resins/scan_tune.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::resins {

/// Changes of what the files say, in the order of `ScanInput`.
using ScanVector = std::array<double, kScanInputs>;

constexpr std::size_t at(ScanInput input) { return static_cast<std::size_t>(input); }

/// What messages call them.
inline constexpr std::array<const char*, kScanInputs> kScanNames{"absorbance height",
                                                                 "light over dose",
                                                                 "stray light",
                                                                 "exchange at lifts",
                                                                 "shrinkage in the plane",
                                                                 "shrinkage along z",
                                                                 "offset of walls",
                                                                 "growth of the first layers",
                                                                 "light that spreads",
                                                                 "light that scatters",
                                                                 "dead zone"};

/// How wide light spreads at the window: the standard deviation of all Gaussians together, um; 0 where it does not.
double spread_width_um(const LightSpread& spread);
/// The same spread, so much wide. A picture stays as it is.
LightSpread spread_as_wide(const LightSpread& spread, double width_um);

class ScanInputs {
 public:
  /// `layerwise`: some print has lifts that exchange resin; `uv`: some was made under UV light.
  ScanInputs(const Setup& setup, const TunePrior& prior, const ScanTuneOptions& options,
             bool layerwise, bool uv);

  bool sought(std::size_t k) const { return sought_[k]; }
  /// Whether it is seen where a print is predicted anew; else it moves what is predicted in closed form.
  bool predicted(std::size_t k) const;
  const Eigen::VectorXd& mean() const { return mean_; }
  const Eigen::MatrixXd& before() const { return before_; }
  /// The nearest change that can be.
  double within(std::size_t k, double change) const;
  /// How far a difference goes down and up; down 0: there is no less of it.
  std::array<double, 2> steps(std::size_t k, double change) const;
  /// The scale on which surfaces are straight.
  double scale(std::size_t k) const { return scale_[k]; }
  /// A print of `setup` with these changes. Growth of the first layers is in it as far as there can be one.
  Setup setup_at(const Setup& setup, const ScanVector& change) const;
  /// What of the growth is not in that, mm.
  double growth_left_mm(double change_mm) const;

 private:
  std::array<bool, kScanInputs> sought_{};
  ScanVector least_{}, most_{}, scale_{};
  double spread_um_ = 0, pixel_um_ = 0, growth_um_ = 0;
  Eigen::VectorXd mean_;
  Eigen::MatrixXd before_;
};

}  // namespace slicecorr::resins
