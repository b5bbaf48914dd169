// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// All that a recommended absorber is found from: docs/design.md, section recommend. Heights are
/// base e, um.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>

#include "slicecorr/cure.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Gaps are judged by the shortest one of which both edges can be right.
inline constexpr int kGapSlices = 2;

/// x in [low, high] where `holds` changes from `at_low`, in ratio to 1e-13.
double boundary(double low, double high, bool at_low, const std::function<bool(double)>& holds);

/// All that a recommendation is found from, at one speed.
class Designer {
 public:
  Designer(const Resin& resin, const Printer& printer, const Wish& wish, double speed_mm_h);

  double m() const { return m_; }
  double blue() const { return blue_; }
  double black() const { return black_; }
  double ratio() const { return ratio_; }
  /// Height at which black light reaches the critical intensity.
  double black_limit() const { return ratio_ > 0 ? limit_ / ratio_ : kInfinity; }
  double phi_max(double he) const { return he / limit_; }
  double phi_min(double he) const { return ratio_ * he / limit_; }

  CureModel model(double he) const;
  /// Of the edge that one grey level moves most, um.
  double error(double he) const;

  Kinetics inhibited(double he) const { return make_kinetics(with_height(resin_, he), true, true); }
  double huv() const { return units::height_e_from_10(resin_.inhibition->absorbance_height10_um); }
  /// (3.25) solved for the UV light, at full blue light.
  double uv_needed(double he) const;
  double phi_with_uv(double he) const;
  double lamp() const { return printer_.uv ? printer_.uv->max_mw_cm2() : 0; }
  bool keeps_any_dead_zone() const;

  /// Interval of heights that gel, keep gaps liquid and keep the dead zone; with what sets its
  /// ends.
  struct HeightLimits {
    double low = 0, high = kInfinity;
    std::string low_because, high_because;
    bool any() const { return low * (1 + 1e-9) < high; }
  };
  HeightLimits limits() const;

  /// Where the falling error of lower edges and the rising one of upper edges meet, or the end
  /// nearest to that.
  double least_of_piece(double start, double end) const;

  /// Heights within `l` at which no edge moves by more than the tolerance; the longest stretch.
  /// `least_error` takes the least error there is.
  std::optional<HeightLimits> within_tolerance(const HeightLimits& l, double& least_error) const;

  /// Error of both edges at the best single intensity up to full light, without correction.
  double uncorrected_error(double he) const;
  /// Height of the least such error: full light is the balanced intensity.
  double best_uncorrected() const { return limit_ * (2 - ratio_); }
  /// Heights at which it is within the tolerance.
  std::optional<HeightRange> uncorrected_range() const;

  double gap_um() const { return kGapSlices * wish_.layer_um; }
  double contrast(double he) const;
  /// The height from `low` to `high` at which gaps keep most contrast.
  double best_contrast(double low, double high) const;

 private:
  const Resin& resin_;
  Printer printer_;
  const Wish& wish_;
  double speed_, m_ = 1, blue_ = 0, black_ = 0, limit_ = 0, ratio_ = 0;
};

/// Fills what the wish's cap and disc ask for, with sentences.
void design_peak(const Designer& designer, const Wish& wish, Recommendation& r);
void design_disc(const Resin& resin, const Printer& printer, const Wish& wish, Recommendation& r);

}  // namespace slicecorr::resins
