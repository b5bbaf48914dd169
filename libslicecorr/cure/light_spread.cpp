// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/light_spread.hpp"

#include <algorithm>
#include <cmath>

#include "base/kernels.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

namespace {

/// What of a spread may be left out.
constexpr double kCut = 1e-6;

/// Sums that are added up together: as many as fill eight registers of AVX2.
constexpr std::size_t kLanes = 32;

/// out = or += taps[0] c + the sum over k of taps[k] (c[-k step] + c[k step]), in that order.
SLICECORR_CLONES
void symmetric_sum(const double* centre, std::ptrdiff_t step, const double* taps, int reach,
                   double* out, std::size_t count, bool add) {
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    const double* c = centre + i;
    double sum[kLanes];
    for (std::size_t j = 0; j < kLanes; ++j) sum[j] = taps[0] * c[j];
    for (int k = 1; k <= reach; ++k) {
      const double *low = c - k * step, *high = c + k * step;
      const double tap = taps[k];
      for (std::size_t j = 0; j < kLanes; ++j) sum[j] += tap * (low[j] + high[j]);
    }
    if (add) {
      for (std::size_t j = 0; j < kLanes; ++j) out[i + j] += sum[j];
    } else {
      for (std::size_t j = 0; j < kLanes; ++j) out[i + j] = sum[j];
    }
  }
  for (; i < count; ++i) {
    const double* c = centre + i;
    double sum = taps[0] * c[0];
    for (int k = 1; k <= reach; ++k) sum += taps[k] * (c[-k * step] + c[k * step]);
    out[i] = add ? out[i] + sum : sum;
  }
}

/// out = the sum over rows and columns of taps times pixels, `stride` between rows of `first`.
SLICECORR_CLONES
void full_sum(const double* first, std::ptrdiff_t stride, const double* taps, int rows, int columns,
              double* out, std::size_t count) {
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    double sum[kLanes] = {};
    const double* tap = taps;
    for (int y = 0; y < rows; ++y) {
      const double* row = first + y * stride + i;
      for (int x = 0; x < columns; ++x, ++tap) {
        for (std::size_t j = 0; j < kLanes; ++j)
          sum[j] += *tap * row[static_cast<std::size_t>(x) + j];
      }
    }
    for (std::size_t j = 0; j < kLanes; ++j) out[i + j] = sum[j];
  }
  for (; i < count; ++i) {
    double sum = 0;
    const double* tap = taps;
    for (int y = 0; y < rows; ++y) {
      const double* row = first + y * stride + i;
      for (int x = 0; x < columns; ++x, ++tap) sum += *tap * row[x];
    }
    out[i] = sum;
  }
}

/// Copies row `y`, columns from `x0` on, of a field over `from` to `row`; 0 outside of it. False
/// where all of it is outside.
bool take_row(const double* in, const PixelBox& from, int y, int x0, double* row, int count) {
  if (y < from.y0 || y >= from.y1) return false;
  const int left = std::clamp(from.x0 - x0, 0, count),
            right = std::clamp(from.x1 - x0, left, count);
  const std::ptrdiff_t at =
      static_cast<std::ptrdiff_t>(y - from.y0) * from.width() + (x0 + left - from.x0);
  std::fill(row, row + left, 0.0);
  if (right > left) std::copy(in + at, in + at + (right - left), row + left);
  std::fill(row + right, row + count, 0.0);
  return true;
}

/// The sum of products of the rows of a measured spread with what of them falls into each pixel:
/// along one axis the share of each of `count` picture pixels in pixels -reach..reach.
std::vector<double> overlaps(int count, double pitch_um, double pixel_um, int reach) {
  std::vector<double> share(static_cast<std::size_t>(count) *
                            (2 * static_cast<std::size_t>(reach) + 1));
  std::size_t at = 0;
  const int middle = count / 2;
  for (int i = 0; i < count; ++i) {
    const double low = (i - middle - 0.5) * pitch_um, high = low + pitch_um;
    for (int k = -reach; k <= reach; ++k) {
      const double from = std::max(low, (k - 0.5) * pixel_um),
                   to = std::min(high, (k + 0.5) * pixel_um);
      share[at++] = std::max(0.0, to - from) / pitch_um;
    }
  }
  return share;
}

/// Pixels that half of `count` picture pixels reach to either side.
int reach_of(int count, double pitch_um, double pixel_um) {
  return std::max(0, static_cast<int>(std::ceil(count / 2.0 * pitch_um / pixel_um - 0.5)));
}

}  // namespace

std::vector<double> gaussian_taps(double sigma_um, double pixel_um) {
  if (!(sigma_um > 0)) return {1.0};
  const double per_pixel = pixel_um / (sigma_um * std::sqrt(2.0));
  std::vector<double> taps{std::erf(0.5 * per_pixel)};
  for (int k = 1; std::erfc((k - 0.5) * per_pixel) >= kCut; ++k) {
    taps.push_back((std::erfc((k - 0.5) * per_pixel) - std::erfc((k + 0.5) * per_pixel)) / 2);
  }
  // From the outermost, which are the least, inwards.
  double sum = 0;
  for (std::size_t k = taps.size(); k-- > 1;) sum += 2 * taps[k];
  sum += taps[0];
  for (double& tap : taps) tap /= sum;
  return taps;
}

double share_beside_line(const LightSpread& spread, bool rows, double x_um) {
  double share = 0, whole = 0;
  if (!spread.picture) {
    for (const SpreadGaussian& g : spread.gaussians) {
      whole += g.weight;
      share +=
          g.weight * (g.sigma_um > 0 ? std::erf(x_um / (g.sigma_um * std::sqrt(2.0))) / 2 : 0.5);
    }
    return whole > 0 ? share / whole : 0.5;
  }
  const SpreadPicture& picture = *spread.picture;
  std::size_t at = 0;
  for (int y = 0; y < picture.height_px; ++y) {
    for (int x = 0; x < picture.width_px; ++x, ++at) {
      // Across the line, from the middle: the near and the far side of this pixel.
      const int k = std::abs(rows ? y - picture.height_px / 2 : x - picture.width_px / 2);
      const double near = std::max(0.0, (k - 0.5) * picture.pitch_um),
                   far = (k + 0.5) * picture.pitch_um;
      const double value = (*picture.values)[at];
      whole += value;
      share += value * std::clamp((x_um - near) / (far - near), 0.0, 1.0) / 2;
    }
  }
  return share / whole;
}

FinestWidths finest_widths(const LightSpread& spread, bool rows, double full, double black) {
  constexpr double kStaysBelow = 0.1;
  const auto beside = [&](double x_um) {
    return x_um < 0 ? -share_beside_line(spread, rows, -x_um)
                    : share_beside_line(spread, rows, x_um);
  };
  // The least x at which what rises with it reaches 0.
  const auto least = [](const auto& rising) {
    double low = 0, high = 1;
    while (rising(high) < 0 && high < 1e9) high *= 2;
    return halved({low, high}, 100, [&](double x) { return rising(x) < 0; }).high;
  };
  FinestWidths finest;
  finest.line_um =
      least([&](double w) { return black + (full - black) * 2 * beside(w / 2) - 1.0; });
  const double dark_um = least(
      [&](double w) { return 1.0 - kStaysBelow - (full - (full - black) * 2 * beside(w / 2)); });
  finest.gap_um = least([&](double w) {
    return full - (full - black) * (beside((dark_um + w) / 2) + beside((dark_um - w) / 2)) - 1.0;
  });
  return finest;
}

LightBlur::LightBlur(const LightSpread& spread, double pixel_x_um, double pixel_y_um,
                     const Turn& to_display) {
  if (spread.none()) return;
  if (!spread.picture) {
    double weights = 0;
    for (const SpreadGaussian& g : spread.gaussians) weights += g.weight;
    for (const SpreadGaussian& g : spread.gaussians) {
      if (g.weight == 0) continue;
      Part part{gaussian_taps(g.sigma_um, pixel_x_um), gaussian_taps(g.sigma_um, pixel_y_um)};
      for (double& tap : part.y) tap *= g.weight / weights;
      reach_x_ = std::max(reach_x_, static_cast<int>(part.x.size()) - 1);
      reach_y_ = std::max(reach_y_, static_cast<int>(part.y.size()) - 1);
      parts_.push_back(std::move(part));
    }
    return;
  }
  const SpreadPicture& picture = *spread.picture;
  // As the blurred images lie.
  const Turn back = to_display.inverse();
  const int width = back.swap_axes ? picture.height_px : picture.width_px,
            height = back.swap_axes ? picture.width_px : picture.height_px;
  std::vector<double> light(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  std::size_t at = 0;
  for (int y = 0; y < picture.height_px; ++y) {
    for (int x = 0; x < picture.width_px; ++x) {
      const Pixel p = turned(Pixel{x, y}, back, picture.width_px, picture.height_px);
      light[static_cast<std::size_t>(p.y) * static_cast<std::size_t>(width) +
            static_cast<std::size_t>(p.x)] = (*picture.values)[at++];
    }
  }
  reach_x_ = reach_of(width, picture.pitch_um, pixel_x_um);
  reach_y_ = reach_of(height, picture.pitch_um, pixel_y_um);
  const auto columns = 2 * static_cast<std::size_t>(reach_x_) + 1,
             rows = 2 * static_cast<std::size_t>(reach_y_) + 1;
  const std::vector<double> share_x = overlaps(width, picture.pitch_um, pixel_x_um, reach_x_),
                            share_y = overlaps(height, picture.pitch_um, pixel_y_um, reach_y_);
  std::vector<double> weights(rows * columns);
  double sum = 0;
  for (std::size_t y = 0; y < static_cast<std::size_t>(height); ++y) {
    std::vector<double> row(columns);
    for (std::size_t x = 0; x < static_cast<std::size_t>(width); ++x) {
      const double v = light[y * static_cast<std::size_t>(width) + x];
      sum += v;
      for (std::size_t i = 0; i < columns; ++i) row[i] += v * share_x[x * columns + i];
    }
    for (std::size_t j = 0; j < rows; ++j) {
      for (std::size_t i = 0; i < columns; ++i) {
        weights[j * columns + i] += share_y[y * rows + j] * row[i];
      }
    }
  }
  for (double& w : weights) w /= sum;
  *this = of_weights(weights, reach_x_, reach_y_);
}

LightBlur LightBlur::of_weights(const std::vector<double>& weights, int reach_x, int reach_y) {
  LightBlur blur;
  blur.reach_x_ = reach_x;
  blur.reach_y_ = reach_y;
  // A pixel takes from the one at +i what that one sends to -i.
  blur.measured_.assign(weights.rbegin(), weights.rend());
  return blur;
}

void LightBlur::apply(const double* in, const PixelBox& from, double* out,
                      const PixelBox& to) const {
  if (to.empty()) return;
  if (!measured_.empty()) return apply_measured(in, from, out, to);
  const auto width = static_cast<std::size_t>(to.width());
  if (parts_.empty()) {
    for (int y = to.y0; y < to.y1; ++y, out += width) {
      if (!take_row(in, from, y, to.x0, out, to.width())) std::fill(out, out + width, 0.0);
    }
    return;
  }
  std::vector<double> padded(width + 2 * static_cast<std::size_t>(reach_x_));
  std::vector<double> rows(
      width * (static_cast<std::size_t>(to.height()) + 2 * static_cast<std::size_t>(reach_y_)));
  bool add = false;
  for (const Part& part : parts_) {
    const int reach_x = static_cast<int>(part.x.size()) - 1,
              reach_y = static_cast<int>(part.y.size()) - 1;
    double* row = rows.data();
    for (int y = to.y0 - reach_y; y < to.y1 + reach_y; ++y, row += width) {
      if (take_row(in, from, y, to.x0 - reach_x, padded.data(), to.width() + 2 * reach_x)) {
        symmetric_sum(padded.data() + reach_x, 1, part.x.data(), reach_x, row, width, false);
      } else {
        std::fill(row, row + width, 0.0);
      }
    }
    for (int y = 0; y < to.height(); ++y) {
      symmetric_sum(rows.data() + static_cast<std::size_t>(y + reach_y) * width,
                    static_cast<std::ptrdiff_t>(width), part.y.data(), reach_y,
                    out + static_cast<std::size_t>(y) * width, width, add);
    }
    add = true;
  }
}

void LightBlur::apply_measured(const double* in, const PixelBox& from, double* out,
                               const PixelBox& to) const {
  const auto width = static_cast<std::size_t>(to.width());
  const std::size_t stride = width + 2 * static_cast<std::size_t>(reach_x_);
  std::vector<double> padded(
      stride * (static_cast<std::size_t>(to.height()) + 2 * static_cast<std::size_t>(reach_y_)));
  double* row = padded.data();
  for (int y = to.y0 - reach_y_; y < to.y1 + reach_y_; ++y, row += stride) {
    take_row(in, from, y, to.x0 - reach_x_, row, static_cast<int>(stride));
  }
  for (int y = 0; y < to.height(); ++y) {
    full_sum(padded.data() + static_cast<std::size_t>(y) * stride,
             static_cast<std::ptrdiff_t>(stride), measured_.data(), 2 * reach_y_ + 1,
             2 * reach_x_ + 1, out + static_cast<std::size_t>(y) * width, width);
  }
}

}  // namespace slicecorr::detail
