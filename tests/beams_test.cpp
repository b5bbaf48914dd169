// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light of beams against closed forms, and what silhouettes and end-on images print.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "beams_parts.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "tomo/beams/beam_projector.hpp"

namespace slicecorr::tomo {
namespace {

using test::ball_part;
using test::beam_setup;
using test::lattice_part;
using test::part_of;
using test::refusal;
using testing::HasSubstr;

/// A cube of n cells in a vat with `margin` cells around it.
Box<std::uint8_t> cube_part(int n, int margin) {
  const int all = n + 2 * margin;
  const auto in = [&](int i) { return i >= margin && i < margin + n; };
  return part_of(all, all, all, [&](int x, int y, int z) { return in(x) && in(y) && in(z); });
}

TEST(Beams, ACubeGetsLessLightTheFurtherItIsFromTheWalls) {
  // alpha a = 0.3. At the corner of the cube N exp(-alpha a) is left; the middle of the last cell is
  // half a cell before it.
  for (const int beams : {2, 3}) {
    const double closed = beams * std::exp(-0.3);
    EXPECT_NEAR(closed, beams == 2 ? 1.48164 : 2.22245, 5e-6);
    BeamSetup setup = beam_setup(beams, 1.0 / 40, 0.3);
    // Something outside, as a cube that fills its vat has nothing.
    Box<std::uint8_t> part = cube_part(40, 0);
    part.values[0] = 0;
    const BeamPrint print = find_beams(part, setup);
    EXPECT_NEAR(print.figures.least_inside, closed * std::exp(0.3 / 80), 1e-6);
  }
  // Beams against each other: the pair is darkest in the middle. 40 cells: half a cell beside it.
  for (const int beams : {4, 6}) {
    BeamSetup setup = beam_setup(beams, 1.0 / 40, 0.3);
    Box<std::uint8_t> part = cube_part(40, 0);
    part.values[0] = 0;
    const BeamPrint print = find_beams(part, setup);
    const double middle = beams * std::exp(-0.15);
    EXPECT_NEAR(print.figures.least_inside, middle * std::cosh(0.3 / 80), 1e-6);
    // Over what a pair gives at the wall.
    EXPECT_NEAR(middle / (1 + std::exp(-0.3)), beams == 4 ? 1.97771 : 2.96656, 5e-6);
  }
}

TEST(Beams, ContrastOfACubeIsOverTheLightAtTheWall) {
  // alpha a 0.3, alpha p 0.15, three beams.
  for (const int n : {20, 80}) {
    const Box<std::uint8_t> part = cube_part(n, n / 2);
    const BeamPrint print = find_beams(part, beam_setup(3, 1.0 / n, 0.3));
    EXPECT_NEAR(print.figures.contrast, n == 20 ? 1.94179 : 1.92007, 5e-6);
    EXPECT_NEAR(print.figures.contrast, 3 * std::exp(-0.45 + 0.3 / n), 2e-6);
    EXPECT_EQ(print.hull_cells, 0U);
    const BeamPrint opposed = find_beams(part, beam_setup(6, 1.0 / n, 0.3));
    // In the first cell before the wall, not at it.
    const double half = 0.15 / n;
    EXPECT_NEAR(opposed.figures.contrast,
                6 * std::exp(-0.3) * std::cosh(half) / (std::exp(-half) + std::exp(half - 0.6)),
                3e-6);
    EXPECT_NEAR(6 * std::exp(-0.3) / (1 + std::exp(-0.6)), 2.86988, 5e-6);
  }
}

TEST(Beams, TheVatIsFilledUpToItsWalls) {
  BeamSetup setup = beam_setup(3, 0.5, 0.3);
  setup.vat_mm = {6, 4, 5.7};
  const Box<std::uint8_t> part = part_of(4, 4, 4, [](int, int, int) { return true; });
  const Box<std::uint8_t> vat = filled_vat(part, setup);
  EXPECT_EQ(vat.nx, 12);
  EXPECT_EQ(vat.ny, 8);
  // Three cells of 0.5 mm fit into the 1.85 mm on either side, and 0.35 are left before the first.
  EXPECT_EQ(vat.nz, 10);
  EXPECT_NEAR(setup.before_mm(2, vat.nz), 0.35, 1e-12);
  const BeamPrint print = find_beams(vat, setup);
  EXPECT_NEAR(
      print.light.values[vat.at(6, 5, 7)],
      std::exp(-0.3 * 7.5 * 0.5) + std::exp(-0.3 * 5.5 * 0.5) + std::exp(-0.3 * (0.35 + 6.5 * 0.5)),
      1e-6);
  setup.vat_mm = {6, 1.9, 6};
  EXPECT_THAT(refusal([&] { filled_vat(part, setup); }),
              HasSubstr("take 2 mm along y, the vat is 1.9 mm inside"));
}

TEST(Beams, SilhouettesOfALattice) {
  const Box<std::uint8_t> part = lattice_part();
  const struct {
    double alpha_l, contrast;
  } kValues[] = {{0, 1.5}, {0.14, 1.3438}, {0.28, 1.2038}, {0.42, 1.0784}, {0.7, 0.8654}};
  for (const auto& v : kValues) {
    const BeamPrint print = find_beams(part, beam_setup(3, 1, v.alpha_l / 14));
    EXPECT_EQ(print.figures.part_cells, 1080U);
    EXPECT_EQ(print.hull_cells, 0U);
    EXPECT_EQ(print.hull_jaccard, 1);
    EXPECT_NEAR(print.figures.contrast, v.contrast, 5.1e-5) << v.alpha_l;
  }
  EXPECT_NEAR(find_beams(part, beam_setup(6, 1, 0.28 / 14)).figures.contrast, 1.4940, 5.1e-5);
  EXPECT_NEAR(find_beams(part, beam_setup(6, 1, 0.7 / 14)).figures.contrast, 1.4633, 5.1e-5);
}

TEST(Beams, TimesOfALatticeAreThoseOfItsLight) {
  // A hydrogel of A 119.238 mJ/cm² and B 4.82633, 10 mW/cm² of each beam.
  Resin resin;
  resin.model = CureModelKind::gel_time;
  resin.gel_a_mj_cm2 = 5 * 119.238;
  resin.gel_b_sqrt_mw_cm2_s = 5 * 4.82633;
  resin.dose_factor = 5;
  const BeamPrint print = find_beams(lattice_part(), beam_setup(6, 1, 0.28 / 14));
  const TimeWindow window = time_window(print.figures, time_to_gel_of(resin), 10);
  EXPECT_NEAR(window.first_s, 2.954, 5.1e-4);
  EXPECT_NEAR(window.last_s, 4.232, 5.1e-4);
  EXPECT_TRUE(window.open());
  EXPECT_NEAR(window.middle_s(), std::sqrt(window.first_s * window.last_s), 1e-12);
}

TEST(Beams, EndOnImagesLightALatticeAlone) {
  BeamSetup setup = beam_setup(3, 1, 0.02, BeamImages::end_on);
  const BeamPrint print = find_beams(lattice_part(), setup);
  EXPECT_EQ(print.figures.most_outside, 0);
  EXPECT_EQ(print.figures.unlit_cells, 0U);
  EXPECT_TRUE(std::isinf(print.figures.contrast));
  // Nine rods end on, of 2 x 2 cells, in each of the three images.
  for (const BeamImage& image : print.images) {
    EXPECT_EQ(std::count(image.share.begin(), image.share.end(), 1.0F), 36);
  }
  // Grey images find that, too.
  setup.images = BeamImages::grey;
  EXPECT_TRUE(std::isinf(find_beams(lattice_part(), setup).figures.contrast));
  // In a larger vat rods would grow to its walls.
  setup.images = BeamImages::end_on;
  setup.vat_mm = {16, 16, 16};
  const BeamPrint larger = find_beams(filled_vat(lattice_part(), setup), setup);
  EXPECT_EQ(larger.figures.unlit_cells, 1080U);
  EXPECT_EQ(larger.figures.contrast, 0);
}

TEST(Beams, HullsOfABall) {
  const Box<std::uint8_t> part = ball_part(64);
  const BeamPrint three = find_beams(part, beam_setup(3));
  EXPECT_NEAR(three.hull_jaccard, 0.89066, 5.1e-6);
  EXPECT_NEAR(three.figures.jaccard, three.hull_jaccard, 1e-12);
  EXPECT_NEAR(three.hull_jaccard, std::numbers::pi / (6 * (2 - std::numbers::sqrt2)), 0.004);
  // As many cells as the hull has too many get as much light as the part.
  EXPECT_EQ(three.figures.contrast, 1);
  EXPECT_EQ(three.figures.wrong_cells, three.hull_cells);
  ASSERT_FALSE(three.in_the_way.empty());
  for (const auto& c : three.in_the_way) EXPECT_EQ(part.values[part.at(c[2], c[1], c[0])], 0);
  const BeamPrint two = find_beams(part, beam_setup(2));
  EXPECT_NEAR(two.hull_jaccard, 0.78215, 5.1e-6);
}

TEST(Beams, ABallOfGreyImagesInClosedForm) {
  // f = (1+k)/3 - k (u² + v²) / (2 R²) gives 1 + k (1 - r²/R²), which is 1 at its surface.
  const Box<std::uint8_t> part = ball_part(64);
  const double k = 0.5, radius = 32;
  const BeamSetup setup = beam_setup(3);
  std::vector<BeamImage> images;
  for (const Beam& beam : setup.beams) {
    BeamImage image{beam, 64, 64, {}};
    for (int r = 0; r < 64; ++r) {
      for (int c = 0; c < 64; ++c) {
        const double u = r - 31.5, v = c - 31.5;
        image.share.push_back(
            static_cast<float>((1 + k) / 3 - k * (u * u + v * v) / (2 * radius * radius)));
      }
    }
    images.push_back(std::move(image));
  }
  const BeamFigures f = figures_of(part, light_of(64, 64, 64, images, setup));
  EXPECT_NEAR(f.least_inside, 1.00061, 5.1e-6);
  EXPECT_NEAR(f.most_outside, 0.99963, 5.1e-6);
  EXPECT_EQ(f.ver, 0);
  EXPECT_EQ(f.jaccard, 1);
  EXPECT_EQ(f.best_jaccard, 1);
}

TEST(Beams, TheSolversLightIsThatOfTheDirectSumAndItsOperatorsAreTransposes) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> number(0, 1);
  for (const int beams : {2, 3, 4, 6, 16}) {
    const Box<std::uint8_t> part = part_of(19, 7, 37, [&](int x, int y, int z) {
      return x > 1 && y > 1 && z > 2 && (x + y + z) % 2 == 0;
    });
    BeamSetup setup = beam_setup(beams % 10, 0.3, 0.4);
    if (beams > 10) {
      setup.spread = {{200, 0.6}, {500, 0.4}};
      setup.scatter_um2_per_um = 12;
    }
    const detail::DecidingCells cells(part, setup);
    // The first of each axis, and the box of the part; all where light goes sideways.
    const int more = setup.goes_sideways() ? 1 : 0;
    EXPECT_EQ(cells.size(0), 1 + 17 + more);
    EXPECT_EQ(cells.size(1), 1 + 5 + more);
    EXPECT_EQ(cells.size(2), 1 + 34 + 2 * more);
    const detail::BeamProjector projector(part, cells, setup);
    Array<float> light(projector.shape().light()), dose(projector.shape().field());
    std::vector<BeamImage> images;
    for (std::size_t k = 0; k < setup.beams.size(); ++k) {
      const int axis = setup.beams[k].axis;
      BeamImage image{setup.beams[k], axis == 2 ? 7 : 37, axis == 0 ? 7 : 19, {}};
      image.share.resize(static_cast<std::size_t>(image.rows) * image.columns);
      for (float& share : image.share) share = number(random);
      images.push_back(std::move(image));
      for (int z = 0; z < cells.size(2); ++z) {
        for (int y = 0; y < cells.size(1); ++y) {
          for (int x = 0; x < cells.size(0); ++x) {
            const int at[3] = {cells.index[0][x], cells.index[1][y], cells.index[2][z]};
            const int row = axis == 2 ? at[1] : at[2], column = axis == 0 ? at[1] : at[0];
            light[projector.pixel(k, x, y, z)] = images[k].at(row, column);
          }
        }
      }
    }
    adjoint(projector, {}, light, dose);
    const Box<float> direct = light_of(part.nz, part.ny, part.nx, images, setup);
    Array<float> field(dose.size()), back(light.size());
    double left = 0;
    for (int z = 0; z < cells.size(2); ++z) {
      for (int y = 0; y < cells.size(1); ++y) {
        for (int x = 0; x < cells.size(0); ++x) {
          const std::size_t v = projector.cell(x, y, z);
          EXPECT_NEAR(
              dose[v],
              direct.values[direct.at(cells.index[2][z], cells.index[1][y], cells.index[0][x])],
              1e-5);
          field[v] = number(random);
          left += static_cast<double>(field[v]) * dose[v];
        }
      }
    }
    forward(projector, {}, field, back);
    double right = 0;
    for (std::size_t i = 0; i < back.size(); ++i) {
      right += static_cast<double>(back[i]) * light[i];
    }
    EXPECT_NEAR(left, right, 1e-5 * left) << beams;
  }
}

/// Mean over a cell of the light of another `apart` cells away, of a Gaussian: midpoints of the one, and the integral
/// over the other.
double share_of_neighbour(double apart, double sigma) {
  if (sigma == 0) return apart == 0 ? 1 : 0;
  const auto below = [&](double x) { return 0.5 * std::erfc(-x / (sigma * std::sqrt(2.0))); };
  constexpr int kPlaces = 400;
  double sum = 0;
  for (int i = 0; i < kPlaces; ++i) {
    const double at = (i + 0.5) / kPlaces - 0.5 + apart;
    sum += (below(at + 0.5) - below(at - 0.5)) / kPlaces;
  }
  return sum;
}

TEST(Beams, LightThatGoesSidewaysIsTheSumOverItsImage) {
  // Along y from its end, 11 cells of 0.2 mm in a vat of 3 mm: the path to cell y is 0.4 + (10.5 - y) 0.2 mm.
  BeamSetup setup = beam_setup(2, 0.2, 0.3);
  setup.beams = {{1, true}};
  setup.vat_mm = {2, 3, 2};
  setup.spread = {{150, 0.8}, {400, 0.2}};
  setup.scatter_um2_per_um = 30;
  BeamImage image{setup.beams[0], 6, 5, std::vector<float>(30, 0.0F)};
  image.share[8] = 1;
  image.share[21] = 0.5F;
  const Box<float> light = light_of(6, 11, 5, {image}, setup);
  for (const int y : {0, 4, 10}) {
    const double path = 0.4 + (10.5 - y) * 0.2;
    for (int z = 0; z < 6; ++z) {
      for (int x = 0; x < 5; ++x) {
        double want = 0;
        for (const auto& [at, share] : {std::pair{8, 1.0}, {21, 0.5}}) {
          for (const auto& [um, weight] : {std::pair{150.0, 0.8}, {400.0, 0.2}}) {
            const double sigma = std::sqrt(um * um * 1e-6 + 0.03 * path) / 0.2;
            want += share * weight * share_of_neighbour(x - at % 5, sigma) *
                    share_of_neighbour(z - at / 5, sigma);
          }
        }
        // The midpoint rule is right to 1e-6 there, light is in single precision.
        EXPECT_NEAR(light.values[light.at(z, y, x)], want * std::exp(-0.3 * path), 3e-6);
      }
    }
  }
}

TEST(Beams, AbsorptionThatImagesBear) {
  const Box<std::uint8_t> part = lattice_part();
  BeamSetup setup = beam_setup(3, 1, 0.7 / 14);
  const BeamPrint print = find_beams(part, setup);
  ASSERT_LT(print.figures.contrast, 1);
  // 1.5 exp(-11 alpha) is 1 there.
  EXPECT_NEAR(most_absorption_per_mm(part, print.images, setup), std::log(1.5) / 11, 2e-5);
  // Where the hull has more than the part, none does.
  EXPECT_EQ(most_absorption_per_mm(ball_part(8), find_beams(ball_part(8), setup).images, setup), 0);
}

TEST(Beams, GelTimesByModel) {
  Resin jacobs;
  jacobs.absorbance_height10_um = 1e4 * std::log(10.0) / 0.5;  // 0.5 per cm
  jacobs.gel_dose_mj_cm3 = 20;
  jacobs.critical_dose_mj_cm3 = 100;
  jacobs.dose_factor = 5;
  EXPECT_NEAR(time_to_gel_of(jacobs)(10), 20 / (0.5 * 10), 1e-9);
  jacobs.gel_dose_mj_cm3 = 0;
  EXPECT_NEAR(time_to_gel_of(jacobs)(10), 20 / (0.5 * 10), 1e-9);
  jacobs.inhibition_dose_mj_cm3 = 5;
  EXPECT_NEAR(time_to_gel_of(jacobs)(10), 25 / (0.5 * 10), 1e-9);
  EXPECT_TRUE(std::isinf(time_to_gel_of(jacobs)(0)));
  Resin kinetic;
  kinetic.model = CureModelKind::kinetic;
  kinetic.m = 0.6;
  kinetic.critical_dose_prime = 50;
  kinetic.dose_factor = 5;
  EXPECT_NEAR(time_to_gel_of(kinetic)(3), 10 / std::pow(3, 0.6), 1e-9);
  // Outside is dark: nothing else ever gels.
  const TimeWindow window =
      time_window({.least_inside = 2, .most_outside = 0}, time_to_gel_of(kinetic), 5);
  EXPECT_TRUE(std::isinf(window.last_s));
  EXPECT_NEAR(window.middle_s(), 2 * window.first_s, 1e-12);
}

TEST(Beams, BadInputIsRefusedInWords) {
  const Box<std::uint8_t> part = ball_part(8);
  const auto refused = [&](const BeamSetup& s, const Box<std::uint8_t>& p) {
    return refusal([&] { find_beams(p, s); });
  };
  EXPECT_THAT(refusal([] { beams_of(5); }), HasSubstr("5 beams; expected 2, 3, 4 or 6"));
  EXPECT_THAT(refusal([] { beam_images_named("gray"); }),
              HasSubstr("expected silhouette, end-on or grey"));
  EXPECT_THAT(refused(beam_setup(3, 0), part), HasSubstr("cells of more than 0 mm"));
  EXPECT_THAT(refused(beam_setup(3, 1, -1), part), HasSubstr("absorption of 0 or more"));
  EXPECT_THAT(refused(beam_setup(3, 1, NAN), part), HasSubstr("absorption of 0 or more"));
  EXPECT_THAT(refused(beam_setup(3), part_of(3, 3, 3, [](int, int, int) { return false; })),
              HasSubstr("no cell that is wholly part"));
  EXPECT_THAT(refused(beam_setup(3), part_of(3, 3, 3, [](int, int, int) { return true; })),
              HasSubstr("fills all of the vat"));
  BeamSetup small = beam_setup(3);
  small.vat_mm = {8, 8, 7};
  EXPECT_THAT(refused(small, part), HasSubstr("take 8 mm along z, the vat is 7 mm inside"));
  EXPECT_THAT(refusal([] { cut_cells({}, 1); }), HasSubstr("no triangle"));
}

TEST(Beams, MemoryIsToldBefore) {
  const Box<std::uint8_t> part = ball_part(64);
  const double plain = bytes_of_beams(part, beam_setup(3));
  EXPECT_NEAR(plain, 9.0 * 64 * 64 * 64, 1);
  const double grey = bytes_of_beams(part, beam_setup(3, 1, 0, BeamImages::grey));
  EXPECT_GT(grey, 40.0 * 64 * 64 * 64);
  EXPECT_LT(grey, 200.0 * 64 * 64 * 64);
}

}  // namespace
}  // namespace slicecorr::tomo
