// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The sentence that a person reads first.
#include "slicecorr/verdict.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "slicecorr/bodies.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr {
namespace {

using ::testing::HasSubstr;

Prediction perfect() {
  Prediction p;
  p.layers = 10;
  p.layer_um = 50;
  p.target_voxels = p.printed_voxels = 83000;
  p.runs = 2000;
  p.gaps = 1000;
  p.height_error_um.add(0.25);
  p.worst_x = 3;
  p.worst_y = 4;
  return p;
}

Prediction with_bodies(const Bodies& printed) {
  Prediction p = perfect();
  auto bodies = std::make_shared<JudgedBodies>();
  bodies->printed = printed;
  bodies->printed.grid.layer_um = 50;
  bodies->printed.grid.pixel_x_um = bodies->printed.grid.pixel_y_um = 100;
  p.bodies = bodies;
  return p;
}

void expect(const Prediction& p, Outcome outcome, const std::string& words) {
  const PrintVerdict verdict = verdict_of(p);
  EXPECT_EQ(verdict.outcome, outcome) << verdict.words;
  EXPECT_EQ(verdict.words, words);
  const auto json = nlohmann::json::parse(p.to_json());
  EXPECT_EQ(json["outcome"], name_of(outcome));
  EXPECT_EQ(json["verdict"], words);
}

TEST(PrintVerdictTest, WhatIsAsDesigned) {
  expect(perfect(), Outcome::as_designed, "Prints as designed. 95 % of edges lie within 0.25 um.");
}

TEST(PrintVerdictTest, NoFigureIsFinerThanAnyPrint) {
  Prediction p = perfect();
  p.height_error_um = {};
  p.height_error_um.add(5.1e-5);
  expect(p, Outcome::as_designed, "Prints as designed. 95 % of edges lie within 0.1 um.");
  p.height_error_um = {};
  p.height_error_um.add(0);
  p.layerwise.emplace();
  expect(p, Outcome::as_designed,
         "Prints as designed. No edge lies over a gap, and light moves no other.");
}

// 0.1549 is not within 0.15; where errors are alike the greatest is the bound, to the last bit.
TEST(PrintVerdictTest, WithinIsNeverRoundedDown) {
  Prediction p = perfect();
  p.height_error_um = {};
  for (int i = 0; i < 100; ++i) p.height_error_um.add(0.1549);
  expect(p, Outcome::as_designed, "Prints as designed. 95 % of edges lie within 0.16 um.");
  p.height_error_um = {};
  for (int i = 0; i < 100; ++i) p.height_error_um.add(0.16);
  expect(p, Outcome::as_designed, "Prints as designed. 95 % of edges lie within 0.16 um.");
}

TEST(PrintVerdictTest, WhatOtherExchangesAtLiftsDoIsTold) {
  Prediction p = perfect();
  p.layerwise.emplace();
  p.joints.emplace();
  p.joints->exchanged_max_um = 222;
  p.joints->staying_max_um = 624;
  expect(p, Outcome::as_designed,
         "Prints as designed. 95 % of edges lie within 0.25 um. That is where lifts exchange no "
         "resin, which nobody said: where they exchange all of it edges over gaps are up to 222 um "
         "off.");
  p.joints->exchange = 0.5;
  expect(
      p, Outcome::as_designed,
      "Prints as designed. 95 % of edges lie within 0.25 um. That is where lifts exchange a "
      "share of 0.5 of the resin: where they exchange all of it edges over gaps are up to 222 um "
      "off, where none 624 um.");
  // How sure it is was asked for, and is told.
  p.uncertain = std::make_shared<UncertainPrint>();
  EXPECT_EQ(verdict_of(p).words.find("That is where"), std::string::npos);
}

TEST(PrintVerdictTest, SlitsThatWereToCloseAreNoFault) {
  Prediction p = perfect();
  p.merged_features = p.one_slice_gaps = 200;
  p.cure_through_voxels = 200;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::fails);
  p.slits_merged = true;
  expect(p, Outcome::as_designed,
         "Prints as designed. 200 gaps of one slice are closed, as was asked. 95 % of edges lie "
         "within 0.25 um.");
  p.merged_features = 203;
  p.merged_thick_gaps = 3;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("3 of 1,000 gaps by column close"));
}

TEST(PrintVerdictTest, OutlinesAreToldWithTheirSide) {
  Prediction p = perfect();
  p.pixel_x_um = p.pixel_y_um = 50;
  for (int i = 0; i < 4; ++i) p.plane_error_um.add(16);
  p.plane_signed_nm = -4 * 16000;
  EXPECT_THAT(verdict_of(p).words,
              HasSubstr("um, on average 16 um inwards: walls are 32 um thinner."));
  p.plane_signed_nm = 0;
  EXPECT_THAT(verdict_of(p).words, testing::Not(HasSubstr("on average")));
  EXPECT_THAT(verdict_of(p).words, HasSubstr("95 % of outlines lie within 16 um."));
}

TEST(PrintVerdictTest, ADeadZoneThatIsThinIsToBeLookedAt) {
  Prediction p = perfect();
  p.dead_zones.emplace();
  p.dead_zones->least_um = p.dead_zones->greatest_um = {20, 15};
  EXPECT_EQ(verdict_of(p).outcome, Outcome::as_designed);
  p.dead_zones->least_um = {20, 0.234};
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("the dead zone gets as thin as 0.23 um"));
}

TEST(PrintVerdictTest, BlackThatGelsTheVatIsSaid) {
  Prediction p = perfect();
  p.black_alone_dose = 0.999;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::as_designed);
  p.black_alone_dose = 1.2;
  expect(p, Outcome::fails,
         "Does not print as designed: black light alone gels resin over the whole display.");
  p.joints.emplace();
  p.merged_features = 500;
  EXPECT_THAT(verdict_of(p).words,
              HasSubstr("whole display where lifts exchange none of it, 50 % of the gaps"));
}

TEST(PrintVerdictTest, ErrorsOfInputsThatWereSaidReachIt) {
  Prediction p = perfect();
  UncertainPrint u;
  u.runs = 1000;
  u.upper.half_width_um.add(97);
  u.lower.half_width_um.add(74);
  p.uncertain = std::make_shared<UncertainPrint>(u);
  const PrintVerdict moved = verdict_of(p);
  EXPECT_EQ(moved.outcome, Outcome::as_designed);
  EXPECT_THAT(moved.words, HasSubstr("move edges by up to 97 um (95 %)"));
  u.may_vanish = 700;
  p.uncertain = std::make_shared<UncertainPrint>(u);
  const PrintVerdict lost = verdict_of(p);
  EXPECT_EQ(lost.outcome, Outcome::look);
  EXPECT_THAT(lost.words, HasSubstr("said 700 of 1,000 features may be lost"));
}

TEST(PrintVerdictTest, WhatComesApartOrOffThePlatformIsNotAsDesigned) {
  Prediction p = perfect();
  p.split_features = 500;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::fails);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("25 % of the features by column come apart"));
  p.split_features = 3;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("3 of 2,000 features by column come apart"));
  p = perfect();
  p.runs_on_platform = 400;
  p.liquid_at_platform = 400;
  expect(p, Outcome::fails, "Will not hold: 100 % of what stands on the platform is liquid at it.");
  p.liquid_at_platform = 1;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("1 of 400 columns on the platform are liquid at it"));
}

TEST(PrintVerdictTest, SinglePlacesAreToBeLookedAt) {
  Prediction p = perfect();
  p.undercure_voxels = 4;
  p.height_error_um.add(12.34);
  expect(
      p, Outcome::look,
      "Prints as designed but for what to look at: 4 of 83,000 voxels stay liquid. The worst edge "
      "is 12.3 um off, in pixel 3, 4.");
  p.merged_features = 1;
  EXPECT_THAT(verdict_of(p).words, HasSubstr("; 1 of 1,000 gaps by column close."));
}

TEST(PrintVerdictTest, FromOneInAHundredItIsAnotherPart) {
  Prediction p = perfect();
  p.merged_features = 9;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  p.merged_features = 10;
  expect(p, Outcome::fails, "Does not print as designed: 1 % of the gaps by column close.");
  p.undercure_voxels = p.target_voxels - 1;
  EXPECT_THAT(verdict_of(p).words,
              HasSubstr("designed: over 99 % of its voxels stay liquid, 1 % of the gaps"));
  p.merged_features = p.gaps;
  EXPECT_THAT(verdict_of(p).words, HasSubstr("100 % of the gaps"));
  p.printed_voxels = 0;
  expect(p, Outcome::fails, "Nothing prints: no voxel reaches the dose that gels.");
  expect(Prediction(), Outcome::look, "Nothing is designed: no voxel is covered whole.");
}

TEST(PrintVerdictTest, EdgesOffByMoreThanALayerMakeAnotherPart) {
  Prediction p = perfect();  // one edge is right
  for (int i = 0; i < 998; ++i) p.height_error_um.add(0.25);
  // No more than a layer is what rounding a design can do.
  p.height_error_um.add(50);
  EXPECT_EQ(verdict_of(p).outcome, Outcome::as_designed);
  for (int i = 0; i < 9; ++i) p.height_error_um.add(51);
  expect(p, Outcome::look,
         "Prints as designed but for what to look at: 9 edges are off by more than a layer. The "
         "worst edge is 51 um off, in pixel 3, 4.");
  p.height_error_um.add(51);
  p.height_error_um.add(51);
  expect(p, Outcome::fails,
         "Does not print as designed: 1.1 % of the edges are off by more than a layer. The worst "
         "edge is 51 um off, in pixel 3, 4.");
  // Where layers differ, the highest one counts.
  p.heights = LayerHeights({50, 60});
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  // By the design's own surface where that is known.
  p.heights = {};
  p.surface_error_um.add(1);
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  p.surface_error_um.add(51);
  EXPECT_EQ(verdict_of(p).outcome, Outcome::fails);
}

TEST(PrintVerdictTest, EdgesOffByAVoxelAreNotAsDesigned) {
  Prediction p = perfect();
  for (int i = 0; i < 98; ++i) p.height_error_um.add(25);
  EXPECT_EQ(verdict_of(p).outcome, Outcome::as_designed) << "half a layer is rounding";
  p.height_error_um.add(43.9);
  p.cure_through_voxels = 404;
  expect(
      p, Outcome::look,
      "Prints with edges that are off: 1 % of them by more than half a layer (25 um); 404 voxels "
      "gel in gaps. The worst edge is 43.9 um off, in pixel 3, 4.");
  p.cure_through_voxels = 0;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
}

TEST(PrintVerdictTest, OutlinesOffByMoreThanAPixel) {
  Prediction p = perfect();
  p.pixel_x_um = 40;
  p.pixel_y_um = 30;
  for (int i = 0; i < 199; ++i) p.plane_error_um.add(40);
  p.plane_error_um.add(40.9);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("1 outline is off by more than a pixel"));
  p.plane_error_um.add(41);
  p.plane_error_um.add(41);
  EXPECT_EQ(verdict_of(p).outcome, Outcome::fails);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("1.5 % of the outlines are off by more than a pixel"));
}

TEST(PrintVerdictTest, GapsThatHardlyStayOpenAreTold) {
  Prediction p = perfect();
  for (int i = 0; i < 990; ++i) p.gap_contrast.add(0.051);
  for (int i = 0; i < 9; ++i) p.gap_contrast.add(0.0055);
  EXPECT_EQ(narrow_gaps(p), 9);
  EXPECT_EQ(verdict_of(p).outcome, Outcome::as_designed);
  p.gap_contrast.add(0.0055);
  expect(p, Outcome::look,
         "Prints as designed but for what to look at: 10 of 1,000 gaps by column are hardly darker "
         "than what gels (a contrast below 0.05).");
  // Gaps that close have none, and are told as closed.
  p.merged_features = 3;
  EXPECT_EQ(narrow_gaps(p), 7);
}

TEST(PrintVerdictTest, ACorrectionThatMakesThePartWorseIsSaid) {
  Prediction before = perfect(), after = perfect();
  EXPECT_EQ(worse_than_none(after, before), "");
  after.height_error_um.add(4);  // 2.125 um on average
  EXPECT_EQ(worse_than_none(after, before),
            "The correction makes this part worse: on average edges are 2.12 um off, and 0.25 um "
            "without it.");
  EXPECT_EQ(worse_than_none(before, after), "");
  before.undercure_voxels = 1;  // worth it
  EXPECT_EQ(worse_than_none(after, before), "");
}

TEST(PrintVerdictTest, WhatFallsComesFirst) {
  Bodies b;
  b.islands = {{.first = 3, .begins = 4, .until = 7, .voxels = 2000},
               {.first = 60, .begins = 61, .until = -1, .voxels = 1000}};
  b.islands_in_all = 2;
  expect(
      with_bodies(b), Outcome::look,
      "Prints as designed but for what to look at: 2 bodies hang on nothing while it prints, until "
      "the rest reaches them (the largest 1 mm³).");
  b.islands[0].voxels = 226000;
  EXPECT_THAT(verdict_of(with_bodies(b)).words, HasSubstr("(the largest 113 mm³)"));
  b.islands[0].voxels = 2000;
  b.loose_bodies = 1;
  Prediction p = with_bodies(b);
  // Slices are told by where they begin.
  expect(p, Outcome::fails, "Will not hold: 1 body hangs on nothing, from 3000 um on.");
  p.undercure_voxels = 8300;
  EXPECT_THAT(verdict_of(p).words,
              HasSubstr("3000 um on. Does not print as designed: 10 % of its"));
}

TEST(PrintVerdictTest, WhatComesLooseOrSticks) {
  Prediction p = perfect();
  p.joints.emplace();
  p.joints->not_holding_voxels = 829;
  EXPECT_EQ(verdict_of(p).outcome, Outcome::look);
  EXPECT_THAT(verdict_of(p).words, HasSubstr("829 voxels come loose when the platform lifts"));
  p.joints->not_holding_voxels = 830;
  expect(p, Outcome::fails, "Will not hold: 1 % of the voxels come loose when the platform lifts.");
  p.dead_zones.emplace();
  p.dead_zones->cured_pixels = 1;
  expect(p, Outcome::fails, "Will stick: resin gels down to the window over 1 pixel.");
}

}  // namespace
}  // namespace slicecorr
