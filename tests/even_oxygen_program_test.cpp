// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicecorr correct --even-oxygen` as people run it, on a real part.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "page_commands.hpp"
#include "program_fixture.hpp"
#include "real_files.hpp"
#include "slicecorr/chemistry.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* kFinePrinter =
    "name = \"fine\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 20.0\n[blue]\n"
    "calibration = [[0, 0.2], [255, 400.0]]\n";

class EvenOxygenProgram : public ProgramFixture {
 protected:
  EvenOxygenProgram() {
    write("fine.toml", kFinePrinter);
    // The hydrogel with a dye: light falls to 1/e in 100 um, of which its initiator takes 1.232 per cm.
    std::ifstream in(SLICECORR_DB_DIR "/model-hydrogel.toml");
    std::stringstream text;
    text << in.rdbuf();
    const Resin plain = parse_resin(text.str(), "plain");
    const GelTime g = gel_time_of(*plain.chemistry);
    std::string chemistry = text.str();
    chemistry = chemistry.substr(chemistry.find("[chemistry]"));
    chemistry = chemistry.substr(0, chemistry.find("[provenance]"));
    resin_ =
        "name = \"dyed\"\n[cure]\nmodel = \"gel-time\"\nabsorbance_height_um = 100\n"
        "absorbance_base = \"e\"\nwavelength_nm = 365\ngel_a_mj_cm2 = " +
        std::to_string(g.A) + "\ngel_b_sqrt_mw_cm2_s = " + std::to_string(g.B) +
        "\ndose_factor = 1\n";
    write("no-chemistry.toml", resin_);
    resin_ += chemistry + "other_absorption_per_cm = 98.768\n";
    write("dyed.toml", resin_);
    std::filesystem::copy_file(SLICECORR_SOURCE_DIR "/tests/data/meshes/clean/ksr_fdmtest_v4.stl",
                               folder_ / "part.stl");
    good({"slice", "part.stl", "-o", "target.uvj", "--fit-mm", "0.4", "--layer-um", "20",
          "--printer", "fine.toml"});
  }
  const Command kWith{"--printer", "fine.toml", "--resin",      "dyed.toml",
                      "--mode",    "layerwise", "--exposure-s", "1.7"};
  std::string resin_;
};

TEST_F(EvenOxygenProgram, ChangesTheLightOfSlices) {
  good(Command{"correct", "target.uvj", "-o", "plain.uvj"} + kWith);
  const RunResult r =
      good(Command{"correct", "target.uvj", "-o", "even.uvj", "--even-oxygen"} + kWith);
  // What it takes is told first, and what came of it.
  EXPECT_THAT(r.err, HasSubstr("different slices of up to"));
  EXPECT_THAT(r.err, HasSubstr("oxygen used up misses what is wanted by"));
  EXPECT_THAT(r.err, HasSubstr("dark voxels gel"));
  const std::vector<Bytes> plain = images("plain.uvj"), even = images("even.uvj"),
                           design = images("target.uvj");
  ASSERT_EQ(plain.size(), even.size());
  std::size_t brighter = 0, lit = 0;
  for (std::size_t n = 0; n < plain.size(); ++n) {
    for (std::size_t k = 0; k < plain[n].size(); ++k) {
      lit += plain[n][k] > 0;
      brighter += even[n][k] > plain[n][k];
      if (n < design.size() && design[n][k] < 128) {
        ASSERT_EQ(even[n][k], plain[n][k]) << n << " " << k;
      }
    }
  }
  EXPECT_GT(brighter, lit / 10);
  // The stack says so, and whoever judges it is told.
  EXPECT_THAT(good({"info", "even.uvj"}).out, HasSubstr("oxygen evened out"));
  EXPECT_THAT(good({"info", "plain.uvj"}).out, Not(HasSubstr("oxygen")));
  EXPECT_THAT(good({"verify", "even.uvj", "--target", "target.uvj"}).err,
              HasSubstr("--even-oxygen"));
  EXPECT_THAT(good({"verify", "plain.uvj", "--target", "target.uvj"}).err,
              Not(HasSubstr("oxygen")));
}

TEST_F(EvenOxygenProgram, TheCommandOfItsPageRuns) {
  const auto commands =
      page_commands(SLICECORR_SOURCE_DIR "/docs/chemistry.md", "slicecorr correct");
  ASSERT_EQ(commands.size(), 1U);
  const RunResult r =
      run_program({"/bin/sh", "-c", SLICECORR_BIN_DIR "/" + commands.front()}, options_);
  EXPECT_EQ(r.exit_code, 0) << commands.front() << r.err;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "part.uvj"));
}

TEST_F(EvenOxygenProgram, ThreadsChangeNothing) {
  const Command with = kWith + Command{"--even-oxygen", "--oxygen-margin", "0.2"};
  good(Command{"correct", "target.uvj", "-o", "one.uvj", "--threads", "1"} + with);
  good(Command{"correct", "target.uvj", "-o", "two.uvj", "--threads", "2"} + with);
  EXPECT_EQ(read_file(folder_ / "one.uvj"), read_file(folder_ / "two.uvj"));
}

TEST_F(EvenOxygenProgram, WhatItDoesNotGoWithIsRefused) {
  const auto correct = [&](const Command& more) {
    return Command{"correct", "target.uvj", "-o", "x.uvj", "--even-oxygen"} + more;
  };
  const Command layers{"--mode", "layerwise", "--exposure-s"};
  bad(2, correct({"--printer", "fine.toml", "--resin", "dyed.toml", "--speed-mm-h", "20"}),
      {"continuous", "expected a print layer by layer"});
  bad(2,
      correct(Command{"--printer", "fine.toml", "--resin", "no-chemistry.toml"} + layers +
              Command{"1.7"}),
      {"[chemistry]"});
  // At the far edge full light is 400 exp(-0.2) mW/cm², which takes 119.238 / 327.5 s.
  bad(3,
      correct(Command{"--printer", "fine.toml", "--resin", "dyed.toml"} + layers + Command{"0.35"}),
      {"0.3641 s"});
  bad(2,
      {"correct", "target.uvj", "-o", "x.uvj", "--oxygen-margin", "0.2", "--printer", "fine.toml",
       "--resin", "dyed.toml", "--mode", "layerwise", "--exposure-s", "1.7"},
      {"--even-oxygen"});
  bad(2, correct(kWith + Command{"--oxygen-margin", "0"}), {"--oxygen-margin"});
  write("two-spots.toml", std::string(kFinePrinter) + "spread = [[10.0, 0.5], [30.0, 0.5]]\n");
  bad(2,
      correct(Command{"--printer", "two-spots.toml", "--resin", "dyed.toml"} + layers +
              Command{"1.7"}),
      {"one Gaussian"});
  // Without viscosity and radii.
  std::string still;
  std::istringstream lines(resin_);
  for (std::string line; std::getline(lines, line);) {
    if (line.find("viscosity") == std::string::npos && line.find("radius") == std::string::npos) {
      still += line + "\n";
    }
  }
  write("still.toml", still);
  bad(2,
      correct(Command{"--printer", "fine.toml", "--resin", "still.toml"} + layers + Command{"1.7"}),
      {"diffuse"});
  std::string pure = resin_;
  const std::string oxygen = "oxygen_mol_l = 0.26e-3";
  pure.replace(pure.find(oxygen), oxygen.size(), "oxygen_mol_l = 0");
  write("pure.toml", pure);
  bad(2,
      correct(Command{"--printer", "fine.toml", "--resin", "pure.toml"} + layers + Command{"1.7"}),
      {"oxygen_mol_l"});
}

}  // namespace
}  // namespace slicecorr::test
