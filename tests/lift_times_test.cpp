// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Times of prints with lifts: closed forms against a platform that is moved step by step, printer files
// that say lifts, what slices light, and the Z compensation of a slicer.
#include "slicecorr/lift_times.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "base/coded_band.hpp"
#include "baseline/z_compensation.hpp"
#include "rounds.hpp"
#include "slicecorr/baseline.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/layer_areas.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr {
namespace {

using testing::HasSubstr;

TEST(LiftTimes, AMarsLiftsInTwoStages) {
  // A .goo file of a Mars 4 Max: 3 mm at 75 mm/min and 4 mm at 230, back the other way round, 1 s of rest.
  LiftMotion m;
  m.up_mm = 3;
  m.up_mm_s = 75.0 / 60;
  m.up_2_mm = 4;
  m.up_2_mm_s = 230.0 / 60;
  m.back_mm_s = 230.0 / 60;
  m.back_2_mm = 1.5;
  m.back_2_mm_s = 75.0 / 60;
  m.before_light_s = 1;
  const DarkTime t = dark_time(m, 50);
  EXPECT_NEAR(t.lift_s, 3 * 60 / 75.0 + 4 * 60 / 230.0, 1e-12);
  // It comes back by a layer less.
  EXPECT_NEAR(t.return_s, 5.45 * 60 / 230.0 + 1.5 * 60 / 75.0, 1e-12);
  EXPECT_EQ(t.waits_s, 1);
}

TEST(LiftTimes, LightStaysOffAsLongAsIsSaid) {
  LiftMotion m;
  m.up_mm = 6;
  m.up_mm_s = 2;
  m.back_mm_s = 3;
  const double moves_s = 3 + 5.95 / 3;
  m.light_off_s = 2;
  EXPECT_NEAR(dark_time(m, 50).all_s(), moves_s, 1e-12);
  m.light_off_s = 20;
  EXPECT_NEAR(dark_time(m, 50).all_s(), 20, 1e-12);
  m.tilt_s = 5;
  EXPECT_NEAR(dark_time(m, 50).all_s(), 25, 1e-12);
}

/// Time in which a platform that speeds up, keeps its speed and slows down goes a way: moved in steps.
double stepped_s(double mm, double mm_s, double mm_s2, double step_s) {
  double at = 0, speed = 0, time = 0;
  while (at < mm) {
    // As fast as it may be and still stop in time.
    const double stops = mm_s2 > 0 ? std::sqrt(2 * mm_s2 * (mm - at)) : mm_s;
    const double wanted = mm_s2 > 0 ? std::min({mm_s, speed + mm_s2 * step_s, stops}) : mm_s;
    speed = std::max(wanted, 1e-4 * mm_s);
    at += speed * step_s;
    time += step_s;
  }
  return time;
}

TEST(LiftTimes, RandomMotionsTakeAsLongAsStepByStep) {
  std::mt19937 random(7);
  const auto any = [&](double least, double most) {
    return std::uniform_real_distribution<>(least, most)(random);
  };
  constexpr double step_s = 2e-5;
  for (int round = 0; round < test::rounds(12); ++round) {
    LiftMotion m;
    m.up_mm = any(0.5, 8);
    m.up_mm_s = any(0.5, 5);
    if (round % 2) {
      m.up_2_mm = any(0.5, 4);
      m.up_2_mm_s = any(0.5, 5);
      m.back_2_mm = any(0.1, 0.4);
      m.back_2_mm_s = any(0.5, 5);
    }
    m.back_mm_s = any(0.5, 5);
    m.before_lift_s = any(0, 1);
    m.after_lift_s = any(0, 1);
    m.before_light_s = any(0, 1);
    if (round % 3) m.acceleration_mm_s2 = any(2, 40);
    const double layer_um = any(10, 100), a = m.acceleration_mm_s2;
    const double back_mm = m.up_mm + m.up_2_mm - layer_um / 1000 - m.back_2_mm;
    double expected = m.before_lift_s + m.after_lift_s + m.before_light_s;
    int moves = 0;
    for (const auto& [mm, mm_s] : {std::pair(m.up_mm, m.up_mm_s),
                                   {m.up_2_mm, m.up_2_mm_s},
                                   {back_mm, m.back_mm_s},
                                   {m.back_2_mm, m.back_2_mm_s}}) {
      if (mm == 0) continue;
      expected += stepped_s(mm, mm_s, a, step_s);
      ++moves;
    }
    // A step at each end of a move; and near its end the least speed, 1e-4 of the whole, stands for a
    // stop: it is reached within v²/(2a) 1e-8 of the end, which takes v/(2a) 1e-4, below 2e-4 s.
    EXPECT_NEAR(dark_time(m, layer_um).all_s(), expected, moves * (3 * step_s + 2e-4) + 1e-3)
        << round;
  }
}

TEST(LiftTimes, EveryLayerCounts) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 2;
  p.bottom_exposure_s = 30;
  p.bottom_layers = 3;
  LiftTimes lifts;
  lifts.normal.before_light_s = 1;
  lifts.bottom.before_light_s = 4;
  lifts.bottom_layers = 3;
  PrintTime t = print_time(p, lifts, 1, 50, 10);
  EXPECT_EQ(t.light_s, 3 * 30 + 7 * 2);
  EXPECT_EQ(t.all_s(), 3 * 34 + 7 * 3);
  // Fewer layers than bottom ones, and layers of their own of which the last holds on.
  EXPECT_EQ(print_time(p, lifts, 1, 50, 2).all_s(), 2 * 34);
  for (const double s : {5.0, 6.0, 7.0}) {
    lifts.layers.emplace_back().before_light_s = s;
  }
  EXPECT_EQ(print_time(p, lifts, 1, 50, 5).dark_s, 5 + 6 + 7 + 7 + 7);
  EXPECT_EQ(print_time_in_words(t), "2 min 03 s, of it 1 min 44 s of light");
  t = print_time(p, std::nullopt, 1, 50, 10);
  EXPECT_FALSE(t.all_s());
  EXPECT_EQ(print_time_in_words(t), "1 min 44 s of light; lifts not known");
  EXPECT_EQ(layer_time(p, std::nullopt, 50).in_words(), "2 s of light; lifts not known");
  EXPECT_TRUE(nlohmann::json::parse(layer_time(p, std::nullopt, 50).to_json())["all"].is_null());
  EXPECT_EQ(nlohmann::json::parse(layer_time(p, lifts, 50).to_json())["all"], 3);
  // A print that moves while it cures has no lifts, whatever is known of them.
  p.mode = ExposureMode::continuous;
  p.speed_mm_h = 1000;
  t = print_time(p, lifts, 1, 50, 10);
  EXPECT_EQ(t.all_s(), t.light_s);
  EXPECT_EQ(print_time_in_words({3723, 0.0}), "1 h 02 min 03 s");
}

constexpr const char* kDisplay =
    "name = \"p\"\n[display]\nwidth_px = 10\nheight_px = 10\npixel_um = 50.0\n[blue]\n"
    "calibration = [[0, 0.0], [255, 10.0]]\n";

Printer printer_with(const std::string& rest) {
  return parse_printer(std::string(kDisplay) + rest, "p.toml");
}

TEST(LiftTimes, PrinterFilesSayThem) {
  const Printer p = printer_with(
      "[stage]\nlift_mm = 6\nlift_speed_mm_h = 3600\nreturn_speed_mm_h = 7200\nwait_s = 1.5\n");
  ASSERT_TRUE(p.lift_motion);
  EXPECT_EQ(p.lift_motion->up_mm, 6);
  EXPECT_NEAR(dark_time(*p.lift_motion, 50).all_s(), 6 + 5.95 / 2 + 1.5, 1e-12);
  // Without a lift nothing is known; speed and wait have defaults.
  EXPECT_FALSE(printer_with("[stage]\nmax_speed_mm_h = 3600\n").lift_motion);
  const Printer plain = printer_with("[stage]\nmax_speed_mm_h = 3600\nlift_mm = 3\n");
  EXPECT_NEAR(dark_time(*plain.lift_motion, 100).all_s(), 3 + 2.9 + 0.5, 1e-12);
  // settle_s is the same as wait_s; moves take longer where speeds are not there at once.
  const Printer slow = printer_with(
      "[stage]\nlift_mm = 3\nlift_speed_mm_h = 3600\nsettle_s = 2\nacceleration_mm_s2 = 4\n");
  EXPECT_NEAR(dark_time(*slow.lift_motion, 100).all_s(), 3.25 + 3.15 + 2, 1e-12);
  // A machine that only steps goes up by a layer.
  const Printer steps = printer_with(
      "[stage]\nlift_mm = 3\nlift_speed_mm_h = 3600\nwait_s = 0\n[process]\nlifts = \"none\"\n");
  EXPECT_NEAR(dark_time(*steps.lift_motion, 100).all_s(), 0.1, 1e-12);
  EXPECT_EQ(printer_with("[vat]\nadhesion_kpa = 12.5\n").adhesion_kpa, 12.5);
}

TEST(LiftTimes, PrinterFilesAreRefusedByKey) {
  const auto refused = [](const std::string& rest, const char* words) {
    try {
      printer_with(rest);
      ADD_FAILURE() << rest;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("p.toml"));
      EXPECT_THAT(e.what(), HasSubstr(words));
    }
  };
  refused("[stage]\nlift_mm = -1\n", "lift_mm");
  refused("[stage]\nlift_mm = 5\n", "lift_speed_mm_h");
  refused("[stage]\nlift_mm = 5\nlift_speed_mm_h = 0\n", "lift_speed_mm_h");
  refused("[stage]\nlift_mm = 5\nlift_speed_mm_h = 100\nreturn_speed_mm_h = -3\n",
          "return_speed_mm_h");
  refused("[stage]\nwait_s = 1\nsettle_s = 1\n", "one of them");
  refused("[stage]\nwait_s = 1e9\n", "wait_s");
  refused("[vat]\nadhesion_kpa = 0\n", "adhesion_kpa");
}

TEST(LiftTimes, SetupsKeepThem) {
  slicecorr::Setup s;
  s.printer = printer_with(
      "[stage]\nlift_mm = 6\nlift_speed_mm_h = 3600\nreturn_speed_mm_h = 7200\nwait_s = 1.5\n"
      "acceleration_mm_s2 = 10\n[vat]\nadhesion_kpa = 12.5\n");
  s.resin = parse_resin(
      "name = \"r\"\n[cure]\nabsorbance_height_um = 150\nabsorbance_base = 10\n"
      "gel_dose_mj_cm2 = 10\n",
      "r.toml");
  s.process.mode = ExposureMode::layerwise;
  s.process.exposure_s = 2;
  const slicecorr::Setup again = parse_setup_json(setup_json(s), "setup");
  EXPECT_EQ(again.printer, s.printer);
  ASSERT_TRUE(again.lift_times);
  EXPECT_EQ(again.lift_times->normal, *s.printer.lift_motion);
}

/// Slices of random pixels in memory.
class RandomSlices final : public SliceSource {
 public:
  RandomSlices(std::mt19937& random, int width, int height, int layers) {
    grid_.width_px = width;
    grid_.height_px = height;
    grid_.layers = layers;
    grid_.pixel_x_um = 40;
    grid_.pixel_y_um = 60;
    grid_.layer_um = 25;
    for (int n = 0; n < layers; ++n) {
      auto& slice = slices_.emplace_back(static_cast<std::size_t>(width * height));
      const unsigned dark = 1 + random() % 6;
      for (auto& v : slice) v = random() % dark ? 0 : static_cast<std::uint8_t>(random());
    }
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {0, 0, grid_.width_px, grid_.height_px}; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    std::vector<std::uint8_t> rows;
    for (int n = 0; n < grid_.layers; ++n) {
      rows.clear();
      for (int y = band.y0; y < band.y1; ++y) {
        const auto* const row = slices_[static_cast<std::size_t>(n)].data() + y * grid_.width_px;
        rows.insert(rows.end(), row + band.x0, row + band.x1);
      }
      sink(n, n % 5 == 4 ? nullptr : rows.data());
    }
  }
  double mm2(int n) const {
    if (n % 5 == 4) return 0;
    double area = 0;
    for (const auto v : slices_[static_cast<std::size_t>(n)]) area += v ? 0.04 * 0.06 : 0;
    return area;
  }

 private:
  Grid grid_;
  std::vector<std::vector<std::uint8_t>> slices_;
};

TEST(LayerAreas, AreThoseOfThePixels) {
  std::mt19937 random(3);
  for (int round = 0; round < test::rounds(10); ++round) {
    const RandomSlices slices(random, 1 + static_cast<int>(random() % 700),
                              1 + static_cast<int>(random() % 90),
                              1 + static_cast<int>(random() % 9));
    Printer printer;
    printer.adhesion_kpa = 30;
    ExecutionContext one, four;
    one.threads = 1;
    four.threads = 4;
    const LayerAreas areas = lit_areas(slices, &printer, four);
    EXPECT_EQ(areas.lit_pixels, lit_areas(slices, nullptr, one).lit_pixels);
    const int layers = slices.grid().layers;
    double most = 0, change = 0;
    int most_at = 0, change_at = 0;
    for (int n = 0; n < layers; ++n) {
      EXPECT_NEAR(areas.mm2(static_cast<std::size_t>(n)), slices.mm2(n), 1e-9);
      if (slices.mm2(n) > most + 1e-9) {
        most = slices.mm2(n);
        most_at = n;
      }
      const double here = n > 0 ? std::abs(slices.mm2(n) - slices.mm2(n - 1)) : 0;
      if (here > change + 1e-9) {
        change = here;
        change_at = n;
      }
    }
    const auto c = areas.largest_change();
    ASSERT_EQ(c.has_value(), change > 0);
    if (c) {
      EXPECT_EQ(c->layer, change_at);
      EXPECT_NEAR(c->mm2(), change, 1e-9);
      EXPECT_EQ(c->um, change_at * 25);
    }
    const auto f = areas.largest_force();
    ASSERT_EQ(f.has_value(), most > 0);
    if (f) {
      EXPECT_EQ(f->layer, most_at);
      // 30 kPa are 0.03 N on a mm².
      EXPECT_NEAR(f->n, 0.03 * most, 1e-9);
    }
    EXPECT_FALSE(lit_areas(slices, nullptr, one).largest_force());
  }
}

TEST(LayerAreas, WordsNameLayersAndLimits) {
  LayerAreas areas;
  areas.layer_um = 50;
  areas.pixel_mm2 = 0.01;
  areas.lit_pixels = {100, 100, 900, 100};
  EXPECT_EQ(areas.in_words(),
            "  largest change of lit area: layer 2, at 100 um, from 1 to 9 mm²\n");
  areas.adhesion_kpa = 20;
  areas.limit_pa = 30000;
  EXPECT_THAT(areas.in_words(), HasSubstr("0.18 N in layer 2, at 100 um (9 mm² at 20 kPa)\n"));
  areas.limit_pa = 10000;
  EXPECT_THAT(areas.in_words(), HasSubstr("more per area than the 10000 Pa"));
  areas.lit_pixels = {7, 7};
  areas.adhesion_kpa = 0;
  EXPECT_EQ(areas.in_words(), "");
  EXPECT_TRUE(nlohmann::json::parse(areas.to_json())["largest_area_change"].is_null());
}

TEST(ZCompensation, KeepsWhatTheSlicesBeforeHaveToo) {
  std::mt19937 random(11);
  for (int round = 0; round < test::rounds(40); ++round) {
    const std::size_t columns = 1 + random() % 40, layers = 1 + random() % 30;
    const bool greys = round % 2;
    std::vector<std::vector<std::uint8_t>> slices(layers, std::vector<std::uint8_t>(columns));
    for (std::size_t i = 0; i < columns; ++i) {
      std::uint8_t now = 0;
      for (std::size_t n = 0; n < layers; ++n) {
        if (random() % 4 == 0) {
          now = random() % 2 ? 255 : greys ? static_cast<std::uint8_t>(random()) : 0;
        }
        slices[n][i] = now;
      }
    }
    detail::CodedBand band(columns);
    BandErase erase(columns);
    for (const auto& slice : slices) {
      band.append(slice.data());
      erase.add_layer(slice.data());
    }
    const int by = static_cast<int>(random() % 12);
    const detail::CodedBand made = detail::compensated(band, by);
    ASSERT_EQ(made.slices(), static_cast<int>(layers));
    BandErase::Walk walk(erase, by);
    std::vector<std::uint8_t> shown(columns);
    for (std::size_t n = layers; n-- > 0;) {
      made.read(static_cast<int>(n), shown.data());
      const std::uint8_t* const erased = walk.next(slices[n].data());
      for (std::size_t i = 0; i < columns; ++i) {
        std::uint8_t least = 255;
        for (std::size_t k = n - std::min(n, static_cast<std::size_t>(by)); k <= n; ++k) {
          least = std::min(least, slices[k][i]);
        }
        EXPECT_EQ(shown[i], least) << n << " " << i;
        EXPECT_TRUE(greys || shown[i] == erased[i]) << n << " " << i;
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr
