// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What displays show of beams, vats in printer files, and jobs as files.
#include "slicecorr/tomo/beams_job.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "beams_parts.hpp"
#include "refusal.hpp"
#include "slicecorr/beam_vat.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/beams_page.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::tomo {
namespace {

using test::beam_setup;
using test::lattice_part;
using test::part_of;
using test::refusal;
using testing::HasSubstr;

std::string printer_toml(const std::string& more = "") {
  return R"(name = "vat"
[display]
width_px = 60
height_px = 40
pixel_um = 100
[blue]
wavelength_nm = 532
calibration = [[0, 0.5], [255, 10.0]]
)" + more;
}

Printer printer() { return parse_printer(printer_toml(), "vat.toml"); }

BeamVat vat_of(const std::string& beams) {
  const std::string text = printer_toml("[beams]\n" + beams);
  return *parse_beam_vat(text, "vat.toml", parse_printer(text, "vat.toml"));
}

const char* const kSix = R"(vat_mm = [2, 2, 2]
from = ["-x", "-y", "-z", "+x", "+y", "+z"]
)";

TEST(BeamVats, AreReadFromPrinterFiles) {
  EXPECT_FALSE(parse_beam_vat(printer_toml(), "vat.toml", printer()));
  const BeamVat vat = vat_of(std::string(kSix) + R"(display = [1, 1, 2, 2, 3, 3]
middle_px = [[15, 20], [45, 20], [15, 20], [45, 20], [15, 20], [45, 20]]
mirror = [false, false, false, true, true, true]
)");
  EXPECT_EQ(vat.inside_mm, (std::array<double, 3>{2, 2, 2}));
  ASSERT_EQ(vat.ways.size(), 6U);
  EXPECT_EQ(vat.displays(), 3);
  EXPECT_EQ(side_of(vat.ways[4]), "+y");
  EXPECT_EQ(vat.ways[4].column_px, 15);
  EXPECT_TRUE(vat.ways[4].mirror);
  // Without lists: a display each, in whose middle the image is.
  EXPECT_EQ(vat_of(kSix).displays(), 6);
  EXPECT_EQ(vat_of(kSix).ways[5].column_px, 30);
  EXPECT_EQ(vat_of(kSix).ways[5].row_px, 20);
}

TEST(BeamVats, SayFileLineAndKeyOfWhatIsWrong) {
  const auto refused = [](const std::string& beams) { return refusal([&] { vat_of(beams); }); };
  EXPECT_THAT(refused("from = [\"-x\"]\n"), HasSubstr("vat_mm"));
  EXPECT_THAT(refused("vat_mm = [2, 2]\nfrom = [\"-x\"]\n"), HasSubstr("[x, y, z]"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 0]\nfrom = [\"-x\"]\n"), HasSubstr("each above 0"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\n"), HasSubstr("from"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"x\"]\n"), HasSubstr("'x' is no side"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"-x\", \"-x\"]\n"), HasSubstr("\"-x\" twice"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"-x\", \"-y\"]\ndisplay = [1]\n"),
              HasSubstr("list of 2"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"-x\"]\ndisplay = [0]\n"),
              HasSubstr("from 1 to 16"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"-x\"]\nmiddle_px = [[61, 3]]\n"),
              HasSubstr("within the image of 60 x 40 pixels"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"-x\"]\nmirror = [1]\n"),
              HasSubstr("true or false"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"-x\"]\nlevels = 8\n"), HasSubstr("focal_mm"));
  EXPECT_THAT(refused("vat_mm = [2, 2, 2]\nfrom = [\"-x\"]\nfocal_mm = 100\n"),
              HasSubstr("pitch_um"));
  EXPECT_THAT(refused(std::string("vat_mm = [2, 2, 2]\nfrom = [\"-x\"]\nfocal_mm = 100\n") +
                      "pitch_um = 8\nlevels = 1\n"),
              HasSubstr("levels"));
  EXPECT_THAT(refusal([] {
                way_of(vat_of("vat_mm = [2, 2, 2]\nfrom = [\"-x\"]\n"), {2, false});
              }),
              HasSubstr("no beam from -z"));
}

TEST(BeamJobs, DisplaysShowCellsWhereTheirLightGoes) {
  // A vat of 20 cells of 0.1 mm, and one cell of it beside the middle in x, y and z. Each display is
  // looked at along with its light: right is the way of the light times up.
  const int cell[3] = {13, 8, 15};
  const double middle[3] = {0.35, -0.15, 0.55};  // mm from the vat's middle
  const Box<std::uint8_t> part = part_of(20, 20, 20, [&](int x, int y, int z) {
    return x == cell[0] && y == cell[1] && z == cell[2];
  });
  BeamSetup setup = beam_setup(6, 0.1);
  const BeamPrint print = find_beams(part, setup);
  for (const bool mirror : {false, true}) {
    const std::string all =
        mirror ? "true, true, true, true, true, true" : "false, false, false, false, false, false";
    const BeamVat vat = vat_of(std::string(kSix) + "mirror = [" + all + "]\n");
    const ShownBeams shown = shown_beams(print.images, setup, vat, printer(), 10);
    ASSERT_EQ(shown.displays.size(), 6U);
    for (std::size_t k = 0; k < 6; ++k) {
      const BeamWay& way = vat.ways[k];
      double light[3] = {0, 0, 0}, up[3] = {0, 0, 0}, right_mm = 0, up_mm = 0;
      light[way.axis] = way.from_plus ? -1 : 1;
      up[way.axis == 2 ? 1 : 2] = 1;
      for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        right_mm += (light[j] * up[l] - light[l] * up[j]) * middle[i];
        up_mm += up[i] * middle[i];
      }
      if (mirror) right_mm = -right_mm;
      const GreyImage& image = shown.displays[static_cast<std::size_t>(way.display) - 1];
      std::vector<std::pair<int, int>> lit;
      for (int row = 0; row < 40; ++row) {
        for (int column = 0; column < 60; ++column) {
          if (image.pixels[static_cast<std::size_t>(row) * 60 + column] == 255) {
            lit.emplace_back(column, row);
          }
        }
      }
      ASSERT_EQ(lit.size(), 1U) << side_of(way);
      EXPECT_NEAR(lit[0].first + 0.5, 30 + right_mm / 0.1, 1e-9) << side_of(way);
      EXPECT_NEAR(lit[0].second + 0.5, 20 - up_mm / 0.1, 1e-9) << side_of(way);
      // And back: the cell gets all of it, its neighbours what black still gives.
      const BeamImage& back = shown.images[k];
      const int row = way.axis == 2 ? cell[1] : cell[2], column = way.axis == 0 ? cell[1] : cell[0];
      EXPECT_EQ(back.at(row, column), 1);
      EXPECT_NEAR(back.at(row, column + 1), 0.05, 1e-7);
    }
  }
}

TEST(BeamJobs, LevelsAreTheNearestAndBlackStillShines) {
  const BeamSetup setup = beam_setup(3, 0.1);
  std::vector<BeamImage> images;
  for (const Beam& beam : setup.beams) images.push_back({beam, 1, 1, {0.5F}});
  const ShownBeams shown = shown_beams(images, setup, vat_of(kSix), printer(), 8);
  // 4 mW/cm² of 0.5 to 10 in 256 levels.
  const double step = 9.5 / 255, level = std::round((4 - 0.5) / step);
  EXPECT_EQ(*std::max_element(shown.displays[0].pixels.begin(), shown.displays[0].pixels.end()),
            static_cast<int>(level));
  EXPECT_NEAR(shown.images[0].share[0], (0.5 + level * step) / 8, 1e-6);
  EXPECT_THAT(refusal([&] { shown_beams(images, setup, vat_of(kSix), printer(), 11); }),
              HasSubstr("gives up to 10"));
}

TEST(BeamJobs, CellsGetTheirOwnLightWhereverTheyLieOnPixels) {
  // Odd numbers of cells lie half a pixel beside those of a display with an even number; three pixels
  // to a cell lie in it.
  std::mt19937 random(5);
  const Printer p = printer();
  for (const double cell_mm : {0.1, 0.3}) {
    for (const int cells : {10, 11}) {
      const BeamSetup setup = beam_setup(6, cell_mm);
      std::vector<BeamImage> images;
      for (const Beam& beam : setup.beams) {
        BeamImage image{beam, cells, cells, {}};
        for (int i = 0; i < cells * cells; ++i) {
          image.share.push_back(0.05F + 0.95F * static_cast<float>(random() % 256) / 255);
        }
        images.push_back(std::move(image));
      }
      const ShownBeams shown = shown_beams(images, setup, vat_of(kSix), p, 10);
      for (std::size_t k = 0; k < images.size(); ++k) {
        for (std::size_t i = 0; i < images[k].share.size(); ++i) {
          ASSERT_NEAR(shown.images[k].share[i], images[k].share[i], 0.5 / 255) << cells << " " << i;
        }
      }
    }
  }
}

TEST(BeamJobs, ImagesMustFitOnTheirDisplays) {
  const Box<std::uint8_t> part =
      part_of(50, 50, 50, [](int x, int y, int z) { return x + y + z < 140; });
  const BeamSetup setup = beam_setup(3, 0.1);
  const BeamPrint print = find_beams(part, setup);
  BeamVat vat = plain_vat({5, 5, 5}, {"-x", "-y", "-z"}, printer());
  EXPECT_THAT(
      refusal([&] { shown_beams(print.images, setup, vat, printer(), 10); }),
      HasSubstr("from -x is 5 x 5 mm large and lies beyond the edge of display 1 (6 x 4 mm)"));
  // Two beams on one display, one over the other.
  const Box<std::uint8_t> small =
      part_of(20, 20, 20, [](int x, int y, int z) { return x + y + z < 50; });
  const BeamPrint both = find_beams(small, setup);
  for (BeamWay& way : vat.ways) way.display = 1;
  EXPECT_THAT(refusal([&] { shown_beams(both.images, setup, vat, printer(), 10); }),
              HasSubstr("lies over that of another on display 1"));
}

BeamJob lattice_job(const BeamVat& vat) {
  BeamJob job;
  job.printer = printer();
  job.resin.name = "resin";
  job.resin.absorbance_height10_um = 1e5;
  job.resin.critical_dose_mj_cm3 = 20;
  job.resin.gel_dose_mj_cm3 = 20;
  job.vat = vat;
  job.setup = beam_setup(3, 0.1, absorption_per_cm(job.resin) * 0.1);
  const Box<std::uint8_t> part = lattice_part();
  const BeamPrint print = find_beams(part, job.setup);
  job.cells[0] = job.cells[1] = job.cells[2] = 14;
  job.brightest_mw_cm2 = 10;
  job.shown = shown_beams(print.images, job.setup, vat, job.printer, 10);
  job.contrast = print.figures.contrast;
  job.window = {2, std::numeric_limits<double>::infinity()};
  job.exposure_s = 4;
  return job;
}

TEST(BeamJobs, ComeBackFromTheirFiles) {
  const test::TemporaryFolder folder;
  const BeamJob job =
      lattice_job(vat_of(std::string(kSix) + "display = [1, 2, 3, 4, 4, 4]\n"
                                             "middle_px = [[30, 20], [30, 20], [30, "
                                             "20], [10, 20], [30, 20], [50, 20]]\n"));
  const std::string path = folder / "job.uvj";
  write_beam_job(path, job);
  EXPECT_TRUE(is_beam_job(path));
  const BeamJob back = read_beam_job(path);
  EXPECT_EQ(back.printer, job.printer);
  EXPECT_EQ(back.resin, job.resin);
  EXPECT_EQ(back.vat, job.vat);
  EXPECT_EQ(back.setup.beams, job.setup.beams);
  EXPECT_EQ(back.exposure_s, 4);
  EXPECT_EQ(back.window.first_s, 2);
  EXPECT_TRUE(std::isinf(back.window.last_s));
  ASSERT_EQ(back.shown.displays.size(), 4U);
  for (std::size_t d = 0; d < 4; ++d) {
    EXPECT_EQ(back.shown.displays[d].pixels, job.shown.displays[d].pixels);
  }
  // The same bytes once more.
  write_beam_job(folder / "again.uvj", job);
  EXPECT_EQ(test::read_file(path), test::read_file(folder / "again.uvj"));
}

TEST(BeamJobs, DamageIsToldByEntryAndKey) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "job.uvj";
  const BeamJob job = lattice_job(vat_of(kSix));
  write_beam_job(path, job);
  const test::Entries good = test::unzip(path);
  const auto refused = [&](const std::function<void(test::Entries&)>& change) {
    test::Entries entries = good;
    change(entries);
    test::make_zip(path, entries);
    return refusal([&] { read_beam_job(path); });
  };
  const auto config = [&](const std::string& from, const std::string& to) {
    return refused([&](test::Entries& entries) {
      std::string text = test::to_text(test::entry(entries, "config.json"));
      const std::size_t at = text.find(from);
      ASSERT_NE(at, std::string::npos) << from;
      text.replace(at, from.size(), to);
      test::entry(entries, "config.json") = test::to_bytes(text);
    });
  };
  EXPECT_THAT(config("\"format\": 1", "\"format\": 2"), HasSubstr("has format 2"));
  EXPECT_THAT(config("\"kind\": \"beams\"", "\"kind\": \"beam\""), HasSubstr("slicecorr beams"));
  EXPECT_THAT(config("\"exposure_s\": 4.0", "\"exposure_s\": 0"), HasSubstr("exposure_s"));
  EXPECT_THAT(config("\"from\": \"-x\"", "\"from\": \"-w\""), HasSubstr("'-w' is no side"));
  EXPECT_THAT(config("{", "["), HasSubstr("not valid JSON"));
  EXPECT_THAT(config("\"exposure_s\": 4.0", "\"exposure_s\": 0.4"),
              HasSubstr("the job's time_window_s"));
  EXPECT_THAT(config("\"exposure_s\": 4.0", "\"exposure_s\": 4.1"), HasSubstr("(checksum)"));
  EXPECT_THAT(config("\"mirror\": false", "\"mirror\": true"), HasSubstr("(checksum)"));
  const auto blackened = [&](const std::string& name, int width, int height) {
    return refused([&](test::Entries& entries) {
      const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
      test::entry(entries, name) =
          encode_png(GreyImage{width, height, std::vector<std::uint8_t>(pixels)});
    });
  };
  EXPECT_THAT(blackened("display/2.png", job.printer.width_px, job.printer.height_px),
              HasSubstr("its images were changed"));
  const BeamImage& beam = job.shown.images[0];
  EXPECT_THAT(blackened("beam/00.png", beam.columns, beam.rows),
              HasSubstr("its images were changed"));
  EXPECT_THAT(refused([](test::Entries& entries) {
                std::erase_if(entries, [](const auto& e) { return e.first == "display/2.png"; });
              }),
              HasSubstr("display/2.png"));
  EXPECT_THAT(refused([](test::Entries& entries) {
                test::entry(entries, "display/1.png") =
                    encode_png(GreyImage{3, 3, std::vector<std::uint8_t>(9)});
              }),
              HasSubstr("display/1.png"));
  EXPECT_FALSE(is_beam_job(folder / "nothing.uvj"));
}

TEST(BeamJobs, DisplaysThatDelayLightShowPhases) {
  const std::string text = R"(name = "vat"
[display]
width_px = 128
height_px = 128
pixel_um = 8
[blue]
wavelength_nm = 532
calibration = [[0, 0.0], [255, 10.0]]
[beams]
vat_mm = [1.4, 1.4, 1.4]
from = ["-x", "-y", "-z"]
focal_mm = 100
pitch_um = 8
image_mm = [1.5, 1.5]
)";
  const Printer p = parse_printer(text, "vat.toml");
  const BeamVat vat = *parse_beam_vat(text, "vat.toml", p);
  ASSERT_TRUE(vat.phase);
  const BeamSetup setup = beam_setup(3, 0.1);
  const BeamPrint print = find_beams(lattice_part(), setup);
  const ShownBeams shown = shown_beams(print.images, setup, vat, p, 10);
  ASSERT_EQ(shown.efficiency.size(), 3U);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_GT(shown.efficiency[k], 0.7);
    // 160 cells of 0.01 mm² at 10 mW/cm².
    double cells = 0;
    for (const float share : print.images[k].share) cells += share;
    EXPECT_NEAR(shown.laser_mw[k], cells * 1e-4 * 10 / shown.efficiency[k], 1e-9);
    const auto& pixels = shown.displays[k].pixels;
    EXPECT_GT(*std::max_element(pixels.begin(), pixels.end()), 200);
  }
}

}  // namespace
}  // namespace slicecorr::tomo
