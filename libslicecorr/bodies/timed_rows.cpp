// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/timed_rows.hpp"

#include <algorithm>
#include <iterator>
#include <limits>
#include <tuple>

namespace slicecorr::detail {

namespace {

/// Ends that both have are none any more.
void flip_ends(const TimedRows::Ends& a, const TimedRows::Ends& b, TimedRows::Ends& to) {
  to.clear();
  std::ranges::set_symmetric_difference(a, b, std::back_inserter(to));
}

}  // namespace

void TimedRows::put_ends(std::span<const Run> runs) {
  put_in_.clear();
  for (const Run& run : runs) {
    const int begin = run.begin - box_.x0, end = run.end - box_.x0;
    if (!put_in_.empty() && put_in_.back() == begin) {
      put_in_.back() = end;
    } else {
      put_in_.insert(put_in_.end(), {begin, end});
    }
  }
}

void TimedRows::flip(int row, const Ends& its) {
  const auto at = static_cast<std::size_t>(row);
  if (flipped_.empty()) {
    flipped_.resize(static_cast<std::size_t>(box_.height()));
    if (keeps_solid_) solid_.resize(flipped_.size());
  }
  for (Ends* const to : {&flipped_[at], keeps_solid_ ? &solid_[at] : nullptr}) {
    if (!to) continue;
    if (to->empty()) {
      to->assign(its.begin(), its.end());
      continue;
    }
    flip_ends(*to, its, ends_);
    to->swap(ends_);
  }
  flipped_rows_.push_back(row);
}

void TimedRows::set_row(int y, std::span<const Run> runs) {
  const int row = y - box_.y0;
  put_ends(runs);
  if (!solid_.empty()) {
    flip_ends(solid_[static_cast<std::size_t>(row)], put_in_, ends_);
    put_in_.assign(ends_.begin(), ends_.end());
  }
  flip(row, put_in_);
  set_delays(y, runs);
}

void TimedRows::flip_row(int y, std::span<const Run> runs) {
  put_ends(runs);
  flip(y - box_.y0, put_in_);
}

void TimedRows::set_delays(int y, std::span<const Run> runs) {
  for (const Run& run : runs) {
    timed_.push_back(
        {y - box_.y0, run.begin - box_.x0, run.end - box_.x0,
         run.at_once ? GelTime::at_once(slice_ + run.delay) : GelTime::after(run.delay)});
  }
}

void TimedRows::sort() {
  std::sort(flipped_rows_.begin(), flipped_rows_.end());
  const auto place = [](const Timed& t) { return std::tie(t.row, t.begin); };
  const auto before = [&](const Timed& a, const Timed& b) { return place(a) < place(b); };
  if (!std::is_sorted(timed_.begin(), timed_.end(), before)) {
    std::sort(timed_.begin(), timed_.end(), before);
  }
}

int TimedRows::next_row(std::size_t flipped, std::size_t timed) const {
  constexpr int kNoRow = std::numeric_limits<int>::max();
  return std::min(flipped < flipped_rows_.size() ? flipped_rows_[flipped] : kNoRow,
                  timed < timed_.size() ? timed_[timed].row : kNoRow);
}

void TimedRows::put_changes(const Ends* flips, std::span<const Timed> timed) {
  constexpr int kNone = std::numeric_limits<int>::max();
  changes_.clear();
  const std::size_t count = flips ? flips->size() : 0;
  int x = std::numeric_limits<int>::min();
  for (std::size_t i = 0, k = 0; i < count || k < timed.size();) {
    const int flips_from = i < count ? std::max((*flips)[i], x) : kNone;
    const int timed_from = k < timed.size() ? std::max(timed[k].begin, x) : kNone;
    SolidRows::Change c;
    c.begin = std::min(flips_from, timed_from);
    c.flips = flips_from == c.begin;
    c.timed = timed_from == c.begin;
    if (c.timed) c.gels = timed[k].gels;
    c.end = std::min(c.flips ? (*flips)[i + 1] : flips_from, c.timed ? timed[k].end : timed_from);
    changes_.push_back(c);
    x = c.end;
    if (i < count && (*flips)[i + 1] <= x) i += 2;
    if (k < timed.size() && timed[k].end <= x) ++k;
  }
}

}  // namespace slicecorr::detail
