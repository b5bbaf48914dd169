// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Columns, rows and stationary exposures against time: closed forms, the rate equation integrated
// in time, growth that never goes back, and the dose at the end of the print.
#include "slicecorr/simulate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "models.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/report.hpp"
#include "uv_models.hpp"

namespace slicecorr {
namespace {

using test::uv::resin_1;
using test::uv::uv_printer;
using testing::HasSubstr;

struct Case {
  std::string name;
  Resin resin;
  Process process;
  double layer_um = 50;
  double tolerance = 0;  ///< of the dose at the end
  CureModel model() const { return make_cure_model(uv_printer(), resin, process, layer_um); }
};

/// One of every kind of model.
std::vector<Case> cases() {
  std::vector<Case> all;
  all.push_back({"plain", test::resin(576, 2000), test::process(1000), 50, 1e-12});
  Case ramp = all[0];
  ramp.name = "ramp";
  ramp.process.ramp = Ramp::lamp_follows;
  ramp.process.ramp_mm = 0.6;
  all.push_back(ramp);
  Case layers{"layerwise", test::resin(576, 110), {}, 50, 1e-12};
  layers.process.mode = ExposureMode::layerwise;
  layers.process.exposure_s = 0.1;
  layers.process.bottom_exposure_s = 0.4;
  layers.process.bottom_layers = 3;
  layers.process.fade_layers = 2;
  all.push_back(layers);
  for (const double x : {0.3, 1.0}) {
    layers.name = "exchanged";
    layers.process.lifts = Lifts::each;
    layers.process.lift_exchange = x;
    all.push_back(layers);
  }
  for (const double m : {0.7, 1.0}) {
    Case uv{"uv", resin_1(m), test::process(250), 50, 2e-6};
    uv.process.uv.kind = UvKind::constant;
    uv.process.uv.uv_mw_cm2 = 200;
    all.push_back(uv);
    uv.name = "uv thin";
    uv.layer_um = 10;
    uv.process.speed_mm_h = 60;
    all.push_back(uv);
    Case still = uv;
    still.name = "uv layerwise";
    still.layer_um = 50;
    still.process.mode = ExposureMode::layerwise;
    still.process.speed_mm_h = 0;
    still.process.exposure_s = 1.0;
    still.process.bottom_exposure_s = 2.5;
    still.process.bottom_layers = 4;
    all.push_back(still);
  }
  return all;
}

std::vector<std::uint8_t> random_pixels(int slices, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::uint8_t> pixels;
  while (pixels.size() < static_cast<std::size_t>(slices)) {
    // Runs of black, full and anything.
    const auto kind = random() % 3;
    const auto run = 1 + random() % 9;
    for (unsigned i = 0; i < run; ++i) {
      pixels.push_back(kind == 0   ? std::uint8_t{0}
                       : kind == 1 ? std::uint8_t{255}
                                   : static_cast<std::uint8_t>(random() % 256));
    }
  }
  pixels.resize(static_cast<std::size_t>(slices));
  return pixels;
}

/// Dose of a profile at the sample nearest to z on one side of it.
double dose_at(const DoseProfile& p, double z_um, bool from_below) {
  double found = std::nan("");
  for (std::size_t i = 0; i < p.z_um.size(); ++i) {
    if (std::abs(p.z_um[i] - z_um) > 1e-6) continue;
    found = p.dose[i];
    if (!from_below) break;  // the first of two is seen from the layer before
  }
  return found;
}

TEST(Simulate, EndsAtTheDoseOfTheColumn) {
  for (const Case& c : cases()) {
    const CureModel model = c.model();
    for (unsigned seed = 1; seed <= 3; ++seed) {
      const auto pixels = random_pixels(70, seed);
      ColumnOptions options;
      options.substeps = 2;
      options.profile_times_s = {
          PrintClock(c.process, model.m, c.layer_um, static_cast<int>(pixels.size())).total_s()};
      const ColumnHistory h = simulate_column(model, c.process, pixels, options);
      const ColumnDose dose = column_dose(model, pixels);
      ASSERT_EQ(h.profiles.size(), 1U);
      const DoseProfile& p = h.profiles[0];
      EXPECT_EQ(p.slice, 69);
      EXPECT_EQ(p.share, 1.0);
      for (std::size_t n = 0; n < pixels.size(); ++n) {
        const double z = static_cast<double>(n) * c.layer_um;
        EXPECT_NEAR(dose_at(p, z, true), dose.upper[n], c.tolerance * (1 + dose.upper[n]))
            << c.name << " " << n;
        EXPECT_NEAR(dose_at(p, z + 0.5 * c.layer_um, true), dose.middle[n],
                    c.tolerance * (1 + dose.middle[n]))
            << c.name << " " << n;
        EXPECT_NEAR(dose_at(p, z + c.layer_um, false), dose.lower[n],
                    c.tolerance * (1 + dose.lower[n]))
            << c.name << " " << n;
      }
    }
  }
}

/// Greatest relative dose so far at z (in slices) at a moment from the rate equation, by the midpoint rule in time.
double integrated(const Case& c, const std::vector<std::uint8_t>& pixels,
                  const PrintClock::Moment& now, double zeta, int steps) {
  const bool inhibited = c.process.uv.kind != UvKind::off;
  const Kinetics k = make_kinetics(c.resin, inhibited, true);
  const bool moving = c.process.mode == ExposureMode::continuous;
  const auto slices = static_cast<int>(pixels.size());
  const double keeps = c.process.lifts == Lifts::each ? 1 - c.process.lift_exchange : 1;
  double dose = 0, greatest = 0;
  for (int n = 0; n <= now.slice; ++n) {
    greatest = std::max(greatest, dose);
    dose *= keeps;
    const double share = n < now.slice ? 1.0 : now.share;
    const SliceLight light = slice_light(c.process, k.m, c.layer_um, n, slices);
    const double blue = light.share * (1 + 99 * pixels[static_cast<std::size_t>(n)] / 255.0);
    const double uv = inhibited ? c.process.uv.uv_mw_cm2 : 0;
    for (int i = 0; i < steps; ++i) {
      const double window = n + (moving ? share * (i + 0.5) / steps : 1.0);
      if (window < zeta) continue;
      dose +=
          dose_prime_at(k, blue, uv, (window - zeta) * c.layer_um, share * light.time_s / steps) /
          k.critical_dose_prime;
    }
  }
  return std::max(greatest, dose);
}

TEST(Simulate, FollowsTheRateEquation) {
  // The midpoint rule is out by less than h²/24 of the second derivative over a smooth stretch, and
  // by half a step of the rate where the window passes the point: in a step of 1/400 slice that is
  // below phi eta ln10 / 800, some 1e-3 of what one slice adds.
  for (const Case& c : cases()) {
    const CureModel model = c.model();
    const auto pixels = random_pixels(36, 7);
    const PrintClock clock(c.process, model.m, c.layer_um, 36);
    ColumnOptions options;
    options.substeps = 3;
    for (const double share : {0.04, 0.33, 0.61, 0.97, 1.0}) {
      options.profile_times_s.push_back(clock.total_s() * share);
    }
    const ColumnHistory h = simulate_column(model, c.process, pixels, options);
    for (const DoseProfile& p : h.profiles) {
      const PrintClock::Moment now{p.slice, p.share};
      double greatest_phi = 0;
      for (const double phi : model.level_phi) {
        greatest_phi = std::max(greatest_phi, phi * model.greatest_ratio());
      }
      for (std::size_t i = 3; i + 3 < p.z_um.size(); i += 11) {
        // Nodes are seen from one side there, and from both here.
        const double zeta = p.z_um[i] / c.layer_um;
        if (std::abs(zeta - std::round(zeta)) < 1e-6) continue;
        EXPECT_NEAR(p.dose[i], integrated(c, pixels, now, zeta, 400),
                    greatest_phi * c.layer_um / 50 * 1e-3 + 1e-4)
            << c.name << " " << p.time_s << " s, " << zeta;
      }
    }
  }
}

TEST(Simulate, GrowsAndNeverGoesBack) {
  for (const Case& c : cases()) {
    const CureModel model = c.model();
    const auto pixels = random_pixels(60, 21);
    const PrintClock clock(c.process, model.m, c.layer_um, 60);
    ColumnOptions options;
    options.substeps = 5;
    for (int i = 0; i <= 97; ++i) options.profile_times_s.push_back(clock.total_s() * i / 97);
    const ColumnHistory h = simulate_column(model, c.process, pixels, options);
    ASSERT_EQ(h.steps.size(), 301U);
    ASSERT_EQ(h.profiles.size(), 98U);
    // With UV light ends come from samples: as far as those are right.
    const double room_um = model.inhibited() ? 0.1 : 1e-6;
    EXPECT_FALSE(h.steps.back().gelled.empty()) << c.name;
    for (std::size_t i = 1; i < h.steps.size(); ++i) {
      EXPECT_GT(h.steps[i].time_s, h.steps[i - 1].time_s);
      EXPECT_GE(h.steps[i].z_window_um, h.steps[i - 1].z_window_um);
      double end = -1;
      for (const GelledInterval& g : h.steps[i].gelled) {
        EXPECT_LT(g.back_um, g.front_um);
        EXPECT_GT(g.back_um, end);
        end = g.front_um;
        EXPECT_LE(g.front_um, h.steps[i].z_window_um);
      }
      for (const GelledInterval& old : h.steps[i - 1].gelled) {
        bool held = false;
        for (const GelledInterval& g : h.steps[i].gelled) {
          held |= g.back_um <= old.back_um + room_um && g.front_um >= old.front_um - room_um;
        }
        EXPECT_TRUE(held) << c.name << " " << h.steps[i].time_s << " s: " << old.back_um << " to "
                          << old.front_um;
      }
    }
    // Profiles share their places as far as the earlier one reaches.
    for (std::size_t i = 1; i < h.profiles.size(); ++i) {
      const DoseProfile &a = h.profiles[i - 1], &b = h.profiles[i];
      for (std::size_t k = 0; k + 1 < a.z_um.size(); ++k) {
        ASSERT_NEAR(a.z_um[k], b.z_um[k], 1e-6);
        EXPECT_GE(b.dose[k], a.dose[k] * (1 - 1e-12) - 1e-15) << c.name << " " << a.z_um[k];
      }
    }
  }
}

TEST(Simulate, FrontsOfAColumnInClosedForm) {
  // A column under full light from the first slice on, as in figure 2.2: behind the window the dose
  // at d is phi (1 - a^(d / hs)), so the front follows at ha log10(phi / (phi - 1)).
  const CureModel model = test::figure_2_2();
  const Process process = test::process(1000);
  const std::vector<std::uint8_t> pixels(30, 255);
  ColumnOptions options;
  options.substeps = 7;
  const ColumnHistory h = simulate_column(model, process, pixels, options);
  const double lag_um = 2000 * std::log10(6.25 / 5.25);
  for (const HistoryStep& step : h.steps) {
    if (step.z_window_um < lag_um) {
      EXPECT_TRUE(step.gelled.empty());
      continue;
    }
    ASSERT_EQ(step.gelled.size(), 1U);
    EXPECT_EQ(step.gelled[0].back_um, 0);
    EXPECT_NEAR(step.gelled[0].front_um, step.z_window_um - lag_um, 1e-7);
  }
  // 1000 mm/h is 0.18 s a slice.
  EXPECT_NEAR(h.total_s, 30 * 0.18, 1e-12);
}

TEST(Simulate, Figure22Uncorrected) {
  // physics.md: one solid piece that ends at 1902.1 um, where two were designed.
  const CureModel model = test::figure_2_2();
  ColumnOptions options;
  options.profile_times_s = {9.0};
  const ColumnHistory h =
      simulate_column(model, test::process(1000), test::column(50, {{11, 20}, {31, 40}}), options);
  ASSERT_EQ(h.steps.back().gelled.size(), 1U);
  EXPECT_EQ(h.steps.back().gelled[0].back_um, 0);
  EXPECT_NEAR(h.steps.back().gelled[0].front_um, 1902.1, 0.05);
  const std::vector<std::pair<int, double>> nodes{{0, 1.9512},  {11, 3.6202}, {21, 1.5736},
                                                  {31, 2.7496}, {38, 1.0125}, {41, 0.025271}};
  for (const auto& [node, dose] : nodes) {
    EXPECT_NEAR(dose_at(h.profiles[0], 50.0 * node, true), dose, 5e-5) << node;
  }
}

TEST(Simulate, LayerwiseFrontsInClosedForm) {
  // The first slice of phi' = 5 shown to a share f: gelled from the window up to ha log10(5 f).
  Process process;
  process.mode = ExposureMode::layerwise;
  const Resin resin = test::resin(576, 110);
  process.exposure_s = 5 * make_kinetics(resin, false, true).critical_dose_prime / 100;
  const CureModel model = make_cure_model(test::linear_printer(1, 100), resin, process, 100);
  ASSERT_NEAR(model.phi_max(), 5, 1e-12);
  ColumnOptions options;
  options.substeps = 20;
  const ColumnHistory h = simulate_column(model, process, {255, 0}, options);
  for (const HistoryStep& step : h.steps) {
    if (step.slice > 0) break;
    EXPECT_EQ(step.z_window_um, 100);
    const double height = 110 * std::log10(5 * step.share);
    if (!(height > 1e-9)) {
      EXPECT_TRUE(step.gelled.empty());
      continue;
    }
    ASSERT_EQ(step.gelled.size(), 1U);
    EXPECT_NEAR(step.gelled[0].front_um, 100, 1e-9);
    EXPECT_NEAR(step.gelled[0].back_um, 100 - height, 1e-9);
  }
}

TEST(Simulate, SlowRampsTakeTimeAndLeaveTheDose) {
  Process ramp = test::process(1000);
  ramp.ramp = Ramp::lamp_follows;
  ramp.ramp_mm = 0.5;
  const PrintClock clock(ramp, 1, 50, 40);
  double sum = 0;
  for (int n = 0; n < 40; ++n) {
    const double time = slice_light(ramp, 1, 50, n, 40).time_s;
    const PrintClock::Moment half = clock.at(sum + 0.5 * time);
    EXPECT_EQ(half.slice, n);
    EXPECT_NEAR(half.share, 0.5, 1e-9);
    EXPECT_NEAR(clock.time_s(half), sum + 0.5 * time, 1e-12);
    sum += time;
  }
  EXPECT_NEAR(clock.total_s(), light_on_s(ramp, 1, 50, 40), 1e-9);
  EXPECT_GT(clock.total_s(), 40 * 0.18 * 1.2);
  EXPECT_EQ(clock.at(0).slice, 0);
  EXPECT_EQ(clock.at(0).share, 0);
  EXPECT_EQ(clock.at(1e9).slice, 39);
  EXPECT_EQ(clock.at(1e9).share, 1);
  // The end of a slice belongs to it.
  EXPECT_EQ(clock.at(clock.time_s({7, 1})).slice, 7);
  const std::vector<double> groups = group_times_s(clock, 8);
  ASSERT_EQ(groups.size(), 8U);
  EXPECT_EQ(clock.at(groups[0]).slice, 4);
  EXPECT_EQ(groups.back(), clock.total_s());
  EXPECT_EQ(group_times_s(PrintClock(ramp, 1, 50, 3), 8).size(), 3U);
}

TEST(Simulate, DeadZonesOfAColumn) {
  for (const Case& c : cases()) {
    const CureModel model = c.model();
    const ColumnHistory h = simulate_column(model, c.process, {255, 0, 255, 128});
    if (!model.inhibited()) {
      EXPECT_TRUE(h.dead_zone_um.empty());
      continue;
    }
    ASSERT_EQ(h.dead_zone_um.size(), 4U);
    // physics.md: 15.766 um and 114.87 um for 100 over 200 mW/cm², whatever m is.
    EXPECT_NEAR(h.dead_zone_um[0], 15.766, 5e-4);
    EXPECT_NEAR(h.first_gel_um[2], 114.87, 5e-3);
    EXPECT_TRUE(std::isnan(h.dead_zone_um[1]));
    EXPECT_GT(h.dead_zone_um[3], h.dead_zone_um[0]);
    // Nothing gels nearer to the window than that.
    const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(1500 / c.layer_um), 255);
    for (const HistoryStep& step : simulate_column(model, c.process, pixels).steps) {
      if (step.gelled.empty()) continue;
      EXPECT_LE(step.gelled.back().front_um, step.z_window_um - h.dead_zone_um[0] + 1e-6);
    }
  }
}

TEST(SimulateStationary, Figure34) {
  const Kinetics k{750, 1, 100, 1, 100};
  const StationaryFronts f = simulate_stationary(k, 100, 200, 10);
  EXPECT_NEAR(f.first.z_um, 312.47, 5e-3);
  EXPECT_NEAR(f.first.time_s, 1.7502, 5e-5);
  EXPECT_NEAR(f.dead_zone_um, 79.979, 5e-4);
  EXPECT_TRUE(std::isinf(f.window_s));
  ASSERT_FALSE(f.points.empty());
  EXPECT_NEAR(f.points.front().front_um, f.first.z_um, 1e-3);
  EXPECT_NEAR(f.points.front().back_um, f.first.z_um, 1e-3);
  int seen = 0;
  for (const auto& p : f.points) {
    const auto near = [&](double time_s, double front, double back) {
      if (std::abs(p.time_s - time_s) > 1e-9) return;
      ++seen;
      EXPECT_NEAR(p.front_um, front, 5e-3);
      EXPECT_NEAR(p.back_um, back, 0.05);
    };
    near(3, 139.17, 822.76);
    near(5, 110.39, 1207.0);
    near(10, 93.857, 1726.9);
  }
  EXPECT_EQ(seen, 3);
  for (std::size_t i = 1; i < f.points.size(); ++i) {
    EXPECT_GT(f.points[i].time_s, f.points[i - 1].time_s);
    EXPECT_LE(f.points[i].front_um, f.points[i - 1].front_um + 1e-9);
    EXPECT_GE(f.points[i].back_um, f.points[i - 1].back_um - 1e-9);
  }
}

TEST(SimulateStationary, WindowWithoutUvAndNothing) {
  const Kinetics k{750, 1, 100, 1, 100};
  // beta Iuv < Ib: the front is at the window after D'c / (Ib - beta Iuv) = 5 s.
  const StationaryFronts cures = simulate_stationary(k, 100, 80, 10);
  EXPECT_NEAR(cures.window_s, 5, 1e-12);
  bool met = false;
  for (const auto& p : cures.points) {
    if (p.time_s == cures.window_s) met = true;
    if (p.time_s > cures.window_s) {
      EXPECT_EQ(p.front_um, 0);
    }
  }
  EXPECT_TRUE(met);
  const StationaryFronts blue = simulate_stationary(k, 100, 0, 10);
  EXPECT_EQ(blue.points.front().front_um, 0);
  EXPECT_NEAR(blue.points.back().back_um, 750 * std::log(10.0), 1e-9);
  EXPECT_TRUE(simulate_stationary(k, 100, 200, 1.75).points.empty());
}

/// Slices of one row of pixels.
class RowSource final : public SliceSource {
 public:
  RowSource(std::vector<std::vector<std::uint8_t>> slices, double layer_um)
      : slices_(std::move(slices)) {
    grid_ = {
        static_cast<int>(slices_[0].size()), 1, static_cast<int>(slices_.size()), 50, 50, layer_um};
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {0, 0, grid_.width_px, 1}; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    for (int n = 0; n < grid_.layers; ++n) {
      sink(n, slices_[static_cast<std::size_t>(n)].data() + band.x0);
    }
  }

 private:
  std::vector<std::vector<std::uint8_t>> slices_;
  Grid grid_;
};

TEST(SimulateSection, AgreesWithItsColumns) {
  for (const Case& c : cases()) {
    const int width = 5, layers = 40;
    std::vector<std::vector<std::uint8_t>> columns;
    for (int x = 0; x < width; ++x) {
      columns.push_back(random_pixels(layers, 40U + static_cast<unsigned>(x)));
    }
    std::vector<std::vector<std::uint8_t>> slices(
        static_cast<std::size_t>(layers),
        std::vector<std::uint8_t>(static_cast<std::size_t>(width)));
    for (std::size_t n = 0; n < slices.size(); ++n) {
      for (std::size_t x = 0; x < columns.size(); ++x) slices[n][x] = columns[x][n];
    }
    const RowSource source(slices, c.layer_um);
    const slicecorr::Setup setup{uv_printer(), c.resin, c.process};
    const PrintClock clock = print_clock(setup, source.grid());
    std::vector<double> times;
    for (const double share : {0.0, 0.21, 0.487, 0.8, 1.0})
      times.push_back(share * clock.total_s());
    const SectionHistory s = simulate_section(source, nullptr, setup, 0, times);
    ASSERT_EQ(s.frames.size(), times.size());
    int compared = 0;
    for (int x = 0; x < width; ++x) {
      ColumnOptions options;
      options.substeps = 1;
      options.profile_times_s = times;
      const ColumnHistory h = simulate_column(source, nullptr, setup, x, 0, options);
      for (std::size_t k = 0; k < times.size(); ++k) {
        EXPECT_EQ(s.frames[k].slice, h.profiles[k].slice);
        for (int n = 0; n < layers; ++n) {
          const double dose = dose_at(h.profiles[k], (n + 0.5) * c.layer_um, true);
          const bool gelled = s.frames[k].gelled[static_cast<std::size_t>(n * width + x)] != 0;
          if (std::abs(dose - 1) < 1e-5) continue;
          EXPECT_EQ(gelled, dose >= 1) << c.name << " " << k << " " << x << " " << n << " " << dose;
          compared += dose >= 1;
        }
      }
    }
    EXPECT_GT(compared, 50) << c.name;
  }
}

TEST(Simulate, BadOptions) {
  const CureModel model = test::figure_2_2();
  const Process process = test::process(1000);
  const std::vector<std::uint8_t> pixels(10, 255);
  const auto message = [&](const ColumnOptions& options, const std::vector<std::uint8_t>& column) {
    try {
      simulate_column(model, process, column, options);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("no error");
  };
  ColumnOptions options;
  EXPECT_THAT(message(options, {}), HasSubstr("expected one slice"));
  options.substeps = -1;
  EXPECT_THAT(message(options, pixels), HasSubstr("1 to 10000"));
  options = {};
  options.profile_times_s = {0.5, 1.9};  // ten slices take 1.8 s
  EXPECT_THAT(message(options, pixels), HasSubstr("expected 0 to 1.8 s"));
  options.profile_times_s = {std::nan("")};
  EXPECT_THAT(message(options, pixels), HasSubstr("outside the print"));
  const RowSource source({{255, 0}, {0, 255}}, 50);
  const slicecorr::Setup setup{test::linear_printer(1, 100), test::resin(576, 2000), process};
  EXPECT_THROW(simulate_section(source, nullptr, setup, 1, {0.1}), InputError);
  EXPECT_THROW(simulate_column(source, nullptr, setup, 2, 0), InputError);
  std::atomic<bool> cancel{true};
  ExecutionContext context;
  context.cancel = &cancel;
  EXPECT_THROW(simulate_column(model, process, pixels, {}, context), Cancelled);
}

TEST(SimulatePictures, AreTheSameForTheSameInput) {
  for (const Case& c : cases()) {
    const CureModel model = c.model();
    ColumnOptions options;
    options.profile_times_s = group_times_s(PrintClock(c.process, model.m, c.layer_um, 40), 8);
    const auto pixels = random_pixels(40, 5);
    const std::string svg =
        column_history_svg(simulate_column(model, c.process, pixels, options), "a < b");
    EXPECT_THAT(svg, HasSubstr("a &lt; b"));
    EXPECT_EQ(svg.find("nan"), std::string::npos) << c.name;
    EXPECT_EQ(svg, column_history_svg(simulate_column(model, c.process, pixels, options), "a < b"));
  }
}

}  // namespace
}  // namespace slicecorr
