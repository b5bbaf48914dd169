// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Room for what waits in the rows of a strip.
#include <algorithm>
#include <utility>
#include <vector>

#include "bodies/solid_rows.hpp"
#include "support/numbers/release.hpp"

namespace slicecorr::detail {

namespace {

/// So much that waits is no reason to make room, for each row of the strip.
constexpr std::size_t kSpareOfRow = 16;

/// Keeps little more memory than there is in it.
template <class Value>
void trim(std::vector<Value>& values) {
  if (values.empty()) {
    release(values);
  } else if (values.capacity() > values.size() + values.size() / 4 + 8) {
    values.shrink_to_fit();
  }
}

}  // namespace

/// Goes through what waits, step by step.
class SolidRows::RoomMaker {
 public:
  explicit RoomMaker(SolidRows& rows)
      : labels_(rows.labels_), place_of_(labels_.size(), kNowhere), seen_(kEdges) {}

  void put_together(Bucket& bucket, int step) {
    const auto hangs = [&](const Patched& p) { return anchored(p.label); };
    std::erase_if(bucket.grows, hangs);
    std::erase_if(bucket.ends, hangs);
    std::erase_if(bucket.edges, [&](Edge& e) { return is_known(e, step); });
    // Of a body only the lowest voxel counts; what hangs on what is anchored is none of its own.
    put_in_one(
        bucket.begins,
        [&](const Beginning& b) { return anchored(b.label) && labels_.begins(b.label) < step; },
        [](Beginning& kept, const Beginning& b) { kept.low = std::min(kept.low, b.low); });
    for (const Sum& s : bucket.sums) {
      bucket.totals.push_back({s.label, GrowingBodies::Volume::of(s.patch, s.slices)});
    }
    release(bucket.sums);
    put_in_one(
        bucket.totals, [&](const Total& t) { return anchored(t.label); },
        [](Total& kept, const Total& t) { kept.volume += t.volume; });
    trim(bucket.grows);
    trim(bucket.ends);
    trim(bucket.edges);
    trim(bucket.begins);
    trim(bucket.totals);
  }

 private:
  static constexpr std::uint32_t kNowhere = 0xFFFFFFFF;

  bool anchored(Label label) { return labels_.anchored(labels_.root(label)); }
  /// Puts those of one body in one place. `drop` tells what is not needed, of roots.
  template <class Waiting, class Drop, class Add>
  void put_in_one(std::vector<Waiting>& all, const Drop& drop, const Add& add) {
    std::size_t kept = 0;
    for (Waiting one : all) {
      one.label = labels_.root(one.label);
      if (drop(one)) continue;
      std::uint32_t& place = place_of_[one.label];
      if (place == kNowhere) {
        place = static_cast<std::uint32_t>(kept);
        all[kept++] = one;
      } else {
        add(all[place], one);
      }
    }
    all.resize(kept, all.empty() ? Waiting{} : all.front());
    for (const Waiting& one : all) place_of_[one.label] = kNowhere;
  }
  /// Whether its runs are one body by now, or are known to be from this step or an earlier one on.
  bool is_known(Edge& e, int step) {
    e = {labels_.root(e.a), labels_.root(e.b)};
    if (e.a == e.b || labels_.unite_early(e.a, e.b, step)) return true;
    if (e.a > e.b) std::swap(e.a, e.b);
    Edge& last = seen_[(e.a * 31 + e.b) % kEdges];
    if (last.a == e.a && last.b == e.b) return true;
    last = e;
    return false;
  }

  SolidLabels& labels_;
  std::vector<std::uint32_t> place_of_;  ///< by root: in the list at hand
  std::vector<Edge> seen_;               ///< some of the steps so far
};

void SolidRows::make_room() {
  if (waiting_ <= 2 * kept_ + kSpareOfRow * rows_.size()) return;
  RoomMaker room(*this);
  waiting_ = 0;
  for (std::size_t k = 0; k < buckets_.size(); ++k) {
    const int step = now_ + static_cast<int>(k);
    Bucket& bucket = buckets_[static_cast<std::size_t>(step) & (buckets_.size() - 1)];
    room.put_together(bucket, step);
    waiting_ += bucket.size();
  }
  kept_ = waiting_;
  for (Row& row : rows_) trim(row);
}

}  // namespace slicecorr::detail
