// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resins whose doses are no sums of light, and resin that ends, with lifts, wanted doses and layers of
// different heights: what columns are corrected to, by prints of the test's own.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "gel_time_models.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/dose_target.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "uv_models.hpp"

namespace slicecorr::any_pair {
namespace {

using Column = std::vector<std::uint8_t>;

constexpr double kLayerUm = 50, kHeightE = 300, kGelA = 60, kGelB = 6;

/// A print of one column, followed in time with nothing in closed form.
struct Followed {
  bool bleaches = false;
  std::vector<double> heights_um{};  ///< empty: all alike; the last holds
  double exposure_s = 0, um_s = 0;   ///< layer by layer, or continuous
  double dose_mj_cm2 = 20;           ///< of a resin that bleaches
  double bleached_height_um = 800, bleaching_mj_cm2 = 30;

  double height(int n) const {
    if (heights_um.empty()) return kLayerUm;
    return heights_um[std::min(static_cast<std::size_t>(n), heights_um.size() - 1)];
  }
  double black = 1;
  double light(std::uint8_t level) const { return black + (100 - black) * level / 255; }

  /// A time to gel: the greatest dose over all cuts, of light in this order.
  static double gelled(const std::vector<double>& light, double step_s) {
    double y = 0, x = 0, most = 0;
    for (const double i : light) y += std::sqrt(i) * step_s / kGelB;
    for (const double i : light) {
      most = std::max(most, std::min(x, y));
      x += i * step_s / kGelA;
      y -= std::sqrt(i) * step_s / kGelB;
    }
    return std::max(most, std::min(x, y));
  }
  /// What one exposure by itself leaves at the far edge of a layer.
  double far_edge(std::uint8_t level, int n) const {
    constexpr int steps = 500, cells = 25;
    const double i = light(level), h = height(n);
    if (!bleaches) {
      return gelled(std::vector<double>(steps, i * std::exp(-h / kHeightE)), exposure_s / steps);
    }
    // Cells of fresh resin, which absorb by what they have had.
    std::vector<double> had(cells + 1, 0.0);
    const double dz = h / cells, dt = exposure_s / steps;
    for (int s = 0; s < steps; ++s) {
      double passes = i, before = 0;
      for (int c = 0; c <= cells; ++c) {
        const double absorbs = 1 / bleached_height_um + (1 / kHeightE - 1 / bleached_height_um) *
                                                            std::exp(-had[c] / bleaching_mj_cm2);
        if (c > 0) passes *= std::exp(-0.5 * dz * (absorbs + before));
        before = absorbs;
        had[c] += passes * dt;
      }
    }
    return had[cells] / dose_mj_cm2;
  }
  /// Doses in the middles of layers, with a time to gel.
  std::vector<double> middles(const Column& levels) const {
    constexpr int steps = 200;
    std::vector<double> node{0}, doses;
    for (std::size_t n = 0; n < levels.size(); ++n) {
      node.push_back(node.back() + height(static_cast<int>(n)));
    }
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const double z = (node[k] + node[k + 1]) / 2;
      std::vector<double> seen;
      const double step_um = 0.25;
      for (std::size_t n = k; n < levels.size(); ++n) {
        if (exposure_s > 0) {
          seen.insert(seen.end(), steps,
                      light(levels[n]) * std::exp(-(node[n + 1] - z) / kHeightE));
          continue;
        }
        for (double at = std::max(node[n], z) + step_um / 2; at < node[n + 1]; at += step_um) {
          seen.push_back(light(levels[n]) * std::exp(-(at - z) / kHeightE));
        }
      }
      doses.push_back(gelled(seen, exposure_s > 0 ? exposure_s / steps : step_um / um_s));
    }
    return doses;
  }
};

struct Kind {
  Printer printer = test::linear_printer(1, 100);
  Resin resin;
  Process process;
  Followed followed;
};

Kind kind(bool bleaches, bool layerwise, bool lifts = false) {
  Kind k;
  if (bleaches) {
    // Dc in mJ/cm3 is that of the dose at the window over the height.
    k.resin = test::resin(20 / (kHeightE * 1e-4), units::height10_from_e(kHeightE));
    k.resin.bleaching = Bleaching{units::height10_from_e(k.followed.bleached_height_um), 30};
  } else {
    k.resin = test::gel_time_resin({kGelA, kGelB}, kHeightE);
  }
  k.followed.bleaches = bleaches;
  if (layerwise) {
    // Black light of all exposures adds up below features.
    k.followed.black = 0.02;
    k.printer = test::linear_printer(k.followed.black, 100);
    k.process.mode = ExposureMode::layerwise;
    k.process.exposure_s = k.followed.exposure_s = bleaches ? 0.6 : 6;
    k.process.lifts = lifts ? Lifts::each : Lifts::none;
    k.process.green_strength = 1.2;
  } else {
    k.process = test::process(bleaches ? 800 : 200);
    k.followed.um_s = k.process.speed_mm_h / 3.6;
  }
  return k;
}

CorrectionPlan plan_of(const Kind& k, int layers) {
  return test::plan_for(make_cure_model(k.printer, k.resin, k.process, kLayerUm), k.process,
                        layers);
}

struct Asked {
  Column coverage, doses{};
  DoseScale scale{};
};

Column corrected(const CorrectionPlan& plan, const Asked& asked) {
  const auto read = [&](int n, std::uint8_t* out) {
    *out = asked.doses[static_cast<std::size_t>(n)];
  };
  BandCorrector band = asked.doses.empty() ? BandCorrector(plan, 1)
                                           : BandCorrector(plan, 1, BandDoses{&asked.scale, read});
  for (const std::uint8_t& c : asked.coverage) band.add_layer(&c);
  Column levels(static_cast<std::size_t>(plan.all_layers));
  band.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
    levels[static_cast<std::size_t>(n)] = *level;
  });
  return levels;
}

Column random_design(std::mt19937& random, std::size_t layers) {
  Column c;
  for (bool full = random() % 2 != 0; c.size() < layers; full = !full) {
    c.insert(c.end(), 4 + random() % 10, full ? 255 : 0);
  }
  c.resize(layers);
  std::fill(c.end() - 6, c.end(), std::uint8_t{0});
  return c;
}

TEST(AnyPair, LayersHoldByTheirOwnExposureThoughDosesAreNoSums) {
  for (const bool bleaches : {false, true}) {
    for (const bool own_heights : {false, true}) {
      Kind k = kind(bleaches, true, true);
      if (own_heights) {
        k.process.layer_heights_um =
            k.followed.heights_um = {50, 50, 50, 50, 50, 50, 50, 50, 40, 40, 40, 40, 40, 60};
      }
      const CorrectionPlan plan = plan_of(k, 60);
      ASSERT_TRUE(plan.model.lifts);
      Kind without = k;
      without.process.lifts = Lifts::none;
      const CorrectionPlan as_before = plan_of(without, 60);
      std::mt19937 random(3);
      int loose = 0, loose_before = 0, looked_at = 0;
      std::vector<double> far;
      for (const double um : {40.0, 50.0, 60.0}) {
        Followed f = k.followed;
        f.heights_um = {um};
        for (int level = 0; level < 256; ++level) {
          far.push_back(f.far_edge(static_cast<std::uint8_t>(level), 0));
        }
      }
      const auto holds = [&](std::uint8_t level, int n) {
        const auto row = static_cast<std::size_t>((k.followed.height(n) - 40) / 10);
        // Steps are off by a part in 1000.
        return far[row * 256 + level] >= 1.2 * (1 - 2e-3);
      };
      for (int round = 0; round < 10; ++round) {
        const Column design = random_design(random, 60);
        const Column levels = corrected(plan, {design}), before = corrected(as_before, {design});
        const ColumnDose dose = column_dose(plan.model, levels);
        bool stands = true;
        for (std::size_t n = 0; n < 60; ++n) {
          stands = stands && design[n] == 255;
          if (design[n] != 255) continue;
          ++looked_at;
          if (stands) {
            EXPECT_EQ(levels[n], 255) << n;
          }
          loose += !holds(levels[n], static_cast<int>(n));
          loose_before += !holds(before[n], static_cast<int>(n));
          EXPECT_GE(dose.middle[n], 1) << bleaches << own_heights << " " << round << " " << n;
        }
      }
      EXPECT_EQ(loose, 0) << bleaches << own_heights << ": of " << looked_at;
      EXPECT_GT(loose_before, looked_at / 4) << bleaches << own_heights;
    }
  }
}

TEST(AnyPair, LightThatHoldsNoLayerIsRefused) {
  for (const bool bleaches : {false, true}) {
    Kind k = kind(bleaches, true, true);
    const double most = k.followed.far_edge(255, 0);
    const auto model = [&](double strength) {
      k.process.green_strength = strength;
      return make_cure_model(k.printer, k.resin, k.process, kLayerUm);
    };
    EXPECT_NO_THROW(check_feasible(model(most * 0.99), k.printer, k.process)) << bleaches;
    EXPECT_THROW(check_feasible(model(most * 1.01), k.printer, k.process), InfeasibleError)
        << bleaches;
  }
}

TEST(AnyPair, DosesInLayersOfDifferentHeightsWithATimeToGel) {
  for (const bool layerwise : {false, true}) {
    Kind k = kind(false, layerwise);
    k.process.layer_heights_um = k.followed.heights_um = {50, 30, 30, 80, 80, 45};
    const CureModel model = make_cure_model(k.printer, k.resin, k.process, kLayerUm);
    std::mt19937 random(9);
    for (int round = 0; round < 6; ++round) {
      Column levels;
      while (levels.size() < 24) {
        levels.insert(levels.end(), 1 + random() % 5, static_cast<std::uint8_t>(random() % 256));
      }
      levels.resize(24);
      const ColumnDose told = column_dose(model, levels);
      const std::vector<double> dose = k.followed.middles(levels);
      // A step's light counts for before the cut or after it.
      const double room =
          100 * (layerwise ? k.followed.exposure_s / 200 : 0.25 / k.followed.um_s) / kGelA;
      for (std::size_t n = 0; n < 24; ++n) {
        EXPECT_NEAR(told.middle[n], dose[n], room) << layerwise << " " << round << " " << n;
      }
    }
  }
}

TEST(AnyPair, FeaturesPrintInLayersOfDifferentHeights) {
  for (const bool bleaches : {false, true}) {
    for (const bool layerwise : {false, true}) {
      Kind k = kind(bleaches, layerwise);
      k.process.layer_heights_um = {50, 50, 30, 30, 30, 30, 30, 60, 60, 60, 60, 60, 60, 60, 40};
      const CorrectionPlan plan = plan_of(k, 70);
      std::mt19937 random(4);
      int wrong = 0, sliced = 0;
      for (int round = 0; round < 12; ++round) {
        const Column design = random_design(random, 70);
        const ColumnDose dose = column_dose(plan.model, corrected(plan, {design})),
                         as_sliced = column_dose(plan.model, design);
        for (std::size_t n = 0; n < 70; ++n) {
          wrong += (dose.middle[n] >= 1) != (design[n] == 255);
          sliced += (as_sliced.middle[n] >= 1) != (design[n] == 255);
        }
      }
      EXPECT_EQ(wrong, 0) << bleaches << layerwise;
      EXPECT_GT(sliced, 50) << bleaches << layerwise;
    }
  }
}

DoseScale scale_to(double most, DoseSide side) {
  DoseScale scale = DoseScale::even(most);
  scale.side = side;
  return scale;
}

/// The most that one level more gives anywhere, of light that stays.
double level_dose(const CureModel& model) {
  double most = 0;
  for (std::size_t l = 1; l < model.level_phi.size(); ++l) {
    most = std::max(most, model.level_phi[l] - model.level_phi[l - 1]);
  }
  return most;
}

TEST(AnyPair, WantedDosesAreHeldThoughTheyAreNoSums) {
  for (const bool bleaches : {false, true}) {
    for (const bool layerwise : {false, true}) {
      const Kind k = kind(bleaches, layerwise);
      const CorrectionPlan plan = plan_of(k, 90);
      for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
        Asked a{test::column(90, {{0, 80}})};
        a.doses.assign(90, 255);
        a.scale = scale_to(1.6, side);
        const ColumnDose dose = column_dose(plan.model, corrected(plan, a));
        // Full light needs some slices to come to it. A level less in every slice would be too little, and
        // continuous, where light changes between two nodes, the middle may have a little less than they.
        for (std::size_t n = 0; n < 60; ++n) {
          EXPECT_GE(dose.middle[n], 1.6 - (layerwise ? 1e-9 : level_dose(plan.model)))
              << bleaches << layerwise << " " << n;
          EXPECT_LE(dose.middle[n], 1.6 + 3 * level_dose(plan.model))
              << bleaches << layerwise << " " << n;
        }
      }
    }
  }
}

TEST(AnyPair, RandomDosesPrintTheirPartThoughTheyAreNoSums) {
  for (const bool bleaches : {false, true}) {
    for (const bool layerwise : {false, true}) {
      const Kind k = kind(bleaches, layerwise);
      const CorrectionPlan plan = plan_of(k, 100);
      std::mt19937 random(6);
      int wrong = 0;
      double more = 0, wanted_more = 0;
      for (int round = 0; round < 18; ++round) {
        Asked a{random_design(random, 100)};
        a.scale = scale_to(1.3 + 0.1 * (round % 5), static_cast<DoseSide>(round % 3));
        while (a.doses.size() < 100) {
          a.doses.insert(a.doses.end(), 4 + random() % 30,
                         static_cast<std::uint8_t>(random() % 256));
        }
        a.doses.resize(100);
        const ColumnDose dose = column_dose(plan.model, corrected(plan, a)),
                         plain = column_dose(plan.model, corrected(plan, {a.coverage}));
        for (std::size_t n = 0; n < 100; ++n) {
          const bool full = a.coverage[n] == 255;
          wrong += (dose.middle[n] >= 1) != full;
          if (!full) continue;
          more += dose.middle[n] - plain.middle[n];
          wanted_more += a.scale.dose[a.doses[n]] - 1;
        }
      }
      EXPECT_EQ(wrong, 0) << bleaches << layerwise;
      // Features of 4 to 13 layers are mostly near their edges, which come first.
      EXPECT_GT(more, 0.2 * wanted_more) << bleaches << layerwise;
    }
  }
}

/// Sums of light, lift by lift, in resin that ends.
std::vector<double> exchanged_middles(const CureModel& model, const Column& levels, double x) {
  std::vector<double> doses;
  const auto all = static_cast<int>(levels.size());
  for (int k = 0; k < all; ++k) {
    double dose = 0, most = 0;
    for (int n = k; n < std::min(all, k + model.bath_slices); ++n) {
      dose = (1 - x) * dose + model.level_phi[levels[static_cast<std::size_t>(n)]] *
                                  std::pow(10.0, -model.eta * (n - k + 0.5));
      most = std::max(most, dose);
    }
    doses.push_back(most);
  }
  return doses;
}

TEST(AnyPair, LiftsInResinThatEnds) {
  Printer printer = test::linear_printer(0.001, 100);
  printer.resin_depth_um = 250;
  const Resin resin = test::resin(200, units::height10_from_e(130));
  std::mt19937 random(12);
  for (const double x : {kUnknownExchange, 0.0, 0.4, 1.0}) {
    Process process;
    process.mode = ExposureMode::layerwise;
    process.exposure_s = 0.4;
    process.lifts = Lifts::each;
    process.green_strength = 1.2;
    process.lift_exchange = x;
    const CureModel model = make_cure_model(printer, resin, process, kLayerUm);
    ASSERT_EQ(model.bath_slices, 5);
    ASSERT_TRUE(model.lifts);
    const CorrectionPlan plan = test::plan_for(model, process, 60);
    int thinner = 0;
    for (int round = 0; round < 20; ++round) {
      const Column design = random_design(random, 60), levels = corrected(plan, {design});
      const ColumnDose told = column_dose(model, levels);
      const std::vector<double> dose = exchanged_middles(model, levels, std::max(0.0, x));
      for (std::size_t n = 0; n < 60; ++n) {
        ASSERT_NEAR(told.middle[n], dose[n], 1e-9 * std::max(1.0, dose[n])) << x << " " << n;
        if (design[n] != 255) continue;
        thinner += dose[n] < 1;
        // All that has a layer above it in its feature holds, but for those that are liquid on purpose.
        if (x == kUnknownExchange) {
          EXPECT_GE(model.level_phi[levels[n]] * model.a, 1.2) << n;
        }
      }
    }
    EXPECT_EQ(thinner, 0) << x;
  }
}

TEST(AnyPair, ExchangedDosesInLayersOfDifferentHeights) {
  Printer printer = test::linear_printer(0.5, 100);
  const Resin resin = test::resin(200, units::height10_from_e(150));
  std::mt19937 random(8);
  for (const double x : {0.25, 0.6, 1.0}) {
    Process process;
    process.mode = ExposureMode::layerwise;
    process.exposure_s = 0.5;
    process.lifts = Lifts::each;
    process.green_strength = 1.2;
    process.lift_exchange = x;
    process.layer_heights_um = {50, 50, 20, 20, 20, 70, 70, 40};
    const CureModel model = make_cure_model(printer, resin, process, kLayerUm);
    for (int round = 0; round < 10; ++round) {
      Column levels;
      while (levels.size() < 20) {
        levels.insert(levels.end(), 1 + random() % 3, static_cast<std::uint8_t>(random() % 256));
      }
      levels.resize(20);
      const ColumnDose told = column_dose(model, levels);
      for (std::size_t k = 0; k < 20; ++k) {
        const auto um = [&](std::size_t n) {
          return process.layer_heights_um[std::min<std::size_t>(n, 7)];
        };
        double dose = 0, most = 0, far_um = -0.5 * um(k);
        for (std::size_t n = k; n < 20; ++n) {
          far_um += um(n);
          dose = (1 - x) * dose + model.level_phi[levels[n]] * std::exp(-far_um / 150);
          most = std::max(most, dose);
        }
        EXPECT_NEAR(told.middle[k], most, 1e-9 * std::max(1.0, most)) << x << " " << k;
      }
    }
  }
}

/// Grey by pulses under UV light, at the middles of layers: full light and black light in their shares of the
/// time, UV light all along, in small steps.
std::vector<double> pulsed_middles(const Column& levels, double uv, double speed_mm_h,
                                   double exposure_s) {
  constexpr double hb = 408, huv = 37.8, beta = 0.73, m = 0.99, dose_prime = 64;
  constexpr int steps = 100;
  const auto rate = [&](double blue, double d) {
    const double net = blue * std::exp(-d / hb) - beta * uv * std::exp(-d / huv);
    return net > 0 ? std::pow(net, m) / dose_prime : 0.0;
  };
  std::vector<double> doses;
  for (std::size_t k = 0; k < levels.size(); ++k) {
    double sum = 0;
    for (std::size_t n = k; n < levels.size(); ++n) {
      const double share = levels[n] / 255.0;
      const auto gains = [&](double d) { return share * rate(100, d) + (1 - share) * rate(1, d); };
      const double z = (static_cast<double>(k) + 0.5) * kLayerUm,
                   end = (static_cast<double>(n) + 1) * kLayerUm;
      if (exposure_s > 0) {
        sum += gains(end - z) * exposure_s;
        continue;
      }
      const double from = std::max(static_cast<double>(n) * kLayerUm, z), h = (end - from) / steps;
      for (int s = 0; s < steps; ++s)
        sum += gains(from + h * (s + 0.5) - z) * h / (speed_mm_h / 3.6);
    }
    doses.push_back(sum);
  }
  return doses;
}

TEST(AnyPair, PulsesUnderUvLight) {
  for (const bool layerwise : {false, true}) {
    Printer printer = test::uv::uv_printer();
    printer.grey = GreyLight::pulsed;
    const Resin resin = test::uv::resin_1();
    Process process = test::uv::uv_process(700, 200);
    if (layerwise) {
      process.mode = ExposureMode::layerwise;
      process.lifts = Lifts::none;
      process.exposure_s = 0.3;
    }
    const CureModel model = make_cure_model(printer, resin, process, kLayerUm);
    const CorrectionPlan plan = test::plan_for(model, process, 70);
    Printer steady = printer;
    steady.grey = GreyLight::steady;
    const CorrectionPlan as_steady =
        test::plan_for(make_cure_model(steady, resin, process, kLayerUm), process, 70);
    std::mt19937 random(15);
    int wrong = 0, taken_for_steady = 0;
    for (int round = 0; round < 4; ++round) {
      const Column design = random_design(random, 70), levels = corrected(plan, {design});
      const ColumnDose told = column_dose(model, levels);
      const auto middles = [&](const Column& of) {
        return pulsed_middles(of, 200, process.speed_mm_h, layerwise ? process.exposure_s : 0);
      };
      const std::vector<double> dose = middles(levels),
                                before = middles(corrected(as_steady, {design}));
      for (std::size_t n = 0; n < 70; ++n) {
        // Where the rate begins in a step it is off by a part of the step.
        ASSERT_NEAR(told.middle[n], dose[n], 1e-3 * std::max(1.0, dose[n]))
            << layerwise << " " << n;
        wrong += (told.middle[n] >= 1) != (design[n] == 255);
        taken_for_steady += (before[n] >= 1) != (design[n] == 255);
      }
    }
    RecordProperty(layerwise ? "layerwise" : "continuous",
                   std::to_string(wrong) + " " + std::to_string(taken_for_steady));
    EXPECT_LT(wrong, taken_for_steady) << layerwise;
    // Pulses are full light: all grey levels have its dead zone.
    const InhibitedKernel& kernel = *model.inhibited();
    EXPECT_DOUBLE_EQ(kernel.setting_dead_zone_um(0, 5), kernel.setting_dead_zone_um(0, 255));
    EXPECT_GT(kernel.setting_dead_zone_um(0, 0), kernel.setting_dead_zone_um(0, 255));
  }
}

}  // namespace
}  // namespace slicecorr::any_pair
