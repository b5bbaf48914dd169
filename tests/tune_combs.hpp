// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Combs and plugs of figure 2.2's process, and files, for tests of tuning.
#pragma once

#include <random>

#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/tuned_together.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins::combs {

using Runs = std::vector<std::pair<int, int>>;

inline const Printer kPrinter = test::linear_printer(1, 100);
inline const Resin kResin = test::resin(576, 2000);
inline const Process kProcess = test::process(1000);

/// 20 dark, teeth of 10, each with its gap behind it: 4, 6, 8, 12, 16; the last one's is given where
/// the part is made.
inline Runs comb() {
  Runs runs;
  int at = 20;
  for (const int gap : {4, 6, 8, 12, 16, 24}) {
    runs.push_back({at, at + 9});
    at += 10 + gap;
  }
  return runs;
}

inline MeasuredPart edges_of(const Runs& runs) {
  MeasuredPart part;
  part.process = kProcess;
  part.layer_um = 50;
  for (const auto& [first, last] : runs) {
    part.edges.push_back({"begin", MeasuredKind::upper, first * 50.0});
    part.edges.push_back({"end", MeasuredKind::lower, (last + 1) * 50.0});
  }
  return part;
}

/// A part, corrected by what is believed of printer and resin; `exact`: as if levels were endless.
/// `behind`: dark slices after the last feature.
inline MeasuredPart printed(const Runs& runs, const Printer& printer, const Resin& resin,
                            bool exact, int behind = 0) {
  MeasuredPart part = edges_of(runs);
  const int layers = runs.back().second + 1 + behind;
  const CureModel model = make_cure_model(printer, resin, kProcess, 50);
  const CorrectionPlan plan = test::plan_for(model, kProcess, layers);
  if (exact) {
    for (const double phi : solve_column_exactly(plan, test::column(layers, runs))) {
      part.intensity_mw_cm2.push_back(phi * model.critical_intensity_mw_cm2);
    }
  } else {
    const std::vector<double> levels = level_intensities(printer);
    for (const std::uint8_t level : solve_column(plan, test::column(layers, runs))) {
      part.intensity_mw_cm2.push_back(levels[level]);
    }
  }
  return part;
}

/// Measures a part of a printer whose truth is `truth` of the files.
inline void measure(MeasuredPart& part, const TuneVector& truth, std::mt19937& random,
                    double noise_um) {
  std::normal_distribution<double> noise(0, noise_um);
  const auto z = predict_edges(part, kPrinter, kResin, truth);
  for (std::size_t i = 0; i < z.size(); ++i) part.edges[i].measured_um = z[i] + noise(random);
}

inline constexpr const char* kResinFile =
    "name = \"r\"\n[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 2000.0\n"
    "absorbance_base = 10\ngel_dose_mj_cm3 = 115.2\ndose_factor = 5.0\n";
inline constexpr const char* kPrinterFile =
    "name = \"p\"\n[display]\nwidth_px = 16\nheight_px = 16\npixel_um = 50.0\n[blue]\n"
    "calibration = [[0, 1.0], [255, 100.0]]\n";

inline TuneResult found_so(const TuneVector& x) {
  TuneResult r;
  r.x = x;
  r.covariance = {{{1e-4, -5e-5, 1e-4}, {-5e-5, 2e-4, -2e-4}, {1e-4, -2e-4, 1e-2}}};
  return r;
}

}  // namespace slicecorr::resins::combs
