// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The table of what goes with what, against models: each pair of the light's features that it refuses
// is refused in its words, every other pair makes a model.
#include "slicecorr/supports.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <set>
#include <string>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using ::testing::HasSubstr;

struct Lit {
  Printer printer;
  Resin resin;
  Process process;
};

Lit plain() {
  Lit p;
  p.printer.name = "p-1";
  p.printer.width_px = p.printer.height_px = 8;
  p.printer.pixel_x_um = p.printer.pixel_y_um = 50;
  p.printer.calibration = {{0, 1}, {255, 100}};
  p.printer.uv = UvLamp{365, true, {{0, 0}, {255, 275}}};
  p.resin.name = "r-1";
  p.resin.model = CureModelKind::kinetic;
  p.resin.m = 0.99;
  p.resin.critical_dose_prime = 64;
  p.resin.absorbance_height10_um = units::height10_from_e(408);
  p.resin.inhibition = Inhibition{0.73, units::height10_from_e(37.8), 0.99, 0};
  p.process.speed_mm_h = 500;
  p.process.surface = Surface::slices;
  return p;
}

/// Gives a print the feature; false: it is not one of light.
bool give(Lit& p, Feature feature) {
  switch (feature) {
    case Feature::layerwise:
      p.process.mode = ExposureMode::layerwise;
      p.process.exposure_s = 5;
      return true;
    case Feature::uv_constant:
      p.process.uv.kind = UvKind::constant;
      p.process.uv.uv_mw_cm2 = 50;
      return true;
    case Feature::uv_per_slice:
      p.process.uv = {UvKind::per_slice, 0, 15, {}};
      return true;
    case Feature::uv_patterned:
      p.process.uv = {UvKind::patterned, 0, 15, {}};
      return true;
    case Feature::gel_time:
      p.resin.model = CureModelKind::gel_time;
      p.resin.gel_a_mj_cm2 = 60;
      p.resin.gel_b_sqrt_mw_cm2_s = 4;
      return true;
    case Feature::bleaching:
      p.resin.bleaching = Bleaching{2 * p.resin.absorbance_height10_um, 30};
      return true;
    case Feature::spread:
      p.printer.spread.gaussians = {{60.0, 1.0}};
      return true;
    case Feature::uneven_light: {
      FlatField field;
      field.width_px = field.height_px = 8;
      auto values = std::vector<std::uint8_t>(64, 255);
      values[9] = 155;
      field.values = std::make_shared<const std::vector<std::uint8_t>>(values);
      p.printer.flat_field = field;
      return true;
    }
    case Feature::vat_depth:
      p.printer.resin_depth_um = 500;
      return true;
    case Feature::reflectance:
      p.printer.platform_reflectance = 0.3;
      return true;
    case Feature::lamps_stay:
      p.process.slice_speed_mm_h = {500, 250};
      p.process.slice_lamps = SliceLamps::stay;
      return true;
    case Feature::pulsed_grey:
      p.printer.grey = GreyLight::pulsed;
      return true;
    case Feature::moved_heights:
      p.process.layer_heights_um = {50, 100};
      return true;
    default:
      return false;
  }
}

bool one_way_to_expose(Feature a, Feature b) {
  const std::set<Feature> uv{Feature::uv_constant, Feature::uv_per_slice, Feature::uv_patterned};
  const auto both = [&](Feature x, Feature y) { return (a == x && b == y) || (a == y && b == x); };
  return (uv.contains(a) && uv.contains(b)) || both(Feature::layerwise, Feature::lamps_stay) ||
         both(Feature::layerwise, Feature::moved_heights);
}

std::string refusal(const Lit& p) {
  try {
    Grid grid;
    grid.width_px = grid.height_px = 8;
    grid.pixel_x_um = grid.pixel_y_um = 50;
    grid.layer_um = 50;
    grid.layers = 10;
    const PlaceModels models(p.printer, p.resin, p.process, grid, {});
    static_cast<void>(models.brightest());
    return {};
  } catch (const InputError& e) {
    return e.what();
  }
}

std::string with_names(std::string words) {
  for (const auto& [mark, name] :
       {std::pair<std::string, std::string>{"{printer}", "p-1"}, {"{resin}", "r-1"}}) {
    if (const auto at = words.find(mark); at != words.npos) words.replace(at, mark.size(), name);
  }
  return words;
}

TEST(Supports, EachPairOfLightIsCountedOrRefusedByName) {
  int refused = 0, counted = 0;
  for (int i = 0; i < kFeatures; ++i) {
    for (int j = i + 1; j < kFeatures; ++j) {
      const auto a = static_cast<Feature>(i), b = static_cast<Feature>(j);
      Lit p = plain();
      if (one_way_to_expose(a, b) || !give(p, a) || !give(p, b)) continue;
      const std::vector<Feature> has = features_of(p.printer, p.resin, p.process);
      EXPECT_THAT(has, ::testing::UnorderedElementsAre(a, b));
      const Unsupported* const pair = find_unsupported(has, Verdict::refused);
      EXPECT_EQ(refusal(p), pair ? with_names(pair->words) : "")
          << name_of(a) << ", " << name_of(b);
      ++(pair ? refused : counted);
    }
  }
  EXPECT_GE(refused, 10);
  EXPECT_GE(counted, 15);
}

TEST(Supports, TheTableSaysEachPairOnce) {
  std::set<std::pair<Feature, Feature>> seen;
  for (const Unsupported& pair : unsupported()) {
    EXPECT_NE(pair.a, pair.b) << name_of(pair.a);
    EXPECT_TRUE(seen.insert(std::minmax(pair.a, pair.b)).second)
        << name_of(pair.a) << ", " << name_of(pair.b);
    if (pair.verdict == Verdict::refused) {
      EXPECT_TRUE(std::string(pair.words).find("expected") != std::string::npos ||
                  pair.a == Feature::even_dead_zone)
          << pair.words << ": says no way out";
    }
  }
}

/// Why the resin's law is not counted in a use; "" where it is.
std::string refused_in(const Resin& resin, LawUse use) {
  try {
    refuse_law(resin, use);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

// Doses that are sums are refused nowhere; each other law where the table has a row for it, with all marks taken
// for names.
TEST(Supports, EachLawIsRefusedInTheWordsOfItsRow) {
  const Resin sums = plain().resin;
  Resin gels = sums, bleaches = sums;
  gels.model = CureModelKind::gel_time;
  gels.gel_a_mj_cm2 = 20;
  gels.gel_b_sqrt_mw_cm2_s = 3;
  bleaches.bleaching = Bleaching{2 * sums.absorbance_height10_um, 30};
  EXPECT_TRUE(sums.adds_up());
  EXPECT_FALSE(gels.adds_up() || bleaches.adds_up());
  std::set<std::pair<LawUse, Feature>> rows;
  for (const UncountedLaw& row : uncounted_laws()) {
    EXPECT_TRUE(rows.emplace(row.use, row.law).second) << name_of(row.use);
  }
  std::set<std::string> names;
  for (int u = 0; u <= static_cast<int>(LawUse::skins); ++u) {
    const auto use = static_cast<LawUse>(u);
    EXPECT_TRUE(names.insert(name_of(use)).second) << name_of(use);
    EXPECT_EQ(refused_in(sums, use), "") << name_of(use);
    for (const auto& [law, resin] :
         {std::pair{Feature::gel_time, gels}, {Feature::bleaching, bleaches}}) {
      const std::string said = refused_in(resin, use);
      EXPECT_EQ(!said.empty(), rows.contains({use, law})) << name_of(use);
      EXPECT_TRUE(said.empty() || said.find("expected") != std::string::npos) << said;
      EXPECT_EQ(said.find_first_of("{}"), std::string::npos) << said;
    }
  }
  EXPECT_EQ(refused_in(bleaches, LawUse::flow),
            "r-1: bleaching: is not counted in flowing resin; expected a resin without it");
  EXPECT_EQ(
      refused_in(gels, LawUse::part_times),
      "r-1: cure.model: is \"gel-time\", by which the times of test parts are not reckoned; expected one of "
      "another model (resinctl derive makes one of it)");
}

// Light that a bath of so many slices and a part of one takes up is that of no whole number.
TEST(Supports, ABathEndsBetweenSlices) {
  for (const double depth_um : {1000.0, 1050.0, 1100.0}) {
    Lit p = plain();
    p.printer.resin_depth_um = depth_um;
    EXPECT_EQ(refusal(p), "") << depth_um;
  }
  Lit p = plain();
  p.printer.resin_depth_um = 1090;
  EXPECT_THAT(refusal(p), HasSubstr("1090 um deep, which is 21.8 slices of 50 um; expected a whole "
                                    "number of slices: a depth of 1050 or 1100 um"));
  // So deep that nothing of it counts.
  p.printer.resin_depth_um = 20'010;
  EXPECT_EQ(refusal(p), "");
}

}  // namespace
}  // namespace slicecorr
