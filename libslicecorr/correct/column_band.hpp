// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Correction of one band, column by column. Coverage and levels are kept as their changes along
/// columns, and columns that are alike are solved once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"
#include "correct/band_solvers.hpp"
#include "correct/column_solver.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// Takes the layers of a target from the first on, then gives slices from the last on. Memory grows
/// with the changes along columns, not with voxels.
class ColumnBand final : public BandSolver {
 public:
  ColumnBand(std::unique_ptr<ColumnSolver> solver, const ColumnFacts& facts, std::size_t columns);
  /// Coverage of the next layer; null: an empty layer.
  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                 const std::uint8_t*) override;
  void keep_light(BandCorrector::ColumnLevels most) override { most_ = std::move(most); }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;

 private:
  /// A column has this value from this layer (or slice) on, in the order in which the list goes. Of
  /// coverage: with the edge height of the node there.
  struct Change {
    std::uint32_t column;
    std::int32_t at;
    std::uint8_t value, height = 0;
  };
  std::vector<Change> solve_columns();
  std::size_t read_runs(std::size_t i, std::vector<CoverageRun>& runs) const;
  void show(const std::vector<Change>& levels, const BandCorrector::Sink& sink);

  std::unique_ptr<ColumnSolver> solver_;
  ColumnFacts facts_;
  std::size_t columns_;
  BandCorrector::ColumnLevels most_;  ///< empty: those of the plan
  CodedBand coded_;
  std::vector<std::uint8_t> before_;
  std::vector<std::uint8_t> last_heights_;  ///< edge heights of the node after the last layer
  std::vector<Change> changes_;             ///< of coverage, by layer
  int layers_ = 0;
};

}  // namespace slicecorr::detail
