// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/rows_of_slices.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "slicecorr/vial.hpp"

namespace slicecorr::tomo::detail {

namespace {

struct RowOfSlice {
  std::size_t slice = 0;
  int shown = -1;  ///< whose light, or black
  double share = 0;
};

std::vector<RowOfSlice> rows_of_slices(const Judged& judged) {
  const Bench& bench = judged.bench;
  const Printer& printer = judged.job.printer;
  const TomoGrid& g = bench.grid;
  std::vector<RowOfSlice> all;
  const auto slices = static_cast<std::size_t>(g.slices);
  if (bench.places.moved() || bench.places.uneven()) {
    for (std::size_t z = 0; z < slices; ++z) all.push_back({z, static_cast<int>(z), 1});
    return all;
  }
  // A point has the row that it lies in, or both where it lies between two.
  constexpr double kPoint = 1e-6;
  const double slice_mm = g.slice_height_mm(), pitch = printer.pixel_y_um * 1e-3,
               lit_share = bench.rays.lit;
  const double height = std::max(judged.height_mm(), kPoint * pitch),
               half_lit = lit_share * pitch / 2;
  for (std::size_t z = 0; z < slices; ++z) {
    const double middle = bench.places.lowest_mm() + slice_mm * static_cast<double>(z),
                 low = middle - height / 2, high = middle + height / 2;
    double lit = 0;
    for (int r = 0; r < printer.height_px; ++r) {
      const double at = pixel_z_mm(printer, r);
      const double meets =
          (std::min(high, at + half_lit) - std::max(low, at - half_lit)) / lit_share;
      if (!(meets > 1e-9 * height)) continue;
      const int shown = bench.places.lit_by(0, bench.window.first_column, r).row;
      lit += meets / height;
      if (!all.empty() && all.back().slice == z && all.back().shown == shown) {
        all.back().share += meets / height;
      } else {
        all.push_back({z, shown, meets / height});
      }
    }
    // The darkness beside the image is not even black light.
    if (lit > 0 && std::abs(lit - 1) < 1e-6 && all.back().slice == z && all.back().share == lit) {
      all.back().share = 1;
    }
  }
  return all;
}

}  // namespace

std::vector<double> light_of_slices(const Judged& judged, bool uneven) {
  const Bench& bench = judged.bench;
  const TomoGrid& g = bench.grid;
  const auto slices = static_cast<std::size_t>(g.slices);
  std::vector<double> light(static_cast<std::size_t>(g.angles) *
                            static_cast<std::size_t>(g.pixels) * slices);
  const std::vector<RowOfSlice> rows = rows_of_slices(judged);
  double* to = light.data();
  for (int m = 0; m < g.angles; ++m) {
    for (int i = 0; i < g.pixels; ++i, to += slices) {
      for (const RowOfSlice& r : rows) {
        const double lit =
            bench.mw_cm2[r.shown < 0 ? 0 : judged.job.levels[g.pixel(m, i, r.shown)]];
        to[r.slice] += r.share * lit;
      }
      if (!uneven || !bench.places.uneven()) continue;
      for (std::size_t z = 0; z < slices; ++z) {
        to[z] *= bench.places.share(m, i, static_cast<int>(z));
      }
    }
  }
  return light;
}

}  // namespace slicecorr::tomo::detail
