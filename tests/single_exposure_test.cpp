// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Single exposures with wanted fronts and backs: what gels is looked up in fine steps of the test's own.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/relief.hpp"
#include "slicecorr/stack.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

Kinetics kinetics_of(double m, bool inhibited) {
  Kinetics k{408, m, 64};
  if (inhibited) {
    k.beta = 0.73;
    k.huv_um = 37.8;
  }
  return k;
}

/// First and last height, in steps of 0.05 um, at which ((Ib e^(-z/hb) - beta Iuv e^(-z/huv))^m t is D'c.
ReliefHeights looked_up(const Kinetics& k, double blue, double uv, double seconds) {
  ReliefHeights found;
  bool any = false;
  for (int step = 0; step < 60000; ++step) {
    const double z = 0.05 * step;
    const double net =
        blue * std::exp(-z / k.hb_um) - (k.beta > 0 ? k.beta * uv * std::exp(-z / k.huv_um) : 0.0);
    if (net <= 0 || std::pow(net, k.m) * seconds < k.critical_dose_prime) continue;
    if (!any) found.front_um = z;
    any = true;
    found.back_um = z;
  }
  return found;
}

TEST(SingleExposure, BacksAloneHaveTheClosedForm) {
  for (const double m : {0.7, 1.0, 1.3}) {
    const Kinetics k = kinetics_of(m, false);
    const std::vector<ReliefHeights> wanted{{0, 100}, {0, 0}, {0, 300}, {0, 700}};
    const ReliefAnswer r = find_relief(k, wanted, {.most_blue_mw_cm2 = 100});
    // The highest place gets all of the light: t = D'c e^(m z/hb)/I^m.
    EXPECT_NEAR(r.time_s, 64 * std::exp(m * 700 / 408) / std::pow(100, m), 1e-9 * r.time_s);
    EXPECT_NEAR(r.places[3].blue_mw_cm2, 100, 1e-9);
    EXPECT_NEAR(r.places[0].blue_mw_cm2, 100 * std::exp(-600.0 / 408), 1e-9);
    EXPECT_EQ(r.places[1].blue_mw_cm2, 0);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const ReliefHeights own = looked_up(k, r.places[i].blue_mw_cm2, 0, r.time_s);
      EXPECT_NEAR(own.back_um, wanted[i].back_um, 0.06) << m << " " << i;
      EXPECT_EQ(r.places[i].miss, ReliefMiss::none);
    }
  }
}

TEST(SingleExposure, UvLightByPlaceGivesBothHeights) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> front(10, 150), thick(150, 800);
  const Kinetics k = kinetics_of(0.99, true);
  std::vector<ReliefHeights> wanted;
  for (int i = 0; i < 20; ++i) {
    const double f = front(random);
    wanted.push_back({f, f + thick(random)});
  }
  const ReliefGoal goal{.most_blue_mw_cm2 = 100, .most_uv_mw_cm2 = 275, .uv_by_place = true};
  const ReliefAnswer r = find_relief(k, wanted, goal);
  double blue = 0, uv = 0;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const ReliefLight& p = r.places[i];
    const ReliefHeights own = looked_up(k, p.blue_mw_cm2, p.uv_mw_cm2, r.time_s);
    EXPECT_NEAR(own.front_um, wanted[i].front_um, 0.06) << i;
    EXPECT_NEAR(own.back_um, wanted[i].back_um, 0.06) << i;
    blue = std::max(blue, p.blue_mw_cm2);
    uv = std::max(uv, p.uv_mw_cm2);
  }
  // The shortest time: one of the lamps gives all it can.
  EXPECT_NEAR(std::max(blue / 100, uv / 275), 1, 1e-9);
  // A time of one's own: twice as long wants less light, half as long more than there is.
  ReliefGoal timed = goal;
  timed.time_s = 2 * r.time_s;
  const ReliefAnswer slow = find_relief(k, wanted, timed);
  EXPECT_NEAR(slow.places[0].blue_mw_cm2, r.places[0].blue_mw_cm2 * std::pow(2, -1 / 0.99), 1e-9);
  timed.time_s = 0.5 * r.time_s;
  const ReliefAnswer fast = find_relief(k, wanted, timed);
  EXPECT_TRUE(std::any_of(fast.places.begin(), fast.places.end(),
                          [](const ReliefLight& p) { return p.miss == ReliefMiss::dim; }));
}

TEST(SingleExposure, AFloodHoldsBacksAndComesNearToFronts) {
  const Kinetics k = kinetics_of(1, true);
  // What one flood makes by itself, taken for the wish: it is found again.
  const double seconds = 3, uv = 120;
  std::vector<ReliefHeights> wanted;
  for (const double blue : {60.0, 75.0, 95.0}) wanted.push_back(looked_up(k, blue, uv, seconds));
  for (const ReliefHeights& w : wanted) ASSERT_GT(w.back_um, w.front_um);
  ReliefGoal goal{.most_blue_mw_cm2 = 200, .most_uv_mw_cm2 = 275};
  goal.time_s = seconds;
  const ReliefAnswer r = find_relief(k, wanted, goal);
  EXPECT_NEAR(r.uv_mw_cm2, uv, 0.01 * uv);
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const ReliefHeights own = looked_up(k, r.places[i].blue_mw_cm2, r.places[i].uv_mw_cm2, seconds);
    EXPECT_NEAR(own.back_um, wanted[i].back_um, 0.11) << i;
    EXPECT_NEAR(own.front_um, wanted[i].front_um, 0.5) << i;
  }
  // A back beside them that is nearer to the window than the net light's greatest place is told.
  wanted.push_back({wanted[0].front_um, wanted[0].front_um + 1});
  goal.weight = {1, 1, 1, 1e-3};
  const ReliefAnswer low = find_relief(k, wanted, goal);
  EXPECT_EQ(low.places.back().miss, ReliefMiss::too_low);
  EXPECT_GT(low.least_back_um, wanted.back().back_um);
}

TEST(SingleExposure, RefusesWhatCanNotBe) {
  const auto refused = [](const Kinetics& k, const std::vector<ReliefHeights>& wanted,
                          const ReliefGoal& goal) {
    EXPECT_THROW(find_relief(k, wanted, goal), InputError);
  };
  const ReliefGoal goal{.most_blue_mw_cm2 = 100, .most_uv_mw_cm2 = 100};
  refused(kinetics_of(1, true), {{50, 50}}, goal);
  refused(kinetics_of(1, true), {{0, 0}}, goal);
  refused(kinetics_of(1, true), {}, goal);
  refused(kinetics_of(1, false), {{50, 100}}, goal);
  refused(kinetics_of(1, true), {{50, 100}}, {.most_blue_mw_cm2 = 100});
  refused(kinetics_of(1, true), {{0, 100}}, {});
  refused(kinetics_of(1, true), {{0, -1}}, goal);
}

class ReliefProgram : public ::testing::Test {
 protected:
  ReliefProgram() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", ""}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    printer("flood.toml", "flood");
    printer("patterned.toml", "patterned");
    std::ofstream(folder_ / "r.toml")
        << "name = \"r\"\n[cure]\nmodel = \"kinetic\"\nm = 1.0\nabsorbance_height_um = 408\n"
           "absorbance_base = \"e\"\ncritical_dose_prime = 64\n[inhibition]\nbeta = 0.73\n"
           "absorbance_height_um = 37.8\nabsorbance_base = \"e\"\n";
    GreyImage back{16, 8, {}}, front{16, 8, {}};
    for (int i = 0; i < 16 * 8; ++i) {
      back.pixels.push_back(static_cast<std::uint8_t>(i % 16 < 2 ? 0 : 100 + 10 * (i % 16)));
      front.pixels.push_back(static_cast<std::uint8_t>(i / 16 < 4 ? 40 : 80));
    }
    write("back.png", back);
    write("front.png", front);
  }
  void write(const char* name, const GreyImage& image) const {
    const auto png = encode_png(image);
    std::ofstream(folder_ / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
  }
  void printer(const char* name, const char* kind) const {
    std::ofstream(folder_ / name)
        << "name = \"p\"\n[display]\nwidth_px = 16\nheight_px = 8\npixel_um = 50\n[blue]\n"
           "calibration = [[0, 0.0], [255, 100.0]]\n[uv]\nkind = \""
        << kind << "\"\ncalibration = [[0, 0.0], [255, 275.0]]\n";
  }
  RunResult call(const Command& more) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "relief", "--back", "back.png",
                               "--back-most-um", "800", "--resin", "r.toml", "-o", "light.png"} +
                           more,
                       options_);
  }
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(ReliefProgram, ImagesTimeAndErrorsAreTold) {
  const RunResult backs = call({"--printer", "flood.toml", "--json", "-", "--quiet"});
  ASSERT_EQ(backs.exit_code, 0) << backs.err;
  const json j = json::parse(backs.out);
  // White of 250 is 784.3 um.
  EXPECT_NEAR(j["time_s"].get<double>(), 64 * std::exp(800 * 250 / 255.0 / 408) / 100, 1e-6);
  // A level of 255 at a fifth of the light is 0.4 % of it, half of that off at most: hb times 0.8 %.
  EXPECT_LT(j["back_error_um"].get<double>(), 408 * 0.5 / (255 * std::exp(-400.0 / 408)));
  EXPECT_EQ(j["uv_mw_cm2"], 0);
  const Command front{"--front", "front.png", "--front-most-um", "300"};
  const RunResult both = call(
      Command{"--printer", "patterned.toml", "--uv-output", "uv.png", "--json", "-", "--quiet"} +
      front);
  ASSERT_EQ(both.exit_code, 0) << both.err;
  const json k = json::parse(both.out);
  EXPECT_TRUE(k["uv_by_place"].get<bool>());
  EXPECT_LT(k["back_error_um"].get<double>(), 10);
  EXPECT_LT(k["front_error_um"].get<double>(), 10);
  EXPECT_EQ(k["pixels"]["not_gelled"], 0);
  const RunResult flood =
      call(Command{"--printer", "flood.toml", "--json", "-", "--quiet"} + front);
  ASSERT_EQ(flood.exit_code, 0) << flood.err;
  // One UV light has one front for each back, so that two wished for can't both be had.
  EXPECT_GT(json::parse(flood.out)["front_error_um"].get<double>(), 10);
}

TEST_F(ReliefProgram, RefusesWhatDoesNotFit) {
  const auto bad = [&](const Command& more, const char* word) {
    const RunResult r = call(more);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    EXPECT_THAT(r.err, HasSubstr(word));
  };
  bad({"--printer", "flood.toml", "--front", "front.png"}, "--front-most-um");
  bad({"--printer", "patterned.toml", "--front", "front.png", "--front-most-um", "300"},
      "--uv-output");
  bad({"--printer", "flood.toml", "--uv-output", "uv.png"}, "--uv-output");
  bad({"--printer", "flood.toml", "--front", "front.png", "--front-most-um", "2000"},
      "expected it below it");
  GreyImage large{40, 8, std::vector<std::uint8_t>(40 * 8, 200)};
  write("front.png", large);
  bad({"--printer", "flood.toml", "--front", "front.png", "--front-most-um", "100"}, "40 x 8");
}

}  // namespace
}  // namespace slicecorr::test
