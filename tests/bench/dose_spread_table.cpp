// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What dose that spreads costs: contrast without it, with it but not counted by the solver, and made
// up for, also in a time that is fixed. dose_spread_table [wheel|gyroid [VOXELS...]]
#include <fmt/format.h>
#include <sys/resource.h>

#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/load_printer.hpp"
#include "slicecorr/tomo/print.hpp"

using namespace slicecorr;
using namespace slicecorr::tomo;

namespace {

double used_s() {
  rusage u{};
  getrusage(RUSAGE_SELF, &u);
  return static_cast<double>(u.ru_utime.tv_sec) + 1e-6 * static_cast<double>(u.ru_utime.tv_usec);
}

/// T1 of tomography.md, eight teeth and a shaft, or a gyroid, with two empty slices at both ends.
Box<std::uint8_t> part_of(std::string_view name, int n, int slices) {
  Box<std::uint8_t> part{slices, n, n, {}};
  part.values.assign(static_cast<std::size_t>(slices * n * n), 0);
  const double middle = 0.5 * (n - 1);
  for (int z = 2; z < slices - 2; ++z) {
    for (int iy = 0; iy < n; ++iy) {
      for (int ix = 0; ix < n; ++ix) {
        const double x = (ix - middle) / middle, y = (iy - middle) / middle;
        const double h = (z - 0.5 * (slices - 1)) / middle, r = std::hypot(x, y);
        const double k = 3 * std::numbers::pi;
        const bool wheel = (r >= .30 && r < .60) ||
                           (r >= .60 && r < .75 && std::cos(8 * std::atan2(y, x)) > 0) || r < .12;
        const bool gyroid =
            std::abs(std::sin(k * x) * std::cos(k * y) + std::sin(k * y) * std::cos(k * h) +
                     std::sin(k * h) * std::cos(k * x)) < .45 &&
            r < .70;
        part.values[part.at(z, iy, ix)] = (name == "wheel" ? wheel : gyroid) ? 255 : 0;
      }
    }
  }
  return part;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view name = argc > 1 ? argv[1] : "wheel";
  const Printer printer =
      load_printer(SLICECORR_SOURCE_DIR "/resins/printers/model-tomography-bench.toml");
  Resin resin = load_resin(SLICECORR_SOURCE_DIR "/resins/db/model-tomography-resin.toml");
  const double voxel_mm = 0.25;
  const Box<std::uint8_t> part =
      part_of(name, voxels_across(printer, voxel_mm), name == "wheel" ? 20 : 48);
  PrintOptions options;
  options.angles = 180;
  const auto tell = [&](const char* what, const PrintFigures& f, double s) {
    fmt::print("{:<22} contrast {:.3f} bound {:.3f} ver {:.2e} pw {:.3f} turns {} time {:.1f} s\n",
               what, f.metrics.contrast, f.contrast_bound, f.metrics.ver, f.metrics.pw, f.turns, s);
    std::fflush(stdout);
  };
  double from = used_s();
  const Print still = solve_print(part, voxel_mm, printer, resin, options);
  tell("without", still.figures, used_s() - from);
  std::vector<double> spreads{0.5, 1.0, 2.0};
  if (argc > 2) spreads.clear();
  for (int i = 2; i < argc; ++i) spreads.push_back(std::stod(argv[i]));
  for (const double voxels : spreads) {
    const double deviation = voxels * voxel_mm * 1e-3;
    resin.dose_diffusion_m2_s = deviation * deviation / 2 / still.figures.print_time_s;
    TomoJob uncounted = still.job;
    uncounted.resin = resin;
    from = used_s();
    const PrintFigures f = figures_of(uncounted, dose_of(uncounted), part);
    fmt::print("{} voxels, {:.3g} m2/s\n", voxels, resin.dose_diffusion_m2_s);
    tell("  not made up for", f, used_s() - from);
    for (const double times : {0.0, 1.5}) {
      options.most_time_s = times * still.figures.print_time_s;
      from = used_s();
      try {
        const Print print = solve_print(part, voxel_mm, printer, resin, options);
        tell(times > 0 ? "  in 1.5 times the time" : "  made up for", print.figures,
             used_s() - from);
      } catch (const std::exception& e) {
        fmt::print("  {} ({:.1f} s)\n", e.what(), used_s() - from);
      }
    }
    options.most_time_s = 0;
  }
}
