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
