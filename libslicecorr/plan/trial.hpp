// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// One correction of some of a part's columns at one speed, and whether it keeps what is asked for.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "plan/design_columns.hpp"
#include "slicecorr/plan.hpp"

namespace slicecorr::detail {

/// Whether a point keeps what is asked for, with edges within `tolerance_um`.
bool keeps_within(const PlanPoint& point, double tolerance_um);

/// What is to be told of a trial besides its point.
struct TrialAsk {
  std::vector<std::uint32_t>* failing = nullptr;  ///< takes the columns that fail; null: not asked
  std::vector<PlanPlace>* places = nullptr;       ///< takes what of them fails; null: not asked
};

/// What all trials of a plan share. Thread-safe.
/// The setup with the ramps that the machine of `stage` needs for its speed, where it says nothing of them.
Setup as_machine_moves(Setup setup, const StageChange& stage);

class Trials {
 public:
  /// `target` and `columns` must outlive this. Reads nothing of the target but its size and frame.
  Trials(const SliceSource& target, const DesignColumns& columns, const PlanAsk& ask);

  /// Corrects and predicts the columns `which`. What `PlacePlans` refuses comes back as a point that
  /// does not print.
  PlanPoint correct(const Setup& asked, std::span<const std::uint32_t> which, const TrialAsk& ask,
                    const ExecutionContext& context) const;

  /// Gaps from run to run below this many slices are left out.
  int least_gap_slices() const { return least_gap_slices_; }
  /// "50 um (1 slice)".
  std::string height_in_words(int slices) const;

 private:
  PlanPoint correct_evenly(const Setup& setup, std::span<const std::uint32_t> which,
                           const TrialAsk& ask, const ExecutionContext& context) const;
  Process with_uv(const Setup& setup, const ExecutionContext& context) const;
  class Block;

  const SliceSource& target_;
  const DesignColumns& columns_;
  const PlanAsk ask_;
  int least_gap_slices_;
};

}  // namespace slicecorr::detail
