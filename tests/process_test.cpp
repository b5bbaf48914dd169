#include "slicecorr/process.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/load_printer.hpp"

namespace slicecorr {
namespace {

using test::refusal;

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr double kLn10 = 2.302585092994046;

/// A text in which one line is replaced; nothing when it is not there.
std::string with(std::string text, const std::string& line, const std::string& replacement) {
  const std::size_t at = text.find("\n" + line + "\n");
  EXPECT_NE(at, std::string::npos) << line;
  if (at != std::string::npos) text.replace(at + 1, line.size(), replacement);
  return text;
}

// --- Printers

const std::string kPrinter = R"(# a printer
name = "dlp-1"
[display]
width_px = 1280
height_px = 800
pixel_um = 50.0
bit_depth = 8
[blue]
wavelength_nm = 460
calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]
[stage]
max_speed_mm_h = 2000
travel_mm = 100
)";

TEST(PrinterFile, EveryKey) {
  const Printer p = parse_printer(kPrinter, "p.toml");
  EXPECT_EQ(p.name, "dlp-1");
  EXPECT_EQ(p.width_px, 1280);
  EXPECT_EQ(p.height_px, 800);
  EXPECT_EQ(p.pixel_x_um, 50);
  EXPECT_EQ(p.pixel_y_um, 50);
  EXPECT_EQ(p.bit_depth, 8);
  EXPECT_EQ(p.levels(), 256);
  EXPECT_EQ(p.wavelength_nm, 460);
  EXPECT_EQ(p.calibration, (std::vector<CalibrationPoint>{{0, 1}, {128, 31}, {255, 100}}));
  EXPECT_EQ(p.max_speed_mm_h, 2000);
  EXPECT_EQ(p.travel_mm, 100);
}

TEST(PrinterFile, WhatMayBeLeftOut) {
  const Printer p = parse_printer(
      "[display]\nwidth_px = 1\nheight_px = 65536\npixel_um = 7\n"
      "[blue]\ncalibration = [[0, 0], [255, 5]]\n",
      "/some/where/small.toml");
  EXPECT_EQ(p.name, "small");
  EXPECT_EQ(p.width_px, 1);
  EXPECT_EQ(p.height_px, 65536);
  EXPECT_EQ(p.pixel_x_um, 7);
  EXPECT_EQ(p.bit_depth, 8);
  EXPECT_EQ(p.wavelength_nm, 0);
  EXPECT_EQ(p.max_speed_mm_h, 0);
  EXPECT_EQ(p.travel_mm, 0);
}

TEST(PrinterFile, OtherKeysAreLeftToOthers) {
  const Printer p = parse_printer(
      kPrinter + "[modbus]\nregister = 40001\n[provenance]\ndate = \"2020\"\n", "p.toml");
  EXPECT_EQ(p, parse_printer(kPrinter, "p.toml"));
}

TEST(PrinterFile, UvLamp) {
  const auto with_uv = [](const std::string& keys) {
    return parse_printer(kPrinter + "[uv]\n" + keys, "p.toml").uv;
  };
  EXPECT_FALSE(parse_printer(kPrinter, "p.toml").uv);
  // A flood lamp has control values of its own.
  const auto flood = with_uv("wavelength_nm = 365\ncalibration = [[10, 1.5], [90, 275]]\n");
  ASSERT_TRUE(flood);
  EXPECT_FALSE(flood->patterned);
  EXPECT_EQ(flood->wavelength_nm, 365);
  EXPECT_EQ(flood->min_mw_cm2(), 1.5);
  EXPECT_EQ(flood->max_mw_cm2(), 275);
  EXPECT_TRUE(with_uv("kind = \"patterned\"\ncalibration = [[0, 0], [255, 9]]\n")->patterned);
  EXPECT_THAT(refusal([&] { with_uv("kind = \"patterned\"\ncalibration = [[0, 0], [9, 9]]\n"); }),
              HasSubstr("uv.calibration: goes from level 0 to 9; expected 0 to 255"));
  EXPECT_THAT(refusal([&] { with_uv("kind = \"beam\"\ncalibration = [[0, 0], [9, 9]]\n"); }),
              HasSubstr("uv.kind: is 'beam'; expected"));
  EXPECT_THAT(refusal([&] { with_uv("wavelength_nm = 365\n"); }),
              HasSubstr("uv.calibration: missing"));
}

TEST(PrinterFile, PixelsNeedNotBeSquare) {
  const Printer p = parse_printer(with(kPrinter, "pixel_um = 50.0", "pixel_um = [19, 24.5]"), "p");
  EXPECT_EQ(p.pixel_x_um, 19);
  EXPECT_EQ(p.pixel_y_um, 24.5);
}

TEST(PrinterFile, EveryBitDepthEndsAtItsOwnLevel) {
  for (int bits = 1; bits <= 8; ++bits) {
    const std::string depth =
        with(kPrinter, "bit_depth = 8", "bit_depth = " + std::to_string(bits));
    const auto ending = [&](int level) {
      return with(depth, "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]",
                  "calibration = [[0, 1.0], [" + std::to_string(level) + ", 31.0]]");
    };
    const int top = (1 << bits) - 1;
    const Printer p = parse_printer(ending(top), "p.toml");
    EXPECT_EQ(p.levels(), top + 1);
    EXPECT_EQ(p.calibration.back().level, top);
    for (const int wrong : {top + 1, 2 * top + 1}) {
      EXPECT_THAT(refusal([&] { parse_printer(ending(wrong), "p.toml"); }),
                  testing::AllOf(HasSubstr("p.toml: line 10: blue.calibration: "),
                                 HasSubstr("expected 0 to " + std::to_string(top) + " for " +
                                           std::to_string(bits) + " bits")));
    }
  }
}

TEST(PrinterFile, CalibrationsWithPlateaus) {
  const auto parse = [](const std::string& points) {
    return parse_printer(with(kPrinter, "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]",
                              "calibration = " + points),
                         "p.toml");
  };
  EXPECT_EQ(parse("[[0, 0], [40, 0], [41, 5], [200, 5], [255, 5]]").calibration.size(), 5u);
  EXPECT_EQ(parse("[[0, 3], [255, 3]]").calibration.back().intensity_mw_cm2, 3);
  EXPECT_EQ(parse("[[0, 0], [0.5, 1], [255, 1000000]]").calibration[1].level, 0.5);
}

struct Wrong {
  const char* name;
  const char* line;         ///< that is replaced
  const char* replacement;  ///< by this
  const char* place;        ///< what the message must say: line and key
  const char* reason;       ///< and this
};

void PrintTo(const Wrong& w, std::ostream* out) { *out << w.name; }
std::string wrong_name(const testing::TestParamInfo<Wrong>& info) { return info.param.name; }

constexpr char kCalibrationLine[] = "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]";

class WrongPrinter : public testing::TestWithParam<Wrong> {};

TEST_P(WrongPrinter, IsRefusedWithFileLineAndKey) {
  const Wrong& w = GetParam();
  const std::string text = with(kPrinter, w.line, w.replacement);
  const std::string message = refusal([&] { parse_printer(text, "dir/bad.toml"); });
  EXPECT_THAT(message, testing::StartsWith("dir/bad.toml: " + std::string(w.place)));
  EXPECT_THAT(message, HasSubstr(w.reason));
}

TEST(PrinterFile, AStageIsATable) {
  std::string text = with(kPrinter, "name = \"dlp-1\"", "stage = \"z\"");
  text.erase(text.find("[stage]"));
  EXPECT_THAT(refusal([&] { parse_printer(text, "p.toml"); }),
              testing::StartsWith("p.toml: line 2: stage: expected a table"));
}

INSTANTIATE_TEST_SUITE_P(
    PrinterFile, WrongPrinter,
    testing::Values(
        Wrong{"NotToml", "width_px = 1280", "width_px = = 1280", "line 4: ", "is not TOML"},
        Wrong{"KeyTwice", "height_px = 800", "height_px = 800\nheight_px = 700",
              "line 6: ", "is not TOML"},
        Wrong{"NameNumber", "name = \"dlp-1\"", "name = 5", "line 2: name: ", "text in quotes"},
        Wrong{"DisplayNumber", "[display]", "display = 5\n[other]",
              "line 3: display: ", "expected a table"},
        Wrong{"DisplayMissing", "[display]", "[displays]",
              "line 1: display: ", "missing; expected a table"},
        Wrong{"WidthMissing", "width_px = 1280", "",
              "line 3: display.width_px: ", "missing; expected a whole number"},
        Wrong{"WidthText", "width_px = 1280", "width_px = \"1280\"",
              "line 4: display.width_px: ", "expected a whole number"},
        Wrong{"WidthFraction", "width_px = 1280", "width_px = 1280.0",
              "line 4: display.width_px: ", "expected a whole number"},
        Wrong{"WidthZero", "width_px = 1280", "width_px = 0",
              "line 4: display.width_px: ", "is 0; expected 1 to 65536"},
        Wrong{"WidthLarge", "width_px = 1280", "width_px = 65537",
              "line 4: display.width_px: ", "is 65537; expected 1 to 65536"},
        Wrong{"WidthHuge", "width_px = 1280", "width_px = 4294968576",
              "line 4: display.width_px: ", "expected 1 to 65536"},
        Wrong{"HeightMissing", "height_px = 800", "", "line 3: display.height_px: ", "missing"},
        Wrong{"HeightNegative", "height_px = 800", "height_px = -800",
              "line 5: display.height_px: ", "is -800; expected 1 to 65536"},
        Wrong{"HeightTruth", "height_px = 800", "height_px = true",
              "line 5: display.height_px: ", "expected a whole number"},
        Wrong{"PixelMissing", "pixel_um = 50.0", "",
              "line 3: display.pixel_um: ", "missing; expected a number"},
        Wrong{"PixelText", "pixel_um = 50.0", "pixel_um = \"50\"",
              "line 6: display.pixel_um: ", "expected a number"},
        Wrong{"PixelZero", "pixel_um = 50.0", "pixel_um = 0",
              "line 6: display.pixel_um: ", "is 0; expected a number above 0"},
        Wrong{"PixelNan", "pixel_um = 50.0", "pixel_um = nan",
              "line 6: display.pixel_um: ", "expected a number above 0"},
        Wrong{"PixelInf", "pixel_um = 50.0", "pixel_um = inf",
              "line 6: display.pixel_um: ", "at most 10000"},
        Wrong{"PixelLarge", "pixel_um = 50.0", "pixel_um = 10001", "line 6: display.pixel_um: ",
              "is 10001; expected a number above 0 and at most 10000"},
        Wrong{"PixelOneOfTwo", "pixel_um = 50.0", "pixel_um = [50]",
              "line 6: display.pixel_um: ", "expected a number or [x, y]"},
        Wrong{"PixelThree", "pixel_um = 50.0", "pixel_um = [50, 50, 50]",
              "line 6: display.pixel_um: ", "expected a number or [x, y]"},
        Wrong{"PixelSecondZero", "pixel_um = 50.0", "pixel_um = [50, 0]",
              "line 6: display.pixel_um: ", "above 0"},
        Wrong{"PixelSecondText", "pixel_um = 50.0", "pixel_um = [50, \"x\"]",
              "line 6: display.pixel_um: ", "expected a number or [x, y]"},
        Wrong{"BitsZero", "bit_depth = 8", "bit_depth = 0",
              "line 7: display.bit_depth: ", "is 0; expected 1 to 8"},
        Wrong{"BitsLarge", "bit_depth = 8", "bit_depth = 16",
              "line 7: display.bit_depth: ", "is 16; expected 1 to 8"},
        Wrong{"BitsText", "bit_depth = 8", "bit_depth = \"8\"",
              "line 7: display.bit_depth: ", "expected a whole number"},
        Wrong{"BlueMissing", "[blue]", "[green]", "line 1: blue: ", "missing; expected a table"},
        Wrong{"WavelengthText", "wavelength_nm = 460", "wavelength_nm = \"blue\"",
              "line 9: blue.wavelength_nm: ", "expected a number"},
        Wrong{"WavelengthZero", "wavelength_nm = 460", "wavelength_nm = 0",
              "line 9: blue.wavelength_nm: ", "above 0"},
        Wrong{"CalibrationMissing", kCalibrationLine, "",
              "line 8: blue.calibration: ", "missing; expected [[grey level, mW/cm²], ...]"},
        Wrong{"CalibrationNumber", kCalibrationLine, "calibration = 3",
              "line 10: blue.calibration: ", "expected [[grey level, mW/cm²], ...]"},
        Wrong{"CalibrationFlat", kCalibrationLine, "calibration = [0, 1, 255, 100]",
              "line 10: blue.calibration: ", "expected pairs"},
        Wrong{"CalibrationTriples", kCalibrationLine, "calibration = [[0, 1, 2], [255, 3, 4]]",
              "line 10: blue.calibration: ", "expected pairs"},
        Wrong{"CalibrationTexts", kCalibrationLine, "calibration = [[0, 1], [255, \"9\"]]",
              "line 10: blue.calibration: ", "expected pairs"},
        Wrong{"CalibrationEmpty", kCalibrationLine, "calibration = []",
              "line 10: blue.calibration: ", "at least two points"},
        Wrong{"CalibrationOnePoint", kCalibrationLine, "calibration = [[0, 1]]",
              "line 10: blue.calibration: ", "at least two points"},
        Wrong{
            "CalibrationFalls", kCalibrationLine, "calibration = [[0, 1], [128, 31], [255, 30.5]]",
            "line 10: blue.calibration: point 3: ", "the curve must not fall, 30.5 comes after 31"},
        Wrong{"CalibrationUnsorted", kCalibrationLine,
              "calibration = [[0, 1], [200, 31], [128, 40], [255, 50]]",
              "line 10: blue.calibration: point 3: ", "must rise, 128 comes after 200"},
        Wrong{"CalibrationLevelTwice", kCalibrationLine,
              "calibration = [[0, 1], [128, 31], [128, 40], [255, 50]]",
              "line 10: blue.calibration: point 3: ", "must rise, 128 comes after 128"},
        Wrong{"CalibrationStartsLate", kCalibrationLine, "calibration = [[1, 1], [255, 50]]",
              "line 10: blue.calibration: ", "goes from level 1 to 255; expected 0 to 255"},
        Wrong{"CalibrationEndsEarly", kCalibrationLine, "calibration = [[0, 1], [254, 50]]",
              "line 10: blue.calibration: ", "goes from level 0 to 254; expected 0 to 255"},
        Wrong{"CalibrationNegative", kCalibrationLine, "calibration = [[0, -1], [255, 50]]",
              "line 10: blue.calibration: point 1 [0, -1]", "an intensity of 0 to 1e6"},
        Wrong{"CalibrationHuge", kCalibrationLine, "calibration = [[0, 1], [255, 1e7]]",
              "line 10: blue.calibration: point 2", "an intensity of 0 to 1e6"},
        Wrong{"CalibrationNan", kCalibrationLine, "calibration = [[0, nan], [255, 50]]",
              "line 10: blue.calibration: point 1", "an intensity of 0 to 1e6"},
        Wrong{"CalibrationLevelNan", kCalibrationLine, "calibration = [[0, 1], [nan, 50]]",
              "line 10: blue.calibration: point 2", "expected"},
        Wrong{"CalibrationDark", kCalibrationLine, "calibration = [[0, 0], [255, 0]]",
              "line 10: blue.calibration: ", "some light at full level"},
        Wrong{"SpeedZero", "max_speed_mm_h = 2000", "max_speed_mm_h = 0",
              "line 12: stage.max_speed_mm_h: ", "is 0; expected a number above 0"},
        Wrong{"SpeedText", "max_speed_mm_h = 2000", "max_speed_mm_h = \"fast\"",
              "line 12: stage.max_speed_mm_h: ", "expected a number"},
        Wrong{"TravelNegative", "travel_mm = 100", "travel_mm = -1",
              "line 13: stage.travel_mm: ", "is -1; expected a number above 0"},
        Wrong{"TravelDate", "travel_mm = 100", "travel_mm = 2020-01-01",
              "line 13: stage.travel_mm: ", "expected a number"}),
    wrong_name);

// --- Resins

const std::string kResin = R"(# a resin
name = "r-1"
[cure]
model = "jacobs"
m = 1.0
absorbance_height_um = 2000.0
absorbance_base = 10
critical_dose_mj_cm3 = 576.0
[provenance]
source = "somewhere"
)";

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
      HasSubstr("inhibition.absorbance_height_um: is 2000 um in base 10; expected less "));
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

// --- Files

class DefinitionFiles : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("slicecorr_process_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    for (const char* name : {"SLICECORR_DB", "XDG_CONFIG_HOME", "HOME"}) {
      const char* value = std::getenv(name);
      before_.emplace_back(name, value ? std::optional<std::string>(value) : std::nullopt);
    }
    unsetenv("SLICECORR_DB");
    set("XDG_CONFIG_HOME", folder_ / "no-config");
    set("HOME", folder_ / "no-home");
  }
  void TearDown() override {
    for (const auto& [name, value] : before_) {
      if (value) {
        setenv(name.c_str(), value->c_str(), 1);
      } else {
        unsetenv(name.c_str());
      }
    }
    fs::remove_all(folder_);
  }
  static void set(const char* name, const fs::path& value) { setenv(name, value.c_str(), 1); }
  std::string write(const fs::path& name, const std::string& text) const {
    const fs::path path = folder_ / name;
    fs::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << text;
    return path.string();
  }

  fs::path folder_;

 private:
  std::vector<std::pair<std::string, std::optional<std::string>>> before_;
};

TEST_F(DefinitionFiles, ByPath) {
  EXPECT_EQ(load_printer(write("one.toml", kPrinter)).name, "dlp-1");
  EXPECT_EQ(load_resin(write("a b/two.toml", kResin)).name, "r-1");
  ResinOverrides o;
  o.dc_mj_cm3 = 7;
  EXPECT_EQ(load_resin(write("two.toml", kResin), o).critical_dose_mj_cm3, 7);
  const std::string missing = (folder_ / "none.toml").string();
  EXPECT_THAT(refusal([&] { load_printer(missing); }), testing::StartsWith(missing));
  EXPECT_THAT(refusal([&] { load_resin(missing); }), testing::StartsWith(missing));
  fs::create_directories(folder_ / "folder.toml");
  EXPECT_THAT(refusal([&] { load_resin((folder_ / "folder.toml").string()); }),
              HasSubstr("folder.toml"));
  // A complaint names the file as it was given.
  const std::string bad = write("bad.toml", with(kPrinter, "width_px = 1280", "width_px = 0"));
  EXPECT_THAT(refusal([&] { load_printer(bad); }),
              testing::StartsWith(bad + ": line 4: display.width_px: "));
  const std::string empty = write("empty.toml", "");
  EXPECT_THAT(refusal([&] { load_printer(empty); }),
              testing::StartsWith(empty + ": line 1: display: missing"));
  EXPECT_THAT(refusal([&] { load_resin(empty); }),
              testing::StartsWith(empty + ": line 1: cure: missing"));
}

TEST_F(DefinitionFiles, WindowsLineEndsAndByteOrderMark) {
  std::string text = "\xEF\xBB\xBF";
  for (const char c : kPrinter) text += c == '\n' ? std::string("\r\n") : std::string(1, c);
  EXPECT_EQ(load_printer(write("dos.toml", text)), parse_printer(kPrinter, "dos.toml"));
}

TEST_F(DefinitionFiles, ByName) {
  const auto named = [](const std::string& text, const char* was, const char* name) {
    return with(text, was, std::string("name = \"") + name + "\"");
  };
  const auto resin = [&](const char* name) { return named(kResin, "name = \"r-1\"", name); };
  EXPECT_THAT(refusal([&] { load_resin("test-resin"); }),
              testing::AllOf(HasSubstr("no resin 'test-resin'"), HasSubstr("no-config")));
  // The user's folder ...
  write("config/slicecorr/test-resin.toml", resin("user"));
  set("XDG_CONFIG_HOME", folder_ / "config");
  EXPECT_EQ(load_resin("test-resin").name, "user");
  // ... or the one below his home ...
  unsetenv("XDG_CONFIG_HOME");
  write("home/.config/slicecorr/resins/test-resin.toml", resin("home"));
  set("HOME", folder_ / "home");
  EXPECT_EQ(load_resin("test-resin").name, "home");
  // ... comes after $SLICECORR_DB.
  set("SLICECORR_DB", folder_ / "db");
  EXPECT_EQ(load_resin("test-resin").name, "home");
  write("db/resins/test-resin.toml", resin("below"));
  EXPECT_EQ(load_resin("test-resin").name, "below");
  write("db/test-resin.toml", resin("db"));
  EXPECT_EQ(load_resin("test-resin").name, "db");
  write("db/printers/test-printer.toml", kPrinter);
  EXPECT_EQ(load_printer("test-printer").name, "dlp-1");
  EXPECT_EQ(find_definition("test-printer", "printer"),
            (folder_ / "db/printers/test-printer.toml").string());
  // $SLICECORR_DB comes before what is shipped.
  write("db/egg-resin.toml", resin("mine"));
  EXPECT_EQ(load_resin("egg-resin").name, "mine");
  const std::string message = refusal([&] { load_printer("no-such"); });
  EXPECT_THAT(message, HasSubstr("no printer 'no-such'; looked for no-such.toml in "));
  EXPECT_THAT(message, HasSubstr((folder_ / "db").string()));
  EXPECT_THAT(message, HasSubstr((folder_ / "home").string()));
}

TEST_F(DefinitionFiles, NoNames) {
  set("SLICECORR_DB", folder_ / "db");
  write("outside.toml", kResin);
  write("db/below/inside.toml", kResin);
  for (const char* name : {"", "../outside", "below/inside", ".", "..", ".hidden", "/etc/passwd"}) {
    EXPECT_THAT(refusal([&] { load_resin(name); }), HasSubstr("is no resin name")) << name;
  }
}

std::string printer_with_csv(const std::string& csv) {
  return with(kPrinter, kCalibrationLine, "calibration = \"" + csv + "\"");
}

TEST_F(DefinitionFiles, CalibrationFromCsv) {
  const std::vector<CalibrationPoint> expected = {{0, 1}, {128, 31.5}, {255, 100}};
  const std::string file = write("printers/p.toml", printer_with_csv("curves/c.csv"));
  for (const char* text : {"0,1\n128,31.5\n255,100\n", "grey,mW/cm2\n0,1\n128,31.5\n255,100",
                           "# measured\n\n0, 1\n 128 , 3.15e1 \n\n# end\n255,\t100.0\n",
                           "level,intensity\r\n0,1\r\n128,31.5\r\n255,100\r\n"}) {
    write("printers/curves/c.csv", text);
    EXPECT_EQ(load_printer(file).calibration, expected) << text;
  }
  // The path is relative to the toml file, whatever the working folder is.
  EXPECT_EQ(load_printer((folder_ / "printers/../printers/p.toml").string()).calibration, expected);
  const std::string absolute =
      write("p2.toml", printer_with_csv((folder_ / "printers/curves/c.csv").string()));
  EXPECT_EQ(load_printer(absolute).calibration, expected);
}

TEST_F(DefinitionFiles, WrongCsv) {
  const std::string file = write("p.toml", printer_with_csv("c.csv"));
  const std::string csv = (folder_ / "c.csv").string();
  const auto complaint = [&](const char* text) {
    write("c.csv", text);
    return refusal([&] { load_printer(file); });
  };
  EXPECT_THAT(refusal([&] { load_printer(file); }),
              testing::AllOf(HasSubstr("line 10: blue.calibration"), HasSubstr(csv)));  // missing
  for (const char* text : {"0,1\n128\n255,9\n", "0,1\nx,3\n255,9\n", "0,1\n128,3,4\n255,9\n",
                           "0,1\n128;3\n255,9\n", "0,1\n128,\n255,9\n"}) {
    EXPECT_THAT(complaint(text), testing::AllOf(HasSubstr(csv + ": line 2: "),
                                                HasSubstr("expected 'grey level, mW/cm²'")))
        << text;
  }
  // The rules of the curve are those of calibrations in the file.
  const auto at = [&](const std::string& text) {
    return HasSubstr(file + ": line 10: blue.calibration: " + text);
  };
  EXPECT_THAT(complaint("0,5\n255,4\n"), at("point 2: the curve must not fall"));
  EXPECT_THAT(complaint("0,5\n9,6\n8,6\n255,7\n"), at("point 3: grey levels must rise"));
  EXPECT_THAT(complaint("0,5\n254,6\n"), at("goes from level 0 to 254"));
  EXPECT_THAT(complaint(""), at("expected at least two points"));
  EXPECT_THAT(complaint("only,words\n"), at("expected at least two points"));
}

TEST(FlowKeys, AreReadAtTheTopAndInTheirTables) {
  const std::string cure =
      "[cure]\nabsorbance_height_um = 550\nabsorbance_base = \"e\"\ngel_dose_mj_cm3 = 40\n";
  const Resin none = parse_resin(cure, "r.toml");
  EXPECT_EQ(none.viscosity_pa_s, 0);
  EXPECT_TRUE(std::isinf(none.inhibitor_life_s));
  for (const std::string& text : {"viscosity_pa_s = 0.3\ninhibitor_life_s = 0\n" + cure,
                                  cure + "viscosity_pa_s = 0.3\ninhibitor_life_s = 0\n"}) {
    const Resin r = parse_resin(text, "r.toml");
    EXPECT_EQ(r.viscosity_pa_s, 0.3);
    EXPECT_EQ(r.inhibitor_life_s, 0);
  }
  for (const char* wrong : {"viscosity_pa_s = 0", "viscosity_pa_s = inf", "viscosity_pa_s = nan",
                            "inhibitor_life_s = -1", "inhibitor_life_s = inf"}) {
    EXPECT_THROW(parse_resin(cure + wrong + "\n", "r.toml"), InputError) << wrong;
  }
  const std::string display =
      "[display]\nwidth_px = 8\nheight_px = 8\npixel_um = 50\n"
      "[blue]\ncalibration = [[0, 1], [255, 100]]\n";
  const std::string vat = "[vat]\nsuction_limit_pa = 20000\n";
  EXPECT_EQ(parse_printer(display, "p.toml").suction_limit_pa, 0);
  EXPECT_EQ(parse_printer(display + vat, "p.toml").suction_limit_pa, 20000);
  EXPECT_EQ(parse_printer("suction_limit_pa = 2e4\n" + display, "p.toml").suction_limit_pa, 20000);
  EXPECT_THROW(parse_printer("suction_limit_pa = 2e4\n" + display + vat, "p.toml"), InputError);
  for (const char* wrong : {"0", "-5", "nan", "101326"}) {
    EXPECT_THROW(
        parse_printer(std::string("suction_limit_pa = ") + wrong + "\n" + display, "p.toml"),
        InputError)
        << wrong;
  }
}

TEST_F(DefinitionFiles, LightThatIsToBeMeasuredIsRefusedWhereItIsNeeded) {
  const std::string text = with(kPrinter, "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]",
                                "calibration = \"to be measured\"");
  const std::string file = write("dark.toml", text);
  const Printer display = load_display(file);
  EXPECT_FALSE(light_is_measured(display));
  EXPECT_TRUE(display.calibration.empty());
  const Printer whole = parse_printer(kPrinter, "dark.toml");
  EXPECT_TRUE(light_is_measured(whole));
  EXPECT_EQ(parse_display(kPrinter, "dark.toml"), whole);
  Printer same = display;
  same.calibration = whole.calibration;
  EXPECT_EQ(same, whole);
  for (const auto& load : {std::function([&] { load_printer(file); }),
                           std::function([&] { parse_printer(text, file); }),
                           std::function([&] { complete_printer(text, file); })}) {
    EXPECT_THAT(
        refusal(load),
        testing::AllOf(testing::StartsWith(file), testing::HasSubstr("line "),
                       testing::HasSubstr("blue.calibration: is to be measured"),
                       testing::HasSubstr("printer 'dlp-1'"), testing::HasSubstr("power meter"),
                       testing::HasSubstr("255"), testing::HasSubstr("testpart levels"),
                       testing::HasSubstr("resinctl import")));
  }
  // Nothing else stands for it, and nothing else is forgiven.
  for (const char* other : {"\"To be measured\"", "\"\"", "\"unknown\"", "[]", "0"}) {
    const std::string wrong = with(kPrinter, "calibration = [[0, 1.0], [128, 31.0], [255, 100.0]]",
                                   std::string("calibration = ") + other);
    EXPECT_THROW(parse_display(wrong, "p.toml"), InputError) << other;
  }
  EXPECT_THROW(parse_display(with(text, "width_px = 1280", "width_pixels = 1280"), "p.toml"),
               InputError);
}

TEST_F(DefinitionFiles, ShippedOnesParseAndAreFoundByName) {
  int printers = 0, resins = 0;
  for (const auto& entry : fs::directory_iterator(SLICECORR_PRINTERS_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    ++printers;
    const std::string name = entry.path().stem().string();
    const Printer p = load_display(entry.path().string());
    EXPECT_EQ(p.name, name);
    set("SLICECORR_DB", SLICECORR_PRINTERS_DIR);
    EXPECT_EQ(load_display(name), p);
    unsetenv("SLICECORR_DB");
    EXPECT_EQ(load_display(name), p);  // the source's own database, found from the build folder
    if (light_is_measured(p)) {
      EXPECT_EQ(load_printer(name), p);
    } else {
      EXPECT_THAT(refusal([&] { load_printer(name); }), testing::HasSubstr("to be measured"));
    }
  }
  for (const auto& entry : fs::directory_iterator(SLICECORR_DB_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    ++resins;
    const std::string name = entry.path().stem().string();
    const Resin r = load_resin(entry.path().string());
    EXPECT_EQ(r.name, name);
    EXPECT_GT(r.absorbance_height10_um, 0);
    EXPECT_TRUE(r.has_gel_time() ? r.gel_a_mj_cm2 > 0 && r.gel_b_sqrt_mw_cm2_s > 0
                                 : r.critical_dose_mj_cm3 + r.critical_dose_prime > 0)
        << name;
    EXPECT_EQ(load_resin(name), r);
  }
  EXPECT_GE(printers, 1);
  EXPECT_GE(resins, 1);
}

}  // namespace
}  // namespace slicecorr
