// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light in units of the brightest level: files that say so, what they may not say beside it, and prints
/// that are the same in either unit.
#include "slicecorr/light_unit.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "layerwise_models.hpp"
#include "models.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/tuning_part.hpp"
#include "slicecorr/units.hpp"
#include "stack/formats/definition_json.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;

constexpr const char* kPrinter =
    "name = \"p\"\n[display]\nwidth_px = 40\nheight_px = 30\npixel_um = 50.0\n[blue]\n"
    "unit = \"of the brightest level\"\ncalibration = [[0, 0.0], [128, 0.22], [255, 1.0]]\n";
constexpr const char* kResin =
    "name = \"r\"\n[cure]\nmodel = \"jacobs\"\nunit = \"of the brightest level\"\n"
    "absorbance_height_um = 150\nabsorbance_base = 10\ncritical_dose_s = 0.8\n";

TEST(LightUnit, FilesSayIt) {
  EXPECT_EQ(parse_printer(kPrinter, "p.toml").unit, LightUnit::brightest);
  const Resin resin = parse_resin(kResin, "r.toml");
  EXPECT_EQ(resin.unit, LightUnit::brightest);
  EXPECT_NEAR(critical_dose_s(resin), 0.8, 1e-12);
  EXPECT_EQ(dose_in_words(resin), "0.8 s of full light");
  std::string mw = kPrinter;
  mw.replace(mw.find("of the brightest level"), 22, "mW/cm2");
  EXPECT_EQ(parse_printer(mw, "p.toml").unit, LightUnit::mw_cm2);
  mw.replace(mw.find("mW/cm2"), 6, "lux");
  EXPECT_THAT(refusal([&] { parse_printer(mw, "p.toml"); }),
              AllOf(HasSubstr("p.toml: line 7: blue.unit"), HasSubstr("'lux'"),
                    HasSubstr("of the brightest level")));
  // Seconds are areal, whatever the height.
  ResinOverrides other;
  other.ha_um = 300;
  EXPECT_NEAR(critical_dose_s(parse_resin(kResin, "r.toml", other)), 0.8, 1e-12);
  EXPECT_NEAR(critical_dose_s(with_overrides(resin, other)), 0.8, 1e-12);
  other.dose_factor = 2;
  EXPECT_NEAR(critical_dose_s(with_overrides(resin, other)), 1.6, 1e-12);
}

TEST(LightUnit, WhatNeedsMilliwattsIsRefusedBesideIt) {
  for (const char* table :
       {"[uv]\ncalibration = [[0, 0], [255, 100]]\n", "[vial]\nouter_mm = 9\ninner_mm = 8\n",
        "[beams]\nvat_mm = [1, 1, 1]\n"}) {
    const std::string text = std::string(kPrinter) + table;
    EXPECT_THAT(refusal([&] { parse_printer(text, "p.toml"); }),
                AllOf(HasSubstr("p.toml: line 7: blue.unit"),
                      HasSubstr(std::string(table).substr(0, std::string(table).find('\n')))));
  }
  std::string dim = kPrinter;
  dim.replace(dim.find("255, 1.0"), 8, "255, 4.5");
  EXPECT_THAT(refusal([&] { parse_printer(dim, "p.toml"); }), HasSubstr("expected 1"));
  const auto refused = [](const std::string& text) {
    return refusal([&] { parse_resin(text, "r.toml"); });
  };
  for (const char* key :
       {"gel_dose_mj_cm3", "gel_dose_mj_cm2", "critical_dose_mj_cm3", "critical_dose_mj_cm2",
        "dose_factor", "inhibition_dose_mj_cm3", "inhibition_resupply_mj_cm3_s"}) {
    EXPECT_THAT(refused(std::string(kResin) + key + " = 3\n"), HasSubstr(key));
  }
  for (const char* table :
       {"[inhibition]\nbeta = 0.7\nabsorbance_height_um = 30\nabsorbance_base = \"e\"\n",
        "[bleaching]\ndose_mj_cm2 = 3\nabsorbance_height_um = 200\nabsorbance_base = 10\n"}) {
    EXPECT_THAT(refused(std::string(kResin) + table), HasSubstr("cure.unit"));
  }
  std::string kinetic = kResin;
  kinetic.replace(kinetic.find("jacobs"), 6, "kinetic");
  EXPECT_THAT(refused(kinetic), HasSubstr("jacobs"));
  EXPECT_THAT(refused(std::string(kResin).substr(0, std::string(kResin).find("critical"))),
              HasSubstr("critical_dose_s"));
  std::string mj = kResin;
  mj.erase(mj.find("unit"), mj.find("absorbance_height") - mj.find("unit"));
  EXPECT_THAT(refused(mj), AllOf(HasSubstr("critical_dose_s"), HasSubstr("brightest")));
  ResinOverrides dose;
  dose.dc_mj_cm3 = 5;
  EXPECT_THAT(refusal([&] { parse_resin(kResin, "r.toml", dose); }), HasSubstr("seconds of full"));
  EXPECT_THAT(refusal([&] { with_overrides(parse_resin(kResin, "r.toml"), dose); }),
              HasSubstr("seconds of full"));
}

TEST(LightUnit, PrinterAndResinHaveTheSame) {
  const Printer printer = parse_printer(kPrinter, "p.toml");
  const Resin own = parse_resin(kResin, "r.toml"), absolute = resin(200, 150);
  EXPECT_NO_THROW(check_same_unit(printer, own));
  const auto names = AllOf(HasSubstr("printer 'p'"), HasSubstr("of the brightest level"),
                           HasSubstr("resin 'test'"), HasSubstr("mW/cm2"));
  EXPECT_THAT(refusal([&] { check_same_unit(printer, absolute); }), names);
  // Wherever light comes to a resin.
  EXPECT_THAT(refusal([&] { make_cure_model(printer, absolute, layerwise(8), 50); }), names);
  EXPECT_THAT(refusal([&] { check_same_light(printer, absolute, false, true, "x"); }), names);
  EXPECT_THROW(make_cure_model(linear_printer(0, 1), own, layerwise(8), 50), InputError);
  EXPECT_THAT(light_notices(printer, own, false), Contains(HasSubstr("shares of the brightest")));
  TuningPart::Ask ask;
  ask.resin = &own;
  Printer wide = printer;
  wide.width_px = wide.height_px = 1000;
  EXPECT_THAT(refusal([&] { TuningPart(TuningPartKind::staircase, wide, ask); }),
              HasSubstr("blue.unit"));
}

TEST(LightUnit, StacksRecordIt) {
  Printer printer = parse_printer(kPrinter, "p.toml");
  const Resin own = parse_resin(kResin, "r.toml");
  const nlohmann::json p = nlohmann::json::parse(detail::printer_json(printer).dump()),
                       r = nlohmann::json::parse(detail::resin_json(own).dump());
  EXPECT_EQ(p["unit"], "of the brightest level");
  EXPECT_EQ(r["unit"], "of the brightest level");
  const detail::JsonSource source{"a.uvj", "config.json"};
  EXPECT_EQ(detail::read_printer({p, "printer", source}), printer);
  EXPECT_EQ(detail::read_resin({r, "resin", source}), own);
  nlohmann::json lux = p;
  lux["unit"] = "lux";
  EXPECT_THROW(detail::read_printer({lux, "printer", source}), InputError);
  // Stacks of mW/cm² are as they were.
  EXPECT_FALSE(detail::printer_json(linear_printer(0, 1)).contains("unit"));
  EXPECT_FALSE(detail::resin_json(resin(200, 150)).contains("unit"));
}

// A light of X mW/cm² and a dose of X t_c mJ/cm² are shares of 1 and t_c seconds: the same levels, whatever X.
TEST(LightUnit, LevelsAreThoseOfTheSameLightInMilliwatts) {
  std::mt19937 random(9);
  for (int round = 0; round < rounds(20); ++round) {
    const auto between = [&](double low, double high) {
      return std::uniform_real_distribution(low, high)(random);
    };
    Printer relative = gamma_printer(0, 1, between(1, 3));
    relative.unit = LightUnit::brightest;
    Resin own = parse_resin(kResin, "r.toml");
    own.absorbance_height10_um = between(80, 400);
    own.critical_dose_mj_cm3 = units::volumetric_from_areal(between(0.3, 2), dose_height_e_um(own));
    // A power of two: exact.
    const double full = std::exp2(1 + static_cast<int>(random() % 6));
    Printer absolute = relative;
    absolute.unit = LightUnit::mw_cm2;
    for (CalibrationPoint& c : absolute.calibration) c.intensity_mw_cm2 *= full;
    Resin measured = own;
    measured.unit = LightUnit::mw_cm2;
    measured.critical_dose_mj_cm3 *= full;
    Process process = layerwise(critical_dose_s(own) * between(6, 12));
    process.lifts = Lifts::each;
    const std::vector<std::uint8_t> coverage = random_column(random, 60, false);
    const auto levels = [&](const Printer& p, const Resin& r) {
      return solve_column(CorrectionPlan{make_cure_model(p, r, process, 50), process, 60, 60},
                          coverage);
    };
    EXPECT_EQ(levels(relative, own), levels(absolute, measured)) << round;
  }
}

}  // namespace
}  // namespace slicecorr::test
