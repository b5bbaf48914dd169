// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The light of a column with which the fewest of its features and gaps fail although inputs are off.
///
/// Slices are chosen from the last to the first. What later slices leave is three doses: as said, in the weak case
/// and in the strong one. From each such state every slice tries a few levels: dark, full, some between, and those
/// that bring a dose just to where a feature or gap that still has to hold does, or an edge lies. Of states that are
/// nearly alike as said, those stay that cost less, or whose cases lie nearer to each other: with the same dose as
/// said, more in the weak case and less in the strong one is never worse for what lies further up. Costs, in this
/// order: what fails with inputs as said, what fails in a case, then voxels on the wrong side of 1 and edges beside
/// their nodes, both with inputs as said.
///
/// The doses are those of the levels themselves: what the plan counts is what is shown. That the states are
/// joined and the levels few makes it a search and no proof; on random columns it finds what a mixed integer
/// programme finds (tests/robust_plan_test.cpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "slicecorr/correct.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

class LightPlan {
 public:
  /// Whether doses of a model follow from slice to slice by a single number: sums of light, in a bath that goes
  /// on, before a platform that sends nothing back, without lifts.
  static bool can_plan(const CureModel& model);
  /// `weak`, `strong`: prints of the same levels. What is given must outlive this. For one thread at a time.
  LightPlan(const CorrectionPlan& plan, const CureModel& weak, const CureModel& strong);
  /// Levels of all slices that are shown, the first slice first; `coverage`: of as many layers.
  std::vector<std::uint8_t> levels(const std::vector<std::uint8_t>& coverage);

 private:
  enum Case : std::size_t { kSaid, kWeak, kStrong, kCases };
  enum class Item : std::uint8_t { none, feature, gap };
  using Doses = std::array<double, kCases>;
  struct State {
    Doses dose{};
    double cost = 0;
    std::uint16_t before = 0;  ///< index of the state that it follows from
    std::uint8_t level = 0;
    std::uint8_t holds = 0;  ///< of the item at hand: 1 as said, 2 in its case
  };
  struct Layer {
    Item item = Item::none;
    bool begins = false, ends = false;  ///< the item, at the lower and at the upper node
    double aim = 0;                     ///< coverage
    double edge_per_dose =
        0;  ///< slices by which an edge at the upper node moves; 0: none is there
    bool capped = false;
  };
  /// What slice `n` does: the dose at its upper node is a * below + gain * phi.
  struct Step {
    Doses a{}, gain{};
    double middle_below = 0, middle_light = 0;  ///< of the dose in the middle
  };
  std::vector<Layer> layers_of(const std::vector<std::uint8_t>& coverage) const;
  void take_items(std::vector<Layer>& layers, const std::vector<std::uint8_t>& coverage) const;
  Step step_of(int slice) const;
  void enter(const Layer& layer, State& state) const;
  static void see(Item item, const Doses& dose, State& state);
  /// Levels to try from a state, in `tried_`.
  void choose(const Step& step, const Layer& layer, Item above, const Doses& below);
  struct Wish {
    double dose;
    bool at_least;
  };
  void add_level(const Step& step, Case of, const Wish& wish, const Doses& below);
  double cost_of(const Step& step, const Layer& layer, const State& from, const State& to) const;
  /// The least that a state can come to cost, as far as is known.
  static double hope(const Layer& layer, const State& state);
  void try_slice(int slice, const Layer& layer, Item above);
  void put(const State& state, double hope);
  void keep_the_best(double least);

  const CorrectionPlan& plan_;
  std::array<const CureModel*, kCases> models_;
  std::array<LevelTable, kCases> tables_;
  bool jumps_;  ///< layer by layer
  double cap_, per_spread_;
  std::vector<std::uint8_t> usual_, tried_;
  std::vector<State> now_, next_;
  std::vector<double> hopes_;       ///< of next_
  std::vector<std::int32_t> cell_;  ///< index in next_ of the state in each cell; -1: none
  std::vector<std::size_t> used_;
  std::vector<std::vector<std::pair<std::uint16_t, std::uint8_t>>> ways_;
};

}  // namespace slicecorr::detail
