// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What refusals name must work when it is typed back, as printed: random processes that are
// refused, followed in every way that the message offers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "memory_slices.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/units.hpp"
#include "typed_back.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using Settings = slicecorr::Setup;

// ---- rounding -------------------------------------------------------------------------------

TEST(Limit, RoundsToTheSideAskedFor) {
  EXPECT_EQ(at_most(6250), "6250");
  EXPECT_EQ(at_most(6250 * (1 - 1e-9)), "6249.9");
  EXPECT_EQ(at_least(62.5 * (1 + 1e-9)), "62.501");
  EXPECT_EQ(at_least(0.0783685123), "0.078369");
  EXPECT_EQ(at_most(99999.9), "99999");
  EXPECT_EQ(at_least(99999.1), "100000");
  EXPECT_EQ(at_least(9.99999, 3), "10");
  EXPECT_EQ(at_most(0), "0");
  std::mt19937_64 random(1);
  for (int i = 0; i < 20000; ++i) {
    const double value = std::pow(10.0, std::uniform_real_distribution<double>(-8, 12)(random));
    const int digits = 1 + static_cast<int>(random() % 12);
    const double down = std::stod(at_most(value, digits)), up = std::stod(at_least(value, digits));
    ASSERT_LE(down, value);
    ASSERT_GE(up, value);
    const double unit = std::pow(10.0, std::floor(std::log10(value)) - digits + 1);
    ASSERT_LT(up - down, unit * 1.001) << value << " " << digits;
  }
}

// ---- refusals through the library -------------------------------------------------------------

struct Case {
  Settings setup;
  Grid grid{8, 8, 40, 50, 50, 50};
  std::optional<MemorySlices> target;  ///< where light is uneven
};

std::string refusal(const Case& c) {
  try {
    if (c.target) {
      plan_correction(*c.target, c.setup);
    } else {
      plan_correction(GridOnly(c.grid, {}), c.setup);
    }
  } catch (const InfeasibleError& e) {
    return e.what();
  } catch (const InputError& e) {
    return std::string("input: ") + e.what();
  }
  return "";
}

std::optional<double> number_in(const std::string& text, const std::string& pattern) {
  const std::string found = text_in(text, pattern);
  return found.empty() ? std::nullopt : std::optional(std::stod(found));
}

Process with_times(Process p, double least_s, double most_s) {
  const auto change = [&](double& s) { s = std::clamp(s, least_s, most_s); };
  change(p.exposure_s);
  if (p.bottom_exposure_s > 0) change(p.bottom_exposure_s);
  for (double& s : p.layer_exposure_s) change(s);
  return p;
}

/// Everything that a message offers, done.
std::vector<std::pair<std::string, Case>> followed(const Case& c, const std::string& text) {
  std::vector<std::pair<std::string, Case>> all;
  const auto add = [&](const std::string& what, const std::function<void(Case&)>& change) {
    Case other = c;
    change(other);
    all.emplace_back(what, std::move(other));
  };
  const std::string n = kNumber;
  for (const char* side : {"slower", "faster"}) {
    if (const auto speed = number_in(text, std::string(side) + " than " + n + " mm/h")) {
      add(side, [&](Case& k) { k.setup.process.speed_mm_h = *speed; });
    }
  }
  const auto least_s = number_in(text, "for at least " + n + " s");
  const auto most_s = number_in(text, "less than " + n + " s");
  if (least_s) {
    add("least time", [&](Case& k) {
      k.setup.process = with_times(k.setup.process, *least_s, most_s.value_or(1e300));
    });
    add("all of the least time",
        [&](Case& k) { k.setup.process = with_times(k.setup.process, *least_s, *least_s); });
  }
  if (most_s) {
    add("greatest time", [&](Case& k) {
      k.setup.process = with_times(k.setup.process, least_s ? *most_s : 0, *most_s);
    });
  }
  const auto full =
      number_in(text, "with (?:at least|more than) " + n + " mW/cm² ?(?:of full|and|$|,)");
  const auto full_at_end =
      full ? full : number_in(text, "with (?:at least|more than) " + n + " mW/cm²");
  const auto black = number_in(text, "black below " + n + " mW/cm²");
  if (full_at_end || black) {
    add("light", [&](Case& k) {
      auto& points = k.setup.printer.calibration;
      if (full_at_end) points.back().intensity_mw_cm2 = *full_at_end;
      if (black) points.front().intensity_mw_cm2 = *black;
    });
  }
  if (const auto uv = number_in(text, "or with " + n + " mW/cm² of UV light")) {
    add("UV light", [&](Case& k) { k.setup.process.uv.uv_mw_cm2 = *uv; });
  }
  if (const auto uv = number_in(text, "; UV light of " + n + " mW/cm² works")) {
    add("UV light of the lamp", [&](Case& k) { k.setup.process.uv.uv_mw_cm2 = *uv; });
  }
  if (const auto zone = number_in(text, "; a dead zone of " + n + " um works")) {
    add("dead zone", [&](Case& k) { k.setup.process.uv.dead_zone_um = *zone; });
  }
  if (const auto lower = number_in(text, "at least " + n + " mm lower")) {
    add("lower", [&](Case& k) {
      k.grid.layers -= static_cast<int>(std::ceil(*lower * 1000 / k.grid.layer_um - 1e-6));
    });
  }
  return all;
}

struct Tally {
  int refused = 0, followed = 0, failed = 0, none_works = 0;
};

double between(std::mt19937& random, double low, double high) {
  return std::exp(std::uniform_real_distribution(std::log(low), std::log(high))(random));
}

/// Any mode, exponent, display, stage; often infeasible.
Case any_case(std::mt19937& random, bool uv) {
  Case c;
  Printer& p = c.setup.printer;
  const double full = between(random, 3, 300);
  p = linear_printer(random() % 5 ? full / between(random, 1.05, 1000) : 0, full,
                     random() % 3 ? 8 : 4);
  p.width_px = p.height_px = 8;
  if (random() % 3 == 0) p.travel_mm = between(random, 1, 60);
  if (random() % 4 == 0) p.max_speed_mm_h = between(random, 100, 5000);
  c.grid.layer_um = between(random, 10, 200);
  c.grid.layers = 1 + static_cast<int>(random() % 60);
  Resin& r = c.setup.resin;
  r = resin(between(random, 50, 5000), between(random, 60, 3000));
  if (uv || random() % 2) {
    r.model = CureModelKind::kinetic;
    r.m = std::uniform_real_distribution(0.5, 1.4)(random);
    r.critical_dose_prime = between(random, 5, 500);
    if (random() % 3 == 0) r.dose_factor = 5;
  }
  Process& process = c.setup.process;
  if (random() % 2) {
    process.speed_mm_h = between(random, 1, 20000);
    if (p.max_speed_mm_h > 0) process.speed_mm_h = std::min(process.speed_mm_h, p.max_speed_mm_h);
  } else {
    process.mode = ExposureMode::layerwise;
    process.exposure_s = between(random, 0.003, 300);
    const auto schedule = uv ? 0 : random() % 4;
    if (schedule == 1) {
      process.bottom_exposure_s = process.exposure_s * between(random, 0.3, 30);
      process.bottom_layers = static_cast<int>(random() % 6);
      process.fade_layers = 1 + static_cast<int>(random() % 6);
    } else if (schedule == 2) {
      for (int n = 0; n < 8; ++n) {
        process.layer_exposure_s.push_back(process.exposure_s * between(random, 0.1, 10));
      }
      process.exposure_s = process.layer_exposure_s.back();
    }
  }
  if (uv) {
    c.grid.layer_um = between(random, 30, 200);
    const double hb = units::height_e_from_10(r.absorbance_height10_um);
    r.inhibition = Inhibition{between(random, 0.3, 3),
                              units::height10_from_e(hb * between(random, 0.02, 0.5)), r.m, 0};
    p.uv = UvLamp{365, false, {{0, 0}, {255, full * between(random, 0.3, 30)}}};
    process.uv.kind = UvKind::constant;
    process.uv.uv_mw_cm2 = p.uv->max_mw_cm2() * between(random, 0.01, 1.5);
    if (random() % 3 == 0) {
      const bool patterned = random() % 2;
      p.uv->patterned = patterned;
      if (patterned) p.uv->calibration.back().level = (1 << p.bit_depth) - 1;
      process.uv = {
          patterned ? UvKind::patterned : UvKind::per_slice, 0, between(random, 1, 300), {}};
    }
    // What is named for a lamp's sake knows nothing of the stage's travel.
    if (process.uv.dead_zone_um > 0 || process.uv.uv_mw_cm2 > p.uv->max_mw_cm2()) p.travel_mm = 0;
    process.allow_window_cure = random() % 4 == 0;
  }
  return c;
}

/// Nowhere between these ends is the case accepted.
bool none_accepted(const Case& c) {
  const int steps = c.setup.process.uv.kind == UvKind::off ? 120 : 30;
  for (int i = 0; i <= steps; ++i) {
    Case k = c;
    Process& p = k.setup.process;
    if (p.mode == ExposureMode::continuous) {
      p.speed_mm_h = std::pow(10.0, -2 + 7.0 * i / steps);
      if (k.setup.printer.max_speed_mm_h > 0 && p.speed_mm_h > k.setup.printer.max_speed_mm_h)
        break;
    } else {
      const double time_s = std::pow(10.0, -4 + 9.0 * i / steps);
      p = with_times(p, time_s, time_s);
    }
    if (refusal(k).empty()) return false;
  }
  return true;
}

void follow(const Case& c, Tally& tally) {
  const std::string text = refusal(c);
  if (text.empty() || text.starts_with("input: ") || text.find("the part is ") == 0) {
    return;
  }
  ++tally.refused;
  if (text.find("no speed") != text.npos || text.find("no exposure") != text.npos) {
    ++tally.none_works;
    EXPECT_TRUE(none_accepted(c)) << text;
  }
  for (const auto& [what, other] : followed(c, text)) {
    ++tally.followed;
    const std::string again = refusal(other);
    tally.failed += again.empty() ? 0 : 1;
    EXPECT_EQ(again, "") << what << ", after: " << text;
  }
}

TEST(Limits, AllThatARefusalNamesWorks) {
  std::mt19937 random(20);
  Tally tally;
  const int cases = by_night() ? 10000 : 500;
  for (int i = 0; i < cases; ++i) follow(any_case(random, false), tally);
  EXPECT_EQ(tally.failed, 0) << "of " << tally.followed;
  EXPECT_GT(tally.followed, cases / 3);
  EXPECT_GT(tally.none_works, cases / 150);
  RecordProperty("followed", tally.followed);
}

TEST(Limits, AllThatARefusalNamesWorksUnderUvLight) {
  std::mt19937 random(21);
  Tally tally;
  const int cases = rounds(40);
  for (int i = 0; i < cases; ++i) follow(any_case(random, true), tally);
  EXPECT_EQ(tally.failed, 0) << "of " << tally.followed;
  EXPECT_GT(tally.followed, cases / 2);
  RecordProperty("followed", tally.followed);
}

TEST(Limits, WhatUnevenLightNamesWorksWhereThePartLies) {
  std::mt19937 random(22);
  Tally tally;
  const int cases = rounds(150);
  for (int i = 0; i < cases; ++i) {
    Case c = any_case(random, false);
    c.target.emplace(c.grid);
    FlatField field;
    field.width_px = field.height_px = 8;
    std::vector<std::uint8_t> values(64);
    const int least = 1 + static_cast<int>(random() % 250);
    for (auto& v : values) v = static_cast<std::uint8_t>(least + random() % (256 - least));
    field.values = std::make_shared<const std::vector<std::uint8_t>>(values);
    field.reference = 150 + static_cast<int>(random() % 106);
    c.setup.printer.flat_field = field;
    for (int k = 0; k < 6; ++k) {
      const int x = static_cast<int>(random() % 8), y = static_cast<int>(random() % 8);
      for (int n = 0; n < c.grid.layers; ++n) c.target->at(n, x, y) = 255;
    }
    const std::string text = refusal(c);
    // The part stays: its images can't be made lower here.
    if (text.find("mm lower") != text.npos) continue;
    follow(c, tally);
  }
  EXPECT_EQ(tally.failed, 0) << "of " << tally.followed;
  EXPECT_GT(tally.followed, cases / 3);
}

TEST(Limits, BothThatBindAreNamedAtOnce) {
  // Layer by layer full light must pass a layer that black must not: (Imax / Imin)^m > 1 / a (1 -
  // a).
  Case c;
  c.setup = {linear_printer(24, 100), resin(576, 110), process(0)};
  c.setup.printer.width_px = c.setup.printer.height_px = 8;
  c.setup.process.mode = ExposureMode::layerwise;
  c.setup.process.exposure_s = 0.07;
  const std::string text = refusal(c);
  EXPECT_THAT(text, AllOf(HasSubstr("a layer does not gel through"), HasSubstr("no exposure works"),
                          HasSubstr("mW/cm²")));
  // At an exposure where both fail, both intensities are named together.
  c.setup.printer = linear_printer(60, 100);
  c.setup.printer.width_px = c.setup.printer.height_px = 8;
  EXPECT_THAT(refusal(c), AllOf(HasSubstr("does not gel through"), HasSubstr("black pixels gel"),
                                HasSubstr("of full light and black below")));
  Tally tally;
  follow(c, tally);
  EXPECT_EQ(tally.followed, 1);
}

TEST(Limits, ASpeedNamedLeavesTheEndOfThePartWithinTheTravel) {
  // At phi just above 1 the end of a part takes 10 mm of slices; the stage has 1 mm left.
  Case c;
  c.setup = {linear_printer(1, 100), resin(576, 2000), process(7000)};
  c.setup.printer.width_px = c.setup.printer.height_px = 8;
  c.setup.printer.travel_mm = 3;
  const double speed = *number_in(refusal(c), std::string("slower than ") + kNumber);
  EXPECT_LT(speed, 5000);
  Tally tally;
  follow(c, tally);
  EXPECT_EQ(tally.failed, 0);
  // Refused for the travel alone, with the same speed.
  c.setup.process.speed_mm_h = 6200;
  const std::string text = refusal(c);
  EXPECT_THAT(text, HasSubstr("slices after it"));
  EXPECT_EQ(*number_in(text, std::string("slower than ") + kNumber), speed);
  EXPECT_EQ(followed(c, text).size(), 3U) << text;
  follow(c, tally);
  // Where few slices are too many, a lower part is another way.
  c.setup.process.speed_mm_h = 5000;
  EXPECT_THAT(refusal(c), HasSubstr("at least 0.400 mm lower"));
  EXPECT_EQ(followed(c, refusal(c)).size(), 4U);
  follow(c, tally);
  EXPECT_EQ(tally.failed, 0);
}

TEST(Limits, LessLightOfBlackIsNoWayWhereThePartCanNotEnd) {
  // 40 slices of 50 um, and travel for a tenth of one more: the end has nothing to cure from.
  Case c;
  c.setup = {linear_printer(50, 100), resin(576, 2000), process(7)};
  c.setup.printer.width_px = c.setup.printer.height_px = 8;
  c.setup.printer.travel_mm = 2.005;
  const std::string text = refusal(c);
  EXPECT_THAT(text, AllOf(HasSubstr("black pixels gel"), HasSubstr("the stage's travel leaves no"),
                          Not(HasSubstr("black below"))));
  EXPECT_TRUE(none_accepted(c));
  EXPECT_EQ(followed(c, text).size(), 0U) << text;
  // With travel it is one.
  c.setup.printer.travel_mm = 60;
  EXPECT_THAT(refusal(c), HasSubstr("black below"));
  Tally tally;
  follow(c, tally);
  EXPECT_GT(tally.followed, 0);
  EXPECT_EQ(tally.failed, 0);
}

// ---- beta Iuv = Ib ----------------------------------------------------------------------------

TEST(JustEnoughUv, KeepsNoDeadZoneAnywhere) {
  const Kinetics k{750, 1, 100, 1, 100};
  EXPECT_FALSE(keeps_dead_zone(k, 100, 100));
  EXPECT_TRUE(keeps_dead_zone(k, 100, std::nextafter(100.0, 200.0)));
  EXPECT_TRUE(keeps_dead_zone(k, 0, 0));
  EXPECT_FALSE(keeps_dead_zone(k, 1, 0));
  EXPECT_EQ(steady_dead_zone_um(k, 100, 100), 0);
  EXPECT_TRUE(std::isinf(window_time_s(k, 100, 100)));

  Resin r = resin(100, units::height10_from_e(750));
  r.model = CureModelKind::kinetic;
  r.critical_dose_prime = 200;
  r.inhibition = Inhibition{1, units::height10_from_e(100), 1, 0};
  Printer p = linear_printer(0, 100);
  p.uv = UvLamp{365, false, {{0, 0}, {255, 300}}};
  Process process = test::process(400);
  process.uv = {UvKind::constant, 100, 0, {}};
  const CureModel model = make_cure_model(p, r, process, 50);
  EXPECT_EQ(model.inhibited()->highest_usable_level(0), 254);
  EXPECT_TRUE(model.inhibited()->any_level_cures_to_window());
  EXPECT_EQ(model.inhibited()->dead_zone_um(0, 255), 0);

  // Under such a pixel no fresh resin comes in: what has gathered at the window stays.
  process.uv = {UvKind::per_slice, 0, 0, {1, 100}};
  const CureModel two = make_cure_model(p, r, process, 50);
  const double one_slice = two.inhibited()->window_dose(0, 255);
  ASSERT_GT(one_slice, 0);
  const int slices = static_cast<int>(std::ceil(1 / one_slice));
  const auto cured = [&](double between_mw_cm2) {
    Process parts = process;
    parts.uv.slice_mw_cm2.assign(static_cast<std::size_t>(slices) + 2, 1);
    parts.uv.slice_mw_cm2[1] = between_mw_cm2;
    const CureModel m = make_cure_model(p, r, parts, 50);
    WindowWatch watch(m, slices + 2, 1);
    const std::uint8_t lit = 255;
    for (int n = 0; n < slices + 1; ++n) watch.add_slice(n, &lit);
    WindowTotal total(m, slices + 2);
    total.merge(watch);
    return total.result().cured_pixels;
  };
  EXPECT_EQ(cured(100), 1U);
  EXPECT_EQ(cured(101), 0U);
}

TEST(JustEnoughUv, PredictSaysThatItIsNotEnough) {
  Resin r = resin(100, units::height10_from_e(750));
  r.model = CureModelKind::kinetic;
  r.critical_dose_prime = 100;
  r.inhibition = Inhibition{1, units::height10_from_e(100), 1, 0};
  resins::Question q;
  q.blue_mw_cm2 = q.uv_mw_cm2 = 100;
  const resins::Forecast f = resins::predict(r, q);
  std::string text;
  for (const std::string& s : f.sentences) text += s + "\n";
  EXPECT_THAT(text, AllOf(HasSubstr("beta Iuv is just Ib"), Not(HasSubstr("infinitely")),
                          Not(HasSubstr("unknown")), HasSubstr("in no finite time")));
  q.uv_mw_cm2 = *number_in(text, "; " + std::string(kNumber) + " mW/cm² of UV light and more");
  EXPECT_GT(resins::predict(r, q).steady_dead_zone_um, 0);
}

// ---- uneven light -----------------------------------------------------------------------------

Printer uneven_printer() {
  Printer p = linear_printer(1, 100);
  FlatField field;
  field.width_px = 4;
  field.height_px = 1;
  field.values = std::make_shared<const std::vector<std::uint8_t>>(
      std::vector<std::uint8_t>{100, 200, 220, 0});
  field.reference = 200;
  p.flat_field = field;
  return p;
}

TEST(UnevenLight, ForecastsSayWhatThePlacesGet) {
  resins::Question q;
  q.blue_mw_cm2 = 100;
  q.black_mw_cm2 = 1;
  q.speed_mm_h = 1000;
  q.take_flat_field(uneven_printer());
  EXPECT_EQ(q.least_light, 0.5);
  EXPECT_EQ(q.greatest_light, 1.1);
  EXPECT_TRUE(q.dark_places);
  const resins::Forecast f = resins::predict(resin(576, 2000), q);
  EXPECT_NEAR(f.passing->fastest_mm_h, 6250, 1e-6);
  ASSERT_TRUE(f.dimmest && f.brightest);
  EXPECT_NEAR(f.dimmest->passing->fastest_mm_h, 3125, 1e-6);
  EXPECT_NEAR(f.brightest->passing->slowest_mm_h, 68.75, 1e-9);
  std::string text;
  for (const std::string& s : f.sentences) text += s + "\n";
  EXPECT_THAT(text, AllOf(HasSubstr("50 to 110 % of it"), HasSubstr("none at all in some places"),
                          HasSubstr("At the dimmest places (50 mW/cm²)"),
                          HasSubstr("the fastest speed is 3124.9 mm/h")));
  EXPECT_THAT(f.to_json(), HasSubstr("dimmest_place"));
  // Light that is even: nothing more is said.
  resins::Question even = q;
  even.least_light = even.greatest_light = 1;
  const resins::Forecast plain = resins::predict(resin(576, 2000), even);
  EXPECT_FALSE(plain.dimmest);
  EXPECT_EQ(plain.sentences.size() + 3, f.sentences.size());
}

TEST(UnevenLight, RecommendationsSayWhereTheyHold) {
  resins::Wish wish;
  wish.speed_mm_h = 1000;
  wish.tolerance_um = 2;
  Printer p = uneven_printer();
  const resins::Recommendation r = resins::recommend(resin(576, 2000), p, wish);
  ASSERT_TRUE(r.feasible);
  ASSERT_TRUE(r.places);
  EXPECT_EQ(r.places->least_light, 0.5);
  EXPECT_EQ(r.places->greatest_light, 1.1);
  EXPECT_NEAR(r.places->fastest_mm_h, r.fastest_mm_h / 2, 1e-9 * r.fastest_mm_h);
  // Full light is about twice the critical one at the recommended height, so half of it is not
  // enough; a quarter of the display gets none.
  EXPECT_EQ(r.places->share_met, r.phi_max / 2 > 1 ? 0.75 : 0.5);
  EXPECT_THAT(r.warnings, testing::Contains(HasSubstr("% of the display only")));
  p.flat_field.reset();
  const resins::Recommendation even = resins::recommend(resin(576, 2000), p, wish);
  EXPECT_FALSE(even.places);
  EXPECT_EQ(even.height_e_um, r.height_e_um);
}

}  // namespace
}  // namespace slicecorr::test
