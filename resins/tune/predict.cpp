// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Where edges of measured parts lie.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "slicecorr/dose_derivatives.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/units.hpp"
#include "tune/matrix.hpp"
#include "tune/printed_resin.hpp"

namespace slicecorr::resins {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
/// Where the printer says nothing of it, and the least that is taken: at 0 the last exposure decides that has
/// any light at all, and no derivative holds.
constexpr double kExchangeBefore = 0.5, kLeastExchange = 1e-3;
/// Doses so close to 1 are 1: edges of corrections lie on nodes, but for rounding.
constexpr double kRounding = 1e-11;

struct Crossing {
  bool rises = false;  ///< away from the platform: a feature begins
  double z_um = 0;
  TuneVector by{};
};

std::vector<Crossing> crossings(const ColumnGradient& column, const CureModel& model,
                                double stray) {
  std::vector<Crossing> found;
  const double fall = units::kLn10 * model.eta;
  for (int n = 0; n < column.slices(); ++n) {
    const double upper = column.at_node(n).dose, lower = column.at_node(n + 1).dose;
    const bool begins = lower >= 1 - kRounding, was = upper >= 1 - kRounding;
    if (begins == was) continue;
    const double phi = column.phi(n);
    const double t = std::clamp(std::log((lower - phi) / (1 - phi)) / fall, 0.0, 1.0);
    const double z = n + 1 - t;
    const LightGradient light = light_gradient(model, phi);
    const DoseGradient g = step_gradient(model, light, column.at_node(n + 1), t);
    const double slope = dose_per_um(model, phi);
    found.push_back(
        {begins,
         z * model.layer_um,
         {-g.ln_ha / slope, -(model.m * g.dose - stray * g.stray) / slope, -g.stray / slope}});
  }
  return found;
}

/// The same layer by layer: a feature begins inside a layer, and ends at a window, whatever the dose.
std::vector<Crossing> crossings_by_layers(const ColumnGradient& column, const CureModel& model,
                                          double stray) {
  std::vector<Crossing> found;
  const double fall = units::kLn10 * model.eta;
  bool solid_above = false;
  for (int n = 0; n < column.slices(); ++n) {
    const DoseGradient window = column.at(n + 1), far = column.at_node(n);
    const bool solid = window.dose >= 1 - kRounding, whole = far.dose >= 1 - kRounding;
    if (solid_above && !whole) found.push_back({false, n * model.layer_um, {}});
    solid_above = solid;
    if (!solid || whole) continue;
    const double t = std::clamp(std::log(window.dose) / fall, 0.0, 1.0);
    const DoseGradient g = t < 1 ? column.at(n + 1 - t) : far;
    const double slope = dose_per_um(model, column.phi(n));
    found.push_back({true,
                     (n + 1 - t) * model.layer_um,
                     {-g.ln_ha / slope, -(model.m * g.dose - stray * g.stray) / slope,
                      -g.stray / slope, -g.exchange / slope}});
  }
  if (solid_above) found.push_back({false, column.slices() * model.layer_um, {}});
  return found;
}

/// Of the edges that want the same crossing the nearest gets it.
void match(const MeasuredPart& part, const std::vector<Crossing>& found, std::vector<double>& z,
           std::vector<TuneVector>& by) {
  std::vector<double> away(found.size(), std::numeric_limits<double>::infinity());
  std::vector<std::size_t> owner(found.size(), 0);
  for (std::size_t i = 0; i < part.edges.size(); ++i) {
    const MeasuredEdge& e = part.edges[i];
    if (e.kind == MeasuredKind::plug) continue;
    std::size_t best = found.size();
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < found.size(); ++k) {
      const double d = std::abs(found[k].z_um - e.designed_um);
      if (found[k].rises != (e.kind == MeasuredKind::upper) || d >= least) continue;
      best = k;
      least = d;
    }
    if (best == found.size() || least >= away[best]) continue;
    if (std::isfinite(away[best])) z[owner[best]] = kNone;
    away[best] = least;
    owner[best] = i;
    z[i] = found[best].z_um;
    by[i] = found[best].by;
  }
}

}  // namespace

Resin printed_resin(const Resin& resin, const Process& process) {
  const bool lifts = process.mode == ExposureMode::layerwise && process.lifts == Lifts::each;
  if (!lifts || !(resin.dose_factor > 1)) return resin;
  ResinOverrides gel;
  gel.dose_factor = 1;
  return with_overrides(resin, gel);
}

double exchange_before(const Printer& printer) {
  return printer.lift_exchange >= 0 ? printer.lift_exchange : kExchangeBefore;
}

double tuned_exchange(const Printer& printer, const TuneVector& x) {
  return std::clamp(exchange_before(printer) + x[kExchange], kLeastExchange, 1.0);
}

Resin tuned_resin(const Resin& resin, const TuneVector& x) {
  Resin r = resin;
  const double height = std::exp(x[0]);
  const double areal = std::exp(-resin.m * x[1]) / (is_relative(resin) ? full_light(x) : 1);
  r.absorbance_height10_um *= height;
  r.active_absorption_per_cm /= height;
  r.critical_dose_mj_cm3 *= areal / height;
  r.gel_dose_mj_cm3 *= areal / height;
  r.critical_dose_prime *= areal;
  if (r.inhibition) r.inhibition->critical_dose_prime *= std::exp(-r.inhibition->m * x[1]);
  return r;
}

Printer tuned_printer(const Printer& printer, double /*m*/, const TuneVector& x) {
  Printer p = printer;
  // Light counts exp(kappa) times: stray light is added to what the file says.
  for (CalibrationPoint& c : p.calibration) {
    c.intensity_mw_cm2 = std::max(0.0, c.intensity_mw_cm2 + x[kStray] * std::exp(-x[1]));
  }
  if (is_relative(p)) {
    for (CalibrationPoint& c : p.calibration) c.intensity_mw_cm2 /= full_light(x);
    p.calibration.back().intensity_mw_cm2 = 1;
  }
  if (x[kExchange] != 0) p.lift_exchange = tuned_exchange(printer, x);
  return p;
}

std::vector<double> predict_edges(const MeasuredPart& part, const Printer& printer,
                                  const Resin& resin, const TuneVector& x,
                                  std::vector<TuneVector>* jacobian) {
  std::vector<double> z(part.edges.size(), kNone);
  std::vector<TuneVector> by(part.edges.size(), TuneVector{});
  const Resin changed = tuned_resin(resin, {x[0], 0, 0});
  const double brighter = std::exp(x[1]);
  for (std::size_t i = 0; i < part.edges.size(); ++i) {
    const MeasuredEdge& e = part.edges[i];
    if (e.kind != MeasuredKind::plug) continue;
    const Kinetics k = make_kinetics(changed, false, false);
    // D' of light and of black pixels after it, and its derivatives.
    double dose = 0, by_kappa = 0, by_stray = 0;
    for (const auto& [mw_cm2, seconds] :
         {std::pair{e.intensity_mw_cm2, e.exposure_s}, std::pair{e.dark_mw_cm2, e.dark_s}}) {
      const double light = mw_cm2 * brighter + x[2];
      if (!(light > 0) || !(seconds > 0)) continue;
      const double rate = std::pow(light, k.m);
      dose += rate * seconds;
      by_kappa += rate / light * seconds * mw_cm2 * brighter;
      by_stray += rate / light * seconds;
    }
    const double height = dose > 0 ? cured_height_um(k, 1, dose) : 0;
    if (!(height > 0)) continue;
    z[i] = height;
    by[i] = {height, k.hb_um * by_kappa / dose, k.hb_um * by_stray / dose};
  }
  if (!part.intensity_mw_cm2.empty()) {
    Process process = part.process;
    const bool by_layers = process.mode == ExposureMode::layerwise;
    if (by_layers) process.lift_exchange = tuned_exchange(printer, x);
    const CureModel model =
        make_cure_model(printer, printed_resin(changed, process), process, part.layer_um);
    std::vector<double> phi;
    for (const double light : part.intensity_mw_cm2) {
      phi.push_back(model.phi(std::max(0.0, light * brighter + x[2])));
    }
    const ColumnGradient column(model, phi);
    match(part,
          by_layers ? crossings_by_layers(column, model, x[2]) : crossings(column, model, x[2]), z,
          by);
  }
  if (jacobian) *jacobian = by;
  return z;
}

}  // namespace slicecorr::resins
