// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light that spreads, with the program as people run it. What it says is held against a direct
/// convolution of the images that it wrote, which are read by libpng here; no blur of ours is used.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "made_once.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;

constexpr int kWidth = kSmallWidth, kHeight = kSmallHeight;
constexpr std::size_t kPixels = static_cast<std::size_t>(kWidth) * kHeight;
constexpr double kPixelUm = 50, kLayerUm = 50, kHeightUm = 2000;

std::string printer_with(const std::string& spread, const std::string& more = "") {
  return kSmallPrinter + std::string("spread = ") + spread + "\n" + more;
}

using Field = std::vector<double>;
double at(const Field& f, int x, int y) {
  // Beyond the display it is dark.
  if (x < 0 || y < 0 || x >= kWidth || y >= kHeight) return 0;
  return f[static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x)];
}

/// Share of the light of a pixel that falls `pixels` away along one axis, by the normal integral.
double share(int pixels, double sigma_px) {
  const double scale = sigma_px * std::sqrt(2.0);
  return (std::erf((pixels + 0.5) / scale) - std::erf((pixels - 0.5) / scale)) / 2;
}

/// A field spread by a Gaussian, summed up pixel by pixel.
Field spread(const Field& light, double sigma_px) {
  const int reach = static_cast<int>(std::ceil(6 * sigma_px)) + 1;
  std::vector<double> shares;
  for (int d = -reach; d <= reach; ++d) shares.push_back(share(d, sigma_px));
  Field rows(kPixels), all(kPixels);
  for (int pass = 0; pass < 2; ++pass) {
    const Field& in = pass == 0 ? light : rows;
    Field& out = pass == 0 ? rows : all;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        double sum = 0;
        for (int d = -reach; d <= reach; ++d) {
          sum += shares[static_cast<std::size_t>(d + reach)] *
                 (pass == 0 ? at(in, x + d, y) : at(in, x, y + d));
        }
        out[static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x)] = sum;
      }
    }
  }
  return all;
}

struct Wrong {
  int through = 0, under = 0;
  int close = 0;  ///< so near to 1 that the cut of the program's weights may decide
};

/// Wrong voxels of coverage 0 and 1 by sums over the images. Weights are cut by the program where
/// 1e-6 of the light is left.
Wrong wrong_voxels(const std::vector<Bytes>& images, const std::vector<Bytes>& target,
                   double sigma_px) {
  const double a = std::pow(10, -kLayerUm / kHeightUm), root = std::sqrt(a);
  Wrong wrong;
  Field above(kPixels, 0);  // at the node above the layer, seen from the platform: shown later
  for (std::size_t n = images.size(); n-- > 0;) {
    Field phi(kPixels);
    for (std::size_t k = 0; k < kPixels; ++k) {
      phi[k] = kPhiMin + (kPhiMax - kPhiMin) * images[n][k] / 255.0;
    }
    const Field light = spread(phi, sigma_px);
    Field dose(kPixels);
    for (std::size_t k = 0; k < kPixels; ++k) {
      dose[k] = (1 - a) * light[k] + a * above[k];
      const double middle = (dose[k] + root * above[k]) / (1 + root);
      const std::uint8_t cover = n < target.size() ? target[n][k] : std::uint8_t{0};
      wrong.close += std::abs(middle - 1) < 1e-5;
      wrong.through += middle >= 1 && cover == 0;
      wrong.under += middle < 1 && cover == 255;
    }
    above = dose;
  }
  return wrong;
}

class SpreadProgram : public ProgramFixture {
 protected:
  SpreadProgram() {
    write_stl(folder_ / "ladder.stl", ladder());
    write("even.toml", kSmallPrinter);
    write("blurred.toml", printer_with("[[40.0, 1.0]]"));
    made_once("SpreadProgram", folder_, {"target.uvj"}, [&] {
      good({"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
            "even.toml"});
    });
  }
  static Command with(const std::string& printer, const std::string& resin = "figure-2-2") {
    return {"--printer", printer, "--resin", resin, "--speed-mm-h", "1000", "--omega-max", "2"};
  }
};

TEST_F(SpreadProgram, FiguresAreThoseOfTheImagesSpread) {
  const auto target = images("target.uvj");
  write("milky.toml",
        "[cure]\nabsorbance_height_um = 2000\nabsorbance_base = 10\n"
        "critical_dose_mj_cm3 = 576\nscatter_um2_per_um = 2\n");
  const auto judge = [&](const std::string& stack, bool scatters) {
    SCOPED_TRACE(stack);
    const json said = figures(stack, "target.uvj");
    // What scatters is held against a fine grid by scatter_grid_test.
    if (scatters)
      return said["cure_through_voxels"].get<int>() + said["undercure_voxels"].get<int>();
    const Wrong sums = wrong_voxels(images(stack), target, 40 / kPixelUm);
    EXPECT_NEAR(said["cure_through_voxels"].get<int>(), sums.through, sums.close);
    EXPECT_NEAR(said["undercure_voxels"].get<int>(), sums.under, sums.close);
    EXPECT_LE(sums.close, 20);
    return sums.through + sums.under;
  };
  for (const auto& [resin, scatters] : {std::pair{"figure-2-2", false}, {"milky.toml", true}}) {
    SCOPED_TRACE(resin);
    good(Command{"correct", "target.uvj", "-o", "alone.uvj", "--spread-correction", "off"} +
         with("blurred.toml", resin));
    const RunResult said =
        good(Command{"correct", "target.uvj", "-o", "together.uvj", "--rounds", "4"} +
             with("blurred.toml", resin));
    EXPECT_NE(said.err.find("round"), std::string::npos) << said.err;
    const int alone = judge("alone.uvj", scatters), together = judge("together.uvj", scatters);
    // Rails and rungs are 20 and 40 pixels wide, far more than light spreads: what columns alone
    // leave wrong lies along their sides, and rounds mend it.
    EXPECT_GT(alone, 100);
    EXPECT_LT(together, alone / 2);
  }
}

TEST_F(SpreadProgram, LightThatStaysIsAsBefore) {
  write("sharp.toml", printer_with("[[0.0, 1.0]]"));
  good(Command{"correct", "target.uvj", "-o", "even.uvj"} + with("even.toml"));
  const RunResult said =
      good(Command{"correct", "target.uvj", "-o", "sharp.uvj"} + with("sharp.toml"));
  EXPECT_EQ(images("even.uvj"), images("sharp.uvj"));
  EXPECT_EQ(said.err.find("round"), std::string::npos) << said.err;
  // No round: columns alone.
  good(Command{"correct", "target.uvj", "-o", "none.uvj", "--rounds", "0"} + with("blurred.toml"));
  good(Command{"correct", "target.uvj", "-o", "off.uvj", "--spread-correction", "off"} +
       with("blurred.toml"));
  EXPECT_EQ(images("none.uvj"), images("off.uvj"));
}

TEST_F(SpreadProgram, WhatCanNotBeIsRefused) {
  const Command correct{"correct", "target.uvj", "-o", "out.uvj"};
  for (const char* wrong : {"[[-1.0, 1.0]]", "[[40.0, 0.5]]", "[[40.0, 1.2], [10.0, -0.2]]",
                            "[[inf, 1.0]]", "[]", "\"missing.png\""}) {
    write("bad.toml", printer_with(wrong));
    bad(2, correct + with("bad.toml"), {"bad.toml", "spread"});
  }
  // Millimetres taken for um: light reaches over more pixels than there are.
  write("wide.toml", printer_with("[[40000.0, 1.0]]"));
  bad(2, correct + with("wide.toml"), {"sigma"});
  write("uv.toml",
        printer_with("[[40.0, 1.0]]",
                     "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n"));
  write("scatters.toml", R"(name = "scatters"

[cure]
model = "kinetic"
wavelength_nm = 460
m = 0.99
absorbance_height_um = 408.0
absorbance_base = "e"
critical_dose_prime = 64.0
scatter_um2_per_um = 1

[inhibition]
wavelength_nm = 365
beta = 0.73
absorbance_height_um = 37.8
absorbance_base = "e"
)");
  bad(2,
      correct + Command{"--printer", "uv.toml", "--resin", "scatters.toml", "--speed-mm-h", "300",
                        "--uv-mw-cm2", "200"},
      {"scatter_um2_per_um, and UV light is on"});
  bad(2, correct + with("blurred.toml") + Command{"--rounds", "-1"}, {"--rounds"});
  bad(2, correct + with("blurred.toml") + Command{"--spread-correction", "maybe"},
      {"--spread-correction"});
}

}  // namespace
}  // namespace slicecorr::test
