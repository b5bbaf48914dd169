// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/along_z.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::detail {

namespace {

/// Corrections that lowering and raising may take.
constexpr int kLowerings = 30, kRaisings = 48, kRepairs = 12;
/// What a slice about something that fails goes slower by at a time.
constexpr double kLower = 0.94;
/// Away from edges full light must just gel, with some room.
constexpr double kGels = 1.02;
/// Slices after the end with speeds of their own, at most, and how they go slower.
constexpr double kMostAfter = 1000, kSlowerAfter = 0.8;

class Search {
 public:
  Search(Planner& planner, const DesignColumns& columns, const PartHeights& heights,
         const PlanLight& light, const PlanAsk& ask, const AlongZBounds& bounds)
      : planner_(planner),
        light_(light),
        bounds_(bounds),
        layer_um_(light.layer_um),
        layers_(bounds.most_mm_h.size()),
        most_(most(columns, ask)),
        limits_(guess(heights, ask)) {}

  std::optional<AlongZ> find() {
    if (!lower(kLowerings)) return std::nullopt;
    raise();
    for (int i = 0; i < kRepairs; ++i) {
      const std::vector<double> speeds = schedule(limits_);
      const Planner::Speeds all = planner_.at_speeds_in_all(speeds);
      if (all.point.keeps) return AlongZ{speeds, all.point};
      if (!slower_about(all.failing)) return std::nullopt;
      if (!lower(kLowerings)) return std::nullopt;
    }
    return std::nullopt;
  }

 private:
  /// The greatest speed of each slice that gels it and that an error of the light leaves edges at.
  std::vector<double> most(const DesignColumns& columns, const PlanAsk& ask) const {
    std::vector<bool> beside(layers_, false);
    const auto mark = [&](int slice) {
      if (slice >= 0 && slice < static_cast<int>(beside.size())) {
        beside[static_cast<std::size_t>(slice)] = true;
      }
    };
    for (std::size_t k = 0; k < columns.columns().size(); ++k) {
      for (const ColumnEvent& e : columns.events(k)) {
        mark(e.layer - 1);
        mark(e.layer);
      }
    }
    mark(static_cast<int>(layers_) - 1);
    const auto tolerated = tolerated_speeds(light_, ask.tolerance_um, ask.light_error);
    const double at_edges = tolerated ? tolerated->greatest_mm_h : bounds_.uniform_mm_h;
    std::vector<double> most = bounds_.most_mm_h;
    for (std::size_t n = 0; n < layers_; ++n) {
      const double light = beside[n] ? at_edges : light_.smax_mm_h;
      most[n] = std::min({most[n], light_.smax_mm_h / kGels, light});
      most[n] = std::max(most[n], bounds_.uniform_mm_h);
    }
    // After the part's end only the burst counts, which takes the less time the slower it is passed.
    const double burst = light_.burst_um(bounds_.uniform_mm_h) / layer_um_;
    most.resize(layers_ + static_cast<std::size_t>(std::ceil(std::min(burst, kMostAfter))) + 1,
                std::max(at_edges, bounds_.uniform_mm_h));
    return most;
  }
  std::vector<double> guess(const PartHeights& heights, const PlanAsk& ask) const {
    std::vector<double> limits = most_;
    std::fill(limits.begin() + static_cast<std::ptrdiff_t>(layers_), limits.end(),
              bounds_.uniform_mm_h);
    const auto hold = [&](std::size_t n, const std::vector<SpeedRange>& ranges) {
      const double fastest = ranges.empty() ? bounds_.uniform_mm_h : ranges.back().greatest_mm_h;
      limits[n] =
          std::clamp(limits[n], bounds_.uniform_mm_h, std::max(bounds_.uniform_mm_h, fastest));
    };
    for (std::size_t n = 0; ask.gap_contrast > 0 && n < layers_; ++n) {
      if (const int gap = heights.gap_at[n]; gap > 0) {
        hold(n, gap_speeds(light_, gap, ask.gap_contrast));
      }
      if (const int gap = heights.platform_gap_at[n]; gap > 0) {
        hold(n, platform_gap_speeds(light_, gap, ask.gap_contrast));
      }
    }
    return limits;
  }
  std::vector<double> schedule(const std::vector<double>& limits) const {
    return speeds_within(limits, *std::max_element(limits.begin(), limits.end()),
                         bounds_.acceleration_mm_s2, layer_um_);
  }
  /// Slows the slices about these places; false: none can go slower.
  bool slower_about(const std::vector<PlanPlace>& places) {
    std::vector<bool> slow(limits_.size(), places.empty());
    for (const PlanPlace& p : places) {
      // What prints an edge is done within a burst of it.
      const int first = std::max(0, p.first - reach());
      const int last = std::min(static_cast<int>(limits_.size()) - 1, p.last + reach());
      for (int n = first; n <= last; ++n) slow[static_cast<std::size_t>(n)] = true;
    }
    bool any = false;
    for (std::size_t n = 0; n < limits_.size(); ++n) {
      if (!slow[n] || limits_[n] <= bounds_.uniform_mm_h) continue;
      limits_[n] = std::max(bounds_.uniform_mm_h, kLower * limits_[n]);
      any = true;
    }
    return any;
  }
  int reach() const {
    const double burst = light_.burst_um(bounds_.uniform_mm_h) / layer_um_;
    return 1 + static_cast<int>(std::ceil(std::min(burst, 8.0)));
  }
  bool lower(int tries) {
    for (int i = 0; i < tries; ++i) {
      const Planner::Speeds s = planner_.at_speeds(schedule(limits_));
      if (s.point.keeps) {
        time_s_ = s.point.time_s;
        return true;
      }
      if (!slower_about(s.failing)) return false;
    }
    return false;
  }
  /// Whether a print is faster and keeps everything with this factor on the limits of the slices
  /// [first, past); if so, they have it.
  bool faster(std::size_t first, std::size_t past, double factor, int& left) {
    std::vector<double> limits = limits_;
    for (std::size_t n = first; n < past; ++n) limits[n] = std::min(most_[n], factor * limits[n]);
    const std::vector<double> speeds = schedule(limits);
    if (left <= 0 || speeds == schedule(limits_)) return false;
    --left;
    const Planner::Speeds s = planner_.at_speeds(speeds);
    if (!s.point.keeps || s.point.time_s > time_s_ * (1 - 1e-5)) return false;
    time_s_ = s.point.time_s;
    limits_ = std::move(limits);
    return true;
  }
  void raise() {
    int left = kRaisings;
    // What lies after the end, slower by ever more, or else faster.
    const std::size_t all = limits_.size();
    bool slower = false;
    while (limits_.back() * kSlowerAfter > 2 * light_.smin_mm_h &&
           faster(layers_, all, kSlowerAfter, left)) {
      slower = true;
    }
    while (!slower && faster(layers_, all, 1 / kSlowerAfter, left)) {
    }
    const std::size_t slices = layers_;
    for (std::size_t size = slices; size > 0 && left > 0; size /= 2) {
      for (std::size_t first = 0; first < slices && left > 0; first += size) {
        const std::size_t past = std::min(slices, first + size);
        while (faster(first, past, 1.2, left)) {
        }
        faster(first, past, 1.05, left);
      }
    }
  }

  Planner& planner_;
  const PlanLight light_;
  const AlongZBounds& bounds_;
  const double layer_um_;
  const std::size_t layers_;
  const std::vector<double> most_;
  std::vector<double> limits_;
  double time_s_ = 0;
};

}  // namespace

std::optional<AlongZ> speeds_along_z(Planner& planner, const DesignColumns& columns,
                                     const PartHeights& heights, const PlanLight& light,
                                     const PlanAsk& ask, const AlongZBounds& bounds) {
  return Search(planner, columns, heights, light, ask, bounds).find();
}

}  // namespace slicecorr::detail
