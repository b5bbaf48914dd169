// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The search for the fastest print of one setting: what has been tried, and by which columns.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "plan/closed.hpp"
#include "plan/search.hpp"
#include "plan/trial.hpp"

namespace slicecorr::detail {

/// Slowest speed over the fastest where the light of black sets none.
inline constexpr double kSlowest = 1e-3;
/// Digits of speeds and exposures that are tried: what is told reads back as what was tried.
inline constexpr int kPaceDigits = 6;

/// Paces between which resin gels in full light and not in black; what no stage does is not yet left out.
PaceRange gelling(const Setup& setup, double layer_um);
/// The setup at a pace: a speed in mm/h, layer by layer one over the exposure in s.
Setup at_pace(Setup setup, double pace);
double pace_of(const PlanPoint& point);

/// What the search of one setting has tried and found. Not thread-safe.
class Planner {
 public:
  /// All but `setup` must outlive this. `tried` takes every correction.
  Planner(const SliceSource& target, const DesignColumns& columns, const PartHeights& heights,
          const Trials& trials, const Setup& setup, const PlanAsk& ask,
          const ExecutionContext& context, std::vector<PlanPoint>& tried);

  const std::optional<PlanLight>& light() const { return light_; }
  double m() const { return m_; }
  const PaceRange& gels() const { return gels_; }
  std::size_t judged() const { return which_.size(); }

  /// The fastest with all columns, at most `most` (a pace), edges within the tolerance; `ranges`: where to
  /// look first.
  std::optional<PlanPoint> fastest(const std::vector<PaceRange>& ranges, double most);
  /// The same of another tolerance, by the columns that are looked at.
  std::optional<PlanPoint> fastest_within(const std::vector<PaceRange>& ranges, double most,
                                          double tolerance_um);
  /// The point of a pace, by the columns that are looked at.
  const PlanPoint& at(double pace);

  /// A correction with a speed for each slice, whose light is for that speed, and what of it fails.
  struct Speeds {
    PlanPoint point;
    std::vector<PlanPlace> failing;
  };
  /// By the columns that are looked at.
  Speeds at_speeds(const std::vector<double>& speeds_mm_h);
  /// By all columns; those that fail are looked at from then on.
  Speeds at_speeds_in_all(const std::vector<double>& speeds_mm_h);
  /// The setup of such speeds.
  Setup with_speeds(const std::vector<double>& speeds_mm_h) const;

 private:
  double key(double pace) const;
  void note(const PlanPoint& point);
  std::vector<std::uint32_t> everything() const;
  /// Columns with the lowest gaps and features, and some of all others.
  std::vector<std::uint32_t> critical(int most) const;
  void grow(std::vector<std::uint32_t> failing);

  const DesignColumns& columns_;
  const PartHeights& heights_;
  const Trials& trials_;
  Setup setup_;
  const ExecutionContext& context_;
  const ExecutionContext quiet_;
  std::vector<PlanPoint>& tried_;
  PaceRange gels_;
  std::vector<std::uint32_t> which_;
  std::map<double, PlanPoint> points_;
  std::optional<PlanLight> light_;
  double m_ = 1;
};

}  // namespace slicecorr::detail
