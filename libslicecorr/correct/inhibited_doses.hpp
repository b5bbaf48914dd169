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

#include "correct/inhibited_loops.hpp"
#include "correct/inhibited_plan.hpp"
#include "cure/margin.hpp"

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
  /// Gives slice n its level; slices are added from the last to the first, after clear(). Those after
  /// the first that is added keep the light of their floors.
  void add(int n, int level);
  /// Adds slices n .. end, from the last on, that show the level of the `near` slices after them: where
  /// all slices are alike and have no floors.
  void add_same(int n, int end);
  /// Adds slices n .. end with the light of their floors.
  void add_dark(int n, int end);
  /// All of a column's levels. `sampled`: doses inside layers are kept, too, for least_sampled().
  void take(const std::vector<Level>& levels, bool sampled);
  /// Sums all doses anew, after changes.
  void rebuild();
  /// Gives slice n another level. Doses of layers `near` and more away change only in rebuild().
  void change(int n, int level) {
    const auto i = static_cast<std::size_t>(n);
    move_light(n, levels_[i], level);
    move_samples(n, levels_[i], level);
    levels_[i] = static_cast<Level>(level);
  }

  /// Keeps the doses that other levels of slices n and n - 1 would change, for `recall`.
  void remember(int n);
  /// Gives the layers within reach of the tables the light of another level of slice n, until `recall`; to their
  /// insides only with `try_samples`. The slice keeps its level.
  void try_level(int n, int level) { move_light(n, this->level(n), level); }
  void try_samples(int n, int level) { move_samples(n, this->level(n), level); }
  /// Brings the doses back as they were at the last `remember`.
  void recall();

  const std::vector<Level>& levels() const { return levels_; }
  int level(int n) const { return levels_[static_cast<std::size_t>(n)]; }
  /// No slice after this one has more than the light of its floor.
  int last_lit() const { return last_; }
  bool has_floors() const { return !floors_.empty(); }
  int floor(int n) const { return has_floors() ? floors_[static_cast<std::size_t>(n)] : 0; }
  /// What a level of slice n adds at the node j layers above it, beyond the light of the slice's
  /// floor.
  double extra(int n, int level, int j) const {
    const int least = floor(n);
    double light = plan_.light_of(n, level, j);
    if (least > 0) light = std::max(0.0, light - plan_.light_of(n, least, j));
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
    return floor_node(k) + near_node_[i + reach_] + far(k) * plan_.node_back(k);
  }
  /// Dose in the middle of layer k.
  double middle(int k) const {
    const auto i = static_cast<std::size_t>(k);
    return floor_middle(k) + near_middle_[i + reach_] +
           plan_.middle_fade(k) * far_middle_[static_cast<std::size_t>(k + plan_.near)] *
               plan_.middle_back(k);
  }
  /// Dose `below` slices below node k, at most half a slice to either side: by a straight line from
  /// the node to the middle there.
  double beside(int k, double below) const {
    const double at_node = node(k);
    if (below == 0) return at_node;
    return at_node + (middle(below > 0 ? k : k - 1) - at_node) * 2.0 * std::abs(below);
  }
  /// Dose at node k of the slices at least `near` layers away, beyond their floors; without the light that the
  /// platform sends back.
  double far(int k) const {
    return plan_.node_fade(k) * far_node_[static_cast<std::size_t>(k + plan_.near)];
  }
  /// Dose at node k of floors and of the slices after n, as added so far.
  double so_far(int k, int n) const {
    if (n - k < plan_.near) return node(k);
    // All of these slices lie further away than the tables reach.
    const int next = n + 1;
    if (!plan_.fades.empty()) return floor_node(k) + far_of_own(k, next);
    const int away = next - k - plan_.near + 1;
    const double power = plan_.promises.has_power(away) ? *plan_.promises.powers(away)
                                                        : std::pow(plan_.kernel->a(), away);
    return floor_node(k) + far_node_[static_cast<std::size_t>(next)] * power;
  }
  /// The least dose at the samples of layer k; only while sampled().
  double least_sampled(int k) const {
    const auto at = static_cast<std::size_t>(k) * kSamples;
    const float* const dark = (floor_fine_.empty() ? plan_.dark_fine : floor_fine_).data() + at;
    const float* const fade = plan_.sample_fades.empty() ? fade_ : plan_.sample_fades.data() + at;
    return static_cast<double>(
        least_sample(dark, near_fine_.data() + at, fade, static_cast<float>(far(k))));
  }
  /// What nodes `first` and after it have of slices after n, and are to have, for `last_asking`: all
  /// within reach of the tables (`near`), or all beyond. Without what can still come.
  NodesAsking asking(const std::vector<double>& demand, int first, int n, bool within) const {
    const auto k = static_cast<std::size_t>(first);
    NodesAsking nodes{demand.data() + k,
                      plan_.dark_node.data() + k,
                      nullptr,
                      nullptr,
                      0,
                      nullptr,
                      nullptr,
                      kMargin};
    if (within) {
      nodes.added = near_node_.data() + k + reach_;
      nodes.far = far_node_.data() + first + plan_.near;
      nodes.far_times = plan_.kernel->a();
    } else {
      nodes.far_times = far_node_[static_cast<std::size_t>(n) + 1];
      nodes.powers = plan_.promises.powers(n + 2 - first - plan_.near);
    }
    return nodes;
  }
  MiddleDoses middles(int first) const {
    const auto k = static_cast<std::size_t>(first);
    return {(floor_middle_.empty() ? plan_.dark_middle : floor_middle_).data() + k,
            near_middle_.data() + k + reach_, far_middle_.data() + first + plan_.near,
            plan_.kernel->a(), plan_.fades.empty() ? nullptr : plan_.middle_times.data() + k};
  }

 private:
  double base_of(const std::vector<double>& own, const std::vector<double>& of_plan, int k) const {
    return (own.empty() ? of_plan : own)[static_cast<std::size_t>(k)];
  }
  double far_of_own(int k, int next) const;
  void blacken(int last);
  void move_light(int n, int from, int to);
  void move_samples(int n, int from, int to);

  const InhibitedPlan& plan_;
  std::vector<Level> levels_;  ///< per slice
  std::vector<Level> floors_;
  std::vector<double> floor_node_, floor_middle_, floor_far_;  ///< empty: those of the plan
  std::vector<float> floor_fine_;
  /// Per layer, from slices nearer than near; before the first layer, room for what passes it.
  std::vector<double> near_node_, near_middle_;
  std::vector<double> far_node_, far_middle_;  ///< F, per slice, and 0 as far as any layer looks
  std::vector<double> kept_;                   ///< by add_same()
  /// What remember() kept, and from where on it belongs.
  std::vector<double> kept_node_, kept_middle_;
  std::vector<float> kept_fine_;
  std::size_t kept_from_ = 0, kept_fine_from_ = 0;
  std::vector<float> near_fine_;  ///< per layer and sample, while sampled()
  std::size_t reach_;             ///< layers to which the loops give light
  int last_ = -1;                 ///< slices after it add nothing to any of these
  int last_sampled_ = -1;         ///< the same of near_fine_
  bool sampled_ = false;
  float fade_[kSamples];  ///< of far light, from a layer's upper end to its samples
};

}  // namespace slicecorr::detail
