// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/coarse_slices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// Pixels of a direction and the cells, without the ring, that their middles lie in.
struct Axis {
  std::vector<int> cell_of_pixel;
  std::vector<int> pixels_of_cell;
};

Axis axis_of(int first, int past, double pixel_um, double start_um, double pitch_um, int cells) {
  Axis axis;
  axis.pixels_of_cell.assign(static_cast<std::size_t>(cells), 0);
  for (int p = first; p < past; ++p) {
    const double middle_um = (p + 0.5) * pixel_um - start_um;
    const int cell = std::clamp(static_cast<int>(std::floor(middle_um / pitch_um)), 0, cells - 1);
    axis.cell_of_pixel.push_back(cell);
    ++axis.pixels_of_cell[static_cast<std::size_t>(cell)];
  }
  return axis;
}

int cells_over(int pixels, double pixel_um, double pitch_um) {
  return std::max(1, static_cast<int>(std::ceil(pixels * pixel_um / pitch_um - 1e-9)));
}

/// The pixels of one band of cell rows.
struct BandPlan {
  PixelBox box;
  int first_row = 0, rows = 0;
};

std::vector<BandPlan> plan_bands(const PixelBox& box, const Axis& y, int most_pixel_rows) {
  std::vector<BandPlan> bands;
  int pixel = box.y0;
  for (std::size_t row = 0; row < y.pixels_of_cell.size(); ++row) {
    const int rows = y.pixels_of_cell[row];
    if (bands.empty() || bands.back().box.height() + rows > most_pixel_rows) {
      bands.push_back({{box.x0, pixel, box.x1, pixel}, static_cast<int>(row), 0});
    }
    pixel += rows;
    bands.back().box.y1 = pixel;
    ++bands.back().rows;
  }
  return bands;
}

/// Adds up the pixels of cells in one band, slice by slice.
class CellSums {
 public:
  CellSums(const BandPlan& plan, const Axis& x, const Axis& y, const PixelBox& box,
           FlowPixels pixels)
      : plan_(plan), x_(x), y_(y), box_(box), pixels_(pixels) {
    sums_.resize(x.pixels_of_cell.size() * static_cast<std::size_t>(plan.rows));
    coverage_.resize(sums_.size());
  }
  /// `alone`: what is shown beside the part; null: nothing.
  const std::uint8_t* coverage(const std::uint8_t* rows, const std::uint8_t* alone) {
    std::fill(sums_.begin(), sums_.end(), 0U);
    add(rows, alone);
    const std::size_t columns = x_.pixels_of_cell.size();
    for (std::size_t k = 0; k < sums_.size(); ++k) {
      const auto row = static_cast<std::size_t>(plan_.first_row) + k / columns;
      const auto pixels =
          static_cast<unsigned>(x_.pixels_of_cell[k % columns] * y_.pixels_of_cell[row]);
      coverage_[k] = pixels > 0 ? static_cast<std::uint8_t>((sums_[k] + pixels / 2) / pixels) : 0;
    }
    return coverage_.data();
  }

 private:
  void add(const std::uint8_t* rows, const std::uint8_t* alone) {
    const auto width = static_cast<std::size_t>(plan_.box.width());
    const std::size_t columns = x_.pixels_of_cell.size();
    for (int y = plan_.box.y0; y < plan_.box.y1; ++y) {
      const auto row = static_cast<std::size_t>(y - plan_.box.y0);
      const auto cell_row = y_.cell_of_pixel[static_cast<std::size_t>(y - box_.y0)];
      std::uint32_t* out = &sums_[static_cast<std::size_t>(cell_row - plan_.first_row) * columns];
      const std::uint8_t* in = rows ? rows + row * width : nullptr;
      const std::uint8_t* left = alone ? alone + row * width : nullptr;
      for (std::size_t p = 0; p < width; ++p) {
        unsigned value = in ? in[p] : 0;
        if (value > 0 && pixels_ == FlowPixels::light) value = 255;
        if (left && left[p]) value = 255;
        out[static_cast<std::size_t>(x_.cell_of_pixel[p])] += value;
      }
    }
  }

  const BandPlan& plan_;
  const Axis &x_, &y_;
  const PixelBox& box_;
  FlowPixels pixels_;
  std::vector<std::uint32_t> sums_;
  std::vector<std::uint8_t> coverage_;
};

CodedBand read_coarse(const SliceSource& source, const BandPlan& plan, const Axis& x, const Axis& y,
                      const PixelBox& box, FlowPixels pixels, const ExecutionContext& context) {
  const auto count =
      static_cast<std::size_t>(plan.box.width()) * static_cast<std::size_t>(plan.box.height());
  std::vector<std::uint8_t> before(count), alone_rows(count);
  CodedBand alone(count);
  if (const SliceSource* left = source.left_alone()) {
    left->read_band(plan.box, [&](int, const std::uint8_t* rows) { alone.append(rows); });
  }
  CellSums sums(plan, x, y, box, pixels);
  CodedBand coded(x.pixels_of_cell.size() * static_cast<std::size_t>(plan.rows));
  bool same_possible = false;
  source.read_band(plan.box, [&](int n, const std::uint8_t* rows) {
    if ((n & 63) == 0) context.check_cancelled();
    const std::uint8_t* left = nullptr;
    if (n < alone.slices() && !alone.black(n)) {
      alone.read(n, alone_rows.data());
      left = alone_rows.data();
    }
    if (!rows && !left) {
      coded.append(nullptr);
      same_possible = false;
      return;
    }
    if (rows && !left && same_possible && std::memcmp(rows, before.data(), count) == 0) {
      coded.append_again();
      return;
    }
    coded.append(sums.coverage(rows, left));
    same_possible = rows != nullptr && left == nullptr;
    if (same_possible) std::memcpy(before.data(), rows, count);
  });
  coded.trim();
  return coded;
}

}  // namespace

FlowGrid flow_grid(const SliceSource& source, const FlowPartOptions& options) {
  const Grid& g = source.grid();
  PixelBox box = source.bounds();
  if (source.left_alone()) box = box.united(source.left_alone()->bounds());
  if (box.empty()) throw InputError("no slice is lit; expected a part whose resin flows");
  const double wide_um = box.width() * g.pixel_x_um, high_um = box.height() * g.pixel_y_um;
  FlowGrid grid;
  grid.pitch_um = options.pitch_um;
  const double pixel_um = std::max(g.pixel_x_um, g.pixel_y_um);
  const double shorter_um = std::min(wide_um, high_um);
  if (!(grid.pitch_um > 0)) {
    const double wanted_um =
        std::min(options.most_pitch_um, std::max(options.gap_um, std::max(wide_um, high_um) / 64));
    // Whole pixels: all cells have as many.
    const double most = std::floor(shorter_um / 3 / pixel_um + 1e-9);
    grid.pitch_um =
        std::max(1.0, std::min(most, std::ceil(wanted_um / pixel_um - 1e-9))) * pixel_um;
  }
  if (grid.pitch_um < pixel_um * (1 - 1e-9)) {
    throw InputError(fmt::format("cells of {:g} um are smaller than pixels of {:g} um",
                                 grid.pitch_um, pixel_um));
  }
  if (grid.pitch_um > shorter_um / 3 * (1 + 1e-9)) {
    throw InputError(
        fmt::format("cells of {:g} um are too coarse for a part that is {:g} um wide; expected at "
                    "most a third of it",
                    grid.pitch_um, shorter_um));
  }
  grid.columns = cells_over(box.width(), g.pixel_x_um, grid.pitch_um) + 2;
  grid.rows = cells_over(box.height(), g.pixel_y_um, grid.pitch_um) + 2;
  grid.left_um = box.x0 * g.pixel_x_um - grid.pitch_um;
  grid.top_um = box.y0 * g.pixel_y_um - grid.pitch_um;
  grid.image_width_um = g.width_px * g.pixel_x_um;
  grid.image_height_um = g.height_px * g.pixel_y_um;
  return grid;
}

CoarseSlices::CoarseSlices(const SliceSource& source, const FlowGrid& grid, FlowPixels pixels,
                           const ExecutionContext& context)
    : grid_(grid) {
  const Grid& g = source.grid();
  PixelBox box = source.bounds();
  if (source.left_alone()) box = box.united(source.left_alone()->bounds());
  const Axis x = axis_of(box.x0, box.x1, g.pixel_x_um, grid.left_um + grid.pitch_um, grid.pitch_um,
                         grid.columns - 2);
  const Axis y = axis_of(box.y0, box.y1, g.pixel_y_um, grid.top_um + grid.pitch_um, grid.pitch_um,
                         grid.rows - 2);
  const std::vector<BandPlan> plans = plan_bands(box, y, band_rows(g));
  for (const BandPlan& plan : plans) bands_.push_back({plan.first_row, CodedBand(0)});
  parallel_for(context, "look at slices", plans.size(), [&](std::size_t i) {
    bands_[i].coded = read_coarse(source, plans[i], x, y, box, pixels, context);
  });
}

bool CoarseSlices::as_before(int slice) const {
  return slice > 0 && std::all_of(bands_.begin(), bands_.end(),
                                  [&](const Band& b) { return b.coded.same(slice, slice - 1); });
}

void CoarseSlices::read(int slice, std::vector<std::uint8_t>& coverage) const {
  coverage.assign(grid_.cells(), 0);
  const auto columns = static_cast<std::size_t>(grid_.columns), inner = columns - 2;
  std::vector<std::uint8_t> rows;
  for (const Band& band : bands_) {
    if (band.coded.black(slice)) continue;
    rows.resize(band.coded.columns());
    band.coded.read(slice, rows.data());
    for (std::size_t r = 0; r * inner < rows.size(); ++r) {
      const auto row = static_cast<std::size_t>(band.first_row) + r + 1;
      std::copy_n(rows.data() + r * inner, inner, coverage.data() + row * columns + 1);
    }
  }
}

}  // namespace slicecorr::detail
