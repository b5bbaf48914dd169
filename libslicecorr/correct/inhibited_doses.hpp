// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The levels of one column under inhibiting UV light, and the doses that they give.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "correct/inhibited_plan.hpp"

namespace slicecorr::detail {

/// Doses are relative. Slices nearer than plan.near add what the kernel's tables say. Those further
/// away are summed in one number per slice, F(n) = D(l_n, near - 1) + a F(n + 1), of which node k
/// gets a F(k + near). For one thread.
class ColumnDoses {
 public:
  static constexpr int kSamples = InhibitedKernel::kSamples;

  explicit ColumnDoses(const InhibitedPlan& plan);

  /// What others shine into the column, per slice, with which slices begin; empty: black.
  void set_floors(const std::vector<Level>& floors);
  /// Gives all slices the light of their floors.
  void clear();
  /// Gives slice n its level; slices are added from the last to the first, after clear().
  void add(int n, int level);
  /// All of a column's levels. `sampled`: doses inside layers are kept, too, for least_sampled().
  void take(const std::vector<Level>& levels, bool sampled);
  /// Sums all doses anew, after changes.
  void rebuild();
  /// Gives slice n another level. Doses of layers `near` and more away change only in rebuild().
  void change(int n, int level) {
    const auto i = static_cast<std::size_t>(n);
    move_light(n, levels_[i], level);
    levels_[i] = static_cast<Level>(level);
  }

  const std::vector<Level>& levels() const { return levels_; }
  int level(int n) const { return levels_[static_cast<std::size_t>(n)]; }
  bool has_floors() const { return !floors_.empty(); }
  int floor(int n) const { return has_floors() ? floors_[static_cast<std::size_t>(n)] : 0; }
  /// What a level of slice n adds at the node j layers above it, beyond the light of the slice's
  /// floor.
  double extra(int n, int level, int j) const {
    const int s = plan_.setting_of(n), least = floor(n);
    double light = plan_.node_light.one(s, level, j);
    if (least > 0) light = std::max(0.0, light - plan_.node_light.one(s, least, j));
    return plan_.ratio_of(n) * light;
  }
  /// The doses of black slices and floors alone.
  double floor_node(int k) const { return base_of(floor_node_, plan_.dark_node, k); }
  double floor_middle(int k) const { return base_of(floor_middle_, plan_.dark_middle, k); }
  /// The part of floor_node() from slices at least `near` layers away.
  double floor_far(int k) const { return base_of(floor_far_, plan_.dark_far, k); }
  bool sampled() const { return sampled_; }

  double node(int k) const {
    const auto i = static_cast<std::size_t>(k);
    return floor_node(k) + near_node_[i] + far_at(far_node_, k);
  }
  /// Dose in the middle of layer k.
  double middle(int k) const {
    const auto i = static_cast<std::size_t>(k);
    return floor_middle(k) + near_middle_[i] + far_at(far_middle_, k);
  }
  /// Dose `below` slices below node k, at most half a slice to either side: by a straight line from
  /// the node to the middle there.
  double beside(int k, double below) const {
    const double at_node = node(k);
    if (below == 0) return at_node;
    return at_node + (middle(below > 0 ? k : k - 1) - at_node) * 2.0 * std::abs(below);
  }
  /// Dose at node k of the slices at least `near` layers away, beyond their floors.
  double far(int k) const { return far_at(far_node_, k); }
  /// Dose at node k of floors and of the slices after n, as added so far.
  double so_far(int k, int n) const {
    if (n - k < plan_.near) return node(k);
    // All of these slices lie further away than the tables reach.
    const int next = n + 1;
    return floor_node(k) + far_node_[static_cast<std::size_t>(next)] *
                               std::pow(plan_.kernel->a(), next - k - plan_.near + 1);
  }
  /// The least dose at the samples of layer k; only while sampled().
  double least_sampled(int k) const {
    const auto at = static_cast<std::size_t>(k) * kSamples;
    const auto beyond = static_cast<float>(far_at(far_node_, k));
    const float* const dark = (floor_fine_.empty() ? plan_.dark_fine : floor_fine_).data() + at;
    float least = std::numeric_limits<float>::infinity();
    for (std::size_t i = 0; i < kSamples; ++i) {
      const float dose = dark[i] + near_fine_[at + i] + beyond * fade_[i];
      least = std::min(least, dose);
    }
    return static_cast<double>(least);
  }

 private:
  double base_of(const std::vector<double>& own, const std::vector<double>& of_plan, int k) const {
    return (own.empty() ? of_plan : own)[static_cast<std::size_t>(k)];
  }
  double far_at(const std::vector<double>& f, int k) const {
    const auto at = static_cast<std::size_t>(k + plan_.near);
    return at < f.size() ? plan_.kernel->a() * f[at] : 0.0;
  }
  void blacken();
  void move_light(int n, int from, int to);

  const InhibitedPlan& plan_;
  std::vector<Level> levels_;  ///< per slice
  std::vector<Level> floors_;
  std::vector<double> floor_node_, floor_middle_, floor_far_;  ///< empty: those of the plan
  std::vector<float> floor_fine_;
  std::vector<double> near_node_, near_middle_;  ///< per layer, from slices nearer than near
  std::vector<double> far_node_, far_middle_;    ///< F, per slice
  std::vector<float> near_fine_;                 ///< per layer and sample, while sampled()
  bool sampled_ = false;
  float fade_[kSamples];  ///< of far light, from a layer's upper end to its samples
};

}  // namespace slicecorr::detail
