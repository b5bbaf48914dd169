#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "cure/walkers.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

double CureModel::phi(double intensity_mw_cm2) const {
  const double ratio = intensity_mw_cm2 / critical_intensity_mw_cm2;
  return m == 1.0 ? ratio : std::pow(ratio, m);
}

double CureModel::crossing(double phi, double below) const {
  // Omega = 1 in (A.35): 10^-(d eta) = (1 - phi) / (below - phi), written so that equal doses are
  // safe.
  const double d = -std::log1p((1.0 - below) / (below - phi)) / (eta * units::ln10);
  return std::clamp(d, 0.0, 1.0);
}

int CureModel::slices_to_gel() const {
  if (mode == ExposureMode::layerwise) return 0;
  const double slices = std::log10(phi_max() / (phi_max() - 1.0)) / eta;
  // A part in 1e9 less than a whole number is that number: the margin of the solve covers it.
  return static_cast<int>(std::ceil(slices - 1e-12));
}

double CureModel::highest_dose(double slices) const {
  const double fall = 1.0 - phi_min();
  const double climb = 1.0 - phi_max();
  return fall * (phi_max() - phi_min()) / (fall - climb * std::pow(10.0, -slices * eta)) +
         phi_min();
}

double CureModel::greatest_ratio() const {
  return exposure_ratio.empty() ? 1.0
                                : *std::max_element(exposure_ratio.begin(), exposure_ratio.end());
}

double CureModel::cut_through_um(double exposure) const {
  return layer_um / eta * std::log10(1.0 + phi_min() * exposure);
}

double CureModel::level_step_um() const {
  double step = 0;
  if (mode == ExposureMode::layerwise) {
    const double ratio = greatest_ratio();
    for (std::size_t l = 1; l < level_phi.size() && level_phi[l - 1] * ratio * a < 1.0; ++l) {
      step = std::max(step, level_phi[l] - level_phi[l - 1]);
    }
    return layer_um * step * ratio * a / (units::ln10 * eta);
  }
  for (std::size_t l = 1; l < level_phi.size() && level_phi[l - 1] < 1.0; ++l) {
    step = std::max(step, level_phi[l] - level_phi[l - 1]);
  }
  return layer_um * step * one_minus_a / (units::ln10 * eta * (1.0 - phi_min()));
}

namespace {

std::vector<double> intensities_of(const std::vector<CalibrationPoint>& points, int levels) {
  std::vector<double> intensity(static_cast<std::size_t>(levels));
  std::size_t segment = 0;
  for (std::size_t level = 0; level < intensity.size(); ++level) {
    const auto g = static_cast<double>(level);
    while (segment + 2 < points.size() && g > points[segment + 1].level) ++segment;
    const auto& p = points[segment];
    const auto& q = points[segment + 1];
    const double t = (g - p.level) / (q.level - p.level);
    intensity[level] = g == q.level
                           ? q.intensity_mw_cm2
                           : p.intensity_mw_cm2 + t * (q.intensity_mw_cm2 - p.intensity_mw_cm2);
  }
  // Interpolation rounds: a curve that does not fall must not seem to.
  for (std::size_t i = 1; i < intensity.size(); ++i) {
    intensity[i] = std::max(intensity[i], intensity[i - 1]);
  }
  return intensity;
}

}  // namespace

std::vector<double> level_intensities(const Printer& printer) {
  return intensities_of(printer.calibration, printer.levels());
}

std::vector<double> uv_level_intensities(const Printer& printer) {
  if (!printer.uv || !printer.uv->patterned) {
    throw InputError(printer.name, "uv.kind",
                     "the printer has no UV lamp that shows patterns; expected \"patterned\"");
  }
  return intensities_of(printer.uv->calibration, printer.levels());
}

namespace {

/// Exposures over the normal one; empty when all are normal.
std::vector<double> exposure_ratios(const Process& process) {
  const std::size_t special =
      process.layer_exposure_s.empty()
          ? static_cast<std::size_t>(process.bottom_layers + process.fade_layers)
          : process.layer_exposure_s.size();
  std::vector<double> ratios;
  bool normal = true;
  // One more than the special ones: the last holds for all layers after it.
  for (std::size_t n = 0; n <= special; ++n) {
    ratios.push_back(layer_exposure_s(process, static_cast<int>(n)) / process.exposure_s);
    normal = normal && ratios.back() == 1.0;
  }
  if (normal) ratios.clear();
  return ratios;
}

/// "layer 3, exposed for 1.5 s," where exposures differ.
std::string failing_layer(const CureModel& model, const Process& process, int layer) {
  const double exposure = layer_exposure_s(process, layer);
  return model.exposure_ratio.empty()
             ? fmt::format("exposed for {:.5g} s", exposure)
             : fmt::format("layer {}, exposed for {:.5g} s,", layer, exposure);
}

/// What black light adds up to where all layers get `ratio` of the normal exposure.
double steady_black(const CureModel& model, double ratio) {
  return model.phi_min() * ratio / model.one_minus_a;
}

/// The most that black light adds up to at a window, and in which layer; that after all of `ratios`
/// stands for normal ones.
struct BlackLight {
  double dose = 0;
  int layer = 0;
};
BlackLight most_black(const CureModel& model, const std::vector<double>& ratios) {
  const double steady = steady_black(model, ratios.empty() ? 1.0 : ratios.back());
  BlackLight most{steady, static_cast<int>(ratios.size())};
  double black = steady;
  for (std::size_t n = ratios.size(); n-- > 0;) {
    black = model.phi_min() * ratios[n] + model.a * black;
    if (black > most.dose) most = {black, static_cast<int>(n)};
  }
  return most;
}

/// How long the first, or single, layers may be exposed, s, where black leaves the resin liquid
/// between normal ones.
double longest_for_black_s(const CureModel& model, const Process& process) {
  const auto gels = [&](double longest_s) {
    Process p = process;
    p.bottom_exposure_s = std::min(p.bottom_exposure_s, longest_s);
    for (double& time_s : p.layer_exposure_s) time_s = std::min(time_s, longest_s);
    return most_black(model, exposure_ratios(p)).dose >= 1.0;
  };
  const auto rule = static_cast<int>(model.exposure_ratio.size());
  double fits_s = layer_exposure_s(process, rule);
  double gels_s = process.exposure_s * model.greatest_ratio();
  for (int halved = 0; halved < 60; ++halved) {
    const double middle_s = (fits_s + gels_s) / 2;
    (gels(middle_s) ? gels_s : fits_s) = middle_s;
  }
  return fits_s;
}

void check_black_layerwise(const CureModel& model, const Printer& printer, const Process& process) {
  const BlackLight black = most_black(model, model.exposure_ratio);
  if (!(black.dose >= 1.0)) return;
  const auto rule = static_cast<int>(model.exposure_ratio.size());
  const double steady = steady_black(model, model.ratio(rule));
  // What is too long as a rule is too long for the first layers, too.
  const bool as_a_rule = steady >= 1.0;
  const int layer = as_a_rule ? std::max(0, rule - 1) : black.layer;  // the first normal one
  const char* const which = model.exposure_ratio.empty()       ? ""
                            : as_a_rule                        ? "all layers "
                            : process.layer_exposure_s.empty() ? "the first layers "
                                                               : "each layer ";
  const double least = printer.calibration.front().intensity_mw_cm2;
  throw InfeasibleError(fmt::format(
      "black pixels gel the resin: {} the light of black ({:g} mW/cm²) adds up to {:.4g} of the "
      "critical dose; expose {}for less than {:.5g} s, or with black below {:.5g} mW/cm²",
      failing_layer(model, process, layer), least, as_a_rule ? steady : black.dose, which,
      as_a_rule ? layer_exposure_s(process, rule) / steady : longest_for_black_s(model, process),
      least * std::pow(1.0 / black.dose, 1.0 / model.m)));
}

void check_feasible_layerwise(const CureModel& model, const Printer& printer,
                              const Process& process) {
  const double most = printer.calibration.back().intensity_mw_cm2;
  const int layers = std::max<int>(1, static_cast<int>(model.exposure_ratio.size()));
  // The weakest layer first: what helps it helps all.
  int weakest = 0;
  for (int n = 1; n < layers; ++n) {
    if (model.ratio(n) < model.ratio(weakest)) weakest = n;
  }
  const double reached = model.phi_max() * model.ratio(weakest) * model.a;
  // Full light for just the least time is feasible, rounding or not.
  if (reached < 1.0 - 1e-12) {
    const double exposure = layer_exposure_s(process, weakest);
    throw InfeasibleError(fmt::format(
        "a layer does not gel through: {} full light ({:g} mW/cm²) leaves {:.4g} of the critical "
        "dose at its far edge; expose for at least {:.5g} s, or with at least {:.5g} mW/cm²",
        failing_layer(model, process, weakest), most, reached, exposure / reached,
        reached > 0 ? most * std::pow(1.0 / reached, 1.0 / model.m) : most));
  }
  check_black_layerwise(model, printer, process);
}

}  // namespace

Printer dimmed(const Printer& printer, double factor) {
  Printer p = printer;
  for (CalibrationPoint& c : p.calibration) c.intensity_mw_cm2 *= factor;
  return p;
}

CureModel make_cure_model(const Printer& printer, const Resin& resin, const Process& process,
                          double layer_um, const PlaceLight& light) {
  const std::vector<double> intensities =
      level_intensities(light.factor == 1 ? printer : dimmed(printer, light.factor));
  CureModel model;
  model.layer_um = layer_um;
  model.m = resin.m;
  model.eta = resin.m * layer_um / resin.absorbance_height10_um;
  model.a = std::exp(-model.eta * units::ln10);
  model.one_minus_a = -std::expm1(-model.eta * units::ln10);
  model.root_a = std::exp(-0.5 * model.eta * units::ln10);
  model.mode = process.mode;
  const double s = units::cm_s_from_mm_h(process.speed_mm_h);
  if (process.mode == ExposureMode::layerwise) {
    if (!(process.exposure_s > 0)) {
      throw InputError("layer by layer exposure without a time; expected exposure_s above 0");
    }
    // phi' = I^m te / D'c, areal.
    const double dose_prime = make_kinetics(resin, false, true).critical_dose_prime;
    model.critical_intensity_mw_cm2 = std::pow(dose_prime / process.exposure_s, 1.0 / resin.m);
    model.exposure_ratio = exposure_ratios(process);
  } else if (resin.critical_dose_prime > 0) {
    const double hb_cm = units::height_e_from_10(resin.absorbance_height10_um) * 1e-4;
    model.critical_intensity_mw_cm2 =
        std::pow(resin.m * s * resin.critical_dose_prime / hb_cm, 1.0 / resin.m);
  } else {
    model.critical_intensity_mw_cm2 = resin.critical_dose_mj_cm3 * s;
  }
  for (const double i : intensities) model.level_phi.push_back(model.phi(i));
  if (process.uv.kind != UvKind::off) {
    model.inhibited = detail::make_inhibited_kernel(printer, resin, process, layer_um, intensities,
                                                    light.brightest);
    // Under UV light phi is the dose after a long run of slices, and the exponent may be another.
    const InhibitedKernel& kernel = *model.inhibited;
    model.m = kernel.kinetics().m;
    model.eta = model.m * layer_um / resin.absorbance_height10_um;
    model.a = kernel.a();
    model.one_minus_a = -std::expm1(-model.eta * units::ln10);
    model.root_a = std::exp(-0.5 * model.eta * units::ln10);
    model.critical_intensity_mw_cm2 = kernel.critical_intensity_mw_cm2(0);
    for (int level = 0; level < kernel.levels(); ++level) {
      model.level_phi[static_cast<std::size_t>(level)] = kernel.steady_dose(0, level);
    }
  }
  return model;
}

void check_feasible(const CureModel& model, const Printer& printer, const Process& process) {
  if (model.inhibited) {
    detail::check_inhibited_feasible(model, printer, process);
    return;
  }
  if (process.mode == ExposureMode::layerwise) {
    check_feasible_layerwise(model, printer, process);
    return;
  }
  if (printer.max_speed_mm_h > 0 && process.speed_mm_h > printer.max_speed_mm_h) {
    throw InputError(
        fmt::format("speed {:g} mm/h is beyond the stage of printer '{}', which reaches {:g} mm/h",
                    process.speed_mm_h, printer.name, printer.max_speed_mm_h));
  }
  // phi is proportional to 1 / s for every m: what phi lacks, the speed must give.
  const double most = printer.calibration.back().intensity_mw_cm2;
  const double least = printer.calibration.front().intensity_mw_cm2;
  const double needed = model.critical_intensity_mw_cm2;
  if (model.phi_max() <= 1.0) {
    throw InfeasibleError(fmt::format(
        "the resin never gels: at {:g} mm/h even full light ({:g} mW/cm², phi {:.4g}) stays below "
        "the "
        "critical intensity; print slower than {:.5g} mm/h, or with more than {:.5g} mW/cm²",
        process.speed_mm_h, most, model.phi_max(), process.speed_mm_h * model.phi_max(), needed));
  }
  if (model.phi_min() >= 1.0) {
    throw InfeasibleError(fmt::format(
        "black pixels gel the resin: at {:g} mm/h the light of black ({:g} mW/cm², phi {:.4g}) "
        "reaches "
        "the critical intensity; print faster than {:.5g} mm/h, or with black below {:.5g} mW/cm²",
        process.speed_mm_h, least, model.phi_min(), process.speed_mm_h * model.phi_min(), needed));
  }
}

std::vector<double> node_doses(const CureModel& model, const std::vector<double>& phi) {
  std::vector<double> omega(phi.size() + 1, 0.0);
  for (std::size_t k = phi.size(); k-- > 0;) omega[k] = model.step(phi[k], omega[k + 1]);
  return omega;
}

}  // namespace slicecorr
