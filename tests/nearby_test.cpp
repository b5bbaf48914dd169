// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Where doses have no recursion of derivatives: derivatives by differences against closed forms, how sure
// prints are against prints with inputs that are off, and robust corrections in both of their cases.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <string>

#include "gel_time_models.hpp"
#include "plan_parts.hpp"
#include "refusal.hpp"
#include "slicecorr/dose_derivatives.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "uv_models.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

/// Steps are a thousandth: differences are off by half of it times a second derivative, which is of the
/// size of the dose and its first.
constexpr double kStepShare = 2e-3;

/// Derivatives after full light of `slices` slices.
struct Steady {
  Steady(const Printer& printer, const Resin& resin, const Process& process, int slices,
         double layer_um = 50)
      : model(make_cure_model(printer, resin, process, layer_um)),
        near(nearby_models(printer, resin, process, layer_um, 0)),
        band(model, 1, {true, false, false, 1, true}, &near) {
    const std::uint8_t full = 255;
    for (int n = slices; n-- > 0;) band.add_slice(n, &full);
  }
  CureModel model;
  NearbyModels near;
  BandDerivatives band;
};

Process by_layers(double exposure_s) {
  Process p = process(1);
  p.mode = ExposureMode::layerwise;
  p.exposure_s = exposure_s;
  return p;
}

TEST(Nearby, OfATimeToGel) {
  // One exposure: 1 / Omega = 1 / X + 1 / Y at the window, X as light, Y as its root; in the resin both fall.
  const Resin resin = bright_resin(600);
  const Steady s(linear_printer(1, 30), resin, by_layers(5), 1);
  const double x = 30 * 5 / 60.0, y = std::sqrt(30.0) * 5 / 6;
  const double far_x = x * std::exp(-50 / 600.0), far_y = y * std::exp(-25 / 600.0);
  const auto dose = [](double a, double b) { return a * b / (a + b); };
  const auto by_light = [&](double a, double b) { return dose(a, b) * (b + a / 2) / (a + b); };
  const DoseGradient window = s.band.at(0, 0), far = s.band.at(0, 1);
  EXPECT_NEAR(window.dose, dose(x, y), 1e-9);
  EXPECT_NEAR(far.dose, dose(far_x, far_y), 1e-9);
  EXPECT_NEAR(window.light, by_light(x, y), kStepShare * window.dose);
  EXPECT_NEAR(far.light, by_light(far_x, far_y), kStepShare * far.dose);
  // By the height as by light that is less by 50 / 600 of it.
  EXPECT_NEAR(window.ln_ha, 0, 1e-9);
  EXPECT_NEAR(far.ln_ha, 50 / 600.0 * by_light(far_x, far_y), kStepShare * far.dose);
  EXPECT_NEAR(window.stray * 30, window.light, kStepShare * window.dose);
}

TEST(Nearby, OfAResinThatBleaches) {
  // Layer by layer doses add up at the window; in the layer dOmega / ds = -G(Omega), so that one at its far
  // edge changes by G(far) / G(near) of what changes at the window.
  Resin r = resin(units::volumetric_from_areal(40, 300), units::height10_from_e(300));
  r.bleaching = Bleaching{units::height10_from_e(900), 30};
  const Steady s(linear_printer(1, 30), r, by_layers(5), 1);
  const BleachingLaw& law = *s.model.bleaching();
  const double near = 30 * 5 / 40.0, far = law.after(near, 1, 0);
  EXPECT_NEAR(s.band.upper().dose[0], far, 1e-9);
  EXPECT_NEAR(s.band.upper().light[0], near * law.absorbed(far) / law.absorbed(near),
              kStepShare * far);
}

TEST(Nearby, OfResinThatEnds) {
  Printer printer = linear_printer(1, 100);
  printer.resin_depth_um = 1000;
  const Steady s(printer, resin(576, 2000), process(1000), 60);
  // phi (1 - e^-x), x the depth over the height; phi grows with the height, x falls.
  const double x = 1000 / units::height_e_from_10(2000), phi = s.model.phi_max();
  const double dose = phi * -std::expm1(-x);
  EXPECT_NEAR(s.band.upper().dose[0], dose, 1e-9 * dose);
  EXPECT_NEAR(s.band.upper().ln_ha[0], dose - phi * x * std::exp(-x), kStepShare * dose);
  EXPECT_NEAR(s.band.upper().light[0], dose, kStepShare * dose);
}

TEST(Nearby, BelowAPlatformThatSendsLightBack) {
  Printer printer = linear_printer(1, 100);
  const Resin of = resin(576, 2000);
  const CureModel plain = make_cure_model(printer, of, process(1000), 50);
  printer.platform_reflectance = 0.3;
  const Steady s(printer, of, process(1000), 30);
  const ColumnGradient g(plain, std::vector<std::uint8_t>(30, 255));
  // The dose at the platform is (1 + rho) times what it were, its derivatives, too; some way from it the
  // light that comes back grows with the height.
  EXPECT_NEAR(s.band.upper().dose[0], 1.3 * g.at_node(0).dose, 1e-9);
  EXPECT_NEAR(s.band.upper().ln_ha[0], 1.3 * g.at_node(0).ln_ha, kStepShare * g.at_node(0).dose);
  const double depth = 2 * 50 / units::height_e_from_10(2000), back = 0.3 * std::exp(-depth);
  const DoseGradient one = g.at(1);
  EXPECT_NEAR(s.band.lower().dose[0], (1 + back) * one.dose, 1e-9);
  EXPECT_NEAR(s.band.lower().ln_ha[0], (1 + back) * one.ln_ha + back * depth * one.dose,
              kStepShare * one.dose);
}

TEST(Nearby, OfLayersOfDifferentHeights) {
  // A layer twice as high is two of the same light.
  const Printer printer = linear_printer(1, 100);
  const Resin of = resin(576, 2000);
  const CureModel cut = make_cure_model(printer, of, process(1000), 50);
  Process high = process(1000);
  high.layer_heights_um = {50, 100, 50, 100};
  const CureModel model = make_cure_model(printer, of, high, 50);
  const NearbyModels near = nearby_models(printer, of, high, 50, 1);
  EXPECT_FALSE(derives_by_recursion(model));
  BandDerivatives band(model, 1, {true, true, false, 1, true}, &near);
  const std::vector<std::uint8_t> levels{200, 30, 10, 255};
  for (int n = 4; n-- > 0;) band.add_slice(n, &levels[static_cast<std::size_t>(n)]);
  const ColumnGradient g(cut, std::vector<std::uint8_t>{200, 30, 30, 10, 255, 255}, 1);
  const DoseGradient& at = g.at_node(0);
  EXPECT_NEAR(band.upper().dose[0], at.dose, 1e-9);
  EXPECT_NEAR(band.upper().ln_ha[0], at.ln_ha, kStepShare * at.dose);
  EXPECT_NEAR(band.upper().stray[0], at.stray, kStepShare * at.stray);
  // The second derivative by m has squares of the logarithm of light, 4.6 at the most.
  EXPECT_NEAR(band.upper().m[0], at.m, 30 * kStepShare * at.dose);
}

/// Prints whose doses have no recursion of derivatives.
struct Unusual {
  const char* name;
  std::function<void(slicecorr::Setup&)> make;
};

const std::vector<Unusual>& unusual() {
  static const std::vector<Unusual> all = {
      {"gel-time",
       [](slicecorr::Setup& s) {
         s.resin = bright_resin();
         s.process.speed_mm_h = 800;
       }},
      {"bleaching",
       [](slicecorr::Setup& s) {
         s.resin = resin(units::volumetric_from_areal(40, 300), units::height10_from_e(300));
         s.resin.bleaching = Bleaching{units::height10_from_e(750), 30};
         s.process.speed_mm_h = 450;
       }},
      {"ends", [](slicecorr::Setup& s) { s.printer.resin_depth_um = 2000; }},
      {"sends back", [](slicecorr::Setup& s) { s.printer.platform_reflectance = 0.3; }},
      {"heights",
       [](slicecorr::Setup& s) { s.process.layer_heights_um = {50, 50, 50, 50, 50, 50, 60}; }},
      {"UV light",
       [](slicecorr::Setup& s) {
         s.printer.uv = uv::uv_printer().uv;
         s.resin = uv::resin_1();
         s.process = uv::uv_process(600, 200);
       }},
      {"layers",
       [](slicecorr::Setup& s) {
         s.process = by_layers(1);
         s.resin = resin(576, 1000);
       }},
  };
  return all;
}

slicecorr::Setup unusual_setup(const Unusual& one, const SliceSource& part) {
  slicecorr::Setup s = setup_of(part);
  s.process = process(1000);
  one.make(s);
  return s;
}

Uncertainty off_by(const std::string& text, ExposureMode mode) {
  return parse_uncertainty(text, mode, 100, {});
}

/// All doses that gel so many times those of the resin.
Resin with_doses(Resin r, double times) {
  for (double* const d : {&r.critical_dose_mj_cm3, &r.gel_dose_mj_cm3, &r.critical_dose_prime,
                          &r.gel_a_mj_cm2, &r.gel_b_sqrt_mw_cm2_s}) {
    *d *= times;
  }
  return r;
}

// An error of the dose that gels scales all doses alike, whatever the law: the weak and the strong print are
// those of the resin that gels later or earlier.
TEST(UncertainNearby, AnErrorOfTheDoseIsAnotherDose) {
  const MemorySlices part = comb({{{0, 9}, {16, 30}}, {{0, 20}}, {{4, 12}, {20, 30}}}, 31);
  for (const Unusual& one : unusual()) {
    slicecorr::Setup s = unusual_setup(one, part);
    const MemorySlices shown(CorrectedSlices(part, s));
    // Under UV light peaks inside layers still gel with a little less, which no end of a layer tells.
    const double off_share = s.process.uv.kind == UvKind::off ? 0.02 : 0.03;
    s.uncertainty = off_by(fmt::format("dc={}%", 100 * off_share), s.process.mode);
    const Prediction sure = verify_stack(shown, part, s);
    ASSERT_TRUE(sure.uncertain) << one.name;
    const EdgeBands &up = sure.uncertain->upper, &low = sure.uncertain->lower;
    const double edges = static_cast<double>(up.edges + low.edges);
    ASSERT_GT(edges, 4) << one.name;
    for (const double side : {-1.0, 1.0}) {
      slicecorr::Setup off = s;
      off.uncertainty.reset();
      off.resin = with_doses(s.resin, std::exp(-side * kSdsOf95 * off_share));
      const Prediction p = verify_stack(shown, part, off);
      const auto abs_um = side > 0 ? up.strong_abs_um.value() + low.strong_abs_um.value()
                                   : up.weak_abs_um.value() + low.weak_abs_um.value();
      // Parabolas inside layers, of exponentials in heights of 300 um and more: a hundredth of a slice.
      EXPECT_NEAR(abs_um / edges, p.height_error_um.mean(), 0.5) << one.name << side;
    }
    EXPECT_GT(up.half_width_um.mean(), 1) << one.name;
  }
}

// The same of light that goes to neighbours: what reaches a column is what its derivatives are of.
TEST(UncertainNearby, WhereLightSpreadsDosesAreThoseOfWhatArrives) {
  MemorySlices part({12, 12, 31, 50, 50, 50});
  for (int n = 0; n < 31; ++n) {
    for (int y = 3; y < 9; ++y) {
      for (int x = 3; x < 9; ++x) part.at(n, x, y) = x < 6 || n < 10 || n > 17 ? 255 : 0;
    }
  }
  for (const Unusual& one : unusual()) {
    if (one.name == std::string("UV light") || one.name == std::string("heights")) continue;
    slicecorr::Setup s = unusual_setup(one, part);
    s.printer.spread.gaussians = {{35, 1}};
    s.process.spread_rounds = 0;
    const MemorySlices shown(CorrectedSlices(part, s));
    s.uncertainty = off_by("dc=2%,light=1%", s.process.mode);
    const Prediction both = verify_stack(shown, part, s);
    s.uncertainty = off_by("dc=2%", s.process.mode);
    const Prediction sure = verify_stack(shown, part, s);
    ASSERT_TRUE(sure.uncertain) << one.name;
    slicecorr::Setup off = s;
    off.uncertainty.reset();
    off.resin = with_doses(s.resin, std::exp(-kSdsOf95 * 0.02));
    const EdgeBands &up = sure.uncertain->upper, &low = sure.uncertain->lower;
    const double edges = static_cast<double>(up.edges + low.edges);
    EXPECT_NEAR((up.strong_abs_um.value() + low.strong_abs_um.value()) / edges,
                verify_stack(shown, part, off).height_error_um.mean(), 0.5)
        << one.name;
    // What light does by itself.
    const auto lamp = static_cast<std::size_t>(ErrorSource::lamp);
    EXPECT_GT(both.uncertain->upper.by_source_um[lamp].value(), 1) << one.name;
    EXPECT_EQ(sure.uncertain->upper.by_source_um[lamp].value(), 0) << one.name;
  }
}

TEST(UncertainNearby, WhatIsNotKnownIsRefused) {
  const MemorySlices part = comb({{{0, 9}, {16, 30}}}, 31);
  const std::map<std::string, std::string> where = {
      {"gel-time", "gel-time"},         {"bleaching", "bleaches"},
      {"ends", "ends above"},           {"sends back", "sends light back"},
      {"heights", "different heights"}, {"UV light", "UV light"}};
  for (const Unusual& one : unusual()) {
    if (!where.contains(one.name)) continue;
    slicecorr::Setup s = unusual_setup(one, part);
    s.uncertainty = off_by("noise=1%", s.process.mode);
    EXPECT_THAT(refusal([&] { verify_stack(part, part, s); }),
                testing::AllOf(HasSubstr("of noise"), HasSubstr(where.at(one.name))));
    s.uncertainty = off_by("m=0.01", s.process.mode);
    const bool none = one.name == std::string("gel-time") || one.name == std::string("bleaching");
    if (none) {
      EXPECT_THROW(verify_stack(part, part, s), InputError) << one.name;
    } else {
      EXPECT_NO_THROW(verify_stack(part, part, s)) << one.name;
    }
    EXPECT_THROW(check_derivatives(make_cure_model(s.printer, s.resin, s.process, 50)), InputError)
        << one.name;
  }
}

/// A part of 100 random columns.
MemorySlices random_part(unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> length(2, 7);
  MemorySlices part({10, 10, 40, 50, 50, 50});
  for (int i = 0; i < 100; ++i) {
    int n = length(random);
    for (bool full = true; n < 36; full = !full) {
      const int end = std::min(36, n + length(random));
      for (int k = n; k < end; ++k) part.at(k, i % 10, i / 10) = full ? 255 : 0;
      n = end;
    }
  }
  return part;
}

/// The print with all inputs off to one side.
slicecorr::Setup case_of(const slicecorr::Setup& said, double share, bool weak) {
  slicecorr::Setup off = said;
  off.uncertainty.reset();
  const double sign = weak ? -1 : 1, height = std::exp(sign * share);
  off.resin = with_doses(said.resin, std::exp(-sign * share));
  off.resin.absorbance_height10_um *= height;
  if (off.resin.critical_dose_prime == 0) {
    // The areal dose is held.
    off.resin.critical_dose_mj_cm3 /= height;
    off.resin.gel_dose_mj_cm3 /= height;
  }
  return off;
}

TEST(RobustNearby, LosesAndFillsLessInBothCases) {
  const MemorySlices part = random_part(5);
  for (const Unusual& one : unusual()) {
    slicecorr::Setup s = unusual_setup(one, part);
    s.uncertainty = off_by("ha=4%,dc=4%", s.process.mode);
    const auto fails = [&](bool robust) {
      s.uncertainty->robust = robust;
      const MemorySlices shown(CorrectedSlices(part, s));
      // In the weak case features count, in the strong one gaps.
      return verify_stack(shown, part, case_of(s, 0.04, true)).lost_features +
             verify_stack(shown, part, case_of(s, 0.04, false)).merged_features;
    };
    const std::uint64_t plain = fails(false), robust = fails(true);
    // Layer by layer the window's side of each layer gels in spite of 8 %. What bleaches can't have more light
    // in a gap than its edges leave it: there much is given up.
    if (plain == 0) {
      EXPECT_EQ(robust, 0U) << one.name;
    } else {
      const bool bleaches = one.name == std::string("bleaching");
      EXPECT_LE(robust, bleaches ? plain * 3 / 4 : plain / 5) << one.name;
    }
  }
}

}  // namespace
}  // namespace slicecorr::test
