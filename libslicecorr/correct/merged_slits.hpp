// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Gaps of one slice that are let close (`OneSliceGaps::merge`): such a gap, empty between full layers,
/// counts as full before anything is solved.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/coded_band.hpp"
#include "correct/band_solvers.hpp"
#include "correct/coverage.hpp"

namespace slicecorr::detail {

/// Whether a layer is such a gap, by what covers it and the layers beside it.
inline bool is_slit(std::uint8_t above, std::uint8_t here, std::uint8_t below) {
  return here == 0 && above == kFull && below == kFull;
}

/// The layers of a column as they are solved.
std::vector<std::uint8_t> merged_slits(const CorrectionPlan& plan,
                                       const std::vector<std::uint8_t>& coverage);

/// Gives layers to a solver so, one layer later, and the design's own coverage with its levels. Where
/// something is left alone there is neither a feature nor a gap.
class MergedSlits final : public BandSolver {
 public:
  MergedSlits(std::unique_ptr<BandSolver> solver, int layers, std::size_t columns);
  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                 const std::uint8_t* left_alone) override;
  void keep_light(BandCorrector::ColumnLevels most) override;
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;

 private:
  /// A layer that waits for the one below it; rows that were null are empty.
  struct Layer {
    std::vector<std::uint8_t> coverage, heights, left_alone;
  };
  static std::uint8_t at(const std::vector<std::uint8_t>& row, std::size_t i) {
    return row.empty() ? std::uint8_t{0} : row[i];
  }
  /// What of a layer counts beside another.
  static std::uint8_t beside(const Layer& layer, std::size_t i) {
    return at(layer.left_alone, i) ? std::uint8_t{0} : at(layer.coverage, i);
  }
  /// Gives on the layer that waits; `below`: the one after it.
  void give(const Layer& below);

  std::unique_ptr<BandSolver> solver_;
  int layers_, taken_ = 0;
  std::size_t columns_;
  Layer above_, here_;
  CodedBand coded_;  ///< the design's own
  std::vector<std::uint8_t> room_;
};

}  // namespace slicecorr::detail
