// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <utility>

#include "correct/coupled_necks.hpp"
#include "correct/coupled_tile.hpp"
#include "parallel/silent.hpp"

namespace slicecorr::detail {

void CoupledCorrection::go_back_to_best() {
  for (Tile& tile : tiles_) {
    tile.now = tile.best;
    tile.figures = tile.best_figures;
  }
  const int round = now_.round;
  now_ = best_;
  now_.round = round;
}

std::vector<CaseTrouble> CoupledCorrection::fails_in(const CasePlans& plans,
                                                     const ExecutionContext& context) const {
  std::vector<std::vector<CaseTrouble>> of_tiles(tiles_.size());
  parallel_for(context, "judge", tiles_.size(), [&](std::size_t i) {
    of_tiles[i] = judge_cases(plans, tiles_[i].box, sources_of(tiles_[i].box));
  });
  std::vector<CaseTrouble> all;
  for (const auto& of : of_tiles) all.insert(all.end(), of.begin(), of.end());
  return all;
}

/// Each of these is to have, with inputs as said, what it lacks or has too much in its case.
void CoupledCorrection::want(const std::vector<CaseTrouble>& troubles) {
  constexpr double beyond = 0.004, least_edge = 0.85;
  for (const CaseTrouble& t : troubles) {
    // A gap of one slice between features has no layer to spare, a feature no node.
    if (t.slice < 0 || !(t.dose > 0)) continue;
    Tile& tile = tiles_[tiles_in({t.x, t.y, t.x + 1, t.y + 1}).front()];
    const double wanted = t.as_said / t.dose * (t.gap ? 1 - beyond : 1 + beyond);
    const std::size_t at = index_in(tile.box, t.x, t.y);
    tile.wanted_doses[{t.slice, at}] = aim_byte(wanted, t.gap);
    if (!t.gap) continue;
    // The edges beside it give way, by no more than it is to have less, and not where one is asked for more.
    const std::uint8_t edge = edge_byte(std::max(wanted, least_edge));
    if (t.top > 0) tile.wanted_doses.try_emplace({t.top, at}, edge);
    tile.wanted_doses.try_emplace({t.bottom, at}, edge);
  }
}

/// These are to gel: the more dose is wanted of their nodes, the more often the middle of the layer did not
/// gel by it.
void CoupledCorrection::want(const std::vector<Miss>& necks) {
  constexpr double least_more = 0.01;
  for (const Miss& miss : necks) {
    Tile& tile = tiles_[tiles_in({miss.x, miss.y, miss.x + 1, miss.y + 1}).front()];
    std::uint8_t& wanted = tile.wanted_doses[{miss.slice, index_in(tile.box, miss.x, miss.y)}];
    const double more = std::max(least_more, -2.0 * static_cast<double>(miss.excess));
    wanted = neck_byte(wanted == 0 ? 1 + plan_.margin : aim_of_byte(wanted) + more);
  }
}

void CoupledCorrection::ask(int rounds, const ExecutionContext& context) {
  std::vector<std::size_t> wanted;
  for (std::size_t k = 0; k < tiles_.size(); ++k) {
    Tile& tile = tiles_[k];
    // For necks only what is around them is solved again.
    tile.urgency = now_.unmet_first ? 0 : kUrgency;
    if (tile.wanted_doses.empty()) continue;
    wanted.push_back(k);
    std::vector<std::uint8_t> rows(pixels_of(tile.box), 0);
    TileWriter writer(*store_, rows.size(), plan_.slices, TileWriter::From::last);
    auto next = tile.wanted_doses.rbegin();
    for (int n = plan_.slices; n-- > 0;) {
      std::fill(rows.begin(), rows.end(), std::uint8_t{0});
      for (; next != tile.wanted_doses.rend() && next->first.first == n; ++next) {
        rows[next->first.second] = next->second;
      }
      writer.put(rows.data());
    }
    tile.aims = writer.finish();
  }
  for (const std::size_t k : wanted) {
    const PixelBox around = PatchPlace::grown(tiles_[k].box, plan_.overlap_x, plan_.overlap_y);
    for (const std::size_t i : tiles_in(around)) tiles_[i].urgency = kUrgency;
  }
  judge(wanted, context);
  best_ = now_;
  keep_best();
  without_gain_ = 0;
  options_.rounds = now_.round + rounds;
  while (improve(context)) {
  }
  go_back_to_best();
}

std::vector<Miss> CoupledCorrection::necks_lost(const ExecutionContext& context) const {
  std::vector<std::vector<Miss>> of_tiles(tiles_.size());
  parallel_for(context, "judge", tiles_.size(), [&](std::size_t i) {
    const Tile& tile = tiles_[i];
    of_tiles[i] = lost_necks(plan_, tile.box, misses_of(tile.figures),
                             sources(PatchPlace::grown(tile.box, 1, 1), &Tile::coverage));
  });
  std::vector<Miss> all;
  for (const auto& of : of_tiles) all.insert(all.end(), of.begin(), of.end());
  return all;
}

CoupledCorrection::NeckFigures CoupledCorrection::hold_necks(const ExecutionContext& context) {
  constexpr int passes = 8, patience = 5, rounds = 6;
  NeckFigures held;
  if (tiles_.empty() || plan_.wants || options_.rounds == 0) return held;
  const ExecutionContext quiet = silent(context);
  go_back_to_best();
  std::vector<Miss> lost = necks_lost(quiet);
  held.before = held.after = lost.size();
  if (lost.empty()) return held;
  std::vector<std::pair<KeptTile, Figures>> best(tiles_.size());
  const auto keep = [&] {
    for (std::size_t k = 0; k < best.size(); ++k) best[k] = {tiles_[k].now, tiles_[k].figures};
  };
  keep();
  now_.unmet_first = true;
  int without_gain = 0;
  for (int pass = 0; pass < passes && without_gain < patience && !lost.empty(); ++pass) {
    context.check_cancelled();
    want(lost);
    ask(rounds, quiet);
    lost = necks_lost(quiet);
    ++without_gain;
    if (lost.size() >= held.after) continue;
    without_gain = 0;
    held.after = lost.size();
    keep();
  }
  for (std::size_t k = 0; k < best.size(); ++k) {
    tiles_[k].now = best[k].first;
    tiles_[k].figures = best[k].second;
  }
  now_.unmet_first = false;
  ask(0, quiet);
  return held;
}

CoupledCorrection::Held CoupledCorrection::hold_in(const CureModel& weak, const CureModel& strong,
                                                   const ExecutionContext& context) {
  constexpr int passes = 12, patience = 4, rounds = 6;
  Held held;
  if (tiles_.empty()) return held;
  const CorrectionPlan& said = plan_.columns;
  const CorrectionPlan of_weak(weak, said.process, said.layers, said.all_layers),
      of_strong(strong, said.process, said.layers, said.all_layers);
  const CoupledPlan weak_plan(of_weak, plan_.blur, plan_.display, plan_.margin, plan_.shares),
      strong_plan(of_strong, plan_.blur, plan_.display, plan_.margin, plan_.shares);
  const CasePlans plans{plan_, weak_plan, strong_plan};
  const ExecutionContext quiet = silent(context);
  const auto count = [](const std::vector<CaseTrouble>& troubles) {
    CaseFigures figures;
    for (const CaseTrouble& t : troubles) {
      ++(t.gap ? figures.filled : figures.lost);
      figures.as_said += t.fails_as_said;
    }
    return figures;
  };
  const auto doses_wanted = [&] {
    std::uint64_t sum = 0;
    for (const Tile& tile : tiles_) sum += tile.wanted_doses.size();
    return sum;
  };
  const std::uint64_t of_necks = doses_wanted();
  go_back_to_best();
  std::vector<CaseTrouble> troubles = fails_in(plans, quiet);
  held.before = held.after = count(troubles);
  std::vector<KeptTile> best;
  for (const Tile& tile : tiles_) best.push_back(tile.best);
  int without_gain = 0;
  for (int pass = 0; pass < passes && without_gain < patience && !troubles.empty(); ++pass) {
    context.check_cancelled();
    want(troubles);
    ask(rounds, quiet);
    troubles = fails_in(plans, quiet);
    const CaseFigures figures = count(troubles);
    // What prints as said is not given up for a case.
    if (figures.sum() >= held.after.sum() || figures.as_said > held.before.as_said) {
      ++without_gain;
      continue;
    }
    without_gain = 0;
    held.after = figures;
    for (std::size_t k = 0; k < best.size(); ++k) best[k] = tiles_[k].best;
  }
  held.aims = doses_wanted() - of_necks;
  for (std::size_t k = 0; k < best.size(); ++k) tiles_[k].now = tiles_[k].best = best[k];
  return held;
}

}  // namespace slicecorr::detail
