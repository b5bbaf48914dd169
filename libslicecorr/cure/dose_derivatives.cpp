// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/dose_derivatives.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <variant>

#include "base/kernels.hpp"
#include "cure/exchanged_gradient.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

/// Whether lifts exchange resin, by a share that is known.
bool exchanges_resin(const CureModel& model) {
  return model.lifts && model.lifts->exchange.value_or(0) > 0;
}

}  // namespace

bool derives_by_recursion(const CureModel& model) {
  return std::holds_alternative<SumOfLight>(model.law) && model.bath_slices == 0 &&
         model.mirrored_slices == 0 && model.heights.alike();
}

void check_derivatives(const CureModel& model) {
  std::vector<Feature> features = features_of(model);
  features.push_back(Feature::derivatives);
  check_supported(features);
  if (derives_by_recursion(model)) return;
  const char* const where = model.inhibited()           ? "under UV light"
                            : model.gel_time()          ? "with a time to gel"
                            : model.bleaching()         ? "of a resin that bleaches"
                            : model.bath_slices > 0     ? "in resin that ends"
                            : model.mirrored_slices > 0 ? "below a platform that sends light back"
                                                        : "in layers of different heights";
  throw InputError(fmt::format(
      "how the dose changes with its inputs is known {} by differences between prints alone; expected "
      "sums of light in layers of one height, in resin without end, below a platform that takes light up",
      where));
}

LightGradient light_gradient(const CureModel& model, double phi, double reference_mw_cm2) {
  LightGradient light{phi, 0, 0};
  const double of_level = model.m / model.critical_intensity_mw_cm2;
  if (model.m == 1.0) {
    light.stray = of_level;
  } else if (phi > 0) {
    light.stray = of_level * std::pow(phi, 1.0 - 1.0 / model.m);
  } else if (model.m < 1) {
    light.stray = std::numeric_limits<double>::infinity();
  }
  if (phi > 0) {
    const double ln_intensity =
        std::log(model.critical_intensity_mw_cm2 / reference_mw_cm2) + std::log(phi) / model.m;
    const bool layerwise = model.mode == ExposureMode::layerwise;
    light.m = phi * (ln_intensity - (layerwise ? 0.0 : 1.0 / model.m));
  }
  return light;
}

DoseGradient step_gradient(const CureModel& model, const LightGradient& light,
                           const DoseGradient& below, double t) {
  const double exponent = -t * model.eta * units::kLn10;
  const double gone = -std::expm1(exponent), e = 1.0 - gone;
  DoseGradient out;
  if (model.mode == ExposureMode::layerwise) {
    const double near = light.phi + below.dose;
    const double by_depth = -exponent * e * near;
    out.dose = e * near;
    out.ln_ha = e * below.ln_ha + by_depth;
    out.stray = e * (light.stray + below.stray);
    out.m = e * (light.m + below.m) - by_depth / model.m;
    out.variance = e * e * (light.phi * light.phi + below.variance);
    out.exchange = e * below.exchange;
    return out;
  }
  const double by_depth = -exponent * e * (below.dose - light.phi);
  out.dose = light.phi * gone + e * below.dose;
  out.ln_ha = light.phi * gone + e * below.ln_ha + by_depth;
  out.stray = light.stray * gone + e * below.stray;
  out.m = light.m * gone + e * below.m - by_depth / model.m;
  const double own = light.phi * gone;
  out.variance = own * own + e * e * below.variance;
  return out;
}

double dose_per_um(const CureModel& model, double phi) {
  const double per_um = model.eta * units::kLn10 / model.layer_um;
  return model.mode == ExposureMode::layerwise ? per_um : per_um * (1.0 - phi);
}

ColumnGradient::ColumnGradient(const CureModel& model, const std::vector<double>& phi,
                               double reference_mw_cm2)
    : model_(model), nodes_(phi.size() + 1) {
  check_derivatives(model);
  light_.reserve(phi.size());
  for (std::size_t n = 0; n < phi.size(); ++n) {
    LightGradient light = light_gradient(model, phi[n], reference_mw_cm2);
    const double ratio = model.ratio(static_cast<int>(n));
    for (double* value : {&light.phi, &light.stray, &light.m}) *value *= ratio;
    light_.push_back(light);
  }
  if (exchanges_resin(model)) {
    const detail::ExchangedGradient exchanged(model, *model.lifts->exchange);
    std::vector<detail::ExchangedGradient::Lift> lifts;
    windows_.resize(phi.size());
    for (std::size_t k = phi.size(); k-- > 0;) {
      windows_[k] = exchanged.add(lifts, light_[k]);
      nodes_[k] = step_gradient(model_, {}, windows_[k]);
    }
    return;
  }
  for (std::size_t k = phi.size(); k-- > 0;) {
    nodes_[k] = step_gradient(model_, light_[k], nodes_[k + 1]);
  }
}

namespace {

std::vector<double> phi_of(const CureModel& model, const std::vector<std::uint8_t>& pixels) {
  const PixelCurve curve = pixel_curve(model);
  std::vector<double> phi(pixels.size());
  for (std::size_t n = 0; n < phi.size(); ++n) {
    phi[n] = curve[pixels[n]];
  }
  return phi;
}

}  // namespace

ColumnGradient::ColumnGradient(const CureModel& model, const std::vector<std::uint8_t>& pixels,
                               double reference_mw_cm2)
    : ColumnGradient(model, phi_of(model, pixels), reference_mw_cm2) {}

DoseGradient ColumnGradient::at(double z) const {
  const double lower = std::clamp(std::ceil(z), 0.0, static_cast<double>(slices()));
  const auto node = static_cast<std::size_t>(lower);
  if (node == 0) return nodes_[0];
  if (!windows_.empty()) return step_gradient(model_, {}, windows_[node - 1], lower - z);
  return step_gradient(model_, light_[node - 1], nodes_[node], lower - z);
}

double ColumnGradient::edge_um(double z, double change, bool from_above) const {
  const double whole = std::floor(z);
  const bool at_node = z == whole;
  const auto layer = static_cast<int>(whole) - (at_node && from_above ? 1 : 0);
  const double light = layer >= 0 && layer < slices() ? phi(layer) : 0.0;
  return -change / dose_per_um(model_, light);
}

/// The doses of the model and of those beside it.
struct BandDerivatives::Differences {
  struct One {
    std::vector<double> Fields::*field;
    const CureModel* model;
    double per_step;
    double brighter, stray_mw_cm2;  ///< its light over that of the model, and what is added to it
    BandDose dose;
    std::vector<double> phi;  ///< of light that spreads
  };
  BandDose dose;
  std::vector<One> each;
  Fields middle;
};

/// Of each column, where lifts exchange resin.
struct BandDerivatives::Exchanged {
  struct At {
    At(const CureModel& model, double share, std::size_t columns)
        : exchange(share), of(model, share), lifts(columns) {}
    DoseGradient add(std::size_t column, const LightGradient& light) {
      return of.add(lifts[column], light);
    }
    double exchange;
    detail::ExchangedGradient of;
    std::vector<std::vector<detail::ExchangedGradient::Lift>> lifts;
  };
  At here;
  std::optional<At> less, more;  ///< for the slope between them
};

BandDerivatives::~BandDerivatives() = default;
BandDerivatives::BandDerivatives(BandDerivatives&&) noexcept = default;

BandDerivatives::BandDerivatives(const CureModel& model, std::size_t columns, const Wanted& wanted,
                                 const NearbyModels* nearby)
    : model_(model), wanted_(wanted) {
  if (nearby && !wanted.noise) {
    differences_ = std::make_unique<Differences>(Differences{BandDose(model, columns), {}, {}});
    const auto add = [&](std::vector<double> Fields::*field, const CureModel& near, double step,
                         double brighter = 1, double stray_mw_cm2 = 0) {
      differences_->each.push_back(
          {field, &near, 1 / step, brighter, stray_mw_cm2, BandDose(near, columns), {}});
    };
    const double step = NearbyModels::kStep;
    add(&Fields::ln_ha, nearby->ha, step);
    if (wanted.light) add(&Fields::light, nearby->light, step, std::exp(step));
    if (wanted.stray) {
      add(&Fields::stray, nearby->stray, nearby->stray_mw_cm2, 1, nearby->stray_mw_cm2);
    }
    if (wanted.m) add(&Fields::m, nearby->m, step);
    for (Fields* fields : {&lower_, &upper_, &differences_->middle}) {
      fields->dose.assign(columns, 0.0);
      for (const Differences::One& one : differences_->each) {
        (fields->*one.field).assign(columns, 0.0);
      }
    }
    light_.phi.assign(columns, 0.0);
    return;
  }
  check_derivatives(model);
  const PixelCurve curve = pixel_curve(model);
  const bool more = wanted.stray || wanted.m;
  for (std::size_t v = 0; v < curve.size(); ++v) {
    const LightGradient light = more ? light_gradient(model, curve[v], wanted.reference_mw_cm2)
                                     : LightGradient{curve[v], 0, 0};
    phi_of_[v] = light.phi;
    stray_of_[v] = light.stray;
    m_of_[v] = light.m;
  }
  const auto make = [&](std::vector<double>& values, bool is_wanted) {
    if (is_wanted) values.assign(columns, 0.0);
  };
  make(light_.phi, true);
  make(light_.stray, wanted.stray);
  make(light_.m, wanted.m);
  for (Fields* fields : {&lower_, &upper_}) {
    make(fields->dose, true);
    make(fields->ln_ha, true);
    make(fields->stray, wanted.stray);
    make(fields->m, wanted.m);
    make(fields->variance, wanted.noise);
    make(fields->exchange, wanted.exchange);
  }
  if (!exchanges_resin(model)) return;
  const double share = *model.lifts->exchange, step = wanted.exchange_step;
  exchanged_ = std::make_unique<Exchanged>(Exchanged{{model, share, columns}, {}, {}});
  if (!wanted.exchange || !(step > 0)) return;
  exchanged_->less.emplace(model, std::max(0.0, share - step), columns);
  exchanged_->more.emplace(model, std::min(1.0, share + step), columns);
}

void BandDerivatives::take_light(int slice, const std::uint8_t* pixels) {
  const double ratio = model_.ratio(slice);
  const std::size_t columns = light_.phi.size();
  const auto fill = [&](std::vector<double>& out, const PixelCurve& of) {
    if (out.empty()) return;
    if (!pixels) {
      std::fill(out.begin(), out.end(), 0.0);
      return;
    }
    for (std::size_t i = 0; i < columns; ++i) out[i] = of[pixels[i]];
    if (ratio == 1) return;
    for (double& value : out) value *= ratio;
  };
  fill(light_.phi, phi_of_);
  fill(light_.stray, stray_of_);
  fill(light_.m, m_of_);
}

namespace {

struct StepFactors {
  double a, gone, by_depth;  ///< 10^-eta, 1 - a, a L
};

SLICECORR_CLONES
void step_dose(const double* __restrict phi, const double* __restrict w, const double* __restrict h,
               double* __restrict dose, double* __restrict ln_ha, StepFactors f, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) {
    const double own = phi[i] * f.gone;
    dose[i] = own + f.a * w[i];
    ln_ha[i] = own + f.a * h[i] + f.by_depth * (w[i] - phi[i]);
  }
}
SLICECORR_CLONES
void step_linear(const double* __restrict light, const double* __restrict below,
                 double* __restrict above, StepFactors f, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) above[i] = light[i] * f.gone + f.a * below[i];
}
SLICECORR_CLONES
void step_variance(const double* __restrict phi, const double* __restrict below,
                   double* __restrict above, StepFactors f, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) {
    const double own = phi[i] * f.gone;
    above[i] = own * own + f.a * f.a * below[i];
  }
}

}  // namespace

void BandDerivatives::step_continuous() {
  std::swap(lower_, upper_);
  const std::size_t n = light_.phi.size();
  const StepFactors f{model_.a, model_.one_minus_a, model_.a * model_.eta * units::kLn10};
  step_dose(light_.phi.data(), lower_.dose.data(), lower_.ln_ha.data(), upper_.dose.data(),
            upper_.ln_ha.data(), f, n);
  if (wanted_.stray) {
    step_linear(light_.stray.data(), lower_.stray.data(), upper_.stray.data(), f, n);
  }
  if (wanted_.m) {
    step_linear(light_.m.data(), lower_.m.data(), upper_.m.data(), f, n);
    const double by_m = f.by_depth / model_.m;
    for (std::size_t i = 0; i < n; ++i) upper_.m[i] -= by_m * (lower_.dose[i] - light_.phi[i]);
  }
  if (wanted_.noise) {
    step_variance(light_.phi.data(), lower_.variance.data(), upper_.variance.data(), f, n);
  }
}

void BandDerivatives::step_layerwise() {
  const std::size_t n = light_.phi.size();
  const double a = model_.a, depth = model_.eta * units::kLn10;
  for (std::size_t i = 0; i < n; ++i) {
    lower_.dose[i] = light_.phi[i] + upper_.dose[i];
    lower_.ln_ha[i] = upper_.ln_ha[i];
    upper_.dose[i] = a * lower_.dose[i];
    upper_.ln_ha[i] = a * lower_.ln_ha[i] + depth * upper_.dose[i];
  }
  if (wanted_.stray) {
    for (std::size_t i = 0; i < n; ++i) {
      lower_.stray[i] = light_.stray[i] + upper_.stray[i];
      upper_.stray[i] = a * lower_.stray[i];
    }
  }
  if (wanted_.m) {
    for (std::size_t i = 0; i < n; ++i) {
      lower_.m[i] = light_.m[i] + upper_.m[i];
      upper_.m[i] = a * lower_.m[i] - depth / model_.m * upper_.dose[i];
    }
  }
  if (wanted_.noise) {
    for (std::size_t i = 0; i < n; ++i) {
      lower_.variance[i] = light_.phi[i] * light_.phi[i] + upper_.variance[i];
      upper_.variance[i] = a * a * lower_.variance[i];
    }
  }
}

void BandDerivatives::step_exchanged() {
  const double a = model_.a, by_depth = model_.eta * units::kLn10 * a;
  for (std::size_t i = 0; i < light_.phi.size(); ++i) {
    const LightGradient light{light_.phi[i], wanted_.stray ? light_.stray[i] : 0,
                              wanted_.m ? light_.m[i] : 0};
    DoseGradient near = exchanged_->here.add(i, light);
    if (exchanged_->less) {
      Exchanged::At &less = *exchanged_->less, &more = *exchanged_->more;
      const double change = more.add(i, light).dose - less.add(i, light).dose;
      near.exchange = change / (more.exchange - less.exchange);
    }
    const auto take = [&](std::vector<double> Fields::*field, double at_window, double at_node) {
      if ((lower_.*field).empty()) return;
      (lower_.*field)[i] = at_window;
      (upper_.*field)[i] = at_node;
    };
    take(&Fields::dose, near.dose, a * near.dose);
    take(&Fields::ln_ha, near.ln_ha, a * near.ln_ha + by_depth * near.dose);
    take(&Fields::stray, near.stray, a * near.stray);
    take(&Fields::m, near.m, a * near.m - by_depth * near.dose / model_.m);
    take(&Fields::variance, near.variance, a * a * near.variance);
    take(&Fields::exchange, near.exchange, a * near.exchange);
  }
}

void BandDerivatives::step() {
  if (exchanged_) return step_exchanged();
  model_.mode == ExposureMode::layerwise ? step_layerwise() : step_continuous();
}

void BandDerivatives::take_differences(int slice, std::span<const ImageShowing> showings) {
  Differences& d = *differences_;
  const std::size_t n = light_.phi.size();
  const bool spread = !showings.empty() && showings.front().phi;
  if (!showings.empty() && (showings.size() > 1 || showings.front().fronts)) {
    throw Error(
        "differences of doses are known of one image a slice, without UV light that spreads");
  }
  d.dose.add_slice(slice, showings);
  const std::array<std::pair<Fields*, const double*>, 3> places{
      {{&lower_, d.dose.lower()}, {&d.middle, d.dose.middle()}, {&upper_, d.dose.upper()}}};
  for (const auto& [fields, dose] : places) std::copy_n(dose, n, fields->dose.begin());
  for (Differences::One& one : d.each) {
    if (spread) {
      // The same light as its model counts it.
      ImageShowing its = showings.front();
      one.phi.resize(n);
      for (std::size_t i = 0; i < n; ++i) {
        const double shone = model_.intensity_mw_cm2(its.phi[i]) * one.brighter + one.stray_mw_cm2;
        one.phi[i] = one.model->phi(std::max(0.0, shone));
      }
      its.phi = one.phi.data();
      one.dose.add_slice(slice, {&its, 1});
    } else {
      one.dose.add_slice(slice, showings);
    }
    const std::array<const double*, 3> near{one.dose.lower(), one.dose.middle(), one.dose.upper()};
    for (std::size_t p = 0; p < places.size(); ++p) {
      std::vector<double>& out = places[p].first->*one.field;
      for (std::size_t i = 0; i < n; ++i)
        out[i] = (near[p][i] - places[p].second[i]) * one.per_step;
    }
  }
}

void BandDerivatives::add_slice(int slice, const std::uint8_t* pixels) {
  if (differences_) {
    if (!pixels) return take_differences(slice, {});
    ImageShowing whole;
    whole.pixels = pixels;
    if (model_.inhibited()) whole.setting = model_.inhibited()->setting_of_slice(slice);
    return take_differences(slice, {&whole, 1});
  }
  take_light(slice, pixels);
  step();
}

void BandDerivatives::add_slice(int slice, std::span<const ImageShowing> showings) {
  if (differences_) return take_differences(slice, showings);
  std::fill(light_.phi.begin(), light_.phi.end(), 0.0);
  const double ratio = model_.ratio(slice);
  for (const ImageShowing& showing : showings) {
    for (std::size_t i = 0; i < light_.phi.size(); ++i) {
      light_.phi[i] += showing.light * (showing.phi ? showing.phi[i] : phi_of_[showing.pixels[i]]);
    }
  }
  for (std::size_t i = 0; i < light_.phi.size() && (wanted_.stray || wanted_.m); ++i) {
    const LightGradient light = light_gradient(model_, light_.phi[i], wanted_.reference_mw_cm2);
    if (wanted_.stray) light_.stray[i] = ratio * light.stray;
    if (wanted_.m) light_.m[i] = ratio * light.m;
  }
  if (ratio != 1) {
    for (double& phi : light_.phi) phi *= ratio;
  }
  step();
}

namespace {

/// Of a parabola through `lower` at 0, `middle` at 1/2 and `upper` at 1.
double parabola(double lower, double middle, double upper, double t) {
  return lower + t * (4 * middle - 3 * lower - upper) + 2 * t * t * (lower + upper - 2 * middle);
}

}  // namespace

DoseGradient BandDerivatives::at(std::size_t column, double t) const {
  const std::size_t i = column;
  const auto value = [i](const std::vector<double>& of) { return of.empty() ? 0.0 : of[i]; };
  if (differences_) {
    const Fields& middle = differences_->middle;
    const double least = std::min({lower_.dose[i], middle.dose[i], upper_.dose[i]});
    const auto between = [&](std::vector<double> Fields::*f) {
      return (lower_.*f).empty() ? 0.0
                                 : parabola((lower_.*f)[i], (middle.*f)[i], (upper_.*f)[i], t);
    };
    DoseGradient g{between(&Fields::dose),
                   between(&Fields::ln_ha),
                   between(&Fields::stray),
                   between(&Fields::m),
                   0,
                   between(&Fields::light)};
    // Light falls as a power of the distance; what a moving window leaves is nearer to a parabola itself.
    const bool falls = model_.mode == ExposureMode::layerwise || model_.inhibited();
    if (least > 0 && falls) {
      g.dose = std::exp(parabola(std::log(lower_.dose[i]), std::log(middle.dose[i]),
                                 std::log(upper_.dose[i]), t));
    }
    g.dose = std::max(g.dose, 0.0);
    return g;
  }
  const DoseGradient below{lower_.dose[i],        lower_.ln_ha[i],        value(lower_.stray),
                           value(lower_.m),       value(lower_.variance), 0,
                           value(lower_.exchange)};
  // Layer by layer the light of the slice is in the doses at its window already.
  if (model_.mode == ExposureMode::layerwise) return step_gradient(model_, {}, below, t);
  return step_gradient(model_, {light_.phi[i], value(light_.stray), value(light_.m)}, below, t);
}

Resin with_height_times(Resin resin, double factor) {
  const double before_um = dose_height_e_um(resin);
  resin.absorbance_height10_um *= factor;
  if (resin.critical_dose_prime > 0) return resin;
  const double held = before_um / dose_height_e_um(resin);
  resin.critical_dose_mj_cm3 *= held;
  resin.gel_dose_mj_cm3 *= held;
  return resin;
}

Process with_pattern_held(Process process, const Resin& of, const Resin& off, double brighter) {
  if (process.uv.kind != UvKind::patterned || !of.inhibition) return process;
  // Iuv = Ib / beta e^(zf (1/huv - 1/hb))
  const auto slope = [](const Resin& r) {
    return 1 / units::height_e_from_10(r.inhibition->absorbance_height10_um) -
           1 / units::height_e_from_10(r.absorbance_height10_um);
  };
  double& zone_um = process.uv.dead_zone_um;
  zone_um = (zone_um * slope(of) - std::log(brighter)) / slope(off);
  return process;
}

NearbyModels nearby_models(const Printer& printer, const Resin& resin, const Process& process,
                           double layer_um, double reference_mw_cm2) {
  const double step = NearbyModels::kStep;
  NearbyModels near;
  const auto model = [&](const Printer& p, const Resin& r, double brighter = 1) {
    return make_cure_model(p, r, with_pattern_held(process, resin, r, brighter), layer_um);
  };
  near.ha = model(printer, with_height_times(resin, std::exp(step)));
  near.light = model(dimmed(printer, std::exp(step)), resin, std::exp(step));
  Printer stray = printer;
  near.stray_mw_cm2 = step * printer.calibration.back().intensity_mw_cm2;
  for (CalibrationPoint& point : stray.calibration) point.intensity_mw_cm2 += near.stray_mw_cm2;
  near.stray = model(stray, resin);
  if (!(reference_mw_cm2 > 0)) return near;
  refuse_law(resin, LawUse::exponent_errors);
  if (process.uv.kind != UvKind::off && !(resin.critical_dose_prime > 0)) {
    throw InputError(
        "how the dose changes with the exponent under UV light is known of resins with "
        "critical_dose_prime only; expected no error of m");
  }
  // D'c is held where I = Iref.
  Resin steep = resin;
  const double held = std::pow(reference_mw_cm2, step);
  steep.m += step;
  if (!(resin.critical_dose_prime > 0)) {
    steep.critical_dose_prime = make_kinetics(resin, false, true).critical_dose_prime;
  }
  steep.critical_dose_prime *= held;
  if (steep.inhibition) {
    steep.inhibition->m += step;
    steep.inhibition->critical_dose_prime *= held;
  }
  near.m = model(printer, steep);
  return near;
}

}  // namespace slicecorr
