// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Exposure schedules in archives: ours back to the last bit, those of others as far as they say
// something.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "layerwise_models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using detail::change_uvj_config;
using detail::parse_uvj_config;
using detail::write_uvj_config;
using nlohmann::json;

StackInfo corrected(const Process& process) {
  StackInfo info;
  info.grid = {40, 50, 6, 50, 50, 50};
  info.kind = StackKind::corrected;
  info.printer = test::linear_printer(1, 100);
  info.printer->uv = UvLamp{365, false, {{0, 0}, {255, 275}}};
  info.resin = test::resin(576, 110);
  info.resin->inhibition = Inhibition{0.73, 87, 1, 0};
  info.process = process;
  info.target_layers = 6;
  info.program = "test";
  return info;
}

Process every_field() {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.speed_mm_h = 17.0 / 3;
  p.exposure_s = 2.1 / 0.7;
  p.bottom_exposure_s = 1e-3 / 3;
  p.bottom_layers = 2;
  p.fade_layers = 3;
  p.layer_exposure_s = {1.0 / 3, 2.0 / 7, 1e-9};
  p.uv.kind = UvKind::per_slice;
  p.uv.uv_mw_cm2 = 100.0 / 3;
  p.uv.dead_zone_um = 30.1;
  p.uv.slice_mw_cm2 = {100.0 / 7, 0, 55.5};
  p.ramp = Ramp::lamp_follows;
  p.ramp_mm = 1.0 / 3;
  p.allow_window_cure = true;
  return p;
}

TEST(StackSchedule, EveryFieldComesBackToTheLastBit) {
  for (const ExposureMode mode : {ExposureMode::continuous, ExposureMode::layerwise}) {
    for (const UvKind uv : {UvKind::off, UvKind::constant, UvKind::per_slice, UvKind::patterned}) {
      for (const Ramp ramp : {Ramp::none, Ramp::lamp_follows, Ramp::outside}) {
        Process p = every_field();
        p.mode = mode;
        p.uv.kind = uv;
        p.ramp = ramp;
        const std::string text = write_uvj_config(corrected(p), {7});
        EXPECT_EQ(json::parse(text)["slicecorr"]["format"], 2);
        EXPECT_EQ(parse_uvj_config(text, "x.uvj").info.process, p);
      }
    }
  }
}

TEST(StackSchedule, FormatIsOneAsLongAsNothingNewIsUsed) {
  const Process plain = test::process(1000, 5);
  const auto format = [](const Process& p) {
    return json::parse(write_uvj_config(corrected(p), {7}))["slicecorr"]["format"].get<int>();
  };
  EXPECT_EQ(format(plain), 1);
  EXPECT_FALSE(
      json::parse(write_uvj_config(corrected(plain), {7}))["slicecorr"]["process"].contains(
          "exposure_s"));
  for (int field = 0; field < 4; ++field) {
    Process p = plain;
    if (field == 0) p.mode = ExposureMode::layerwise;
    if (field == 1) p.uv.kind = UvKind::constant;
    if (field == 2) p.ramp = Ramp::outside;
    if (field == 3) p.allow_window_cure = true;
    EXPECT_EQ(format(p), 2) << field;
  }
}

TEST(StackSchedule, LiftsOfAnArchiveStay) {
  Process p = test::layerwise(2);
  p.bottom_exposure_s = 14;
  p.bottom_layers = 2;
  StackInfo info = corrected(p);
  LiftTimes lifts;
  lifts.normal.up_mm = 3;
  lifts.normal.up_mm_s = 1.25;
  lifts.normal.up_2_mm = 4;
  lifts.normal.up_2_mm_s = 4;
  lifts.normal.back_mm_s = 3.5;
  lifts.bottom.up_mm = 5;
  lifts.bottom.up_mm_s = lifts.bottom.back_mm_s = 1;
  lifts.bottom.before_light_s = 2.5;
  lifts.bottom_layers = 2;
  // Those of a printer file are the machine's own.
  info.lift_times = lifts;
  EXPECT_EQ(json::parse(write_uvj_config(info, {7}))["Properties"]["Exposure"]["LiftHeight"], 0);
  info.lift_times->by_archive = true;
  const std::string text = write_uvj_config(info, {7});
  const json config = json::parse(text);
  const json& normal = config["Properties"]["Exposure"];
  EXPECT_EQ(normal["LiftHeight"], 7);
  EXPECT_NEAR(normal["LiftSpeed"], 60 * 7 / (3 / 1.25 + 4 / 4.), 1e-9);
  EXPECT_NEAR(normal["RetractSpeed"], 60 * 3.5, 1e-9);
  EXPECT_EQ(normal["LightOffTime"], 0);
  EXPECT_EQ(config["Properties"]["Bottom"]["LiftHeight"], 5);
  EXPECT_NEAR(config["Properties"]["Bottom"]["LightOffTime"], 5 + 5 + 2.5, 1e-9);
  json bottom = config["Properties"]["Bottom"];
  bottom.erase("Count");
  EXPECT_EQ(config["Layers"][0]["Exposure"], bottom);
  EXPECT_EQ(config["Layers"][2]["Exposure"], normal);
  // A stopwatch shows the same, but for the way that the second stage comes back by a layer less.
  const StackInfo back = parse_uvj_config(text, "x.uvj").info;
  ASSERT_TRUE(back.lift_times);
  for (const int layer : {0, 2}) {
    EXPECT_NEAR(dark_time(back.lift_times->of(layer), 50).all_s(),
                dark_time(info.lift_times->of(layer), 50).all_s(), 0.051)
        << layer;
  }
}

TEST(StackSchedule, LayersSayTheirExposure) {
  Process p = test::layerwise(2);
  p.bottom_exposure_s = 14;
  p.bottom_layers = 1;
  p.fade_layers = 2;
  const json config = json::parse(write_uvj_config(corrected(p), {7}));
  EXPECT_EQ(config["Properties"]["Exposure"]["LightOnTime"], 2);
  EXPECT_EQ(config["Properties"]["Bottom"]["LightOnTime"], 14);
  EXPECT_EQ(config["Properties"]["Bottom"]["Count"], 1);
  const std::vector<double> expected{14, 10, 6, 2, 2, 2};
  for (std::size_t n = 0; n < 6; ++n) {
    EXPECT_EQ(config["Layers"][n]["Exposure"]["LightOnTime"], expected[n]);
    EXPECT_EQ(config["Layers"][n]["Exposure"]["LightPWM"], 255);
  }
  const StackInfo back = parse_uvj_config(config.dump(), "x.uvj").info;
  // The list is told as what it is: a first layer, and even steps down from it.
  EXPECT_EQ(back.exposure_s, 2);
  EXPECT_TRUE(back.layer_exposure_s.empty());
  EXPECT_EQ(back.bottom_exposure_s, 14);
  EXPECT_EQ(back.bottom_layers, 1);
  EXPECT_EQ(back.fade_layers, 2);
}

TEST(StackSchedule, RampsChangeTimeAndLightOfTheSlicesInThem) {
  Process p = test::process(1000);
  p.ramp = Ramp::lamp_follows;
  p.ramp_mm = 0.1;
  const json ramped = json::parse(write_uvj_config(corrected(p), {7}));
  // Middles at 25, 75, 125 um from the ends; the ramp is 100 um.
  const double slice_s = 50 * 3.6 / 1000;
  for (const std::size_t n : {0U, 1U, 2U, 3U, 4U, 5U}) {
    const double z = (static_cast<double>(std::min<std::size_t>(n, 5 - n)) + 0.5) * 0.05;
    const double speed = std::min(1.0, std::sqrt(z / 0.1));
    const json& exposure = ramped["Layers"][n]["Exposure"];
    EXPECT_NEAR(exposure["LightOnTime"].get<double>(), slice_s / speed, 1e-12) << n;
    EXPECT_EQ(exposure["LightPWM"], static_cast<int>(std::lround(255 * speed))) << n;
  }
  p.ramp = Ramp::outside;
  const json outside = json::parse(write_uvj_config(corrected(p), {7}));
  for (const json& layer : outside["Layers"]) {
    EXPECT_EQ(layer["Exposure"]["LightPWM"], 255);
    EXPECT_EQ(layer["Exposure"]["LightOnTime"], slice_s);
  }
}

/// An archive's config of another program.
json foreign(int layers) {
  json config;
  config["Properties"]["Size"] = {{"X", 40},
                                  {"Y", 50},
                                  {"Millimeter", {{"X", 2.0}, {"Y", 2.5}}},
                                  {"Layers", layers},
                                  {"LayerHeight", 0.05}};
  return config;
}
StackInfo read(const json& config) { return parse_uvj_config(config.dump(), "x.uvj").info; }

TEST(StackSchedule, ForeignArchivesSayTimesInThreeWays) {
  json config = foreign(4);
  EXPECT_EQ(read(config).exposure_s, 0);
  config["Properties"]["Exposure"]["LightOnTime"] = 2.5;
  EXPECT_EQ(read(config).exposure_s, 2.5);
  EXPECT_EQ(read(config).bottom_layers, 0);
  config["Properties"]["Bottom"] = {{"LightOnTime", 30}, {"Count", 2}};
  EXPECT_EQ(read(config).bottom_exposure_s, 30);
  EXPECT_EQ(read(config).bottom_layers, 2);
  EXPECT_TRUE(read(config).layer_exposure_s.empty());
  for (const double t : {30.0, 16.0, 2.5, 2.5}) {
    config["Layers"].push_back({{"Z", 1}, {"Exposure", {{"LightOnTime", t}, {"LiftHeight", 5}}}});
  }
  EXPECT_EQ(read(config).layer_exposure_s, (std::vector<double>{30, 16, 2.5, 2.5}));
  // All alike: nothing that the properties don't say.
  for (json& layer : config["Layers"]) layer["Exposure"]["LightOnTime"] = 2.5;
  EXPECT_TRUE(read(config).layer_exposure_s.empty());
  config["Properties"].erase("Exposure");
  EXPECT_EQ(read(config).exposure_s, 2.5);
  // Not every layer says one: what the properties say counts.
  config["Layers"][1].erase("Exposure");
  EXPECT_EQ(read(config).exposure_s, 0);
  // Times of 0 are none: a continuous print without a speed.
  config = foreign(2);
  for (int n = 0; n < 2; ++n) config["Layers"].push_back({{"Exposure", {{"LightOnTime", 0}}}});
  EXPECT_EQ(read(config).exposure_s, 0);
  EXPECT_TRUE(read(config).layer_exposure_s.empty());
}

// A list of another program's that says no light gets that of each layer once one of them is dimmed:
// here lamps follow a stage that goes slower from slice 2 on.
TEST(StackSchedule, ListsWithoutLightGetThatOfEachLayer) {
  json config = foreign(4);
  for (int n = 0; n < 4; ++n) config["Layers"].push_back({{"Exposure", {{"LightOnTime", 1}}}});
  StackInfo info = corrected(test::process(300));
  info.grid.layers = info.target_layers = 4;
  info.process->slice_speed_mm_h = {300, 300, 200};
  const json changed = json::parse(change_uvj_config(config.dump(), info, {7}, true, false));
  for (int n = 0; n < 4; ++n) {
    const json& exposure = changed["Layers"][n]["Exposure"];
    ASSERT_TRUE(exposure.contains("LightPWM")) << n;
    EXPECT_EQ(exposure["LightPWM"], n < 2 ? 255 : 170);
    EXPECT_NEAR(exposure["LightOnTime"], 50e-3 / (n < 2 ? 300 : 200) * 3600, 1e-9);
  }
  // Of a list in which some say it, the others have that of the properties.
  config["Properties"]["Exposure"]["LightPWM"] = 51;
  config["Layers"][3]["Exposure"]["LightPWM"] = 204;
  EXPECT_EQ(read(config).light_share, (std::vector<double>{0.2, 0.2, 0.2, 0.8}));
}

// First layers and even steps down from them are told from a list, whether its head counts them or not: so
// that a new exposure leaves them.
TEST(StackSchedule, ListsOfFirstLayersAreThose) {
  json config = foreign(8);
  config["Properties"]["Exposure"]["LightOnTime"] = 4;
  for (const double t : {30.0, 30.0, 30.0, 30.0, 21.33, 12.67, 4.0, 4.0}) {
    config["Layers"].push_back({{"Exposure", {{"LightOnTime", t}}}});
  }
  for (const bool said : {false, true}) {
    if (said) config["Properties"]["Bottom"] = {{"LightOnTime", 30}, {"Count", 4}};
    const StackInfo info = read(config);
    EXPECT_TRUE(info.layer_exposure_s.empty());
    EXPECT_EQ(info.bottom_exposure_s, 30);
    EXPECT_EQ(info.bottom_layers, 4);
    EXPECT_EQ(info.fade_layers, 2);
  }
  // Steps that are not even are the list's alone.
  config["Layers"][4]["Exposure"]["LightOnTime"] = 25;
  EXPECT_EQ(read(config).layer_exposure_s.size(), 8U);
}

TEST(StackSchedule, BadTimesAreNamed) {
  const auto refused = [](const json& config) -> std::string {
    try {
      read(config);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  json config = foreign(2);
  config["Layers"] = {{{"Exposure", {{"LightOnTime", 1}}}}, {{"Exposure", {{"LightOnTime", -1}}}}};
  EXPECT_NE(refused(config).find("Layers[1].Exposure.LightOnTime is -1"), std::string::npos);
  config["Layers"][1]["Exposure"]["LightOnTime"] = "long";
  EXPECT_NE(refused(config).find("Layers[1].Exposure.LightOnTime"), std::string::npos);
  config = foreign(2);
  config["Properties"]["Bottom"] = {{"LightOnTime", 30}, {"Count", -2}};
  EXPECT_NE(refused(config).find("Properties.Bottom.Count is -2"), std::string::npos);

  // Layers are objects, and so is what they say of exposure.
  for (const json& odd : {json(5), json("long"), json(true), json::array({1}), json()}) {
    config = foreign(2);
    config["Layers"] = {{{"Exposure", {{"LightOnTime", 1}}}}, odd};
    EXPECT_NE(refused(config).find("Layers[1] is "), std::string::npos) << odd << refused(config);
    if (odd.is_null()) continue;  // none
    config["Layers"][1] = {{"Exposure", odd}};
    EXPECT_NE(refused(config).find("Layers[1].Exposure is "), std::string::npos)
        << odd << refused(config);
  }
  config = foreign(2);
  config["Layers"] = {{"a", 1}};
  EXPECT_NE(refused(config).find("Layers is an object"), std::string::npos) << refused(config);

  // Our own block.
  const auto changed = [&](const char* key, const json& value) {
    json block = json::parse(write_uvj_config(corrected(every_field()), {7}));
    block["slicecorr"]["process"][key] = value;
    return refused(block);
  };
  EXPECT_EQ(changed("exposure_s", 3), "");
  for (const auto& [key, value] :
       std::vector<std::pair<const char*, json>>{{"exposure_s", 0},
                                                 {"exposure_s", "2"},
                                                 {"bottom_exposure_s", -1},
                                                 {"bottom_layers", 1.5},
                                                 {"fade_layers", -1},
                                                 {"layer_exposure_s", {1, -1}},
                                                 {"layer_exposure_s", 1},
                                                 {"ramp", "steep"},
                                                 {"ramp_mm", -1},
                                                 {"window_cure", "maybe"},
                                                 {"uv", {{"kind", "on"}}}}) {
    EXPECT_NE(changed(key, value).find(std::string("slicecorr.process.") + key), std::string::npos)
        << changed(key, value);
  }
  // Version 1 knows one mode only.
  json block = json::parse(write_uvj_config(corrected(every_field()), {7}));
  block["slicecorr"]["format"] = 1;
  EXPECT_NE(refused(block).find("slicecorr.mode"), std::string::npos);
}

}  // namespace
}  // namespace slicecorr
