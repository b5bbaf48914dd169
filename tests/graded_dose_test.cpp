// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses that are wanted of features: closed forms first, then what columns print.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::column;

constexpr double kHeightUm = 2000;

TEST(GradedDose, LightThatHoldsASlope) {
  // From 2 down to 1 over a millimetre: where the dose is 1.5.
  EXPECT_NEAR(graded_phi(kHeightUm, 1.5, -1e-3), 2.36859, 5e-6);
  EXPECT_NEAR(graded_phi(kHeightUm, 1.5, 1e-3), 0.63141, 5e-6);
  EXPECT_EQ(graded_phi(kHeightUm, 1.5, 0), 1.5);
}

TEST(GradedDose, LeastHeightsOfSteps) {
  EXPECT_NEAR(fall_height_um(kHeightUm, 2, 1, 6.25), 183.54, 5e-3);
  EXPECT_NEAR(rise_height_um(kHeightUm, 1, 2, 0.0625), 630.54, 5e-3);
  EXPECT_EQ(fall_height_um(kHeightUm, 1, 1, 6.25), 0);
  EXPECT_EQ(rise_height_um(kHeightUm, 2, 1, 0.0625), 0);
  EXPECT_TRUE(std::isinf(fall_height_um(kHeightUm, 7, 1, 6.25)));
  EXPECT_TRUE(std::isinf(rise_height_um(kHeightUm, 1, 2, 1.5)));
}

/// A column of which doses are wanted, and what it prints.
struct Printed {
  std::vector<std::uint8_t> levels;
  ColumnDose dose;
  Printed(const CureModel& model, const DoseScale& scale, const std::vector<std::uint8_t>& coverage,
          const std::vector<std::uint8_t>& bytes) {
    const CorrectionPlan plan =
        test::plan_for(model, test::process(1000), static_cast<int>(coverage.size()));
    levels = solve_graded_column(plan, scale, coverage, bytes);
    std::vector<std::uint8_t> pixels;
    for (const std::uint8_t l : levels) {
      pixels.push_back(static_cast<std::uint8_t>(pixel_of_level(l, plan.levels.size())));
    }
    dose = column_dose(model, pixels);
  }
};

CureModel model_of_layers(double layer_um, int bit_depth = 8) {
  return make_cure_model(test::linear_printer(1, 100, bit_depth), test::resin(576, kHeightUm),
                         test::process(1000), layer_um);
}

/// Greatest effect of one level on the dose of a node.
double level_dose(const CureModel& model) {
  double most = 0;
  for (std::size_t l = 1; l < model.level_phi.size(); ++l) {
    most = std::max(most, (model.level_phi[l] - model.level_phi[l - 1]) * model.one_minus_a);
  }
  return most;
}

DoseScale scale_to(double most, DoseSide side = DoseSide::nearest) {
  DoseScale scale = DoseScale::even(most);
  scale.side = side;
  return scale;
}

TEST(GradedDose, AnEvenDoseIsHeldToHalfALevel) {
  const CureModel model = model_of_layers(50);
  const auto coverage = column(200, {{0, 179}});
  const Printed p(model, scale_to(2), coverage, std::vector<std::uint8_t>(200, 255));
  // All but the climb at the end, and rounding does not pile up.
  for (std::size_t n = 0; n < 170; ++n) {
    EXPECT_NEAR(p.dose.upper[n], 2.0, 0.51 * level_dose(model)) << n;
  }
}

TEST(GradedDose, ASlopeIsHeldAndItsLightIsThatOfTheClosedForm) {
  const CureModel model = model_of_layers(10);
  constexpr int layers = 400;
  const auto coverage = column(layers, {{0, 379}});
  // From 2 at 1 mm to 1 at 2 mm.
  std::vector<std::uint8_t> bytes(layers, 0);
  const DoseScale scale = scale_to(2);
  for (int n = 0; n < layers; ++n) {
    const double t = std::clamp(2.0 - ((n + 0.5) * 10 - 1000) / 1000, 1.0, 2.0);
    bytes[static_cast<std::size_t>(n)] = static_cast<std::uint8_t>(std::lround((t - 1) * 255));
  }
  const Printed p(model, scale, coverage, bytes);
  for (std::size_t n = 0; n < 370; ++n) {
    const double wanted = scale.dose[bytes[n]];
    // A byte of the scale is 1 / 255.
    EXPECT_NEAR(p.dose.middle[n], wanted, level_dose(model) + 1.0 / 255) << n;
  }
  double phi = 0;
  for (std::size_t n = 125; n < 175; ++n) phi += model.level_phi[p.levels[n]] / 50;
  // What is left of rounding at both ends of 50 slices: half a level's dose each, a 50th of it.
  EXPECT_NEAR(phi, 2.36859, 2 * (level_dose(model) + 1.0 / 255) / model.one_minus_a / 50);
}

/// T is `first` up to layer 100, then `second`.
std::vector<std::uint8_t> step_at_100(int layers, std::uint8_t first, std::uint8_t second) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(layers), second);
  std::fill_n(bytes.begin(), 100, first);
  return bytes;
}

TEST(GradedDose, StepsAreMetFromTheSideThatIsNamed) {
  const CureModel model = model_of_layers(20);
  constexpr int layers = 300;
  const auto coverage = column(layers, {{0, 279}});
  const double one = level_dose(model) + 1e-9;
  const double fall = fall_height_um(kHeightUm, 2, 1, model.phi_max()) / 20;
  const double rise = rise_height_um(kHeightUm, 1, 2, model.phi_min()) / 20;
  for (const bool falls : {true, false}) {
    const auto bytes = falls ? step_at_100(layers, 255, 0) : step_at_100(layers, 0, 255);
    double worst[3] = {};
    for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
      const DoseScale scale = scale_to(2, side);
      const Printed p(model, scale, coverage, bytes);
      int off = 0;
      for (std::size_t n = 0; n < 265; ++n) {
        const double wanted = scale.dose[bytes[n]], dose = p.dose.middle[n];
        if (side == DoseSide::at_least) {
          EXPECT_GE(dose, wanted - 1e-9) << n;
        }
        // Features print: where 1 is wanted, rounding goes up.
        if (side == DoseSide::at_most) {
          EXPECT_LE(dose, wanted + (wanted > 1 ? 1e-9 : one)) << n;
        }
        EXPECT_GE(dose, 1.0) << n;
        worst[static_cast<int>(side)] =
            std::max(worst[static_cast<int>(side)], std::abs(dose - wanted));
        off += std::abs(dose - wanted) > 2 * one ? 1 : 0;
      }
      // The dose is off no longer than the step must take, and a slice at either end.
      // Half way it is off by half as much for twice as long.
      const double slices = (falls ? fall : rise) * (side == DoseSide::nearest ? 2 : 1);
      EXPECT_LE(off, slices + 2) << falls << static_cast<int>(side);
    }
    EXPECT_LE(worst[0], std::max(worst[1], worst[2]) / 2 + 2 * one);
  }
}

TEST(GradedDose, RandomDosesAreNowhereTooLowOrNowhereTooHigh) {
  std::mt19937 random(23);
  const CureModel model = model_of_layers(20);
  constexpr int layers = 200;
  const auto coverage = column(layers, {{0, 179}});
  const double one = level_dose(model) + 1e-9;
  // From 1 at its end a feature climbs to 2 in so many slices.
  const auto climb = static_cast<std::size_t>(
      std::ceil(fall_height_um(kHeightUm, 2, 1, model.phi_max()) / 20) + 1);
  for (int k = 0; k < 100; ++k) {
    std::vector<std::uint8_t> bytes;
    while (bytes.size() < layers) {
      bytes.insert(bytes.end(), 1 + random() % 30, static_cast<std::uint8_t>(random() % 256));
    }
    bytes.resize(layers);
    double off[3] = {};
    for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
      const DoseScale scale = scale_to(2, side);
      const Printed p(model, scale, coverage, bytes);
      for (std::size_t n = 0; n + climb < 180; ++n) {
        const double wanted = scale.dose[bytes[n]], dose = p.dose.middle[n];
        off[static_cast<int>(side)] =
            std::max(off[static_cast<int>(side)], std::abs(dose - wanted));
        if (side == DoseSide::at_least) {
          ASSERT_GE(dose, wanted - 1e-9) << k << " " << n;
        }
        // Features print: near 1 rounding goes up.
        if (side == DoseSide::at_most) {
          ASSERT_LE(dose, std::max(wanted + 1e-9, 1 + one)) << k << " " << n;
        }
        ASSERT_GE(dose, 1.0);
      }
    }
    // A step that light follows within a slice is met at the node between its layers.
    const double followed = (model.phi_max() - 1) * model.one_minus_a / 4;
    EXPECT_LE(off[0], std::max(off[1], off[2]) / 2 + 2 * one + followed) << k;
  }
}

TEST(GradedDose, GapsStayOpenAndFeaturesPrint) {
  const CureModel model = model_of_layers(50);
  const auto coverage = column(200, {{0, 79}, {90, 150}});
  const Printed p(model, scale_to(3), coverage, std::vector<std::uint8_t>(200, 255));
  const CorrectionPlan plan = test::plan_for(model, test::process(1000), 200);
  for (std::size_t n = 0; n < 200; ++n) {
    EXPECT_EQ(p.dose.middle[n] >= 1.0, coverage[n] == 255) << n;
  }
  // Edges lie where the ordinary correction has them.
  EXPECT_NEAR(p.dose.upper[80], 1.0, 0.01);
  EXPECT_NEAR(p.dose.upper[90], 1.0, 0.01);
}

TEST(GradedDose, FeaturesBetweenGapsAreNoBrighterThanWanted) {
  // Two edges, and the slices before them, are chosen by what edges need: 4 % of the levels of
  // three slices are room for that.
  const CureModel model = model_of_layers(50);
  const auto coverage = column(50, {{11, 20}, {31, 40}});
  const double room = 1.5 * 11 * level_dose(model);
  for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
    DoseScale scale = scale_to(2, side);
    const Printed p(model, scale, coverage, std::vector<std::uint8_t>(50, 0));
    for (std::size_t n = 0; n < 50; ++n) {
      if (coverage[n] != 255) continue;
      EXPECT_NEAR(p.dose.middle[n], 1 + room / 2, room / 2 + 1e-9) << n;
    }
  }
}

std::vector<std::uint8_t> random_coverage(std::mt19937& random, std::size_t layers, int shortest) {
  std::vector<std::uint8_t> coverage;
  bool full = random() % 2 != 0;
  while (coverage.size() < layers) {
    coverage.insert(coverage.end(), static_cast<std::size_t>(shortest) + random() % 30,
                    full ? 255 : 0);
    full = !full;
  }
  coverage.resize(layers);
  return coverage;
}

TEST(GradedDose, NoVoxelOfRandomColumnsIsWrongThatNeedNotBe) {
  std::mt19937 random(11);
  for (const int bits : {8, 4}) {
    for (const DoseSide side : {DoseSide::nearest, DoseSide::at_least, DoseSide::at_most}) {
      const CureModel model = model_of_layers(50, bits);
      const CorrectionPlan plan = test::plan_for(model, test::process(1000), 200);
      for (int k = 0; k < 100; ++k) {
        const auto coverage = random_coverage(random, 200, 1 + k % 3);
        std::vector<std::uint8_t> bytes;
        while (bytes.size() < 200) {
          bytes.insert(bytes.end(), 1 + random() % 40, static_cast<std::uint8_t>(random() % 256));
        }
        const auto ordinary = solve_column(plan, coverage);
        std::vector<std::uint8_t> pixels;
        for (const std::uint8_t l : ordinary) {
          pixels.push_back(static_cast<std::uint8_t>(pixel_of_level(l, plan.levels.size())));
        }
        const ColumnDose before = column_dose(model, pixels);
        const Printed p(model, scale_to(1 + k % 5, side), coverage, bytes);
        for (std::size_t n = 0; n < coverage.size(); ++n) {
          if ((before.middle[n] >= 1.0) != (coverage[n] == 255)) continue;
          ASSERT_EQ(p.dose.middle[n] >= 1.0, coverage[n] == 255)
              << bits << " bits, column " << k << " layer " << n;
        }
      }
    }
  }
}

TEST(GradedDose, BandsGiveTheSameAsColumns) {
  std::mt19937 random(5);
  const CureModel model = model_of_layers(50);
  constexpr std::size_t columns = 150, layers = 130;
  const CorrectionPlan plan = test::plan_for(model, test::process(1000), layers);
  const DoseScale scale = scale_to(2.5);
  std::vector<std::vector<std::uint8_t>> coverage, doses;
  for (std::size_t i = 0; i < columns; ++i) {
    coverage.push_back(random_coverage(random, layers, 2));
    std::vector<std::uint8_t> bytes(layers);
    for (std::size_t n = 0; n < layers; ++n) bytes[n] = static_cast<std::uint8_t>(n * 2);
    doses.push_back(bytes);
  }
  BandCorrector corrector(plan, columns, {&scale, [&](int n, std::uint8_t* out) {
                                            for (std::size_t i = 0; i < columns; ++i) {
                                              out[i] = doses[i][static_cast<std::size_t>(n)];
                                            }
                                          }});
  std::vector<std::uint8_t> row(columns);
  for (std::size_t n = 0; n < layers; ++n) {
    for (std::size_t i = 0; i < columns; ++i) row[i] = coverage[i][n];
    corrector.add_layer(row.data());
  }
  std::vector<std::vector<std::uint8_t>> levels(columns);
  corrector.solve([&](int n, const std::uint8_t* shown, const std::uint8_t* design, bool) {
    for (std::size_t i = 0; i < columns; ++i) {
      if (levels[i].empty()) levels[i].resize(static_cast<std::size_t>(plan.all_layers));
      levels[i][static_cast<std::size_t>(n)] = shown[i];
      const bool inside = static_cast<std::size_t>(n) < layers;
      EXPECT_EQ(design[i], inside ? coverage[i][static_cast<std::size_t>(n)] : 0);
    }
  });
  for (std::size_t i = 0; i < columns; ++i) {
    EXPECT_EQ(levels[i], solve_graded_column(plan, scale, coverage[i], doses[i])) << i;
  }
}

/// A target of two blocks and its doses, on a display whose right half is dimmer, or is not.
struct Plate {
  Setup setup;
  test::MemorySlices target, bytes;
  DoseTarget doses;
  static Grid grid(int layers) { return {16, 16, layers, 50, 50, 50}; }
  explicit Plate(bool uneven)
      : setup{test::linear_printer(1, 100), test::resin(576, kHeightUm), test::process(1000)},
        target(grid(120)),
        bytes(grid(120)) {
    if (uneven) {
      FlatField field;
      field.width_px = 2;
      field.height_px = 1;
      field.values =
          std::make_shared<const std::vector<std::uint8_t>>(std::vector<std::uint8_t>{255, 180});
      setup.printer.flat_field = field;
    }
    for (int n = 0; n < 120; ++n) {
      for (int y = 2; y < 14; ++y) {
        for (int x = 2; x < 14; ++x) {
          target.at(n, x, y) = n < 60 || n >= 75 ? 255 : 0;
          bytes.at(n, x, y) = static_cast<std::uint8_t>(x * 8 + n);
        }
      }
    }
    doses.images = &bytes;
    doses.scale = DoseScale::even(2);
    name_ranges(doses);
  }
};

TEST(GradedDose, StacksAreMeasuredAsTheyAreVerified) {
  const test::TemporaryFolder folder;
  for (const bool uneven : {false, true}) {
    SCOPED_TRACE(uneven);
    const Plate plate(uneven);
    const GradedTarget graded(plate.target, plate.doses);
    const std::string path = folder / "out.uvj";
    const Correction made = correct_stack(graded, plate.setup, StackFile(path), {.before = true});
    EXPECT_EQ(made.after.undercure_voxels + made.after.cure_through_voxels, 0U);
    ASSERT_EQ(made.after.regions.size(), 8U);
    const StackReader stack(path, folder.path());
    const Prediction told = verify_stack(stack, graded, plate.setup);
    EXPECT_EQ(told.to_json(), made.after.to_json());
    std::uint64_t voxels = 0;
    for (const RegionDose& r : told.regions) {
      voxels += r.voxels;
      EXPECT_GE(r.least, 1.0);
      EXPECT_LE(r.mean_off(), std::max(r.most_above, r.most_below));
    }
    EXPECT_EQ(voxels, told.target_voxels);
    // What is read without a file is what the file has.
    const CorrectedSlices slices(graded, plate.setup);
    EXPECT_TRUE(test::MemorySlices(slices) == test::MemorySlices(stack));
    // The first block lies on the platform: there its doses are free.
    const ProbeRow first = probe_stack(stack, nullptr, plate.setup, 12, 8)[0];
    EXPECT_NEAR(first.dose_middle, plate.doses.scale.dose[12 * 8], 0.01);
  }
}

/// Doses in the middle of voxels by sums over all slices and pixels, of light that spreads by a Gaussian of
/// 35 um: in figure 2.2's process 16 mW/cm² hold a dose of 1.
std::vector<double> doses_by_sums(const test::MemorySlices& shown, int layers) {
  const int all = shown.grid().layers;
  const auto share = [](int x) {
    const double scale = 35 / 50.0 * std::sqrt(2.0);
    return (std::erf((x + 0.5) / scale) - std::erf((x - 0.5) / scale)) / 2;
  };
  std::vector<double> doses(static_cast<std::size_t>(layers) * 256, 0.0), light(256);
  for (int k = 0; k < all; ++k) {
    for (int p = 0; p < 256; ++p) {
      double& sum = light[static_cast<std::size_t>(p)] = 0;
      for (int q = 0; q < 256; ++q) {
        sum += share(p % 16 - q % 16) * share(p / 16 - q / 16) *
               (1 + 99.0 * shown.at(k, q % 16, q / 16) / 255) / 16;
      }
    }
    for (int n = 0; n <= std::min(k, layers - 1); ++n) {
      const double fall = 50 / kHeightUm, from = std::max(0.0, k - n - 0.5), to = k - n + 0.5;
      const double part = std::pow(10, -from * fall) - std::pow(10, -to * fall);
      for (std::size_t p = 0; p < 256; ++p) {
        doses[static_cast<std::size_t>(n) * 256 + p] += part * light[p];
      }
    }
  }
  return doses;
}

// Where light spreads, columns alone are too dim beside gaps and beside others that want less.
TEST(GradedDose, WhereLightSpreadsColumnsTogetherHaveTheirDoses) {
  Plate plate(false);
  plate.setup.printer.spread.gaussians = {{35, 1}};
  for (int n = 0; n < 120; ++n) {
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) plate.bytes.at(n, x, y) = x < 8 ? 0 : 153;
    }
  }
  const GradedTarget graded(plate.target, plate.doses);
  double off[2] = {};
  std::uint64_t wrong[2] = {};
  for (const int together : {0, 1}) {
    plate.setup.process.spread_rounds = together ? Process::kDefaultSpreadRounds : 0;
    const test::MemorySlices shown(CorrectedSlices(graded, plate.setup));
    const Prediction told = verify_stack(shown, graded, plate.setup);
    const std::vector<double> doses = doses_by_sums(shown, 120);
    double sum = 0, inside = 0;
    std::size_t count = 0, counted = 0;
    int near = 0;
    for (int n = 0; n < 120; ++n) {
      for (int p = 0; p < 256; ++p) {
        const int x = p % 16, y = p / 16;
        const bool feature = plate.target.at(n, x, y) == 255;
        const double dose = doses[static_cast<std::size_t>(n) * 256 + static_cast<std::size_t>(p)];
        wrong[together] += (dose >= 1) != feature;
        near += std::abs(dose - 1) < 1e-5;
        if (!feature) continue;
        ++count;
        sum += dose;
        // Far from gaps in all directions.
        if (x < 3 || x > 12 || y < 3 || y > 12 || n < 10 || n > 109 || (n > 45 && n < 90)) continue;
        ++counted;
        inside += std::abs(dose - (x < 8 ? 1.0 : 1.6));
      }
    }
    off[together] = inside / static_cast<double>(counted);
    std::uint64_t voxels = 0;
    double mean = 0;
    for (const RegionDose& r : told.regions) {
      voxels += r.voxels;
      mean += static_cast<double>(r.voxels) * r.mean();
    }
    EXPECT_EQ(voxels, count);
    // Sums in single and double precision, of weights to 1e-6.
    EXPECT_NEAR(mean, sum, 1e-5 * sum);
    const std::uint64_t said = told.undercure_voxels + told.cure_through_voxels;
    EXPECT_NEAR(static_cast<double>(said), static_cast<double>(wrong[together]), near);
  }
  EXPECT_LT(off[1], 0.5 * off[0]);
  EXPECT_LE(wrong[1], wrong[0]);
}

TEST(GradedDose, TargetsThatDoNotFitAreRefused) {
  const Plate plate(false);
  for (const Grid& other : {Grid{15, 16, 120, 50, 50, 50}, Grid{16, 17, 120, 50, 50, 50},
                            Grid{16, 16, 119, 50, 50, 50}, Grid{16, 16, 120, 51, 50, 50},
                            Grid{16, 16, 120, 50, 49, 50}, Grid{16, 16, 120, 50, 50, 100}}) {
    DoseTarget doses = plate.doses;
    const test::MemorySlices images(other);
    doses.images = &images;
    EXPECT_THROW(GradedTarget(plate.target, doses), InputError);
  }
  DoseTarget liquid = plate.doses;
  liquid.scale.dose[7] = 0.5;
  EXPECT_THROW(GradedTarget(plate.target, liquid), InputError);
  // Images without light, and a scale of ones, want nothing.
  const test::MemorySlices black(plate.target.grid());
  DoseTarget none = plate.doses;
  none.images = &black;
  EXPECT_EQ(GradedTarget(plate.target, none).doses(), nullptr);
  none = plate.doses;
  none.scale = DoseScale::even(1);
  EXPECT_EQ(GradedTarget(plate.target, none).doses(), nullptr);
  EXPECT_NE(GradedTarget(plate.target, plate.doses).doses(), nullptr);
}

TEST(GradedDose, ScalesAndSidesThatAreNone) {
  EXPECT_EQ(DoseScale::even(1).greatest(), 1.0);
  EXPECT_EQ(DoseScale::even(3).dose[255], 3.0);
  EXPECT_EQ(DoseScale::even(3).dose[0], 1.0);
  for (const double bad : {0.99, -1.0, std::numeric_limits<double>::infinity(),
                           std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW(DoseScale::even(bad), InputError) << bad;
  }
  EXPECT_EQ(dose_side_named("at-least"), DoseSide::at_least);
  EXPECT_THROW(dose_side_named("above"), InputError);
}

}  // namespace
}  // namespace slicecorr
