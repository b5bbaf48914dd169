// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What each kind of part would tell: expected information gain, nat.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "slicecorr/correct.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/test_part.hpp"
#include "slicecorr/tuning_part.hpp"
#include "slicecorr/units.hpp"
#include "spread/model.hpp"
#include "tune/matrix.hpp"
#include "tune/printed_resin.hpp"

namespace slicecorr::resins {

namespace {

/// What is taken to be known of what tuning does not find, relative standard deviations.
constexpr double kSpreadSd = 0.3, kFlatSd = 0.05, kInhibitionSd = 0.1;
/// Sigma where the printer file has none, in pixels.
constexpr double kSpreadPixels = 0.5;

MeasuredPart plugs_of(const TuningPart& part) {
  MeasuredPart measured;
  for (const TuningPart::Row& r : part.rows()) {
    MeasuredEdge e;
    e.name = r.name;
    e.exposure_s = r.shown_s;
    e.intensity_mw_cm2 = r.intensity_mw_cm2;
    e.dark_s = r.dark_s;
    e.dark_mw_cm2 = r.dark_mw_cm2;
    measured.edges.push_back(e);
  }
  return measured;
}

/// The speed at which black and full light are as far from the dose that is aimed at, as far as the
/// stage goes: there gaps have contrast.
Process middle_process(const Printer& printer, const Resin& resin) {
  Process process;
  process.mode = ExposureMode::continuous;
  const Kinetics k = make_kinetics(resin, false, true);
  const double light = std::sqrt(printer.calibration.front().intensity_mw_cm2 *
                                 printer.calibration.back().intensity_mw_cm2);
  process.speed_mm_h = light > 0 ? passing_dose_prime(k, light, 0, 1) / k.critical_dose_prime : 0;
  if (printer.max_speed_mm_h > 0) {
    process.speed_mm_h = std::min(process.speed_mm_h, printer.max_speed_mm_h);
  }
  if (!(process.speed_mm_h > 0)) {
    throw InputError("black pixels give no light: name a speed by --printed");
  }
  return process;
}

/// A comb, corrected by what is known now.
MeasuredPart comb_of(const TuningPart& part, const Printer& printer, const Resin& resin,
                     const Process& process) {
  MeasuredPart measured;
  measured.process = process;
  measured.layer_um = part.grid().layer_um;
  for (const TuningPart::Row& r : part.rows()) {
    MeasuredEdge e;
    e.name = r.name;
    e.kind = r.kind == "upper" ? MeasuredKind::upper : MeasuredKind::lower;
    e.designed_um = r.designed_um;
    measured.edges.push_back(e);
  }
  std::vector<std::uint8_t> coverage;
  part.read_band({part.x_px(), part.y_px(), part.x_px() + 1, part.y_px() + 1},
                 [&](int, const std::uint8_t* row) { coverage.push_back(row ? *row : 0); });
  const int layers = part.grid().layers;
  const CureModel model =
      make_cure_model(printer, printed_resin(resin, process), process, measured.layer_um);
  const CorrectionPlan plan(model, process, layers, slices_with_burst(model, layers, layers - 1));
  const std::vector<double> levels = level_intensities(printer);
  for (const std::uint8_t level : solve_column(plan, coverage)) {
    measured.intensity_mw_cm2.push_back(levels[level]);
  }
  return measured;
}

/// What there is known by then.
struct Known {
  const Printer& printer;
  const Resin& resin;
  const TuneMatrix& covariance;
  double sigma_um;
};

void add_gain(NextPart& next, const MeasuredPart& part, const Known& known) {
  std::vector<TuneVector> by, there;
  const std::vector<double> z = predict_edges(part, known.printer, known.resin, {}, &by);
  for (std::size_t i = 0; i < z.size(); ++i) {
    if (z[i] > 0) there.push_back(by[i]);
  }
  const TuneGain gain = gain_of(known.covariance, there, known.sigma_um);
  next.nat = gain.nat;
  const auto both = [&](std::size_t i, double unit) {
    return fmt::format("{:.2g} -> {:.2g}", unit * std::sqrt(known.covariance[i][i]),
                       unit * std::sqrt(gain.covariance[i][i]));
  };
  next.text += fmt::format("ha {} %, light {} %, stray {} {}", both(0, 196), both(1, 196),
                           both(kStray, 1.96), unit_of_light(known.printer.unit));
  // Parts that tell nothing of it leave it as it was, but for rounding.
  if (gain.covariance[kExchange][kExchange] < 0.99 * known.covariance[kExchange][kExchange]) {
    next.text += fmt::format(", exchange {}", both(kExchange, 1.96));
  }
}

/// Lines and gaps: the unknowns are ln sigma and the dose, which is known as light over dose is.
void add_spread_gain(NextPart& next, const Known& known, double layer_um) {
  const SpreadTestPart part(known.printer, layer_um, layer_um);
  double sigma = 0;
  for (const SpreadGaussian& g : known.printer.spread.gaussians) {
    sigma = std::max(sigma, g.sigma_um);
  }
  if (!(sigma > 0)) sigma = kSpreadPixels * known.printer.pixel_x_um;
  SpreadState state;
  state.sigma_um = sigma;
  state.dark = known.printer.calibration.front().intensity_mw_cm2 /
               known.printer.calibration.back().intensity_mw_cm2;
  // Light as far above what edges need as black pixels are below it.
  state.dose = state.dark > 0 ? 1 / std::sqrt(state.dark) : 5;
  double a00 = 1 / (kSpreadSd * kSpreadSd), a01 = 0, a11 = 1 / known.covariance[1][1];
  const double before = a00 * a11;
  const double scale = 1 / (known.sigma_um * known.sigma_um);
  for (const TestFeature& f : part.features()) {
    Exposure exposure;
    exposure.gap = f.gap;
    exposure.m = known.resin.m;
    const auto width = [&](double ln_sigma, double ln_dose) {
      SpreadState s = state;
      s.sigma_um *= std::exp(ln_sigma);
      s.dose *= std::exp(ln_dose);
      return printed_width_um(s, exposure, f.width_um);
    };
    constexpr double step = 1e-3;
    const double middle = width(0, 0);
    const double by_sigma = (width(step, 0) - width(-step, 0)) / (2 * step);
    const double by_dose = (width(0, step) - width(0, -step)) / (2 * step);
    if (!(middle > 0) || !std::isfinite(by_sigma) || !std::isfinite(by_dose)) continue;
    a00 += by_sigma * by_sigma * scale;
    a01 += by_sigma * by_dose * scale;
    a11 += by_dose * by_dose * scale;
  }
  const double after = a00 * a11 - a01 * a01;
  next.nat = 0.5 * std::log(after / before);
  next.text = fmt::format("of how far light spreads: sigma {:.3g} um, {:.2g} % -> {:.2g} %{}",
                          sigma, 196 * kSpreadSd, 196 * std::sqrt(a11 / after),
                          known.printer.spread.none()
                              ? " (taken as half a pixel: the printer file has no spread)"
                              : "");
}

void add_flat_gain(NextPart& next, const Known& known, const TuningPart& part) {
  const double hb = units::height_e_from_10(known.resin.absorbance_height10_um);
  const double ratio = kFlatSd * hb / known.sigma_um;
  next.nat = 0.5 * std::log1p(ratio * ratio) * static_cast<double>(part.rows().size());
  next.text =
      fmt::format("of how even light is: {} places, each {:.2g} % -> {:.2g} %", part.rows().size(),
                  196 * kFlatSd, 196 * kFlatSd / std::sqrt(1 + ratio * ratio));
}

/// The steady dead zone's unknowns are ln beta and ln huv.
void add_zone_gain(NextPart& next, const Known& known, const TuningPart& part, double uv) {
  const Kinetics k = make_kinetics(known.resin, true, false);
  double a00 = 1 / (kInhibitionSd * kInhibitionSd), a01 = 0, a11 = a00;
  const double before = a00 * a11;
  for (const TuningPart::Row& r : part.rows()) {
    const auto zone = [&](double ln_beta, double ln_huv) {
      Kinetics moved = k;
      moved.beta *= std::exp(ln_beta);
      moved.huv_um *= std::exp(ln_huv);
      return steady_dead_zone_um(moved, r.intensity_mw_cm2, uv);
    };
    constexpr double step = 1e-4;
    const double middle = zone(0, 0);
    const double by_beta = (zone(step, 0) - zone(-step, 0)) / (2 * step);
    const double by_huv = (zone(0, step) - zone(0, -step)) / (2 * step);
    if (!(middle > 0) || !std::isfinite(by_beta) || !std::isfinite(by_huv)) continue;
    const double scale = 1 / (known.sigma_um * known.sigma_um);
    a00 += by_beta * by_beta * scale;
    a01 += by_beta * by_huv * scale;
    a11 += by_huv * by_huv * scale;
  }
  const double after = a00 * a11 - a01 * a01;
  next.nat = 0.5 * std::log(after / before);
  next.text = fmt::format(
      "of how UV light inhibits: beta {0:.2g} % -> {1:.2g} %, huv {0:.2g} % -> "
      "{2:.2g} %",
      196 * kInhibitionSd, 196 * std::sqrt(a11 / after), 196 * std::sqrt(a00 / after));
}

}  // namespace

std::vector<NextPart> next_parts(const Printer& printer, const Resin& resin,
                                 const TuneResult& known, const std::optional<Process>& process,
                                 double layer_um, double sigma_um) {
  const Printer shines = tuned_printer(printer, resin.m, known.x);
  const Resin cures = tuned_resin(resin, known.x);
  const Known now{shines, cures, known.covariance, sigma_um};
  std::vector<NextPart> all;
  TuningPart::Ask ask;
  ask.layer_um = layer_um;
  ask.resin = &cures;
  const auto add = [&](const std::string& name, bool tuned, auto&& fill) {
    NextPart next;
    next.part = name;
    next.tuned = tuned;
    try {
      fill(next);
    } catch (const InputError& e) {
      next.nat = 0;
      next.text = std::string("can't be used: ") + e.what();
    }
    all.push_back(std::move(next));
  };
  for (const TuningPartKind kind : {TuningPartKind::staircase, TuningPartKind::wedge}) {
    add(word_of(kind), true,
        [&](NextPart& next) { add_gain(next, plugs_of(TuningPart(kind, shines, ask)), now); });
  }
  add("comb", true, [&](NextPart& next) {
    const bool continuous = process && process->mode == ExposureMode::continuous;
    const Process how = continuous ? *process : middle_process(shines, cures);
    next.text = fmt::format("at {:.4g} mm/h: ", how.speed_mm_h);
    const TuningPart part(TuningPartKind::comb, shines, ask);
    add_gain(next, comb_of(part, shines, cures, how), now);
  });
  add("lift-comb", true, [&](NextPart& next) {
    if (!process || process->mode != ExposureMode::layerwise) {
      next.text = "is printed layer by layer: name such a print by --printed";
      return;
    }
    Process how = *process;
    how.lift_exchange = 0;
    const TuningPart part(TuningPartKind::lift_comb, shines, ask);
    add_gain(next, comb_of(part, shines, cures, how), now);
  });
  add("spread", false, [&](NextPart& next) { add_spread_gain(next, now, layer_um); });
  add("flat-field", false, [&](NextPart& next) {
    add_flat_gain(next, now, TuningPart(TuningPartKind::flat_field, shines, ask));
  });
  add("dead-zone", false, [&](NextPart& next) {
    if (!cures.inhibition) {
      next.text = "nothing: the resin has no [inhibition]";
      return;
    }
    // UV light that keeps a dead zone under full light.
    const Kinetics k = make_kinetics(cures, true, false);
    ask.uv_mw_cm2 = shines.uv ? shines.uv->max_mw_cm2()
                              : 2 * shines.calibration.back().intensity_mw_cm2 / k.beta;
    add_zone_gain(next, now, TuningPart(TuningPartKind::dead_zone, shines, ask), ask.uv_mw_cm2);
  });
  std::stable_sort(all.begin(), all.end(), [](const NextPart& a, const NextPart& b) {
    return a.tuned != b.tuned ? a.tuned : a.nat > b.nat;
  });
  return all;
}

}  // namespace slicecorr::resins
