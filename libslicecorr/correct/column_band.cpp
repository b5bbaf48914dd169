// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/column_band.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "correct/coverage.hpp"
#include "correct/solved_columns.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/target.hpp"
#include "support/numbers/release.hpp"

namespace slicecorr::detail {

namespace {

/// A number of few bytes where it is small.
void put(std::string& bytes, std::uint32_t number) {
  for (; number >= 128; number >>= 7U) bytes.push_back(static_cast<char>(number | 128U));
  bytes.push_back(static_cast<char>(number));
}
std::uint32_t take(const std::string& bytes, std::size_t& at) {
  std::uint32_t number = 0;
  for (unsigned shift = 0;; shift += 7) {
    const auto byte = static_cast<std::uint8_t>(bytes[at++]);
    number |= (byte & 127U) << shift;
    if (byte < 128) return number;
  }
}

/// Equal for columns of equal coverage and edge heights of which the same is left alone, and for no others.
std::string key_of(const std::vector<CoverageRun>& runs, const std::vector<LeftAloneRun>& left,
                   bool doses) {
  std::string key;
  std::int32_t before = 0;
  for (const CoverageRun& r : runs) {
    put(key, static_cast<std::uint32_t>(r.first - before));
    put(key, static_cast<std::uint32_t>(r.end - r.first));
    for (const std::uint8_t byte : {r.coverage, r.upper_height, r.lower_height}) {
      key.push_back(static_cast<char>(byte));
    }
    before = r.end;
  }
  if (left.empty() && !doses) return key;
  // No run is empty: here the others begin.
  key.append(2, '\0');
  before = 0;
  for (const LeftAloneRun& r : left) {
    put(key, static_cast<std::uint32_t>(r.first - before));
    put(key, static_cast<std::uint32_t>(r.end - r.first));
    key.push_back(static_cast<char>(r.level));
    before = r.end;
  }
  if (doses) key.append(2, '\0');
  return key;
}

/// To what is left alone a feature has no edge, and none of a height.
void forget_heights_beside(const std::vector<LeftAloneRun>& left, std::vector<CoverageRun>& runs) {
  for (CoverageRun& run : runs) {
    for (const LeftAloneRun& l : left) {
      if (l.end == run.first) run.upper_height = 0;
      if (l.first == run.end) run.lower_height = 0;
    }
  }
}

/// Where the levels of a column change, from the last slice on.
std::string changes_of(const std::vector<Level>& levels, int slices) {
  std::string bytes;
  Level before = 0;
  int last = slices;
  for (int n = slices; n-- > 0;) {
    const Level level = levels[static_cast<std::size_t>(n)];
    if (level == before) continue;
    put(bytes, static_cast<std::uint32_t>(last - n));
    bytes.push_back(static_cast<char>(level));
    before = level;
    last = n;
  }
  return bytes;
}

/// Sorts by keys below `keys`; what has the same key stays in its order.
template <class T, class Key>
void sort_by(std::vector<T>& values, std::size_t keys, const Key& key) {
  std::vector<std::size_t> next(keys + 1, 0);
  for (const T& value : values) ++next[key(value) + 1];
  for (std::size_t k = 0; k < keys; ++k) next[k + 1] += next[k];
  std::vector<T> sorted(values.size());
  for (const T& value : values) sorted[next[key(value)]++] = value;
  values = std::move(sorted);
}

}  // namespace

std::uint8_t taken_height(const ColumnFacts& facts, std::uint8_t height) {
  if (height == 0) return 0;
  const double below =
      std::round(edge_height_slices(height) * facts.height_steps) / facts.height_steps;
  return below == 0 ? std::uint8_t{0} : edge_height_byte(below);
}

int move_to_begin(const ColumnFacts& facts, std::vector<CoverageRun>& runs) {
  if (facts.begin_at == 0 || runs.empty() || runs.front().first <= facts.begin_at ||
      runs.back().end + facts.clear_after > facts.all_layers) {
    return 0;
  }
  const int by = runs.front().first - facts.begin_at;
  for (CoverageRun& run : runs) {
    run.first -= by;
    run.end -= by;
  }
  return by;
}

ColumnBand::ColumnBand(std::unique_ptr<ColumnSolver> solver, const ColumnFacts& facts,
                       std::size_t columns)
    : solver_(std::move(solver)),
      facts_(facts),
      columns_(columns),
      coded_(columns),
      before_(columns, 0),
      last_heights_(columns, 0) {}

void ColumnBand::add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                           const std::uint8_t* left_alone) {
  if (layers_ == facts_.layers && !coverage) {
    if (!heights || facts_.lower_at_window) return;
    for (std::size_t i = 0; i < columns_; ++i) last_heights_[i] = taken_height(facts_, heights[i]);
    return;
  }
  if (layers_ >= facts_.layers) throw Error("more layers than the plan has");
  coded_.append(coverage);
  if (left_alone) left_before_.resize(columns_, -1);
  for (std::size_t i = 0; i < left_before_.size(); ++i) {
    const bool left = left_alone && left_alone[i] != 0;
    const int level = left ? level_of_pixel(left_alone[i], facts_.levels) : -1;
    if (level == left_before_[i]) continue;
    left_changes_.push_back({static_cast<std::uint32_t>(i), layers_,
                             static_cast<std::uint8_t>(std::max(level, 0)),
                             static_cast<std::uint8_t>(left)});
    left_before_[i] = static_cast<std::int16_t>(level);
  }
  for (std::size_t i = 0; i < columns_; ++i) {
    const bool left = left_alone && left_alone[i] != 0;
    const std::uint8_t value = coverage && !left ? coverage[i] : std::uint8_t{0};
    if (value == before_[i]) continue;
    // Layer by layer, lower edges lie at the window.
    const bool taken = heights && (value != 0 || !facts_.lower_at_window);
    const std::uint8_t height = taken ? taken_height(facts_, heights[i]) : std::uint8_t{0};
    changes_.push_back({static_cast<std::uint32_t>(i), layers_, value, height});
    before_[i] = value;
  }
  ++layers_;
}

void ColumnBand::keep_light(BandCorrector::ColumnLevels most) {
  if (!facts_.keeps_caps) BandSolver::keep_light(most);
  most_ = std::move(most);
}

void ColumnBand::solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) {
  if (layers_ != facts_.layers) throw Error("the plan has more layers");
  solve_columns();
  show(sink);
}

std::string ColumnBand::answer_of(const std::string& key, const std::vector<CoverageRun>& runs,
                                  const ColumnBounds& bounds) {
  if (runs.empty()) return changes_of(bounds.floors, facts_.all_layers);
  std::string answer;
  if (facts_.solved && facts_.solved->find(key, answer)) return answer;
  answer = changes_of(solver_->solve(runs, bounds), facts_.all_layers);
  if (facts_.solved) facts_.solved->keep(key, answer);
  return answer;
}

void ColumnBand::find_next(Shown& shown) const {
  const std::string& answer = answers_[shown.answer];
  std::size_t at = shown.at;
  shown.next = at < answer.size() ? shown.next - static_cast<std::int32_t>(take(answer, at)) : -1;
  shown.at = static_cast<std::uint32_t>(at);
}

void ColumnBand::add_answer(std::uint32_t column, int moved, std::string answer) {
  if (answer.empty()) return;
  if (answers_.empty() || answers_.back() != answer) answers_.push_back(std::move(answer));
  Shown shown{column, static_cast<std::uint32_t>(answers_.size() - 1), facts_.all_layers + moved};
  find_next(shown);
  shown_.push_back(shown);
}

void ColumnBand::solve_columns() {
  // By column; within a column they stay in the order of layers.
  const auto column_of = [](const Change& c) { return static_cast<std::size_t>(c.column); };
  sort_by(changes_, columns_, column_of);
  sort_by(left_changes_, columns_, column_of);
  std::vector<CoverageRun> runs;
  ColumnBounds bounds;
  read_doses();
  for (std::size_t i = 0, left = 0; i < changes_.size() || left < left_changes_.size();) {
    std::uint32_t column = i < changes_.size() ? changes_[i].column : left_changes_[left].column;
    if (left < left_changes_.size()) column = std::min(column, left_changes_[left].column);
    i = read_runs(i, column, runs);
    read_left_alone(column, left, bounds);
    forget_heights_beside(bounds.left_alone, runs);
    const bool bounded = most_ || doses_ || !bounds.left_alone.empty();
    const int moved = bounded ? 0 : move_to_begin(facts_, runs);
    std::string key = key_of(runs, bounds.left_alone, doses_.has_value());
    if (doses_) read_wanted(column, runs, bounds, key);
    if (most_) {
      bounds.caps.resize(static_cast<std::size_t>(facts_.all_layers));
      most_(column, bounds.caps.data());
      key.append(bounds.caps.begin(), bounds.caps.end());
    }
    // Of columns that are alike, as neighbours often are, one is solved.
    add_answer(column, moved, answer_of(key, runs, bounds));
  }
  release(changes_);
  release(left_changes_);
}

/// The runs of a column, whose changes begin at `i`, if it has any; returns where those of the next begin.
std::size_t ColumnBand::read_runs(std::size_t i, std::uint32_t column,
                                  std::vector<CoverageRun>& runs) const {
  runs.clear();
  for (; i < changes_.size() && changes_[i].column == column; ++i) {
    const bool more = i + 1 < changes_.size() && changes_[i + 1].column == column;
    if (changes_[i].value == 0) continue;
    runs.push_back({changes_[i].at, more ? changes_[i + 1].at : facts_.layers, changes_[i].value,
                    changes_[i].height, more ? changes_[i + 1].height : last_heights_[column]});
  }
  return i;
}

void ColumnBand::read_doses() {
  if (!doses_) return;
  std::vector<std::uint8_t> row(columns_), before(columns_, 0);
  for (int n = 0; n < facts_.layers; ++n) {
    doses_->read(n, row.data());
    for (std::size_t i = 0; i < columns_; ++i) {
      if (row[i] == before[i]) continue;
      dose_changes_.push_back({static_cast<std::uint32_t>(i), n, row[i]});
      before[i] = row[i];
    }
  }
  sort_by(dose_changes_, columns_,
          [](const Change& c) { return static_cast<std::size_t>(c.column); });
}

void ColumnBand::read_wanted(std::uint32_t column, const std::vector<CoverageRun>& runs,
                             ColumnBounds& bounds, std::string& key) {
  const std::vector<Change>& doses = dose_changes_;
  std::size_t& i = next_dose_;
  while (i < doses.size() && doses[i].column < column) ++i;
  const DoseScale& scale = *doses_->scale;
  bounds.side = scale.side;
  key.push_back(static_cast<char>(scale.side));
  bounds.wanted.assign(static_cast<std::size_t>(facts_.layers), 1.0);
  std::uint8_t byte = 0;
  std::optional<std::uint8_t> told;
  std::int32_t told_at = 0;
  bool any = false;
  for (const CoverageRun& run : runs) {
    if (run.coverage != kFull) continue;
    for (std::int32_t n = run.first; n < run.end; ++n) {
      for (; i < doses.size() && doses[i].column == column && doses[i].at <= n; ++i) {
        byte = doses[i].value;
      }
      bounds.wanted[static_cast<std::size_t>(n)] = scale.dose[byte];
      any = any || scale.dose[byte] > 1;
      if (byte == told) continue;
      put(key, static_cast<std::uint32_t>(n - told_at));
      const auto bits = std::bit_cast<std::array<char, sizeof(double)>>(scale.dose[byte]);
      key.append(bits.begin(), bits.end());
      told = byte;
      told_at = n;
    }
  }
  // Nothing more than enough: as without.
  if (!any && !facts_.wants_ones) bounds.wanted.clear();
}

void ColumnBand::read_left_alone(std::uint32_t column, std::size_t& i, ColumnBounds& bounds) const {
  bounds = {};
  for (; i < left_changes_.size() && left_changes_[i].column == column; ++i) {
    const Change& change = left_changes_[i];
    if (change.height == 0) continue;
    const bool more = i + 1 < left_changes_.size() && left_changes_[i + 1].column == column;
    const int end = more ? left_changes_[i + 1].at : facts_.layers;
    bounds.left_alone.push_back({change.at, std::min(end, facts_.all_layers), change.value});
  }
  if (bounds.left_alone.empty()) return;
  bounds.floors.assign(static_cast<std::size_t>(facts_.all_layers), 0);
  bounds.caps.assign(bounds.floors.size(), std::numeric_limits<Level>::max());
  for (const LeftAloneRun& run : bounds.left_alone) {
    std::fill(bounds.floors.begin() + run.first, bounds.floors.begin() + run.end, run.level);
    std::fill(bounds.caps.begin() + run.first, bounds.caps.begin() + run.end, run.level);
  }
}

/// Gives the slices to the sink, from the last to the first.
void ColumnBand::show(const BandCorrector::Sink& sink) {
  std::vector<std::uint8_t> now(columns_, 0), coverage(columns_);
  // Who changes at a slice: the first of them, and who of them comes after whom; -1: nobody.
  std::vector<std::int32_t> first(static_cast<std::size_t>(facts_.all_layers), -1);
  std::vector<std::int32_t> after(shown_.size());
  const auto await = [&](std::size_t i) {
    const std::int32_t next = shown_[i].next;
    if (next < 0 || next >= facts_.all_layers) return;
    after[i] = std::exchange(first[static_cast<std::size_t>(next)], static_cast<std::int32_t>(i));
  };
  for (std::size_t i = 0; i < shown_.size(); ++i) await(i);
  std::size_t lit = 0;
  for (int n = facts_.all_layers; n-- > 0;) {
    for (std::int32_t who = first[static_cast<std::size_t>(n)]; who >= 0;) {
      const auto i = static_cast<std::size_t>(who);
      Shown& shown = shown_[i];
      std::uint8_t& level = now[shown.column];
      lit += static_cast<std::size_t>(level == 0);
      level = static_cast<std::uint8_t>(answers_[shown.answer][shown.at++]);
      lit -= static_cast<std::size_t>(level == 0);
      find_next(shown);
      who = after[i];
      await(i);
    }
    coded_.read(n, coverage.data());
    sink(n, now.data(), coverage.data(), lit == 0 && (n >= facts_.layers || coded_.black(n)));
  }
}

std::vector<CoverageRun> runs_of(const ColumnFacts& facts,
                                 const std::vector<std::uint8_t>& coverage,
                                 const std::vector<std::uint8_t>& heights) {
  const auto height = [&](std::size_t node) {
    return node < heights.size() ? taken_height(facts, heights[node]) : std::uint8_t{0};
  };
  std::vector<CoverageRun> runs;
  for (std::size_t n = 0; n < coverage.size(); ++n) {
    if (coverage[n] == 0) continue;
    const auto at = static_cast<std::int32_t>(n);
    if (!runs.empty() && runs.back().end == at && runs.back().coverage == coverage[n]) {
      ++runs.back().end;
    } else {
      runs.push_back({at, at + 1, coverage[n], height(n), 0});
    }
    // Layer by layer, lower edges lie at the window.
    runs.back().lower_height = facts.lower_at_window ? std::uint8_t{0} : height(n + 1);
  }
  return runs;
}

std::vector<std::uint8_t> solve_alone(ColumnSolver& solver, const ColumnFacts& facts,
                                      const std::vector<std::uint8_t>& coverage,
                                      const std::vector<std::uint8_t>& heights) {
  std::vector<CoverageRun> runs = runs_of(facts, coverage, heights);
  const int moved = move_to_begin(facts, runs);
  const std::vector<Level>& levels = solver.solve(runs, {});
  std::vector<std::uint8_t> own(static_cast<std::size_t>(facts.all_layers), 0);
  std::copy_n(levels.begin(), facts.all_layers - moved, own.begin() + moved);
  return own;
}

}  // namespace slicecorr::detail
