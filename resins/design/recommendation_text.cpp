// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "design/recommendation_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "design/designer.hpp"
#include "design/numbers.hpp"

namespace slicecorr::resins {

namespace {

std::string height_words(double he) {
  return fmt::format("{} um (base 10; {} um base e)", figure(units::height10_from_e(he)),
                     figure(he));
}

/// Whether the present absorber will do, and what to change of it.
void say_what_to_do(const Resin& resin, const Printer& printer, Recommendation& r) {
  const std::string at = printer.wavelength_nm > 0
                             ? fmt::format("at {:g} nm", printer.wavelength_nm)
                             : "at the wavelength of the curing light";
  const double present = make_kinetics(resin, false, true).hb_um;
  r.reasons.push_back(aim_words(resin));
  if (r.present_fits) {
    r.reasons.push_back(
        fmt::format("The resin as it is, {}, meets the wish already.", height_words(present)));
  } else {
    r.reasons.push_back(fmt::format(
        "The resin as it is, {}, does not meet the wish: its height is {} the range.",
        height_words(present), r.present_height10_um <= r.range->least_um ? "below" : "above"));
  }
  const double f = r.absorber_factor;
  const std::string best = height_words(r.height_e_um);
  if (f > 1.02) {
    r.reasons.push_back(fmt::format(
        "{}: add absorber until the absorbance {} is {:.3g} times what it is; the height is then "
        "{}.",
        r.present_fits ? "Best for gaps" : "Recommended", at, f, best));
  } else if (f < 0.98) {
    r.reasons.push_back(fmt::format(
        "{}: leave out absorber until the absorbance {} is {:.3g} times what it is; the height is "
        "then {}.",
        r.present_fits ? "Best for gaps" : "Recommended", at, f, best));
  } else {
    r.reasons.emplace_back("No other absorber would be better by much.");
  }
}

/// What the recommended height and those around it lead to.
void say_what_it_gives(Recommendation& r) {
  r.reasons.push_back(
      fmt::format("Any height between {} and {} um (base 10) will do. Below: {}. Above: {}.",
                  figure(r.range->least_um), figure(r.range->greatest_um), r.least_because,
                  r.greatest_because));
  r.reasons.push_back(fmt::format(
      "At the height above full light is {} times the critical intensity, black light {}; the "
      "fastest speed is {} mm/h{}.",
      figure(r.phi_max), figure(r.phi_min), figure(r.fastest_mm_h),
      r.slowest_mm_h > 0 ? fmt::format(", the slowest {} mm/h", figure(r.slowest_mm_h)) : ""));
  r.reasons.push_back(fmt::format(
      "With correction one grey level moves an edge by {} um at most; one percent more light moves "
      "an upper edge by {} um.",
      figure(r.corrected_error_um), figure(r.um_per_percent_of_light)));
}

void say_uncorrected(const Wish& wish, Recommendation& r) {
  r.reasons.push_back(fmt::format(
      "Without correction, at full light, thick features would reach {} um past their upper edge "
      "and miss {} um at their lower one.",
      figure(r.uncorrected.over_um), figure(r.uncorrected.under_um)));
  if (r.range_uncorrected) {
    r.reasons.push_back(fmt::format(
        "Without correction the tolerance needs an absorbance height between {} and {} um (base "
        "10) and one intensity for all lit pixels.",
        figure(r.range_uncorrected->least_um), figure(r.range_uncorrected->greatest_um)));
  } else {
    r.reasons.push_back(fmt::format(
        "Without correction no absorber meets {} um at this speed: the best error, with one "
        "intensity for all lit pixels, is {} um, at {} um (base 10).",
        figure(wish.tolerance_um), figure(r.best_uncorrected_error_um),
        figure(r.best_uncorrected_height10_um)));
  }
}

void say_dead_zone(const Wish& wish, Recommendation& r) {
  r.reasons.push_back(fmt::format(
      "A dead zone of {} um under full blue light takes {} mW/cm² of UV light; phi falls to {} "
      "by it.",
      figure(wish.dead_zone_um), figure(r.uv_needed_mw_cm2), figure(r.phi_with_uv)));
  r.warnings.emplace_back(
      "the correction does not reckon with UV light yet: near the window it takes dose away");
}

/// Of what is met, but barely.
void warn_of_little_room(const Printer& printer, Recommendation& r) {
  if (r.phi_max < 1.25) {
    r.warnings.push_back(fmt::format(
        "full light is only {} times the critical intensity: a dimmer lamp or a dose that is "
        "somewhat higher stops the print from gelling",
        figure(r.phi_max)));
  }
  if (r.gap_contrast < 0.03) {
    r.warnings.push_back(fmt::format(
        "a gap of {} um keeps a contrast of {} only: errors of a few percent in light or dose "
        "close it",
        figure(r.gap_um), figure(r.gap_contrast)));
  }
  const double travel_um = printer.travel_mm * 1000;
  if (travel_um > 0 && r.burst_um > travel_um) {
    r.warnings.push_back(fmt::format(
        "the lower end of a part takes {} um of extra slices, more than the stage's travel",
        figure(r.burst_um)));
  }
}

}  // namespace

void describe(const Resin& resin, const Printer& printer, const Wish& wish, Recommendation& r) {
  say_what_to_do(resin, printer, r);
  say_what_it_gives(r);
  say_uncorrected(wish, r);
  if (wish.dead_zone_um > 0) say_dead_zone(wish, r);
  r.reasons.push_back(
      "Assumed: absorber changes the absorbance height and leaves the areal gel dose as it is "
      "(measure again after mixing)" +
      std::string(wish.dead_zone_um > 0 ? "; the UV absorbance height stays as well." : "."));
  warn_of_little_room(printer, r);
  r.reasons.push_back(fmt::format(
      "Below a feature {} um of full light are needed; a gap of {} um keeps a contrast of {}.",
      figure(r.burst_um), figure(r.gap_um), figure(r.gap_contrast)));
}

void describe_places(const Resin& resin, const Printer& printer, const Wish& wish,
                     Recommendation& r) {
  if (!printer.flat_field) return;
  const FlatField& field = *printer.flat_field;
  std::array<std::uint64_t, 256> pixels{};
  for (const std::uint8_t v : *field.values) ++pixels[v];
  const double greatest = 1.0 * field.greatest() / field.reference;
  const Resin formulated = with_height(resin, r.height_e_um);
  Recommendation::Places places;
  places.greatest_light = greatest;
  places.least_light = greatest;
  double met = 0, least_met = kInfinity, greatest_met = 0;
  for (int v = 255; v > 0; --v) {
    const std::uint64_t count = pixels[static_cast<std::size_t>(v)];
    if (count == 0) continue;
    const double share = 1.0 * v / field.reference;
    places.least_light = share;
    const Printer there = dimmed(printer, share);
    const Designer d(resin, there, wish, wish.speed_mm_h);
    bool meets = d.phi_max(r.height_e_um) > 1 && d.phi_min(r.height_e_um) < 1 &&
                 d.error(r.height_e_um) <= wish.tolerance_um;
    if (wish.dead_zone_um > 0) {
      // One lamp for the whole window: it keeps the dead zone where light is brightest.
      const double uv = r.uv_needed_mw_cm2 * greatest;
      const Kinetics k = make_kinetics(formulated, true, true);
      meets = meets && uv <= d.lamp() &&
              passing_dose_prime(k, d.blue(), uv, wish.speed_mm_h) > k.critical_dose_prime;
    }
    if (!meets) continue;
    met += static_cast<double>(count);
    least_met = share;
    greatest_met = std::max(greatest_met, share);
  }
  places.share_met = met / static_cast<double>(field.values->size());
  const auto m = make_kinetics(resin, false, true).m;
  places.fastest_mm_h = r.fastest_mm_h * std::pow(places.least_light, m);
  places.slowest_mm_h = r.slowest_mm_h * std::pow(greatest, m);
  r.places = places;
  r.reasons.push_back(fmt::format(
      "All of this holds for places that get the light of the calibration. By its flat-field the "
      "display gives {:.3g} to {:.3g} % of it{}: with the height above the resin gels everywhere{} "
      "up to {} mm/h{}.",
      100 * places.least_light, 100 * greatest,
      pixels[0] > 0 ? ", and none at all in some places" : "", pixels[0] > 0 ? " else" : "",
      at_most(places.fastest_mm_h * (1 - 1e-9)),
      places.slowest_mm_h > 0 ? fmt::format(", and black leaves it liquid from {} mm/h on",
                                            at_least(places.slowest_mm_h * (1 + 1e-9)))
                              : ""));
  if (places.share_met >= 1) {
    r.reasons.emplace_back("The wish is met on the whole display.");
  } else if (met > 0) {
    r.warnings.push_back(fmt::format(
        "the wish is met on {:.3g} % of the display only, where it gives {:.3g} to {:.3g} % of the "
        "calibration's light",
        100 * places.share_met, 100 * least_met, 100 * greatest_met));
  } else {
    r.warnings.emplace_back(
        "the wish is met nowhere on the display: no place gets the light of the calibration");
  }
}

}  // namespace slicecorr::resins
