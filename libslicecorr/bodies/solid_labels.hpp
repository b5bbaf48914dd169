// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Labels of solid runs before and after their bodies begin.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "bodies/growing_bodies.hpp"

namespace slicecorr::detail {

/// A union-find over the labels of a strip. What begins in the step in which it joins another is never a
/// body of its own: their labels are united before either begins. For one thread.
class SolidLabels {
 public:
  using Label = GrowingBodies::Label;
  static constexpr Label kNone = GrowingBodies::kNone;

  /// `begins`: the step in which a body is to begin with it, the one at hand or a later one.
  Label add(int begins, bool anchored) {
    const auto label = static_cast<Label>(parent_.size());
    parent_.push_back(label);
    known_.push_back({begins, anchored, kNone});
    return label;
  }
  Label root(Label label) {
    while (parent_[label] != label) {
      parent_[label] = parent_[parent_[label]];
      label = parent_[label];
    }
    return label;
  }
  /// Whether all that has this label hangs on what all hangs on as soon as it is there: of such a body no
  /// sums are asked for.
  bool anchored(Label root) const { return known_[root].anchored; }
  /// The step in which its body begins.
  int begins(Label root) const { return known_[root].begins; }
  void set_anchored(Label root) { known_[root].anchored = true; }
  /// Its label among the bodies of all strips; kNone: it has not begun.
  Label& body(Label root) { return known_[root].body; }
  std::size_t size() const { return parent_.size(); }
  /// Whether there are so many that those in use should be looked for in so many places: most have been
  /// united by then.
  bool many(std::size_t places) const {
    return size() > 2 * kept_ + places / kPlacesOfLabel + kSpare;
  }

  /// Of two roots that join in `step`, the one at hand or a later one, if that may be done before it comes.
  bool unite_early(Label a, Label b, int step) {
    if (known_[b].begins < known_[a].begins) std::swap(a, b);
    Known& first = known_[a];
    const Known& later = known_[b];
    // What hangs on the same all hangs on is told nothing of, whenever it joins.
    if (!first.anchored || !later.anchored) {
      if (later.begins != step) return false;
      // An island that was there before ends.
      if (later.anchored && first.begins < step) return false;
    }
    if (later.body != kNone) return false;
    first.anchored = first.anchored || later.anchored;
    parent_[b] = a;
    return true;
  }
  /// Of two roots whose bodies have joined.
  void unite(Label a, Label b, Label body) {
    if (known_[b].begins < known_[a].begins) std::swap(a, b);
    known_[a].anchored = known_[a].anchored || known_[b].anchored;
    known_[a].body = body;
    parent_[b] = a;
  }
  /// As `GrowingBodies::renumber`.
  template <class Each>
  void renumber(const Each& each) {
    std::vector<Label> to(parent_.size(), kNone);
    std::vector<Known> known;
    each([&](Label& label) {
      const Label r = root(label);
      if (to[r] == kNone) {
        to[r] = static_cast<Label>(known.size());
        known.push_back(known_[r]);
      }
      label = to[r];
    });
    known_ = std::move(known);
    kept_ = known_.size();
    parent_.resize(kept_);
    for (std::size_t i = 0; i < parent_.size(); ++i) parent_[i] = static_cast<Label>(i);
  }
  /// Calls `take` with each root's body, if it has begun.
  template <class Take>
  void each_body(const Take& take) {
    for (std::size_t i = 0; i < parent_.size(); ++i) {
      if (parent_[i] == i && known_[i].body != kNone) take(known_[i].body);
    }
  }

 private:
  /// So many more than were in use are no reason to make room.
  static constexpr std::size_t kSpare = 16384;
  /// New labels pay for looking at so many places each.
  static constexpr std::size_t kPlacesOfLabel = 4;
  struct Known {
    std::int32_t begins;  ///< step
    bool anchored;
    Label body;
  };
  std::vector<Label> parent_;
  std::vector<Known> known_;  ///< of roots
  std::size_t kept_ = 0;      ///< when room was made last
};

}  // namespace slicecorr::detail
