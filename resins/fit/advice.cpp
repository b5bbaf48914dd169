// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/advice.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/statistics.hpp"
#include "slicecorr/resins/repeated_rows.hpp"

namespace slicecorr::resins {

namespace {

/// Least and greatest of a quantity of the observations of one kind.
struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  int different = 0, count = 0;
  double factor() const { return std::exp(high - low); }
};

template <typename Of>
Range range_of(const PreparedFit& prepared, bool dead_zones, Of&& of) {
  Range range;
  std::vector<double> values;
  for (const Observation& o : prepared.problem.observations) {
    if (o.is_dead_zone == dead_zones) values.push_back(of(o.exposure));
  }
  range.count = static_cast<int>(values.size());
  for (const double v : values) {
    range.low = std::min(range.low, v);
    range.high = std::max(range.high, v);
  }
  range.different = count_different(std::move(values));
  return range;
}

Range blue_of(const PreparedFit& s, bool dead_zones) {
  return range_of(s, dead_zones, [](const Exposure& e) { return e.ln_blue; });
}
Range time_of(const PreparedFit& s, bool dead_zones) {
  return range_of(s, dead_zones, [](const Exposure& e) { return e.ln_time; });
}
Range dose_of(const PreparedFit& s) {
  return range_of(s, false, [](const Exposure& e) { return e.ln_blue + e.ln_time; });
}
Range ratio_of(const PreparedFit& s) {
  return range_of(s, true, [](const Exposure& e) { return e.ln_uv - e.ln_blue; });
}

bool is_free(const PreparedFit& s, Slot slot) {
  return std::any_of(s.problem.unknowns.begin(), s.problem.unknowns.end(), [&](const Unknown& u) {
    return std::find(u.slots.begin(), u.slots.end(), slot) != u.slots.end();
  });
}

/// "heights.csv: lines 7, 9 and 3 more".
std::string lines_of(const FitResult& result, const std::vector<std::size_t>& points) {
  constexpr std::size_t most = 5;
  std::string text;
  int source = -1;
  for (std::size_t i = 0; i < std::min(points.size(), most); ++i) {
    const Origin& origin = result.points[points[i]].origin;
    if (origin.source == source) {
      text += fmt::format(", {}", origin.line);
    } else {
      text += (i ? "; " : "") + place_of(origin, result.sources);
      source = origin.source;
    }
  }
  if (points.size() > most) text += fmt::format(" and {} more", points.size() - most);
  return text;
}

void advise_intervals(const PreparedFit& s, const FitResult& result,
                      std::vector<std::string>& out) {
  for (const Parameter& p : result.parameters) {
    if (p.at_bound) {
      std::string text = fmt::format(
          "{} ended at its bound {:.4g}: the measurements ask for a value beyond it, or say too "
          "little about it",
          p.name, p.value);
      const bool exponent = p.name == "m" || p.name == "m_uv";
      out.push_back(text + (exponent ? "; " + why_unknown(s, p.name) : "; --bound widens it"));
      continue;
    }
    const double width = p.ci95[1] - p.ci95[0];
    if (p.fixed || !std::isfinite(width)) continue;
    const bool exponent = p.name == "m" || p.name == "m_uv";
    if (exponent ? width > 0.5 : p.ci95[1] > 3 * p.ci95[0]) {
      out.push_back(
          fmt::format("{} is known badly: {:.4g}, but anything from {:.4g} to {:.4g} fits (95 %); "
                      "{}",
                      p.name, p.value, p.ci95[0], p.ci95[1], why_unknown(s, p.name)));
    }
  }
}

void advise_cured(const PreparedFit& s, const FitResult& result, const Diagnosis& d,
                  std::vector<std::string>& out) {
  const Range dose = dose_of(s);
  if (dose.count == 0) return;
  if (is_free(s, kHeight) && dose.factor() < 2) {
    out.push_back(
        fmt::format("the doses differ by a factor of {:.3g} only ({:.4g} to {:.4g} mJ/cm2): the "
                    "slope of the working curve rests on a short piece of it; measure over a "
                    "factor of 8 or more",
                    dose.factor(), std::exp(dose.low), std::exp(dose.high)));
  }
  double lowest = std::numeric_limits<double>::infinity();
  for (const FitPoint& p : result.points) {
    if (!p.is_dead_zone) lowest = std::min(lowest, p.predicted_um);
  }
  const double h = d.law[kHeight];
  if (is_free(s, kDose) && lowest > 1.6 * h) {
    out.push_back(fmt::format(
        "all {} cured heights lie far above gel, the lowest at {:.4g} um, {:.3g} times the dose of "
        "gel: the gel dose is extrapolated; measure at doses down to 1.5 times it, about {:.4g} "
        "mJ/cm2",
        dose.count, lowest, std::exp(lowest / h), 1.5 * std::exp(dose.low - lowest / h)));
  }
  std::vector<std::size_t> below;
  for (std::size_t i = 0; i < result.points.size(); ++i) {
    const FitPoint& p = result.points[i];
    if (!p.is_dead_zone && p.predicted_um <= 0) below.push_back(i);
  }
  if (!below.empty()) {
    out.push_back(
        fmt::format("by the fit {} sample(s) should not have gelled at all ({}); look at them, or "
                    "at the low end of the curve",
                    below.size(), lines_of(result, below)));
  }
}

void advise_dead_zones(const PreparedFit& s, const FitResult& result, const Diagnosis& d,
                       std::vector<std::string>& out) {
  std::vector<std::size_t> liquid, closed, early, contradicted;
  double worst_early = 0, farthest = 0;
  const double sigma = result.dead_zones.sigma_um;
  const bool knows_time = d.law[kDose] > 0 && d.law[kUvHeight] < d.law[kHeight];
  for (std::size_t i = 0; i < result.points.size(); ++i) {
    const FitPoint& p = result.points[i];
    if (!p.is_dead_zone) continue;
    const Exposure e{std::log(p.blue_mw_cm2), std::log(p.uv_mw_cm2), std::log(p.exposure_s)};
    if (p.weight == 0) {
      if (p.predicted_um > 2 * sigma) contradicted.push_back(i);
      continue;
    }
    if (!knows_time) continue;
    const double steady = std::max(0.0, steady_height(d.law, e).um);
    const Height front = front_height(d.law, e);
    if (s.problem.is_steady) {
      if (steady <= 0) closed.push_back(i);
      const double excess = front.um - steady;
      if (!front.gels || excess > std::max(sigma, 0.05 * steady)) {
        early.push_back(i);
        if (front.gels) worst_early = std::max(worst_early, excess);
      }
    } else {
      if (!front.gels) liquid.push_back(i);
      if (front.gels && front.um <= 0) closed.push_back(i);
      farthest = std::max(farthest, front.um - steady);
    }
  }
  if (!liquid.empty()) {
    out.push_back(
        fmt::format("by the fit nothing had gelled yet at {} measured dead zone(s) ({}); these "
                    "pull at the fit without being described by it: check D'c of the resin and the "
                    "exposure times",
                    liquid.size(), lines_of(result, liquid)));
  }
  if (!closed.empty()) {
    out.push_back(
        fmt::format("by the fit {} measured dead zone(s) had closed ({}); the fit goes on past the "
                    "window for them and is doubtful there: measure at a higher ratio of UV to "
                    "blue",
                    closed.size(), lines_of(result, closed)));
  }
  if (!early.empty()) {
    out.push_back(
        fmt::format("{} dead zone(s) were measured before they were steady, by up to {:.4g} um "
                    "({}): beta and huv_um come out wrong; fit with deadzone-transient, or expose "
                    "longer",
                    early.size(), worst_early, lines_of(result, early)));
  }
  if (!contradicted.empty()) {
    out.push_back(
        fmt::format("the fit predicts an open dead zone where {} sample(s) had cured to the window "
                    "({}): model and measurements contradict each other there",
                    contradicted.size(), lines_of(result, contradicted)));
  }
  const Range ratio = ratio_of(s);
  if (ratio.count > 0 && is_free(s, kUvHeight) && ratio.factor() < 2) {
    out.push_back(
        fmt::format("the ratios of UV to blue differ by a factor of {:.3g} only; measure over a "
                    "factor of 4 or more",
                    ratio.factor()));
  }
  if (!s.problem.is_steady && is_free(s, kUvExponent) && liquid.empty() && farthest < sigma) {
    out.push_back(
        fmt::format("all {} dead zones lie within {:.4g} um of the steady ones, less than their "
                    "scatter of {:.4g} um: the exponent under UV light can't be known from them; "
                    "measure at shorter exposures",
                    ratio.count, farthest, sigma));
  }
}

void advise_repeats(const FitResult& result, std::vector<std::string>& out) {
  std::vector<std::vector<double>> rows;
  for (const FitPoint& p : result.points) {
    rows.push_back({p.blue_mw_cm2, p.uv_mw_cm2, p.exposure_s, p.dose_mj_cm2, p.measured_um});
  }
  if (std::string words = repeats_in_words(std::move(rows)); !words.empty()) {
    out.push_back(std::move(words));
  }
}

/// The dose of gel, in mJ/cm² at the intensities measured, and where resins have theirs: those of
/// the database from 2 to 240. A slip of units is a factor of 1000 or 60.
constexpr double kLeastGelDose = 0.05, kGreatestGelDose = 2000;

void advise_units(const PreparedFit& s, const Diagnosis& d, std::vector<std::string>& out) {
  const Range blue = blue_of(s, false);
  if (blue.count == 0 || !is_free(s, kDose)) return;
  // I^m t = D'c at the middle intensity; without intensities m is 1.
  const double middle = 0.5 * (blue.low + blue.high);
  const double dose = d.law[kDose] * std::exp((1 - d.law[kExponent]) * middle);
  if (dose > kGreatestGelDose) {
    out.push_back(
        fmt::format("the dose of gel comes out at {:.0f} mJ/cm2; resins gel at some 1 to 500: are "
                    "the exposures in ms, or the intensities in uW/cm2?",
                    dose));
  } else if (dose < kLeastGelDose) {
    out.push_back(
        fmt::format("the dose of gel comes out at {:.3g} mJ/cm2; resins gel at some 1 to 500: are "
                    "the exposures in minutes, or the intensities in W/cm2?",
                    dose));
  }
}

/// Beside this what is left of heights is rounding alone: weighted, of one measurement.
double rounding_of(const std::vector<Observation>& all) {
  double scale = 0;
  for (const Observation& o : all) scale = std::max(scale, std::abs(o.weight * o.measured_um));
  return 1e-9 * scale;
}

/// Scatter that readings have at the least, weighted as that of the least weight: who reads to full
/// 10 um is off by up to 5. Heights that lie on a law by chance would else make outliers of others.
double reading_scatter(const std::vector<Observation>& all) {
  double step_um = 0, least_weight = std::numeric_limits<double>::infinity();
  for (const double tried_um : {1e-3, 1e-2, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0}) {
    const bool full = std::ranges::all_of(all, [&](const Observation& o) {
      const double steps = o.measured_um / tried_um;
      return std::abs(steps - std::round(steps)) < 1e-6;
    });
    if (full) step_um = tried_um;
  }
  for (const Observation& o : all) least_weight = std::min(least_weight, o.weight);
  // The standard deviation of what is even over a step.
  return std::max(rounding_of(all), step_um * least_weight / std::sqrt(12.0));
}

/// Lack of fit against the scatter of replicates.
void advise_replicates(const PreparedFit& s, const Diagnosis& d, std::vector<std::string>& out) {
  if (s.problem.loss != Loss::none || d.freedom <= 0) return;
  double pure = 0;
  const auto& all = s.problem.observations;
  const Groups groups = replicate_groups(all);
  for (std::size_t g = 0; g < groups.count(); ++g) {
    const auto group = groups[g];
    double mean = 0;
    for (const std::size_t i : group)
      mean += all[i].measured_um / static_cast<double>(group.size());
    for (const std::size_t i : group) {
      pure += std::pow(all[i].weight * (all[i].measured_um - mean), 2);
    }
  }
  const double pure_freedom = static_cast<double>(all.size() - groups.count());
  const double lack_freedom = d.freedom - pure_freedom;
  const double lack = d.residual.squaredNorm() - pure;
  // Replicates that agree to the last digit were computed or copied: they tell no scatter.
  const double nothing = std::pow(rounding_of(all), 2);
  if (!(pure_freedom > 0) || !(lack_freedom > 0) || !(pure > nothing * pure_freedom) ||
      !(lack > 0)) {
    return;
  }
  const double f = lack / lack_freedom / (pure / pure_freedom);
  const double p = f_exceedance(f, lack_freedom, pure_freedom);
  if (p < 0.01) {
    out.push_back(
        fmt::format("the curve misses the means of replicates by more than their scatter explains "
                    "(lack of fit F = {:.3g}, p = {:.2g}): the model is not the whole story, or "
                    "samples that were made together share an error; intervals are too narrow",
                    f, p));
  }
}

}  // namespace

std::string why_unknown(const PreparedFit& prepared, const std::string& name) {
  const bool of_uv = name == "beta" || name == "huv_um" || name == "m_uv" ||
                     prepared.model == FitModel::dead_zone_transient;
  if (!of_uv) {
    const Range blue = blue_of(prepared, false), time = time_of(prepared, false);
    if (name == "m" && blue.different == 1) {
      return fmt::format(
          "all {} measurements have one intensity ({:.4g} mW/cm2); measure at two or more "
          "intensities that differ by at least a factor of 4",
          blue.count, std::exp(blue.low));
    }
    if (name == "m" && time.different == 1) {
      return fmt::format(
          "all {} measurements have one exposure time ({:.4g} s); measure each intensity at "
          "several times",
          time.count, std::exp(time.low));
    }
    // Logarithms and back: 10 to 40 are a factor of 4.
    if (name == "m" && blue.factor() < 4 * (1 - 1e-9)) {
      return fmt::format(
          "the intensities differ by a factor of {:.3g} only ({:.4g} to {:.4g} mW/cm2); measure at "
          "intensities that differ by at least a factor of 4",
          blue.factor(), std::exp(blue.low), std::exp(blue.high));
    }
    if (name == "m") {
      return "intensity and exposure time vary together; expose each intensity to several doses, "
             "the same ones for all, and more often";
    }
    const Range dose = dose_of(prepared);
    return fmt::format(
        "measure over a wider range of doses (now a factor of {:.3g}), and more often (now {})",
        dose.factor(), dose.count);
  }
  const Range ratio = ratio_of(prepared);
  if (name == "m" || name == "m_uv") {
    const Range time = time_of(prepared, true);
    const double dose = std::log(prepared.start[kDose]);
    if (time.different == 1 && std::abs(time.low - dose) < 0.1) {
      return fmt::format(
          "all exposures last {:.4g} s, about D'c, where the exponent cancels out; measure at "
          "other times, shorter ones above all",
          std::exp(time.low));
    }
    return "it shows only before the dead zone is steady; measure at shorter exposures, at several "
           "times and with several blue intensities";
  }
  return fmt::format(
      "measure over a wider range of ratios of UV to blue (now a factor of {:.3g}), and more often "
      "(now {})",
      ratio.factor(), ratio.count);
}

std::vector<std::string> advise(const PreparedFit& prepared, const FitResult& result,
                                const Diagnosis& d) {
  std::vector<std::string> out;
  advise_intervals(prepared, result, out);
  advise_repeats(result, out);
  advise_units(prepared, d, out);
  advise_cured(prepared, result, d, out);
  advise_dead_zones(prepared, result, d, out);
  advise_replicates(prepared, d, out);
  if (d.freedom <= 0) {
    out.push_back(
        fmt::format("there are as many free parameters as measurements ({}): nothing is left to "
                    "tell the scatter, so there are no intervals; measure more",
                    result.n));
  }
  return out;
}

namespace {

/// Fits without some of the observations, to first order: how far the others then lie off, over
/// what may be expected of them.
class WithoutSome {
 public:
  /// `reading` is the scatter that readings have at the least.
  WithoutSome(const Diagnosis& d, const std::vector<bool>& left_out, double reading)
      : d_(d), left_out_(left_out), reading_(reading) {
    const Eigen::Index n = d.residual.size(), p = d.jacobian.cols();
    Eigen::VectorXd right = Eigen::VectorXd::Zero(p);
    inverse_ = d.unscaled;
    residual_ = d.residual;
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto row = d.jacobian.row(i);
      if (!left_out[static_cast<std::size_t>(i)]) {
        ++count_;
        if (p > 0) right += row.transpose() * d.residual(i);
        continue;
      }
      if (p == 0) continue;
      // Sherman and Morrison: the inverse without this row.
      const Eigen::VectorXd v = inverse_ * row.transpose();
      const double rest = 1 - row.dot(v);
      if (rest > 1e-9) inverse_ += v * v.transpose() / rest;
    }
    if (p > 0) residual_ -= d.jacobian * (inverse_ * right);
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!left_out[static_cast<std::size_t>(i)]) squares_ += residual_(i) * residual_(i);
    }
  }
  int count() const { return count_; }
  /// Of the scatter that is left when an observation is left out, too.
  double freedom() const { return count_ - 1.0 - static_cast<double>(d_.jacobian.cols()); }
  /// Externally studentised.
  double studentised(std::size_t observation) const {
    const auto i = static_cast<Eigen::Index>(observation);
    const double r = residual_(i);
    const auto row = d_.jacobian.row(i);
    const double leverage = row.size() > 0 ? row.dot(inverse_ * row.transpose()) : 0;
    const bool inside = !left_out_[observation];
    const double rest = inside ? 1 - leverage : 1 + leverage;
    if (!(rest > 1e-12)) return 0;
    const double others =
        inside ? std::max(0.0, squares_ - r * r / rest) / freedom() : squares_ / (freedom() + 1);
    return r / std::sqrt(std::max(others, reading_ * reading_) * rest);
  }

 private:
  const Diagnosis& d_;
  const std::vector<bool>& left_out_;
  double reading_;
  Eigen::MatrixXd inverse_;
  Eigen::VectorXd residual_;
  double squares_ = 0;
  int count_ = 0;
};

/// Bonferroni's 5 % limit of a studentised residual.
double outlier_limit(double count, double freedom) {
  return student_t_quantile(1 - 0.05 / (2 * count), freedom);
}

/// Outliers that hide each other: the worst is left out, then the worst of the others, and so on;
/// all up to the last that was beyond its limit are outliers (Rosner, Technometrics 25, 1983).
std::vector<bool> hidden_outliers(const Diagnosis& d, double reading) {
  const auto n = static_cast<std::size_t>(d.residual.size());
  std::vector<bool> left_out(n, false), found = left_out;
  const std::size_t most = std::min<std::size_t>(10, n / 5);
  for (std::size_t round = 0, since = 0; round < most && since < 2; ++round, ++since) {
    const WithoutSome fit(d, left_out, reading);
    if (fit.freedom() < 2) break;
    std::size_t worst = n;
    double farthest = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const double off = left_out[i] ? 0 : std::abs(fit.studentised(i));
      if (off > farthest) {
        farthest = off;
        worst = i;
      }
    }
    if (worst == n) break;
    left_out[worst] = true;
    if (farthest > outlier_limit(fit.count(), fit.freedom())) {
      found = left_out;
      since = static_cast<std::size_t>(-1);
    }
  }
  return found;
}

/// Where a measurement is a thousandth of what is expected, or a thousand times that.
const char* unit_slip(const FitPoint& point) {
  const double ratio = point.measured_um / point.predicted_um;
  const auto about = [&](double factor) { return ratio > factor / 2.5 && ratio < factor * 2.5; };
  return about(1e-3) ? "; is it in mm?" : about(1e3) ? "; is it in nm?" : "";
}

}  // namespace

void find_outliers(const PreparedFit& prepared, const Diagnosis& d, FitResult& result) {
  const auto& all = prepared.problem.observations;
  const double n = static_cast<double>(all.size());
  const double p = static_cast<double>(d.active.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    result.points[prepared.point_of[i]].leverage = d.leverage(static_cast<Eigen::Index>(i));
  }
  for (std::size_t i = 0; i < all.size() && p > 0 && n > p; ++i) {
    // More than 0.99: its neighbours say next to nothing about it.
    const FitPoint& point = result.points[prepared.point_of[i]];
    if (point.leverage < 0.99) continue;
    result.warnings.push_back(fmt::format(
        "{} alone decides a parameter (leverage {:.3f}): an error in it can't be seen; repeat it",
        place_of(point.origin, result.sources), point.leverage));
  }
  if (d.freedom < 2 || d.singular) return;
  // Residuals that are rounding alone are no outliers.
  if (!(d.robust_variance > std::pow(rounding_of(all), 2))) return;

  // With a robust loss the scatter does not know of outliers anyway.
  const bool plain = prepared.problem.loss == Loss::none;
  const double reading = reading_scatter(all);
  const std::vector<bool> hidden =
      plain && p > 0 ? hidden_outliers(d, reading) : std::vector<bool>(all.size(), false);
  const WithoutSome clean(d, hidden, reading);
  const double limit = plain && clean.freedom() >= 1 ? outlier_limit(clean.count(), clean.freedom())
                                                     : outlier_limit(n, d.freedom - 1);
  std::size_t far_off = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    FitPoint& point = result.points[prepared.point_of[i]];
    const double rest = 1 - point.leverage;
    if (!(rest > 1e-12)) continue;
    const double r = d.residual(k);
    point.studentised = plain ? clean.studentised(i) : r / std::sqrt(d.robust_variance * rest);
    if (p > 0) {
      point.cooks_distance = r * r * point.leverage / (p * d.robust_variance * rest * rest);
    }
    const std::string place = place_of(point.origin, result.sources);
    if (hidden[i] || std::abs(point.studentised) > limit) {
      ++far_off;
      result.outliers.push_back(
          {prepared.point_of[i],
           fmt::format("{}: measured {:.4g} um, {:.4g} um expected: {:.1f} times "
                       "the scatter of the others (limit {:.1f}){}",
                       place, point.measured_um, point.predicted_um, std::abs(point.studentised),
                       limit, unit_slip(point))});
    } else if (point.leverage > 0.5 && point.cooks_distance > 4 / n &&
               std::abs(point.studentised) > 2) {
      // More than half of what is predicted there is its own measurement.
      result.outliers.push_back(
          {prepared.point_of[i],
           fmt::format("{}: measured {:.4g} um, {:.4g} um expected; it stands apart "
                       "from the others (leverage {:.2f}) and pulls the fit to it "
                       "(Cook's distance {:.2g}, limit {:.2g})",
                       place, point.measured_um, point.predicted_um, point.leverage,
                       point.cooks_distance, 4 / n)});
    }
  }
  if (plain && far_off > 0) {
    result.warnings.push_back(fmt::format(
        "{} far off and pull{} the whole fit: look at {}, leave out what was a mistake, or let a "
        "robust loss hold against {} (--loss soft-l1)",
        far_off == 1 ? "an outlier lies" : fmt::format("{} outliers lie", far_off),
        far_off == 1 ? "s" : "", far_off == 1 ? "it" : "them", far_off == 1 ? "it" : "them"));
  }
}

}  // namespace slicecorr::resins
