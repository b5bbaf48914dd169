// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The report in a real browser: its controls work, its pictures come, it fits a phone.
#include <gtest/gtest.h>
#include <zlib.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "devtools.hpp"
#include "ladder.hpp"
#include "lattice.hpp"
#include "models.hpp"
#include "report/page_parts.hpp"
#include "run_program.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/slice.hpp"
#include "support/text/base64.hpp"

namespace slicecorr {
namespace {

namespace fs = std::filesystem;

using test::chromium;
using test::DrivenPage;
using Folder = test::BrowserFolder;

struct Page {
  Setup setup;
  std::string html;
  StackInfo info;
};

/// `cells` of a lattice, in a grid that just holds it.
Page lattice_page(const MeshSlices& target, const Setup& setup) {
  const CorrectedSlices corrected(target, setup);
  StackInfo info;
  info.grid = corrected.grid();
  const Prediction after = verify_stack(corrected, target, setup);
  const Prediction before = verify_stack(target, target, setup);
  return {setup,
          make_report(gather_report(corrected, target, setup, info, after, before, "lattice")),
          info};
}

class ReportPage : public ::testing::Test {
 protected:
  void SetUp() override {
    if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
    Printer printer = test::linear_printer(1, 100);
    printer.width_px = 200;
    printer.height_px = 80;
    setup_ = {printer, test::resin(576, 2000), test::process(1000)};
    // Along x it has more pixels than the page has cells.
    target_.emplace(test::lattice(3, 1, 1, 3, 0.4), printer, SliceOptions{});
  }
  /// Writes a page; its address.
  std::string write(const std::string& html) const {
    std::ofstream(folder_.path / "page.html") << html;
    return "file://" + (folder_.path / "page.html").string();
  }
  Folder folder_;
  slicecorr::Setup setup_;
  std::optional<MeshSlices> target_;
};

TEST_F(ReportPage, ControlsWork) {
  const CorrectedSlices corrected(*target_, setup_);
  const ReducedVolume v = reduce_volume(corrected, *target_, setup_, kReportCells);
  const std::string address = write(lattice_page(*target_, setup_).html);
  DrivenPage page;
  for (const int window : {1280, 500}) {
    const auto test = page.selftest(address, window);
    ASSERT_TRUE(test.is_object());
    EXPECT_EQ(test.value("error", ""), "");
    for (const auto& [name, passed] : test["checks"].items()) {
      EXPECT_TRUE(passed.get<bool>()) << window << ": " << name;
    }
    EXPECT_GE(test["checks"].size(), 20U);
    RecordProperty("first_picture_ms", test["firstPictureMs"].get<int>());
    // The page computes a column as the program does.
    const int x = test["column"]["x"], y = test["column"]["y"];
    const auto rows = probe_stack(corrected, nullptr, setup_, x, y);
    ASSERT_EQ(test["column"]["levels"].size(), rows.size());
    for (const ProbeRow& row : rows) {
      const auto n = static_cast<std::size_t>(row.slice);
      ASSERT_EQ(test["column"]["levels"][n].get<int>(), row.grey);
      ASSERT_NEAR(test["column"]["dose"][n].get<double>(), row.dose, 1e-9);
    }
    // Wrong cells as counted by the library.
    std::size_t through = 0;
    for (const std::uint8_t s : v.before.state) through += s & kCellCureThrough;
    EXPECT_EQ(test["wrong"][0][0].get<std::size_t>(), through);
  }
}

/// The kernel of layer by layer exposure as tables of two distances, with a tail: as the page gets
/// it under UV light.
std::string kernel_of(const CureModel& m) {
  std::vector<float> values;
  for (const double place : {1.0, m.root_a, m.a}) {
    for (const double distance : {1.0, m.a}) {
      for (const double phi : m.level_phi) {
        values.push_back(static_cast<float>(phi * place * distance));
      }
    }
  }
  uLongf size = compressBound(values.size() * sizeof(float));
  std::vector<std::uint8_t> bytes(size);
  compress(bytes.data(), &size, reinterpret_cast<const Bytef*>(values.data()),
           values.size() * sizeof(float));
  bytes.resize(size);
  return nlohmann::json{{"near", 2},
                        {"levels", m.level_phi.size()},
                        {"a", m.a},
                        {"setting", {0}},
                        {"values", detail::base64(bytes)}}
      .dump();
}

TEST_F(ReportPage, ColumnsLayerByLayerAndFromAKernel) {
  slicecorr::Setup setup = setup_;
  setup.resin = test::resin(576, 110);
  setup.process = Process{};
  setup.process.mode = ExposureMode::layerwise;
  setup.process.exposure_s = 0.16;
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, 50);
  DrivenPage page;
  for (const bool kernel : {false, true}) {
    // Both give the same doses; the tables are in single precision. A schedule of its own goes with
    // the first only.
    setup.process.bottom_exposure_s = kernel ? 0 : 0.5;
    setup.process.bottom_layers = kernel ? 0 : 3;
    std::string html = lattice_page(*target_, setup).html;
    const std::string mark = "\"layerwise\":true";
    const auto at = html.find(mark);
    ASSERT_NE(at, std::string::npos);
    if (kernel) html.insert(at + mark.size(), ",\"kernel\":" + kernel_of(model));
    const auto test = page.selftest(write(html), 1280);
    ASSERT_TRUE(test.is_object());
    EXPECT_EQ(test.value("error", ""), "");
    for (const auto& [name, passed] : test["checks"].items()) {
      EXPECT_TRUE(passed.get<bool>()) << kernel << ": " << name;
    }
    const CorrectedSlices corrected(*target_, setup);
    const auto rows = probe_stack(corrected, nullptr, setup, test["column"]["x"].get<int>(),
                                  test["column"]["y"].get<int>());
    ASSERT_EQ(test["column"]["levels"].size(), rows.size());
    for (const ProbeRow& row : rows) {
      const auto n = static_cast<std::size_t>(row.slice);
      ASSERT_NEAR(test["column"]["dose"][n].get<double>(), row.dose, kernel ? 1e-6 : 1e-9) << n;
    }
  }
}

TEST_F(ReportPage, PicturesOnDeskAndPhoneLightAndDark) {
  const std::string address = write(lattice_page(*target_, setup_).html);
  DrivenPage page;
  page.looks(address, fs::path(SLICECORR_BIN_DIR).parent_path() / "report-pictures", "report",
             "document.documentElement.dataset.ready");
}

TEST_F(ReportPage, PrintsWithoutScripts) {
  const auto paper = folder_.path / "page.pdf";
  const std::string html = lattice_page(*target_, setup_).html;
  const std::string still = html.substr(0, html.find("<script"));
  EXPECT_NE(still.find("<section id=\"explorer\" hidden"), std::string::npos);
  std::ofstream(folder_.path / "still.html") << still;
  DrivenPage page;
  page.open("file://" + (folder_.path / "still.html").string());
  page.print(paper);
  ASSERT_TRUE(fs::exists(paper));
  EXPECT_GT(fs::file_size(paper), 30000U);
  // The still sections stand in the markup itself.
  EXPECT_NE(still.find("alt=\"This stack: what will print\""), std::string::npos);
}

/// A page of a lattice of cells of 1.5 mm: edges everywhere.
void expect_small_page(int cells, int display_px) {
  Printer printer = test::linear_printer(1, 100);
  printer.width_px = display_px;
  printer.height_px = display_px;
  const slicecorr::Setup setup{printer, test::resin(576, 2000), test::process(1000)};
  const MeshSlices target(test::lattice(cells, cells, cells, 1.5, 0.15), printer, SliceOptions{});
  const Page page = lattice_page(target, setup);
  EXPECT_LT(page.html.size(), 6000000U);
  EXPECT_GT(page.html.size(), 500000U);
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed: page made, not opened";
  const Folder folder;
  std::ofstream(folder.path / "page.html") << page.html;
  DrivenPage browser;
  const auto test = browser.selftest("file://" + (folder.path / "page.html").string(), 1280);
  ASSERT_TRUE(test.is_object());
  EXPECT_TRUE(test["ok"].get<bool>()) << test["checks"].dump() << test.value("error", "");
}

/// Nearly as many cells as there may be, of one voxel each.
TEST(ReportSize, AFewMegabytes) { expect_small_page(5, 160); }

/// 30 and 240 million voxels.
TEST(ReportSizeNight, AFewMegabytesOfAPart) { expect_small_page(10, 320); }
TEST(ReportSizeNight, AFewMegabytesWhateverThePart) { expect_small_page(20, 640); }

}  // namespace
}  // namespace slicecorr
