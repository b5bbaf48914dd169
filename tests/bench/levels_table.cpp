// Prints docs/levels.md: what a number of grey levels can do on the ladder of dissertation
// figure 2.2.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "models.hpp"
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
                                                (units::ln10 * model.eta * std::abs(into - 1)));
    }
    sum.merge(predictor.finish(0, 0, 1));
  }
  row.mean_um = sum.height_error_um.mean();
  row.worst_um = sum.height_error_um.greatest();
  row.wrong = sum.cure_through_voxels + sum.undercure_voxels;
  return row;
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
      "# What grey levels can do\n\n"
      "Ladder of dissertation figure 2.2 (rungs at slices 11-20 and 31-40 of 50, rails full "
      "height; "
      "critical dose 576 mJ/cm³, slices of 50 um, absorbance height 2000 um, 1000 mm/h, 1 to 100 "
      "mW/cm²), corrected with different projector curves. *Reached*: height errors of the "
      "corrected "
      "stack as its levels print it. *Bound*: how far one level step moves the edge that it moves "
      "most, hs·dphi·(1-a)/(ln10·eta·|phi-1|), phi the intensity in the layer the edge moves into. "
      "Levels are chosen so that voxels print right; errors are overreach, except where steps are "
      "so coarse that an edge gives way to keep a gap open.\n\n"
      "| curve | cap of the dose | mean, um | largest, um | bound, um | wrong voxels |\n"
      "|---|---|---|---|---|---|\n");
  for (const auto& [name, printer] : printers) {
    for (const double cap : {1.0, 2.0, 1e300}) {
      const Row r = ladder(printer, cap);
      fmt::print("| {} | {} | {:.3f} | {:.3f} | {:.3f} | {} |\n", name,
                 cap >= 1e300 ? "none" : fmt::format("{:g}", cap), r.mean_um, r.worst_um,
                 r.bound_um, r.wrong);
    }
  }
  fmt::print(
      "\nPrinted by `build/bin/levels_table`. With 4 levels a step at the upper edge (33 % of full "
      "light) is larger than what the gap above can take: a voxel stays wrong. `slicecorr "
      "verify` "
      "says so.\n");
  return 0;
}
