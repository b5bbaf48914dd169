// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies and what is trapped through the programs: parts that end in the vat, archives with blank
/// slices, cups and sealed boxes; what is told, counted and refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "ladder.hpp"
#include "memory_slices.hpp"
#include "program_fixture.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

const Command kSmall{"--printer", "small.toml", "--resin", "figure-2-2", "--speed-mm-h", "1000"};

class BodiesProgram : public ProgramFixture {
 protected:
  BodiesProgram() {
    write("small.toml", kSmallPrinter);
    TriangleMesh floating;
    add_box(floating, {0, 0, 0}, {4, 4, 1});
    add_box(floating, {1, 1, 3}, {3, 3, 5});
    write_stl(folder_ / "floating.stl", floating);
    write_stl(folder_ / "sealed.stl", hollow({0.5, 0.5, 0.5}, {3.5, 3.5, 2.5}));
    write_stl(folder_ / "ladder.stl", ladder());
  }
  /// A box of 4 x 4 x 3 mm with a hollow.
  static TriangleMesh hollow(const Point3& low, const Point3& high) {
    TriangleMesh mesh;
    add_box(mesh, {0, 0, 0}, {4, 4, 3});
    const std::size_t outer = mesh.triangles.size();
    add_box(mesh, low, high);
    for (std::size_t t = outer; t < mesh.triangles.size(); ++t) {
      std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
    }
    return mesh;
  }
  json read(const std::string& name) const {
    return json::parse(to_text(read_file(folder_ / name)));
  }
  json info(const std::string& name) const {
    return json::parse(good({"info", name, "--json", "-"}).out);
  }
  /// Slices of a block on the platform, 20 of 50 um, as an archive.
  void write_blocks(const std::string& name, int first, int blank) const {
    Grid grid{kSmallWidth, kSmallHeight, 20, 50, 50, 50};
    MemorySlices slices(grid);
    for (int n = first; n < grid.layers; ++n) {
      if (n == blank) continue;
      for (int y = 30; y < 90; ++y) {
        for (int x = 40; x < 120; ++x) slices.at(n, x, y) = 255;
      }
    }
    write_target(slices, StackFile(folder_ / name));
  }
};

TEST_F(BodiesProgram, ACubeThatFloatsIsToldEverywhere) {
  const RunResult run = good(
      Command{"run", "floating.stl", "-o", "f.uvj", "--layer-um", "50", "--threads", "1"} + kSmall);
  EXPECT_THAT(run.err, HasSubstr("1 body hangs on nothing when it begins: from 3000 um on"));
  EXPECT_THAT(run.err, HasSubstr("never joined"));
  EXPECT_THAT(run.err, HasSubstr("loose bodies"));
  // When what uncorrected light prints hangs on nothing is not followed: the column has a dash.
  EXPECT_THAT(run.err, ContainsRegex("begin hanging on nothing +- +1\n"));
  const json f = read("f.json");
  EXPECT_TRUE(f["in_time"]);
  EXPECT_FALSE(f["uncorrected"]["in_time"]);
  EXPECT_EQ(f["loose_bodies"], 1);
  ASSERT_EQ(f["islands"].size(), 1U);
  const json& island = f["islands"][0];
  EXPECT_EQ(island["first_um"], 3000);
  EXPECT_TRUE(island["until_um"].is_null());
  // The edge of the cube lies within a level of its place: no voxel is off.
  EXPECT_NEAR(island["volume_mm3"].get<double>(), 8, 1e-9);
  // The plate is in the middle of the display of 8 x 6 mm.
  EXPECT_NEAR(island["x_mm"].get<double>(), 4, 1e-9);
  EXPECT_NEAR(island["y_mm"].get<double>(), 3, 1e-9);
  EXPECT_TRUE(f["sealed_cavities"].empty());
  EXPECT_TRUE(f["cups"].empty());
  EXPECT_EQ(f["designed"]["loose_bodies"], 1);
  // Light falls by less than sqrt(2) in 4 slices of a 40th of an absorbance height, by more in 8.
  EXPECT_EQ(f["in_time"], true);
  EXPECT_EQ(f["time_step_um"], 200);
  EXPECT_EQ(f["uncorrected"]["loose_bodies"], 1);
  EXPECT_THAT(to_text(read_file(folder_ / "f.html")), HasSubstr("What hangs on nothing"));

  // Slice by slice it is the same, for any number of threads.
  good({"slice", "floating.stl", "-o", "d.uvj", "--layer-um", "50", "--printer", "small.toml"});
  const json by_verify = figures("f.uvj", "d.uvj", {"--threads", "8"});
  for (const char* key : {"loose_bodies", "islands", "sealed_cavities", "cups", "designed"}) {
    EXPECT_EQ(by_verify[key], f[key]) << key;
  }
  const json corrected =
      json::parse(good(Command{"correct", "d.uvj", "-o", "c.uvj", "--json", "-"} + kSmall).out);
  EXPECT_EQ(corrected["islands"], f["islands"]);
  const json said = info("d.uvj");
  EXPECT_EQ(said["loose_bodies"], 1);
  // The light of the print gels it when its lower slices have passed; of images nobody knows light.
  json gelled = f["islands"];
  EXPECT_GT(gelled[0]["begins_um"], 3000);
  gelled[0]["begins_um"] = 3000.0;
  EXPECT_EQ(said["islands"], gelled);
  EXPECT_THAT(good({"info", "d.uvj"}).out, HasSubstr("by the images alone"));
  EXPECT_TRUE(info("c.uvj")["loose_bodies"].is_null());
  EXPECT_THAT(good({"info", "c.uvj"}).out, HasSubstr("not said by light"));
  const RunResult plan = good({"plan", "floating.stl", "--layer-um", "50", "--printer",
                               "small.toml", "--resin", "figure-2-2"});
  EXPECT_THAT(plan.err, HasSubstr("1 body hangs on nothing"));
  const json compared = json::parse(
      good(Command{"compare", "floating.stl", "--layer-um", "50", "--json", "-"} + kSmall).out);
  EXPECT_EQ(compared["ours"]["loose_bodies"], 1);

  // Counted, and refused where that is asked for.
  const Command verify{"verify", "f.uvj", "--target", "d.uvj", "--max-loose-bodies"};
  good(verify + Command{"1"});
  bad(5, verify + Command{"0"}, {"1 body never hangs on the platform, allowed are 0"});
  bad(2, verify + Command{"-1"}, {"--max-loose-bodies"});
  bad(3,
      Command{"run", "floating.stl", "-o", "r.uvj", "--layer-um", "50", "--loose", "refuse"} +
          kSmall,
      {"1 body hangs on nothing"});
  bad(3, Command{"correct", "d.uvj", "-o", "r.uvj", "--loose", "refuse"} + kSmall,
      {"1 body hangs on nothing"});
  bad(2, Command{"correct", "d.uvj", "-o", "r.uvj", "--loose", "maybe"} + kSmall, {"--loose"});
  good(Command{"correct", "d.uvj", "-o", "r.uvj", "--loose", "tell"} + kSmall);
}

TEST_F(BodiesProgram, WhatHangsIsNoWordWorth) {
  const RunResult run =
      good(Command{"run", "ladder.stl", "-o", "l.uvj", "--layer-um", "50", "--loose", "refuse"} +
           kSmall);
  EXPECT_THAT(run.err, Not(HasSubstr("hangs on nothing")));
  const json f = read("l.json");
  EXPECT_EQ(f["loose_bodies"], 0);
  EXPECT_TRUE(f["islands"].empty());
  EXPECT_EQ(f["designed"]["loose_bodies"], 0);
}

TEST_F(BodiesProgram, ANeckIsInTheVerdict) {
  TriangleMesh neck;
  add_box(neck, {0, 0, 0}, {4, 4, 1});
  add_box(neck, {1.75, 1.75, 1}, {2.25, 2.25, 1.5});
  add_box(neck, {1, 1, 1.5}, {3, 3, 3});
  write_stl(folder_ / "neck.stl", neck);
  const auto run = [&](const char* least_mm2) {
    return good(Command{"run", "neck.stl", "-o", "n.uvj", "--layer-um", "50", "--least-neck-mm2",
                        least_mm2} +
                kSmall)
        .err;
  };
  EXPECT_THAT(run("1"), HasSubstr("to look at: 1 body hangs by less than 1 mm²."));
  EXPECT_THAT(run("0.2"), Not(HasSubstr("hangs by less")));
  // 4 x 4 mm at most: by 17 mm² nothing is judged, which is told, and refused where loose bodies are.
  EXPECT_THAT(run("17"), HasSubstr("no body is as wide as the 17 mm² by which each is to hang"));
  const RunResult refused =
      run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "run", "neck.stl", "-o", "r.uvj",
                          "--layer-um", "50", "--least-neck-mm2", "17", "--loose", "refuse"} +
                      kSmall,
                  options_);
  EXPECT_EQ(refused.exit_code, 3) << refused.err;
  EXPECT_THAT(refused.err,
              HasSubstr("the widest has 16 mm² in a slice, so that none was judged by it"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "r.uvj"));
}

// What options say of a stack that is there already is told or refused, not dropped.
TEST_F(BodiesProgram, OptionsThatChangeNothingOfAStackAreNamed) {
  good({"slice", "ladder.stl", "-o", "options.uvj", "--layer-um", "50", "--printer", "small.toml"});
  const Command correct = Command{"correct", "options.uvj", "-o", "x.uvj"} + kSmall;
  for (const Command& lies :
       {Command{"--scale", "2"}, Command{"--units", "inch"}, Command{"--fit-mm", "3"},
        Command{"--rotate-deg", "0", "0", "90"}, Command{"--center-mm", "1", "1"}}) {
    bad(2, correct + lies, {lies.front() + " says how meshes lie"});
  }
  bad(2, correct + Command{"--design", "ladder.stl"}, {"expected --region with it"});
  bad(2, correct + Command{"--layer-um", "20"},
      {"says layers of 50 um", "expected it not to be given"});
  bad(2, correct + Command{"--rounds", "3"}, {"--rounds changes nothing where no light spreads"});
  bad(2, correct + Command{"--spread-correction", "off"}, {"--spread-correction changes nothing"});
  bad(2, correct + Command{"--platform-features", "uncapped"}, {"expected --omega-max with it"});
  good(correct + Command{"--layer-um", "50"});
  const RunResult verify =
      good({"verify", "x.uvj", "--target", "options.uvj", "--omega-max", "2", "--loose", "refuse"});
  for (const char* said : {"--omega-max", "--loose"}) {
    EXPECT_THAT(verify.err, HasSubstr(std::string(said) +
                                      " says how a part is corrected: this stack is, and it "
                                      "changes nothing"));
  }
  bad(2, {"verify", "x.uvj", "--target", "options.uvj", "--scale", "2"},
      {"--scale says how meshes lie"});
  bad(2, {"solid", "x.uvj", "-o", "x.stl", "--scale", "2"}, {"--scale says how meshes lie"});
}

TEST_F(BodiesProgram, InfoCountsWhatIsInsideOutAsItPrints) {
  TriangleMesh mesh;
  add_box(mesh, {0, 0, 0}, {6, 6, 6});
  add_box(mesh, {3, 3, 2}, {9, 9, 8});
  for (std::size_t t = 12; t < 24; ++t) std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
  write_stl(folder_ / "inside-out.stl", mesh);
  // Two cubes of 6 mm that share 3 x 3 x 4 mm, by slices of which one may be cut at an edge.
  const json said = info("inside-out.stl");
  EXPECT_EQ(said["defects"]["inside_out_bodies"], 1);
  EXPECT_NEAR(said["volume_ml"].get<double>(), 2 * 0.216 - 0.036, 0.001);
}

TEST_F(BodiesProgram, BlankSlicesCutLoose) {
  write_blocks("behind.sl1", 10, -1);
  json said = info("behind.sl1");
  EXPECT_EQ(said["loose_bodies"], 1);
  EXPECT_EQ(said["islands"][0]["first_um"], 500);
  write_blocks("middle.sl1", 0, 8);
  said = info("middle.sl1");
  EXPECT_EQ(said["loose_bodies"], 1);
  EXPECT_EQ(said["islands"][0]["first_um"], 450);
  EXPECT_NEAR(said["islands"][0]["volume_mm3"].get<double>(), 4 * 3 * 11 * 0.05, 1e-9);
  for (const char* name : {"behind.sl1", "middle.sl1"}) {
    const RunResult r = good(Command{"correct", name, "-o", "x.uvj", "--json", "x.json"} + kSmall);
    EXPECT_THAT(r.err, HasSubstr("1 body hangs on nothing")) << name;
    EXPECT_EQ(read("x.json")["loose_bodies"], 1) << name;
    EXPECT_EQ(read("x.json")["designed"]["loose_bodies"], 1) << name;
  }
  write_blocks("whole.sl1", 0, -1);
  EXPECT_EQ(info("whole.sl1")["loose_bodies"], 0);
}

TEST_F(BodiesProgram, SealedBoxesAndCupsAreToldApart) {
  const auto run = [&](const char* name) {
    const RunResult r = good(Command{"run", name, "-o", "x.uvj", "--layer-um", "50"} + kSmall);
    json f = read("x.json");
    f["told"] = r.err;
    return f;
  };
  const json sealed = run("sealed.stl");
  ASSERT_EQ(sealed["sealed_cavities"].size(), 1U);
  EXPECT_NEAR(sealed["sealed_cavities"][0]["volume_mm3"].get<double>(), 18, 1e-9);
  EXPECT_EQ(sealed["sealed_cavities"][0]["first_um"], 500);
  EXPECT_EQ(sealed["sealed_cavities"][0]["last_um"], 2500);
  ASSERT_EQ(sealed["cups"].size(), 1U);
  EXPECT_NEAR(sealed["cups"][0]["area_mm2"].get<double>(), 9, 1e-9);
  EXPECT_EQ(sealed["cups"][0]["closes_um"], 2500);
  EXPECT_THAT(sealed["told"].get<std::string>(), HasSubstr("1 sealed cavity keeps resin"));

  // The hollow reaches beyond the box: open there.
  write_stl(folder_ / "cup.stl", hollow({0.5, 0.5, 0.5}, {3.5, 3.5, 3}));
  write_stl(folder_ / "bell.stl", hollow({0.5, 0.5, 0}, {3.5, 3.5, 2.5}));
  const json cup = run("cup.stl");
  EXPECT_TRUE(cup["sealed_cavities"].empty());
  ASSERT_EQ(cup["cups"].size(), 1U);
  EXPECT_NEAR(cup["cups"][0]["area_mm2"].get<double>(), 9, 1e-9);
  EXPECT_TRUE(cup["cups"][0]["closes_um"].is_null());
  EXPECT_EQ(cup["cups"][0]["until_um"], 3000);
  EXPECT_THAT(cup["told"].get<std::string>(), HasSubstr("1 cup pulls at the window: 9 mm² wide"));
  const json bell = run("bell.stl");
  EXPECT_TRUE(bell["sealed_cavities"].empty());
  ASSERT_EQ(bell["cups"].size(), 1U);
  EXPECT_EQ(bell["cups"][0]["closes_um"], 2500);
  EXPECT_EQ(bell["loose_bodies"], 0);

  // `flow` says the same of what it finds.
  write("thick.toml",
        "name = \"thick\"\nviscosity_pa_s = 0.3\n[cure]\nabsorbance_height_um = 500\n"
        "absorbance_base = \"e\"\ngel_dose_mj_cm2 = 10\n");
  const auto kind = [&](const char* part) {
    const json f = json::parse(good({"flow", part, "--layer-um", "50", "--printer", "small.toml",
                                     "--resin", "thick.toml", "--speed-mm-h", "100", "--json", "-"})
                                   .out);
    EXPECT_EQ(f["blind"].size(), 1U) << part;
    return f["blind"][0]["kind"].get<std::string>();
  };
  EXPECT_EQ(kind("sealed.stl"), "sealed");
  EXPECT_EQ(kind("cup.stl"), "cup");
  EXPECT_EQ(kind("bell.stl"), "cup");
}

}  // namespace
}  // namespace slicecorr::test
