// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where a mesh is solid from which volumes are taken away: what windings of whom say.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// Numbers the shares of a mesh by what they do. 0: all solids to which triangles are only added, as
/// one; the others by solid and role.
class SolidRule {
 public:
  using Tag = std::uint16_t;
  /// Tags that a mesh may have: edge heights keep them in 11 bits.
  static constexpr std::size_t kMostTags = 2047;

  SolidRule() = default;
  /// Throws `InputError` where there are more tags.
  explicit SolidRule(const std::vector<TriangleMesh::Share>& shares);

  /// Whether there is nothing but tag 0.
  bool plain() const { return whose_.size() <= 1; }
  std::size_t tags() const { return whose_.size(); }
  /// The tag of each of the mesh's shares.
  Tag tag_of_share(std::size_t share) const { return tag_of_share_[share]; }
  SolidRole role(Tag tag) const { return whose_[tag].role; }
  /// Whether what this tag crosses may be solid otherwise than by its winding with all others. What
  /// is added to a solid is, where something is kept within: nothing is solid outside.
  bool needs_rule(Tag tag) const { return whose_[tag].needs_rule; }

 private:
  friend class SolidWindings;
  struct Whose {
    std::uint32_t solid = 0;
    SolidRole role = SolidRole::added;
    bool needs_rule = false;
  };
  std::vector<Whose> whose_{Whose{}};
  std::vector<Tag> tag_of_share_;
  std::vector<std::uint8_t> keeps_{0};  ///< per solid: whether something is kept within
};

/// The windings at a place, changed one crossing at a time.
class SolidWindings {
 public:
  explicit SolidWindings(const SolidRule& rule)
      : rule_(rule), windings_(rule.whose_.size(), 0), solids_(rule.keeps_.size()) {}

  void add(SolidRule::Tag tag, std::int64_t by) {
    std::int64_t& winding = windings_[tag];
    const bool was = winding != 0;
    winding += by;
    if ((winding != 0) == was) return;
    const SolidRule::Whose& whose = rule_.whose_[tag];
    Solid& solid = solids_[whose.solid];
    const bool before = solid.filled(rule_.keeps_[whose.solid] != 0);
    const int step = was ? -1 : 1;
    if (whose.role == SolidRole::added) solid.added += step;
    if (whose.role == SolidRole::taken_away) solid.taken += step;
    if (whose.role == SolidRole::kept_within) solid.kept += step;
    filled_ +=
        static_cast<int>(solid.filled(rule_.keeps_[whose.solid] != 0)) - static_cast<int>(before);
  }
  bool inside() const { return filled_ > 0; }
  /// Whether all windings are 0.
  bool balanced() const {
    for (const std::int64_t winding : windings_) {
      if (winding != 0) return false;
    }
    return true;
  }
  void clear() {
    windings_.assign(windings_.size(), 0);
    solids_.assign(solids_.size(), {});
    filled_ = 0;
  }

 private:
  /// How many tags of each role wind around the place.
  struct Solid {
    int added = 0, taken = 0, kept = 0;
    bool filled(bool keeps) const { return added > 0 && taken == 0 && (!keeps || kept > 0); }
  };
  const SolidRule& rule_;
  std::vector<std::int64_t> windings_;
  std::vector<Solid> solids_;
  int filled_ = 0;
};

}  // namespace slicecorr::detail
