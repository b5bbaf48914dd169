// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Splitting a box of pixels into bands, and putting the figures of bands together.
#pragma once

#include <memory>
#include <vector>

#include "base/coded_band.hpp"
#include "cure/shown_slices.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// The bands that cover `box`, from the top row down, aligned to band_rows(grid).
inline std::vector<PixelBox> bands_of(const Grid& grid, const PixelBox& box) {
  std::vector<PixelBox> bands;
  if (box.empty()) return bands;
  const int rows = band_rows(grid);
  for (int y = box.y0 / rows * rows; y < box.y1; y += rows) {
    bands.push_back({box.x0, y, box.x1, std::min(y + rows, grid.height_px)});
  }
  return bands;
}

/// Gives the pixel of each column of a band.
inline BandPredictor::PixelOfColumn pixels_of_columns(const PixelBox& band) {
  const auto width = static_cast<std::size_t>(band.width());
  return [band, width](std::size_t column) {
    return Pixel{band.x0 + static_cast<int>(column % width),
                 band.y0 + static_cast<int>(column / width)};
  };
}

/// Columns in which nothing but black is shown; `recorded` null: one image per slice.
inline Prediction black_columns(const CureModel& model, int slices, std::uint64_t columns,
                                const ShownSlices* recorded) {
  if (!recorded) return predict_black_columns(model, slices, columns);
  return predict_black_columns(
      model, slices, columns,
      [black = std::make_shared<BlackColumn>(*recorded)](int n) { return (*black)(n); });
}

/// What all bands print together with the columns outside them, when `slices` slices are shown.
inline Prediction whole_image(const Prediction& in_bands, const CureModel& model, const Grid& grid,
                              int slices, const std::vector<PixelBox>& bands,
                              const ShownSlices* recorded = nullptr) {
  std::uint64_t outside =
      static_cast<std::uint64_t>(grid.width_px) * static_cast<std::uint64_t>(grid.height_px);
  for (const PixelBox& band : bands) outside -= columns_of(band);
  Prediction sum = black_columns(model, slices, outside, recorded);
  sum.layers = slices;
  sum.layerwise = layerwise_figures(model);
  sum.layer_um = grid.layer_um;
  sum.heights = model.heights;
  sum.pixel_x_um = grid.pixel_x_um;
  sum.pixel_y_um = grid.pixel_y_um;
  sum.merge(in_bands);
  return sum;
}

/// Puts the band's edge heights where `edges` is not null.
inline void put_edge_heights(const SliceSource* edges, const PixelBox& band,
                             StackWriter::BandEncoder& encoder, const ExecutionContext& context) {
  if (edges == nullptr) return;
  edges->read_band(band, [&](int n, const std::uint8_t* rows) {
    if ((n & 63) == 0) context.check_cancelled();
    encoder.put_edge_heights(n, band.x0, band.x1, rows);
  });
}

/// Sets orientation and frame of a stack to those of the slices that it is made from.
inline void set_frame(StackInfo& info, const SliceSource& slices) {
  const ImageFrame frame = slices.frame();
  info.for_display = frame.to_display.has_value();
  info.orientation_known = frame.orientation.has_value();
  info.orientation = frame.orientation.value_or(Orientation{});
  info.made_for = frame.made_for;
}

}  // namespace slicecorr::detail
