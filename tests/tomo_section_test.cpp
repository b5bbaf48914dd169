// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Prints cut open: which voxels are shown, where lines run, and the program that draws them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/section.hpp"
#include "stack_fixture.hpp"
#include "tomo_definitions.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

/// A grid of 1 mm voxels, 3 slices of 21 x 21.
struct Grid {
  Box<float> dose{3, 21, 21, std::vector<float>(3 * 21 * 21)};
  Box<std::uint8_t> part{3, 21, 21, std::vector<std::uint8_t>(3 * 21 * 21)};
  Box<std::uint8_t> insert;
  std::vector<PrintSection> cut(const std::vector<Plane>& planes) const {
    return sections_of(dose, part, insert, 1, 10, planes);
  }
};

std::vector<std::uint8_t> bytes_of(const std::string& text) { return {text.begin(), text.end()}; }

TEST(TomoSection, PlanesShowTheVoxelsWhereTheyAre) {
  Grid g;
  // Part at x 3, y -2, z +1, and on the axis in the middle slice; gelled void at x -4.
  g.part.values[g.part.at(2, 8, 13)] = 255;
  g.part.values[g.part.at(1, 10, 10)] = 255;
  g.dose.values[g.dose.at(1, 10, 10)] = 10;
  g.dose.values[g.dose.at(2, 8, 6)] = 10.5F;
  g.dose.values[g.dose.at(2, 8, 13)] = 9.99F;
  const auto s = g.cut({{Axis::x, 3.4}, {Axis::y, -2}, {Axis::z, 0.8}, {Axis::z, 0}});
  ASSERT_EQ(s.size(), 4U);
  // All of z, x from -4 to 3 and y from -2 to 0, two voxels around.
  EXPECT_EQ(s[0].at_mm, 3);
  EXPECT_EQ(s[0].width, 7);
  EXPECT_EQ(s[0].height, 3);
  EXPECT_EQ(s[1].width, 12);
  EXPECT_EQ(s[1].height, 3);
  EXPECT_EQ(s[2].at_mm, 1);
  EXPECT_EQ(s[2].width, 12);
  EXPECT_EQ(s[2].height, 7);
  const auto at = [](const PrintSection& p, int row, int column) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(p.width) +
           static_cast<std::size_t>(column);
  };
  EXPECT_EQ(s[0].target[at(s[0], 2, 2)], 255);  // y -2 is the third column, z +1 the upper row
  EXPECT_EQ(s[1].target[at(s[1], 2, 9)], 255);  // x from -6: 3 is the tenth
  EXPECT_EQ(s[1].dose[at(s[1], 2, 2)], 10.5F);
  EXPECT_EQ(s[2].target[at(s[2], 2, 9)], 255);  // y from -4: -2 is the third row
  for (const std::size_t k : {0U, 1U, 2U}) {
    EXPECT_EQ(s[k].missing(), 1U) << k;
    EXPECT_EQ(s[k].gelled(), k == 0 ? 0U : 1U) << k;
  }
  // Exactly at the gel dose it gels.
  EXPECT_EQ(s[3].missing(), 0U);
  EXPECT_EQ(s[3].gelled(), 0U);
}

TEST(TomoSection, InsertsAndWhatIsBesideTheResinAreNotJudged) {
  Grid g;
  g.insert = {3, 21, 21, std::vector<std::uint8_t>(3 * 21 * 21)};
  std::fill(g.dose.values.begin(), g.dose.values.end(), 20.0F);
  g.insert.values[g.insert.at(1, 10, 12)] = 1;
  const auto s = g.cut({{Axis::z, 0}});
  EXPECT_EQ(s[0].width, 21);
  std::size_t resin = 0;
  for (int y = -10; y <= 10; ++y) {
    for (int x = -10; x <= 10; ++x) resin += x * x + y * y <= 100;
  }
  EXPECT_EQ(s[0].gelled(), resin - 1);
  EXPECT_EQ(std::count(s[0].matter.begin(), s[0].matter.end(), Matter::insert), 1);
  EXPECT_EQ(s[0].matter[0], Matter::nothing);
}

TEST(TomoSection, PlanesOutsideAreRefused) {
  const Grid g;
  for (const auto& [plane, words] : {std::pair{Plane{Axis::x, 10.6}, "x = 10.6 mm"},
                                     {Plane{Axis::z, -1.6}, "-1.500 to 1.500"}}) {
    try {
      g.cut({plane});
      FAIL();
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(words));
    }
  }
  EXPECT_EQ(g.cut({{Axis::x, 10.4}})[0].at_mm, 10);
}

TEST(TomoSection, TheGelLineLiesWhereTheDoseCrossesIt) {
  // Dose rises by 1 per mm along x, from 0 at x = -10: 10 is reached at x = 0, 12.25 at 2.25.
  Grid g;
  for (int z = 0; z < 3; ++z) {
    for (int y = 0; y < 21; ++y) {
      for (int x = 0; x < 21; ++x) g.dose.values[g.dose.at(z, y, x)] = static_cast<float>(x);
    }
  }
  std::fill(g.part.values.begin(), g.part.values.end(), std::uint8_t{255});
  const auto sections = sections_of(g.dose, g.part, {}, 1, 12.25, {{Axis::y, 0}});
  const std::string svg = sections_svg(sections, ColouredBy::dose, "a <title>");
  EXPECT_THAT(svg, HasSubstr("a &lt;title&gt;"));
  // 21 voxels at 21 pixels each, from x 16 on: the line is at 16 + (12.25 + 0.5) 21 = 283.75.
  const std::string mark = "stroke=\"#1b1f24\"";
  const auto end = svg.find(mark);
  ASSERT_NE(end, std::string::npos);
  const auto begin = svg.rfind("d=\"", end) + 3;
  std::string path = svg.substr(begin, svg.find('"', begin) - begin);
  int points = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (path[i] != 'M' && path[i] != 'L') continue;
    double x = 0, y = 0;
    ASSERT_EQ(std::sscanf(path.c_str() + i + 1, "%lf %lf", &x, &y), 2);
    EXPECT_EQ(x, 283.75);
    ++points;
  }
  EXPECT_GE(points, 3);
}

TEST(TomoSection, AWrongVoxelIsSeenHoweverSmallThePicture) {
  const int n = 2001;
  Box<float> dose{1, n, n, std::vector<float>(static_cast<std::size_t>(n) * n)};
  Box<std::uint8_t> part{1, n, n, std::vector<std::uint8_t>(static_cast<std::size_t>(n) * n, 100)};
  // Darker than grey gel and paler than ink: only what is hatched.
  const auto hatched = [&] {
    const auto sections = sections_of(dose, part, {}, 1, 10, {{Axis::z, 0}});
    const auto png = bytes_of(sections_png(sections, ColouredBy::print, "large"));
    const auto be = [&](std::size_t at) {
      return (png[at] << 24) + (png[at + 1] << 16) + (png[at + 2] << 8) + png[at + 3];
    };
    const GreyImage image = decode_png(png, be(16), be(20), "picture", "");
    EXPECT_LT(image.width_px, 2400);
    // Files have two pixels along each side of one; rims of letters have such greys, too, but not four
    // alike.
    const auto wide = static_cast<std::size_t>(image.width_px);
    std::ptrdiff_t seen = 0;
    for (std::size_t row = 0; row + 1 < image.pixels.size() / wide; row += 2) {
      for (std::size_t at = row * wide; at + 1 < (row + 1) * wide; at += 2) {
        const std::uint8_t v = image.pixels[at];
        const bool alike = image.pixels[at + 1] == v && image.pixels[at + wide] == v &&
                           image.pixels[at + wide + 1] == v;
        seen += alike && v > 55 && v < 110 ? 1 : 0;
      }
    }
    return seen;
  };
  const auto none = hatched();
  for (const std::vector<int>& wrong : {std::vector{700, 1000}, {703}}) {
    for (const int x : wrong) {
      part.values[part.at(0, 1234, x)] = 0;
      dose.values[dose.at(0, 1234, x)] = 10;
    }
    EXPECT_EQ(hatched(), none + static_cast<std::ptrdiff_t>(wrong.size())) << wrong.front();
    for (const int x : wrong) {
      part.values[part.at(0, 1234, x)] = 100;
      dose.values[dose.at(0, 1234, x)] = 0;
    }
  }
}

class TomoSectionProgram : public ::testing::Test {
 protected:
  void SetUp() override { write_job(path("a.frames"), random_job(dry_printer(), 3, 24)); }
  std::string path(const std::string& name) const { return folder_ / name; }
  test::RunResult call(std::vector<std::string> words) const {
    test::RunOptions options;
    options.folder = folder_.path();
    words.insert(words.begin(), {SLICECORR_BIN_DIR "/slicecorr", "tomo", "section"});
    return test::run_program(words, options);
  }
  test::TemporaryFolder folder_;
};

TEST_F(TomoSectionProgram, DrawsWhatItIsAsked) {
  const test::RunResult all = call({"a.frames", "-o", "a.svg"});
  ASSERT_EQ(all.exit_code, 0) << all.err;
  const auto svg = test::read_file(path("a.svg"));
  const std::string text(svg.begin(), svg.end());
  for (const char* words :
       {"x = 0.000 mm", "y = 0.000 mm", "z = 0.000 mm", "mJ/cm³", " mm</text>"}) {
    EXPECT_THAT(text, HasSubstr(words));
  }
  EXPECT_THAT(all.err, HasSubstr("voxels missing"));
  // The same bytes, whatever the threads.
  ASSERT_EQ(call({"a.frames", "-o", "b.svg", "--threads", "1"}).exit_code, 0);
  EXPECT_EQ(test::read_file(path("b.svg")), svg);
  for (const char* show : {"dose", "print", "target"}) {
    ASSERT_EQ(call({"a.frames", "-o", "a.png", "--x-mm", "1", "--show", show}).exit_code, 0);
    EXPECT_EQ(test::read_file(path("a.png"))[1], 'P');
  }
}

TEST_F(TomoSectionProgram, WrongUseIsToldByName) {
  const auto refused = [&](const std::vector<std::string>& words) {
    const test::RunResult r = call(words);
    EXPECT_EQ(r.exit_code, 2);
    return r.err;
  };
  EXPECT_THAT(refused({"a.frames", "-o", "a.gif"}), HasSubstr(".png or .svg"));
  EXPECT_THAT(refused({"a.frames", "-o", "a.png", "--z-mm", "9"}), HasSubstr("z = 9 mm"));
  EXPECT_THAT(refused({"a.frames", "-o", "a.png", "--z-mm", "nan"}), HasSubstr("--z-mm"));
  EXPECT_THAT(refused({"a.frames", "-o", "a.png", "--show", "light"}), HasSubstr("--show"));
  EXPECT_THAT(refused({"none.frames", "-o", "a.png"}), HasSubstr("none.frames"));
  EXPECT_FALSE(std::filesystem::exists(path("a.png")));
  std::filesystem::copy_file(path("a.frames"), path("a.svg"));
  EXPECT_THAT(refused({"a.svg", "-o", "a.svg"}), HasSubstr("a.svg"));
}

/// Far too dark on the axis: alpha R is 3.2.
struct Dark {
  Printer printer = bench_printer();
  Resin resin = bench_resin(8);
  Box<std::uint8_t> part{3, 33, 33, std::vector<std::uint8_t>(3 * 33 * 33)};
  Dark() {
    // The slice in the middle is a ring, the lowest has a few voxels only.
    for (int y = 9; y < 24; ++y) {
      for (int x = 9; x < 24; ++x) {
        part.values[part.at(2, y, x)] = 255;
        part.values[part.at(1, y, x)] = y < 12 || y > 20 || x < 12 || x > 20 ? 255 : 0;
      }
    }
    part.values[part.at(0, 16, 4)] = 255;
  }
};

TEST(TomoEvidence, IsTheSliceThatTheBoundIsOf) {
  const Dark d;
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.98};
  int calls = 0;
  Evidence e;
  options.evidence = [&](const Evidence& evidence) {
    e = evidence;
    ++calls;
  };
  std::string words;
  try {
    solve_print(d.part, 0.25, d.printer, d.resin, options);
  } catch (const InfeasibleError& error) {
    words = error.what();
  }
  ASSERT_EQ(calls, 1) << words;
  EXPECT_EQ(e.slice, 2);
  EXPECT_THAT(words, HasSubstr("in slice 2"));
  EXPECT_EQ(e.z_mm, 0.25);
  EXPECT_LT(e.bound, 1);
  EXPECT_TRUE(e.insert.values.empty());
  for (int y = 0; y < 33; ++y) {
    for (int x = 0; x < 33; ++x) {
      ASSERT_EQ(e.part.values[e.part.at(0, y, x)], d.part.values[d.part.at(2, y, x)]);
    }
  }
  // Both ways it is wrong, by the same factor.
  const PrintSection s = section_of(e);
  EXPECT_GT(s.missing(), 0U);
  EXPECT_GT(s.gelled(), 0U);
  double least = 1e9, most = 0;
  for (std::size_t k = 0; k < s.dose.size(); ++k) {
    if (s.target[k] == 255) least = std::min<double>(least, s.dose[k]);
    if (s.target[k] == 0) most = std::max<double>(most, s.dose[k]);
  }
  EXPECT_NEAR(least * most, 1, 1e-6);
  EXPECT_LT(least / most, e.bound);
}

class TomoInfeasibleProgram : public TomoSectionProgram {
 protected:
  void SetUp() override {
    TomoSectionProgram::SetUp();
    write_npy(path("part.npy"), Dark().part);
    test::write_file(path("bench.toml"), test::to_bytes(test::bench_printer_toml()));
    test::write_file(path("resin.toml"), test::to_bytes(test::bench_resin_toml("8")));
  }
  test::RunResult solve(const std::vector<std::string>& more) const {
    test::RunOptions options;
    options.folder = folder_.path();
    std::vector<std::string> words{SLICECORR_BIN_DIR "/slicecorr",
                                   "--quiet",
                                   "tomo",
                                   "solve",
                                   "--volume",
                                   "part.npy",
                                   "--voxel-mm",
                                   "0.25",
                                   "--printer",
                                   "bench.toml",
                                   "--resin",
                                   "resin.toml",
                                   "-o",
                                   "b.frames",
                                   "--angles",
                                   "60"};
    words.insert(words.end(), more.begin(), more.end());
    return test::run_program(words, options);
  }
};

TEST_F(TomoInfeasibleProgram, DrawsWhereAPartFails) {
  const test::RunResult usual = solve({});
  EXPECT_EQ(usual.exit_code, 3);
  EXPECT_THAT(usual.err, testing::AllOf(HasSubstr("no light prints this part"),
                                        HasSubstr("b.frames.infeasible.png shows that slice")));
  EXPECT_TRUE(std::filesystem::exists(path("b.frames.infeasible.png")));
  EXPECT_FALSE(std::filesystem::exists(path("b.frames")));
  const test::RunResult named = solve({"--picture", "why.svg"});
  EXPECT_EQ(named.exit_code, 3);
  const auto svg = test::read_file(path("why.svg"));
  EXPECT_THAT(std::string(svg.begin(), svg.end()),
              testing::AllOf(HasSubstr("slice 2 can't be printed"), HasSubstr("z = 0.250 mm"),
                             HasSubstr("times the gel dose")));
}

TEST_F(TomoInfeasibleProgram, PicturesThatCanNotBeAreRefusedBeforeTheSolve) {
  for (const auto& [picture, words] :
       {std::pair{"why.jpg", ".png or .svg"}, {"none/why.png", "none"}}) {
    const test::RunResult r = solve({"--picture", picture});
    EXPECT_TRUE(r.exit_code == 2 || r.exit_code == 4) << r.exit_code;
    EXPECT_THAT(r.err, HasSubstr(words));
    EXPECT_THAT(r.err, testing::Not(HasSubstr("no light prints")));
  }
  // Where a part can be printed, none is drawn.
  const test::RunResult osmo = solve({"--method", "osmo", "--iterations", "2"});
  EXPECT_EQ(osmo.exit_code, 5) << osmo.err;
  EXPECT_FALSE(std::filesystem::exists(path("b.frames.infeasible.png")));
}

}  // namespace
}  // namespace slicecorr::tomo
