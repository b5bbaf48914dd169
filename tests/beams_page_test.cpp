// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The page of a print with beams in a real browser.
#include "slicecorr/tomo/beams_page.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "beams_parts.hpp"
#include "devtools.hpp"

namespace slicecorr::tomo {
namespace {

namespace fs = std::filesystem;
using test::chromium;
using Folder = test::BrowserFolder;

TEST(BeamsPage, ControlsWorkAndItCountsAsTheLibraryDoes) {
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
  // A ball with silhouettes, which gel more than it.
  const Box<std::uint8_t> part = test::ball_part(24);
  BeamJob job;
  job.printer.name = "display";
  job.printer.width_px = job.printer.height_px = 64;
  job.printer.pixel_x_um = job.printer.pixel_y_um = 100;
  job.printer.calibration = {{0, 0.0}, {255, 10.0}};
  job.resin.name = "resin";
  job.resin.absorbance_height10_um = 1e7;
  job.resin.gel_dose_mj_cm3 = job.resin.critical_dose_mj_cm3 = 20;
  job.vat = plain_vat({2.4, 2.4, 2.4}, {"-x", "-y", "-z"}, job.printer);
  job.setup = test::beam_setup(3, 0.1);
  job.cells[0] = job.cells[1] = job.cells[2] = 24;
  job.brightest_mw_cm2 = 10;
  const BeamPrint print = find_beams(part, job.setup);
  job.shown = shown_beams(print.images, job.setup, job.vat, job.printer, 10);
  job.window = time_window(print.figures, time_to_gel_of(job.resin), 10);
  // A little more than the hull needs.
  job.exposure_s = 1.01 * job.window.first_s;
  const std::string why = "its hull is larger";
  const std::string html =
      beams_page({job, part, print, print.light, print.figures, why}, "ball", {});
  const Folder folder;
  std::ofstream(folder.path / "page.html") << html;
  test::DrivenPage page;
  for (const int window : {1280, 500}) {
    const auto test = page.selftest("file://" + (folder.path / "page.html").string(), window);
    ASSERT_TRUE(test.is_object());
    EXPECT_EQ(test.value("error", ""), "");
    for (const auto& [name, passed] : test["checks"].items()) {
      EXPECT_TRUE(passed.get<bool>()) << window << ": " << name;
    }
    EXPECT_EQ(test["counts"]["100"]["part"], print.figures.part_cells);
    EXPECT_EQ(test["counts"]["100"]["empty"], print.hull_cells);
    EXPECT_EQ(test["counts"]["0"]["part"], 0);
  }
}

}  // namespace
}  // namespace slicecorr::tomo
