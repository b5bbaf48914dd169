// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Lamps as they are: grey by pulses, and lamps that fade while they print.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "memory_slices.hpp"
#include "meshes.hpp"
#include "programs/common/setup_options.hpp"
#include "run_program.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/volume.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

Printer lamp(GreyLight grey, double black) {
  Printer p;
  p.name = "p";
  p.width_px = p.height_px = 16;
  p.pixel_x_um = p.pixel_y_um = 50;
  p.calibration = {{0, black}, {255, 100}};
  p.grey = grey;
  return p;
}

Resin resin_of(double m) {
  Resin r;
  r.name = "r";
  r.model = CureModelKind::kinetic;
  r.m = m;
  r.absorbance_height10_um = 2000;
  r.critical_dose_prime = 20;
  return r;
}

TEST(PulsedGrey, DoesWhatItsShareOfFullLightDoes) {
  for (const double m : {0.5, 0.7, 1.0, 1.3}) {
    for (const double black : {0.0, 2.0}) {
      const Printer p = for_resin(lamp(GreyLight::pulsed, black), resin_of(m));
      const std::vector<double> of_level = level_intensities(p);
      const double off = std::pow(black, m), full = std::pow(100, m);
      for (int level = 0; level < 256; level += 15) {
        const double share = level / 255.0;
        EXPECT_NEAR(std::pow(of_level[static_cast<std::size_t>(level)], m),
                    (1 - share) * off + share * full, 1e-12 * full)
            << m << " " << level;
      }
    }
  }
  // At half grey and m 0.7 steady light does 23 % more: 0.5^0.7 of full light's, not 0.5.
  const Printer pulsed = for_resin(lamp(GreyLight::pulsed, 0), resin_of(0.7));
  const double half = level_intensities(pulsed)[128], mean = 100 * 128.0 / 255;
  EXPECT_NEAR(std::pow(mean / half, 0.7), 1.23, 0.005);
  // The model of a print knows it without being told.
  Process process;
  process.speed_mm_h = 300;
  const CureModel model =
      make_cure_model(lamp(GreyLight::pulsed, 0), resin_of(0.7), process, 50, {});
  EXPECT_NEAR(model.level_phi[51] / model.level_phi[255], 0.2, 1e-12);
  // Where dose is light times time it is all the same.
  EXPECT_EQ(level_intensities(for_resin(lamp(GreyLight::pulsed, 2), resin_of(1))),
            level_intensities(lamp(GreyLight::steady, 2)));
}

TEST(PulsedGrey, IsRefusedWhereItIsNotCounted) {
  Process uv;
  uv.speed_mm_h = 300;
  uv.uv.kind = UvKind::constant;
  uv.uv.uv_mw_cm2 = 100;
  const auto refusal = [](const Printer& p, const Resin& r, const Process& process) -> std::string {
    try {
      check_supported(p, r, process);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  const Printer pulsed = lamp(GreyLight::pulsed, 0);
  EXPECT_EQ(refusal(pulsed, resin_of(1), uv), "");
  EXPECT_EQ(refusal(lamp(GreyLight::steady, 0), resin_of(0.7), uv), "");
  Process plain;
  plain.speed_mm_h = 300;
  EXPECT_EQ(refusal(pulsed, resin_of(0.7), plain), "");
  Printer spreads = pulsed;
  spreads.spread.gaussians = {{20, 1}};
  EXPECT_THAT(refusal(spreads, resin_of(0.7), plain), HasSubstr("pulses of pixels"));
  EXPECT_EQ(refusal(spreads, resin_of(1), plain), "");
  Resin gel_time = resin_of(1);
  gel_time.model = CureModelKind::gel_time;
  gel_time.gel_a_mj_cm2 = gel_time.gel_b_sqrt_mw_cm2_s = 1;
  EXPECT_EQ(refusal(pulsed, gel_time, plain), "");
}

TEST(PulsedGrey, OfATimeToGelRootsCountInTheirShares) {
  // One exposure of 5 s: A takes light times time, B roots of light times time, 1 / Omega = 1 / X + 1 / Y.
  Resin r = resin_of(1);
  r.model = CureModelKind::gel_time;
  r.gel_a_mj_cm2 = 60;
  r.gel_b_sqrt_mw_cm2_s = 6;
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 5;
  for (const GreyLight grey : {GreyLight::steady, GreyLight::pulsed}) {
    Printer printer = lamp(grey, 0);
    printer.calibration.front().intensity_mw_cm2 = 1;
    const double full = printer.calibration.back().intensity_mw_cm2;
    const CureModel model = make_cure_model(printer, r, p, 50);
    const int top = printer.levels() - 1;
    for (const int level : {0, top / 4, top / 2, top}) {
      const double share = static_cast<double>(level) / top, mean = 1 + share * (full - 1);
      const double root =
          grey == GreyLight::steady ? std::sqrt(mean) : 1 - share + share * std::sqrt(full);
      const double x = mean * 5 / 60, y = root * 5 / 6, dose = x * y / (x + y);
      EXPECT_NEAR(model.level_phi[static_cast<std::size_t>(level)], dose, 1e-9 * dose);
      const ColumnDose column =
          column_dose(model, {static_cast<std::uint8_t>(pixel_of_level(level, printer.levels()))});
      EXPECT_NEAR(column.lower[0], dose, 1e-9 * dose);
    }
  }
}

TEST(LampThatFades, OfATimeToGelRootsAreThoseOfTheLightThatIsLeft) {
  Resin r = resin_of(1);
  r.model = CureModelKind::gel_time;
  r.gel_a_mj_cm2 = 60;
  r.gel_b_sqrt_mw_cm2_s = 6;
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 5;
  p.lamp_share = {1, 0.8, 0.5};
  const CureModel model = make_cure_model(lamp(GreyLight::steady, 1), r, p, 50);
  const ColumnDose column = column_dose(model, {0, 0, 255});
  // The last slice is alone at its window, and counts with half of the light.
  const double x = 50 * 5 / 60.0, y = std::sqrt(50.0) * 5 / 6, dose = x * y / (x + y);
  EXPECT_NEAR(column.lower[2], dose, 1e-9 * dose);
  // Continuous it is a dimmer lamp from there on.
  p.mode = ExposureMode::continuous;
  p.speed_mm_h = 400;
  p.lamp_share = {1, 0.5};
  const CureModel fades = make_cure_model(lamp(GreyLight::steady, 1), r, p, 50);
  p.lamp_share.clear();
  const CureModel dim = make_cure_model(dimmed(lamp(GreyLight::steady, 1), 0.5), r, p, 50);
  const std::vector<std::uint8_t> pixels(40, 200);
  EXPECT_NEAR(column_dose(fades, pixels).middle[1], column_dose(dim, pixels).middle[1], 1e-9);
  EXPECT_GT(column_dose(fades, pixels).middle[0], column_dose(dim, pixels).middle[0] * 1.01);
}

TEST(LampThatFades, IsOneWithTheShareOfLayers) {
  Process p;
  p.light_share = {1, 0.5};
  p.lamp_share = {0.9, 0.8, 0.6};
  const Process both = as_lamp_shines(p);
  ASSERT_EQ(both.light_share.size(), 3U);
  EXPECT_DOUBLE_EQ(both.light_share[0], 0.9);
  EXPECT_DOUBLE_EQ(both.light_share[1], 0.4);
  EXPECT_DOUBLE_EQ(both.light_share[2], 0.3);
  EXPECT_TRUE(both.lamp_share.empty());
  EXPECT_EQ(as_lamp_shines(both), both);
}

TEST(LampThatFades, CurvesInSecondsAreReadInTheMiddleOfSlices) {
  const TemporaryFolder folder;
  const std::string path = folder / "lamp.csv";
  const auto write = [&](const char* text) { std::ofstream(path) << text; };
  write("seconds,lamp_share\n0,1\n10,0.8\n");
  EXPECT_TRUE(cli::is_lamp_curve(path));
  const std::vector<double> shares = cli::read_lamp_curve(path, 2);
  ASSERT_GE(shares.size(), 5U);
  for (std::size_t n = 0; n < 5; ++n) {
    EXPECT_NEAR(shares[n], 1 - 0.02 * (2.0 * static_cast<double>(n) + 1), 1e-12);
  }
  EXPECT_EQ(shares.back(), 0.8);
  for (const char* bad :
       {"seconds,lamp_share\n", "seconds,lamp_share\n3,1\n2,1\n", "seconds,lamp_share\n0,0\n",
        "seconds,lamp_share\n0,x\n", "seconds,light\n0,1\n", "seconds,lamp_share\n0,1,2\n"}) {
    write(bad);
    EXPECT_THROW(cli::read_lamp_curve(path, 2), InputError) << bad;
  }
  write("seconds,lamp_share\n0,1\n");
  EXPECT_THROW(cli::read_lamp_curve(path, 0), InputError);
  write("slice,lamp_share\n0,1\n");
  EXPECT_FALSE(cli::is_lamp_curve(path));
}

class LampProgram : public ::testing::Test {
 protected:
  LampProgram() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", ""}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    std::ofstream(folder_ / "r.toml")
        << "name = \"r\"\n[cure]\nmodel = \"kinetic\"\nm = 0.7\nabsorbance_height_um = 800\n"
           "absorbance_base = 10\ncritical_dose_prime = 20\n";
    // Bars over each other with gaps between them.
    write_stl(folder_ / "bars.stl", box({0, 0, 0}, {1, 1, 0.4}) + box({0, 0, 0.8}, {1, 1, 1.3}) +
                                        box({0, 0, 1.9}, {1, 1, 2.2}));
    printer("steady.toml", "", 1);
  }
  /// `own_pulses`: the calibration is that of pulses of a resin of m = 0.7, in the test's own terms.
  void printer(const char* name, const char* grey, double share, bool own_pulses = false) const {
    std::ofstream file(folder_ / name);
    file << "name = \"p\"\n[display]\nwidth_px = 40\nheight_px = 40\npixel_um = 50\n[blue]\n"
         << grey << "calibration = [";
    for (int level = 0; level < 256; ++level) {
      const double mean = share * 100 * level / 255.0;
      const double light =
          own_pulses ? 100 * share * std::exp(std::log(level / 255.0 + 1e-300) / 0.7) : mean;
      file << (level ? ", [" : "[") << level << ", " << (level ? light : 0.0) << "]";
    }
    file << "]\n[stage]\nmax_speed_mm_h = 5000\n";
  }
  void correct(const char* printer_file, const char* out, const Command& more = {}) const {
    const RunResult r = run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "run", "bars.stl", "-o",
                                            out, "--printer", printer_file, "--resin", "r.toml",
                                            "--layer-um", "50", "--speed-mm-h", "300", "--quiet"} +
                                        more,
                                    options_);
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  MemorySlices slices(const char* stack) const {
    return MemorySlices(StackReader(folder_ / stack, folder_.path()));
  }
  /// How many pixels differ by more than a level, which rounding may.
  static int differ(const MemorySlices& a, const MemorySlices& b) {
    int count = 0;
    for (int n = 0; n < a.grid().layers; ++n) {
      for (int y = 0; y < a.grid().height_px; ++y) {
        for (int x = 0; x < a.grid().width_px; ++x) {
          count += std::abs(a.at(n, x, y) - b.at(n, x, y)) > 1 ? 1 : 0;
        }
      }
    }
    return count;
  }
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(LampProgram, PulsesAreTheLightThatDoesAsMuch) {
  printer("pulsed.toml", "grey = \"pulsed\"\n", 1);
  printer("own.toml", "", 1, true);
  correct("pulsed.toml", "pulsed.uvj");
  correct("own.toml", "own.uvj");
  correct("steady.toml", "steady.uvj");
  const MemorySlices pulsed = slices("pulsed.uvj");
  EXPECT_EQ(differ(pulsed, slices("own.uvj")), 0);
  EXPECT_GT(differ(pulsed, slices("steady.uvj")), 100);
  // The stack says so, and is judged by it.
  const StackInfo info = StackReader::read_info(folder_ / "pulsed.uvj");
  EXPECT_EQ(info.printer->grey, GreyLight::pulsed);
  printer("other.toml", "grey = \"flickering\"\n", 1);
  const RunResult r =
      run_program({SLICECORR_BIN_DIR "/slicecorr", "run", "bars.stl", "-o", "x.uvj", "--printer",
                   "other.toml", "--resin", "r.toml", "--layer-um", "50", "--speed-mm-h", "300"},
                  options_);
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("expected \"steady\" or \"pulsed\""));
}

TEST_F(LampProgram, AWeakLampIsAWeakCalibration) {
  std::ofstream(folder_ / "lamp.csv") << "slice,lamp_share\n0,0.8\n";
  printer("weak.toml", "", 0.8);
  correct("steady.toml", "logged.uvj", {"--lamp-log", "lamp.csv"});
  correct("weak.toml", "weak.uvj");
  EXPECT_EQ(differ(slices("logged.uvj"), slices("weak.uvj")), 0);
}

TEST_F(LampProgram, AFadingLampIsCountedSliceBySliceAndToldToNobody) {
  // 44 slices of 0.6 s: from all of the light to 0.7 of it.
  std::ofstream curve(folder_ / "curve.csv"), table(folder_ / "table.csv"),
      shares(folder_ / "shares.csv");
  curve << "seconds,lamp_share\n0,1\n26.4,0.7\n";
  table << "slice,lamp_share\n";
  shares << "slice,light_share\n";
  for (int n = 0; n < 44; ++n) {
    const double share = 1 - 0.3 * (n + 0.5) / 44;
    table << n << "," << share << "\n";
    shares << n << "," << share << "\n";
  }
  table << "44,0.7\n";
  shares << "44,0.7\n";
  curve.close();
  table.close();
  shares.close();
  correct("steady.toml", "curve.uvj", {"--lamp-log", "curve.csv"});
  correct("steady.toml", "table.uvj", {"--lamp-log", "table.csv"});
  correct("steady.toml", "shares.uvj", {"--light-share", "shares.csv"});
  correct("steady.toml", "even.uvj");
  const MemorySlices faded = slices("table.uvj");
  EXPECT_EQ(differ(faded, slices("shares.uvj")), 0);
  EXPECT_EQ(differ(faded, slices("curve.uvj")), 0);
  EXPECT_GT(differ(faded, slices("even.uvj")), 100);
  // The printer is not told to dim what fades by itself, and the stack keeps what it was made for.
  const StackInfo info = StackReader::read_info(folder_ / "table.uvj");
  EXPECT_TRUE(info.process->light_share.empty());
  ASSERT_EQ(info.process->lamp_share.size(), 45U);
  EXPECT_NEAR(info.process->lamp_share[43], 1 - 0.3 * 43.5 / 44, 1e-6);
  // Judged with its own lamp nothing is undercured.
  ASSERT_EQ(run_program({SLICECORR_BIN_DIR "/slicecorr", "slice", "bars.stl", "-o", "t.uvj",
                         "--printer", "steady.toml", "--layer-um", "50", "--quiet"},
                        options_)
                .exit_code,
            0);
  for (const char* stack : {"table.uvj", "even.uvj"}) {
    const RunResult r = run_program({SLICECORR_BIN_DIR "/slicecorr", "verify", stack, "--target",
                                     "t.uvj", "--lamp-log", "table.csv", "--json", "-", "--quiet"},
                                    options_);
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const json j = json::parse(r.out);
    if (std::string(stack) == "table.uvj") {
      EXPECT_EQ(j["undercure_voxels"], 0);
    } else {
      EXPECT_GT(j["undercure_voxels"], 100);
    }
  }
}

class UnevenUv : public ::testing::Test {
 protected:
  UnevenUv() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", ""}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    std::ofstream(folder_ / "r.toml")
        << "name = \"r\"\n[cure]\nmodel = \"kinetic\"\nm = 0.99\nabsorbance_height_um = 408\n"
           "absorbance_base = \"e\"\ncritical_dose_prime = 64\n[inhibition]\nbeta = 0.73\n"
           "absorbance_height_um = 37.8\nabsorbance_base = \"e\"\n";
    write_stl(folder_ / "bars.stl", box({0, 0, 0}, {2, 2, 0.5}) + box({0, 0, 1.1}, {2, 2, 1.8}));
    printer("even.toml", "");
  }
  void printer(const char* name, const std::string& field, const char* kind = "flood",
               const char* more = "") const {
    std::ofstream(folder_ / name)
        << "name = \"p\"\n[display]\nwidth_px = 60\nheight_px = 60\npixel_um = 50\n"
           "[blue]\ncalibration = [[0, 0.0], [255, 100.0]]\n"
        << more << "[uv]\nkind = \"" << kind << "\"\ncalibration = [[0, 0.0], [255, 275.0]]\n"
        << field << "[stage]\nmax_speed_mm_h = 5000\n";
  }
  RunResult correct(const char* printer_file, const char* out, const Command& uv) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "run", "bars.stl", "-o", out,
                               "--printer", printer_file, "--resin", "r.toml", "--layer-um", "50",
                               "--speed-mm-h", "300", "--quiet"} +
                           uv,
                       options_);
  }
  MemorySlices slices(const char* stack) const {
    return MemorySlices(StackReader(folder_ / stack, folder_.path()));
  }
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(UnevenUv, APlaceIsCorrectedForItsOwnLight) {
  // All of the light within 0.7 mm of the middle, 0.8 of it from there on.
  printer("uneven.toml", "flat_field = [[0, 1], [0.7, 1], [0.701, 0.8]]\n");
  ASSERT_EQ(correct("uneven.toml", "u.uvj", {"--uv-mw-cm2", "200"}).exit_code, 0);
  ASSERT_EQ(correct("even.toml", "e200.uvj", {"--uv-mw-cm2", "200"}).exit_code, 0);
  ASSERT_EQ(correct("even.toml", "e160.uvj", {"--uv-mw-cm2", "160"}).exit_code, 0);
  const MemorySlices uneven = slices("u.uvj"), strong = slices("e200.uvj"),
                     weak = slices("e160.uvj");
  int inner = 0, outer = 0, differ = 0;
  const int layers = std::min({uneven.grid().layers, strong.grid().layers, weak.grid().layers});
  for (int n = 0; n < layers; ++n) {
    for (int y = 0; y < 60; ++y) {
      for (int x = 0; x < 60; ++x) {
        const double r = std::hypot(x - 29.5, y - 29.5) * 0.05;
        differ += strong.at(n, x, y) != weak.at(n, x, y) ? 1 : 0;
        if (r < 0.65) inner += uneven.at(n, x, y) != strong.at(n, x, y) ? 1 : 0;
        if (r > 0.75) outer += uneven.at(n, x, y) != weak.at(n, x, y) ? 1 : 0;
      }
    }
  }
  EXPECT_GT(differ, 100);
  EXPECT_EQ(inner, 0);
  EXPECT_EQ(outer, 0);
  // What the stack carries is what it was corrected for.
  const StackInfo info = StackReader::read_info(folder_ / "u.uvj");
  ASSERT_TRUE(info.printer->uv_flat_field);
  EXPECT_EQ(info.printer->uv_flat_field->least(), 204);
  EXPECT_EQ(info.printer->uv_flat_field->greatest(), 255);
  ASSERT_EQ(run_program({SLICECORR_BIN_DIR "/slicecorr", "slice", "bars.stl", "-o", "t.uvj",
                         "--printer", "even.toml", "--layer-um", "50", "--quiet"},
                        options_)
                .exit_code,
            0);
  const RunResult r = run_program({SLICECORR_BIN_DIR "/slicecorr", "verify", "u.uvj", "--target",
                                   "t.uvj", "--json", "-", "--quiet"},
                                  options_);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json j = json::parse(r.out);
  EXPECT_EQ(j["undercure_voxels"], 0);
  EXPECT_LT(j["height_error_um"]["mean_abs"].get<double>(), 5);
  // Pages draw no columns by one kernel.
  const StackReader shown(folder_ / "u.uvj", folder_.path()),
      target(folder_ / "t.uvj", folder_.path());
  const slicecorr::Setup setup{*info.printer, *info.resin, *info.process, 0};
  EXPECT_TRUE(reduce_volume(shown, target, setup, 16).under_uv);
}

TEST_F(UnevenUv, TheWeakestPlaceKeepsTheDeadZone) {
  printer("uneven.toml", "flat_field = [[0, 1], [2, 0.8]]\n");
  const RunResult r = correct("uneven.toml", "u.uvj", {"--dead-zone-um", "8"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const StackInfo info = StackReader::read_info(folder_ / "u.uvj");
  // Iuv = Ib/beta e^(z (1/huv - 1/hb)), over the share at the corner of the display.
  const double even = 100 / 0.73 * std::exp(8 * (1 / 37.8 - 1 / 408.0));
  const double least = info.printer->uv_flat_field->least() / 255.0;
  EXPECT_LT(least, 0.82);
  EXPECT_NEAR(info.process->uv.uv_mw_cm2, even / least, 1e-6 * even);
  // With UV light by slice each keeps it, and none gets more than full light needs.
  const Command zone{"--dead-zone-um", "8", "--uv-schedule", "per-slice"};
  ASSERT_EQ(correct("uneven.toml", "s.uvj", zone).exit_code, 0);
  const std::vector<double> uv = StackReader::read_info(folder_ / "s.uvj").process->uv.slice_mw_cm2;
  const MemorySlices shown = slices("s.uvj");
  ASSERT_EQ(uv.size(), static_cast<std::size_t>(shown.grid().layers));
  for (int n = 0; n < shown.grid().layers; ++n) {
    const double slice_uv = uv[static_cast<std::size_t>(n)];
    EXPECT_LE(slice_uv * least, even * (1 + 1e-6)) << n;
    for (int i = 0; i < 3600; ++i) {
      // The picture of the lamp has steps of 1/255.
      const double of_lamp = 1 - 0.1 * std::hypot(i % 60 - 29.5, i / 60 - 29.5) * 0.05 + 0.5 / 255;
      ASSERT_GE(slice_uv * of_lamp, even * shown.at(n, i % 60, i / 60) / 255 * (1 - 1e-6)) << n;
    }
  }
  // A lamp that can't is told where.
  const RunResult weak = correct("uneven.toml", "w.uvj", {"--dead-zone-um", "20"});
  EXPECT_EQ(weak.exit_code, 3);
  EXPECT_THAT(weak.err, HasSubstr("of its light"));
}

TEST_F(UnevenUv, IsRefusedWhereItIsNotCounted) {
  const std::string field = "flat_field = [[0, 1], [2, 0.8]]\n";
  printer("uneven.toml", field);
  // A dead zone is as uneven as light of one intensity.
  std::ofstream(folder_ / "flows.toml") << "viscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n"
                                        << std::ifstream(folder_ / "r.toml").rdbuf();
  const RunResult zone = run_program(
      Command{SLICECORR_BIN_DIR "/slicecorr", "run", "bars.stl", "-o", "x.uvj", "--printer",
              "uneven.toml", "--resin", "flows.toml", "--layer-um", "50", "--speed-mm-h", "300",
              "--quiet", "--gap-um", "60", "--even-dead-zone", "constant"},
      options_);
  EXPECT_EQ(zone.exit_code, 2);
  EXPECT_THAT(zone.err, HasSubstr("uv.flat_field"));
  // In patterns and where light spreads it is counted.
  printer("patterned.toml", field, "patterned");
  EXPECT_EQ(correct("patterned.toml", "x.uvj", {"--dead-zone-um", "8"}).exit_code, 0);
  printer("spread.toml", field, "flood", "spread = [[30, 1]]\n");
  EXPECT_EQ(correct("spread.toml", "x.uvj", {"--uv-mw-cm2", "200", "--rounds", "1"}).exit_code, 0);
  // Without UV light it does not matter.
  EXPECT_EQ(correct("uneven.toml", "x.uvj", {}).exit_code, 0);
  for (const char* bad :
       {"flat_field = [[1, 1]]\n", "flat_field = [[0, 1], [0, 0.5]]\n", "flat_field = [[0, 0]]\n",
        "flat_field = [[0, 1.2]]\n", "flat_field = []\n", "flat_field = [[0, 1, 2]]\n",
        "flat_field = 3\n", "flat_field = [[0, 1]]\nflat_field_reference = 200\n"}) {
    printer("bad.toml", bad);
    const RunResult r = correct("bad.toml", "x.uvj", {"--uv-mw-cm2", "200"});
    EXPECT_EQ(r.exit_code, 2) << bad;
    EXPECT_THAT(r.err, HasSubstr("flat_field")) << bad;
  }
}

using FadingUv = UnevenUv;

TEST_F(FadingUv, AsMuchLightAsComesIsWhatIsAskedOfAWholeLamp) {
  std::ofstream(folder_ / "even.csv") << "slice,uv_lamp_share\n0,0.8\n";
  ASSERT_EQ(correct("even.toml", "faded.uvj", {"--uv-mw-cm2", "200", "--uv-lamp-log", "even.csv"})
                .exit_code,
            0);
  ASSERT_EQ(correct("even.toml", "weak.uvj", {"--uv-mw-cm2", "160"}).exit_code, 0);
  const MemorySlices faded = slices("faded.uvj"), weak = slices("weak.uvj");
  ASSERT_EQ(faded.grid().layers, weak.grid().layers);
  for (int n = 0; n < faded.grid().layers; ++n) {
    for (int x = 8; x < 52; ++x) ASSERT_EQ(faded.at(n, x, 30), weak.at(n, x, 30)) << n << " " << x;
  }
  // The lamp is asked for what was said, and the stack knows what comes.
  const StackInfo info = StackReader::read_info(folder_ / "faded.uvj");
  EXPECT_EQ(info.process->uv.kind, UvKind::constant);
  EXPECT_EQ(info.process->uv.uv_mw_cm2, 200);
  EXPECT_EQ(info.process->uv_lamp_share, std::vector{0.8});
}

/// Dose of a column's voxel middles by the law itself, in steps of a hundredth of a slice (physics 5).
std::vector<double> own_doses(const MemorySlices& shown, int x, int y,
                              const std::vector<double>& uv) {
  const double hb = 408, huv = 37.8, m = 0.99, hs = 50, s_um = 300 / 3.6;
  constexpr int kSteps = 100;
  std::vector<double> doses;
  for (int k = 0; k < shown.grid().layers; ++k) {
    const double z = (k + 0.5) * hs;
    double dose = 0;
    for (int n = k; n < shown.grid().layers; ++n) {
      const double blue = 100 * shown.at(n, x, y) / 255.0;
      const double u = uv[std::min(static_cast<std::size_t>(n), uv.size() - 1)];
      for (int i = 0; i < kSteps; ++i) {
        const double d = (n + (i + 0.5) / kSteps) * hs - z;
        if (d < 0) continue;
        const double rate = blue * std::exp(-d / hb) - 0.73 * u * std::exp(-d / huv);
        if (rate > 0) dose += std::pow(rate, m) * hs / kSteps / s_um;
      }
    }
    doses.push_back(dose / 64);
  }
  return doses;
}

TEST_F(FadingUv, IsCountedSliceBySlice) {
  // One log of both lamps, in seconds: UV light falls from all to half of it, blue light stays.
  std::ofstream(folder_ / "both.csv") << "seconds,lamp_share,uv_lamp_share\n0,1,1\n21.6,1,0.5\n";
  const RunResult r =
      correct("even.toml", "f.uvj", {"--uv-mw-cm2", "200", "--lamp-log", "both.csv"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const StackInfo info = StackReader::read_info(folder_ / "f.uvj");
  EXPECT_TRUE(info.process->lamp_share.empty() || info.process->lamp_share == std::vector{1.0});
  std::vector<double> uv;
  for (int n = 0; n < 60; ++n)
    uv.push_back(200 * (1 - 0.5 * std::min(1.0, (n + 0.5) * 0.6 / 21.6)));
  ASSERT_GE(info.process->uv_lamp_share.size(), 30U);
  EXPECT_NEAR(200 * info.process->uv_lamp_share[20], uv[20], 1e-9);
  // Doses by the law itself: what the part needs is gelled, gaps are not.
  const MemorySlices shown = slices("f.uvj");
  const std::vector<double> doses = own_doses(shown, 30, 30, uv);
  for (int k = 0; k < 36; ++k) {
    const bool part = k < 10 || k >= 22;
    // Edges within slices: the outermost voxels of features may be short of a part of them.
    if (k == 9 || k == 10 || k == 21 || k == 22 || k == 35) continue;
    if (part) {
      EXPECT_GT(doses[static_cast<std::size_t>(k)], 1 - 0.005) << k;
    } else {
      EXPECT_LT(doses[static_cast<std::size_t>(k)], 1 + 0.005) << k;
    }
  }
  // It is another print than that of a lamp that lasts.
  ASSERT_EQ(correct("even.toml", "e.uvj", {"--uv-mw-cm2", "200"}).exit_code, 0);
  const MemorySlices lasting = slices("e.uvj");
  int differ = 0;
  for (int n = 0; n < 36; ++n) differ += shown.at(n, 30, 30) != lasting.at(n, 30, 30) ? 1 : 0;
  EXPECT_GT(differ, 5);
}

TEST_F(FadingUv, ADeadZoneAsksMoreOfALampThatGivesLess) {
  std::ofstream(folder_ / "log.csv") << "slice,uv_lamp_share\n0,1\n10,0.9\n";
  const Command zone{"--dead-zone-um", "8", "--uv-schedule", "per-slice"};
  ASSERT_EQ(correct("even.toml", "whole.uvj", zone).exit_code, 0);
  ASSERT_EQ(correct("even.toml", "faded.uvj", zone + Command{"--uv-lamp-log", "log.csv"}).exit_code,
            0);
  const auto whole = StackReader::read_info(folder_ / "whole.uvj").process->uv.slice_mw_cm2;
  const auto faded = StackReader::read_info(folder_ / "faded.uvj").process->uv.slice_mw_cm2;
  ASSERT_EQ(whole.size(), faded.size());
  for (std::size_t n = 0; n < whole.size(); ++n) {
    EXPECT_NEAR(faded[n] * (n < 10 ? 1 : 0.9), whole[n], 1e-9 * whole[n]) << n;
  }
  // A lamp that can't is told with its slice.
  std::ofstream(folder_ / "weak.csv") << "slice,uv_lamp_share\n0,1\n10,0.4\n";
  const RunResult weak = correct("even.toml", "w.uvj", zone + Command{"--uv-lamp-log", "weak.csv"});
  EXPECT_EQ(weak.exit_code, 3);
  EXPECT_THAT(weak.err, HasSubstr("the UV lamp still gives 40 %"));
}

TEST_F(FadingUv, PatternsAreMadeForTheLeastThatComes) {
  std::ofstream(folder_ / "log.csv") << "slice,uv_lamp_share\n0,1\n10,0.9\n";
  printer("patterned.toml", "", "patterned");
  const Command zone{"--dead-zone-um", "8"};
  ASSERT_EQ(
      correct("patterned.toml", "f.uvj", zone + Command{"--uv-lamp-log", "log.csv"}).exit_code, 0);
  const StackReader stack(folder_ / "f.uvj", folder_.path());
  std::vector<std::uint8_t> blue(3600), uv(3600);
  double least = 1e9;
  for (int n = 0; n < stack.info().grid.layers; ++n) {
    stack.read_slice(n, blue.data());
    stack.read_uv_slice(n, uv.data());
    for (std::size_t i = 0; i < blue.size(); ++i) {
      if (blue[i] == 0) continue;
      const double comes = 275.0 * uv[i] / 255 * (n < 10 ? 1 : 0.9);
      const double needed = 100.0 * blue[i] / 255 / 0.73 * std::exp(8 * (1 / 37.8 - 1 / 408.0));
      least = std::min(least, comes - needed);
    }
  }
  // No pixel of any slice has less than it needs, and not more than a level of the lamp more.
  EXPECT_GE(least, -1e-9);
  EXPECT_LE(least, 275.0 / 255);
  EXPECT_EQ(correct("patterned.toml", "w.uvj", {"--dead-zone-um", "25", "--uv-lamp-log", "log.csv"})
                .exit_code,
            3);
}

TEST_F(FadingUv, IsRefusedWhereItIsNotCounted) {
  std::ofstream(folder_ / "log.csv") << "slice,uv_lamp_share\n0,1\n10,0.9\n";
  const RunResult sure =
      correct("even.toml", "x.uvj",
              {"--uv-mw-cm2", "200", "--uv-lamp-log", "log.csv", "--uncertain", "ha=5%"});
  EXPECT_EQ(sure.exit_code, 0) << sure.err;
  for (const char* bad :
       {"slice,uv_lamp_share\n0,1.2\n", "slice,uv_lamp_share\n0,0\n", "slice,lamp_share\n0,1\n",
        "slice,lamp_share,uv_lamp_share\n0,1\n", "seconds,uv_share\n0,1\n"}) {
    std::ofstream(folder_ / "bad.csv") << bad;
    EXPECT_EQ(
        correct("even.toml", "x.uvj", {"--uv-mw-cm2", "200", "--uv-lamp-log", "bad.csv"}).exit_code,
        2)
        << bad;
  }
}

}  // namespace
}  // namespace slicecorr::test
