// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What all columns of a stack share in the correction under inhibiting UV light.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "correct/column_solver.hpp"
#include "correct/far_light.hpp"
#include "correct/inhibited_tuning.hpp"
#include "correct/solved_columns.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

/// Light that black does not give: entries of the kernel's tables less those of level 0, per UV
/// setting, with running sums over the distance. What belongs to one level lies together.
class ExtraLight {
 public:
  ExtraLight(const InhibitedKernel& kernel, InhibitedKernel::LayerPosition place);
  /// What a slice of level l adds j layers above its own.
  double one(int setting, int l, int j) const {
    return j < near_ ? close(setting, l, j) : beyond(setting, l, j);
  }
  /// What a slice adds to the layer near - 1 above its own, without the light that the platform sends back.
  double last(int setting, int l) const {
    return last_[static_cast<std::size_t>(setting * levels_ + l)];
  }
  /// The same of j < near.
  double close(int setting, int l, int j) const { return upwards(setting, l)[reach_ - 1 - j]; }
  /// What it adds to each of the `reach()` layers up to its own, the farthest first; 0 to those that
  /// are `near` and more layers away.
  const double* upwards(int setting, int l) const {
    return tables_[static_cast<std::size_t>(setting)].data() +
           static_cast<std::ptrdiff_t>(l) * reach_;
  }
  /// `near` and some more, so that loops have no rest.
  int reach() const { return reach_; }
  double a() const { return a_; }
  /// Sum of one(l, i) over i < j.
  double sum(int setting, int l, int j) const;
  /// Sum of one(l, i) over first <= i < end.
  double sum(int setting, int l, int first, int end) const {
    const double all = sum(setting, l, end);
    return first > 0 ? all - sum(setting, l, first) : all;
  }
  /// The distance at which a slice of level l acts most, in slices.
  int peak(int setting, int l) const;

 private:
  double beyond(int setting, int l, int j) const;

  int near_, levels_, reach_;
  double a_;
  std::vector<std::vector<double>> tables_;  ///< [setting][level][reach_ - 1 - j]
  /// [setting][level][j]; none of settings of one slice, whose neighbours have other ones
  std::vector<std::vector<double>> sums_;
  std::vector<double> last_;    ///< [setting * levels + level]
  std::vector<double> powers_;  ///< of a, down to where nothing is left
};

/// Stands for the highest levels of a column that has none of its own.
inline const std::vector<Level> kCapsOfPlan;

/// A lag in slices, from a share of the distance of the kernel's peak.
inline int lag_of(const InhibitedTuning::Fraction& share, int peak) {
  return std::max(share.times * peak / share.over, 1);
}

/// What the rule asks again and again, by distance: where all slices have one UV setting and one
/// exposure.
class Promises {
 public:
  Promises() = default;
  /// Of distances up to `distances`, and of lags up to the longest of `lags`.
  struct Lengths {
    int distances, longest_lag;
  };
  Promises(const ExtraLight& light, int levels, const Lengths& lengths);
  /// Adds what can still come: `cap` down to the lag, the level `steady` after it.
  void add_rest(const ExtraLight& light, int cap, int steady);

  bool hold(int distance, int lag) const {
    return distance <= lengths_.distances && lag <= lengths_.longest_lag;
  }
  /// `ExtraLight::sum(0, level, j)` of j = 0 .. distances.
  const double* of_level(int level) const { return &sums_[at(level, 0)]; }
  /// The most that slices nearer than `distance` can give a node whose own light begins at once,
  /// beyond the lag. Distances fall from entry to entry.
  const double* rest(int lag, int distance) const {
    return &rests_[at(lag, lengths_.distances - distance)];
  }
  bool has_power(int exponent) const { return exponent <= lengths_.distances; }
  /// Powers of a; exponents fall from entry to entry.
  const double* powers(int exponent) const {
    return &powers_[static_cast<std::size_t>(lengths_.distances - exponent)];
  }

 private:
  std::size_t at(int row, int i) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(lengths_.distances + 1) +
           static_cast<std::size_t>(i);
  }
  Lengths lengths_{-1, -1};
  std::vector<double> sums_, rests_, powers_;
};

/// What a layer makes of light from slices `near` and more layers away, where layers are not alike: `node` and
/// `middle` are left of what came to these places of the layer below, `back` times more is what the platform sends
/// back to them.
struct LayerFade {
  double node, middle, node_back, middle_back;
};

/// Immutable once made; may be shared between threads. Doses are relative: 1 gels the resin.
struct InhibitedPlan {
  InhibitedPlan(const CureModel& model, bool merge, int target_layers, int all_slices,
                const InhibitedTuning& numbers = {});

  /// The same where features want doses up to `most`, relative.
  InhibitedPlan for_doses(double most) const;
  /// What the `slices` next ones after node k can still give it, beyond black, as the rule counts on it: full
  /// light down to the longest lag, the steady level after it.
  double climb(int k, int slices) const;
  /// Of light of the steady level: the part of a node's dose that comes from beyond so many slices.
  double from_beyond(int slices) const {
    return 1.0 - node_light.sum(kernel->strongest_setting(), steady, slices) / steady_sum;
  }

  /// Slices to show for a target whose last lit layer is `last_lit`: the end of a feature that is
  /// promised its dose late gets it from slices further away.
  int slices_for(int target_layers, int last_lit) const;

  int setting_of(int slice) const {
    const auto n = static_cast<std::size_t>(std::max(slice, 0));
    return uniform ? 0 : n < settings.size() ? settings[n] : kernel->setting_of_slice(slice);
  }
  /// Exposure of a slice over the normal one.
  double ratio_of(int slice) const {
    return ratio.empty() ? 1.0 : ratio[static_cast<std::size_t>(slice)];
  }
  /// Highest level in use in a slice.
  int cap_of(int slice) const { return caps[static_cast<std::size_t>(setting_of(slice))]; }
  /// The same of a column with levels of its own per slice; empty: it has none.
  int cap_of(int slice, const std::vector<Level>& of_column) const {
    const int cap = cap_of(slice);
    return of_column.empty() ? cap : std::min<int>(cap, of_column[static_cast<std::size_t>(slice)]);
  }

  /// What a level of slice n adds at the node j layers above it, beyond black, at the normal exposure.
  double light_of(int n, int level, int j) const {
    const int setting = setting_of(n);
    return fades.empty() || j < near ? node_light.one(setting, level, j)
                                     : far_light_of(n, level, j);
  }
  /// Of light from slices `near` and more away at the node (in the middle) of the layer below, what comes to that of
  /// a layer.
  double node_fade(int layer) const { return fades.empty() ? kernel->a() : fade(layer).node; }
  double middle_fade(int layer) const { return fades.empty() ? kernel->a() : fade(layer).middle; }
  double node_back(int layer) const { return fades.empty() ? 1.0 : fade(layer).node_back; }
  double middle_back(int layer) const { return fades.empty() ? 1.0 : fade(layer).middle_back; }
  const LayerFade& fade(int layer) const {
    return fades[static_cast<std::size_t>(std::max(0, layer))];
  }
  /// A lag from a node on, in slices as they are.
  int lag_from(int node, int lag) const {
    return lags_from.empty() ? lag
                             : lags_from[static_cast<std::size_t>(lag) *
                                             static_cast<std::size_t>(all_layers + 1) +
                                         static_cast<std::size_t>(std::min(node, all_layers))];
  }
  /// The most slices of a lag.
  int longest(int lag) const;
  /// Dose that a node between these layers of a feature demands.
  double inside_of(int above, int below) const {
    return insides.empty() ? inside
                           : std::max(insides[static_cast<std::size_t>(above)],
                                      insides[static_cast<std::size_t>(below)]);
  }
  int steady_of(int slice) const {
    return steadies.empty() ? steady : steadies[static_cast<std::size_t>(slice)];
  }

  ColumnFacts facts() const;

  InhibitedTuning tuning;
  std::shared_ptr<SolvedColumns> solved;
  std::shared_ptr<const InhibitedKernel> kernel;
  ExtraLight node_light, middle_light;
  std::vector<double> ratio;  ///< per slice; empty: all 1
  std::vector<int> settings;  ///< per slice, where not `uniform`
  /// With lifts: least level whose own exposure leaves what holds at the layer's far edge, per slice, no
  /// higher than caps; empty: nothing is lifted.
  std::vector<Level> holding_own;
  std::vector<Level> film_own;  ///< the same of one that is a film, too
  int near, levels, layers, all_layers;
  std::vector<int> caps;  ///< highest level in use, per setting
  int steady = 0;         ///< lowest level whose steady dose is at least 1, strongest UV setting
  double inside = 1;      ///< dose that nodes inside features demand
  int holding = 0;        ///< lowest level whose steady dose is at least `inside`
  int reach = 0;          ///< slices of full light that lift the dose from 0 to 1
  double layer_um = 0;
  /// The dose of nodes over that of middles where one level stands for long.
  double node_over_middle = 1;
  double steady_sum = 1;       ///< dose of the steady level at nodes, beyond black
  int peak = 0;                ///< distance at which it acts most, slices
  std::vector<double> climbs;  ///< `climb` by slices, where `uniform` and doses are wanted
  bool merge_one_slice_gaps = false;
  /// Features get even light inside, not the least that gels (`Process::even_light`).
  bool even = false;
  bool uniform = true;    ///< one UV setting and one exposure for all slices
  std::vector<int> lags;  ///< slices; to be tried in this order
  int end_lag = 1;        ///< slices; that for which there are slices after the end
  Promises promises;      ///< where `uniform`
  std::vector<double> dark_node, dark_middle;  ///< dose that black slices alone leave, per layer
  std::vector<double> dark_far;  ///< the part of dark_node from slices `near` and more layers away
  double most_dark = 0;          ///< the greatest of dark_middle
  /// Dose of black slices at InhibitedKernel::kSamples places of each layer; layer by layer only.
  std::vector<float> dark_fine;
  // Where layers are not alike (`InhibitedKernel::alike`); else empty.
  std::vector<LayerFade> fades;      ///< per layer
  std::vector<double> middle_times;  ///< per layer: `middle` times `middle_back`
  /// Per layer and sample: what far light at the layer's node is there, with what the platform sends back.
  std::vector<float> sample_fades;
  std::vector<int> lags_from;   ///< [lag][node]; layers of one height: empty
  std::vector<double> insides;  ///< `inside` by layers, where their heights differ layer by layer
  std::vector<int> steadies;    ///< `steady`, likewise
  FarLight far_light;

 private:
  double far_light_of(int n, int level, int j) const {
    return node_light.last(setting_of(n), level) * far_light.fade(n - near + 1, n - j) *
           node_back(n - j);
  }
  void find_own_layers();
  int reach_at(double height_um, int level) const;
  int steady_at(double height_um) const;
  double ripple_at(double height_um) const;
  void find_levels();
  double ripple() const;
  void find_lags();
  void tabulate_promises();
  void find_holding(const CureModel& model);
  void sum_dark(const CureModel& model);
  std::vector<double> dark_at(const CureModel& model, InhibitedKernel::LayerPosition place);
  void sample_dark(const CureModel& model);
};

}  // namespace slicecorr::detail
