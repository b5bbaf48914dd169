// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light that nobody measured, and what is taken in its place.
#include "slicecorr/assumed_light.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "films_lab.hpp"
#include "lab_columns.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/uncertainty.hpp"
#include "slicecorr/unmeasured_light.hpp"

namespace slicecorr {
namespace {

using test::refusal;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kResin =
    "name = \"grey\"\n[cure]\nwavelength_nm = 405\nabsorbance_height_um = 150.0\nabsorbance_base = 10\n"
    "gel_dose_mj_cm2 = 6.0\n";

StackInfo archive(double layer_um, double exposure_s) {
  StackInfo info;
  info.grid = {100, 100, 40, 50, 50, layer_um};
  info.exposure_s = exposure_s;
  return info;
}

SetupChoices choices(const char* resin = kResin) {
  SetupChoices c;
  c.printer_toml = test::kUnlitPrinter;
  c.resin_toml = resin;
  c.mode = "layerwise";
  c.assume = "typical";
  return c;
}

slicecorr::Setup assumed(const SetupChoices& c, const StackInfo& info) {
  return resolve_setup(c, nullptr, &info, ChoiceNames::options);
}

// A print of F critical doses at the window has F a at the far edge of each layer, which is the mean multiple
// of what holds.
TEST(AssumedLight, ExposuresAreTheMeanMultipleOfWhatHolds) {
  for (const char* resin :
       {kResin,
        "name = \"steep\"\n[cure]\nmodel = \"kinetic\"\nm = 0.9\nabsorbance_height_um = 210.0\n"
        "absorbance_base = 10\ncritical_dose_prime = 30.0\ndose_factor = 1\n"}) {
    for (const double layer_um : {25.0, 50.0, 100.0}) {
      for (const double strength : {0.0, 1.5}) {
        SetupChoices c = choices(resin);
        c.green_strength = strength;
        const slicecorr::Setup setup = assumed(c, archive(layer_um, 2.5));
        const double holds = strength > 0 ? strength : kDefaultGreenStrength;
        const double a =
            std::pow(10, -setup.resin.m * layer_um / setup.resin.absorbance_height10_um);
        const CureModel model =
            make_cure_model(setup.printer, setup.resin, setup.process, layer_um);
        EXPECT_NEAR(model.phi_max() * a / holds, std::sqrt(10), 1e-9) << resin << layer_um;
        EXPECT_NEAR(setup.process.green_strength, holds * std::sqrt(2.5), 1e-12);
        EXPECT_EQ(setup.process.assumed, AssumedLight::mono_lcd_405);
        ASSERT_TRUE(setup.uncertainty);
        EXPECT_DOUBLE_EQ(setup.uncertainty->sd(UncertainInput::dc), 0.23);
      }
    }
  }
}

// Layers that get half of the light, as a file says, and higher ones: what holds last decides.
TEST(AssumedLight, DimmedAndHigherLayersCount) {
  SetupChoices c = choices();
  StackInfo info = archive(50, 2);
  const Resin plain = assumed(c, info).resin;
  info.light_share = {0.5};
  EXPECT_NEAR(assumed(c, info).resin.critical_dose_mj_cm3, plain.critical_dose_mj_cm3 / 2, 1e-12);
  info.light_share.clear();
  info.layer_heights_um = {50, 100, 50};
  EXPECT_NEAR(assumed(c, info).resin.critical_dose_mj_cm3,
              plain.critical_dose_mj_cm3 * std::pow(10, -50.0 / 150), 1e-12);
}

// What the archive says prints; another exposure is so many times as much of it.
TEST(AssumedLight, TheArchivesExposureIsTheOneThatPrints) {
  SetupChoices c = choices();
  const StackInfo info = archive(50, 2.5);
  const double dose = assumed(c, info).resin.critical_dose_mj_cm3;
  c.exposure_s = 0.1;
  const slicecorr::Setup short_one = assumed(c, info);
  EXPECT_EQ(short_one.resin.critical_dose_mj_cm3, dose);
  const CureModel model =
      make_cure_model(short_one.printer, short_one.resin, short_one.process, 50);
  EXPECT_NEAR(model.phi_max() * std::pow(10, -50.0 / 150),
              std::sqrt(10) * kDefaultGreenStrength * 0.1 / 2.5, 1e-9);
  // Without an archive the one that is chosen, of layers as high as is said, each or all.
  const auto without = [](SetupChoices chosen) {
    return resolve_setup(chosen, nullptr, nullptr, ChoiceNames::options).resin.critical_dose_mj_cm3;
  };
  c.exposure_s = 2.5;
  EXPECT_THAT(refusal([&] { without(c); }), HasSubstr("exposures and layer heights"));
  c.layer_um = 50;
  EXPECT_NEAR(without(c), dose, 1e-12 * dose);
  c.layer_um = 0;
  c.layer_heights_um = {25, 50};
  EXPECT_NEAR(without(c), dose, 1e-12 * dose);
}

// A stack that was corrected so says strength and dose with their margins: who repeats its options gets them
// once, whatever exposure and strength it was corrected with.
TEST(AssumedLight, OptionsThatAreRepeatedChangeNothing) {
  for (const double exposure_s : {0.0, 4.0}) {
    for (const double strength : {0.0, 1.5}) {
      SCOPED_TRACE(fmt::format("{} s, {}", exposure_s, strength));
      SetupChoices c = choices();
      c.exposure_s = exposure_s;
      c.green_strength = strength;
      c.layer_heights_um = {50, 80, 50};
      StackInfo info = archive(50, 2.5);
      info.light_share = {0.5};
      const slicecorr::Setup made = assumed(c, info);
      // The archive that comes of it.
      info.kind = StackKind::corrected;
      info.printer = made.printer;
      info.resin = made.resin;
      info.process = made.process;
      info.exposure_s = made.process.exposure_s;
      const auto again = [&](const SetupChoices& said) {
        return resolve_setup(said, &info, &info, ChoiceNames::options);
      };
      const double dose = made.resin.critical_dose_mj_cm3, green = made.process.green_strength;
      SetupChoices without_times = c;
      without_times.layer_heights_um.clear();
      without_times.exposure_s = 0;
      for (const SetupChoices& said : {SetupChoices{}, c, without_times}) {
        const slicecorr::Setup seen = again(said);
        EXPECT_NEAR(seen.resin.critical_dose_mj_cm3, dose, 1e-14 * dose);
        EXPECT_NEAR(seen.process.green_strength, green, 1e-14 * green);
        EXPECT_EQ(seen.process.assumed, AssumedLight::mono_lcd_405);
        ASSERT_TRUE(seen.uncertainty);
      }
      SetupChoices none;
      EXPECT_EQ(again(none).process.green_strength, green);
      // A strength by itself is that of people, who know of no margin.
      none.green_strength = 1.5;
      EXPECT_NEAR(again(none).process.green_strength, 1.5 * std::sqrt(2.5), 1e-12);
      // What is measured has no margin.
      SetupChoices measured;
      std::string lit = test::kUnlitPrinter;
      const std::string unlit = "\"to be measured\"";
      lit.replace(lit.find(unlit), unlit.size(), "[[0, 0], [255, 1.5]]");
      measured.printer_toml = lit;
      measured.resin_toml = kResin;
      EXPECT_NEAR(again(measured).process.green_strength,
                  strength > 0 ? strength : kDefaultGreenStrength, 1e-12);
      EXPECT_EQ(again(measured).process.assumed, AssumedLight::none);
    }
  }
}

// An archive with times is printed layer by layer: that is what is asked for first.
TEST(AssumedLight, AnArchiveWithTimesIsSaidToBeLayerByLayer) {
  SetupChoices c = choices();
  c.mode.clear();
  const StackInfo info = archive(50, 2.5);
  EXPECT_THAT(refusal([&] { resolve_setup(c, &info, &info, ChoiceNames::options); }),
              HasSubstr("expected --mode layerwise, which takes the archive's exposure times"));
}

TEST(AssumedLight, CurvesOfTypicalDisplays) {
  const Printer display = parse_display(test::kUnlitPrinter, "dark.toml");
  const Printer lcd = with_assumed_light(display, AssumedLight::mono_lcd_405);
  ASSERT_EQ(lcd.calibration.size(), 256U);
  // 236 for 80 % of the light, as was measured (UVtools issue 1104).
  EXPECT_NEAR(lcd.calibration[236].intensity_mw_cm2, 0.8, 0.01);
  EXPECT_EQ(lcd.calibration[0].intensity_mw_cm2, 0);
  EXPECT_EQ(lcd.calibration[255].intensity_mw_cm2, 1);
  const Printer dlp = with_assumed_light(display, AssumedLight::dlp_405);
  EXPECT_EQ(dlp.calibration[37].intensity_mw_cm2, 0);
  EXPECT_NEAR(dlp.calibration[146].intensity_mw_cm2, 0.5, 1e-12);
  Printer uv = display;
  uv.wavelength_nm = 385;
  EXPECT_EQ(assumed_light("typical", uv), AssumedLight::dlp_385);
  EXPECT_EQ(assumed_light("typical", display), AssumedLight::mono_lcd_405);
  EXPECT_THAT(refusal([&] { with_assumed_light(uv, AssumedLight::mono_lcd_405); }),
              AllOf(HasSubstr("385"), HasSubstr("LCD of 405 nm")));
  EXPECT_THAT(refusal([&] { with_assumed_light(lcd, AssumedLight::mono_lcd_405); }),
              HasSubstr("is measured"));
}

// A display of black and white drops a part's greys, which is told.
TEST(AssumedLight, BlackAndWhiteAloneIsTold) {
  SetupChoices c = choices();
  EXPECT_THAT(setup_notices(assumed(c, archive(50, 2)), nullptr, ChoiceNames::options),
              testing::Not(testing::Contains(HasSubstr("black and white"))));
  // Nor whose display films were made with: there were none.
  EXPECT_THAT(setup_notices(assumed(c, archive(50, 2)), nullptr, ChoiceNames::options),
              testing::Not(testing::Contains(HasSubstr("its films were made"))));
  std::string two = test::kUnlitPrinter;
  two.insert(two.find("[blue]"), "bit_depth = 1\n");
  c.printer_toml = two;
  EXPECT_THAT(setup_notices(assumed(c, archive(50, 2)), nullptr, ChoiceNames::options),
              testing::Contains(AllOf(HasSubstr("'dark'"), HasSubstr("black and white alone"))));
}

TEST(AssumedLight, WhatDoesNotGoWithIt) {
  const StackInfo info = archive(50, 2.5);
  const auto refused = [&](const auto& change) {
    SetupChoices c = choices();
    change(c);
    return refusal([&] { assumed(c, info); });
  };
  EXPECT_THAT(refused([](SetupChoices& c) { c.mode = "continuous", c.speed_mm_h = 100; }),
              AllOf(HasSubstr("--assume"), HasSubstr("--mode layerwise")));
  EXPECT_THAT(refused([](SetupChoices& c) { c.lifts = "none"; }), HasSubstr("--lifts each"));
  EXPECT_THAT(refused([](SetupChoices& c) { c.lift_exchange = 0.5; }),
              HasSubstr("--lift-exchange"));
  EXPECT_THAT(refused([](SetupChoices& c) { c.dose_factor = 2; }), HasSubstr("--dose-factor"));
  EXPECT_THAT(
      refused([](SetupChoices& c) {
        c.resin_toml =
            "name = \"mine\"\n[cure]\nunit = \"of the brightest level\"\nabsorbance_height_um = "
            "150.0\nabsorbance_base = 10\ncritical_dose_s = 0.8\n";
      }),
      HasSubstr("seconds"));
  EXPECT_THAT(refused([](SetupChoices& c) {
                c.resin_toml =
                    "name = \"other\"\n[cure]\nwavelength_nm = 385\nabsorbance_height_um = "
                    "150.0\nabsorbance_base = 10\ngel_dose_mj_cm2 = 6.0\n";
              }),
              AllOf(HasSubstr("385"), HasSubstr("405")));
  SetupChoices c = choices();
  const StackInfo no_time = archive(50, 0);
  EXPECT_THAT(refusal([&] { assumed(c, no_time); }), HasSubstr("--exposure-s"));
  c.assume = "none";
  EXPECT_THAT(refusal([&] { assumed(c, info); }), HasSubstr("to be measured"));
}

// Labs that measured nothing: displays of powers from 2.2 to 3.5, exposures 2 to 5 times what holds, heights
// some 10 % from those published. Every layer gels by its own exposure, no edge lies further from its place
// than as sliced, and edges lie in the band that is told.
TEST(AssumedLight, LabsThatMeasuredNothing) {
  std::mt19937 random(11);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  std::normal_distribution<double> normal;
  int edges = 0, in_band = 0, nearer = 0;
  for (int lab = 0; lab < test::rounds(60); ++lab) {
    SCOPED_TRACE(lab);
    SetupChoices c = choices();
    c.ha_um = between(90, 350);
    const slicecorr::Setup setup = assumed(c, archive(50, 2.5));
    const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, 50);
    const test::LabColumn part = test::random_lab_column(random);
    const int layers = static_cast<int>(part.coverage.size());
    const std::vector<std::uint8_t> levels =
        solve_column(CorrectionPlan{model, setup.process, layers, layers}, part.coverage);
    // What is hidden.
    const double power = between(2.2, 3.5), x = std::array{0.0, 0.3, 1.0}[random() % 3],
                 ha_um = c.ha_um * std::exp(std::clamp(0.1 * normal(random), -0.2, 0.2)),
                 multiple = 2 * std::pow(2.5, between(0, 1)),
                 full = multiple * kDefaultGreenStrength * std::pow(10, 50 / ha_um);
    std::vector<double> phi, sliced, told;
    for (const std::uint8_t g : levels) {
      phi.push_back(full * std::pow(g / 255.0, power));
      told.push_back(model.phi_max() * std::pow(g / 255.0, 3));
    }
    for (const std::uint8_t covered : part.coverage) sliced.push_back(covered ? full : 0);
    for (int n = 0; n < layers; ++n) {
      if (!part.coverage[static_cast<std::size_t>(n)]) continue;
      // Powers above 3 take 7 % from the least light, published heights and levels little more.
      EXPECT_GE(phi[static_cast<std::size_t>(n)] * std::pow(10, -50 / ha_um), 1.0) << n;
    }
    const auto scaled = [](std::vector<double> doses, double factor) {
      for (double& d : doses) d *= factor;
      return doses;
    };
    // 1.96 standard deviations of dose and light together; heights by the same to either side.
    const double off = std::exp(1.96 * std::hypot(0.23, 0.12)), high = 1.96 * 0.1;
    for (const int u : part.begins) {
      const double now = test::lab_edge_um(phi, ha_um, 50, u, x),
                   before = test::lab_edge_um(sliced, ha_um, 50, u, x);
      EXPECT_GE(now, -50.0 / test::kLabPoints) << "a feature got thinner";
      const auto at = [&](double factor, double height) {
        return test::lab_edge_um(scaled(told, factor), c.ha_um * height, 50, u, x);
      };
      const double weak = std::min(at(1 / off, 1 - high), at(1 / off, 1 + high)),
                   strong = std::max(at(off, 1 - high), at(off, 1 + high));
      ++edges;
      in_band += now >= weak && now <= strong ? 1 : 0;
      nearer += now <= before ? 1 : 0;
    }
  }
  EXPECT_EQ(nearer, edges);
  EXPECT_GE(in_band, 0.95 * edges);
  RecordProperty("in_band", in_band);
  RecordProperty("edges", edges);
}

}  // namespace
}  // namespace slicecorr
