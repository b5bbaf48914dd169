// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Parts to measure: what stands where, how long it is lit, and their tables.
#include "slicecorr/tuning_part.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "memory_slices.hpp"
#include "meshes.hpp"
#include "models.hpp"
#include "refusal.hpp"
#include "slicecorr/kinetics.hpp"

namespace slicecorr {
namespace {

using testing::HasSubstr;

Printer plate(int width_px = 1280, int height_px = 800, double black = 1) {
  Printer p = test::linear_printer(black, 100);
  p.width_px = width_px;
  p.height_px = height_px;
  return p;
}

Resin resin(double m = 1) {
  Resin r = test::resin(576, 2000);
  r.gel_dose_mj_cm3 = 576;
  r.m = m;
  if (m != 1) r.critical_dose_prime = 100;
  return r;
}

TuningPart part(TuningPartKind kind, const Printer& printer, const Resin& r) {
  TuningPart::Ask ask;
  ask.resin = &r;
  ask.uv_mw_cm2 = 200;
  return {kind, printer, ask};
}

constexpr TuningPartKind kAll[] = {TuningPartKind::comb,       TuningPartKind::staircase,
                                   TuningPartKind::wedge,      TuningPartKind::dead_zone,
                                   TuningPartKind::flat_field, TuningPartKind::lift_comb};

// The dose of each plug, summed over the images that are shown, is what its row says, and what was
// wanted: six times the same doses at three intensities.
TEST(TuningPart, PlugsOfAStaircaseGetTheirDoses) {
  for (const double m : {1.0, 1.3, 0.7}) {
    const Resin r = resin(m);
    const TuningPart stairs = part(TuningPartKind::staircase, plate(), r);
    const test::MemorySlices images(stairs);
    const Kinetics k = make_kinetics(r, false, false);
    // A quarter of the light, 25 mW/cm², whose plugs take 4^m times as long: black of 1 mW/cm² would
    // give 9 / 25.75^m gel doses until they are done, at m = 0.7 more than half of the least, 1.5.
    ASSERT_EQ(stairs.rows().size(), m < 1 ? 12U : 18U) << m;
    ASSERT_EQ(stairs.image_s().size(), static_cast<std::size_t>(stairs.grid().layers));
    for (std::size_t i = 0; i < stairs.rows().size(); ++i) {
      const TuningPart::Row& row = stairs.rows()[i];
      const int x = (row.box.x0 + row.box.x1) / 2, y = (row.box.y0 + row.box.y1) / 2;
      double dose = 0, lit_s = 0;
      for (int n = 0; n < stairs.grid().layers; ++n) {
        const int level = images.at(n, x, y);
        const double seconds = stairs.image_s()[static_cast<std::size_t>(n)];
        const double light = 1 + 99 * level / 255.0;
        dose += std::pow(light, m) * seconds;
        if (level > 0) {
          lit_s += seconds;
          EXPECT_NEAR(light, row.intensity_mw_cm2, 1e-9);
        }
      }
      EXPECT_NEAR(lit_s, row.shown_s, 1e-3 * lit_s);
      const double wanted = 1.5 * std::pow(6.0, static_cast<double>(i % 6) / 5);
      EXPECT_NEAR(dose / k.critical_dose_prime, wanted, 1e-3 * wanted) << m << row.name;
      EXPECT_NEAR(std::pow(row.intensity_mw_cm2, m) * row.exposure_s, dose, 1e-3 * dose);
    }
    // Full, half and quarter light, by the nearest levels.
    EXPECT_NEAR(stairs.rows()[6].intensity_mw_cm2, 50, 0.2);
    if (m >= 1) {
      EXPECT_NEAR(stairs.rows()[12].intensity_mw_cm2, 25, 0.2);
    }
  }
}

// A contrast of 20: at a quarter of the light the dark minutes would give more than half of the
// first plug's dose.
TEST(TuningPart, BrightBlackLeavesOutWeakLight) {
  const Resin r = resin();
  const TuningPart stairs = part(TuningPartKind::staircase, plate(1280, 800, 5), r);
  EXPECT_EQ(stairs.rows().size(), 6U);
  EXPECT_THAT(test::refusal([&] { part(TuningPartKind::staircase, plate(1280, 800, 30), r); }),
              testing::AllOf(HasSubstr("too bright for a staircase"), HasSubstr("expected less")));
}

TEST(TuningPart, StepsOfAWedgeRise) {
  for (const double m : {1.0, 1.3}) {
    const Resin r = resin(m);
    const TuningPart wedge = part(TuningPartKind::wedge, plate(), r);
    ASSERT_EQ(wedge.rows().size(), 12U);
    EXPECT_EQ(wedge.grid().layers, 1);
    const Kinetics k = make_kinetics(r, false, false);
    for (std::size_t i = 0; i < 12; ++i) {
      const TuningPart::Row& row = wedge.rows()[i];
      const double dose =
          std::pow(row.intensity_mw_cm2, m) * row.exposure_s / k.critical_dose_prime;
      const double wanted = 1.3 * std::pow(9 / 1.3, static_cast<double>(i) / 11);
      // Half a level of 99 / 255 mW/cm².
      EXPECT_NEAR(dose, wanted, m * wanted * 0.2 / row.intensity_mw_cm2) << i;
      if (i > 0) {
        EXPECT_EQ(row.box.x0, wedge.rows()[i - 1].box.x1);
      }
    }
  }
}

TEST(TuningPart, TheDeadZoneLadderSpansAFactorOfTen) {
  const Resin r = resin();
  const TuningPart ladder = part(TuningPartKind::dead_zone, plate(), r);
  ASSERT_EQ(ladder.rows().size(), 12U);
  EXPECT_NEAR(ladder.rows().front().intensity_mw_cm2, 100, 1e-9);
  EXPECT_NEAR(ladder.rows().back().intensity_mw_cm2, 10, 0.2);
  EXPECT_EQ(ladder.form().rows[0], (std::vector<std::string>{"plug 1", "100", "200", "30"}));
}

TEST(TuningPart, PlugsOfAFlatFieldLieInTheMiddlesOfItsPicture) {
  const Resin r = resin();
  for (const auto& [width, height] : {std::pair{1280, 800}, {161, 120}, {4000, 2400}}) {
    const TuningPart grid = part(TuningPartKind::flat_field, plate(width, height), r);
    const MeasuringForm form = grid.form();
    const int columns = static_cast<int>(form.fact("columns", 1, 100));
    const int rows = static_cast<int>(form.rows.size()) / columns;
    for (std::size_t i = 0; i < form.rows.size(); ++i) {
      const double x =
          (static_cast<double>(i % static_cast<std::size_t>(columns)) + 0.5) * width / columns;
      const double y = (std::floor(static_cast<double>(i) / columns) + 0.5) * height / rows;
      EXPECT_NEAR(*form.number(i, "x_px", 0, 1e5), x, 1);
      EXPECT_NEAR(*form.number(i, "y_px", 0, 1e5), y, 1);
    }
  }
}

// Plugs stand apart, within the plate; all that is lit belongs to a row.
TEST(TuningPart, PlugsStandApart) {
  const Resin r = resin();
  for (const TuningPartKind kind : kAll) {
    for (const auto& [width, height] : {std::pair{1280, 800}, {160, 120}}) {
      const bool comb = kind == TuningPartKind::comb || kind == TuningPartKind::lift_comb;
      if (comb && width < 200) continue;
      const TuningPart p = part(kind, plate(width, height), r);
      std::map<std::pair<int, int>, int> owner;
      for (std::size_t i = 0; i < p.rows().size(); ++i) {
        const PixelBox& b = p.rows()[i].box;
        EXPECT_GE(b.x0, 0);
        EXPECT_GE(b.y0, 0);
        EXPECT_LE(b.x1, width);
        EXPECT_LE(b.y1, height);
        EXPECT_GT(b.width() * b.height(), 0);
        if (comb) continue;
        for (std::size_t j = 0; j < i; ++j) {
          const PixelBox& o = p.rows()[j].box;
          EXPECT_TRUE(b.x0 >= o.x1 || o.x0 >= b.x1 || b.y0 >= o.y1 || o.y0 >= b.y1)
              << word_of(kind) << width << i << j;
        }
      }
    }
  }
}

// A place that gets half of the light needs twice the time, and its row says so.
TEST(TuningPart, UnevenLightIsCounted) {
  Printer p = plate();
  FlatField field;
  field.width_px = 2;
  field.height_px = 1;
  field.values =
      std::make_shared<const std::vector<std::uint8_t>>(std::vector<std::uint8_t>{128, 255});
  p.flat_field = field;
  const Resin r = resin();
  const TuningPart even = part(TuningPartKind::staircase, plate(), r);
  const TuningPart uneven = part(TuningPartKind::staircase, p, r);
  EXPECT_LT(uneven.rows()[0].intensity_mw_cm2, even.rows()[0].intensity_mw_cm2);
  EXPECT_NEAR(uneven.rows()[0].intensity_mw_cm2 * uneven.rows()[0].exposure_s,
              even.rows()[0].intensity_mw_cm2 * even.rows()[0].exposure_s, 1e-9);
}

TEST(TuningPart, WhatCantBeMadeIsRefused) {
  const Resin r = resin();
  TuningPart::Ask none;
  for (const TuningPartKind kind :
       {TuningPartKind::staircase, TuningPartKind::wedge, TuningPartKind::flat_field}) {
    EXPECT_THAT(test::refusal([&] { TuningPart(kind, plate(), none); }),
                HasSubstr("needs a resin"));
  }
  EXPECT_THAT(test::refusal([&] { TuningPart(TuningPartKind::dead_zone, plate(), none); }),
              HasSubstr("lit by UV light, too"));
  for (const TuningPartKind kind : kAll) {
    EXPECT_THAT(test::refusal([&] { part(kind, plate(30, 20), r); }),
                HasSubstr("expected at least"))
        << word_of(kind);
  }
}

TEST(TuningPart, SheetsSayWhatToMeasure) {
  const Resin r = resin();
  for (const TuningPartKind kind : kAll) {
    const TuningPart p = part(kind, plate(), r);
    const std::string page = p.sheet("my <form>.csv", "the-printer.toml");
    EXPECT_THAT(page, HasSubstr("my &lt;form&gt;.csv"));
    if (kind != TuningPartKind::dead_zone) {
      EXPECT_THAT(page, HasSubstr("--printer the-printer.toml"));
    }
    for (const TuningPart::Row& row : p.rows()) EXPECT_THAT(page, HasSubstr(row.name));
    EXPECT_THAT(page, testing::AnyOf(HasSubstr("slicecorr tune "), HasSubstr("resinctl ")));
  }
}

}  // namespace
}  // namespace slicecorr
