// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is wanted of a part, wanted doses and what is left alone, with each kind of light: doses by sums and
// by small steps of the test's own.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "gel_time_models.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/dose_target.hpp"
#include "uv_models.hpp"

namespace slicecorr::demands {
namespace {

using test::column;
using Column = std::vector<std::uint8_t>;

/// A column that is corrected as a band of one.
struct Asked {
  Column coverage, left_alone{}, doses{}, heights{};
  DoseScale scale{};
};

Column corrected(const CorrectionPlan& plan, const Asked& asked) {
  const auto read = [&](int n, std::uint8_t* out) {
    *out = asked.doses[static_cast<std::size_t>(n)];
  };
  BandCorrector band = asked.doses.empty() ? BandCorrector(plan, 1, !asked.left_alone.empty())
                                           : BandCorrector(plan, 1, BandDoses{&asked.scale, read});
  for (std::size_t n = 0; n < asked.coverage.size(); ++n) {
    band.add_layer(&asked.coverage[n], asked.heights.empty() ? nullptr : &asked.heights[n],
                   asked.left_alone.empty() ? nullptr : &asked.left_alone[n]);
  }
  Column levels(static_cast<std::size_t>(plan.all_layers));
  band.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
    levels[static_cast<std::size_t>(n)] = *level;
  });
  return levels;
}

DoseScale scale_to(double most, DoseSide side = DoseSide::nearest) {
  DoseScale scale = DoseScale::even(most);
  scale.side = side;
  return scale;
}

/// Light and resin in numbers of their own, and what images give in the middles of layers.
struct Light {
  double layer_um = 50, ha_um = 2000, speed_um_s = 0, exposure_s = 0, dose = 1, m = 1;
  double least = 1, most = 100;  ///< mW/cm², levels in even steps
  double uv = 0, beta = 0, huv_um = 1;
  double depth_um = 1e9, reflectance = 0;
  std::vector<double> share{}, heights_um{};

  double height(std::size_t n) const { return heights_um.empty() ? layer_um : heights_um[n]; }
  double blue(std::uint8_t level, std::size_t n) const {
    return (least + (most - least) * level / 255) * (share.empty() ? 1.0 : share[n]);
  }
  /// Rate of dose at a distance from the window.
  double rate(double blue_mw_cm2, double d_um, double back) const {
    if (d_um > depth_um) return 0;
    const double he = ha_um / std::log(10.0);
    const double net =
        back * blue_mw_cm2 * std::exp(-d_um / he) - beta * uv * std::exp(-d_um / huv_um);
    return net > 0 ? std::pow(net, m) / dose : 0.0;
  }
  std::vector<double> middles(const Column& levels) const {
    constexpr int steps = 32;
    std::vector<double> doses;
    std::vector<double> node{0};
    for (std::size_t n = 0; n < levels.size(); ++n) node.push_back(node.back() + height(n));
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const double z = (node[k] + node[k + 1]) / 2;
      const double back = 1 + reflectance * std::exp(-2 * z * std::log(10.0) / ha_um);
      double sum = 0;
      for (std::size_t n = k; n < levels.size(); ++n) {
        const double i = blue(levels[n], n);
        if (exposure_s > 0) {
          sum += rate(i, node[n + 1] - z, back) * exposure_s;
          continue;
        }
        const double from = std::max(node[n], z), h = (node[n + 1] - from) / steps;
        for (int s = 0; s < steps; ++s)
          sum += rate(i, from + h * (s + 0.5) - z, back) * h / speed_um_s;
      }
      doses.push_back(sum);
    }
    return doses;
  }
};

/// Half-steps' own error: (h / he)² / 24 of blue light, more where UV light ends the rate.
constexpr double kSteps = 1e-3;

struct Kind {
  const char* name;
  Printer printer;
  Resin resin;
  Process process;
  Light light;
};

Kind plain() {
  Kind k{"plain", test::linear_printer(1, 100), test::resin(576, 2000), test::process(1000), {}};
  k.light.speed_um_s = 1000 / 3.6;
  k.light.dose = 576 * 1e-4 * 2000 / std::log(10.0);
  return k;
}

Kind under_uv(double uv = 200) {
  Kind k{"UV", test::uv::uv_printer(), test::uv::resin_1(), test::uv::uv_process(700, uv), {}};
  k.light = {50, 408 * std::log(10.0), 700 / 3.6, 0, 64, 0.99};
  k.light.uv = uv;
  k.light.beta = 0.73;
  k.light.huv_um = 37.8;
  return k;
}

CorrectionPlan plan_of(const Kind& k, int layers) {
  return test::plan_for(make_cure_model(k.printer, k.resin, k.process, 50), k.process, layers);
}

/// Runs of 5 to 20 slices: features, gaps and, in every third column or so, what is left alone.
Asked random_column(std::mt19937& random, std::size_t layers, std::uint8_t grey) {
  Asked a;
  int last = 0;
  while (a.coverage.size() < layers) {
    const std::size_t count = 5 + random() % 16;
    auto kind = static_cast<int>(random() % 3);
    if (kind == last) kind = (kind + 1) % 3;
    // Dim light of it stands after gaps, full light on features: either can be corrected around.
    if (kind == 2 && (last == 1) != (grey == 255)) kind = 1 - last % 2;
    a.coverage.insert(a.coverage.end(), count, kind == 1 ? 255 : 0);
    a.left_alone.insert(a.left_alone.end(), count, kind == 2 ? grey : std::uint8_t{0});
    last = kind;
  }
  a.coverage.resize(layers);
  a.left_alone.resize(layers);
  // The part ends before its last slice.
  for (std::size_t n = layers - 8; n < layers; ++n) a.coverage[n] = a.left_alone[n] = 0;
  return a;
}

TEST(Demands, WhatIsLeftAloneUnderUvLightStaysAndThePartPrintsAroundIt) {
  for (const double uv : {130.0, 200.0}) {
    const Kind k = under_uv(uv);
    const CorrectionPlan plan = plan_of(k, 110);
    std::mt19937 random(5);
    int wrong = 0, voxels = 0;
    for (int round = 0; round < 30; ++round) {
      const bool bright = round % 2 != 0;
      const Asked a = random_column(random, 110, bright ? 255 : 20);
      const Column levels = corrected(plan, a);
      const std::vector<double> dose = k.light.middles(levels);
      for (std::size_t n = 0; n < 110; ++n) {
        if (a.left_alone[n] != 0) {
          ASSERT_EQ(levels[n], a.left_alone[n]) << uv << " " << round << " " << n;
        } else if (a.coverage[n] == 255 || !bright) {
          ++voxels;
          const bool prints = dose[n] >= 1 + (a.coverage[n] == 255 ? -kSteps : kSteps);
          wrong += prints != (a.coverage[n] == 255);
        }
      }
    }
    EXPECT_EQ(wrong, 0) << uv << ": of " << voxels;
  }
}

TEST(Demands, NothingLeftAloneChangesNothing) {
  for (const bool uv : {false, true}) {
    Kind k = uv ? under_uv() : plain();
    if (!uv) k.resin = test::bright_resin();
    const CorrectionPlan plan = plan_of(k, 90);
    std::mt19937 random(2);
    for (int round = 0; round < 12; ++round) {
      Asked a = random_column(random, 90, 0);
      std::fill(a.left_alone.begin(), a.left_alone.end(), std::uint8_t{0});
      EXPECT_EQ(corrected(plan, a), solve_column(plan, a.coverage)) << uv << round;
    }
  }
}

TEST(Demands, WhatIsLeftAloneWithATimeToGelAndBleaching) {
  for (const bool bleaches : {false, true}) {
    Kind k = plain();
    if (bleaches) {
      k.resin = test::resin(576, 1200);
      k.resin.bleaching = Bleaching{3000, 60};
    } else {
      k.resin = test::bright_resin();
    }
    const CorrectionPlan plan = plan_of(k, 110);
    std::mt19937 random(5);
    int wrong = 0;
    for (int round = 0; round < 30; ++round) {
      const bool bright = round % 2 != 0;
      const Asked a = random_column(random, 110, bright ? 255 : 20);
      const Column levels = corrected(plan, a);
      const ColumnDose dose = column_dose(plan.model, levels);
      for (std::size_t n = 0; n < 110; ++n) {
        if (a.left_alone[n] != 0) {
          ASSERT_EQ(levels[n], a.left_alone[n]) << bleaches << " " << round << " " << n;
        } else if (a.coverage[n] == 255 || !bright) {
          wrong += (dose.middle[n] >= 1) != (a.coverage[n] == 255);
        }
      }
    }
    EXPECT_EQ(wrong, 0) << bleaches;
  }
}

/// The most that one level more gives anywhere.
double level_dose(const CureModel& model) {
  double most = 0;
  for (std::size_t l = 1; l < model.level_phi.size(); ++l) {
    most = std::max(most, model.level_phi[l] - model.level_phi[l - 1]);
  }
  return most;
}

TEST(Demands, AnEvenDoseUnderUvLightIsHeldToAFewLevels) {
  for (const double uv : {130.0, 200.0}) {
    const Kind k = under_uv(uv);
    const CorrectionPlan plan = plan_of(k, 120);
    for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
      Asked a{column(120, {{0, 110}})};
      a.doses.assign(120, 255);
      a.scale = scale_to(1.5, side);
      const std::vector<double> dose = k.light.middles(corrected(plan, a));
      // Levels stay although up to three less would do (InhibitedTuning::calm_levels).
      for (std::size_t n = 0; n < 90; ++n) {
        EXPECT_GE(dose[n], 1.5 - 2 * kSteps) << uv << " " << n;
        EXPECT_LE(dose[n], 1.5 + 5 * level_dose(plan.model)) << uv << " " << n;
      }
    }
  }
}

TEST(Demands, RandomDosesUnderUvLightPrintTheirPart) {
  const Kind k = under_uv();
  const CorrectionPlan plan = plan_of(k, 120);
  std::mt19937 random(3);
  int wrong = 0;
  for (int round = 0; round < 24; ++round) {
    Asked a = random_column(random, 120, 0);
    a.left_alone.clear();
    a.scale = scale_to(1.3 + 0.1 * (round % 5), static_cast<DoseSide>(round % 3));
    while (a.doses.size() < 120) {
      a.doses.insert(a.doses.end(), 4 + random() % 30, static_cast<std::uint8_t>(random() % 256));
    }
    a.doses.resize(120);
    const std::vector<double> dose = k.light.middles(corrected(plan, a));
    for (std::size_t n = 0; n < 120; ++n) {
      const bool full = a.coverage[n] == 255;
      wrong += (dose[n] >= 1 + (full ? -kSteps : kSteps)) != full;
    }
  }
  EXPECT_EQ(wrong, 0);
}

TEST(Demands, StepsOfDosesUnderUvLightAreMetFromTheSideThatIsNamed) {
  const Kind k = under_uv();
  const CorrectionPlan plan = plan_of(k, 140);
  const double room = 5 * level_dose(plan.model);
  for (const bool rises : {false, true}) {
    double off[3] = {};
    for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
      Asked a{column(140, {{0, 130}})};
      a.scale = scale_to(2, side);
      // Bytes of 60 and of 200 are doses of 1.235 and 1.784.
      a.doses.assign(140, 60);
      std::fill(a.doses.begin() + (rises ? 0 : 70), a.doses.begin() + (rises ? 70 : 140), 200);
      const std::vector<double> dose = k.light.middles(corrected(plan, a));
      for (std::size_t n = 0; n < 110; ++n) {
        const double wanted = a.scale.dose[a.doses[n]];
        off[static_cast<int>(side)] += std::abs(dose[n] - wanted);
        if (side == DoseSide::at_least) {
          EXPECT_GE(dose[n], wanted - 2 * kSteps) << rises << " " << n;
        }
        if (side == DoseSide::at_most) {
          EXPECT_LE(dose[n], wanted + room) << rises << " " << n;
        }
      }
    }
    EXPECT_LT(off[0], std::max(off[1], off[2])) << rises;
  }
}

TEST(Demands, UnderUvLightDosesEndWithTheResin) {
  for (const bool layerwise : {false, true}) {
    Kind k = under_uv();
    // A tenth of full light's dose comes from further away.
    k.printer.resin_depth_um = k.light.depth_um = 900;
    if (layerwise) {
      k.process.mode = ExposureMode::layerwise;
      k.process.lifts = Lifts::none;
      k.process.exposure_s = k.light.exposure_s = 0.25;
    }
    const CorrectionPlan plan = plan_of(k, 110);
    Kind endless = k;
    endless.printer.resin_depth_um = 0;
    const CorrectionPlan as_if = plan_of(endless, 110);
    std::mt19937 random(31);
    int wrong = 0, before = 0;
    for (int round = 0; round < 12; ++round) {
      Asked a = random_column(random, 110, 20);
      if (round % 3 != 0) a.left_alone.clear();
      if (round % 3 == 2) {
        a.scale = scale_to(1.4);
        a.doses.assign(110, 255);
      }
      const Column levels = corrected(plan, a);
      const ColumnDose told = column_dose(plan.model, levels);
      const std::vector<double> dose = k.light.middles(levels);
      const std::vector<double> otherwise = k.light.middles(corrected(as_if, a));
      for (std::size_t n = 0; n < 110; ++n) {
        ASSERT_NEAR(told.middle[n], dose[n], kSteps * std::max(1.0, dose[n]))
            << layerwise << " " << round << " " << n;
        if (!a.left_alone.empty() && a.left_alone[n] != 0) continue;
        const bool full = a.coverage[n] == 255;
        wrong += (dose[n] >= 1 + (full ? -kSteps : kSteps)) != full;
        before += (otherwise[n] >= 1 + (full ? -kSteps : kSteps)) != full;
      }
    }
    // Of features of a slice, at the ends of columns, light may not be enough.
    EXPECT_LT(20 * wrong, before) << layerwise << ": " << wrong << " of " << before;
  }
}

/// Prints where the sums of light are not plain, with wanted doses.
std::vector<Kind> not_plain() {
  std::vector<Kind> kinds;
  Kind k = plain();
  kinds.push_back(k);
  k.name = "depth";
  k.printer.resin_depth_um = k.light.depth_um = 4000;
  kinds.push_back(k);
  k.name = "depth and reflectance";
  k.printer.platform_reflectance = k.light.reflectance = 0.3;
  kinds.push_back(k);
  k = plain();
  k.name = "reflectance";
  k.printer.platform_reflectance = k.light.reflectance = 0.3;
  kinds.push_back(k);
  k = plain();
  k.name = "lamps that stay";
  k.process.slice_lamps = SliceLamps::stay;
  for (int n = 0; n < 300; ++n) {
    k.process.slice_speed_mm_h.push_back(n < 40 ? 800 : 1000);
    k.light.share.push_back(n < 40 ? 1.25 : 1);
  }
  kinds.push_back(k);
  return kinds;
}

TEST(Demands, AnEvenDoseIsHeldToHalfALevel) {
  for (const Kind& k : not_plain()) {
    const CorrectionPlan plan = plan_of(k, 160);
    Asked a{column(160, {{0, 150}})};
    a.doses.assign(160, 255);
    a.scale = scale_to(1.7);
    const Column levels = corrected(plan, a);
    const std::vector<double> dose = k.light.middles(levels);
    // Light from the platform makes doses of a layer differ, and the search's of a node stands for it.
    const double b = plan.model.one_minus_a * 1.3 * 1.25;
    for (std::size_t n = 0; n < 100; ++n) {
      EXPECT_NEAR(dose[n], 1.7, level_dose(plan.model) * b + kSteps) << k.name << " " << n;
    }
  }
}

TEST(Demands, FeaturesPrintAndDosesAreNoneTooFar) {
  for (const Kind& k : not_plain()) {
    const CorrectionPlan plan = plan_of(k, 160);
    std::mt19937 random(8);
    int wrong = 0, ordinary = 0;
    for (int round = 0; round < 6; ++round) {
      Asked a = random_column(random, 160, 20);
      if (round % 2 == 0) a.left_alone.assign(160, 0);
      const auto count = [&] {
        int sum = 0;
        const Column levels = corrected(plan, a);
        const std::vector<double> dose = k.light.middles(levels);
        for (std::size_t n = 0; n < 160; ++n) {
          if (a.left_alone[n] != 0) {
            EXPECT_EQ(levels[n], a.left_alone[n]) << k.name << " " << round << " " << n;
            continue;
          }
          const bool full = a.coverage[n] == 255;
          sum += (dose[n] >= 1 + (full ? -kSteps : kSteps)) != full;
        }
        return sum;
      };
      ordinary += count();
      a.scale = scale_to(1.5, static_cast<DoseSide>(round % 3));
      while (a.doses.size() < 160) {
        a.doses.insert(a.doses.end(), 3 + random() % 40, static_cast<std::uint8_t>(random() % 256));
      }
      a.doses.resize(160);
      wrong += count();
    }
    EXPECT_LE(wrong, ordinary) << k.name;
  }
}

TEST(Demands, ACapHoldsBesideWantedDoses) {
  Kind k = plain();
  k.process.omega_max = 1.4;
  k.process.cap_platform_features = true;
  const CorrectionPlan plan = plan_of(k, 120);
  Asked a{column(120, {{0, 49}, {60, 110}})};
  a.doses.assign(120, 255);
  a.scale = scale_to(2);
  const std::vector<double> dose = k.light.middles(corrected(plan, a));
  double most = 0;
  for (std::size_t n = 0; n < 111; ++n) {
    if (a.coverage[n] == 255) most = std::max(most, dose[n]);
    EXPECT_EQ(dose[n] >= 1, a.coverage[n] == 255) << n;
  }
  EXPECT_LE(most, 1.4 + level_dose(plan.model) * plan.model.one_minus_a + kSteps);
  EXPECT_GE(most, 1.4 - 2 * level_dose(plan.model) * plan.model.one_minus_a - kSteps);
}

TEST(Demands, LayersOfDifferentHeightsHaveTheDosesThatAreWanted) {
  for (const bool mirrored : {false, true}) {
    Kind k = plain();
    k.resin = test::resin(576, 300);
    k.process = Process{};
    k.process.mode = ExposureMode::layerwise;
    k.process.lifts = Lifts::none;
    k.process.exposure_s = 2;
    k.light = {50, 300, 0, 2, 576 * 1e-4 * 300 / std::log(10.0)};
    if (mirrored) {
      k.printer.platform_reflectance = k.light.reflectance = 0.3;
      k.printer.resin_depth_um = k.light.depth_um = 1000;
    } else {
      for (int n = 0; n < 130; ++n) {
        k.light.heights_um.push_back(n % 30 < 10 ? 30 : n % 30 < 20 ? 50 : 70);
      }
      k.process.layer_heights_um = k.light.heights_um;
    }
    const CorrectionPlan plan = plan_of(k, 130);
    Asked a{column(130, {{0, 129}})};
    a.doses.assign(130, 255);
    for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
      a.scale = scale_to(12, side);
      const std::vector<double> dose = k.light.middles(corrected(plan, a));
      const double step = level_dose(plan.model) * (mirrored ? 1.3 : 1);
      for (std::size_t n = 0; n < 100; ++n) {
        EXPECT_NEAR(dose[n], 12, side == DoseSide::nearest ? 0.51 * step : 1.01 * step)
            << mirrored << " " << n;
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr::demands
