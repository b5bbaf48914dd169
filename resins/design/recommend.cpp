// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The absorber that a speed and a tolerance need: docs/design.md, section recommend.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "design/designer.hpp"
#include "design/numbers.hpp"
#include "design/recommendation_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {

namespace {

/// The recommended height keeps this factor from the ends of the range.
constexpr double kMargin = 1.02;

/// Whether some absorber meets the wish.
bool any_meets(const Resin& resin, const Printer& printer, const Wish& wish) {
  const Designer d(resin, printer, wish, wish.speed_mm_h);
  double least = 0;
  return d.within_tolerance(d.limits(), least).has_value();
}

constexpr int kWayDigits = 3;

/// The value nearest to `now` on the way to `end`, in steps of 15 %, at which `works` holds, with
/// as many digits as that takes; empty when there is none.
std::string first_that_works(double now, double end, const std::function<bool(double)>& works) {
  const bool up = end > now;
  const double step = up ? 1 / 0.85 : 0.85;
  double fails = now;
  for (int i = 0; i < 40 && fails != end; ++i) {
    const double next = up ? std::min(end, fails * step) : std::max(end, fails * step);
    if (!works(next)) {
      fails = next;
      continue;
    }
    const double limit =
        up ? boundary(fails, next, false, works) : boundary(next, fails, true, works);
    for (int digits = kWayDigits; digits <= 15; digits += 2) {
      const double typed = up ? rounded_up(limit, digits) : rounded_down(limit, digits);
      if (works(typed)) return fmt::format("{}", typed);
    }
    return {};
  }
  return {};
}

std::vector<std::string> ways_out(const Designer& d, const Resin& resin, const Printer& printer,
                                  const Wish& wish, const Designer::HeightLimits& limits,
                                  double least_error) {
  std::vector<std::string> ways;
  const auto with_speed = [&](double speed) {
    Wish w = wish;
    w.speed_mm_h = speed;
    return any_meets(resin, printer, w);
  };
  if (!limits.any() && wish.dead_zone_um > 0) {
    std::string text =
        d.keeps_any_dead_zone()
            ? fmt::format(
                  "the UV lamp's {} mW/cm² do not keep a dead zone of {} um and let full light ({} "
                  "mW/cm²) gel the resin at {} mm/h",
                  figure(d.lamp()), figure(wish.dead_zone_um), figure(d.blue()),
                  figure(wish.speed_mm_h))
            : fmt::format(
                  "no dead zone lasts under full blue light ({} mW/cm²) with the UV lamp's {} "
                  "mW/cm²",
                  figure(d.blue()), figure(d.lamp()));
    const auto with_lamp = [&](double most) {
      Printer p = printer;
      if (!p.uv) p.uv = UvLamp{0, false, {{0, 0}, {1, most}}};
      p.uv->calibration.back().intensity_mw_cm2 = most;
      return any_meets(resin, p, wish);
    };
    const double lamp = std::max(d.lamp(), d.blue() / resin.inhibition->beta * 0.5);
    if (const auto most = first_that_works(lamp, lamp * 1e4, with_lamp); !most.empty()) {
      text += fmt::format("; a UV lamp of {} mW/cm² would do", most);
    }
    const auto with_zone = [&](double zone_um) {
      Wish w = wish;
      w.dead_zone_um = zone_um;
      return any_meets(resin, printer, w);
    };
    if (const auto zone = first_that_works(wish.dead_zone_um, wish.dead_zone_um * 1e-3, with_zone);
        !zone.empty()) {
      text += fmt::format("; a dead zone of {} um would do", zone);
    }
    const auto with_blue = [&](double most) {
      Printer p = printer;
      for (CalibrationPoint& c : p.calibration) c.intensity_mw_cm2 *= most / d.blue();
      return any_meets(resin, p, wish);
    };
    if (const auto blue = first_that_works(d.blue(), d.blue() * 1e-3, with_blue); !blue.empty()) {
      text += fmt::format(
          "; a projector of {} mW/cm² at full light, and black in proportion, would do", blue);
    }
    ways.push_back(text);
  } else if (!limits.any()) {
    ways.push_back(fmt::format(
        "the printer's black ({} mW/cm²) is too bright against its full light ({} mW/cm²), or the "
        "speed of {} mm/h is beyond every absorbance height of a resin file",
        figure(d.black()), figure(d.blue()), figure(wish.speed_mm_h)));
  } else {
    ways.push_back(fmt::format(
        "one grey level moves an edge by {} um at the least, whatever the absorber; that tolerance "
        "would do, or a projector with finer steps below the critical intensity",
        at_least(least_error, kWayDigits)));
  }
  if (const auto slower = first_that_works(wish.speed_mm_h, wish.speed_mm_h * 1e-3, with_speed);
      !slower.empty()) {
    ways.push_back(fmt::format("a speed of {} mm/h meets the rest of the wish", slower));
  }
  return ways;
}

void check_wish(const Printer& printer, const Resin& resin, const Wish& wish) {
  if (!(wish.speed_mm_h > 0) || !(wish.tolerance_um > 0) || !(wish.layer_um > 0)) {
    throw InputError("a wish needs a speed, a tolerance and a slice height above 0");
  }
  if (printer.max_speed_mm_h > 0 && wish.speed_mm_h > printer.max_speed_mm_h) {
    throw InputError(
        fmt::format("speed {:g} mm/h is beyond the stage of printer '{}', which reaches {:g} mm/h",
                    wish.speed_mm_h, printer.name, printer.max_speed_mm_h));
  }
  if (wish.omega_max != 0 && !(wish.omega_max > 1)) {
    throw InputError(
        "a wanted dose inside features is at most 1, which edges have; expected one above 1");
  }
  if (wish.disc_radius_mm > 0 && !(resin.viscosity_pa_s > 0)) {
    throw InputError(
        resin.name, "viscosity_pa_s",
        "is missing: nothing is known of how the resin flows; expected the viscosity in Pa·s");
  }
  if (wish.dead_zone_um > 0 && !resin.inhibition) {
    throw InputError(resin.name, "inhibition",
                     "a dead zone is asked for, but the resin has no inhibition by UV light; "
                     "expected beta and absorbance_height_um");
  }
}

}  // namespace

Recommendation recommend(const Resin& resin, const Printer& printer, const Wish& wish) {
  refuse_relative(printer, "a resin that is recommended");
  check_same_unit(printer, resin);
  refuse_law(resin, LawUse::absorber);
  check_wish(printer, resin, wish);
  const Designer d(resin, printer, wish, wish.speed_mm_h);
  Recommendation r;
  r.present_height10_um = resin.absorbance_height10_um;
  r.range_uncorrected = d.uncorrected_range();
  r.best_uncorrected_height10_um = units::height10_from_e(d.best_uncorrected());
  r.best_uncorrected_error_um = d.uncorrected_error(d.best_uncorrected());
  const Designer::HeightLimits limits = d.limits();
  double least_error = kInfinity;
  const auto found = d.within_tolerance(limits, least_error);
  if (!found) {
    r.ways_out = ways_out(d, resin, printer, wish, limits, least_error);
    if (printer.flat_field) {
      r.ways_out.push_back(fmt::format(
          "this is said of places that get the light of the calibration; by its flat-field the "
          "display gives {}",
          light_in_words(printer)));
    }
    return r;
  }
  r.feasible = true;
  r.range = HeightRange{units::height10_from_e(found->low), units::height10_from_e(found->high)};
  r.least_because = found->low_because;
  r.greatest_because = found->high_because;
  r.present_fits =
      r.present_height10_um > r.range->least_um && r.present_height10_um < r.range->greatest_um;

  const double narrow = std::sqrt(found->high / found->low);
  const double margin = std::min(kMargin, std::sqrt(narrow));
  const double he = d.best_contrast(found->low * margin, found->high / margin);
  const CureModel model = d.model(he);
  r.height_e_um = he;
  r.height10_um = units::height10_from_e(he);
  r.absorber_factor = r.present_height10_um / r.height10_um;
  r.phi_max = model.phi_max();
  r.phi_min = model.phi_min();
  r.fastest_mm_h = wish.speed_mm_h * r.phi_max;
  r.slowest_mm_h = wish.speed_mm_h * r.phi_min;
  r.corrected_error_um = d.error(he);
  const double effective = he / d.m();
  // Dose and floor both rise by a percent: the decay reaches 1 that much later.
  const double more = 1.01;
  r.um_per_percent_of_light =
      more * r.phi_min < 1 ? effective * std::log(more * (1 - r.phi_min) / (1 - more * r.phi_min))
                           : kInfinity;
  r.uncorrected = uncorrected_edges(r.phi_max, r.phi_min, effective);
  r.burst_um = r.uncorrected.under_um;
  r.gap_um = d.gap_um();
  r.gap_contrast = d.contrast(he);
  if (wish.dead_zone_um > 0) {
    r.uv_needed_mw_cm2 = d.uv_needed(he);
    r.phi_with_uv = d.phi_with_uv(he);
  }
  describe(resin, printer, wish, r);
  describe_places(resin, printer, wish, r);
  if (wish.omega_max > 0) design_peak(d, wish, r);
  if (wish.disc_radius_mm > 0) design_disc(resin, printer, wish, r);
  return r;
}

}  // namespace slicecorr::resins
