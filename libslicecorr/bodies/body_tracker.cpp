// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "bodies/joined_rows.hpp"
#include "bodies/necks.hpp"
#include "bodies/solid_rows.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr {

using detail::BodyListener;
using detail::GrowingBody;
using detail::JoinedRows;
using detail::SolidRows;

namespace {

std::uint64_t size_of(const Island& i) { return i.voxels; }
std::uint64_t size_of(const SealedCavity& c) { return c.voxels; }
std::uint64_t size_of(const Cup& c) { return c.opening; }
std::uint64_t size_of(const Neck& n) { return n.borne; }
std::tuple<int, double, double> begins(const Neck& n) { return {n.slice, n.row, n.column}; }
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
double middle(__int128 sum2, std::uint64_t voxels, int origin) {
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

}  // namespace

struct BodyTracker::Impl {
  Impl(const PixelBox& its_box, const Grid& its_grid, const ImageFrame& its_frame,
       const BodyAsk& its_ask)
      : box(its_box),
        grid(its_grid),
        frame(its_frame),
        ask(its_ask),
        solid_bodies(Origin{box.x0, box.y0}, ask.time_step),
        void_bodies(Origin{box.x0, box.y0}),
        solids(box.height(), ask.time_step, solid_bodies) {
    const double pixel_mm2 = grid.pixel_x_um * grid.pixel_y_um * 1e-6;
    if (ask.least_neck_mm2 > 0 && pixel_mm2 > 0) {
      // So many voxels have at least this area, whatever rounding did to it.
      necks.emplace(
          box.height(),
          static_cast<std::uint64_t>(std::ceil(ask.least_neck_mm2 / pixel_mm2 * (1 - 1e-9))),
          [this](const Neck& neck) {
            ++necks_in_all;
            largest_necks.add(neck);
          });
    }
    if (ask.voids && !box.empty()) open.emplace(box.height(), -1, box.width() + 1, void_bodies);
  }
  /// Columns where something changes in a row, in rising order: 2k and 2k + 1 are the ends of run k.
  using Ends = std::vector<int>;
  /// Puts the ends of runs into `put_in`.
  void put_ends(std::span<const Run> its);
  void flip(int row, const Ends& its);
  /// Rows with changes in the slice at hand.
  void set_changed();
  /// What is solid in it changed: what is not, and necks.
  void set_flipped(int row);

  const PixelBox box;
  const Grid grid;
  const ImageFrame frame;
  const BodyAsk ask;
  SolidListener solid_bodies;
  VoidListener void_bodies;
  SolidRows solids;
  std::optional<JoinedRows> open;
  std::optional<detail::NeckFinder> necks;
  std::uint64_t necks_in_all = 0;
  Largest<Neck> largest_necks;
  int slices = 0, lit = 0;           ///< slices so far, and up to the last that has something solid
  std::vector<Ends> solid, flipped;  ///< by row; `flipped`: in the slice at hand
  std::vector<int> flipped_rows;     ///< may stand twice
  /// When voxels of a row gel.
  struct Timed {
    int row = 0, begin = 0, end = 0;
    detail::GelTime gels;
  };
  std::vector<Timed> timed;
  std::vector<Run> runs, between;
  std::vector<SolidRows::Change> changes;
  Ends ends, put_in;
};

namespace {

/// Ends that both have are none any more.
void flip_ends(const std::vector<int>& a, const std::vector<int>& b, std::vector<int>& to) {
  to.clear();
  std::ranges::set_symmetric_difference(a, b, std::back_inserter(to));
}

/// What changes in a row where some columns flip and others are timed, each from left to right.
template <class Timed>
void put_changes(const std::vector<int>& flips, std::span<const Timed> timed,
                 std::vector<SolidRows::Change>& to) {
  constexpr int kNone = std::numeric_limits<int>::max();
  to.clear();
  int x = std::numeric_limits<int>::min();
  for (std::size_t i = 0, k = 0; i < flips.size() || k < timed.size();) {
    const int flips_from = i < flips.size() ? std::max(flips[i], x) : kNone;
    const int timed_from = k < timed.size() ? std::max(timed[k].begin, x) : kNone;
    SolidRows::Change c;
    c.begin = std::min(flips_from, timed_from);
    c.flips = flips_from == c.begin;
    c.timed = timed_from == c.begin;
    if (c.timed) c.gels = timed[k].gels;
    c.end = std::min(c.flips ? flips[i + 1] : flips_from, c.timed ? timed[k].end : timed_from);
    to.push_back(c);
    x = c.end;
    if (i < flips.size() && flips[i + 1] <= x) i += 2;
    if (k < timed.size() && timed[k].end <= x) ++k;
  }
}

}  // namespace

void BodyTracker::Impl::put_ends(std::span<const Run> its) {
  put_in.clear();
  for (const Run& run : its) {
    const int begin = run.begin - box.x0, end = run.end - box.x0;
    if (!put_in.empty() && put_in.back() == begin) {
      put_in.back() = end;
    } else {
      put_in.insert(put_in.end(), {begin, end});
    }
  }
}

void BodyTracker::Impl::flip(int row, const Ends& its) {
  const auto at = static_cast<std::size_t>(row);
  if (solid.empty()) {
    solid.resize(static_cast<std::size_t>(box.height()));
    flipped.resize(solid.size());
  }
  for (Ends* const to : {&solid[at], &flipped[at]}) {
    flip_ends(*to, its, ends);
    to->assign(ends.begin(), ends.end());
  }
  flipped_rows.push_back(row);
}

void BodyTracker::Impl::set_flipped(int row) {
  if (!open && !necks) return;
  const Ends& known = solid[static_cast<std::size_t>(row)];
  runs.clear();
  between.clear();
  int at = -1;
  for (std::size_t k = 0; k < known.size(); k += 2) {
    runs.push_back({known[k], known[k + 1]});
    if (known[k] > at) between.push_back({at, known[k]});
    at = known[k + 1];
  }
  between.push_back({at, box.width() + 1});
  if (necks) necks->set_row(row, runs);
  if (open) open->set_row(row, between);
}

void BodyTracker::Impl::set_changed() {
  std::sort(flipped_rows.begin(), flipped_rows.end());
  const auto place = [](const Timed& t) { return std::tie(t.row, t.begin); };
  const auto before = [&](const Timed& a, const Timed& b) { return place(a) < place(b); };
  if (!std::is_sorted(timed.begin(), timed.end(), before)) {
    std::sort(timed.begin(), timed.end(), before);
  }
  const Ends none;
  for (std::size_t i = 0, k = 0; i < flipped_rows.size() || k < timed.size();) {
    constexpr int kNoRow = std::numeric_limits<int>::max();
    const int flips = i < flipped_rows.size() ? flipped_rows[i] : kNoRow;
    const int row = std::min(flips, k < timed.size() ? timed[k].row : kNoRow);
    std::size_t past = k;
    while (past < timed.size() && timed[past].row == row) ++past;
    Ends* const its = flips == row ? &flipped[static_cast<std::size_t>(row)] : nullptr;
    put_changes(its ? *its : none, std::span<const Timed>(timed).subspan(k, past - k), changes);
    solids.change_row(row, changes);
    k = past;
    if (!its) continue;
    if (!its->empty()) set_flipped(row);
    its->clear();
    while (i < flipped_rows.size() && flipped_rows[i] == row) ++i;
  }
  flipped_rows.clear();
  timed.clear();
}

BodyTracker::BodyTracker(const PixelBox& box, const Grid& grid, const ImageFrame& frame,
                         const BodyAsk& ask)
    : impl_(std::make_unique<Impl>(box, grid, frame, ask)) {}
BodyTracker::~BodyTracker() = default;
BodyTracker::BodyTracker(BodyTracker&&) noexcept = default;

void BodyTracker::set_row(int y, std::span<const Run> runs) {
  Impl& t = *impl_;
  const int row = y - t.box.y0;
  t.put_ends(runs);
  if (!t.solid.empty()) {
    flip_ends(t.solid[static_cast<std::size_t>(row)], t.put_in, t.ends);
    t.put_in.assign(t.ends.begin(), t.ends.end());
  }
  t.flip(row, t.put_in);
  set_delays(y, runs);
}

void BodyTracker::flip_row(int y, std::span<const Run> runs) {
  impl_->put_ends(runs);
  impl_->flip(y - impl_->box.y0, impl_->put_in);
}

void BodyTracker::set_delays(int y, std::span<const Run> runs) {
  Impl& t = *impl_;
  for (const Run& run : runs) {
    t.timed.push_back({y - t.box.y0, run.begin - t.box.x0, run.end - t.box.x0,
                       run.at_once ? detail::GelTime::at_once(t.slices + run.delay)
                                   : detail::GelTime::after(run.delay)});
  }
}

void BodyTracker::end_slice(int more) {
  impl_->set_changed();
  impl_->slices += 1 + more;
  if (impl_->solids.any()) impl_->lit = impl_->slices;
  impl_->solids.end_slice(more);
  if (impl_->open) impl_->open->end_slice(more);
  if (impl_->necks) impl_->necks->end_slice(more);
}

Bodies BodyTracker::finish() {
  Impl& t = *impl_;
  if (t.ask.time_step > 1) t.solid_bodies.set_slices(t.slices);
  t.solids.finish();
  if (t.open) t.open->finish();
  Bodies found;
  found.grid = t.grid;
  found.frame = t.frame;
  found.time_step = t.ask.time_step;
  t.solid_bodies.put(found);
  t.void_bodies.put(found);
  if (t.necks) {
    found.least_neck_mm2 = t.ask.least_neck_mm2;
    t.necks->finish();
    found.necks_in_all = t.necks_in_all;
    found.necks = t.largest_necks.take();
    for (Neck& neck : found.necks) {
      neck.column += t.box.x0;
      neck.row += t.box.y0;
    }
  }
  // Black slices after the last body are no more of the print.
  for (Cup& c : found.cups) {
    if (c.end == CupEnd::opened && c.past == t.lit) c.end = CupEnd::print_ends;
  }
  const auto move = [&](auto& list) {
    for (auto& f : list) {
      f.x += t.box.x0;
      f.y += t.box.y0;
    }
  };
  move(found.islands);
  move(found.sealed_cavities);
  move(found.cups);
  return found;
}

}  // namespace slicecorr
