// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The report and its pictures.
#include "slicecorr/report.hpp"

#include <gtest/gtest.h>
#include <png.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "ladder.hpp"
#include "models.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {
namespace {

Setup figure_setup() {
  Printer p = test::linear_printer(1, 100);
  p.name = "two <colours> & \"more\"";
  p.width_px = 128;
  p.height_px = 80;
  return {p, test::resin(576, 2000), test::process(1000)};
}

TEST(Section, ColoursSayWhatIsWrong) {
  // One pixel per column: right, cured through, undercured, empty.
  Section s;
  s.width = 4;
  s.layers = 2;
  s.coverage = {255, 0, 255, 0, 255, 0, 255, 0};
  s.pixels = {255, 0, 0, 0, 255, 0, 0, 0};
  s.dose = {1.5F, 1.0F, 0.99F, 0.2F, 1.5F, 1.0F, 0.99F, 0.2F};
  const ColourImage image = cure_picture(s, 50, 50, 8);
  ASSERT_EQ(image.width_px, 8);
  ASSERT_EQ(image.height_px, 4);
  const auto at = [&](int x) { return &image.rgb[static_cast<std::size_t>(x) * 3]; };
  EXPECT_LT(std::abs(at(0)[0] - at(0)[2]), 20) << "right is grey";
  EXPECT_GT(at(2)[0], 2 * at(2)[2]) << "cured through is red";
  EXPECT_GT(at(4)[2], 2 * at(4)[0]) << "undercured is blue";
  EXPECT_EQ(at(6)[0] + at(6)[1] + at(6)[2], 765) << "empty is white";
}

TEST(Section, AWrongVoxelIsSeenInASmallPicture) {
  Section s;
  s.width = 300;
  s.layers = 300;
  s.coverage.assign(90000, 0);
  s.pixels.assign(90000, 0);
  s.dose.assign(90000, 0.1F);
  s.dose[137 * 300 + 211] = 1.2F;
  const ColourImage image = cure_picture(s, 50, 50, 60);
  ASSERT_LE(image.width_px, 60);
  int red = 0;
  for (std::size_t i = 0; i < image.rgb.size(); i += 3) red += image.rgb[i + 1] < 100;
  EXPECT_EQ(red, 1);
}

/// libpng reads what we wrote.
TEST(Picture, IsAPngOfTheSamePixels) {
  std::mt19937 random(4);
  for (const auto& [width, height] : {std::pair(1, 1), {7, 3}, {64, 50}, {900, 11}}) {
    for (const int kind : {0, 1, 2}) {  // flat, slopes, noise
      ColourImage image{width, height, {}};
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          for (int c = 0; c < 3; ++c) {
            const unsigned value = kind == 0   ? 200U
                                   : kind == 1 ? static_cast<unsigned>(3 * x + 5 * y + c)
                                               : static_cast<unsigned>(random());
            image.rgb.push_back(static_cast<std::uint8_t>(value));
          }
        }
      }
      const std::vector<std::uint8_t> bytes = encode_png(image);
      png_image png{};
      png.version = PNG_IMAGE_VERSION;
      ASSERT_TRUE(png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()));
      EXPECT_EQ(png.format, static_cast<unsigned>(PNG_FORMAT_RGB));
      ASSERT_EQ(png.width, static_cast<unsigned>(width));
      ASSERT_EQ(png.height, static_cast<unsigned>(height));
      std::vector<std::uint8_t> read(PNG_IMAGE_SIZE(png));
      ASSERT_TRUE(png_image_finish_read(&png, nullptr, read.data(), 0, nullptr)) << png.message;
      EXPECT_EQ(read, image.rgb) << width << " x " << height << ", " << kind;
    }
  }
}

TEST(Section, OfTheLadderBeforeAndAfter) {
  const slicecorr::Setup setup = figure_setup();
  SliceOptions options;
  const MeshSlices target(test::ladder(), setup.printer, options);
  const CorrectedSlices corrected(target, setup);
  const Section before = section_of(target, target, setup, 40);
  const Section after = section_of(corrected, target, setup, 40);
  EXPECT_EQ(before.layers, 50);
  EXPECT_EQ(after.layers, 54);
  const auto wrong = [](const Section& s) {
    int n = 0;
    for (std::size_t k = 0; k < s.dose.size(); ++k) {
      n += (s.coverage[k] == 0 && s.dose[k] >= 1) || (s.coverage[k] == 255 && s.dose[k] < 1);
    }
    return n;
  };
  EXPECT_EQ(wrong(after), 0);
  // 40 rung columns with 21 cured and 3 uncured voxels, 40 rail columns whose last voxels stay
  // liquid.
  EXPECT_EQ(wrong(before), 40 * 24 + 40 * 3);
}

TEST(Report, IsSelfContainedAndEscapesNames) {
  const slicecorr::Setup setup = figure_setup();
  const MeshSlices target(test::ladder(), setup.printer, SliceOptions{});
  const auto path = std::filesystem::path(::testing::TempDir()) /
                    ("report-" + std::to_string(::getpid()) + ".uvj");
  const Correction c = correct_stack(target, setup, path.string(), {.before = true});
  std::filesystem::remove(path);
  const CorrectedSlices corrected(target, setup);
  const std::string html = make_report(
      gather_report(corrected, target, setup, c.info, c.after, c.before, "a <b> & \"c\""));
  EXPECT_NE(html.find("a &lt;b&gt; &amp; &quot;c&quot;"), std::string::npos);
  EXPECT_EQ(html.find("<colours>"), std::string::npos);
  for (const char* outside : {"http:", "https:", "src=\"/", "url(", "@import", "<link"}) {
    EXPECT_EQ(html.find(outside), std::string::npos) << outside;
  }
  EXPECT_LT(html.size(), 2000000U);
  // The same input gives the same page.
  EXPECT_EQ(html, make_report(gather_report(corrected, target, setup, c.info, c.after, c.before,
                                            "a <b> & \"c\"")));
}

TEST(Report, ColumnPlotShowsDesignDoseAndLevels) {
  const slicecorr::Setup setup = figure_setup();
  const MeshSlices target(test::ladder(), setup.printer, SliceOptions{});
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, 50);
  const auto column = probe_stack(target, &target, setup, 64, 40);
  const std::string svg = column_svg(column, model, "rung");
  EXPECT_NE(svg.find("class=\"dose\""), std::string::npos);
  std::size_t shaded = 0;
  for (std::size_t at = svg.find("class=\"design\""); at != std::string::npos;
       at = svg.find("class=\"design\"", at + 1)) {
    ++shaded;
  }
  EXPECT_EQ(shaded, 2U);
  EXPECT_TRUE(column_svg({}, model, "none").empty());
}

}  // namespace
}  // namespace slicecorr
