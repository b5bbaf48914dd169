// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "slicecorr/light_map.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo {

FramePlaces::FramePlaces(const Printer& printer, const TomoGrid& grid, const PixelWindow& window,
                         bool clockwise)
    : coupled_(grid.coupled()),
      window_(window),
      column_mm_(printer.pixel_x_um * 1e-3),
      row_um_(printer.pixel_y_um),
      lowest_mm_(grid.lowest_mm),
      slice_mm_(grid.slice_height_mm()),
      rows_(grid.light_rows()) {
  const Optics& optics = *printer.optics;
  if (optics.tilt_deg != 0) {
    sine_ = std::sin(optics.tilt_deg * std::numbers::pi / 180);
    cosine_ = std::cos(optics.tilt_deg * std::numbers::pi / 180);
  }
  axis_column_ = (printer.width_px - 1) / 2.0 + optics.axis_right_px - window.first_column;
  middle_row_ = (printer.height_px - 1) / 2.0;
  axis_up_px_ = optics.axis_up_px;
  const double row_mm = row_um_ * 1e-3, rows = slice_mm_ / row_mm;
  if (!coupled_ && sine_ == 0 && std::abs(rows - std::round(rows)) < 1e-6) {
    // Rows of the image's edges and of the lowest slice's lower edge, counted upwards.
    const double edge = (lowest_mm_ - 0.5 * slice_mm_) / row_mm + middle_row_ + axis_up_px_ + 0.5;
    lowest_mm_ -= (edge - std::floor(edge + 0.5 - 1e-6)) * row_mm;
  }
  if (!printer.rotation->wobble.empty()) {
    for (int m = 0; m < grid.angles; ++m) {
      // The stage turns forwards from frame to frame, whichever way that is.
      const int frame = clockwise || m == 0 ? m : grid.angles - m;
      const AxisWobble at = wobble_at(*printer.rotation, 360.0 * frame / grid.angles);
      right_px_.push_back(at.right_px);
      up_px_.push_back(at.up_px);
    }
  }
  // Rows beside the image show nothing.
  if (printer.flat_field || (coupled_ && window.first_row < 0)) take_light(printer, grid.angles);
}

double FramePlaces::column_of(int m, double pixel, int slice) const {
  if (sine_ == 0) return pixel + right_px(m);
  return axis_column_ + (pixel - axis_column_) * cosine_ + z_mm(slice) / column_mm_ * sine_ +
         right_px(m);
}

double FramePlaces::pixel_of(int m, double column, int slice) const {
  if (sine_ == 0) return column - right_px(m);
  return axis_column_ +
         (column - right_px(m) - axis_column_ - z_mm(slice) / column_mm_ * sine_) / cosine_;
}

int FramePlaces::slice_of(int m, int pixel, int row) const {
  const double up = std::round(up_px(m));
  double z = (middle_row_ - (row + up) - axis_up_px_) * row_um_ * 1e-3;
  if (sine_ != 0) z = z * cosine_ + (pixel - axis_column_ - right_px(m)) * column_mm_ * sine_;
  const double slice = std::floor((z - lowest_mm_) / slice_mm_ + 0.5);
  return slice >= 0 && slice < rows_ ? static_cast<int>(slice) : -1;
}

int FramePlaces::slice_shown(int m, int at, int slice) const {
  const double rows = std::round(up_px(at)) - std::round(up_px(m));
  if (rows == 0) return slice;
  const auto shown =
      static_cast<int>(std::lround(slice + rows * row_um_ * 1e-3 * cosine_ / slice_mm_));
  return shown >= 0 && shown < rows_ ? shown : -1;
}

FramePlaces::Lit FramePlaces::lit_by(int m, int column, int row) const {
  Lit lit;
  if (!coupled_) {
    const int pixel = column - window_.first_column;
    if (pixel < 0 || pixel >= window_.columns) return lit;
    lit.pixel = pixel;
    lit.row = slice_of(m, pixel, row);
    return lit;
  }
  const int right = column - static_cast<int>(std::lround(right_px(m))) - window_.first_column;
  const int down = row + static_cast<int>(std::lround(up_px(m))) - window_.first_row;
  if (right < 0 || down < 0 || right >= window_.columns || down >= window_.rows) return lit;
  lit.pixel = right;
  lit.row = window_.rows - 1 - down;
  return lit;
}

FramePlaces::Place FramePlaces::place_of(int m, double column, double row) const {
  return {column - std::round(right_px(m)) - window_.first_column,
          window_.rows - 1 - (row + std::round(up_px(m)) - window_.first_row)};
}

void FramePlaces::take_light(const Printer& printer, int angles) {
  Grid images;
  images.width_px = printer.width_px;
  images.height_px = printer.height_px;
  ImageFrame shown;
  shown.to_display = Turn{};
  shown.orientation.reset();
  const LightMap map(printer, images, shown);
  if (map.even() && window_.first_row >= 0) return;
  // Sideways, wobble moves the rows of a leaning axis by much less than one.
  std::map<std::pair<long, long>, std::size_t> known;
  const std::size_t of_shift =
      static_cast<std::size_t>(window_.columns) * static_cast<std::size_t>(rows_);
  for (int m = 0; m < angles; ++m) {
    const std::pair<long, long> shift{coupled_ ? std::lround(right_px(m)) : 0,
                                      std::lround(up_px(m))};
    const auto [at, is_new] = known.try_emplace(shift, share_.size());
    share_of_angle_.push_back(at->second);
    if (!is_new) continue;
    std::vector<double> sum(of_shift), pixels(of_shift);
    for (int column = 0; column < printer.width_px; ++column) {
      for (int row = 0; row < printer.height_px; ++row) {
        const Lit lit = lit_by(m, column, row);
        if (!lit.any()) continue;
        const std::size_t i =
            static_cast<std::size_t>(lit.pixel) * static_cast<std::size_t>(rows_) +
            static_cast<std::size_t>(lit.row);
        sum[i] += map.even() ? 1 : map.factor(map.value(column, row));
        ++pixels[i];
      }
    }
    for (std::size_t i = 0; i < of_shift; ++i) {
      share_.push_back(static_cast<float>(pixels[i] > 0 ? sum[i] / pixels[i] : 0));
    }
  }
}

}  // namespace slicecorr::tomo
