// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that goes sideways by the projector's blur and the resin's scatter, pixels with gaps between them, and a bath
// behind a flat window: closed forms, transposes, and what jobs are judged by against rays marched at random.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/blurred_projector.hpp"
#include "tomo/operators/footprint.hpp"
#include "tomo_pair.hpp"
#include "tomo_walk.hpp"

namespace slicecorr::tomo {
namespace {

using test::refusal;

Printer blurred_printer(bool dry, double pixel_mm, double sigma_um) {
  Printer p = small_printer(dry, pixel_mm);
  p.spread.gaussians = {{sigma_um, 0.7}, {2.5 * sigma_um, 0.3}};
  return p;
}
Resin scattering_resin(double alpha_per_cm, double um2_per_um) {
  Resin r = bench_resin(alpha_per_cm);
  r.scatter_um2_per_um = um2_per_um;
  return r;
}
Printer before_a_pinhole(Printer p) {
  p.optics->kind = OpticsKind::pinhole;
  p.optics->distance_mm = 30;
  return p;
}

/// Of a voxel of 0.3 mm seen at 25 degrees, the share that a blurred pixel of 0.25 mm gives it.
double share_of_blurred(double sigma_mm, double from_voxel_mm) {
  Printer p = bench_printer();
  p.spread.gaussians = {{1e3 * sigma_mm, 1}};
  const std::vector<BlurredLight> light =
      detail::blurred_light(p, bench_resin(), {1, 1, 4, 4, 0.3, 12});
  EXPECT_EQ(light.size(), 1U);
  const double th = 25 * pi / 180, side = 0.3 / 0.25;
  const detail::Boxes<double> boxes(side * std::cos(th), side * std::sin(th),
                                    light.front().across.soft);
  std::vector<float> numbers{1};
  if (!light.front().blur.none()) numbers = light.front().blur.sum.front().columns;
  double sum = 0;
  const int reach = static_cast<int>(numbers.size()) - 1;
  for (int k = -reach; k <= reach; ++k) {
    const double at = from_voxel_mm / 0.25 + k;
    sum += numbers[static_cast<std::size_t>(std::abs(k))] *
           (boxes.below(at + 0.5) - boxes.below(at - 0.5));
  }
  return sum;
}

TEST(TomoBlur, SharesOfBlurredPixelsAreTheExactIntegrals) {
  // tomography-optics.md; what boxes and whole pixels make of a Gaussian is right to 0.02.
  const double th = 25 * pi / 180, place = 1.2 * std::cos(th) + 0.45 * std::sin(th);
  EXPECT_NEAR(share_of_blurred(0.15, 1.25 - place), 0.52117, 0.012);
  EXPECT_NEAR(share_of_blurred(0.15, 1.5 - place), 0.26642, 0.012);
  EXPECT_NEAR(share_of_blurred(0.06, 1.25 - place), 0.73468, 0.012);
  EXPECT_NEAR(share_of_blurred(0.3, 1.25 - place), 0.30974, 0.002);
  // Far away, by the sum of both variances: a Gaussian of 1 mm is 4 pixels wide.
  EXPECT_NEAR(share_of_blurred(1, 0), 0.25 / std::sqrt(2 * pi), 0.002);
}

TEST(TomoBlur, SharesOfDepthAddUpToAll) {
  const Printer p = blurred_printer(false, 0.25, 100);
  for (const double scatter : {0.5, 20.0, 900.0}) {
    const std::vector<BlurredLight> light =
        detail::blurred_light(p, scattering_resin(2, scatter), {1, 1, 4, 4, 0.25, 4});
    for (double way = 0; way <= 4.4; way += 0.05) {
      double sum = 0, variance = 0;
      for (const BlurredLight& one : light) {
        if (!(one.depth.at(way) > 0)) continue;
        double of_term = one.blur.none() ? 1 : 0, wide = one.across.soft * one.across.soft / 12;
        for (const ImageBlur::Gaussian& g : one.blur.sum) {
          of_term += g.weight;
          double of_numbers = 0;
          for (std::size_t k = 1; k < g.columns.size(); ++k) {
            of_numbers += 2.0 * g.columns[k] * static_cast<double>(k * k);
          }
          variance += one.depth.at(way) * g.weight * of_numbers;
        }
        sum += one.depth.at(way) * of_term;
        variance += one.depth.at(way) * of_term * wide;
      }
      ASSERT_NEAR(sum, 1, 1e-6) << scatter << " " << way;
      // Variances add up, in pixels of 0.25 mm: hats are linear. The last one holds on.
      const double want =
          (0.7 * 0.01 + 0.3 * 0.0625 + scatter * 1e-3 * std::min(way, 4.0)) / 0.0625;
      ASSERT_NEAR(variance, want, 0.02 * want + 0.001) << scatter << " " << way;
    }
  }
}

/// A comet: a head in the middle, a tail to the right and, fainter, upwards; `pitch_um` wide pixels.
SpreadPicture comet(double pitch_um) {
  auto values = std::make_shared<std::vector<std::uint8_t>>(7 * 5, 0);
  const auto at = [&](int right, int up) -> std::uint8_t& {
    return (*values)[static_cast<std::size_t>((2 - up) * 7 + 3 + right)];
  };
  for (int k = 0; k <= 3; ++k) at(k, 0) = static_cast<std::uint8_t>(200 - 50 * k);
  for (int k = 1; k <= 2; ++k) at(0, k) = static_cast<std::uint8_t>(120 - 40 * k);
  at(-1, -1) = 30;
  return {7, 5, pitch_um, values};
}
Printer printer_of_picture(bool dry, double pitch_um) {
  Printer p = small_printer(dry, 0.25);
  p.spread.picture = comet(pitch_um);
  return p;
}

TEST(TomoBlur, OperatorsAreTransposes) {
  for (const bool point : {false, true}) {
    for (const bool dry : {false, true}) {
      Printer p = blurred_printer(dry, 0.25, 120);
      if (point) p = before_a_pinhole(p);
      p.fill_factor = 0.6;
      const Bench bench = make_bench(p, scattering_resin(2, 15), {0.25, 4, 10});
      ASSERT_TRUE(bench.grid.coupled());
      ASSERT_GT(bench.blur.size(), 2U);
      const RandomPair random(bench.grid);
      expect_transposes(*make_projector(bench), random);
      expect_transposes(*make_search_projector(bench, Search::close), random);
    }
  }
  const Bench measured =
      make_bench(printer_of_picture(true, 125), scattering_resin(2, 15), {0.25, 4, 10});
  const RandomPair of_measured(measured.grid);
  expect_transposes(*make_projector(measured), of_measured);
  expect_transposes(*make_search_projector(measured, Search::close), of_measured);
  // Gaps between pixels of light that stays in its slice.
  for (const bool dry : {false, true}) {
    Printer p = small_printer(dry, 0.25);
    p.fill_factor = 0.5;
    for (const int slices : {1, 4, 20}) {
      const Bench bench = make_bench(p, bench_resin(2), {0.25, std::min(slices, 8), 10});
      ASSERT_FALSE(bench.grid.coupled());
      const RandomPair random(bench.grid);
      expect_transposes(*make_projector(bench), random);
      expect_transposes(*make_search_projector(bench, Search::close), random);
    }
  }
}

/// Rays agree with doses to 2 % of the largest: what boxes and whole pixels make of a Gaussian is right to that.
void expect_rays(const Printer& p, const Resin& resin, int angles, std::uint32_t seed) {
  std::mt19937 random(seed);
  const Sampling sampling{0.25, 4, angles};
  const TomoJob job =
      job_of_light(p, resin, sampling, [&](int, int, int) { return random() % 3 == 0 ? 255 : 0; });
  const Agreement a = agreement_of(job, make_bench(p, resin, sampling), 0.02, 400000);
  EXPECT_EQ(a.within, a.all);
  EXPECT_NEAR(a.off, 0, 0.01 + a.noise);
  EXPECT_GT(a.all, 100);
}

TEST(TomoBlur, RaysAgreeOnLightThatTheProjectorBlurs) {
  for (const bool dry : {false, true}) {
    SCOPED_TRACE(dry);
    expect_rays(blurred_printer(dry, 0.25, 100), bench_resin(2), 18, 5);
    expect_rays(before_a_pinhole(blurred_printer(dry, 0.25, 60)), bench_resin(2), 18, 6);
  }
}

/// A measured picture, to all sides differently: as wide as pixels, and narrower.
TEST(TomoBlur, RaysAgreeOnAMeasuredPicture) {
  for (const double pitch_um : {125.0, 40.0}) {
    SCOPED_TRACE(pitch_um);
    expect_rays(printer_of_picture(false, pitch_um), bench_resin(2), 18, 5);
  }
  expect_rays(before_a_pinhole(printer_of_picture(true, 100)), scattering_resin(2, 12), 18, 6);
}

/// A picture of a Gaussian is that Gaussian.
TEST(TomoBlur, APictureOfAGaussianIsOne) {
  constexpr int kSide = 81, kInMiddle = kSide / 2;
  constexpr double pitch_um = 25, sigma_um = 200;
  auto values = std::make_shared<std::vector<std::uint8_t>>();
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double r = std::hypot(x - kInMiddle, y - kInMiddle) * pitch_um / sigma_um;
      values->push_back(static_cast<std::uint8_t>(std::lround(255 * std::exp(-r * r / 2))));
    }
  }
  Printer of_picture = small_printer(false, 0.25), of_gaussian = of_picture;
  of_picture.spread.picture = SpreadPicture{kSide, kSide, pitch_um, values};
  of_gaussian.spread.gaussians = {{sigma_um, 1}};
  const Sampling sampling{0.25, 4, 12};
  const Bench a = make_bench(of_picture, bench_resin(2), sampling),
              b = make_bench(of_gaussian, bench_resin(2), sampling);
  // Both light a window of their own; the middle of it is the same.
  const auto middle = [](const Bench& bench) {
    Light light(bench.grid);
    for (int m = 0; m < bench.grid.angles; ++m) {
      for (int i = 0; i < bench.grid.pixels; ++i) {
        for (int r = 0; r < bench.grid.rows; ++r) {
          const double x = std::fmod(bench.window.column_of(i), 5);
          light.values[bench.grid.pixel(m, i, r)] = static_cast<float>(x * (m + 1));
        }
      }
    }
    return adjoint(*make_projector(bench), {}, light);
  };
  const Field one = middle(a), other = middle(b);
  double most = 0, off = 0;
  for (int z = 0; z < 4; ++z) {
    for (int k = 4; k < 13; ++k) {
      const double d = other.values[b.grid.voxel(k, k, z)];
      most = std::max(most, d);
      off = std::max(off, std::abs(d - one.values[a.grid.voxel(k, k, z)]));
    }
  }
  // Values of 1 in 255 are left out: 0.4 % of the brightest, to sigma 3.5.
  EXPECT_LT(off, 0.015 * most);
}

/// Rays of an aperture fill a disc: what of it a pixel lights (tomography-optics.md, disc of 0.3, pixel of 0.25).
TEST(TomoBlur, AnApertureIsADisc) {
  constexpr int kRays = 1000;
  const auto share = [&](double x, double y) {
    int lit = 0;
    for (const auto& point : aperture_points(kRays)) {
      lit += std::abs(0.3 * point.x - x) < 0.125 && std::abs(0.3 * point.z - y) < 0.125 ? 1 : 0;
    }
    return static_cast<double>(lit) / kRays;
  };
  EXPECT_NEAR(share(0, 0), 0.22105, 0.005);
  EXPECT_NEAR(share(0.3, 0.1), 0.08569, 0.005);
}

TEST(TomoBlur, RaysAgreeOnResinThatScatters) {
  for (const bool dry : {false, true}) {
    SCOPED_TRACE(dry);
    expect_rays(small_printer(dry, 0.25), scattering_resin(2, 12), 18, 7);
  }
  expect_rays(before_a_pinhole(blurred_printer(false, 0.25, 60)), scattering_resin(2, 15), 18, 8);
}

TEST(TomoBlur, RaysAgreeOnGapsBetweenPixels) {
  for (const bool dry : {false, true}) {
    SCOPED_TRACE(dry);
    Printer p = small_printer(dry, 0.25);
    p.fill_factor = 0.4;
    expect_rays(p, bench_resin(2), 18, 9);
    expect_rays(before_a_pinhole(p), bench_resin(2), 18, 10);
  }
}

/// One column, one frame in three lit: what few frames and gaps do is seen one by one.
TEST(TomoBlur, RaysAgreeOnABathBehindAWindow) {
  for (const bool point : {false, true}) {
    Printer p = small_printer(false, 0.25);
    if (point) {
      p = before_a_pinhole(p);
      // The window makes the image smaller: more pixels.
      p.width_px = 26;
      p.height_px = 12;
    }
    p.bath = Bath{12, 1.5, 2, 1.52};
    SCOPED_TRACE(point);
    expect_rays(p, bench_resin(2), 18, 11);
  }
}

TEST(TomoBath, RaysThroughTheWindowAreTheTracers) {
  Printer p = bench_printer();
  p.width_px = 1920;
  p.height_px = 1080;
  p.pixel_x_um = p.pixel_y_um = 100;
  p.optics->kind = OpticsKind::pinhole;
  p.optics->distance_mm = 99.5;
  // tomography-optics.md, 7.
  const auto at = [&](double x, double z) {
    const ImagePlace place = image_place(p, {x, z});
    return std::pair{place.column, place.row};
  };
  p.bath = Bath{30, 1.5, 3, 1.52};
  {
    const auto [column, row] = at(6, 19);
    const LightLine line = chief_ray(p, column, row);
    EXPECT_NEAR(line.x_mm, 5.38218, 5.1e-6);
    EXPECT_NEAR(line.z_mm, 17.04356, 1e-5);
    EXPECT_NEAR(line.slope_x, 0.039761, 5.1e-7);
    EXPECT_NEAR(line.slope_z, 0.125908, 5.1e-7);
    EXPECT_NEAR(line.transmittance, 0.95735, 5.1e-6);
    EXPECT_NEAR(chief_ray(p, at(1e-7, 0).first, at(0, 0).second).x_mm / 1e-7, 0.89923, 5.1e-6);
    EXPECT_NEAR(1e-7 * 0.89923 / chief_ray(p, at(1e-7, 0).first, at(0, 0).second).slope_x, 134.2105,
                2e-3);
  }
  p.bath = Bath{20, 1.5, 0, 1.52};
  {
    const auto [column, row] = at(3, 1);
    const LightLine line = chief_ray(p, column, row);
    EXPECT_NEAR(line.x_mm, 2.79888, 5.1e-6);
    EXPECT_NEAR(line.z_mm, 0.93296, 5.1e-6);
  }
  std::mt19937 random(4);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (random() >> 5) * 0x1p-27;
  };
  for (int i = 0; i < 200; ++i) {
    p.bath = Bath{uniform(10, 80), uniform(1.3, 1.6), uniform(0, 5), uniform(1.4, 1.6)};
    const double column = uniform(0, p.width_px), row = uniform(0, p.height_px);
    double power = 0;
    const LightLine traced = through_window(p, column, row, &power),
                    line = chief_ray(p, column, row);
    ASSERT_NEAR(line.x_mm, traced.x_mm, 1e-9);
    ASSERT_NEAR(line.z_mm, traced.z_mm, 1e-9);
    ASSERT_NEAR(line.slope_x, traced.slope_x, 1e-12);
    ASSERT_NEAR(line.slope_z, traced.slope_z, 1e-12);
    ASSERT_NEAR(line.transmittance, power, 1e-12);
  }
}

TEST(TomoBath, HeightsOnTheAxisAreThoseOfRays) {
  Printer p = dry_printer();
  p.optics = Optics{OpticsKind::pinhole, 99.5};
  p.bath = Bath{30, 1.33, 3, 1.52};
  p.vial->n_outside = 1.33;
  const ImagePlace place = image_place(p, {0, 1e-3});
  const auto ray = ray_in_resin(*p.vial, 1.5, chief_ray(p, place.column, place.row));
  ASSERT_TRUE(ray);
  const double z = ray->entry_z_mm + p.vial->inner_mm * ray->kz / std::sqrt(1 - ray->kz * ray->kz);
  EXPECT_NEAR(z / 1e-3, height_on_axis(p, 1.5), 1e-6);
}

TEST(TomoBath, FilesSayIt) {
  const std::string head =
      "name = \"tank\"\n[display]\nwidth_px = 100\nheight_px = 80\npixel_um = 100\nfill_factor = 0.9\n"
      "[blue]\ncalibration = [[0, 0.0], [255, 2.0]]\n[optics]\nkind = \"pinhole\"\ndistance_mm = 60\n"
      "[rotation]\ndeg_s = 10\ndirection = \"clockwise\"\n";
  const std::string vial = "[vial]\nouter_mm = 5\ninner_mm = 4\n";
  const Printer p =
      parse_printer(head + vial + "[bath]\nwindow_mm = 20\nn = 1.47\nwall_mm = 2\n", "tank.toml");
  EXPECT_EQ(p.bath, (Bath{20, 1.47, 2, 1.52}));
  EXPECT_EQ(p.vial->n_outside, 1.47);
  EXPECT_EQ(p.fill_factor, 0.9);
  const auto refused = [&](const std::string& text, const std::string& words) {
    const std::string said = refusal([&] { parse_printer(head + text, "tank.toml"); });
    EXPECT_THAT(said, testing::HasSubstr(words)) << text;
  };
  refused(vial + "[bath]\nwindow_mm = 5\nn = 1.4\nwall_mm = 2\n", "behind the window");
  refused(vial + "[bath]\nwindow_mm = 70\nn = 1.4\n", "distance_mm");
  refused(vial + "[bath]\nwindow_mm = 20\nn = 0.9\n", "n");
  refused(vial + "[bath]\nwindow_mm = 20\n", "refractive index");
  refused(vial + "n_outside = 1.3\n[bath]\nwindow_mm = 20\nn = 1.4\n", "n_outside");
  refused(vial + "shape = \"square\"\n", "is not of a vial of shape");
  const auto printer_with = [&](const std::string& after, const std::string& line) {
    std::string text = head + vial;
    text.replace(text.find(after) + after.size(), 0, "\n" + line);
    EXPECT_THAT(refusal([&] { parse_printer(text, "tank.toml"); }),
                testing::AllOf(testing::HasSubstr("not counted"),
                               testing::HasSubstr(line.substr(0, line.find(' ')))));
  };
  printer_with("distance_mm = 60", "focus_mm = 2");
  printer_with("distance_mm = 60", "window_mm = 20");
  printer_with("deg_s = 10", "lit_share = 0.5");
  const std::string resin =
      "name = \"gel\"\n[cure]\nmodel = \"jacobs\"\nm = 1.0\nabsorption_per_cm = 1\nn = 1.4\n"
      "gel_dose_mj_cm3 = 20\n";
  EXPECT_EQ(parse_resin(resin, "gel.toml").n, 1.4);
  // What makes a resin turbid is said whole.
  for (const auto& [key, missing] : {std::pair{"extinction_per_cm", "cure.albedo: missing"},
                                     {"albedo", "expected extinction_per_cm too"},
                                     {"anisotropy", "expected extinction_per_cm too"}}) {
    const std::string text = resin + key + " = 0.9\n";
    EXPECT_THAT(refusal([&] { parse_resin(text, "gel.toml"); }), testing::HasSubstr(missing))
        << key;
  }
}

TEST(TomoBlur, WhatIsNotCountedIsRefused) {
  Printer p = small_printer(false, 0.25);
  p.fill_factor = 0.8;
  p.optics->tilt_deg = 1;
  EXPECT_THAT(refusal([&] {
                make_bench(p, bench_resin(), {0.25, 4, 10});
              }),
              testing::HasSubstr("fill_factor"));
}

/// A square of 5 voxels with a slot of one: what sharp light prints blurred light does not, and light that was found
/// for the blur prints more of it.
TEST(TomoBlur, SolvingCountsIt) {
  Printer sharp = small_printer(false, 0.25);
  Printer soft = sharp;
  soft.spread.gaussians = {{150, 1}};
  const Resin resin = bench_resin(0.5);
  const int n = make_bench(soft, resin, {0.25, 4, 24}).grid.voxels, c = n / 2;
  Box<std::uint8_t> part{4, n, n, std::vector<std::uint8_t>(static_cast<std::size_t>(4 * n * n))};
  for (int z = 1; z < 3; ++z) {
    for (int y = -2; y <= 2; ++y) {
      for (int x = -2; x <= 2; ++x) {
        if (x != 0 || y < 0) part.values[part.at(z, c + y, c + x)] = 255;
      }
    }
  }
  PrintOptions options;
  options.angles = 24;
  options.solve.method = Method::osmo;
  options.solve.steps = 20;
  const Print found = solve_print(part, 0.25, soft, resin, options);
  // Level light is of slices, light that goes sideways of rows: the sharp printer's as if it had rays.
  Printer nearly = sharp;
  nearly.spread.gaussians = {{1, 1}};
  TomoJob naive = solve_print(part, 0.25, nearly, resin, options).job;
  const double told = figures_of(naive, dose_of(naive), part).metrics.contrast;
  naive.printer = soft;
  // The window of a blurred printer has more pixels around; those are black.
  const Bench wide = make_bench(soft, resin, naive.sampling),
              narrow = make_bench(nearly, resin, naive.sampling);
  std::vector<std::uint16_t> levels(wide.grid.blocks() * wide.grid.light_of_block(), 0);
  const int right = narrow.window.first_column - wide.window.first_column,
            down = narrow.window.first_row - wide.window.first_row,
            up = wide.grid.rows - narrow.grid.rows - down;
  for (int m = 0; m < 24; ++m) {
    for (int i = 0; i < narrow.grid.pixels; ++i) {
      for (int r = 0; r < narrow.grid.rows; ++r) {
        levels[wide.grid.pixel(m, i + right, r + up)] = naive.levels[narrow.grid.pixel(m, i, r)];
      }
    }
  }
  naive.levels = levels;
  const double real = figures_of(naive, dose_of(naive), part).metrics.contrast;
  RecordProperty("told", std::to_string(told));
  RecordProperty("real", std::to_string(real));
  RecordProperty("found", std::to_string(found.figures.metrics.contrast));
  EXPECT_LT(real, 0.9 * told);
  EXPECT_GT(found.figures.metrics.contrast, real);
}

/// Voxels are judged by their means and in their middles: of a column as wide as they are, lit on the axis alone, the
/// middle of the voxel there has all of the light, and its mean 0.86 of it.
TEST(TomoBlur, CentresAreJudgedApart) {
  for (const bool point : {false, true}) {
    Printer p = small_printer(false, 0.25);
    p.optics->axis_right_px = 0.5;
    if (point) {
      p = before_a_pinhole(p);
      p.optics->distance_mm = 1e4;
    }
    const Sampling sampling{0.25, 4, 24};
    const Resin resin = bench_resin(1e-6);
    const Bench bench = make_bench(p, resin, sampling);
    int column = 0;
    for (int i = 0; i < bench.grid.pixels; ++i) {
      if (std::abs(pixel_x_mm(p, bench.window.first_column + i)) < 1e-9) column = i;
    }
    TomoJob job =
        job_of_light(p, resin, sampling, [&](int, int i, int) { return i == column ? 255 : 0; });
    const int c = bench.grid.voxels / 2;
    const Box<float> means = dose_of(job), centres = dose_of(job, {}, JudgedAt::centres);
    const std::size_t v = means.at(1, c, c);
    const double all = dose_of_turn(bench.grid, bench.exposure) * job.turns * 24 * 2;
    EXPECT_NEAR(centres.values[v] / all, 1, 0.01) << point;
    // The mean over all directions of the share of a square's middle strip: 1 - (1 - 2/pi) sec ..., summed here.
    double mean = 0;
    constexpr int kDirections = 3600, kPlaces = 200;
    for (int k = 0; k < kDirections; ++k) {
      const double th = 2 * pi * (k + 0.5) / kDirections, cosine = std::cos(th),
                   sine = std::sin(th);
      // x of a random place of the square along the strip's normal: the share within half of a side.
      double in = 0;
      for (int i = 0; i < kPlaces; ++i) {
        const double x = (i + 0.5) / kPlaces - 0.5, low = (-0.5 - x * cosine) / sine,
                     high = (0.5 - x * cosine) / sine;
        in +=
            std::clamp(std::max(low, high), -0.5, 0.5) - std::clamp(std::min(low, high), -0.5, 0.5);
      }
      mean += in / kPlaces / kDirections;
    }
    EXPECT_NEAR(means.values[v] / all, mean, 0.01) << point;
    job.part.values[v] = 255;
    job.resin.critical_dose_mj_cm3 = (means.values[v] + centres.values[v]) / 2;
    EXPECT_EQ(share_below_gel(job, means, job.part), 1);
    EXPECT_EQ(share_below_gel(job, centres, job.part), 0);
  }
}

}  // namespace
}  // namespace slicecorr::tomo
