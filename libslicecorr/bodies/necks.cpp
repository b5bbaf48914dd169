// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/necks.hpp"

#include <algorithm>
#include <tuple>
#include <utility>

#include "bodies/neighbour_rows.hpp"

namespace slicecorr::detail {

namespace {

std::uint32_t root_of(std::vector<std::uint32_t>& parent, std::uint32_t i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

}  // namespace

NeckFinder::NeckFinder(int rows, std::uint64_t least, Sink found)
    : least_(least),
      found_(std::move(found)),
      rows_(static_cast<std::size_t>(rows)),
      before_(static_cast<std::size_t>(rows)),
      necks_(1) {}

void NeckFinder::set_row(int y, std::span<const Run> runs) {
  Row& row = rows_[static_cast<std::size_t>(y)];
  row.clear();
  for (const Run& run : runs) {
    if (!row.empty() && row.back().end == run.begin) {
      row.back().end = run.end;
    } else {
      row.push_back({run.begin, run.end, 0});
    }
  }
  changed_ = true;
}

/// Numbers the patches of the slice at hand in reading order.
void NeckFinder::label() {
  parent_.clear();
  for (std::size_t y = 0; y < rows_.size(); ++y) {
    for (Labelled& run : rows_[y]) {
      run.patch = static_cast<std::uint32_t>(parent_.size());
      parent_.push_back(run.patch);
    }
    if (y == 0) continue;
    each_overlap(rows_[y - 1], rows_[y], [&](const Labelled& u, const Labelled& l) {
      const std::uint32_t a = root_of(parent_, u.patch), b = root_of(parent_, l.patch);
      parent_[std::max(a, b)] = std::min(a, b);
    });
  }
  patches_.clear();
  std::vector<std::uint32_t> number(parent_.size());
  for (std::uint32_t i = 0; i < parent_.size(); ++i) {
    const std::uint32_t root = root_of(parent_, i);
    if (root == i) {
      number[i] = static_cast<std::uint32_t>(patches_.size());
      patches_.emplace_back();
    } else {
      number[i] = number[root];
    }
  }
  for (Row& row : rows_) {
    for (Labelled& run : row) {
      run.patch = number[run.patch];
      patches_[run.patch].voxels += static_cast<std::uint64_t>(run.end - run.begin);
    }
  }
  for (const Patch& p : patches_) widest_ = std::max(widest_, p.voxels);
}

std::uint32_t NeckFinder::add(std::uint64_t voxels, std::int64_t column2, std::int64_t row2,
                              std::uint32_t below) {
  const double twice = 2.0 * static_cast<double>(voxels);
  Neck neck;
  neck.slice = slice_;
  neck.voxels = voxels;
  neck.column = static_cast<double>(column2) / twice;
  neck.row = static_cast<double>(row2) / twice;
  hold(below);
  if (free_.empty()) {
    necks_.push_back({neck, 0, below});
    return static_cast<std::uint32_t>(necks_.size() - 1);
  }
  const std::uint32_t made = free_.back();
  free_.pop_back();
  necks_[made] = {neck, 0, below};
  return made;
}

void NeckFinder::hold(std::uint32_t neck) {
  if (neck != kNothing && neck != kEnough) ++necks_[neck].hanging;
}

void NeckFinder::let_go(std::uint32_t neck) {
  while (neck != kNothing && neck != kEnough && --necks_[neck].hanging == 0) {
    const Found& ended = necks_[neck];
    if (ended.widest >= least_) found_(ended.neck);
    // What hangs by a neck hangs by the one below it, too.
    necks_[ended.below].neck.borne += ended.neck.borne;
    free_.push_back(neck);
    neck = ended.below;
  }
}

/// `contacts`: of one patch, by necks.
std::uint32_t NeckFinder::hang(std::span<const Contact> contacts) {
  std::uint64_t borne = 0, shared = 0;
  std::int64_t column2 = 0, row2 = 0;
  std::uint32_t only = kNothing;
  bool whole = false, one = true;  // the one neck bears no less here
  for (const Contact& c : contacts) {
    if (c.neck == kNothing) continue;
    const std::uint64_t bears =
        c.neck == kEnough ? c.voxels : std::min(c.voxels, necks_[c.neck].neck.voxels);
    borne += bears;
    shared += c.voxels;
    column2 += c.column2;
    row2 += c.row2;
    one = one && only == kNothing;
    only = c.neck;
    whole = c.neck != kEnough && bears == necks_[c.neck].neck.voxels;
  }
  if (only == kNothing) return kNothing;
  if (borne >= least_) return kEnough;
  if (one && whole) return only;
  const std::uint32_t made = add(shared, column2, row2, one ? only : kEnough);
  necks_[made].neck.voxels = borne;
  return made;
}

void NeckFinder::hang() {
  contacts_.clear();
  const auto add = [&](std::uint32_t patch, std::uint32_t neck, std::size_t y, std::int64_t begin,
                       std::int64_t end) {
    contacts_.push_back({patch, neck, static_cast<std::uint64_t>(end - begin),
                         end * end - begin * begin,
                         (end - begin) * (2 * static_cast<std::int64_t>(y) + 1)});
  };
  // In the first slice by its own area on the platform.
  for (std::size_t y = 0; slice_ == 0 && y < rows_.size(); ++y) {
    for (const Labelled& run : rows_[y]) add(run.patch, kEnough, y, run.begin, run.end);
  }
  for (std::size_t y = 0; slice_ > 0 && y < rows_.size(); ++y) {
    each_overlap(rows_[y], before_[y], [&](const Labelled& run, const Labelled& before) {
      add(run.patch, patches_before_[before.patch].neck, y, std::max(run.begin, before.begin),
          std::min(run.end, before.end));
    });
  }
  const auto key = [](const Contact& c) { return std::tie(c.patch, c.neck); };
  std::sort(contacts_.begin(), contacts_.end(),
            [&](const Contact& a, const Contact& b) { return key(a) < key(b); });
  std::size_t kept = 0;  // one for each patch and neck
  for (const Contact& c : contacts_) {
    if (kept > 0 && key(contacts_[kept - 1]) == key(c)) {
      Contact& sum = contacts_[kept - 1];
      sum.voxels += c.voxels;
      sum.column2 += c.column2;
      sum.row2 += c.row2;
    } else {
      contacts_[kept++] = c;
    }
  }
  contacts_.resize(kept);
  for (std::size_t begin = 0; begin < kept;) {
    std::size_t end = begin;
    while (end < kept && contacts_[end].patch == contacts_[begin].patch) ++end;
    patches_[contacts_[begin].patch].neck = hang(std::span(contacts_).subspan(begin, end - begin));
    begin = end;
  }
}

void NeckFinder::end_slice(int more) {
  if (changed_) {
    std::swap(patches_, patches_before_);
    label();
    hang();
    before_ = rows_;
    for (const Patch& p : patches_) hold(p.neck);
    for (const Patch& p : patches_before_) let_go(p.neck);
  }
  // In slices that are alike patches hang by what they hung by.
  for (const Patch& p : patches_) {
    if (p.neck == kNothing || p.neck == kEnough) continue;
    Found& found = necks_[p.neck];
    found.neck.borne += p.voxels * static_cast<std::uint64_t>(1 + more);
    found.widest = std::max(found.widest, p.voxels);
  }
  slice_ += 1 + more;
  changed_ = false;
}

void NeckFinder::finish() {
  for (const Patch& p : patches_) let_go(p.neck);
  patches_.clear();
}

}  // namespace slicecorr::detail
