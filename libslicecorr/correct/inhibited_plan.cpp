// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_plan.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "correct/band_solvers.hpp"
#include "cure/margin.hpp"
#include "cure/own_doses.hpp"

namespace slicecorr::detail {

namespace {

/// `near` up to a whole number of vector registers.
int whole_registers(int near) { return (near + 7) / 8 * 8; }

}  // namespace

ExtraLight::ExtraLight(const InhibitedKernel& kernel, InhibitedKernel::LayerPosition place)
    : near_(kernel.near()),
      levels_(kernel.levels()),
      reach_(whole_registers(near_)),
      a_(kernel.a()) {
  for (int s = 0; s < kernel.settings(); ++s) {
    const double* from = kernel.table(s, place);
    std::vector<double> table(static_cast<std::size_t>(reach_ * levels_), 0.0);
    // Sums over distances are for slices that are alike.
    const bool summed = kernel.slice_of(s) < 0;
    std::vector<double> sums(summed ? static_cast<std::size_t>((near_ + 1) * levels_) : 0, 0.0);
    const double* const last = kernel.last_row(s, place);
    for (int l = 0; l < levels_; ++l) last_.push_back(std::max(0.0, last[l] - last[0]));
    for (int l = 0; l < levels_; ++l) {
      double* const sum = summed ? &sums[static_cast<std::size_t>(l * (near_ + 1))] : nullptr;
      for (int j = 0; j < near_; ++j) {
        const double light = std::max(0.0, from[static_cast<std::size_t>(j * levels_ + l)] -
                                               from[static_cast<std::size_t>(j * levels_)]);
        table[static_cast<std::size_t>(l * reach_ + reach_ - 1 - j)] = light;
        if (summed) sum[j + 1] = sum[j] + light;
      }
    }
    tables_.push_back(std::move(table));
    sums_.push_back(std::move(sums));
  }
  for (double power = 1; power > 1e-12; power *= a_) powers_.push_back(power);
}

double ExtraLight::beyond(int setting, int l, int j) const {
  const auto away = static_cast<std::size_t>(j - near_ + 1);
  const double power = away < powers_.size() ? powers_[away] : std::pow(a_, away);
  return close(setting, l, near_ - 1) * power;
}

double ExtraLight::sum(int setting, int l, int j) const {
  const double* const sums = sums_[static_cast<std::size_t>(setting)].data() +
                             static_cast<std::ptrdiff_t>(l) * (near_ + 1);
  if (j <= near_) return sums[j];
  const double last = close(setting, l, near_ - 1);
  return sums[near_] + last * a_ * (1.0 - std::pow(a_, j - near_)) / (1.0 - a_);
}

int ExtraLight::peak(int setting, int l) const {
  int peak = 0;
  for (int j = 1; j < near_; ++j) {
    if (one(setting, l, j) > one(setting, l, peak)) peak = j;
  }
  return peak;
}

Promises::Promises(const ExtraLight& light, int levels, const Lengths& lengths)
    : lengths_(lengths) {
  sums_.resize(at(levels, 0));
  for (int l = 0; l < levels; ++l) {
    for (int j = 0; j <= lengths_.distances; ++j) sums_[at(l, j)] = light.sum(0, l, j);
  }
}

void Promises::add_rest(const ExtraLight& light, int cap, int steady) {
  rests_.resize(at(lengths_.longest_lag + 1, 0), 0.0);
  for (int lag = 1; lag <= lengths_.longest_lag; ++lag) {
    for (int j = lag; j <= lengths_.distances; ++j) {
      double& rest = rests_[at(lag, lengths_.distances - j)];
      rest = light.sum(0, cap, lag, j);
      rest += light.sum(0, steady, 0, lag);
    }
  }
  for (int e = lengths_.distances; e >= 0; --e) powers_.push_back(std::pow(light.a(), e));
}

InhibitedPlan::InhibitedPlan(const CureModel& model, bool merge, int target_layers, int all_slices,
                             const InhibitedTuning& numbers)
    : tuning(numbers),
      solved(std::make_shared<SolvedColumns>(numbers.kept_bytes)),
      kernel(std::get<UnderUv>(model.law).kernel),
      node_light(*kernel, InhibitedKernel::upper_end),
      middle_light(*kernel, InhibitedKernel::middle),
      near(kernel->near()),
      levels(kernel->levels()),
      layers(target_layers),
      all_layers(all_slices),
      layer_um(model.layer_um),
      merge_one_slice_gaps(merge),
      even(kernel->gap_um() > 0) {
  if (even) {
    // What shines inside features is given: none of it is too much.
    tuning.excess_weight = 0;
    tuning.tolerance_um = tuning.height_tolerance_um = tuning.even_tolerance_um;
  }
  for (const double r : model.exposure_ratio) uniform = uniform && r == 1.0;
  uniform = uniform && kernel->settings() == 1;
  if (!uniform) {
    for (int n = 0; n < all_layers; ++n) {
      ratio.push_back(model.ratio(n));
      settings.push_back(kernel->setting_of_slice(n));
    }
  }
  find_levels();
  find_lags();
  if (!kernel->alike()) {
    find_own_layers();
    far_light = FarLight(*this);
  }
  if (uniform) tabulate_promises();
  sum_dark(model);
  if (model.lifts) find_holding(model);
}

void InhibitedPlan::find_holding(const CureModel& model) {
  OwnDoses own(*kernel, model.lifts->skin);
  const double least = model.lifts->green_strength * (1 + kMargin);
  std::map<std::pair<int, double>, std::pair<Level, Level>> known;
  for (int n = 0; n < all_layers; ++n) {
    const int setting = setting_of(n), cap = cap_of(n);
    const double more = model.ratio(n);
    const auto [entry, is_new] = known.try_emplace({setting, more});
    if (is_new) {
      // Doses rise with the level.
      const auto lowest = [&](const auto& does) {
        int low = 0, high = cap;
        while (low < high) {
          const int middle = (low + high) / 2;
          if (does(own.of_level(setting, middle, more))) {
            high = middle;
          } else {
            low = middle + 1;
          }
        }
        return static_cast<Level>(low);
      };
      entry->second = {lowest([&](const OwnDoses::Own& o) { return o.joint >= least; }),
                       lowest([&](const OwnDoses::Own& o) { return o.joint >= least && o.film; })};
    }
    holding_own.push_back(entry->second.first);
    film_own.push_back(entry->second.second);
  }
}

/// Finds the levels that may be used, those that hold a dose, and how far full light reaches.
void InhibitedPlan::find_levels() {
  for (int s = 0; s < kernel->settings(); ++s) caps.push_back(kernel->highest_usable_level(s));
  const int strongest = kernel->strongest_setting();
  const int highest = caps[static_cast<std::size_t>(strongest)];
  // check_feasible() refuses light that never lifts the dose to 1; this only ends the loops.
  constexpr int never_reaches = 100000;
  int cap = even ? std::min(highest, kernel->least_even_level()) : highest;
  // Even light may be so dim somewhere that still resin hardly gels there, because dose flows in from
  // brighter places: more slices would not help. The dimmest light that counts is done within some
  // three absorbance heights, exp(-3) = 0.05 from its end.
  constexpr double dimmest = 1.05;
  while (even && cap < highest && node_light.sum(strongest, cap, never_reaches) < dimmest) ++cap;
  steady = cap;
  while (steady > 0 && kernel->steady_dose(strongest, steady - 1) >= 1.0) --steady;
  inside = tuning.inside_dose * ripple();
  steady_sum = node_light.sum(strongest, steady, never_reaches);
  node_over_middle = steady_sum / middle_light.sum(strongest, steady, never_reaches);
  holding = steady;
  while (holding < levels && kernel->steady_dose(strongest, holding) < inside) ++holding;
  reach = 1;
  while (reach < never_reaches && node_light.sum(strongest, cap, reach) < 1.0) ++reach;
  int most = reach;
  for (const double um : kernel->heights().um()) most = std::max(most, reach_at(um, cap));
  reach = most;
}

InhibitedPlan InhibitedPlan::for_doses(double most) const {
  InhibitedPlan plan = *this;
  // None of the light that doses want is too much.
  plan.tuning.excess_weight = 0;
  const int strongest = kernel->strongest_setting();
  const int cap = caps[static_cast<std::size_t>(strongest)];
  constexpr int farthest = 100000;
  while (plan.reach < farthest && node_light.sum(strongest, cap, plan.reach) < most) ++plan.reach;
  plan.climbs.clear();
  for (int j = 0; uniform && j <= plan.reach; ++j) plan.climbs.push_back(climb(0, j));
  plan.promises = {};
  if (uniform) plan.tabulate_promises();
  return plan;
}

double InhibitedPlan::climb(int k, int slices) const {
  if (static_cast<std::size_t>(slices) < climbs.size()) {
    return climbs[static_cast<std::size_t>(slices)];
  }
  const int longest = *std::max_element(lags.begin(), lags.end());
  double sum = 0;
  for (int n = k; n < (uniform ? k + slices : std::min(k + slices, all_layers)); ++n) {
    const int level = n < k + lag_from(k, longest) ? std::min(steady_of(n), cap_of(n)) : cap_of(n);
    sum += ratio_of(n) * light_of(n, level, n - k);
  }
  return sum;
}

/// How far the dose at nodes is above the least between them, as a factor, where the steady level
/// stands for long. Layer by layer the dose ripples, and the least in a layer is what has to gel.
double InhibitedPlan::ripple() const {
  if (!kernel->layer_by_layer()) return 1.0;
  constexpr int samples = InhibitedKernel::kSamples;
  const float* const fine = kernel->fine(kernel->strongest_setting());
  double sum[samples] = {};
  for (int j = 0; j < near; ++j) {
    for (int i = 0; i < samples; ++i) {
      const double light =
          fine[static_cast<std::size_t>(steady * near + j) * samples + static_cast<std::size_t>(i)];
      sum[i] += j + 1 < near ? light : light / (1.0 - kernel->a());
    }
  }
  return sum[samples - 1] / *std::min_element(sum, sum + samples);
}

void InhibitedPlan::find_lags() {
  peak = node_light.peak(kernel->strongest_setting(), steady);
  for (const InhibitedTuning::Fraction& share :
       kernel->layer_by_layer() ? tuning.layerwise_lag_shares : tuning.lag_shares) {
    const int lag = lag_of(share, peak);
    if (std::find(lags.begin(), lags.end(), lag) == lags.end()) lags.push_back(lag);
  }
  end_lag = lag_of(tuning.end_lag_share, peak);
}

void InhibitedPlan::tabulate_promises() {
  const int longest = *std::max_element(lags.begin(), lags.end());
  // No node asks for light of slices further away; a plan that reaches so far does without tables.
  const int distances = reach + longest + tuning.spare_slices + 2;
  constexpr int most = 1000;
  if (distances > most || longest >= near) return;
  promises = Promises(node_light, levels, {distances, longest});
  promises.add_rest(node_light, caps.front(), steady);
}

void InhibitedPlan::sum_dark(const CureModel& model) {
  dark_far.resize(static_cast<std::size_t>(all_layers));
  dark_node = dark_at(model, InhibitedKernel::upper_end);
  dark_middle = dark_at(model, InhibitedKernel::middle);
  for (const double dose : dark_middle) most_dark = std::max(most_dark, dose);
  if (kernel->layer_by_layer()) sample_dark(model);
}

/// Dose of black slices at one place of each layer.
std::vector<double> InhibitedPlan::dark_at(const CureModel& model,
                                           InhibitedKernel::LayerPosition place) {
  std::vector<double> dose(static_cast<std::size_t>(all_layers), 0.0);
  double far = 0;  // of slices near or more layers away
  for (int k = all_layers; k-- > 0;) {
    const bool at_node = place == InhibitedKernel::upper_end;
    const double left = at_node ? node_fade(k) : middle_fade(k);
    far *= left;
    if (k + near < all_layers) {
      const int n = k + near;
      far += left * model.ratio(n) * kernel->last_row(kernel->setting_of_slice(n), place)[0];
    }
    double sum = far * (at_node ? node_back(k) : middle_back(k));
    for (int j = 0; j < near && k + j < all_layers; ++j) {
      sum += model.ratio(k + j) * kernel->table(kernel->setting_of_slice(k + j),
                                                place)[static_cast<std::size_t>(j * levels)];
    }
    dose[static_cast<std::size_t>(k)] = sum;
    if (at_node) dark_far[static_cast<std::size_t>(k)] = far;
  }
  return dose;
}

void InhibitedPlan::sample_dark(const CureModel& model) {
  constexpr std::size_t samples = InhibitedKernel::kSamples;
  dark_fine.resize(static_cast<std::size_t>(all_layers) * samples);
  for (int k = 0; k < all_layers; ++k) {
    float* const out = &dark_fine[static_cast<std::size_t>(k) * samples];
    for (std::size_t i = 0; i < samples; ++i) {
      const double t = static_cast<double>(i + 1) / samples;
      double sum =
          dark_far[static_cast<std::size_t>(k)] *
          (sample_fades.empty()
               ? std::pow(kernel->a(), t - 1.0)
               : static_cast<double>(sample_fades[static_cast<std::size_t>(k) * samples + i]));
      for (int j = 0; j < near && k + j < all_layers; ++j) {
        sum += model.ratio(k + j) * kernel->fine(kernel->setting_of_slice(
                                        k + j))[static_cast<std::size_t>(j) * samples + i];
      }
      out[i] = static_cast<float>(sum);
    }
  }
}

ColumnFacts InhibitedPlan::facts() const {
  ColumnFacts facts;
  facts.layers = layers;
  facts.all_layers = all_layers;
  facts.lower_at_window = kernel->layer_by_layer();
  facts.height_steps = tuning.height_steps;
  facts.solved = solved;
  facts.levels = levels;
  if (!uniform || even || !holding_own.empty()) return facts;
  // What a column is at one height it is at any, but for the dose of black slices, which near to the
  // last one is less by `most_dark` a^distance: that is to be a tenth of the margin for rounding. What
  // prints beyond a feature's edge towards the platform ends where it has room above it: 100 gel doses
  // fall to one in less.
  const double fall = -std::log(kernel->a());
  constexpr double most_dose = 100;
  facts.begin_at = near + static_cast<int>(std::ceil(std::log(most_dose) / fall));
  const double dark = std::max(1.0, 10 * most_dark / kMargin);
  const int longest = *std::max_element(lags.begin(), lags.end());
  facts.clear_after = std::max(static_cast<int>(std::ceil(std::log(dark) / fall)),
                               reach + longest + tuning.spare_slices) +
                      near;
  return facts;
}

int InhibitedPlan::slices_for(int target_layers, int last_lit) const {
  return std::max(target_layers, last_lit + 1 + reach + longest(end_lag) + tuning.spare_slices);
}

int inhibited_slices(const CureModel& model, int target_layers, int last_lit) {
  return InhibitedPlan(model, false, 1, 1).slices_for(target_layers, last_lit);
}

}  // namespace slicecorr::detail
