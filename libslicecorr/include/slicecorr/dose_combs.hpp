// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file dose_combs.hpp
/// A plate of combs, each corrected for a critical dose of its own: 1 to 8 times the gel dose (dissertation 2.3.2,
/// A.5). It is printed as it is. The comb whose teeth print as designed has the dose to aim at.
///
/// A comb is a spine with teeth of 10 slices, behind 20 dark slices, and gaps of 12, 16 and 20.
///
/// Immutable and thread-safe.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "slicecorr/measuring_form.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

class DoseCombs final : public SliceSource {
 public:
  struct Ask {
    double layer_um = 50;   ///< > 0
    double speed_mm_h = 0;  ///< at which it is printed, > 0
  };
  /// An edge that is measured.
  struct Row {
    std::string name, kind;  ///< "3 times: tooth 1 begins", "upper" or "lower"
    double dose_factor = 0;  ///< of its comb
    double designed_um = 0;  ///< from the platform
    PixelBox box{};          ///< of the comb
  };
  /// Images of the plate, corrected. Throws `InputError` where the display is too small, or the resin's gel dose
  /// is not known; `InfeasibleError` where no two doses can be printed at this speed.
  DoseCombs(const Printer& printer, const Resin& resin, const Ask& ask,
            const ExecutionContext& context = {});
  ~DoseCombs() override;

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return bounds_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  const std::vector<Row>& rows() const { return rows_; }
  /// Times the gel dose, of the combs on the plate, rising.
  const std::vector<double>& dose_factors() const { return factors_; }
  /// Why combs are not on it, each in a sentence.
  const std::vector<std::string>& left_out() const { return left_out_; }
  /// For how long each image is shown: a slice's height over the speed.
  std::vector<double> image_s() const;
  MeasuringForm form() const;
  /// A page to print; `form_file`: what the table is called, `printer_file`: the printer's file.
  std::string sheet(const std::string& form_file, const std::string& printer_file) const;

 private:
  class Comb;
  std::string printer_name_, resin_name_;
  Ask ask_;
  Grid grid_;
  PixelBox bounds_;
  std::vector<double> factors_;
  std::vector<std::unique_ptr<const Comb>> combs_;
  std::vector<Row> rows_;
  std::vector<std::string> left_out_;
};

}  // namespace slicecorr
