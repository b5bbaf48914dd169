// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Prints the tables of docs/levels.md: what a number of grey levels can do.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "models.hpp"
#include "printed_column.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/units.hpp"

namespace {

using namespace slicecorr;

struct Row {
  double mean_um = 0, worst_um = 0, bound_um = 0;
  std::uint64_t wrong = 0;
};

/// The rung column and the rail column of the ladder.
Row ladder(const Printer& printer, double cap) {
  const Process process = test::process(1000, cap);
  const CureModel model = make_cure_model(printer, test::resin(576, 2000), process, 50);
  const PixelCurve curve = pixel_curve(model);
  Row row;
  Prediction sum;
  for (const auto& design : {test::column(50, {{11, 20}, {31, 40}}), test::column(50, {{0, 49}})}) {
    const auto plan = test::plan_for(model, process, 50);
    const auto levels = solve_column(plan, design);
    BandPredictor predictor(model, curve, plan.all_layers, 1);
    for (int n = plan.all_layers; n-- > 0;) {
      const auto k = static_cast<std::size_t>(n);
      const auto pixel = static_cast<std::uint8_t>(pixel_of_level(levels[k], printer.levels()));
      const std::uint8_t cover = n < 50 ? design[k] : 0;
      predictor.add_slice(n, &pixel, &cover);
      // One level step of the slice that decides an edge, and where it moves the edge.
      const bool lower = cover == 0 && n > 0 && n <= 50 && design[k - 1];
      const bool upper = cover && n > 0 && design[k - 1] == 0;
      if (!lower && !upper) continue;
      const int level = std::max<int>(levels[k], 1);
      const double step = model.level_phi[static_cast<std::size_t>(level)] -
                          model.level_phi[static_cast<std::size_t>(level) - 1];
      const double into = upper ? model.level_phi[levels[k - 1]] : model.level_phi[levels[k]];
      row.bound_um = std::max(row.bound_um, 50 * step * model.one_minus_a /
                                                (units::kLn10 * model.eta * std::abs(into - 1)));
    }
    sum.merge(predictor.finish(0, 0, 1));
  }
  row.mean_um = sum.height_error_um.mean();
  row.worst_um = sum.height_error_um.greatest();
  row.wrong = sum.cure_through_voxels + sum.undercure_voxels;
  return row;
}

void slits() {
  fmt::print(
      "| phi_max | shortfall, slices | largest other error, um | least contrast | wrong voxels "
      "|\n|---|---|---|---|---|\n");
  for (const double phi_max : {1.02, 1.2, 1.9, 2.5, 6.25}) {
    for (const double shortfall : {0.05, kDefaultGapShortfall, 0.5}) {
      Process process = test::process(1000);
      process.gap_shortfall = shortfall;
      std::vector<std::uint8_t> design(4, 0);
      for (int k = 0; k < 12; ++k) {
        design.insert(design.end(), 5, 255);
        design.push_back(0);
      }
      design.insert(design.end(), 5, 255);
      const test::PrintedColumn p =
          test::print(test::model_of(50, 1500, phi_max, 100, 1, 8), process, design);
      fmt::print("| {:g} | {:g} | {:.3f} | {:.4f} | {} |\n", phi_max, shortfall, p.largest_um,
                 p.least_contrast, p.wrong());
    }
  }
}

void random_columns() {
  struct Kind {
    std::string words;
    unsigned least;
    std::vector<unsigned> most;
    double brightest;
  };
  const std::vector<Kind> kinds = {{"3 to 25", 3, {25}, 40},
                                   {"1 to 2, 4, 12 or 25", 1, {2, 4, 12, 25}, 40},
                                   {"the same, phi_max to 2.5", 1, {2, 4, 12, 25}, 2.5}};
  constexpr int columns = 40, layers = 60;
  fmt::print(
      "| runs, slices | levels | columns without a wrong voxel | their largest error, median, um | "
      "90 % | wrong voxels of the others |\n|---|---|---|---|---|---|\n");
  for (const Kind& kind : kinds) {
    for (const int bits : {8, 6, 4}) {
      std::mt19937 random(7);
      const auto between = [&](double low, double high) {
        return low * std::pow(high / low, static_cast<double>(random()) / 4294967296.0);
      };
      std::vector<double> errors;
      std::uint64_t wrong = 0;
      for (int i = 0; i < columns; ++i) {
        const double phi_max = between(1.02, kind.brightest);
        const double layer_um = between(10, 100), ha_um = between(100, 5000);
        const double contrast = std::max(between(20, 1000), 1.2 * phi_max);
        const double gamma = between(0.6, 3);
        std::vector<std::uint8_t> design;
        const unsigned most = kind.most[random() % kind.most.size()];
        for (std::uint8_t c = random() % 2 ? 255 : 0; design.size() < layers;
             c = static_cast<std::uint8_t>(255 - c)) {
          design.insert(design.end(), kind.least + random() % (most - kind.least + 1), c);
        }
        const test::PrintedColumn p =
            test::print(test::model_of(layer_um, ha_um, phi_max, contrast, gamma, bits),
                        test::process(1000), design);
        wrong += p.wrong();
        if (p.wrong() == 0) errors.push_back(p.largest_um);
      }
      std::sort(errors.begin(), errors.end());
      fmt::print("| {} | {} | {} of {} | {:.3f} | {:.2f} | {} |\n", kind.words, 1 << bits,
                 errors.size(), columns, errors[errors.size() / 2], errors[errors.size() * 9 / 10],
                 wrong);
    }
  }
}

}  // namespace

int main() {
  Printer nine = test::linear_printer(1, 100);
  nine.calibration = {{0, 1.0},    {20, 1.2},   {50, 4.0},   {90, 14.0},  {120, 26.0},
                      {170, 52.0}, {200, 71.0}, {240, 95.0}, {255, 100.0}};
  const std::vector<std::pair<std::string, Printer>> printers = {
      {"256 levels, linear", test::linear_printer(1, 100)},
      {"256 levels, gamma 3", test::gamma_printer(1, 100, 3)},
      {"256 levels, 9 uneven points", nine},
      {"64 levels, linear", test::linear_printer(1, 100, 6)},
      {"16 levels, linear", test::linear_printer(1, 100, 4)},
      {"16 levels, gamma 3", test::gamma_printer(1, 100, 3, 4)},
      {"4 levels, linear", test::linear_printer(1, 100, 2)},
  };
  fmt::print(
      "| curve | cap of the dose | mean, um | largest, um | one level step, um | wrong voxels |\n"
      "|---|---|---|---|---|---|\n");
  for (const auto& [name, printer] : printers) {
    for (const double cap : {1.0, 2.0, 1e300}) {
      const Row r = ladder(printer, cap);
      fmt::print("| {} | {} | {:.3f} | {:.3f} | {:.3f} | {} |\n", name,
                 cap >= 1e300 ? "none" : fmt::format("{:g}", cap), r.mean_um, r.worst_um,
                 r.bound_um, r.wrong);
    }
  }
  fmt::print("\n");
  slits();
  fmt::print("\n");
  random_columns();
  return 0;
}
