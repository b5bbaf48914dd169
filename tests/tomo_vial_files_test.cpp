// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What printer files say of vials that are not round and of rods, resin files of turbid gels; and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "refusal.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "stack/formats/definition_json.hpp"

namespace slicecorr::vial_files_test {
namespace {

using test::refusal;
using testing::HasSubstr;

std::string printer_text(const std::string& vial) {
  return "[display]\nwidth_px = 1024\nheight_px = 768\npixel_um = 54.0\n"
         "[blue]\ncalibration = [[0, 0.0], [255, 10.0]]\n[vial]\n" +
         vial +
         "[optics]\nkind = \"telecentric\"\n[rotation]\ndeg_s = 25\ndirection = \"clockwise\"\n";
}
Vial vial_of(const std::string& text) { return *parse_printer(printer_text(text), "p.toml").vial; }
std::string wrong(const std::string& text) {
  return refusal([&] { parse_printer(printer_text(text), "p.toml"); });
}

const detail::JsonSource kJob{"a.frames", "config.json"};
detail::JsonNode<nlohmann::json> node_of(const nlohmann::json& json) { return {json, "", kJob}; }

/// As a job keeps a printer.
void expect_kept(const Vial& vial) {
  Printer p = parse_printer(printer_text("outer_mm = 2\ninner_mm = 1.5\n"), "p.toml");
  p.vial = vial;
  const nlohmann::json json = nlohmann::json::parse(detail::printer_json(p).dump());
  EXPECT_EQ(*detail::read_printer(node_of(json)).vial, vial);
}

const std::string kSquare = "shape = \"square\"\nside_mm = 12.5\nwall_mm = 1.25\n";

TEST(VialFiles, SquareWithRods) {
  const Vial v = vial_of(kSquare +
                         "corner_mm = 0.5\nn_wall = 1.47\nglass_rods = [[0, 1, 3, 1.52]]\n"
                         "metal_rods = [[3, -2.5, 1, 0.6], [-3, 0, 0.5, 0]]\n");
  EXPECT_EQ(v.shape, VialShape::square);
  EXPECT_EQ(v.side_mm, 12.5);
  EXPECT_EQ(v.rods,
            (std::vector<Rod>{{0, 1, 3, 1.52, 0}, {3, -2.5, 1, 0, 0.6}, {-3, 0, 0.5, 0, 0}}));
  // Corners: half of the side less the radius, its diagonal and the radius.
  EXPECT_NEAR(v.outer_mm, std::sqrt(2.0) * 5.75 + 0.5, 1e-3);
  EXPECT_NEAR(v.inner_mm, std::sqrt(2.0) * 5, 1e-12);
  EXPECT_TRUE(v.traced());
  expect_kept(v);
  const Vial round = vial_of("outer_mm = 2\ninner_mm = 1.5\nglass_rods = [[0, 0, 1, 1.5]]\n");
  EXPECT_EQ(round.shape, VialShape::round);
  EXPECT_TRUE(round.traced());
  expect_kept(round);
  EXPECT_FALSE(vial_of("shape = \"round\"\nouter_mm = 2\ninner_mm = 1.5\n").traced());
}

TEST(VialFiles, OutlinesAreListsOrTables) {
  const Vial list = vial_of(
      "shape = \"outline\"\nwall_mm = 0.5\noutline = [[-3, -2], [3, -2], [3, 2], [-3, 2]]\n");
  EXPECT_NEAR(list.inner_mm, std::hypot(2.5, 1.5), 1e-12);
  expect_kept(list);
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) /
                                       ("slicecorr-outline-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const std::string text = "shape = \"outline\"\nwall_mm = 0.5\noutline = \"box.csv\"\n";
  const auto with = [&](const std::string& table) {
    std::ofstream(folder / "box.csv") << table;
    return parse_printer(printer_text(text), (folder / "p.toml").string());
  };
  EXPECT_EQ(*with("x_mm,y_mm\n-3,-2\n3,-2\n3,2\n-3,2\n").vial, list);
  EXPECT_THAT(
      refusal([&] { with("-3,-2\n3,x\n3,2\n"); }),
      testing::AllOf(HasSubstr("box.csv"), HasSubstr("line 2"), HasSubstr("expected x_mm,y_mm")));
  EXPECT_THAT(refusal([&] { with("-3,-2\n3,-2,1\n3,2\n"); }), HasSubstr("line 2"));
  EXPECT_THAT(refusal([&] { with("-3,-2\n3,2\n"); }), HasSubstr("has 2 corners; expected 3"));
  std::filesystem::remove(folder / "box.csv");
  EXPECT_THAT(refusal([&] { parse_printer(printer_text(text), (folder / "p.toml").string()); }),
              HasSubstr("is not a file that can be read"));
  std::filesystem::remove_all(folder);
}

TEST(VialFiles, WhatDoesNotGoTogetherIsRefusedByKey) {
  EXPECT_THAT(wrong("shape = \"oval\"\nouter_mm = 2\ninner_mm = 1\n"),
              testing::AllOf(HasSubstr("vial.shape"), HasSubstr("is 'oval'; expected \"round\"")));
  EXPECT_THAT(wrong(kSquare + "outer_mm = 5\n"),
              testing::AllOf(HasSubstr("vial.outer_mm"),
                             HasSubstr("is not of a vial of shape \"square\"")));
  EXPECT_THAT(wrong("side_mm = 2\nouter_mm = 2\ninner_mm = 1\n"), HasSubstr("vial.side_mm"));
  EXPECT_THAT(wrong(kSquare + "jacket_outer_mm = 20\n"), HasSubstr("vial.jacket_outer_mm"));
  EXPECT_THAT(wrong("shape = \"square\"\nwall_mm = 1\n"), HasSubstr("vial.side_mm: missing"));
  EXPECT_THAT(wrong("shape = \"square\"\nside_mm = 4\n"), HasSubstr("vial.wall_mm: missing"));
  EXPECT_THAT(wrong("shape = \"square\"\nside_mm = 4\nwall_mm = 2\n"),
              HasSubstr("vial.wall_mm: is 2; expected less than half of side_mm, 4"));
  EXPECT_THAT(wrong(kSquare + "corner_mm = 7\n"), HasSubstr("vial.corner_mm"));
  EXPECT_THAT(wrong("shape = \"outline\"\nwall_mm = 1\n"), HasSubstr("vial.outline: missing"));
  EXPECT_THAT(wrong("shape = \"outline\"\nwall_mm = 1\noutline = [[1, 2, 3]]\n"),
              HasSubstr("vial.outline: expected [[x_mm, y_mm], ...]"));
  EXPECT_THAT(
      wrong(
          "shape = \"outline\"\nwall_mm = 0.1\noutline = [[-2, -2], [2, -2], [0, 0.5], [2, 2], [-2, 2]]\n"),
      HasSubstr("turns inwards at (0, 0.5) mm"));
  EXPECT_THAT(wrong(kSquare + "glass_rods = [[0, 0, 3, 0.9]]\n"), HasSubstr("vial.glass_rods"));
  EXPECT_THAT(wrong(kSquare + "glass_rods = [[0, 0, -3, 1.5]]\n"), HasSubstr("vial.glass_rods"));
  EXPECT_THAT(wrong(kSquare + "glass_rods = [[4, 0, 3, 1.5]]\n"),
              HasSubstr("reaches into the wall"));
  EXPECT_THAT(wrong(kSquare + "metal_rods = [[0, 0, 1, 0.5], [0.9, 0, 1, 0.5]]\n"),
              HasSubstr("expected resin between them"));
  EXPECT_THAT(wrong(kSquare + "metal_rods = [[0, 0, 1, 1.5]]\n"), HasSubstr("vial.metal_rods"));
  EXPECT_THAT(wrong(kSquare + "metal_rods = \"rod\"\n"), HasSubstr("vial.metal_rods: expected [["));
  EXPECT_THAT(wrong(kSquare + "metal_rods = [[0, 0, nan, 0.5]]\n"), HasSubstr("vial.metal_rods"));
}

std::string resin_text(const std::string& keys) {
  return "name = \"r\"\nn = 1.5\n[cure]\ncritical_dose_mj_cm3 = 20\n" + keys;
}
TEST(VialFiles, TurbidResin) {
  const Resin r =
      parse_resin(resin_text("extinction_per_cm = 5\nalbedo = 0.9\nanisotropy = 0.95\n"), "r.toml");
  EXPECT_EQ(r.turbidity, (Turbidity{5, 0.9, 0.95}));
  EXPECT_NEAR(absorption_per_cm(r), 0.5, 1e-12);
  const nlohmann::json json = nlohmann::json::parse(detail::resin_json(r).dump());
  EXPECT_EQ(detail::read_resin(node_of(json)).turbidity, r.turbidity);
  const auto says = [](const std::string& keys) {
    return refusal([&] { parse_resin(resin_text(keys), "r.toml"); });
  };
  EXPECT_THAT(says("extinction_per_cm = 5\n"), HasSubstr("albedo: missing"));
  EXPECT_THAT(says("extinction_per_cm = 5\nalbedo = 0.9\n"), HasSubstr("anisotropy: missing"));
  EXPECT_THAT(says("extinction_per_cm = 5\nalbedo = 1\nanisotropy = 0.95\n"), HasSubstr("albedo"));
  EXPECT_THAT(says("extinction_per_cm = 5\nalbedo = 0.9\nanisotropy = 0.5\n"),
              HasSubstr("anisotropy"));
  EXPECT_THAT(says("absorption_per_cm = 1\nalbedo = 0.9\n"),
              HasSubstr("expected extinction_per_cm too"));
  EXPECT_THAT(
      says("extinction_per_cm = 5\nalbedo = 0.9\nanisotropy = 0.95\nabsorption_per_cm = 5\n"),
      HasSubstr("of the extinction 0.5 is left"));
  EXPECT_THAT(
      says("extinction_per_cm = 5\nalbedo = 0.9\nanisotropy = 0.95\nscatter_um2_per_um = 2\n"),
      HasSubstr("expected one of both"));
  // Nothing else counts it.
  const Printer dlp =
      load_printer(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
  Process process;
  process.speed_mm_h = 800;
  EXPECT_THAT(refusal([&] { make_cure_model(dlp, r, process, 50); }),
              HasSubstr("is not counted in printing slice by slice"));
}

}  // namespace
}  // namespace slicecorr::vial_files_test
