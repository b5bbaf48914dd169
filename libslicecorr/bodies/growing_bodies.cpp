// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bodies/growing_bodies.hpp"

#include <algorithm>
#include <tuple>
#include <utility>

namespace slicecorr::detail {

namespace {

/// The greater of two areas; of equals that of the earlier slice.
void widen(std::uint64_t& widest, int& slice, std::uint64_t area, int its_slice) {
  if (area < widest || (area == widest && its_slice >= slice)) return;
  widest = area;
  slice = its_slice;
}

bool older(const GrowingBody& a, const GrowingBody& b) {
  if (a.anchored != b.anchored) return a.anchored;
  return std::tie(a.first, a.low) < std::tie(b.first, b.low);
}

}  // namespace

GrowingBodies::Label GrowingBodies::begin(const FirstVoxel& low, bool anchored) {
  const auto label = static_cast<Label>(parent_.size());
  parent_.push_back(label);
  if (free_.empty()) {
    body_of_.push_back(static_cast<std::uint32_t>(bodies_.size()));
    bodies_.emplace_back();
  } else {
    body_of_.push_back(free_.back());
    free_.pop_back();
    body(label) = {};
  }
  GrowingBody& made = body(label);
  made.first = made.counted = slice_;
  made.low = low;
  made.anchored = anchored;
  made.touched = slice_;
  touched_.push_back(label);
  return label;
}

void GrowingBodies::lower(Label label, const FirstVoxel& low) {
  if (anchored(label)) return;
  GrowingBody& known = change(root(label));
  known.joined_low = std::min(known.joined_low, low);
}

void GrowingBodies::count(GrowingBody& b) const {
  const int slices = slice_ - b.counted;
  if (slices == 0) return;
  b.counted = slice_;
  b.voxels += b.area * static_cast<std::uint64_t>(slices);
  b.column2 += static_cast<__int128>(b.area_column2) * slices;
  b.row2 += static_cast<__int128>(b.area_row2) * slices;
}

GrowingBody& GrowingBodies::change(Label label) {
  GrowingBody& b = body(label);
  count(b);
  if (b.touched != slice_) {
    b.touched = slice_;
    touched_.push_back(label);
  }
  return b;
}

void GrowingBodies::grow(Label label, const Patch& patch, int more) {
  GrowingBody& b = change(root(label));
  const std::int64_t begin = patch.begin, end = patch.end;
  b.area += static_cast<std::uint64_t>(more * (end - begin));
  b.area_column2 += more * (end * end - begin * begin);
  b.area_row2 += more * (end - begin) * (2 * patch.row + 1);
}

void GrowingBodies::add(Label label, const Volume& volume) {
  GrowingBody& b = body(root(label));
  b.voxels += static_cast<std::uint64_t>(volume.voxels);
  b.column2 += volume.column2;
  b.row2 += volume.row2;
}

GrowingBodies::Label GrowingBodies::unite(Label a, Label b) {
  a = root(a);
  b = root(b);
  if (a == b) return a;
  if (older(body(b), body(a))) std::swap(a, b);
  GrowingBody &stays = change(a), &goes = change(b);
  listener_.join(stays, goes, slice_);
  // Apart until the slice is done: no figure depends on the order in which bodies join.
  stays.joined_low = std::min({stays.joined_low, goes.low, goes.joined_low});
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

void GrowingBodies::end(Label label, bool no_slice_left) {
  if (body_of_[label] == kNoBody) return;
  GrowingBody& b = body(label);
  count(b);
  listener_.end(b, slice_, no_slice_left);
  free_.push_back(std::exchange(body_of_[label], kNoBody));
}

void GrowingBodies::end_slice(bool empty_ends) {
  for (const Label label : touched_) {
    if (parent_[label] != label) continue;  // its root was touched, too
    GrowingBody& b = body(label);
    b.low = std::min(b.low, std::exchange(b.joined_low, {}));
    b.voxels += std::exchange(b.joined_voxels, 0);
    b.column2 += std::exchange(b.joined_column2, 0);
    b.row2 += std::exchange(b.joined_row2, 0);
    widen(b.widest, b.widest_slice, std::exchange(b.joined_widest, 0), b.joined_widest_slice);
    widen(b.widest, b.widest_slice, b.area, slice_);
    b.told = b.told || !b.anchored;
    listener_.end_slice(b);
    if (empty_ends && b.area == 0) end(label, false);
  }
  touched_.clear();
  ++slice_;
}

void GrowingBodies::finish() {
  for (Label label = 0; label < parent_.size(); ++label) {
    if (parent_[label] == label) end(label, true);
  }
}

}  // namespace slicecorr::detail
