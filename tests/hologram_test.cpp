// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Holograms: closed forms of the optics, published figures, and what must hold of any image.
#include "slicecorr/hologram.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using std::numbers::pi;

PhaseDisplay display_of(int width, int height, double pitch_um = 8) {
  PhaseDisplay d;
  d.width_px = width;
  d.height_px = height;
  d.pitch_um = pitch_um;
  return d;
}
HologramOptics green(double focal_mm) {
  HologramOptics o;
  o.wavelength_nm = 532;
  o.focal_mm = focal_mm;
  return o;
}
/// Rows and columns first..last lit.
HologramPlane square(int side, int first_row, int last_row, int first_column, int last_column) {
  HologramPlane p;
  p.power.resize(static_cast<std::size_t>(side) * side);
  for (int y = first_row; y <= last_row; ++y) {
    for (int x = first_column; x <= last_column; ++x) p.power[y * side + x] = 1;
  }
  return p;
}
std::vector<std::vector<float>> phases(const std::vector<PhaseImage>& images) {
  std::vector<std::vector<float>> all;
  for (const PhaseImage& i : images) all.push_back(i.phase_rad);
  return all;
}

TEST(HologramOptics, AreThoseOfTheDisplay) {
  const HologramGeometry g = geometry_of(display_of(1920, 1080), green(400));
  EXPECT_NEAR(g.order_deg, 3.81298, 5e-6);
  EXPECT_NEAR(g.half_field_deg, 1.90544, 5e-6);
  EXPECT_NEAR(g.field_mm, 26.6, 5e-4);
  EXPECT_NEAR(g.pixel_x_mm, 0.0138542, 5e-8);
  EXPECT_NEAR(g.pixel_y_mm, 0.0246296, 5e-8);
  EXPECT_NEAR(g.depth_of_focus_x_mm, 1.44314, 5e-6);
  EXPECT_NEAR(g.depth_of_focus_y_mm, 4.56104, 5e-6);
  EXPECT_NEAR(geometry_of(display_of(1920, 1080, 4), green(400)).half_field_deg, 3.81298, 5e-6);
  EXPECT_NEAR(geometry_of(display_of(1920, 1080, 2), green(400)).half_field_deg, 7.64299, 5e-6);
}

TEST(HologramOptics, RelaysMagnify) {
  HologramOptics o = green(400);
  o.relay_f1_mm = 100;
  o.relay_f2_mm = 250;
  const HologramGeometry g = geometry_of(display_of(1920, 1080), o);
  EXPECT_NEAR(g.field_mm, 26.6 * 2.5, 2e-3);
  EXPECT_NEAR(g.depth_of_focus_x_mm, 1.44314 * 6.25, 5e-5);
}

TEST(HologramOptics, ZeroOrder) {
  EXPECT_NEAR(zero_order(0.87, 0.005, 1), 0.01056, 5e-6);
  EXPECT_NEAR(zero_order(1, 0.005, 1), 0.005, 5e-7);
  EXPECT_NEAR(zero_order(0.87, 0, 1), 0.00103, 5e-6);
  EXPECT_NEAR(zero_order(0.87, 0, 0.5), 0.42, 0.005);
}

TEST(GerchbergSaxton, MeetsAnIndependentOnesFigures) {
  struct Row {
    int steps;
    double rms, efficiency, padded;
  };
  const PhaseDisplay d = display_of(128, 128);
  const HologramPlane p = square(128, 80, 111, 80, 111);
  for (const Row& row : {Row{1, 0.32331, 0.88031, 0.7785}, Row{10, 0.2192, 0.9279, 0.766},
                         Row{50, 0.1707, 0.943, 0.748}, Row{200, 0.155, 0.948, 0.737}}) {
    HologramOptions options;
    options.steps = row.steps;
    const auto images = make_holograms(d, green(100), {p}, options, {});
    const ImageFigures f = figures_of(d, green(100), p, phases(images), {});
    // Half a unit of the last digit of the table, and 1e-5 for single precision.
    EXPECT_NEAR(f.rms_error, row.rms, row.steps == 1 ? 1.5e-5 : 6e-4) << row.steps;
    EXPECT_NEAR(f.efficiency, row.efficiency, row.steps == 1 ? 1.5e-5 : 6e-4) << row.steps;
    EXPECT_NEAR(f.rms_error_padded, row.padded, 6e-4) << row.steps;
  }
}

TEST(GerchbergSaxton, SmallOneToSixDigits) {
  const PhaseDisplay d = display_of(32, 32);
  const HologramPlane p = square(32, 20, 27, 20, 27);
  HologramOptions options;
  options.steps = 5;
  const auto images = make_holograms(d, green(100), {p}, options, {});
  const ImageFigures f = figures_of(d, green(100), p, phases(images), {});
  EXPECT_NEAR(f.efficiency, 0.927725, 2e-6);
  EXPECT_NEAR(f.rms_error, 0.231976, 2e-6);
}

TEST(GerchbergSaxton, EachHologramHasItsOwnSeed) {
  const PhaseDisplay d = display_of(32, 32);
  const HologramPlane p = square(32, 20, 27, 20, 27);
  HologramOptions options;
  options.steps = 3;
  options.holograms = 2;
  const auto both = make_holograms(d, green(100), {p}, options, {});
  // x <- 1664525 x + 1013904223, once for each pixel.
  std::uint32_t x = 1;
  for (int i = 0; i < 32 * 32; ++i) x = 1664525u * x + 1013904223u;
  EXPECT_EQ(both[0].seed, 1u);
  EXPECT_EQ(both[1].seed, x);
  options.holograms = 1;
  options.seed = x;
  EXPECT_EQ(make_holograms(d, green(100), {p}, options, {})[0].phase_rad, both[1].phase_rad);
}

TEST(GerchbergSaxton, FreeLightBesideTheTargetIsTruerOnIt) {
  const PhaseDisplay d = display_of(128, 128);
  const HologramPlane p = square(128, 80, 111, 80, 111);
  HologramOptions options;
  options.free_outside = true;
  const ImageFigures f =
      figures_of(d, green(100), p, phases(make_holograms(d, green(100), {p}, options, {})), {});
  EXPECT_NEAR(f.rms_error, 0.026, 1e-3);
  EXPECT_NEAR(f.efficiency, 0.862, 1e-3);
  EXPECT_NEAR(f.rms_error_padded, 0.73, 6e-3);
}

TEST(GerchbergSaxton, HologramsInTurnAverageSpeckle) {
  const PhaseDisplay d = display_of(128, 128);
  const HologramPlane p = square(128, 80, 111, 80, 111);
  HologramOptions options;
  options.holograms = 16;
  const auto all = phases(make_holograms(d, green(100), {p}, options, {}));
  const auto contrast = [&](std::size_t m) {
    return figures_of(d, green(100), p, {all.begin(), all.begin() + static_cast<std::ptrdiff_t>(m)},
                      {})
        .speckle_contrast;
  };
  // C1/sqrt(M); the draw of 4096 samples, a quarter of them independent, is known to 3 %.
  EXPECT_NEAR(contrast(1), 0.748, 0.02);
  EXPECT_NEAR(contrast(4), 0.375, 0.02);
  EXPECT_NEAR(contrast(16), 0.196, 0.02);
}

TEST(GerchbergSaxton, TwoPlanesShareThePowerEvenly) {
  const PhaseDisplay d = display_of(256, 256);
  HologramPlane near = square(256, 152, 199, 152, 199), far = square(256, 56, 103, 152, 199);
  near.dz_mm = -40;
  far.dz_mm = 40;
  HologramOptions options;
  options.steps = 20;
  const auto images = phases(make_holograms(d, green(100), {near, far}, options, {}));
  EXPECT_NEAR(figures_of(d, green(100), near, images, {}).efficiency, 0.4614, 6e-4);
  EXPECT_NEAR(figures_of(d, green(100), far, images, {}).efficiency, 0.4614, 6e-4);
  // What a draw of one hologram for each pixel gives: a quarter each.
  const auto first = phases(make_holograms(d, green(100), {near}, options, {}));
  const auto second = phases(make_holograms(d, green(100), {far}, options, {}));
  std::vector<float> drawn = first[0];
  std::uint32_t x = 1;
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    x = 1664525u * x + 1013904223u;
    if (x >= 0x80000000u) drawn[i] = second[0][i];
  }
  EXPECT_NEAR(figures_of(d, green(100), near, {drawn}, {}).efficiency, 0.2514, 0.004);
  EXPECT_NEAR(figures_of(d, green(100), far, {drawn}, {}).efficiency, 0.2512, 0.004);
}

TEST(GerchbergSaxton, ImagesGoWhereTheyAreMoved) {
  const PhaseDisplay d = display_of(128, 128);
  const HologramGeometry g = geometry_of(d, green(100));
  HologramPlane p = square(128, 70, 79, 70, 79);
  p.dx_mm = 20 * g.pixel_x_mm;
  p.dy_mm = 16 * g.pixel_y_mm;  // upwards, so to rows with smaller numbers
  HologramOptions options;
  options.steps = 10;
  const auto images = make_holograms(d, green(100), {p}, options, {});
  const auto power = power_at(d, green(100), images[0].phase_rad, 0, 1, {});
  double inside = 0, all = 0;
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      const double v = power[static_cast<std::size_t>(y) * 128 + x];
      all += v;
      if (x >= 90 && x < 100 && y >= 54 && y < 64) inside += v;
    }
  }
  EXPECT_NEAR(all, 1, 1e-5);
  EXPECT_NEAR(inside, figures_of(d, green(100), p, phases(images), {}).efficiency, 1e-5);
  EXPECT_GT(inside, 0.8);
}

TEST(GerchbergSaxton, RelaysTurnNothing) {
  const PhaseDisplay d = display_of(64, 64);
  HologramOptics relayed = green(100);
  relayed.relay_f1_mm = 100;
  relayed.relay_f2_mm = 200;
  HologramPlane p = square(64, 40, 47, 44, 55);
  p.dz_mm = 12;
  HologramOptions options;
  options.steps = 10;
  const auto images = make_holograms(d, relayed, {p}, options, {});
  EXPECT_GT(figures_of(d, relayed, p, phases(images), {}).efficiency, 0.8);
  // Four times less deep in front of the relay, and upside down.
  HologramPlane before = square(64, 17, 24, 9, 20);
  before.dz_mm = 3;
  EXPECT_NEAR(figures_of(d, green(100), before, phases(images), {}).efficiency,
              figures_of(d, relayed, p, phases(images), {}).efficiency, 1e-4);
}

TEST(GerchbergSaxton, ThreadsDoNotChangeABit) {
  // Large enough to be shared among threads.
  const PhaseDisplay d = display_of(192, 108);
  HologramPlane p;
  p.power.resize(192 * 108);
  for (int i = 0; i < 20; ++i) p.power[static_cast<std::size_t>(10 + i) * 192 + 60 + i % 7] = 1;
  HologramPlane q = p;
  q.dz_mm = 5;
  ExecutionContext one, four;
  one.threads = 1;
  four.threads = 4;
  EXPECT_EQ(make_holograms(d, green(100), {p, q}, {}, one)[0].phase_rad,
            make_holograms(d, green(100), {p, q}, {}, four)[0].phase_rad);
}

TEST(HologramLevels, FewCostLight) {
  PhaseDisplay d = display_of(128, 128);
  const HologramPlane p = square(128, 80, 111, 80, 111);
  const auto images = make_holograms(d, green(100), {p}, {}, {});
  const auto shown = [&](int levels) {
    d.levels = levels;
    return figures_of(d, green(100), p, {phase_of_grey(d, grey_of_phase(d, images[0].phase_rad))},
                      {})
        .efficiency;
  };
  EXPECT_NEAR(shown(256), 0.943, 6e-4);
  // Rounding to L levels leaves sinc^2(1/L) of the light in the image.
  EXPECT_NEAR(shown(8), 0.943 - 0.045, 4e-3);
}

TEST(HologramLevels, ShortStrokesShowTheNearestPhase) {
  PhaseDisplay d = display_of(2, 2);
  d.stroke_turns = 0.5;
  d.levels = 4;
  const auto pi = std::numbers::pi_v<float>;
  // Levels at 0, 1/4, 1/2 and 3/4 of half a turn.
  EXPECT_EQ(grey_of_phase(d, {0.1F * pi, 0.3F * pi, 1.2F * pi, 1.7F * pi}).pixels,
            (std::vector<std::uint8_t>{0, 64, 192, 0}));
}

TEST(AngularSpectrum, GaussianBeamSpreadsAsItsClosedFormSays) {
  const int n = 256;
  const double pitch = 0.008, w0 = 0.05;
  std::vector<std::complex<float>> field(n * n);
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const double r2 = pitch * pitch * ((x - n / 2) * (x - n / 2) + (y - n / 2) * (y - n / 2));
      field[y * n + x] = static_cast<float>(std::exp(-r2 / (w0 * w0)));
    }
  }
  propagate(field, n, n, pitch, 532, 30, {});
  double sum = 0, sum_x2 = 0;
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const double p = std::norm(std::complex<double>(field[y * n + x]));
      sum += p;
      sum_x2 += p * pitch * pitch * (x - n / 2) * (x - n / 2);
    }
  }
  // The second moment of a Gaussian beam's power is w^2/4.
  EXPECT_NEAR(2 * std::sqrt(sum_x2 / sum), 0.113241, 2e-5);
}

TEST(AngularSpectrum, FocusLiesWhereTheLensPutsIt) {
  // A flat phase with the lens of 20 mm: a spot 20 mm behind the focal plane, none before it.
  const PhaseDisplay d = display_of(128, 128);
  std::vector<float> phase(128 * 128);
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 128; ++x) {
      const double r2 = 0.008 * 0.008 * ((x - 64) * (x - 64) + (y - 64) * (y - 64));
      phase[y * 128 + x] = static_cast<float>(pi * 20 * r2 / (532e-6 * 100 * 100));
    }
  }
  const auto brightest = [&](double z) {
    const auto power = power_at(d, green(100), phase, z, 2, {});
    return *std::max_element(power.begin(), power.end());
  };
  // The depth of focus is 20 mm.
  for (const double other : {-5.0, 0.0, 45.0, 62.0}) EXPECT_GT(brightest(20), 2 * brightest(other));
}

TEST(Hologram, RefusesWhatCanNotBe) {
  const HologramPlane p = square(64, 40, 47, 40, 47);
  const auto make = [&](const PhaseDisplay& d, const HologramOptics& o,
                        const HologramPlane& plane) {
    return make_holograms(d, o, {plane}, {}, {});
  };
  EXPECT_THROW(make(display_of(64, 64, 0), green(100), p), InputError);
  EXPECT_THROW(make(display_of(64, 64), green(0), p), InputError);
  PhaseDisplay one_level = display_of(64, 64);
  one_level.levels = 1;
  EXPECT_THROW(make(one_level, green(100), p), InputError);
  HologramPlane far = p;
  far.dx_mm = 3;  // the half field is 3.3 mm
  EXPECT_THROW(make(display_of(64, 64), green(100), far), InputError);
  far = p;
  far.dz_mm = 1300;  // 1299 mm
  EXPECT_THROW(make(display_of(64, 64), green(100), far), InputError);
  EXPECT_THROW(make(display_of(64, 64), green(100), square(64, 1, 0, 1, 0)), InputError);
  const GreyImage black{8, 8, std::vector<std::uint8_t>(64)};
  const GreyImage white{64, 64, std::vector<std::uint8_t>(64 * 64, 255)};
  EXPECT_THROW(plane_of_picture(black, "black.png", display_of(64, 64), green(100)), InputError);
  EXPECT_THROW(plane_of_picture(white, "white.png", display_of(64, 64), green(100)), InputError);
  EXPECT_THROW(plane_of_picture(white, "white.png", display_of(32, 32), green(100)), InputError);
}

TEST(Hologram, LightOnTheAxisIsToldUnlessTheStrokeIsKnown) {
  PhaseDisplay d = display_of(64, 64);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  HologramOptions options;
  options.steps = 1;
  make_holograms(d, green(100), {square(64, 40, 47, 40, 47)}, options, context);
  EXPECT_EQ(told, "");
  make_holograms(d, green(100), {square(64, 30, 37, 30, 37)}, options, context);
  EXPECT_NE(told.find("1.1 % of all"), std::string::npos) << told;
  told.clear();
  d.stroke_turns = 1;
  make_holograms(d, green(100), {square(64, 30, 37, 30, 37)}, options, context);
  EXPECT_EQ(told, "");
}

}  // namespace
}  // namespace slicecorr
