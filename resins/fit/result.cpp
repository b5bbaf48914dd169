// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a fit tells: predictions with their band, JSON, and text for people.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "fit/figure_text.hpp"
#include "fit/prepare.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/fit.hpp"
#include "support/json/finite.hpp"

namespace slicecorr::resins {

namespace {

using Json = nlohmann::ordered_json;
using slicecorr::detail::finite_or_null;

// A table for a program to draw, not an archive: larger ones would be hundreds of megabytes.
constexpr std::size_t kMostPointsInJson = 20000;

Json interval(const std::array<double, 2>& ci) {
  return {finite_or_null(ci[0]), finite_or_null(ci[1])};
}

Slots law_of(const FitResult& r) {
  Slots law{};
  law[kHeight] = r.hb_um;
  law[kDose] = r.critical_dose_prime;
  law[kExponent] = law[kUvExponent] = r.m;
  const bool own_m = r.model == FitModel::dead_zone_transient;
  for (const Parameter& p : r.parameters) {
    if (p.name == "beta") law[kBeta] = p.value;
    if (p.name == "huv_um") law[kUvHeight] = p.value;
    if (p.name == "gel_a_mj_cm2") law[kGelA] = p.value;
    if (p.name == "gel_b_sqrt_mw_cm2_s") law[kGelB] = p.value;
    if (p.name == "h_bleached_um") law[kBleachedHeight] = p.value;
    if (p.name == "bleaching_dose_mj_cm2") law[kBleachingDose] = p.value;
    if (p.name == "m_uv" || (own_m && p.name == "m")) law[kUvExponent] = p.value;
  }
  return law;
}

Slot slot_of(const FitResult& r, const std::string& name) {
  if (name == "h_um") return kHeight;
  if (name == "dc_mj_cm2" || name == "critical_dose_prime") return kDose;
  if (name == "beta") return kBeta;
  if (name == "huv_um") return kUvHeight;
  if (name == "gel_a_mj_cm2") return kGelA;
  if (name == "gel_b_sqrt_mw_cm2_s") return kGelB;
  if (name == "h_bleached_um") return kBleachedHeight;
  if (name == "bleaching_dose_mj_cm2") return kBleachingDose;
  if (name == "m_uv" || r.model == FitModel::dead_zone_transient) return kUvExponent;
  return kExponent;
}

Height predict(const FitResult& r, double blue, double uv, double exposure) {
  const Slots law = law_of(r);
  const Exposure e{std::log(blue), uv > 0 ? std::log(uv) : 0, std::log(exposure)};
  if (!(uv > 0)) return cured_height(law, e);
  if (!kind_of(r.model).dead_zones) {
    throw InputError(fmt::format("a {} fit says nothing about UV light; expected a dead-zone fit",
                                 name_of(r.model)));
  }
  return r.model == FitModel::dead_zone_steady ? steady_height(law, e) : front_height(law, e);
}

Json kind_json(const KindFit& k) {
  return Json{{"n", k.n},
              {"r2", finite_or_null(k.r2)},
              {"rmse_um", finite_or_null(k.rmse_um)},
              {"sigma_um", finite_or_null(k.sigma_um)}};
}

Json outlier_json(const FitResult& r, const Outlier& o) {
  const FitPoint& p = r.points[o.point];
  const auto source = static_cast<std::size_t>(p.origin.source);
  return Json{{"point", o.point},
              {"file", source < r.sources.size() ? Json(r.sources[source]) : Json()},
              {"line", p.origin.line},
              {"measured_um", finite_or_null(p.measured_um)},
              {"predicted_um", finite_or_null(p.predicted_um)},
              {"studentised", finite_or_null(p.studentised)},
              {"leverage", finite_or_null(p.leverage)},
              {"cooks_distance", finite_or_null(p.cooks_distance)},
              {"reason", o.reason}};
}

Json point_json(const FitPoint& p) {
  Json q{{"kind", p.is_dead_zone ? "dead_zone" : "cured_height"}};
  if (p.blue_mw_cm2 > 0) q["blue_mw_cm2"] = p.blue_mw_cm2;
  if (p.is_dead_zone) q["uv_mw_cm2"] = p.uv_mw_cm2;
  if (p.exposure_s > 0) q["exposure_s"] = p.exposure_s;
  q["dose_mj_cm2"] = finite_or_null(p.dose_mj_cm2);
  q["measured_um"] = finite_or_null(p.measured_um);
  q["predicted_um"] = finite_or_null(p.predicted_um);
  q["weight"] = finite_or_null(p.weight);
  q["leverage"] = finite_or_null(p.leverage);
  q["studentised"] = finite_or_null(p.studentised);
  q["cooks_distance"] = finite_or_null(p.cooks_distance);
  q["source"] = p.origin.source;
  q["line"] = p.origin.line;
  return q;
}

Json left_out_json(const LeftOut& l) {
  Json laws = Json::array();
  for (const LeftOutLaw& law : l.laws) {
    laws.push_back({{"model", std::string(name_of(law.model))},
                    {"parameters", law.parameters},
                    {"left_out_rmse_um", finite_or_null(law.left_out_rmse_um)},
                    {"left_out_bias_um", finite_or_null(law.left_out_bias_um)}});
    if (law.other_files_rmse_um) {
      laws.back()["other_files_rmse_um"] = finite_or_null(*law.other_files_rmse_um);
    }
  }
  return Json{{"settings", l.settings},
              {"laws", std::move(laws)},
              {"not_compared", l.not_compared},
              {"trust", std::string(name_of(l.trust))},
              {"verdict", l.verdict}};
}

/// A matrix of `width` rows.
Json square_json(const std::vector<double>& values, std::size_t width) {
  Json rows = Json::array();
  for (std::size_t i = 0; i < width; ++i) {
    Json row = Json::array();
    for (std::size_t k = 0; k < width; ++k) row.push_back(finite_or_null(values[i * width + k]));
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace

const Parameter* FitResult::find(std::string_view name) const {
  const auto at = std::find_if(parameters.begin(), parameters.end(),
                               [&](const Parameter& p) { return p.name == name; });
  return at == parameters.end() ? nullptr : &*at;
}

double FitResult::value(std::string_view name) const {
  if (const Parameter* p = find(name)) return p->value;
  throw InputError(fmt::format("a {} fit has no parameter {}", name_of(model), name));
}

double predict_um(const FitResult& r, double blue_mw_cm2, double uv_mw_cm2, double exposure_s) {
  const Height z = predict(r, blue_mw_cm2, uv_mw_cm2, exposure_s);
  if (!(uv_mw_cm2 > 0)) return z.um;
  if (z.gels) return std::max(0.0, z.um);
  const Exposure e{std::log(blue_mw_cm2), std::log(uv_mw_cm2), std::log(exposure_s)};
  return std::max(0.0, first_gel_height(law_of(r), e));
}

double confidence_um(const FitResult& r, double blue_mw_cm2, double uv_mw_cm2, double exposure_s) {
  const Height z = predict(r, blue_mw_cm2, uv_mw_cm2, exposure_s);
  const double nothing = std::numeric_limits<double>::quiet_NaN();
  if (!z.gels) return nothing;
  std::vector<double> gradient;
  const bool shared_m = r.model == FitModel::joint && !r.find("m_uv");
  for (const Parameter& p : r.parameters) {
    if (p.fixed) continue;
    const Slot slot = slot_of(r, p.name);
    double by = z.by[slot];
    if (shared_m && slot == kExponent) by += z.by[kUvExponent];
    gradient.push_back(by);
  }
  const std::size_t width = gradient.size();
  double variance = 0;
  for (std::size_t i = 0; i < width; ++i) {
    for (std::size_t j = 0; j < width; ++j) {
      const double c = r.covariance[i * width + j];
      if (gradient[i] != 0 && gradient[j] != 0) variance += gradient[i] * c * gradient[j];
    }
  }
  const int freedom = r.n - r.free_parameters;
  if (freedom <= 0 || !(variance >= 0)) return nothing;
  return student_t_quantile(0.975, freedom) * std::sqrt(variance);
}

std::string FitResult::to_json() const {
  Json j;
  j["model"] = std::string(name_of(model));
  Json& all = j["parameters"] = Json::object();
  Json free = Json::array();
  for (const Parameter& p : parameters) {
    Json& q = all[p.name];
    q["value"] = finite_or_null(p.value);
    q["stderr"] = finite_or_null(p.stderr_);
    q["ci95"] = interval(p.ci95);
    if (p.bootstrap95) q["bootstrap95"] = interval(*p.bootstrap95);
    q["unit"] = p.unit;
    q["fixed"] = p.fixed;
    q["at_bound"] = p.at_bound;
    if (!p.fixed) free.push_back(p.name);
  }
  j["r2"] = finite_or_null(r2);
  j["rmse_um"] = finite_or_null(rmse_um);
  j["sigma_um"] = finite_or_null(sigma_um);
  j["n"] = n;
  j["free_parameters"] = free_parameters;
  if (cured.n > 0) j["cured_heights"] = kind_json(cured);
  if (dead_zones.n > 0) j["dead_zones"] = kind_json(dead_zones);
  if (kind_of(model).dead_zones) {
    j["blue_law"] = {{"hb_um", finite_or_null(hb_um)},
                     {"critical_dose_prime", finite_or_null(critical_dose_prime)},
                     {"m", finite_or_null(m)}};
  }
  Json& apart = j["outliers"] = Json::array();
  for (const Outlier& o : outliers) {
    apart.push_back(outlier_json(*this, o));
  }
  j["warnings"] = warnings;
  if (reciprocity) {
    const Reciprocity& r = *reciprocity;
    j["reciprocity"] = {{"holds", r.holds},
                        {"m", finite_or_null(r.m)},
                        {"m_ci95", interval(r.m_ci95)},
                        {"f", finite_or_null(r.f)},
                        {"p_value", finite_or_null(r.p_value)},
                        {"aicc_jacobs", finite_or_null(r.aic_jacobs)},
                        {"aicc_kinetic", finite_or_null(r.aic_kinetic)},
                        {"verdict", r.verdict}};
  }
  if (left_out) j["left_out"] = left_out_json(*left_out);
  Json rows = square_json(covariance, free.size());
  j["covariance"] = {{"names", std::move(free)}, {"matrix", std::move(rows)}};
  j["sources"] = sources;
  if (points.size() <= kMostPointsInJson) {
    Json& list = j["points"] = Json::array();
    for (const FitPoint& p : points) list.push_back(point_json(p));
  }
  return j.dump(2, ' ', false, Json::error_handler_t::replace);
}

std::string FitResult::to_text() const {
  std::string files;
  for (const std::string& s : sources) files += (files.empty() ? "" : ", ") + s;
  std::string text = fmt::format("{} fit of {} measurements from {}\n", name_of(model), n, files);
  for (const Parameter& p : parameters) {
    std::string line = fmt::format("  {:<20} {:>10}", p.name, figure(p.value, p.stderr_));
    line += p.unit.empty() ? "" : " " + p.unit;
    if (p.fixed) {
      line += "  (held)";
    } else if (p.at_bound) {
      line += "  (at its bound)";
    } else {
      line += fmt::format("  95 %: {} to {}, standard error {:.2g}", figure(p.ci95[0], p.stderr_),
                          figure(p.ci95[1], p.stderr_), p.stderr_);
    }
    if (p.bootstrap95) {
      line += fmt::format("; bootstrap {} to {}", figure((*p.bootstrap95)[0], p.stderr_),
                          figure((*p.bootstrap95)[1], p.stderr_));
    }
    text += line + "\n";
  }
  if (model == FitModel::dead_zone_steady || model == FitModel::dead_zone_transient) {
    text += fmt::format("  taken from the resin as exact: hb {} um", figure(hb_um));
    if (model == FitModel::dead_zone_transient) {
      text += fmt::format(", D'c {}", figure(critical_dose_prime));
    }
    text += "\n";
  }
  text += fmt::format("R² {}, RMSE {} um, scatter {} um\n", figure(r2), figure(rmse_um),
                      figure(sigma_um));
  if (model == FitModel::joint) {
    text += fmt::format(
        "  cured heights: {}, R² {:.4f}, RMSE {} um; dead zones: {}, R² {:.4f}, RMSE {} um\n",
        cured.n, cured.r2, figure(cured.rmse_um), dead_zones.n, dead_zones.r2,
        figure(dead_zones.rmse_um));
  }
  text += cured.n > 0
              ? "Heights are base e; the dose is that of gel, of which correction aims at a "
                "multiple.\n"
              : "Heights are base e.\n";
  if (reciprocity) text += reciprocity->verdict + "\n";
  if (left_out) text += left_out->verdict + "\n";
  for (const Outlier& o : outliers) text += "Outlier: " + o.reason + "\n";
  for (const std::string& w : warnings) text += "Warning: " + w + "\n";
  text.pop_back();
  return text;
}

}  // namespace slicecorr::resins
