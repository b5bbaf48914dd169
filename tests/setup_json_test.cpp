// A setup as text: what stacks record, without a stack.

#include <gtest/gtest.h>

#include <string>

#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr {
namespace {

Setup resolved(SetupChoices choices) {
  choices.printer = std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml";
  choices.resin = std::string(SLICECORR_DB_DIR) + "/da-2-ppo.toml";
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
  expect_same_again(resolved(c));
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

}  // namespace
}  // namespace slicecorr
