// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file cell_law.hpp
/// Light and law of dose in one cell, level by level: Y signed with a life of its store, m other than
/// 1, the clamp.
#pragma once

#include <limits>
#include <vector>

#include "gap_band.hpp"
#include "slicecorr/flow.hpp"

namespace slicecorr::detail {

/// Which piece of the law holds in a level.
enum class DosePiece : unsigned char {
  dose,   ///< Y >= 0
  store,  ///< Y < 0: inhibitor, which decays
  empty,  ///< held at 0, between the two
};

/// Dose that each level gains per light while resin rises through it, s.
struct LevelLight {
  void resize(std::size_t n) {
    blue.resize(n);
    uv.resize(n);
  }
  /// For a gap, um, and a speed, um/s.
  void set(const Kinetics& k, const GapLevels& levels, double gap_um, double um_s);
  std::vector<double> blue;
  std::vector<double> uv;  ///< with -beta
};

/// One cell at a time: its matrix and sources, and the solve that finds the pieces.
class CellLaw {
 public:
  CellLaw(const FlowResin& resin, const GapLevels& levels);

  /// Goes to a cell. `diagonal`: of the plan's flow, `spread` = c/(S h).
  void go_to(double diagonal, double spread, double gap_um, double um_s, const LevelLight& light,
             double blue, double uv);
  /// `y`: what flows in; replaced by the cell's dose. Fills `piece`.
  void solve(double* y, DosePiece* piece);
  /// The transposed solve with these pieces; `slope_blue` and `slope_uv` are what the light counts.
  void solve_back(const DosePiece* piece, double* y, double& slope_blue, double& slope_uv);

 private:
  BandRow row(std::size_t j, DosePiece piece) const;
  void factor(const DosePiece* piece);
  double source(std::size_t j, DosePiece piece) const;
  void march(double* y, DosePiece* piece) const;
  bool better(const double* in, const double* y, DosePiece* piece) const;
  double thick(std::size_t j) const { return levels_.face[j + 1] - levels_.face[j]; }
  DosePiece negative() const {
    return resin_.inhibitor_life_s > 0 ? DosePiece::store : DosePiece::empty;
  }

  const FlowResin& resin_;
  const GapLevels& levels_;
  std::vector<double> stored_, gained_, gained_blue_, gained_uv_;
  std::vector<double> below2_, below_, inverse_, in_;
  const LevelLight* light_ = nullptr;
  double diagonal_ = 0, spread_ = 0, decay_ = 0;
};

}  // namespace slicecorr::detail
