// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/solid_strips.hpp"

#include <algorithm>

#include "bodies/neighbour_rows.hpp"

namespace slicecorr::detail {

namespace {

/// So many labels more than are in use are no reason to make room.
constexpr std::size_t kSpareLabels = 16384;

}  // namespace

SolidStrips::SolidStrips(std::span<const int> ends, int step, BodyListener& listener)
    : step_(step), bodies_(listener), ends_(ends.begin(), ends.end()) {
  int first = 0;
  strips_.reserve(ends.size());
  for (const int end : ends) {
    strips_.emplace_back(first, end - first, step);
    first = end;
  }
  borders_.resize(strips_.empty() ? 0 : strips_.size() - 1);
}

void SolidStrips::join(std::size_t border, const SolidRows::Row& made, const SolidRows::Row& beside,
                       bool made_above, int slice) {
  SolidLabels &above = strips_[border].labels(), &below = strips_[border + 1].labels();
  each_overlap(made, beside, [&](const SolidRows::Labelled& m, const SolidRows::Labelled& b) {
    Label upper = made_above ? m.label : b.label, lower = made_above ? b.label : m.label;
    upper = above.root(upper);
    lower = below.root(lower);
    const Label a = above.body(upper), c = below.body(lower);
    if (a != SolidLabels::kNone && c != SolidLabels::kNone && bodies_.root(a) == bodies_.root(c)) {
      return;
    }
    const int gels = std::max(m.gels.of(slice), b.gels.of(slice)) / step_;
    borders_[border].joins[std::max(gels, bodies_.slice())].push_back({upper, lower});
  });
}

void SolidStrips::join_borders() {
  for (std::size_t i = 0; i < borders_.size(); ++i) {
    std::vector<SolidRows::Edging>&upper = strips_[i].lower(), &lower = strips_[i + 1].upper();
    for (std::size_t u = 0, l = 0; u < upper.size() || l < lower.size();) {
      const int slice = u == upper.size()   ? lower[l].slice
                        : l == lower.size() ? upper[u].slice
                                            : std::min(upper[u].slice, lower[l].slice);
      SolidRows::Edging* const above =
          u < upper.size() && upper[u].slice == slice ? &upper[u++] : nullptr;
      SolidRows::Edging* const below =
          l < lower.size() && lower[l].slice == slice ? &lower[l++] : nullptr;
      if (above) borders_[i].upper.swap(above->row);
      if (below) borders_[i].lower.swap(below->row);
      if (above) join(i, above->made, borders_[i].lower, true, slice);
      if (below) join(i, below->made, borders_[i].upper, false, slice);
    }
  }
  for (SolidRows& s : strips_) {
    s.upper().clear();
    s.lower().clear();
  }
}

bool SolidStrips::waits() const {
  return std::ranges::any_of(strips_, [](const SolidRows& s) { return s.waits(); }) ||
         std::ranges::any_of(borders_, [](const Border& b) { return !b.joins.empty(); });
}

void SolidStrips::pass_step() {
  // No figure depends on the order in which bodies join within a step, once what gelled before it counts.
  for (SolidRows& s : strips_) s.gel_step(bodies_);
  for (SolidRows& s : strips_) s.join_step(bodies_);
  for (std::size_t i = 0; i < borders_.size(); ++i) {
    auto& joins = borders_[i].joins;
    const auto now = joins.find(bodies_.slice());
    if (now == joins.end()) continue;
    SolidLabels &above = strips_[i].labels(), &below = strips_[i + 1].labels();
    for (const auto& [upper, lower] : now->second) {
      Label& a = above.body(above.root(upper));
      Label& b = below.body(below.root(lower));
      a = b = bodies_.unite(a, b);
    }
    joins.erase(now);
  }
  bodies_.end_slice(false);
}

void SolidStrips::pass(int slices) {
  join_borders();
  int steps = slices / step_ - bodies_.slice();
  for (; steps > 0 && waits(); --steps) pass_step();
  if (steps > 0) {
    bodies_.skip(steps);
    for (SolidRows& s : strips_) s.skip(steps);
  }
  renumber();
}

void SolidStrips::change_row(int y, std::span<const SolidRows::Change> changes) {
  const auto i = static_cast<std::size_t>(std::ranges::upper_bound(ends_, y) - ends_.begin());
  strips_[i].change_row(i > 0 ? y - ends_[i - 1] : y, changes);
}

void SolidStrips::end_slice(int more) {
  for (SolidRows& s : strips_) {
    s.end_slice(more);
    s.make_room();
  }
  slices_ += 1 + more;
  pass(slices_);
}

void SolidStrips::renumber() {
  std::size_t labels = 0;
  for (std::size_t i = 0; i < strips_.size(); ++i) {
    SolidRows& strip = strips_[i];
    if (strip.labels().many(strip.labelled())) {
      strip.labels().renumber([&](const auto& keep) {
        strip.keep_labels(keep);
        if (i > 0) {
          for (auto& [step, joins] : borders_[i - 1].joins) {
            for (auto& join : joins) keep(join.second);
          }
          for (auto& run : borders_[i - 1].lower) keep(run.label);
        }
        if (i < borders_.size()) {
          for (auto& [step, joins] : borders_[i].joins) {
            for (auto& join : joins) keep(join.first);
          }
          for (auto& run : borders_[i].upper) keep(run.label);
        }
      });
    }
    labels += strip.labels().size();
  }
  if (bodies_.size() <= 2 * labels + kSpareLabels) return;
  bodies_.renumber([&](const auto& keep) {
    for (SolidRows& s : strips_) s.labels().each_body(keep);
  });
}

void SolidStrips::finish() {
  join_borders();
  for (SolidRows& s : strips_) s.end();
  while (waits()) pass_step();
  bodies_.finish();
}

}  // namespace slicecorr::detail
