// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The page of a tomographic print in a real browser: its controls work, it fits a phone, it stays small.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "devtools.hpp"
#include "slicecorr/tomo/report.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

namespace fs = std::filesystem;
using test::chromium;
using test::DrivenPage;
using Folder = test::BrowserFolder;

/// |gyroid| < 0.45 in a cylinder, on n^3 voxels, with doses that grow from void into the part; they
/// are out by some noise.
Printed gyroid(int n) {
  Printed p;
  p.job.printer = bench_printer();
  p.job.resin = bench_resin();
  const double voxel = 8.0 / (n - 1);
  p.job.printer.pixel_x_um = p.job.printer.pixel_y_um = 900 * voxel;
  p.job.printer.width_px = p.job.printer.height_px = n + n / 4;
  p.job.sampling = {voxel, n, 180};
  p.job.turns = 5;
  p.job.part = {n, n, n, {}};
  p.dose = {n, n, n, {}};
  std::mt19937 random(7);
  std::uniform_real_distribution<double> noise(-1.5, 1.5);
  const double k = 3 * std::numbers::pi, half = 0.5 * (n - 1);
  for (int z = 0; z < n; ++z) {
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const double u = (x - half) / half, v = (y - half) / half, w = (z - half) / half;
        const double g =
            std::abs(std::sin(k * u) * std::cos(k * v) + std::sin(k * v) * std::cos(k * w) +
                     std::sin(k * w) * std::cos(k * u));
        const bool inside = std::hypot(u, v) < 0.7 && std::abs(w) < 0.9 && g < 0.45;
        p.job.part.values.push_back(inside ? 255 : 0);
        const double r = std::hypot(u, v);
        p.dose.values.push_back(
            r > 1 ? 0.0F : static_cast<float>((inside ? 26 : 22 - 8 * r) - 6 * g + noise(random)));
      }
    }
  }
  const Bench bench = make_bench(p.job.printer, p.job.resin, p.job.sampling);
  const TomoGrid& grid = bench.grid;
  p.job.levels.assign(grid.blocks() * grid.light_of_block(), 0);
  for (auto& level : p.job.levels) level = static_cast<std::uint16_t>(random() % 256);
  p.job.history.resize(20000, {.rung = 0.9, .loss = 1, .contrast = 1});
  p.figures = figures_of(p.job, p.dose, p.job.part);
  return p;
}

/// Writes a page; its address.
std::string write(const Folder& folder, const std::string& html) {
  std::ofstream(folder.path / "page.html") << html;
  return "file://" + (folder.path / "page.html").string();
}

TEST(TomoPage, ControlsWorkAndItCountsAsTheLibraryDoes) {
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
  const Folder folder;
  const Printed p = gyroid(41);
  const std::string address = write(folder, report_page(p, "gyroid"));
  DrivenPage page;
  for (const int window : {1280, 500}) {
    const auto test = page.selftest(address, window);
    ASSERT_TRUE(test.is_object());
    EXPECT_EQ(test.value("error", ""), "");
    EXPECT_GE(test["checks"].size(), 13U);
    for (const auto& [name, passed] : test["checks"].items()) {
      EXPECT_TRUE(passed.get<bool>()) << window << ": " << name;
    }
    const GelTimes g = gel_times(p, 1);
    std::size_t part = 0, parts = 0, empty = 0;
    for (std::size_t k = 0; k < p.dose.values.size(); ++k) {
      const bool gels = p.dose.values[k] >= p.figures.gel_dose_mj_cm3;
      parts += p.job.part.values[k] == 255;
      part += p.job.part.values[k] == 255 && gels;
      empty += p.job.part.values[k] == 0 && gels;
    }
    EXPECT_GT(empty, 0U);
    EXPECT_EQ(test["counts"]["100"]["parts"], parts);
    EXPECT_EQ(test["counts"]["100"]["part"], part);
    EXPECT_EQ(test["counts"]["100"]["empty"], empty);
    EXPECT_EQ(test["counts"]["0"]["part"], 0);
  }
}

TEST(TomoPage, PicturesOnDeskAndPhoneLightAndDark) {
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
  const Folder folder;
  DrivenPage page;
  page.looks(write(folder, report_page(gyroid(41), "gyroid")),
             fs::path(SLICECORR_BIN_DIR).parent_path() / "report-pictures", "tomo",
             "document.documentElement.dataset.ready");
}

/// n^3 voxels with noise in their doses, and frames of noise.
void expect_small_page_of(int n, std::size_t most) {
  const std::string html = report_page(gyroid(n), "gyroid");
  EXPECT_LT(html.size(), most);
  EXPECT_GT(html.size(), 500000U);
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed: page made, not opened";
  const Folder folder;
  DrivenPage page;
  const auto test = page.selftest(write(folder, html), 1280);
  ASSERT_TRUE(test.is_object());
  EXPECT_TRUE(test["ok"].get<bool>()) << test.dump();
  testing::Test::RecordProperty("draw_ms", test["drawMs"].get<int>());
}

/// With 0.3 times the voxels of the larger one it may have less than half of its bytes.
TEST(TomoPage, AFewMegabytes) { expect_small_page_of(121, 2000000); }

/// 5.9 million voxels.
TEST(TomoPageNight, AFewMegabytes) { expect_small_page_of(181, 4500000); }

}  // namespace
}  // namespace slicecorr::tomo
