// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The part from which spread is measured: what stands where.
#include "slicecorr/test_part.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "memory_slices.hpp"
#include "meshes.hpp"
#include "refusal.hpp"

namespace slicecorr {
namespace {

using testing::HasSubstr;

TEST(TestPart, LinesAndGapsStandFreeOfEachOther) {
  for (const auto& [width, height] : {std::pair{1280, 800}, {3840, 2400}, {720, 640}}) {
    const SpreadTestPart part(test::printer(width, height, 50, 40), 50, 220);
    EXPECT_EQ(part.grid().layers, 4);
    const test::MemorySlices image(part);
    ASSERT_EQ(part.features().size(), 48U);
    int least = 1000;
    for (const TestFeature& f : part.features()) {
      ASSERT_EQ(f.upright ? f.box.width() : f.box.height(), f.width_px);
      EXPECT_DOUBLE_EQ(f.width_um, f.width_px * (f.upright ? 50.0 : 40.0));
      EXPECT_GE(f.upright ? f.box.height() : f.box.width(), 48);
      // Half along it, from its middle to both sides: first it alone, then what is beside it.
      const int x = (f.box.x0 + f.box.x1) / 2, y = (f.box.y0 + f.box.y1) / 2;
      const auto lit = [&](int at) {
        return image.at(0, f.upright ? at : x, f.upright ? y : at) > 0;
      };
      const int from = f.upright ? f.box.x0 : f.box.y0, to = f.upright ? f.box.x1 : f.box.y1;
      for (int at = from; at < to; ++at) EXPECT_EQ(lit(at), !f.gap);
      for (const int way : {-1, 1}) {
        int far = 0, at = way < 0 ? from - 1 : to;
        const int end = f.upright ? width : height;
        while (at >= 0 && at < end && lit(at) == f.gap) at += way, ++far;
        if (at >= 0 && at < end) least = std::min(least, far);
      }
    }
    EXPECT_GE(least, 16);
    // The square's sides are alone, too.
    const PixelBox& s = part.square();
    EXPECT_EQ(s.width(), s.height());
    EXPECT_GE(s.width(), 48);
    for (int k = 1; k <= 16; ++k) {
      EXPECT_EQ(image.at(0, s.x0 - k, (s.y0 + s.y1) / 2), 0);
      EXPECT_EQ(image.at(0, s.x1 - 1 + k, (s.y0 + s.y1) / 2), 0);
      EXPECT_EQ(image.at(0, (s.x0 + s.x1) / 2, s.y1 - 1 + k), 0);
    }
    // All slices are alike, within the bounds that it says.
    const PixelBox b = image.bounds();
    EXPECT_EQ(b.x0, part.bounds().x0);
    EXPECT_EQ(b.y1, part.bounds().y1);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; x += 7) ASSERT_EQ(image.at(0, x, y), image.at(3, x, y));
    }
  }
}

TEST(TestPart, TheFormNamesThemAll) {
  const SpreadTestPart part(test::printer(1280, 800, 50, 40), 50, 20);
  EXPECT_EQ(part.grid().layers, 1);
  const MeasuringForm form = part.form();
  EXPECT_EQ(form.rows.size(), 48U);
  EXPECT_EQ(form.rows[0], (std::vector<std::string>{"upright line 1 px", "line", "50"}));
  EXPECT_EQ(form.rows[36], (std::vector<std::string>{"level gap 1 px", "gap", "40"}));
  const std::string page = part.sheet("form.csv", "p.toml");
  for (const auto& row : form.rows) EXPECT_THAT(page, HasSubstr(row[0]));
}

TEST(TestPart, ADisplayThatIsTooSmallIsRefused) {
  EXPECT_THAT(test::refusal([] { SpreadTestPart(test::printer(400, 300, 50, 50), 50, 500); }),
              testing::AllOf(HasSubstr("shows 400 x 300 pixels"), HasSubstr("expected at least")));
}

}  // namespace
}  // namespace slicecorr
