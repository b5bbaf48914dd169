// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Printers whose light nobody has told yet, through the programs: what works without it, what is refused,
/// and the way from the shipped file to a correction, as somebody goes it who has just bought the printer
/// and a power meter.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>

#include "ladder.hpp"
#include "print_file_fixture.hpp"
#include "program_fixture.hpp"
#include "refusal.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/level_images.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/write_images.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr const char* kDark =
    "name = \"dark\"\nmaker = \"Works\"\nproduct = \"Dark\"\n[display]\nwidth_px = 160\n"
    "height_px = 120\npixel_um = 50.0\nmirror = \"x\"\n[blue]\n# A remark.\n"
    "calibration = \"to be measured\"\n[stage]\nmax_speed_mm_h = 2000\ntravel_mm = 100\n"
    "[provenance]\nmeasurements = \"none\"\n";
/// What the display does: dark at 0.02, full at 4.5 mW/cm², to the power of 2.2.
double light_of(double level) { return 0.02 + 4.48 * std::pow(level / 255, 2.2); }

FileGreys held(const detail::LayerCodec& codec) { return codec.shown(); }

// ---- images -----------------------------------------------------------------------------------

Printer display_of(int bits = 8) {
  Printer p;
  p.name = "dark";
  p.width_px = 40;
  p.height_px = 30;
  p.pixel_x_um = p.pixel_y_um = 50;
  p.bit_depth = bits;
  return p;
}

TEST(LevelImages, ShowLevelsThatTheFileHolds) {
  const auto levels = [](const FileGreys& greys, int bits = 8) {
    return LevelImages(display_of(bits), greys, {}).levels();
  };
  const FileGreys all = held(*detail::goo_code(8, 8, false));
  EXPECT_THAT(levels(all), ElementsAre(0, 8, 10, 12, 14, 17, 20, 24, 29, 34, 41, 49, 59, 71, 85,
                                       103, 123, 148, 177, 213, 255));
  // CTB keeps seven bits, the grey values 2v + 1; Photon Workshop four, multiples of 17.
  for (const auto& codec : {detail::ctb_code(8, 8, 0), detail::pw0_code(8, 8, false),
                            detail::lgs_code(8, 8), detail::bit_sets_code(8, 8, 8, false)}) {
    const auto some = levels(codec->shown());
    EXPECT_GE(some.size(), 8u);
    EXPECT_EQ(some.front(), 0);
    EXPECT_EQ(some.back(), 255);
    for (std::size_t i = 0; i < some.size(); ++i) {
      EXPECT_EQ(codec->shown()[static_cast<std::size_t>(some[i])], some[i]);
      if (i > 0) {
        EXPECT_GT(some[i], some[i - 1]);
      }
    }
  }
  EXPECT_THAT(levels(held(*detail::bit_sets_code(8, 8, 1, false))), ElementsAre(0, 255));
  EXPECT_THAT(levels(all, 2), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(levels(all, 1), ElementsAre(0, 1));
  FileGreys no_full = all;
  no_full[255] = 254;
  EXPECT_THAT(refusal([&] { levels(no_full); }), HasSubstr("black and full light"));
  EXPECT_THROW(LevelImages(display_of(), all, {.layer_um = 0}), InputError);
  EXPECT_THROW(LevelImages(display_of(), all, {.image_s = 0}), InputError);
}

// A calibration is straight between its points: off a power of the level by g (g - 1) / 8 (b - a)^2 / (a b)
// at most between the levels a and b, to the second order; a tenth more for the rest.
TEST(LevelImages, AreCloseEnoughForACurve) {
  const auto levels = LevelImages(display_of(), held(*detail::goo_code(8, 8, false)), {}).levels();
  for (const double g : {1.0, 2.2, 3.0}) {
    for (std::size_t i = 2; i < levels.size(); ++i) {
      const double a = levels[i - 1], b = levels[i];
      const double bound = 1.1 * g * (g - 1) / 8 * (b - a) * (b - a) / (a * b);
      EXPECT_LT(bound, 0.042);
      for (double x = a; x <= b; ++x) {
        const double straight =
            std::pow(a, g) + (std::pow(b, g) - std::pow(a, g)) * (x - a) / (b - a);
        EXPECT_NEAR(straight / std::pow(x, g), 1, bound + 1e-12) << g << " " << x;
      }
    }
  }
}

TEST(LevelImages, AreEvenAllOverThePlate) {
  const LevelImages part(display_of(2), held(*detail::goo_code(8, 8, false)), {});
  EXPECT_EQ(part.grid().layers, 4);
  const PixelBox all = part.bounds();
  EXPECT_EQ(std::vector({all.x0, all.y0, all.x1, all.y1}), std::vector({0, 0, 40, 30}));
  int images = 0;
  part.read_band({3, 5, 11, 7}, [&](int n, const std::uint8_t* rows) {
    EXPECT_EQ(n, images++);
    if (n == 0) {
      EXPECT_EQ(rows, nullptr);
    } else {
      ASSERT_NE(rows, nullptr);
      EXPECT_THAT(std::vector<int>(rows, rows + 16), Each(85 * n));
    }
  });
  EXPECT_EQ(images, 4);
}

TEST(WriteImages, EveryImageNeedsATime) {
  const TemporaryFolder folder;
  const LevelImages part(display_of(2), held(*detail::goo_code(8, 8, false)), {});
  for (const std::vector<double>& wrong :
       {std::vector<double>{1, 2, 3}, {1, 2, 3, 0}, {1, 2, 3, NAN}, {1, 2, 3, 1e6}}) {
    EXPECT_THROW(write_images(part, wrong, StackFile(folder / "a.uvj")), InputError);
  }
  EXPECT_EQ(folder.count(), 0u);
  write_images(part, {1, 2, 3, 4.5}, StackFile(folder / "a.uvj"));
  EXPECT_THAT(StackReader::read_info(folder / "a.uvj").layer_exposure_s, ElementsAre(1, 2, 3, 4.5));
  write_images(part, {2, 2, 2, 2}, StackFile(folder / "b.uvj"));
  const StackInfo even = StackReader::read_info(folder / "b.uvj");
  EXPECT_EQ(even.exposure_s, 2);
  EXPECT_TRUE(even.layer_exposure_s.empty());
}

// ---- printers that are shipped ----------------------------------------------------------------

std::vector<std::filesystem::path> shipped_without_light() {
  std::vector<std::filesystem::path> found;
  for (const auto& entry : std::filesystem::directory_iterator(SLICECORR_PRINTERS_DIR)) {
    if (entry.path().extension() != ".toml") continue;
    if (!light_is_measured(load_display(entry.path().string()))) found.push_back(entry.path());
  }
  return found;
}

// Each number is the one of the source that the file names.
TEST(KnownPrinters, HaveTheDisplayOfTheirSource) {
  const std::regex words(
      "source = \"UVtools' profile ([^\"]*)\\.ini [^:]*: (\\d+) x (\\d+) pixels on ([0-9.]+) x "
      "([0-9.]+) mm, landscape, (not mirrored|mirrored in x), ([0-9.]+) mm high, FILEFORMAT_[A-Z0-9]+\"");
  const auto files = shipped_without_light();
  EXPECT_EQ(files.size(), 37u);
  for (const auto& file : files) {
    SCOPED_TRACE(file.string());
    std::ifstream in(file);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    std::smatch found;
    ASSERT_TRUE(std::regex_search(text, found, words));
    const Printer p = load_display(file.string());
    EXPECT_EQ(p.width_px, std::stoi(found[2]));
    EXPECT_EQ(p.height_px, std::stoi(found[3]));
    EXPECT_NEAR(p.pixel_x_um, 1e3 * std::stod(found[4]) / p.width_px, 6e-4);
    EXPECT_NEAR(p.pixel_y_um, 1e3 * std::stod(found[5]) / p.height_px, 6e-4);
    ASSERT_TRUE(p.orientation);
    EXPECT_EQ(p.orientation->mirror_x, found[6] == "mirrored in x");
    EXPECT_FALSE(p.orientation->mirror_y || p.orientation->portrait);
    EXPECT_EQ(p.travel_mm, std::stod(found[7]));
    EXPECT_EQ(p.bit_depth, 8);
  }
}

// And, where there is a file of the printer's slicer, that file's.
TEST(KnownPrinters, HaveTheDisplayOfRealFiles) {
  const std::pair<const char*, const char*> pairs[] = {
      {"anycubic-photon", "pfe_smilie.v1.photon"},
      {"anycubic-photon-mono", "msla_photon_mono.v515.pwmo.gz"},
      {"anycubic-photon-mono-x", "msla_photon_mono_x.v516.pwmx.gz"},
      {"anycubic-photon-mono-4k", "msla_photon_mono_4k.v516.pwma.gz"},
      {"anycubic-photon-m3", "msla_photon_m3.v516.pm3.gz"},
      {"elegoo-mars", "mariner_pyramid.v3.ctb"},
      {"elegoo-mars-4-max", "msla_mars4max.goo.gz"},
      {"elegoo-saturn", "msla_saturn.v4.ctb"},
      {"creality-halot-one-plus", "msla_halot_one_plus.v3.cxdlp.gz"},
      {"longer-orange-10", "uv3dp_microsupports3.lgs"}};
  if (const std::string why = lacks(real_file("slices/binary")); !why.empty()) GTEST_SKIP() << why;
  const TemporaryFolder folder;
  for (const auto& [name, file] : pairs) {
    SCOPED_TRACE(file);
    std::string path = folder / file;
    if (path.ends_with(".gz")) path.resize(path.size() - 3);
    write_file(path, real_print_file(file));
    const StackInfo info = StackReader::read_info(path);
    const Printer p = load_display(std::string(SLICECORR_PRINTERS_DIR "/") + name + ".toml");
    EXPECT_EQ(info.grid.width_px, p.width_px);
    EXPECT_EQ(info.grid.height_px, p.height_px);
    // As near as records and archives must agree.
    EXPECT_NEAR(info.grid.pixel_x_um, p.pixel_x_um, 1e-3 * p.pixel_x_um);
    EXPECT_NEAR(info.grid.pixel_y_um, p.pixel_y_um, 1e-3 * p.pixel_y_um);
    if (info.orientation_known) {
      EXPECT_EQ(info.orientation, *p.orientation);
    }
    std::filesystem::remove(path);
  }
}

// ---- programs ---------------------------------------------------------------------------------

class MeasureLightProgram : public ProgramFixture {
 protected:
  MeasureLightProgram() {
    write("dark.toml", kDark);
    write_stl(folder_ / "ladder.stl", ladder());
  }
  RunResult other(const std::string& program, const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/" + program} + arguments, options_);
  }
  std::string text_of(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  /// The table with the light of each level, but for those that `leave` names.
  std::string filled(const std::string& form, const std::set<int>& leave = {}) const {
    std::istringstream lines(text_of(form));
    std::string text;
    for (std::string line; std::getline(lines, line);) {
      text += line;
      if (!line.empty() && line[0] >= '0' && line[0] <= '9') {
        const int level = std::stoi(line);
        if (!line.ends_with(",")) text += ",";
        if (!leave.contains(level)) text += fmt::format("{:.4f}", light_of(level));
      }
      text += "\n";
    }
    return text;
  }
  void refused(const RunResult& r) const {
    EXPECT_EQ(r.exit_code, 2) << r.err;
    for (const char* words : {"blue.calibration: is to be measured", "power meter",
                              "slicecorr testpart levels", "resinctl import"}) {
      EXPECT_THAT(r.err, HasSubstr(words));
    }
  }
};

TEST_F(MeasureLightProgram, WhatNeedsLightIsRefusedAndWhatDoesNotIsDone) {
  good({"slice", "ladder.stl", "-o", "target.uvj", "--printer", "dark.toml", "--layer-um", "50"});
  good({"convert", "target.uvj", "-o", "target.goo", "--printer", "dark.toml"});
  std::string wide = kDark;
  wide.replace(wide.find("160"), 3, "640");
  wide.replace(wide.find("120"), 3, "480");
  write("wide.toml", wide);
  good({"testpart", "spread", "--printer", "wide.toml", "-o", "lines.uvj"});
  const auto before = folder_.count();
  const Command light{"--printer", "dark.toml", "--resin", "figure-2-2"};
  const Command speed{"--speed-mm-h", "800"};
  refused(call(Command{"correct", "target.uvj", "-o", "part.uvj"} + light + speed));
  refused(call(Command{"correct", "target.goo", "-o", "part.goo", "--exposure-s", "2"} + light));
  refused(call(Command{"run", "ladder.stl", "-o", "part.uvj", "--layer-um", "50"} + light + speed));
  refused(call(Command{"compare", "ladder.stl", "--layer-um", "50"} + light + speed));
  refused(call(Command{"plan", "target.uvj"} + light));
  refused(call(Command{"flow", "target.uvj"} + light + speed));
  refused(call(Command{"verify", "target.uvj", "--target", "target.uvj"} + light + speed));
  refused(call(Command{"probe", "target.uvj", "--x", "80", "--y", "60"} + light + speed));
  refused(call(Command{"testpart", "staircase", "-o", "stairs.uvj"} + light));
  refused(other("slicecorr-post", Command{"target.goo", "--exposure-s", "2"} + light));
  refused(other("resinctl", {"recommend", "--printer", "dark.toml", "--resin", "figure-2-2",
                             "--speed-mm-h", "800", "--tolerance-um", "25"}));
  refused(other("resinctl", {"export", "dark.toml", "--format", "csv"}));
  const RunResult farm =
      other("slicefarm", Command{"submit", "target.uvj", "--dir", "farm"} + light + speed);
  EXPECT_EQ(farm.exit_code, 2);
  EXPECT_THAT(farm.err, HasSubstr("to be measured"));
  std::filesystem::remove_all(folder_ / "farm");
  EXPECT_EQ(folder_.count(), before);
}

TEST_F(MeasureLightProgram, ResinctlTellsOfIt) {
  const RunResult show = other("resinctl", {"show", "dark.toml"});
  EXPECT_EQ(show.exit_code, 0) << show.err;
  EXPECT_THAT(show.out, AllOf(HasSubstr("160 x 120 of 50 x 50 um"), HasSubstr("to be measured"),
                              HasSubstr("slicecorr testpart levels")));
  const RunResult as_json = other("resinctl", {"show", "dark.toml", "--json", "-"});
  EXPECT_EQ(json::parse(as_json.out)["calibration"], "to be measured");
  EXPECT_EQ(other("resinctl", {"validate", "dark.toml"}).exit_code, 0);
  const RunResult text = other("resinctl", {"export", "dark.toml", "--format", "toml"});
  EXPECT_EQ(text.out, kDark);
  const RunResult list = other("resinctl", {"list", "--printers"});
  EXPECT_EQ(list.exit_code, 0);
  EXPECT_EQ(list.err.find("to be measured"), std::string::npos) << list.err;
  EXPECT_THAT(list.out, AllOf(HasSubstr("elegoo-mars-4-max"), HasSubstr("to be measured")));
  const RunResult added = other("resinctl", {"add", "dark.toml", "--folder", "db"});
  EXPECT_EQ(added.exit_code, 0) << added.err;
  EXPECT_THAT(text_of("db/dark.toml"), HasSubstr("calibration = \"to be measured\""));
}

// From the shipped file to a correction.
TEST_F(MeasureLightProgram, LevelsBecomeACalibrationByWhichPartsAreCorrected) {
  for (const char* name : {"levels.goo", "levels.ctb", "levels.uvj", "levels.sl1"}) {
    SCOPED_TRACE(name);
    const Command make{"testpart",     "levels",
                       "--printer",    "dark.toml",
                       "-o",           name,
                       "--exposure-s", "20",
                       "--form",       std::string(name) + ".csv",
                       "--sheet",      std::string(name) + ".html"};
    const RunResult made = good(make);
    EXPECT_EQ(made.err.find("rounded"), std::string::npos) << made.err;
    const StackInfo info = StackReader::read_info(folder_ / name);
    EXPECT_GT(info.grid.layers, 15);
    EXPECT_EQ(info.exposure_s, 20);
    EXPECT_TRUE(info.layer_exposure_s.empty());
    EXPECT_EQ(info.bottom_layers, 0);
    // What the images show is what the table says.
    const StackReader stack(folder_ / name, folder_.path());
    std::vector<int> shown(static_cast<std::size_t>(info.grid.layers));
    stack.read_band({0, 0, 160, 120}, [&](int n, const std::uint8_t* rows) {
      if (!rows) return;
      shown[static_cast<std::size_t>(n)] = rows[0];
      EXPECT_THAT(std::vector<int>(rows, rows + 160 * 120), Each(rows[0]));
    });
    std::vector<int> said;
    std::istringstream lines(text_of(std::string(name) + ".csv"));
    for (std::string line; std::getline(lines, line);) {
      if (line[0] >= '0' && line[0] <= '9') said.push_back(std::stoi(line));
    }
    EXPECT_EQ(shown, said);
  }
  EXPECT_THAT(text_of("levels.goo.html"),
              AllOf(HasSubstr("<b>21 images</b>"), HasSubstr("<b>20 s</b>"), HasSubstr("level 255"),
                    HasSubstr("resinctl import levels.goo.csv --format calibration --printer "
                              "dark.toml --name my-dark")));
  // One that was not measured is left out; the table may come back changed in nothing else.
  write("levels.csv", filled("levels.goo.csv", {103}));
  const Command import{"import",    "levels.csv", "--format", "calibration", "--printer",
                       "dark.toml", "--name",     "my-dark",  "--folder",    "db"};
  const RunResult r = other("resinctl", import);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const Printer mine = load_printer(folder_ / "db/my-dark.toml");
  ASSERT_EQ(mine.calibration.size(), 20u);
  for (const CalibrationPoint& p : mine.calibration) {
    EXPECT_NE(p.level, 103);
    EXPECT_NEAR(p.intensity_mw_cm2, light_of(p.level), 5.1e-5);
  }
  EXPECT_EQ(mine.orientation, load_display(folder_ / "dark.toml").orientation);
  EXPECT_THAT(text_of("db/my-dark.toml"), HasSubstr("20 readings"));
  good({"slice", "ladder.stl", "-o", "target.uvj", "--printer", "dark.toml", "--layer-um", "50"});
  good({"correct", "target.uvj", "-o", "part.uvj", "--printer", "db/my-dark.toml", "--resin",
        "liqcreate-strong-x-405nm", "--mode", "layerwise", "--exposure-s", "24"});

  // A table of another part, with rows moved, or without its ends.
  std::string moved = filled("levels.goo.csv");
  const std::size_t at = moved.find("\n34,");
  ASSERT_NE(at, std::string::npos);
  moved.replace(at, 4, "\n33,");
  write("levels.csv", moved);
  EXPECT_EQ(other("resinctl", import + Command{"--replace"}).exit_code, 2);
  write("levels.csv", filled("levels.goo.csv", {255}));
  const RunResult no_full = other("resinctl", import + Command{"--replace"});
  EXPECT_EQ(no_full.exit_code, 2);
  EXPECT_THAT(no_full.err, AllOf(HasSubstr("levels.csv: has no reading of full light, level 255"),
                                 HasSubstr("levels go from 0 to 213")));
  // In uW/cm², and a meter out of its range.
  for (const auto& [rows, words] : {std::pair{"0,3\n128,700\n255,4010\n", "were these uW/cm²?"},
                                    {"0,4\n128,4\n255,4\n", "hardly brighter than black"}}) {
    write("mine.csv", std::string("level,intensity_mw_cm2\n") + rows);
    const RunResult wrong =
        other("resinctl", {"import", "mine.csv", "--format", "calibration", "--printer",
                           "dark.toml", "--name", "mine", "--folder", "db"});
    EXPECT_EQ(wrong.exit_code, 2);
    EXPECT_THAT(wrong.err, HasSubstr(words));
  }
  good({"testpart", "comb", "--printer", "db/my-dark.toml", "-o", "comb.uvj"});
  const RunResult comb = other("resinctl", {"import", "comb.csv", "--format", "calibration",
                                            "--printer", "dark.toml", "--folder", "db"});
  EXPECT_EQ(comb.exit_code, 2);
  EXPECT_THAT(comb.err, HasSubstr("slicecorr tune"));
}

// The file of another printer's slicer keeps all but its layers.
TEST_F(MeasureLightProgram, LevelsGoIntoATemplate) {
  const SmallFile lgs = small_lgs();
  write_file(folder_ / "from-the-slicer.lgs", lgs.bytes);
  write("dark.toml",
        "name = \"dark\"\n[display]\nwidth_px = 40\nheight_px = 30\npixel_um = 50.0\n"
        "mirror = \"x\"\n[blue]\ncalibration = \"to be measured\"\n");
  bad(2, {"testpart", "levels", "--printer", "dark.toml", "-o", "levels.lgs"}, {"template"});
  good({"testpart", "levels", "--printer", "dark.toml", "-o", "levels.lgs", "--template",
        "from-the-slicer.lgs"});
  const StackReader stack(folder_ / "levels.lgs", folder_.path());
  std::vector<int> shown;
  stack.read_band({0, 0, 40, 30},
                  [&](int, const std::uint8_t* rows) { shown.push_back(rows ? rows[0] : 0); });
  EXPECT_THAT(shown, ElementsAre(0, 17, 34, 51, 68, 85, 102, 119, 153, 170, 221, 255));
  EXPECT_EQ(stack.info().exposure_s, 30);
}

// ---- staircases -------------------------------------------------------------------------------

/// A printer whose black pixels are dark enough for staircases.
constexpr const char* kLit =
    "name = \"lit\"\n[display]\nwidth_px = 480\nheight_px = 360\npixel_um = 50.0\nmirror = \"x\"\n"
    "[blue]\ncalibration = [[0, 0.002], [255, 4.0]]\n";
constexpr const char* kSlow =
    "name = \"slow\"\n[cure]\nmodel = \"jacobs\"\nm = 1.0\nabsorbance_height_um = 200\n"
    "absorbance_base = \"e\"\ngel_dose_mj_cm2 = 20\ndose_factor = 1.0\n";

TEST_F(MeasureLightProgram, StacksOfStaircasesSayForHowLongEachImageIsShown) {
  write("lit.toml", kLit);
  write("slow.toml", kSlow);
  for (const char* name : {"stairs.uvj", "stairs.goo", "stairs.ctb", "stairs.zip"}) {
    SCOPED_TRACE(name);
    Command make{"testpart", "staircase", "--printer", "lit.toml",
                 "--resin",  "slow.toml", "-o",        name};
    const std::string file = std::string(name) + ".csv";
    make = make + Command{"--form", file, "--sheet", std::string(name) + ".html"};
    if (std::string(name) == "stairs.zip") make = make + Command{"--format", "chitubox"};
    good(make);
    const StackReader stack(folder_ / name, folder_.path());
    const StackInfo& info = stack.info();
    ASSERT_EQ(info.layer_exposure_s.size(), static_cast<std::size_t>(info.grid.layers));
    EXPECT_GT(info.grid.layers, 6);
    // A plug is lit, summed over the images that show it, for as long as the table says; its grey
    // value gives the light that the table says.
    std::istringstream lines(text_of(file));
    std::vector<double> shown_s, mw_cm2;
    for (std::string line; std::getline(lines, line);) {
      if (!line.starts_with("plug")) continue;
      std::vector<std::string> cells;
      std::istringstream all(line + ",");
      for (std::string cell; std::getline(all, cell, ',');) cells.push_back(cell);
      mw_cm2.push_back(std::stod(cells[1]));
      shown_s.push_back(std::stod(cells[3]));
    }
    ASSERT_EQ(shown_s.size(), 18u);
    // Three rows of six plugs; which way they are mirrored does not matter to the sums of a row.
    std::map<int, std::multiset<long>> lit_ms, said_ms;
    std::vector<std::vector<std::uint8_t>> images;
    stack.read_band({0, 0, 480, 360}, [&](int, const std::uint8_t* rows) {
      images.emplace_back(rows, rows + 480 * 360);
    });
    const auto& first = images.front();
    for (int y = 1; y < 360; ++y) {
      for (int x = 1; x < 480; ++x) {
        const auto p = static_cast<std::size_t>(y * 480 + x);
        // The upper left corner of a plug.
        if (first[p] == 0 || first[p - 1] != 0 || first[p - 480] != 0) continue;
        double sum_s = 0;
        for (std::size_t n = 0; n < images.size(); ++n) {
          if (images[n][p] == first[p]) sum_s += info.layer_exposure_s[n];
        }
        lit_ms[first[p]].insert(std::lround(sum_s * 100));
      }
    }
    for (std::size_t i = 0; i < shown_s.size(); ++i) {
      const double level = (mw_cm2[i] - 0.002) / 3.998 * 255;
      EXPECT_NEAR(level, std::lround(level), 2e-3) << mw_cm2[i];  // six digits of the table
      said_ms[static_cast<int>(std::lround(level))].insert(std::lround(shown_s[i] * 100));
    }
    ASSERT_EQ(lit_ms.size(), said_ms.size());
    for (const auto& [level, times] : said_ms) {
      ASSERT_EQ(lit_ms[level].size(), times.size()) << level;
      auto got = lit_ms[level].begin();
      // A hundredth of a second for each of up to 18 times that are rounded to milliseconds.
      for (const long t : times)
        EXPECT_NEAR(static_cast<double>(*got++), static_cast<double>(t), 2);
    }
  }
  // What can't say times of single layers tells so.
  const RunResult sl1 =
      good({"testpart", "staircase", "--printer", "lit.toml", "--resin", "slow.toml", "-o",
            "stairs.sl1", "--form", "s.csv", "--sheet", "s.html"});
  EXPECT_THAT(sl1.err, HasSubstr("no exposure time of their own for each layer"));
}

}  // namespace
}  // namespace slicecorr::test
