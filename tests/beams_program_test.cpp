// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicecorr beams` as people run it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "beams_parts.hpp"
#include "ladder.hpp"
#include "run_program.hpp"
#include "slicecorr/tomo/beams_job.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

class BeamsProgram : public testing::Test {
 protected:
  void SetUp() override {
    printer(0);
    resin(0.2);
    write_npy(path("lattice.npy"), test::lattice_part());
    write_npy(path("ball.npy"), test::ball_part(8));
    write_npy(path("octants.npy"), test::octants_part());
    write_npy(path("hollow.npy"), test::hollow_part());
  }
  /// Light of its black pixels, of 10 at full level.
  void printer(double black_mw_cm2) const {
    write("printer.toml", fmt::format(R"(name = "plain"
[display]
width_px = 128
height_px = 128
pixel_um = 50
[blue]
wavelength_nm = 405
calibration = [[0, {:.1f}], [255, 10.0]]
)",
                                      black_mw_cm2));
  }
  /// Absorption per cm.
  void resin(double per_cm) const {
    write("resin.toml", fmt::format(R"(name = "resin"
[cure]
model = "gel-time"
absorption_per_cm = {}
gel_a_mj_cm2 = 119.238
gel_b_sqrt_mw_cm2_s = 4.82633
dose_factor = 1
)",
                                    per_cm));
  }
  void write(const std::string& name, const std::string& text) const {
    test::write_file(path(name), test::to_bytes(text));
  }
  std::string path(const std::string& name) const { return folder_ / name; }
  test::RunResult run(const std::string& volume, std::vector<std::string> more = {},
                      const std::string& voxel_mm = "0.1") const {
    std::vector<std::string> words{SLICECORR_BIN_DIR "/slicecorr",
                                   "beams",
                                   "--volume",
                                   path(volume + ".npy"),
                                   "--voxel-mm",
                                   voxel_mm,
                                   "--printer",
                                   path("printer.toml"),
                                   "--resin",
                                   path("resin.toml"),
                                   "-o",
                                   path("job.uvj")};
    words.insert(words.end(), more.begin(), more.end());
    return test::run_program(words);
  }
  bool written() const { return std::filesystem::exists(path("job.uvj")); }
  test::TemporaryFolder folder_;
};

TEST_F(BeamsProgram, ALatticeFromBothSides) {
  // alpha L 0.28 over 14 cells of 0.1 mm: 0.2 per mm.
  resin(2);
  const auto r = run("lattice", {"--beams", "6", "--json", "-", "--report", path("page.html"),
                                 "--dose", path("dose.npy")});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_NEAR(j["contrast"], 1.4940, 5.1e-5);
  EXPECT_NEAR(j["contrast_shown"], 1.4940, 5.1e-5);
  EXPECT_EQ(j["jaccard"], 1);
  EXPECT_EQ(j["hull_jaccard"], 1);
  EXPECT_NEAR(j["time_window_s"][0], 2.954, 5.1e-4);
  EXPECT_NEAR(j["time_window_s"][1], 4.232, 5.1e-4);
  EXPECT_EQ(j["printable"], true);
  EXPECT_THAT(r.err, HasSubstr("has no [beams]"));
  EXPECT_THAT(r.err, HasSubstr("MB of memory"));
  const BeamJob job = read_beam_job(path("job.uvj"));
  EXPECT_EQ(job.shown.displays.size(), 6U);
  EXPECT_NEAR(job.exposure_s, std::sqrt(2.954 * 4.232), 1e-3);
  const Box<float> dose = read_dose_npy(path("dose.npy"));
  const std::size_t corner = dose.at(0, 0, 0);
  // 3 pairs, each exp(-0.01) + exp(-0.27) of 10 mW/cm², of which 2 per cm are absorbed.
  EXPECT_NEAR(dose.values[corner], 30 * (std::exp(-0.01) + std::exp(-0.27)) * 2 * job.exposure_s,
              1e-2);
  const std::string page = test::to_text(test::read_file(path("page.html")));
  EXPECT_THAT(page, HasSubstr("prints as designed"));
  EXPECT_THAT(page, HasSubstr("id=\"tomo-data\""));
  for (const char* loads : {"src=\"http", "https:", "@import"}) {
    EXPECT_EQ(page.find(loads), std::string::npos) << loads;
  }
}

TEST_F(BeamsProgram, EndOnImagesLeaveTheOutsideDark) {
  const auto r = run("lattice", {"--images", "end-on", "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_TRUE(j["contrast"].is_null());
  EXPECT_TRUE(j["time_window_s"][1].is_null());
  EXPECT_EQ(j["most_outside_mw_cm2"], 0);
  EXPECT_THAT(r.err, HasSubstr("nothing else does"));
  // It is no stack, whatever its name ends in.
  const auto info = test::run_program({SLICECORR_BIN_DIR "/slicecorr", "info", path("job.uvj")});
  EXPECT_EQ(info.exit_code, 2);
  EXPECT_THAT(info.err, HasSubstr("a print with beams, not of slices"));
}

TEST_F(BeamsProgram, GreyImagesPrintWhatNoHullHas) {
  const auto hull = run("hollow", {"--json", "-"});
  EXPECT_EQ(hull.exit_code, 3);
  EXPECT_NEAR(nlohmann::json::parse(hull.out)["hull_jaccard"], 208.0 / 216, 1e-12);
  EXPECT_THAT(hull.err, HasSubstr("mark out 8 cells more than the part has"));
  EXPECT_THAT(hull.err, HasSubstr("--images grey"));
  EXPECT_FALSE(written());
  resin(1e-6);
  const auto r = run("hollow", {"--images", "grey", "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_NEAR(j["contrast"], 7.0 / 3, 0.025);
  EXPECT_EQ(j["jaccard"], 1);
  EXPECT_TRUE(written());
}

TEST_F(BeamsProgram, SaysWhatWouldDo) {
  // alpha L 0.7.
  resin(5);
  const auto dim = run("lattice");
  EXPECT_EQ(dim.exit_code, 3);
  EXPECT_THAT(dim.err, HasSubstr("absorbs 0.5 per mm; with less than 0.368"));
  EXPECT_THAT(dim.err, HasSubstr("--beams 6"));
  EXPECT_EQ(run("lattice", {"--beams", "6"}).exit_code, 0);
  resin(1e-6);
  const auto never = run("octants", {"--images", "grey", "--report", path("page.html")});
  EXPECT_EQ(never.exit_code, 3);
  EXPECT_THAT(never.err, HasSubstr("no images of these beams print this part"));
  EXPECT_THAT(test::to_text(test::read_file(path("page.html"))), HasSubstr("Why not:"));
  const auto unlit = run("ball", {"--images", "end-on"});
  EXPECT_EQ(unlit.exit_code, 3);
  EXPECT_THAT(unlit.err, HasSubstr("lie on no ray that meets nothing but part"));
  const auto late = run("lattice", {"--exposure-s", "100"});
  EXPECT_EQ(late.exit_code, 3);
  EXPECT_THAT(late.err, HasSubstr("100 s are not within the time"));
}

TEST_F(BeamsProgram, WrongInputIsRefused) {
  const auto refused = [&](const std::string& volume, std::vector<std::string> more,
                           const std::string& voxel_mm = "0.1") {
    const auto r = run(volume, std::move(more), voxel_mm);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    EXPECT_FALSE(written());
    return r.err;
  };
  EXPECT_THAT(refused("lattice", {"--beams", "5"}), HasSubstr("--beams"));
  EXPECT_THAT(refused("lattice", {"--images", "gray"}), HasSubstr("--images"));
  EXPECT_THAT(refused("lattice", {}, "1"), HasSubstr("lies beyond the edge of display 1"));
  EXPECT_THAT(refused("lattice", {"--vat-mm", "1,2,2"}), HasSubstr("take 1.4 mm along x"));
  EXPECT_THAT(refused("lattice", {"--intensity-mw-cm2", "20"}), HasSubstr("gives up to 10"));
  EXPECT_THAT(refused("lattice", {"part.stl"}), HasSubstr("expected meshes, or a volume"));
  EXPECT_THAT(refused("none", {}), HasSubstr("none.npy"));
  EXPECT_THAT(refused("lattice", {"--report", path("page.htm")}), HasSubstr(".html"));
  write_npy(path("empty.npy"), test::part_of(3, 3, 3, [](int, int, int) { return false; }));
  write_npy(path("full.npy"), test::part_of(3, 3, 3, [](int, int, int) { return true; }));
  EXPECT_THAT(refused("empty", {}), HasSubstr("no cell that is wholly part"));
  EXPECT_THAT(refused("full", {}), HasSubstr("fills all of the vat"));
}

TEST_F(BeamsProgram, BlackAndLevelsAreCounted) {
  // Black gives a fifth of full light: what three beams leave beside the part is too much for end-on
  // images no longer dark.
  printer(2);
  resin(1e-6);
  const auto r = run("lattice", {"--images", "end-on", "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_TRUE(j["contrast"].is_null());
  // A rod has its own light and the black of the two others; outside there are three of these.
  EXPECT_NEAR(j["contrast_shown"], 14.0 / 6, 1e-6);
}

TEST_F(BeamsProgram, TheSameBytesForAnyNumberOfThreads) {
  resin(1e-6);
  ASSERT_EQ(run("hollow", {"--images", "grey", "--threads", "1"}).exit_code, 0);
  const auto one = test::read_file(path("job.uvj"));
  ASSERT_EQ(run("hollow", {"--images", "grey", "--threads", "3"}).exit_code, 0);
  EXPECT_EQ(one, test::read_file(path("job.uvj")));
}

TEST_F(BeamsProgram, TheModelVatPrintsAMesh) {
  // A corner of three bars: a cube of its own size would be larger than its hull.
  const auto box = [](double x0, double y0, double z0, double x1, double y1, double z1) {
    std::string text;
    const double c[2][3] = {{x0, y0, z0}, {x1, y1, z1}};
    const int faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                              {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    for (const auto& f : faces) {
      text += "facet normal 0 0 0\nouter loop\n";
      for (const int v : f) {
        text += fmt::format("vertex {} {} {}\n", c[v & 1][0], c[v >> 1 & 1][1], c[v >> 2 & 1][2]);
      }
      text += "endloop\nendfacet\n";
    }
    return text;
  };
  write("cube.stl", "solid cube\n" + box(0, 0, 0, 2, 2, 2) + "endsolid\n");
  const auto r = test::run_program({SLICECORR_BIN_DIR "/slicecorr", "beams", path("cube.stl"),
                                    "--voxel-mm", "0.1", "--printer", "model-beam-vat", "--resin",
                                    "model-beam-resin", "-o", path("job.uvj"), "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_EQ(j["cells"], nlohmann::json({100, 100, 100}));
  EXPECT_EQ(j["beams"].size(), 6U);
  EXPECT_EQ(j["part_cells"], 8000);
  EXPECT_EQ(j["hull_jaccard"], 1);
  EXPECT_GT(j["contrast"], 2.9);
}

TEST_F(BeamsProgram, GreyImagesReachWhatHighsFinds) {
  constexpr const char* kPython = "/usr/bin/python3";
  // To look for it takes a tenth of what importing it does.
  if (test::run_program({kPython, "-c",
                         "import importlib.util, sys\n"
                         "sys.exit(importlib.util.find_spec('scipy') is None)"})
          .exit_code != 0) {
    GTEST_SKIP() << "SciPy is not installed (scripts/setup --all)";
  }
  // alpha of 0.02 a cell of 0.1 mm.
  resin(2);
  // A cup with a foot, on no symmetry's side.
  write_npy(path("cup.npy"), test::part_of(13, 11, 12, [](int x, int y, int z) {
              const int u = x - 6, v = y - 5, r = u * u + v * v;
              return z == 1 ? r < 16 : z < 5 ? r < 3 : z < 11 && r < 24 && (z == 5 || r >= 12);
            }));
  const auto best = test::run_program(
      {kPython, SLICECORR_SOURCE_DIR "/tests/beams_linprog.py", path("cup.npy"), "0.02", "3", "6"});
  ASSERT_EQ(best.exit_code, 0) << best.err;
  std::istringstream bests(best.out);
  for (const char* beams : {"3", "6"}) {
    double most = 0;
    ASSERT_TRUE(bests >> most) << best.out;
    const auto r = run(
        "cup", {"--images", "grey", "--beams", beams, "--json", "-", "--report", path("c.html")});
    const auto j = nlohmann::json::parse(r.out, nullptr, false);
    ASSERT_TRUE(j.is_object()) << r.err;
    EXPECT_LE(j["contrast"].get<double>(), most * (1 + 1e-4));
    EXPECT_GE(j["contrast"].get<double>(), most * 0.98);
    EXPECT_GE(j["contrast_bound"].get<double>(), most * (1 - 1e-4));
  }
}

TEST_F(BeamsProgram, CommandsOfThePageRun) {
  test::write_stl(path("part.stl"), test::ladder());
  std::istringstream lines(test::to_text(test::read_file(SLICECORR_SOURCE_DIR "/docs/beams.md")));
  test::RunOptions options;
  options.folder = folder_.path();
  int commands = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("    slicecorr ", 0) != 0) continue;
    ++commands;
    const auto r = test::run_program(
        {"/bin/sh", "-c", std::string(SLICECORR_BIN_DIR) + "/" + line.substr(4)}, options);
    EXPECT_EQ(r.exit_code, 0) << line << "\n" << r.err;
  }
  EXPECT_EQ(commands, 1);
  EXPECT_TRUE(written());
  EXPECT_TRUE(std::filesystem::exists(path("part.html")));
}

}  // namespace
}  // namespace slicecorr::tomo
