// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Correction of one band, column by column. Coverage is kept as its changes along columns, levels as two
/// bytes for each of theirs, and columns that are alike are solved once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
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
                 const std::uint8_t* left_alone) override;
  void keep_light(BandCorrector::ColumnLevels most) override;
  /// Doses that features are to have. To be called before `solve`.
  void want(BandDoses doses) { doses_ = std::move(doses); }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;

 private:
  /// A column has this value from this layer (or slice) on, in the order in which the list goes. Of
  /// coverage: with the edge height of the node there.
  struct Change {
    std::uint32_t column;
    std::int32_t at;
    std::uint8_t value, height = 0;
  };
  /// The levels of a column, from the last slice on, while slices are shown.
  struct Shown {
    std::uint32_t column;
    std::uint32_t answer;  ///< in answers_
    std::int32_t next;     ///< slice at which the level changes next
    std::uint32_t at = 0;  ///< where the answer says what to
  };
  void solve_columns();
  /// The levels of a column as changes, kept for those that are alike.
  std::string answer_of(const std::string& key, const std::vector<CoverageRun>& runs,
                        const ColumnBounds& bounds);
  void add_answer(std::uint32_t column, int moved, std::string answer);
  /// Where the level of a column changes after this.
  void find_next(Shown& shown) const;
  void read_doses();
  /// The doses wanted of a column's full layers; their bytes are added to the key. Columns rise.
  void read_wanted(std::uint32_t column, const std::vector<CoverageRun>& runs, ColumnBounds& bounds,
                   std::string& key);
  std::size_t read_runs(std::size_t i, std::uint32_t column, std::vector<CoverageRun>& runs) const;
  /// What of a column is left alone; `i` goes on to the changes of the next.
  void read_left_alone(std::uint32_t column, std::size_t& i, ColumnBounds& bounds) const;
  void show(const BandCorrector::Sink& sink);

  std::unique_ptr<ColumnSolver> solver_;
  ColumnFacts facts_;
  std::size_t columns_;
  BandCorrector::ColumnLevels most_;  ///< empty: those of the plan
  std::optional<BandDoses> doses_;
  std::vector<Change> dose_changes_;  ///< of their bytes, by column and layer
  std::size_t next_dose_ = 0;
  CodedBand coded_;
  std::vector<std::uint8_t> before_;
  std::vector<std::uint8_t> last_heights_;  ///< edge heights of the node after the last layer
  std::vector<Change> changes_;             ///< of coverage, by layer
  /// The same of levels of what is left alone, `height` 0 where nothing is; empty while nothing was.
  std::vector<Change> left_changes_;
  std::vector<std::int16_t> left_before_;  ///< -1: nothing
  int layers_ = 0;
  std::vector<std::string> answers_;  ///< those of neighbours that are alike once
  std::vector<Shown> shown_;
};

}  // namespace slicecorr::detail
