// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Resin that ends, platforms that send light back and supports that are left alone, with the
/// programs as people run them. What they say is held against sums over the images themselves, which
/// are read by libpng here.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "made_once.hpp"
#include "program_fixture.hpp"
#include "real_files.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;

constexpr int kWidth = kSmallWidth, kHeight = kSmallHeight;
constexpr double kLayerUm = 50, kHeightUm = 2000;
/// Figure 2.2: absorbance height 2000 um, 576 mJ/cm³, 1000 mm/h.
const Command kProcess{"--printer", "small.toml", "--resin", "figure-2-2", "--speed-mm-h", "1000"};
const Command kRung{"--x", "80", "--y", "60"};

class Bath : public ProgramFixture {
 protected:
  Bath() {
    write_stl(folder_ / "ladder.stl", ladder());
    write("small.toml", kSmallPrinter);
  }
  void slice(const std::string& part, const std::string& target) const {
    good({"slice", part, "-o", target, "--layer-um", "50", "--printer", "small.toml"});
  }
  void slice_ladder() const {
    made_once("Bath", folder_, {"target.uvj"}, [&] { slice("ladder.stl", "target.uvj"); });
  }
};

double phi_of(std::uint8_t grey) { return kPhiMin + (kPhiMax - kPhiMin) * grey / 255.0; }

/// Dose at `zeta` slices from the platform below column (x, y), summed up over the images: what of
/// each slice's light is absorbed between its window and the next, on the way to the point and back
/// from the platform, of slices within the resin's depth.
double dose_of(const std::vector<Bytes>& images, int x, int y, double zeta, double depth_slices,
               double reflectance) {
  const double fall = kLayerUm / kHeightUm * std::log(10.0);
  double dose = 0;
  for (std::size_t n = 0; n < images.size(); ++n) {
    const double from = std::max(0.0, static_cast<double>(n) - zeta);
    const double to = std::min(depth_slices, static_cast<double>(n) + 1 - zeta);
    if (to <= from) continue;
    const double there = std::exp(-from * fall) - std::exp(-to * fall);
    const std::uint8_t grey = images[n][static_cast<std::size_t>(y * kWidth + x)];
    dose += phi_of(grey) * there * (1 + reflectance * std::exp(-2 * zeta * fall));
  }
  return dose;
}

/// Wrong voxels of coverage 0 and 1 by these sums.
struct Wrong {
  int cured_through = 0, undercured = 0, left_alone = 0;
};
Wrong wrong_voxels(const std::vector<Bytes>& images, const std::vector<Bytes>& target,
                   const std::vector<Bytes>& left_alone, double depth_slices, double reflectance) {
  Wrong wrong;
  std::map<Bytes, Wrong> known;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const auto at = static_cast<std::size_t>(y * kWidth + x);
      Bytes key;
      for (const Bytes& image : images) key.push_back(image[at]);
      for (const Bytes& image : target) key.push_back(image[at]);
      for (const Bytes& image : left_alone) key.push_back(image[at]);
      const auto [found, is_new] = known.try_emplace(key);
      Wrong& column = found->second;
      for (std::size_t n = 0; is_new && n < images.size(); ++n) {
        const std::uint8_t cover = n < target.size() ? target[n][at] : std::uint8_t{0};
        if (n < left_alone.size() && left_alone[n][at] > 0 && 2 * left_alone[n][at] >= cover) {
          ++column.left_alone;
          continue;
        }
        if (cover != 0 && cover != 255) continue;
        const bool prints =
            dose_of(images, x, y, static_cast<double>(n) + 0.5, depth_slices, reflectance) >= 1;
        column.cured_through += prints && cover == 0;
        column.undercured += !prints && cover == 255;
      }
      wrong.cured_through += column.cured_through;
      wrong.undercured += column.undercured;
      wrong.left_alone += column.left_alone;
    }
  }
  return wrong;
}

struct Case {
  Command options;
  double depth_slices, reflectance;
};

TEST_F(Bath, DosesAreThoseOfTheImages) {
  slice_ladder();
  const auto target = images("target.uvj");
  for (const Case& c :
       {Case{{}, 1e9, 0}, Case{{"--resin-depth-um", "3000"}, 60, 0},
        Case{{"--platform-reflectance", "0.3"}, 1e9, 0.3},
        Case{{"--resin-depth-um", "2050", "--platform-reflectance", "0.2"}, 41, 0.2}}) {
    SCOPED_TRACE(::testing::PrintToString(c.options));
    good(Command{"correct", "target.uvj", "-o", "stack.uvj"} + kProcess + c.options);
    const auto shown = images("stack.uvj");
    // The stack remembers: probe and verify are told nothing.
    for (const char* x : {"80", "50"}) {
      const RunResult r = good({"probe", "stack.uvj", "--x", x, "--y", "60", "--quiet"});
      std::istringstream lines(r.out);
      std::string line;
      std::getline(lines, line);
      std::size_t n = 0;
      while (std::getline(lines, line)) {
        const double dose = std::stod(line.substr(line.rfind(',') + 1));
        const double summed =
            dose_of(shown, std::stoi(x), 60, static_cast<double>(n), c.depth_slices, c.reflectance);
        ASSERT_NEAR(dose, summed, 1e-9 + 1e-9 * summed) << "node " << n;
        ++n;
      }
      EXPECT_EQ(n, shown.size());
    }
    const json f = figures("stack.uvj", "target.uvj");
    const Wrong wrong = wrong_voxels(shown, target, {}, c.depth_slices, c.reflectance);
    EXPECT_EQ(f["cure_through_voxels"], wrong.cured_through);
    EXPECT_EQ(f["undercure_voxels"], wrong.undercured);
    EXPECT_EQ(wrong.cured_through, 0);
    EXPECT_EQ(wrong.undercured, 0);
    EXPECT_LT(f["height_error_um"]["max_abs"], 1.0);
    EXPECT_FALSE(f.contains("left_alone_voxels"));
    const json said = json::parse(good({"info", "stack.uvj", "--json", "-"}).out);
    EXPECT_EQ(said.contains("resin_depth_um"), c.depth_slices < 1e9);
    EXPECT_EQ(said.value("platform_reflectance", 0.0), c.reflectance);
    // Pictures, surfaces and time count what the stack says, too: both of it.
    if (c.options.size() < 4) continue;
    good({"section", "stack.uvj", "--target", "target.uvj", "-o", "section.png"});
    good({"report", "stack.uvj", "--target", "target.uvj", "-o", "report.html"});
    good({"solid", "stack.uvj", "-o", "solid.stl"});
    good({"simulate", "stack.uvj", "--x", "80", "--y", "60", "-o", "history.svg"});
  }
}

TEST_F(Bath, LightThatGelsAtADepth) {
  // Even light of phi needs phi (1 - 10^(-H / ha)) = 1: 1.01010 at 4000 um, 1.46248 at 1000 um.
  TriangleMesh block;
  add_box(block, {0, 0, 0}, {1, 1, 8});
  write_stl(folder_ / "block.stl", block);
  slice("block.stl", "block.uvj");
  for (const auto& [depth_um, needed] : {std::pair{"4000", 1.01010}, {"1000", 1.46248}}) {
    // Uncorrected slices are full light: the dose far from their end is phi over what is needed.
    const RunResult r = good(
        Command{"probe", "block.uvj", "--resin-depth-um", depth_um, "--quiet"} + kProcess + kRung);
    std::istringstream lines(r.out);
    std::string line;
    std::getline(lines, line);
    std::getline(lines, line);
    const double dose = std::stod(line.substr(line.rfind(',') + 1));
    EXPECT_NEAR(kPhiMax / dose, needed, 5e-6) << depth_um;
  }
}

TEST_F(Bath, LightFromThePlatform) {
  // 1 + rho 10^(-2 z / ha): 1.09487 at 500 um for rho 0.3.
  slice_ladder();
  const auto dose_at_500 = [&](const Command& more) {
    const RunResult r = good(Command{"probe", "target.uvj", "--quiet"} + kProcess + kRung + more);
    std::istringstream lines(r.out);
    std::string line;
    for (int n = 0; n < 12; ++n) std::getline(lines, line);
    EXPECT_EQ(line.substr(0, 7), "10,500,");
    return std::stod(line.substr(line.rfind(',') + 1));
  };
  EXPECT_NEAR(dose_at_500({"--platform-reflectance", "0.3"}) / dose_at_500({}), 1.09487, 5e-6);
  write("mirror.toml", std::string(kSmallPrinter) + "[vat]\nplatform_reflectance = 0.3\n");
  Command process = kProcess;
  process[1] = "mirror.toml";
  const RunResult r = good(Command{"probe", "target.uvj", "--quiet"} + process + kRung);
  const RunResult o =
      good(Command{"probe", "target.uvj", "--quiet", "--platform-reflectance", "0.3"} + kProcess +
           kRung);
  EXPECT_EQ(r.out, o.out);
  // The option may take back what the printer's file says.
  EXPECT_EQ(good(Command{"probe", "target.uvj", "--quiet", "--platform-reflectance", "0"} +
                 process + kRung)
                .out,
            good(Command{"probe", "target.uvj", "--quiet"} + kProcess + kRung).out);
}

TEST_F(Bath, WithoutThemTheBytesAreThoseOfDeepResinAndADarkPlatform) {
  slice_ladder();
  good(Command{"correct", "target.uvj", "-o", "plain.uvj"} + kProcess);
  good(Command{"correct", "target.uvj", "-o", "dark.uvj", "--platform-reflectance", "0"} +
       kProcess);
  EXPECT_EQ(read_file(folder_ / "plain.uvj"), read_file(folder_ / "dark.uvj"));
  // So deep that it doesn't matter: the images are the same, the printer that is recorded differs.
  good(Command{"correct", "target.uvj", "-o", "deep.uvj", "--resin-depth-um", "100000"} + kProcess);
  EXPECT_EQ(images("plain.uvj"), images("deep.uvj"));
  Entries plain = unzip(folder_ / "plain.uvj"), deep = unzip(folder_ / "deep.uvj");
  EXPECT_EQ(to_text(entry(plain, "config.json")).find("resin_depth"), std::string::npos);
  EXPECT_NE(to_text(entry(deep, "config.json")).find("resin_depth"), std::string::npos);
}

TEST_F(Bath, LayerByLayer) {
  slice_ladder();
  const Command process{"--printer", "small.toml", "--resin",   "figure-2-2",   "--ha-um",
                        "110",       "--mode",     "layerwise", "--exposure-s", "1.5"};
  const auto probed = [&](const Command& more) {
    return good(Command{"probe", "target.uvj", "--quiet"} + process + kRung + more).out;
  };
  // The same doses times the light that returns.
  std::istringstream none(probed({})), some(probed({"--platform-reflectance", "0.5"}));
  std::string a, b;
  std::getline(none, a);
  std::getline(some, b);
  for (int n = 0; n < 50; ++n) {
    std::getline(none, a);
    std::getline(some, b);
    const double factor = 1 + 0.5 * std::pow(10.0, -2 * n * 50 / 110.0);
    EXPECT_NEAR(std::stod(b.substr(b.rfind(',') + 1)),
                factor * std::stod(a.substr(a.rfind(',') + 1)), 1e-9)
        << n;
  }
  for (const Command& more :
       {Command{"--platform-reflectance", "0.5"}, Command{"--resin-depth-um", "500"}}) {
    good(Command{"correct", "target.uvj", "-o", "stack.uvj"} + process + more);
    const json f = figures("stack.uvj", "target.uvj");
    EXPECT_EQ(f["undercure_voxels"], 0);
    EXPECT_EQ(f["lost_features"], 0);
  }
}

TEST_F(Bath, WrongNumbersAreRefused) {
  slice_ladder();
  const Command correct = Command{"correct", "target.uvj", "-o", "stack.uvj"} + kProcess;
  bad(2, correct + Command{"--platform-reflectance", "1.1"}, {"--platform-reflectance"});
  bad(2, correct + Command{"--platform-reflectance", "-0.1"}, {"--platform-reflectance"});
  bad(2, correct + Command{"--resin-depth-um", "0"}, {"--resin-depth-um"});
  bad(2, correct + Command{"--resin-depth-um", "49"}, {"49 um deep", "slice of 50 um"});
  // phi 6.25 gels from 151.4 um on: whole slices, 200 um.
  bad(3, correct + Command{"--resin-depth-um", "150"}, {"not deep enough", "at least 200 um"});
  const RunResult shallow = good(correct + Command{"--resin-depth-um", "3900"});
  EXPECT_NE(shallow.err.find("less than two absorbance heights"), std::string::npos) << shallow.err;
  const RunResult deep = good(correct + Command{"--resin-depth-um", "4000"});
  EXPECT_EQ(deep.err.find("absorbance heights"), std::string::npos) << deep.err;
  write("bad.toml", std::string(kSmallPrinter) + "[vat]\nplatform_reflectance = 30\n");
  Command process = kProcess;
  process[1] = "bad.toml";
  bad(2, Command{"correct", "target.uvj", "-o", "other.uvj"} + process,
      {"bad.toml", "platform_reflectance", "at most 1"});
  // Black gels where so much of it comes back: 18 mW/cm² at phi 1.125 does so anyhow, 13 at 0.81
  // beside a mirror.
  write("bright.toml",
        "name = \"bright\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 50.0\n[blue]\n"
        "calibration = [[0, 13.0], [255, 100.0]]\n");
  process[1] = "bright.toml";
  bad(3,
      Command{"correct", "target.uvj", "-o", "other.uvj", "--platform-reflectance", "0.5"} +
          process,
      {"beside the platform"});
}

/// The ladder's rails and rungs, with a pillar from the platform to the lower rung, one between the
/// rungs, and a raft.
TriangleMesh supports() {
  TriangleMesh mesh;
  add_box(mesh, {-0.3, -0.3, 0}, {0.3, 0.3, 0.6});
  add_box(mesh, {-0.25, -0.25, 1.0}, {0.25, 0.25, 1.6});
  add_box(mesh, {-2.5, -1.5, -0.3}, {2.5, 1.5, 0});
  return mesh;
}

TEST_F(Bath, SupportsAreLeftAlone) {
  write_stl(folder_ / "supports.stl", supports());
  const Command run{"run", "ladder.stl", "-o", "out.uvj", "--layer-um", "50"};
  const RunResult told = good(run + kProcess + Command{"--leave-alone", "supports.stl"});
  EXPECT_NE(told.err.find("voxels left alone"), std::string::npos) << told.err;
  const json proof = json::parse(to_text(read_file(folder_ / "out.json")));
  // What was left alone lies beside the stack, and whoever measures it finds it there.
  EXPECT_NE(told.err.find("out-left-alone.uvj: what was left alone"), std::string::npos)
      << told.err;
  EXPECT_EQ(told.err.find("touches nothing"), std::string::npos) << told.err;
  const json again = json::parse(good({"verify", "out.uvj", "--json", "-"}).out);
  for (const char* key : {"left_alone_voxels", "cure_through_voxels", "undercure_voxels", "gaps",
                          "height_error_um"}) {
    EXPECT_EQ(again[key], proof[key]) << key;
  }
  // What is said otherwise than the stack says it is told.
  EXPECT_EQ(good({"verify", "out.uvj"}).err.find("is measured with"), std::string::npos);
  const std::string other = good({"verify", "out.uvj", "--speed-mm-h", "700"}).err;
  EXPECT_NE(other.find("--speed-mm-h: the stack was made with "), std::string::npos) << other;
  EXPECT_NE(other.find(", and is measured with 700"), std::string::npos) << other;
  good({"section", "out.uvj", "-o", "out.svg"});
  good({"simulate", "out.uvj", "--x", "80", "--y", "60", "-o", "out.csv"});
  // Both are placed together: the raft, six slices, lies below the ladder's 50.
  const auto shown = images("out.uvj");
  EXPECT_GE(shown.size(), 56U);
  // The same from stacks that are sliced apart, each with its place said.
  TriangleMesh all = ladder();
  append(all, supports());
  write_stl(folder_ / "all.stl", all);
  slice("all.stl", "all.uvj");
  write_stl(folder_ / "alone.stl", supports());
  TriangleMesh on_plate = supports();
  for (Point3& v : on_plate.vertices) v = {v[0] + 4, v[1] + 3, v[2] + 0.3};
  write_stl(folder_ / "on-plate.stl", on_plate);
  // The target holds the supports, too, as slicers often export them.
  good(Command{"correct", "all.uvj", "-o", "apart.uvj", "--leave-alone", "on-plate.stl"} +
       kProcess);
  EXPECT_EQ(images("apart.uvj"), shown);
  const json f = figures("apart.uvj", "all.uvj", {"--leave-alone", "on-plate.stl"});
  for (const char* key : {"left_alone_voxels", "cure_through_voxels", "undercure_voxels",
                          "target_voxels", "runs", "gaps"}) {
    EXPECT_EQ(f[key], proof[key]) << key;
  }

  // By the images: what is left alone shows what it is sliced to, the rest prints as designed.
  // Columns 74 to 85 hold the pillar, 75 to 84 the one between the rungs.
  for (std::size_t n = 0; n < 56; ++n) {
    const auto grey = [&](int x, int y) {
      return shown[n][static_cast<std::size_t>(y * kWidth + x)];
    };
    const double z_mm = (static_cast<double>(n) + 0.5) * 0.05 - 0.3;
    const bool left = z_mm < 0.6 || (z_mm > 1.0 && z_mm < 1.6);
    EXPECT_TRUE(!left || grey(80, 60) == 255) << n;
  }
  std::vector<Bytes> target(56, Bytes(static_cast<std::size_t>(kWidth * kHeight), 0)),
      left = target;
  for (int n = 0; n < 56; ++n) {
    const double z = (n + 0.5) * 0.05 - 0.3;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const double px = (x + 0.5) * 0.05 - 4, py = 3 - (y + 0.5) * 0.05;
        const auto at = static_cast<std::size_t>(y * kWidth + x);
        const auto in = [](double v, double low, double high) { return v > low && v < high; };
        const bool rail = in(std::abs(px), 1, 2) && in(py, -1, 1) && in(z, 0, 2.5);
        const bool rung =
            in(px, -1, 1) && in(py, -1, 1) && (in(z, 0.55, 1.05) || in(z, 1.55, 2.05));
        const bool pillar = (in(px, -0.3, 0.3) && in(py, -0.3, 0.3) && in(z, 0, 0.6)) ||
                            (in(px, -0.25, 0.25) && in(py, -0.25, 0.25) && in(z, 1.0, 1.6));
        const bool raft = in(px, -2.5, 2.5) && in(py, -1.5, 1.5) && in(z, -0.3, 0);
        target[static_cast<std::size_t>(n)][at] = rail || rung ? 255 : 0;
        left[static_cast<std::size_t>(n)][at] = pillar || raft ? 255 : 0;
      }
    }
  }
  const Wrong wrong = wrong_voxels(shown, target, left, 1e9, 0);
  EXPECT_EQ(proof["left_alone_voxels"], wrong.left_alone);
  EXPECT_EQ(proof["cure_through_voxels"], wrong.cured_through);
  EXPECT_EQ(proof["undercure_voxels"], wrong.undercured);
  EXPECT_EQ(wrong.undercured, 0);
  EXPECT_EQ(proof["lost_features"], 0);
  // The pillar's full light reaches no gap here: it stands on the raft, the other on a rung.
  EXPECT_EQ(wrong.cured_through, 0);
}

TEST_F(Bath, HeightsOfTheMeshThatAreLeftOutAreTold) {
  const char* const told =
      "edges lie at slices: the mesh's own heights are not counted below a platform";
  const Command run = Command{"run", "ladder.stl", "-o", "out.uvj", "--layer-um", "50"} + kProcess;
  const Command reflecting{"--platform-reflectance", "0.05"};
  EXPECT_NE(good(run + reflecting).err.find(told), std::string::npos);
  EXPECT_EQ(good(run + reflecting + Command{"--surface", "slices"}).err.find(told),
            std::string::npos);
  EXPECT_EQ(good(run).err.find(told), std::string::npos);
}

TEST_F(Bath, ARealPartOnAPillar) {
  const std::string boat = real_file("meshes/clean/3DBenchy.stl");
  if (!std::filesystem::exists(boat)) GTEST_SKIP() << "without the real meshes";
  TriangleMesh pillar;
  // Beside the hull and up to its height: Benchy stands 60 mm long, 48 mm high.
  add_box(pillar, {-31, -3, 0}, {-29.5, 3, 6});
  write_stl(folder_ / "pillar.stl", pillar);
  const Command run{"run", boat, "-o", "boat.uvj", "--layer-um", "50", "--scale", "0.1"};
  good(run + kProcess + Command{"--leave-alone", "pillar.stl"});
  const json proof = json::parse(to_text(read_file(folder_ / "boat.json")));
  EXPECT_GT(proof["left_alone_voxels"], 0);
  EXPECT_EQ(proof["lost_features"], 0);
  EXPECT_EQ(proof["undercure_voxels"], 0);
}

TEST_F(Bath, WrongFilesToLeaveAloneAreRefused) {
  slice_ladder();
  const Command correct = Command{"correct", "target.uvj", "-o", "out.uvj"} + kProcess;
  const auto leave = [&](const std::string& file) {
    return correct + Command{"--leave-alone", file};
  };
  bad(2, leave("none.stl"), {"none.stl"});
  bad(2, leave("none.uvj"), {"none.uvj"});
  // Less high, and so of fewer slices: a stack is taken by its word.
  TriangleMesh low;
  add_box(low, {0, 0, 0}, {1, 1, 1});
  write_stl(folder_ / "low.stl", low);
  slice("low.stl", "low.uvj");
  bad(2, leave("low.uvj"), {"low.uvj", "20 slices", "50"});
  good({"slice", "ladder.stl", "-o", "fine.uvj", "--layer-um", "25", "--printer", "small.toml"});
  bad(2, leave("fine.uvj"), {"fine.uvj", "voxels of 50 x 50 x 25"});
  write("wide.toml",
        "name = \"wide\"\n[display]\nwidth_px = 170\nheight_px = 120\npixel_um = 50.0\n"
        "[blue]\ncalibration = [[0, 1.0], [255, 100.0]]\n");
  good({"slice", "ladder.stl", "-o", "wide.uvj", "--layer-um", "50", "--printer", "wide.toml"});
  bad(2, leave("wide.uvj"), {"wide.uvj", "170 x 120"});
  // A mesh that is higher than the part, or lies below the platform or beside the display.
  TriangleMesh high, deep, beside;
  add_box(high, {1, 1, 0}, {2, 2, 3});
  add_box(deep, {1, 1, -1}, {2, 2, 1});
  add_box(beside, {-1, 1, 0}, {2, 2, 1});
  write_stl(folder_ / "high.stl", high);
  write_stl(folder_ / "deep.stl", deep);
  write_stl(folder_ / "beside.stl", beside);
  bad(2, leave("high.stl"), {"high.stl", "60 slices"});
  bad(2, leave("deep.stl"), {"deep.stl", "platform"});
  bad(2, leave("beside.stl"), {"beside.stl", "beyond the display"});
  // All of the part.
  bad(2, leave("target.uvj"), {"nothing of the part is left to correct"});
  // A corrected stack.
  good(Command{"correct", "target.uvj", "-o", "made.uvj"} + kProcess);
  bad(2, leave("made.uvj"), {"made.uvj", "corrected stack"});
  bad(2,
      {"correct", "target.uvj", "-o", "low.stl", "--leave-alone", "low.stl", "--printer",
       "small.toml", "--resin", "figure-2-2", "--speed-mm-h", "1000"},
      {"is an input"});
}

}  // namespace
}  // namespace slicecorr::test
