// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Edges where the design's own surface is, between the slices: correction and prediction of columns
// with edge heights.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "layerwise_models.hpp"
#include "models.hpp"
#include "printed_column.hpp"
#include "rounds.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::figure_2_2;
using test::plan_for;
using test::process;

using Bytes = std::vector<std::uint8_t>;

/// Dose at `z` slices from the platform.
double dose_at(const CureModel& model, const std::vector<double>& phi,
               const std::vector<double>& node, double z) {
  const int n = std::clamp(static_cast<int>(z), 0, static_cast<int>(phi.size()) - 1);
  const auto k = static_cast<std::size_t>(n);
  return phi[k] + (node[k + 1] - phi[k]) * std::pow(model.a, n + 1 - z);
}

/// Where edges of a column are wanted: edge heights of all nodes between full and empty layers but
/// the platform.
Bytes random_heights(std::mt19937& random, const Bytes& design) {
  Bytes heights(design.size() + 1, 0);
  for (std::size_t n = 1; n <= design.size(); ++n) {
    const int above = design[n - 1], below = n < design.size() ? design[n] : 0;
    if (above + below == 255) heights[n] = static_cast<std::uint8_t>(1 + random() % 255);
  }
  return heights;
}

/// Runs of full and of empty layers.
Bytes random_column(std::mt19937& random, int least, int most, int layers) {
  std::uniform_int_distribution<int> length(least, most);
  Bytes c;
  std::uint8_t value = random() % 2 ? 255 : 0;
  while (static_cast<int>(c.size()) < layers) {
    c.insert(c.end(), static_cast<std::size_t>(length(random)), value);
    value = static_cast<std::uint8_t>(255 - value);
  }
  return c;
}

/// A slice more than for edges at nodes: the part's end may lie half a slice further down.
CorrectionPlan plan_with_heights(const CureModel& model, const Process& process, int layers) {
  return {model, process, layers, slices_with_burst(model, layers, layers - 1) + 1};
}

struct Solved {
  std::vector<double> phi, node;
  int wrong = 0;
  std::vector<double> errors_um;  ///< distance of the dose 1 from each edge's surface
};

/// What the levels chosen for a column print; the edge is sought between the middles of the layers
/// beside it, where the dose passes 1 once.
Solved solve(const CureModel& model, double cap, const Bytes& design, const Bytes& heights) {
  const auto plan = plan_with_heights(model, process(1000, cap), static_cast<int>(design.size()));
  Solved s;
  for (const std::uint8_t l : solve_column(plan, design, heights)) {
    s.phi.push_back(plan.levels.phi(l));
  }
  s.node = node_doses(model, s.phi);
  for (std::size_t n = 0; n < s.phi.size(); ++n) {
    const bool full = n < design.size() && design[n] == 255;
    s.wrong += (dose_at(model, s.phi, s.node, static_cast<double>(n) + 0.5) >= 1.0) != full;
  }
  for (std::size_t n = 0; n < heights.size(); ++n) {
    if (heights[n] == 0) continue;
    double low = static_cast<double>(n) - 0.5, high = static_cast<double>(n) + 0.5;
    const bool printed_low = dose_at(model, s.phi, s.node, low) >= 1.0;
    if (printed_low == (dose_at(model, s.phi, s.node, high) >= 1.0)) continue;  // counted as wrong
    for (int k = 0; k < 50; ++k) {
      const double middle = 0.5 * (low + high);
      ((dose_at(model, s.phi, s.node, middle) >= 1.0) == printed_low ? low : high) = middle;
    }
    const double wanted = static_cast<double>(n) + edge_height_slices(heights[n]);
    s.errors_um.push_back(std::abs(low - wanted) * model.layer_um);
  }
  return s;
}

TEST(EdgeHeights, BytesCoverHalfASliceToEitherSide) {
  EXPECT_EQ(edge_height_slices(1), -0.5);
  EXPECT_EQ(edge_height_slices(128), 0.0);
  EXPECT_EQ(edge_height_slices(255), 0.5);
  for (int b = 1; b < 256; ++b) {
    const auto byte = static_cast<std::uint8_t>(b);
    EXPECT_EQ(edge_height_byte(edge_height_slices(byte)), byte);
  }
  EXPECT_EQ(edge_height_byte(-0.7), 1);
  EXPECT_EQ(edge_height_byte(0.7), 255);
}

TEST(SurfaceExactly, DoseIsOneOnTheSurface) {
  // Edges a quarter of a slice before and after their nodes, in all combinations.
  const CureModel m = figure_2_2();
  const auto plan = plan_for(m, process(1000), 50);
  const Bytes design = column(50, {{11, 20}, {31, 40}});
  for (int k = 0; k < 16; ++k) {
    Bytes heights(51, 0);
    std::size_t nodes[] = {11, 21, 31, 41};
    for (int e = 0; e < 4; ++e) heights[nodes[e]] = k >> e & 1 ? 64 : 192;
    const auto phi = solve_column_exactly(plan, design, heights);
    const auto node = node_doses(m, phi);
    for (const std::size_t n : nodes) {
      const double z = static_cast<double>(n) + edge_height_slices(heights[n]);
      EXPECT_NEAR(dose_at(m, phi, node, z), 1.0, 1e-9) << k << " at " << n;
    }
  }
}

TEST(SurfaceToLevels, EdgesAtNodesAreThoseWithoutHeights) {
  std::mt19937 random(31);
  const CureModel m = figure_2_2();
  for (int round = 0; round < test::rounds(200); ++round) {
    const Bytes design = random_column(random, 1, 12, 60);
    Bytes heights = random_heights(random, design);
    for (auto& h : heights) h = h ? 128 : 0;
    const auto plan = plan_for(m, process(1000), static_cast<int>(design.size()));
    EXPECT_EQ(solve_column(plan, design, heights), solve_column(plan, design));
    EXPECT_EQ(solve_column_exactly(plan, design, heights), solve_column_exactly(plan, design));
  }
}

TEST(SurfaceToLevels, PlacesEdgesToAHundredthOfAStep) {
  // As Levels.PlacesEdgesToAHundredthOfAStep: each edge has the levels before it to itself.
  std::mt19937 random(17);
  std::vector<double> largest;
  for (int round = 0; round < test::rounds(60); ++round) {
    const CureModel model =
        test::model_of(50, 1500, 5 + 10 * (round % 2), 100, round % 3 ? 1 : 3, 8);
    const Bytes design = random_column(random, 8, 25, 100);
    const Solved s = solve(model, 1e300, design, random_heights(random, design));
    ASSERT_EQ(s.wrong, 0) << round;
    largest.push_back(*std::max_element(s.errors_um.begin(), s.errors_um.end()));
  }
  std::sort(largest.begin(), largest.end());
  // Aimed at is 0.05 um; a tolerance that grows does so by a fifth.
  EXPECT_LE(largest[largest.size() / 2], 0.05 * 1.2);
  EXPECT_LE(largest.back(), 2.0);
}

TEST(SurfaceToLevels, HeightsMakeNoVoxelWrong) {
  // Voxels go by the middles of layers, wherever the edges between them lie.
  std::mt19937 random(18);
  int columns = 0;
  for (int round = 0; round < test::rounds(1500); ++round) {
    std::uniform_real_distribution<double> unit(0, 1);
    const CureModel model =
        test::model_of(10 * std::pow(10, unit(random)), 200 * std::pow(25, unit(random)),
                       1.5 * std::pow(20, unit(random)), 100, round % 2 ? 1 : 3, 8);
    const Bytes design = random_column(random, 2, 14, 50);
    const Solved at_nodes = solve(model, 1e300, design, {});
    if (at_nodes.wrong) continue;
    ++columns;
    const Solved s = solve(model, 1e300, design, random_heights(random, design));
    ASSERT_EQ(s.wrong, 0) << round;
  }
  EXPECT_GT(columns, 500);
}

TEST(SurfaceToLevels, BandsOfAnyWidthAgreeWithColumns) {
  std::mt19937 random(19);
  const CureModel m = figure_2_2();
  for (const std::size_t columns : {1, 7, 32, 64, 100}) {
    const int layers = 90;
    std::vector<Bytes> designs, heights;
    for (std::size_t i = 0; i < columns; ++i) {
      Bytes d = random_column(random, 1, 14, layers);
      d.resize(static_cast<std::size_t>(layers));
      if (i % 3 == 0) d.assign(static_cast<std::size_t>(layers), 0);
      if (i % 7 == 5) d[40] = 77;
      heights.push_back(random_heights(random, d));
      designs.push_back(std::move(d));
    }
    const auto plan = plan_for(m, process(1000), layers);
    BandCorrector band(plan, columns);
    Bytes row(columns), height_row(columns);
    for (int n = 0; n <= layers; ++n) {
      const auto k = static_cast<std::size_t>(n);
      for (std::size_t i = 0; i < columns; ++i) {
        row[i] = n < layers ? designs[i][k] : std::uint8_t{0};
        height_row[i] = heights[i][k];
      }
      band.add_layer(n < layers ? row.data() : nullptr, height_row.data());
    }
    std::vector<Bytes> got(columns, Bytes(static_cast<std::size_t>(plan.all_layers)));
    std::vector<Bytes> told(columns, Bytes(static_cast<std::size_t>(plan.all_layers)));
    band.solve(
        [&](int slice, const std::uint8_t* levels, const std::uint8_t*, bool) {
          for (std::size_t i = 0; i < columns; ++i) {
            got[i][static_cast<std::size_t>(slice)] = levels[i];
          }
        },
        [&](const BandCorrector::Tile& t) {
          if (!t.heights) return;
          for (int k = 0; k < t.slices; ++k) {
            for (std::size_t i = 0; i < t.columns; ++i) {
              told[t.first_column + i][static_cast<std::size_t>(t.first_slice + k)] =
                  t.heights[static_cast<std::size_t>(k) * BandCorrector::Tile::kStride + i];
            }
          }
        });
    for (std::size_t i = 0; i < columns; ++i) {
      ASSERT_EQ(got[i], solve_column(plan, designs[i], heights[i])) << i;
      for (std::size_t n = 1; n < heights[i].size(); ++n) {
        ASSERT_EQ(told[i][n], heights[i][n]) << i << " " << n;
      }
    }
  }
}

TEST(SurfacePrediction, ErrorsAreThoseOfTheDoseItself) {
  std::mt19937 random(20);
  for (int round = 0; round < test::rounds(60); ++round) {
    const CureModel model = test::model_of(50, 1500, 8, 100, 1, 8);
    const Bytes design = random_column(random, 3, 20, 80);
    const Bytes heights = random_heights(random, design);
    const Solved s = solve(model, 1e300, design, heights);
    if (s.wrong) continue;
    double sum = 0;
    for (const double e : s.errors_um) sum += e;
    const auto plan = plan_with_heights(model, process(1000), static_cast<int>(design.size()));
    const Bytes levels = solve_column(plan, design, heights);
    const PixelCurve curve = pixel_curve(model);
    for (const bool in_tiles : {false, true}) {
      BandPredictor predictor(model, curve, plan.all_layers, 1);
      const auto all = static_cast<std::size_t>(plan.all_layers);
      Bytes pixels(all * 64), covers(all * 64), edges(all * 64);
      for (std::size_t n = 0; n < all; ++n) {
        pixels[n * 64] = levels[n];
        covers[n * 64] = n < design.size() ? design[n] : std::uint8_t{0};
        edges[n * 64] = n < heights.size() ? heights[n] : std::uint8_t{0};
      }
      if (in_tiles) {
        predictor.add_tile({0, 1, 0, plan.all_layers}, pixels.data(),
                           {covers.data(), edges.data()});
      } else {
        for (std::size_t n = all; n-- > 0;) {
          predictor.add_slice(static_cast<int>(n), &pixels[n * 64],
                              {&covers[n * 64], &edges[n * 64]});
        }
      }
      const Prediction p = predictor.finish(0, 0, 1);
      ASSERT_EQ(p.surface_error_um.count(), s.errors_um.size());
      // Samples are kept in units of 2^-20.
      EXPECT_NEAR(p.surface_error_um.mean() * static_cast<double>(s.errors_um.size()), sum,
                  1e-5 * static_cast<double>(s.errors_um.size()));
    }
  }
}

TEST(SurfaceLayerwise, FarEdgesLieOnTheSurface) {
  // One layer's light fades as a^f towards the platform: the far edge is where its dose, with that
  // of later slices, is 1.
  std::mt19937 random(21);
  const double exposure_s = 2 * test::least_exposure_s();
  const CureModel m = test::figure_a_7(exposure_s);
  int edges = 0;
  for (int round = 0; round < test::rounds(100); ++round) {
    const Bytes design = random_column(random, 2, 12, 60);
    const Bytes heights = random_heights(random, design);
    const auto plan = plan_for(m, test::layerwise(exposure_s), static_cast<int>(design.size()));
    const auto phi = solve_column_exactly(plan, design, heights);
    double later = 0;
    for (std::size_t n = phi.size(); n-- > 0;) {
      const double at_window = phi[n] * m.ratio(static_cast<int>(n)) + later;
      const bool far_edge = n > 0 && n < design.size() && design[n] == 255 && design[n - 1] == 0;
      if (far_edge && phi[n] > m.phi_min() && phi[n] < m.phi_max()) {
        const double below = edge_height_slices(heights[n]);
        // In the gap, its own black light is added.
        const double dark = below < 0 ? m.phi_min() * m.ratio(static_cast<int>(n) - 1) : 0.0;
        if (std::pow(m.a, below) - dark >= 1.0 || below >= 0) {
          EXPECT_NEAR((at_window * m.a + dark) * std::pow(m.a, -below), 1.0, 1e-9);
          ++edges;
        }
      }
      later = at_window * m.a;
    }
  }
  EXPECT_GT(edges, 200);
}

TEST(SurfaceLayerwise, LevelsAreTheNearestThatKeepTheMiddles) {
  std::mt19937 random(22);
  const double exposure_s = 2 * test::least_exposure_s();
  for (const int depth : {8, 4}) {
    const CureModel m = make_cure_model(test::linear_printer(1, 100, depth), test::resin(576, 110),
                                        test::layerwise(exposure_s), 50);
    const int highest = (1 << depth) - 1;
    const double exact_bytes = 1e-6;
    int edges = 0, off_the_target = 0;
    for (int round = 0; round < test::rounds(100); ++round) {
      const Bytes design = random_column(random, 2, 12, 60);
      const Bytes heights = random_heights(random, design);
      const auto plan = plan_for(m, test::layerwise(exposure_s), static_cast<int>(design.size()));
      const auto levels = solve_column(plan, design, heights);
      double later = 0;
      for (std::size_t n = levels.size(); n-- > 0;) {
        const auto at_window = [&](int level) {
          return plan.levels.phi(level) * m.ratio(static_cast<int>(n)) + later;
        };
        const bool far_edge = n > 0 && n < design.size() && design[n] == 255 && design[n - 1] == 0;
        if (far_edge && heights[n] != 0 && heights[n] != kEdgeAtNode) {
          // All levels are tried: right middles without a slit at the node first, then the distance.
          const double below = edge_height_slices(heights[n]);
          const double dark = plan.levels.phi(0) * m.ratio(static_cast<int>(n) - 1);
          const auto badness = [&](int level) {
            const double node = at_window(level) * m.a, gap = node + dark;
            const bool liquid = node / std::sqrt(m.a) < 1.0, closed = gap * std::sqrt(m.a) >= 1.0;
            const bool slit = node < 1.0 && gap >= 1.0;
            const double at = std::log(node < 1.0 ? node : gap) / std::log(m.a);
            return std::pair(2 * liquid + closed + slit, std::abs(at - below));
          };
          auto best = badness(0);
          for (int level = 1; level <= highest; ++level) best = std::min(best, badness(level));
          const auto chosen = badness(levels[n]);
          EXPECT_EQ(chosen.first, best.first);
          EXPECT_NEAR(chosen.second, best.second, exact_bytes);
          ++edges;
          off_the_target += best.second > 1e-3;
        }
        later = at_window(levels[n]) * m.a;
      }
    }
    EXPECT_GT(edges, 200);
    EXPECT_GT(off_the_target, 50);
  }
}

}  // namespace
}  // namespace slicecorr
