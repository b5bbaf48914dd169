// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Slices of different heights in continuous exposure through the programs: a real mesh in heights that its slopes
// ask for, times that files say, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>

#include "ladder.hpp"
#include "program_fixture.hpp"
#include "real_files.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class MovedProgram : public ProgramFixture {
 protected:
  MovedProgram() {
    write("small.toml", kSmallPrinter);
    write("resin.toml",
          "name = \"plain\"\n[cure]\nmodel = \"kinetic\"\nm = 1.0\nabsorbance_height_um = 400\n"
          "absorbance_base = 10\ncritical_dose_prime = 40.0\n");
  }
  static json layers_of(const TemporaryFolder& folder, const std::string& stack) {
    Entries entries = unzip(folder / stack);
    return json::parse(to_text(entry(entries, "config.json")))["Layers"];
  }
  const Command kWith{"--printer",    "small.toml", "--resin",          "resin.toml",
                      "--speed-mm-h", "200",        "--one-slice-gaps", "merge"};
};

TEST_F(MovedProgram, ARealPartIsCorrectedInHeightsThatItsSlopesAskFor) {
  const std::string mesh = real_file("meshes/clean/ksr_fdmtest_v4.stl");
  const Command cut{"--fit-mm", "5", "--adaptive-um", "20,100"};
  good(Command{"run", mesh, "-o", "one.uvj", "--threads", "1"} + cut + kWith);
  good(Command{"slice", mesh, "-o", "target.uvj", "--printer", "small.toml"} + cut);
  good(Command{"correct", "target.uvj", "-o", "eight.uvj", "--threads", "8"} + kWith);
  EXPECT_EQ(read_file(folder_ / "one.uvj"), read_file(folder_ / "eight.uvj"));
  const json f = figures("one.uvj", "target.uvj");
  EXPECT_EQ(f["cure_through_voxels"], 0);
  EXPECT_EQ(f["undercure_voxels"], 0);
  EXPECT_EQ(f["lost_features"], 0);
  // Of 256 levels the vernier takes three before an edge: a 25th of a step of one is some 0.1 um here.
  EXPECT_LT(f["height_error_um"]["mean_abs"].get<double>(), 0.2);
  const auto heights = f["layer_um"].get<std::vector<double>>();
  const auto [least, most] = std::minmax_element(heights.begin(), heights.end());
  EXPECT_EQ(*least, 20);
  EXPECT_EQ(*most, 100);
  // 200 mm/h are 1 um in 18 ms.
  double z_um = 0;
  const json layers = layers_of(folder_, "one.uvj");
  ASSERT_EQ(layers.size(), heights.size());
  for (std::size_t n = 0; n < heights.size(); ++n) {
    z_um += heights[n];
    EXPECT_NEAR(layers[n]["Exposure"]["LightOnTime"].get<double>(), 0.018 * heights[n], 1e-6) << n;
    EXPECT_NEAR(layers[n]["Z"].get<double>(), z_um * 1e-3, 1e-6) << n;
  }
  const json told = json::parse(good({"info", "one.uvj", "--json", "-"}).out);
  EXPECT_NEAR(told["print_time_s"].get<double>(), 0.018 * z_um, 1e-3);
  EXPECT_EQ(told["layer_um"].size(), heights.size());
}

TEST_F(MovedProgram, TablesOfHeightsAndSpeedsGoTogether) {
  TriangleMesh block;
  add_box(block, {0, 0, 0}, {2, 2, 0.4});
  add_box(block, {0, 0, 1}, {2, 2, 1.6});
  write_stl(folder_ / "part.stl", block);
  write("heights.csv", "slice,layer_um\n0,40\n5,100\n9,20\n");
  write("speeds.csv", "slice,speed_mm_h\n0,100\n7,200\n");
  const RunResult r = good(Command{"run", "part.stl", "-o", "part.uvj", "--layers", "heights.csv",
                                   "--slice-speed-mm-h", "speeds.csv"} +
                           kWith);
  EXPECT_THAT(r.err, HasSubstr("edges lie at slices: the mesh's own heights are not counted"));
  const json layers = layers_of(folder_, "part.uvj");
  EXPECT_NEAR(layers[0]["Exposure"]["LightOnTime"].get<double>(), 0.036 * 40, 1e-6);
  EXPECT_NEAR(layers[6]["Exposure"]["LightOnTime"].get<double>(), 0.036 * 100, 1e-6);
  EXPECT_NEAR(layers[8]["Exposure"]["LightOnTime"].get<double>(), 0.018 * 100, 1e-6);
  EXPECT_NEAR(layers[20]["Exposure"]["LightOnTime"].get<double>(), 0.018 * 20, 1e-6);
  // Edges lie at nodes: the lower block ends at one, the upper one begins and ends at one.
  const json solid = json::parse(good({"solid", "part.uvj", "-o", "print.stl", "--json", "-"}).out);
  EXPECT_NEAR(solid["lower_mm"][2].get<double>(), 0, 1e-6);
  EXPECT_NEAR(solid["upper_mm"][2].get<double>(), 1.6, 5e-4);
  // Half a pixel is missing or too much along each side.
  EXPECT_NEAR(solid["volume_mm3"].get<double>(), 4.0, 4.0 * 2 * 0.05);
  bad(2,
      Command{"run", "part.stl", "-o", "no.uvj", "--layers", "heights.csv", "--layer-um", "50"} +
          kWith,
      {"--layers", "--layer-um"});
  bad(2, Command{"run", "part.stl", "-o", "no.uvj"} + kWith,
      {"expected the height of layers", "--adaptive-um"});
}

TEST_F(MovedProgram, WhatIsLeftAloneHasTheTargetsLayers) {
  TriangleMesh part, post;
  add_box(part, {0, 0, 0}, {2, 2, 0.4});
  add_box(post, {3, 0, 0}, {3.5, 0.5, 0.3});
  write_stl(folder_ / "part.stl", part);
  write_stl(folder_ / "post.stl", post);
  write("heights.csv", "slice,layer_um\n0,40\n5,100\n");
  good(Command{"run", "part.stl", "-o", "part.uvj", "--layers", "heights.csv", "--leave-alone",
               "post.stl"} +
       kWith);
  // 5 layers of 40 um and one of 100 um are 0.3 mm: the post is lit in these, and in no other.
  std::size_t lit = 0;
  for (const Bytes& image : images("part.uvj")) {
    // The post lies right of the part, at the lower edge of both.
    std::size_t right = 0;
    for (std::size_t i = 0; i < image.size(); ++i) {
      right += i % kSmallWidth >= 100 && image[i] == 255;
    }
    lit += right > 0;
  }
  EXPECT_EQ(lit, 6U);
  const Command slice{"slice", "part.stl", "--printer", "small.toml"};
  good(slice + Command{"-o", "even.uvj", "--layer-um", "100"});
  good(slice + Command{"-o", "uneven.uvj", "--layers", "heights.csv"});
  good(Command{"correct", "even.uvj", "-o", "made.uvj"} + kWith);
  bad(2, {"verify", "made.uvj", "--target", "uneven.uvj"},
      {"uneven.uvj", "its layer 0 is 40 um high, that of the stack 100 um"});
  good(Command{"correct", "uneven.uvj", "-o", "moved.uvj"} + kWith);
  bad(2, {"verify", "moved.uvj", "--target", "even.uvj"},
      {"even.uvj", "its layer 0 is 100 um high, that of the stack 40 um"});
  bad(2, Command{"correct", "uneven.uvj", "-o", "no.uvj", "--leave-alone", "even.uvj"} + kWith,
      {"even.uvj", "layer 0 is 100 um high, that of the target 40 um"});
}

TEST_F(MovedProgram, JobsOfTheFarmTakeHeights) {
  TriangleMesh block;
  add_box(block, {0, 0, 0}, {2, 2, 0.4});
  add_box(block, {0, 0, 1}, {2, 2, 1.6});
  write_stl(folder_ / "part.stl", block);
  write("heights.csv", "slice,layer_um\n0,40\n5,100\n9,20\n");
  const auto farm = [&](Command words, int code = 0) {
    words.insert(words.begin(), SLICECORR_BIN_DIR "/slicefarm");
    RunResult r = run_program(words + Command{"--dir", "farm"}, options_);
    EXPECT_EQ(r.exit_code, code) << ::testing::PrintToString(words) << r.out << r.err;
    return r.out + r.err;
  };
  const std::string defaults =
      "[defaults]\nprinter = \"small.toml\"\nresin = \"resin.toml\"\nspeed_mm_h = 200\n"
      "one_slice_gaps = \"merge\"\nlayer_um = 50\nout = \"out\"\n";
  write("jobs.toml",
        defaults +
            "[[job]]\npart = \"part.stl\"\nname = \"each\"\n"
            "layer_heights_um = [40, 40, 40, 40, 40, 100, 100, 100, 100, 20]\n"
            "[[job]]\npart = \"part.stl\"\nname = \"slopes\"\nadaptive_um = [20, 100]\n"
            "[[job]]\npart = \"part.stl\"\nname = \"alike\"\n");
  farm({"submit", "jobs.toml"});
  farm(Command{"submit", "part.stl", "--layers", "heights.csv", "--name", "by-table", "--out",
               "out"} +
       kWith);
  EXPECT_THAT(farm({"run", "--until-empty"}), HasSubstr("4"));
  // Byte for byte what `run` makes.
  for (const auto& [name, heights] :
       {std::pair<std::string, Command>("each", {"--layers", "heights.csv"}),
        {"by-table", {"--layers", "heights.csv"}},
        {"slopes", {"--adaptive-um", "20,100"}},
        {"alike", {"--layer-um", "50"}}}) {
    SCOPED_TRACE(name);
    good(Command{"run", "part.stl", "-o", "by-run.uvj"} + heights + kWith);
    EXPECT_EQ(read_file(folder_ / ("out/" + name + ".uvj")), read_file(folder_ / "by-run.uvj"));
    EXPECT_EQ(StackReader::read_info(folder_ / "by-run.uvj").process->layer_heights_um.empty(),
              name == "alike");
  }
  // Heights are said once, and by a mesh alone.
  good({"slice", "part.stl", "-o", "part.uvj", "--printer", "small.toml", "--layer-um", "50"});
  const auto refused = [&](const std::string& job, const char* words) {
    const bool says = job.find("part = ") != std::string::npos;
    write("wrong.toml",
          defaults + "[[job]]\n" + (says ? "" : "part = \"part.stl\"\n") + job + "\n");
    EXPECT_THAT(farm({"submit", "wrong.toml"}, 2), HasSubstr(words)) << job;
  };
  refused("layer_um = 20\nadaptive_um = [20, 100]", "layer_um and adaptive_um are both said");
  refused("layer_heights_um = [20]\nadaptive_um = [20, 100]",
          "layer_heights_um and adaptive_um are both said");
  refused("part = \"part.uvj\"\nadaptive_um = [20, 100]", "expected no adaptive_um with it");
  refused("part = \"part.uvj\"\nlayer_heights_um = [20]", "expected no layer_heights_um with it");
  refused("adaptive_um = [20]", "adaptive_um");
  // What can't be written is refused before the night, and by `run` and `slice` before the work.
  refused("adaptive_um = [20, 100]\nformat = \"sl1\"",
          "can't say that layers are of different heights; expected a format that can");
  refused("format = \"lgs\"\nmode = \"continuous\"", "only changed, not made from nothing");
  for (const Command& command : {Command{"run", "part.stl"} + kWith,
                                 Command{"slice", "part.stl", "--printer", "small.toml"}}) {
    bad(2, command + Command{"-o", "x.sl1", "--layers", "heights.csv"},
        {"x.sl1", "can't say that layers are of different heights"});
    bad(2, command + Command{"-o", "x.lgs", "--layer-um", "50"}, {"x.lgs", "made from nothing"});
  }
  refused("layer_heights_um = [0.5]", "layer 0 is 0.5 um high; expected 1 to 1000 um");
  refused("layer_heights_um = [2000]", "layer_heights_um");
  EXPECT_THAT(farm(Command{"submit", "part.stl"} + kWith, 2),
              HasSubstr("--layer-um is missing; expected it, --layers or --adaptive-um"));
  farm(Command{"submit", "part.stl", "--layer-um", "50", "--layers", "heights.csv"} + kWith, 2);
  EXPECT_THAT(farm(Command{"submit", "part.stl", "--layers", "heights.csv", "--mode", "tomography",
                           "--printer", "small.toml", "--resin", "resin.toml"},
                   2),
              HasSubstr("--layers has no place in a tomographic print"));
}

}  // namespace
}  // namespace slicecorr::test
