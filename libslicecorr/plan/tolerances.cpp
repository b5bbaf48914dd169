// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/tolerances.hpp"

#include <algorithm>
#include <cmath>

#include "plan/closed.hpp"
#include "slicecorr/limit.hpp"

namespace slicecorr::detail {

namespace {

/// How far the curve goes to either side of the tolerance asked for.
constexpr double kFactor = 10;
/// Digits of tolerances that are tried.
constexpr int kDigits = 3;

std::vector<double> tolerances_of(const PlanAsk& ask) {
  std::vector<double> all{ask.tolerance_um};
  const int points = ask.tolerance_points;
  for (int k = 0; k < points; ++k) {
    const double at = points > 1 ? 2.0 * k / (points - 1) - 1 : 1;
    all.push_back(rounded_up(ask.tolerance_um * std::pow(kFactor, at), kDigits));
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

PlanTolerance at_tolerance(Planner& planner, const PlanAsk& ask, const std::vector<PlanGap>& gaps,
                           const Bound& bound) {
  PlanTolerance t;
  t.tolerance_um = ask.tolerance_um;
  const double gels = planner.gels().greatest;
  double most = gels;
  std::vector<PaceRange> ranges{planner.gels()};
  std::string word = "light";
  if (planner.light()) {
    const auto tolerated = tolerated_speeds(*planner.light(), ask.tolerance_um, ask.light_error);
    if (!tolerated) {
      t.limited_by = "tolerance";
      return t;
    }
    if (tolerated->greatest_mm_h < most) {
      most = tolerated->greatest_mm_h;
      word = "tolerance";
    }
    ranges.clear();
    for (const SpeedRange& r : closed_ranges(*planner.light(), gaps, ask)) {
      ranges.push_back({r.least_mm_h, r.greatest_mm_h});
    }
    if (ranges.empty()) ranges.push_back({tolerated->least_mm_h, tolerated->greatest_mm_h});
  }
  if (bound.most_mm_h < most) {
    most = bound.most_mm_h;
    word = bound.word;
  }
  t.at = planner.fastest_within(ranges, most, ask.tolerance_um);
  if (!t.at) {
    t.limited_by = planner.at(most).limited_by;
    return t;
  }
  t.at->keeps = true;
  t.at->why.clear();
  t.at->limited_by.clear();
  const double next = pace_of(*t.at) * kPaceStep;
  if (next > most) {
    t.limited_by = word;
  } else {
    const std::string why = planner.at(next).limited_by;
    t.limited_by = why.empty() ? "edges" : why;
  }
  return t;
}

}  // namespace

std::vector<PlanTolerance> tolerance_curve(Planner& planner, const PlanAsk& ask,
                                           const std::vector<PlanGap>& gaps, const Bound& bound) {
  std::vector<PlanTolerance> curve;
  for (const double tolerance_um : tolerances_of(ask)) {
    PlanAsk its = ask;
    its.tolerance_um = tolerance_um;
    curve.push_back(at_tolerance(planner, its, gaps, bound));
  }
  return curve;
}

}  // namespace slicecorr::detail
