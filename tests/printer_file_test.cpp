// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What printer files say: display, lamps, stage; what is refused, with its line and key.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "definition_texts.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {
namespace {

using namespace test;
using testing::HasSubstr;

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
        // toml++ asserts that names begin otherwise.
        Wrong{"ControlCharacter", "[display]", "[\020display]", "line 3: ", "is not TOML"},
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

}  // namespace
}  // namespace slicecorr
