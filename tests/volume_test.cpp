// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The reduced volume of the report, and the places of lost and merged features.
#include "slicecorr/volume.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <random>

#include "ladder.hpp"
#include "lattice.hpp"
#include "models.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {
namespace {

Setup lattice_setup() {
  Printer p = test::linear_printer(1, 100);
  p.width_px = 260;
  p.height_px = 220;
  return {p, test::resin(576, 2000), test::process(1000)};
}

/// Slices held in memory, of any content.
class Voxels final : public SliceSource {
 public:
  Voxels(const Grid& grid, const PixelBox& box) : grid_(grid), box_(box) {
    values.assign(static_cast<std::size_t>(grid.width_px) *
                      static_cast<std::size_t>(grid.height_px) *
                      static_cast<std::size_t>(grid.layers),
                  0);
  }
  std::uint8_t& at(int x, int y, int n) {
    return values[(static_cast<std::size_t>(n) * static_cast<std::size_t>(grid_.height_px) +
                   static_cast<std::size_t>(y)) *
                      static_cast<std::size_t>(grid_.width_px) +
                  static_cast<std::size_t>(x)];
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return box_; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    std::vector<std::uint8_t> rows;
    for (int n = 0; n < grid_.layers; ++n) {
      rows.clear();
      for (int y = band.y0; y < band.y1; ++y) {
        for (int x = band.x0; x < band.x1; ++x) {
          rows.push_back(const_cast<Voxels*>(this)->at(x, y, n));
        }
      }
      sink(n, rows.data());
    }
  }
  std::vector<std::uint8_t> values;

 private:
  Grid grid_;
  PixelBox box_;
};

/// Random runs per column; the stack longer than the target, its levels random too.
std::pair<Voxels, Voxels> random_stack(unsigned seed) {
  const Grid target_grid{70, 61, 75, 50, 50, 50};
  Grid stack_grid = target_grid;
  stack_grid.layers = 79;
  const PixelBox box{3, 5, 68, 60};
  std::pair<Voxels, Voxels> made{Voxels(target_grid, box), Voxels(stack_grid, box)};
  std::mt19937 random(seed);
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      for (int n = 0; n < 75;) {
        const int end = std::min<int>(75, n + 1 + static_cast<int>(random() % 30));
        const int kind = static_cast<int>(random() % 9);
        const auto value = static_cast<std::uint8_t>(kind < 4   ? 0
                                                     : kind < 8 ? 255
                                                                : random() % 256);
        for (; n < end; ++n) made.first.at(x, y, n) = value;
      }
      for (int n = 0; n < 79; ++n) {
        const bool lit = n < 75 && made.first.at(x, y, n) > 0;
        made.second.at(x, y, n) = static_cast<std::uint8_t>(lit ? random() % 90 : random() % 3);
      }
    }
  }
  return made;
}

void expect_no_wrong_voxel_lost(const ReducedVolume& v, const SliceSource& stack,
                                const SliceSource& target, const Setup& setup) {
  std::vector<std::uint8_t> before(v.cells(), 0), after(v.cells(), 0);
  const auto mark = [&](const SliceSource& shown, std::vector<std::uint8_t>& flags) {
    for (int y = v.box.y0; y < v.box.y1; ++y) {
      const Section s = section_of(shown, target, setup, y);
      for (int n = 0; n < s.layers; ++n) {
        for (int x = 0; x < s.width; ++x) {
          const std::size_t at = static_cast<std::size_t>(n * s.width + x);
          // Sections hold doses as floats: just at the gel point they may round across it.
          if (std::abs(s.dose[at] - 1.0F) < 1e-6F) continue;
          const bool printed = s.dose[at] >= 1;
          const int wrong = s.coverage[at] == 0 && printed      ? kCellCureThrough
                            : s.coverage[at] == 255 && !printed ? kCellUndercure
                                                                : 0;
          const int i = (s.x0 + x - v.box.x0) / v.step_x, j = (y - v.box.y0) / v.step_y;
          flags[static_cast<std::size_t>((n / v.step_z * v.ny + j) * v.nx + i)] |=
              static_cast<std::uint8_t>(wrong);
        }
      }
    }
  };
  mark(target, before);
  mark(stack, after);
  std::size_t wrong = 0;
  for (std::size_t c = 0; c < v.cells(); ++c) {
    ASSERT_EQ(v.before.state[c] & 3, before[c]) << c;
    ASSERT_EQ(v.after.state[c] & 3, after[c]) << c;
    wrong += before[c] != 0;
  }
  EXPECT_GT(wrong, 0U);
}

TEST(Volume, NoWrongVoxelIsLost) {
  const slicecorr::Setup setup = lattice_setup();
  for (const int cells : {7, 40, 160}) {
    const auto [target, stack] = random_stack(static_cast<unsigned>(cells));
    const ReducedVolume v = reduce_volume(stack, target, setup, cells);
    EXPECT_LE(std::max({v.nx, v.ny, v.nz}), cells);
    expect_no_wrong_voxel_lost(v, stack, target, setup);
    if (cells != 40) continue;
    // Nor by joining cells.
    const ReducedVolume c = coarser(v);
    EXPECT_EQ(c.nx, (v.nx + 1) / 2);
    expect_no_wrong_voxel_lost(c, stack, target, setup);
  }
}

/// The flags of all cells, counted voxel by voxel from sections.
TEST(Volume, CellsAreTheVoxelsInThem) {
  const slicecorr::Setup setup = lattice_setup();
  for (const int cells : {9, 30, 160}) {
    const auto [target, stack] = random_stack(static_cast<unsigned>(cells) + 100);
    const ReducedVolume v = reduce_volume(stack, target, setup, cells);
    const auto check = [&, &target = target](const SliceSource& shown, const ReducedPrint& print) {
      struct Cell {
        int voxels = 0, printed = 0, designed = 0, flags = 0;
        bool unsure = false;  // a float of the section lies at the gel point
      };
      std::vector<Cell> expected(v.cells());
      for (int y = v.box.y0; y < v.box.y1; ++y) {
        const Section s = section_of(shown, target, setup, y);
        for (int n = 0; n < v.layers; ++n) {
          for (int x = 0; x < s.width; ++x) {
            const int i = (s.x0 + x - v.box.x0) / v.step_x, j = (y - v.box.y0) / v.step_y;
            Cell& cell = expected[static_cast<std::size_t>((n / v.step_z * v.ny + j) * v.nx + i)];
            const auto at = static_cast<std::size_t>(n * s.width + x);
            const bool there = n < s.layers;
            const int cover = there ? s.coverage[at] : 0;
            const float dose = there ? s.dose[at] : 0.0F;
            cell.unsure |= std::abs(dose - 1.0F) < 1e-6F;
            ++cell.voxels;
            cell.printed += dose >= 1;
            cell.designed += cover >= 128;
            if (cover != 0 && cover != 255) cell.flags |= kCellGrey;
            if (cover == 0 && dose >= 1) cell.flags |= kCellCureThrough;
            if (cover == 255 && dose < 1) cell.flags |= kCellUndercure;
          }
        }
      }
      for (std::size_t c = 0; c < v.cells(); ++c) {
        Cell& cell = expected[c];
        if (cell.unsure) continue;
        if (2 * cell.printed >= cell.voxels) cell.flags |= kCellPrinted;
        if (2 * cell.designed >= cell.voxels) cell.flags |= kCellDesigned;
        ASSERT_EQ(print.state[c], cell.flags) << c << " of " << cells;
      }
    };
    check(target, v.before);
    check(stack, v.after);
  }
}

TEST(Volume, ACorrectionGathersItOnTheWay) {
  const slicecorr::Setup setup = lattice_setup();
  const MeshSlices target(test::lattice(2, 2, 2, 3, 0.4), setup.printer, SliceOptions{});
  const auto path = std::filesystem::temp_directory_path() /
                    ("slicecorr-volume-" + std::to_string(::getpid()) + ".uvj");
  const CorrectedSlices corrected(target, setup);
  for (const int cells : {11, 100}) {
    const ReducedVolume expected = reduce_volume(corrected, target, setup, cells);
    for (const int threads : {1, 5}) {
      ExecutionContext context;
      context.threads = threads;
      const Correction c = correct_stack(target, setup, path.string(),
                                         {.before = true, .volume_cells = cells}, context);
      ASSERT_TRUE(c.volume);
      EXPECT_TRUE(*c.volume == expected) << cells << " cells, " << threads << " threads";
    }
  }
  std::filesystem::remove(path);
}

TEST(Volume, ColumnsGiveTheDosesOfProbe) {
  const slicecorr::Setup setup = lattice_setup();
  const auto [target, stack] = random_stack(5);
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, 50);
  const ReducedVolume v = reduce_volume(stack, target, setup, 16);
  const auto unroll = [](const ReducedVolume::Runs& runs) {
    std::vector<int> values;
    for (const ReducedVolume::Run run : runs) {
      values.insert(values.end(), run.slices, static_cast<int>(run.value));
    }
    return values;
  };
  ASSERT_EQ(v.columns.size(), static_cast<std::size_t>(v.nx * v.ny));
  for (std::size_t c = 0; c < v.columns.size(); c += 3) {
    const auto& column = v.columns[c];
    EXPECT_EQ((column.x - v.box.x0) / v.step_x, static_cast<int>(c) % v.nx);
    EXPECT_EQ((column.y - v.box.y0) / v.step_y, static_cast<int>(c) / v.nx);
    const auto rows = probe_stack(stack, &target, setup, column.x, column.y);
    const auto levels = unroll(column.levels), coverage = unroll(column.coverage);
    ASSERT_EQ(levels.size(), rows.size());
    ASSERT_EQ(coverage.size(), 75U);
    double dose = 0;
    for (std::size_t n = rows.size(); n-- > 0;) {
      const double phi = model.level_phi[static_cast<std::size_t>(levels[n])];
      const double middle = model.middle(phi, dose);
      dose = model.step(phi, dose);
      ASSERT_EQ(dose, rows[n].dose);
      if (n < coverage.size()) {
        ASSERT_EQ(coverage[n] / 255.0, rows[n].target);
      }
      const int z = static_cast<int>(n), first = z / v.step_z * v.step_z;
      if (z == (first + std::min(first + v.step_z, v.layers)) / 2) {
        const std::size_t cell = static_cast<std::size_t>(z / v.step_z * v.ny * v.nx) + c;
        ASSERT_EQ(v.after.dose[cell], dose_code(middle));
        ASSERT_EQ(dose_code(middle) >= 128, middle >= 1);
      }
    }
  }
}

TEST(Volume, ErrorsLieWhereEdgesAre) {
  Printer printer = test::linear_printer(1, 100);
  printer.width_px = 128;
  printer.height_px = 80;
  const slicecorr::Setup setup{printer, test::resin(576, 2000), test::process(1000)};
  const MeshSlices target(test::ladder(), printer, SliceOptions{});
  const CorrectedSlices corrected(target, setup);
  const ReducedVolume v = reduce_volume(corrected, target, setup, 160);
  ASSERT_EQ(v.step_z, 1);
  const auto error = [&](const ReducedPrint& p, int n) {
    return p.error[static_cast<std::size_t>((n * v.ny + v.ny / 2) * v.nx + v.nx / 2)];
  };
  // The rungs are slices 11-20 and 31-40 (figure 2.2): uncorrected, the gaps print.
  for (const int n : {0, 10, 11, 20, 21, 31}) EXPECT_GT(error(v.before, n), 128) << n;
  EXPECT_LT(error(v.before, 40), 128) << "the lower edge stays behind";
  for (const int n : {11, 20, 31, 40}) {
    EXPECT_NE(error(v.after, n), 0) << n;
    EXPECT_NEAR(error(v.after, n), 128, 20) << n;
  }
  EXPECT_EQ(error(v.after, 15), 0) << "no edge inside a rung";
}

TEST(Volume, SamePageForAnyNumberOfThreads) {
  const slicecorr::Setup setup = lattice_setup();
  const MeshSlices target(test::lattice(2, 2, 2, 3, 0.4), setup.printer, SliceOptions{});
  const CorrectedSlices corrected(target, setup);
  std::string first;
  for (const int threads : {1, 8}) {
    ExecutionContext context;
    context.threads = threads;
    StackInfo info;
    info.grid = corrected.grid();
    const Prediction after = verify_stack(corrected, target, setup, context);
    const Prediction before = verify_stack(target, target, setup, context);
    const std::string page = make_report(
        gather_report(corrected, target, setup, info, after, before, "lattice", context));
    if (first.empty()) first = page;
    EXPECT_TRUE(page == first) << threads;
  }
}

TEST(Volume, EvenNoiseMakesAPageOfAFewMegabytes) {
  const slicecorr::Setup setup = lattice_setup();
  ReducedVolume v;
  v.box = {0, 0, 160, 160};
  v.layers = v.nx = v.ny = v.nz = 160;
  std::mt19937 random(1);
  for (ReducedPrint* p : {&v.before, &v.after}) {
    for (auto* grid : {&p->state, &p->dose, &p->grey, &p->error}) {
      grid->resize(v.cells());
      for (auto& byte : *grid) byte = static_cast<std::uint8_t>(random());
    }
    for (auto& state : p->state) state &= 31;
  }
  v.columns.resize(160 * 160);
  for (auto& column : v.columns) {
    column.x = column.y = 0;
    for (int n = 0; n < 160; ++n)
      column.levels.push_back({static_cast<std::uint32_t>(random() % 256), 1});
    column.coverage = column.levels;
  }
  ReportContent content;
  content.info.grid = {160, 160, 160, 50, 50, 50};
  content.setup = setup;
  content.volume = std::make_shared<ReducedVolume>(std::move(v));
  ComparisonTable comparison;
  comparison.columns = {"way", "mean <error>"};
  comparison.rows = {{"ours", "1 um"}};
  content.comparison = comparison;
  const std::string page = make_report(content);
  EXPECT_LT(page.size(), 5'500'000U);
  EXPECT_GT(page.size(), 500'000U);
  EXPECT_NE(page.find("mean &lt;error&gt;"), std::string::npos);
}

TEST(Features, ExamplesAreTheFirstInReadingOrderInAnyOrderOfMerging) {
  std::mt19937 random(3);
  std::vector<FeatureExample> all;
  for (int i = 0; i < 1000; ++i) {
    const int first = static_cast<int>(random() % 50);
    all.push_back(
        {static_cast<int>(random() % 40), static_cast<int>(random() % 40), first, first + 2});
  }
  std::vector<FeatureExample> expected = all;
  std::sort(expected.begin(), expected.end());
  expected.resize(FeatureExamples::kMost);
  for (int round = 0; round < 5; ++round) {
    std::shuffle(all.begin(), all.end(), random);
    FeatureExamples parts[7], sum;
    for (std::size_t i = 0; i < all.size(); ++i) parts[i % 7].add(all[i]);
    for (const auto& part : parts) sum.merge(part);
    EXPECT_EQ(sum.sorted(), expected);
  }
}

TEST(Features, PlacesOfTheLadder) {
  Printer printer = test::linear_printer(1, 100);
  printer.width_px = 128;
  printer.height_px = 80;
  const slicecorr::Setup setup{printer, test::resin(576, 2000), test::process(1000)};
  const MeshSlices target(test::ladder(), printer, SliceOptions{});
  const Prediction p = verify_stack(target, target, setup);
  // Both gaps of every rung column fill: platform to slice 10, and 21 to 30.
  const auto merged = p.merged_examples.sorted();
  ASSERT_EQ(merged.size(), FeatureExamples::kMost);
  EXPECT_EQ(p.merged_features, 2U * 40 * 40);
  EXPECT_EQ(merged[0], (FeatureExample{44, 20, 0, 10}));
  EXPECT_EQ(merged[1], (FeatureExample{44, 20, 21, 30}));
  EXPECT_EQ(merged[2], (FeatureExample{45, 20, 0, 10}));
  EXPECT_TRUE(p.lost_examples.sorted().empty());
}

TEST(Histogram, CoarseBinsCountEverySampleOnce) {
  Histogram h;
  for (const double v : {0.0, 0.05, 0.15, 0.15, 0.95, 1.0, 7.0}) h.add(v);
  EXPECT_EQ(h.coarse({0, 0.1, 0.2, 0.9, 1.0}), (std::vector<std::uint64_t>{2, 2, 0, 3}));
  EXPECT_EQ(Histogram().coarse({0, 1}), (std::vector<std::uint64_t>{0}));
}

}  // namespace
}  // namespace slicecorr
