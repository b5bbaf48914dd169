// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <numbers>
#include <random>
#include <set>

#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "tomo_reference.hpp"

namespace slicecorr::tomo {
namespace {

using std::numbers::pi;

/// A kind of light with a grid on which the pair is tried.
struct LightKind {
  const char* name;
  TomoGrid grid;
  RayTables optics;
  bool insert = false;
};

std::vector<LightKind> light_kinds() {
  std::vector<LightKind> all;
  for (const int slices : {1, 11, 40}) {
    TomoGrid grid = square_grid(61, 50, slices, 1.5);
    all.push_back({"plain", grid, {}});
    grid.angles = 49;  // odd: nothing is folded
    all.push_back({"odd", grid, {}});
    all.push_back({"attenuated", grid, {.alpha_per_mm = 0.8}});
    all.push_back({"insert", grid, {.alpha_per_mm = 0.3}, true});
    all.push_back({"insert alone", square_grid(61, 50, slices, 1.5), {}, true});
    TomoGrid fine = grid;
    fine.pixels = 90;
    fine.pixel_mm = 0.031;  // fewer voxels than pixels, and a detector narrower than the vial
    all.push_back({"fine pixels", fine, {.alpha_per_mm = 0.2}});
    all.push_back({"fine pixels, insert", fine, {.alpha_per_mm = 0.2}, true});
    // Angles that turn into each other, and voxels of two pixels. None is at 45 degrees, where the
    // edges of an insert pass through the middles of voxels.
    TomoGrid turned = square_grid(61, 52, slices, 1.5);
    all.push_back({"turns, attenuated", turned, {.alpha_per_mm = 0.8}});
    all.push_back({"turns, insert", turned, {.alpha_per_mm = 0.3}, true});
    turned.pixels = 121;
    turned.pixel_mm = turned.voxel_mm() / 2;
    all.push_back({"two pixels", turned, {}});
    all.push_back({"two pixels, attenuated", turned, {.alpha_per_mm = 0.8}});
    all.push_back({"two pixels, insert", turned, {.alpha_per_mm = 0.3}, true});
    turned.voxels = 60;  // even, and pixels neither one nor two to a voxel
    turned.angles = 47;
    all.push_back({"even", turned, {.alpha_per_mm = 0.8}});
    TomoGrid coarse = grid;
    coarse.pixels = 31;
    coarse.pixel_mm = 0.12;
    all.push_back({"coarse pixels", coarse, {}});
    LightKind refracted{"refracted", grid, {.alpha_per_mm = 0.4}};
    LightKind pinhole{"refracted, uneven lines", square_grid(61, 50, slices, 1.5), {}};
    for (int i = 0; i < 61; ++i) {
      const double q = (i - 30) / 31.0;
      refracted.optics.weight.push_back(1.4 - 0.5 * q * q);
      refracted.optics.turn_rad.push_back(0.7 * q + 0.2 * q * q * q);
      pinhole.optics.weight.push_back(1.4 - 0.5 * q * q);
      pinhole.optics.turn_rad.push_back(0.7 * q);
      pinhole.optics.line_mm.push_back(1.1 * q - 0.1 * q * q * q);
    }
    all.push_back(refracted);
    all.push_back(pinhole);
  }
  return all;
}

std::shared_ptr<const Shadow> shadow_of(const LightKind& c) {
  if (!c.insert) return nullptr;
  // Not the same in all slices.
  return std::make_shared<Shadow>(cast_shadow(part_of(c.grid, [](double x, double y, double z) {
    return std::hypot(x - 0.2, y + 0.1) < 0.25 + 0.1 * z || (std::abs(x + .5) < .05 && y > .2);
  })));
}

TEST(TomoProjector, ReferenceIsATransposedPair) {
  for (const LightKind& c : light_kinds()) {
    SCOPED_TRACE(c.name);
    if (c.grid.slices > 1) continue;
    const auto shadow = shadow_of(c);
    const ReferenceProjector reference(c.grid, c.optics, shadow.get());
    const auto x = random_numbers(static_cast<std::size_t>(c.grid.voxels) * c.grid.voxels, 1);
    const auto b = random_numbers(static_cast<std::size_t>(c.grid.angles) * c.grid.pixels, 2);
    const auto [ax, atb] = reference.of(x, b);
    double left = 0, right = 0;
    for (std::size_t i = 0; i < b.size(); ++i) left += ax[i] * b[i];
    for (std::size_t i = 0; i < x.size(); ++i) right += x[i] * atb[i];
    EXPECT_NEAR(left / right, 1, 1e-12);
  }
}

/// The fast pair against the reference. All terms are positive, so errors are relative: places are
/// known to 2e-6 of a pixel (three roundings of numbers below 32), which a weight is wrong by; what
/// is multiplied has six roundings, and sums of n terms wander by n 2^-24 at most.
TEST(TomoProjector, FastPairIsTheReference) {
  const std::vector<LightKind> all = light_kinds();
  const std::size_t kinds = all.size() / 3;
  for (std::size_t k = 0; k < all.size(); ++k) {
    // By day each kind with one of the numbers of slices.
    if (!test::by_night() && k % kinds % 3 != k / kinds) continue;
    const LightKind& c = all[k];
    SCOPED_TRACE(std::string(c.name) + ", slices " + std::to_string(c.grid.slices));
    const TomoGrid& g = c.grid;
    const int n = g.voxels;
    const auto shadow = shadow_of(c);
    const auto projector = make_projector(g, c.optics, shadow);
    Field x(g);
    Light b(g);
    const std::size_t pixels = static_cast<std::size_t>(g.angles) * g.pixels;
    for (int z = 0; z < g.slices; ++z) {
      const auto xs = random_numbers(n * n, 10 + z), bs = random_numbers(pixels, 100 + z);
      for (int i = 0; i < n * n; ++i) {
        x.values[g.voxel(i % n, i / n, z)] = static_cast<float>(xs[i]);
      }
      for (std::size_t i = 0; i < pixels; ++i) {
        b.values[g.pixel(static_cast<int>(i / g.pixels), static_cast<int>(i % g.pixels), z)] =
            static_cast<float>(bs[i]);
      }
    }
    const Light ax = forward(*projector, {}, x);
    const Field atb = adjoint(*projector, {}, b);
    // The last slice, and one of the second block where there are two.
    std::set<int> looked{g.slices - 1};
    if (g.blocks() > 1) looked.insert(g.lanes() + 1);
    for (const int z : looked) {
      const ReferenceProjector reference(g, c.optics, shadow.get(), z);
      const auto [want_ax, want_atb] =
          reference.of(random_numbers(n * n, 10 + z), random_numbers(pixels, 100 + z));
      // A pixel sees at most so many voxels, each with a weight wrong by 2e-6 and e up to most_e.
      const double step = g.voxel_mm() / g.pixel_mm;
      const double most_e = 1.5 * std::exp(c.optics.alpha_per_mm * 0.0);
      const double voxels_seen = n * (2 / step + 1), angles = g.angles;
      double worst = 0;
      for (std::size_t i = 0; i < pixels; ++i) {
        const float got =
            ax.values[g.pixel(static_cast<int>(i / g.pixels), static_cast<int>(i % g.pixels), z)];
        worst = std::max(worst, std::abs(got - want_ax[i]));
      }
      EXPECT_LE(worst, most_e * voxels_seen * (2e-6 + n * 0x1p-24)) << z;
      worst = 0;
      for (int i = 0; i < n * n; ++i) {
        worst = std::max(worst, std::abs(atb.values[g.voxel(i % n, i / n, z)] - want_atb[i]));
      }
      EXPECT_LE(worst, most_e * angles * (2 * 2e-6 + 50 * 0x1p-24)) << z;
    }
    // Lanes without a slice stay 0.
    for (std::size_t i = 0; i < g.voxels_of_block(); ++i) {
      const std::size_t last = g.blocks() - 1;
      if (static_cast<int>(i % g.lanes()) >= g.lanes_used(last)) {
        ASSERT_EQ(atb.values[last * g.voxels_of_block() + i], 0);
      }
    }
  }
}

TEST(TomoProjector, SameBytesForAnyNumberOfThreads) {
  const TomoGrid grid = square_grid(40, 36, 70);
  const auto projector = make_projector(grid, {.alpha_per_mm = 0.5});
  const Field part = field_of(gyroid(grid));
  const Light one = forward(*projector, on_threads(1), part);
  const Light more = forward(*projector, on_threads(3), part);
  EXPECT_EQ(one.values, more.values);
  EXPECT_EQ(adjoint(*projector, on_threads(1), one).values,
            adjoint(*projector, on_threads(3), one).values);
}

/// A block's rows and angles are shared among threads: of one slice, of few, and where slices turn
/// into each other and where not.
TEST(TomoProjector, SameBytesForAnyNumberOfThreadsWithinABlock) {
  for (const int slices : {1, 9, 20}) {
    for (const int angles : {88, 85}) {
      for (const double alpha : {0.0, 0.5}) {
        const TomoGrid grid =
            square_grid(slices == 1 ? 300 : 90, slices == 1 ? 4 * angles : angles, slices);
        const auto projector = make_projector(grid, {.alpha_per_mm = alpha});
        ASSERT_EQ(grid.blocks(), 1u);
        const Light one = forward(*projector, on_threads(1), field_of(gyroid(grid)));
        const Light more = forward(*projector, on_threads(5), field_of(gyroid(grid)));
        EXPECT_EQ(one.values, more.values);
        EXPECT_EQ(adjoint(*projector, on_threads(1), one).values,
                  adjoint(*projector, on_threads(5), one).values);
      }
    }
  }
}

/// A projector of some slices does to them what the whole one does, in their order; in blocks of
/// another width to the rounding of sums.
TEST(TomoProjector, OfSomeSlices) {
  const TomoGrid grid = square_grid(45, 36, 40);
  const Volume insert = part_of(grid, [](double x, double y, double z) {
    return std::hypot(x - 0.2, y) < 0.1 + 0.1 * std::abs(z);
  });
  const auto whole =
      make_projector(grid, {.alpha_per_mm = 0.5}, std::make_shared<Shadow>(cast_shadow(insert)));
  const Field part = field_of(gyroid(grid));
  const Light light = forward(*whole, {}, part);
  for (const std::vector<int>& slices :
       {std::vector<int>{31, 5}, {1, 2, 3, 5, 8, 13, 21, 34, 39, 20, 22}}) {
    const auto some = whole->of_slices(slices);
    TomoGrid of_some = grid;
    of_some.slices = static_cast<int>(slices.size());
    ASSERT_EQ(some->shape(), of_some.shape());
    Field taken(of_some);
    for (int y = 0; y < 45; ++y) {
      for (int x = 0; x < 45; ++x) {
        for (std::size_t z = 0; z < slices.size(); ++z) {
          taken.values[of_some.voxel(x, y, static_cast<int>(z))] =
              part.values[grid.voxel(x, y, slices[z])];
        }
      }
    }
    const Light got = forward(*some, {}, taken);
    for (int m = 0; m < 36; ++m) {
      for (int i = 0; i < 45; ++i) {
        for (std::size_t z = 0; z < slices.size(); ++z) {
          // 45 rows of up to three terms of at most 1.65.
          ASSERT_NEAR(got.values[of_some.pixel(m, i, static_cast<int>(z))],
                      light.values[grid.pixel(m, i, slices[z])], 45 * 3 * 1.65 * 2e-6);
        }
      }
    }
  }
}

/// A as a line integral, in units of R. An edge that a line crosses lies somewhere in a voxel; the
/// sum is wrong by up to that voxel's share of length there, about a voxel per crossing.
TEST(TomoProjector, LineIntegralsOfTargets) {
  const TomoGrid grid = square_grid(256, 360);
  const auto projector = make_projector(grid);
  const double h = grid.voxel_mm();
  const auto integral = [&](const Light& light, int m, double t) {
    const double f = t / grid.pixel_mm + 0.5 * (grid.pixels - 1);
    const int i = static_cast<int>(f);
    const double w = f - i;
    return h * ((1 - w) * light.values[grid.pixel(m, i, 0)] +
                w * light.values[grid.pixel(m, i + 1, 0)]);
  };
  const Light one = forward(*projector, {}, field_of(t1(grid)));
  EXPECT_NEAR(integral(one, 0, 0), 1.14, 6 * h / 2);
  EXPECT_NEAR(0.5 * (integral(one, 22, 0) + integral(one, 23, 0)), 0.84, 6 * h / 2);
  const Light two = forward(*projector, {}, field_of(t2(grid)));
  EXPECT_NEAR(integral(two, 0, 0), 0.9, h);
  // At 45 degrees diagonals of voxels lie 0.71 pixels apart, so single pixels are uneven; eight are
  // not. The length falls by 2 |t| beside the diagonal.
  double sum = 0;
  for (int i = 124; i < 132; ++i) {
    sum += h * two.values[grid.pixel(45, i, 0)] + 2 * std::abs(grid.pixel_at_mm(i));
  }
  EXPECT_NEAR(sum / 8, 1.27279, 2 * h);
  EXPECT_NEAR(integral(two, 30, 0.3), 0.72680, 2 * h);
}

TEST(TomoProjector, AttenuatedDisc) {
  const TomoGrid grid = square_grid(401, 8);
  const auto projector = make_projector(grid, {.alpha_per_mm = 1});
  Field disc(grid);
  for (int y = 0; y < grid.voxels; ++y) {
    for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) {
      disc.values[grid.voxel(x, y, 0)] = 1;
    }
  }
  const Light light = forward(*projector, {}, disc);
  const double h = grid.voxel_mm();
  for (const auto& [t, want] : {std::pair{0.0, .864665}, {0.5, .823079}, {0.9, .581793}}) {
    EXPECT_NEAR(want, 1 - std::exp(-2 * std::sqrt(1 - t * t)), 1e-6);
    const int i = static_cast<int>(std::lround((t + 1) / h));
    // Two ends, each wrong by half a voxel along the line, which at t = 0.9 meets the edge aslant.
    EXPECT_NEAR(light.values[grid.pixel(0, i, 0)] * h, want, h / std::sqrt(1 - t * t)) << t;
  }
}

/// Struve functions of order 0 and 1 with imaginary argument, by their series.
double struve_l(int order, double x) {
  double sum = 0, term = order == 0 ? 2 / pi * x : 2 / (3 * pi) * x * x;
  for (int k = 1; k < 60; ++k) {
    sum += term;
    term *=
        order == 0 ? x * x / ((2.0 * k + 1) * (2 * k + 1)) : x * x / ((2.0 * k + 1) * (2 * k + 3));
  }
  return sum;
}

TEST(TomoProjector, UniformLight) {
  EXPECT_NEAR(pi / 2 * (std::cyl_bessel_i(1., 2.) - struve_l(1, 2)), .766356, 1e-6);
  const TomoGrid grid = square_grid(201, 720);
  const double want[3][3] = {
      {.606531, .636658, .777911}, {.367879, .417465, .671076}, {.135335, .193503, .585436}};
  int row = 0;
  for (const double depth : {0.5, 1.0, 2.0}) {
    const auto projector = make_projector(grid, {.alpha_per_mm = depth});
    Light light(grid);
    std::fill(light.values.begin(), light.values.end(), 1.0f);
    const Field dose = adjoint(*projector, {}, light);
    const auto at = [&](int x) { return dose.values[grid.voxel(x, 100, 0)] / grid.angles; };
    const double x = 2 * depth;
    EXPECT_NEAR(0.5 + 0.5 * (std::cyl_bessel_i(0., x) - struve_l(0, x)), want[row][2], 1e-6);
    // e^(-alpha sqrt(R^2-t^2)) is taken at pixels and is linear between them: its second derivative
    // is alpha/R at the middle, less than 3 at 0.5.
    EXPECT_NEAR(at(100), want[row][0], 1e-5);
    EXPECT_NEAR(at(150), want[row][1], 3 * grid.pixel_mm * grid.pixel_mm / 8);
    // At the edge it falls like a root; the chord is wrong by up to 0.25 sqrt(2 R h) for the few
    // angles that see the edge within a pixel, sqrt(2 h)/pi of all, at both ends.
    const double h = grid.pixel_mm;
    EXPECT_NEAR(at(200), want[row][2], depth * 0.25 * std::sqrt(2 * h) * 2 * std::sqrt(2 * h) / pi);
    ++row;
  }
  // Light that is uniform at the plane of the axis (S): I0(alpha r).
  TomoGrid fine = grid;
  const double alpha = 1.5;
  const auto projector = make_projector(fine, {.alpha_per_mm = alpha});
  Light light(fine);
  for (int m = 0; m < fine.angles; ++m) {
    for (int i = 0; i < fine.pixels; ++i) {
      const double t = fine.pixel_at_mm(i);
      light.values[fine.pixel(m, i, 0)] =
          static_cast<float>(std::exp(alpha * std::sqrt(std::max(0.0, 1 - t * t))));
    }
  }
  const Field dose = adjoint(*projector, {}, light);
  EXPECT_NEAR(dose.values[grid.voxel(150, 100, 0)] / grid.angles, 1.145647, 1e-5);
}

TEST(TomoProjector, DoseInPhysicalUnits) {
  const TomoGrid grid = square_grid(101, 720, 1, 12.5);
  const auto projector = make_projector(grid, {.alpha_per_mm = 0.08});
  Light light(grid);
  std::fill(light.values.begin(), light.values.end(), 2.0f);
  const Field dose = adjoint(*projector, {}, light);
  const double scale = 0.8 * 14.4 / grid.angles;
  EXPECT_NEAR(scale * dose.values[grid.voxel(50, 50, 0)], 8.4759, 1e-3);
  EXPECT_NEAR(scale * dose.values[grid.voxel(100, 50, 0)], 15.4616, 15.4616 * 0.01);
}

/// Webber's vial, from the closed forms for light without climb.
struct WebberVial {
  double ro = 12.5, ri = 11.8, n1 = 1, n2 = 1.48, n3 = 1.49969;
  double line(double q) const { return n1 * q / n3; }
  double turn(double q) const {
    return std::asin(q / ro) - std::asin(n1 * q / (n2 * ro)) + std::asin(n1 * q / (n2 * ri)) -
           std::asin(n1 * q / (n3 * ri));
  }
  static std::pair<double, double> face(double na, double nb, double ca, double sin_b) {
    const double cb = std::sqrt(1 - sin_b * sin_b);
    const double rs = (na * ca - nb * cb) / (na * ca + nb * cb);
    const double rp = (nb * ca - na * cb) / (nb * ca + na * cb);
    return {1 - rs * rs, 1 - rp * rp};
  }
  double transmitted(double q) const {
    const double s1 = q / ro, s2 = n1 * q / (n2 * ri);
    const auto [ts1, tp1] = face(n1, n2, std::sqrt(1 - s1 * s1), n1 * q / (n2 * ro));
    const auto [ts2, tp2] = face(n2, n3, std::sqrt(1 - s2 * s2), n1 * q / (n3 * ri));
    return 0.5 * (ts1 * ts2 + tp1 * tp2);
  }
};

TEST(TomoProjector, RefractedUniformLight) {
  const WebberVial vial;
  EXPECT_NEAR(vial.transmitted(10), .938461, 1e-6);
  EXPECT_NEAR(vial.turn(10) * 180 / pi, 20.933405, 1e-6);
  TomoGrid grid;
  grid.voxels = 119;  // 0.2 mm: centres at 4, 8 and 10 mm
  grid.angles = 720;
  grid.radius_mm = vial.ri;
  const double pitch = 12.5 / 400;
  grid.pixels = 799;  // the outermost ray just meets the vial
  grid.pixel_mm = pitch / vial.n3;
  RayTables optics;
  for (int i = 0; i < grid.pixels; ++i) {
    const double q = (i - 399) * pitch;
    optics.weight.push_back(vial.transmitted(q) * vial.n3);
    optics.turn_rad.push_back(vial.turn(q));
  }
  const double want[2][4] = {{1.44345, 1.44281, 1.38306, .86985}, {.53102, .56231, .64389, .45208}};
  for (const bool attenuated : {false, true}) {
    optics.alpha_per_mm = attenuated ? 1 / 11.8 : 0;
    const auto projector = make_projector(grid, optics);
    Light light(grid);
    std::fill(light.values.begin(), light.values.end(), 1.0f);
    const Field dose = adjoint(*projector, {}, light);
    int k = 0;
    for (const double r : {0, 4, 8, 10}) {
      const int x = 59 + static_cast<int>(std::lround(r / 0.2));
      // Beyond the reach of 8.335 mm the light ends at grazing rays, where it falls from 0.5 to 0
      // within a pixel of 0.02 mm: at 10 mm that is 2 * 0.02 / (10 cos 33.5 deg) of a turn's 2 pi.
      const double slack = r < 8.5 ? 2e-3 * want[attenuated][k] : 0.004;
      EXPECT_NEAR(dose.values[grid.voxel(x, 59, 0)] / grid.angles, want[attenuated][k], slack)
          << r << (attenuated ? ", attenuated" : "");
      ++k;
    }
  }
}

TEST(TomoProjector, RefractedPinholeInPlane) {
  const WebberVial vial;
  const double distance = 99.5;
  TomoGrid grid;
  grid.voxels = 119;
  grid.angles = 720;
  grid.radius_mm = vial.ri;
  grid.pixels = 801;
  grid.pixel_mm = 2 * 8.3 / 800;
  RayTables optics;
  optics.alpha_per_mm = 0.05;
  for (int i = 0; i < grid.pixels; ++i) {
    const double x = (i - 400) * 12.58 / 400, psi = std::atan(x / distance);
    const double q = x * std::cos(psi);
    optics.line_mm.push_back(vial.line(q));
    optics.turn_rad.push_back(vial.turn(q) - psi);
    optics.weight.push_back(vial.transmitted(q) * vial.n3 / std::pow(std::cos(psi), 3));
  }
  const auto projector = make_projector(grid, optics);
  Light light(grid);
  std::fill(light.values.begin(), light.values.end(), 1.0f);
  const Field dose = adjoint(*projector, {}, light);
  EXPECT_NEAR(dose.values[grid.voxel(59 + 20, 59, 0)] / grid.angles, .82417, 1e-3);
  EXPECT_NEAR(dose.values[grid.voxel(59 + 35, 59, 0)] / grid.angles, .87013, 1e-3);
}

TEST(TomoProjector, SeenFractionBesideAnInsert) {
  const int half = test::by_night() ? 200 : 100;
  const TomoGrid grid = square_grid(2 * half + 1, 720 * half / 200);
  const double a = 0.2 - 1e-9;  // whose voxels are sure to be outside at 0.2
  const auto shadow = std::make_shared<Shadow>(
      cast_shadow(part_of(grid, [&](double x, double y, double) { return std::hypot(x, y) < a; })));
  const auto projector = make_projector(grid, {}, shadow);
  Light light(grid);
  std::fill(light.values.begin(), light.values.end(), 1.0f);
  const Field dose = adjoint(*projector, {}, light);
  for (const auto& [ratio, want] :
       {std::pair{1.0, .5}, {1.5, .767720}, {2.0, .833333}, {4.0, .919569}}) {
    EXPECT_NEAR(want, 1 - std::asin(1 / ratio) / pi, 1e-6);
    const int x = half + static_cast<int>(std::lround(ratio * a * half));
    const double seen = dose.values[grid.voxel(x, half, 0)] / grid.angles;
    // The disc's radius is known to a voxel, h: asin(a/r) changes by h / sqrt(r^2 - a^2), and at
    // the disc itself by acos(a / (a + h)).
    const double h = grid.voxel_mm(), r = ratio * a;
    const double slack = ratio == 1 ? std::acos(a / (a + h)) : h / std::sqrt(r * r - a * a);
    EXPECT_NEAR(seen, want, slack / pi + 1.0 / grid.angles) << ratio;
  }
}

TEST(TomoProjector, CountsOfTargets) {
  const TomoGrid grid = square_grid(256, 360);
  const auto counts = [](const Target& t) { return std::pair{t.gel, t.empty}; };
  EXPECT_EQ(counts(Target(t1(grid))), (std::pair<std::size_t, std::size_t>{19712, 31328}));
  EXPECT_EQ(counts(Target(t2(grid))), (std::pair<std::size_t, std::size_t>{12996, 38044}));
  EXPECT_EQ(counts(Target(t3(grid))), (std::pair<std::size_t, std::size_t>{18980, 32060}));
}

TEST(TomoProjector, RefusesWhatDoesNotFit) {
  const TomoGrid grid = square_grid(20, 10);
  TomoGrid wrong = grid;
  wrong.angles = 2;
  EXPECT_THROW(make_projector(wrong), InputError);
  wrong = grid;
  wrong.pixel_mm = std::nan("");
  EXPECT_THROW(make_projector(wrong), InputError);
  EXPECT_THROW(make_projector(grid, {.alpha_per_mm = -1}), InputError);
  EXPECT_THROW(make_projector(grid, {.alpha_per_mm = std::nan("")}), InputError);
  EXPECT_THROW(make_projector(grid, {.alpha_per_mm = 41}), InputError);
  EXPECT_THROW(make_projector(grid, {.weight = {1, 2}}), InputError);
  EXPECT_THROW(make_projector(grid, {.weight = std::vector<double>(20, -1)}), InputError);
  EXPECT_THROW(make_projector(grid, {.line_mm = std::vector<double>(20, 0)}), InputError);
  const auto shadow = std::make_shared<Shadow>(cast_shadow(t3_insert(square_grid(21, 10))));
  EXPECT_THROW(make_projector(grid, {}, shadow), InputError);
  EXPECT_THROW(Target(part_of(grid, [](double, double, double) { return true; })), InputError);
  EXPECT_THROW(Target(part_of(grid, [](double, double, double) { return false; })), InputError);
  const Volume disc = t2(grid);
  EXPECT_THROW(Target(disc, &disc), InputError);
}

}  // namespace
}  // namespace slicecorr::tomo
