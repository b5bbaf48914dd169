// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/prepare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include "fit/starts.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

// Wide enough for any resin; they only keep the solver's numbers finite.
constexpr double kLeastHeight = 1e-3, kGreatestHeight = 1e9;
constexpr double kLeastDose = 1e-12, kGreatestDose = 1e15;
constexpr double kLeastBeta = 1e-6, kGreatestBeta = 1e6;
// A resin file takes exponents up to 2; theory has 1/2 to 1.
constexpr double kLeastExponent = 0.05, kGreatestExponent = 2;

/// Standard deviations by column or by replicates: weights are their inverse.
void weigh_by_scatter(PreparedFit& s, const std::vector<double>& sigma_given) {
  // The scatter of three replicates is itself uncertain by half: taken as it is, it would give
  // single groups far too much to say. It is drawn to that of all by what the groups tell.
  auto& all = s.problem.observations;
  std::vector<double> sigma = sigma_given;
  const auto groups = replicate_groups(all);
  for (const bool dead_zone : {false, true}) {
    std::vector<double> variances, freedoms;
    std::vector<std::pair<std::span<const std::size_t>, double>> unknown;
    for (std::size_t g = 0; g < groups.count(); ++g) {
      const auto group = groups[g];
      if (all[group.front()].is_dead_zone != dead_zone) continue;
      const double n = static_cast<double>(group.size());
      double mean = 0, squares = 0;
      bool given = true;
      for (const std::size_t i : group) {
        mean += all[i].measured_um / n;
        given = given && sigma[i] > 0;
      }
      for (const std::size_t i : group) squares += std::pow(all[i].measured_um - mean, 2);
      if (n > 1) {
        variances.push_back(squares / (n - 1));
        freedoms.push_back(n - 1);
      }
      if (!given) unknown.emplace_back(group, n > 2 ? squares / (n - 1) : -1);
    }
    if (unknown.empty()) continue;
    if (variances.empty() || *std::max_element(variances.begin(), variances.end()) <= 0) {
      refuse_fit(
          s, fmt::format("weights by scatter were asked for, but {} has neither replicates that "
                         "differ nor a number in a column sigma_um; expected one of them",
                         dead_zone ? "a dead zone" : "a cured height"));
    }
    const VariancePrior prior = variance_prior(variances, freedoms);
    for (const auto& [group, own] : unknown) {
      const double variance =
          own < 0 ? prior.variance : prior.moderated(own, static_cast<double>(group.size()) - 1);
      for (const std::size_t i : group) {
        if (sigma[i] <= 0) sigma[i] = std::sqrt(variance);
      }
    }
  }
  for (std::size_t i = 0; i < all.size(); ++i) all[i].weight = 1 / sigma[i];
}

void check_number(const std::string& what, double value, bool positive) {
  if (!std::isfinite(value) || (positive && !(value > 0))) {
    throw InputError(fmt::format("{} is {}; expected a finite number{}", what, value,
                                 positive ? " above 0" : ""));
  }
}

/// Bounds and fixed values as asked for.
void apply_choices(PreparedFit& s, const FitOptions& options) {
  std::string names;
  for (const auto& p : s.parameters) names += (names.empty() ? "" : ", ") + p.unknown.name;
  const auto find = [&](const std::string& name) {
    const auto at = std::find_if(s.parameters.begin(), s.parameters.end(),
                                 [&](const auto& p) { return p.unknown.name == name; });
    if (at == s.parameters.end()) {
      throw InputError(fmt::format("'{}' is no parameter of the {} model; expected one of {}", name,
                                   name_of(s.model), names));
    }
    return static_cast<std::size_t>(at - s.parameters.begin());
  };
  for (const auto& [name, bounds] : options.bounds) {
    Unknown& u = s.parameters[find(name)].unknown;
    check_number("the lower bound of " + name, bounds.low, true);
    check_number("the upper bound of " + name, bounds.high, true);
    if (!(bounds.low < bounds.high)) {
      throw InputError(
          fmt::format("the bounds of {} are {:g} to {:g}; expected the lower one first", name,
                      bounds.low, bounds.high));
    }
    const double limit = u.slots.front() == kUvHeight ? u.high : bounds.high;
    if (!(bounds.low < limit)) {
      throw InputError(
          fmt::format("the lower bound of {} is {:g}; expected less than the height of the curing "
                      "light, {:g} um",
                      name, bounds.low, limit));
    }
    u.low = bounds.low;
    u.high = std::min(bounds.high, limit);
  }
  for (const auto& [name, value] : options.fixed) {
    const Unknown& u = s.parameters[find(name)].unknown;
    check_number(name, value, true);
    if (u.slots.front() == kUvHeight && !(value < u.high)) {
      throw InputError(fmt::format(
          "{} is {:g} um; expected less than the height of the curing light", name, value));
    }
    if (options.bounds.contains(name)) {
      throw InputError(fmt::format("{} is both fixed and bounded; expected one of them", name));
    }
  }
  for (const auto& p : s.parameters) s.problem.unknowns.push_back(p.unknown);
}

/// What is wrong with the options whatever was measured.
void check_options(FitModel model, const FitOptions& options) {
  if (!(options.tolerance > 0 && options.tolerance < 1)) {
    throw InputError(
        fmt::format("the tolerance is {:g}; expected a number between 0 and 1", options.tolerance));
  }
  if (options.starts < 1) {
    throw InputError(fmt::format("starts is {}; expected 1 or more", options.starts));
  }
  if (options.bootstrap < 0) {
    throw InputError(fmt::format("bootstrap is {}; expected 0 or more", options.bootstrap));
  }
  if (model == FitModel::dead_zone_steady || model == FitModel::dead_zone_transient) {
    const auto need = [&](const char* what, double value) {
      if (std::isfinite(value) && value > 0) return;
      throw InputError(
          fmt::format("the {} model stands on the blue law of the resin, and {} is {:g}; expected "
                      "it from --resin",
                      name_of(model), what, value));
    };
    need("its absorbance height hb_um", options.hb_um);
    if (model == FitModel::dead_zone_transient) {
      need("its gel dose D'c", options.critical_dose_prime);
      need("its exponent m", options.m);
    }
  }
}

/// What the rows of measurements give besides the observations.
struct RowNumbers {
  std::size_t cured = 0, dead = 0;     ///< that became observations
  int without_intensity = 0;           ///< cured heights with a dose alone
  std::vector<std::string> saturated;  ///< places of dead zones of 0
  std::vector<double> sigma_um;        ///< per observation, 0: not given
};

void take_cured_heights(PreparedFit& s, const Measurements& data, RowNumbers& rows) {
  for (const CuredHeight& c : data.cured) {
    FitPoint p;
    p.blue_mw_cm2 = c.blue_mw_cm2;
    p.exposure_s = c.exposure_s;
    p.dose_mj_cm2 = c.dose_mj_cm2;
    p.measured_um = c.height_um;
    p.origin = c.origin;
    Observation o;
    o.measured_um = c.height_um;
    const bool known = c.blue_mw_cm2 > 0 && c.exposure_s > 0;
    rows.without_intensity += known ? 0 : 1;
    o.exposure.ln_blue = known ? std::log(c.blue_mw_cm2) : 0;
    o.exposure.ln_time = known ? std::log(c.exposure_s) : std::log(c.dose_mj_cm2);
    s.point_of.push_back(s.points.size());
    s.points.push_back(p);
    s.problem.observations.push_back(o);
    rows.sigma_um.push_back(c.sigma_um);
  }
  rows.cured = data.cured.size();
}

void take_dead_zones(PreparedFit& s, const Measurements& data, RowNumbers& rows) {
  for (const DeadZone& d : data.dead_zones) {
    FitPoint p;
    p.is_dead_zone = true;
    p.blue_mw_cm2 = d.blue_mw_cm2;
    p.uv_mw_cm2 = d.uv_mw_cm2;
    p.exposure_s = d.exposure_s;
    p.dose_mj_cm2 = d.blue_mw_cm2 * d.exposure_s;
    p.measured_um = d.dead_zone_um;
    p.origin = d.origin;
    if (d.dead_zone_um <= 0) {
      // Such a sample says only that the front has arrived, not when: no residual can be given.
      p.weight = 0;
      rows.saturated.push_back(place_of(d.origin, data.sources));
      s.points.push_back(p);
      continue;
    }
    Observation o;
    o.is_dead_zone = true;
    o.measured_um = d.dead_zone_um;
    o.exposure = {std::log(d.blue_mw_cm2), std::log(d.uv_mw_cm2), std::log(d.exposure_s)};
    s.point_of.push_back(s.points.size());
    s.points.push_back(p);
    s.problem.observations.push_back(o);
    rows.sigma_um.push_back(d.sigma_um);
  }
  rows.dead = data.dead_zones.size() - rows.saturated.size();
}

/// Points and observations of all measurements that the model uses.
RowNumbers take_measurements(PreparedFit& s, const Measurements& data) {
  RowNumbers rows;
  const bool cured = kind_of(s.model).heights, dead = kind_of(s.model).dead_zones;
  const std::size_t most = (cured ? data.cured.size() : 0) + (dead ? data.dead_zones.size() : 0);
  s.points.reserve(most);
  s.point_of.reserve(most);
  s.problem.observations.reserve(most);
  rows.sigma_um.reserve(most);
  if (cured) take_cured_heights(s, data, rows);
  if (dead) take_dead_zones(s, data, rows);
  return rows;
}

/// Throws where the measurements are not enough for the model.
void check_enough(const PreparedFit& s, const Measurements& data, const FitOptions& options,
                  const RowNumbers& rows) {
  if (kind_of(s.model).heights && rows.cured == 0) {
    refuse_fit(s, fmt::format("there are no cured heights among the measurements ({} dead zones); "
                              "expected intensity_mw_cm2,exposure_s,cured_height_um",
                              data.dead_zones.size()));
  }
  if (kind_of(s.model).dead_zones && rows.dead == 0) {
    refuse_fit(
        s, rows.saturated.empty()
               ? fmt::format("there are no dead zones among the measurements ({} cured "
                             "heights); expected blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um",
                             data.cured.size())
               : fmt::format("all {} dead zones are 0: the resin cured to the window each time; "
                             "expected more UV or less blue light, or shorter exposures",
                             rows.saturated.size()));
  }
  if (rows.without_intensity > 0 && !kind_of(s.model).by_dose) {
    refuse_fit(s, fmt::format(
                      "{} of {} cured heights come with a dose alone; expected "
                      "intensity_mw_cm2 and exposure_s (a dose is enough for jacobs and bleaching)",
                      rows.without_intensity, rows.cured));
  }
  std::size_t free = 0;
  for (const Unknown& u : s.problem.unknowns) free += options.fixed.contains(u.name) ? 0 : 1;
  if (s.problem.observations.size() < free) {
    refuse_fit(s, fmt::format("{} measurements are fewer than its {} free parameters; expected at "
                              "least {}, better 3 times as many",
                              s.problem.observations.size(), free, free + 1));
  }
}

void warn_of_unused(PreparedFit& s, const Measurements& data, const RowNumbers& rows) {
  if (!kind_of(s.model).heights && !data.cured.empty()) {
    s.warnings.push_back(fmt::format("{} cured heights are not used by the {} model",
                                     data.cured.size(), name_of(s.model)));
  }
  if (!kind_of(s.model).dead_zones && !data.dead_zones.empty()) {
    s.warnings.push_back(fmt::format("{} dead zones are not used by the {} model",
                                     data.dead_zones.size(), name_of(s.model)));
  }
  if (!rows.saturated.empty()) {
    std::string lines;
    for (std::size_t i = 0; i < std::min<std::size_t>(rows.saturated.size(), 5); ++i) {
      lines += (i ? ", " : "") + rows.saturated[i];
    }
    if (rows.saturated.size() > 5) lines += ", ...";
    s.warnings.push_back(
        fmt::format("{} of {} dead zones are 0, cured to the window ({}): that says only that the "
                    "dead zone had closed, so the fit leaves them out; measure with more UV or "
                    "less blue light, or shorter",
                    rows.saturated.size(), rows.saturated.size() + rows.dead, lines));
  }
}

}  // namespace

std::vector<ParameterKind> parameters_of(FitModel model, const FitOptions& options) {
  const ParameterKind h{{"h_um", {kHeight}, true, kLeastHeight, kGreatestHeight}, "um"};
  const ParameterKind dc{{"dc_mj_cm2", {kDose}, true, kLeastDose, kGreatestDose}, "mJ/cm²"};
  const ParameterKind prime{{"critical_dose_prime", {kDose}, true, kLeastDose, kGreatestDose},
                            "(mW/cm²)^m·s"};
  const ParameterKind beta{{"beta", {kBeta}, true, kLeastBeta, kGreatestBeta}, ""};
  ParameterKind huv{{"huv_um", {kUvHeight}, true, kLeastHeight, kGreatestHeight}, "um"};
  const auto exponent = [](const char* name, std::vector<Slot> slots) {
    return ParameterKind{{name, std::move(slots), false, kLeastExponent, kGreatestExponent}, ""};
  };
  // The front has no place to stand unless UV light is absorbed more than blue light.
  const double below_hb = options.hb_um * (1 - 1e-6);
  switch (model) {
    case FitModel::jacobs:
      return {h, dc};
    case FitModel::kinetic:
      return {h, exponent("m", {kExponent}), prime};
    case FitModel::gel_time:
      return {
          h,
          {{"gel_a_mj_cm2", {kGelA}, true, kLeastDose, kGreatestDose}, "mJ/cm²"},
          {{"gel_b_sqrt_mw_cm2_s", {kGelB}, true, kLeastDose, kGreatestDose}, "sqrt(mW/cm²)·s"}};
    case FitModel::bleaching:
      return {
          h,
          dc,
          {{"h_bleached_um", {kBleachedHeight}, true, kLeastHeight, kGreatestHeight}, "um"},
          {{"bleaching_dose_mj_cm2", {kBleachingDose}, true, kLeastDose, kGreatestDose}, "mJ/cm²"}};
    case FitModel::dead_zone_steady:
      huv.unknown.high = below_hb;
      return {beta, huv};
    case FitModel::dead_zone_transient:
      huv.unknown.high = below_hb;
      return {beta, huv, exponent("m", {kUvExponent})};
    case FitModel::joint:
      if (!options.separate_m) {
        return {h, exponent("m", {kExponent, kUvExponent}), prime, beta, huv};
      }
      return {h, exponent("m", {kExponent}), prime, beta, huv, exponent("m_uv", {kUvExponent})};
  }
  return {};
}

void PreparedFit::hold(const std::string& name, double value) {
  for (auto u = problem.unknowns.begin(); u != problem.unknowns.end(); ++u) {
    if (u->name != name) continue;
    for (const Slot s : u->slots) problem.fixed[s] = start[s] = value;
    problem.unknowns.erase(u);
    return;
  }
}

void PreparedFit::share_exponent() {
  std::erase_if(parameters, [](const auto& p) { return p.unknown.name == "m_uv"; });
  std::erase_if(problem.unknowns, [](const Unknown& u) { return u.name == "m_uv"; });
  bool free = false;
  for (Unknown& u : problem.unknowns) {
    if (u.name != "m") continue;
    u.slots = {kExponent, kUvExponent};
    free = true;
  }
  for (auto& p : parameters) {
    if (p.unknown.name == "m") p.unknown.slots = {kExponent, kUvExponent};
  }
  if (!free) problem.fixed[kUvExponent] = problem.fixed[kExponent];
  start[kUvExponent] = start[kExponent];
}

int count_different(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  int count = values.empty() ? 0 : 1;
  for (std::size_t i = 1; i < values.size(); ++i) {
    // Logarithms are compared: rounding of a product, not a setting of its own.
    if (values[i] - values[i - 1] > 1e-9) ++count;
  }
  return count;
}

Groups replicate_groups(const std::vector<Observation>& all) {
  Groups groups;
  groups.order.resize(all.size());
  std::iota(groups.order.begin(), groups.order.end(), std::size_t{0});
  const auto key = [&](std::size_t i) {
    const Observation& o = all[i];
    return std::tuple(o.is_dead_zone, o.exposure.ln_blue, o.exposure.ln_uv, o.exposure.ln_time);
  };
  std::sort(groups.order.begin(), groups.order.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(key(a), a) < std::pair(key(b), b);
  });
  for (std::size_t k = 0; k < groups.order.size(); ++k) {
    if (k == 0 || key(groups.order[k]) != key(groups.order[k - 1])) groups.begin.push_back(k);
  }
  groups.begin.push_back(groups.order.size());
  return groups;
}

void normalise_weights(Problem& problem) {
  double sum = 0;
  for (const Observation& o : problem.observations) sum += o.weight * o.weight;
  const double factor = std::sqrt(static_cast<double>(problem.observations.size()) / sum);
  for (Observation& o : problem.observations) o.weight *= factor;
}

std::string place_of(const Origin& origin, const std::vector<std::string>& sources) {
  const auto source = static_cast<std::size_t>(origin.source);
  const std::string name = source < sources.size() ? sources[source] : "measurement";
  return origin.line > 0 ? fmt::format("{}: line {}", name, origin.line) : name;
}

PreparedFit prepare_fit(const Measurements& data, FitModel model, const FitOptions& options) {
  check_options(model, options);
  PreparedFit s;
  s.model = model;
  s.problem.is_steady = model == FitModel::dead_zone_steady;
  s.problem.tolerance = options.tolerance;
  s.parameters = parameters_of(model, options);
  apply_choices(s, options);
  s.problem.fixed[kHeight] = s.start[kHeight] = options.hb_um;
  s.problem.fixed[kExponent] = s.start[kExponent] = kind_of(model).by_dose ? 1 : options.m;
  s.problem.fixed[kUvExponent] = s.start[kUvExponent] = options.m;
  s.problem.fixed[kDose] = s.start[kDose] = options.critical_dose_prime;
  s.start[kBeta] = s.start[kUvHeight] = 1;

  const RowNumbers rows = take_measurements(s, data);
  check_enough(s, data, options, rows);
  warn_of_unused(s, data, rows);
  choose_starts(s, options);
  for (const auto& [name, value] : options.fixed) s.hold(name, value);
  if (options.weights == Weights::scatter) weigh_by_scatter(s, rows.sigma_um);
  normalise_weights(s.problem);
  return s;
}

}  // namespace slicecorr::resins
