// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Print files wherever archives are taken: slicecorr-post in place, a folder that is watched, the farm, the C
// interface by way of Python. All of them make the same bytes as `slicecorr correct` of the same file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "ladder.hpp"
#include "program_fixture.hpp"
#include "slicecorr/print_file.hpp"

namespace slicecorr::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;

/// Of a display whose black is dark enough for layers that lie on top of each other.
constexpr const char* kLcd =
    "name = \"lcd\"\nmaker = \"Works\"\nproduct = \"Lcd One\"\n[display]\nwidth_px = 160\n"
    "height_px = 120\npixel_um = 50.0\nmirror = \"x\"\n[blue]\nwavelength_nm = 405\n"
    "calibration = [[0, 0.002], [255, 4.0]]\n[stage]\ntravel_mm = 100\n";
const Command kLight{"--printer", "lcd.toml", "--resin", "liqcreate-strong-x-405nm"};
const Command kLayers{"--mode", "layerwise", "--exposure-s", "24"};

/// The ending of the format.
class PrintFilesEverywhere : public ProgramFixture,
                             public testing::WithParamInterface<const char*> {
 protected:
  PrintFilesEverywhere() {
    write("lcd.toml", kLcd);
    write_stl(folder_ / "ladder.stl", ladder());
    // Made once for each format: each test gets the same files.
    static std::map<std::string, Made> all;
    if (!all.contains(ending())) all[ending()] = make();
    const Made& made = all[ending()];
    exported_ = made.exported;
    wanted_ = made.wanted;
    EXPECT_NE(wanted_, exported_);
    write_file(folder_ / "target.uvj", made.target);
    write_file(folder_ / part(), exported_);
  }
  struct Made {
    Bytes target, exported, wanted;
  };
  Made make() const {
    good({"slice", "ladder.stl", "-o", "target.uvj", "--printer", "lcd.toml", "--layer-um", "50"});
    // As a slicer exports it: with times, and turned to the display.
    good({"convert", "target.uvj", "-o", "plain.uvj", "--printer", "lcd.toml"});
    const StackReader target(folder_ / "plain.uvj", folder_.path());
    Images images{target.grid(), {}};
    const Grid& g = target.grid();
    target.read_band({0, 0, g.width_px, g.height_px}, [&](int, const std::uint8_t* rows) {
      images.slices.emplace_back(static_cast<std::size_t>(g.width_px * g.height_px));
      if (rows) std::copy_n(rows, images.slices.back().size(), images.slices.back().begin());
    });
    StackInfo info = info_of(images.grid);
    info.kind = StackKind::foreign;
    info.exposure_s = 9;
    info.bottom_exposure_s = 40;
    info.bottom_layers = 2;
    write_stack(folder_ / part(), images, info);
    good(Command{"correct", part(), "-o", "wanted" + ending()} + kLight + kLayers);
    return {read_file(folder_ / "target.uvj"), read_file(folder_ / part()),
            read_file(folder_ / ("wanted" + ending()))};
  }
  static std::string ending() { return std::string(".") + GetParam(); }
  static std::string part() { return "part" + ending(); }
  RunResult run(const std::string& program, const Command& arguments) const {
    const RunResult r = run_program(Command{SLICECORR_BIN_DIR "/" + program} + arguments, options_);
    EXPECT_EQ(r.exit_code, 0) << testing::PrintToString(arguments) << r.err;
    return r;
  }
  /// Corrected, with its record beside it.
  void expect_corrected(const std::string& name) const {
    const StackInfo info = StackReader::read_info(folder_ / name);
    EXPECT_EQ(info.kind, StackKind::corrected);
    EXPECT_TRUE(info.parameters_checked);
    EXPECT_EQ(info.format, GetParam());
    ASSERT_TRUE(info.printer);
    EXPECT_EQ(info.printer->name, "lcd");
    EXPECT_TRUE(fs::exists(record_beside(folder_ / name)));
  }
  Bytes exported_, wanted_;
};
INSTANTIATE_TEST_SUITE_P(Formats, PrintFilesEverywhere, testing::Values("goo", "ctb"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(PrintFilesEverywhere, PostCorrectsInPlaceAndUndoes) {
  run("slicecorr-post", kLight + kLayers + Command{"--backup", part()});
  expect_corrected(part());
  EXPECT_EQ(read_file(folder_ / part()), wanted_);
  EXPECT_EQ(read_file(folder_ / (part() + ".orig")), exported_);
  // Not twice.
  const RunResult again = run_program(
      Command{SLICECORR_BIN_DIR "/slicecorr-post"} + kLight + kLayers + Command{part()}, options_);
  EXPECT_EQ(again.exit_code, 2);
  EXPECT_EQ(read_file(folder_ / part()), wanted_);
  run("slicecorr-post", {"--undo", part()});
  EXPECT_EQ(read_file(folder_ / part()), exported_);
  EXPECT_FALSE(fs::exists(record_beside(folder_ / part())));
  EXPECT_EQ(StackReader::read_info(folder_ / part()).kind, StackKind::foreign);
}

TEST_P(PrintFilesEverywhere, AWatchedFolderIsCorrected) {
  fs::create_directory(folder_ / "exports");
  write_file(folder_ / ("exports/" + part()), exported_);
  const Command watch =
      kLight + kLayers + Command{"--watch", "exports", "--once", "--patience-s", "0"};
  run("slicecorr-post", watch);
  expect_corrected("exports/" + part());
  EXPECT_EQ(read_file(folder_ / ("exports/" + part())), wanted_);
  // The record is no file to correct, and a second look changes nothing.
  run("slicecorr-post", watch);
  EXPECT_EQ(read_file(folder_ / ("exports/" + part())), wanted_);
}

TEST_P(PrintFilesEverywhere, TheFarmDeliversIt) {
  run("slicefarm", Command{"submit", "ladder.stl", "--dir", "farm", "--layer-um", "50", "--out",
                           "delivered", "--out-format", GetParam()} +
                       kLight + kLayers);
  run("slicefarm", {"run", "--dir", "farm", "--until-empty"});
  const std::string made = "delivered/ladder" + ending();
  expect_corrected(made);
  // The same images as those of the file that was corrected, which has other bottom layers.
  good(Command{"correct", "target.uvj", "-o", "alike" + ending()} + kLight + kLayers);
  const auto pixels = [&](const std::string& name) {
    const StackReader stack(folder_ / name, folder_.path());
    Bytes all;
    const Grid& g = stack.grid();
    stack.read_band({0, 0, g.width_px, g.height_px}, [&](int, const std::uint8_t* rows) {
      const std::size_t at = all.size(), count = static_cast<std::size_t>(g.width_px * g.height_px);
      all.resize(at + count);
      if (rows) std::copy_n(rows, count, all.begin() + static_cast<std::ptrdiff_t>(at));
    });
    return all;
  };
  EXPECT_EQ(pixels(made), pixels("alike" + ending()));
  const json figures = this->figures(made, "target.uvj");
  EXPECT_EQ(figures["cure_through_voxels"],
            this->figures("alike" + ending(), "target.uvj")["cure_through_voxels"]);
}

// The Python module is a layer on top of the C interface: one test for both.
TEST_P(PrintFilesEverywhere, PythonAndTheCInterfaceCorrectIt) {
  if (SLICECORR_SANITIZED) GTEST_SKIP() << "the sanitizer's library must be loaded first";
  RunOptions options = options_;
  options.environment["PYTHONPATH"] = SLICECORR_PYTHON_MODULES;
  const std::string script =
      "import slicecorr\n"
      "figures = slicecorr.correct('" +
      part() + "', 'python" + ending() +
      "', printer='lcd.toml', resin='liqcreate-strong-x-405nm', mode='layerwise', exposure_s=24)\n"
      "print(figures['layers'])\n";
  const RunResult r = run_program({"/usr/bin/python3", "-W", "error", "-c", script}, options);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  expect_corrected("python" + ending());
  EXPECT_EQ(read_file(folder_ / ("python" + ending())), wanted_);
}

TEST_P(PrintFilesEverywhere, InfoShowsWhatTheFileSays) {
  const RunResult text = good({"info", part()});
  for (const char* words :
       {"exposure", "display", "lift", "waits", "times of single layers", "grey levels"}) {
    EXPECT_THAT(text.out, HasSubstr(words));
  }
  const json all = json::parse(good({"info", part(), "--json", "-"}).out);
  EXPECT_EQ(all["archive"]["grey levels"], std::string(GetParam()) == "goo" ? "256" : "128");
  EXPECT_EQ(all["format"], GetParam());
}

// What a format has no place for is told or refused before anything is written.
TEST_P(PrintFilesEverywhere, WhatDoesNotFitIsRefusedFirst) {
  const std::string out = "out" + ending();
  bad(2, Command{"correct", part(), "-o", out, "--exposure-s", "nan"} + kLight, {"exposure-s"});
  bad(2, Command{"convert", part(), "-o", "out.pwmx"}, {"photon-workshop", "template"});
  bad(2, Command{"convert", part(), "-o", "out.pwmx", "--template", part()},
      {part(), "is no archive of the format photon-workshop"});
  bad(2, Command{"convert", part(), "-o", out, "--template", "none" + ending()}, {"none"});
  bad(2,
      Command{"slice", "ladder.stl", "-o", "out.lgs", "--printer", "lcd.toml", "--layer-um", "50"},
      {"template"});
  // A damaged one: cut off in its last layer.
  Bytes cut = exported_;
  cut.resize(cut.size() - 20);
  write_file(folder_ / ("cut" + ending()), cut);
  bad(2, Command{"correct", "cut" + ending(), "-o", out} + kLight + kLayers, {"cut" + ending()});
  bad(2, {"info", "cut" + ending()}, {"cut" + ending()});
}

}  // namespace
}  // namespace slicecorr::test
