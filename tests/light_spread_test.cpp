// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that spreads: keys, the blur at the window, scatter with depth. Figures are closed forms of
// normal distributions, and those of a 2-D example that another program computed.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "cure/distance_blurs.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {
namespace {

using detail::LightBlur;
using Field = std::vector<double>;

/// What is left out of a Gaussian, per axis.
constexpr double kLeftOut = 1e-6;

double phi(double x) { return std::erfc(-x / std::sqrt(2.0)) / 2; }

LightSpread gaussian(double sigma_um) { return {{{sigma_um, 1}}, std::nullopt}; }

/// A pixel so high that no light leaves it.
constexpr double kRowUm = 1e6;

/// A row of light, blurred along it; the light goes on as at its ends.
Field blurred_row(const Field& light, double sigma_um, double pixel_um) {
  const LightBlur blur(gaussian(sigma_um), pixel_um, kRowUm);
  const int r = blur.reach_x(), n = static_cast<int>(light.size());
  Field longer(static_cast<std::size_t>(r), light.front());
  longer.insert(longer.end(), light.begin(), light.end());
  longer.insert(longer.end(), static_cast<std::size_t>(r), light.back());
  Field out(light.size());
  blur.apply(longer.data(), {-r, 0, n + r, 1}, out.data(), {0, 0, n, 1});
  return out;
}

/// Dose in the middle of a strip of one pixel `width_um` wide at `inside`, with `outside` around it.
double middle_of_strip(double width_um, double sigma_um, double inside, double outside) {
  return blurred_row({outside, inside, outside}, sigma_um, width_um)[1];
}

Field random_field(std::size_t size, unsigned seed) {
  std::mt19937 generator(seed);
  Field field(size);
  for (double& v : field) v = static_cast<double>(generator()) / 4294967296.0 - 0.3;
  return field;
}

// --- The blur ---

TEST(LightSpread, WeightsAreIntegratedOverPixels) {
  const auto taps = detail::gaussian_taps(40, 50);
  ASSERT_EQ(taps.size(), 5U);
  const double expected[] = {0.46803, 0.23559, 0.029507, 0.00088295};
  for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(taps[k] / expected[k], 1, 2e-5) << k;
  double sum = taps[0], variance_um2 = 0;
  for (std::size_t k = 1; k < taps.size(); ++k) {
    sum += 2 * taps[k];
    variance_um2 += 2 * taps[k] * std::pow(50.0 * static_cast<double>(k), 2);
  }
  EXPECT_NEAR(sum, 1, 1e-15);
  // What is left out lies within a pixel or so of the cut, 5 x 50 um.
  EXPECT_NEAR(variance_um2, 1808.3, 0.05 + kLeftOut * 300 * 300);
  EXPECT_EQ(detail::gaussian_taps(0, 50), Field{1});
}

TEST(LightSpread, EdgeIsTheNormalIntegral) {
  for (const double sigma_um : {4.0, 20.0, 40.0, 333.0}) {
    Field light(80, 0.0);
    std::fill(light.begin() + 40, light.end(), 1.0);
    const Field dose = blurred_row(light, sigma_um, 50);
    for (std::size_t x = 0; x < light.size(); ++x) {
      const double from_edge_um = (static_cast<double>(x) - 39.5) * 50;
      EXPECT_NEAR(dose[x], phi(from_edge_um / sigma_um), 2 * kLeftOut) << sigma_um << ' ' << x;
    }
  }
}

TEST(LightSpread, EdgesPrintFurtherOut) {
  const struct { double most, least, out; } cases[] = {{6.25, 0.0625, 1.0300}, {2, 0.02, 0.01266}};
  for (const auto& c : cases) {
    // The first pixel outside has its middle where the outline prints.
    const double pixel_um = 2 * c.out * 40;
    const double dose = blurred_row({c.least, c.most}, 40, pixel_um)[0];
    EXPECT_NEAR(dose, 1, (c.most - c.least) * (0.4 * 5e-5 + 2 * kLeftOut));
  }
}

TEST(LightSpread, CornersRetreat) {
  const double sigma_um = 40, pixel_um = 2 * 0.5450 * sigma_um;
  const LightBlur blur(gaussian(sigma_um), pixel_um, pixel_um);
  const int n = 20;
  Field light(400, 0.0), dose(400);
  for (int y = 10; y < n; ++y) std::fill_n(light.begin() + y * n + 10, 10, 1.0);
  const PixelBox all{0, 0, n, n};
  blur.apply(light.data(), all, dose.data(), all);
  EXPECT_NEAR(dose[10 * n + 10], 0.5, 1e-4);
  for (int y = 6; y < 14; ++y) {
    for (int x = 6; x < 14; ++x) {
      EXPECT_NEAR(dose[static_cast<std::size_t>(y * n + x)],
                  phi((x - 9.5) * pixel_um / sigma_um) * phi((y - 9.5) * pixel_um / sigma_um),
                  4 * kLeftOut);
    }
  }
  // The mean of the four pixels at the corner is its dose: the normal integral is odd about it.
  EXPECT_NEAR((dose[9 * n + 9] + dose[9 * n + 10] + dose[10 * n + 9] + dose[10 * n + 10]) / 4, 0.25,
              4 * kLeftOut);
}

TEST(LightSpread, LinesAndGaps) {
  const double expected[] = {0.38292, 0.68269, 0.86639, 0.95450};
  for (int w = 1; w <= 4; ++w) {
    EXPECT_NEAR(middle_of_strip(w * 40, 40, 1, 0), expected[w - 1], 6e-6);
    EXPECT_NEAR(middle_of_strip(w * 40, 40, 0, 1), 1 - expected[w - 1], 6e-6);
    // The same of several pixels.
    const Field line{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1,
                     1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    EXPECT_NEAR(blurred_row(line, 40, w * 8)[17], expected[w - 1], 6e-6 + kLeftOut);
  }
  EXPECT_NEAR(middle_of_strip(0.38210 * 40, 40, 6.25, 0.0625), 1, 6.2 * 0.4 * 1e-5 + 1e-5);
  EXPECT_NEAR(middle_of_strip(1.33313 * 40, 40, 2, 0.02), 1, 2 * 0.4 * 1e-5 + 1e-5);
}

TEST(LightSpread, LitWidthsForGapsAndLines) {
  const struct {
    double width_um, dark_um, dark_dose, lit_um, lit_dose;
  } cases[] = {{40, 128.62, 0.7301, 17.32, 1.1228},
               {80, 162.81, 0.3214, 25.05, 1.5835},
               {120, 202.41, 0.1331, 44.17, 2.6559},
               {160, 242.40, 0.0776, 78.10, 4.2146}};
  for (const auto& c : cases) {
    // 0.005 um of a width change a dose by at most 6.19 * 0.4 / 40 * 0.005.
    EXPECT_NEAR(middle_of_strip(c.dark_um, 40, 0.0625, 6.25), c.dark_dose, 4e-4);
    EXPECT_NEAR(middle_of_strip(c.lit_um, 40, 6.25, 0.0625), c.lit_dose, 4e-4);
    for (const bool dark : {true, false}) {
      const double shown_um = dark ? c.dark_um : c.lit_um, inside = dark ? 0.0625 : 6.25;
      constexpr int half = 40, n = 601, middle = n / 2;
      const double pixel_um = shown_um / (2 * half + 1);
      Field light(n, 6.3125 - inside);
      std::fill_n(light.begin() + middle - half, 2 * half + 1, inside);
      const Field dose = blurred_row(light, 40, pixel_um);
      const double at = middle + c.width_um / 2 / pixel_um, share = at - std::floor(at);
      const auto i = static_cast<std::size_t>(at);
      // Linear between pixels 0.2 to 3 um wide.
      EXPECT_NEAR((1 - share) * dose[i] + share * dose[i + 1], 1, 1.5e-3) << c.width_um << dark;
    }
  }
}

TEST(LightSpread, BarsLoseTheirContrast) {
  const double modulation[] = {0.0072, 0.1116, 0.2912}, greatest[] = {0.5046, 0.5710, 0.6854};
  for (int period = 2; period <= 4; ++period) {
    constexpr int half = 5;  // pixels of a bar
    const double pixel_um = period * 40.0 / (2 * half);
    Field light;
    for (int x = 0; x < 41 * half; ++x) light.push_back((x / half) % 2 == 0);
    const Field dose = blurred_row(light, 40, pixel_um);
    const auto m = static_cast<std::size_t>(20 * half + half / 2);
    EXPECT_NEAR(dose[m], greatest[period - 2], 6e-5);
    EXPECT_NEAR(dose[m + half], 1 - greatest[period - 2], 6e-5);
    // The ground wave of bars of 0 and 1 is 2 / pi; the third of these pixels' steps is ninth.
    double wave = 0;
    for (int x = 0; x < 2 * half; ++x) {
      wave += dose[m + static_cast<std::size_t>(x)] * std::cos(x * M_PI / half) / half;
    }
    double of_light = 0;
    for (int x = 0; x < 2 * half; ++x) {
      of_light += light[m + static_cast<std::size_t>(x)] * std::cos(x * M_PI / half) / half;
    }
    // Pixels of the doses' samples fold higher waves in, which are below exp(-81 * ...).
    const double pixels = std::sin(M_PI / (2 * half)) / (M_PI / (2 * half));
    EXPECT_NEAR(wave / of_light / pixels, modulation[period - 2], 1.2e-4);
  }
}

TEST(LightSpread, TwoDimensionalExample) {
  const int n = 32;
  const auto is_feature = [](int x, int y) {
    if (x < 4 || x > 27 || y < 4 || y > 27) return false;
    const bool gap = x == 10 || x == 14 || x == 15 || (x >= 19 && x <= 21);
    return !(gap && y >= 8 && y <= 23);
  };
  const struct {
    double sigma_um, light;
    int under, through;
  } cases[] = {{25, 1.1, 200, 0}, {25, 2, 0, 0},     {40, 1.1, 200, 0},
               {40, 2, 0, 16},    {60, 1.1, 340, 0}, {60, 2, 4, 28}};
  for (const auto& c : cases) {
    const LightBlur blur(gaussian(c.sigma_um), 50, 50);
    Field light(n * n), dose(n * n);
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        light[static_cast<std::size_t>(y * n + x)] = is_feature(x, y) ? c.light : 0.02;
      }
    }
    const PixelBox all{0, 0, n, n};
    blur.apply(light.data(), all, dose.data(), all);
    int under = 0, through = 0;
    for (int y = 4; y <= 27; ++y) {
      for (int x = 4; x <= 27; ++x) {
        const bool gels = dose[static_cast<std::size_t>(y * n + x)] >= 1;
        under += is_feature(x, y) && !gels;
        through += !is_feature(x, y) && gels;
      }
    }
    EXPECT_EQ(under, c.under) << c.sigma_um << ' ' << c.light;
    EXPECT_EQ(through, c.through) << c.sigma_um << ' ' << c.light;
  }
}

/// A picture whose light is to the right of, and below, its middle, within a pixel.
SpreadPicture lopsided(double pitch_um) {
  return {5, 3, pitch_um,
          std::make_shared<const std::vector<std::uint8_t>>(
              std::vector<std::uint8_t>{0, 10, 20, 30, 0, 5, 60, 255, 160, 20, 0, 40, 90, 70, 10})};
}

std::vector<LightSpread> spreads() {
  return {{},
          gaussian(12),
          gaussian(70),
          {{{8, 0.6}, {0, 0.1}, {90, 0.3}}, std::nullopt},
          {{}, lopsided(37)}};
}

TEST(LightSpread, BandsAreTheWholeImageBitForBit) {
  const PixelBox all{0, 0, 71, 53};
  const Field light = random_field(71 * 53, 1);
  for (const LightSpread& spread : spreads()) {
    const LightBlur blur(spread, 20, 30);
    Field whole(light.size());
    blur.apply(light.data(), all, whole.data(), all);
    for (const int rows : {1, 7, 16, 53}) {
      for (int y = 0; y < 53; y += rows) {
        const PixelBox band{0, y, 71, std::min(53, y + rows)};
        const PixelBox halo{0, std::max(0, band.y0 - blur.reach_y()), 71,
                            std::min(53, band.y1 + blur.reach_y())};
        Field part(71 * static_cast<std::size_t>(band.height()));
        blur.apply(light.data() + 71 * halo.y0, halo, part.data(), band);
        EXPECT_TRUE(std::equal(part.begin(), part.end(), whole.begin() + 71 * y))
            << rows << ' ' << y;
        // Parts of rows, too.
        const PixelBox piece{13, band.y0, 38, band.y1};
        Field of_piece(25 * static_cast<std::size_t>(band.height()));
        blur.apply(light.data(), all, of_piece.data(), piece);
        for (int row = 0; row < piece.height(); ++row) {
          EXPECT_TRUE(std::equal(of_piece.begin() + 25 * row, of_piece.begin() + 25 * (row + 1),
                                 whole.begin() + 71 * (y + row) + 13));
        }
      }
    }
  }
}

TEST(LightSpread, KeepsLight) {
  for (const LightSpread& spread : spreads()) {
    const LightBlur blur(spread, 20, 30);
    const PixelBox all{0, 0, 47, 29};
    const PixelBox around{-blur.reach_x(), -blur.reach_y(), 47 + blur.reach_x(),
                          29 + blur.reach_y()};
    const Field x = random_field(47 * 29, 2);
    Field seen(static_cast<std::size_t>(around.width()) *
               static_cast<std::size_t>(around.height()));
    blur.apply(x.data(), all, seen.data(), around);
    EXPECT_NEAR(std::accumulate(seen.begin(), seen.end(), 0.0),
                std::accumulate(x.begin(), x.end(), 0.0), 1e-10);
  }
}

TEST(LightSpread, NoneLeavesBits) {
  const Field x = random_field(40, 5);
  for (const LightSpread& spread :
       {LightSpread{}, gaussian(0), LightSpread{{{0, 0.5}, {0, 0.5}}, std::nullopt}}) {
    EXPECT_TRUE(spread.none());
    const LightBlur blur(spread, 50, 50);
    EXPECT_TRUE(blur.none());
    EXPECT_EQ(blur.reach_y(), 0);
    Field out(40);
    blur.apply(x.data(), {0, 0, 8, 5}, out.data(), {0, 0, 8, 5});
    EXPECT_EQ(out, x);
  }
}

TEST(LightSpread, PicturesAreGaussiansWhereTheyShowOne) {
  constexpr int side = 71, middle = side / 2;
  const double pitch_um = 5, sigma_um = 40;
  std::vector<std::uint8_t> values;
  double sum = 0;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const double r2 = (x - middle) * (x - middle) + (y - middle) * (y - middle);
      values.push_back(static_cast<std::uint8_t>(
          std::lround(255 * std::exp(-r2 * pitch_um * pitch_um / (2 * sigma_um * sigma_um)))));
      sum += values.back();
    }
  }
  const LightSpread measured{
      {},
      SpreadPicture{side, side, pitch_um,
                    std::make_shared<const std::vector<std::uint8_t>>(values)}};
  const LightBlur blur(measured, 50, 25), round(gaussian(sigma_um), 50, 25);
  const PixelBox point{0, 0, 1, 1}, around{-4, -8, 5, 9};
  const double light = 1;
  Field a(9 * 17), b(9 * 17);
  blur.apply(&light, point, a.data(), around);
  round.apply(&light, point, b.data(), around);
  for (std::size_t i = 0; i < a.size(); ++i) {
    // Grey levels are off by half of one, in 50 pixels of the picture per weight and in their sum;
    // samples for integrals over them by (pitch / sigma)^2 / 24 of each weight, times two axes.
    const double levels = 0.5 * (10 * 5 + side * side * b[i]) / sum;
    EXPECT_NEAR(a[i], b[i], levels + 0.0013 * b[i] + 1e-6) << i;
  }
}

TEST(LightSpread, PicturesLieLikeTheDisplay) {
  const auto arrow = [](int dx, int dy, const Turn& to_display) {
    // Light in the middle and to the right of it.
    const SpreadPicture right{
        3, 1, 20,
        std::make_shared<const std::vector<std::uint8_t>>(std::vector<std::uint8_t>{0, 100, 100})};
    const LightBlur blur({{}, right}, 20, 20, to_display);
    const PixelBox around{-2, -2, 3, 3};
    const double light = 1;
    Field out(25);
    blur.apply(&light, {0, 0, 1, 1}, out.data(), around);
    EXPECT_DOUBLE_EQ(out[12], 0.5);
    return out[static_cast<std::size_t>(12 + dx + 5 * dy)];
  };
  EXPECT_DOUBLE_EQ(arrow(1, 0, {}), 0.5);
  EXPECT_DOUBLE_EQ(arrow(-1, 0, {false, true, false}), 0.5);
  EXPECT_DOUBLE_EQ(arrow(0, 1, {true, false, false}), 0.5);
  for (const bool swap : {false, true}) {
    for (const bool flip_x : {false, true}) {
      for (const bool flip_y : {false, true}) {
        // The pixel that lies to the right on the display.
        const Turn turn{swap, flip_x, flip_y};
        const Turn back = turn.inverse();
        const Pixel p = turned(Pixel{2, 1}, back, 3, 3);
        EXPECT_DOUBLE_EQ(arrow(p.x - 1, p.y - 1, turn), 0.5);
      }
    }
  }
}

// --- Scatter with depth ---

// Layer by layer the light of a distance of its own has crossed all slices between: what scatters adds its
// variance to that of the picture.
TEST(LightSpread, WhatScattersWidensPictures) {
  constexpr double kSliceUm = 50;
  const LightSpread spread{{}, lopsided(37)};
  const PixelBox box{-60, -60, 61, 61};
  const double one = 1;
  struct Moments {
    double sum = 0, x2 = 0, y2 = 0;
  };
  const auto moments = [&](const LightBlur& blur) {
    Field field(121 * 121);
    blur.apply(&one, {0, 0, 1, 1}, field.data(), box);
    double sum = 0, x1 = 0, y1 = 0, x2 = 0, y2 = 0;
    for (int y = -60; y <= 60; ++y) {
      for (int x = -60; x <= 60; ++x) {
        const double v = field[static_cast<std::size_t>((y + 60) * 121 + x + 60)];
        EXPECT_GE(v, 0);
        sum += v;
        x1 += v * x * 50;
        y1 += v * y * 40;
        x2 += v * x * x * 50 * 50;
        y2 += v * y * y * 40 * 40;
      }
    }
    return Moments{sum, x2 - x1 * x1, y2 - y1 * y1};
  };
  const Moments window = moments(LightBlur(spread, 50, 40));
  for (const double scatter : {0.7, 10.0, 90.0}) {
    const auto all = detail::distance_blurs(spread, {scatter, 300, kSliceUm, true, 50, 40}, 2);
    ASSERT_FALSE(all.empty());
    ASSERT_EQ(all.front().to, 1);
    const Moments m = moments(all.front().blur);
    EXPECT_NEAR(m.sum, 1, 1e-13);
    // Rows and columns without a weight of 1e-6 are left out: they begin some 5 sigma from the middle,
    // where a Gaussian has less than 1e-3 of its variance.
    EXPECT_NEAR(m.x2, window.x2 + scatter * kSliceUm, 1e-3 * m.x2) << scatter;
    EXPECT_NEAR(m.y2, window.y2 + scatter * kSliceUm, 1e-3 * m.y2) << scatter;
  }
}

// --- Keys ---

std::string printer_text(const std::string& blue, const std::string& uv = "") {
  return "name = \"p\"\n[display]\nwidth_px = 128\nheight_px = 80\npixel_um = 50\n[blue]\n"
         "calibration = [[0, 1], [255, 100]]\n" +
         blue + (uv.empty() ? "" : "\n[uv]\ncalibration = [[0, 1], [255, 100]]\n" + uv);
}

TEST(SpreadKeys, AreRead) {
  const Printer p = parse_printer(
      printer_text("spread = [[15, 0.9], [120.5, 0.1]]", "kind = \"patterned\"\nspread = [[9, 1]]"),
      "p.toml");
  EXPECT_EQ(p.spread.gaussians, (std::vector<SpreadGaussian>{{15, 0.9}, {120.5, 0.1}}));
  EXPECT_EQ(p.uv->spread.gaussians, (std::vector<SpreadGaussian>{{9, 1}}));
  EXPECT_TRUE(parse_printer(printer_text(""), "p.toml").spread.none());
  EXPECT_EQ(spread_in_words(p.uv->spread), "Gaussian, sigma 9 um");
  const std::string cure =
      "[cure]\nabsorbance_height_um = 550\nabsorbance_base = \"e\"\ngel_dose_mj_cm3 = 40\n";
  EXPECT_EQ(parse_resin(cure + "scatter_um2_per_um = 1.5\n", "r.toml").scatter_um2_per_um, 1.5);
  EXPECT_EQ(parse_resin("scatter_um2_per_um = 2\n" + cure, "r.toml").scatter_um2_per_um, 2);
  EXPECT_EQ(parse_resin(cure, "r.toml").scatter_um2_per_um, 0);
  for (const char* wrong : {"-1", "inf", "nan", "1001", "\"2\""}) {
    EXPECT_THROW(parse_resin(cure + "scatter_um2_per_um = " + wrong + "\n", "r.toml"), InputError)
        << wrong;
  }
}

/// The complaint about a printer file.
std::string complaint(const std::string& text, const std::string& source = "p.toml") {
  try {
    complete_printer(text, source);
  } catch (const InputError& e) {
    return e.what();
  }
  return "no complaint";
}

TEST(SpreadKeys, AreRefused) {
  const struct {
    const char *spread, *says;
  } cases[] = {{"[]", "expected [[sigma_um, weight], ...]"},
               {"3", "expected [[sigma_um, weight], ...]"},
               {"\"\"", "expected [[sigma_um, weight], ...]"},
               {"[3, 1]", "expected pairs"},
               {"[[3]]", "expected pairs"},
               {"[[3, \"1\"]]", "expected pairs"},
               {"[[-3, 1]]", "sigma is -3 um"},
               {"[[nan, 1]]", "sigma is nan um"},
               {"[[inf, 1]]", "sigma is inf um"},
               {"[[3, 1.5], [4, -0.5]]", "Gaussian 2: the weight is -0.5"},
               {"[[3, nan]]", "the weight is nan"},
               {"[[3, 0.9], [4, 0.05]]", "weights that add up to 0.95"},
               // The display's shorter side is 4 mm.
               {"[[900, 1]]", "further than the display's shorter side, 4000 um"},
               {"\"none.png\"\nspread_pitch_um = 4", "is not a file that can be read"},
               {"\"none.png\"", "spread_pitch_um"}};
  for (const auto& c : cases) {
    const std::string said = complaint(printer_text(std::string("spread = ") + c.spread));
    EXPECT_NE(said.find(c.says), std::string::npos) << c.spread << ": " << said;
    EXPECT_NE(said.find("p.toml"), std::string::npos) << said;
  }
  EXPECT_NE(complaint(printer_text("spread_pitch_um = 4")).find("without a picture"),
            std::string::npos);
  EXPECT_NE(complaint(printer_text("", "spread = [[3, 1]]")).find("flood"), std::string::npos);
  std::string many = "spread = [";
  for (int i = 0; i < 17; ++i) many += "[3, 0.0588235],";
  EXPECT_NE(complaint(printer_text(many + "]")).find("17 Gaussians"), std::string::npos);
}

class SpreadPictures : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = (std::filesystem::temp_directory_path() / "spread-XXXXXX").string();
    ASSERT_NE(::mkdtemp(folder_.data()), nullptr);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string with(const GreyImage& image, double pitch_um) {
    const auto bytes = encode_png(image);
    std::ofstream(folder_ + "/k.png", std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    return printer_text("spread = \"k.png\"\nspread_pitch_um = " + std::to_string(pitch_um));
  }
  std::string source() const { return folder_ + "/p.toml"; }
  std::string folder_;
};

TEST_F(SpreadPictures, AreReadAndKept) {
  const SpreadPicture wanted = lopsided(37.5);
  const Printer p = complete_printer(with({5, 3, *wanted.values}, 37.5), source());
  ASSERT_TRUE(p.spread.picture);
  EXPECT_EQ(*p.spread.picture, wanted);
  EXPECT_FALSE(p.spread.none());
  SetupChoices c;
  c.printer = std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml";
  c.resin = std::string(SLICECORR_DB_DIR) + "/da-2-ppo.toml";
  c.speed_mm_h = 700;
  slicecorr::Setup setup = resolve_setup(c, nullptr, nullptr, ChoiceNames::fields);
  const std::string without = setup_json(setup);
  EXPECT_EQ(without.find("spread"), std::string::npos);
  EXPECT_EQ(without.find("scatter"), std::string::npos);
  for (const LightSpread& spread : spreads()) {
    setup.printer.spread = spread;
    setup.printer.uv->spread = spread;
    setup.resin.scatter_um2_per_um = 0.3;
    const slicecorr::Setup again = parse_setup_json(setup_json(setup), "text");
    EXPECT_EQ(again.printer, setup.printer);
    EXPECT_EQ(again.resin, setup.resin);
  }
  const auto refused = [&](const LightSpread& spread) {
    setup.printer.spread = spread;
    EXPECT_THROW(parse_setup_json(setup_json(setup), "text"), InputError);
  };
  refused(gaussian(1e6));
  refused({{{3, 0.5}}, std::nullopt});
  SpreadPicture wrong = wanted;
  wrong.height_px = 1;
  refused({{}, wrong});
}

TEST_F(SpreadPictures, AreRefused) {
  const auto said = [&](int width, int height, std::vector<std::uint8_t> values, double pitch_um) {
    return complaint(with({width, height, std::move(values)}, pitch_um), source());
  };
  EXPECT_NE(said(2, 3, std::vector<std::uint8_t>(6, 9), 10).find("odd sides"), std::string::npos);
  EXPECT_NE(said(3, 4, std::vector<std::uint8_t>(12, 9), 10).find("odd sides"), std::string::npos);
  EXPECT_NE(said(3, 3, std::vector<std::uint8_t>(9, 0), 10).find("is black"), std::string::npos);
  EXPECT_NE(said(5, 1, {0, 0, 0, 10, 90}, 10).find("centre at [1.9, 0] pixels"), std::string::npos);
  EXPECT_NE(said(3, 3, std::vector<std::uint8_t>(9, 9), 3000).find("reaches 4500 um"),
            std::string::npos);
  EXPECT_NE(said(513, 1, std::vector<std::uint8_t>(513, 9), 1).find("at most 511"),
            std::string::npos);
  std::ofstream(folder_ + "/k.png") << "text";
  EXPECT_NE(complaint(printer_text("spread = \"k.png\"\nspread_pitch_um = 4"), source())
                .find("is no PNG image"),
            std::string::npos);
}

}  // namespace
}  // namespace slicecorr
