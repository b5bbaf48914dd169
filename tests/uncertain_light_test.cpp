// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How sure predictions are under UV light and where light spreads: against figures that were computed
// apart, and against predictions with inputs that are off.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "plan_parts.hpp"
#include "refusal.hpp"
#include "slicecorr/dose_derivatives.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "uv_models.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

Uncertainty off_by(const std::string& text, double reference_mw_cm2 = 100) {
  return parse_uncertainty(text, ExposureMode::continuous, reference_mw_cm2, {});
}

/// The dissertation's Resin 1 under 200 mW/cm² of UV light.
struct Uv {
  Printer printer = uv::uv_printer();
  Resin resin = uv::resin_1();
  Process process = uv::uv_process(1000, 200);
  CureModel model(double layer_um = 50) const {
    return make_cure_model(printer, resin, process, layer_um);
  }
};

TEST(DerivativesUnderUv, AreTheElasticitiesOfTheSteadyDose) {
  const Uv at;
  const CureModel model = at.model();
  const NearbyModels near = nearby_models(at.printer, at.resin, at.process, 50, 1);
  BandDerivatives band(model, 1, {true, true, false, 1, true}, &near);
  EXPECT_TRUE(band.by_differences());
  const std::uint8_t full = 255;
  const int slices = 200;  // 25 absorbance heights
  for (int n = slices; n-- > 0;) band.add_slice(n, &full);
  const auto& f = band.upper();
  const double dose = f.dose[0];
  // Of phi, computed apart; of a difference of a thousandth to a thousandth or two, and tables to 1e-6
  // of the dose over a step of 1e-3.
  EXPECT_NEAR(f.light[0] / dose, 1.09109, 0.004);
  EXPECT_NEAR(f.m[0] / dose, 3.40072, 0.015);
  EXPECT_NEAR(f.ln_ha[0] / dose, 1.14266, 0.004);
  // Stray light acts on full light as a relative change of it by 1 / 100 per mW/cm².
  EXPECT_NEAR(f.stray[0] / f.light[0], 0.01, 1e-4);
}

TEST(DerivativesUnderUv, WithHardlyAnyUvLightAreTheRecursions) {
  // At 3 um of a dead zone, and where doses are looked at far from the window.
  Uv at;
  at.resin.m = at.resin.inhibition->m = 1;
  at.process.uv.uv_mw_cm2 = 1e-6;
  const CureModel model = at.model();
  Process off = at.process;
  off.uv = {};
  const CureModel plain = make_cure_model(at.printer, at.resin, off, 50);
  const NearbyModels near = nearby_models(at.printer, at.resin, at.process, 50, 0);
  BandDerivatives by_difference(model, 1, {true, false, false, 1, true}, &near);
  BandDerivatives recursion(plain, 1, {true, false, false, 1, false});
  std::vector<std::uint8_t> pixels(60);
  for (std::size_t n = 0; n < pixels.size(); ++n) {
    pixels[n] = static_cast<std::uint8_t>(n % 20 < 8 ? 10 : 200 + n % 7);
  }
  for (int n = 60; n-- > 0;) {
    by_difference.add_slice(n, &pixels[static_cast<std::size_t>(n)]);
    recursion.add_slice(n, &pixels[static_cast<std::size_t>(n)]);
    const auto &a = by_difference.upper(), &b = recursion.upper();
    ASSERT_NEAR(a.dose[0], b.dose[0], 1e-4 * b.dose[0]) << n;
    EXPECT_NEAR(a.ln_ha[0], b.ln_ha[0], 4e-3 * b.dose[0]) << n;
    EXPECT_NEAR(a.light[0], b.dose[0], 4e-3 * b.dose[0]) << n;
    EXPECT_NEAR(a.stray[0], b.stray[0], 4e-3 * b.stray[0] + 1e-6) << n;
    // The parabola of logarithms between ends and middle, against the exponential: it misses third
    // differences, most where doses are far below 1.
    for (const double t : {0.2, 0.7}) {
      if (n > 57) continue;
      EXPECT_NEAR(by_difference.at(0, t).dose, recursion.at(0, t).dose, 6e-4) << n;
    }
  }
}

Setup uv_setup(const SliceSource& part) {
  slicecorr::Setup s;
  const Uv at;
  s.printer = at.printer;
  s.printer.width_px = part.grid().width_px;
  s.printer.height_px = part.grid().height_px;
  s.resin = at.resin;
  s.process = at.process;
  s.process.speed_mm_h = 600;
  return s;
}

// An error of the dose that gels scales all doses alike: the weak and the strong print are those of the
// resin that gels later or earlier, whatever light there is.
TEST(UncertainUnderUv, AnErrorOfTheDoseIsAnotherDose) {
  const MemorySlices part = comb({{{0, 9}, {16, 30}}, {{0, 20}}, {{4, 12}, {20, 30}}}, 31);
  slicecorr::Setup s = uv_setup(part);
  const CorrectedSlices corrected(part, s);
  const MemorySlices shown(corrected);
  s.uncertainty = off_by("dc=3%");
  const Prediction sure = verify_stack(shown, part, s);
  ASSERT_TRUE(sure.uncertain);
  for (const double side : {-1.0, 1.0}) {
    slicecorr::Setup off = s;
    off.uncertainty.reset();
    // Strong: gels earlier.
    const double factor = std::exp(-side * kSdsOf95 * 0.03);
    off.resin.critical_dose_prime *= factor;
    const Prediction p = verify_stack(shown, part, off);
    const EdgeBands &up = sure.uncertain->upper, &low = sure.uncertain->lower;
    const double edges = static_cast<double>(up.edges + low.edges);
    const auto abs_um = side > 0 ? up.strong_abs_um.value() + low.strong_abs_um.value()
                                 : up.weak_abs_um.value() + low.weak_abs_um.value();
    // Parabolas inside layers: a hundredth of a slice.
    EXPECT_NEAR(abs_um / edges, p.height_error_um.mean(), 0.5) << side;
  }
  EXPECT_GT(sure.uncertain->upper.half_width_um.mean(), 5);
}

TEST(UncertainUnderUv, WhatIsNotKnownIsRefused) {
  const MemorySlices part = comb({{{0, 9}, {16, 30}}}, 31);
  slicecorr::Setup s = uv_setup(part);
  s.uncertainty = off_by("noise=1%");
  EXPECT_THAT(refusal([&] { verify_stack(part, part, s); }), HasSubstr("noise under UV light"));
  s.uncertainty = off_by("m=0.01");
  s.resin = resin(320, 900);
  s.resin.inhibition = Inhibition{0.73, 90, 1, 0};
  EXPECT_THAT(refusal([&] { verify_stack(part, part, s); }), HasSubstr("critical_dose_prime"));
}

TEST(UncertainWhereLightSpreads, AnErrorOfTheDoseIsAnotherDose) {
  // Half of the pixels are a block, half a block with a gap, whose light spreads into each other.
  MemorySlices part({12, 12, 31, 50, 50, 50});
  for (int n = 0; n < 31; ++n) {
    for (int y = 3; y < 9; ++y) {
      for (int x = 3; x < 9; ++x) {
        part.at(n, x, y) = x < 6 && n > 9 && n < 14 ? std::uint8_t{0} : std::uint8_t{255};
      }
    }
  }
  slicecorr::Setup s = setup_of(part);
  s.process.speed_mm_h = 1000;
  s.printer.spread.gaussians = {{25, 1}};
  s.process.spread_rounds = 0;
  const CorrectedSlices corrected(part, s);
  const MemorySlices shown(corrected);
  s.uncertainty = off_by("dc=3%");
  const Prediction sure = verify_stack(shown, part, s);
  ASSERT_TRUE(sure.uncertain);
  for (const double side : {-1.0, 1.0}) {
    slicecorr::Setup off = s;
    off.uncertainty.reset();
    off.resin.critical_dose_mj_cm3 *= std::exp(-side * kSdsOf95 * 0.03);
    const Prediction p = verify_stack(shown, part, off);
    const EdgeBands &up = sure.uncertain->upper, &low = sure.uncertain->lower;
    const double edges = static_cast<double>(up.edges + low.edges);
    const auto abs_um = side > 0 ? up.strong_abs_um.value() + low.strong_abs_um.value()
                                 : up.weak_abs_um.value() + low.weak_abs_um.value();
    EXPECT_NEAR(abs_um / edges, p.height_error_um.mean(), 0.01) << side;
  }
}

TEST(UncertainSlicesThatDiffer, AnErrorOfTheDoseIsAnotherDose) {
  const MemorySlices part = comb({{{0, 9}, {16, 30}}, {{0, 20}}, {{4, 12}, {20, 30}}}, 31);
  slicecorr::Setup s = setup_of(part);
  s.process.speed_mm_h = 1500;
  for (int n = 0; n < 31; ++n) s.process.slice_speed_mm_h.push_back(1500 - 25 * (n % 20));
  s.process.slice_lamps = SliceLamps::stay;
  const CorrectedSlices corrected(part, s);
  const MemorySlices shown(corrected);
  s.uncertainty = off_by("dc=3%");
  const Prediction sure = verify_stack(shown, part, s);
  slicecorr::Setup off = s;
  off.uncertainty.reset();
  off.resin.critical_dose_mj_cm3 *= std::exp(-kSdsOf95 * 0.03);
  const Prediction p = verify_stack(shown, part, off);
  const EdgeBands &up = sure.uncertain->upper, &low = sure.uncertain->lower;
  EXPECT_NEAR((up.strong_abs_um.value() + low.strong_abs_um.value()) /
                  static_cast<double>(up.edges + low.edges),
              p.height_error_um.mean(), 0.01);
}

}  // namespace
}  // namespace slicecorr::test
