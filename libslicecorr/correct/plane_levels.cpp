// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/plane_levels.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::detail {

namespace {

/// Kept from what is needed for rounding: sums of a few hundred weights of about 1.
constexpr double kRounding = 1e-12;

/// Where the light of a pixel goes.
class Spot {
 public:
  explicit Spot(const LightBlur& blur) : rx_(blur.reach_x()), ry_(blur.reach_y()) {
    const double one = 1;
    const PixelBox pixel{0, 0, 1, 1}, around{-rx_, -ry_, rx_ + 1, ry_ + 1};
    weights_.resize(static_cast<std::size_t>(around.width()) *
                    static_cast<std::size_t>(around.height()));
    if (blur.none()) {
      weights_[0] = 1;
    } else {
      blur.apply(&one, pixel, weights_.data(), around);
    }
  }
  double own() const { return at(0, 0); }
  double at(int dx, int dy) const {
    return weights_[static_cast<std::size_t>(dy + ry_) * static_cast<std::size_t>(2 * rx_ + 1) +
                    static_cast<std::size_t>(dx + rx_)];
  }
  /// Calls `each(pixel, weight)` for the pixels of a plane around (x, y), itself included.
  template <class Each>
  void around(const PlaneOfLight& plane, int x, int y, const Each& each) const {
    const int x0 = std::max(0, x - rx_), x1 = std::min(plane.width_px - 1, x + rx_);
    const int y0 = std::max(0, y - ry_), y1 = std::min(plane.height_px - 1, y + ry_);
    for (int py = y0; py <= y1; ++py) {
      for (int px = x0; px <= x1; ++px) {
        const double w = at(px - x, py - y);
        if (w > 0) {
          each(static_cast<std::size_t>(py) * static_cast<std::size_t>(plane.width_px) +
                   static_cast<std::size_t>(px),
               w);
        }
      }
    }
  }
  /// Whether it is as wide as a Gaussian whose sigma is half a pixel.
  bool wide() const {
    double sum = 0, x = 0, y = 0;
    for (int dy = -ry_; dy <= ry_; ++dy) {
      for (int dx = -rx_; dx <= rx_; ++dx) {
        const double w = at(dx, dy);
        sum += w;
        x += w * dx * dx;
        y += w * dy * dy;
      }
    }
    double least = 0, k = 0;
    for (const double tap : gaussian_taps(0.5, 1.0)) {
      least += 2 * tap * k * k;
      k += 1;
    }
    least *= 1 - 1e-9;
    return x >= least * sum && y >= least * sum;
  }

 private:
  int rx_, ry_;
  std::vector<double> weights_;
};

/// Features by number, 1 and on; 0 in gaps.
std::vector<std::uint32_t> features_of(const PlaneOfLight& p) {
  const auto width = static_cast<std::size_t>(p.width_px);
  std::vector<std::uint32_t> label(width * static_cast<std::size_t>(p.height_px), 0);
  std::vector<std::size_t> open;
  std::uint32_t count = 0;
  for (std::size_t start = 0; start < label.size(); ++start) {
    if (p.feature[start] == 0 || label[start] != 0) continue;
    label[start] = ++count;
    open.push_back(start);
    while (!open.empty()) {
      const std::size_t at = open.back();
      open.pop_back();
      const int x = static_cast<int>(at % width), y = static_cast<int>(at / width);
      for (int py = std::max(0, y - 1); py <= std::min(p.height_px - 1, y + 1); ++py) {
        for (int px = std::max(0, x - 1); px <= std::min(p.width_px - 1, x + 1); ++px) {
          const std::size_t next =
              static_cast<std::size_t>(py) * width + static_cast<std::size_t>(px);
          if (p.feature[next] == 0 || label[next] != 0) continue;
          label[next] = count;
          open.push_back(next);
        }
      }
    }
  }
  return label;
}

class PlaneDecision {
 public:
  PlaneDecision(const LevelTable& levels, const PlaneOfLight& plane, const LightBlur& blur)
      : table_(levels), plane_(plane), spot_(blur), label_(features_of(plane)) {}
  PlaneOfLevels decide(const LightBlur& blur) {
    const std::size_t size = label_.size();
    decided_.assign(size, 0);
    credit_.assign(size, 0.0);
    light_.assign(plane_.wanted, plane_.wanted + size);
    if (!blur.none()) {
      const PixelBox all{0, 0, plane_.width_px, plane_.height_px};
      blur.apply(plane_.wanted, all, light_.data(), all);
    }
    result_.levels.assign(size, 0);
    result_.handed_on = spot_.wide();
    // Gaps first: what they lack beside what is wanted, features make up for.
    in_order([this](int x, int y, std::size_t at) {
      if (label_[at] == 0) set(x, y, at, table_.at_most(plane_.wanted[at]));
    });
    in_order([this](int x, int y, std::size_t at) {
      if (label_[at] != 0) decide_feature(x, y, at);
    });
    for (std::size_t at = 0; at < label_.size(); ++at) {
      if (label_[at] == 0) continue;
      const double missing = plane_.needed[at] - light_[at];
      if (missing <= kRounding * std::max(1.0, plane_.needed[at])) continue;
      ++result_.short_pixels;
      result_.most_short = std::max(result_.most_short, missing);
    }
    return std::move(result_);
  }

 private:
  template <class Each>
  void in_order(const Each& each) const {
    const int width = plane_.width_px;
    for (int y = 0; y < plane_.height_px; ++y) {
      for (int i = 0; i < width; ++i) {
        const int x = y % 2 == 0 ? i : width - 1 - i;
        each(x, y,
             static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(x));
      }
    }
  }
  void set(int x, int y, std::size_t at, int level) {
    result_.levels[at] = static_cast<std::uint8_t>(level);
    decided_[at] = 1;
    const double more = table_.phi(level) - plane_.wanted[at];
    if (more == 0) return;
    spot_.around(plane_, x, y, [&](std::size_t k, double w) { light_[k] += w * more; });
  }
  void decide_feature(int x, int y, std::size_t at) {
    const double wanted = plane_.wanted[at];
    const double aimed = wanted - credit_[at];
    // Not so dark that this pixel, or one that is decided, has less than it needs.
    double least = wanted + (plane_.needed[at] - light_[at]) / spot_.own();
    spot_.around(plane_, x, y, [&](std::size_t k, double w) {
      if (k == at || label_[k] == 0 || !decided_[k]) return;
      least = std::max(least, wanted + std::min(0.0, plane_.needed[k] - light_[k]) / w);
    });
    const int level = table_.at_least(std::max(aimed, least));
    set(x, y, at, level);
    const double surplus = table_.phi(level) - aimed;
    if (surplus <= 0 || !result_.handed_on) return;
    double all = 0;
    const auto takes = [&](std::size_t k) { return label_[k] == label_[at] && !decided_[k]; };
    spot_.around(plane_, x, y, [&](std::size_t k, double w) { all += takes(k) ? w : 0.0; });
    if (!(all > 0)) return;
    spot_.around(plane_, x, y, [&](std::size_t k, double w) {
      if (takes(k)) credit_[k] += surplus * w / all;
    });
  }

  const LevelTable& table_;
  const PlaneOfLight& plane_;
  const Spot spot_;
  const std::vector<std::uint32_t> label_;  ///< the feature of each pixel
  std::vector<std::uint8_t> decided_;
  std::vector<double> credit_;  ///< light that was handed to pixels
  std::vector<double> light_;   ///< after it has spread, of pixels that are not decided as wanted
  PlaneOfLevels result_;
};

}  // namespace

bool is_wide(const LightBlur& blur) { return Spot(blur).wide(); }

PlaneOfLevels levels_of_plane(const LevelTable& levels, const PlaneOfLight& plane,
                              const LightBlur& blur) {
  return PlaneDecision(levels, plane, blur).decide(blur);
}

}  // namespace slicecorr::detail
