// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the bridge asks of a UV lamp that shines unevenly: so much that its weakest place keeps resin off the window.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "control_bench.hpp"
#include "memory_slices.hpp"
#include "slicecorr/bridge/plan.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/units.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::bridge {
namespace {

constexpr int kSide = 16;

/// How a block is printed that was corrected for lamps that flood the window, and the brightest blue light of each
/// slice, mW/cm².
struct Printed {
  PrintPlan plan;
  std::vector<double> blue_mw_cm2;
};

Printed print_of_block(const Machine& machine) {
  Setup setup;
  setup.printer = machine.printer;
  setup.resin.name = "resin 1";
  setup.resin.model = CureModelKind::kinetic;
  setup.resin.m = 0.99;
  setup.resin.absorbance_height10_um = units::height10_from_e(408);
  setup.resin.critical_dose_prime = 64;
  setup.resin.inhibition = Inhibition{0.73, units::height10_from_e(37.8), 0.99, 0};
  setup.process.speed_mm_h = 600;
  setup.process.uv.kind = UvKind::constant;
  setup.process.uv.uv_mw_cm2 = 220;
  Grid grid;
  grid.width_px = grid.height_px = kSide;
  grid.layers = 20;
  grid.pixel_x_um = grid.pixel_y_um = grid.layer_um = 50;
  slicecorr::test::MemorySlices block(grid);
  for (int n = 0; n < grid.layers; ++n) {
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) block.at(n, x, y) = 255;
    }
  }
  slicecorr::test::TemporaryFolder folder;
  correct_stack(block, setup, folder / "block.uvj", {});
  const StackReader stack(folder / "block.uvj", folder.path(), {}, {});
  Printed printed{plan_print(stack, "block.uvj", machine), {}};
  const std::vector<double> levels = level_intensities(machine.printer);
  std::vector<std::uint8_t> image(static_cast<std::size_t>(kSide * kSide));
  for (int n = 0; n < stack.grid().layers; ++n) {
    stack.read_slice(n, image.data());
    printed.blue_mw_cm2.push_back(levels[*std::max_element(image.begin(), image.end())]);
  }
  return printed;
}

TEST(BridgeUnevenUv, TheWeakestPlaceDecides) {
  Machine even = test::test_machine();
  even.printer.width_px = even.printer.height_px = kSide;
  even.printer.pixel_x_um = even.printer.pixel_y_um = 50;
  for (const int value : {255, 204}) {
    Machine m = even;
    m.printer.uv_flat_field = FlatField{
        1, 1,
        std::make_shared<const std::vector<std::uint8_t>>(1, static_cast<std::uint8_t>(value))};
    const Printed printed = print_of_block(m);
    ASSERT_EQ(printed.plan.frames.size(), printed.blue_mw_cm2.size());
    int lit = 0;
    for (std::size_t n = 0; n < printed.blue_mw_cm2.size(); ++n) {
      const FramePlan& frame = printed.plan.frames[n];
      if (!frame.lit) continue;
      ++lit;
      // beta times what of the lamp's light comes there is as much as the blue light.
      EXPECT_NEAR(0.73 * frame.least_uv_mw_cm2 * value / 255, printed.blue_mw_cm2[n], 1e-9) << n;
    }
    EXPECT_GT(lit, 15) << value;
  }
}

}  // namespace
}  // namespace slicecorr::bridge
