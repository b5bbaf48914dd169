// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What scans of parts would tell, before any is printed.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <random>

#include "slicecorr/error.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/resins/scan_tune.hpp"
#include "tune/scan_inputs.hpp"

namespace slicecorr::resins {

ScanForecast forecast_scan(const PrintScan& print, const Setup& setup, const TunePrior& prior,
                           double noise_um, const ScanTuneOptions& options,
                           const ExecutionContext& context) {
  if (!(noise_um >= 0) || !std::isfinite(noise_um)) {
    throw InputError(fmt::format("points lie {:g} um off; expected 0 or more", noise_um));
  }
  Setup own = setup;
  if (print.process) own.process = *print.process;
  const PlaceModels models(own.printer, own.resin, own.process, print.shown->grid(),
                           print.shown->frame());
  const SurfaceSamples samples = sample_surface(
      predicted_surface(*print.shown, models, kMostPredictedTriangles, context), options.points);
  Scan scan;
  scan.unit = "mm";
  scan.points = samples.points;
  scan.normals = samples.normals;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 1e-3 * noise_um);
  for (Point3& p : scan.points) {
    for (double& c : p) c += noise_um > 0 ? noise(random) : 0;
  }
  const ScanTuneResult r =
      tune_by_scans({{&scan, print.shown, print.process}}, setup, prior, options, context);
  return {"", r.findings, r.not_apart};
}

std::string forecast_text(const std::vector<ScanForecast>& parts, double noise_um) {
  // In units of what people say, times 1.96: per cent of height and light, mW/cm², per cent, um.
  struct Unit {
    const char* name;
    double times;
  };
  constexpr std::array<Unit, kScanInputs> units{{{"%", 100},
                                                 {"%", 100},
                                                 {"mW/cm²", 1},
                                                 {"share", 1},
                                                 {"%", 100},
                                                 {"%", 100},
                                                 {"um", 1000},
                                                 {"um", 1000},
                                                 {"um", 1},
                                                 {"um²/um", 1},
                                                 {"%", 100}}};
  std::string out = fmt::format(
      "what a scan of each would tell, points {:g} um off: 95 % within plus or minus so much\n\n{:36} {:>8}",
      noise_um, "", "before");
  for (const ScanForecast& p : parts) out += fmt::format("  {:>12}", p.part);
  out += '\n';
  for (std::size_t k = 0; k < kScanInputs; ++k) {
    std::string line;
    double before = 0;
    for (const ScanForecast& p : parts) {
      const ScanFinding& f = p.findings[k];
      if (!f.sought) {
        line += fmt::format("  {:>12}", "not sought");
        continue;
      }
      before = 1.96 * f.sd_before * units[k].times;
      line += fmt::format(
          "  {:>12}", f.told() ? fmt::format("{:.2g}", 1.96 * f.sd * units[k].times) : "not told");
    }
    if (!(before > 0)) continue;
    out += fmt::format("{:36} {:8.3g}{}\n", fmt::format("{}, {}", kScanNames[k], units[k].name),
                       before, line);
  }
  for (const ScanForecast& p : parts) {
    for (const std::string& text : p.not_apart) {
      out += fmt::format("{} would not tell apart: {}\n", p.part, text);
    }
  }
  return out;
}

}  // namespace slicecorr::resins
