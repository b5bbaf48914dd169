// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The equations of chemistry.hpp given to CVODE of SUNDIALS, as they stand there: one cell, or a line of cells between
/// walls with diffusion by second differences. Shares no code with the product but the struct of figures.
#pragma once

#include <cvode/cvode.h>
#include <gtest/gtest.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_band.h>
#include <sunmatrix/sunmatrix_band.h>

#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <vector>

#include "slicecorr/chemistry.hpp"

namespace slicecorr::test {

class CvodePeer {
 public:
  /// Species of a cell, in this order.
  enum Species { I, Ir, P0, P1, P2, P3, O, Q, kSpecies };

  /// `intensity_mw_cm2` has one for each cell; `dx_um` counts for several.
  CvodePeer(const Chemistry& c, std::vector<double> intensity_mw_cm2, double dx_um = 1,
            double supply_per_s = 0, double relative = 1e-9)
      : c_(c), dx_um_(dx_um), supply_(supply_per_s) {
    for (const double i : intensity_mw_cm2) kd_.push_back(initiation_per_s(c, i));
    const auto n = static_cast<sunindextype>(kd_.size() * kSpecies);
    SUNContext_Create(nullptr, &context_);
    y_ = N_VNew_Serial(n, context_);
    tolerance_ = N_VNew_Serial(n, context_);
    const double start[kSpecies] = {c.initiator_mol_l, 0, c.groups_mol_l, 0, 0, 0, c.oxygen_mol_l,
                                    c.inhibitor_mol_l};
    const double least[kSpecies] = {1e-12, 1e-20, 1e-12, 1e-17, 1e-12, 1e-14, 1e-16, 1e-16};
    for (sunindextype k = 0; k < n; ++k) {
      NV_Ith_S(y_, k) = start[k % kSpecies];
      NV_Ith_S(tolerance_, k) = least[k % kSpecies];
    }
    cvode_ = CVodeCreate(CV_BDF, context_);
    CVodeInit(cvode_, &CvodePeer::slope, 0, y_);
    CVodeSetUserData(cvode_, this);
    CVodeSVtolerances(cvode_, relative, tolerance_);
    CVodeSetMaxNumSteps(cvode_, 10000000);
    const sunindextype band = std::min<sunindextype>(n - 1, kSpecies);
    matrix_ = SUNBandMatrix(n, band, band, context_);
    solver_ = SUNLinSol_Band(y_, matrix_, context_);
    CVodeSetLinearSolver(cvode_, solver_, matrix_);
  }
  ~CvodePeer() {
    CVodeFree(&cvode_);
    SUNLinSolFree(solver_);
    SUNMatDestroy(matrix_);
    N_VDestroy(y_);
    N_VDestroy(tolerance_);
    SUNContext_Free(&context_);
  }
  CvodePeer(const CvodePeer&) = delete;
  CvodePeer& operator=(const CvodePeer&) = delete;

  double at(std::size_t cell, Species s) const {
    return NV_Ith_S(y_, static_cast<sunindextype>(cell * kSpecies + s));
  }
  /// Another light from now on.
  void light(double intensity_mw_cm2) {
    for (double& kd : kd_) kd = initiation_per_s(c_, intensity_mw_cm2);
    CVodeReInit(cvode_, time_, y_);
  }
  void advance_to(double seconds) { EXPECT_GE(CVode(cvode_, seconds, y_, &time_, CV_NORMAL), 0); }
  /// The time at which a cell has gelled, within the step by the polynomial that CVODE has for it.
  double gel_time(std::size_t cell, double most_s) {
    const double level = c_.groups_mol_l * (1 - c_.gel_conversion);
    double from = time_;
    while (time_ < most_s) {
      if (CVode(cvode_, most_s, y_, &time_, CV_ONE_STEP) < 0) break;
      if (at(cell, P0) > level) {
        from = time_;
        continue;
      }
      double to = time_;
      while (to - from > 1e-9 * to) {
        const double middle = (from + to) / 2;
        EXPECT_EQ(CVodeGetDky(cvode_, middle, 0, y_), 0);
        (at(cell, P0) > level ? from : to) = middle;
      }
      return to;
    }
    return std::numeric_limits<double>::infinity();
  }
  long steps() const {
    long n = 0;
    CVodeGetNumSteps(cvode_, &n);
    return n;
  }

 private:
  static int slope(realtype, N_Vector y, N_Vector dy, void* self) {
    const CvodePeer& p = *static_cast<CvodePeer*>(self);
    const Chemistry& c = p.c_;
    const std::size_t cells = p.kd_.size();
    const double* a = NV_DATA_S(y);
    double* d = NV_DATA_S(dy);
    const double D[kSpecies] = {
        c.initiator_um2_s.value_or(0), c.radical_um2_s.value_or(0),  0, 0, 0, 0,
        c.oxygen_um2_s.value_or(0),    c.inhibitor_um2_s.value_or(0)};
    for (std::size_t k = 0; k < cells; ++k) {
      const double* s = a + k * kSpecies;
      double* r = d + k * kSpecies;
      const double start = c.initiation_l_mol_s * s[P0] * s[Ir];
      const double grow = c.propagation_l_mol_s * s[P0] * s[P1];
      const double end = c.termination_l_mol_s * s[P1] * s[P1];
      const double by_O = c.oxygen_l_mol_s * s[P1] * s[O],
                   by_Q = c.inhibitor_l_mol_s * s[P1] * s[Q];
      const double lost = c.initiator_oxygen_l_mol_s * s[Ir] * s[O];
      r[I] = -p.kd_[k] * s[I];
      r[Ir] = 2 * p.kd_[k] * s[I] - start - lost;
      r[P0] = -start - grow;
      r[P1] = start - 2 * end - by_O - by_Q;
      r[P2] = grow + 2 * end;
      r[P3] = by_O + by_Q;
      r[O] = -by_O - lost + p.supply_ * (c.oxygen_mol_l - s[O]);
      r[Q] = -by_Q;
      if (cells == 1) continue;
      for (std::size_t j = 0; j < kSpecies; ++j) {
        const double left = k > 0 ? s[j - kSpecies] : s[j];
        const double right = k + 1 < cells ? s[j + kSpecies] : s[j];
        r[j] += D[j] * (left + right - 2 * s[j]) / (p.dx_um_ * p.dx_um_);
      }
    }
    return 0;
  }

  Chemistry c_;
  std::vector<double> kd_;
  double dx_um_, supply_;
  SUNContext context_ = nullptr;
  N_Vector y_ = nullptr, tolerance_ = nullptr;
  void* cvode_ = nullptr;
  SUNMatrix matrix_ = nullptr;
  SUNLinearSolver solver_ = nullptr;
  realtype time_ = 0;
};

}  // namespace slicecorr::test
