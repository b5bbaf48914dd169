// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Layer by layer with the program as its users run it: from a mesh to the figures, and what it
/// refuses.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "layerwise_models.hpp"
#include "made_once.hpp"
#include "program_fixture.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/slice.hpp"
#include "slicecorr/solid.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;

constexpr const char* kUvLamp = "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n";

/// Figure A.7: the ladder in an absorbance height of 110 um.
const Command kResin{"--printer", "small.toml", "--resin", "figure-2-2", "--ha-um", "110"};
/// The rule for machines that only step; tests of lifts are lifts_test and lifts_program_test.
const Command kLayerwise{"--mode", "layerwise", "--lifts", "none"};
const Command kRung{"--x", "80", "--y", "60"};
const double kA = std::pow(10.0, -50.0 / 110);

class Layerwise : public ProgramFixture {
 protected:
  Layerwise() {
    write_stl(folder_ / "ladder.stl", ladder());
    write("small.toml", kSmallPrinter + std::string(kUvLamp));
    made_once("Layerwise", folder_, {"target.uvj"}, [&] {
      good({"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
            "small.toml"});
    });
  }
  Command correct(const std::string& from, const std::string& to) const {
    return Command{"correct", from, "-o", to} + kResin;
  }
  json config_of(const std::string& stack) const {
    Entries entries = unzip(folder_ / stack);
    return json::parse(to_text(entry(entries, "config.json")));
  }
  Bytes bytes(const std::string& name) const { return read_file(folder_ / name); }

  struct Row {
    int slice = 0, grey = 0;
    double z_um = 0, intensity = 0, phi = 0, dose = 0, target = 0;
  };
  std::vector<Row> probe(const std::string& stack) const {
    const RunResult r = good(Command{"probe", stack, "--target", "target.uvj", "--quiet"} + kRung);
    std::istringstream lines(r.out);
    std::string line;
    std::getline(lines, line);
    EXPECT_EQ(line, "slice,z_um,grey,intensity_mw_cm2,phi,dose,target");
    std::vector<Row> rows;
    while (std::getline(lines, line)) {
      Row row;
      EXPECT_EQ(std::sscanf(line.c_str(), "%d,%lf,%d,%lf,%lf,%lf,%lf", &row.slice, &row.z_um,
                            &row.grey, &row.intensity, &row.phi, &row.dose, &row.target),
                7);
      rows.push_back(row);
    }
    return rows;
  }
};

TEST_F(Layerwise, LadderFromSlicesToFigures) {
  const RunResult said =
      good(correct("target.uvj", "out.uvj") + kLayerwise + Command{"--exposure-s", "0.07837"});
  EXPECT_NE(said.err.find("1.342 um above a feature"), std::string::npos) << said.err;
  EXPECT_NE(said.err.find("varies 2.848-fold"), std::string::npos) << said.err;

  // The dose at node n, seen from inside layer n: the sum of what every slice leaves there.
  const auto rows = probe("out.uvj");
  ASSERT_EQ(rows.size(), 50U);  // none are added
  for (std::size_t n = 0; n < 50; ++n) {
    const Row& row = rows[n];
    EXPECT_NEAR(row.phi, row.intensity * 0.07837 * std::log(10) / (576 * 110e-4), 1e-9);
    double sum = 0;
    for (std::size_t k = n; k < 50; ++k) {
      sum += rows[k].phi * std::pow(kA, static_cast<double>(k - n + 1));
    }
    EXPECT_NEAR(row.dose, sum, 1e-9) << n;
    EXPECT_EQ(row.target, (n >= 11 && n <= 20) || (n >= 31 && n <= 40) ? 1 : 0) << n;
    if (row.target == 1) {
      EXPECT_GE(row.dose, 1) << n;
      EXPECT_LT(row.dose, 1.005) << n;
    } else {
      EXPECT_EQ(row.grey, 0) << n;
    }
  }

  // What the stack needs to be judged is in it.
  const auto figures = json::parse(
      good({"verify", "out.uvj", "--target", "target.uvj", "--json", "-", "--quiet"}).out);
  EXPECT_EQ(figures["layers"], 50);
  EXPECT_EQ(figures["cure_through_voxels"], 0);
  EXPECT_EQ(figures["undercure_voxels"], 0);
  EXPECT_NEAR(figures["layerwise"]["cut_through_um"].get<double>(), 1.3416, 1e-4);
  EXPECT_NEAR(figures["layerwise"]["heterogeneity"].get<double>(), 2.848, 1e-3);
  const double worst = figures["height_error_um"]["max_overreach"];
  EXPECT_GE(worst, 1.3416);
  EXPECT_LT(worst, 1.3416 + 110 * std::log10(1.005));
  EXPECT_EQ(figures["height_error_um"]["max_shortfall"], 0);
  bad(5, {"verify", "out.uvj", "--target", "target.uvj", "--max-height-error-um", "1"}, {"1."});

  // The target shown as it is.
  const auto before = json::parse(
      good(Command{"verify", "target.uvj", "--target", "target.uvj", "--json", "-", "--quiet"} +
           kResin + kLayerwise + Command{"--exposure-s", "0.07837"})
          .out);
  EXPECT_GT(before["height_error_um"]["max_overreach"].get<double>(), 20);

  const auto info = json::parse(good({"info", "out.uvj", "--json", "-"}).out);
  EXPECT_EQ(info["mode"], "layerwise");
  EXPECT_EQ(info["exposure_s"], 0.07837);
  EXPECT_NEAR(info["light_s"].get<double>(), 50 * 0.07837, 1e-9);
  EXPECT_TRUE(info["print_time_s"].is_null());
  EXPECT_FALSE(info.contains("speed_mm_h"));
  EXPECT_NE(good({"info", "out.uvj"}).out.find("lifts not known"), std::string::npos);
}

TEST_F(Layerwise, RunWritesTheSameAndPictures) {
  const Command how = kLayerwise + Command{"--exposure-s",    "0.1", "--bottom-exposure-s", "0.4",
                                           "--bottom-layers", "3",   "--fade-layers",       "2"};
  good(correct("target.uvj", "steps.uvj") + how);
  good(Command{"run", "ladder.stl", "-o", "out.uvj", "--layer-um", "50"} + kResin + how);
  EXPECT_EQ(bytes("out.uvj"), bytes("steps.uvj"));
  const json proof = json::parse(to_text(bytes("out.json")));
  const json again = json::parse(
      good({"verify", "out.uvj", "--target", "target.uvj", "--json", "-", "--quiet"}).out);
  for (const auto& [key, value] : again.items()) EXPECT_EQ(proof[key], value) << key;
  EXPECT_GT(proof["layerwise"]["max_cut_through_um"], proof["layerwise"]["cut_through_um"]);

  const std::string page = to_text(bytes("out.html"));
  EXPECT_NE(page.find("Exposed layer by layer, 0.1 s as a rule"), std::string::npos);
  EXPECT_NE(page.find("\"layerwise\":true"), std::string::npos);
  EXPECT_EQ(page.find("nan"), std::string::npos);
  good({"report", "out.uvj", "--target", "target.uvj", "-o", "page.html"});
  EXPECT_GT(bytes("page.html").size(), 50000U);
  good({"section", "out.uvj", "--target", "target.uvj", "-o", "section.png"});
  EXPECT_GT(bytes("section.png").size(), 300U);
  good({"solid", "out.uvj", "--target", "target.uvj", "-o", "solid.stl", "--json", "solid.json"});
  const json solid = json::parse(to_text(bytes("solid.json")));
  const double design = solid["design_volume_mm3"];
  EXPECT_NEAR(solid["volume_mm3"].get<double>(), design, 0.06 * design);
  const auto compared = json::parse(
      good(Command{"compare", "ladder.stl", "--layer-um", "50", "--json", "-", "--quiet"} + kResin +
           how)
          .out);
  EXPECT_LT(compared["ours"]["height_error_um"]["mean_abs"].get<double>(),
            compared["erase"]["height_error_um"]["mean_abs"].get<double>());
}

/// By day one and five threads correct and one and two make the surface, by night one, two and five.
TEST_F(Layerwise, SameBytesForAnyNumberOfThreads) {
  const auto corrected = [&](const std::string& threads) {
    good(correct("target.uvj", threads + ".uvj") + kLayerwise +
         Command{"--exposure-s", "0.2", "--threads", threads});
    return bytes(threads + ".uvj");
  };
  const auto surface = [&](const std::string& threads) {
    good({"solid", "1.uvj", "-o", threads + ".ply", "--threads", threads});
    return bytes(threads + ".ply");
  };
  const Bytes stack = corrected("1"), solid = surface("1");
  EXPECT_EQ(corrected("5"), stack);
  EXPECT_EQ(surface("2"), solid);
  if (!by_night()) return;
  EXPECT_EQ(corrected("2"), stack);
  EXPECT_EQ(surface("5"), solid);
}

TEST_F(Layerwise, TimesComeFromTheArchive) {
  Entries entries = unzip(folder_ / "target.uvj");
  json config = json::parse(to_text(entry(entries, "config.json")));
  const auto save = [&](const std::string& name) {
    entry(entries, "config.json") = to_bytes(config.dump());
    make_zip(folder_ / name, entries);
  };
  bad(2, correct("target.uvj", "x.uvj") + kLayerwise, {"--exposure-s", "archive"});
  config["Properties"]["Exposure"]["LightOnTime"] = 0.2;
  for (std::size_t n = 0; n < 50; ++n) {
    config["Layers"][n]["Exposure"]["LightOnTime"] = n < 2 ? 0.8 : n == 2 ? 0.5 : 0.2;
  }
  save("timed.uvj");
  good(correct("timed.uvj", "out.uvj") + kLayerwise);
  const json out = config_of("out.uvj");
  EXPECT_EQ(out["slicecorr"]["process"]["exposure_s"], 0.2);
  // Two longer ones, one step, the normal one: that is how it is kept.
  EXPECT_EQ(out["slicecorr"]["process"]["layer_exposure_s"], json::array());
  EXPECT_EQ(out["slicecorr"]["process"]["bottom_layers"], 2);
  EXPECT_EQ(out["slicecorr"]["process"]["bottom_exposure_s"], 0.8);
  EXPECT_EQ(out["slicecorr"]["process"]["fade_layers"], 1);
  for (std::size_t n = 0; n < 50; ++n) {
    EXPECT_EQ(out["Layers"][n]["Exposure"]["LightOnTime"],
              config["Layers"][n]["Exposure"]["LightOnTime"]);
  }
  // The same as if said in options; those count over the archive.
  EXPECT_NEAR(json::parse(good({"info", "out.uvj", "--json", "-"}).out)["light_s"].get<double>(),
              2 * 0.8 + 0.5 + 47 * 0.2, 1e-9);
  good(correct("timed.uvj", "plain.uvj") + kLayerwise + Command{"--exposure-s", "0.3"});
  EXPECT_EQ(config_of("plain.uvj")["slicecorr"]["process"]["layer_exposure_s"], json::array());
  // First layers that are longer stay, and so does the step to the new one.
  EXPECT_EQ(config_of("plain.uvj")["Layers"][0]["Exposure"]["LightOnTime"], 0.8);
  EXPECT_NEAR(config_of("plain.uvj")["Layers"][2]["Exposure"]["LightOnTime"], 0.55, 1e-9);
  EXPECT_EQ(config_of("plain.uvj")["Layers"][3]["Exposure"]["LightOnTime"], 0.3);
  // Bottom layers of the properties, where single layers say nothing.
  config.erase("Layers");
  config["Properties"]["Bottom"] = {{"LightOnTime", 0.9}, {"Count", 4}};
  save("bottom.uvj");
  good(correct("bottom.uvj", "out2.uvj") + kLayerwise);
  EXPECT_EQ(config_of("out2.uvj")["slicecorr"]["process"]["bottom_layers"], 4);
  EXPECT_EQ(config_of("out2.uvj")["Layers"][3]["Exposure"]["LightOnTime"], 0.9);
  EXPECT_EQ(config_of("out2.uvj")["Layers"][4]["Exposure"]["LightOnTime"], 0.2);
  EXPECT_EQ(
      json::parse(good({"verify", "out2.uvj", "--target", "target.uvj", "--json", "-", "--quiet"})
                      .out)["cure_through_voxels"],
      0);
}

TEST_F(Layerwise, WhatDoesNotGoTogether) {
  const Command layerwise = correct("target.uvj", "x.uvj") + kLayerwise;
  const Command continuous = correct("target.uvj", "x.uvj");
  const Command speed{"--speed-mm-h", "800"}, exposure{"--exposure-s", "0.2"};
  bad(2, layerwise + speed + exposure, {"--speed-mm-h", "continuous"});
  bad(2, continuous, {"--speed-mm-h is required"});
  bad(2, continuous + speed + exposure, {"--mode layerwise"});
  bad(2, continuous + exposure, {"--mode layerwise"});
  bad(2, continuous + speed + Command{"--bottom-layers", "3"}, {"--mode layerwise"});
  bad(2, layerwise + exposure + Command{"--bottom-layers", "3"}, {"--bottom-exposure-s"});
  bad(2, layerwise + exposure + Command{"--bottom-exposure-s", "3"}, {"--bottom-layers"});
  bad(2, layerwise + exposure + Command{"--fade-layers", "3"}, {"--bottom-exposure-s"});
  bad(2, layerwise + exposure + Command{"--ramp", "outside"}, {"--ramp", "stands still"});
  bad(2, continuous + speed + Command{"--ramp", "lamp-follows"}, {"--ramp-mm"});
  bad(2, continuous + speed + Command{"--ramp-mm", "1"}, {"--ramp"});
  bad(2, continuous + speed + Command{"--ramp", "steep"}, {"--ramp"});
  for (const char* value : {"0", "soon"}) {
    bad(2, layerwise + Command{"--exposure-s", value}, {"--exposure-s", value});
  }
  bad(2, layerwise + exposure + Command{"--bottom-layers", "-1"}, {"--bottom-layers"});
  // UV light: figure 2.2's resin has no inhibition.
  bad(2, continuous + speed + Command{"--uv-mw-cm2", "50"}, {"figure-2-2", "[inhibition]"});
  bad(2, continuous + speed + Command{"--dead-zone-um", "50"}, {"figure-2-2", "[inhibition]"});
  bad(2, continuous + speed + Command{"--uv-mw-cm2", "50", "--dead-zone-um", "50"},
      {"one of them"});
  bad(2, continuous + speed + Command{"--uv-schedule", "patterned"}, {"--dead-zone-um"});
  bad(2, continuous + speed + Command{"--uv-schedule", "constant"}, {"--uv-mw-cm2"});
  bad(2, continuous + speed + Command{"--window-cure", "perhaps"}, {"--window-cure"});
}

TEST_F(Layerwise, UvOptionsWantLampAndInhibition) {
  write("inhibited.toml",
        "name = \"inhibited\"\n[cure]\nabsorbance_height_um = 110.0\nabsorbance_base = 10\n"
        "critical_dose_mj_cm3 = 576.0\n[inhibition]\nbeta = 0.73\nabsorbance_height_um = 20.0\n"
        "absorbance_base = 10\n");
  write("dark.toml", kSmallPrinter);
  const auto with = [](const std::string& printer) {
    return Command{"correct", "target.uvj",     "-o",     "x.uvj",     "--printer",    printer,
                   "--resin", "inhibited.toml", "--mode", "layerwise", "--exposure-s", "0.2"};
  };
  bad(2, with("dark.toml") + Command{"--uv-mw-cm2", "50"}, {"small", "[uv]"});
  bad(2, with("small.toml") + Command{"--dead-zone-um", "20", "--uv-schedule", "patterned"},
      {"floods the window"});
  bad(2, with("small.toml") + Command{"--uv-mw-cm2", "5", "--uv-schedule", "per-slice"},
      {"--dead-zone-um"});
  // Without any, it is said that UV light is left out; with a printer without lamp it is not.
  EXPECT_NE(good(with("small.toml")).err.find("counts as off"), std::string::npos);
  EXPECT_EQ(good(with("dark.toml")).err.find("counts as off"), std::string::npos);
}

TEST_F(Layerwise, InfeasibleSaysWhatWouldDo) {
  const Command layerwise = correct("target.uvj", "x.uvj") + kLayerwise;
  bad(3, layerwise + Command{"--exposure-s", "0.05"},
      {"does not gel through", "at least 0.07837 s", "at least 156.74 mW/cm²"});
  bad(3, layerwise + Command{"--exposure-s", "10"}, {"black pixels gel", "less than 1.7855 s"});
  bad(3,
      layerwise +
          Command{"--exposure-s", "0.2", "--bottom-exposure-s", "9", "--bottom-layers", "1"},
      {"layer 0, exposed for 9 s"});
  // A part higher than the stage travels: no slices are added, so only its height counts.
  write("short.toml", kSmallPrinter + std::string("[stage]\ntravel_mm = 2\n"));
  bad(3,
      Command{"correct", "target.uvj", "-o", "x.uvj", "--printer", "short.toml", "--resin",
              "figure-2-2", "--ha-um", "110", "--exposure-s", "0.2"} +
          kLayerwise,
      {"2.500 mm high", "travels 2 mm"});
}

TEST_F(Layerwise, RampsLeaveImagesAlone) {
  const Command how{"--printer", "small.toml", "--resin", "figure-2-2", "--speed-mm-h", "1000"};
  good(Command{"correct", "target.uvj", "-o", "plain.uvj"} + how);
  good(Command{"correct", "target.uvj", "-o", "ramp.uvj", "--ramp", "lamp-follows", "--ramp-mm",
               "0.5"} +
       how);
  const Entries plain = unzip(folder_ / "plain.uvj"), ramp = unzip(folder_ / "ramp.uvj");
  ASSERT_EQ(plain.size(), ramp.size());
  for (std::size_t i = 0; i < plain.size(); ++i) {
    ASSERT_EQ(plain[i].first, ramp[i].first);
    if (plain[i].first != "config.json") {
      EXPECT_EQ(plain[i].second, ramp[i].second);
    }
  }
  EXPECT_EQ(config_of("plain.uvj")["slicecorr"]["format"], 1);
  const json config = config_of("ramp.uvj");
  EXPECT_EQ(config["slicecorr"]["format"], 2);
  EXPECT_EQ(config["Layers"][0]["Exposure"]["LightPWM"], std::lround(255 * std::sqrt(0.05)));
  EXPECT_EQ(config["Layers"][20]["Exposure"]["LightPWM"], 255);
  const auto time = [&](const char* stack) {
    return json::parse(good({"info", stack, "--json", "-"}).out)["print_time_s"].get<double>();
  };
  EXPECT_GT(time("ramp.uvj"), time("plain.uvj"));
  EXPECT_NE(good({"info", "ramp.uvj"}).out.find("lamp follows"), std::string::npos);
}

/// A stack in memory.
class Memory final : public SliceSource {
 public:
  explicit Memory(Images images) : images_(std::move(images)) {}
  const Grid& grid() const override { return images_.grid; }
  PixelBox bounds() const override { return {0, 0, grid().width_px, grid().height_px}; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    Bytes rows;
    for (int n = 0; n < grid().layers; ++n) {
      rows.clear();
      for (int y = band.y0; y < band.y1; ++y) {
        const auto from = images_.slices[static_cast<std::size_t>(n)].begin() +
                          static_cast<std::ptrdiff_t>(y) * grid().width_px;
        rows.insert(rows.end(), from + band.x0, from + band.x1);
      }
      sink(n, rows.data());
    }
  }

 private:
  Images images_;
};

TEST(LayerwiseSolid, IsClosedOnAnyStackAndHasTheTeeth) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    Images images = random_images(20, 18, 12, seed);
    images.grid.layer_um = 50;
    const CureModel m = figure_a_7(0.1 + 0.1 * seed);
    const MeshReport r = inspect(solid_mesh(Memory(images), m));
    EXPECT_EQ(r.defects.open_edges, 0U) << seed;
    EXPECT_EQ(r.defects.misoriented_edges, 0U) << seed;
    EXPECT_GT(r.volume, 0) << seed;
  }
  // A box of full light in slices 4 to 7: from where the dose has fallen to 1 above it to the
  // window of the last slice, where it begins at phi'.
  Images images;
  images.grid = {16, 14, 12, 50, 40, 50};
  for (int n = 0; n < 12; ++n) {
    Bytes pixels(16 * 14);
    for (std::size_t y = 4; y < 10 && n >= 4 && n < 8; ++y) {
      for (std::size_t x = 3; x < 9; ++x) pixels[y * 16 + x] = 255;
    }
    images.slices.push_back(std::move(pixels));
  }
  const CureModel m = figure_a_7(0.12);
  const MeshReport r = inspect(solid_mesh(Memory(images), m));
  EXPECT_EQ(r.defects.open_edges, 0U);
  EXPECT_EQ(r.defects.misoriented_edges, 0U);
  double w = 0;
  for (int n = 12; n-- > 4;) w = (w + (n < 8 ? m.phi_max() : m.phi_min())) * m.a;
  const double reach_um = 110 * std::log10(w + m.phi_min());
  ASSERT_LT(reach_um, 50);
  EXPECT_NEAR(r.lower[2], (4 * 50 - reach_um) * 1e-3, 0.05 / 1024 + 1e-6);
  EXPECT_NEAR(r.upper[2], 8 * 0.05, 1e-6);
}

void expect_benchy_as_designed(double scale) {
  const std::string path = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(path);
  slicecorr::Setup setup{linear_printer(1, 100), resin(576, 110), layerwise(0.16)};
  setup.printer.width_px = 1280;
  setup.printer.height_px = 800;
  setup.process.bottom_exposure_s = 1;
  setup.process.bottom_layers = 5;
  setup.process.fade_layers = 10;
  const MeshSlices target(read_mesh(path, {.scale = scale}), setup.printer, SliceOptions{});
  const TemporaryFolder folder;
  const Correction c = correct_stack(target, setup, folder / "benchy.uvj", {.before = true});
  EXPECT_EQ(c.after.cure_through_voxels + c.after.undercure_voxels, 0U);
  EXPECT_EQ(c.after.lost_features + c.after.merged_features + c.after.gap_teeth, 0U);
  EXPECT_EQ(c.after.greatest_shortfall_um, 0);
  const CureModel m = make_cure_model(setup.printer, setup.resin, setup.process, 50);
  ASSERT_TRUE(c.after.layerwise);
  EXPECT_LE(c.after.greatest_overreach_um,
            c.after.layerwise->max_cut_through_um + m.level_step_um() + 1e-9);
  EXPECT_LT(c.after.height_error_um.mean() * 10, c.before->height_error_um.mean());
}
TEST(LayerwiseReal, BenchyComesOutAsDesigned) { expect_benchy_as_designed(0.3); }
TEST(LayerwiseRealNight, BenchyComesOutAsDesigned) { expect_benchy_as_designed(1); }

}  // namespace
}  // namespace slicecorr::test
