// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/relief.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/row_kernels.hpp"

namespace slicecorr::detail {

namespace {
constexpr int kPictureSide = 512;
constexpr std::size_t kWord = kRowWord;
}  // namespace

LitColumns::LitColumns(std::size_t columns)
    : columns_(columns),
      lit_now_((columns + kWord - 1) / kWord, 0),
      lit_next_(lit_now_),
      last_lit_(columns, 0) {}

void LitColumns::end(std::size_t word, std::uint64_t bits) {
  for (; bits != 0; bits &= bits - 1) {
    last_lit_[word * kWord + static_cast<std::size_t>(std::countr_zero(bits))] = next_;
  }
}

void LitColumns::add(int slice, const std::uint8_t* rows) {
  if (next_ != slice || rows == nullptr) {
    // Columns that were lit before end here: this slice is black, or slices were left out.
    for (std::size_t w = 0; lit_ && w < lit_now_.size(); ++w) end(w, lit_now_[w]);
    if (lit_) std::fill(lit_now_.begin(), lit_now_.end(), 0);
    lit_ = false;
  }
  if (rows == nullptr) return;
  const std::size_t whole = columns_ / kWord;
  sum_ += find_lit(rows, whole, lit_next_.data());
  if (whole < lit_now_.size()) {
    std::uint8_t tail[kWord] = {};
    std::memcpy(tail, rows + whole * kWord, columns_ - whole * kWord);
    sum_ += find_lit(tail, 1, lit_next_.data() + whole);
  }
  std::uint64_t any = 0;
  for (std::size_t w = 0; w < lit_now_.size(); ++w) {
    any |= lit_next_[w];
    if (const std::uint64_t ended = lit_now_[w] & ~lit_next_[w]) end(w, ended);
  }
  lit_now_.swap(lit_next_);
  lit_ = any != 0;
  next_ = slice + 1;
}

const std::vector<std::int32_t>& LitColumns::finish() {
  for (std::size_t w = 0; lit_ && w < lit_now_.size(); ++w) end(w, lit_now_[w]);
  lit_ = false;
  return last_lit_;
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
    const int offset = band.x0 - bounds_.x0;
    for (int x = 0; x < band.width();) {
      const int cell = (offset + x) / step_;
      const int past = std::min((cell + 1) * step_ - offset, band.width());
      out[cell] = std::max(out[cell], *std::max_element(row + x, row + past));
      x = past;
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
