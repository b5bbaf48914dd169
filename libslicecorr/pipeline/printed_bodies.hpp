// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The bodies of a print beside those of its design, gathered from predictions of bands while they are
/// made.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "bodies/kept_voxels.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// Bands may be gathered on any thread and in any order, and give the same bodies.
class PrintedBodies {
 public:
  /// `layers`: of the part and of what is shown, whichever is more.
  /// `in_time`: whether to follow when voxels gel.
  PrintedBodies(const std::vector<PixelBox>& bands, int layers, const CureModel& model,
                const ExecutionContext& context, bool in_time = true);

  /// Gathers one band; for one thread.
  class Band {
   public:
    Band(PrintedBodies& whole, std::size_t index, const PixelBox& box);
    /// Lets a predictor tell this band what it finds. `columns`: those of the band that are the
    /// predictor's, null for all; must outlive the predictor.
    void listen(BandPredictor& predictor, const std::vector<std::uint32_t>* columns);
    /// To be called once, after all predictors.
    void finish();

   private:
    /// Where design and whole voxels differ from the print, which is seldom, is kept in their place.
    static constexpr std::uint8_t kPrinted = 1, kDesignedOther = 2, kWholeOther = 4;
    void enter(std::size_t column, int slice, std::uint8_t state);
    PrintedBodies& whole_;
    const std::size_t index_;
    /// From this slice down, as `BandPredictor::DelaySink`.
    void gel(std::size_t column, int slice, int delay);
    std::vector<std::uint8_t> state_;  ///< per column: of the slices at hand
    VoxelChanges changes_;
    std::vector<std::int32_t>
        told_;  ///< per column: of its moments, the last; empty before the first
    MomentChanges moments_;
    std::vector<KeptVoxels::Pieces>
        kept_moments_;        ///< of slices that are done, the last ones first
    bool in_groups_ = false;  ///< columns are told apart, each group from the last slice on
  };

  /// After all bands. `least_neck_mm2`: see BodyAsk.
  std::shared_ptr<const JudgedBodies> judge(const Grid& grid, const ImageFrame& frame,
                                            const LayerHeights& heights,
                                            double least_neck_mm2) const;

 private:
  const int layers_;
  const int step_;  ///< slices after which it is looked what hangs on nothing
  const ExecutionContext& context_;
  KeptVoxels kept_;
  /// By band: of what prints, and of where what is designed, and what is covered whole, is otherwise.
  KeptVoxels::Stream printed_, designed_other_, whole_other_;
  KeptVoxels::Stream moments_;  ///< of the printed voxels
  std::atomic<bool> in_time_;   ///< moments are known, so far
};

/// Tells what of a print hangs on nothing and what it traps. Throws `InfeasibleError` where something
/// hangs on nothing and `setup` refuses that.
void judge_bodies(const JudgedBodies& bodies, const Setup& setup, const ExecutionContext& context);

}  // namespace slicecorr::detail
