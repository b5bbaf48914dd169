#include "pipeline/relief.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::detail {

namespace {
constexpr int kPictureSide = 512;
}

Relief::Relief(const PixelBox& bounds, int layers)
    : bounds_(bounds),
      layers_(std::max(layers, 1)),
      step_(std::max(
          1, (std::max(bounds.width(), bounds.height()) + kPictureSide - 1) / kPictureSide)),
      width_(std::max(1, (bounds.width() + step_ - 1) / step_)),
      height_(std::max(1, (bounds.height() + step_ - 1) / step_)),
      depth_(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_)) {}

void Relief::add(const PixelBox& band, const std::vector<std::int32_t>& last_lit) {
  const std::lock_guard lock(mutex_);
  for (int y = std::max(band.y0, bounds_.y0); y < std::min(band.y1, bounds_.y1); ++y) {
    const auto* row = last_lit.data() + static_cast<std::ptrdiff_t>(y - band.y0) * band.width();
    auto* out = depth_.data() + static_cast<std::ptrdiff_t>((y - bounds_.y0) / step_) * width_;
    for (int x = 0; x < band.width(); ++x) {
      auto& cell = out[(band.x0 + x - bounds_.x0) / step_];
      cell = std::max(cell, row[x]);
    }
  }
}

bool Relief::empty() const {
  return std::all_of(depth_.begin(), depth_.end(), [](std::int32_t d) { return d == 0; });
}

GreyImage Relief::picture() const {
  GreyImage image{width_, height_, std::vector<std::uint8_t>(depth_.size())};
  const auto at = [&](int x, int y) {
    x = std::clamp(x, 0, width_ - 1);
    y = std::clamp(y, 0, height_ - 1);
    return depth_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                  static_cast<std::size_t>(x)];
  };
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      const std::int32_t d = at(x, y);
      if (d == 0) continue;
      // Nearer is brighter; a slope towards the upper left is lit.
      const double near = static_cast<double>(d) / layers_;
      const double slope = (at(x + 1, y) - at(x - 1, y) + at(x, y + 1) - at(x, y - 1)) * 1.0;
      const double light = slope / (std::abs(slope) + 8.0 * step_);
      const double grey = 70 + 120 * near + 60 * light;
      image.pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                   static_cast<std::size_t>(x)] =
          static_cast<std::uint8_t>(std::clamp(grey, 10.0, 255.0));
    }
  }
  return image;
}

}  // namespace slicecorr::detail
