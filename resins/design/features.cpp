// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a recommended resin does to one feature: its greatest dose, and the resin that flows under a disc.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "design/designer.hpp"
#include "design/numbers.hpp"
#include "slicecorr/flow_disc.hpp"
#include "slicecorr/flow_suction.hpp"
#include "slicecorr/same_light.hpp"

namespace slicecorr::resins {

namespace {

/// Heights between the ends of the range that are looked at for the most even one.
constexpr int kHeights = 4;
/// Doses are wanted to a few thousandths here: coarser than the flow's own grid.
constexpr DiscGrid kCoarse{.levels = 32, .steps = 100};

/// With UV light and inhibition; else the suction alone.
bool has_dead_zone(const Resin& resin, const Printer& printer) {
  return resin.inhibition.has_value() && printer.uv.has_value();
}

EvenDisc disc_of(const Resin& resin, const Printer& printer, const Wish& wish, double height_e_um) {
  const double limit_pa = printer.suction_limit_pa > 0 ? printer.suction_limit_pa : kCavitationPa;
  EvenDisc disc;
  disc.height_e_um = height_e_um;
  disc.gap_um = kDefaultGapUm;
  if (has_dead_zone(resin, printer)) {
    const DiscPrint print{DiscShape::disc, wish.disc_radius_mm, wish.speed_mm_h};
    const FlowResin flows = flow_resin(with_height(resin, height_e_um));
    DiscGoal goal;
    goal.blue_most_mw_cm2 = printer.calibration.back().intensity_mw_cm2;
    goal.uv_most_mw_cm2 = printer.uv->max_mw_cm2();
    const DiscOptimum best = best_disc_light(flows, print, goal, kCoarse);
    disc.gap_um = best.gap_um;
    disc.blue_mw_cm2 = best.light.blue_mw_cm2.at(0);
    disc.uv_mw_cm2 = best.light.uv_mw_cm2.at(0);
    disc.share_within = best.share_within;
    disc.mean_square = best.mean_square;
    disc.gap_at_limit = best.gap_at_limit;
  }
  // 3 mu S R²/h³ in the middle, half of it in the mean.
  const double radius_m = wish.disc_radius_mm * 1e-3, gap_m = disc.gap_um * 1e-6;
  disc.suction_pa = 3 * resin.viscosity_pa_s * units::cm_s_from_mm_h(wish.speed_mm_h) * 1e-2 *
                    radius_m * radius_m / (gap_m * gap_m * gap_m);
  disc.force_n = 0.5 * std::numbers::pi * radius_m * radius_m * disc.suction_pa;
  disc.fastest_mm_h = wish.speed_mm_h * limit_pa / disc.suction_pa;
  return disc;
}

std::string in_words(const EvenDisc& disc) {
  return fmt::format(
      "a gap of {} under {} and {} mW/cm² of curing and UV light has its dose within a tenth on {:.3g} % "
      "of the radius",
      disc.gap_at_limit ? figure(disc.gap_um) + " um, where gaps end,"
                        : figure(disc.gap_um) + " um",
      figure(disc.blue_mw_cm2), figure(disc.uv_mw_cm2), 100 * disc.share_within);
}

}  // namespace

Peak peak_of_feature(double phi_max, double phi_min, double effective_um, double height_um) {
  // Up from the lower edge with full light, down to the upper edge with black: they meet there.
  const double over = 1 - phi_min, spare = phi_max - 1;
  const double decay = std::exp(-height_um / effective_um);
  Peak peak;
  peak.omega = over * (phi_max - phi_min) / (over + spare * decay) + phi_min;
  peak.below_top_um = effective_um * std::log((peak.omega - phi_min) / over);
  return peak;
}

double height_for_peak_um(double phi_max, double phi_min, double effective_um, double omega) {
  if (!(omega < phi_max)) return kInfinity;
  return effective_um *
         std::log((phi_max - 1) * (omega - phi_min) / ((1 - phi_min) * (phi_max - omega)));
}

void design_peak(const Designer& designer, const Wish& wish, Recommendation& r) {
  const double effective = r.height_e_um / designer.m();
  const double height = height_for_peak_um(r.phi_max, r.phi_min, effective, wish.omega_max);
  r.height_for_omega_um = height;
  r.peak = peak_of_feature(r.phi_max, r.phi_min, effective, height);
  if (std::isfinite(height)) {
    r.reasons.push_back(fmt::format(
        "A corrected feature gets a dose of {} inside from {} um of height on, {} um below its upper edge; "
        "lower ones get less, whatever the cap (omega_max).",
        figure(wish.omega_max), at_least(height), figure(r.peak.below_top_um)));
    return;
  }
  // phi_max goes as one over the speed.
  r.warnings.push_back(fmt::format(
      "no feature gets a dose of {} inside at this speed: full light leads to {} at most; a speed below {} "
      "mm/h would do",
      figure(wish.omega_max), figure(r.phi_max), at_most(r.fastest_mm_h / wish.omega_max)));
}

namespace {

/// Shares of the calibration's light that a lamp gives at its dimmest and its brightest place.
std::array<double, 2> shares_of(const std::optional<FlatField>& field) {
  if (!field) return {1, 1};
  return {1.0 * field->least() / field->reference, 1.0 * field->greatest() / field->reference};
}

/// Share of the radius within 10 % of its dose, and the greatest dose at the window, where lamps give these shares of
/// the disc's light.
struct AtPlace {
  double within = 0, window = 0;
};
AtPlace disc_at(const FlowResin& flows, const DiscPrint& print, const EvenDisc& disc, double blue,
                double uv) {
  const DiscDose dose =
      disc_dose(flows, print, even_curve(disc.gap_um),
                even_light(blue * disc.blue_mw_cm2, uv * disc.uv_mw_cm2), kCoarse);
  AtPlace at;
  const RadialCurve& f = dose.front;
  for (std::size_t i = 1; i < f.r.size(); ++i) {
    const double mean = 0.5 * (f.value[i] + f.value[i - 1]);
    if (std::abs(mean - 1) <= 0.1) at.within += f.r[i] - f.r[i - 1];
  }
  at.window = *std::max_element(dose.window.value.begin(), dose.window.value.end());
  return at;
}

/// Even light is the lamps' at the calibration's places: what it does at others.
void disc_by_place(const Resin& resin, const Printer& printer, const Wish& wish,
                   const EvenDisc& disc, Recommendation& r) {
  if (!printer.flat_field && !printer.uv_flat_field) return;
  const auto blue = shares_of(printer.flat_field), uv = shares_of(printer.uv_flat_field);
  const DiscPrint print{DiscShape::disc, wish.disc_radius_mm, wish.speed_mm_h};
  const FlowResin flows = flow_resin(with_height(resin, disc.height_e_um));
  const AtPlace dim = disc_at(flows, print, disc, blue[0], uv[1]);
  const AtPlace bright = disc_at(flows, print, disc, blue[1], uv[0]);
  r.reasons.push_back(fmt::format(
      "By the flat-fields of the lamps {} to {} of this blue light and {} to {} of this UV light come: with least blue "
      "and most UV light {:.0f} % of the radius lies within 10 % of their dose, with most blue and least UV light {:.0f} % "
      "(each as if it were even over the disc).",
      figure(blue[0]), figure(blue[1]), figure(uv[0]), figure(uv[1]), 100 * dim.within,
      100 * bright.within));
  if (bright.window >= 1) {
    r.warnings.push_back(fmt::format(
        "where the display gives {} and the UV lamp {} of their light the disc of {} mm sticks to the window: the dose "
        "there is {} times that of gel",
        figure(blue[1]), figure(uv[0]), figure(wish.disc_radius_mm), figure(bright.window)));
  }
}

}  // namespace

void design_disc(const Resin& resin, const Printer& printer, const Wish& wish, Recommendation& r) {
  r.disc = disc_of(resin, printer, wish, r.height_e_um);
  const EvenDisc& disc = *r.disc;
  if (has_dead_zone(resin, printer)) {
    r.disc_present = disc_of(resin, printer, wish, units::height_e_from_10(r.present_height10_um));
    r.reasons.push_back(fmt::format(
        "Even light under a disc of {} mm radius, resin flowing: with the height above {}; with "
        "the resin as it is {}.",
        figure(wish.disc_radius_mm), in_words(disc), in_words(*r.disc_present)));
    disc_by_place(resin, printer, wish, disc, r);
    // Blue light must reach further than UV light.
    const double huv = units::height_e_from_10(resin.inhibition->absorbance_height10_um);
    const double low = std::max(units::height_e_from_10(r.range->least_um), huv * 1.01);
    const double high = units::height_e_from_10(r.range->greatest_um);
    EvenDisc most = disc;
    for (int i = 0; i <= kHeights && high > low; ++i) {
      const double he = low * std::pow(high / low, 1.0 * i / kHeights);
      const EvenDisc other = disc_of(resin, printer, wish, he);
      if (other.mean_square < most.mean_square) most = other;
    }
    if (const Resin given = with_height(resin, most.height_e_um);
        most.height_e_um != disc.height_e_um) {
      r.reasons.push_back(fmt::format(
          "Of {} heights over the range {} um (base 10) leaves the most even dead zone: {}.",
          kHeights + 2, figure(given.absorbance_height10_um), in_words(most)));
    }
    r.disc_most_even = most;
  }
  r.reasons.push_back(fmt::format(
      "In a gap of {} um{} the disc draws {} Pa and {} N; {} mm/h reach {}.", figure(disc.gap_um),
      has_dead_zone(resin, printer) ? "" : " (assumed: no UV light makes one)",
      figure(disc.suction_pa), figure(disc.force_n), at_most(disc.fastest_mm_h),
      printer.suction_limit_pa > 0 ? "what the vat bears" : "1 bar"));
  if (disc.fastest_mm_h < wish.speed_mm_h) {
    r.warnings.push_back(fmt::format(
        "the disc of {} mm draws more than {} at {} mm/h (slicecorr flow tells it of parts)",
        figure(wish.disc_radius_mm), printer.suction_limit_pa > 0 ? "the vat bears" : "1 bar",
        figure(wish.speed_mm_h)));
  }
}

}  // namespace slicecorr::resins
