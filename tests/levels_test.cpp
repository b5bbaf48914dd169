// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Levels chosen together: voxels against all sequences of levels, edges against what is aimed at.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>

#include "models.hpp"
#include "printed_column.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {
namespace {

using Column = std::vector<std::uint8_t>;
using test::model_of;
using test::print;
using Printed = test::PrintedColumn;

/// The rules of a right print, apart from everything that the solve works with: doses at the lower
/// node of each layer from which the layers above it have been got right, as intervals.
class Possible {
 public:
  Possible(const CureModel& model, const Column& design, int slices)
      : model_(model), design_(design), slices_(slices) {
    for (const double p : model.level_phi) {
      if (phi_.empty() || p > phi_.back()) phi_.push_back(p);
    }
  }

  /// Whether some sequence of levels has no wrong voxel.
  bool any() const {
    std::vector<Range> doses = {{full(0) ? 1.0 : 0.0, full(0) ? 1e300 : 1.0}};
    for (int n = 0; n < slices_; ++n) {
      std::vector<Range> next;
      for (const double phi : phi_) {
        const Range own = allowed(n, phi);
        for (const Range& d : doses) {
          const Range w{std::max(own.lo, (d.lo - phi * model_.one_minus_a) / model_.a),
                        std::min(own.hi, (d.hi - phi * model_.one_minus_a) / model_.a)};
          if (w.lo <= w.hi) next.push_back(w);
        }
      }
      std::sort(next.begin(), next.end(), [](auto x, auto y) { return x.lo < y.lo; });
      doses.clear();
      for (const Range& w : next) {
        if (!doses.empty() && w.lo <= doses.back().hi) {
          doses.back().hi = std::max(doses.back().hi, w.hi);
        } else {
          doses.push_back(w);
        }
      }
      if (doses.empty()) return false;
    }
    return doses.front().lo <= 0;
  }

  /// The same by trying all sequences: few levels and slices only.
  bool any_by_trial() const { return trial(slices_ - 1, 0.0); }

 private:
  struct Range {
    double lo, hi;
  };
  bool full(int n) const {
    return n >= 0 && n < static_cast<int>(design_.size()) && design_[static_cast<std::size_t>(n)];
  }
  /// Doses at the lower node of layer n that are right with this light: its middle, 0.0001 of a
  /// slice beyond it where an edge is near, and the node itself where it is none.
  Range allowed(int n, double phi) const {
    Range w{0.0, 1e300};
    const bool below = n + 1 < slices_ && full(n + 1) != full(n);
    const bool above = n > 0 && full(n - 1) != full(n);
    for (const double f : {0.5, below ? 0.4999 : 0.5, above ? 0.5001 : 0.5}) {
      const double grown = std::pow(model_.a, -f);
      const double bound = grown - phi * (grown - 1.0);
      // A margin wider than that of the solve, which is for rounding.
      if (full(n)) w.lo = std::max(w.lo, bound + 1e-8 * grown);
      if (!full(n)) w.hi = std::min(w.hi, bound - 1e-8 * grown);
    }
    if (!below && full(n)) w.lo = std::max(w.lo, 1.0 + 1e-8);
    if (!below && !full(n) && n + 1 < slices_) w.hi = std::min(w.hi, 1.0 - 1e-8);
    return w;
  }
  bool trial(int n, double below) const {
    if (n < 0) return full(0) ? below >= 1.0 : below <= 1.0;
    for (const double phi : phi_) {
      const Range w = allowed(n, phi);
      if (below < w.lo || below > w.hi) continue;
      if (trial(n - 1, model_.step(phi, below))) return true;
    }
    return false;
  }

  const CureModel& model_;
  const Column& design_;
  int slices_;
  std::vector<double> phi_;
};

Column random_column(std::mt19937& random, unsigned least, unsigned most, std::size_t layers) {
  Column design;
  for (std::uint8_t c = random() % 2 ? 255 : 0; design.size() < layers;
       c = static_cast<std::uint8_t>(255 - c)) {
    design.insert(design.end(), least + random() % (most - least + 1), c);
  }
  return design;
}

/// Any process that can gel features and does not gel gaps.
CureModel random_model(std::mt19937& random, int bits) {
  std::uniform_real_distribution<double> unit(0, 1);
  const auto between = [&](double low, double high) {
    return low * std::pow(high / low, unit(random));
  };
  // Light to spare from a thousandth on.
  const double phi_max = 1.0 + between(0.001, 39);
  const double contrast = std::max(between(20, 1000), 1.2 * phi_max);
  return model_of(between(10, 100), between(100, 5000), phi_max, contrast, random() % 2 ? 1.0 : 3.0,
                  bits);
}

TEST(Levels, SequencesByTrialAndBySetsOfDosesAreTheSame) {
  // What the tests below rely on.
  std::mt19937 random(3);
  int possible = 0;
  const int rounds = test::rounds(150);
  for (int round = 0; round < rounds; ++round) {
    const CureModel model = random_model(random, 2);
    const Column design = random_column(random, 1, 3, 6);
    const int slices = std::min(slices_with_burst(model, static_cast<int>(design.size()),
                                                  static_cast<int>(design.size()) - 1),
                                9);
    const Possible sequences(model, design, slices);
    const bool any = sequences.any();
    ASSERT_EQ(any, sequences.any_by_trial()) << round;
    possible += any;
  }
  // Both kinds occur often.
  EXPECT_GT(possible, rounds / 8);
  EXPECT_LT(possible, rounds - rounds / 8);
}

TEST(Levels, NoVoxelIsWrongWhereSomeSequenceHasNoneAndFeaturesNeverAre) {
  std::mt19937 random(5);
  int possible = 0, impossible = 0;
  const int rounds = test::rounds(40);
  for (int round = 0; round < rounds; ++round) {
    const int bits = 4 + static_cast<int>(random() % 5);
    const CureModel model = random_model(random, bits);
    const unsigned longest[] = {1, 2, 4, 12, 25};
    const Column design = random_column(random, 1, longest[random() % 5], 40);
    const Printed printed = print(model, test::process(1000), design);
    ASSERT_EQ(printed.undercured, 0U) << round;
    const auto plan = test::plan_for(model, test::process(1000), static_cast<int>(design.size()));
    if (printed.cured_through == 0) {
      ++possible;
    } else {
      ++impossible;
      ASSERT_FALSE(Possible(model, design, plan.all_layers).any()) << round;
    }
  }
  EXPECT_GT(possible, rounds * 2 / 3);
  EXPECT_GT(impossible, rounds / 100);
}

TEST(Levels, GapsOfOneSliceCostWhatWasAllowed) {
  // Twelve gaps between features of five slices, with ever less light to spare.
  Column design(4, 0);
  for (int k = 0; k < 12; ++k) {
    design.insert(design.end(), 5, 255);
    design.push_back(0);
  }
  design.insert(design.end(), 5, 255);
  for (const double phi_max : {1.02, 1.2, 1.9, 2.5, 6.25, 10.0}) {
    double before = 0;
    for (const double shortfall : {0.05, kDefaultGapShortfall, 0.5}) {
      Process process = test::process(1000);
      process.gap_shortfall = shortfall;
      const Printed p = print(model_of(50, 1500, phi_max, 100, 1, 8), process, design);
      EXPECT_EQ(p.undercured + p.cured_through, 0U) << phi_max;
      EXPECT_LE(p.above_slits_um, 50 * shortfall + 0.01) << phi_max;
      // A hundredth of a slice, and half a step of levels where little light is to spare.
      EXPECT_LE(p.largest_um, 0.5) << phi_max;
      // What may be lost makes gaps darker, as far as there is darkness to win.
      EXPECT_GE(p.least_contrast, before * 0.98) << phi_max;
      before = p.least_contrast;
    }
  }
}

TEST(Levels, LittleLightToSpareLosesNoFeature) {
  // A bow's railing: posts under gaps of one slice, at 1.02 times the least light.
  for (const double phi_max : {1.001, 1.02, 1.5}) {
    for (const double gamma : {1.0, 3.0}) {
      for (const int bits : {8, 6, 4}) {
        Column design(3, 0);
        for (const int run : {6, 1, 2, 12, 1}) {
          design.insert(design.end(), static_cast<std::size_t>(run), 255);
          design.push_back(0);
        }
        design.insert(design.end(), 20, 255);
        const Printed p =
            print(model_of(50, 1500, phi_max, 100, gamma, bits), test::process(1000), design);
        EXPECT_EQ(p.undercured, 0U) << phi_max << " " << gamma << " " << bits;
      }
    }
  }
}

TEST(Levels, PlacesEdgesToAHundredthOfAStep) {
  // Runs of eight slices and more, so that each edge has all the levels before it to itself; one
  // level step moves an edge by more than a um.
  std::mt19937 random(17);
  std::vector<double> errors;
  for (int round = 0; round < 60; ++round) {
    const CureModel model = model_of(50, 1500, 5 + 10 * (round % 2), 100, round % 3 ? 1 : 3, 8);
    const Column design = random_column(random, 8, 25, 100);
    const Printed p = print(model, test::process(1000), design);
    ASSERT_EQ(p.undercured + p.cured_through, 0U);
    errors.push_back(p.largest_um);
  }
  std::sort(errors.begin(), errors.end());
  // Aimed at is 0.05 um; a tolerance that grows does so by a fifth.
  EXPECT_LE(errors[errors.size() / 2], 0.05 * 1.2);
  EXPECT_LE(errors.back(), 2.0);
}

constexpr double kGapsMayCostUm = 50 * kDefaultGapShortfall + 0.01;

/// 1.02 and 1.93 times the least light that gels at this speed. Gaps of one slice cost what they may, but with
/// 1.02 times, where no levels avoid it, `most_um`.
void expect_benchy_with_little_light(const char* length_mm, double most_um) {
  const std::string path = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(path);
  namespace fs = std::filesystem;
  const fs::path folder =
      fs::path(::testing::TempDir()) / ("slicecorr-levels-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  test::RunOptions options;
  options.folder = folder.string();
  options.environment = {{"SLICECORR_DB", SLICECORR_DB_DIR}};
  const auto call = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {SLICECORR_BIN_DIR "/slicecorr", "--quiet"});
    return test::run_program(words, options);
  };
  const std::vector<std::string> printer = {"--printer", "dual-wavelength-dlp"};
  for (const std::string surface : {"slices", "mesh"}) {
    ASSERT_EQ(call({"slice", path, "-o", "target.uvj", "--layer-um", "50", "--antialias", "off",
                    "--fit-mm", length_mm, "--surface", surface, printer[0], printer[1]})
                  .exit_code,
              0);
    for (const std::string dose : {"1764", "900"}) {
      // By day each surface and each dose once.
      if (!test::by_night() && (surface == "slices") != (dose == "1764")) continue;
      SCOPED_TRACE(surface + ", " + dose);
      const auto corrected =
          call({"correct", "target.uvj", "-o", "part.uvj", printer[0], printer[1], "--resin",
                "benchy-resin", "--speed-mm-h", "2000", "--dc-mj-cm3", dose});
      ASSERT_EQ(corrected.exit_code, 0) << corrected.err;
      const auto verified = call({"verify", "part.uvj", "--target", "target.uvj", "--json", "-"});
      ASSERT_EQ(verified.exit_code, 0) << verified.err;
      const auto j = nlohmann::json::parse(verified.out);
      EXPECT_EQ(j["undercure_voxels"], 0);
      EXPECT_EQ(j["cure_through_voxels"], 0);
      EXPECT_EQ(j["lost_features"], 0);
      EXPECT_LT(j["height_error_um"]["mean_abs"], 0.3);
      // Between the slices, where thinner gaps are, edges have only the middles of layers for a limit.
      const double of_slices = dose == "1764" ? most_um : kGapsMayCostUm;
      EXPECT_LE(j["height_error_um"]["max_abs"], surface == "mesh" ? 50 : of_slices);
    }
  }
  fs::remove_all(folder);
}

// An edge that is off by more than half a layer makes a voxel wrong.
TEST(Levels, SmallBenchyWithLittleLightToSpare) { expect_benchy_with_little_light("12", 25); }
// In its full size no gap costs more.
TEST(LevelsNight, BenchyWithLittleLightToSpare) {
  expect_benchy_with_little_light("25", 25);
  expect_benchy_with_little_light("60", kGapsMayCostUm);
}

}  // namespace
}  // namespace slicecorr
