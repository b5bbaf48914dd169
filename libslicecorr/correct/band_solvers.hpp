// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The solves of a band; see slicecorr/correct.hpp. All but the first give columns to a solver one by one
/// (column_band.hpp).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "cure/margin.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// The solve behind a `BandCorrector`, which passes its calls on.
class BandSolver {
 public:
  virtual ~BandSolver() = default;
  virtual void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                         const std::uint8_t* left_alone) = 0;
  /// `tiles` may be empty; where `has_tiles` is false it must be.
  virtual void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) = 0;
  virtual bool has_tiles() const { return false; }
  virtual void keep_light(BandCorrector::ColumnLevels most);
};

/// The solver of plain models.
std::unique_ptr<BandSolver> make_continuous_solver(const CorrectionPlan& plan, std::size_t columns);

/// The solver of models with an inhibited kernel, in both modes.
std::unique_ptr<BandSolver> make_inhibited_solver(const CorrectionPlan& plan, std::size_t columns);
/// The same where doses are wanted.
std::unique_ptr<BandSolver> make_inhibited_solver(const CorrectionPlan& plan, std::size_t columns,
                                                  BandDoses doses);
/// The levels of one column.
std::vector<std::uint8_t> solve_inhibited_column(const CorrectionPlan& plan,
                                                 const std::vector<std::uint8_t>& coverage,
                                                 const std::vector<std::uint8_t>& heights);

/// Slices to show for a target whose last lit layer is `last_lit`, with an inhibited kernel.
int inhibited_slices(const CureModel& model, int target_layers, int last_lit);

}  // namespace slicecorr::detail
