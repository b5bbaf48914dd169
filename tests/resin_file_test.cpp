// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What resin files say: doses, heights, inhibition; what is refused, with its line and key.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "definition_texts.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {
namespace {

using namespace test;
using testing::HasSubstr;

constexpr double kLn10 = 2.302585092994046;

TEST(ResinFile, EveryKey) {
  const Resin r = parse_resin(kResin, "r.toml");
  EXPECT_EQ(r.name, "r-1");
  EXPECT_EQ(r.model, CureModelKind::jacobs);
  EXPECT_EQ(r.m, 1);
  EXPECT_EQ(r.absorbance_height10_um, 2000);
  EXPECT_EQ(r.critical_dose_mj_cm3, 576);
  EXPECT_EQ(r.critical_dose_prime, 0);
  EXPECT_EQ(r.gel_dose_mj_cm3, 0);
}

TEST(ResinFile, WhatMayBeLeftOut) {
  const Resin r = parse_resin(
      "[cure]\nabsorbance_height_um = 100\nabsorbance_base = 10\ncritical_dose_mj_cm3 = 5\n",
      "db/plain.toml");
  EXPECT_EQ(r.name, "plain");
  EXPECT_EQ(r.model, CureModelKind::jacobs);
  EXPECT_EQ(r.m, 1);
}

TEST(ResinFile, HeightsOfBothBases) {
  const auto height = [](const char* base) {
    return parse_resin(
               with(kResin, "absorbance_base = 10", std::string("absorbance_base = ") + base),
               "r.toml")
        .absorbance_height10_um;
  };
  EXPECT_EQ(height("10"), 2000);
  EXPECT_EQ(height("\"10\""), 2000);
  EXPECT_NEAR(height("\"e\""), 2000 * kLn10, 1e-9);
}

Resin resin_of(const std::string& doses, const ResinOverrides& overrides = {}) {
  return parse_resin(with(kResin, "critical_dose_mj_cm3 = 576.0", doses), "r.toml", overrides);
}

// Over he um the areal dose is the volumetric dose times he.
constexpr double kHeightECm = 2000e-4 / kLn10;

TEST(ResinFile, ArealAndVolumetricDoses) {
  EXPECT_NEAR(resin_of("critical_dose_mj_cm2 = 15").critical_dose_mj_cm3, 15 / kHeightECm, 1e-9);
  EXPECT_NEAR(15 / kHeightECm, 172.69, 0.005);  // as the dissertation's egg resin says
  const Resin gel = resin_of("gel_dose_mj_cm3 = 149.6\ndose_factor = 5.0");
  EXPECT_EQ(gel.gel_dose_mj_cm3, 149.6);
  EXPECT_EQ(gel.critical_dose_mj_cm3, 748);
  const Resin areal = resin_of("gel_dose_mj_cm2 = 13\ndose_factor = 2");
  EXPECT_NEAR(areal.gel_dose_mj_cm3, 13 / kHeightECm, 1e-9);
  EXPECT_NEAR(areal.critical_dose_mj_cm3, 26 / kHeightECm, 1e-9);
  // In base e the height itself is the one that counts.
  const Resin base_e = parse_resin(
      "[cure]\nabsorbance_height_um = 500\nabsorbance_base = \"e\"\ncritical_dose_mj_cm2 = 10\n",
      "r.toml");
  EXPECT_NEAR(base_e.critical_dose_mj_cm3, 10 / 0.05, 1e-9);
}

TEST(ResinFile, TheCriticalDoseGivenCountsMoreThanGelDoseTimesFactor) {
  const Resin r = resin_of("critical_dose_mj_cm3 = 300\ngel_dose_mj_cm3 = 100\ndose_factor = 5");
  EXPECT_EQ(r.critical_dose_mj_cm3, 300);
  EXPECT_EQ(r.gel_dose_mj_cm3, 100);
}

std::string kinetic(const std::string& m, const std::string& doses) {
  return with(with(with(kResin, "model = \"jacobs\"", "model = \"kinetic\""), "m = 1.0", m),
              "critical_dose_mj_cm3 = 576.0", doses);
}

TEST(ResinFile, KineticModels) {
  const Resin r = parse_resin(kinetic("m = 0.78", "critical_dose_prime = 12.5"), "r.toml");
  EXPECT_EQ(r.model, CureModelKind::kinetic);
  EXPECT_EQ(r.m, 0.78);
  EXPECT_EQ(r.critical_dose_prime, 12.5);
  EXPECT_EQ(r.critical_dose_mj_cm3, 0);
  // The factor is that of what correction aims at.
  EXPECT_EQ(parse_resin(kinetic("m = 2", "critical_dose_prime = 12.5\ndose_factor = 2"), "r.toml")
                .critical_dose_prime,
            25);
  // A linear one is both: (mW/cm²) s = mJ/cm².
  const Resin linear = parse_resin(kinetic("m = 1", "critical_dose_prime = 15"), "r.toml");
  EXPECT_EQ(linear.critical_dose_prime, 15);
  EXPECT_NEAR(linear.critical_dose_mj_cm3, 15 / kHeightECm, 1e-9);
  const Resin volumetric = parse_resin(kinetic("m = 1.0", "critical_dose_mj_cm3 = 15"), "r.toml");
  EXPECT_EQ(volumetric.critical_dose_mj_cm3, 15);
  EXPECT_EQ(volumetric.critical_dose_prime, 0);
  // A measured dose in mJ may stand beside D'c, which alone counts for m other than 1.
  for (const char* beside : {"gel_dose_mj_cm3 = 9\ncritical_dose_prime = 12.5",
                             "critical_dose_mj_cm3 = 9\ncritical_dose_prime = 12.5"}) {
    const Resin both = parse_resin(kinetic("m = 0.5", beside), "r.toml");
    EXPECT_EQ(both.critical_dose_prime, 12.5) << beside;
    EXPECT_EQ(both.critical_dose_mj_cm3, 0) << beside;
  }
}

TEST(ResinFile, OtherKeysAreLeftToOthers) {
  EXPECT_EQ(parse_resin(kResin + "[shop]\nshelf = 3\n", "r.toml"), parse_resin(kResin, "r.toml"));
}

TEST(ResinFile, Inhibition) {
  const auto inhibition = [](const std::string& keys) {
    return parse_resin(kResin + "[inhibition]\n" + keys, "r.toml").inhibition;
  };
  EXPECT_FALSE(parse_resin(kResin, "r.toml").inhibition);
  const auto i = inhibition("beta = 0.73\nabsorbance_height_um = 37.8\nabsorbance_base = \"e\"\n");
  ASSERT_TRUE(i);
  EXPECT_EQ(i->beta, 0.73);
  EXPECT_NEAR(i->absorbance_height10_um, 37.8 * 2.302585092994046, 1e-12);
  EXPECT_EQ(i->m, 1);  // that of the cure
  EXPECT_EQ(inhibition("beta = 1\nabsorbance_height_um = 90\nabsorbance_base = 10\nm = 0.5\n")->m,
            0.5);
  EXPECT_THAT(
      refusal([&] { inhibition("beta = 1\nabsorbance_height_um = 2000\nabsorbance_base = 10\n"); }),
      HasSubstr("inhibition.absorbance_height_um: is 2000 um; expected less "));
  EXPECT_THAT(refusal([&] { inhibition("absorbance_height_um = 90\nabsorbance_base = 10\n"); }),
              HasSubstr("inhibition.beta: missing"));
}

TEST(ResinFile, AimsAtFiveTimesTheGelDose) {
  const Resin five = resin_of("gel_dose_mj_cm3 = 100");
  EXPECT_EQ(five.dose_factor, 5);
  EXPECT_EQ(five.critical_dose_mj_cm3, 500);
  const Resin three = resin_of("gel_dose_mj_cm3 = 100\ndose_factor = 3");
  EXPECT_EQ(three.dose_factor, 3);
  EXPECT_EQ(three.critical_dose_mj_cm3, 300);
  // A dose to aim at that is given counts, whatever the factor says.
  const Resin given =
      resin_of("gel_dose_mj_cm3 = 100\ndose_factor = 3\ncritical_dose_mj_cm3 = 200");
  EXPECT_EQ(given.dose_factor, 2);
  EXPECT_EQ(given.critical_dose_mj_cm3, 200);
}

TEST(ResinFile, Overrides) {
  ResinOverrides o;
  o.dc_mj_cm3 = 99;
  Resin r = parse_resin(kResin, "r.toml", o);
  EXPECT_EQ(r.critical_dose_mj_cm3, 99);
  EXPECT_EQ(r.absorbance_height10_um, 2000);
  // The gel dose is a measurement and stays.
  EXPECT_EQ(resin_of("gel_dose_mj_cm3 = 10\ndose_factor = 5", o).gel_dose_mj_cm3, 10);
  EXPECT_NEAR(resin_of("gel_dose_mj_cm2 = 10\ndose_factor = 5", o).gel_dose_mj_cm3, 10 / kHeightECm,
              1e-9);
  EXPECT_EQ(resin_of("gel_dose_mj_cm3 = 10\ndose_factor = 5", o).critical_dose_mj_cm3, 99);
  // With a dose from outside the file needs none.
  EXPECT_EQ(resin_of("", o).critical_dose_mj_cm3, 99);
  const Resin linear = parse_resin(kinetic("m = 1", "critical_dose_prime = 15"), "r.toml", o);
  EXPECT_EQ(linear.critical_dose_mj_cm3, 99);
  EXPECT_EQ(linear.critical_dose_prime, 0);

  o = {};
  o.ha_um = 1000;  // base 10, whatever the file's
  r = parse_resin(with(kResin, "absorbance_base = 10", "absorbance_base = \"e\""), "r.toml", o);
  EXPECT_EQ(r.absorbance_height10_um, 1000);
  EXPECT_EQ(r.critical_dose_mj_cm3, 576);
}

TEST(ResinFile, OverridesThatDoNotFit) {
  ResinOverrides o;
  o.dc_mj_cm3 = 99;
  // mJ/cm³ mean nothing where the dose is not intensity times time.
  EXPECT_THAT(
      refusal([&] { parse_resin(kinetic("m = 0.78", "critical_dose_prime = 12.5"), "r.toml", o); }),
      testing::AllOf(HasSubstr("r.toml: line 5: cure.m: is 0.78"), HasSubstr("mJ/cm³")));
  for (const double bad : {0.0, -1.0, std::nan(""), 1e300}) {
    o = {};
    o.dc_mj_cm3 = bad;
    refusal([&] { parse_resin(kResin, "r.toml", o); });
    o = {};
    o.ha_um = bad;
    refusal([&] { parse_resin(kResin, "r.toml", o); });
  }
}

class WrongResin : public testing::TestWithParam<Wrong> {};

TEST_P(WrongResin, IsRefusedWithFileLineAndKey) {
  const Wrong& w = GetParam();
  const std::string text = with(kResin, w.line, w.replacement);
  const std::string message = refusal([&] { parse_resin(text, "dir/bad.toml"); });
  EXPECT_THAT(message, testing::StartsWith("dir/bad.toml: " + std::string(w.place)));
  EXPECT_THAT(message, HasSubstr(w.reason));
}

constexpr char kDoseLine[] = "critical_dose_mj_cm3 = 576.0";
constexpr char kModelLine[] = "model = \"jacobs\"";

INSTANTIATE_TEST_SUITE_P(
    ResinFile, WrongResin,
    testing::Values(
        Wrong{"NotToml", kModelLine, "model = jacobs", "line 4: ", "is not TOML"},
        Wrong{"NextToNothing", kDoseLine, "critical_dose_mj_cm3 = 1e-320",
              "line 8: cure.critical_dose_mj_cm3: ", "expected 0 or a number further from it"},
        Wrong{"BeyondAll", kDoseLine, "critical_dose_mj_cm3 = 1e300",
              "line 8: cure.critical_dose_mj_cm3: ", "expected"},
        Wrong{"NameNumber", "name = \"r-1\"", "name = 1", "line 2: name: ", "text in quotes"},
        Wrong{"CureMissing", "[cure]", "[cures]", "line 1: cure: ", "missing; expected a table"},
        Wrong{"ModelUnknown", kModelLine, "model = \"magic\"", "line 4: cure.model: ",
              "is 'magic'; expected \"jacobs\", \"kinetic\" or \"gel-time\""},
        Wrong{"ModelNumber", kModelLine, "model = 1", "line 4: cure.model: ", "text in quotes"},
        Wrong{"JacobsWithM", "m = 1.0", "m = 0.8", "line 5: cure.m: ", "Jacobs model has m = 1"},
        Wrong{"MText", "m = 1.0", "m = \"1\"", "line 5: cure.m: ", "expected a number"},
        Wrong{"MZero", "m = 1.0", "m = 0", "line 5: cure.m: ", "is 0; expected a number above 0"},
        Wrong{"MLarge", "m = 1.0", "m = 2.01", "line 5: cure.m: ", "at most 2"},
        Wrong{"HeightMissing", "absorbance_height_um = 2000.0", "",
              "line 3: cure.absorbance_height_um: ", "missing; expected a number"},
        Wrong{"HeightText", "absorbance_height_um = 2000.0", "absorbance_height_um = \"2 mm\"",
              "line 6: cure.absorbance_height_um: ", "expected a number"},
        Wrong{"HeightZero", "absorbance_height_um = 2000.0", "absorbance_height_um = 0.0",
              "line 6: cure.absorbance_height_um: ", "above 0"},
        Wrong{"HeightInf", "absorbance_height_um = 2000.0", "absorbance_height_um = inf",
              "line 6: cure.absorbance_height_um: ", "at most 1e+07"},
        Wrong{"BaseMissing", "absorbance_base = 10", "",
              "line 3: cure.absorbance_base: ", "missing; expected 10 or \"e\""},
        Wrong{"BaseOther", "absorbance_base = 10", "absorbance_base = 2",
              "line 7: cure.absorbance_base: ", "expected 10 or \"e\""},
        Wrong{"BaseText", "absorbance_base = 10", "absorbance_base = \"ln\"",
              "line 7: cure.absorbance_base: ", "expected 10 or \"e\""},
        Wrong{"DoseMissing", kDoseLine, "", "line 3: cure.critical_dose_mj_cm3: ",
              "missing; expected a critical dose, or gel_dose_mj_cm3 with its dose_factor"},
        Wrong{"DoseText", kDoseLine, "critical_dose_mj_cm3 = \"576\"",
              "line 8: cure.critical_dose_mj_cm3: ", "expected a number"},
        Wrong{"DoseZero", kDoseLine, "critical_dose_mj_cm3 = 0",
              "line 8: cure.critical_dose_mj_cm3: ", "above 0"},
        Wrong{"DoseTwice", kDoseLine, "critical_dose_mj_cm3 = 576\ncritical_dose_mj_cm2 = 50",
              "line 9: cure.critical_dose_mj_cm2: ", "beside critical_dose_mj_cm3"},
        Wrong{"ArealNegative", kDoseLine, "critical_dose_mj_cm2 = -5",
              "line 8: cure.critical_dose_mj_cm2: ", "above 0"},
        Wrong{"FactorWithoutGel", kDoseLine, "dose_factor = 5",
              "line 3: cure.critical_dose_mj_cm3: ", "missing"},
        Wrong{"FactorZero", kDoseLine, "gel_dose_mj_cm3 = 100\ndose_factor = 0",
              "line 9: cure.dose_factor: ", "above 0"},
        Wrong{"FactorHuge", kDoseLine, "gel_dose_mj_cm3 = 100\ndose_factor = 1001",
              "line 9: cure.dose_factor: ", "at most 1000"},
        Wrong{"GelText", kDoseLine, "gel_dose_mj_cm3 = \"x\"\ndose_factor = 2",
              "line 8: cure.gel_dose_mj_cm3: ", "expected a number"},
        Wrong{"GelTwice", kDoseLine, "gel_dose_mj_cm3 = 1\ngel_dose_mj_cm2 = 1\ndose_factor = 2",
              "line 9: cure.gel_dose_mj_cm2: ", "beside gel_dose_mj_cm3"},
        Wrong{"PrimeOfJacobs", kDoseLine, "critical_dose_prime = 5",
              "line 3: cure.critical_dose_mj_cm3: ", "missing"},
        Wrong{"PrimeText", kDoseLine, "critical_dose_prime = \"5\"",
              "line 8: cure.critical_dose_prime: ", "expected a number"}),
    wrong_name);

TEST(ResinFile, KineticModelsNeedTheirOwnDose) {
  for (const char* dose : {"critical_dose_mj_cm3 = 5", "critical_dose_mj_cm2 = 5",
                           "gel_dose_mj_cm3 = 5\ndose_factor = 2"}) {
    EXPECT_THAT(refusal([&] { parse_resin(kinetic("m = 0.7", dose), "r.toml"); }),
                HasSubstr("r.toml: line 3: cure.critical_dose_prime: missing; a resin with m "));
  }
  EXPECT_THAT(
      refusal([&] { parse_resin(kinetic("m = 0.7", "critical_dose_prime = 0"), "r.toml"); }),
      HasSubstr("r.toml: line 8: cure.critical_dose_prime: is 0; expected"));
}

}  // namespace
}  // namespace slicecorr
