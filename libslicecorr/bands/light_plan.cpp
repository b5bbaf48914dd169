// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/light_plan.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "correct/coverage.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// What counts; voxels and edges count 1 at most each. Where as many fail, a feature is lost rather than a gap
/// filled, if that costs a voxel more, but not two.
constexpr double kFailsAsSaid = 1e9, kLostInACase = 1e5, kFilledInACase = kLostInACase + 1.25;
/// States whose hope is worse than the best by more are dropped: one failure, and some voxels.
constexpr double kWorse = kLostInACase + 50;
constexpr std::size_t kMostStates = 500;
/// Doses are to pass 1 by so much; far above rounding.
constexpr double kPass = 1e-5;
/// Levels that are tried at each slice, beside those that just do.
constexpr int kUsualLevels = 6;
/// Cells of states: by their dose as said, finest around 1, and by how far the cases lie from each other.
constexpr std::size_t kDoseCells = 200, kSpreadCells = 128, kHoldCells = 4;
constexpr double kFineBelow = 0.3;
constexpr std::uint8_t kHoldsAsSaid = 1, kHoldsInCase = 2;

double fails_in_case(bool feature) { return feature ? kLostInACase : kFilledInACase; }

}  // namespace

bool LightPlan::can_plan(const CureModel& model) {
  return std::holds_alternative<SumOfLight>(model.law) && model.bath_slices == 0 &&
         model.mirrored_slices == 0 && !model.lifts;
}

LightPlan::LightPlan(const CorrectionPlan& plan, const CureModel& weak, const CureModel& strong)
    : plan_(plan),
      models_{&plan.model, &weak, &strong},
      tables_{LevelTable(plan.model.level_phi), LevelTable(weak.level_phi),
              LevelTable(strong.level_phi)},
      jumps_(plan.model.mode == ExposureMode::layerwise),
      cap_(jumps_ ? kNoCap : plan.process.omega_max),
      cell_(kDoseCells * kHoldCells * kSpreadCells, -1) {
  const double widest = 1 - weak.phi_max() / strong.phi_max();
  per_spread_ = 90 / std::max(widest, 1e-6);
  const LevelTable& said = tables_[kSaid];
  const double most = said.phi(said.highest());
  const double least = std::max(said.phi(0), 0.01 * most);
  usual_.push_back(0);
  for (int i = 1; i < kUsualLevels; ++i) {
    const double part = static_cast<double>(i) / (kUsualLevels - 1);
    usual_.push_back(static_cast<std::uint8_t>(said.at_most(least * std::pow(most / least, part))));
  }
  usual_.back() = static_cast<std::uint8_t>(said.highest());
}

/// Features and gaps that count, as the judge of both cases has them: gaps with a feature right below.
void LightPlan::take_items(std::vector<Layer>& layers,
                           const std::vector<std::uint8_t>& coverage) const {
  for (std::size_t from = 0, past; from < coverage.size(); from = past) {
    for (past = from; past < coverage.size() && coverage[past] == coverage[from];) ++past;
    if (is_grey(coverage[from])) continue;
    const bool feature = coverage[from] == kFull;
    if (!feature) {
      if (past == coverage.size() || coverage[past] != kFull) continue;
      if (plan_.merge_one_slice_gaps && past - from == 1) {
        layers[from].aim = 1;
        continue;
      }
    }
    for (std::size_t n = from; n < past; ++n) {
      layers[n].item = feature ? Item::feature : Item::gap;
      layers[n].capped = feature && (from > 0 || plan_.process.cap_platform_features);
    }
    layers[from].ends = layers[past - 1].begins = true;
  }
}

std::vector<LightPlan::Layer> LightPlan::layers_of(
    const std::vector<std::uint8_t>& coverage) const {
  std::vector<Layer> layers(coverage.size());
  for (std::size_t n = 0; n < coverage.size(); ++n) layers[n].aim = aim_of(coverage[n]);
  take_items(layers, coverage);
  for (std::size_t n = 1; n < layers.size(); ++n) {
    const bool upper = layers[n].aim == 1 && layers[n - 1].aim == 0,
               lower = layers[n].aim == 0 && layers[n - 1].aim == 1;
    if (!upper && !(lower && !jumps_)) continue;
    const CureModel& said = plan_.model;
    const double slope = jumps_ ? 1 : upper ? 1 - said.phi_min() : said.phi_max() - 1;
    const double per_slice = units::kLn10 * said.eta_of(static_cast<int>(n));
    layers[n].edge_per_dose = 1 / (std::max(slope, 1e-3) * per_slice);
  }
  return layers;
}

LightPlan::Step LightPlan::step_of(int slice) const {
  Step step;
  for (std::size_t k = 0; k < kCases; ++k) {
    const CureModel& m = *models_[k];
    step.a[k] = m.a_of(slice);
    step.gain[k] = (jumps_ ? step.a[k] : m.one_minus_a_of(slice)) * m.ratio(slice);
  }
  const CureModel& said = plan_.model;
  const double root_a = said.root_a_of(slice), ratio = said.ratio(slice);
  step.middle_below = root_a;
  step.middle_light = (jumps_ ? root_a : 1 - root_a) * ratio;
  return step;
}

void LightPlan::see(Item item, const Doses& dose, State& state) {
  if (item == Item::none) return;
  const bool feature = item == Item::feature;
  const double in_case = dose[feature ? kWeak : kStrong];
  const auto holds = [&](double d) { return feature ? d >= 1 + kPass : d < 1 - kPass; };
  if (!(state.holds & kHoldsAsSaid) && holds(dose[kSaid])) {
    state.holds |= kHoldsAsSaid;
    state.cost -= kFailsAsSaid;
  }
  if (!(state.holds & kHoldsInCase) && holds(in_case)) {
    state.holds |= kHoldsInCase;
    state.cost -= fails_in_case(feature);
  }
}

void LightPlan::enter(const Layer& layer, State& state) const {
  if (layer.item == Item::none || !layer.begins) return;
  state.holds = 0;
  state.cost += kFailsAsSaid + fails_in_case(layer.item == Item::feature);
  if (!jumps_) see(layer.item, state.dose, state);
}

double LightPlan::hope(const Layer& layer, const State& state) {
  if (layer.item == Item::none || layer.ends) return state.cost;
  return state.cost - ((state.holds & kHoldsAsSaid) ? 0 : kFailsAsSaid) -
         ((state.holds & kHoldsInCase) ? 0 : fails_in_case(layer.item == Item::feature));
}

void LightPlan::add_level(const Step& step, Case of, const Wish& wish, const Doses& below) {
  const double phi = (wish.dose - step.a[of] * below[of]) / step.gain[of];
  const LevelTable& table = tables_[of];
  if (!(phi > table.phi(0)) || phi > table.phi(table.highest())) return;
  tried_.push_back(
      static_cast<std::uint8_t>(wish.at_least ? table.at_least(phi) : table.at_most(phi)));
}

void LightPlan::choose(const Step& step, const Layer& layer, Item above, const Doses& below) {
  tried_ = usual_;
  const auto sees = [&](Item item) {
    return layer.item == item || (!jumps_ && layer.ends && above == item);
  };
  if (sees(Item::feature)) {
    for (const Case of : {kSaid, kWeak}) {
      add_level(step, of, {(1 + kPass) * (jumps_ ? step.a[of] : 1), true}, below);
    }
  }
  if (sees(Item::gap)) {
    for (const Case of : {kSaid, kStrong}) add_level(step, of, {1 - 2 * kPass, false}, below);
  }
  if (layer.edge_per_dose > 0 || jumps_) add_level(step, kSaid, {1 + kPass, true}, below);
}

double LightPlan::cost_of(const Step& step, const Layer& layer, const State& from,
                          const State& to) const {
  const double middle =
      step.middle_below * from.dose[kSaid] + step.middle_light * tables_[kSaid].phi(to.level);
  const bool whole = layer.aim == 0 || layer.aim == 1;
  double cost = whole ? static_cast<double>((middle >= 1) != (layer.aim == 1))
                      : std::min(1.0, std::abs(middle - layer.aim));
  if (layer.edge_per_dose > 0) {
    cost += std::min(1.0, std::abs(to.dose[kSaid] - 1) * layer.edge_per_dose);
  }
  return cost;
}

void LightPlan::put(const State& state, double hope) {
  const double off = state.dose[kSaid] - 1;
  const double place = 0.5 * (1 + off / (kFineBelow + std::abs(off)));
  const auto dose = std::min(kDoseCells - 1, static_cast<std::size_t>(place * kDoseCells));
  const double apart = (1 - state.dose[kWeak] / std::max(state.dose[kStrong], 1e-12));
  const auto spread =
      std::min(kSpreadCells - 1, static_cast<std::size_t>(std::max(0.0, apart) * per_spread_));
  const std::size_t cell = (dose * kHoldCells + state.holds) * kSpreadCells + spread;
  std::int32_t& at = cell_[cell];
  if (at < 0) {
    at = static_cast<std::int32_t>(next_.size());
    used_.push_back(cell);
    next_.push_back(state);
    hopes_.push_back(hope);
  } else if (hope < hopes_[static_cast<std::size_t>(at)]) {
    next_[static_cast<std::size_t>(at)] = state;
    hopes_[static_cast<std::size_t>(at)] = hope;
  }
}

/// Of states alike as said those that cost less than all whose cases lie nearer to each other.
void LightPlan::keep_the_best(double least) {
  std::sort(used_.begin(), used_.end());
  std::vector<std::pair<double, std::size_t>> kept;
  std::size_t group = std::numeric_limits<std::size_t>::max();
  double least_here = 0;
  for (const std::size_t cell : used_) {
    if (cell / kSpreadCells != group) {
      group = cell / kSpreadCells;
      least_here = std::numeric_limits<double>::infinity();
    }
    const auto at = static_cast<std::size_t>(std::exchange(cell_[cell], -1));
    if (hopes_[at] >= least_here || hopes_[at] > least + kWorse) continue;
    least_here = hopes_[at];
    kept.emplace_back(hopes_[at], at);
  }
  if (kept.size() > kMostStates) {
    const auto past = kept.begin() + static_cast<std::ptrdiff_t>(kMostStates);
    std::nth_element(kept.begin(), past, kept.end());
    kept.erase(past, kept.end());
    std::sort(kept.begin(), kept.end());
  }
  now_.clear();
  for (const auto& [hope, at] : kept) now_.push_back(next_[at]);
}

void LightPlan::try_slice(int slice, const Layer& layer, Item above) {
  const Step step = step_of(slice);
  next_.clear();
  hopes_.clear();
  used_.clear();
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < now_.size(); ++i) {
    State& from = now_[i];
    enter(layer, from);
    choose(step, layer, above, from.dose);
    for (const std::uint8_t level : tried_) {
      State to = from;
      to.before = static_cast<std::uint16_t>(i);
      to.level = level;
      for (std::size_t k = 0; k < kCases; ++k) {
        to.dose[k] = step.a[k] * from.dose[k] + step.gain[k] * tables_[k].phi(level);
      }
      if (layer.capped && to.dose[kSaid] > std::max(cap_, from.dose[kSaid])) continue;
      Doses seen = to.dose;
      if (jumps_ && layer.item == Item::feature) {
        for (std::size_t k = 0; k < kCases; ++k) seen[k] /= step.a[k];
      }
      see(layer.item, seen, to);
      to.cost += cost_of(step, layer, from, to);
      const double its_hope = hope(layer, to);
      least = std::min(least, its_hope);
      if (its_hope > least + kWorse) continue;
      if (layer.ends) to.holds = 0;
      put(to, its_hope);
    }
  }
  keep_the_best(least);
}

std::vector<std::uint8_t> LightPlan::levels(const std::vector<std::uint8_t>& coverage) {
  const std::vector<Layer> layers = layers_of(coverage);
  now_.assign(1, State{});
  ways_.resize(layers.size());
  for (std::size_t n = layers.size(); n-- > 0;) {
    try_slice(static_cast<int>(n), layers[n], n > 0 ? layers[n - 1].item : Item::none);
    ways_[n].clear();
    for (const State& state : now_) ways_[n].emplace_back(state.before, state.level);
  }
  const auto best = std::min_element(
      now_.begin(), now_.end(), [](const State& a, const State& b) { return a.cost < b.cost; });
  std::vector<std::uint8_t> levels(layers.size());
  auto at = static_cast<std::size_t>(best - now_.begin());
  for (std::size_t n = 0; n < layers.size(); ++n) {
    levels[n] = ways_[n][at].second;
    at = ways_[n][at].first;
  }
  return levels;
}

}  // namespace slicecorr::detail
