// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file fit.hpp
/// Fits of cure models to measurements, with what can be said about their parameters.
///
/// Models (heights base e, doses areal; dissertation chapter III):
///
/// - jacobs: zc = h ln(D / Dc); parameters h_um, dc_mj_cm2.
/// - kinetic: zc = (h / m) ln(I^m t / D'c); h_um, m, critical_dose_prime.
/// - gel_time: zc = h ln(I / ig(t)), ig from A and B (gel_time.hpp); h_um, gel_a_mj_cm2,
///   gel_b_sqrt_mw_cm2_s.
/// - bleaching: zc is the length over which D falls to Dc as the resin bleaches (bleaching.hpp); h_um,
///   dc_mj_cm2, h_bleached_um, bleaching_dose_mj_cm2.
/// - dead_zone_steady: zf = ln(beta Iuv / Ib) / (1/huv - 1/hb); beta, huv_um.
/// - dead_zone_transient: the front, root of (Ib e^(-z/hb) - beta Iuv e^(-z/huv))^m t = D'c;
///   beta, huv_um, m.
/// - joint: kinetic and transient together, weighed by the scatter of each kind; h_um, m,
///   critical_dose_prime, beta, huv_um, and m_uv.
///
/// Residuals are measured minus predicted height. Least squares with Ceres; analytic derivatives,
/// that of the front by the implicit function theorem.
///
/// Plain values; all functions are thread-safe. Errors are `InputError`, and `Cancelled` where a
/// `context` is cancelled.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/resins/measurements.hpp"

namespace slicecorr::resins {

enum class FitModel {
  jacobs,
  kinetic,
  gel_time,
  bleaching,
  dead_zone_steady,
  dead_zone_transient,
  joint
};
/// What is known of each, in the order of `FitModel`.
struct FitModelKind {
  const char* name;
  const char* title;  ///< for people: "Jacobs fit"
  bool heights;       ///< fitted to cured heights
  bool dead_zones;
  bool by_dose;  ///< of cured heights the dose is enough: intensity and time do not count apart
};
std::span<const FitModelKind> fit_model_kinds();
const FitModelKind& kind_of(FitModel model);
/// Their names.
std::vector<std::string> fit_model_names();
std::string_view name_of(FitModel model);
/// Throws `InputError` when no model has this name.
FitModel fit_model_named(const std::string& name);

enum class Loss { none, soft_l1, cauchy };
enum class Weights { none, scatter };

struct Bounds {
  double low = 0, high = 0;  ///< in the parameter's unit, low < high
};

struct FitOptions {
  Loss loss = Loss::none;
  /// Scale of a robust loss in um; 0: from the median absolute residual of a first fit.
  double loss_scale_um = 0;
  /// scatter: residuals divided by the `sigma_um` column, or by the scatter of replicates: that of
  /// groups of three or more is drawn to that of all groups by as much as they differ no more than
  /// by chance (Smyth 2004); smaller groups get that of all.
  Weights weights = Weights::none;
  std::map<std::string, double> fixed;   ///< parameters held at a value, > 0
  std::map<std::string, Bounds> bounds;  ///< over the defaults, by name of parameter, > 0
  /// Starting points, >= 1; the best result counts. One is enough, and taken, where the problem
  /// has a single minimum (jacobs, kinetic, dead_zone_steady without loss and bounds).
  int starts = 8;
  int bootstrap = 0;  ///< resamplings for `Parameter::bootstrap95`; 0: none
  std::uint64_t seed = 1;
  double tolerance = 1e-12;  ///< of Ceres' function, gradient and parameters
  /// Blue law that dead zones stand on: base e height and D'c. Needed by dead_zone_*; m is that of
  /// the cure and the start value of the transient fit.
  double hb_um = 0, critical_dose_prime = 0, m = 1;
  /// Joint fits: whether the exponent under UV is a parameter of its own (`m_uv`).
  bool separate_m = true;
};

struct Parameter {
  std::string name;    ///< contract's name
  std::string unit;    ///< for people: "um", "mJ/cm²", ""
  double value = 0;    ///< in `unit`, as the next ones
  double stderr_ = 0;  ///< from the covariance; NaN when it can't be known
  /// value -+ t(0.975, n - p) stderr, in log for scale parameters (all but exponents); of
  /// dead_zone_transient and joint without robust loss from the likelihood profile, so asymmetric.
  std::array<double, 2> ci95{};
  std::optional<std::array<double, 2>> bootstrap95;  ///< percentiles of resampled fits
  /// Held at a value: asked for, or because the measurements can't tell it (with a warning).
  bool fixed = false;
  bool at_bound = false;     ///< it ended there, so neither stderr nor interval is known
  bool bound_given = false;  ///< its bounds were asked for
};

/// One measurement beside the fit.
struct FitPoint {
  bool is_dead_zone = false;
  double blue_mw_cm2 = 0, uv_mw_cm2 = 0, exposure_s = 0, dose_mj_cm2 = 0;
  double measured_um = 0;
  double predicted_um = 0;  ///< as `predict_um`
  /// 1 / sigma of the residual, relative: mean square 1. 0: left out of the fit (a dead zone of 0).
  double weight = 1;
  double leverage = 0;        ///< diagonal of the hat matrix, 0..1
  double studentised = 0;     ///< externally studentised residual
  double cooks_distance = 0;  ///< >= 0
  Origin origin;
};

struct Outlier {
  std::size_t point = 0;  ///< index into `FitResult::points`
  std::string reason;     ///< with file, line and figures, in words
};

/// Jacobs against kinetic on the same data.
struct Reciprocity {
  double f = 0, p_value = 1;               ///< F test of the extra parameter m
  double aic_jacobs = 0, aic_kinetic = 0;  ///< corrected for small samples (AICc); NaN below n = 6
  double m = 1;
  std::array<double, 2> m_ci95{};
  bool holds = true;
  std::string verdict;  ///< one or two sentences
};

/// One law at settings (or files) that it was not fitted to.
struct LeftOutLaw {
  FitModel model = FitModel::jacobs;
  int parameters = 0;           ///< that were fitted
  double left_out_rmse_um = 0;  ///< of heights at settings left out, one setting at a time
  double left_out_bias_um = 0;  ///< predicted minus measured, mean of these
  /// The same, one file at a time: what another print adds. Nothing where all is from one file.
  std::optional<double> other_files_rmse_um;
};
/// Laws of cured heights compared by what they predict.
struct LeftOut {
  std::size_t settings = 0;               ///< different exposures
  std::vector<LeftOutLaw> laws;           ///< one or more
  std::vector<std::string> not_compared;  ///< "law: why"
  /// That with the fewest parameters of which the mean square is above the least one by no more than
  /// the standard error of the least one (Hastie, Tibshirani, Friedman, The Elements of Statistical
  /// Learning, 7.10).
  FitModel trust = FitModel::jacobs;
  std::string verdict;  ///< one or two sentences
};

/// How well one kind of measurement is met.
struct KindFit {
  int n = 0;
  double squares = 0, total = 0;  ///< SSres, and SStot about the mean of the kind, um²
  double r2 = 0, rmse_um = 0;     ///< 1 - SSres / SStot; sqrt(SSres / n)
  double sigma_um = 0;            ///< sqrt(SSres / (n - summed leverage))
};

struct FitResult {
  FitModel model = FitModel::jacobs;
  std::vector<Parameter> parameters;
  /// Of the free parameters, in the order of `parameters`, row by row.
  std::vector<double> covariance;
  /// 1 - SSres / SStot, heights about their mean, unweighted (joint: each kind about its own).
  double r2 = 0;
  double rmse_um = 0;              ///< sqrt(SSres / n)
  double sigma_um = 0;             ///< sqrt(SSres / (n - p)): what the fit says of the scatter
  int n = 0, free_parameters = 0;  ///< measurements fitted; parameters that were not held
  KindFit cured, dead_zones;
  std::vector<FitPoint> points;
  std::vector<Outlier> outliers;
  std::vector<std::string> warnings;
  std::optional<Reciprocity> reciprocity;
  /// Parameters that a dead-zone fit took from the resin, and fixed ones.
  double hb_um = 0, critical_dose_prime = 0, m = 1;
  std::vector<std::string> sources;
  int iterations = 0;
  double seconds = 0;
  std::optional<LeftOut> left_out;  ///< as `compare_left_out`, where somebody asked for it

  const Parameter* find(std::string_view name) const;
  /// Value of a parameter; throws `InputError` when the model does not have it.
  double value(std::string_view name) const;
  /// Keys of the contract and more (covariance, points, reciprocity).
  std::string to_json() const;
  /// The result as a text for people.
  std::string to_text() const;
};

/// Fits; throws `InputError` when the data can't be fitted at all (too few points, wrong kind) and
/// says what is missing; what can be fitted but not trusted has a warning. Deterministic for a
/// seed, whatever the number of threads.
FitResult fit(const Measurements& data, FitModel model, const FitOptions& options = {},
              const ExecutionContext& context = {});

/// Fits all laws of cured heights to all settings but one, and looks how well they predict that one, for
/// each setting. Of more than 60 settings several are left out at a time, always the same ones. Nothing
/// where there are less than four settings or more than 20,000 heights, and where parameters are held or
/// bounded. Options as of `fit`.
std::optional<LeftOut> compare_left_out(const Measurements& data, const FitOptions& options = {},
                                        const ExecutionContext& context = {});

/// Height that a fit predicts, um: of cured resin where `uv` is 0 (below 0 when nothing gels), of
/// the dead zone else (0 when it has closed; the place of the first gel while nothing has gelled).
double predict_um(const FitResult& result, double blue_mw_cm2, double uv_mw_cm2, double exposure_s);
/// Half-width of the 95 % confidence band of that prediction, by the delta method. NaN while
/// nothing has gelled, and where the fit has no covariance.
double confidence_um(const FitResult& result, double blue_mw_cm2, double uv_mw_cm2,
                     double exposure_s);

}  // namespace slicecorr::resins
