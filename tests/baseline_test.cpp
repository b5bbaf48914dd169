// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The usual compensations: columns by hand, properties of random columns, the search for N, and a
// real part.
#include "slicecorr/baseline.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>

#include "ladder.hpp"
#include "models.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::figure_2_2;
using test::process;
using Column = std::vector<std::uint8_t>;

/// Coverage in memory: columns of a square image, row by row.
class Columns final : public SliceSource {
 public:
  Columns(int width, std::vector<Column> columns) : columns_(std::move(columns)) {
    grid_.width_px = grid_.height_px = width;
    grid_.layers = static_cast<int>(columns_[0].size());
    grid_.pixel_x_um = grid_.pixel_y_um = grid_.layer_um = 50;
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {0, 0, grid_.width_px, grid_.height_px}; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    Column rows;
    for (int n = 0; n < grid_.layers; ++n) {
      rows.clear();
      for (int y = band.y0; y < band.y1; ++y) {
        for (int x = band.x0; x < band.x1; ++x) {
          rows.push_back(columns_[static_cast<std::size_t>(y * grid_.width_px + x)]
                                 [static_cast<std::size_t>(n)]);
        }
      }
      sink(n, rows.data());
    }
  }

 private:
  Grid grid_;
  std::vector<Column> columns_;
};

/// Shows columns of one height to a baseline, all at once. `next` makes one layer.
template <typename Next>
std::vector<Column> walk(const std::vector<Column>& design, Next next) {
  std::vector<Column> shown(design.size(), Column(design[0].size()));
  Column row(design.size());
  for (std::size_t n = design[0].size(); n-- > 0;) {
    for (std::size_t i = 0; i < design.size(); ++i) row[i] = design[i][n];
    const std::uint8_t* out = next(row.data());
    for (std::size_t i = 0; i < design.size(); ++i) shown[i][n] = out[i];
  }
  return shown;
}

void add_layers(BandErase& band, const std::vector<Column>& design) {
  Column row(design.size());
  for (std::size_t n = 0; n < design[0].size(); ++n) {
    bool lit = false;
    for (std::size_t i = 0; i < design.size(); ++i) {
      row[i] = design[i][n];
      lit = lit || row[i];
    }
    band.add_layer(lit ? row.data() : nullptr);
  }
}

std::vector<Column> erased(const std::vector<Column>& design, int layers) {
  BandErase band(design.size());
  add_layers(band, design);
  BandErase::Walk way(band, layers);
  return walk(design, [&](const std::uint8_t* row) { return way.next(row); });
}
Column erased(const Column& design, int layers) {
  return erased(std::vector<Column>{design}, layers)[0];
}

std::vector<Column> darkened(const std::vector<Column>& design) {
  BandGreyTable table(design.size());
  return walk(design, [&](const std::uint8_t* row) { return table.next(row); });
}
Column darkened(const Column& design) { return darkened(std::vector<Column>{design})[0]; }

/// Runs and gaps of any height, some layers grey.
std::vector<Column> random_columns(std::mt19937& random, std::size_t columns, std::size_t layers) {
  std::vector<Column> all(columns);
  for (Column& c : all) {
    bool lit = random() % 2;
    while (c.size() < layers) {
      c.insert(c.end(), 1 + random() % 12, lit ? 255 : 0);
      if (lit && random() % 3 == 0) c.back() = static_cast<std::uint8_t>(1 + random() % 254);
      lit = !lit;
    }
    c.resize(layers);
  }
  return all;
}

TEST(Erase, ByHand) {
  const Column design = column(20, {{0, 3}, {6, 9}, {12, 12}, {15, 19}});
  EXPECT_EQ(erased(design, 0), design);
  EXPECT_EQ(erased(design, 1), column(20, {{0, 3}, {7, 9}, {16, 19}}));
  EXPECT_EQ(erased(design, 3), column(20, {{0, 3}, {9, 9}, {18, 19}}));
  EXPECT_EQ(erased(design, 4), column(20, {{0, 3}, {19, 19}}));
  EXPECT_EQ(erased(design, 5), column(20, {{0, 3}}));
  EXPECT_EQ(erased(design, 1000000), column(20, {{0, 3}}));
}

TEST(Erase, GreyIsLit) {
  EXPECT_EQ(erased(Column{0, 40, 255, 255, 1, 0}, 1), (Column{0, 0, 255, 255, 1, 0}));
  EXPECT_EQ(erased(Column{0, 40, 255, 255, 1, 0}, 3), (Column{0, 0, 0, 0, 1, 0}));
  EXPECT_EQ(erased(Column{40, 255, 0}, 9), (Column{40, 255, 0}));
}

TEST(Erase, RandomBandsEqualTheDefinition) {
  std::mt19937 random(21);
  for (const std::size_t columns : {1, 31, 32, 33, 100}) {
    const auto design = random_columns(random, columns, 90);
    for (const int layers : {0, 1, 2, 5, 11, 12, 90}) {
      const auto shown = erased(design, layers);
      for (std::size_t i = 0; i < columns; ++i) {
        int age = 0;  // layers of the run before this one
        bool platform = true;
        for (std::size_t n = 0; n < 90; ++n) {
          const std::uint8_t c = design[i][n];
          platform = platform && c;
          age = c ? age + 1 : 0;
          ASSERT_EQ(shown[i][n], c && (platform || age > layers) ? c : 0) << i << " " << n;
          ASSERT_LE(shown[i][n], c);  // never more light
        }
      }
    }
  }
}

TEST(Erase, WalksDoNotDisturbEachOther) {
  std::mt19937 random(22);
  const auto design = random_columns(random, 40, 60);
  BandErase band(40);
  add_layers(band, design);
  BandErase::Walk two(band, 2), five(band, 5);
  std::vector<Column> with_five;
  const auto with_two = walk(design, [&](const std::uint8_t* row) {
    const std::uint8_t* other = five.next(row);
    with_five.emplace_back(other, other + 40);
    return two.next(row);
  });
  EXPECT_EQ(with_two, erased(design, 2));
  const auto alone = erased(design, 5);
  for (std::size_t i = 0; i < 40; ++i) {
    for (std::size_t n = 0; n < 60; ++n) ASSERT_EQ(with_five[59 - n][i], alone[i][n]);
  }
}

TEST(GreyTable, ByHand) {
  EXPECT_EQ(darkened(Column{0, 255, 255, 255, 255, 255, 255, 0}),
            (Column{0, 200, 200, 205, 215, 230, 255, 0}));
  // The slices after a gap count as well; the platform does not matter.
  EXPECT_EQ(darkened(Column{255, 0, 255, 0, 255}), (Column{235, 0, 240, 0, 255}));
  EXPECT_EQ(darkened(Column{255, 0, 0, 0, 255}), (Column{250, 0, 0, 0, 255}));
  EXPECT_EQ(darkened(Column{255, 0, 0, 0, 0, 255}), (Column{255, 0, 0, 0, 0, 255}));
  // Grey is lit, and nothing falls below 0.
  EXPECT_EQ(darkened(Column{24, 26, 1, 0}), (Column{0, 1, 1, 0}));
}

TEST(GreyTable, RandomBandsEqualTheDefinition) {
  std::mt19937 random(23);
  for (const std::size_t columns : {1, 31, 32, 33, 100}) {
    const auto design = random_columns(random, columns, 90);
    const auto shown = darkened(design);
    for (std::size_t i = 0; i < columns; ++i) {
      for (std::size_t n = 0; n < 90; ++n) {
        int left = design[i][n];
        for (std::size_t k = 0; k < 4; ++k) {
          if (n + k + 1 < 90 && design[i][n + k + 1]) left -= kGreyTable[k];
        }
        ASSERT_EQ(shown[i][n], std::max(left, 0)) << i << " " << n;
      }
    }
  }
}

Setup figure_setup() {
  Setup setup;
  setup.printer = test::linear_printer(1, 100);
  setup.resin = test::resin(576, 2000);
  setup.process = process(1000);
  return setup;
}

TEST(Compare, HighFeatureInClosedForm) {
  // One run behind a gap: phi 6.25 within, 0.0625 in the dark. Uncorrected, the print reaches
  // lg((6.25 - 0.0625) / (1 - 0.0625)) / 0.025 = 32.78 slices into the gap, and its lower end stays
  // lg(6.25 / 5.25) / 0.025 = 3.03 slices behind whatever N is.
  const double reach = std::log10(6.1875 / 0.9375) / 0.025;
  const double end = std::log10(6.25 / 5.25) / 0.025;
  EXPECT_EQ(cure_through_slices(figure_2_2()), 33);
  const Columns target(16, std::vector<Column>(256, column(500, {{60, 499}})));
  const Comparison c = compare_methods(target, figure_setup());
  EXPECT_EQ(c.best_n, 33);
  ASSERT_EQ(c.erase_mean_um.size(), 34U);
  for (std::size_t n = 0; n < 34; ++n) {
    const double slices = (std::abs(reach - static_cast<double>(n)) + end) / 2;
    EXPECT_NEAR(c.erase_mean_um[n], 50 * slices, 1e-3) << n;
  }
  EXPECT_NEAR(c.uncorrected.height_error_um.mean(), 50 * (reach + end) / 2, 1e-3);
  EXPECT_NEAR(c.erase.height_error_um.mean(), 50 * (33 - reach + end) / 2, 1e-3);
  // The table shows 200 of 255 inside: less light, but none the less phi 4.92.
  const double phi = (1 + 99 * 200 / 255.0) / 16;
  const double table_reach = std::log10((phi - 0.0625) / 0.9375) / 0.025;
  EXPECT_NEAR(c.table.greatest_overreach_um, 50 * table_reach, 1e-3);
  EXPECT_LT(c.ours.height_error_um.mean(), 2.0);
}

TEST(Compare, SearchAgreesWithTheFullPrediction) {
  std::mt19937 random(24);
  const Columns target(16, random_columns(random, 256, 120));
  const Comparison c = compare_methods(target, figure_setup());
  EXPECT_EQ(c.erase_mean_um[0], c.uncorrected.height_error_um.mean());
  EXPECT_EQ(c.erase_mean_um[static_cast<std::size_t>(c.best_n)], c.erase.height_error_um.mean());
  for (const double mean : c.erase_mean_um) EXPECT_GE(mean, c.erase.height_error_um.mean());
  EXPECT_EQ(c.ours.undercure_voxels, 0U);
}

TEST(Compare, NoGreaterNIsBetter) {
  std::mt19937 random(25);
  const CureModel model = figure_2_2();
  const PixelCurve curve = pixel_curve(model);
  for (int round = 0; round < test::rounds(5); ++round) {
    std::vector<Column> design;
    for (int i = 0; i < 64; ++i) {
      Column c;
      for (std::uint8_t v = 0; c.size() < 300; v = static_cast<std::uint8_t>(255 - v)) {
        c.insert(c.end(), 1 + random() % 90, v);
      }
      c.resize(300);
      design.push_back(std::move(c));
    }
    double last = 0;
    for (int layers = cure_through_slices(model); layers < 95; ++layers) {
      const auto shown = erased(design, layers);
      BandPredictor predictor(model, curve, 300, 64);
      for (std::size_t n = 300; n-- > 0;) {
        Column pixels, coverage;
        for (std::size_t i = 0; i < 64; ++i) {
          pixels.push_back(shown[i][n]);
          coverage.push_back(design[i][n]);
        }
        predictor.add_slice(static_cast<int>(n), pixels.data(), coverage.data());
      }
      const double mean = predictor.finish(0, 0, 64).height_error_um.mean();
      ASSERT_GE(mean, last - 1e-6) << round << ", N = " << layers;
      last = mean;
    }
  }
}

TEST(Compare, EmptyPartIsRefused) {
  const Columns target(16, std::vector<Column>(256, Column(20, 0)));
  EXPECT_THROW(compare_methods(target, figure_setup()), InputError);
}

TEST(Compare, ThreadsDoNotMatter) {
  slicecorr::Setup setup = figure_setup();
  setup.printer.width_px = setup.printer.height_px = 100;
  SliceOptions options;
  const MeshSlices target(test::ladder(), setup.printer, options);
  ExecutionContext one, four;
  one.threads = 1;
  four.threads = 4;
  const Comparison a = compare_methods(target, setup, one);
  const Comparison b = compare_methods(target, setup, four);
  EXPECT_EQ(a.best_n, b.best_n);
  EXPECT_EQ(a.erase_mean_um, b.erase_mean_um);
  EXPECT_EQ(a.uncorrected.to_json(), b.uncorrected.to_json());
  EXPECT_EQ(a.erase.to_json(), b.erase.to_json());
  EXPECT_EQ(a.table.to_json(), b.table.to_json());
  EXPECT_EQ(a.ours.to_json(), b.ours.to_json());
}

Comparison benchy_compared(const std::string& path, double scale) {
  slicecorr::Setup setup;  // gtest has a Setup too
  setup.printer = load_printer(SLICECORR_PRINTERS_DIR "/dual-wavelength-dlp.toml");
  setup.resin = load_resin(SLICECORR_DB_DIR "/benchy-resin.toml");
  setup.process = process(800);
  SliceOptions options;
  options.antialias = false;
  Placement placement;
  placement.scale = scale;
  const MeshSlices target(read_mesh(path, placement), setup.printer, options);
  return compare_methods(target, setup);
}

TEST(Compare, SmallBenchyIsFarBetter) {
  const std::string path = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(path);
  const Comparison c = benchy_compared(path, 0.2);
  const double ours = c.ours.height_error_um.mean();
  EXPECT_LT(ours, 0.5);
  EXPECT_GT(c.erase.height_error_um.mean(), 100 * ours);
  EXPECT_GT(c.table.height_error_um.mean(), 100 * ours);
  EXPECT_EQ(c.ours.lost_features, 0U);
  EXPECT_GT(c.erase.lost_features, 1000U);
}

TEST(CompareNight, BenchyIsFarBetter) {
  const std::string path = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(path);
  const Comparison c = benchy_compared(path, 1);
  const double ours = c.ours.height_error_um.mean();
  const double erase = c.erase.height_error_um.mean(), table = c.table.height_error_um.mean();
  // 0.066 um against 171.22 um (N = 40) and 776.56 um.
  EXPECT_LT(ours, 0.3);
  EXPECT_LT(c.ours.height_error_um.greatest(), 10);
  EXPECT_EQ(c.best_n, 40);
  EXPECT_NEAR(erase, 171.22, 0.1);
  EXPECT_NEAR(table, 776.56, 0.1);
  EXPECT_EQ(c.ours.lost_features, 0U);
  EXPECT_GT(c.erase.lost_features, 50000U);
}

}  // namespace
}  // namespace slicecorr
