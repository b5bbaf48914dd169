// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What fails in the cases of a robust correction.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "bands/robust_design.hpp"
#include "bands/robust_edges.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::detail {

/// Doses of a band in both cases, at the nodes of each layer.
class CaseDoses {
 public:
  CaseDoses(const CureModel& model, const RobustAsk& ask, std::size_t columns);
  CaseDoses(const CaseDoses&) = delete;
  CaseDoses& operator=(const CaseDoses&) = delete;

  void add_slice(int slice, const std::uint8_t* pixels);
  const double* weak_lower() const { return weak_dose_ ? weak_dose_->lower() : weak_[0].data(); }
  const double* weak_upper() const { return weak_dose_ ? weak_dose_->upper() : weak_[1].data(); }
  const double* strong_lower() const {
    return strong_dose_ ? strong_dose_->lower() : strong_[0].data();
  }
  const double* strong_upper() const {
    return strong_dose_ ? strong_dose_->upper() : strong_[1].data();
  }

 private:
  const DoseVariance variance_;
  const double chi_;
  std::unique_ptr<BandDose> weak_dose_, strong_dose_;
  std::unique_ptr<BandDerivatives> derivatives_;
  std::array<std::vector<double>, 2> weak_, strong_;
};

/// Finds what fails in the cases, and with inputs as said, slices from the last to the first.
class RobustWatch {
 public:
  RobustWatch(const CorrectionPlan& plan, const RobustAsk& ask, std::size_t columns);
  void add_slice(int slice, const std::uint8_t* pixels, const std::uint8_t* coverage);
  std::vector<RobustTrouble> finish();

 private:
  struct Column {
    CoverKind kind = CoverKind::gap;
    bool run_below = false;
    int bottom = 0;
    double extreme = std::numeric_limits<double>::infinity();
    double as_said = std::numeric_limits<double>::infinity();
  };
  void close(std::size_t i, int top);
  const bool merged_;  ///< gaps of one slice are to fill
  CaseDoses doses_;
  BandDose as_said_;
  std::vector<Column> columns_;
  std::vector<RobustTrouble> troubles_;
};

}  // namespace slicecorr::detail
