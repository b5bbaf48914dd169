// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Displays that do not shine evenly, and ways to expose them.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test::flat {

using Values = std::vector<std::uint8_t>;
/// Tests have a Setup of their own.
using Settings = slicecorr::Setup;

inline FlatField field_of(int width, int height, Values values, int reference = 255,
                          bool of_plate = false) {
  FlatField f;
  f.width_px = width;
  f.height_px = height;
  f.values = std::make_shared<const Values>(std::move(values));
  f.reference = reference;
  f.of_plate = of_plate;
  return f;
}

inline FlatField uniform(int value, int reference = 255) {
  return field_of(1, 1, {static_cast<std::uint8_t>(value)}, reference);
}

inline std::string refusal(const std::function<void()>& f) {
  try {
    f();
  } catch (const Error& e) {
    return e.what();
  }
  return "nothing was thrown";
}

inline constexpr Grid kGrid{16, 16, 40, 50, 50, 50};

/// Random columns of runs, gaps and some grey.
inline MemorySlices random_target(const Grid& grid, unsigned seed, bool grey = true) {
  std::mt19937 random(seed);
  MemorySlices t(grid);
  for (int y = 2; y < grid.height_px - 1; ++y) {
    for (int x = 1; x < grid.width_px - 2; ++x) {
      if (random() % 5 == 0) continue;
      for (int n = static_cast<int>(random() % 6); n < grid.layers;) {
        const int run = 1 + static_cast<int>(random() % 12);
        for (int k = n; k < std::min(grid.layers, n + run); ++k) t.at(k, x, y) = 255;
        n += run;
        if (grey && random() % 3 == 0 && n < grid.layers) {
          t.at(n++, x, y) = static_cast<std::uint8_t>(1 + random() % 254);
        }
        n += 1 + static_cast<int>(random() % 10);
      }
    }
  }
  return t;
}

inline Settings even_setup() { return {linear_printer(1, 100), resin(576, 2000), process(1000)}; }

inline Settings with(Settings setup, const FlatField& field) {
  setup.printer.flat_field = field;
  return setup;
}

/// Ways to expose, each with a printer of 16 x 16 pixels.
struct Mode {
  std::string name;
  Settings setup;
};
inline std::vector<Mode> modes() {
  std::vector<Mode> all;
  all.push_back({"continuous", even_setup()});
  Settings capped = even_setup();
  capped.process.omega_max = 1;
  capped.printer = gamma_printer(0.5, 90, 3, 6);
  all.push_back({"capped, gamma, 6 bits", capped});
  Settings kinetic = even_setup();
  kinetic.resin.model = CureModelKind::kinetic;
  kinetic.resin.m = 0.8;
  kinetic.resin.critical_dose_mj_cm3 = 0;
  kinetic.resin.critical_dose_prime = 70;
  all.push_back({"kinetic", kinetic});
  Settings layers = even_setup();
  layers.resin = resin(576, 110);
  layers.process.mode = ExposureMode::layerwise;
  layers.process.exposure_s = 0.2;
  layers.process.bottom_exposure_s = 0.4;
  layers.process.bottom_layers = 3;
  all.push_back({"layer by layer", layers});
  Settings uv = even_setup();
  uv.printer.uv = UvLamp{365, false, {{0, 0}, {255, 600}}};
  uv.resin.model = CureModelKind::kinetic;
  uv.resin.m = 0.99;
  uv.resin.critical_dose_mj_cm3 = 0;
  uv.resin.critical_dose_prime = 64;
  uv.resin.absorbance_height10_um = units::height10_from_e(408);
  uv.resin.inhibition = Inhibition{0.73, units::height10_from_e(37.8), 0.99, 0};
  uv.process.uv.kind = UvKind::constant;
  uv.process.uv.uv_mw_cm2 = 200;
  all.push_back({"UV light", uv});
  Settings pattern = uv;
  pattern.printer.uv->patterned = true;
  pattern.process.uv = {UvKind::patterned, 0, 15, {}};
  all.push_back({"patterned UV light", pattern});
  return all;
}

/// A folder for each test.
class FlatFieldTest : public testing::Test {
 protected:
  FlatFieldTest() {
    const testing::TestInfo* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() /
              ("flat-field-" + std::string(info->name()) + "-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  ~FlatFieldTest() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  static std::string bytes(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  std::filesystem::path folder_;
};

}  // namespace slicecorr::test::flat
