// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "cure/limits.hpp"
#include "cure/steps.hpp"
#include "cure/walkers.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/turbidity.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

double CureModel::phi(double intensity_mw_cm2) const {
  if (gel_time()) return gel_time()->phi(intensity_mw_cm2);
  const double ratio = intensity_mw_cm2 / critical_intensity_mw_cm2;
  return m == 1.0 ? ratio : std::pow(ratio, m);
}

double CureModel::intensity_mw_cm2(double phi) const {
  if (gel_time()) return gel_time()->intensity_mw_cm2(phi);
  return critical_intensity_mw_cm2 * std::pow(phi, 1.0 / m);
}

double CureModel::crossing(double phi, double below, double layer_eta) const {
  // Omega = 1 in (A.35): 10^-(d eta) = (1 - phi) / (below - phi), written so that equal doses are
  // safe.
  const double d = -std::log1p((1.0 - below) / (below - phi)) / (layer_eta * units::kLn10);
  return std::clamp(d, 0.0, 1.0);
}

int CureModel::slices_to_gel(int first) const {
  if (mode == ExposureMode::layerwise) return 0;
  if (bleaching()) {
    detail::BleachingSteps steps(*this);
    constexpr int most = 1'000'000;
    int slices = 0;
    for (double dose = 0; dose < 1.0 - 1e-12 && slices < most; ++slices) {
      steps.enter(first + slices);
      dose = steps.node(phi_max() * ratio(first + slices), dose);
    }
    return slices;
  }
  if (gel_time()) {
    const double slices = gel_time()->slices_to_gel(
        gel_time()->level_mw_cm2(gel_time()->levels() - 1) * gel_time()->least_share(first));
    double thinnest = 1;
    for (std::size_t n = 0; n < own_a.size(); ++n) {
      if (n >= static_cast<std::size_t>(std::max(0, first)) || n + 1 == own_a.size()) {
        thinnest = std::min(thinnest, height(static_cast<int>(n)));
      }
    }
    return static_cast<int>(std::min(1e9, std::ceil(slices / thinnest)));
  }
  if (!heights.alike()) {
    double dose = 0, left = 1;
    const auto own = static_cast<int>(std::max(exposure_ratio.size(), own_a.size()));
    int slices = 0;
    for (; first + slices < own && dose < 1.0 - 1e-12; ++slices) {
      const int slice = first + slices;
      dose += left * one_minus_a_of(slice) * phi_max() * ratio(slice);
      left *= a_of(slice);
    }
    if (dose >= 1.0 - 1e-12) return slices;
    // What is missing comes from slices alike.
    const double lit = phi_max() * ratio(own), share = (1.0 - dose) / left;
    return slices +
           static_cast<int>(std::ceil(std::log10(lit / (lit - share)) / eta_of(own) - 1e-12));
  }
  if (!exposure_ratio.empty()) {
    double dose = 0, left = one_minus_a;
    const auto own = static_cast<int>(exposure_ratio.size());
    int slices = 0;
    for (; first + slices < own && dose < 1.0 - 1e-12; ++slices, left *= a) {
      dose += left * phi_max() * ratio(first + slices);
    }
    if (dose >= 1.0 - 1e-12) return slices;
    // What is missing comes from slices alike.
    const double lit = phi_max() * exposure_ratio.back(), share = (1.0 - dose) * one_minus_a / left;
    return slices + static_cast<int>(std::ceil(std::log10(lit / (lit - share)) / eta - 1e-12));
  }
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

double CureModel::film_of(int layer) const {
  return heights.alike() ? lifts->film : std::exp(lifts->skin * eta * height(layer) * units::kLn10);
}

double CureModel::with_returned(double zeta) const {
  const double factor = 1.0 + reflectance * std::exp(-2.0 * depth(zeta) * (eta / m) * units::kLn10);
  return m == 1.0 ? factor : std::pow(factor, m);
}

double CureModel::greatest_ratio() const {
  return exposure_ratio.empty() ? 1.0
                                : *std::max_element(exposure_ratio.begin(), exposure_ratio.end());
}

double CureModel::least_ratio() const {
  return exposure_ratio.empty() ? 1.0
                                : *std::min_element(exposure_ratio.begin(), exposure_ratio.end());
}

double CureModel::cut_through_um(double exposure) const {
  return layer_um / eta * std::log10(1.0 + phi_min() * exposure);
}

double CureModel::level_step_um() const {
  double step = 0;
  if (gel_time()) {
    // What a level adds to X, of which Omega takes no more; from an edge on the dose falls at least half
    // as fast as light does, from the window of the layer on (layer by layer).
    const bool layerwise = mode == ExposureMode::layerwise;
    const double ratio = greatest_ratio();
    const auto gels = [&](int l) {
      return layerwise ? gel_time()->dose_through_layer(gel_time()->level_mw_cm2(l), ratio) >= 1.0
                       : level_phi[static_cast<std::size_t>(l)] >= 1.0;
    };
    for (int l = 1; l < gel_time()->levels() && !gels(l - 1); ++l) {
      step = std::max(step, ratio * (gel_time()->light(l).x - gel_time()->light(l - 1).x));
    }
    return layer_um * step * (layerwise ? a : one_minus_a) / (0.5 * units::kLn10 * eta);
  }
  if (mode == ExposureMode::layerwise) {
    const double ratio = greatest_ratio();
    for (std::size_t l = 1; l < level_phi.size() && faded(level_phi[l - 1] * ratio) < 1.0; ++l) {
      step = std::max(step, level_phi[l] - level_phi[l - 1]);
    }
    if (bleaching()) {
      // Light falls at least by what bleached resin takes, the dose by what one of 1 takes from it.
      return layer_um * step * ratio * std::exp(-bleaching()->bleached()) /
             bleaching()->absorbed(1.0);
    }
    return layer_um * step * ratio * a / (units::kLn10 * eta);
  }
  for (std::size_t l = 1; l < level_phi.size() && level_phi[l - 1] < 1.0; ++l) {
    step = std::max(step, level_phi[l] - level_phi[l - 1]);
  }
  if (bleaching()) {
    // A slice adds what its light is and resin takes a part of, and the edge falls by G(1) (1 - phi).
    return layer_um * step / (1.0 - phi_min());
  }
  const double highest = heights.alike()
                             ? one_minus_a
                             : *std::max_element(own_one_minus_a.begin(), own_one_minus_a.end());
  return layer_um * step * highest / (units::kLn10 * eta * (1.0 - phi_min()));
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
  std::vector<double> of_level = intensities_of(printer.calibration, printer.levels());
  if (printer.grey != GreyLight::pulsed || printer.grey_m == 1) return of_level;
  // The steady light that does as much as full light for a share of the time, and black for the rest.
  const double m = printer.grey_m, black = of_level.front(), full = of_level.back();
  const double of_black = std::pow(black, m), of_full = std::pow(full, m);
  for (double& intensity : of_level) {
    if (intensity <= black || intensity >= full) continue;
    const double share = (intensity - black) / (full - black);
    intensity = std::pow((1 - share) * of_black + share * of_full, 1 / m);
  }
  return of_level;
}

Printer for_resin(Printer printer, const Resin& resin) {
  if (printer.grey == GreyLight::pulsed) printer.grey_m = resin.m;
  return printer;
}

std::vector<double> uv_level_intensities(const Printer& printer) {
  if (!printer.uv || !printer.uv->patterned) {
    throw InputError(printer.name, "uv.kind",
                     "the printer has no UV lamp that shows patterns; expected \"patterned\"");
  }
  return intensities_of(printer.uv->calibration, printer.levels());
}

namespace {

/// Less than this of a slice's light is nothing: rounding has a margin of 1e-9 of a dose.
constexpr double kNoLight = 1e-12;
/// The margin of rounding, in doses.
constexpr double kRounding = 1e-9;

/// Lets the bath of a printer end where it does.
void end_bath(const Printer& printer, CureModel& model) {
  const double depth_um = printer.resin_depth_um;
  if (!(depth_um > 0)) return;
  if (depth_um < model.layer_um) {
    throw InputError(fmt::format(
        "the resin is {:g} um deep, less than a slice of {:g} um; expected a depth of one or more",
        depth_um, model.layer_um));
  }
  // A depth of so many slices must not become one less by rounding.
  const double slices = std::floor(depth_um / model.layer_um * (1 + 1e-12));
  // Of a time to gel the root of light counts, too, which falls half as fast.
  const double eta = model.gel_time() ? model.eta / 2 : model.eta;
  const double left = std::exp(-slices * eta * units::kLn10);
  if (left < kNoLight) return;
  // What lies in a part of a slice gets a part of its light, which no slice can have.
  const double part = depth_um / model.layer_um - slices;
  if (left * -std::expm1(-part * eta * units::kLn10) > kRounding) {
    throw InputError(fmt::format(
        "the resin is {:g} um deep, which is {:.4g} slices of {:g} um; expected a whole number of "
        "slices: a depth of {:g} or {:g} um (vat.depth_um), or other slices",
        depth_um, depth_um / model.layer_um, model.layer_um, slices * model.layer_um,
        (slices + 1) * model.layer_um));
  }
  model.bath_slices = static_cast<int>(slices);
  model.beyond = left;
}

/// Lets the platform of a printer send light back as far as it counts.
void mirror(const Printer& printer, CureModel& model) {
  model.reflectance = printer.platform_reflectance;
  if (!(model.reflectance > kNoLight)) return;
  const double slices = std::log10(model.reflectance / kNoLight) * model.m / (2 * model.eta);
  double thinnest = 1;
  for (std::size_t n = 0; n < model.own_a.size(); ++n) {
    thinnest = std::min(thinnest, model.height(static_cast<int>(n)));
  }
  model.mirrored_slices = static_cast<int>(std::min(1e9, std::ceil(slices / thinnest))) + 1;
}

/// Makes the model of a resin with a time to gel of one that has its printer, height and mode.
void take_gel_time(const Resin& resin, const Process& process, GreyLight grey,
                   const std::vector<double>& intensities, CureModel& model) {
  model.law = WithGelTime{
      std::make_shared<const GelTimeKernel>(GelTime{resin.gel_a_mj_cm2, resin.gel_b_sqrt_mw_cm2_s},
                                            units::height_e_from_10(resin.absorbance_height10_um),
                                            process, model.layer_um, intensities, grey)};
  const GelTimeKernel& kernel = *model.gel_time();
  model.critical_intensity_mw_cm2 = kernel.intensity_mw_cm2(1.0);
  for (int level = 0; level < kernel.levels(); ++level) {
    model.level_phi.push_back(kernel.phi_of(kernel.light(level)));
  }
}

/// Makes the model of a resin that bleaches of one of its fresh absorption.
void take_bleaching(const Resin& resin, CureModel& model) {
  const double critical_mj_cm2 = make_kinetics(resin, false, true).critical_dose_prime;
  const double fresh = model.eta * units::kLn10;
  const double bleached =
      fresh * resin.absorbance_height10_um / resin.bleaching->absorbance_height10_um;
  const BleachingLaw law(fresh, bleached, resin.bleaching->dose_mj_cm2 / critical_mj_cm2);
  // Continuous, phi of 1 holds a dose of 1 although that takes less light than it would in fresh resin.
  if (model.mode == ExposureMode::continuous) {
    model.critical_intensity_mw_cm2 *= law.absorbed(1.0) / fresh;
  }
  model.law = WithBleaching{law};
}

/// Gives the model of layers of different heights what each leaves of a dose.
void take_heights(const Process& process, CureModel& model) {
  const std::vector<double>& heights_um = process.layer_heights_um;
  const bool alike = std::all_of(heights_um.begin(), heights_um.end(),
                                 [&](double um) { return um == model.layer_um; });
  if (alike) return;
  model.heights = LayerHeights(heights_um);
  for (const double um : heights_um) {
    const double eta = model.eta * um / model.layer_um;
    model.own_a.push_back(std::exp(-eta * units::kLn10));
    model.own_root_a.push_back(std::exp(-0.5 * eta * units::kLn10));
    model.own_one_minus_a.push_back(-std::expm1(-eta * units::kLn10));
  }
}

/// Gives the model of a process with lifts what they ask, where they are counted.
void take_lifts(const Printer& printer, const Resin& resin, Process process, CureModel& model) {
  leave_out_lifts(printer, resin, process);
  if (process.mode != ExposureMode::layerwise || process.lifts == Lifts::none) return;
  LiftModel& lifts = model.lifts.emplace();
  lifts.green_strength = process.green_strength;
  lifts.skin = process.skin;
  lifts.film = std::exp(lifts.skin * model.eta * units::kLn10);
  if (process.lift_exchange >= 0) lifts.exchange = process.lift_exchange;
  lifts.each_holds = lifts.exchange.value_or(0) > 0 && light_spreads(printer, resin, process);
}

}  // namespace

namespace {

/// What the light of a layer counts for over that of layers as a rule.
double light_ratio(const Process& process, int layer, double m) {
  const double share = light_share(process, layer) / usual_light_share(process);
  return m == 1.0 ? share : std::pow(share, m);
}

}  // namespace

std::vector<double> detail::exposure_ratios(const Process& process, double normal_s, double m) {
  const std::size_t special =
      std::max(process.layer_exposure_s.empty()
                   ? static_cast<std::size_t>(process.bottom_layers + process.fade_layers)
                   : process.layer_exposure_s.size(),
               light_differs(process) ? process.light_share.size() : 0);
  std::vector<double> ratios;
  bool normal = true;
  // One more than the layers with times of their own: the last holds for all layers after it.
  for (std::size_t n = 0; n <= special; ++n) {
    const auto layer = static_cast<int>(n);
    ratios.push_back(layer_exposure_s(process, layer) / normal_s * light_ratio(process, layer, m));
    normal = normal && ratios.back() == 1.0;
  }
  if (normal) ratios.clear();
  return ratios;
}

Printer dimmed(const Printer& printer, double factor) {
  Printer p = printer;
  for (CalibrationPoint& c : p.calibration) c.intensity_mw_cm2 *= factor;
  return p;
}

Printer as_lit(const Printer& printer, const Process& process) {
  const double usual = usual_light_share(as_lamp_shines(process));
  return usual == 1 ? printer : dimmed(printer, usual);
}

std::vector<Feature> features_of(const CureModel& model) {
  std::vector<Feature> features;
  if (model.mode == ExposureMode::layerwise) features.push_back(Feature::layerwise);
  if (model.inhibited()) features.push_back(Feature::uv_constant);
  if (model.gel_time()) features.push_back(Feature::gel_time);
  if (model.bleaching()) features.push_back(Feature::bleaching);
  if (model.lifts) features.push_back(Feature::lifts);
  if (model.lifts && model.lifts->exchange.value_or(0) > 0) features.push_back(Feature::exchange);
  if (model.bath_slices > 0) features.push_back(Feature::vat_depth);
  if (model.mirrored_slices > 0) features.push_back(Feature::reflectance);
  if (!model.heights.alike()) {
    features.push_back(model.mode == ExposureMode::layerwise ? Feature::own_heights
                                                             : Feature::moved_heights);
  }
  if (model.mode == ExposureMode::continuous && !model.exposure_ratio.empty()) {
    features.push_back(Feature::lamps_stay);
  }
  return features;
}

CureModel make_cure_model(const Printer& printer, const Resin& resin, const Process& process,
                          double layer_um, const PlaceLight& light) {
  refuse_turbidity(resin, "printing slice by slice");
  // What a lamp that shows patterns gives, and how much of it comes, is for the kernel.
  const bool pattern_fades = process.uv.kind == UvKind::patterned && !process.even_light;
  if (!process.lamp_share.empty() || (!process.uv_lamp_share.empty() && !pattern_fades)) {
    return make_cure_model(printer, resin, as_lamp_shines(process), layer_um, light);
  }
  if (process.uv.kind != UvKind::off && printer.grey_m != 1) {
    // The kernel takes pulses apart, whatever the resin's exponent.
    Printer mean = printer;
    mean.grey_m = 1;
    return make_cure_model(mean, resin, process, layer_um, light);
  }
  check_supported(printer, resin, process);
  const double factor = light.factor * usual_light_share(process);
  const Printer lit = factor == 1 ? printer : dimmed(printer, factor);
  const std::vector<double> intensities =
      level_intensities(process.uv.kind == UvKind::off ? for_resin(lit, resin) : lit);
  CureModel model;
  model.layer_um = layer_um;
  model.m = resin.m;
  model.eta = resin.m * layer_um / resin.absorbance_height10_um;
  model.a = std::exp(-model.eta * units::kLn10);
  model.one_minus_a = -std::expm1(-model.eta * units::kLn10);
  model.root_a = std::exp(-0.5 * model.eta * units::kLn10);
  model.mode = process.mode;
  const double counts_as = light_exponent(resin, process);
  const double s = units::cm_s_from_mm_h(process.speed_mm_h);
  if (process.mode == ExposureMode::layerwise) {
    if (!(process.exposure_s > 0)) {
      throw InputError("layer by layer exposure without a time; expected exposure_s above 0");
    }
    model.exposure_ratio = detail::exposure_ratios(process, process.exposure_s, counts_as);
  }
  if (slices_differ(process)) {
    const bool stay = process.slice_lamps == SliceLamps::stay;
    const std::size_t own = std::max(stay ? process.slice_speed_mm_h.size() : 0,
                                     light_differs(process) ? process.light_share.size() : 0);
    for (std::size_t n = 0; n < own; ++n) {
      const auto slice = static_cast<int>(n);
      model.exposure_ratio.push_back(
          (stay ? process.speed_mm_h / slice_speed_mm_h(process, slice) : 1.0) *
          light_ratio(process, slice, counts_as));
    }
  }
  if (resin.has_gel_time()) {
    take_gel_time(resin, process, printer.grey, intensities, model);
    take_heights(process, model);
    take_lifts(printer, resin, process, model);
    end_bath(printer, model);
    mirror(printer, model);
    return model;
  }
  if (process.mode == ExposureMode::layerwise) {
    // phi' = I^m te / D'c, areal.
    const double dose_prime = make_kinetics(resin, false, true).critical_dose_prime;
    model.critical_intensity_mw_cm2 = std::pow(dose_prime / process.exposure_s, 1.0 / resin.m);
  } else if (resin.critical_dose_prime > 0) {
    const double hb_cm = units::height_e_from_10(resin.absorbance_height10_um) * 1e-4;
    model.critical_intensity_mw_cm2 =
        std::pow(resin.m * s * resin.critical_dose_prime / hb_cm, 1.0 / resin.m);
  } else {
    // Of what is absorbed, what cures counts: 1 in all where nothing else absorbs.
    const double cures =
        units::height_e_from_10(resin.absorbance_height10_um) / dose_height_e_um(resin);
    model.critical_intensity_mw_cm2 = resin.critical_dose_mj_cm3 * s / cures;
  }
  if (resin.bleaches()) take_bleaching(resin, model);
  for (const double i : intensities) model.level_phi.push_back(model.phi(i));
  take_lifts(printer, resin, process, model);
  if (process.uv.kind == UvKind::off) {
    take_heights(process, model);
    end_bath(printer, model);
    mirror(printer, model);
  } else {
    model.law =
        UnderUv{detail::make_inhibited_kernel(printer, resin, process, layer_um, intensities,
                                              light.brightest * usual_light_share(process))};
    // Under UV light phi is the dose after a long run of slices, and the exponent may be another.
    const InhibitedKernel& kernel = *model.inhibited();
    model.m = kernel.kinetics().m;
    model.eta = model.m * layer_um / resin.absorbance_height10_um;
    model.a = kernel.a();
    model.one_minus_a = -std::expm1(-model.eta * units::kLn10);
    model.root_a = std::exp(-0.5 * model.eta * units::kLn10);
    model.critical_intensity_mw_cm2 = kernel.critical_intensity_mw_cm2(0);
    for (int level = 0; level < kernel.levels(); ++level) {
      model.level_phi[static_cast<std::size_t>(level)] = kernel.steady_dose(0, level);
    }
    take_heights(process, model);
    mirror(printer, model);
    // The kernel ends where the resin does; a depth that is none is refused.
    CureModel checked = model;
    end_bath(printer, checked);
  }
  return model;
}

std::vector<double> node_doses(const CureModel& model, const std::vector<double>& phi) {
  std::vector<double> omega(phi.size() + 1, 0.0);
  const auto bath = static_cast<std::size_t>(model.bath_slices);
  for (std::size_t k = phi.size(); k-- > 0;) {
    const double far = bath > 0 && k + bath < phi.size() ? phi[k + bath] : 0.0;
    omega[k] = model.step_in(static_cast<int>(k), bath > 0 ? model.in_bath(phi[k], far) : phi[k],
                             omega[k + 1]);
  }
  for (std::size_t k = 0; k < omega.size(); ++k) omega[k] *= model.returned(static_cast<double>(k));
  return omega;
}

}  // namespace slicecorr
