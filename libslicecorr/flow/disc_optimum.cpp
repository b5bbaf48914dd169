// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that makes the dead zone even.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"
#include "flow/disc_march.hpp"
#include "flow/least_squares.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kBoundPlaces = 50;
/// Places at which a polynomial is told: straight lines between them are within 1e-4 of it.
constexpr int kCurvePlaces = 201;
/// How much the coefficients of a light are pulled to their mean, against the mean square that is
/// made least: with both lights free the middle's are all but undetermined.
constexpr double kPull = 1e-6;
constexpr int kCoarseGaps = 24, kFineGaps = 16;
/// Where each gap takes many marches.
constexpr int kCoarseGapsInSteps = 12;

/// Row vector of what each coefficient adds at r: Bernstein's polynomials, or hats over even nodes.
VectorXd shapes_at(const DiscGoal& goal, bool patterned, double r) {
  if (!patterned) return VectorXd::Ones(1);
  if (goal.free_nodes > 0) {
    VectorXd hats = VectorXd::Zero(goal.free_nodes);
    const double place = r * (goal.free_nodes - 1);
    const int left = std::min(static_cast<int>(place), goal.free_nodes - 2);
    hats[left] = 1 - (place - left);
    hats[left + 1] = place - left;
    return hats;
  }
  // By de Casteljau's scheme turned round.
  VectorXd b = VectorXd::Zero(goal.degree + 1);
  b[0] = 1;
  for (int d = 1; d <= goal.degree; ++d) {
    for (int i = d; i > 0; --i) b[i] = (1 - r) * b[i] + r * b[i - 1];
    b[0] *= 1 - r;
  }
  return b;
}

double place_of(int i, int count) { return static_cast<double>(i) / (count - 1); }

/// Unknowns: coefficients of blue, then of UV, as shares of their caps.
class Problem {
 public:
  Problem(const FlowResin& resin, const DiscPrint& print, const DiscGoal& goal,
          const DiscGrid& grid)
      : resin_(resin),
        print_(print),
        goal_(goal),
        grid_(grid),
        blue_patterned_(goal.pattern == DiscPattern::blue || goal.pattern == DiscPattern::both),
        uv_patterned_(goal.pattern == DiscPattern::uv || goal.pattern == DiscPattern::both),
        blues_(shapes_at(goal, blue_patterned_, 0).size()),
        uvs_(shapes_at(goal, uv_patterned_, 0).size()) {
    bound_light();
  }

  struct Solution {
    double gap_um = 0;
    VectorXd x;
    double mean_square = 0;  ///< with the pull; what gaps are compared by
  };
  Solution solve(double gap_um, const VectorXd* start) const {
    const VectorXd weight = weights(gap_um);
    return disc::is_linear(resin_) ? solve_linear(gap_um, weight)
                                   : solve_in_steps(gap_um, weight, start);
  }

  DiscLight light_of(const VectorXd& x) const {
    DiscLight light;
    for (int i = 0; i < kCurvePlaces; ++i) {
      const double r = place_of(i, kCurvePlaces);
      const double blue = shapes_at(goal_, blue_patterned_, r).dot(x.head(blues_));
      const double uv = shapes_at(goal_, uv_patterned_, r).dot(x.tail(uvs_));
      light.blue_mw_cm2.r.push_back(r);
      light.blue_mw_cm2.value.push_back(goal_.blue_most_mw_cm2 * std::clamp(blue, 0.0, 1.0));
      light.uv_mw_cm2.r.push_back(r);
      light.uv_mw_cm2.value.push_back(goal_.uv_most_mw_cm2 * std::clamp(uv, 0.0, 1.0));
    }
    return light;
  }

  double mean_square(double gap_um, const RadialCurve& front) const {
    const VectorXd w = weights(gap_um);
    double sum = 0;
    for (Eigen::Index i = 0; i < w.size(); ++i) {
      const double off = front.value[static_cast<std::size_t>(i)] - 1;
      sum += w[i] * off * off;
    }
    return sum;
  }

 private:
  Eigen::Index unknowns() const { return blues_ + uvs_; }

  /// Of each place of the march in the mean, that with the least r first; together 1.
  VectorXd weights(double gap_um) const {
    const disc::Places p = disc::make_places(print_.shape, grid_);
    const std::size_t n = p.r.size();
    const double last = goal_.leave_out_edge ? 1 - gap_um / (1e3 * print_.radius_mm) : 1.0;
    const bool by_r = goal_.by_area && print_.shape == DiscShape::disc;
    VectorXd w = VectorXd::Zero(static_cast<Eigen::Index>(n));
    const auto between = [&](double from, double to, Eigen::Index inner, Eigen::Index outer,
                             double inner_r, double outer_r) {
      if (!(to > from)) return;
      // Gauss' two places: right for r times straight lines.
      for (const double side : {-1.0, 1.0}) {
        const double r = 0.5 * (from + to) + side * 0.5 * (to - from) / std::sqrt(3.0);
        const double weight = 0.5 * (to - from) * (by_r ? r : 1);
        const double part = outer_r > inner_r ? (r - inner_r) / (outer_r - inner_r) : 0;
        w[inner] += weight * (1 - part);
        w[outer] += weight * part;
      }
    };
    between(0, std::min(p.r.back(), last), 0, 0, 0, 0);
    for (std::size_t i = 1; i < n; ++i) {
      const double inner = p.r[n - i], outer = p.r[n - i - 1];
      between(inner, std::min(outer, last), static_cast<Eigen::Index>(i - 1),
              static_cast<Eigen::Index>(i), inner, outer);
    }
    return w / w.sum();
  }

  /// Lights within their caps at the places; without diffusion also Ib <= beta Iuv.
  void bound_light() {
    const bool limits_rate = disc::diffusion_um2_s(resin_) <= 0;
    const Eigen::Index each = limits_rate ? 5 : 4;
    light_rows_ = MatrixXd::Zero(each * kBoundPlaces, unknowns());
    light_most_ = VectorXd::Zero(each * kBoundPlaces);
    const double against = resin_.kinetics.beta * goal_.uv_most_mw_cm2 / goal_.blue_most_mw_cm2;
    for (int i = 0; i < kBoundPlaces; ++i) {
      const double r = place_of(i, kBoundPlaces);
      const VectorXd blue = shapes_at(goal_, blue_patterned_, r);
      const VectorXd uv = shapes_at(goal_, uv_patterned_, r);
      const Eigen::Index row = each * i;
      light_rows_.row(row).head(blues_) = blue;
      light_most_[row] = 1;
      light_rows_.row(row + 1).head(blues_) = -blue;
      light_rows_.row(row + 2).tail(uvs_) = uv;
      light_most_[row + 2] = 1;
      light_rows_.row(row + 3).tail(uvs_) = -uv;
      if (!limits_rate) continue;
      light_rows_.row(row + 4).head(blues_) = blue;
      light_rows_.row(row + 4).tail(uvs_) = -against * uv;
      // So that m, the clamp and rounding leave something.
      light_most_[row + 4] = -1e-6;
    }
  }

  /// Rows of the pull, below those of the places.
  MatrixXd pull() const {
    MatrixXd rows = MatrixXd::Zero(unknowns(), unknowns());
    const auto part = [&](Eigen::Index first, Eigen::Index n) {
      rows.block(first, first, n, n) =
          std::sqrt(kPull / static_cast<double>(n)) *
          (MatrixXd::Identity(n, n) - MatrixXd::Constant(n, n, 1.0 / static_cast<double>(n)));
    };
    part(0, blues_);
    part(blues_, uvs_);
    return rows;
  }

  VectorXd front_of(const DiscDose& dose) const {
    return Eigen::Map<const VectorXd>(dose.front.value.data(),
                                      static_cast<Eigen::Index>(dose.front.value.size()));
  }
  /// At all places of the march; none without diffusion, where the light itself is bounded.
  VectorXd window_of(const DiscDose& dose) const {
    if (disc::diffusion_um2_s(resin_) <= 0) return {};
    return Eigen::Map<const VectorXd>(dose.window.value.data(),
                                      static_cast<Eigen::Index>(dose.window.value.size()));
  }

  /// Where the dose is `front` + dfront dx, window likewise: the best dx with |dx| <= trust.
  VectorXd best_step(const VectorXd& x, const VectorXd& weight, const VectorXd& front,
                     const MatrixXd& dfront, const VectorXd& window, const MatrixXd& dwindow,
                     double trust) const {
    const Eigen::Index n = unknowns(), places = front.size();
    const VectorXd root = weight.cwiseSqrt();
    const MatrixXd to_mean = pull();
    MatrixXd M(places + n, n);
    VectorXd y(places + n);
    M << root.asDiagonal() * dfront, to_mean;
    y << root.cwiseProduct(VectorXd::Ones(places) - front), -to_mean * x;
    const bool trusted = std::isfinite(trust);
    const Eigen::Index rows = light_rows_.rows() + window.size() + (trusted ? 2 * n : 0);
    MatrixXd A(rows, n);
    VectorXd b(rows);
    A.topRows(light_rows_.rows()) = light_rows_;
    b.head(light_rows_.rows()) = light_most_ - light_rows_ * x;
    A.middleRows(light_rows_.rows(), window.size()) = dwindow;
    b.segment(light_rows_.rows(), window.size()) =
        VectorXd::Constant(window.size(), goal_.window_most) - window;
    // Where what was bent has led a little over a bound, no further.
    if (trusted) b = b.cwiseMax(1e-7);
    if (trusted) {
      A.bottomRows(2 * n) << MatrixXd::Identity(n, n), -MatrixXd::Identity(n, n);
      b.tail(2 * n).setConstant(trust);
    }
    return disc::bounded_least_squares(M, y, A, b);
  }

  /// Dose is linear in light: the unknowns' own doses tell all.
  Solution solve_linear(double gap_um, const VectorXd& weight) const {
    std::vector<DiscLight> lights;
    const auto add = [&](Eigen::Index count, bool patterned, bool blue) {
      for (Eigen::Index i = 0; i < count; ++i) {
        RadialCurve curve;
        for (int j = 0; j < kCurvePlaces; ++j) {
          const double r = place_of(j, kCurvePlaces);
          curve.r.push_back(r);
          curve.value.push_back((blue ? goal_.blue_most_mw_cm2 : goal_.uv_most_mw_cm2) *
                                shapes_at(goal_, patterned, r)[i]);
        }
        lights.push_back(blue ? DiscLight{curve, even_curve(0)} : DiscLight{even_curve(0), curve});
      }
    };
    add(blues_, blue_patterned_, true);
    add(uvs_, uv_patterned_, false);
    const std::vector<DiscDose> doses =
        disc::march(resin_, print_, even_curve(gap_um), lights, grid_);
    const Eigen::Index n = unknowns(),
                       windows = disc::diffusion_um2_s(resin_) > 0 ? weight.size() : 0;
    MatrixXd front(weight.size(), n), window(windows, n);
    for (Eigen::Index k = 0; k < n; ++k) {
      const DiscDose& dose = doses[static_cast<std::size_t>(k)];
      front.col(k) = front_of(dose);
      if (windows > 0) window.col(k) = window_of(dose);
    }
    const VectorXd none = VectorXd::Zero(n);
    Solution s{gap_um,
               best_step(none, weight, VectorXd::Zero(weight.size()), front,
                         VectorXd::Zero(windows), window, std::numeric_limits<double>::infinity()),
               0};
    s.mean_square = judged(s.x, weight, front * s.x);
    return s;
  }

  double judged(const VectorXd& x, const VectorXd& weight, const VectorXd& front) const {
    return weight.dot((front.array() - 1).square().matrix()) + (pull() * x).squaredNorm();
  }

  /// Dose bends with light: steps of linear problems, no longer than what was true of the last.
  Solution solve_in_steps(double gap_um, const VectorXd& weight, const VectorXd* start) const {
    const RadialCurve gap = even_curve(gap_um);
    const auto dose_of = [&](const VectorXd& x) {
      return disc::march(resin_, print_, gap, {light_of(x)}, grid_).front();
    };
    // A light too much at the window counts more than any unevenness.
    const auto merit = [&](const VectorXd& x, const DiscDose& dose) {
      const VectorXd window = window_of(dose);
      const double over = window.size() > 0 ? window.maxCoeff() - goal_.window_most : 0;
      return judged(x, weight, front_of(dose)) + 10 * std::max(over, 0.0);
    };
    VectorXd x = within_bounds(first_guess(gap_um), dose_of);
    DiscDose dose = dose_of(x);
    double worth = merit(x, dose), trust = 0.2;
    if (start != nullptr) {
      const VectorXd before = within_bounds(*start, dose_of);
      const DiscDose before_dose = dose_of(before);
      const double before_worth = merit(before, before_dose);
      if (before_worth < worth) {
        x = before;
        dose = before_dose;
        worth = before_worth;
      }
    }
    for (int round = 0; round < 30 && trust > 1e-4; ++round) {
      const VectorXd front = front_of(dose), window = window_of(dose);
      MatrixXd dfront(front.size(), unknowns()), dwindow(window.size(), unknowns());
      for (Eigen::Index k = 0; k < unknowns(); ++k) {
        VectorXd beside = x;
        // Inwards, so that light stays below its cap.
        const double by = x[k] > 0.5 ? -1e-3 : 1e-3;
        beside[k] += by;
        const DiscDose there = dose_of(beside);
        dfront.col(k) = (front_of(there) - front) / by;
        if (window.size() > 0) dwindow.col(k) = (window_of(there) - window) / by;
      }
      const VectorXd next = x + best_step(x, weight, front, dfront, window, dwindow, trust);
      const DiscDose next_dose = dose_of(next);
      const double next_worth = merit(next, next_dose);
      if (next_worth < worth) {
        const bool settled = worth - next_worth < 1e-6 * worth;
        trust = std::min(2 * trust, 1.0);
        x = next;
        dose = next_dose;
        worth = next_worth;
        if (settled) break;
      } else {
        trust *= 0.25;
      }
    }
    return {gap_um, x, worth};
  }

  /// The best light of a resin like this whose dose is linear: as much as is had at the rate that
  /// brings D'c in the time that resin has.
  VectorXd first_guess(double gap_um) const {
    FlowResin like = resin_;
    Kinetics& k = like.kinetics;
    const double time_s = 1.5 * gap_um / disc::um_s(print_.speed_mm_h);
    k.critical_dose_prime = time_s * std::pow(k.critical_dose_prime / time_s, 1 / k.m);
    k.m = 1;
    like.inhibitor_life_s = std::numeric_limits<double>::infinity();
    return Problem(like, print_, goal_, grid_).solve(gap_um, nullptr).x;
  }

  /// With so much less blue light that no bound is passed.
  template <class DoseOf>
  VectorXd within_bounds(VectorXd x, const DoseOf& dose_of) const {
    for (int round = 0; round < 60; ++round) {
      const VectorXd window = window_of(dose_of(x));
      const bool dark = window.size() == 0 || window.maxCoeff() < goal_.window_most;
      if (dark && (light_most_ - light_rows_ * x).minCoeff() >= -1e-9) break;
      x.head(blues_) *= 0.9;
    }
    return x;
  }

  const FlowResin& resin_;
  const DiscPrint& print_;
  const DiscGoal& goal_;
  const DiscGrid& grid_;
  bool blue_patterned_, uv_patterned_;
  Eigen::Index blues_, uvs_;
  MatrixXd light_rows_;
  VectorXd light_most_;
};

/// Coarsely over all gaps, then by golden section around the best.
Problem::Solution best_gap(const Problem& problem, double least_um, double most_um,
                           int coarse_gaps) {
  Problem::Solution best;
  const VectorXd* start = nullptr;
  VectorXd last;
  const auto at = [&](double gap_um) {
    Problem::Solution s = problem.solve(gap_um, start);
    last = s.x;
    start = &last;
    if (best.x.size() == 0 || s.mean_square < best.mean_square) best = s;
    return s.mean_square;
  };
  const double ratio = std::log(most_um / least_um) / (coarse_gaps - 1);
  const auto coarse = [&](int i) {
    return i == coarse_gaps - 1 ? most_um : least_um * std::exp(ratio * i);
  };
  int found = 0;
  for (int i = 0; i < coarse_gaps; ++i) {
    at(coarse(i));
    if (best.gap_um == coarse(i)) found = i;
  }
  last = best.x;
  const double golden = 0.5 * (std::sqrt(5.0) - 1);
  double low = coarse(std::max(found - 1, 0)), high = coarse(std::min(found + 1, coarse_gaps - 1));
  double left = high - golden * (high - low), right = low + golden * (high - low);
  double at_left = at(left), at_right = at(right);
  for (int i = 2; i < kFineGaps; ++i) {
    if (at_left < at_right) {
      high = right;
      right = left;
      at_right = at_left;
      at_left = at(left = high - golden * (high - low));
    } else {
      low = left;
      left = right;
      at_left = at_right;
      at_right = at(right = low + golden * (high - low));
    }
  }
  return best;
}

void check_goal(const DiscPrint& print, const DiscGoal& goal) {
  disc::check_positive(goal.blue_most_mw_cm2, "blue_most_mw_cm2");
  if (goal.uv_most_mw_cm2 == 0) {
    throw InfeasibleError(
        "resin flow: the UV lamp is off, so that there is no dead zone: the part adheres to the "
        "window at once");
  }
  disc::check_positive(goal.uv_most_mw_cm2, "uv_most_mw_cm2");
  if ((goal.pattern == DiscPattern::uv || goal.pattern == DiscPattern::both) &&
      !goal.uv_patternable) {
    disc::refuse("pattern",
                 "asks for patterned UV light of a lamp that shows none; expected none "
                 "or blue");
  }
  if (goal.gap_um) disc::check_positive(*goal.gap_um, "gap_um");
  disc::check_positive(goal.least_gap_um, "least_gap_um");
  disc::check_positive(goal.largest_gap_um, "largest_gap_um");
  if (!goal.gap_um && !(goal.least_gap_um < goal.largest_gap_um)) {
    disc::refuse("largest_gap_um", fmt::format("is {}; expected more than the least, {} um",
                                               goal.largest_gap_um, goal.least_gap_um));
  }
  const double most = goal.gap_um.value_or(goal.largest_gap_um);
  if (goal.leave_out_edge && !(most < 1e3 * print.radius_mm)) {
    disc::refuse("leave_out_edge", fmt::format("nothing is left of a radius of {} mm without {} um",
                                               print.radius_mm, most));
  }
  if (!(goal.window_most > 0 && goal.window_most < 1)) {
    disc::refuse("window_most",
                 fmt::format("is {}; expected it between 0 and 1", goal.window_most));
  }
  if (goal.degree < 1 || goal.degree > 20) {
    disc::refuse("degree", fmt::format("is {}; expected 1 to 20", goal.degree));
  }
  if (goal.free_nodes != 0 && (goal.free_nodes < 2 || goal.free_nodes > 40)) {
    disc::refuse("free_nodes", fmt::format("is {}; expected 2 to 40, or 0", goal.free_nodes));
  }
}

bool at_cap(const RadialCurve& light, double most) {
  return *std::max_element(light.value.begin(), light.value.end()) >= 0.999 * most;
}

}  // namespace

DiscOptimum best_disc_light(const FlowResin& resin, const DiscPrint& print, const DiscGoal& goal,
                            const DiscGrid& grid) {
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_grid(grid);
  check_goal(print, goal);
  const Problem problem(resin, print, goal, grid);
  const bool linear = disc::is_linear(resin);
  // Gaps may be compared coarsely where each takes many marches.
  DiscGrid scan = grid;
  if (!linear) {
    scan.levels = std::max(4, grid.levels / 2);
    scan.steps = std::max(4, grid.steps / 2);
  }
  Problem::Solution best;
  if (goal.gap_um) {
    best = problem.solve(*goal.gap_um, nullptr);
  } else {
    best = best_gap(linear ? problem : Problem(resin, print, goal, scan), goal.least_gap_um,
                    goal.largest_gap_um, linear ? kCoarseGaps : kCoarseGapsInSteps);
    if (!linear) best = problem.solve(best.gap_um, &best.x);
  }
  DiscOptimum o;
  o.gap_um = best.gap_um;
  o.light = problem.light_of(best.x);
  o.dose = disc::march(resin, print, even_curve(o.gap_um), {o.light}, grid).front();
  o.mean_square = problem.mean_square(o.gap_um, o.dose.front);
  o.share_within = share_within_tenth(o.dose.front);
  o.window_most = *std::max_element(o.dose.window.value.begin(), o.dose.window.value.end());
  o.blue_at_cap = at_cap(o.light.blue_mw_cm2, goal.blue_most_mw_cm2);
  o.uv_at_cap = at_cap(o.light.uv_mw_cm2, goal.uv_most_mw_cm2);
  o.gap_at_limit = !goal.gap_um &&
                   (o.gap_um <= 1.01 * goal.least_gap_um || o.gap_um >= 0.99 * goal.largest_gap_um);
  return o;
}

double share_within_tenth(const RadialCurve& front) {
  disc::check_front(front);
  // The share of each piece in which a straight line lies within.
  const auto within = [](double a, double b) {
    const double low = std::min(a, b), high = std::max(a, b);
    if (high == low) return low >= 0.9 && low <= 1.1 ? 1.0 : 0.0;
    return std::max(0.0, (std::min(high, 1.1) - std::max(low, 0.9)) / (high - low));
  };
  double share = within(front.value.front(), front.value.front()) * front.r.front();
  for (std::size_t i = 1; i < front.r.size(); ++i) {
    share += (front.r[i] - front.r[i - 1]) * within(front.value[i - 1], front.value[i]);
  }
  return share + within(front.value.back(), front.value.back()) * (1 - front.r.back());
}

}  // namespace slicecorr
