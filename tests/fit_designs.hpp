// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file fit_designs.hpp
/// Experiments as the dissertation made them (§3.2.3, 3.2.4), with its fitted parameters and a
/// scatter that gives its R²: what fits are tried on where the raw data were not published.
#pragma once

#include <atomic>
#include <cmath>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/resins/fit.hpp"

namespace slicecorr::test {

/// Measurements without scatter, and the scatter that belongs to them.
struct Design {
  std::string name;
  resins::FitModel model = resins::FitModel::jacobs;
  std::map<std::string, double> truth;  ///< by name of parameter
  resins::Measurements exact;
  double r2 = 0;  ///< as published; of a joint fit, which the cured heights rule, that of these
  double cured_sigma_um = 0, dead_zone_sigma_um = 0;
  resins::FitOptions options;
  unsigned first_seed = 0;
};

/// Scatter with which fits of p parameters have an R² on average:
/// SSres / SStot = sigma² (n - p) / (n variance + sigma² (n - 1)).
inline double sigma_for(const std::vector<double>& heights, double r2, int p) {
  const double n = static_cast<double>(heights.size());
  double mean = 0, variance = 0;
  for (const double z : heights) mean += z / n;
  for (const double z : heights) variance += (z - mean) * (z - mean) / n;
  return std::sqrt((1 - r2) * n * variance / (n - p - (1 - r2) * (n - 1)));
}

/// Full, half and quarter intensity; six doses from 1.6 to 9 times the gel dose at full intensity,
/// the same ones at every intensity; three of each.
inline void add_cured(Design& d, const Kinetics& k, double full_mw_cm2, double r2) {
  const double gel_dose = k.critical_dose_prime * std::pow(full_mw_cm2, 1 - k.m);
  d.r2 = r2;
  std::vector<double> heights;
  for (const double share : {1.0, 0.5, 0.25}) {
    for (const double dose : {1.6, 2.3, 3.2, 4.5, 6.4, 9.0}) {
      for (int repeat = 0; repeat < 3; ++repeat) {
        resins::CuredHeight c;
        c.blue_mw_cm2 = full_mw_cm2 * share;
        c.exposure_s = gel_dose * dose / c.blue_mw_cm2;
        c.dose_mj_cm2 = c.blue_mw_cm2 * c.exposure_s;
        c.height_um = cured_height_um(k, c.blue_mw_cm2, c.exposure_s);
        c.origin.line = static_cast<int>(d.exact.cured.size()) + 2;
        heights.push_back(c.height_um);
        d.exact.cured.push_back(c);
      }
    }
  }
  d.cured_sigma_um = sigma_for(heights, r2, d.model == resins::FitModel::jacobs ? 2 : 3);
}

/// Constant UV, blue in equal steps of its logarithm, one exposure time, three of each.
inline void add_dead_zones(Design& d, const Kinetics& k, double uv, double most_blue,
                           double least_blue, int levels, double exposure_s, double r2) {
  d.r2 = r2;
  std::vector<double> heights;
  for (int i = 0; i < levels; ++i) {
    const double blue = most_blue * std::pow(least_blue / most_blue, i / (levels - 1.0));
    resins::DeadZone z;
    z.blue_mw_cm2 = blue;
    z.uv_mw_cm2 = uv;
    z.exposure_s = exposure_s;
    z.dead_zone_um = d.model == resins::FitModel::dead_zone_steady
                         ? steady_dead_zone_um(k, blue, uv)
                         : curing_fronts(k, blue, uv, exposure_s).value().front_um;
    for (int repeat = 0; repeat < 3; ++repeat) {
      z.origin.line = static_cast<int>(d.exact.dead_zones.size()) + 2;
      heights.push_back(z.dead_zone_um);
      d.exact.dead_zones.push_back(z);
    }
  }
  d.dead_zone_sigma_um =
      sigma_for(heights, r2, d.model == resins::FitModel::dead_zone_steady ? 2 : 3);
}

inline Design begin_design(const std::string& name, resins::FitModel model,
                           std::map<std::string, double> truth) {
  Design d;
  d.name = name;
  d.model = model;
  d.truth = std::move(truth);
  return d;
}
inline Design jacobs_design(const std::string& resin, double dc, double h, double r2) {
  Design d = begin_design(resin, resins::FitModel::jacobs, {{"dc_mj_cm2", dc}, {"h_um", h}});
  add_cured(d, {h, 1, dc, 0, 0}, 20, r2);
  return d;
}
inline Design kinetic_design(const std::string& resin, double dose_prime, double h, double m,
                             double r2, double full_mw_cm2 = 20) {
  Design d = begin_design(resin, resins::FitModel::kinetic,
                          {{"critical_dose_prime", dose_prime}, {"h_um", h}, {"m", m}});
  add_cured(d, {h, m, dose_prime, 0, 0}, full_mw_cm2, r2);
  return d;
}
/// Custom Resin 1, figure 3.7b: ratios of UV to blue from 4 to 40, taken as steady.
inline Design steady_design() {
  Design d = begin_design("custom Resin 1", resins::FitModel::dead_zone_steady,
                          {{"beta", 0.73}, {"huv_um", 37.8}});
  d.options.hb_um = 408;
  add_dead_zones(d, {408, 0.99, 64, 0.73, 37.8}, 200, 50, 5, 12, 30, 0.902);
  return d;
}
/// Custom Resin 2, figure 3.7d: 15 s, before the dead zone is steady.
inline Design transient_design() {
  Design d = begin_design("custom Resin 2", resins::FitModel::dead_zone_transient,
                          {{"beta", 4.84}, {"huv_um", 100}, {"m", 1.29}});
  d.options.hb_um = 1631;
  d.options.critical_dose_prime = 238;
  d.options.m = 1.03;
  add_dead_zones(d, {1631, 1.29, 238, 4.84, 100}, 100, 200, 20, 12, 15, 0.980);
  return d;
}
inline Design joint_design() {
  Design d = begin_design("custom Resin 2", resins::FitModel::joint,
                          {{"h_um", 1631},
                           {"m", 1.03},
                           {"critical_dose_prime", 238},
                           {"beta", 4.84},
                           {"huv_um", 100},
                           {"m_uv", 1.29}});
  add_dead_zones(d, {1631, 1.29, 238, 4.84, 100}, 100, 200, 20, 12, 15, 0.980);
  add_cured(d, {1631, 1.03, 238, 0, 0}, 100, 0.958);
  return d;
}

/// All fits that the dissertation publishes, and a joint one.
inline std::vector<Design> published_designs() {
  std::vector<Design> all = {jacobs_design("MakerJuice yellow", 69, 170, 0.983),
                             jacobs_design("Formlabs clear", 223, 260, 0.992),
                             jacobs_design("PR57 black", 82, 92, 0.994),
                             kinetic_design("MakerJuice yellow", 67, 168, 0.99, 0.983),
                             kinetic_design("Formlabs clear", 148, 238, 0.91, 0.994),
                             kinetic_design("PR57 black", 117, 99, 1.07, 0.996),
                             kinetic_design("custom Resin 1", 64, 408, 0.99, 0.985, 100),
                             kinetic_design("custom Resin 2", 238, 1631, 1.03, 0.958, 100),
                             steady_design(),
                             transient_design(),
                             joint_design()};
  // Runs of one design must not be the runs of the next in other units.
  for (std::size_t i = 0; i < all.size(); ++i) all[i].first_seed = 1000 * static_cast<unsigned>(i);
  return all;
}

/// Normal numbers that are the same everywhere: the standard library's differ between versions.
class Normal {
 public:
  explicit Normal(unsigned seed) : random_(seed) {}
  double operator()() {
    const double u = (random_() + 0.5) / 4294967296.0, v = (random_() + 0.5) / 4294967296.0;
    return std::sqrt(-2 * std::log(u)) * std::cos(6.283185307179586 * v);
  }

 private:
  std::mt19937 random_;
};

inline resins::Measurements with_scatter(const Design& d, unsigned seed) {
  resins::Measurements m = d.exact;
  Normal normal(d.first_seed + seed);
  for (auto& c : m.cured) c.height_um += d.cured_sigma_um * normal();
  for (auto& z : m.dead_zones) z.dead_zone_um += d.dead_zone_sigma_um * normal();
  return m;
}

/// What seeded runs say of a parameter.
struct Seen {
  double share = 0;  ///< of runs in which its own 95 % interval held the truth
  double mean_value = 0, mean_stderr = 0;
  int without_interval = 0;  ///< held or at a bound: counts as missed
};
struct CoverageOf {
  std::map<std::string, Seen> parameters;
  double mean_r2 = 0;
};

inline CoverageOf measure_coverage(const Design& d, int runs,
                                   const ExecutionContext& context = {}) {
  std::vector<resins::FitResult> results(static_cast<std::size_t>(runs));
  parallel_for(context, "coverage", results.size(), [&](std::size_t i) {
    results[i] = resins::fit(with_scatter(d, static_cast<unsigned>(i) + 1), d.model, d.options);
  });
  CoverageOf c;
  for (const auto& r : results) {
    c.mean_r2 += r.r2 / runs;
    for (const auto& [name, value] : d.truth) {
      Seen& seen = c.parameters[name];
      const resins::Parameter* p = r.find(name);
      if (!p || !std::isfinite(p->stderr_)) {
        ++seen.without_interval;
        continue;
      }
      seen.share += p->ci95[0] <= value && value <= p->ci95[1] ? 1.0 / runs : 0;
      seen.mean_value += p->value;
      seen.mean_stderr += p->stderr_;
    }
  }
  for (auto& [name, seen] : c.parameters) {
    seen.mean_value /= runs - seen.without_interval;
    seen.mean_stderr /= runs - seen.without_interval;
  }
  return c;
}

}  // namespace slicecorr::test
