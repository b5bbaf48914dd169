// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that makes the dead zone even: its values by place and slice, what it means for the dose, and
// the correction that gives it to features.

#include "slicecorr/even_light.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "correct/even_column.hpp"
#include "cure/front_profile.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/grid.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/setup.hpp"
#include "uv_models.hpp"

namespace slicecorr {
namespace {

using testing::Each;
using testing::HasSubstr;

using Bytes = std::vector<std::uint8_t>;
std::shared_ptr<const Bytes> shared(Bytes bytes) {
  return std::make_shared<const Bytes>(std::move(bytes));
}

/// 3 x 2 cells of 1 mm from (0.5, 1) mm on, slices 10 and 20.
EvenLight small_light() {
  EvenLight light;
  light.columns = 3;
  light.rows = 2;
  light.pitch_um = 1000;
  light.left_um = 500;
  light.top_um = 1000;
  light.gap_um = 80;
  light.slices = {10, 20};
  // 10 + 20 x + 40 y, then 100 more.
  light.blue = shared({10, 30, 50, 50, 70, 90, 110, 130, 150, 150, 170, 190});
  light.uv = light.blue;
  return light;
}

constexpr Grid kImages{100, 100, 40, 100, 100, 50};

TEST(EvenLight, IsLinearBetweenCellsAndSlicesAndFlatOutside) {
  const EvenLight light = small_light();
  check_even_light(light, "test");
  const EvenPixels pixels(light, kImages);
  const auto wanted = [](int x, int y, int n) {
    // Middles of cells lie at 1, 2, 3 mm and 1.5, 2.5 mm.
    const double u = std::clamp((x + 0.5) / 10 - 1, 0.0, 2.0);
    const double v = std::clamp((y + 0.5) / 10 - 1.5, 0.0, 1.0);
    return 10 + 20 * u + 40 * v + 100 * std::clamp((n - 10) / 10.0, 0.0, 1.0);
  };
  Bytes blue(40);
  std::vector<double> uv(100);
  for (int y = 0; y < 100; y += 3) {
    for (int x = 0; x < 100; x += 3) {
      pixels.blue_of(x, y, blue);
      for (int n = 0; n < 40; ++n) {
        EXPECT_EQ(blue[static_cast<std::size_t>(n)], std::lround(wanted(x, y, n) + 1e-9));
      }
    }
    for (const int n : {0, 13, 39}) {
      pixels.uv_of_row(n, 0, y, uv);
      for (int x = 0; x < 100; ++x) {
        EXPECT_NEAR(uv[static_cast<std::size_t>(x)], wanted(x, y, n), 1e-9);
      }
    }
  }
}

TEST(EvenLight, ExtendsOutwardsFromWhatIsKnown) {
  // A line of known cells: beside it cells have its mean over what they touch, then theirs.
  std::vector<double> values(7 * 5, -1);
  Bytes known(values.size(), 0);
  for (const int x : {2, 3, 4}) {
    values[static_cast<std::size_t>(2 * 7 + x)] = x;
    known[static_cast<std::size_t>(2 * 7 + x)] = 1;
  }
  extend_outwards(values, known, 7, 5);
  const auto at = [&](int x, int y) { return values[static_cast<std::size_t>(y * 7 + x)]; };
  EXPECT_EQ(at(3, 2), 3);
  EXPECT_EQ(at(3, 1), 3);    // of 2, 3, 4
  EXPECT_EQ(at(2, 1), 2.5);  // of 2, 3
  EXPECT_EQ(at(1, 2), 2);    // of 2
  EXPECT_EQ(at(0, 2), (2.0 + 2.0 + 2.0) / 3);
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 7; ++x) {
      EXPECT_GE(at(x, y), 2);
      EXPECT_LE(at(x, y), 4);
      EXPECT_DOUBLE_EQ(at(x, y), 6 - at(6 - x, y));
      EXPECT_DOUBLE_EQ(at(x, y), at(x, 4 - y));
    }
  }
  std::vector<double> none(6, 7);
  extend_outwards(none, Bytes(6, 0), 3, 2);
  EXPECT_THAT(none, Each(7.0));
}

TEST(EvenLight, ASlowLampGivesNoLessAndChangesNoFaster) {
  EXPECT_EQ(slowed({0, 0, 10, 0, 0}, std::vector{0, 1, 2, 3, 5}, 4),
            (std::vector<double>{2, 6, 10, 6, 0}));
  std::mt19937 random(7);
  std::uniform_real_distribution<double> light(0, 100);
  for (int round = 0; round < 50; ++round) {
    std::vector<double> values(30);
    std::vector<int> slices;
    int n = 0;
    for (double& v : values) {
      v = light(random);
      slices.push_back(n += 1 + static_cast<int>(random() % 9));
    }
    const std::vector<double> slow = slowed(values, slices, 3);
    for (std::size_t i = 0; i < values.size(); ++i) {
      EXPECT_GE(slow[i], values[i]);
      if (i == 0) continue;
      EXPECT_LE(std::abs(slow[i] - slow[i - 1]), 3 * (slices[i] - slices[i - 1]) + 1e-9);
    }
    EXPECT_EQ(*std::max_element(slow.begin(), slow.end()),
              *std::max_element(values.begin(), values.end()));
    EXPECT_EQ(slowed(slow, slices, 3.0000001), slow);
  }
}

TEST(EvenLight, WhatDoesNotFitIsRefusedByKey) {
  const auto refused = [](const char* key, const auto& spoil) {
    EvenLight light = small_light();
    spoil(light);
    try {
      check_even_light(light, "stack.uvj");
      FAIL() << key;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("stack.uvj"));
      EXPECT_THAT(e.what(), HasSubstr(std::string("even_light.") + key));
    }
  };
  refused("columns", [](EvenLight& l) { l.columns = 0; });
  refused("rows", [](EvenLight& l) { l.rows = EvenLight::kMostCells + 1; });
  refused("pitch_um", [](EvenLight& l) { l.pitch_um = 0; });
  refused("pitch_um", [](EvenLight& l) { l.pitch_um = NAN; });
  refused("gap_um", [](EvenLight& l) { l.gap_um = -1; });
  refused("left_um", [](EvenLight& l) { l.left_um = INFINITY; });
  refused("slices", [](EvenLight& l) { l.slices = {20, 10}; });
  refused("slices", [](EvenLight& l) { l.slices = {-1, 10}; });
  refused("slices", [](EvenLight& l) { l.slices.clear(); });
  refused("blue", [](EvenLight& l) { l.blue.reset(); });
  refused("blue", [](EvenLight& l) { l.blue = shared(Bytes(11, 1)); });
  refused("blue", [](EvenLight& l) { l.blue = shared(Bytes(12, 0)); });
  refused("uv", [](EvenLight& l) { l.uv = shared(Bytes(13, 1)); });
}

// ------------------------------------------------------------------------------ dose and levels

/// Up to 400 mW/cm² in 256 levels, UV light as a flood of 275.
Printer bright_printer() { return test::uv::uv_printer(0, 400); }

/// Uniform shares of the curing light.
Process even_process(std::uint8_t least, std::uint8_t greatest, double gap_um) {
  Process p = test::process(300);
  p.uv.kind = UvKind::per_slice;
  p.uv.slice_mw_cm2 = {250};
  p.even_dead_zone = EvenDeadZone::blue;
  EvenLight light;
  light.columns = 2;
  light.rows = 1;
  light.pitch_um = 1000;
  light.gap_um = gap_um;
  light.slices = {0};
  light.blue = shared({least, greatest});
  p.even_light = light;
  return p;
}

CureModel even_model(const Process& process) {
  return make_cure_model(bright_printer(), test::uv::resin_1(1.0), process, 50);
}

TEST(EvenDose, EvenLightGelsJustAtTheGap) {
  const CureModel model = even_model(even_process(90, 140, 80));
  const InhibitedKernel& kernel = *model.inhibited();
  EXPECT_EQ(kernel.gap_um(), 80);
  for (const int level : {90, 100, 120, 140}) {
    // What light gives up to the gap, and beyond it as ever (m = 1, per um that the window moves).
    const double amount = kernel.source(0, level).amount;
    EXPECT_NEAR(amount * (kernel.rest(0, level, 0) - kernel.rest(0, level, 80)), 1, 1e-9) << level;
    const double blue = 400.0 * level / 255, speed_um_s = 300 / 3.6, dc = 64;
    const double beyond =
        (blue * 408 * std::exp(-80.0 / 408) - 0.73 * 250 * 37.8 * std::exp(-80.0 / 37.8)) /
        (speed_um_s * dc);
    EXPECT_NEAR(amount * kernel.rest(0, level, 80), beyond, 1e-6 * beyond) << level;
    EXPECT_NEAR(kernel.steady_dose(0, level), 1 + beyond, 1e-5 * (1 + beyond)) << level;
  }
  // Dimmer light than any even light counts as the dimmest does; brighter as the brightest.
  EXPECT_EQ(kernel.flow_factor(0, 30), kernel.flow_factor(0, 90));
  EXPECT_EQ(kernel.flow_factor(0, 255), kernel.flow_factor(0, 140));
  EXPECT_GT(kernel.flow_factor(0, 90), kernel.flow_factor(0, 140));
  // Tables and the integral itself are the same.
  for (const int j : {0, 1, 2, 5}) {
    const double table = kernel.table(0, InhibitedKernel::middle)[j * kernel.levels() + 120];
    EXPECT_NEAR(kernel.exact(0, 120, j + 0.5), table, 1e-12);
  }
}

TEST(EvenDose, WithoutEvenLightNothingCounts) {
  Process p = even_process(90, 140, 80);
  p.even_light.reset();
  p.even_dead_zone = EvenDeadZone::off;
  const CureModel model = even_model(p);
  const InhibitedKernel& kernel = *model.inhibited();
  EXPECT_EQ(kernel.gap_um(), 0);
  EXPECT_EQ(kernel.flow_factor(0, 100), 1);
}

TEST(EvenDose, LayerByLayerIsRefused) {
  Process p = even_process(90, 140, 80);
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 1;
  EXPECT_THROW(even_model(p), InputError);
}

/// Levels of columns of one design, each with its own even light; first slice first.
std::vector<Bytes> corrected(const CorrectionPlan& plan, const Bytes& coverage,
                             const std::vector<Bytes>& most) {
  BandCorrector corrector(plan, most.size());
  Bytes row(most.size());
  for (int n = 0; n < plan.layers; ++n) {
    std::fill(row.begin(), row.end(), coverage[static_cast<std::size_t>(n)]);
    corrector.add_layer(row.data());
  }
  corrector.keep_light([&](std::size_t column, std::uint8_t* levels) {
    std::copy(most[column].begin(), most[column].end(), levels);
  });
  std::vector<Bytes> levels(most.size(), Bytes(static_cast<std::size_t>(plan.all_layers)));
  corrector.solve([&](int n, const std::uint8_t* row_levels, const std::uint8_t*, bool) {
    for (std::size_t i = 0; i < most.size(); ++i) {
      levels[i][static_cast<std::size_t>(n)] = row_levels[i];
    }
  });
  return levels;
}

// Even light was planned by the design, gap and all, whatever was asked.
TEST(EvenCorrection, AGapThatIsMergedIsNone) {
  for (const bool even : {true, false}) {
    Process process = even_process(90, 140, 80);
    if (!even) {
      process.even_light.reset();
      process.even_dead_zone = EvenDeadZone::off;
    }
    const CureModel model = even_model(process);
    constexpr int layers = 60;
    Bytes full(layers, 255), slit = full;
    slit[30] = 0;
    const int all = slices_with_burst(model, layers, layers - 1);
    Process merge = process;
    merge.one_slice_gaps = OneSliceGaps::merge;
    const CorrectionPlan open(model, process, layers, all), merging(model, merge, layers, all);
    const std::vector<Bytes> most(
        1, Bytes(static_cast<std::size_t>(all), static_cast<std::uint8_t>(even ? 120 : 255)));
    EXPECT_EQ(corrected(merging, slit, most), corrected(open, full, most)) << even;
    EXPECT_NE(corrected(open, slit, most), corrected(open, full, most)) << even;
  }
}

TEST(EvenCorrection, FeaturesGetEvenLightInsideAndKeepTheirEdges) {
  const Process process = even_process(90, 140, 80);
  const CureModel model = even_model(process);
  // On the platform up to 40, a gap of 40 slices, then up to 140.
  constexpr int layers = 140;
  Bytes coverage(layers, 255);
  std::fill(coverage.begin() + 40, coverage.begin() + 80, std::uint8_t{0});
  const int all = slices_with_burst(model, layers, layers - 1);
  const CorrectionPlan plan(model, process, layers, all);
  // Two columns that stay, and one whose light changes with the slice.
  std::vector<Bytes> most(3, Bytes(static_cast<std::size_t>(all), 90));
  std::fill(most[1].begin(), most[1].end(), std::uint8_t{140});
  for (std::size_t n = 0; n < most[2].size(); ++n) {
    most[2][n] = static_cast<std::uint8_t>(std::min<std::size_t>(90 + n / 3, 140));
  }
  const std::vector<Bytes> levels = corrected(plan, coverage, most);
  for (std::size_t c = 0; c < most.size(); ++c) {
    BandDose dose(model, 1);
    double edge_above = 0, edge_below = 0, least_inside = 10, most_in_gap = 0;
    int even = 0;
    for (int n = all; n-- > 0;) {
      const auto i = static_cast<std::size_t>(n);
      EXPECT_LE(levels[c][i], most[c][i]) << c << ", " << n;
      if (n < 40) {
        EXPECT_EQ(levels[c][i], most[c][i]) << c << ", " << n;
      }
      if (n >= 80 && n < layers) even += static_cast<int>(levels[c][i] == most[c][i]);
      const auto pixel = static_cast<std::uint8_t>(pixel_of_level(levels[c][i], 256));
      dose.add_slice(n, &pixel);
      if (n == 80) edge_above = *dose.upper();
      if (n == layers) edge_below = *dose.upper();
      if (n >= layers) continue;
      if (coverage[i]) least_inside = std::min(least_inside, *dose.middle());
      if (!coverage[i]) most_in_gap = std::max(most_in_gap, *dose.middle());
    }
    // A level of some 100 is 1 % of the dose, and the last of some slices is rounded up.
    EXPECT_NEAR(edge_above, 1, 0.02) << c;
    EXPECT_NEAR(edge_below, 1, 0.02) << c;
    EXPECT_GE(least_inside, 1) << c;
    EXPECT_LT(most_in_gap, 1) << c;
    // Dark towards the gap until light from below brings the edge just its dose: the steady dose
    // falls to 1 over hb ln(steady dose), and the slices before that are all even.
    const double dark = 408 / 50.0 * std::log(model.inhibited()->steady_dose(0, most[c].back()));
    EXPECT_NEAR(60 - even, dark, 2.5) << c;
  }
}

TEST(EvenCorrection, GreyLayersOfSlopesTakeNoEvenLightAway) {
  const Process process = even_process(90, 140, 80);
  const CureModel model = even_model(process);
  constexpr int layers = 120;
  const int all = slices_with_burst(model, layers, layers - 1);
  const CorrectionPlan plan(model, process, layers, all);
  const std::vector<Bytes> most(1, Bytes(static_cast<std::size_t>(all), 117));
  // A feature between edges at nodes, and one whose edges lie in grey layers.
  Bytes sharp(layers, 0), slope(layers, 0);
  std::fill(sharp.begin() + 30, sharp.begin() + 100, std::uint8_t{255});
  slope = sharp;
  slope[29] = 200;
  slope[28] = 60;
  slope[100] = 190;
  const auto even = [&](const Bytes& coverage) {
    const Bytes levels = corrected(plan, coverage, most).front();
    return std::count(levels.begin(), levels.begin() + 100, 117);
  };
  EXPECT_GT(even(sharp), 40);
  // Edges a slice or two further out: even light begins as much earlier.
  EXPECT_NEAR(static_cast<double>(even(slope)), static_cast<double>(even(sharp)), 3);
}

TEST(EvenCorrection, IsKnownBeforehand) {
  // What EvenColumn says of columns without a solve is what the solve makes of them, but for the few
  // slices at edges in which it weighs one voxel against another.
  const Process process = even_process(90, 140, 80);
  const CureModel model = even_model(process);
  constexpr int layers = 160;
  const int all = slices_with_burst(model, layers, layers - 1);
  const CorrectionPlan plan(model, process, layers, all);
  detail::EvenColumn column(*plan.inhibited);
  std::mt19937 random(28);
  const auto draw = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  for (int round = 0; round < 40; ++round) {
    std::vector<detail::CoverageRun> runs;
    Bytes coverage(layers, 0);
    // Features thicker than what stays dark before them, 20 slices, gaps as wide.
    for (int at = draw(0, 1) * draw(5, 30); at < layers;) {
      const int end = std::min(layers, at + draw(30, 90));
      runs.push_back({at, end, 255});
      std::fill(coverage.begin() + at, coverage.begin() + end, std::uint8_t{255});
      at = end + draw(25, 60);
    }
    Bytes most(static_cast<std::size_t>(all));
    const int first = draw(90, 140), last = draw(90, 140);
    for (int n = 0; n < all; ++n) {
      most[static_cast<std::size_t>(n)] =
          static_cast<std::uint8_t>(first + (last - first) * n / all);
    }
    const Bytes& known = column.levels(runs, most);
    const Bytes solved = corrected(plan, coverage, {most}).front();
    int differ = 0;
    for (int n = 0; n < layers; ++n) {
      const auto i = static_cast<std::size_t>(n);
      differ += static_cast<int>(std::abs(known[i] - solved[i]) > 2);
    }
    EXPECT_LE(differ, 4 * static_cast<int>(runs.size())) << round;
  }
}

TEST(EvenCorrection, ColumnsDoNotDependOnTheirNeighbours) {
  const Process process = even_process(90, 140, 80);
  const CureModel model = even_model(process);
  const Bytes coverage(60, 255);
  const int all = slices_with_burst(model, 60, 59);
  const CorrectionPlan plan(model, process, 60, all);
  std::vector<Bytes> most;
  for (const int level : {90, 101, 117, 117, 140}) {
    most.emplace_back(static_cast<std::size_t>(all), static_cast<std::uint8_t>(level));
  }
  const std::vector<Bytes> together = corrected(plan, coverage, most);
  for (std::size_t i = 0; i < most.size(); ++i) {
    EXPECT_EQ(corrected(plan, coverage, {most[i]}).front(), together[i]);
  }
}

// ------------------------------------------------------------------------------------- setups

Setup even_setup() {
  Setup setup{bright_printer(), test::uv::resin_1(1.0), even_process(90, 140, 80), 0};
  setup.resin.viscosity_pa_s = 0.3;
  return setup;
}

TEST(EvenSetup, TextGivesItBackBitForBit) {
  slicecorr::Setup setup = even_setup();
  setup.process.even_light = small_light();
  setup.process.even_light->pitch_um = 100.0 / 3;
  const slicecorr::Setup back = parse_setup_json(setup_json(setup), "test");
  EXPECT_EQ(back.process, setup.process);
  ASSERT_TRUE(back.process.even_light);
  EXPECT_EQ(*back.process.even_light->blue, *setup.process.even_light->blue);
  setup.process.even_light.reset();
  EXPECT_EQ(parse_setup_json(setup_json(setup), "test").process, setup.process);
}

TEST(EvenSetup, SpoiltTextIsRefusedByKey) {
  const std::string text = setup_json(even_setup());
  const auto refused = [&](const std::string& from, const std::string& to, const char* key) {
    std::string spoilt = text;
    const auto at = spoilt.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    spoilt.replace(at, from.size(), to);
    try {
      parse_setup_json(spoilt, "spoilt.json");
      FAIL() << from;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(key)) << e.what();
    }
  };
  refused("\"even_dead_zone\": \"blue\"", "\"even_dead_zone\": \"green\"", "even_dead_zone");
  refused("\"columns\": 2", "\"columns\": 3", "blue");
  refused("\"gap_um\": 80.0", "\"gap_um\": 0", "gap_um");
  refused("\"blue\": \"", "\"blue\": \"!", "blue");
}

}  // namespace
}  // namespace slicecorr
