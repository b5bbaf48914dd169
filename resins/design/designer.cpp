// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "design/designer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "design/numbers.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::resins {

namespace {

Process continuous(double speed_mm_h) {
  Process process;
  process.speed_mm_h = speed_mm_h;
  return process;
}

/// The absorbance heights that definitions may have (base 10, um), as base e.
constexpr double kGreatestHeightE = 1e7 / units::kLn10;

/// How far one grey level moves an upper and a lower edge at most, beside gaps that keep half the
/// contrast.
struct EdgeSteps {
  double upper_um = kInfinity, lower_um = kInfinity;
};

EdgeSteps edge_steps(const CureModel& model) {
  if (!(model.phi_max() > 1) || !(model.phi_min() < 1)) return {};
  double step = 0;
  for (std::size_t l = 1; l < model.level_phi.size(); ++l) {
    step = std::max(step, model.level_phi[l] - model.level_phi[l - 1]);
  }
  // A lower edge hangs on the fractional slice that begins the burst. A step there has decayed at
  // the edge by (phi - 1) / (phi - W), W the dose above that slice, and the edge moves by the rest
  // over the slope phi - 1. W is at most one slice of the burst above the least dose of the gap,
  // half the critical one. A burst of one slice is no brighter than it must be.
  const double contrast = std::min(model.phi_max() - 0.5, 0.5 / model.one_minus_a);
  return {model.level_step_um(), model.layer_um * step * model.one_minus_a /
                                     (model.a * units::kLn10 * model.eta * contrast)};
}

}  // namespace

double boundary(double low, double high, bool at_low, const std::function<bool(double)>& holds) {
  const Bracket found =
      halved_by_ratio({low, high}, 200, 1 + 1e-14, [&](double x) { return holds(x) == at_low; });
  return at_low ? found.low : found.high;
}

Designer::Designer(const Resin& resin, const Printer& printer, const Wish& wish, double speed_mm_h)
    : resin_(resin), printer_(for_resin(printer, resin)), wish_(wish), speed_(speed_mm_h) {
  const Kinetics k = make_kinetics(resin, false, true);
  m_ = k.m;
  blue_ = printer.calibration.back().intensity_mw_cm2;
  black_ = printer.calibration.front().intensity_mw_cm2;
  // phi_max = he / limit_: the areal dose does not depend on the absorber.
  limit_ = m_ * units::cm_s_from_mm_h(speed_) * k.critical_dose_prime / std::pow(blue_, m_) * 1e4;
  ratio_ = std::pow(black_ / blue_, m_);
}

CureModel Designer::model(double he) const {
  return make_cure_model(printer_, with_height(resin_, he), continuous(speed_), wish_.layer_um);
}

double Designer::error(double he) const {
  const EdgeSteps e = edge_steps(model(he));
  return std::max(e.upper_um, e.lower_um);
}

double Designer::uv_needed(double he) const {
  const Inhibition& i = *resin_.inhibition;
  return blue_ / i.beta * std::exp(wish_.dead_zone_um * (1 / huv() - 1 / he));
}

double Designer::phi_with_uv(double he) const {
  const Kinetics k = inhibited(he);
  return passing_dose_prime(k, blue_, uv_needed(he), speed_) / k.critical_dose_prime;
}

bool Designer::keeps_any_dead_zone() const {
  return keeps_dead_zone(make_kinetics(resin_, true, true), blue_, lamp());
}

Designer::HeightLimits Designer::limits() const {
  HeightLimits l{limit_, std::min(black_limit(), kGreatestHeightE), {}, {}};
  l.low_because = fmt::format("full light ({} mW/cm²) gels the resin at {} mm/h above it",
                              figure(blue_), figure(speed_));
  l.high_because =
      black_limit() < kGreatestHeightE
          ? fmt::format("black pixels ({} mW/cm²) gel the resin from there on", figure(black_))
          : "no resin file goes beyond it";
  if (!(wish_.dead_zone_um > 0)) return l;
  // Above huv, and where full light still gels the resin against the UV light.
  const double least = std::max(l.low, huv() * (1 + 1e-9));
  const auto gels = [&](double he) { return phi_with_uv(he) > 1; };
  double low = kGreatestHeightE;
  if (gels(kGreatestHeightE)) {
    low = gels(least) ? least : boundary(least, kGreatestHeightE, false, gels);
  }
  if (low > l.low) {
    l.low = low;
    l.low_because = low <= huv() * (1 + 1e-8)
                        ? "blue light must reach further than UV light for a dead zone"
                        : "full light gels the resin against the UV light above it";
  }
  // The stronger the blue light reaches, the more UV light the dead zone takes.
  const double longest =
      1 / huv() - std::log(resin_.inhibition->beta * lamp() / blue_) / wish_.dead_zone_um;
  const double high = !keeps_any_dead_zone() ? 0.0 : longest > 0 ? 1 / longest : kInfinity;
  if (high < l.high) {
    l.high = high;
    l.high_because = fmt::format(
        "the UV lamp's {} mW/cm² keep a dead zone of {} um under full blue light up to there",
        figure(lamp()), figure(wish_.dead_zone_um));
  }
  return l;
}

double Designer::least_of_piece(double start, double end) const {
  const auto rising = [&](double he) {
    const EdgeSteps e = edge_steps(model(he));
    return e.upper_um >= e.lower_um;
  };
  if (rising(start)) return start;
  return rising(end) ? boundary(start, end, false, rising) : end;
}

std::optional<Designer::HeightLimits> Designer::within_tolerance(const HeightLimits& l,
                                                                 double& least_error) const {
  least_error = kInfinity;
  if (!l.any()) return std::nullopt;
  // Between heights at which a grey level passes phi = 1 the error of upper edges rises with the
  // height, that of lower edges falls. So each piece holds one stretch at most.
  std::vector<double> cuts{l.low * (1 + 1e-12), l.high * (1 - 1e-12)};
  for (const double i : level_intensities(printer_)) {
    if (!(i > 0)) continue;
    const double he = limit_ * std::pow(blue_ / i, m_) * (1 + 1e-12);
    if (he > cuts[0] && he < cuts[1]) cuts.push_back(he);
  }
  std::sort(cuts.begin(), cuts.end());
  const auto fits = [&](double he) { return error(he) <= wish_.tolerance_um; };
  std::optional<HeightLimits> best, open;
  const auto close = [&] {
    if (open && (!best || open->high / open->low > best->high / best->low)) best = open;
    open.reset();
  };
  const std::string tolerance = fmt::format(
      "one grey level moves an edge by the {} um allowed there", figure(wish_.tolerance_um));
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i) {
    const double start = cuts[i], end = cuts[i + 1] * (1 - 2e-12);
    if (!(end > start)) continue;
    const double bottom = least_of_piece(start, end);
    least_error = std::min(least_error, error(bottom));
    if (!fits(bottom)) {
      close();
      continue;
    }
    if (!fits(start)) {
      close();
      open = HeightLimits{boundary(start, bottom, false, fits), 0, tolerance, {}};
    } else if (!open) {
      open = HeightLimits{i == 0 ? l.low : start, 0, i == 0 ? l.low_because : tolerance, {}};
    }
    if (fits(end)) {
      open->high = i + 2 == cuts.size() ? l.high : end;
      open->high_because = l.high_because;
    } else {
      open->high = boundary(bottom, end, true, fits);
      open->high_because = tolerance;
      close();
    }
  }
  close();
  return best;
}

double Designer::uncorrected_error(double he) const {
  // Over and under are equal where phi² - 2 phi + phi_min = 0.
  const double balanced = 1 + std::sqrt(std::max(0.0, 1 - phi_min(he)));
  const UncorrectedEdges e =
      uncorrected_edges(std::min(balanced, phi_max(he)), phi_min(he), he / m_);
  return std::max(e.over_um, e.under_um);
}

std::optional<HeightRange> Designer::uncorrected_range() const {
  const auto fits = [&](double he) { return uncorrected_error(he) <= wish_.tolerance_um; };
  const double best = best_uncorrected();
  if (!fits(best)) return std::nullopt;
  double high = std::min(black_limit(), kGreatestHeightE) * (1 - 1e-12);
  if (!fits(high)) high = boundary(best, high, true, fits);
  const double low = boundary(limit_ * (1 + 1e-12), best, false, fits);
  return HeightRange{units::height10_from_e(low), units::height10_from_e(high)};
}

double Designer::contrast(double he) const {
  return gap_contrast(phi_max(he), phi_min(he), he / m_, gap_um());
}

double Designer::best_contrast(double low, double high) const {
  for (int i = 0; i < 200 && high / low > 1 + 1e-10; ++i) {
    const double third = std::pow(high / low, 1.0 / 3);
    const double p = low * third, q = p * third;
    (contrast(p) > contrast(q) ? high : low) = contrast(p) > contrast(q) ? q : p;
  }
  return std::sqrt(low * high);
}

UncorrectedEdges uncorrected_edges(double phi, double phi_min, double effective_um) {
  UncorrectedEdges e;
  e.over_um = phi > 1 && phi_min < 1 ? effective_um * std::log((phi - phi_min) / (1 - phi_min))
              : phi > 1              ? kInfinity
                                     : 0;
  e.under_um = phi > 1 ? -effective_um * std::log1p(-1 / phi) : kInfinity;
  return e;
}

double gap_contrast(double phi_max, double phi_min, double effective_um, double gap_um) {
  if (!(phi_max > 1) || !(phi_min < 1)) return 0;
  // From the lower feature the dose decays upwards to phi_min, from the upper one it must rise
  // downwards, seen from its edge, along phi_max - (phi_max - 1) u; they meet at u (as in A.41).
  const double decay = std::exp(-gap_um / effective_um);
  const double u = (phi_max - phi_min) / ((1 - phi_min) * decay + phi_max - 1);
  return (phi_max - 1) * (u - 1);
}

Resin with_height(const Resin& resin, double height_e_um) {
  Resin r = resin;
  r.absorbance_height10_um = units::height10_from_e(height_e_um);
  // Less absorption than that of what cures takes some of this away.
  if (r.active_absorption_per_cm >= absorption_per_cm(r)) r.active_absorption_per_cm = 0;
  const double before = dose_height_e_um(resin), after = dose_height_e_um(r);
  r.critical_dose_mj_cm3 = units::volumetric_from_areal(
      units::areal_from_volumetric(resin.critical_dose_mj_cm3, before), after);
  r.gel_dose_mj_cm3 = units::volumetric_from_areal(
      units::areal_from_volumetric(resin.gel_dose_mj_cm3, before), after);
  return r;
}

double corrected_error_um(const Printer& printer, const Resin& resin, double speed_mm_h,
                          double layer_um) {
  const EdgeSteps e = edge_steps(make_cure_model(printer, resin, continuous(speed_mm_h), layer_um));
  return std::max(e.upper_um, e.lower_um);
}

}  // namespace slicecorr::resins
