// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How dose spreads in resin: the heat equation on the grid's voxels, solved exactly in time.
///
/// Dose moves between voxels of resin that touch, and nowhere else: none goes through the vial's
/// wall or into an insert, and none is lost. With L the differences to the six neighbours, in units
/// of a voxel's width squared, dose that has spread for a time t is exp(-kappa L) of what it was,
/// kappa = D t / h². Of a point far from all walls its variance along x, y and z is exactly 2 D t. A
/// wave of wavelength w along x has lambda = 2 - 2 cos(2 pi h/w), of which (2 pi h/w)² is the start.
/// Any function f of L is the Chebyshev series of f; so all of them are symmetric, and commute.
///
/// Above and below the slices resin goes on in the dark, with the inserts that the end slices have.
///
/// Thread-safe once made; the same bytes for any number of threads.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

/// f(L) as a series.
using SpreadSeries = std::vector<double>;

class DoseSpread {
 public:
  /// `insert`: opaque where above 0, on the grid; empty: none. `farthest_mm`: the greatest standard
  /// deviation that is asked for; so much resin above and below the slices counts.
  DoseSpread(const TomoGrid& grid, const Box<std::uint8_t>& insert, double farthest_mm);

  /// A number for each voxel of resin: column by column, z innermost, `rows()` to a column.
  std::size_t size() const { return columns_.size() * stride_; }
  /// Where slice 0 of the voxel (x, y) is, its other slices after it; none outside of the resin.
  std::size_t at(int x, int y) const;
  /// Slices of dark resin below, and above, those of the grid.
  int below() const { return pad_; }
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  /// To 1e-7 of the largest f: the series of f(lambda), lambda >= 0.
  SpreadSeries series(const std::function<double(double)>& f) const;
  /// f(L) of these numbers, in place. Those where no resin is don't count and become 0.
  void apply(const SpreadSeries& f, Array<float>& numbers, const ExecutionContext& context) const;

 private:
  struct Column {
    int x = 0, y = 0;
    std::array<int, 4> beside{};  ///< numbers of the columns that touch it
    int neighbours = 0;
  };
  void step(std::size_t column, float add, float factor, const float* first, const float* last,
            float* out) const;

  TomoGrid grid_;
  int pad_ = 0;
  std::size_t count_ = 0;   ///< of numbers in a column
  std::size_t stride_ = 0;  ///< of columns
  float along_z_ = 1;       ///< weight of neighbours along z
  double most_ = 0;         ///< no eigenvalue of L is larger
  std::vector<Column> columns_;
  std::vector<int> column_of_;  ///< [y][x]; -1: none
  Array<float> open_;           ///< 1 resin, 0 insert; empty: all resin
};

/// exp(-kappa lambda), after the time of which kappa is.
double spread_for(double kappa, double lambda);
/// The mean of what so many turns leave, each spread for half of its own time, in which its light
/// comes, and for that of all turns after it. `kappa` of one turn.
double spread_of_turns(int turns, double kappa, double lambda);

}  // namespace slicecorr::tomo::detail
