// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The coupled correction, judged by doses that are summed here, pixel by pixel, with weights of the
// test's own.
#include "correct/coupled.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "coupled_sums.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::test::together {
namespace {

using detail::Miss;

/// A single image: no slice sees another one's light.
CureModel image_model(double phi_min, double phi_max) {
  CureModel model;
  model.layer_um = kLayerUm;
  model.eta = 12;
  model.a = std::pow(10, -model.eta);
  model.one_minus_a = 1 - model.a;
  model.root_a = std::pow(10, -model.eta / 2);
  for (int l = 0; l < 256; ++l) model.level_phi.push_back(phi_min + (phi_max - phi_min) * l / 255);
  return model;
}

Design image_with_gaps() {
  Design d(32, 32, 1);
  d.fill({4, 4, 28, 28}, 0, 1, 255);
  d.fill({10, 8, 11, 24}, 0, 1, 0);
  d.fill({14, 8, 16, 24}, 0, 1, 0);
  d.fill({19, 8, 22, 24}, 0, 1, 0);
  return d;
}

/// Walls, an overhang, a hole, a channel, thin walls and grey edges.
Design block() {
  Design d(44, 36, 40);
  d.fill({6, 5, 36, 31}, 0, 36, 255);
  d.fill({26, 5, 36, 31}, 10, 18, 0);
  d.fill({12, 10, 15, 13}, 0, 40, 0);
  d.fill({18, 5, 22, 31}, 20, 28, 0);
  d.fill({39, 8, 41, 28}, 0, 30, 255);
  d.fill({6, 30, 24, 31}, 0, 36, 100);
  return d;
}

Design random_design(unsigned seed) {
  std::mt19937 random(seed);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  Design d(26, 22, 24);
  for (int k = 0; k < 14; ++k) {
    const int x = below(22), y = below(18), n = below(22);
    d.fill({x, y, std::min(26, x + 1 + below(12)), std::min(22, y + 1 + below(10))}, n,
           std::min(24, n + 1 + below(12)),
           static_cast<std::uint8_t>(k < 8        ? 255
                                     : k % 3 == 0 ? below(256)
                                                  : 0));
  }
  return d;
}

TEST(Coupled, PrintsTheImageWithGaps) {
  const Design design = image_with_gaps();
  const CureModel model = image_model(0.02, 2);
  const CorrectionPlan plan(model, test::process(1000), 1, 1);
  struct Case {
    double sigma_um;
    int rounds;
    std::uint64_t columns_wrong;
  };
  // Voxels that are wrong where all of the feature is lit at 2.
  for (const Case& c : {Case{25, 3, 0}, Case{40, 10, 16}, Case{60, 20, 32}}) {
    Setting setting{.sigma_px = c.sigma_um / kPixelUm, .margin = 0.02, .rounds = c.rounds};
    Coupled coupled(design, plan, setting);
    EXPECT_EQ(coupled->columns_alone().wrong(), c.columns_wrong) << c.sigma_um;
    coupled.run();
    EXPECT_EQ(coupled->best().wrong(), 0) << c.sigma_um;
    const Direct direct = judge(design, plan, coupled.levels(design), setting);
    EXPECT_EQ(direct.through + direct.under, 0) << c.sigma_um;
  }
}

TEST(Coupled, JudgesAsDirectSumsDo) {
  const Design design = block();
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  for (const double kappa : {0.0, 2.0}) {
    Setting setting{.kappa = kappa, .rounds = 2};
    // As far as light goes, and some way on.
    setting.border = 8;
    Coupled coupled(design, plan, setting);
    for (int round = 0; round < 3; ++round) {
      const auto& figures = coupled->best();
      const Direct direct = judge(design, plan, coupled.levels(design), setting);
      EXPECT_EQ(figures.through, direct.through) << kappa << " " << round;
      EXPECT_EQ(figures.under, direct.under) << kappa << " " << round;
      EXPECT_NEAR(figures.loss, direct.loss, 1e-5 * direct.loss + 1e-9) << kappa << " " << round;
      coupled->improve(coupled.context());
    }
  }
}

TEST(Coupled, WhatIsReportedAsWrongIsWrong) {
  const Design design = block();
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  Setting setting{.sigma_px = 1.5, .rounds = 2};
  setting.border = 10;
  Coupled coupled(design, plan, setting);
  coupled.run();
  ASSERT_GT(coupled->best().wrong(), 0);
  const Direct direct = judge(design, plan, coupled.levels(design), setting);
  const std::vector<Miss> wrong = coupled->wrong_voxels(1000000);
  EXPECT_EQ(wrong.size(), direct.through + direct.under);
  const int w = design.width + 2 * setting.border;
  const auto size = static_cast<std::size_t>(w * (design.height + 2 * setting.border));
  for (const Miss& miss : wrong) {
    const double middle = direct.middle[static_cast<std::size_t>(miss.slice) * size +
                                        static_cast<std::size_t>((miss.y + setting.border) * w +
                                                                 miss.x + setting.border)];
    const int cover = design.of(miss.x, miss.y, miss.slice);
    EXPECT_TRUE(cover == 255 ? middle < 1 : cover == 0 && middle >= 1)
        << miss.slice << " " << miss.y << " " << miss.x << " " << middle;
  }
  EXPECT_EQ(coupled->wrong_voxels(3).size(), 3);
}

TEST(Coupled, MendsMostOfWhatSpreadSpoils) {
  const Design design = block();
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  for (const double sigma_px : {0.3, 0.8, 1.5}) {
    Setting setting{.sigma_px = sigma_px};
    setting.border = 10;
    Coupled coupled(design, plan, setting);
    coupled.run();
    EXPECT_LT(coupled->best().wrong() * 20, coupled->columns_alone().wrong()) << sigma_px;
    EXPECT_LT(coupled->best().loss * 100, coupled->columns_alone().loss) << sigma_px;
  }
}

TEST(Coupled, IsNeverWorseThanColumnsAlone) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const Design design = random_design(seed);
    const double m = seed % 3 == 0 ? 0.8 : 1;
    CureModel model = test::figure_2_2(seed % 2 ? 1000 : 2500);
    model.m = m;
    const CorrectionPlan plan = plan_of(design, model);
    Setting setting{
        .sigma_px = seed % 3 == 1 ? 0.4 : 1.1, .kappa = seed % 2 ? 0.0 : 1.5, .rounds = 3};
    setting.border = 8;
    Coupled coupled(design, plan, setting);
    const Direct before = judge(design, plan, coupled.levels(design), setting);
    coupled.run();
    const Direct after = judge(design, plan, coupled.levels(design), setting);
    EXPECT_LE(after.through + after.under, before.through + before.under) << seed;
    EXPECT_EQ(after.through, coupled->best().through) << seed;
    EXPECT_EQ(after.under, coupled->best().under) << seed;
  }
}

TEST(Coupled, CornersOfTheEndGetTheSlicesThatTheyNeed) {
  const auto slices = [](const CureModel& model, double phi) {
    return static_cast<int>(std::ceil(std::log10(phi / (phi - 1)) / model.eta - 1e-9));
  };
  for (const double exposure : {500.0, 1000.0, 2000.0}) {
    const CureModel model = test::figure_2_2(exposure);
    const int most = static_cast<int>(std::ceil(1 / model.eta));
    EXPECT_EQ(detail::slices_to_gel_at_edges(model, {}), model.slices_to_gel());
    for (const double sigma_px : {0.3, 0.8, 1.5}) {
      const LightBlur blur(spread_of(sigma_px), kPixelUm, kPixelUm);
      // What the middle of a pixel gets from one side, itself included.
      const double side = (1 + share(0, sigma_px)) / 2;
      const auto light = [&](double part) {
        return model.phi_min() + part * (model.phi_max() - model.phi_min());
      };
      int expected = model.slices_to_gel();
      for (const double part : {side, side * side}) {
        if (light(part) > 1)
          expected = std::max(expected, std::min(most, slices(model, light(part))));
      }
      EXPECT_EQ(detail::slices_to_gel_at_edges(model, blur), expected) << sigma_px;
    }
  }
}

TEST(Coupled, EdgesOfTheEndCureBetterWithTheSlicesThatTheyNeed) {
  Design design(30, 30, 24);
  design.fill({6, 6, 24, 24}, 0, 24, 255);
  const CureModel model = test::figure_2_2();
  const LightBlur blur(spread_of(1.5), kPixelUm, kPixelUm);
  const int edges = detail::slices_to_gel_at_edges(model, blur);
  ASSERT_GT(edges, model.slices_to_gel());
  std::uint64_t under[2];
  double loss[2];
  for (const int k : {0, 1}) {
    const CorrectionPlan plan(model, test::process(1000), design.layers,
                              design.layers + (k ? edges : model.slices_to_gel()));
    Setting setting{.sigma_px = 1.5};
    setting.border = 10;
    Coupled coupled(design, plan, setting);
    coupled.run();
    const Direct direct = judge(design, plan, coupled.levels(design), setting);
    under[k] = direct.under;
    loss[k] = direct.loss;
  }
  EXPECT_LT(under[1], under[0]);
  EXPECT_LT(loss[1], loss[0]);
}

TEST(Coupled, FewLevelsHandOnInThePlane) {
  const Design design = block();
  for (const int levels : {4, 16}) {
    CureModel model = test::figure_2_2();
    const double black = model.phi_min(), full = model.phi_max();
    model.level_phi.clear();
    for (int l = 0; l < levels; ++l) {
      model.level_phi.push_back(black + (full - black) * l / (levels - 1));
    }
    const CorrectionPlan plan = plan_of(design, model);
    std::uint64_t wrong[2] = {};
    for (const int on : {0, 1}) {
      for (const double sigma_px : {0.6, 0.8, 1.2}) {
        Setting setting{.sigma_px = sigma_px};
        setting.border = 10;
        setting.hand_on = on != 0;
        Coupled coupled(design, plan, setting);
        coupled.run();
        wrong[on] += coupled->best().wrong();
      }
    }
    EXPECT_LT(wrong[1], wrong[0]) << levels;
  }
}

TEST(Coupled, NarrowSpreadsAndManyLevelsHandNothingOn) {
  const Design design = block();
  CureModel few = test::figure_2_2();
  few.level_phi = {few.phi_min(), 2, 4, few.phi_max()};
  const auto hands_on = [&](const CureModel& model, double sigma_px) {
    const CorrectionPlan plan = plan_of(design, model);
    const LightBlur blur(spread_of(sigma_px), kPixelUm, kPixelUm);
    return detail::CoupledPlan(plan, blur, {0, 0, design.width, design.height}, 0, {}).hands_on;
  };
  for (const double sigma_px : {0.0, 0.3, 0.45}) EXPECT_FALSE(hands_on(few, sigma_px)) << sigma_px;
  EXPECT_TRUE(hands_on(few, 0.5));
  EXPECT_FALSE(hands_on(test::figure_2_2(), 0.5));
}

TEST(Coupled, TakesLightThatGoesFarAndLightThatGoesOneWay) {
  const Design design = block();
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  ExecutionContext context;
  context.threads = 2;
  // Most light stays near, some goes further than a patch; a picture that sends light to the right;
  // and nothing but scatter.
  const SpreadPicture right{
      3, 1, kPixelUm,
      std::make_shared<const std::vector<std::uint8_t>>(std::vector<std::uint8_t>{0, 200, 50})};
  const LightSpread spreads[] = {{{{30, 0.9}, {300, 0.1}}, std::nullopt}, {{}, right}, {}};
  for (const LightSpread& spread : spreads) {
    const std::vector<DistanceBlur> distances = distances_of(model, spread, spread.none() ? 3 : 0);
    const LightBlur blur =
        distances.empty() ? LightBlur(spread, kPixelUm, kPixelUm) : distances.front().blur;
    CoupledCorrection coupled(plan, blur, {0, 0, design.width, design.height},
                              {-2, -2, design.width + 2, design.height + 2},
                              options_of({.rounds = 3, .patch_px = 16}, distances));
    coupled.solve_columns(reader_of(design), false, context);
    while (coupled.improve(context)) {
    }
    EXPECT_GT(coupled.last().round, 0);
    EXPECT_LT(coupled.best().wrong() * 2, coupled.columns_alone().wrong());
  }
}

TEST(Coupled, SameBytesForAnyNumberOfThreads) {
  const Design design = block();
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  std::vector<std::uint8_t> first;
  for (const int threads : {1, 2, 3}) {
    Setting setting{.rounds = 4, .threads = threads, .patch_px = 16};
    Coupled coupled(design, plan, setting);
    coupled.run();
    const auto levels = coupled.levels(design);
    if (first.empty()) first = levels;
    EXPECT_EQ(first, levels) << threads;
  }
}

TEST(Coupled, LeavesAloneWhatNothingViolated) {
  // A body with a wide cavity: far from walls the faces of the cavity are as columns alone have them.
  Design design(120, 110, 30);
  design.fill({5, 5, 115, 105}, 0, 26, 255);
  design.fill({20, 20, 100, 90}, 8, 14, 0);
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  const Setting setting{.rounds = 4};
  Coupled coupled(design, plan, setting);
  const auto before = coupled.levels(design);
  coupled.run();
  const auto after = coupled.levels(design);
  EXPECT_NE(before, after);
  for (int n = 0; n < plan.all_layers; ++n) {
    for (int y = 50; y < 60; ++y) {
      for (int x = 50; x < 70; ++x) {
        ASSERT_EQ(before[design.at(x, y, n)], after[design.at(x, y, n)])
            << n << " " << y << " " << x;
      }
    }
  }
}

TEST(Coupled, PatchesBesideTheDesignStayBlack) {
  // The last row of patches lies below the design, and only gets light from it.
  Design design(40, 32, 12);
  design.fill({0, 0, 40, 32}, 0, 12, 255);
  design.fill({8, 8, 12, 24}, 2, 9, 0);
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  Setting setting{.rounds = 6, .patch_px = 8};
  setting.border = 8;
  Coupled coupled(design, plan, setting);
  coupled.run();
  ASSERT_GT(coupled->best().round, 1);
  const Direct direct = judge(design, plan, coupled.levels(design), setting);
  EXPECT_EQ(coupled->best().through, direct.through);
  EXPECT_EQ(coupled->best().under, direct.under);
}

TEST(Coupled, WithoutSpreadColumnsStay) {
  const Design design = random_design(11);
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  Coupled coupled(design, plan, {.sigma_px = 0});
  const auto before = coupled.levels(design);
  for (int y = 0; y < design.height; ++y) {
    for (int x = 0; x < design.width; ++x) {
      std::vector<std::uint8_t> column;
      for (int n = 0; n < design.layers; ++n) column.push_back(design.of(x, y, n));
      const auto alone = solve_column(plan, column);
      for (int n = 0; n < plan.all_layers; ++n) {
        ASSERT_EQ(alone[static_cast<std::size_t>(n)], before[design.at(x, y, n)]);
      }
    }
  }
}

TEST(Coupled, ReadsAnyBox) {
  const Design design = block();
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  Coupled coupled(design, plan, {.rounds = 1});
  coupled.run();
  const std::vector<std::uint8_t> all = coupled.levels(design);
  const PixelBox box{3, 7, 40, 21};
  int next = 0;
  coupled->read(box, [&](int n, const std::uint8_t* slice) {
    ASSERT_EQ(n, next++);
    std::size_t k = 0;
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x, ++k) {
        ASSERT_EQ(slice ? slice[k] : 0, all[design.at(x, y, n)]) << n << " " << y << " " << x;
      }
    }
  });
  EXPECT_EQ(next, plan.all_layers);
}

TEST(Coupled, HoldsFewBytes) {
  // Coverage, the columns' levels, those of the last round and the best ones, run-length coded.
  Design design(200, 200, 60);
  design.fill({20, 20, 180, 180}, 0, 56, 255);
  design.fill({60, 60, 120, 120}, 20, 30, 0);
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  Coupled coupled(design, plan, {.rounds = 2, .patch_px = 128});
  coupled.run();
  const auto voxels = static_cast<double>(design.coverage.size());
  EXPECT_LT(static_cast<double>(coupled->bytes()), 0.5 * voxels);
}

TEST(Coupled, LayerByLayer) {
  const Design design = block();
  Process process;
  process.mode = ExposureMode::layerwise;
  for (const bool bottom : {false, true}) {
    for (const auto& [ha_um, gain] : {std::pair{110.0, 2.0}, {600.0, 5.0}}) {
      // Two and a half times what a layer needs at full light (A.52); at the platform three times
      // that, fading.
      process.exposure_s =
          2.5 * 576 * 110e-4 * std::pow(10, kLayerUm / ha_um) / (100 * std::log(10.0));
      if (bottom) {
        process.bottom_exposure_s = 3 * process.exposure_s;
        process.bottom_layers = 3;
        process.fade_layers = 4;
      }
      SCOPED_TRACE(::testing::Message() << bottom << " " << ha_um);
      const CureModel model = make_cure_model(test::linear_printer(1, 100),
                                              test::resin(576 * 110 / ha_um, ha_um), process, 50);
      const CorrectionPlan plan = test::plan_for(model, process, design.layers);
      Setting setting{.rounds = 4, .patch_px = 16};
      setting.border = 8;
      Coupled coupled(design, plan, setting);
      for (int round = 0; round < 2; ++round) {
        const Direct direct = judge(design, plan, coupled.levels(design), setting);
        EXPECT_EQ(coupled->best().through, direct.through) << round;
        EXPECT_EQ(coupled->best().under, direct.under) << round;
        EXPECT_EQ(coupled->best().parted, direct.parted) << round;
        EXPECT_NEAR(coupled->best().loss, direct.loss, 1e-5 * direct.loss + 1e-9) << round;
        coupled.run();
      }
      // Light that fades within two layers does little harm.
      EXPECT_GT(coupled->columns_alone().wrong(), 200);
      EXPECT_LT(static_cast<double>(coupled->best().wrong()) * gain,
                static_cast<double>(coupled->columns_alone().wrong()));
    }
  }
}

TEST(Coupled, LightThatIsUneven) {
  const Design design = block();
  for (const double m : {1.0, 0.8}) {
    CureModel model = test::figure_2_2();
    model.m = m;
    const CorrectionPlan plan = plan_of(design, model);
    Setting setting{.rounds = 4, .patch_px = 16};
    setting.border = 8;
    setting.uneven = 0.6;
    Coupled coupled(design, plan, setting);
    for (int round = 0; round < 2; ++round) {
      const Direct direct = judge(design, plan, coupled.levels(design), setting);
      EXPECT_EQ(coupled->best().through, direct.through) << m << " " << round;
      EXPECT_EQ(coupled->best().under, direct.under) << m << " " << round;
      EXPECT_NEAR(coupled->best().loss, direct.loss, 1e-5 * direct.loss + 1e-9) << m;
      coupled.run();
    }
    EXPECT_LT(coupled->best().wrong() * 10, coupled->columns_alone().wrong()) << m;
  }
}

TEST(Coupled, LeftAloneStaysAndTheRestIsCorrectedAroundIt) {
  Design design = block();
  // A support beside the wall and one under the overhang.
  design.leave_alone({2, 12, 5, 16}, 0, 36, 255);
  design.leave_alone({29, 14, 31, 17}, 10, 18, 180);
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  Setting setting{.rounds = 4, .patch_px = 16};
  setting.border = 8;
  Coupled coupled(design, plan, setting);
  coupled.run();
  const auto levels = coupled.levels(design);
  for (std::size_t k = 0; k < design.left_alone.size(); ++k) {
    if (design.left_alone[k] != 0) {
      ASSERT_EQ(levels[k], design.left_alone[k]) << k;
    }
  }
  const Direct direct = judge(design, plan, levels, setting);
  EXPECT_EQ(coupled->best().through, direct.through);
  EXPECT_EQ(coupled->best().under, direct.under);
  EXPECT_LT(coupled->best().wrong() * 3, coupled->columns_alone().wrong());
}

TEST(Coupled, StopsWhenCancelled) {
  const Design design = block();
  const CureModel model = test::figure_2_2();
  const CorrectionPlan plan = plan_of(design, model);
  Coupled coupled(design, plan, {});
  const std::atomic<bool> cancel{true};
  ExecutionContext context;
  context.cancel = &cancel;
  EXPECT_THROW(coupled->improve(context), Cancelled);
  EXPECT_EQ(coupled->last().round, 0);
}

}  // namespace
}  // namespace slicecorr::test::together
