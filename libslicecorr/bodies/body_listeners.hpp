// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What becomes of bodies, as it is told: islands, loose bodies, cavities and cups, the largest of each.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "bodies/growing_bodies.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr::detail {

inline std::uint64_t size_of(const Island& i) { return i.voxels; }
inline std::uint64_t size_of(const SealedCavity& c) { return c.voxels; }
inline std::uint64_t size_of(const Cup& c) { return c.opening; }
inline std::uint64_t size_of(const Neck& n) { return n.borne; }
inline std::tuple<int, double, double> begins(const Neck& n) { return {n.slice, n.row, n.column}; }
template <class Found>
std::tuple<int, double, double> begins(const Found& f) {
  return {f.first, f.y, f.x};
}

/// The largest of what is found, in any order.
template <class Found>
class Largest {
 public:
  void add(const Found& found) {
    if (heap_.size() == Bodies::kMost) {
      if (!before(found, heap_.front())) return;
      std::pop_heap(heap_.begin(), heap_.end(), before);
      heap_.pop_back();
    }
    heap_.push_back(found);
    std::push_heap(heap_.begin(), heap_.end(), before);
  }
  std::vector<Found> take() {
    std::sort_heap(heap_.begin(), heap_.end(), before);
    return std::move(heap_);
  }

 private:
  static bool before(const Found& a, const Found& b) {
    if (size_of(a) != size_of(b)) return size_of(a) > size_of(b);
    return begins(a) < begins(b);
  }
  std::vector<Found> heap_;
};

/// Lists of what waits in bodies, one after the other in one room.
template <class Waiting>
class WaitingLists {
 public:
  void add(GrowingBody& body, const Waiting& value) {
    std::int32_t at = free_;
    if (at >= 0) {
      free_ = nodes_[static_cast<std::size_t>(at)].next;
      nodes_[static_cast<std::size_t>(at)] = {value, -1};
    } else {
      at = static_cast<std::int32_t>(nodes_.size());
      nodes_.push_back({value, -1});
    }
    ++size_;
    append(body, at, at);
  }
  /// What waits in `from` waits in `to`.
  void move(GrowingBody& from, GrowingBody& to) {
    if (from.waiting >= 0) append(to, from.waiting, from.waiting_end);
    from.waiting = from.waiting_end = -1;
  }
  /// Nothing waits in `body` any more.
  template <class Take>
  void take(GrowingBody& body, const Take& each) {
    while (body.waiting >= 0) {
      Node& node = nodes_[static_cast<std::size_t>(body.waiting)];
      each(node.value);
      body.waiting = std::exchange(node.next, std::exchange(free_, body.waiting));
      --size_;
    }
    body.waiting_end = -1;
  }
  std::size_t size() const { return size_; }

 private:
  struct Node {
    Waiting value;
    std::int32_t next;
  };
  void append(GrowingBody& body, std::int32_t first, std::int32_t last) {
    if (body.waiting < 0) {
      body.waiting = first;
    } else {
      nodes_[static_cast<std::size_t>(body.waiting_end)].next = first;
    }
    body.waiting_end = last;
  }
  std::vector<Node> nodes_;
  std::int32_t free_ = -1;
  std::size_t size_ = 0;
};

/// Where the tracked box begins in the images.
struct Origin {
  int x = 0, y = 0;
};

/// The mean of `sum2`, twice a sum over voxels, from `origin` on; the same for every box.
inline double middle(__int128 sum2, std::uint64_t voxels, int origin) {
  const __int128 whole = sum2 + 2 * static_cast<__int128>(origin) * static_cast<__int128>(voxels);
  return static_cast<double>(whole) / (2.0 * static_cast<double>(voxels));
}

/// Bodies of what is solid.
class SolidListener final : public BodyListener {
 public:
  SolidListener(Origin origin, int step) : at_(origin), step_(step) {}
  /// Slices in all, before what is left is told.
  void set_slices(int slices) { last_ = slices - 1; }
  void join(GrowingBody& older, GrowingBody& younger, int slice) override {
    if (older.anchored) {
      if (younger.told) tell(island(younger), slice);
      islands_.take(younger, [&](const Island& i) { tell(i, slice); });
      return;
    }
    if (younger.told) {
      if (islands_.size() < Bodies::kMostWaiting) {
        islands_.add(older, island(younger));
      } else {
        ++in_all_;
      }
    }
    islands_.move(younger, older);
  }
  void end_slice(GrowingBody&) override {}
  void end(GrowingBody& body, int, bool) override {
    if (body.anchored) {
      ++on_platform_;
      return;
    }
    ++loose_;
    tell(island(body), -1);
    islands_.take(body, [&](const Island& i) { tell(i, -1); });
  }
  void put(Bodies& bodies) {
    bodies.on_platform = on_platform_;
    bodies.loose_bodies = loose_;
    bodies.islands_in_all = in_all_;
    bodies.islands = largest_.take();
  }

 private:
  Island island(const GrowingBody& b) const {
    return {b.low.slice,
            end_of(b.first),
            -1,
            b.voxels,
            middle(b.column2, b.voxels, at_.x),
            middle(b.row2, b.voxels, at_.y),
            b.low.x,
            b.low.y};
  }
  int end_of(int step) const { return std::min((step + 1) * step_ - 1, last_); }
  /// `until`: step, or -1.
  void tell(Island island, int until) {
    ++in_all_;
    island.until = until < 0 ? -1 : end_of(until);
    largest_.add(island);
  }
  const Origin at_;
  const int step_;  ///< slices
  int last_ = std::numeric_limits<int>::max();
  WaitingLists<Island> islands_;
  Largest<Island> largest_;
  std::uint64_t on_platform_ = 0, loose_ = 0, in_all_ = 0;
};

/// Bodies of what is not.
class VoidListener final : public BodyListener {
 public:
  explicit VoidListener(Origin origin) : at_(origin) {}
  void join(GrowingBody& older, GrowingBody& younger, int slice) override {
    if (older.anchored) {
      if (younger.told) tell(cup(younger, CupEnd::opened, slice));
      joined_.take(younger, [&](const Cup& c) { tell(c); });
      return;
    }
    // Two cups become one, or both are opened when the slice is done.
    if (younger.told) {
      joined_.add(older, cup(younger, CupEnd::opened, slice));
    }
    joined_.move(younger, older);
  }
  void end_slice(GrowingBody& body) override {
    joined_.take(body, [](const Cup&) {});
  }
  void end(GrowingBody& body, int slice, bool no_slice_left) override {
    if (body.anchored) return;
    tell(cup(body, no_slice_left ? CupEnd::print_ends : CupEnd::closed, slice));
    if (no_slice_left || body.first == 0) return;
    ++sealed_in_all_;
    sealed_voxels_ += body.voxels;
    sealed_.add({body.first, slice, body.voxels, middle(body.column2, body.voxels, at_.x),
                 middle(body.row2, body.voxels, at_.y), body.low.x, body.low.y});
  }
  void put(Bodies& bodies) {
    bodies.cups_in_all = cups_in_all_;
    bodies.sealed_in_all = sealed_in_all_;
    bodies.sealed_voxels = sealed_voxels_;
    bodies.cups = cups_.take();
    bodies.sealed_cavities = sealed_.take();
  }

 private:
  Cup cup(const GrowingBody& b, CupEnd end, int past) const {
    return {b.first,
            past,
            end,
            b.widest_slice,
            b.widest,
            middle(b.column2, b.voxels, at_.x),
            middle(b.row2, b.voxels, at_.y),
            b.low.x,
            b.low.y};
  }
  void tell(const Cup& found) {
    ++cups_in_all_;
    cups_.add(found);
  }
  const Origin at_;
  WaitingLists<Cup> joined_;
  Largest<Cup> cups_;
  Largest<SealedCavity> sealed_;
  std::uint64_t cups_in_all_ = 0, sealed_in_all_ = 0, sealed_voxels_ = 0;
};

}  // namespace slicecorr::detail
