// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resins with a time to gel: closed forms, doses against an integration in time, the limits that are other
// laws, correction, refusals.

#include "slicecorr/gel_time.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "gel_time_models.hpp"
#include "printed_column.hpp"
#include "rounds.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/place_models.hpp"

namespace slicecorr {
namespace {

using test::bright_resin;
using test::gel_time_resin;
using test::kHydrogel;
using testing::AllOf;
using testing::HasSubstr;

TEST(GelTimeLaw, ChecksOfTheHydrogel) {
  // A and B have six digits.
  constexpr double digits = 2e-5;
  const double times[] = {124.065, 13.4500, 1.67502, 0.271860};
  const double exponents[] = {0.98055, 0.94326, 0.85593, 0.71930};
  for (int k = 0; k < 4; ++k) {
    const double i = std::pow(10.0, k);
    EXPECT_NEAR(gel_time_s(kHydrogel, i) / times[k], 1, digits);
    EXPECT_NEAR(local_exponent(kHydrogel, i), exponents[k], 1e-5);
    EXPECT_NEAR(gel_intensity_mw_cm2(kHydrogel, gel_time_s(kHydrogel, i)) / i, 1, 1e-12);
  }
  EXPECT_NEAR(gel_intensity_mw_cm2(kHydrogel, 5), 29.0503, 1e-3);
  Kinetics k;
  k.hb_um = 8115.88;
  k.critical_dose_prime = 1;
  k.gel_time = kHydrogel;
  EXPECT_NEAR(cured_height_um(k, 100, 5), 10032.4, 0.3);
  EXPECT_NEAR(exposure_for_height_s(k, 100, cured_height_um(k, 100, 5)), 5, 1e-9);
}

TEST(GelTimeLaw, NearestLawsOverARange) {
  const NearestLaw one = nearest_kinetic(kHydrogel, 1, 100, 41);
  EXPECT_NEAR(one.m, 0.93792, 1e-5);
  EXPECT_NEAR(one.critical_dose_prime, 119.410, 3e-3);
  EXPECT_NEAR(one.worst_error, 0.054, 5e-4);
  const NearestLaw other = nearest_kinetic(kHydrogel, 10, 1000, 41);
  EXPECT_NEAR(other.m, 0.85030, 1e-5);
  EXPECT_NEAR(other.critical_dose_prime, 88.094, 3e-3);
  // A power has no error over a range of powers, and Jacobs' law has the more the wider it is.
  EXPECT_NEAR(nearest_kinetic({0, 3}, 1, 100).m, 0.5, 1e-12);
  EXPECT_LT(nearest_kinetic({0, 3}, 1, 100).worst_error, 1e-12);
  EXPECT_LT(nearest_jacobs({3, 0}, 1, 100).worst_error, 1e-12);
  EXPECT_GT(nearest_jacobs(kHydrogel, 10, 1000).worst_error, other.worst_error);
  for (const auto& [from, to] : {std::pair{0.0, 1.0}, {2.0, 1.0}, {1.0, 1.0}, {-1.0, 1.0}}) {
    EXPECT_THROW(nearest_kinetic(kHydrogel, from, to), InputError) << from << " " << to;
  }
  EXPECT_THROW(nearest_kinetic(kHydrogel, 1, 2, 1), InputError);
}

std::string file_of(const std::string& cure) {
  return "name = \"r\"\n[cure]\nabsorbance_height_um = 600\nabsorbance_base = \"e\"\n" + cure;
}

TEST(GelTimeResin, WithoutBIsJacobsAndWithoutAIsKinetic) {
  // To the last bit of everything that is made of them.
  const auto same = [](const std::string& gel_time, const std::string& other) {
    for (const char* factor : {"", "dose_factor = 3\n"}) {
      const Resin a = parse_resin(file_of("model = \"gel-time\"\n" + gel_time + factor), "a.toml");
      const Resin b =
          parse_resin(file_of(other + (*factor == 0 ? "dose_factor = 5\n" : factor)), "a.toml");
      EXPECT_EQ(a, b);
    }
  };
  same("gel_a_mj_cm2 = 37.3\ngel_b_sqrt_mw_cm2_s = 0\n", "gel_dose_mj_cm2 = 37.3\n");
  same("gel_a_mj_cm2 = 0\ngel_b_sqrt_mw_cm2_s = 8.1\n",
       "model = \"kinetic\"\nm = 0.5\ncritical_dose_prime = 8.1\n");
}

TEST(GelTimeResin, BadFiles) {
  const auto complaint = [](const std::string& cure, const ResinOverrides& overrides = {}) {
    try {
      parse_resin(file_of(cure), "r.toml", overrides);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("none");
  };
  const std::string model = "model = \"gel-time\"\n";
  EXPECT_THAT(complaint(model), AllOf(HasSubstr("r.toml"), HasSubstr("gel_a_mj_cm2")));
  EXPECT_THAT(complaint(model + "gel_a_mj_cm2 = 3\n"), HasSubstr("gel_b_sqrt_mw_cm2_s"));
  EXPECT_THAT(complaint(model + "gel_a_mj_cm2 = 0\ngel_b_sqrt_mw_cm2_s = 0\n"),
              HasSubstr("above 0"));
  EXPECT_THAT(complaint(model + "gel_a_mj_cm2 = -1\ngel_b_sqrt_mw_cm2_s = 1\n"), HasSubstr("-1"));
  EXPECT_THAT(complaint(model + "gel_a_mj_cm2 = nan\ngel_b_sqrt_mw_cm2_s = 1\n"),
              HasSubstr("gel_a_mj_cm2"));
  const std::string both = model + "gel_a_mj_cm2 = 3\ngel_b_sqrt_mw_cm2_s = 1\n";
  EXPECT_EQ(complaint(both), "none");
  for (const char* key : {"m", "gel_dose_mj_cm2", "critical_dose_mj_cm3", "critical_dose_prime"}) {
    EXPECT_THAT(complaint(both + key + " = 1\n"), AllOf(HasSubstr(key), HasSubstr("gel-time")));
  }
  EXPECT_THAT(complaint("gel_dose_mj_cm2 = 3\ngel_a_mj_cm2 = 3\n"), HasSubstr("gel-time"));
  EXPECT_THAT(complaint(both + "[inhibition]\nbeta = 1\nabsorbance_height_um = 30\n"
                               "absorbance_base = \"e\"\n"),
              HasSubstr("[inhibition]"));
  ResinOverrides dose;
  dose.dc_mj_cm3 = 100;
  EXPECT_THAT(complaint(both, dose), HasSubstr("dose factor"));
  EXPECT_THAT(complaint("model = \"gel\"\n"), HasSubstr("gel-time"));
}

Process layers_of(double exposure_s) {
  Process p = test::process(0);
  p.mode = ExposureMode::layerwise;
  p.exposure_s = exposure_s;
  return p;
}

/// The dose at zeta by its definition: light in small steps of time, the best of all cuts between them,
/// linear within the step of the cut. `vat`: how deep the resin is, and what its platform sends back.
double integrated(const Resin& resin, const Process& process, double layer_um,
                  const std::vector<double>& light, double zeta, int steps,
                  const Printer& vat = {}) {
  const double h_um = units::height_e_from_10(resin.absorbance_height10_um);
  const double back = 1 + vat.platform_reflectance * std::exp(-2 * zeta * layer_um / h_um);
  std::vector<double> x{0}, y{0};
  for (std::size_t n = 0; n < light.size(); ++n) {
    const bool moving = process.mode == ExposureMode::continuous;
    const double time_s = moving ? units::slice_time_s(layer_um, process.speed_mm_h)
                                 : layer_exposure_s(process, static_cast<int>(n));
    for (int k = 0; k < steps; ++k) {
      const double window = static_cast<double>(n) + (moving ? (k + 0.5) / steps : 1.0);
      if (window < zeta) continue;
      if (vat.resin_depth_um > 0 && (window - zeta) * layer_um > vat.resin_depth_um) continue;
      const double i = back * light[n] * std::exp(-(window - zeta) * layer_um / h_um);
      x.push_back(x.back() + i * time_s / steps / resin.gel_a_mj_cm2);
      y.push_back(y.back() + std::sqrt(i) * time_s / steps / resin.gel_b_sqrt_mw_cm2_s);
    }
  }
  for (std::size_t k = 1; k < x.size(); ++k) {
    const double after = y.back() - y[k];
    if (x[k] < after) continue;
    const double dx = x[k] - x[k - 1], dy = y[k] - y[k - 1];
    return x[k - 1] + dx * (after + dy - x[k - 1]) / (dx + dy);
  }
  return 0;
}

TEST(GelTimeDose, EqualsAnIntegrationInTimeOnRandomSchedules) {
  std::mt19937 random(5);
  for (int round = 0; round < test::rounds(12); ++round) {
    const double layer_um = round % 3 == 0 ? 10 : 50;
    Process process = test::process(round % 4 == 0 ? 200 : 800);
    if (round % 2) {
      process = layers_of(2);
      process.bottom_exposure_s = 9;
      process.bottom_layers = 3;
      process.fade_layers = 2;
    }
    const double heights[] = {150, 400, 900};
    const Resin resin = gel_time_resin(
        {std::pow(10.0, 1.0 * (random() % 5) - 1), 0.5 * (1 + random() % 20)}, heights[round % 3]);
    Printer printer = test::linear_printer(1, 100);
    if (round % 3 != 0) printer.resin_depth_um = layer_um * (5 + random() % 20);
    if (round % 4 > 1) printer.platform_reflectance = 0.1 * (1 + random() % 6);
    const CureModel model = make_cure_model(printer, resin, process, layer_um);
    const std::vector<double> levels = level_intensities(printer);
    std::vector<std::uint8_t> pixels;
    std::vector<double> light;
    std::uint8_t level = 0;
    for (int n = 0; n < 60; ++n) {
      if (random() % 3 == 0) level = static_cast<std::uint8_t>(random() % 256);
      pixels.push_back(level);
      light.push_back(levels[level]);
    }
    const ColumnDose dose = column_dose(model, pixels);
    for (int n = 0; n < 60; n += 7) {
      const auto k = static_cast<std::size_t>(n);
      // The midpoint rule in 200 steps a slice is off by less than (hs/h)² / 24 / 200² of a slice's light.
      const auto check = [&](double got, double zeta) {
        const double want = integrated(resin, process, layer_um, light, zeta, 200, printer);
        EXPECT_NEAR(got, want, 1e-6 * want + 2 * GelTimeKernel::kLeftOut) << round << " " << zeta;
      };
      check(dose.upper[k], n + 1e-12);
      check(dose.middle[k], n + 0.5);
      check(dose.lower[k], n + 1 - (process.mode == ExposureMode::layerwise ? 1e-12 : 0.0));
    }
  }
}

TEST(GelTimeDose, ConstantLightIsTimeOverTimeToGel) {
  // Layer by layer, one exposure: at the window t / t_gel(i), further up that of the light there.
  const Resin resin = bright_resin();
  const CureModel model = make_cure_model(test::linear_printer(1, 100), resin, layers_of(5), 100);
  const GelTime g{resin.gel_a_mj_cm2, resin.gel_b_sqrt_mw_cm2_s};
  const ColumnDose dose = column_dose(model, {255});
  EXPECT_NEAR(dose.lower[0], 5 / gel_time_s(g, 100), 1e-12);
  EXPECT_NEAR(dose.middle[0], 5 / gel_time_s(g, 100 * std::exp(-50 / 600.0)), 1e-12);
  EXPECT_NEAR(dose.upper[0], 5 / gel_time_s(g, 100 * std::exp(-100 / 600.0)), 1e-12);
}

TEST(GelTimeDose, LongExposureHasAClosedForm) {
  const Resin resin = bright_resin();
  const Process process = test::process(800);
  const Printer printer = test::linear_printer(1, 100);
  const CureModel model = make_cure_model(printer, resin, process, 50);
  const Kinetics k = make_kinetics(resin, false, true);
  for (const int level : {0, 40, 255}) {
    const double i = level_intensities(printer)[static_cast<std::size_t>(level)];
    const std::vector<std::uint8_t> long_run(800, static_cast<std::uint8_t>(level));
    EXPECT_NEAR(column_dose(model, long_run).upper[0], model.phi(i), 1e-6);
    EXPECT_NEAR(passing_dose_prime(k, i, 0, 800), model.phi(i), 1e-12);
    EXPECT_NEAR(model.intensity_mw_cm2(model.phi(i)), i, 1e-9 * i);
  }
  // The intensity that just gels: A s/h + (B s/(2 h))².
  const double rate = units::cm_s_from_mm_h(800) / 600e-4;
  EXPECT_NEAR(model.critical_intensity_mw_cm2, 60 * rate + std::pow(3 * rate, 2), 1e-9);
  // So many slices of full light lift the last node to 1, and one less do not.
  const int slices = model.slices_to_gel();
  const auto end = [&](int n) {
    return column_dose(model, std::vector<std::uint8_t>(static_cast<std::size_t>(n), 255)).upper[0];
  };
  EXPECT_GE(end(slices), 1.0 - 1e-12);
  EXPECT_LT(end(slices - 1), 1.0);
}

TEST(GelTimeDose, IsInverselyProportionalToTheSpeedAndNeverFallsWithLight) {
  std::mt19937 random(9);
  const Printer printer = test::linear_printer(1, 100);
  const CureModel slow = make_cure_model(printer, bright_resin(), test::process(400), 50),
                  fast = make_cure_model(printer, bright_resin(), test::process(800), 50);
  for (int round = 0; round < test::rounds(20); ++round) {
    std::vector<std::uint8_t> pixels(50);
    for (auto& p : pixels) p = static_cast<std::uint8_t>(random() % 256);
    const ColumnDose a = column_dose(slow, pixels), b = column_dose(fast, pixels);
    const std::size_t brighter = random() % pixels.size();
    std::vector<std::uint8_t> more = pixels;
    more[brighter] = 255;
    const ColumnDose c = column_dose(fast, more);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      EXPECT_NEAR(a.upper[n], 2 * b.upper[n], 1e-9);
      EXPECT_GE(c.upper[n], b.upper[n] - 1e-12);
      EXPECT_GE(c.middle[n], b.middle[n] - 1e-12);
    }
  }
}

TEST(GelTimeDose, LittleOfOnePartIsTheOtherLaw) {
  // With B of a share e of A sqrt(i) the cut lies at the very end: what is missing is of the order of
  // sqrt(e), and the other way round.
  std::mt19937 random(2);
  std::vector<std::uint8_t> pixels(60);
  for (auto& p : pixels) p = static_cast<std::uint8_t>(random() % 256);
  const Printer printer = test::linear_printer(1, 100);
  Resin jacobs = bright_resin(), kinetic = jacobs;
  jacobs.model = kinetic.model = CureModelKind::kinetic;
  jacobs.gel_a_mj_cm2 = kinetic.gel_a_mj_cm2 = 0;
  jacobs.gel_b_sqrt_mw_cm2_s = kinetic.gel_b_sqrt_mw_cm2_s = 0;
  jacobs.critical_dose_prime = 60;
  kinetic.m = 0.5;
  kinetic.critical_dose_prime = 6;
  for (const Process& process : {test::process(800), layers_of(2)}) {
    const auto doses = [&](const Resin& resin) {
      return column_dose(make_cure_model(printer, resin, process, 50), pixels);
    };
    const ColumnDose a = doses(jacobs), like_a = doses(gel_time_resin({60, 1e-6}, 600));
    const ColumnDose b = doses(kinetic), like_b = doses(gel_time_resin({1e-6, 6}, 600));
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      EXPECT_NEAR(like_a.upper[n] / a.upper[n], 1, 1e-3) << n;
      EXPECT_NEAR(like_b.middle[n] / b.middle[n], 1, 1e-3) << n;
      EXPECT_LE(like_a.upper[n], a.upper[n] * (1 + 1e-12));
      EXPECT_LE(like_b.upper[n], b.upper[n] * (1 + 1e-12));
    }
  }
}

TEST(GelTimeDose, InsideLayersIsWhatSamplesSay) {
  std::mt19937 random(21);
  const CureModel model =
      make_cure_model(test::linear_printer(1, 100), bright_resin(250), test::process(800), 200);
  for (int round = 0; round < test::rounds(30); ++round) {
    std::vector<std::uint8_t> pixels(12);
    for (auto& p : pixels) p = static_cast<std::uint8_t>(random() % 3 ? random() % 256 : 0);
    BandDose band(model, 1);
    for (std::size_t n = pixels.size(); n-- > 0;) {
      band.add_slice(static_cast<int>(n), &pixels[n]);
      InsideLayer inside;
      band.inside(0, -1, inside);
      // The dose between, from columns of thinner layers: the same light in 8 slices each.
      const CureModel thin =
          make_cure_model(test::linear_printer(1, 100), bright_resin(250), test::process(800), 25);
      std::vector<std::uint8_t> cut;
      for (std::size_t k = n; k < pixels.size(); ++k) cut.insert(cut.end(), 8, pixels[k]);
      const ColumnDose fine = column_dose(thin, cut);
      double least = fine.lower[7];
      int crossings = 0;
      for (std::size_t k = 8; k-- > 0;) {
        least = std::min({least, fine.middle[k], fine.upper[k]});
        crossings += ((fine.lower[k] >= 1) != (fine.middle[k] >= 1)) +
                     ((fine.middle[k] >= 1) != (fine.upper[k] >= 1));
      }
      EXPECT_LE(inside.least, least + 1e-9);
      EXPECT_NEAR(inside.least, least, 2e-4);
      EXPECT_EQ(static_cast<int>(inside.crossings.size()), crossings) << round << " " << n;
    }
  }
}

TEST(GelTimeDose, ColumnsOfABandAreColumnsAlone) {
  std::mt19937 random(4);
  const CureModel model =
      make_cure_model(test::linear_printer(1, 100), bright_resin(), test::process(800), 50);
  constexpr std::size_t columns = 150;
  std::vector<std::vector<std::uint8_t>> slices(40, std::vector<std::uint8_t>(columns));
  for (auto& slice : slices) {
    const auto all = static_cast<std::uint8_t>(random() % 256);
    for (auto& p : slice) p = random() % 40 ? all : static_cast<std::uint8_t>(random() % 256);
  }
  BandDose band(model, columns);
  std::vector<std::vector<double>> upper(slices.size());
  for (std::size_t n = slices.size(); n-- > 0;) {
    band.add_slice(static_cast<int>(n), slices[n].data());
    upper[n].assign(band.upper(), band.upper() + columns);
  }
  for (std::size_t i = 0; i < columns; ++i) {
    std::vector<std::uint8_t> pixels;
    for (const auto& slice : slices) pixels.push_back(slice[i]);
    const ColumnDose alone = column_dose(model, pixels);
    for (std::size_t n = 0; n < slices.size(); ++n) ASSERT_EQ(alone.upper[n], upper[n][i]);
  }
}

TEST(GelTimeCorrection, LadderPrintsAsDesigned) {
  const auto design = test::column(50, {{11, 20}, {31, 40}});
  const Process process = test::process(800);
  const CureModel model =
      make_cure_model(test::linear_printer(1, 100), bright_resin(), process, 50);
  const test::PrintedColumn printed = test::print(model, process, design);
  EXPECT_EQ(printed.wrong(), 0U);
  EXPECT_LT(printed.largest_um, 0.5);
  // As sliced it is one piece.
  std::vector<std::uint8_t> plain = design;
  plain.resize(60, 0);
  const ColumnDose uncorrected = column_dose(model, plain);
  EXPECT_GT(uncorrected.middle[25], 1.0);
}

// Between two nodes that gel the dose of a layer may dip: a feature must not come apart there. Layers at
// edges have theirs elsewhere.
TEST(GelTimeCorrection, NoFeatureDipsBetweenItsNodes) {
  std::mt19937 random(31);
  for (const double speed_mm_h : {171.0, 1000.0, 1200.0, 1300.0, 1389.0, 1600.0}) {
    const Process process = test::process(speed_mm_h);
    const CureModel model =
        make_cure_model(test::linear_printer(0.05, 100), gel_time_resin({60, 6}, 600), process, 50);
    for (int round = 0; round < 4; ++round) {
      const auto design = test::column(60, test::random_runs(random, 4, 59, 4, 3));
      const auto levels = solve_column(test::plan_for(model, process, 60), design);
      BandDose band(model, 1);
      for (std::size_t n = levels.size(); n-- > 0;) {
        const auto pixel = static_cast<std::uint8_t>(levels[n]);
        band.add_slice(static_cast<int>(n), &pixel);
        const bool within = n > 0 && n + 1 < design.size() && design[n - 1] == 255 &&
                            design[n] == 255 && design[n + 1] == 255;
        if (!within) continue;
        InsideLayer inside;
        band.inside(0, -1, inside);
        EXPECT_GE(inside.least, 1.0) << speed_mm_h << " " << n;
      }
    }
  }
}

TEST(GelTimeCorrection, WhereNoLevelGelsItIsTheBrightest) {
  // As fast as light still gels layers, if barely, as plans try it: inside features more is asked.
  const Printer printer = test::linear_printer(1, 100);
  const auto feasible = [&](double speed_mm_h) {
    const Process process = test::process(speed_mm_h);
    try {
      check_feasible(make_cure_model(printer, bright_resin(), process, 50), printer, process);
    } catch (const InfeasibleError&) {
      return false;
    }
    return true;
  };
  double speed_mm_h = 800;
  while (feasible(1.001 * speed_mm_h)) speed_mm_h *= 1.001;
  const Process process = test::process(speed_mm_h);
  const CureModel model = make_cure_model(printer, bright_resin(), process, 50);
  const auto design = test::column(50, {{11, 20}, {31, 40}});
  const auto levels = solve_column(test::plan_for(model, process, 50), design);
  for (std::size_t n = 0; n < design.size(); ++n) {
    if (design[n] != 0) {
      EXPECT_EQ(levels[n], 255) << n;
    }
  }
}

TEST(GelTimeCorrection, RandomColumns) {
  std::mt19937 random(17);
  for (int round = 0; round < test::rounds(60); ++round) {
    const bool layerwise = round % 3 == 2;
    const double height_um = layerwise ? 60.0 + random() % 60 : 300.0 + random() % 700;
    const double layer_um = round % 2 ? 50 : 25;
    const double a = 20.0 + random() % 60, b = 1.0 + random() % 6;
    // Layer by layer full light has twice what a layer takes.
    const double through_s = (a / 100 + b / 10) * std::exp(layer_um / height_um);
    const Process process = layerwise ? layers_of(2 * through_s) : test::process(500);
    const int bits = round % 5 == 4 ? 5 : 8;
    const Printer printer = test::gamma_printer(0.5, 100, round % 4 == 1 ? 2.2 : 1.0, bits);
    const CureModel model =
        make_cure_model(printer, gel_time_resin({a, b}, height_um), process, layer_um);
    const auto design = test::column(110, test::random_runs(random, 6, 109, 3, 4));
    const test::PrintedColumn printed = test::print(model, process, design);
    // Features gel always. The middle of a gap's layer stays open where no level moves an edge that far.
    EXPECT_EQ(printed.undercured, 0U) << round;
    if (model.level_step_um() < layer_um / 2) {
      EXPECT_EQ(printed.cured_through, 0U) << round;
    }
    // A level moves an edge by no more than the model says; in continuous exposure several together
    // place it finer.
    // Layer by layer black light of the layer above an edge goes on what is left there.
    const double black_um = layerwise ? model.gel_time()->light(0).x * 2 * height_um : 0.0;
    EXPECT_LT(printed.largest_um, std::max(0.5, model.level_step_um()) + black_um) << round;
  }
}

TEST(GelTimeCorrection, RandomColumnsInResinThatEndsBelowAPlatformThatSendsLightBack) {
  std::mt19937 random(29);
  for (int round = 0; round < 16; ++round) {
    const bool layerwise = round % 3 == 2;
    Printer printer = test::linear_printer(0.5, 100);
    if (round % 4 != 1) printer.resin_depth_um = layerwise ? 400 : 1500;
    if (round % 4 != 2) printer.platform_reflectance = 0.3;
    const double height_um = layerwise ? 90 : 500;
    // Full light in resin that ends has more than it takes, layer by layer twice what a layer takes.
    const Process process =
        layerwise ? layers_of(2 * (0.4 + 0.3) * std::exp(50 / height_um)) : test::process(400);
    const Resin resin = gel_time_resin({40, 3}, height_um);
    const CureModel model = make_cure_model(printer, resin, process, 50);
    const auto design = test::column(110, test::random_runs(random, 6, 109, 3, 5));
    const CorrectionPlan plan = test::plan_for(model, process, 110);
    const std::vector<std::uint8_t> levels = solve_column(plan, design);
    std::vector<double> light;
    for (const std::uint8_t level : levels) light.push_back(0.5 + 99.5 * level / 255);
    int wrong = 0;
    for (std::size_t n = 0; n < 110; ++n) {
      const double dose =
          integrated(resin, process, 50, light, static_cast<double>(n) + 0.5, 40, printer);
      // The midpoint rule is off by less than (hs/h)² / 24 / 40² of a slice's light.
      const bool full = design[n] == 255;
      wrong += (dose >= 1 + (full ? -1e-5 : 1e-5)) != full;
    }
    EXPECT_EQ(wrong, 0) << round;
  }
}

TEST(GelTimeCorrection, OneSliceGapsStayOpenAndGreysAimAtTheirCoverage) {
  const Process process = test::process(800);
  const CureModel model =
      make_cure_model(test::linear_printer(1, 100), bright_resin(), process, 50);
  const test::PrintedColumn slit =
      test::print(model, process, test::column(40, {{5, 18}, {20, 34}}));
  EXPECT_EQ(slit.wrong(), 0U);
  EXPECT_LT(slit.above_slits_um, 0.2 * 50);
  Process merge = process;
  merge.one_slice_gaps = OneSliceGaps::merge;
  const auto plan = test::plan_for(model, merge, 40);
  const auto levels = solve_column(plan, test::column(40, {{5, 18}, {20, 34}}));
  EXPECT_GT(levels[19], 0);
  auto grey = test::column(40, {{10, 20}});
  grey[9] = 220;
  const auto grey_plan = test::plan_for(model, process, 40);
  const ColumnDose dose = column_dose(model, solve_column(grey_plan, grey));
  EXPECT_LT(dose.middle[9], 1.0);
  EXPECT_GE(dose.middle[10], 1.0);
}

TEST(GelTimeCorrection, BandsAreColumnsAndEdgesGoToTheirHeights) {
  const Process process = test::process(800);
  const CureModel model =
      make_cure_model(test::linear_printer(1, 100), bright_resin(), process, 50);
  const auto design = test::column(40, {{8, 20}, {26, 33}});
  const auto plan = test::plan_for(model, process, 40);
  for (const double below : {-0.4, -0.15, 0.2, 0.35}) {
    std::vector<std::uint8_t> heights(41, 0);
    heights[8] = edge_height_byte(below);
    heights[21] = edge_height_byte(-below);
    const auto levels = solve_column(plan, design, heights);
    BandCorrector band(plan, 3);
    for (std::size_t n = 0; n < design.size(); ++n) {
      const std::uint8_t row[3] = {design[n], 0, design[n]},
                         height[3] = {heights[n], 0, heights[n]};
      band.add_layer(row, height);
    }
    band.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
      ASSERT_EQ(level[0], levels[static_cast<std::size_t>(n)]);
      ASSERT_EQ(level[1], 0);
      ASSERT_EQ(level[2], level[0]);
    });
    BandDose dose(model, 1);
    for (std::size_t n = levels.size(); n-- > 0;) {
      dose.add_slice(static_cast<int>(n), &levels[n]);
      const bool has_edge = n == (below >= 0 ? 8U : 7U);
      if (!has_edge) continue;
      InsideLayer inside;
      dose.inside(0, -1, inside);
      ASSERT_EQ(inside.crossings.size(), 1U) << below;
      // Heights are taken to a 64th of a slice, edges within a micrometre.
      const double at = static_cast<double>(n) + 1 - inside.crossings[0];
      EXPECT_NEAR(at, 8 + below, 1.0 / 64 + 0.02) << below;
    }
  }
}

TEST(GelTimeLimits, RefusalsNameWhatWouldDo) {
  const Printer printer = test::linear_printer(1, 100);
  const auto refused = [&](const Process& process, const Printer& p, const Resin& resin) {
    try {
      check_feasible(make_cure_model(p, resin, process, 50), p, process);
    } catch (const InfeasibleError& e) {
      return std::string(e.what());
    }
    return std::string("fine");
  };
  EXPECT_EQ(refused(test::process(800), printer, bright_resin()), "fine");
  // What is said works when it is done: the speed, and the light.
  const std::string fast = refused(test::process(8000), printer, bright_resin());
  const auto number_after = [](const std::string& text, const std::string& words) {
    const auto at = text.find(words);
    EXPECT_NE(at, std::string::npos) << text;
    return at == std::string::npos ? 0.0 : std::stod(text.substr(at + words.size()));
  };
  const double speed = number_after(fast, "slower than ");
  EXPECT_EQ(refused(test::process(speed * 0.9999), printer, bright_resin()), "fine") << fast;
  EXPECT_NE(refused(test::process(speed * 1.001), printer, bright_resin()), "fine") << fast;
  const double light = number_after(fast, "more than ");
  EXPECT_EQ(refused(test::process(8000), test::linear_printer(1, light * 1.0001), bright_resin()),
            "fine")
      << fast;
  EXPECT_NE(refused(test::process(8000), test::linear_printer(1, light * 0.999), bright_resin()),
            "fine")
      << fast;
  EXPECT_THAT(refused(test::process(2), printer, bright_resin()), HasSubstr("black"));
  const std::string brief = refused(layers_of(0.1), printer, bright_resin());
  const double time_s = number_after(brief, "at least ");
  EXPECT_EQ(refused(layers_of(time_s), printer, bright_resin()), "fine") << brief;
  EXPECT_NE(refused(layers_of(time_s * 0.999), printer, bright_resin()), "fine") << brief;
  EXPECT_THAT(refused(layers_of(500), printer, bright_resin()), HasSubstr("black"));
}

TEST(GelTimeLimits, WhatIsNotCountedIsRefused) {
  Printer uv = test::linear_printer(1, 100);
  uv.uv = UvLamp{365, false, {{0, 0}, {255, 275}}};
  Process with_uv = test::process(800);
  with_uv.uv.kind = UvKind::constant;
  with_uv.uv.uv_mw_cm2 = 100;
  EXPECT_THROW(make_cure_model(uv, bright_resin(), with_uv, 50), InputError);
}

}  // namespace
}  // namespace slicecorr
