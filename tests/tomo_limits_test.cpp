// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What limits a tomographic printer, against Webber's figures and closed forms.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/limits.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

double width_of(const Limits& l, std::string_view name) {
  for (const Limit& w : l.widths) {
    if (w.name == name) return w.mm;
  }
  return -1;
}

/// Webber's vial and aperture: 4.0632 degrees in the resin, a blur of 0.2344 mm radius 3.3 mm from the focus,
/// a numerical aperture of 0.1063.
TEST(TomoLimits, WebbersFigures) {
  Printer p = bench_printer();
  p.vial = Vial{12.5, 11.8, 1.0, 1.48};
  p.width_px = 1024;
  p.pixel_x_um = p.pixel_y_um = 54;
  p.optics->half_angle_deg = 6.1;
  p.optics->rays_per_pixel = 13;
  Resin r = bench_resin();
  r.n = 1.49969;
  const Limits l = limits_of(p, r, {.radius_mm = 3.3, .voxel_mm = 0.1, .angles = 360});
  EXPECT_NEAR(l.half_angle_deg, 4.0632, 5.1e-5);
  EXPECT_NEAR(width_of(l, "aperture"), 2 * 0.2344, 1.1e-4);
  EXPECT_NEAR(l.numerical_aperture, 0.1063, 5.1e-5);
  EXPECT_NEAR(width_of(l, "wave"), 405e-6 / (2 * 0.106264), 1e-8);
  EXPECT_NEAR(width_of(l, "pixel"), 0.054 / 1.49969, 1e-12);
  EXPECT_NEAR(width_of(l, "turn"), 2 * std::numbers::pi * 3.3 / 360, 1e-12);
  EXPECT_EQ(l.widths.front().name, "aperture");
  // With the aperture that a voxel leaves, pixel and cone are a voxel wide.
  p.optics->half_angle_deg = l.most_half_angle_deg;
  const Limits less = limits_of(p, r, {.radius_mm = 3.3, .voxel_mm = 0.1, .angles = 360});
  EXPECT_NEAR(width_of(less, "aperture") + width_of(less, "pixel"), 0.1, 1e-9);
  EXPECT_NEAR(less.light_share, 1, 1e-9);
  EXPECT_NE(less.widths.front().name, "aperture");
}

TEST(TomoLimits, RecipesAreBeersLaw) {
  Printer p = bench_printer();
  p.vial = Vial{13.5, 12.5, 1.5, 1.5};
  p.width_px = 1280;
  const Limits l = limits_of(
      p, bench_resin(0.55), {.epsilon_per_m_cm = 46, .molar_mass_g = 166.22, .density_g_cm3 = 1.1});
  EXPECT_NEAR(l.alpha_r, 0.55 * 1.25, 1e-9);
  EXPECT_NEAR(l.best_absorption_per_cm, 0.8, 1e-12);
  // 5.2 mM, as Kelly's thesis has it.
  EXPECT_NEAR(l.grams_now * 1.1 / 166.22 * 1e3, 5.2, 0.01);
  EXPECT_NEAR(l.grams_per_kg / l.grams_now, 0.8 / 0.55, 1e-9);
  const Limits dark = limits_of(
      p, bench_resin(0.55), {.epsilon_per_m_cm = 46, .molar_mass_g = 166.22, .without_per_cm = 1});
  EXPECT_LT(dark.grams_per_kg, 0);
  EXPECT_THROW(limits_of(p, bench_resin(), {.epsilon_per_m_cm = 46}), InputError);
  EXPECT_THROW(limits_of(p, bench_resin(), {.radius_mm = 13}), InputError);
}

TEST(TomoLimitsProgram, NamesWhatLimits) {
  const auto r = test::run_program({SLICECORR_BIN_DIR "/slicecorr", "tomo", "limits", "--printer",
                                    "kelly-projector-and-vial", "--resin", "kelly-bpagda-pegda",
                                    "--radius-mm", "5", "--angles", "120", "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_EQ(j["limited_by"], "turn");
  EXPECT_THAT(r.err, testing::HasSubstr("this limits"));
}

}  // namespace
}  // namespace slicecorr::tomo
