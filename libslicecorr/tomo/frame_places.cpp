#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "slicecorr/light_map.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo {

FramePlaces::FramePlaces(const Printer& printer, const Sampling& sampling, int first_column,
                         int columns, bool clockwise)
    : column_mm_(printer.pixel_x_um * 1e-3),
      row_um_(printer.pixel_y_um),
      lowest_mm_(-0.5 * sampling.voxel_mm * (sampling.slices - 1)),
      voxel_mm_(sampling.voxel_mm),
      slices_(sampling.slices) {
  const Optics& optics = *printer.optics;
  if (optics.tilt_deg != 0) {
    sine_ = std::sin(optics.tilt_deg * std::numbers::pi / 180);
    cosine_ = std::cos(optics.tilt_deg * std::numbers::pi / 180);
  }
  axis_column_ = (printer.width_px - 1) / 2.0 + optics.axis_right_px - first_column;
  middle_row_ = (printer.height_px - 1) / 2.0;
  axis_up_px_ = optics.axis_up_px;
  if (!printer.rotation->wobble.empty()) {
    for (int m = 0; m < sampling.angles; ++m) {
      // The stage turns forwards from frame to frame, whichever way that is.
      const int frame = clockwise || m == 0 ? m : sampling.angles - m;
      const AxisWobble at = wobble_at(*printer.rotation, 360.0 * frame / sampling.angles);
      right_px_.push_back(at.right_px);
      up_rows_.push_back(static_cast<int>(std::lround(at.up_px)));
    }
  }
  if (printer.flat_field) take_light(printer, first_column, columns, sampling.angles);
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

int FramePlaces::slice_of(int m, int column, int row) const {
  const int up = up_rows_.empty() ? 0 : up_rows_[static_cast<std::size_t>(m)];
  double z = (middle_row_ - (row + up) - axis_up_px_) * row_um_ * 1e-3;
  if (sine_ != 0) z = z * cosine_ + (column - axis_column_ - right_px(m)) * column_mm_ * sine_;
  const double slice = std::floor((z - lowest_mm_) / voxel_mm_ + 0.5);
  return slice >= 0 && slice < slices_ ? static_cast<int>(slice) : -1;
}

int FramePlaces::slice_shown(int m, int at, int slice) const {
  if (up_rows_.empty()) return slice;
  const int rows = up_rows_[static_cast<std::size_t>(at)] - up_rows_[static_cast<std::size_t>(m)];
  if (rows == 0) return slice;
  const auto shown =
      static_cast<int>(std::lround(slice + rows * row_um_ * 1e-3 * cosine_ / voxel_mm_));
  return shown >= 0 && shown < slices_ ? shown : -1;
}

void FramePlaces::take_light(const Printer& printer, int first_column, int columns, int angles) {
  Grid images;
  images.width_px = printer.width_px;
  images.height_px = printer.height_px;
  ImageFrame shown;
  shown.to_display = Turn{};
  shown.orientation.reset();
  const LightMap map(printer, images, shown);
  if (map.even()) return;
  // Sideways, wobble moves the rows of a leaning axis by much less than one.
  std::map<int, std::size_t> known;
  for (int m = 0; m < angles; ++m) {
    const int up = up_rows_.empty() ? 0 : up_rows_[static_cast<std::size_t>(m)];
    const auto [at, is_new] = known.try_emplace(up, share_.size());
    share_of_angle_.push_back(at->second);
    if (!is_new) continue;
    for (int c = 0; c < columns; ++c) {
      std::vector<double> sum(static_cast<std::size_t>(slices_)), rows(sum.size());
      for (int row = 0; row < printer.height_px; ++row) {
        const int s = slice_of(m, c, row);
        if (s < 0) continue;
        sum[static_cast<std::size_t>(s)] += map.factor(map.value(first_column + c, row));
        ++rows[static_cast<std::size_t>(s)];
      }
      for (std::size_t s = 0; s < sum.size(); ++s) {
        share_.push_back(static_cast<float>(rows[s] > 0 ? sum[s] / rows[s] : 0));
      }
    }
  }
}

}  // namespace slicecorr::tomo
