// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Drives the program `slicecorr` as its users do: arguments in, files, text and exit codes out.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <sys/mount.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "made_once.hpp"
#include "program_fixture.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/stack.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;

constexpr double kLn10 = 2.302585092994046;
// Figure 2.2 of the dissertation: 50 um slices, absorbance height 2000 um base 10, 576 mJ/cm³,
// 1000 mm/h, 1 to 100 mW/cm².
constexpr double kSliceUm = 50, kEta = 0.025;
const double kA = std::pow(10.0, -kEta);

struct Box {
  float x0, x1, y0, y1, z0, z1;
};

/// A binary STL of boxes.
void write_boxes(const std::string& path, const std::vector<Box>& boxes) {
  std::string text(80, ' ');
  const auto put = [&](const auto& value) {
    text.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  put(static_cast<std::uint32_t>(boxes.size() * 12));
  for (const Box& b : boxes) {
    // Corner c: bit 0 x, bit 1 y, bit 2 z.
    constexpr int sides[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                 {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const auto& q : sides) {
      for (const auto& corners : {std::array{q[0], q[1], q[2]}, std::array{q[0], q[2], q[3]}}) {
        for (int i = 0; i < 3; ++i) put(0.0F);
        for (const int c : corners) {
          put(c & 1 ? b.x1 : b.x0);
          put(c & 2 ? b.y1 : b.y0);
          put(c & 4 ? b.z1 : b.z0);
        }
        put(std::uint16_t{0});
      }
    }
  }
  write_file(path, to_bytes(text));
}

const std::vector<Box>& ladder_boxes() {
  static const std::vector<Box> boxes{{-2, -1, -1, 1, 0, 2.5F},
                                      {1, 2, -1, 1, 0, 2.5F},
                                      {-1, 1, -1, 1, .55F, 1.05F},
                                      {-1, 1, -1, 1, 1.55F, 2.05F}};
  return boxes;
}
// Columns of the ladder: through the rungs (features at slices 11-20 and 31-40), through a rail.
const Command kRungColumn{"--x", "640", "--y", "400"}, kRailColumn{"--x", "610", "--y", "400"};

/// A grid of posts with plates between them, large enough that it takes a while.
std::vector<Box> lattice(float size, float height) {
  std::vector<Box> boxes;
  for (float x = 0; x < size; x += 2) {
    for (float y = 0; y < size; y += 2) boxes.push_back({x, x + 1, y, y + 1, 0, height});
  }
  for (float z = 1; z + 1 < height; z += 2) boxes.push_back({0, size, 0, size, z, z + 1});
  return boxes;
}

struct Row {
  int slice = 0, grey = 0;
  double z_um = 0, intensity = 0, phi = 0, dose = 0, target = -1;
};

struct Edge {
  bool upper;  ///< of its feature
  int node;
};

class Cli : public ::testing::Test {
 protected:
  Cli() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", SLICECORR_DB_DIR}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    write_boxes(folder_ / "ladder.stl", ladder_boxes());
  }

  RunResult call(const Command& arguments) const { return call(arguments, options_); }
  static RunResult call(const Command& arguments, const RunOptions& options) {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr"} + arguments, options);
  }

  /// Calls it, wants exit 0, gives stdout.
  std::string good(const Command& arguments) const {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
    return r.out;
  }
  /// Calls it, wants `code`, all `words` in its message, and no file more than before.
  void bad(int code, const Command& arguments, const std::vector<std::string>& words) const {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const auto before = folder_.count();
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, code) << r.err;
    EXPECT_EQ(r.out, "");
    for (const auto& word : words) EXPECT_NE(r.err.find(word), std::string::npos) << word << r.err;
    EXPECT_EQ(folder_.count(), before);
  }

  std::vector<Row> probe(const std::string& stack, const Command& more) const {
    std::istringstream lines(good(Command{"probe", stack, "--quiet"} + more));
    std::string line;
    std::getline(lines, line);
    const bool with_target = line == "slice,z_um,grey,intensity_mw_cm2,phi,dose,target";
    EXPECT_TRUE(with_target || line == "slice,z_um,grey,intensity_mw_cm2,phi,dose") << line;
    std::vector<Row> rows;
    while (std::getline(lines, line)) {
      Row r;
      const int fields = std::sscanf(line.c_str(), "%d,%lf,%d,%lf,%lf,%lf,%lf", &r.slice, &r.z_um,
                                     &r.grey, &r.intensity, &r.phi, &r.dose, &r.target);
      EXPECT_EQ(fields, with_target ? 7 : 6) << line;
      EXPECT_EQ(r.slice, static_cast<int>(rows.size()));
      EXPECT_DOUBLE_EQ(r.z_um, r.slice * kSliceUm);
      rows.push_back(r);
    }
    check_doses(rows);
    return rows;
  }

  /// Sums what all slices contribute to each node, from the intensities shown.
  static void check_doses(const std::vector<Row>& rows) {
    for (std::size_t k = 0; k < rows.size(); ++k) {
      double sum = 0;
      for (std::size_t n = rows.size(); n-- > k;) {
        const auto d = static_cast<double>(n - k);
        sum += rows[n].phi * (std::pow(10.0, -d * kEta) - std::pow(10.0, -(d + 1) * kEta));
      }
      ASSERT_NEAR(rows[k].dose, sum, 1e-12) << "node " << k;
    }
  }

  static double dose_at(const std::vector<Row>& rows, double zeta) {
    const auto n = static_cast<std::size_t>(zeta);
    if (n >= rows.size()) return 0;
    const double below = n + 1 < rows.size() ? rows[n + 1].dose : 0;
    return rows[n].phi +
           (below - rows[n].phi) * std::pow(10.0, -(static_cast<double>(n) + 1 - zeta) * kEta);
  }

  std::string write_text(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, to_bytes(text));
    return name;
  }
  /// The printer of figure 2.2 with other keys.
  std::string printer(const std::string& name, const std::string& calibration,
                      const std::string& display = "bit_depth = 8",
                      const std::string& stage = "travel_mm = 100") const {
    return write_text(name,
                      "name = \"of the test\"\n[display]\nwidth_px = 1280\nheight_px = 800\n" +
                          std::string("pixel_um = 50.0\n") + display +
                          "\n[blue]\ncalibration = " + calibration + "\n[stage]\n" + stage + "\n");
  }

  static Command setup(const std::string& printer = "dual-wavelength-dlp",
                       const std::string& speed = "1000", const std::string& resin = "figure-2-2") {
    return {"--printer", printer, "--resin", resin, "--speed-mm-h", speed};
  }
  void slice() const {
    made_once("Cli slice", folder_, {"target.uvj"}, [&] {
      good({"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
            "dual-wavelength-dlp"});
    });
  }
  json run(const Command& more, const std::string& to = "out.uvj") const {
    good(Command{"run", "ladder.stl", "-o", to, "--layer-um", "50"} + more);
    return json_file(std::filesystem::path(to).stem().string() + ".json");
  }
  void slice_and_run() const {
    slice();
    made_once("Cli run", folder_, {"out.uvj", "out.html", "out.json"}, [&] { run(setup()); });
  }
  json json_file(const std::string& name) const {
    return json::parse(to_text(read_file(folder_ / name)));
  }
  Bytes bytes(const std::string& name) const {
    Bytes data = read_file(folder_ / name);
    EXPECT_FALSE(data.empty()) << name;
    return data;
  }

  TemporaryFolder folder_;
  RunOptions options_;
};

void expect_clean(const json& j, double largest_um) {
  EXPECT_EQ(j["layers"], 54);
  EXPECT_EQ(j["target_voxels"], 112000);
  EXPECT_EQ(j["printed_voxels"], 112000);
  EXPECT_EQ(j["cure_through_voxels"], 0);
  EXPECT_EQ(j["undercure_voxels"], 0);
  EXPECT_EQ(j["lost_features"], 0);
  EXPECT_EQ(j["merged_features"], 0);
  EXPECT_EQ(j["grey_voxels"], 0);
  EXPECT_EQ(j["iou"], 1.0);
  EXPECT_GE(j["dose"]["min_inside"], 1.0);
  EXPECT_LT(j["dose"]["max_outside"], 1.0);
  EXPECT_LT(j["height_error_um"]["max_abs"], largest_um);
  EXPECT_LE(j["height_error_um"]["mean_abs"], j["height_error_um"]["max_abs"]);
}

TEST_F(Cli, LadderUncorrectedIsOneSolidPiece) {
  slice();
  const auto rows = probe("target.uvj", kRungColumn + setup() + Command{"--target", "target.uvj"});
  ASSERT_EQ(rows.size(), 50U);
  const std::map<int, double> doses{{0, 1.9512},  {11, 3.6202}, {21, 1.5736},
                                    {31, 2.7496}, {38, 1.0125}, {41, 0.025271}};
  for (const auto& [node, dose] : doses) {
    EXPECT_NEAR(rows[static_cast<std::size_t>(node)].dose, dose, 5e-5 * std::max(1.0, dose / 2));
  }
  for (const Row& r : rows) {
    const bool lit = (r.slice >= 11 && r.slice <= 20) || (r.slice >= 31 && r.slice <= 40);
    EXPECT_EQ(r.grey, lit ? 255 : 0);
    EXPECT_EQ(r.target, lit ? 1.0 : 0.0);
    EXPECT_EQ(r.intensity, lit ? 100.0 : 1.0);
    EXPECT_EQ(r.phi, lit ? kPhiMax : kPhiMin);
  }
  // The lower printed edge, 1902.1 um from the platform.
  EXPECT_GT(dose_at(rows, 38.041), 1.0);
  EXPECT_LT(dose_at(rows, 38.043), 1.0);

  const json j = json::parse(
      good(Command{"verify", "target.uvj", "--target", "target.uvj", "--json", "-"} + setup()));
  EXPECT_EQ(j["layers"], 50);
  EXPECT_EQ(j["merged_features"], j["gaps"]);
  EXPECT_EQ(j["gap_contrast"]["min"], 0.0);
  // Two gaps, of 11 and 10 layers under 40 x 40 pixels, are filled; three layers of rungs and rails
  // stay behind.
  EXPECT_EQ(j["cure_through_voxels"], 21 * 1600);
  EXPECT_EQ(j["undercure_voxels"], 3 * 3200);
  EXPECT_NEAR(j["height_error_um"]["max_abs"], 550.0, 1e-9);
}

/// By day each printer and each cap, by night all pairs.
TEST_F(Cli, LadderCorrected) {
  int pair = 0;
  for (const char* printer : {"dual-wavelength-dlp", "dual-wavelength-dlp-gamma3"}) {
    const bool linear = std::strlen(printer) < 20;
    for (const char* cap : {"1", "2", "inf"}) {
      if (pair++ % 2 != 0 && !by_night()) continue;
      SCOPED_TRACE(fmt::format("{} {}", printer, cap));
      const json j = run(setup(printer) + Command{"--omega-max", cap});
      expect_clean(j, linear ? 2.0 : 3.0);
      const double step = linear ? (kPhiMax - kPhiMin) / 255 : 0.08;
      const double peak = std::string(cap) == "inf" ? kPhiMax : std::stod(cap);
      EXPECT_LE(j["dose"]["max_inside"], peak + step);
    }
  }
}

TEST_F(Cli, LadderShowsThePaperSlices) {
  const double step = (kPhiMax - kPhiMin) / 255;
  // The levels before an edge are chosen together and need room to both sides: 4 % of the levels,
  // on the average of three slices, and one level of rounding.
  const double room = (0.04 * 256 * 3 / 2 + 1) * step;
  const auto near = [&](const std::vector<Row>& rows, std::size_t n, double phi) {
    EXPECT_NEAR(rows[n].phi, phi, room) << n;
  };
  json figures = run(setup() + Command{"--omega-max", "1"});
  EXPECT_LE(figures["height_error_um"]["mean_abs"], 0.4);
  auto rows = probe("out.uvj", kRungColumn);
  ASSERT_EQ(rows.size(), 54U);
  for (const std::size_t n : {21, 41, 42}) near(rows, n, kPhiMax);
  near(rows, 22, 1.2778);
  near(rows, 43, 5.9633);
  for (const std::size_t n : {5, 23, 30, 44, 53}) EXPECT_EQ(rows[n].phi, kPhiMin);
  // The cap leaves three level steps of room.
  for (std::size_t n = 11; n <= 20; ++n) {
    EXPECT_GE(rows[n].dose, 1.0 - 1e-3);
    EXPECT_LE(rows[n].dose, 1.0 + 3 * step * (1 - kA) + 1e-9);
  }

  figures = run(setup());
  // A third more than the tolerance aimed at: one step of its ladder, and the step of a level.
  EXPECT_LE(figures["height_error_um"]["max_abs"], 0.05 * 1.44);
  rows = probe("out.uvj", kRungColumn);
  for (const std::size_t n : {20, 40}) near(rows, n, kPhiMax);
  for (const std::size_t n : {12, 13, 14}) near(rows, n, kPhiMin);
  for (const std::size_t n : {16, 17}) EXPECT_EQ(rows[n].phi, kPhiMin);
  EXPECT_NEAR(1 - rows[23].dose, 0.34598, 2e-3 + room * (1 - kA));

  rows = probe("out.uvj", kRailColumn);
  for (std::size_t n = 0; n < 50; ++n) EXPECT_EQ(rows[n].phi, kPhiMax) << n;
  for (std::size_t n = 50; n < 53; ++n) near(rows, n, kPhiMax);
  near(rows, 53, 0.18526);
  // Its end is within the tolerance of an edge, a thousandth of a slice.
  EXPECT_GE(rows[50].dose, 1.0 - 1e-3 * kLn10 * kEta * (kPhiMax - 1));
}

// Few and uneven levels: nothing is printed wrong, and no edge is off by more than one step costs.
TEST_F(Cli, LadderWithCoarseProjectors) {
  const std::string uneven =
      printer("uneven.toml",
              "[[0, 1.0], [9, 1.5], [40, 4.0], [77, 16.0], [130, 17.5], [131, 40.0], [200, 71.0], "
              "[201, 71.0], [255, 100.0]]");
  // 23 mW/cm² between two levels: a step of phi 1.41.
  const json j = run(setup(uneven));
  expect_clean(j, 20);

  const std::string coarse = printer("coarse.toml", "[[0, 1.0], [15, 100.0]]", "bit_depth = 4");
  expect_clean(run(setup(coarse)), 25);
  slice();
  const double step = (kPhiMax - kPhiMin) / 15;
  for (const Command& column : {kRungColumn, kRailColumn}) {
    const auto rows = probe("out.uvj", column + Command{"--target", "target.uvj"});
    ASSERT_EQ(rows.size(), 54U);
    for (const Row& r : rows) {
      EXPECT_NEAR(r.phi, kPhiMin + r.grey * step, 1e-12);
      EXPECT_LE(r.grey, 15);
    }
    const std::vector<Edge> edges =
        column == kRungColumn ? std::vector<Edge>{{true, 11}, {false, 21}, {true, 31}, {false, 41}}
                              : std::vector<Edge>{{false, 50}};
    for (const Edge& e : edges) {
      const auto node = static_cast<std::size_t>(e.node);
      // The print ends where Omega(zeta) = 1: in the layer above the node when the node's dose and
      // that layer's light lie on different sides of it, or else in the layer below.
      const bool above = (rows[node].dose >= 1) != (rows[node - 1].dose >= 1);
      const double phi = rows[above ? node - 1 : node].phi;
      const double below = rows[above ? node : node + 1].dose;
      const double into_layer = std::log10((1 - phi) / (below - phi)) / -kEta;
      const double off_um = (above ? into_layer : 1 - into_layer) * kSliceUm;
      // A tenth of what one level step does.
      const double bound = kSliceUm * step * (1 - kA) / (kLn10 * kEta * std::abs(phi - 1));
      EXPECT_LE(off_um, 0.1 * bound) << e.node;
    }
  }
}

TEST_F(Cli, FiguresAndFilesOfAllRoutesAgree) {
  const json ran = run(setup());
  slice();
  const std::string target_bytes = to_text(bytes("target.uvj"));
  const RunResult corrected =
      call(Command{"correct", "target.uvj", "-o", "corrected.uvj"} + setup());
  EXPECT_EQ(corrected.exit_code, 0) << corrected.err;
  EXPECT_EQ(corrected.out, "");
  EXPECT_EQ(bytes("corrected.uvj"), bytes("out.uvj"));

  const RunResult verified =
      call({"verify", "corrected.uvj", "--target", "target.uvj", "--json", "-"});
  EXPECT_EQ(verified.exit_code, 0);
  // Times of the print are in the proof of `run` alone.
  json without = ran;
  for (const char* key : {"uncorrected", "light_s", "print_time_s"}) {
    ASSERT_EQ(without.erase(key), 1U) << key;
  }
  EXPECT_EQ(json::parse(verified.out), without);
  good({"verify", "corrected.uvj", "--target", "target.uvj", "--json", "figures.json"});
  EXPECT_EQ(json_file("figures.json"), without);
  json as_sliced = json::parse(
      good(Command{"verify", "target.uvj", "--target", "target.uvj", "--json", "-"} + setup()));
  // What slices light is told of stacks.
  ASSERT_EQ(as_sliced.erase("largest_area_change"), 1U);
  // When it gels is not followed beside a correction.
  json uncorrected = ran["uncorrected"];
  EXPECT_FALSE(uncorrected["in_time"]);
  for (const char* key : {"in_time", "time_step_um"}) {
    ASSERT_EQ(as_sliced.erase(key), 1U);
    ASSERT_EQ(uncorrected.erase(key), 1U);
  }
  EXPECT_EQ(as_sliced, uncorrected);

  for (const char* key : {"layers", "layer_um", "pixel_um", "target_voxels", "printed_voxels",
                          "cure_through_voxels", "undercure_voxels", "iou", "lost_features",
                          "split_features", "merged_features", "grey_voxels"}) {
    EXPECT_TRUE(ran.contains(key) && (ran[key].is_number())) << key;
  }
  const std::map<std::string, std::vector<std::string>> groups{
      {"height_error_um", {"mean_abs", "p95_abs", "max_abs"}},
      {"dose", {"min_inside", "max_inside", "min_inside_layers", "max_outside"}},
      {"gap_contrast", {"min", "p05"}},
      {"grey_dose_error", {"mean_abs", "p95_abs"}}};
  for (const auto& [group, keys] : groups) {
    for (const auto& key : keys) EXPECT_TRUE(ran[group].contains(key)) << group << " " << key;
  }

  // The page of `run` and that of `report` differ in the title only.
  good({"report", "corrected.uvj", "--target", "target.uvj", "-o", "page.html"});
  std::string page = to_text(bytes("page.html"));
  for (std::size_t at; (at = page.find("corrected</title>")) != std::string::npos;) {
    page.replace(at, 9, "out");
  }
  for (std::size_t at; (at = page.find("<h1>corrected<")) != std::string::npos;) {
    page.replace(at + 4, 9, "out");
  }
  EXPECT_EQ(page, to_text(bytes("out.html")));

  const json info = json::parse(good({"info", "out.uvj", "--json", "-"}));
  EXPECT_EQ(info["kind"], "corrected");
  EXPECT_EQ(info["target_layers"], 50);
  EXPECT_EQ(info["omega_max"], "inf");
  EXPECT_NEAR(info["print_time_s"], 54 * 0.05 / 1000 * 3600, 1e-9);
  EXPECT_NEAR(info["resin_volume_ml"], 112000 * 0.05 * 0.05 * 0.05 * 1e-3, 1e-9);
  const std::string told = good({"info", "target.uvj"});
  EXPECT_NE(told.find("kind         target"), std::string::npos) << told;

  // No path, folder or host of this run may be in a stack.
  EXPECT_EQ(target_bytes.find(folder_.path()), std::string::npos);
  EXPECT_EQ(to_text(bytes("out.uvj")).find(folder_.path()), std::string::npos);
}

TEST_F(Cli, SameInputGivesTheSameBytes) {
  write_boxes(folder_ / "block.stl", {{0, 12.02F, 0, 9.01F, 0, 1}, {3, 10.3F, 2, 8, 1.5F, 2.13F}});
  std::vector<std::map<std::string, std::string>> all;
  for (const char* threads : {"1", "8"}) {
    std::map<std::string, std::string> made;
    const std::string to = "made.uvj";
    const auto keep = [&](const std::string& name) { made[name] = to_text(bytes(name)); };
    const Command number{"--threads", threads};
    good(number + Command{"run", "block.stl", "-o", to, "--layer-um", "50"} + setup());
    for (const char* name : {"made.uvj", "made.html", "made.json"}) keep(name);
    good(Command{"slice", "block.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
                 "dual-wavelength-dlp"} +
         number);
    keep("target.uvj");
    good(Command{"correct", "target.uvj", "-o", "corrected.uvj"} + setup() + number);
    keep("corrected.uvj");
    EXPECT_EQ(made["corrected.uvj"], made["made.uvj"]);
    good(Command{"report", "made.uvj", "--target", "target.uvj", "-o", "page.html"} + number);
    keep("page.html");
    good(Command{"section", "made.uvj", "--target", "target.uvj", "-o", "section.png"} + number);
    keep("section.png");
    made["verify"] =
        good(Command{"verify", "made.uvj", "--target", "target.uvj", "--json", "-"} + number);
    made["verify text"] = good(Command{"verify", "made.uvj", "--target", "target.uvj"} + number);
    made["probe"] = good(Command{"probe", "made.uvj", "--x", "600", "--y", "401"} + number);
    made["info"] = good(Command{"info", "made.uvj"} + number);
    made["info json"] = good(Command{"info", "made.uvj", "--json", "-"} + number);
    all.push_back(std::move(made));
  }
  EXPECT_GT(json::parse(all[0]["verify"])["grey_voxels"], 0);
  for (std::size_t i = 1; i < all.size(); ++i) EXPECT_EQ(all[i] == all[0], true) << i;
}

TEST_F(Cli, SurfaceChoosesEdgeHeights) {
  const auto slice_to = [&](const std::string& to, const Command& more) {
    good(Command{"slice", "ladder.stl", "-o", to, "--layer-um", "70", "--printer",
                 "dual-wavelength-dlp"} +
         more);
    return json::parse(good({"info", to, "--json", "-"}));
  };
  EXPECT_EQ(slice_to("a.uvj", {"--surface", "mesh"})["edge_heights"], true);
  EXPECT_EQ(slice_to("slices.uvj", {"--surface", "slices"})["edge_heights"], false);
  EXPECT_EQ(slice_to("default.uvj", {})["edge_heights"], true);
  EXPECT_EQ(bytes("default.uvj"), bytes("a.uvj"));
  EXPECT_THAT(good({"info", "a.uvj"}), testing::HasSubstr("heights of the mesh"));
  EXPECT_THAT(good({"info", "slices.uvj"}), testing::HasSubstr("heights of the slices"));
  bad(2,
      {"slice", "ladder.stl", "-o", "b.uvj", "--layer-um", "70", "--printer", "dual-wavelength-dlp",
       "--surface", "up"},
      {"--surface"});

  // Other formats lose them, and that is said once.
  const RunResult lost = call({"convert", "a.uvj", "-o", "a.nanodlp"});
  EXPECT_EQ(lost.exit_code, 0);
  EXPECT_THAT(lost.err, testing::HasSubstr("edge heights"));
  EXPECT_EQ(json::parse(good({"info", "a.nanodlp", "--json", "-"}))["edge_heights"], false);
  const RunResult kept = call({"convert", "a.uvj", "-o", "b.uvj"});
  EXPECT_EQ(kept.exit_code, 0);
  EXPECT_THAT(kept.err, testing::Not(testing::HasSubstr("edge heights")));
  EXPECT_EQ(json::parse(good({"info", "b.uvj", "--json", "-"}))["edge_heights"], true);
  // A corrected stack is no target: nothing of it has a surface beside its slices.
  good(Command{"correct", "a.uvj", "-o", "c.uvj"} + setup());
  EXPECT_FALSE(json::parse(good({"info", "c.uvj", "--json", "-"})).contains("edge_heights"));
}

/// By day every third command says its version, by night each.
TEST_F(Cli, HelpAndVersion) {
  int command_number = 0;
  for (const char* command :
       {"", "slice", "correct", "verify", "probe", "report", "section", "solid", "run", "info"}) {
    const Command start = *command ? Command{command} : Command{};
    SCOPED_TRACE(command);
    const RunResult help = call(start + Command{"--help"});
    EXPECT_EQ(help.exit_code, 0);
    EXPECT_EQ(help.err, "");
    EXPECT_NE(help.out.find("Usage: slicecorr"), std::string::npos);
    EXPECT_NE(help.out.find("Exit codes:"), std::string::npos);
    if (command_number++ % 3 != 0 && !by_night()) continue;
    const RunResult version = call(start + Command{"--version"});
    EXPECT_EQ(version.exit_code, 0);
    EXPECT_EQ(version.out.find("slicecorr "), 0U);
    EXPECT_EQ(std::count(version.out.begin(), version.out.end(), '\n'), 1);
  }
}

/// By day --quiet stands before or after what it quietens in turn, by night both.
TEST_F(Cli, QuietIsQuietAndStdoutIsClean) {
  const Command quiet{"--quiet"};
  int place = 0;
  slice();
  for (const Command& c : {
           Command{"run", "ladder.stl", "-o", "out.uvj", "--layer-um", "50"} + setup(),
           Command{"slice", "ladder.stl", "-o", "t.uvj", "--layer-um", "50", "--printer",
                   "dual-wavelength-dlp"},
           Command{"correct", "target.uvj", "-o", "c.uvj"} + setup(),
           Command{"report", "c.uvj", "--target", "target.uvj", "-o", "c.html"},
       }) {
    const RunResult loud = call(c);
    EXPECT_EQ(loud.exit_code, 0);
    EXPECT_EQ(loud.out, "");
    EXPECT_NE(loud.err, "");
    // Piped: plain lines.
    EXPECT_EQ(loud.err.find_first_of("\r\033"), std::string::npos) << loud.err;
    const bool after = ++place % 2 == 0;
    for (const bool last : {true, false}) {
      if (last != after && !by_night()) continue;
      const RunResult r = call(last ? c + quiet : quiet + c);
      EXPECT_EQ(r.exit_code, 0);
      EXPECT_EQ(r.out + r.err, "");
    }
  }
  for (const Command& c : {
           Command{"verify", "c.uvj", "--target", "target.uvj", "--json", "-"},
           Command{"info", "c.uvj", "--json", "-"},
       }) {
    EXPECT_TRUE(json::accept(call(c).out));
    const RunResult r = call(c + quiet);
    EXPECT_TRUE(json::accept(r.out));
    EXPECT_EQ(r.err, "");
  }
  const RunResult r = call(quiet + Command{"probe", "nowhere.uvj", "--x", "1", "--y", "1"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_NE(r.err, "");
}

TEST_F(Cli, WrongUsageAndInput) {
  slice_and_run();
  const Command sliced{"slice", "ladder.stl", "-o", "x.uvj", "--printer", "dual-wavelength-dlp"};
  const Command layer{"--layer-um", "50"};
  const auto without = [&](const char* option, const char* value) {
    Command c = Command{"run", "ladder.stl", "-o", "x.uvj"} + layer + setup();
    const auto at = std::find(c.begin(), c.end(), option);
    if (at == c.end()) return c + Command{option, value};
    *(at + 1) = value;
    return c;
  };
  bad(2, {}, {"slice, correct, verify"});
  bad(2, {"polish"}, {"'polish'", "slice, correct, verify"});
  bad(2, sliced, {"--layer-um"});
  bad(2, sliced + layer + Command{"--sharpen"}, {"--sharpen"});
  for (const char* value : {"0", "nan", "50um", "0,05", "1001", ""}) {
    bad(2, without("--layer-um", value), {"--layer-um", value});
  }
  // By day each option and each value, by night all pairs.
  const char* const options[] = {"--speed-mm-h", "--dc-mj-cm3", "--ha-um"};
  const char* const values[] = {"0", "-5", "nan", "1e999", "fast"};
  for (std::size_t v = 0; v < std::size(values); ++v) {
    for (std::size_t o = 0; o < std::size(options); ++o) {
      if (!by_night() && v % std::size(options) != o) continue;
      bad(2, without(options[o], values[v]), {options[o], values[v]});
    }
  }
  for (const char* value : {"0.5", "-1", "nan", "much", ""}) {
    bad(2, without("--omega-max", value), {"--omega-max", "inf"});
  }
  for (const char* value : {"0", "-1", "nan"}) bad(2, without("--scale", value), {"scale"});
  for (const char* value : {"5", "nan,5", "5,x", "1,2,3"}) {
    bad(2, without("--center-mm", value), {"--center-mm"});
  }
  bad(2, without("--rotate-deg", "90,nan,0"), {"--rotate-deg"});
  bad(2, without("--mode", "sideways"), {"--mode", "continuous"});
  bad(2, without("--antialias", "some"), {"--antialias"});
  bad(2, without("--units", "furlong"), {"--units"});
  bad(2, without("--one-slice-gaps", "shut"), {"--one-slice-gaps"});
  bad(2, without("--threads", "-1"), {"--threads"});
  bad(2, without("-o", "x.zip"), {"x.zip", "several formats", "chitubox"});
  bad(2, without("-o", "x.obj"), {"x.obj", ".uvj"});
  bad(2, without("-o", "x"), {".uvj"});

  // What is not there, or is something else.
  bad(2, without("--printer", "no-such-printer"), {"no-such-printer", SLICECORR_DB_DIR});
  bad(2, without("--printer", "nowhere.toml"), {"nowhere.toml"});
  bad(2, without("--printer", "figure-2-2"), {"figure-2-2.toml", "display"});
  bad(2, without("--resin", "uhd-dlp"), {"uhd-dlp.toml", "no resin"});
  bad(2, without("--resin", "no-such-resin"), {"no-such-resin"});
  const Command correct{"-o", "x.uvj"};
  bad(2, Command{"run", "nowhere.stl", "-o", "x.uvj"} + layer + setup(), {"nowhere.stl"});
  bad(2, Command{"run", folder_.path(), "-o", "x.uvj"} + layer + setup(), {folder_.path()});
  write_text("part.step", "ISO-10303-21;");
  bad(2, Command{"run", "part.step", "-o", "x.uvj"} + layer + setup(), {"part.step", ".stl"});
  write_text("empty.stl", "");
  bad(2, Command{"run", "empty.stl", "-o", "x.uvj"} + layer + setup(), {"empty.stl"});
  bad(2, Command{"correct", "nowhere.uvj"} + correct + setup(), {"nowhere.uvj"});
  bad(2, Command{"correct", "ladder.stl"} + correct + setup(), {"ladder.stl", "is a mesh"});
  bad(2, {"verify", "out.uvj", "--target", "nowhere.uvj"}, {"nowhere.uvj"});

  // A design is wanted, and its size.
  bad(2, Command{"correct", "out.uvj"} + correct + setup(), {"out.uvj", "corrected"});
  bad(2, {"verify", "out.uvj", "--target", "out.uvj"}, {"out.uvj", "corrected"});
  bad(2, {"probe", "out.uvj", "--x", "1", "--y", "1", "--target", "out.uvj"}, {"corrected"});
  bad(2, {"report", "out.uvj", "--target", "out.uvj", "-o", "x.html"}, {"corrected"});
  bad(2, {"section", "out.uvj", "--target", "out.uvj", "-o", "x.png"}, {"corrected"});
  bad(2, {"verify", "target.uvj", "--target", "target.uvj"}, {"--printer"});
  bad(2, Command{"correct", "target.uvj"} + correct + setup("uhd-dlp"), {"1280 x 800", "3840"});
  good(Command{"slice", "ladder.stl", "-o", "big.uvj", "--printer", "uhd-dlp"} + layer);
  good(sliced + Command{"--layer-um", "25"});
  std::filesystem::rename(folder_ / "x.uvj", folder_ / "fine.uvj");
  bad(2, {"verify", "out.uvj", "--target", "big.uvj"}, {"1280 x 800", "3840 x 2400"});
  bad(2, {"verify", "out.uvj", "--target", "fine.uvj"}, {"50", "25"});
  bad(2, {"report", "out.uvj", "--target", "big.uvj", "-o", "x.html"}, {"3840"});
  for (const auto& [x, y] : {std::pair{"1280", "0"}, {"0", "800"}, {"-1", "0"}, {"1.5", "0"}}) {
    bad(2, {"probe", "out.uvj", "--x", x, "--y", y}, {x});
  }
  for (const char* value : {"-1", "nan"}) {
    bad(2, {"verify", "out.uvj", "--target", "target.uvj", "--max-height-error-um", value},
        {"--max-height-error-um"});
  }

  // Too large for the display; too thick for the stage.
  write_boxes(folder_ / "wide.stl", {{0, 70, 0, 10, 0, 1}});
  bad(2, Command{"run", "wide.stl", "-o", "x.uvj"} + layer + setup(), {"70", "64", "mm"});
  write_boxes(folder_ / "tall.stl", {{0, 1, 0, 1, 0, 101}});
  bad(2, Command{"run", "tall.stl", "-o", "x.uvj"} + layer + setup(), {"101", "100", "mm"});
  bad(2, Command{"run", "ladder.stl", "-o", "x.uvj"} + layer + setup("dual-wavelength-dlp", "2001"),
      {"2001", "2000 mm/h"});

  // Damaged definitions name the line.
  printer("bent.toml", "[[0, 1.0], [255, ]");
  bad(2, without("--printer", "bent.toml"), {"bent.toml", "line 9", "TOML"});
  printer("falls.toml", "[[0, 1.0], [100, 50.0], [255, 40.0]]");
  bad(2, without("--printer", "falls.toml"), {"falls.toml", "line 8", "fall"});
  write_text("bent-resin.toml", "name = \"bent\"\n[cure]\nabsorbance_height_um = \"thick\"\n");
  bad(2, without("--resin", "bent-resin.toml"), {"bent-resin.toml", "line 3"});
}

// An output never replaces what it is made from.
// The ladder's rails reach from the platform to 2.5 mm at x = 30 to 34 mm of the display; the
// corrected print has the ladder's volume, the uncorrected one fills its gaps.
TEST_F(Cli, SolidIsTheLadder) {
  slice_and_run();
  const Command design{"--design", "ladder.stl", "--json", "-", "--quiet"};
  const json good = json::parse(
      this->good(Command{"solid", "out.uvj", "--target", "target.uvj", "-o", "good.stl"} + design));
  const json bad =
      json::parse(this->good(Command{"solid", "target.uvj", "-o", "bad.ply"} + setup() + design));
  EXPECT_NEAR(good["design_volume_mm3"], 2 * 5 + 2 * 2.0, 1e-9);
  EXPECT_NEAR(good["volume_mm3"], 14, 0.5);
  EXPECT_GT(bad["volume_mm3"], 17);
  EXPECT_EQ(good["lower_mm"][2], 0);
  EXPECT_NEAR(good["upper_mm"][2], 2.5, 2e-3);
  EXPECT_NEAR(good["lower_mm"][0], 30, 0.025);
  EXPECT_NEAR(good["upper_mm"][0], 34, 0.025);
  // Half the diagonal of a voxel of 50 um.
  EXPECT_LT(good["distance_um"]["max_abs"], 43.4);
  EXPECT_GT(bad["distance_um"]["max_abs"], 200);
  EXPECT_EQ(bytes("good.stl").size(), 84 + 50 * good["triangles"].get<std::size_t>());
  this->good({"solid", "out.uvj", "-o", "small.3mf", "--reduce", "4"});
  EXPECT_LT(bytes("small.3mf").size(), bytes("good.stl").size());
  this->bad(2, {"solid", "out.uvj", "-o", "part.obj"}, {"part.obj", ".stl, .ply or .3mf"});
  this->bad(2, {"solid", "target.uvj", "-o", "part.stl"}, {"--printer"});
  this->bad(2, {"solid", "out.uvj", "--design", "ladder.stl", "-o", "ladder.stl"}, {"input"});
}

TEST_F(Cli, InputsStay) {
  slice_and_run();
  const Bytes target = bytes("target.uvj"), stack = bytes("out.uvj");
  bad(2, Command{"correct", "target.uvj", "-o", "target.uvj"} + setup(), {"target.uvj"});
  bad(2, Command{"correct", "target.uvj", "-o", folder_ / "target.uvj"} + setup(), {"input"});
  bad(2, {"report", "out.uvj", "--target", "target.uvj", "-o", "target.uvj"}, {"input"});
  bad(2, {"report", "out.uvj", "--target", "target.uvj", "-o", "out.uvj"}, {"input"});
  bad(2, {"section", "out.uvj", "--target", "target.uvj", "-o", "out.uvj"}, {"input"});
  bad(2, {"verify", "out.uvj", "--target", "target.uvj", "--json", "out.uvj"}, {"input"});
  bad(2, {"info", "out.uvj", "--json", "./out.uvj"}, {"input"});
  EXPECT_EQ(bytes("target.uvj"), target);
  EXPECT_EQ(bytes("out.uvj"), stack);
}

TEST_F(Cli, PhysicallyInfeasible) {
  const std::string fast = printer("fast.toml", "[[0, 1.0], [255, 100.0]]");
  const auto with = [&](const char* part, const std::string& speed) {
    return Command{"run", part, "-o", "x.uvj", "--layer-um", "50"} + setup(fast, speed);
  };
  for (const char* speed : {"6250", "7000"}) bad(3, with("ladder.stl", speed), {"6249.9 mm/h"});
  for (const char* speed : {"62.5", "50"}) bad(3, with("ladder.stl", speed), {"62.501 mm/h"});
  EXPECT_EQ(call(with("ladder.stl", "6200")).exit_code, 0);
  EXPECT_EQ(call(with("ladder.stl", "63")).exit_code, 0);
  for (const char* name : {"x.uvj", "x.html", "x.json"}) {
    std::filesystem::remove(folder_ / name);
  }
  // 100 mm of travel: the part fits, its end does not.
  write_boxes(folder_ / "tall.stl", {{0, 1, 0, 1, 0, 99.85F}});
  bad(3, with("tall.stl", "1000"), {"4 slices", "100 mm", "0.050 mm lower"});
  write_boxes(folder_ / "tall.stl", {{0, 1, 0, 1, 0, 99.8F}});
  EXPECT_EQ(call(with("tall.stl", "1000")).exit_code, 0);
}

TEST_F(Cli, OutputThatCannotBeWritten) {
  slice_and_run();
  const Command layer{"--layer-um", "50"};
  bad(4, Command{"slice", "ladder.stl", "-o", "no/x.uvj", "--printer", "uhd-dlp"} + layer, {"no/"});
  bad(4, Command{"correct", "target.uvj", "-o", "no/x.uvj"} + setup(), {"no/x.uvj"});
  bad(4, Command{"run", "ladder.stl", "-o", "no/x.uvj"} + layer + setup(), {"no/x.uvj"});
  bad(4, {"report", "out.uvj", "--target", "target.uvj", "-o", "no/x.html"}, {"no/x.html"});
  bad(4, {"verify", "out.uvj", "--target", "target.uvj", "--json", "no/x.json"}, {"no/x.json"});
  bad(4, {"info", "out.uvj", "--json", "no/x.json"}, {"no/x.json"});
  bad(4, {"info", "out.uvj", "--json", "."}, {".: can't be written"});

  for (const Command& c : {Command{"probe", "out.uvj"} + kRungColumn, Command{"info", "out.uvj"},
                           Command{"verify", "out.uvj", "--target", "target.uvj"},
                           Command{"verify", "out.uvj", "--target", "target.uvj", "--json", "-"}}) {
    RunOptions full = options_;
    full.stdout_path = "/dev/full";
    const RunResult r = call(c, full);
    EXPECT_EQ(r.exit_code, 4) << c[0] << r.err;
    EXPECT_NE(r.err.find("stdout"), std::string::npos) << r.err;
  }

  // A device is written to, not replaced.
  good({"info", "out.uvj", "--json", "/dev/null"});
  EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
}

/// A file system of its own, which is gone again with this object. Only root gets one.
class SmallDisk {
 public:
  SmallDisk(std::string folder, const char* size) : folder_(std::move(folder)) {
    mounted_ = ::mount("none", folder_.c_str(), "tmpfs", 0, size) == 0;
  }
  ~SmallDisk() {
    if (mounted_) ::umount2(folder_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  bool mounted() const { return mounted_; }

 private:
  std::string folder_;
  bool mounted_ = false;
};

TEST_F(Cli, FullDiskLeavesNothing) {
  write_boxes(folder_ / "grid.stl", lattice(10, 6));
  const Command commands[] = {
      Command{"slice", "grid.stl", "-o", "disk/x.uvj", "--layer-um", "50", "--printer",
              "dual-wavelength-dlp"},
      Command{"run", "grid.stl", "-o", "disk/x.uvj", "--layer-um", "50"} + setup()};
  std::filesystem::create_directory(folder_ / "disk");
  const auto files = [&] {
    const std::filesystem::directory_iterator all(folder_ / "disk");
    return std::distance(begin(all), end(all));
  };
  for (const Command& c : commands) {
    RunOptions small = options_;
    small.largest_file = 200000;
    const RunResult r = call(c, small);
    EXPECT_EQ(r.exit_code, 4) << r.err;
    EXPECT_NE(r.err.find("disk/x.uvj"), std::string::npos) << r.err;
    EXPECT_EQ(files(), 0);
  }
  const SmallDisk disk(folder_ / "disk", "size=256k");
  if (!disk.mounted()) GTEST_SKIP() << "a full disk needs root; a limited file size was tried";
  for (const Command& c : commands) {
    const RunResult r = call(c);
    EXPECT_EQ(r.exit_code, 4) << r.err;
    EXPECT_NE(r.err.find("No space left"), std::string::npos) << r.err;
    EXPECT_EQ(files(), 0);
  }
}

TEST_F(Cli, ToleranceMissed) {
  slice_and_run();
  const auto with = [](const char* limit, const char* to) {
    return Command{
        "verify", "out.uvj", "--target", "target.uvj", "--json", to, "--max-height-error-um",
        limit};
  };
  EXPECT_EQ(call(with("2", "x.json")).exit_code, 0);
  const RunResult r = call(with("0.0001", "-") + Command{"--quiet"});
  EXPECT_EQ(r.exit_code, 5);
  // The result is there all the same, and the reason.
  EXPECT_GT(json::parse(r.out)["height_error_um"]["max_abs"], 0.0001);
  EXPECT_NE(r.err.find("0.0001 um"), std::string::npos) << r.err;

  const auto surface = [](const char* limit) {
    return Command{"verify", "out.uvj", "--target", "target.uvj", "--max-surface-error-um", limit};
  };
  EXPECT_EQ(call(surface("2")).exit_code, 0);
  const RunResult far = call(surface("0.0001"));
  EXPECT_EQ(far.exit_code, 5);
  EXPECT_THAT(far.err, testing::HasSubstr("largest surface error"));
  bad(2, surface("-1"), {"--max-surface-error-um"});
}

TEST_F(Cli, VerifyDrawsTheSurface) {
  slice_and_run();
  good({"verify", "out.uvj", "--target", "target.uvj", "--map", "map.png"});
  const Bytes png = bytes("map.png");
  ASSERT_GT(png.size(), 8U);
  EXPECT_EQ(png[1], 'P');
  bad(4, {"verify", "out.uvj", "--target", "target.uvj", "--map", "none/map.png"}, {"none"});
  bad(2, {"verify", "out.uvj", "--target", "target.uvj", "--map", "out.uvj"}, {"out.uvj"});
}

TEST_F(Cli, InterruptedLeavesNothing) {
  using Clock = std::chrono::steady_clock;
  write_boxes(folder_ / "grid.stl", lattice(12, 8));
  std::filesystem::create_directory(folder_ / "made");
  const auto files = [&] {
    std::vector<std::string> names;
    for (const auto& f : std::filesystem::directory_iterator(folder_ / "made")) {
      names.push_back(f.path().filename().string());
    }
    return names;
  };
  const Command c =
      Command{"run", "grid.stl", "-o", "made/x.uvj", "--layer-um", "10", "--threads", "1"} +
      setup();
  enum Moment { mesh_read, correcting, writing };
  for (const Moment moment : {mesh_read, correcting, writing}) {
    SCOPED_TRACE(static_cast<int>(moment));
    Clock::time_point read;
    RunOptions options = options_;
    options.signal = moment == mesh_read ? SIGTERM : SIGINT;
    options.signal_when = [&](const std::string&, const std::string& err) {
      const auto now = Clock::now();
      if (err.find("grid.stl: ") == std::string::npos) return false;
      if (read == Clock::time_point()) read = now;
      bool yes = true;
      if (moment == correcting) yes = now - read > std::chrono::milliseconds(300);
      if (moment == writing) yes = err.find("correct: done") != std::string::npos;
      return yes;
    };
    const RunResult r = call(c, options);
    ASSERT_TRUE(r.signalled) << "it was done too soon: " << r.err;
    EXPECT_FALSE(r.timed_out);
    EXPECT_EQ(r.exit_code, 130) << r.err;
    EXPECT_NE(r.err.find("interrupted"), std::string::npos) << r.err;
    EXPECT_THAT(files(), ::testing::IsEmpty());
  }
}

/// A zip with images of any kind, and nothing of ours in it.
class HandMade : public Cli {
 protected:
  enum Kind { grey8, grey16, rgba, palette, grey1 };

  static Bytes png(const Bytes& pixels, int width, Kind kind) {
    const auto height = static_cast<int>(pixels.size()) / width;
    png_structp out = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(out);
    Bytes data;
    png_set_write_fn(
        out, &data,
        [](png_structp p, png_bytep bytes, png_size_t size) {
          auto& to = *static_cast<Bytes*>(png_get_io_ptr(p));
          to.insert(to.end(), bytes, bytes + size);
        },
        nullptr);
    constexpr int colour[] = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_RGBA,
                              PNG_COLOR_TYPE_PALETTE, PNG_COLOR_TYPE_GRAY};
    constexpr int depth[] = {8, 16, 8, 8, 1};
    png_set_IHDR(out, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height),
                 depth[kind], colour[kind], PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_color colours[256];
    // Upside down, so that reading indices for values is seen.
    for (int i = 0; i < 256; ++i) {
      const auto v = static_cast<png_byte>(255 - i);
      colours[i] = {v, v, v};
    }
    if (kind == palette) png_set_PLTE(out, info, colours, 256);
    png_write_info(out, info);
    for (int y = 0; y < height; ++y) {
      Bytes row;
      for (int x = 0; x < width; ++x) {
        const std::uint8_t v = pixels[static_cast<std::size_t>(y * width + x)];
        const auto inverse = static_cast<std::uint8_t>(255 - v);
        if (kind == grey8) row.push_back(v);
        if (kind == grey16) row.insert(row.end(), {v, v});
        if (kind == rgba) row.insert(row.end(), {v, v, v, 255});
        if (kind == palette) row.push_back(inverse);
        if (kind == grey1) {
          if (x % 8 == 0) row.push_back(0);
          row.back() = static_cast<std::uint8_t>(row.back() | (v ? 128 >> x % 8 : 0));
        }
      }
      png_write_row(out, row.data());
    }
    png_write_end(out, nullptr);
    png_destroy_write_struct(&out, &info);
    return data;
  }

  /// The slices of figure 2.2 on a small display of `printer()`.
  static Bytes image(int n) {
    Bytes pixels(static_cast<std::size_t>(kWidth * kHeight));
    const bool lit = (n >= 11 && n <= 20) || (n >= 31 && n <= 40);
    for (int y = 2; y < kHeight - 2; ++y) {
      for (int x = 3; x < kWidth - 3; ++x) {
        const bool in_rail = n < 50 && (x < 8 || x >= kWidth - 8);
        pixels[static_cast<std::size_t>(y * kWidth + x)] = lit || in_rail ? 255 : 0;
      }
    }
    return pixels;
  }
  /// Slices of these kinds in turn.
  void make(const std::string& name, const std::vector<Kind>& kinds, int layers,
            bool deflated = false) const {
    const std::string config = fmt::format(
        R"({{"Properties": {{"Size": {{"X": {}, "Y": {}, "Millimeter": {{"X": {}, "Y": {}}}, )"
        R"("Layers": {}, "LayerHeight": 0.05}}}}}})",
        kWidth, kHeight, kWidth * 0.05, kHeight * 0.05, layers);
    Entries entries{{"config.json", to_bytes(config)}};
    for (int n = 0; n < layers; ++n) {
      const Kind kind = kinds[static_cast<std::size_t>(n) % kinds.size()];
      entries.emplace_back(fmt::format("slice/{:08}.png", n), png(image(n), kWidth, kind));
    }
    make_zip(folder_ / name, entries, deflated);
  }
  Command small() const {
    write_text("small.toml", fmt::format("[display]\nwidth_px = {}\nheight_px = {}\n"
                                         "pixel_um = 50\n[blue]\n"
                                         "calibration = [[0, 1.0], [255, 100.0]]\n",
                                         kWidth, kHeight));
    return setup("small.toml");
  }
  /// Of all slices.
  std::string pixels(const std::string& stack) const {
    const slicecorr::StackReader reader(folder_ / stack, folder_.path());
    const slicecorr::Grid& g = reader.grid();
    std::string all;
    const auto size = static_cast<std::size_t>(g.width_px) * static_cast<std::size_t>(g.height_px);
    reader.read_band({0, 0, g.width_px, g.height_px}, [&](int, const std::uint8_t* rows) {
      all += rows ? std::string(rows, rows + size) : std::string(size, '\0');
    });
    return all;
  }
  json verified(const std::string& stack, const std::string& target) const {
    return json::parse(good(Command{"verify", stack, "--target", target, "--json", "-"} + small()));
  }

  static constexpr int kWidth = 29, kHeight = 17;
};

TEST_F(HandMade, AllKindsOfImagesMeanTheSame) {
  make("target.uvj", {grey8}, 50);
  const json expected = verified("target.uvj", "target.uvj");
  EXPECT_EQ(expected["target_voxels"], 13 * (10 * 50 + 13 * 20));
  EXPECT_EQ(expected["merged_features"], 2 * 13 * 13);
  good(Command{"correct", "target.uvj", "-o", "expected.uvj"} + small());
  // One of which each image is copied as it is, and one of all others in turn.
  const std::vector<Kind> plain{grey8}, others{grey16, rgba, palette, grey1};
  for (const auto& kinds : {plain, others}) {
    // The container knows nothing of what it packs.
    for (const bool deflated : {false, true}) {
      const bool all = deflated == (kinds.size() > 1);
      if (!all && !by_night()) continue;
      SCOPED_TRACE(fmt::format("{} {}", kinds.size(), deflated));
      make("made.uvj", kinds, 50, deflated);
      EXPECT_EQ(verified("made.uvj", "target.uvj"), expected);
      EXPECT_EQ(verified("target.uvj", "made.uvj"), expected);
      good(Command{"correct", "made.uvj", "-o", "corrected.uvj"} + small());
      EXPECT_EQ(pixels("corrected.uvj"), pixels("expected.uvj"));
    }
  }
  const json corrected = verified("expected.uvj", "target.uvj");
  EXPECT_EQ(corrected["iou"], 1.0);
  EXPECT_EQ(corrected["layers"], 54);
  EXPECT_LT(corrected["height_error_um"]["max_abs"], 2.0);
}

TEST_F(HandMade, FewerAndMoreSlicesThanTheTarget) {
  make("target.uvj", {grey8}, 50);
  // 45 slices: the rungs are as before, the rails end ten slices early, in three unlit ones less.
  make("fewer.uvj", {grey8}, 45);
  const json fewer = verified("fewer.uvj", "target.uvj");
  EXPECT_EQ(fewer["layers"], 45);
  EXPECT_EQ(fewer["target_voxels"], 13 * (10 * 50 + 13 * 20));
  EXPECT_EQ(fewer["undercure_voxels"], 13 * (10 * (5 + 3) + 13 * 3));
  EXPECT_NEAR(fewer["height_error_um"]["max_abs"], 550.0, 1e-9);
  // The last node that light reaches fully is 45: from there the rails stay behind.
  double dose = 0;
  int top = 45;
  while (dose < 1) dose = kPhiMax * (1 - kA) + kA * dose, --top;
  const double into =
      std::log10((1 - kPhiMax) / ((dose - kPhiMax * (1 - kA)) / kA - kPhiMax)) / -kEta;
  const double short_um = (50 - top - 1 + into) * kSliceUm;
  EXPECT_NEAR(fewer["height_error_um"]["max_shortfall"], short_um, 1e-6);

  make("more.uvj", {grey8}, 60);
  const auto rows = probe("more.uvj", Command{"--x", "14", "--y", "8"} + small());
  EXPECT_EQ(rows.size(), 60U);
  const json more = verified("more.uvj", "target.uvj");
  EXPECT_EQ(more["layers"], 60);
  // Ten black slices more: a little dose, no other voxel.
  const json same = verified("target.uvj", "target.uvj");
  EXPECT_EQ(more["undercure_voxels"], same["undercure_voxels"]);
  EXPECT_EQ(more["cure_through_voxels"], same["cure_through_voxels"]);
  EXPECT_GT(more["dose"]["max_inside"], same["dose"]["max_inside"]);

  // A target with less: what the stack prints below it is cured through.
  make("short.uvj", {grey8}, 31);
  const json below = verified("target.uvj", "short.uvj");
  EXPECT_EQ(below["layers"], 50);
  EXPECT_EQ(below["target_voxels"], 13 * (10 * 31 + 13 * 10));
  EXPECT_GT(below["cure_through_voxels"], 13 * 10 * 16);
}

}  // namespace
}  // namespace slicecorr::test
