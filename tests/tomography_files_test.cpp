// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Printer and resin files of tomographic printing: what they say, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>

#include "refusal.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr {
namespace {

using test::refusal;
using testing::HasSubstr;

const std::string kDisplay =
    "[display]\nwidth_px = 1024\nheight_px = 768\npixel_um = 54.0\n"
    "[blue]\ncalibration = [[0, 0.0], [255, 10.0]]\n";
const std::string kVial =
    "[vial]\nouter_mm = 12.5\ninner_mm = 11.8\nn_outside = 1.0\nn_wall = 1.48\n";
const std::string kOptics = "[optics]\nkind = \"pinhole\"\ndistance_mm = 99.5\n";
const std::string kRotation = "[rotation]\ndeg_s = 25\ndirection = \"clockwise\"\n";

TEST(TomographicPrinterFile, EveryKey) {
  const Printer p = parse_printer(
      kDisplay + kVial + kOptics +
          "half_angle_deg = 6.0887\nrays_per_pixel = 13\naxis_right_px = -3.5\naxis_up_px = 120\n" +
          kRotation + "max_fps = 60\n",
      "p.toml");
  EXPECT_EQ(p.vial, (Vial{12.5, 11.8, 1.0, 1.48}));
  EXPECT_EQ(p.optics, (Optics{OpticsKind::pinhole, 99.5, 6.0887, 13, -3.5, 120}));
  EXPECT_EQ(p.rotation, (Rotation{25, TurnDirection::clockwise, 60}));
  EXPECT_EQ(p.max_speed_mm_h, 0);  // it needs no stage
  EXPECT_NO_THROW(require_tomographic(p));
}

/// A printer that names this table of wobble.
class WobbleFile : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  Printer with(const std::string& table) const {
    std::ofstream(folder_ / "wobble.csv") << table;
    return parse_printer(
        kDisplay + kVial + kOptics + "tilt_deg = -0.4\n" + kRotation + "wobble = \"wobble.csv\"\n",
        (folder_ / "p.toml").string());
  }
  std::filesystem::path folder_ = std::filesystem::path(testing::TempDir()) /
                                  ("slicecorr-wobble-" + std::to_string(::getpid()));
};

TEST_F(WobbleFile, IsReadBesideThePrinter) {
  const Printer p = with("angle_deg,right_px,up_px\n0,0.5,-1\n# a remark\n120,-0.25,2\n");
  EXPECT_EQ(p.optics->tilt_deg, -0.4);
  EXPECT_EQ(p.rotation->wobble, (std::vector<AxisWobble>{{0, 0.5, -1}, {120, -0.25, 2}}));
  EXPECT_EQ(with("10,0.5\n").rotation->wobble, (std::vector<AxisWobble>{{10, 0.5, 0}}));
}

TEST_F(WobbleFile, WhatItCanNotBeIsRefusedByLine) {
  const auto says = [&](const std::string& table) { return refusal([&] { with(table); }); };
  EXPECT_THAT(says("0,0\n90,x\n"), testing::AllOf(HasSubstr("wobble.csv"), HasSubstr("line 2"),
                                                  HasSubstr("expected angle_deg,right_px")));
  EXPECT_THAT(says("0,0\n360,1\n"), HasSubstr("is 360; expected angles that rise"));
  EXPECT_THAT(says("90,0\n90,1\n"), HasSubstr("line 2"));
  EXPECT_THAT(says("-1,0\n"), HasSubstr("from 0 to below 360"));
  EXPECT_THAT(says("0,20000\n"), HasSubstr("at most 10000"));
  EXPECT_THAT(says("0,1,2,3\n"), HasSubstr("line 1"));
  EXPECT_THAT(says("angle_deg,right_px\n"), HasSubstr("has no rows"));
  EXPECT_THAT(refusal([&] {
                parse_printer(kDisplay + kVial + kOptics + kRotation + "wobble = \"none.csv\"\n",
                              (folder_ / "p.toml").string());
              }),
              testing::AllOf(HasSubstr("rotation.wobble"), HasSubstr("none.csv")));
  EXPECT_THAT(refusal([&] {
                parse_printer(kDisplay + kVial + kOptics + kRotation + "wobble = 3\n", "p.toml");
              }),
              HasSubstr("expected the name of a .csv file"));
}

TEST(TomographicPrinterFile, WhatMayBeLeftOut) {
  const Printer p = parse_printer(kDisplay + "[vial]\nouter_mm = 4\ninner_mm = 3.3\n" +
                                      "[optics]\nkind = \"telecentric\"\n" +
                                      "[rotation]\ndeg_s = 3\ndirection = \"counterclockwise\"\n",
                                  "p.toml");
  EXPECT_EQ(p.vial, (Vial{4, 3.3, 1.0, 1.48}));
  EXPECT_EQ(p.optics, (Optics{OpticsKind::telecentric, 0, 0, 1, 0, 0}));
  EXPECT_EQ(p.rotation, (Rotation{3, TurnDirection::counterclockwise, 0}));
  EXPECT_FALSE(parse_printer(kDisplay, "p.toml").vial);
}

TEST(TomographicPrinterFile, WhatIsMissingIsNamed) {
  const auto says = [](const std::string& text) {
    return refusal([&] { require_tomographic(parse_printer(text, "p.toml")); });
  };
  EXPECT_THAT(says(kDisplay + kOptics + kRotation),
              HasSubstr("p: vial: the printer has no [vial]"));
  EXPECT_THAT(says(kDisplay + kVial + kRotation),
              HasSubstr("p: optics: the printer has no [optics]"));
  EXPECT_THAT(says(kDisplay + kVial + kOptics),
              HasSubstr("p: rotation: the printer has no [rotation]"));
}

struct Wrong {
  const char *name, *from, *to, *key, *expected;
};
class TomographicPrinterRefusal : public testing::TestWithParam<Wrong> {};
TEST_P(TomographicPrinterRefusal, NamesFileKeyAndWhatWasExpected) {
  const Wrong& w = GetParam();
  std::string text = kDisplay + kVial + kOptics + kRotation + "max_fps = 60\n";
  const std::string from = w.from;
  const std::size_t at = text.find("\n" + from + "\n");
  ASSERT_NE(at, std::string::npos);
  text.replace(at + 1, from.size(), w.to);
  const std::string said = refusal([&] { parse_printer(text, "p.toml"); });
  EXPECT_THAT(said, testing::StartsWith("p.toml: line "));
  EXPECT_THAT(said, HasSubstr(std::string(": ") + w.key + ": "));
  EXPECT_THAT(said, HasSubstr(w.expected));
}
INSTANTIATE_TEST_SUITE_P(
    Keys, TomographicPrinterRefusal,
    testing::Values(
        Wrong{"InnerZero", "inner_mm = 11.8", "inner_mm = 0", "vial.inner_mm", "above 0"},
        Wrong{"InnerNegative", "inner_mm = 11.8", "inner_mm = -1.0", "vial.inner_mm", "above 0"},
        Wrong{"InnerNan", "inner_mm = 11.8", "inner_mm = nan", "vial.inner_mm",
              "expected a number"},
        Wrong{"InnerAsOuter", "inner_mm = 11.8", "inner_mm = 12.5", "vial.inner_mm",
              "is 12.5; expected less than outer_mm, 12.5"},
        Wrong{"JacketAlone", "inner_mm = 11.8", "inner_mm = 11.8\njacket_outer_mm = 15",
              "vial.jacket_inner_mm", "around the first"},
        Wrong{"JacketInVial", "inner_mm = 11.8",
              "inner_mm = 11.8\njacket_outer_mm = 15\njacket_inner_mm = 12", "vial.jacket_inner_mm",
              "expected outer_mm, 12.5, or more"},
        Wrong{"JacketTurned", "inner_mm = 11.8",
              "inner_mm = 11.8\njacket_outer_mm = 14\njacket_inner_mm = 15", "vial.jacket_outer_mm",
              "more than jacket_inner_mm"},
        Wrong{"BetweenWithoutWall", "inner_mm = 11.8", "inner_mm = 11.8\nn_between = 1.3",
              "vial.n_between", "of a second wall"},
        Wrong{"InnerMissing", "inner_mm = 11.8", "", "vial.inner_mm", "missing"},
        Wrong{"OuterMissing", "outer_mm = 12.5", "", "vial.outer_mm", "missing"},
        Wrong{"OuterText", "outer_mm = 12.5", "outer_mm = \"1\"", "vial.outer_mm",
              "expected a number"},
        Wrong{"OutsideBelow", "n_outside = 1.0", "n_outside = 0.99", "vial.n_outside",
              "is 0.99; expected a number of at least 1 and at most 3"},
        Wrong{"WallAbove", "n_wall = 1.48", "n_wall = 3.1", "vial.n_wall", "at most 3"},
        Wrong{"WallNan", "n_wall = 1.48", "n_wall = nan", "vial.n_wall", "at most 3"},
        Wrong{"KindOther", "kind = \"pinhole\"", "kind = \"laser\"", "optics.kind",
              "is 'laser'; expected \"telecentric\" or \"pinhole\""},
        Wrong{"KindMissing", "kind = \"pinhole\"", "", "optics.kind", "missing; expected"},
        Wrong{"DistanceMissing", "distance_mm = 99.5", "", "optics.distance_mm", "missing"},
        Wrong{"DistanceInVial", "distance_mm = 99.5", "distance_mm = 12.5", "optics.distance_mm",
              "is 12.5; expected more than the vial's outer radius, 12.5 mm"},
        Wrong{"DistanceInf", "distance_mm = 99.5", "distance_mm = inf", "optics.distance_mm",
              "at most 1e+06"},
        Wrong{"AngleNegative", "distance_mm = 99.5", "distance_mm = 99.5\nhalf_angle_deg = -1",
              "optics.half_angle_deg", "of at least 0 and at most 45"},
        Wrong{"NoRays", "distance_mm = 99.5", "distance_mm = 99.5\nrays_per_pixel = 0",
              "optics.rays_per_pixel", "is 0; expected 1 to 1000"},
        Wrong{"AxisBeside", "distance_mm = 99.5", "distance_mm = 99.5\naxis_right_px = 513",
              "optics.axis_right_px", "at most 512"},
        Wrong{"TiltTooLarge", "distance_mm = 99.5", "distance_mm = 99.5\ntilt_deg = 46",
              "optics.tilt_deg", "of at least -45 and at most 45"},
        Wrong{"SpeedZero", "deg_s = 25", "deg_s = 0", "rotation.deg_s", "above 0"},
        Wrong{"SpeedMissing", "deg_s = 25", "", "rotation.deg_s", "missing"},
        Wrong{
            "DirectionMissing", "direction = \"clockwise\"", "", "rotation.direction",
            "missing; expected \"clockwise\" or \"counterclockwise\", as the vial turns seen from "
            "above"},
        Wrong{"DirectionOther", "direction = \"clockwise\"", "direction = \"left\"",
              "rotation.direction", "is 'left'; expected"},
        Wrong{"FramesZero", "max_fps = 60", "max_fps = 0", "rotation.max_fps", "above 0"}),
    [](const auto& info) { return info.param.name; });

std::string resin_text(const std::string& cure, const std::string& top = "") {
  return "name = \"r\"\n" + top + "[cure]\n" + cure;
}
const std::string kHeight = "absorbance_height_um = 12500\nabsorbance_base = \"e\"\n";

TEST(TomographicResinFile, AbsorptionAloneGivesTheHeight) {
  const Resin r =
      parse_resin(resin_text("absorption_per_cm = 0.8\ngel_dose_mj_cm2 = 25\n"), "r.toml");
  EXPECT_NEAR(r.absorbance_height10_um, 12500 * std::log(10.0), 1e-9);
  EXPECT_NEAR(absorption_per_cm(r), .8, 1e-15);
  EXPECT_NEAR(absorption_per_mm(r), .08, 1e-16);
  EXPECT_EQ(r.active_absorption_per_cm, 0);
  EXPECT_EQ(curing_absorption_per_mm(r), absorption_per_mm(r));
  // Dc = alpha_a E_c.
  EXPECT_NEAR(r.gel_dose_mj_cm3, 20, 1e-12);
  EXPECT_NEAR(dose_to_gel_mj_cm3(r), 20, 1e-12);
  EXPECT_EQ(r.n, 0);
}

TEST(TomographicResinFile, HeightAloneGivesTheAbsorption) {
  // alpha = 1e4 / h_e = ln 10 1e4 / h_10.
  EXPECT_NEAR(absorption_per_cm(parse_resin(resin_text(kHeight + "gel_dose_mj_cm3 = 20\n"), "r")),
              .8, 1e-15);
  EXPECT_NEAR(
      absorption_per_cm(parse_resin(resin_text("absorbance_height_um = 2000\nabsorbance_base = 10\n"
                                               "critical_dose_mj_cm3 = 5\n"),
                                    "r")),
      std::log(10.0) * 5, 1e-13);
}

TEST(TomographicResinFile, KeysStandInCureOrAtTheTop) {
  const std::string keys =
      "absorption_per_cm = 0.8\nactive_absorption_per_cm = 0.4\nn = 1.49969\n"
      "inhibition_dose_mj_cm3 = 3.5\ninhibition_resupply_mj_cm3_s = 0.02\n"
      "dose_diffusion_m2_s = 5e-12\n";
  const std::string dose = "gel_dose_mj_cm3 = 20\n";
  const Resin cure = parse_resin(resin_text(keys + dose), "r.toml");
  const Resin top = parse_resin(resin_text(dose, keys), "r.toml");
  EXPECT_EQ(cure, top);
  EXPECT_EQ(cure.active_absorption_per_cm, .4);
  EXPECT_EQ(cure.n, 1.49969);
  EXPECT_EQ(index_of(cure), 1.49969);
  EXPECT_EQ(cure.inhibition_dose_mj_cm3, 3.5);
  EXPECT_EQ(cure.inhibition_resupply_mj_cm3_s, .02);
  EXPECT_EQ(cure.dose_diffusion_m2_s, 5e-12);
  // sqrt(2 D t): sqrt(2 * 5e-6 mm²/s * 1000 s).
  EXPECT_DOUBLE_EQ(dose_spread_mm(cure, 1000), .1);
  EXPECT_DOUBLE_EQ(dose_to_gel_mj_cm3(cure), 23.5);
  EXPECT_THAT(refusal([&] { parse_resin(resin_text(dose + keys, "n = 1.5\n"), "r.toml"); }),
              HasSubstr("cure.n: is given here and at the top of the file; expected one of them"));
}

TEST(TomographicResinFile, OnlyWhatCuresCountsForDoses) {
  const auto resin = [](const std::string& active) {
    return parse_resin(resin_text(kHeight + active + "gel_dose_mj_cm2 = 25\ndose_factor = 2\n"),
                       "r");
  };
  const Resin all = resin(""), half = resin("active_absorption_per_cm = 0.4\n");
  EXPECT_NEAR(half.gel_dose_mj_cm3, .4 * 25, 1e-12);
  EXPECT_NEAR(half.critical_dose_mj_cm3, 2 * .4 * 25, 1e-12);
  EXPECT_NEAR(dose_to_gel_mj_cm3(half), 10, 1e-12);
  // Areal doses know nothing of it: at the window both cure alike.
  EXPECT_NEAR(units::areal_from_volumetric(half.gel_dose_mj_cm3, dose_height_e_um(half)), 25,
              1e-12);
  EXPECT_NEAR(units::areal_from_volumetric(all.gel_dose_mj_cm3, dose_height_e_um(all)), 25, 1e-12);
  EXPECT_NEAR(make_kinetics(half, false, false).critical_dose_prime, 25, 1e-12);
  EXPECT_NEAR(make_kinetics(half, false, true).critical_dose_prime, 50, 1e-12);
  const Printer dlp =
      load_printer(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
  Process process;
  process.speed_mm_h = 800;
  const double critical = make_cure_model(dlp, all, process, 50).critical_intensity_mw_cm2;
  EXPECT_NEAR(make_cure_model(dlp, half, process, 50).critical_intensity_mw_cm2, critical,
              1e-12 * critical);
  // As much as absorbs in all is nothing special.
  EXPECT_EQ(resin("active_absorption_per_cm = 0.8\n"), all);
}

TEST(TomographicResinFile, Rounding) {
  const auto beside = [](const std::string& absorption) {
    return parse_resin(
        resin_text(kHeight + "absorption_per_cm = " + absorption + "\ngel_dose_mj_cm3 = 20\n"),
        "r.toml");
  };
  // The height counts.
  EXPECT_NEAR(absorption_per_cm(beside("0.803")), .8, 1e-15);
  EXPECT_NEAR(absorption_per_cm(beside("0.797")), .8, 1e-15);
  for (const char* far : {"0.81", "0.79", "1.84"}) {
    EXPECT_THAT(refusal([&] { beside(far); }),
                HasSubstr("the absorbance height of 12500 um in base e is 0.8 per cm; expected the "
                          "same, or one of them"));
  }
}

TEST(TomographicResinFile, Refused) {
  const auto says = [](const std::string& keys) {
    return refusal([&] { parse_resin(resin_text(keys + "gel_dose_mj_cm3 = 20\n"), "r.toml"); });
  };
  EXPECT_THAT(
      says("absorption_per_cm = -0.1\n"),
      HasSubstr("r.toml: line 3: cure.absorption_per_cm: is -0.1; expected a number above 0"));
  EXPECT_THAT(says("absorption_per_cm = 0\n"), HasSubstr("above 0"));
  EXPECT_THAT(says("absorption_per_cm = nan\n"), HasSubstr("above 0"));
  EXPECT_THAT(says(""), HasSubstr("cure.absorbance_height_um: missing; expected a number, or "
                                  "absorption_per_cm"));
  EXPECT_THAT(
      says(kHeight + "active_absorption_per_cm = 0.81\n"),
      HasSubstr("cure.active_absorption_per_cm: is 0.81; expected at most the 0.8 per cm that "
                "absorb in all"));
  EXPECT_THAT(says(kHeight + "active_absorption_per_cm = -1\n"), HasSubstr("above 0"));
  EXPECT_THAT(says(kHeight + "n = 0.9\n"),
              HasSubstr("cure.n: is 0.9; expected a number of at least 1"));
  EXPECT_THAT(says(kHeight + "n = 3.01\n"), HasSubstr("at most 3"));
  EXPECT_THAT(says(kHeight + "n = nan\n"), HasSubstr("cure.n: is nan"));
  EXPECT_THAT(says(kHeight + "inhibition_dose_mj_cm3 = -1\n"),
              HasSubstr("cure.inhibition_dose_mj_cm3: is -1; expected a number of at least 0"));
  EXPECT_THAT(says(kHeight + "inhibition_resupply_mj_cm3_s = inf\n"),
              HasSubstr("cure.inhibition_resupply_mj_cm3_s: is inf"));
  for (const char* wrong : {"-1e-12", "nan", "inf", "2e-6"}) {
    EXPECT_THAT(says(kHeight + "dose_diffusion_m2_s = " + wrong + "\n"),
                HasSubstr("expected a number of at least 0 and at most 1e-06"));
  }
  EXPECT_THAT(says(kHeight + "dose_diffusion_m2_s = \"slow\"\n"),
              HasSubstr("cure.dose_diffusion_m2_s: expected a number"));
  // A resin of which nobody says it.
  EXPECT_THAT(refusal([] {
                index_of(parse_resin(resin_text(kHeight + "gel_dose_mj_cm3 = 20\n"), "r.toml"));
              }),
              HasSubstr("r: n: the resin file does not say its refractive index"));
  EXPECT_THAT(refusal([] {
                dose_to_gel_mj_cm3(parse_resin(
                    resin_text(kHeight + "model = \"kinetic\"\nm = 0.9\ncritical_dose_prime = 5\n"),
                    "r.toml"));
              }),
              HasSubstr("is 0.9; expected a resin with m = 1"));
}

TEST(TomographicResinFile, AnotherHeightKeepsWhatCures) {
  const Resin r = parse_resin(
      resin_text(kHeight + "active_absorption_per_cm = 0.4\ngel_dose_mj_cm3 = 20\n"), "r.toml");
  const double half10 = 6250 * std::log(10.0);
  const Resin darker = with_overrides(r, {.dc_mj_cm3 = {}, .ha_um = half10, .dose_factor = {}});
  EXPECT_NEAR(absorption_per_cm(darker), 1.6, 1e-12);
  EXPECT_EQ(curing_absorption_per_cm(darker), .4);
  EXPECT_THAT(refusal([&] {
                with_overrides(r, {.dc_mj_cm3 = {}, .ha_um = 10 * half10, .dose_factor = {}});
              }),
              HasSubstr("expected at most 57564.6 um"));
}

TEST(TomographicFiles, WhatIsShippedFitsTogether) {
  for (const auto& [printer_name, resin_name] :
       {std::pair{"kelly-projector-and-vial", "kelly-bpagda-pegda"},
        {"webber-vial", "webber-dudma-pegda"},
        {"model-tomography-bench", "model-tomography-resin"}}) {
    const Printer printer =
        load_printer(std::string(SLICECORR_PRINTERS_DIR) + "/" + printer_name + ".toml");
    const Resin resin = load_resin(std::string(SLICECORR_DB_DIR) + "/" + resin_name + ".toml");
    require_tomographic(printer);
    EXPECT_GT(index_of(resin), 1) << resin_name;
    EXPECT_GT(dose_to_gel_mj_cm3(resin), 0) << resin_name;
    EXPECT_GE(most_frames_per_turn(*printer.rotation), 360) << printer_name;
    // The image covers the reach.
    EXPECT_NEAR(reach_mm(printer, index_of(resin)),
                printer.vial->n_outside == 1 ? 12.5 / 1.49969 : printer.vial->inner_mm, 1e-12);
  }
  const Printer dry = load_printer(std::string(SLICECORR_PRINTERS_DIR) + "/webber-vial.toml");
  EXPECT_EQ(*dry.vial, (Vial{12.5, 11.8, 1.0, 1.48}));
  EXPECT_NEAR(height_on_axis(dry, 1.49969), .958204, 5.1e-7);
  // On the bench light is down to 1/e on the axis.
  const Resin model = load_resin(std::string(SLICECORR_DB_DIR) + "/model-tomography-resin.toml");
  const Printer bench =
      load_printer(std::string(SLICECORR_PRINTERS_DIR) + "/model-tomography-bench.toml");
  EXPECT_NEAR(absorption_per_mm(model) * bench.vial->inner_mm, 1, 1e-12);
  // All light of a turn there: alpha_a I T e^(-alpha R).
  EXPECT_NEAR(curing_absorption_per_cm(model) * bench.calibration.back().intensity_mw_cm2 *
                  bench.rotation->turn_s() * std::exp(-1.0),
              8.4759, 5.1e-5);
}

}  // namespace
}  // namespace slicecorr
