// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Strips of rows below each other, which threads follow side by side for some slices. What joins across
/// their borders is found when all have done so; then the bodies of all pass the steps that are over.
#pragma once

#include <map>
#include <span>
#include <utility>
#include <vector>

#include "bodies/solid_rows.hpp"

namespace slicecorr::detail {

/// All rows, strip by strip.
class SolidStrips {
 public:
  /// `ends`: of strips, the row after the last. `listener` must outlive this; it is told steps in the place
  /// of slices.
  SolidStrips(std::span<const int> ends, int step, BodyListener& listener);

  std::size_t size() const { return strips_.size(); }
  SolidRows& strip(std::size_t i) { return strips_[i]; }
  /// So many slices have ended in all strips, from the first on: passes the steps that are over.
  void pass(int slices);
  /// For who follows all strips one after the other, slice by slice: as `SolidRows`, and `pass`.
  void change_row(int y, std::span<const SolidRows::Change> changes);
  void end_slice(int more);
  /// After the last slice.
  void finish();

 private:
  using Label = SolidRows::Label;
  /// Where a strip lies on the next one.
  struct Border {
    SolidRows::Row upper, lower;
    /// Of runs that share a face, which have both gelled in a step: labels of either strip.
    std::map<int, std::vector<std::pair<Label, Label>>> joins;
  };
  bool waits() const;
  void join_borders();
  void join(std::size_t border, const SolidRows::Row& made, const SolidRows::Row& beside,
            bool made_above, int slice);
  void pass_step();
  void renumber();

  const int step_;
  int slices_ = 0;        ///< ended by `end_slice`
  GrowingBodies bodies_;  ///< counts steps
  std::vector<int> ends_;
  std::vector<SolidRows> strips_;
  std::vector<Border> borders_;
};

}  // namespace slicecorr::detail
