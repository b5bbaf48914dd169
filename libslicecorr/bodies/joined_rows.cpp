// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/joined_rows.hpp"

#include <algorithm>
#include <utility>

namespace slicecorr::detail {

namespace {

/// The greater of two areas; of equals that of the earlier slice.
void widen(std::uint64_t& widest, int& slice, std::uint64_t area, int its_slice) {
  if (area < widest || (area == widest && its_slice >= slice)) return;
  widest = area;
  slice = its_slice;
}

}  // namespace

JoinedRows::JoinedRows(int rows, int first, int past, BodyListener& listener)
    : first_(first),
      past_(past),
      listener_(listener),
      rows_(static_cast<std::size_t>(rows)),
      changed_(static_cast<std::size_t>(rows), 0) {
  // Outside is there before the first slice.
  const Label anchor = add_body(0, first);
  body(anchor).anchored = true;
  for (int y = 0; y < rows; ++y) {
    rows_[static_cast<std::size_t>(y)].push_back({first, past, anchor});
    enter({first, past, anchor}, y);
  }
  runs_ = rows_.size();
}

JoinedRows::Label JoinedRows::root(Label label) {
  while (parent_[label] != label) {
    parent_[label] = parent_[parent_[label]];
    label = parent_[label];
  }
  return label;
}

JoinedRows::Label JoinedRows::add_body(int row, int column) {
  const auto label = static_cast<Label>(parent_.size());
  std::uint32_t at = 0;
  if (free_.empty()) {
    at = static_cast<std::uint32_t>(bodies_.size());
    bodies_.emplace_back();
  } else {
    at = free_.back();
    free_.pop_back();
    bodies_[at] = {};
  }
  GrowingBody& made = bodies_[at];
  made.first = made.counted = slice_;
  made.x = column;
  made.y = row;
  parent_.push_back(label);
  body_of_.push_back(at);
  return label;
}

void JoinedRows::count(GrowingBody& b) const {
  const int slices = slice_ - b.counted;
  if (slices == 0) return;
  b.counted = slice_;
  b.voxels += b.area * static_cast<std::uint64_t>(slices);
  b.column2 += static_cast<__int128>(b.area_column2) * slices;
  b.row2 += static_cast<__int128>(b.area_row2) * slices;
}

GrowingBody& JoinedRows::change(Label label) {
  GrowingBody& b = body(label);
  count(b);
  if (b.touched != slice_) {
    b.touched = slice_;
    touched_.push_back(label);
  }
  return b;
}

bool JoinedRows::older(const GrowingBody& a, const GrowingBody& b) const {
  if (a.anchored != b.anchored) return a.anchored;
  if (a.first != b.first) return a.first < b.first;
  return a.y != b.y ? a.y < b.y : a.x < b.x;
}

JoinedRows::Label JoinedRows::unite(Label a, Label b) {
  a = root(a);
  b = root(b);
  if (a == b) return a;
  if (older(body(b), body(a))) std::swap(a, b);
  GrowingBody &stays = change(a), &goes = change(b);
  listener_.join(stays, goes, slice_);
  // Apart until the slice is done: no figure depends on the order in which bodies join.
  stays.joined_voxels += goes.voxels + goes.joined_voxels;
  stays.joined_column2 += goes.column2 + goes.joined_column2;
  stays.joined_row2 += goes.row2 + goes.joined_row2;
  stays.area += goes.area;
  stays.area_column2 += goes.area_column2;
  stays.area_row2 += goes.area_row2;
  widen(stays.joined_widest, stays.joined_widest_slice, goes.widest, goes.widest_slice);
  widen(stays.joined_widest, stays.joined_widest_slice, goes.joined_widest,
        goes.joined_widest_slice);
  parent_[b] = a;
  free_.push_back(body_of_[b]);
  return a;
}

void JoinedRows::leave(const Labelled& run, int row) {
  GrowingBody& b = change(root(run.label));
  const std::int64_t begin = run.begin, end = run.end;
  b.area -= static_cast<std::uint64_t>(end - begin);
  b.area_column2 -= end * end - begin * begin;
  b.area_row2 -= (end - begin) * (2 * row + 1);
}

void JoinedRows::enter(const Labelled& run, int row) {
  GrowingBody& b = change(root(run.label));
  const std::int64_t begin = run.begin, end = run.end;
  b.area += static_cast<std::uint64_t>(end - begin);
  b.area_column2 += end * end - begin * begin;
  b.area_row2 += (end - begin) * (2 * row + 1);
}

void JoinedRows::set_row(int y, std::span<const Run> runs) {
  Row& row = rows_[static_cast<std::size_t>(y)];
  next_.clear();
  const bool beside_outside = y == 0 || y + 1 == static_cast<int>(rows_.size());
  const bool hangs = slice_ > 0;  // on the slice before
  std::size_t at = 0;
  for (const Run& run : runs) {
    while (at < row.size() && row[at].end <= run.begin) leave(row[at++], y);
    Labelled made{run.begin, run.end, kNone};
    const bool same = at < row.size() && row[at].begin == run.begin && row[at].end == run.end;
    if (hangs) {
      for (std::size_t k = at; k < row.size() && row[k].begin < run.end; ++k) {
        made.label = made.label == kNone ? row[k].label : unite(made.label, row[k].label);
      }
    }
    if (beside_outside || run.begin == first_ || run.end == past_) {
      made.label = made.label == kNone ? kAnchor : unite(made.label, kAnchor);
    }
    if (same && hangs) {
      ++at;
    } else {
      if (made.label == kNone) made.label = add_body(y, run.begin);
      enter(made, y);
    }
    next_.push_back(made);
  }
  while (at < row.size()) leave(row[at++], y);
  runs_ += next_.size();
  runs_ -= row.size();
  row.swap(next_);
  if (!changed_[static_cast<std::size_t>(y)]) {
    changed_[static_cast<std::size_t>(y)] = 1;
    changed_rows_.push_back(y);
  }
}

void JoinedRows::join_rows(int a, int b) {
  if (a < 0 || b < 0 || std::max(a, b) >= static_cast<int>(rows_.size())) return;
  Row &upper = rows_[static_cast<std::size_t>(a)], &lower = rows_[static_cast<std::size_t>(b)];
  std::size_t i = 0, j = 0;
  while (i < upper.size() && j < lower.size()) {
    Labelled &u = upper[i], &l = lower[j];
    if (u.begin < l.end && l.begin < u.end && u.label != l.label) {
      u.label = l.label = unite(u.label, l.label);
    }
    if (u.end < l.end) {
      ++i;
    } else {
      ++j;
    }
  }
}

void JoinedRows::end_slice(int more) {
  // Rows from the top down, whatever the order in which they came: no figure depends on it.
  std::sort(changed_rows_.begin(), changed_rows_.end());
  for (const int y : changed_rows_) {
    join_rows(y - 1, y);
    const auto below = static_cast<std::size_t>(y) + 1;
    if (below < changed_.size() && !changed_[below]) join_rows(y, y + 1);
  }
  for (const int y : changed_rows_) changed_[static_cast<std::size_t>(y)] = 0;
  changed_rows_.clear();
  for (const Label label : touched_) {
    if (parent_[label] != label) continue;  // its root was touched, too
    GrowingBody& b = body(label);
    b.voxels += std::exchange(b.joined_voxels, 0);
    b.column2 += std::exchange(b.joined_column2, 0);
    b.row2 += std::exchange(b.joined_row2, 0);
    widen(b.widest, b.widest_slice, std::exchange(b.joined_widest, 0), b.joined_widest_slice);
    widen(b.widest, b.widest_slice, b.area, slice_);
    b.told = b.told || !b.anchored;
    listener_.end_slice(b);
    if (b.area > 0) continue;
    listener_.end(b, slice_, false);
    free_.push_back(body_of_[label]);  // no run has its label any more
  }
  touched_.clear();
  slice_ += 1 + more;
  if (parent_.size() > 2 * runs_ + 65536) renumber();
}

/// Labels that no run has any more make room.
void JoinedRows::renumber() {
  std::vector<Label> to(parent_.size(), kNone);
  std::vector<std::uint32_t> body_of;
  to[kAnchor] = 0;
  body_of.push_back(body_of_[kAnchor]);
  for (Row& row : rows_) {
    for (Labelled& run : row) {
      const Label r = root(run.label);
      if (to[r] == kNone) {
        to[r] = static_cast<Label>(body_of.size());
        body_of.push_back(body_of_[r]);
      }
      run.label = to[r];
    }
  }
  parent_.resize(body_of.size());
  for (std::size_t i = 0; i < parent_.size(); ++i) parent_[i] = static_cast<Label>(i);
  body_of_ = std::move(body_of);
}

void JoinedRows::finish() {
  renumber();
  for (std::size_t i = 0; i < body_of_.size(); ++i) {
    GrowingBody& b = bodies_[body_of_[i]];
    count(b);
    listener_.end(b, slice_, true);
  }
}

}  // namespace slicecorr::detail
