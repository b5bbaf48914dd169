// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resins that bleach: the law's closed forms, doses against light that is followed in time through resin in
// cells, the limit that is Beer's law, correction, fits, refusals.

#include "slicecorr/bleaching.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "printed_column.hpp"
#include "rounds.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using testing::HasSubstr;

/// `dose_mj_cm2`: areal, that correction aims at.
Resin bleaching_resin(double height_e_um, double bleached_um, double dose_mj_cm2, double eb) {
  Resin r = test::resin(units::volumetric_from_areal(dose_mj_cm2, height_e_um),
                        units::height10_from_e(height_e_um));
  r.bleaching = Bleaching{units::height10_from_e(bleached_um), eb};
  return r;
}

Process layers_of(double exposure_s) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = exposure_s;
  return p;
}

TEST(BleachingLaw, WithoutBleachingItIsBeersLaw) {
  const BleachingLaw law(0.7, 0.7, 3);
  for (const double dose : {1e-6, 0.4, 5.0, 300.0}) {
    EXPECT_NEAR(law.absorbed(dose) / (0.7 * dose), 1, 1e-14);
    EXPECT_NEAR(law.steady(0.7 * dose) / dose, 1, 1e-14);
    EXPECT_NEAR(law.after(dose, 1.3, 0) / (dose * std::exp(-0.91)), 1, 1e-12);
    const double steady = 2 / 0.7;
    EXPECT_NEAR(law.after(dose, 1.3, 2), steady + (dose - steady) * std::exp(-0.91),
                1e-11 * (dose + steady));
    EXPECT_NEAR(law.length(dose * std::exp(2.1), dose), 3, 1e-9);
  }
}

TEST(BleachingLaw, WhatBleachesWhollyHasAClosedForm) {
  // alpha1 = 0: with y = e^(E/Eb), y' = ((q - alpha0 Eb) y + alpha0 Eb) / Eb.
  constexpr double eb = 0.8, fresh = 0.5, c = fresh * eb;
  const BleachingLaw law(fresh, 0, eb);
  for (const double q : {0.0, 0.1, 2.0}) {
    for (const double dose : {0.01, 1.0, 6.0}) {
      for (const double length : {0.3, 4.0}) {
        const double rate = (q - c) / eb, from = c / (q - c);
        const double y = (std::exp(dose / eb) + from) * std::exp(rate * length) - from;
        EXPECT_NEAR(law.after(dose, length, q) / (eb * std::log(y)), 1, 1e-10)
            << q << " " << dose << " " << length;
      }
    }
  }
}

TEST(BleachingLaw, WaysThereAndBack) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(0, 1);
  for (int round = 0; round < 200; ++round) {
    const double fresh = std::exp(4 * u(random) - 2), bleached = fresh * (0.02 + 0.98 * u(random));
    const BleachingLaw law(fresh, bleached, std::exp(4 * u(random) - 2));
    const double dose = std::exp(6 * u(random) - 3), length = 3 * u(random) / fresh;
    const double far = law.after(dose, length, 0);
    EXPECT_NEAR(law.after(far, -length, 0) / dose, 1, 1e-9);
    EXPECT_NEAR(law.length(dose, far) / length, 1, 1e-7);
    EXPECT_NEAR(law.length(far, dose) / length, -1, 1e-7);
    const double gain = law.absorbed(dose);
    EXPECT_NEAR(law.steady(gain) / dose, 1, 1e-12);
    EXPECT_NEAR(law.after(dose, length, gain) / dose, 1, 1e-11);
    // More light never makes less dose.
    EXPECT_GT(law.after(dose, length, 1.1 * gain), law.after(dose, length, gain));
    EXPECT_GT(law.after(1.1 * dose, length, gain), law.after(dose, length, gain));
  }
}

// A fit may try any numbers: what is beyond them ends at once, and a long way is that to its end.
TEST(BleachingLaw, AnyNumbersEnd) {
  const double inf = std::numeric_limits<double>::infinity(), tiny = 1e-308, huge = 1e308;
  const BleachingLaw law(2.0, 0.5, 3.0);
  for (const double odd : {0.0, inf, -inf, std::nan("")}) {
    EXPECT_FALSE(std::isfinite(law.length(1.0, odd))) << odd;
    EXPECT_FALSE(std::isfinite(law.length(odd, 1.0))) << odd;
  }
  // 1/alpha1 over what has bleached, 1/alpha0 over what has not.
  EXPECT_NEAR(law.length(huge, tiny) / (std::log(huge) / 0.5 - std::log(tiny) / 2.0), 1, 0.01);
  EXPECT_LE(law.after(1.0, inf, 0.0), 1e-320);
  EXPECT_LE(law.after(1.0, huge, 0.0), 1e-320);
  EXPECT_NEAR(law.after(1.0, huge, 0.7) / law.steady(0.7), 1, 1e-11);
  EXPECT_NEAR(law.after(50.0, inf, 0.7) / law.steady(0.7), 1, 1e-11);
  EXPECT_FALSE(std::isfinite(law.after(1.0, -huge, 0.0)));
  EXPECT_FALSE(std::isfinite(law.after(1.0, std::nan(""), 0.0)));
}

/// Doses of a column by following its light in time: resin in cells, each absorbs by the dose that it has
/// had. At the middles of `cells` to a layer, from the platform on.
std::vector<double> followed(const Resin& resin, const Process& process, double layer_um,
                             const std::vector<double>& light_mw_cm2, int cells) {
  const double fresh = 1 / units::height_e_from_10(resin.absorbance_height10_um),
               bleached = 1 / units::height_e_from_10(resin.bleaching->absorbance_height10_um);
  const double dz = layer_um / cells, eb = resin.bleaching->dose_mj_cm2;
  std::vector<double> dose(light_mw_cm2.size() * static_cast<std::size_t>(cells), 0.0);
  const auto fall_at = [&](double had) {
    return (bleached + (fresh - bleached) * std::exp(-had / eb)) * dz;
  };
  /// Light comes in at the lower end of cell `end` - 1 for a time, in the middle of which resin absorbs
  /// as it does on average.
  std::vector<double> half;
  const auto shine = [&](std::size_t end, double mw_cm2, double time_s) {
    half = dose;
    for (const double share : {0.5, 1.0}) {
      std::vector<double>& to = share < 1 ? half : dose;
      double left = share * mw_cm2 * time_s;
      for (std::size_t k = end; k-- > 0;) {
        const double fall = fall_at(share < 1 ? dose[k] : half[k]);
        to[k] += left * std::exp(-0.5 * fall);
        left *= std::exp(-fall);
      }
    }
  };
  const bool moving = process.mode == ExposureMode::continuous;
  for (std::size_t n = 0; n < light_mw_cm2.size(); ++n) {
    if (!moving) {
      for (int part = 0; part < cells; ++part) {
        shine((n + 1) * static_cast<std::size_t>(cells), light_mw_cm2[n],
              process.exposure_s / cells);
      }
      continue;
    }
    const double time_s = units::slice_time_s(layer_um, process.speed_mm_h) / cells;
    for (std::size_t c = 0; c < static_cast<std::size_t>(cells); ++c) {
      // While the window passes a cell, light comes to the ones before for all of the time through
      // half of it, and to its middle for half of it.
      const std::size_t k = n * static_cast<std::size_t>(cells) + c;
      const double fall = fall_at(0.25 * light_mw_cm2[n] * time_s);
      shine(k, light_mw_cm2[n] * std::exp(-0.5 * fall), time_s);
      dose[k] += light_mw_cm2[n] * 0.5 * time_s * std::exp(-0.25 * fall);
    }
  }
  return dose;
}

TEST(BleachingDose, EqualsLightFollowedInTime) {
  std::mt19937 random(5);
  for (int round = 0; round < test::rounds(8); ++round) {
    const double layer_um = round % 3 == 0 ? 25 : 100;
    const bool moving = round % 2 == 0;
    const Process process = moving ? test::process(800) : layers_of(1.5);
    const double dose = 60;
    const Resin resin =
        bleaching_resin(200, 200 * (1.2 + random() % 5), dose, 20.0 + random() % 90);
    const Printer printer = test::linear_printer(1, 100);
    const CureModel model = make_cure_model(printer, resin, process, layer_um);
    const std::vector<double> levels = level_intensities(printer);
    std::vector<std::uint8_t> pixels;
    std::vector<double> light;
    for (int n = 0; n < 30; ++n) {
      pixels.push_back(random() % 3     ? static_cast<std::uint8_t>(random() % 256)
                       : pixels.empty() ? 255
                                        : pixels.back());
      light.push_back(levels[pixels.back()]);
    }
    const ColumnDose got = column_dose(model, pixels);
    constexpr int cells = 32;
    const std::vector<double> want = followed(resin, process, layer_um, light, cells);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      // The middle of a layer lies between two cells. Midpoints of cells are off by some (dz alpha)²,
      // 2.5e-4 of layers of 100 um.
      const std::size_t k = n * cells + cells / 2;
      EXPECT_NEAR(got.middle[n], 0.5 * (want[k - 1] + want[k]) / dose, 4e-4 * (1 + got.middle[n]))
          << round << " " << n;
    }
  }
}

TEST(BleachingDose, MuchThatBleachesLateIsTheFreshResin) {
  Resin late = bleaching_resin(150, 600, 50, 1e9), beer = late;
  beer.bleaching.reset();
  const Printer printer = test::linear_printer(1, 100);
  std::mt19937 random(8);
  std::vector<std::uint8_t> pixels(50);
  for (auto& p : pixels) p = static_cast<std::uint8_t>(random() % 256);
  for (const Process& process : {test::process(800), layers_of(1.5)}) {
    const ColumnDose a = column_dose(make_cure_model(printer, late, process, 50), pixels),
                     b = column_dose(make_cure_model(printer, beer, process, 50), pixels);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      EXPECT_NEAR(a.upper[n] / b.upper[n], 1, 1e-6);
      EXPECT_NEAR(a.middle[n] / b.middle[n], 1, 1e-6);
    }
  }
}

TEST(BleachingDose, ALongRunGelsAtPhiOfOne) {
  const Resin resin = bleaching_resin(150, 600, 50, 30);
  const Printer printer = test::linear_printer(1, 100);
  const CureModel model = make_cure_model(printer, resin, test::process(800), 50);
  const Kinetics k = make_kinetics(resin, false, true);
  // At the critical intensity a long run brings just the critical dose; a slower stage by as much more
  // light as its share.
  EXPECT_NEAR(passing_dose_prime(k, model.critical_intensity_mw_cm2, 0, 800), 50, 1e-9);
  EXPECT_NEAR(model.phi(2 * model.critical_intensity_mw_cm2), 2, 1e-12);
  EXPECT_LT(model.critical_intensity_mw_cm2, [&] {
    Resin fresh = resin;
    fresh.bleaching.reset();
    return make_cure_model(printer, fresh, test::process(800), 50).critical_intensity_mw_cm2;
  }());
  const int slices = model.slices_to_gel();
  const auto end = [&](int n) {
    return column_dose(model, std::vector<std::uint8_t>(static_cast<std::size_t>(n), 255)).upper[0];
  };
  EXPECT_GE(end(slices), 1.0 - 1e-9);
  EXPECT_LT(end(slices - 1), 1.0);
}

TEST(BleachingDose, InsideLayersIsWhereTheDoseIsOne) {
  std::mt19937 random(21);
  const Resin resin = bleaching_resin(150, 600, 50, 30);
  for (const Process& process : {test::process(800), layers_of(1.0)}) {
    const CureModel model = make_cure_model(test::linear_printer(0.2, 100), resin, process, 100);
    const CureModel thin = make_cure_model(test::linear_printer(0.2, 100), resin, process, 1);
    int seen = 0;
    for (int round = 0; round < 30; ++round) {
      std::vector<std::uint8_t> pixels(8);
      for (auto& p : pixels) p = static_cast<std::uint8_t>(random() % 3 ? random() % 256 : 0);
      BandDose band(model, 1);
      for (std::size_t n = pixels.size(); n-- > 0;) {
        band.add_slice(static_cast<int>(n), &pixels[n]);
        InsideLayer inside;
        band.inside(0, -1, inside);
        const bool passes = (*band.lower() >= 1) != (*band.upper() >= 1);
        ASSERT_EQ(inside.crossings.size(), passes ? 1U : 0U);
        if (!passes || process.mode == ExposureMode::layerwise) continue;
        // The same light in a hundred slices each: 1 um.
        std::vector<std::uint8_t> cut;
        for (std::size_t k = n; k < pixels.size(); ++k) cut.insert(cut.end(), 100, pixels[k]);
        const ColumnDose fine = column_dose(thin, cut);
        const auto at = static_cast<std::size_t>(100 * (1 - inside.crossings[0]));
        EXPECT_TRUE((fine.lower[at] >= 1) != (fine.upper[at] >= 1) ||
                    std::abs(fine.middle[at] - 1) < 1e-3);
        ++seen;
      }
    }
    if (process.mode == ExposureMode::continuous) {
      EXPECT_GT(seen, 10);
    }
  }
}

TEST(BleachingCorrection, RandomColumns) {
  std::mt19937 random(17);
  for (int round = 0; round < test::rounds(60); ++round) {
    const bool layerwise = round % 3 == 2;
    const double height_um = layerwise ? 40.0 + random() % 40 : 150.0 + random() % 300;
    const double bleached_um = height_um * (1.1 + 0.1 * (random() % 15));
    const double layer_um = round % 2 ? 50 : 25;
    const double dose = 20.0 + random() % 60;
    const Resin resin =
        bleaching_resin(height_um, bleached_um, dose, dose * (0.2 + 0.1 * (random() % 30)));
    // Layer by layer full light has twice what a layer takes.
    const Kinetics k = make_kinetics(resin, false, true);
    const Process process =
        layerwise ? layers_of(2 * exposure_for_height_s(k, 100, layer_um)) : test::process(500);
    const int bits = round % 5 == 4 ? 5 : 8;
    const Printer printer = test::gamma_printer(0.5, 100, round % 4 == 1 ? 2.2 : 1.0, bits);
    const CureModel model = make_cure_model(printer, resin, process, layer_um);
    const auto design = test::column(110, test::random_runs(random, 6, 109, 3, 4));
    const test::PrintedColumn printed = test::print(model, process, design);
    EXPECT_EQ(printed.undercured, 0U) << round;
    if (model.level_step_um() < layer_um / 2) {
      EXPECT_EQ(printed.cured_through, 0U) << round;
    }
    // Layer by layer black light of the layer above an edge goes on what is left there; there light
    // falls no slower than in bleached resin.
    const double black_um = layerwise ? model.phi_min() * bleached_um : 0.0;
    EXPECT_LT(printed.largest_um, std::max(0.5, model.level_step_um()) + black_um) << round;
  }
}

TEST(BleachingCorrection, WhoTakesItForBeersLawCuresThrough) {
  // What the resin is corrected for, and the same images in the resin that bleaches.
  const Resin resin = bleaching_resin(100, 400, 50, 25);
  Resin beer = resin;
  beer.bleaching.reset();
  const Process process = test::process(800);
  const Printer printer = test::linear_printer(0.5, 100);
  const CureModel model = make_cure_model(printer, resin, process, 50),
                  wrong = make_cure_model(printer, beer, process, 50);
  const auto design = test::column(60, {{10, 30}, {40, 50}});
  EXPECT_EQ(test::print(model, process, design).wrong(), 0U);
  const auto levels = solve_column(test::plan_for(wrong, process, 60), design);
  const ColumnDose dose = column_dose(model, levels);
  EXPECT_GE(dose.middle[9], 1.0);
  EXPECT_GE(dose.middle[8], 1.0);
}

TEST(BleachingLimits, NumbersThatAreNamedWork) {
  const Resin resin = bleaching_resin(60, 200, 50, 20);
  const Printer printer = test::linear_printer(0.5, 20);
  const auto fails = [&](const Process& process) -> std::string {
    try {
      check_feasible(make_cure_model(printer, resin, process, 50), printer, process);
    } catch (const InfeasibleError& e) {
      return e.what();
    }
    return {};
  };
  const auto number_after = [](const std::string& text, const std::string& words) {
    const auto at = text.find(words);
    EXPECT_NE(at, text.npos) << text;
    return at == text.npos ? 0.0 : std::stod(text.substr(at + words.size()));
  };
  const std::string fast = fails(test::process(2000));
  ASSERT_FALSE(fast.empty());
  const double speed = number_after(fast, "slower than ");
  EXPECT_EQ(fails(test::process(speed)), "");
  EXPECT_NE(fails(test::process(1.001 * speed)), "");
  const std::string brief = fails(layers_of(2));
  ASSERT_FALSE(brief.empty());
  const double least_s = number_after(brief, "expose for at least ");
  EXPECT_EQ(fails(layers_of(least_s)), "");
  EXPECT_NE(fails(layers_of(0.999 * least_s)), "");
  // More light in place of more time: what bleaches lets both through alike.
  const double full = number_after(brief, "or with at least ");
  EXPECT_NEAR(full / 20, least_s / 2, 1e-3 * least_s);
  const std::string black = fails(layers_of(400));
  ASSERT_THAT(black, HasSubstr("black"));
  const double most_s = number_after(black, "for less than ");
  EXPECT_EQ(fails(layers_of(most_s)), "");
  EXPECT_NE(fails(layers_of(1.001 * most_s)), "");
}

TEST(BleachingFit, FindsTheLawOfHeights) {
  const Resin resin = bleaching_resin(100, 260, 12, 40);
  Kinetics k = make_kinetics(resin, false, true);
  resins::Measurements data;
  data.sources = {"made.csv"};
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0, 0.5);
  for (const double dose : {16.0, 25.0, 40.0, 60.0, 90.0, 140.0, 220.0, 350.0, 550.0, 900.0}) {
    for (int again = 0; again < 3; ++again) {
      resins::CuredHeight c;
      c.dose_mj_cm2 = dose;
      c.height_um = cured_height_um(k, 1, dose) + noise(random);
      data.cured.push_back(c);
    }
  }
  const resins::FitResult found = resins::fit(data, resins::FitModel::bleaching, {});
  const double truth[] = {100, 12, 260, 40};
  ASSERT_EQ(found.parameters.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    const resins::Parameter& p = found.parameters[i];
    EXPECT_LE(std::abs(p.value - truth[i]), 4 * p.stderr_) << p.name;
    EXPECT_LT(p.stderr_, 0.2 * truth[i]) << p.name;
  }
  EXPECT_LT(found.rmse_um, 0.7);
  // Jacobs' law can't: heights that bend upwards.
  EXPECT_GT(resins::fit(data, resins::FitModel::jacobs, {}).rmse_um, 5 * found.rmse_um);
}

}  // namespace
}  // namespace slicecorr
