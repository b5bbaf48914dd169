// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/first_slices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

class LightOfCells {
 public:
  LightOfCells(const Process& process, const Printer& printer, const Grid& images,
               const FlowGrid& cells)
      : process_(as_lamp_shines(process)),
        cells_(cells),
        images_(images),
        pixels_(*process_.even_light, images_),
        blue_mw_cm2_(as_lit(printer, process).calibration.back().intensity_mw_cm2),
        uv_mw_cm2_(printer.uv ? printer.uv->max_mw_cm2() : 0),
        blue_(cells.cells()) {}

  FlowLight at(int slice, std::size_t cell) {
    const std::size_t column = cell % static_cast<std::size_t>(cells_.columns);
    const std::size_t row = cell / static_cast<std::size_t>(cells_.columns);
    const int x = pixel(cells_.left_um, column, images_.pixel_x_um, images_.width_px);
    const int y = pixel(cells_.top_um, row, images_.pixel_y_um, images_.height_px);
    std::vector<std::uint8_t>& blue = blue_[cell];
    if (blue.empty()) {
      blue.resize(static_cast<std::size_t>(images_.layers));
      pixels_.blue_of(x, y, blue);
    }
    FlowLight light;
    const auto n = std::min(static_cast<std::size_t>(slice), blue.size() - 1);
    light.blue_mw_cm2 = blue_mw_cm2_ * blue[n] / 255;
    if (process_.even_light->uv) {
      double share = 0;
      pixels_.uv_of_row(slice, x, y, {&share, 1});
      light.uv_mw_cm2 = uv_mw_cm2_ * share / 255;
    } else {
      const std::vector<double>& schedule = process_.uv.slice_mw_cm2;
      light.uv_mw_cm2 =
          schedule.empty()
              ? process_.uv.uv_mw_cm2
              : schedule[std::min(static_cast<std::size_t>(slice), schedule.size() - 1)];
    }
    return light;
  }

 private:
  int pixel(double from_um, std::size_t cell, double pixel_um, int most) const {
    const double at_um = from_um + (static_cast<double>(cell) + 0.5) * cells_.pitch_um;
    return std::clamp(static_cast<int>(at_um / pixel_um), 0, most - 1);
  }

  const Process process_;
  FlowGrid cells_;
  Grid images_;
  EvenPixels pixels_;
  double blue_mw_cm2_, uv_mw_cm2_;
  std::vector<std::vector<std::uint8_t>> blue_;  ///< of cells, slices; empty: not looked up yet
};

}  // namespace

LightInTime even_light_in_time(const Process& process, const Printer& printer, const Grid& images,
                               const FlowGrid& cells) {
  const auto light = std::make_shared<LightOfCells>(process, printer, images, cells);
  return [light](int slice, std::size_t cell) { return light->at(slice, cell); };
}

FirstSlices follow_first_slices(const SliceSource& part, FlowPixels pixels, const Setup& setup,
                                const ExecutionContext& context) {
  constexpr int kAcross = 30, kSlices = 40;
  FlowPull pull;
  pull.resin = flow_resin(setup.resin);
  pull.viscosity_pa_s = setup.resin.viscosity_pa_s;
  pull.speed_mm_h = setup.process.speed_mm_h;
  ExecutionContext untold = context;
  untold.notice = nullptr;
  const PixelBox box = part.bounds();
  const Grid& grid = part.grid();
  const double pixel_um = std::max(grid.pixel_x_um, grid.pixel_y_um);
  const double side_um = std::max(box.width() * grid.pixel_x_um, box.height() * grid.pixel_y_um);
  FirstSlices first;
  first.pitch_um = std::max(pixel_um, side_um / kAcross);
  try {
    const FlowPart cells(part, {.pitch_um = first.pitch_um, .pixels = pixels}, untold);
    if (cells.masks() == 0) {
      first.why_not = "no cell is lit by half";
      return first;
    }
    InTime how;
    how.layer_um = cells.layer_um();
    how.heights = LayerHeights(setup.process.layer_heights_um);
    how.slices = std::min(cells.slices(), kSlices);
    // Half as many levels take a quarter of the time, and tell the same slice.
    how.level_um = 10;
    first.sticks =
        follow_part(cells, pull, how,
                    even_light_in_time(setup.process, setup.printer, grid, cells.grid()), untold)
            .sticks;
    first.slices = how.slices;
  } catch (const InputError& e) {
    first.why_not = e.what();
  }
  return first;
}

std::string FirstSlices::in_words() const {
  if (slices == 0) {
    return fmt::format("whether the first slices print was not found: {}", why_not);
  }
  if (!sticks) {
    return fmt::format(
        "the first {} slices print before the flow is steady (on cells of {:.0f} um)", slices,
        pitch_um);
  }
  return fmt::format(
      "before the flow is steady the print sticks to the window in slice {}, after {:.2g} s, at x "
      "{:.2f}, y {:.2f} mm (on cells of {:.0f} um)",
      sticks->slice, sticks->seconds, sticks->x_mm, sticks->y_mm, pitch_um);
}

}  // namespace slicecorr
