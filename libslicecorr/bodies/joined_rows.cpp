// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/joined_rows.hpp"

namespace slicecorr::detail {

JoinedRows::JoinedRows(int rows, int first, int past, BodyListener& listener)
    : first_(first),
      past_(past),
      bodies_(listener),
      rows_(static_cast<std::size_t>(rows)),
      changed_(rows) {
  // Outside is there before the first slice.
  const Label anchor = bodies_.begin({0, 0, first}, true);
  for (int y = 0; y < rows; ++y) {
    rows_[static_cast<std::size_t>(y)].push_back({first, past, anchor});
    enter({first, past, anchor}, y);
  }
  runs_ = rows_.size();
}

void JoinedRows::set_row(int y, std::span<const Run> runs) {
  Row& row = rows_[static_cast<std::size_t>(y)];
  next_.clear();
  const bool beside_outside = y == 0 || y + 1 == static_cast<int>(rows_.size());
  const bool hangs = bodies_.slice() > 0;  // on the slice before
  std::size_t at = 0;
  for (const Run& run : runs) {
    while (at < row.size() && row[at].end <= run.begin) leave(row[at++], y);
    Labelled made{run.begin, run.end, kNone};
    const auto join = [&](Label label) {
      made.label = made.label == kNone ? label : bodies_.unite(made.label, label);
    };
    const bool same = at < row.size() && row[at].begin == run.begin && row[at].end == run.end;
    for (std::size_t k = at; hangs && k < row.size() && row[k].begin < run.end; ++k) {
      join(row[k].label);
    }
    if (beside_outside || run.begin == first_ || run.end == past_) join(kAnchor);
    if (same && hangs) {
      ++at;
    } else {
      if (made.label == kNone) {
        made.label = bodies_.begin({bodies_.slice(), y, run.begin}, false);
      }
      enter(made, y);
    }
    next_.push_back(made);
  }
  while (at < row.size()) leave(row[at++], y);
  runs_ += next_.size();
  runs_ -= row.size();
  row.swap(next_);
  changed_.add(y);
}

void JoinedRows::join_rows(int upper, int lower) {
  each_overlap(rows_[static_cast<std::size_t>(upper)], rows_[static_cast<std::size_t>(lower)],
               [&](Labelled& u, Labelled& l) {
                 if (u.label != l.label) u.label = l.label = bodies_.unite(u.label, l.label);
               });
}

void JoinedRows::end_slice(int more) {
  changed_.take_neighbours([&](int upper, int lower) { join_rows(upper, lower); });
  bodies_.end_slice(true);
  bodies_.skip(more);
  if (bodies_.size() > 2 * runs_ + 65536) renumber();
}

void JoinedRows::renumber() {
  bodies_.renumber([&](const auto& keep) {
    Label anchor = kAnchor;
    keep(anchor);
    for (Row& row : rows_) {
      for (Labelled& run : row) keep(run.label);
    }
  });
}

void JoinedRows::finish() { bodies_.finish(); }

}  // namespace slicecorr::detail
