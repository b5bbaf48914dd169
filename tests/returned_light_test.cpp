// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A platform that sends light back: doses against their sums, then prints.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "layerwise_models.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/simulate.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::layerwise;
using test::linear_printer;

constexpr double kHaUm = 2000, kHsUm = 50;

Printer printer_with(double reflectance, double depth_um = 0) {
  Printer p = linear_printer(1, 100);
  p.platform_reflectance = reflectance;
  p.resin_depth_um = depth_um;
  return p;
}

CureModel model_with(double reflectance, double depth_um = 0,
                     const Process& process = test::process(1000), double height_um = kHaUm,
                     double m = 1) {
  Resin resin = test::resin(576, height_um);
  if (m != 1) {
    resin.model = CureModelKind::kinetic;
    resin.m = m;
    resin.critical_dose_mj_cm3 = 0;
    resin.critical_dose_prime = 50;
  }
  return make_cure_model(printer_with(reflectance, depth_um), resin, process, kHsUm);
}

std::vector<std::uint8_t> random_runs(int slices) {
  std::mt19937 random(11);
  std::vector<std::uint8_t> pixels;
  // Runs of light and of dark: doses pass 1 and turn.
  while (static_cast<int>(pixels.size()) < slices) {
    pixels.insert(pixels.end(), 1 + random() % 8,
                  random() % 2 ? static_cast<std::uint8_t>(random() % 256) : std::uint8_t{0});
  }
  pixels.resize(static_cast<std::size_t>(slices));
  return pixels;
}

double share_um(double reflectance, double z_um, double height_um = kHaUm) {
  return 1 + reflectance * std::pow(10.0, -2 * z_um / height_um);
}

/// The intensities that pass a point, summed up over the slices and over the way to the platform and
/// back; continuous, m = 1.
double direct_dose(const CureModel& model, const std::vector<double>& phi, double zeta,
                   double reflectance) {
  const double fall = model.eta * std::log(10.0);
  const double bath = model.bath_slices > 0 ? model.bath_slices : 1e9;
  double dose = 0;
  for (std::size_t k = 0; k < phi.size(); ++k) {
    const double from = std::max(0.0, static_cast<double>(k) - zeta);
    const double to = std::min(bath, static_cast<double>(k) + 1 - zeta);
    if (to <= from) continue;
    const double there = std::exp(-from * fall) - std::exp(-to * fall);
    dose += phi[k] * (there + reflectance * std::exp(-2 * zeta * fall) * there);
  }
  return dose;
}

TEST(ReturnedLight, CheckValue) {
  EXPECT_NEAR(model_with(0.3).returned(10), 1.09487, 5e-6);
  EXPECT_NEAR(model_with(0.3).returned(0), 1.3, 1e-12);
  EXPECT_NEAR(model_with(0.3, 0, layerwise(60)).returned(10), 1.09487, 5e-6);
  // The power of the intensity, of which the light that returns is a part.
  EXPECT_NEAR(model_with(0.3, 0, test::process(1000), kHaUm, 0.8).returned(10),
              std::pow(share_um(0.3, 500), 0.8), 1e-12);
}

TEST(ReturnedLight, NoneLeavesTheModelAsItIs) {
  const CureModel none = model_with(0), dark = model_with(0, 0, layerwise(60));
  EXPECT_TRUE(none.is_plain());
  EXPECT_EQ(none.mirrored_slices, 0);
  EXPECT_EQ(none.returned(0), 1.0);
  EXPECT_EQ(dark.mirrored_slices, 0);
  EXPECT_FALSE(model_with(0.01).is_plain());
  // As far as a part in 10^12 of the light comes back, and no further.
  const CureModel some = model_with(0.3);
  EXPECT_GT(some.returned(some.mirrored_slices - 2), 1.0);
  EXPECT_LT(some.returned(some.mirrored_slices - 0.01) - 1, 1e-12);
}

TEST(ReturnedLight, DosesAreSumsOverBothWays) {
  const auto pixels = random_runs(120);
  for (const double depth_um : {0.0, 1500.0}) {
    const CureModel model = model_with(0.4, depth_um);
    const PixelCurve curve = pixel_curve(model);
    std::vector<double> phi;
    for (const std::uint8_t p : pixels) phi.push_back(curve[p]);
    const ColumnDose dose = column_dose(model, pixels);
    const auto nodes = node_doses(model, phi);
    for (int n = 0; n < 120; ++n) {
      const auto k = static_cast<std::size_t>(n);
      EXPECT_NEAR(dose.upper[k], direct_dose(model, phi, n, 0.4), 1e-11) << n;
      EXPECT_NEAR(dose.middle[k], direct_dose(model, phi, n + 0.5, 0.4), 1e-11) << n;
      EXPECT_NEAR(dose.lower[k], direct_dose(model, phi, n + 1, 0.4), 1e-11) << n;
      EXPECT_NEAR(dose.upper[k], nodes[k], 1e-11) << n;
    }
  }
}

TEST(ReturnedLight, DosesWithAnExponentAndLayerByLayer) {
  const auto pixels = random_runs(80);
  const CureModel powered = model_with(0.5, 0, test::process(100), kHaUm, 0.8);
  const CureModel none = model_with(0, 0, test::process(100), kHaUm, 0.8);
  const CureModel steps = model_with(0.5, 0, layerwise(60)),
                  plain = model_with(0, 0, layerwise(60));
  const ColumnDose a = column_dose(powered, pixels), b = column_dose(none, pixels);
  const ColumnDose c = column_dose(steps, pixels), d = column_dose(plain, pixels);
  for (std::size_t n = 0; n < 80; ++n) {
    const double z_um = static_cast<double>(n) * kHsUm;
    EXPECT_NEAR(a.middle[n], b.middle[n] * std::pow(share_um(0.5, z_um + 25), 0.8), 1e-10) << n;
    EXPECT_NEAR(c.lower[n], d.lower[n] * share_um(0.5, z_um + 50), 1e-10) << n;
    EXPECT_NEAR(c.middle[n], d.middle[n] * share_um(0.5, z_um + 25), 1e-10) << n;
    EXPECT_NEAR(c.upper[n], d.upper[n] * share_um(0.5, z_um), 1e-10) << n;
  }
}

TEST(ReturnedLight, InsideLayersAsInFineSteps) {
  // A strong mirror and resin that absorbs much: doses turn inside layers.
  int turned = 0, crossed = 0;
  for (const double m : {1.0, 0.8}) {
    const auto pixels = random_runs(60);
    const CureModel model = model_with(1, 0, test::process(m == 1 ? 300 : 30), 300, m);
    const PixelCurve curve = pixel_curve(model);
    BandDose band(model, 1);
    InsideLayer inside;
    double raw = 0;  // without the light that returns, at the layer's lower end
    for (int n = 60; n-- > 0;) {
      const std::uint8_t pixel = pixels[static_cast<std::size_t>(n)];
      band.add_slice(n, &pixel);
      const double phi = curve[pixel];
      const auto at = [&](double d) {
        const double left = std::pow(model.a, d);
        return (phi + (raw - phi) * left) * std::pow(share_um(1, (n + 1 - d) * kHsUm, 300), m);
      };
      constexpr int steps = 2000;
      double least = at(0);
      std::vector<double> crossings;
      for (int i = 1; i <= steps; ++i) {
        const double d = static_cast<double>(i) / steps;
        least = std::min(least, at(d));
        if ((at(d) >= 1.0) != (at(d - 1.0 / steps) >= 1.0)) crossings.push_back(d);
      }
      const bool turns = least < std::min(at(0), at(1)) * (1 - 1e-9);
      turned += turns;
      band.inside(0, 0, inside);
      EXPECT_NEAR(inside.least, least, 1e-5 * least + 1e-12) << n;
      const bool told = band.turning() && band.turning()[0];
      EXPECT_TRUE(told || !turns) << n;
      ASSERT_EQ(inside.crossings.size(), crossings.size()) << n;
      for (std::size_t i = 0; i < crossings.size(); ++i) {
        EXPECT_NEAR(inside.crossings[i], crossings[i], 1.0 / steps) << n;
        EXPECT_NEAR(at(inside.crossings[i]), 1.0, 1e-9) << n;
        ++crossed;
      }
      raw = model.step(phi, raw);
    }
  }
  EXPECT_GT(turned, 0);
  EXPECT_GT(crossed, 5);
}

TEST(ReturnedLight, SlicesOfSeveralImages) {
  // Halves of a slice that show different images, against two slices of half the height.
  const CureModel model = model_with(0.6, 0, test::process(500), 400);
  Printer fine_printer = printer_with(0.6);
  const CureModel fine =
      make_cure_model(fine_printer, test::resin(576, 400), test::process(500), kHsUm / 2);
  const auto pixels = random_runs(40);
  BandDose coarse(model, 1), halves(fine, 1);
  InsideLayer inside, low, high;
  for (int n = 20; n-- > 0;) {
    const auto k = static_cast<std::size_t>(2 * n);
    const ImageShowing parts[]{{&pixels[k], 0.5, 0, 0, 0.5}, {&pixels[k + 1], 0.5, 0, 0.5, 1}};
    coarse.add_slice(n, parts);
    halves.add_slice(2 * n + 1, &pixels[k + 1]);
    halves.inside(0, 0, low);
    halves.add_slice(2 * n, &pixels[k]);
    halves.inside(0, 0, high);
    EXPECT_NEAR(*coarse.upper(), *halves.upper(), 1e-12) << n;
    EXPECT_NEAR(*coarse.middle(), *halves.lower(), 1e-12) << n;
    coarse.inside(0, 0, inside);
    EXPECT_NEAR(inside.least, std::min(low.least, high.least), 1e-9) << n;
    EXPECT_EQ(inside.crossings.size(), low.crossings.size() + high.crossings.size()) << n;
  }
}

TEST(ReturnedLight, CorrectedColumnsPrint) {
  const auto coverage = column(200, {{0, 9}, {14, 19}, {24, 39}, {50, 59}, {80, 149}, {160, 190}});
  for (const double reflectance : {0.02, 0.3, 0.6}) {
    const CureModel model = model_with(reflectance);
    const CorrectionPlan plan = test::plan_for(model, test::process(1000), 200);
    const auto levels = solve_column(plan, coverage);
    const ColumnDose dose = column_dose(model, levels);
    std::vector<double> phi;
    for (const std::uint8_t l : levels) phi.push_back(model.level_phi[l]);
    for (std::size_t n = 0; n < coverage.size(); ++n) {
      EXPECT_EQ(dose.middle[n] >= 1.0, coverage[n] == 255) << reflectance << " layer " << n;
    }
    // Edges where they belong, by bisection in the sum over both ways.
    for (std::size_t n = 1; n < coverage.size(); ++n) {
      if (coverage[n] == coverage[n - 1]) continue;
      double full = coverage[n] ? 0.5 : -0.5, empty = -full;
      for (int i = 0; i < 50; ++i) {
        const double middle = (full + empty) / 2;
        const double there = direct_dose(model, phi, static_cast<double>(n) + middle, reflectance);
        (there >= 1.0 ? full : empty) = middle;
      }
      EXPECT_LT(std::abs(full) * kHsUm, 1.0) << reflectance << " edge " << n;
    }
    // What is planned without light that returns grows into gaps.
    const auto blind =
        solve_column(test::plan_for(model_with(0), test::process(1000), 200), coverage);
    const ColumnDose grown = column_dose(model, blind);
    int wrong = 0;
    for (std::size_t n = 0; n < coverage.size(); ++n) {
      wrong += (grown.middle[n] >= 1.0) != (coverage[n] == 255);
    }
    EXPECT_TRUE(wrong > 0 || reflectance < 0.1) << reflectance;
  }
}

TEST(ReturnedLight, NoVoxelOfRandomColumnsIsWrong) {
  int wrong = 0, all = 0;
  for (const double reflectance : {0.1, 0.5}) {
    for (const double depth_um : {0.0, 4000.0}) {
      for (const double cap : {1.0, 1e300}) {
        const CureModel model = model_with(reflectance, depth_um);
        std::mt19937 random(5);
        for (int k = 0; k < 60; ++k) {
          std::vector<std::uint8_t> coverage;
          bool full = random() % 2 != 0;
          while (coverage.size() < 120) {
            coverage.insert(coverage.end(), 3 + random() % 20, full ? 255 : 0);
            full = !full;
          }
          coverage.resize(120);
          const auto plan = test::plan_for(model, test::process(1000, cap), 120);
          const auto levels = solve_column(plan, coverage);
          const ColumnDose dose = column_dose(model, levels);
          for (std::size_t n = 0; n < coverage.size(); ++n, ++all) {
            if ((dose.middle[n] >= 1.0) == (coverage[n] == 255)) continue;
            ++wrong;
            ADD_FAILURE() << reflectance << " " << depth_um << " " << cap << " column " << k
                          << " layer " << n << ": " << dose.middle[n];
          }
        }
      }
    }
  }
  EXPECT_EQ(wrong, 0) << "of " << all;
}

TEST(ReturnedLight, CapsAreKept) {
  const CureModel model = model_with(0.3);
  const auto coverage = column(120, {{4, 100}});
  const auto plan = test::plan_for(model, test::process(1000, 2.0), 120);
  const ColumnDose dose = column_dose(model, solve_column(plan, coverage));
  for (std::size_t n = 5; n < 100; ++n) {
    EXPECT_LE(dose.upper[n], 2.0 + 1e-9) << n;
    EXPECT_GE(dose.upper[n], 1.0) << n;
  }
}

TEST(ReturnedLight, GreyLayersGetTheirShare) {
  const CureModel model = model_with(0.3);
  for (const int grey : {64, 128, 200}) {
    const std::vector<std::uint8_t> coverage(60, static_cast<std::uint8_t>(grey));
    const auto levels = solve_column(test::plan_for(model, test::process(1000), 60), coverage);
    const ColumnDose dose = column_dose(model, levels);
    // A level step and the change of the factor in half a layer.
    for (std::size_t n = 0; n < 60; ++n) EXPECT_NEAR(dose.middle[n], grey / 255.0, 0.02) << n;
  }
}

TEST(ReturnedLight, CorrectedLayerByLayer) {
  const auto coverage = column(60, {{0, 2}, {6, 19}, {25, 30}, {40, 59}});
  const Process process = layerwise(60);
  for (const double reflectance : {0.0, 0.4}) {
    const CureModel model = model_with(reflectance, 0, process, 200);
    const CorrectionPlan plan = test::plan_for(model, process, 60);
    const auto levels = solve_column(plan, coverage);
    EXPECT_EQ(test::solve_band_of_one(plan, coverage), levels);
    const ColumnDose dose = column_dose(model, levels);
    for (std::size_t n = 0; n < coverage.size(); ++n) {
      if (coverage[n] != 255) continue;
      EXPECT_GE(dose.upper[n], 1.0) << n;
      if (levels[n] == 0) continue;
      // No level more than it takes.
      auto less = levels;
      --less[n];
      EXPECT_LT(column_dose(model, less).upper[n], 1.0) << n;
    }
  }
}

/// Dose at `zeta` when the window stands at `window`, by small steps.
double dose_until(const CureModel& model, const std::vector<double>& phi, double zeta,
                  double window) {
  const double fall = model.eta * std::log(10.0);
  const double bath = model.bath_slices > 0 ? model.bath_slices : 1e9;
  const double end = std::min(window, zeta + bath);
  double dose = 0;
  for (std::size_t k = 0; k < phi.size(); ++k) {
    const double from = std::max(zeta, static_cast<double>(k));
    const double to = std::min(end, static_cast<double>(k) + 1);
    if (to > from) {
      dose += phi[k] * (std::exp(-(from - zeta) * fall) - std::exp(-(to - zeta) * fall));
    }
  }
  return dose * model.returned(zeta);
}

TEST(ReturnedLight, SimulatedColumnsGrowAsTheSumsSay) {
  const auto pixels = random_runs(50);
  for (const auto& [reflectance, depth_um] :
       {std::pair{0.5, 0.0}, {0.0, 800.0}, {0.5, 800.0}, {0.0, 100.0}}) {
    const CureModel model = model_with(reflectance, depth_um, test::process(800), 500);
    const PixelCurve curve = pixel_curve(model);
    std::vector<double> phi;
    for (const std::uint8_t p : pixels) phi.push_back(curve[p]);
    ColumnOptions options;
    options.substeps = 4;
    const PrintClock clock(test::process(800), model.m, model.layer_um, 50);
    for (const double share : {0.13, 0.5, 0.731, 1.0}) {
      options.profile_times_s.push_back(share * clock.total_s());
    }
    const ColumnHistory history = simulate_column(model, test::process(800), pixels, options, {});
    ASSERT_EQ(history.profiles.size(), 4U);
    for (const DoseProfile& p : history.profiles) {
      const double window = p.slice + p.share;
      ASSERT_GT(p.z_um.size(), 5U);
      for (std::size_t i = 0; i < p.z_um.size(); ++i) {
        EXPECT_NEAR(p.dose[i], dose_until(model, phi, p.z_um[i] / kHsUm, window), 1e-9)
            << reflectance << " " << depth_um << " at " << p.z_um[i];
      }
    }
    // What has gelled begins and ends where the dose is 1, or at an end of the print.
    for (const auto& step : history.steps) {
      const double window = step.slice + step.share;
      for (const GelledInterval& g : step.gelled) {
        for (const double z_um : {g.front_um, g.back_um}) {
          const double zeta = z_um / kHsUm;
          if (zeta < 1e-9 || zeta > window - 1e-9) continue;
          EXPECT_NEAR(dose_until(model, phi, zeta, window), 1.0, 1e-6) << zeta;
        }
      }
    }
  }
}

TEST(ReturnedLight, AddedDosesSumUp) {
  const CureModel model = model_with(0.5, 800, test::process(800), 500);
  const auto pixels = random_runs(30);
  for (const double zeta : {0.3, 4.5, 11.9}) {
    double sum = 0;
    std::vector<double> phi;
    for (int n = 0; n < 30; ++n) {
      const int level = pixels[static_cast<std::size_t>(n)];
      phi.push_back(model.level_phi[static_cast<std::size_t>(level)]);
      if (n + 1 > zeta) sum += added_dose(model, {n, 1.0}, level, n + 1 - zeta);
    }
    EXPECT_NEAR(sum, direct_dose(model, phi, zeta, 0.5), 1e-12);
  }
}

TEST(ReturnedLight, PrinterFile) {
  const std::string head =
      "[display]\nwidth_px = 8\nheight_px = 8\npixel_um = 50\n"
      "[blue]\ncalibration = [[0, 1], [255, 100]]\n[vat]\n";
  const auto parsed = [&](const std::string& text) { return parse_printer(head + text, "p.toml"); };
  EXPECT_EQ(parsed("").platform_reflectance, 0);
  for (const char* good : {"0", "0.3", "1"}) {
    EXPECT_EQ(parsed(std::string("platform_reflectance = ") + good).platform_reflectance,
              std::stod(good));
  }
  for (const char* bad : {"-0.1", "1.01", "inf", "nan", "\"steel\"", "30"}) {
    EXPECT_THROW(parsed(std::string("platform_reflectance = ") + bad), InputError) << bad;
  }
  const Resin resin = test::resin(576, kHaUm);
  const Printer printer = printer_with(0.3);
  EXPECT_EQ(parse_definitions_json(definitions_json(printer, resin), "text").first, printer);
  EXPECT_EQ(definitions_json(printer_with(0), resin).find("reflectance"), std::string::npos);
}

TEST(ReturnedLight, BlackThatGelsBesideThePlatformIsRefused) {
  // phi of black 0.8 stays below 1, with 0.3 of it sent back it does not.
  Printer printer = linear_printer(12.8, 100);
  const auto check = [&](double reflectance) {
    printer.platform_reflectance = reflectance;
    const CureModel model =
        make_cure_model(printer, test::resin(576, kHaUm), test::process(1000), kHsUm);
    check_feasible(model, printer, test::process(1000));
  };
  EXPECT_NO_THROW(check(0));
  EXPECT_NO_THROW(check(0.2));
  try {
    check(0.3);
    FAIL() << "black gels beside the platform";
  } catch (const InfeasibleError& e) {
    EXPECT_NE(std::string(e.what()).find("beside the platform"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace slicecorr
