// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Which light a resin was measured with, against that of the printer.
#include "slicecorr/same_light.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "refusal.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/load_printer.hpp"

namespace slicecorr {
namespace {

using test::refusal;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Printer printer_of(double nm, double uv_nm = 0) {
  Printer p;
  p.name = "lamp";
  p.wavelength_nm = nm;
  p.calibration = {{0, 0.25}, {255, 30}};
  p.uv = UvLamp{uv_nm, false, {{0, 0}, {255, 100}}};
  return p;
}

Resin resin_of(double nm, double uv_nm = 0) {
  Resin r;
  r.name = "goo";
  r.wavelength_nm = nm;
  r.inhibition = Inhibition{0.7, 20, 1, 0, uv_nm};
  return r;
}

bool refuses(const Printer& printer, const Resin& resin, bool uv, bool take) {
  try {
    check_same_light(printer, resin, uv, take, "--take");
  } catch (const InputError&) {
    return true;
  }
  return false;
}

TEST(SameLight, TenNanometresAndNoMore) {
  std::mt19937 random(3);
  // Eighths of a nanometre, which numbers hold without rounding.
  std::uniform_int_distribution<int> eighths(2400, 4000), near_ones(-90, 90);
  for (int i = 0; i < 2000; ++i) {
    const int a = eighths(random), b = i % 2 == 0 ? a + near_ones(random) : eighths(random);
    const bool same = a - b <= 80 && b - a <= 80;
    const Printer printer = printer_of(a * 0.125);
    const Resin resin = resin_of(b * 0.125);
    EXPECT_EQ(same_light(a * 0.125, b * 0.125), same) << a << " " << b;
    EXPECT_EQ(other_wavelength(printer, resin).has_value(), !same);
    EXPECT_EQ(refuses(printer, resin, false, false), !same);
    EXPECT_EQ(other_wavelength_in_words(printer, resin, false).empty(), same);
    EXPECT_EQ(light_notices(printer, resin, false).empty(), same);
    // Taken, whatever it is.
    EXPECT_FALSE(refuses(printer, resin, false, true));
  }
}

TEST(SameLight, NamesBothAndHowToTakeIt) {
  EXPECT_THAT(
      refusal([] { check_same_light(printer_of(405), resin_of(365), false, false, "--take"); }),
      AllOf(HasSubstr("resin 'goo'"), HasSubstr("365 nm"), HasSubstr("printer 'lamp'"),
            HasSubstr("405 nm"), HasSubstr("within 10 nm"), HasSubstr("or --take")));
  const auto other = other_wavelength(printer_of(405), resin_of(365));
  ASSERT_TRUE(other);
  EXPECT_EQ(*other, (OtherWavelength{405, 365}));
}

TEST(SameLight, UvLightCountsWhereItIsOn) {
  const Printer printer = printer_of(460, 365);
  const Resin resin = resin_of(460, 385);
  EXPECT_NO_THROW(check_same_light(printer, resin, false, false, "x"));
  EXPECT_THAT(refusal([&] { check_same_light(printer, resin, true, false, "x"); }),
              AllOf(HasSubstr("inhibition of resin 'goo'"), HasSubstr("385 nm"),
                    HasSubstr("UV light of printer 'lamp' has 365 nm")));
  EXPECT_NO_THROW(check_same_light(printer, resin, true, true, "x"));
  EXPECT_EQ(light_notices(printer, resin, true).size(), 1U);
  EXPECT_THAT(light_notices(printer, resin, false), IsEmpty());
  // A lamp that no resin answers to, and a resin that no lamp inhibits.
  Resin plain = resin;
  plain.inhibition.reset();
  EXPECT_FALSE(other_uv_wavelength(printer, plain));
  Printer blue = printer;
  blue.uv.reset();
  EXPECT_FALSE(other_uv_wavelength(blue, resin));
}

TEST(SameLight, WhatIsNotKnownIsToldAndNotRefused) {
  EXPECT_NO_THROW(check_same_light(printer_of(0), resin_of(365), true, false, "x"));
  EXPECT_NO_THROW(check_same_light(printer_of(405), resin_of(0), true, false, "x"));
  const auto without_printer = light_notices(printer_of(0), resin_of(365), false);
  ASSERT_EQ(without_printer.size(), 1U);
  EXPECT_THAT(without_printer[0],
              AllOf(HasSubstr("resin 'goo' was measured at 365 nm"), HasSubstr("printer 'lamp'")));
  const auto without_resin = light_notices(printer_of(405), resin_of(0), false);
  ASSERT_EQ(without_resin.size(), 1U);
  EXPECT_THAT(without_resin[0],
              AllOf(HasSubstr("printer 'lamp' has 405 nm"), HasSubstr("resin 'goo'")));
  // Where neither is known there is nothing to tell.
  EXPECT_THAT(light_notices(printer_of(0), resin_of(0), true), IsEmpty());
}

TEST(SameLight, ATunedResinGoesWithItsPrinterAlone) {
  const Printer printer = printer_of(405);
  EXPECT_EQ(printer_and_light(printer), "lamp, 0.25 to 30 mW/cm2");
  const std::string text =
      "name = \"tuned\"\n[cure]\nabsorbance_height_um = 100\nabsorbance_base = 10\n"
      "gel_dose_mj_cm3 = 100\n[provenance]\n";
  const auto noted = [&](const std::string& note) {
    return parse_resin(text + "tuning = \"" + note + "\"\n", "tuned.toml");
  };
  const Resin tuned = noted(printer_and_light(printer) +
                            ": ha, light, stray_mw_cm2: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]");
  EXPECT_EQ(tuned.tuned_with, printer_and_light(printer));
  EXPECT_NO_THROW(check_same_light(printer, tuned, false, false, "x"));
  Printer brighter = printer, renamed = printer, stray = printer;
  brighter.calibration.back().intensity_mw_cm2 = 31;
  stray.calibration.front().intensity_mw_cm2 = 0.26;
  renamed.name = "other";
  for (const Printer* other : {&brighter, &renamed, &stray}) {
    // No other wavelength: that is not the matter.
    for (const bool take : {false, true}) {
      EXPECT_THAT(refusal([&] { check_same_light(*other, tuned, false, take, "x"); }),
                  AllOf(HasSubstr("resin 'tuned' was tuned with the printer 'lamp, 0.25 to 30"),
                        HasSubstr(printer_and_light(*other))));
    }
  }
  // The middle of the curve is no matter of the note.
  Printer finer = printer;
  finer.calibration.insert(finer.calibration.begin() + 1, {100, 10});
  EXPECT_NO_THROW(check_same_light(finer, tuned, false, false, "x"));
  // A note of somebody's own says nothing of a printer, and a resin without one goes with any.
  EXPECT_EQ(noted("by hand").tuned_with, "");
  EXPECT_EQ(parse_resin(text, "tuned.toml").tuned_with, "");
}

TEST(SameLight, DeliveredPairsOfOneLightGoTogether) {
  // What is delivered as a pair, and what the examples print with.
  const std::pair<const char*, const char*> pairs[] = {
      {"dual-wavelength-dlp", "benchy-resin"},
      {"dual-wavelength-dlp", "egg-resin"},
      {"dual-wavelength-dlp", "custom-resin-1"},
      {"dual-wavelength-dlp", "custom-resin-2"},
      {"dual-wavelength-dlp", "dissertation-resin1-5gel"},
      {"dual-wavelength-dlp", "figure-2-2"},
      {"dual-wavelength-dlp-gamma3", "benchy-resin"},
      {"uhd-dlp", "custom-resin-1"},
      {"prusa-sl1s", "liqcreate-strong-x-405nm"},
      {"generic-lcd-gamma3", "liqcreate-strong-x-405nm"},
      {"ember", "autodesk-pr48-405nm"},
      {"ember", "formlabs-clear-405nm"},
      {"model-beam-vat", "model-beam-resin"},
      {"model-tomography-bench", "model-tomography-resin"},
      {"kelly-projector-and-vial", "kelly-bpagda-pegda"},
      {"webber-vial", "webber-dudma-pegda"},
  };
  const std::string resins = SLICECORR_DB_DIR "/", printers = SLICECORR_PRINTERS_DIR "/";
  for (const auto& [printer, resin] : pairs) {
    const Printer p = load_printer(printers + printer + ".toml");
    const Resin r = load_resin(resins + resin + ".toml");
    EXPECT_NO_THROW(check_same_light(p, r, true, false, "x")) << printer << " " << resin;
  }
  // Resins of other wavelengths are refused by each of the printers that say theirs.
  int refused = 0;
  for (const Definition& d : list_definitions("printer")) {
    const Printer p = load_display(d.path);
    for (const char* resin : {"autodesk-pr48-365nm", "liqcreate-strong-x-385nm"}) {
      const Resin r = load_resin(resins + resin + ".toml");
      const bool known = p.wavelength_nm > 0;
      EXPECT_EQ(refuses(p, r, false, false), known) << d.name;
      refused += known;
    }
  }
  EXPECT_GE(refused, 2 * 10);
}

}  // namespace
}  // namespace slicecorr
