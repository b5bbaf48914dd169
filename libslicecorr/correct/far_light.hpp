// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light from slices beyond the reach of the tables, where layers are not alike under UV light: of many slices at once.
#pragma once

#include <cstddef>
#include <vector>

#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

struct InhibitedPlan;

/// What layers leave of light without UV light, between any two nodes, by one product: e^-x is 2^-halves left, so that
/// no print is too high. Immutable.
class NodePowers {
 public:
  NodePowers() = default;
  /// Of nodes 0 .. last.
  NodePowers(const InhibitedKernel& kernel, int last);
  /// What is left at node `to` of light at node `from`, `from` >= `to`.
  double fade(int from, int to) const {
    const Power &of = powers_[static_cast<std::size_t>(from)],
                &at = powers_[static_cast<std::size_t>(to)];
    const std::size_t halves = of.halves - at.halves;
    return halves < halves_.size() ? of.left * at.back * halves_[halves] : 0.0;
  }

 private:
  struct Power {
    double left, back;  ///< 1/2 .. 1, and one over it
    std::size_t halves;
  };
  std::vector<Power> powers_;
  std::vector<double> halves_;  ///< powers of 1/2, down to where nothing is left
};

/// Sums of far light over slices that follow each other. Immutable; doses are those of `InhibitedPlan::light_of`,
/// times the exposure of each slice.
class FarLight {
 public:
  FarLight() = default;
  /// Of a plan that has all but this.
  explicit FarLight(const InhibitedPlan& plan);
  /// What is left at node `to` of light at node `from`, `from` >= `to`.
  double fade(int from, int to) const { return powers_.fade(from, to); }
  /// Slices first <= n < end, none nearer than `near` to node k.
  struct Slices {
    int k, first, end;
  };
  double of_level(int level, const Slices& slices) const { return sum(level, slices); }
  /// Of the highest level of each slice.
  double of_caps(const Slices& slices) const { return sum(levels_, slices); }
  /// Of its steady level, or the highest where that is less.
  double of_steady(const Slices& slices) const { return sum(levels_ + 1, slices); }
  double bytes() const { return 8.0 * static_cast<double>(rows_.size()); }

 private:
  double sum(int row, const Slices& slices) const;

  int near_ = 1, levels_ = 0;
  std::size_t count_ = 0;  ///< slices
  NodePowers powers_;
  std::vector<double> backs_;  ///< of node k, what the platform sends back there
  /// [row][slice]: what the slice and all after it give its farthest layer; rows are levels, caps and steady levels.
  std::vector<double> rows_;
};

}  // namespace slicecorr::detail
