// The page of a tomographic print in a real browser: its controls work, it fits a phone, it stays small.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "browser.hpp"
#include "slicecorr/tomo/report.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

namespace fs = std::filesystem;
using test::browse;
using test::chromium;
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

nlohmann::json selftest_in(const Folder& folder, const std::string& html, const char* window) {
  std::ofstream(folder.path / "page.html") << html;
  const auto result = browse(folder, {"--dump-dom", window},
                             "file://" + (folder.path / "page.html").string() + "#selftest");
  return test::selftest_of(result.out);
}

TEST(TomoPage, ControlsWorkAndItCountsAsTheLibraryDoes) {
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
  const Folder folder;
  const Printed p = gyroid(41);
  const std::string html = report_page(p, "gyroid");
  for (const char* window : {"--window-size=1280,900", "--window-size=500,900"}) {
    const auto test = selftest_in(folder, html, window);
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
  const fs::path out = fs::path(SLICECORR_BIN_DIR).parent_path() / "report-pictures";
  fs::create_directories(out);
  std::ofstream(folder.path / "page.html") << report_page(gyroid(41), "gyroid");
  std::ofstream(folder.path / "phone.html")
      << "<body style='margin:0'><iframe src='page.html' width=400 height=6500 style='border:0'>";
  const std::vector<std::tuple<std::string, std::string, std::vector<std::string>>> looks = {
      {"tomo-desk.png", "page.html", {"--window-size=1280,4800"}},
      {"tomo-dark.png",
       "page.html",
       {"--window-size=1280,4800", "--blink-settings=preferredColorScheme=0"}},
      {"tomo-phone.png", "phone.html", {"--window-size=500,6500"}}};
  for (const auto& [name, page, flags] : looks) {
    fs::remove(out / name);
    auto all = flags;
    all.push_back("--screenshot=" + (out / name).string());
    const auto result = browse(folder, all, "file://" + (folder.path / page).string());
    ASSERT_TRUE(fs::exists(out / name)) << result.err.substr(0, 2000);
    EXPECT_GT(fs::file_size(out / name), 30000U) << name;
  }
}

/// 5.9 million voxels with noise in their doses, and frames of noise.
TEST(TomoPage, AFewMegabytes) {
  const std::string html = report_page(gyroid(181), "gyroid");
  EXPECT_LT(html.size(), 4500000U);
  EXPECT_GT(html.size(), 500000U);
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed: page made, not opened";
  const Folder folder;
  const auto test = selftest_in(folder, html, "--window-size=1280,900");
  ASSERT_TRUE(test.is_object());
  EXPECT_TRUE(test["ok"].get<bool>()) << test.dump();
  RecordProperty("draw_ms", test["drawMs"].get<int>());
}

}  // namespace
}  // namespace slicecorr::tomo
