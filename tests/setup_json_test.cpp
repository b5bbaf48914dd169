// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A setup as text: what stacks record, without a stack.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/absorbance_in_layer.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {
namespace {

Setup resolved(SetupChoices choices) {
  choices.printer = std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml";
  if (choices.resin.empty()) choices.resin = std::string(SLICECORR_DB_DIR) + "/da-2-ppo.toml";
  return resolve_setup(choices, nullptr, nullptr, ChoiceNames::fields);
}

void expect_same_again(const Setup& setup) {
  const std::string text = setup_json(setup);
  const Setup again = parse_setup_json(text, "text");
  EXPECT_EQ(again.printer, setup.printer);
  EXPECT_EQ(again.resin, setup.resin);
  EXPECT_EQ(again.process, setup.process);
  EXPECT_EQ(setup_json(again), text);
}

TEST(SetupJson, ContinuousComesBack) {
  SetupChoices c;
  c.speed_mm_h = 712.3000000000001;  // needs all 17 digits
  c.omega_max = "1.37";
  c.one_slice_gaps = "merge";
  c.gap_shortfall = 0.31;
  c.edge_aim_um = 0.37;
  expect_same_again(resolved(c));
}

TEST(SetupJson, TomographyComesBack) {
  SetupChoices c;
  c.speed_mm_h = 700;
  slicecorr::Setup setup = resolved(c);
  setup.printer.vial = Vial{12.5, 11.8, 1.0, 1.48};
  setup.printer.optics = Optics{OpticsKind::pinhole, 99.5, 6.0887, 13, -3.5, 120};
  setup.printer.rotation = Rotation{25, TurnDirection::counterclockwise, 60};
  setup.resin.active_absorption_per_cm = 0.4;
  setup.resin.n = 1.49969;
  setup.resin.inhibition_dose_mj_cm3 = 3;
  setup.resin.inhibition_resupply_mj_cm3_s = 0.02;
  setup.resin.dose_diffusion_m2_s = 5e-12;
  setup.resin.viscosity_pa_s = 0.3;
  setup.resin.inhibitor_life_s = 3;
  setup.resin.chemistry =
      load_resin(std::string(SLICECORR_DB_DIR "/model-hydrogel.toml")).chemistry;
  setup.printer.suction_limit_pa = 2e4;
  expect_same_again(setup);
  // More than absorbs in all, and light from inside the vial.
  slicecorr::Setup wrong = setup;
  wrong.resin.active_absorption_per_cm = 20;  // 1e4 / 550 um are 18.2
  EXPECT_THROW(parse_setup_json(setup_json(wrong), "text"), InputError);
  wrong = setup;
  wrong.printer.optics->distance_mm = 12.5;
  EXPECT_THROW(parse_setup_json(setup_json(wrong), "text"), InputError);
  wrong = setup;
  wrong.printer.vial->inner_mm = 12.5;
  EXPECT_THROW(parse_setup_json(setup_json(wrong), "text"), InputError);
}

TEST(SetupJson, SpeedsOfSlicesComeBack) {
  SetupChoices c;
  c.speed_mm_h = 700;
  c.slice_speed_mm_h = {700, 123.4, 0.1 + 0.2, 0.1 + 0.2};
  const slicecorr::Setup setup = resolved(c);
  EXPECT_EQ(setup.process.slice_speed_mm_h.size(), 3U);  // the last holds
  expect_same_again(setup);
  c.slice_speed_mm_h = {700, 700};
  EXPECT_TRUE(resolved(c).process.slice_speed_mm_h.empty());
  for (const std::vector<double>& wrong :
       {std::vector<double>{700, 701}, {0}, {-1, 700}, {std::nan("")}}) {
    c.slice_speed_mm_h = wrong;
    EXPECT_THROW(resolved(c), InputError);
  }
  c = {};
  c.mode = "layerwise";
  c.exposure_s = 2;
  c.slice_speed_mm_h = {100};
  EXPECT_THROW(resolved(c), InputError);
  // A speed beyond that of the light is no stack of ours.
  std::string text = setup_json(setup);
  const auto at = text.find("123.4");
  ASSERT_NE(at, std::string::npos);
  EXPECT_THROW(parse_setup_json(text.replace(at, 5, "700.5"), "text"), InputError);
}

TEST(SetupJson, LayerwiseComesBack) {
  SetupChoices c;
  c.mode = "layerwise";
  c.exposure_s = 2.1;
  c.bottom_exposure_s = 30;
  c.bottom_layers = 4;
  c.fade_layers = 3;
  expect_same_again(resolved(c));
  c.layer_exposure_s = {3.1, 2.2, 1.3};
  c.exposure_s = c.bottom_exposure_s = 0;
  c.bottom_layers = c.fade_layers = -1;
  expect_same_again(resolved(c));
}

/// A printer of 128 x 80 pixels with more keys in [display].
Setup with_display(const std::string& keys) {
  SetupChoices c;
  c.printer_toml = "name = \"p\"\n[display]\nwidth_px = 128\nheight_px = 80\npixel_um = 50\n" +
                   keys + "[blue]\nwavelength_nm = 460\ncalibration = [[0, 1], [255, 100]]\n";
  c.resin = std::string(SLICECORR_DB_DIR) + "/benchy-resin.toml";
  c.speed_mm_h = 700;
  return resolve_setup(c, nullptr, nullptr, ChoiceNames::fields);
}

TEST(SetupJson, DisplaysThatAreTurnedOrUnevenComeBack) {
  namespace fs = std::filesystem;
  std::string folder = (fs::temp_directory_path() / "setup-json-XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  const auto picture = [&](const std::string& name, const GreyImage& image) {
    const auto bytes = encode_png(image);
    std::ofstream(folder + "/" + name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    return "flat_field = \"" + folder + "/" + name + "\"\n";
  };
  // Every value there is, also 0x00 and 0xff next to each other.
  GreyImage many{128, 80, {}};
  for (int i = 0; i < 128 * 80; ++i) many.pixels.push_back(static_cast<std::uint8_t>(i * 37));
  const std::string even = picture("even.png", {2, 1, {128, 240}}),
                    other = picture("other.png", {2, 1, {128, 241}}),
                    full = picture("full.png", many);
  std::set<std::string> texts;
  int different = 0;
  for (const std::string& field : {std::string(), even, other, full}) {
    for (const std::string turn : {"", "mirror = \"x\"\n", "mirror = \"y\"\n", "mirror = \"xy\"\n",
                                   "orientation = \"landscape\"\n", "orientation = \"portrait\"\n",
                                   "orientation = \"portrait\"\nmirror = \"x\"\n"}) {
      // The full picture covers the display, whichever way it is turned.
      SCOPED_TRACE(field + turn);
      const slicecorr::Setup setup = with_display(field + turn);
      expect_same_again(setup);
      EXPECT_EQ(setup.printer.flat_field.has_value(), !field.empty());
      texts.insert(setup_json(setup));
      ++different;
    }
  }
  EXPECT_EQ(texts.size(), static_cast<std::size_t>(different)) << "displays that are not the same";
  fs::remove_all(folder);
}

TEST(SetupJson, DifferentSetupsDiffer) {
  SetupChoices c;
  c.speed_mm_h = 700;
  const std::string one = setup_json(resolved(c));
  c.speed_mm_h = 700.0000000000001;
  EXPECT_NE(setup_json(resolved(c)), one);
}

TEST(SetupJson, DamageIsRefusedByName) {
  SetupChoices c;
  c.speed_mm_h = 700;
  std::string text = setup_json(resolved(c));
  const std::size_t at = text.find("\"width_px\"");
  ASSERT_NE(at, text.npos);
  text[at + 1] = 'v';
  try {
    parse_setup_json(text, "order.json");
    FAIL() << "accepted";
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("order.json"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("width_px"), std::string::npos) << e.what();
  }
  EXPECT_THROW(parse_setup_json("{}", "x"), InputError);
  EXPECT_THROW(parse_setup_json("", "x"), InputError);
}

/// What resolving these is refused with; empty: nothing.
std::string refusal(SetupChoices choices) {
  try {
    resolved(std::move(choices));
  } catch (const InputError& e) {
    return e.what();
  }
  return {};
}

SetupChoices continuous() {
  SetupChoices c;
  c.speed_mm_h = 700;
  return c;
}

SetupChoices layers() {
  SetupChoices c;
  c.mode = "layerwise";
  c.exposure_s = 2.1;
  return c;
}

TEST(SetupRefused, WhatChangesNothingIsNotTaken) {
  using ::testing::HasSubstr;
  for (const bool shortfall : {false, true}) {
    const std::string name = shortfall ? "gap_shortfall" : "edge_aim_um";
    const auto with = [&](SetupChoices c) {
      (shortfall ? c.gap_shortfall : c.edge_aim_um) = 0.3;
      return refusal(c);
    };
    EXPECT_EQ(with(continuous()), "");
    EXPECT_THAT(with(layers()), HasSubstr(name + " changes nothing layer by layer"));
    SetupChoices uv = continuous();
    uv.resin = std::string(SLICECORR_DB_DIR) + "/custom-resin-1.toml";
    uv.other_wavelength = "take";
    uv.uv_mw_cm2 = 50;
    EXPECT_EQ(refusal(uv), "");
    EXPECT_THAT(with(uv), HasSubstr(name + " changes nothing under UV light"));
    // Where levels are tried, both count in continuous exposure, and layer by layer neither does.
    for (SetupChoices tried : {continuous(), layers()}) {
      tried.resin = std::string(SLICECORR_DB_DIR) + "/bis-ema-tpo-gel-time.toml";
      tried.other_wavelength = "take";
      EXPECT_EQ(refusal(tried), "");
      EXPECT_THAT(with(tried), tried.mode == "layerwise"
                                   ? HasSubstr(name + " changes nothing layer by layer")
                                   : HasSubstr(""));
    }
  }
  SetupChoices gap = continuous();
  gap.gap_um = 80;
  EXPECT_THAT(refusal(gap), HasSubstr("viscosity_pa_s"));
  gap = layers();
  gap.gap_um = 80;
  EXPECT_THAT(refusal(gap), HasSubstr("gap_um changes nothing layer by layer"));
}

TEST(SetupRefused, WhatWasTypedIsNamed) {
  using ::testing::StartsWith;
  SetupChoices c = continuous();
  c.skin = 0.3;
  EXPECT_THAT(refusal(c), StartsWith("skin is for layer by layer"));
  c = continuous();
  c.green_strength = 1.5;
  EXPECT_THAT(refusal(c), StartsWith("green_strength is for layer by layer"));
  c = continuous();
  c.lift_exchange = 0;
  EXPECT_THAT(refusal(c), StartsWith("lift_exchange is for layer by layer"));
  c.lifts = "each";
  EXPECT_THAT(refusal(c), StartsWith("lifts is for layer by layer"));
}

TEST(SetupRefused, PrintersThatTurnAVial) {
  SetupChoices c = continuous();
  c.printer = std::string(SLICECORR_PRINTERS_DIR) + "/model-tomography-bench.toml";
  c.resin = std::string(SLICECORR_DB_DIR) + "/model-tomography-resin.toml";
  try {
    resolve_setup(c, nullptr, nullptr, ChoiceNames::fields);
    FAIL() << "accepted";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), ::testing::HasSubstr("'model-tomography-bench' turns a vial"));
  }
  // It is none of it for jobs in vials.
  EXPECT_TRUE(chosen_definitions(c, ChoiceNames::fields).first.vial);
}

TEST(SetupRefused, AbsorbanceHeightsThatAreMillimetres) {
  SetupChoices c = continuous();
  const auto check = [&](double ha_um) {
    c.ha_um = ha_um;
    const slicecorr::Setup s = resolved(c);
    check_absorbance_height(s.resin, 50);
  };
  check(2.5);
  try {
    check(0.2);
    FAIL() << "accepted";
  } catch (const InputError& e) {
    EXPECT_THAT(
        e.what(),
        ::testing::HasSubstr("has an absorbance height of 0.2 um: 250 of them are in a layer of 50 "
                             "um, which then lets no light pass; expected at least 2.5 um: is it "
                             "0.2 mm, which are 200 um?"));
  }
}

TEST(SetupTold, AFadeThatThePartDoesNotOutlast) {
  SetupChoices c = layers();
  c.bottom_exposure_s = 30;
  c.bottom_layers = 2;
  slicecorr::Setup setup = resolved(c);
  const auto told = [&](int fade_layers, int layers) {
    setup.process.fade_layers = fade_layers;
    std::string words;
    ExecutionContext context;
    context.notice = [&](const std::string& text) { words += text + "\n"; };
    setup_to_correct(test::MemorySlices({1, 1, layers, 50, 50, 50}), setup, context);
    return words;
  };
  EXPECT_THAT(told(9, 12), ::testing::Not(::testing::HasSubstr("fade_layers")));
  // The last of 11 layers is the 9th of 10 steps from 30 to 2.1 s.
  EXPECT_THAT(told(9, 11),
              ::testing::HasSubstr("the part ends after 11: no layer gets the 2.1 s of "
                                   "normal ones, the last one gets 4.89 s"));
}

}  // namespace
}  // namespace slicecorr
