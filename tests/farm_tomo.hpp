// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_tomo.hpp
/// Tomographic prints for tests of the farm: a small printer with a vial, parts that solve in a moment.
#pragma once

#include "farm_fixture.hpp"
#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::test {

/// 64 x 40 pixels of 0.125 mm before a vial of 3.5 mm in a bath of the resin's index.
constexpr const char* kVialPrinterToml = R"(
name = "vial"
[display]
width_px = 64
height_px = 40
pixel_um = 125.0
bit_depth = 8
[blue]
wavelength_nm = 405
calibration = [[0, 0.002], [255, 2.0]]
[vial]
outer_mm = 4.0
inner_mm = 3.5
n_outside = 1.5
n_wall = 1.5
[optics]
kind = "telecentric"
[rotation]
deg_s = 25
direction = "clockwise"
max_fps = 60
)";

constexpr const char* kVialResinToml = R"(
name = "gel"
[cure]
model = "jacobs"
m = 1.0
wavelength_nm = 405
absorption_per_cm = 2.0
n = 1.5
gel_dose_mj_cm3 = 20.0
)";

class FarmTomography : public FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    write_file(dir / "vial.toml", kVialPrinterToml);
    write_file(dir / "gel.toml", kVialResinToml);
  }
  /// Of `slicecorr tomo solve` as of `slicefarm submit`, which has --mode besides.
  std::vector<std::string> tomo_options() const {
    return {"--printer", dir / "vial.toml", "--resin", dir / "gel.toml", "--voxel-mm",
            "0.25",      "--method",        "osmo",    "--iterations",   "3"};
  }
  /// What `slicecorr tomo solve` and `tomo report` make of the same, as BASE.frames, .json and .html;
  /// the exit code of the first.
  int tomo_reference(const std::string& base, const std::vector<std::string>& what) const {
    std::vector<std::string> arguments = {"tomo",           "solve",  "-o",
                                          base + ".frames", "--json", base + ".json"};
    arguments.insert(arguments.end(), what.begin(), what.end());
    const RunResult r = program("slicecorr", arguments);
    EXPECT_TRUE(r.exit_code == 0 || r.exit_code == 5) << r.err;
    EXPECT_EQ(
        program("slicecorr", {"tomo", "report", base + ".frames", "-o", base + ".html"}).exit_code,
        0);
    return r.exit_code;
  }
  void expect_same_print(const std::string& a, const std::string& b) const {
    for (const char* ending : {".frames", ".json", ".html"}) {
      ASSERT_TRUE(fs::exists(a + ending)) << a << ending;
      EXPECT_TRUE(text_of_file(a + ending) == text_of_file(b + ending)) << a << ending;
    }
  }
  /// Two bars with a gap, so many slices high.
  std::string make_volume(const std::string& name, int slices) const {
    tomo::Box<std::uint8_t> box{slices, 9, 9, {}};
    for (int z = 0; z < slices; ++z) {
      for (int y = 0; y < 9; ++y) {
        for (int x = 0; x < 9; ++x) box.values.push_back(x < 3 || x > 5 ? 255 : 0);
      }
    }
    const std::string path = dir / name;
    tomo::write_npy(path, box);
    return path;
  }
};

}  // namespace slicecorr::test
