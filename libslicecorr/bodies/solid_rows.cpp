// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/solid_rows.hpp"

#include <algorithm>
#include <tuple>
#include <utility>

namespace slicecorr::detail {

SolidRows::SolidRows(int rows, BodyListener& listener)
    : listener_(listener),
      rows_(static_cast<std::size_t>(rows)),
      changed_(static_cast<std::size_t>(rows), 0),
      buckets_(1) {}

SolidRows::Label SolidRows::root(Label label) {
  while (parent_[label] != label) {
    parent_[label] = parent_[parent_[label]];
    label = parent_[label];
  }
  return label;
}

SolidRows::Bucket& SolidRows::at(int slice) {
  const auto ahead = static_cast<std::size_t>(slice - slice_);
  if (ahead >= buckets_.size()) {
    std::vector<Bucket> more(2 * ahead);
    std::size_t size = 1;
    while (size <= ahead) size *= 2;
    more.resize(size);
    for (std::size_t k = 0; k < buckets_.size(); ++k) {
      const auto n = static_cast<std::size_t>(slice_) + k;
      more[n & (size - 1)] = std::move(buckets_[n & (buckets_.size() - 1)]);
    }
    buckets_ = std::move(more);
  }
  return buckets_[static_cast<std::size_t>(slice) & (buckets_.size() - 1)];
}

SolidRows::Label SolidRows::add_body(int row, const Run& run) {
  const auto label = static_cast<Label>(parent_.size());
  std::uint32_t at_hand = 0;
  if (free_.empty()) {
    at_hand = static_cast<std::uint32_t>(bodies_.size());
    bodies_.emplace_back();
  } else {
    at_hand = free_.back();
    free_.pop_back();
    bodies_[at_hand] = {};
  }
  GrowingBody& made = bodies_[at_hand];
  made.first = made.counted = slice_ + run.delay;
  made.low = {slice_, row, run.begin};
  made.anchored = slice_ == 0;
  parent_.push_back(label);
  body_of_.push_back(at_hand);
  return label;
}

void SolidRows::count(GrowingBody& b) const {
  const int slices = slice_ - b.counted;
  if (slices <= 0) return;
  b.counted = slice_;
  b.voxels += b.area * static_cast<std::uint64_t>(slices);
  b.column2 += static_cast<__int128>(b.area_column2) * slices;
  b.row2 += static_cast<__int128>(b.area_row2) * slices;
}

GrowingBody& SolidRows::change(Label label) {
  GrowingBody& b = body(label);
  count(b);
  if (b.touched != slice_) {
    b.touched = slice_;
    touched_.push_back(label);
  }
  return b;
}

bool SolidRows::older(const GrowingBody& a, const GrowingBody& b) const {
  if (a.anchored != b.anchored) return a.anchored;
  return std::tie(a.first, a.low) < std::tie(b.first, b.low);
}

void SolidRows::unite(Label a, Label b) {
  a = root(a);
  b = root(b);
  if (a == b) return;
  if (older(body(b), body(a))) std::swap(a, b);
  GrowingBody &stays = change(a), &goes = change(b);
  listener_.join(stays, goes, slice_);
  // Apart until the slice is done: no figure depends on the order in which bodies join.
  stays.joined_voxels += goes.voxels + goes.joined_voxels;
  stays.joined_column2 += goes.column2 + goes.joined_column2;
  stays.joined_row2 += goes.row2 + goes.joined_row2;
  stays.joined_low = std::min({stays.joined_low, goes.low, goes.joined_low});
  stays.area += goes.area;
  stays.area_column2 += goes.area_column2;
  stays.area_row2 += goes.area_row2;
  parent_[b] = a;
  free_.push_back(body_of_[b]);
}

void SolidRows::grow(const Change& run, int sign) {
  GrowingBody& b = change(root(run.label));
  const std::int64_t begin = run.begin, end = run.end;
  b.area += static_cast<std::uint64_t>(sign * (end - begin));
  b.area_column2 += sign * (end * end - begin * begin);
  b.area_row2 += sign * (end - begin) * (2 * run.row + 1);
}

void SolidRows::join(const Labelled& a, const Labelled& b, int slice) {
  if (root(a.label) == root(b.label)) return;
  at(slice).edges.push_back({a.label, b.label});
  ++waiting_;
}

void SolidRows::set_row(int y, std::span<const Run> runs) {
  Row& row = rows_[static_cast<std::size_t>(y)];
  next_.clear();
  std::size_t old = 0;  // the first that does not end before the run at hand
  const auto leave = [&](const Labelled& run) {
    at(slice_ + run.delay).ends.push_back({run.label, y, run.begin, run.end});
    ++waiting_;
  };
  // A run of the slice before that is none of this one is left once; `left`: all before it were looked
  // at.
  std::size_t left = 0;
  for (const Run& run : runs) {
    while (old < row.size() && row[old].end <= run.begin) ++old;
    if (old < row.size() && row[old].same(run)) {
      for (; left < old; ++left) leave(row[left]);
      left = old + 1;
      next_.push_back(row[old]);
    } else {
      const Labelled made{run.begin, run.end, run.delay, add_body(y, run)};
      at(slice_ + run.delay).begins.push_back({made.label, y, run.begin, run.end});
      ++waiting_;
      for (std::size_t k = old; k < row.size() && row[k].begin < run.end; ++k) {
        join(made, row[k], std::max(slice_ + run.delay, slice_ - 1 + row[k].delay));
      }
      next_.push_back(made);
    }
    if (next_.size() > 1) {
      const Labelled &before = next_[next_.size() - 2], &last = next_.back();
      if (before.end == last.begin) join(before, last, slice_ + std::max(before.delay, last.delay));
    }
  }
  for (; left < row.size(); ++left) leave(row[left]);
  runs_ += next_.size();
  runs_ -= row.size();
  row.swap(next_);
  if (!changed_[static_cast<std::size_t>(y)]) {
    changed_[static_cast<std::size_t>(y)] = 1;
    changed_rows_.push_back(y);
  }
}

void SolidRows::join_rows(int a, int b) {
  if (a < 0 || b < 0 || std::max(a, b) >= static_cast<int>(rows_.size())) return;
  const Row &upper = rows_[static_cast<std::size_t>(a)],
            &lower = rows_[static_cast<std::size_t>(b)];
  std::size_t i = 0, j = 0;
  while (i < upper.size() && j < lower.size()) {
    const Labelled &u = upper[i], &l = lower[j];
    if (u.begin < l.end && l.begin < u.end) join(u, l, slice_ + std::max(u.delay, l.delay));
    if (u.end < l.end) {
      ++i;
    } else {
      ++j;
    }
  }
}

void SolidRows::pass_slice() {
  Bucket& now = at(slice_);
  waiting_ -= now.begins.size() + now.ends.size() + now.edges.size();
  for (const Change& run : now.begins) grow(run, 1);
  for (const Change& run : now.ends) grow(run, -1);
  for (const Edge& edge : now.edges) unite(edge.a, edge.b);
  now.begins.clear();
  now.ends.clear();
  now.edges.clear();
  for (const Label label : touched_) {
    if (parent_[label] != label) continue;  // its root was touched, too
    GrowingBody& b = body(label);
    b.voxels += std::exchange(b.joined_voxels, 0);
    b.column2 += std::exchange(b.joined_column2, 0);
    b.row2 += std::exchange(b.joined_row2, 0);
    b.low = std::min(b.low, std::exchange(b.joined_low, {}));
    b.told = b.told || !b.anchored;
  }
  touched_.clear();
  ++slice_;
}

void SolidRows::end_slice(int more) {
  // Rows from the top down, whatever the order in which they came: no figure depends on it.
  std::sort(changed_rows_.begin(), changed_rows_.end());
  for (const int y : changed_rows_) {
    join_rows(y - 1, y);
    const auto below = static_cast<std::size_t>(y) + 1;
    if (below < changed_.size() && !changed_[below]) join_rows(y, y + 1);
  }
  for (const int y : changed_rows_) changed_[static_cast<std::size_t>(y)] = 0;
  changed_rows_.clear();
  pass_slice();
  for (; more > 0 && waiting_ > 0; --more) pass_slice();
  slice_ += more;
  if (parent_.size() > 2 * (runs_ + 2 * waiting_) + 65536) renumber();
}

/// Labels of bodies that no run has any more, in no bucket either, make room: nothing joins them.
void SolidRows::renumber() {
  std::vector<Label> to(parent_.size(), kNone);
  std::vector<std::uint32_t> body_of;
  const auto keep = [&](Label& label) {
    const Label r = root(label);
    if (to[r] == kNone) {
      to[r] = static_cast<Label>(body_of.size());
      body_of.push_back(body_of_[r]);
    }
    label = to[r];
  };
  for (Row& row : rows_) {
    for (Labelled& run : row) keep(run.label);
  }
  for (Bucket& bucket : buckets_) {
    for (Change& run : bucket.begins) keep(run.label);
    for (Change& run : bucket.ends) keep(run.label);
    for (Edge& edge : bucket.edges) {
      keep(edge.a);
      keep(edge.b);
    }
  }
  for (Label label = 0; label < parent_.size(); ++label) {
    if (parent_[label] != label || to[label] != kNone) continue;
    GrowingBody& b = body(label);
    count(b);
    listener_.end(b, slice_, false);
    free_.push_back(body_of_[label]);
  }
  parent_.resize(body_of.size());
  for (std::size_t i = 0; i < parent_.size(); ++i) parent_[i] = static_cast<Label>(i);
  body_of_ = std::move(body_of);
}

void SolidRows::finish() {
  // What has not gelled yet does so before anything is judged.
  for (int y = 0; y < static_cast<int>(rows_.size()); ++y) {
    if (!rows_[static_cast<std::size_t>(y)].empty()) set_row(y, {});
  }
  for (const int y : changed_rows_) changed_[static_cast<std::size_t>(y)] = 0;
  changed_rows_.clear();
  while (waiting_ > 0) pass_slice();
  renumber();
}

}  // namespace slicecorr::detail
