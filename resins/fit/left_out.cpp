// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Which law to trust: each predicts settings that it was not fitted to.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "fit/estimate.hpp"
#include "fit/figure_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/fit.hpp"

namespace slicecorr::resins {

namespace {

// More settings are left out several at a time, so that the work stays that of so many fits.
constexpr std::size_t kMostFolds = 60;
constexpr std::size_t kMostMeasurements = 20000;
constexpr std::size_t kFewestSettings = 4;

/// Of each measurement the group that is left out with it, and how many groups there are.
struct Folds {
  std::vector<std::size_t> of;
  std::size_t count = 0;
};

Exposure exposure_of(const CuredHeight& c) {
  if (!(c.blue_mw_cm2 > 0)) return {0, 0, std::log(c.dose_mj_cm2)};
  return {std::log(c.blue_mw_cm2), 0, std::log(c.exposure_s)};
}

/// Measurements that were exposed alike go together: one of them would tell of the others.
Folds folds_of_settings(const std::vector<CuredHeight>& cured, std::size_t& settings) {
  std::map<std::pair<double, double>, std::size_t> known;  // by dose, then by light
  for (const CuredHeight& c : cured) known.emplace(std::pair(c.dose_mj_cm2, c.blue_mw_cm2), 0);
  settings = known.size();
  Folds folds{{}, std::min(settings, kMostFolds)};
  std::size_t at = 0;
  for (auto& [setting, fold] : known) fold = at++ % folds.count;
  folds.of.reserve(cured.size());
  for (const CuredHeight& c : cured) {
    folds.of.push_back(known.at({c.dose_mj_cm2, c.blue_mw_cm2}));
  }
  return folds;
}

Folds folds_of_files(const std::vector<CuredHeight>& cured) {
  std::map<int, std::size_t> known;
  for (const CuredHeight& c : cured) known.emplace(c.origin.source, known.size());
  Folds folds{{}, known.size()};
  folds.of.reserve(cured.size());
  for (const CuredHeight& c : cured) folds.of.push_back(known.at(c.origin.source));
  return folds;
}

/// Predicted minus measured of each height, by fits to all the other folds. Throws `InputError`
/// where a law can't be fitted without one of them.
std::vector<double> errors_left_out(const Measurements& data, const PreparedFit& all,
                                    const Folds& folds, const FitOptions& options) {
  std::vector<double> errors(data.cured.size());
  for (std::size_t fold = 0; fold < folds.count; ++fold) {
    Measurements rest;
    rest.sources = data.sources;
    for (std::size_t i = 0; i < data.cured.size(); ++i) {
      if (folds.of[i] != fold) rest.cured.push_back(data.cured[i]);
    }
    PreparedFit prepared = prepare_fit(rest, all.model, options);
    // The fit to all is near: one start is enough.
    prepared.start = all.start;
    const Slots law = prepared.problem.law(estimate(prepared, options).inner);
    for (std::size_t i = 0; i < data.cured.size(); ++i) {
      if (folds.of[i] != fold) continue;
      errors[i] = cured_height(law, exposure_of(data.cured[i])).um - data.cured[i].height_um;
      if (!std::isfinite(errors[i])) {
        throw InputError("it foresees no height at a setting that is left out");
      }
    }
  }
  return errors;
}

double mean_square(const std::vector<double>& errors) {
  double sum = 0;
  for (const double e : errors) sum += e * e;
  return sum / static_cast<double>(errors.size());
}

/// Standard error of the mean square, from its scatter between folds.
double error_of_mean_square(const std::vector<double>& errors, const Folds& folds) {
  std::vector<double> sum(folds.count), rows(folds.count);
  for (std::size_t i = 0; i < errors.size(); ++i) {
    sum[folds.of[i]] += errors[i] * errors[i];
    rows[folds.of[i]] += 1;
  }
  const auto n = static_cast<double>(folds.count);
  double mean = 0, squares = 0;
  for (std::size_t k = 0; k < folds.count; ++k) mean += sum[k] / rows[k] / n;
  for (std::size_t k = 0; k < folds.count; ++k) squares += std::pow(sum[k] / rows[k] - mean, 2);
  return std::sqrt(squares / (n - 1) / n);
}

std::size_t different_intensities(const std::vector<CuredHeight>& cured) {
  std::vector<double> ln_blue;
  for (const CuredHeight& c : cured) {
    if (c.blue_mw_cm2 > 0) ln_blue.push_back(std::log(c.blue_mw_cm2));
  }
  return static_cast<std::size_t>(count_different(ln_blue));
}

std::string verdict_of(const LeftOut& l) {
  std::string text;
  for (const LeftOutLaw& law : l.laws) {
    text += fmt::format("{}{} {} um", text.empty() ? "" : ", ", name_of(law.model),
                        figure(law.left_out_rmse_um));
    if (law.other_files_rmse_um) {
      text += fmt::format(" (other files {} um)", figure(*law.other_files_rmse_um));
    }
  }
  return fmt::format(
      "Settings that were left out of the fit are predicted to (rms): {}. Trust {}{}.", text,
      name_of(l.trust),
      l.laws.size() > 1 ? ", the plainest that is no worse than chance allows" : "");
}

}  // namespace

std::optional<LeftOut> compare_left_out(const Measurements& data, const FitOptions& options,
                                        const ExecutionContext& context) {
  if (!options.fixed.empty() || !options.bounds.empty() || data.cured.empty()) return std::nullopt;
  if (data.cured.size() > kMostMeasurements) return std::nullopt;
  LeftOut l;
  const Folds settings = folds_of_settings(data.cured, l.settings);
  const Folds files = folds_of_files(data.cured);
  if (l.settings < kFewestSettings) return std::nullopt;

  FitOptions from_there = options;
  from_there.starts = 1;
  std::vector<std::vector<double>> errors;
  for (std::size_t k = 0; k < fit_model_kinds().size(); ++k) {
    const auto model = static_cast<FitModel>(k);
    if (!kind_of(model).heights || kind_of(model).dead_zones) continue;
    context.check_cancelled();
    try {
      // Exponent and dose can't be told apart then, and the law is Jacobs'.
      if (model == FitModel::kinetic && different_intensities(data.cured) < 2) {
        throw InputError("heights at one intensity are those of Jacobs' law");
      }
      PreparedFit all = prepare_fit(data, model, options);
      all.start = all.problem.law(estimate(all, options).inner);
      LeftOutLaw law;
      law.model = model;
      law.parameters = static_cast<int>(all.problem.unknowns.size());
      errors.push_back(errors_left_out(data, all, settings, from_there));
      law.left_out_rmse_um = std::sqrt(mean_square(errors.back()));
      for (const double e : errors.back()) {
        law.left_out_bias_um += e / static_cast<double>(data.cured.size());
      }
      if (files.count > 1) {
        law.other_files_rmse_um =
            std::sqrt(mean_square(errors_left_out(data, all, files, from_there)));
      }
      l.laws.push_back(law);
    } catch (const InputError& e) {
      errors.resize(l.laws.size());
      l.not_compared.push_back(fmt::format("{}: {}", name_of(model), e.what()));
    }
  }
  if (l.laws.empty()) return std::nullopt;

  std::size_t best = 0;
  for (std::size_t k = 1; k < errors.size(); ++k) {
    if (mean_square(errors[k]) < mean_square(errors[best])) best = k;
  }
  const double most = mean_square(errors[best]) + error_of_mean_square(errors[best], settings);
  std::size_t trusted = best;
  for (std::size_t k = 0; k < errors.size(); ++k) {
    if (l.laws[k].parameters < l.laws[trusted].parameters && mean_square(errors[k]) <= most) {
      trusted = k;
    }
  }
  l.trust = l.laws[trusted].model;
  l.verdict = verdict_of(l);
  return l;
}

}  // namespace slicecorr::resins
