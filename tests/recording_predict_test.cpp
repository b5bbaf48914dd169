// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Predictions from recordings: against stacks that are none, closed forms, and the dose of the
/// whole history by integration over time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

#include "models.hpp"
#include "recorded_slices.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using test::as_planned;
using test::Cure;
using test::MemorySlices;
using test::RecordedSlices;
using test::Stretch;
using testing::HasSubstr;
/// Tests have a Setup of their own.
using Settings = slicecorr::Setup;
using Showing = Recording::Showing;

constexpr Grid kGrid{12, 10, 60, 50, 50, 20};
constexpr double kSpeedMmH = 720, kSpeedUmS = 200;

Printer uv_printer(bool patterned = false) {
  Printer p = test::linear_printer(1, 100);
  p.uv = UvLamp{365, patterned, {{0, 0}, {255, 275}}};
  p.width_px = kGrid.width_px;
  p.height_px = kGrid.height_px;
  return p;
}

Resin kinetic_resin(double m) {
  Resin r;
  r.name = "kinetic";
  r.model = CureModelKind::kinetic;
  r.m = m;
  r.absorbance_height10_um = units::height10_from_e(408);
  r.critical_dose_prime = 64;
  r.inhibition = Inhibition{0.73, units::height10_from_e(37.8), m, 0};
  return r;
}

Cure cure_of(const Resin& r) {
  Cure c;
  c.hb_um = r.absorbance_height10_um / std::log(10.0);
  c.m = r.m;
  c.dose_prime =
      r.critical_dose_prime > 0 ? r.critical_dose_prime : r.critical_dose_mj_cm3 * c.hb_um * 1e-4;
  if (r.inhibition) {
    c.beta = r.inhibition->beta;
    c.huv_um = r.inhibition->absorbance_height10_um / std::log(10.0);
  }
  return c;
}

Process continuous() { return test::process(kSpeedMmH); }
Process layerwise() {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 0.4;
  p.bottom_exposure_s = 1.2;
  p.bottom_layers = 3;
  p.fade_layers = 4;
  return p;
}
Process under_uv(Process p, double uv_mw_cm2 = 180) {
  p.uv.kind = UvKind::constant;
  p.uv.uv_mw_cm2 = uv_mw_cm2;
  return p;
}

/// Runs and gaps of random grey in most columns; the outermost stay black.
MemorySlices random_slices(const Grid& grid, unsigned seed, bool coverage) {
  std::mt19937 random(seed);
  MemorySlices s(grid);
  for (int y = 1; y < grid.height_px - 1; ++y) {
    for (int x = 1; x < grid.width_px - 1; ++x) {
      for (int n = static_cast<int>(random() % 6); n < grid.layers;) {
        const int run = 2 + static_cast<int>(random() % 14);
        const auto value = static_cast<std::uint8_t>(coverage ? (random() % 9 == 0 ? 100 : 255)
                                                              : 1 + random() % 255);
        for (int k = n; k < std::min(grid.layers, n + run); ++k) s.at(k, x, y) = value;
        n += run + 1 + static_cast<int>(random() % 8);
      }
    }
  }
  return s;
}

// ---- the plan, as it was ---------------------------------------------------------------------

struct Case {
  const char* name;
  Settings setup;
  double uv_mw_cm2 = 0;
};

std::vector<Case> cases() {
  const Printer plain = [] {
    Printer p = uv_printer();
    p.uv.reset();
    return p;
  }();
  const Printer uneven = [&] {
    Printer p = uv_printer();
    FlatField f;
    f.width_px = 2;
    f.height_px = 1;
    f.values =
        std::make_shared<const std::vector<std::uint8_t>>(std::vector<std::uint8_t>{200, 255});
    p.flat_field = f;
    return p;
  }();
  Process per_slice = under_uv(continuous());
  per_slice.uv.kind = UvKind::per_slice;
  per_slice.uv.uv_mw_cm2 = 0;
  per_slice.uv.slice_mw_cm2 = {180};
  Process patterned = continuous();
  patterned.uv.kind = UvKind::patterned;
  patterned.uv.dead_zone_um = 20;
  return {
      {"continuous", {plain, test::resin(576, 2000), continuous()}},
      {"exponent", {plain, kinetic_resin(1.3), continuous()}},
      {"layerwise", {plain, test::resin(40, 110), layerwise()}},
      {"uneven", {uneven, test::resin(576, 2000), continuous()}},
      {"uv", {uv_printer(), kinetic_resin(0.99), under_uv(continuous())}, 180},
      {"uv_uneven", {uneven, kinetic_resin(0.99), under_uv(continuous())}, 180},
      {"uv_per_slice", {uv_printer(), kinetic_resin(1.29), per_slice}, 180},
      {"uv_layerwise", {uv_printer(), kinetic_resin(1), under_uv(layerwise())}, 180},
      {"uv_patterned", {uv_printer(true), kinetic_resin(0.99), patterned}, 275},
  };
}

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class AsPlanned : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Recording, AsPlanned, testing::ValuesIn(cases()),
                         [](const auto& info) { return info.param.name; });

TEST_P(AsPlanned, PredictsWhatTheStackDoes) {
  const Settings& setup = GetParam().setup;
  const MemorySlices target = random_slices(kGrid, 5, true), stack = random_slices(kGrid, 6, false);
  const RecordedSlices recorded(stack, as_planned(kGrid.layers, GetParam().uv_mw_cm2));
  const Prediction expected = verify_stack(stack, target, setup);
  ASSERT_GT(expected.printed_voxels, 200u);
  ASSERT_GT(expected.height_error_um.count(), 50u);
  // When voxels gel is not known of recordings.
  const auto but_moments = [](const Prediction& p) {
    auto json = nlohmann::ordered_json::parse(p.to_json());
    for (const char* key : {"islands", "islands_in_all", "in_time", "time_step_um", "verdict"}) {
      json.erase(key);
    }
    return json.dump(1);
  };
  EXPECT_EQ(but_moments(verify_stack(recorded, target, setup)), but_moments(expected));
  for (const auto& [x, y] : {std::pair{3, 4}, {10, 8}, {0, 0}}) {
    const auto rows = probe_stack(recorded, &target, setup, x, y);
    const auto as_stack = probe_stack(stack, &target, setup, x, y);
    ASSERT_EQ(rows.size(), as_stack.size());
    for (std::size_t n = 0; n < rows.size(); ++n) {
      EXPECT_EQ(rows[n].grey, as_stack[n].grey);
      EXPECT_EQ(rows[n].dose, as_stack[n].dose);
      EXPECT_EQ(rows[n].dose_middle, as_stack[n].dose_middle);
      EXPECT_EQ(rows[n].dose_lower, as_stack[n].dose_lower);
      EXPECT_EQ(rows[n].intensity_mw_cm2, as_stack[n].intensity_mw_cm2);
      EXPECT_NEAR(rows[n].phi, as_stack[n].phi, 1e-12 * as_stack[n].phi);
      EXPECT_EQ(rows[n].z_um, as_stack[n].z_um);
      EXPECT_EQ(rows[n].target, as_stack[n].target);
    }
  }
  const Section section = section_of(recorded, target, setup, 5);
  const Section as_stack = section_of(stack, target, setup, 5);
  EXPECT_EQ(section.dose, as_stack.dose);
  EXPECT_EQ(section.pixels, as_stack.pixels);
}

TEST_P(AsPlanned, PartsOfOneImageAreOne) {
  // Cut up in ten, with pauses of darkness and other images that got no light between them.
  const Settings& setup = GetParam().setup;
  const MemorySlices target = random_slices(kGrid, 7, true), stack = random_slices(kGrid, 8, false);
  Recording cut;
  for (int n = 0; n < kGrid.layers; ++n) {
    std::vector<Showing> showings;
    for (int k = 0; k < 10; ++k) {
      showings.push_back({n, 0.1, GetParam().uv_mw_cm2, 0, 0, 0, 1});
      showings.push_back({(n + 7) % kGrid.layers, 0, GetParam().uv_mw_cm2, 0, 0, 0, 0});
      showings.push_back({-1, 0, 0, 0, 0, 0, 0});
    }
    cut.add_slice(showings);
  }
  const Section section = section_of(RecordedSlices(stack, cut), target, setup, 4);
  const Section as_stack = section_of(stack, target, setup, 4);
  for (std::size_t i = 0; i < section.dose.size(); ++i) {
    // Ten times a tenth is not quite 1, and doses are kept as floats.
    ASSERT_NEAR(section.dose[i], as_stack.dose[i], 2e-7 * as_stack.dose[i]);
  }
}

TEST_P(AsPlanned, DoesNotDependOnThreads) {
  // Higher than a band.
  Grid grid = kGrid;
  grid.height_px = 4 * band_rows(kGrid) - 3;
  Settings setup = GetParam().setup;
  setup.printer.height_px = grid.height_px;
  const MemorySlices target = random_slices(grid, 9, true);
  Recording late;
  for (int n = 0; n < grid.layers; ++n) {
    const double uv = GetParam().uv_mw_cm2;
    const double z = n * grid.layer_um;
    const std::vector<Showing> showings{{n - 1, 0.25, uv, z, z + 6, 0, 1},
                                        {n, 0.73, uv * 1.1, z + 6, z + 20, 0, 1}};
    late.add_slice(showings);
  }
  const RecordedSlices recorded(random_slices(grid, 10, false), late);
  ExecutionContext one, three;
  one.threads = 1;
  three.threads = 3;
  const std::string figures = verify_stack(recorded, target, setup, one).to_json();
  EXPECT_EQ(verify_stack(recorded, target, setup, three).to_json(), figures);
  // Late light is other light.
  EXPECT_NE(verify_stack(recorded.images(), target, setup, one).to_json(), figures);
}

// ---- closed forms ----------------------------------------------------------------------------

/// A column of figure 2.2: 50 um slices, phi 0.0625 to 6.25.
const Grid kColumn{1, 1, 40, 50, 50, 50};
Settings figure_2_2() {
  Settings s{test::linear_printer(1, 100), test::resin(576, 2000), test::process(1000)};
  s.printer.width_px = s.printer.height_px = 1;
  return s;
}
const double kA = std::pow(10.0, -0.025);

MemorySlices column_of(const std::vector<std::uint8_t>& values) {
  Grid grid = kColumn;
  grid.layers = static_cast<int>(values.size());
  MemorySlices s(grid);
  for (std::size_t n = 0; n < values.size(); ++n) s.at(static_cast<int>(n), 0, 0) = values[n];
  return s;
}

std::vector<double> node_doses_of(const SliceSource& s, const Settings& setup) {
  std::vector<double> doses;
  for (const ProbeRow& row : probe_stack(s, nullptr, setup, 0, 0)) doses.push_back(row.dose);
  return doses;
}

TEST(RecordedColumn, ImagesShareASlice) {
  // Black for 0.3 of the last slice, full light for 0.7; nothing after it.
  Recording r;
  const std::vector<Showing> showings{{0, 0.3, 0, 0, 0, 0, 1}, {1, 0.7, 0, 0, 0, 0, 1}};
  r.add_slice({});
  r.add_slice(showings);
  const RecordedSlices s(column_of({0, 255}), r);
  const auto rows = probe_stack(s, nullptr, figure_2_2(), 0, 0);
  const double phi = 0.3 * 0.0625 + 0.7 * 6.25;
  EXPECT_NEAR(rows[1].phi, phi, 1e-12);
  EXPECT_NEAR(rows[1].dose, phi * (1 - kA), 1e-12);
  EXPECT_NEAR(rows[0].dose, phi * (1 - kA) * kA, 1e-12);
  EXPECT_EQ(rows[1].grey, 255);
  EXPECT_EQ(rows[0].grey, 0);
  EXPECT_EQ(rows[0].phi, 0);
  EXPECT_EQ(rows[0].intensity_mw_cm2, 0);
  EXPECT_NEAR(rows[1].intensity_mw_cm2, 0.3 * 1 + 0.7 * 100, 1e-9);
}

TEST(RecordedColumn, BlackIsTheLightOfBlackAndDarknessIsNone) {
  Recording r;
  for (int n = 0; n < 400; ++n) {
    const Showing black{-1, 1, 0, 0, 0, 0, 1}, dark{0, 0, 0, 0, 0, 0, 0};
    r.add_slice({n < 200 ? &black : &dark, 1});
  }
  const auto doses = node_doses_of(RecordedSlices(column_of({255}), r), figure_2_2());
  EXPECT_NEAR(doses[0], 0.0625, 1e-6);
  EXPECT_EQ(doses[200], 0);
  EXPECT_NEAR(doses[199], 0.0625 * (1 - kA), 1e-12);
}

TEST(RecordedColumn, HalfTheLampIsHalfTheDose) {
  std::vector<std::uint8_t> values;
  for (int n = 0; n < 40; ++n) values.push_back(static_cast<std::uint8_t>(n * 37));
  Recording half = as_planned(40);
  for (Showing& p : half.showings) {
    p.light = 0.5;
    p.blue_share = 0.5;
  }
  const auto whole = node_doses_of(column_of(values), figure_2_2());
  const auto doses = node_doses_of(RecordedSlices(column_of(values), half), figure_2_2());
  for (std::size_t n = 0; n < 40; ++n) EXPECT_DOUBLE_EQ(doses[n], 0.5 * whole[n]);
}

TEST(RecordedColumn, AnImageThatStaysOnCountsInEverySlice) {
  // An underrun: image 0 for twenty slices.
  Recording r;
  for (int n = 0; n < 20; ++n) {
    const Showing p{0, 1, 0, 0, 0, 0, 1};
    r.add_slice({&p, 1});
  }
  const auto doses = node_doses_of(RecordedSlices(column_of({255}), r), figure_2_2());
  const auto as_stack = node_doses_of(column_of(std::vector<std::uint8_t>(20, 255)), figure_2_2());
  EXPECT_EQ(doses, as_stack);
}

TEST(RecordedColumn, LateFramesMoveAnEdgeByTheirLateness) {
  // Full light down to node 30, then black without light; each frame comes a share q late.
  const double q = 0.4, phi = 6.25;
  Settings setup = figure_2_2();
  setup.printer.calibration = {{0, 0}, {255, 100}};
  std::vector<std::uint8_t> values(40, 0);
  std::fill_n(values.begin(), 30, std::uint8_t{255});
  const MemorySlices stack = column_of(values), target = column_of(values);
  Recording late;
  for (int n = 0; n < 40; ++n) {
    const std::vector<Showing> showings{{n == 0 ? 0 : n - 1, q, 0, 0, 0, 0, 1},
                                        {n, 1 - q, 0, 0, 0, 0, 1}};
    late.add_slice(showings);
  }
  Recording placed = late;
  for (std::size_t k = 0; k < placed.showings.size(); ++k) {
    const double z = 50.0 * static_cast<double>(k / 2);
    Showing& p = placed.showings[k];
    p.from_um = k % 2 ? z + 50 * q : z;
    p.to_um = k % 2 ? z + 50 : z + 50 * q;
  }
  const auto shortfall = [&](const SliceSource& shown) {
    return verify_stack(shown, target, setup).greatest_shortfall_um;
  };
  const double before = shortfall(stack), after = shortfall(RecordedSlices(stack, late));
  EXPECT_NEAR(before, -50 * std::log10((phi - 1) / phi) / 0.025, 1e-9);
  // Where the showings have places it is just that.
  EXPECT_NEAR(before - shortfall(RecordedSlices(stack, placed)), 50 * q, 1e-9);
  // Spread over the slice: Omega(zeta) = phi + (Omega(30) - phi) a^(30 - zeta), with Omega(30) = q
  // phi (1 - a): 1 at a^(30 - zeta) = (phi - 1) / (phi - Omega(30)).
  EXPECT_NEAR(before - after, -50 * std::log10(1 - q * (1 - kA)) / 0.025, 1e-9);
  // The dose at node 30 is off by up to half eta ln10 (1 - a) D, D = 2 q (1 - q) phi, which moves
  // an edge by that over the slope eta ln10 (phi - 1) per slice.
  const double bound = 50 * 0.5 * (1 - kA) * 2 * q * (1 - q) * phi / (phi - 1);
  EXPECT_NEAR(before - after, 50 * q, bound);
  EXPECT_LT(bound, 0.9);
  EXPECT_GT(std::abs(before - after - 50 * q), 0.01 * bound);
}

TEST(RecordedColumn, AnEdgeInsideASliceIsWhereItsPartEnds) {
  // Full light for the first 0.3 of the last slice, on top of black for the rest of it: the dose
  // climbs from the end of the light on.
  const double phi = 6.25;
  Settings setup = figure_2_2();
  setup.printer.calibration = {{0, 0}, {255, 100}};
  std::vector<std::uint8_t> values(10, 255);
  const MemorySlices stack = column_of(values), target = column_of(values);
  Recording r;
  for (int n = 0; n < 10; ++n) {
    const double z = 50.0 * n;
    const Showing showing{n, n == 9 ? 0.3 : 1.0, 0, z, n == 9 ? z + 15 : z + 50, 0, 1};
    r.add_slice({&showing, 1});
  }
  const double whole = verify_stack(stack, target, setup).greatest_shortfall_um;
  const Prediction p = verify_stack(RecordedSlices(stack, r), target, setup);
  EXPECT_NEAR(whole, -50 * std::log10((phi - 1) / phi) / 0.025, 1e-9);
  EXPECT_NEAR(p.greatest_shortfall_um, whole + 35, 1e-9);
}

TEST(RecordedColumn, MoreSlicesThanPlannedAndFewerAreAsTheyAre) {
  const MemorySlices target = column_of(std::vector<std::uint8_t>(10, 255));
  const Prediction none =
      verify_stack(RecordedSlices(column_of({255}), Recording{}), target, figure_2_2());
  EXPECT_EQ(none.layers, 0);
  EXPECT_EQ(none.printed_voxels, 0u);
  EXPECT_EQ(none.undercure_voxels, 10u);
  const Prediction all =
      verify_stack(RecordedSlices(column_of(std::vector<std::uint8_t>(25, 255)), as_planned(25)),
                   target, figure_2_2());
  EXPECT_EQ(all.layers, 25);
  EXPECT_GT(all.cure_through_voxels, 8u);
}

// ---- against the history ---------------------------------------------------------------------

/// What was shown within a slice: from `begin` to `end` of it, shares of its height.
struct Shown {
  int image = 0;
  double begin = 0, end = 0, share = 1, speed_um_s = 0, uv_mw_cm2 = 0;
};
using History = std::vector<std::vector<Shown>>;

/// Images come late, the lamp and the stage waver, and there are stretches of darkness.
History random_history(unsigned seed, int slices, bool uv) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(0, 1);
  // Few settings, so that each has a table of its own.
  const double shares[] = {0.5, 0.8, 1.0}, uvs[] = {120, 180};
  History history;
  for (int n = 0; n < slices; ++n) {
    std::vector<Shown> showings;
    for (double at = any(random) < 0.2 ? 0.3 * any(random) : 0; at < 1;) {
      const double end = std::min(1.0, at + 0.1 + any(random));
      const int image = std::max(0, n - static_cast<int>(random() % 3));
      showings.push_back({image, at, end, shares[random() % 3],
                          kSpeedUmS * (0.7 + 0.8 * any(random)), uv ? uvs[random() % 2] : 0});
      at = end + (any(random) < 0.2 ? 0.2 * any(random) : 0);
    }
    history.push_back(showings);
  }
  return history;
}

/// The same with the showings of each slice taking turns in it `turns` times.
History spread(const History& history, int turns) {
  History out;
  for (const auto& showings : history) {
    std::vector<Shown> shown;
    for (int k = 0; k < turns; ++k) {
      for (Shown p : showings) {
        p.begin = (k + p.begin) / turns;
        p.end = (k + p.end) / turns;
        shown.push_back(p);
      }
    }
    out.push_back(shown);
  }
  return out;
}

/// `placed`: says where showings lie in their slices; else their light counts as spread over them.
Recording recording_of(const History& history, double m, bool placed) {
  Recording r;
  for (std::size_t n = 0; n < history.size(); ++n) {
    std::vector<Showing> showings;
    for (const Shown& s : history[n]) {
      // Time over that of the plan.
      const double time = (s.end - s.begin) * kSpeedUmS / s.speed_um_s;
      const double z = kGrid.layer_um * static_cast<double>(n);
      Showing showing{s.image, std::pow(s.share, m) * time, s.uv_mw_cm2, 0, 0, s.speed_um_s,
                      s.share};
      if (placed) {
        showing.from_um = z + s.begin * kGrid.layer_um;
        showing.to_um = z + s.end * kGrid.layer_um;
      }
      showings.push_back(showing);
    }
    r.add_slice(showings);
  }
  return r;
}

std::vector<Stretch> stretches(const History& history, const MemorySlices& images, int x, int y,
                               const Printer& printer) {
  const double least = printer.calibration.front().intensity_mw_cm2;
  const double most = printer.calibration.back().intensity_mw_cm2;
  std::vector<Stretch> list;
  for (std::size_t n = 0; n < history.size(); ++n) {
    for (const Shown& s : history[n]) {
      const double z = kGrid.layer_um * static_cast<double>(n);
      const double from = z + s.begin * kGrid.layer_um, to = z + s.end * kGrid.layer_um;
      const double blue = least + (most - least) * images.at(s.image, x, y) / 255.0;
      list.push_back({from, to, (to - from) / s.speed_um_s, s.share * blue, s.uv_mw_cm2});
    }
  }
  return list;
}

/// D of docs/recording.md: integral over the slice of |light density - its mean|, in phi.
double unevenness(const std::vector<Shown>& showings, const std::vector<double>& phi) {
  double sum = 0, dark = 1, uneven = 0;
  for (std::size_t k = 0; k < showings.size(); ++k) {
    sum += phi[k];
    dark -= showings[k].end - showings[k].begin;
  }
  for (std::size_t k = 0; k < showings.size(); ++k) {
    uneven += std::abs(phi[k] - (showings[k].end - showings[k].begin) * sum);
  }
  return uneven + std::max(0.0, dark) * sum;
}

TEST(RecordedHistory, ContinuousDosesAreThoseOfTheIntegral) {
  double worst_share = 0;
  for (const double m : {1.0, 1.3}) {
    Printer printer = uv_printer();
    printer.uv.reset();
    Resin resin = kinetic_resin(m);
    if (m == 1) resin = test::resin(576, 2000);
    const Settings setup{printer, resin, continuous()};
    const Cure cure = cure_of(resin);
    const MemorySlices images = random_slices(kGrid, 21, false);
    for (const int turns : {1, 16}) {
      // By day each m and each number of turns once.
      if (!test::by_night() && (m == 1) == (turns == 1)) continue;
      const int steps = std::max(25, 400 / turns);
      const History history = random_history(31, kGrid.layers, false);
      const History shown = spread(history, turns);
      const RecordedSlices recorded(images, recording_of(shown, m, false));
      const RecordedSlices placed(images, recording_of(shown, m, true));
      const double slope = m * kGrid.layer_um / cure.hb_um;  // eta ln10
      const double a = std::exp(-slope);
      for (const auto& [x, y] : {std::pair{2, 3}, {5, 5}, {9, 2}}) {
        const auto rows = probe_stack(recorded, nullptr, setup, x, y);
        const auto exact = probe_stack(placed, nullptr, setup, x, y);
        const auto list = stretches(shown, images, x, y, printer);
        double bound = 0;  // at the node below
        for (int n = kGrid.layers; n-- > 0;) {
          std::vector<double> phi;
          for (const Shown& s : history[static_cast<std::size_t>(n)]) {
            // phi = I^m hb / (m s D'c) at the plan's speed.
            const double blue = 1 + 99.0 * images.at(s.image, x, y) / 255.0;
            phi.push_back((s.end - s.begin) / s.speed_um_s * kSpeedUmS *
                          std::pow(s.share * blue, m) * cure.hb_um / (m * kSpeedUmS) /
                          cure.dose_prime);
          }
          const double d = unevenness(history[static_cast<std::size_t>(n)], phi);
          const double inside = 0.5 * slope * d + std::sqrt(a) * bound;
          const ProbeRow& row = rows[static_cast<std::size_t>(n)];
          const double z = n * kGrid.layer_um;
          // Spread over the slice the bound shrinks to that of a thinner slice.
          bound = 0.5 * slope * d * (1 - std::pow(a, 1.0 / turns)) + a * bound;
          const double at_node = dose_by_time(list, cure, z, steps);
          // The midpoint rule is off by (d step)^2 / 24 of the dose, at most 1e-9.
          ASSERT_NEAR(row.dose, at_node, bound + 1e-8 * at_node) << n << " " << turns;
          const double in_middle = dose_by_time(list, cure, z + 0.5 * kGrid.layer_um, steps);
          ASSERT_NEAR(row.dose_middle, in_middle, inside + 1e-8 * in_middle) << n;
          // Where its showings have places nothing is off, unless they are too many.
          if (turns == 1) {
            const ProbeRow& known = exact[static_cast<std::size_t>(n)];
            ASSERT_NEAR(known.dose, at_node, 1e-8 * at_node) << n;
            ASSERT_NEAR(known.dose_middle, in_middle, 1e-8 * in_middle) << n;
          }
          if (turns == 1 && bound > 1e-6) {
            worst_share = std::max(worst_share, std::abs(row.dose - at_node) / bound);
          }
        }
      }
    }
  }
  // The bound is no wishful number: it is nearly met.
  EXPECT_GT(worst_share, 0.2);
}

TEST(RecordedHistory, UnderUvDosesAreThoseOfTheIntegralWithinTheBound) {
  for (const double m : {1.0, 1.29}) {
    const Resin resin = kinetic_resin(m);
    const Printer printer = uv_printer();
    const Settings setup{printer, resin, under_uv(continuous())};
    const Cure cure = cure_of(resin);
    const MemorySlices images = random_slices(kGrid, 22, false);
    for (const int turns : {1, 32}) {
      const int steps = std::max(25, 400 / turns);
      const History history = random_history(32, kGrid.layers, true);
      const History shown = spread(history, turns);
      const RecordedSlices recorded(images, recording_of(shown, m, true));
      for (const auto& [x, y] : {std::pair{2, 3}, {7, 6}}) {
        const auto rows = probe_stack(recorded, nullptr, setup, x, y);
        const auto list = stretches(shown, images, x, y, printer);
        for (int n = 0; n < kGrid.layers; n += 3) {
          // What a showing adds lies between the least and the greatest rate over its slice, or
          // over the showing of the slice in which it takes its turn, for the same time.
          double bound = 0;
          for (int k = n; k < kGrid.layers; ++k) {
            for (const Shown& s : history[static_cast<std::size_t>(k)]) {
              const double blue = s.share * (1 + 99.0 * images.at(s.image, x, y) / 255.0);
              const double time = (s.end - s.begin) * kGrid.layer_um / s.speed_um_s / turns;
              for (int t = 0; t < turns; ++t) {
                double low = 1e300, high = 0;
                for (int i = 0; i <= 20; ++i) {
                  const double d = (k - n + (t + i / 20.0) / turns) * kGrid.layer_um;
                  const double net = blue * std::exp(-d / cure.hb_um) -
                                     cure.beta * s.uv_mw_cm2 * std::exp(-d / cure.huv_um);
                  const double rate = net > 0 ? std::pow(net, m) : 0;
                  low = std::min(low, rate);
                  high = std::max(high, rate);
                }
                bound += time * (high - low) / cure.dose_prime;
              }
            }
          }
          const double expected = dose_by_time(list, cure, n * kGrid.layer_um, steps);
          // Beyond the tables' reach UV light is left out: a share of 1e-6.
          ASSERT_NEAR(rows[static_cast<std::size_t>(n)].dose, expected, bound + 2e-6 * expected)
              << n << " " << turns << " m " << m;
          if (turns > 1 && n < 30 && expected > 0.5) {
            ASSERT_LT(bound, 0.05 * expected);
          }
        }
      }
    }
  }
}

TEST(RecordedHistory, LayerByLayerDosesAreExact) {
  for (const bool uv : {false, true}) {
    const Resin resin = uv ? kinetic_resin(1.2) : test::resin(40, 110);
    Printer printer = uv_printer();
    if (!uv) printer.uv.reset();
    Process process = layerwise();
    if (uv) process = under_uv(process);
    const Settings setup{printer, resin, process};
    const Cure cure = cure_of(resin);
    const MemorySlices images = random_slices(kGrid, 23, false);
    const History history = random_history(33, kGrid.layers, uv);
    Recording recording;
    std::vector<std::vector<Stretch>> columns(2);
    for (int n = 0; n < kGrid.layers; ++n) {
      std::vector<Showing> showings;
      const double window = (n + 1) * kGrid.layer_um, plan = planned_light_s(process, 20, n, 1);
      EXPECT_EQ(plan, layer_exposure_s(process, n));
      for (const Shown& s : history[static_cast<std::size_t>(n)]) {
        const double time_s = plan * (s.end - s.begin);
        showings.push_back({s.image, std::pow(s.share, resin.m) * time_s / plan, s.uv_mw_cm2,
                            window, window, 0, s.share});
        for (int k = 0; k < 2; ++k) {
          const double blue = s.share * (1 + 99.0 * images.at(s.image, 3 + 4 * k, 4) / 255.0);
          columns[static_cast<std::size_t>(k)].push_back(
              {window, window, time_s, blue, s.uv_mw_cm2});
        }
      }
      recording.add_slice(showings);
    }
    const RecordedSlices recorded(images, recording);
    for (int k = 0; k < 2; ++k) {
      const auto rows = probe_stack(recorded, nullptr, setup, 3 + 4 * k, 4);
      for (int n = 0; n < kGrid.layers; ++n) {
        const ProbeRow& row = rows[static_cast<std::size_t>(n)];
        const double z = n * kGrid.layer_um;
        const auto& list = columns[static_cast<std::size_t>(k)];
        // Inside the layer, the exposure whose window stands at its far edge does not count: 1e-9
        // um, or 2e-11 of an absorbance height of 48 um.
        const double share = uv ? 2e-6 : 3e-11;
        const double upper = test::dose_by_time(list, cure, z + 1e-9, 1);
        EXPECT_NEAR(row.dose, upper, share * upper);
        const double middle = test::dose_by_time(list, cure, z + 10, 1);
        EXPECT_NEAR(row.dose_middle, middle, share * middle);
      }
    }
  }
}

// ---- UV light --------------------------------------------------------------------------------

TEST(RecordedUv, ManyIntensitiesShareTablesAndItIsTold) {
  const Settings setup{uv_printer(), kinetic_resin(0.99), under_uv(continuous())};
  const MemorySlices images = random_slices(kGrid, 41, false);
  const MemorySlices target = random_slices(kGrid, 42, true);
  const Recording even = as_planned(kGrid.layers, 180);
  Recording wavering = even;
  std::mt19937 random(1);
  for (Showing& p : wavering.showings) p.uv_mw_cm2 *= 1 + 0.02 * (random() / 4294967295.0 - 0.5);
  std::vector<std::string> told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told.push_back(text); };
  verify_stack(RecordedSlices(images, wavering), target, setup, context);
  ASSERT_FALSE(told.empty());
  EXPECT_THAT(told[0], HasSubstr("measured UV light is taken as one of"));
  told.clear();
  verify_stack(RecordedSlices(images, even), target, setup, context);
  for (const std::string& text : told)
    EXPECT_THAT(text, testing::Not(HasSubstr("taken as one of")));
  // The values lie within 2 %, so groups of 32 are at most 0.16 % wide: half of that off.
  const auto a = probe_stack(RecordedSlices(images, wavering), nullptr, setup, 4, 4);
  Recording lower = even, higher = even;
  for (Showing& p : lower.showings) p.uv_mw_cm2 = 180 * 0.99;
  for (Showing& p : higher.showings) p.uv_mw_cm2 = 180 * 1.01;
  const auto most = probe_stack(RecordedSlices(images, lower), nullptr, setup, 4, 4);
  const auto least = probe_stack(RecordedSlices(images, higher), nullptr, setup, 4, 4);
  for (std::size_t n = 0; n < a.size(); ++n) {
    EXPECT_LE(a[n].dose, most[n].dose * (1 + 1e-9));
    EXPECT_GE(a[n].dose, least[n].dose * (1 - 1e-9));
  }
}

TEST(RecordedUv, ALampThatFailedOrWasNeverAskedForCounts) {
  const Resin resin = kinetic_resin(1);
  const MemorySlices images = random_slices(kGrid, 51, false);
  const MemorySlices target = random_slices(kGrid, 52, true);
  const Settings with{uv_printer(), resin, under_uv(continuous())};
  const Settings without{uv_printer(), resin, continuous()};
  const RecordedSlices dark(images, as_planned(kGrid.layers, 0));
  const RecordedSlices lit(images, as_planned(kGrid.layers, 180));
  // m = 1 in both, so that blue light alone is the same.
  const auto failed = probe_stack(dark, nullptr, with, 4, 4);
  const auto never = probe_stack(dark, nullptr, without, 4, 4);
  const auto stray = probe_stack(lit, nullptr, without, 4, 4);
  const auto asked = probe_stack(lit, nullptr, with, 4, 4);
  for (std::size_t n = 0; n < failed.size(); ++n) {
    EXPECT_NEAR(failed[n].dose, never[n].dose, 1e-9);
    EXPECT_DOUBLE_EQ(stray[n].dose, asked[n].dose);
  }
  EXPECT_LT(asked[20].dose, 0.99 * failed[20].dose);
  const Prediction p = verify_stack(dark, target, with);
  ASSERT_TRUE(p.dead_zones);
  EXPECT_GT(p.dead_zones->cured_pixels, 0u);
}

TEST(RecordedUv, HalfTheBlueLightUnderTheSameUvHasTheDeadZoneOfTwiceTheRatio) {
  const Settings setup{uv_printer(), kinetic_resin(1), under_uv(continuous())};
  MemorySlices images(kGrid);
  for (int n = 0; n < kGrid.layers; ++n) images.at(n, 5, 5) = 255;
  Recording half = as_planned(kGrid.layers, 180);
  for (Showing& p : half.showings) p.light = p.blue_share = 0.5;
  const Prediction p = verify_stack(RecordedSlices(images, half), images, setup);
  const Cure c = cure_of(setup.resin);
  const double zone = std::log(c.beta * 180 / (0.5 * 100)) / (1 / c.huv_um - 1 / c.hb_um);
  ASSERT_TRUE(p.dead_zones);
  EXPECT_NEAR(p.dead_zones->least(), zone, 1e-9);
}

// ---- refusals --------------------------------------------------------------------------------

std::string refusal(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "nothing was thrown";
}

TEST(RecordedRefusals, WhatCantBeDoneIsSaid) {
  const Settings setup{uv_printer(), kinetic_resin(1), under_uv(continuous())};
  const MemorySlices target = random_slices(kGrid, 61, true);
  const RecordedSlices recorded(target, as_planned(kGrid.layers, 180));
  EXPECT_THAT(refusal([&] { correct_stack(recorded, setup, "a.uvj", {}, {}); }),
              HasSubstr("recording"));
  EXPECT_THAT(refusal([&] { verify_stack(target, recorded, setup); }), HasSubstr("recording"));
  EXPECT_THAT(refusal([&] { simulate_column(recorded, nullptr, setup, 3, 3, {}); }),
              HasSubstr("recording"));
  EXPECT_THAT(refusal([&] { reduce_volume(recorded, target, setup, 10); }), HasSubstr("recording"));
  const PlaceModels models(setup.printer, setup.resin, setup.process, kGrid, {});
  EXPECT_THAT(refusal([&] { solid_mesh(recorded, models); }), HasSubstr("recording"));
  Recording other = as_planned(kGrid.layers, 180);
  other.other_uv_images = {3};
  EXPECT_THAT(refusal([&] { verify_stack(RecordedSlices(target, other), target, setup); }),
              HasSubstr("UV images"));
  Recording many;
  std::vector<Showing> showings;
  for (int k = 0; k < 400; ++k) showings.push_back({k, 0.01, 180, 0, 0, 0, 1});
  many.add_slice(showings);
  Grid grid = kGrid;
  grid.layers = 400;
  EXPECT_THAT(
      refusal([&] { verify_stack(RecordedSlices(MemorySlices(grid), many), target, setup); }),
      HasSubstr("slice 0 of the recording shows 400 images; expected at most 256"));
}

TEST(RecordedSolid, IsTheSurfaceOfTheStack) {
  for (const bool layers : {false, true}) {
    Printer printer = uv_printer();
    printer.uv.reset();
    const Settings setup{printer, layers ? test::resin(40, 110) : test::resin(576, 2000),
                         layers ? layerwise() : continuous()};
    const MemorySlices stack = random_slices(kGrid, 71, false);
    const PlaceModels models(setup.printer, setup.resin, setup.process, kGrid, {});
    const TriangleMesh as_stack = solid_mesh(stack, models);
    const TriangleMesh recorded =
        solid_mesh(RecordedSlices(stack, as_planned(kGrid.layers)), models);
    ASSERT_GT(as_stack.triangles.size(), 1000u);
    EXPECT_EQ(recorded.triangles, as_stack.triangles);
    EXPECT_EQ(recorded.vertices, as_stack.vertices);
  }
}

}  // namespace
}  // namespace slicecorr
