// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/solid_rows.hpp"

#include <algorithm>
#include <bit>
#include <utility>

namespace slicecorr::detail {

SolidRows::SolidRows(int rows, BodyListener& listener)
    : bodies_(listener), rows_(static_cast<std::size_t>(rows)), changed_(rows), buckets_(1) {}

SolidRows::Bucket& SolidRows::at(int n) {
  const auto ahead = static_cast<std::size_t>(n - slice());
  if (ahead >= buckets_.size()) {
    std::vector<Bucket> more(std::bit_ceil(ahead + 1));
    for (std::size_t k = 0; k < buckets_.size(); ++k) {
      const auto its = static_cast<std::size_t>(slice()) + k;
      more[its & (more.size() - 1)] = std::move(buckets_[its & (buckets_.size() - 1)]);
    }
    buckets_ = std::move(more);
  }
  return buckets_[static_cast<std::size_t>(n) & (buckets_.size() - 1)];
}

void SolidRows::join(const Labelled& a, const Labelled& b, int n) {
  if (bodies_.root(a.label) == bodies_.root(b.label)) return;
  at(n).edges.push_back({a.label, b.label});
  ++waiting_;
}

void SolidRows::set_row(int y, std::span<const Run> runs) {
  Row& row = rows_[static_cast<std::size_t>(y)];
  next_.clear();
  std::size_t old = 0;   // the first that does not end before the run at hand
  std::size_t left = 0;  // all before it go on in this slice, or were left
  const auto leave_before = [&](std::size_t past) {
    for (; left < past; ++left) {
      const Labelled& run = row[left];
      at(slice() + run.delay).ends.push_back({run.label, {y, run.begin, run.end}});
      ++waiting_;
    }
  };
  for (const Run& run : runs) {
    while (old < row.size() && row[old].end <= run.begin) ++old;
    if (old < row.size() && row[old].same(run)) {
      leave_before(old);
      left = old + 1;
      next_.push_back(row[old]);
    } else {
      Labelled made{run.begin, run.end, run.delay, 0};
      const GrowingBodies::Patch patch{y, run.begin, run.end};
      // What gels at once, on what has gelled, is more of its body: most runs are.
      std::size_t k = old;
      while (k < row.size() && row[k].begin < run.end && row[k].delay > 1) ++k;
      if (run.delay == 0 && k < row.size() && row[k].begin < run.end) {
        made.label = row[k].label;
        at(slice()).goes_on.push_back({made.label, patch});
      } else {
        made.label = bodies_.add_label();
        at(slice() + run.delay).begins.push_back({{made.label, patch}, slice()});
      }
      ++waiting_;
      for (k = old; k < row.size() && row[k].begin < run.end; ++k) {
        join(made, row[k], slice() + std::max(run.delay, row[k].delay - 1));
      }
      next_.push_back(made);
    }
    if (next_.size() > 1) {
      const Labelled &before = next_[next_.size() - 2], &last = next_.back();
      if (before.end == last.begin) {
        join(before, last, slice() + std::max(before.delay, last.delay));
      }
    }
  }
  leave_before(row.size());
  runs_ += next_.size();
  runs_ -= row.size();
  row.swap(next_);
  changed_.add(y);
}

void SolidRows::pass_slice() {
  Bucket& now = at(slice());
  waiting_ -= now.size();
  for (const Beginning& b : now.begins) {
    bodies_.begin(b.label, {b.slice, b.patch.row, b.patch.begin}, b.slice == 0);
    bodies_.grow(b.label, b.patch, 1);
  }
  for (const Change& c : now.goes_on) bodies_.grow(c.label, c.patch, 1);
  for (const Change& c : now.ends) bodies_.grow(c.label, c.patch, -1);
  for (const Edge& e : now.edges) bodies_.unite(e.a, e.b);
  // Not only cleared: many may wait for one slice, and few for all others.
  now = {};
  bodies_.end_slice(false);
}

void SolidRows::end_slice(int more) {
  changed_.take_neighbours([&](int upper, int lower) {
    each_overlap(rows_[static_cast<std::size_t>(upper)], rows_[static_cast<std::size_t>(lower)],
                 [&](const Labelled& u, const Labelled& l) {
                   join(u, l, slice() + std::max(u.delay, l.delay));
                 });
  });
  pass_slice();
  for (; more > 0 && waiting_ > 0; --more) pass_slice();
  bodies_.skip(more);
  if (bodies_.size() > 2 * (runs_ + 2 * waiting_) + 65536) renumber();
}

void SolidRows::renumber() {
  bodies_.renumber([&](const auto& keep) {
    for (Row& row : rows_) {
      for (Labelled& run : row) keep(run.label);
    }
    for (Bucket& bucket : buckets_) {
      for (Change& c : bucket.begins) keep(c.label);
      for (Change& c : bucket.goes_on) keep(c.label);
      for (Change& c : bucket.ends) keep(c.label);
      for (Edge& e : bucket.edges) {
        keep(e.a);
        keep(e.b);
      }
    }
  });
}

void SolidRows::finish() {
  // What has not gelled yet does so before anything is judged.
  for (int y = 0; y < static_cast<int>(rows_.size()); ++y) {
    if (!rows_[static_cast<std::size_t>(y)].empty()) set_row(y, {});
  }
  while (waiting_ > 0) pass_slice();
  bodies_.finish();
}

}  // namespace slicecorr::detail
