// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Draws docs/flat-field.png: the height error that a flat-field leaves over a display when the
// correction does not know it, and when it does. PRINTER RESIN SPEED_MM_H OUT.png
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/report.hpp"

namespace {

using namespace slicecorr;

constexpr int kLayers = 100;

struct Errors {
  double mean_um = 0, greatest_um = 0;
};

/// Two rungs of 20 slices and the gaps above them, corrected with one model and printed with
/// another.
Errors errors(const CureModel& believed, const CureModel& real, const Process& process) {
  const auto design = test::column(kLayers, {{30, 49}, {80, 99}});
  const auto plan = test::plan_for(believed, process, kLayers);
  const auto levels = solve_column(plan, design);
  const PixelCurve curve = pixel_curve(real);
  BandPredictor predictor(real, curve, plan.all_layers, 1);
  for (int n = plan.all_layers; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    const auto pixel = static_cast<std::uint8_t>(pixel_of_level(levels[k], plan.levels.size()));
    const std::uint8_t cover = n < kLayers ? design[k] : 0;
    predictor.add_slice(n, &pixel, &cover);
  }
  const Prediction p = predictor.finish(0, 0, 1);
  return {p.height_error_um.mean(), p.height_error_um.greatest()};
}

/// White to red to black at 300 um and more.
void colour(double um, std::uint8_t* rgb) {
  const double t = std::min(1.0, std::log1p(um) / std::log1p(300.0));
  rgb[0] = static_cast<std::uint8_t>(255 - 175 * std::max(0.0, 2 * t - 1));
  rgb[1] = static_cast<std::uint8_t>(255 * std::max(0.0, 1 - 1.3 * t));
  rgb[2] = static_cast<std::uint8_t>(245 * std::max(0.0, 1 - 1.6 * t));
}

int draw(const std::string& printer_name, const std::string& resin_name, double speed_mm_h,
         const std::string& path) {
  const Printer printer = load_printer(printer_name);
  const Resin resin = load_resin(resin_name);
  const Process process = test::process(speed_mm_h);
  Grid grid = plate_grid(printer);
  grid.layers = kLayers;
  grid.layer_um = 50;
  const PlaceModels models(printer, resin, process, grid, {});
  const CureModel& even = models.model(models.map().reference());
  const int step = std::max(1, grid.width_px / 420);
  const int width = grid.width_px / step, height = grid.height_px / step;
  std::array<Errors, 256> without{}, with{};
  std::array<bool, 256> known{};
  ColourImage left{width, height, {}}, right{width, height, {}};
  Errors sum_without, sum_with;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::uint8_t v = models.map().value(x * step + step / 2, y * step + step / 2);
      if (!known[v]) {
        without[v] = errors(even, models.model(v), process);
        with[v] = errors(models.model(v), models.model(v), process);
        known[v] = true;
      }
      std::uint8_t rgb[3];
      colour(without[v].mean_um, rgb);
      left.rgb.insert(left.rgb.end(), rgb, rgb + 3);
      colour(with[v].mean_um, rgb);
      right.rgb.insert(right.rgb.end(), rgb, rgb + 3);
      sum_without.mean_um += without[v].mean_um / (1.0 * width * height);
      sum_with.mean_um += with[v].mean_um / (1.0 * width * height);
      sum_without.greatest_um = std::max(sum_without.greatest_um, without[v].greatest_um);
      sum_with.greatest_um = std::max(sum_with.greatest_um, with[v].greatest_um);
    }
  }
  const auto png = encode_png(side_by_side(left, right));
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
  fmt::print(
      "light {}\nwithout: mean {:.2f} um, greatest {:.2f} um\nwith: mean {:.2f} um, greatest "
      "{:.2f} um\n",
      light_in_words(printer), sum_without.mean_um, sum_without.greatest_um, sum_with.mean_um,
      sum_with.greatest_um);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "flat_field_map PRINTER RESIN SPEED_MM_H OUT.png\n");
    return 2;
  }
  try {
    return draw(argv[1], argv[2], std::atof(argv[3]), argv[4]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "flat_field_map: %s\n", e.what());
    return 2;
  }
}
