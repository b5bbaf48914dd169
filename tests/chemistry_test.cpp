// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Closed forms of the photochemistry, against figures that were worked out independently of this code (six digits, for
// the two model resins at 100 mW/cm² unless said), and the table [chemistry] of resin files.
#include "slicecorr/chemistry.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "chemistries.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {
namespace {

using test::diacrylate;
using test::hydrogel;
using ::testing::HasSubstr;

/// Figures that are known to six digits.
void expect_six(double value, double known) { EXPECT_NEAR(value / known, 1, 6e-6) << value; }

TEST(ChemistryForms, PhotonsAndDiffusivities) {
  EXPECT_NEAR(photon_energy_j_mol(365), 327744.0, 0.05);
  expect_six(stokes_einstein_um2_s(300, 0.012, 2.16), 84.7751);
  // 5 mm through resin of 12 mPa·s.
  expect_six(5000.0 * 5000.0 / stokes_einstein_um2_s(300, 0.012, 2.16) / 3600, 81.916);
  expect_six(*hydrogel().oxygen_um2_s, 277.253);
  expect_six(*hydrogel().initiator_um2_s, 149.717);
  expect_six(*hydrogel().radical_um2_s, 199.622);
  expect_six(*diacrylate().oxygen_um2_s, 10.1730);
  EXPECT_FALSE(hydrogel().inhibitor_um2_s);
}

TEST(ChemistryForms, RatesOfTheHydrogel) {
  const Chemistry& c = hydrogel();
  expect_six(initiation_per_s(c, 100), 8.14965e-4);
  expect_six(radicals_mol_l_s(c, 100), 2.18051e-4);
  expect_six(light_height_um(c), 8115.88);
  EXPECT_NEAR(absorbed_share(c, 170), 0.021, 5e-4);
  EXPECT_NEAR(mean_light_share(c, 170), 1 - 0.021 / 2, 2e-4);
  EXPECT_EQ(mean_light_share(c, 0), 1);
  expect_six(inhibition_time_s(c, 100), 1.192383);
  expect_six(inhibition_time_used_up_s(c, 100), 1.192962);
  EXPECT_NEAR(inhibited_radicals_mol_l(c, 100), 1.6773e-9, 5e-14);
  expect_six(steady_radicals_mol_l(c, 100), 9.30205e-6);
  expect_six(rise_time_s(c, 100), 0.0426600);
}

TEST(ChemistryForms, TimesToGel) {
  const GelTime h = gel_time_of(hydrogel()), p = gel_time_of(diacrylate());
  expect_six(h.A, 119.238);
  expect_six(h.B, 4.82633);
  expect_six(p.A, 687.913);
  const double i[] = {1, 10, 100, 1000}, t[] = {124.065, 13.4500, 1.67502, 0.271860},
               m[] = {0.98055, 0.94326, 0.85593, 0.71930};
  for (int k = 0; k < 4; ++k) {
    expect_six(gel_time_s(h, i[k]), t[k]);
    EXPECT_NEAR(local_exponent(h, i[k]), m[k], 6e-6);
    // The intensity for a time is the time's inverse, and the dose is intensity times time.
    EXPECT_NEAR(gel_intensity_mw_cm2(h, gel_time_s(h, i[k])) / i[k], 1, 1e-12);
    EXPECT_NEAR(gel_dose_mj_cm2(h, i[k]), i[k] * gel_time_s(h, i[k]), 1e-9);
    // The exponent is the slope of ln t over ln i.
    const double e = 1e-5;
    const double slope =
        std::log(gel_time_s(h, i[k] * (1 + e)) / gel_time_s(h, i[k] * (1 - e))) / (2 * e);
    EXPECT_NEAR(-slope, local_exponent(h, i[k]), 1e-8);
  }
  expect_six(gel_intensity_mw_cm2(h, 5), 29.0503);
  expect_six(light_height_um(hydrogel()) * std::log(100 / gel_intensity_mw_cm2(h, 5)), 10032.4);
}

TEST(ChemistryForms, ConversionAfterInhibitionEndsAtTheGelTime) {
  const Chemistry& c = hydrogel();
  const GelTime g = gel_time_of(c);
  for (const double i : {0.01, 1.0, 100.0, 1e5}) {
    EXPECT_NEAR(conversion_after_inhibition(c, i, gel_time_s(g, i) - inhibition_time_s(c, i)),
                c.gel_conversion, 1e-11);
  }
  EXPECT_EQ(conversion_after_inhibition(c, 100, 0), 0);
  EXPECT_NEAR(dark_conversion(c, 100, 1), 0.031212, 5e-7);
}

TEST(ChemistryForms, AResinWithoutOxygenHasNoA) {
  Chemistry c = hydrogel();
  c.oxygen_mol_l = 0;
  EXPECT_EQ(gel_time_of(c).A, 0);
  EXPECT_EQ(local_exponent(gel_time_of(c), 7), 0.5);
  // arcosh of a huge number, whose cosh overflows.
  c.termination_l_mol_s = 1e10;
  c.propagation_l_mol_s = 1;
  EXPECT_TRUE(std::isfinite(gel_time_of(c).B));
}

TEST(ChemistryForms, DeadZonesOfAPermeableWindow) {
  const Chemistry& c = hydrogel();
  expect_six(permeable_dead_zone_um(c, 10, c.oxygen_mol_l), 81.313);
  expect_six(permeable_dead_zone_um(c, 10, c.oxygen_mol_l, 100), 118.127);
  // Light that hardly falls is even light; and light that falls too fast never ends the dead zone.
  EXPECT_NEAR(permeable_dead_zone_um(c, 10, c.oxygen_mol_l, 1e7) /
                  permeable_dead_zone_um(c, 10, c.oxygen_mol_l),
              1, 1e-5);
  EXPECT_TRUE(std::isinf(permeable_dead_zone_um(c, 10, c.oxygen_mol_l, 50)));
  EXPECT_EQ(permeable_dead_zone_um(c, 10, 0), 0);
}

TEST(ChemistryForms, ThresholdOfOxygenFromOutside) {
  const Chemistry& c = hydrogel();
  const double ks = 0.05, least = threshold_intensity_mw_cm2(c, ks);
  EXPECT_NEAR(least, ks * c.oxygen_mol_l / radicals_mol_l_s(c, 1), 1e-12);
  EXPECT_TRUE(std::isinf(inhibition_time_supplied_s(c, least, ks)));
  EXPECT_TRUE(std::isfinite(inhibition_time_supplied_s(c, least * 1.0001, ks)));
  EXPECT_NEAR(inhibition_time_supplied_s(c, 100, 1e-9) / inhibition_time_s(c, 100), 1, 1e-8);
  EXPECT_EQ(inhibition_time_supplied_s(c, 100, 0), inhibition_time_s(c, 100));
}

TEST(ChemistryForms, OxygenAtTheCentreOfALoneFeature) {
  const Chemistry& c = hydrogel();
  const double half[] = {15, 25, 50};
  const struct {
    FeatureShape shape;
    double seconds[3];
  } rows[] = {{FeatureShape::line, {2.3358, 1.4902, 1.2095}},
              {FeatureShape::square, {17.3605, 2.1481, 1.2279}},
              {FeatureShape::disc, {47.330, 2.7770, 1.2537}}};
  for (const auto& row : rows) {
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(feature_inhibition_time_s(c, 100, row.shape, half[k]) / row.seconds[k], 1, 6e-5);
    }
  }
  EXPECT_NEAR(c.oxygen_mol_l - oxygen_used_mol_l(c, 100, FeatureShape::square, 25, 1.0),
              0.093422e-3, 1e-9);
  // A feature so wide that nothing comes from its side, and one that is brought enough for ever.
  EXPECT_NEAR(feature_inhibition_time_s(c, 100, FeatureShape::disc, 1e5), inhibition_time_s(c, 100),
              1e-9);
  EXPECT_TRUE(std::isinf(feature_inhibition_time_s(c, 1e-3, FeatureShape::disc, 1)));
}

TEST(ChemistryForms, AddedInhibitorAndInitiatorThatIsUsedUp) {
  Chemistry c = hydrogel();
  c.inhibitor_mol_l = 1e-3;
  c.inhibitor_l_mol_s = c.oxygen_l_mol_s;
  expect_six(inhibition_time_s(c, 100), 5.77847);
  EXPECT_NEAR(gel_time_s(gel_time_of(c), 100), 6.26110, 6e-5);
  Chemistry scarce = hydrogel();
  scarce.initiator_mol_l = 1e-4;
  EXPECT_TRUE(std::isinf(inhibition_time_used_up_s(scarce, 100)));
  EXPECT_EQ(least_initiator_mol_l(scarce), 0.13e-3);
  scarce.initiator_mol_l = 2e-4;
  expect_six(inhibition_time_used_up_s(scarce, 100), 1288.18);
  EXPECT_NEAR(inhibition_time_s(scarce, 100), 797.58, 0.005);
}

// --- the table of a resin file ---

std::string file_text(const char* name) {
  std::ifstream in(std::string(SLICECORR_DB_DIR "/") + name + ".toml");
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

/// The hydrogel's file with the line of a key exchanged, or gone where `value` is empty.
std::string with(const std::string& key, const std::string& value) {
  std::string text = file_text("model-hydrogel");
  const std::size_t table = text.find("[chemistry]");
  std::size_t at = text.find("\n" + key + " = ", table);
  if (at == std::string::npos && value.empty()) return text;
  if (at == std::string::npos) {
    at = text.find('\n', table);
    return text.insert(at, "\n" + key + " = " + value);
  }
  const std::size_t end = text.find('\n', at + 1);
  return text.replace(at, end - at, value.empty() ? "" : "\n" + key + " = " + value);
}

std::string refusal(const std::string& key, const std::string& value) {
  try {
    parse_resin(with(key, value), "r.toml");
  } catch (const InputError& e) {
    return e.what();
  }
  return "accepted";
}

TEST(ChemistryFile, BadFiguresAreRefusedWithLineAndKey) {
  for (const char* key :
       {"groups_mol_l", "initiator_mol_l", "absorptivity_l_mol_cm", "quantum_yield",
        "initiation_l_mol_s", "propagation_l_mol_s", "termination_l_mol_s", "gel_conversion",
        "temperature_k", "viscosity_pa_s", "oxygen_radius_angstrom", "wavelength_nm"}) {
    for (const char* bad : {"0", "-1", "nan", "inf", "\"much\"", "1e30"}) {
      const std::string text = refusal(key, bad);
      EXPECT_THAT(text, HasSubstr(std::string("chemistry.") + key)) << bad;
      EXPECT_THAT(text, HasSubstr("r.toml: line ")) << bad;
    }
  }
  for (const char* key :
       {"oxygen_mol_l", "inhibitor_mol_l", "other_absorption_per_cm", "oxygen_l_mol_s",
        "initiator_oxygen_l_mol_s", "inhibitor_l_mol_s", "inhibitor_diffusion_um2_s"}) {
    for (const char* bad : {"-1", "nan", "inf", "1e30"}) {
      EXPECT_THAT(refusal(key, bad), HasSubstr(std::string("chemistry.") + key)) << bad;
    }
  }
  EXPECT_THAT(refusal("gel_conversion", "1"), HasSubstr("between 0 and 1"));
  EXPECT_THAT(refusal("quantum_yield", "1.01"), HasSubstr("at most 1"));
  EXPECT_THAT(refusal("termination_counts", "\"both\""), HasSubstr("2 kt R²"));
  EXPECT_THAT(refusal("termination_counts", ""), HasSubstr("missing"));
  EXPECT_THAT(refusal("absorptivity_base", ""), HasSubstr("missing"));
  EXPECT_THAT(refusal("absorptivity_base", "2"), HasSubstr("expected 10 or"));
  EXPECT_THAT(refusal("oxygen_mol_l", ""), HasSubstr("0 where there is none"));
  EXPECT_THAT(refusal("oxygen_l_mol_s", ""), HasSubstr("mol/l of oxygen"));
  EXPECT_THAT(refusal("inhibitor_mol_l", "1e-3"), HasSubstr("mol/l of inhibitor"));
  EXPECT_THAT(refusal("oxygen_diffusion_um2_s", "300"), HasSubstr("expected one of them"));
  EXPECT_THAT(refusal("viscosity_pa_s", ""), HasSubstr("says nothing without viscosity_pa_s"));
}

TEST(ChemistryFile, WhatCountsIsConverted) {
  const auto of = [](const std::string& key, const std::string& value) {
    return *parse_resin(with(key, value), "r.toml").chemistry;
  };
  // The loss of radicals is 2 kt R² where kt counts pairs.
  EXPECT_EQ(of("termination_counts", "\"radicals\"").termination_l_mol_s, 0.63e6);
  EXPECT_EQ(of("termination_counts", "\"pairs\"").termination_l_mol_s, 1.26e6);
  EXPECT_EQ(of("absorptivity_base", "\"e\"").absorptivity_l_mol_cm, 4.0);
  EXPECT_NEAR(of("absorptivity_base", "10").absorptivity_l_mol_cm, 4 * std::log(10.0), 1e-12);
  EXPECT_EQ(of("other_absorption_per_cm", "1.5").other_absorption_per_cm, 1.5);
  EXPECT_EQ(of("temperature_k", "").temperature_k, 298.15);
  EXPECT_EQ(of("oxygen_radius_angstrom", "").oxygen_um2_s, hydrogel().oxygen_um2_s);
  EXPECT_EQ(of("wavelength_nm", "405").wavelength_nm, 405);
  EXPECT_EQ(of("wavelength_nm", "").wavelength_nm, 365);
  EXPECT_EQ(of("initiator_radius_angstrom", "").initiator_um2_s, std::nullopt);
}

TEST(ChemistryFile, AWordIsNoTable) {
  std::string text = file_text("model-hydrogel");
  text.erase(text.find("[chemistry]"), text.find("[provenance]") - text.find("[chemistry]"));
  EXPECT_FALSE(parse_resin("chemistry = \"acrylate\"\n" + text, "r.toml").chemistry);
  EXPECT_FALSE(parse_resin(text, "r.toml").chemistry);
  EXPECT_THAT(test::refusal([&] { parse_resin("chemistry = 7\n" + text, "r.toml"); }),
              HasSubstr("expected a table"));
}

}  // namespace
}  // namespace slicecorr
