// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/cell_lines.hpp"

#include <algorithm>
#include <utility>

#include "base/kernels.hpp"

namespace slicecorr::tomo::detail {

namespace {

SLICECORR_CLONES
void add_weighed(float share, const float* weight, const float* from, std::size_t pixels,
                 std::size_t lanes, float* to) {
  if (lanes == 1) {
    for (std::size_t i = 0; i < pixels; ++i) to[i] += share * weight[i] * from[i];
    return;
  }
  for (std::size_t i = 0; i < pixels; ++i) {
    const float w = share * weight[i];
    for (std::size_t l = i * lanes; l < (i + 1) * lanes; ++l) to[l] += w * from[l];
  }
}

}  // namespace

CellLines::CellLines(const TomoGrid& grid, const Directions& directions, std::vector<float> weight)
    : pixels_(grid.pixels),
      angles_(grid.angles),
      cells_(directions.cells),
      weight_(std::move(weight)),
      of_cell_{0, 1.0F / static_cast<float>(cells_)} {}

CellLines::CellLines(const TomoGrid& grid, const RayTables& optics, const Directions& directions,
                     std::vector<float> weight)
    : pixels_(grid.pixels),
      angles_(grid.angles),
      cells_(directions.cells),
      weight_(std::move(weight)) {
  const int n = pixels_;
  shares_.resize(static_cast<std::size_t>(n) * static_cast<std::size_t>(cells_));
  const auto lit = [&](int i) {
    return i >= 0 && i < n && weight_[static_cast<std::size_t>(i)] > 0;
  };
  const auto turn_of = [&](int i) { return optics.turn_rad[static_cast<std::size_t>(i)]; };
  for (int i = 0; i < n; ++i) {
    if (!lit(i)) continue;
    const int a = lit(i - 1) ? i - 1 : i, b = lit(i + 1) ? i + 1 : i;
    const double across = b > a ? (turn_of(b) - turn_of(a)) / (b - a) : 0;
    for (int cell = 0; cell < cells_; ++cell) {
      std::vector<FrameShare>& shares =
          shares_[static_cast<std::size_t>(i) * static_cast<std::size_t>(cells_) +
                  static_cast<std::size_t>(cell)];
      directions.shares(cell, turn_of(i), across, shares);
      for (FrameShare& s : shares) s.share /= static_cast<float>(cells_);
    }
  }
}

std::size_t CellLines::place(int k, int shift, int pixel) const {
  int m = (k / cells_ + shift) % angles_;
  if (m < 0) m += angles_;
  return static_cast<std::size_t>(m) * static_cast<std::size_t>(pixels_) +
         static_cast<std::size_t>(pixel);
}

void CellLines::of_cell(int k, std::size_t lanes, const float* light, float* to) const {
  const auto pixels = static_cast<std::size_t>(pixels_);
  std::fill_n(to, pixels * lanes, 0.0F);
  if (alike()) {
    add_weighed(of_cell_.share, weight_.data(), light + place(k, 0, 0) * lanes, pixels, lanes, to);
    return;
  }
  for (int i = 0; i < pixels_; ++i, to += lanes) {
    for (const FrameShare& s : shares_of(i, k)) {
      const float* const from = light + place(k, s.shift, i) * lanes;
      const float w = s.share * weight_[static_cast<std::size_t>(i)];
      for (std::size_t l = 0; l < lanes; ++l) to[l] += w * from[l];
    }
  }
}

void CellLines::back_frame(int frame, std::size_t lanes, const float* lines, float* light) const {
  const std::size_t pixels = static_cast<std::size_t>(pixels_), size = pixels * lanes;
  float* const to = light + static_cast<std::size_t>(frame) * size;
  std::fill_n(to, size, 0.0F);
  for (int cell = 0; cell < cells_; ++cell) {
    const std::size_t k = static_cast<std::size_t>(frame) * static_cast<std::size_t>(cells_) +
                          static_cast<std::size_t>(cell);
    add_weighed(of_cell_.share, weight_.data(), lines + k * size, pixels, lanes, to);
  }
}

void CellLines::back(int k, int pixel, std::size_t lanes, const float* lines, float* light) const {
  const float* const from = lines + static_cast<std::size_t>(pixel) * lanes;
  const auto add = [&](const FrameShare& s) {
    float* const to = light + place(k, s.shift, pixel) * lanes;
    const float w = s.share * weight_[static_cast<std::size_t>(pixel)];
    for (std::size_t l = 0; l < lanes; ++l) to[l] += w * from[l];
  };
  if (alike()) {
    add(of_cell_);
  } else {
    for (const FrameShare& s : shares_of(pixel, k)) add(s);
  }
}

}  // namespace slicecorr::tomo::detail
