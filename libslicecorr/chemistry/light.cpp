// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "chemistry/light.hpp"

#include <cmath>

#include "chemistry/diffusion.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::detail {

/// Products that make a thread worth while.
constexpr std::size_t kProductsAThread = 20000;

std::vector<double> spread_weights(double spread_um, double cell_um) {
  const double sigma = spread_um / cell_um;
  if (!(sigma > 0)) return {1};
  std::vector<double> w;
  double sum = 0;
  const int reach = static_cast<int>(std::ceil(kSpreadReachSigmas * sigma));
  for (int j = 0; j <= reach; ++j) {
    w.push_back(std::exp(-0.5 * j * j / (sigma * sigma)));
    sum += j == 0 ? w.back() : 2 * w.back();
  }
  for (double& v : w) v /= sum;
  return w;
}

std::vector<float> spread_shares(const std::vector<float>& share, int width, int height,
                                 const PatternSetup& setup, const ExecutionContext& context) {
  const std::vector<double> w = spread_weights(setup.spread_um, setup.cell_um);
  if (w.size() == 1) return share;
  const bool walls = setup.sides == Sides::walls;
  const auto nx = static_cast<std::size_t>(width), ny = static_cast<std::size_t>(height);
  const auto reach = static_cast<std::ptrdiff_t>(w.size()) - 1;
  std::vector<double> along(share.size());
  std::vector<float> out(share.size());
  const ExecutionContext quiet = silent(context, share.size() * w.size(), kProductsAThread);
  parallel_for(quiet, "spreading light", ny, [&](std::size_t y) {
    const float* row = share.data() + y * nx;
    for (std::size_t x = 0; x < nx; ++x) {
      double sum = 0;
      for (std::ptrdiff_t j = -reach; j <= reach; ++j) {
        sum +=
            w[static_cast<std::size_t>(std::abs(j))] *
            static_cast<double>(row[wrapped_cell(static_cast<std::ptrdiff_t>(x) + j, nx, walls)]);
      }
      along[y * nx + x] = sum;
    }
  });
  parallel_for(quiet, "spreading light", ny, [&](std::size_t y) {
    std::vector<double> sum(nx, 0.0);
    for (std::ptrdiff_t j = -reach; j <= reach; ++j) {
      const double* row =
          along.data() + wrapped_cell(static_cast<std::ptrdiff_t>(y) + j, ny, walls) * nx;
      const double v = w[static_cast<std::size_t>(std::abs(j))];
      for (std::size_t x = 0; x < nx; ++x) sum[x] += v * row[x];
    }
    for (std::size_t x = 0; x < nx; ++x) out[y * nx + x] = static_cast<float>(sum[x]);
  });
  return out;
}

std::vector<float> light_of(const Chemistry& c, const LightPattern& pattern,
                            const PatternSetup& setup, const ExecutionContext& context) {
  std::vector<float> light =
      spread_shares(pattern.share, pattern.width, pattern.height, setup, context);
  const double scale = setup.intensity_mw_cm2 * mean_light_share(c, setup.film_um);
  for (float& v : light) v = static_cast<float>(scale * static_cast<double>(v));
  return light;
}

}  // namespace slicecorr::detail
