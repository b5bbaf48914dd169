// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resin that ends at a depth above the window: doses against their sums, then prints.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "models.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::linear_printer;

constexpr double kHeightUm = 2000, kLayerUm = 50;

Printer printer_with_depth(double depth_um) {
  Printer p = linear_printer(1, 100);
  p.resin_depth_um = depth_um;
  return p;
}

CureModel model_with_depth(double depth_um, const Process& process = test::process(1000)) {
  return make_cure_model(printer_with_depth(depth_um), test::resin(576, kHeightUm), process,
                         kLayerUm);
}

Process with_bottom_layers(double exposure_s) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = exposure_s;
  p.bottom_exposure_s = 3 * exposure_s;
  p.bottom_layers = 4;
  return p;
}

std::vector<std::uint8_t> random_pixels(int slices) {
  std::mt19937 random(7);
  std::vector<std::uint8_t> pixels;
  for (int n = 0; n < slices; ++n) pixels.push_back(static_cast<std::uint8_t>(random() % 256));
  return pixels;
}

/// Dose at `zeta` from the slices that shine through at most `depth` slices of resin: each is the
/// light between its nearer and its farther end, as far as the bath goes.
double direct_dose(const CureModel& model, const std::vector<double>& phi, double zeta, int depth) {
  const double fall = model.eta * std::log(10.0);
  double dose = 0;
  for (std::size_t k = 0; k < phi.size(); ++k) {
    const double from = std::max(0.0, static_cast<double>(k) - zeta);
    const double to = std::min<double>(depth, static_cast<double>(k) + 1 - zeta);
    if (to > from) dose += phi[k] * (std::exp(-from * fall) - std::exp(-to * fall));
  }
  return dose;
}

TEST(ResinDepth, LightThatGelsAtADepth) {
  // 1 / (1 - 10^(-H / ha)): even light of that intensity gives a dose of 1.
  for (const auto& [depth_um, phi] : {std::pair{4000.0, 1.01010}, {1000.0, 1.46248}}) {
    const CureModel model = model_with_depth(depth_um);
    EXPECT_NEAR(model.steady(phi), 1.0, 1e-5) << depth_um;
    const auto dose = node_doses(model, std::vector<double>(400, phi));
    EXPECT_NEAR(dose[0], 1.0, 1e-5) << depth_um;
  }
}

TEST(ResinDepth, DosesAreSumsOverTheBath) {
  const auto pixels = random_pixels(120);
  const CureModel model = model_with_depth(1000);
  EXPECT_EQ(model.bath_slices, 20);
  const PixelCurve curve = pixel_curve(model);
  std::vector<double> phi;
  for (const std::uint8_t p : pixels) phi.push_back(curve[p]);
  const ColumnDose dose = column_dose(model, pixels);
  const auto nodes = node_doses(model, phi);
  BandDose band(model, 1);
  InsideLayer inside;
  for (int n = 120; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    EXPECT_NEAR(dose.upper[k], direct_dose(model, phi, n, 20), 1e-12) << n;
    EXPECT_NEAR(dose.middle[k], direct_dose(model, phi, n + 0.5, 20), 1e-12) << n;
    EXPECT_NEAR(dose.lower[k], direct_dose(model, phi, n + 1, 20), 1e-12) << n;
    EXPECT_NEAR(dose.upper[k], nodes[k], 1e-12) << n;
    band.add_slice(n, &pixels[k]);
    band.inside(0, 0, inside);
    for (const double from_lower : inside.crossings) {
      EXPECT_NEAR(direct_dose(model, phi, n + 1 - from_lower, 20), 1.0, 1e-9) << n;
    }
  }
}

TEST(ResinDepth, DosesLayerByLayer) {
  const auto pixels = random_pixels(100);
  const CureModel model = model_with_depth(1000, with_bottom_layers(5));
  const PixelCurve curve = pixel_curve(model);
  const ColumnDose dose = column_dose(model, pixels);
  for (int n = 0; n < 100; ++n) {
    double near = 0;
    for (int k = n; k < std::min(100, n + 20); ++k) {
      near +=
          curve[pixels[static_cast<std::size_t>(k)]] * model.ratio(k) * std::pow(model.a, k - n);
    }
    EXPECT_NEAR(dose.lower[static_cast<std::size_t>(n)], near, 1e-10 * near) << n;
  }
}

TEST(ResinDepth, DeepResinHasNoEnd) {
  const CureModel none = model_with_depth(0), deep = model_with_depth(1e6);
  EXPECT_TRUE(none.is_plain());
  EXPECT_TRUE(deep.is_plain());
  EXPECT_FALSE(model_with_depth(4000).is_plain());
  // A depth of so many whole slices is not one less by rounding; a part of one is refused.
  EXPECT_EQ(model_with_depth(1050).bath_slices, 21);
  EXPECT_THROW(model_with_depth(1049), InputError);
  EXPECT_EQ(model_with_depth(kLayerUm * 7).bath_slices, 7);
}

TEST(ResinDepth, ShallowResinIsRefusedWithTheLeastDepth) {
  // phi_max 6.25: ha log10(6.25 / 5.25) = 151.4 um, four slices.
  const Process process = test::process(1000);
  EXPECT_NO_THROW(check_feasible(model_with_depth(200), printer_with_depth(200), process));
  try {
    check_feasible(model_with_depth(150), printer_with_depth(150), process);
    FAIL() << "150 um of resin can't gel";
  } catch (const InfeasibleError& e) {
    EXPECT_NE(std::string(e.what()).find("at least 200 um"), std::string::npos) << e.what();
  }
  EXPECT_THROW(model_with_depth(49), InputError);
  EXPECT_NO_THROW(model_with_depth(50));
}

TEST(ResinDepth, PrinterFile) {
  const std::string head =
      "[display]\nwidth_px = 8\nheight_px = 8\npixel_um = 50\n"
      "[blue]\ncalibration = [[0, 1], [255, 100]]\n";
  EXPECT_EQ(parse_printer(head, "p.toml").resin_depth_um, 0);
  EXPECT_EQ(parse_printer(head + "[vat]\ndepth_um = 4000\n", "p.toml").resin_depth_um, 4000);
  for (const char* bad : {"0", "-1", "inf", "nan", "\"deep\"", "1e8"}) {
    EXPECT_THROW(parse_printer(head + "[vat]\ndepth_um = " + bad + "\n", "p.toml"), InputError)
        << bad;
  }
  // As stacks record it, and back.
  const Printer printer = printer_with_depth(4000);
  const Resin resin = test::resin(576, kHeightUm);
  EXPECT_EQ(parse_definitions_json(definitions_json(printer, resin), "text").first, printer);
  const std::string without = definitions_json(printer_with_depth(0), resin);
  EXPECT_EQ(without.find("resin_depth"), std::string::npos);
}

/// Height errors, um, of the edges of a column whose slices show `levels`: by bisection in the dose
/// that is summed up directly, within a slice of each edge.
double worst_edge_um(const CureModel& model, const std::vector<std::uint8_t>& coverage,
                     const std::vector<std::uint8_t>& levels) {
  std::vector<double> phi;
  for (const std::uint8_t l : levels) phi.push_back(model.level_phi[l]);
  double worst = 0;
  for (std::size_t n = 1; n < coverage.size(); ++n) {
    if (coverage[n] == coverage[n - 1]) continue;
    double full = coverage[n] ? 0.5 : -0.5, empty = -full;
    const auto dose = [&](double off) {
      return direct_dose(model, phi, static_cast<double>(n) + off, model.bath_slices);
    };
    if (dose(full) < 1.0 || dose(empty) >= 1.0) {
      ADD_FAILURE() << "the middles of the layers at node " << n << " are wrong";
      continue;
    }
    for (int i = 0; i < 60; ++i) {
      const double middle = (full + empty) / 2;
      (dose(middle) >= 1.0 ? full : empty) = middle;
    }
    worst = std::max(worst, std::abs(full) * kLayerUm);
  }
  return worst;
}

TEST(ResinDepth, CorrectedColumnsPrint) {
  const auto coverage = column(200, {{0, 39}, {50, 59}, {80, 149}, {160, 190}});
  for (const double depth_um : {8000.0, 4000.0, 2000.0}) {
    const CureModel model = model_with_depth(depth_um);
    const CorrectionPlan plan = test::plan_for(model, test::process(1000), 200);
    const auto levels = solve_column(plan, coverage);
    EXPECT_LT(worst_edge_um(model, coverage, levels), 1.0) << depth_um;
    // The same in a band, and layers beyond the design end where they should.
    EXPECT_EQ(test::solve_band_of_one(plan, coverage), levels);
    const ColumnDose dose = column_dose(model, levels);
    for (std::size_t n = 0; n < coverage.size(); ++n) {
      EXPECT_EQ(dose.middle[n] >= 1.0, coverage[n] == 255) << depth_um << " layer " << n;
    }
  }
}

TEST(ResinDepth, NoVoxelOfRandomColumnsIsWrong) {
  // Down to one absorbance height of resin, with runs of two slices and more.
  for (const double depth_um : {8000.0, 4000.0, 2000.0}) {
    const CureModel model = model_with_depth(depth_um);
    std::mt19937 random(3);
    for (int k = 0; k < 300; ++k) {
      std::vector<std::uint8_t> coverage;
      bool full = random() % 2 != 0;
      while (coverage.size() < 200) {
        coverage.insert(coverage.end(), 2 + random() % 30, full ? 255 : 0);
        full = !full;
      }
      coverage.resize(200);
      const auto levels = solve_column(test::plan_for(model, test::process(1000), 200), coverage);
      const ColumnDose dose = column_dose(model, levels);
      for (std::size_t n = 0; n < coverage.size(); ++n) {
        ASSERT_EQ(dose.middle[n] >= 1.0, coverage[n] == 255)
            << depth_um << " column " << k << " layer " << n;
      }
    }
  }
}

TEST(ResinDepth, FewLevelsKnowTheBath) {
  for (const int bits : {3, 4, 5}) {
    for (const double depth_um : {8000.0, 4000.0}) {
      for (const double reflectance : {0.0, 0.1}) {
        Printer printer = linear_printer(1, 100, bits);
        printer.resin_depth_um = depth_um;
        printer.platform_reflectance = reflectance;
        const CureModel model =
            make_cure_model(printer, test::resin(576, kHeightUm), test::process(1000), kLayerUm);
        std::mt19937 random(3);
        for (int k = 0; k < 40; ++k) {
          std::vector<std::uint8_t> coverage;
          bool full = random() % 2 != 0;
          while (coverage.size() < 150) {
            coverage.insert(coverage.end(), 3 + random() % 30, full ? 255 : 0);
            full = !full;
          }
          coverage.resize(150);
          auto pixels = solve_column(test::plan_for(model, test::process(1000), 150), coverage);
          for (std::uint8_t& p : pixels) {
            p = static_cast<std::uint8_t>(pixel_of_level(p, 1 << bits));
          }
          const ColumnDose dose = column_dose(model, pixels);
          for (std::size_t n = 0; n < coverage.size(); ++n) {
            ASSERT_EQ(dose.middle[n] >= 1.0, coverage[n] == 255)
                << bits << " bits " << depth_um << " column " << k << " layer " << n;
          }
        }
      }
    }
  }
}

TEST(ResinDepth, BlackLightLayerByLayerAddsUpOverTheBathAlone) {
  // Black that gels in deep resin, but not in 500 um: 1 - 10^(-500 / 2000) = 0.438 of it.
  Process process = with_bottom_layers(1);
  process.bottom_layers = 0;
  process.exposure_s =
      1.5 * model_with_depth(0, process).one_minus_a / model_with_depth(0, process).phi_min();
  const auto check = [&](double depth_um) {
    check_feasible(model_with_depth(depth_um, process), printer_with_depth(depth_um), process);
  };
  EXPECT_THROW(check(0), InfeasibleError);
  EXPECT_NO_THROW(check(500));
  EXPECT_THROW(check(2000), InfeasibleError);  // 0.9 of it
  // The greatest dose of black that the program refuses by is that of the slices themselves.
  const CureModel model = model_with_depth(500, process);
  const ColumnDose dose = column_dose(model, std::vector<std::uint8_t>(100, 0));
  EXPECT_NEAR(*std::max_element(dose.lower.begin(), dose.lower.end()),
              1.5 * (1 - std::pow(10.0, -0.25)), 1e-9);
}

TEST(ResinDepth, CorrectedWithoutItTooLittleIsPrinted) {
  // What a correction for deep resin plans falls short where the resin ends.
  const auto coverage = column(120, {{0, 99}});
  const CureModel deep = model_with_depth(0), shallow = model_with_depth(1000);
  const auto blind = solve_column(test::plan_for(deep, test::process(1000), 120), coverage);
  const auto aware = solve_column(test::plan_for(shallow, test::process(1000), 120), coverage);
  const auto sums = [](const std::vector<std::uint8_t>& levels) {
    double sum = 0;
    for (const std::uint8_t l : levels) sum += l;
    return sum;
  };
  EXPECT_GE(sums(aware), sums(blind));
}

TEST(ResinDepth, CorrectedLayerByLayer) {
  const auto coverage = column(60, {{0, 19}, {25, 30}, {40, 59}});
  const Process process = with_bottom_layers(60);
  const CureModel model = model_with_depth(1000, process);
  const CorrectionPlan plan = test::plan_for(model, process, 60);
  const auto levels = solve_column(plan, coverage);
  EXPECT_EQ(test::solve_band_of_one(plan, coverage), levels);
  const ColumnDose dose = column_dose(model, levels);
  for (std::size_t n = 0; n < coverage.size(); ++n) {
    if (coverage[n] == 255) {
      EXPECT_GE(dose.upper[n], 1.0) << n;
    }
  }
}

}  // namespace
}  // namespace slicecorr
