// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/hologram.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/tomo/beams_job.hpp"
#include "slicecorr/tomo/metrics.hpp"

namespace slicecorr::tomo {
namespace {

/// Of a pixel, by which its middle counts as further left and up: where it lies on the edge of a cell
/// the one before has it, whatever was rounded.
constexpr double kNudge = 1e-6;
constexpr int kHologramSteps = 50;

/// Whether columns of a beam's image run to the right, as seen from its display.
bool columns_run_right(const BeamWay& way) {
  // Right is the way of the light times up, which is z, of beams along z y.
  const bool right = way.axis == 1 ? !way.from_plus : way.from_plus;
  return right != way.mirror;
}

/// Pixels of a display and cells of an image: which of the one lies over which of the other.
class Place {
 public:
  Place(const BeamImage& image, const BeamWay& way, double cell_mm, const Printer& printer)
      : image_(image),
        way_(way),
        px_(printer.pixel_x_um * 1e-3 / cell_mm),
        py_(printer.pixel_y_um * 1e-3 / cell_mm),
        right_(columns_run_right(way)) {}

  /// Pixels that show the image: columns [first, end), rows alike.
  int first_column() const { return pixel(way_.column_px - 0.5 * image_.columns / px_); }
  int end_column() const { return pixel(way_.column_px + 0.5 * image_.columns / px_); }
  int first_row() const { return pixel(way_.row_px - 0.5 * image_.rows / py_); }
  int end_row() const { return pixel(way_.row_px + 0.5 * image_.rows / py_); }

  /// The cell under the middle of a pixel.
  std::size_t cell(int column, int row) const {
    const double across = (column + 0.5 - kNudge - way_.column_px) * px_;
    const double up = (way_.row_px - row - 0.5 + kNudge) * py_;
    const int c = clamp((right_ ? across : -across) + 0.5 * image_.columns, image_.columns);
    const int r = clamp(up + 0.5 * image_.rows, image_.rows);
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(image_.columns) +
           static_cast<std::size_t>(c);
  }
  int column_of_cell(int c) const {
    const double across = c + 0.5 - 0.5 * image_.columns;
    return pixel_at((right_ ? across : -across) / px_ + way_.column_px);
  }
  int row_of_cell(int r) const {
    return pixel_at(way_.row_px - (r + 0.5 - 0.5 * image_.rows) / py_);
  }

 private:
  static int clamp(double at, int cells) {
    return std::clamp(static_cast<int>(std::floor(at)), 0, cells - 1);
  }
  static int pixel_at(double place) { return static_cast<int>(std::floor(place + 0.5 * kNudge)); }
  /// The first whose middle lies behind an edge.
  static int pixel(double edge) { return static_cast<int>(std::ceil(edge - 0.5 + kNudge)); }

  const BeamImage& image_;
  const BeamWay& way_;
  double px_, py_;  ///< pixels, in cells
  bool right_;
};

GreyImage black_image(const Printer& printer) {
  GreyImage image{printer.width_px, printer.height_px, {}};
  image.pixels.assign(
      static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px), 0);
  return image;
}

/// Share of the calibration's light that each pixel gets.
class Evenness {
 public:
  explicit Evenness(const Printer& printer) {
    Grid images;
    images.width_px = printer.width_px;
    images.height_px = printer.height_px;
    ImageFrame shown;
    shown.to_display = Turn{};
    shown.orientation.reset();
    map_ = LightMap(printer, images, shown);
  }
  double at(int column, int row) const {
    return map_.even() ? 1 : map_.factor(map_.value(column, row));
  }

 private:
  LightMap map_;
};

/// The part of an image that is lit, in rows and columns of cells: all of it where it is dark.
struct Lit {
  int r0, r1, c0, c1;
};
Lit lit_part(const BeamImage& image) {
  Lit lit{image.rows, 0, image.columns, 0};
  for (int r = 0; r < image.rows; ++r) {
    for (int c = 0; c < image.columns; ++c) {
      if (!(image.at(r, c) > 0)) continue;
      lit = {std::min(lit.r0, r), std::max(lit.r1, r + 1), std::min(lit.c0, c),
             std::max(lit.c1, c + 1)};
    }
  }
  return lit;
}

void show(const BeamImage& wanted, const BeamWay& way, const BeamSetup& setup,
          const Printer& printer, const std::vector<double>& mw_cm2, double brightest,
          const Evenness& evenness, GreyImage& display, std::vector<std::uint8_t>& taken,
          BeamImage& shown) {
  const Place place(wanted, way, setup.cell_mm, printer);
  const Lit lit = lit_part(wanted);
  const int levels = printer.levels();
  const auto inside = [&](int column, int row) {
    return column >= 0 && column < display.width_px && row >= 0 && row < display.height_px;
  };
  for (const auto& [r, c] : {std::pair{lit.r0, lit.c0}, {lit.r1 - 1, lit.c1 - 1}}) {
    if (lit.r1 <= lit.r0 || inside(place.column_of_cell(c), place.row_of_cell(r))) continue;
    throw InputError(fmt::format(
        "the image of the beam from {} is {:.4g} x {:.4g} mm large and lies beyond the edge of "
        "display {} ({:.4g} x {:.4g} mm); expected a smaller part, or another middle_px",
        side_of(way), (lit.c1 - lit.c0) * setup.cell_mm, (lit.r1 - lit.r0) * setup.cell_mm,
        way.display, printer.width_px * printer.pixel_x_um * 1e-3,
        printer.height_px * printer.pixel_y_um * 1e-3));
  }
  const int c0 = std::max(0, place.first_column()),
            c1 = std::min(display.width_px, place.end_column());
  const int r0 = std::max(0, place.first_row()), r1 = std::min(display.height_px, place.end_row());
  for (int row = r0; row < r1; ++row) {
    for (int column = c0; column < c1; ++column) {
      const float share = wanted.share[place.cell(column, row)];
      if (!(share > 0)) continue;
      const std::size_t at =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(display.width_px) +
          static_cast<std::size_t>(column);
      if (taken[at] != 0) {
        throw InputError(fmt::format(
            "the image of the beam from {} lies over that of another on display {}; expected a "
            "smaller part, or another middle_px",
            side_of(way), way.display));
      }
      taken[at] = 1;
      const double even = evenness.at(column, row);
      if (share * brightest > mw_cm2.back() * even * (1 + 1e-9)) {
        throw InputError(fmt::format(
            "{:.4g} mW/cm² is wanted at pixel {}, {} of display {}, which gives {:.4g} at most; "
            "expected a lower intensity",
            share * brightest, column, row, way.display, mw_cm2.back() * even));
      }
      const int level = nearest_level(share * brightest / even, mw_cm2);
      display.pixels[at] = static_cast<std::uint8_t>(pixel_of_level(level, levels));
    }
  }
  // What is beside the display gets nothing.
  for (int r = 0; r < wanted.rows; ++r) {
    for (int c = 0; c < wanted.columns; ++c) {
      float& share =
          shown.share[static_cast<std::size_t>(r) * static_cast<std::size_t>(wanted.columns) +
                      static_cast<std::size_t>(c)];
      const int column = place.column_of_cell(c), row = place.row_of_cell(r);
      share = 0;
      if (!inside(column, row)) continue;
      const std::size_t at =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(display.width_px) +
          static_cast<std::size_t>(column);
      // Pixels of another beam on the same display go another way.
      const bool own = wanted.share[place.cell(column, row)] > 0;
      const int level = own ? level_of_pixel(display.pixels[at], levels) : 0;
      share = static_cast<float>(mw_cm2[static_cast<std::size_t>(level)] *
                                 evenness.at(column, row) / brightest);
    }
  }
}

void make_phase(const BeamImage& wanted, const BeamWay& way, std::uint32_t seed,
                const BeamSetup& setup, const PhaseVat& vat, const Printer& printer,
                double brightest, GreyImage& display, ShownBeams& shown,
                const ExecutionContext& context) {
  PhaseDisplay made;
  made.width_px = printer.width_px;
  made.height_px = printer.height_px;
  made.pitch_um = vat.pitch_um;
  made.levels = vat.levels;
  made.stroke_turns = vat.stroke_turns;
  made.fill = vat.fill;
  HologramOptics optics;
  optics.wavelength_nm = printer.wavelength_nm;
  optics.focal_mm = vat.focal_mm;
  double sum = 0;
  for (const float share : wanted.share) sum += share;
  if (!(sum > 0)) {
    shown.efficiency.push_back(0);
    shown.rms_error.push_back(0);
    shown.laser_mw.push_back(0);
    return;
  }
  HologramPlane plane = plane_of_picture(seen_image(wanted, way), "beam from " + side_of(way), made,
                                         optics, setup.cell_mm * 1e3);
  plane.dx_mm = vat.dx_mm;
  plane.dy_mm = vat.dy_mm;
  HologramOptions options;
  options.steps = kHologramSteps;
  options.seed = seed;
  const auto images = make_holograms(made, optics, {plane}, options, context);
  display = grey_of_phase(made, images.front().phase_rad);
  const ImageFigures f = figures_of(made, optics, plane, {phase_of_grey(made, display)}, context);
  shown.efficiency.push_back(f.efficiency);
  shown.rms_error.push_back(f.rms_error_padded);
  const double cell_cm = setup.cell_mm * 0.1;
  shown.laser_mw.push_back(sum * brightest * cell_cm * cell_cm / f.efficiency);
}

}  // namespace

const BeamWay& way_of(const BeamVat& vat, const Beam& beam) {
  for (const BeamWay& way : vat.ways) {
    if (way.axis == beam.axis && way.from_plus == beam.from_end) return way;
  }
  throw InputError(fmt::format(
      "the printer's vat has no beam from {} ([beams] from); expected fewer beams", side_of(beam)));
}

GreyImage seen_image(const BeamImage& image, const BeamWay& way) {
  GreyImage seen{image.columns, image.rows, {}};
  const bool right = columns_run_right(way);
  for (int row = 0; row < image.rows; ++row) {
    for (int column = 0; column < image.columns; ++column) {
      const float share =
          image.at(image.rows - 1 - row, right ? column : image.columns - 1 - column);
      seen.pixels.push_back(
          static_cast<std::uint8_t>(std::lround(255 * std::clamp(share, 0.0F, 1.0F))));
    }
  }
  return seen;
}

ShownBeams shown_beams(const std::vector<BeamImage>& images, const BeamSetup& setup,
                       const BeamVat& vat, const Printer& printer, double brightest,
                       const ExecutionContext& context) {
  ShownBeams shown;
  const auto displays = static_cast<std::size_t>(vat.displays());
  shown.displays.assign(displays, black_image(printer));
  shown.images = images;
  if (vat.phase) {
    std::vector<int> used(displays, 0);
    for (std::size_t k = 0; k < images.size(); ++k) {
      const BeamWay& way = way_of(vat, images[k].beam);
      const auto at = static_cast<std::size_t>(way.display) - 1;
      if (++used[at] > 1) {
        throw InputError(
            fmt::format("display {} has two beams; expected one for each display that delays light",
                        way.display));
      }
      make_phase(images[k], way, static_cast<std::uint32_t>(k + 1), setup, *vat.phase, printer,
                 brightest, shown.displays[at], shown, context);
    }
    return shown;
  }
  const std::vector<double> mw_cm2 = level_intensities(printer);
  if (!(brightest > 0) || brightest > mw_cm2.back() * (1 + 1e-9)) {
    throw InputError(fmt::format(
        "{:g} mW/cm² is wanted of printer '{}', which gives up to {:g}; expected that or less",
        brightest, printer.name, mw_cm2.back()));
  }
  const Evenness evenness(printer);
  std::vector<std::vector<std::uint8_t>> taken(
      displays, std::vector<std::uint8_t>(shown.displays.front().pixels.size(), 0));
  for (std::size_t k = 0; k < images.size(); ++k) {
    context.check_cancelled();
    const BeamWay& way = way_of(vat, images[k].beam);
    const auto at = static_cast<std::size_t>(way.display) - 1;
    show(images[k], way, setup, printer, mw_cm2, brightest, evenness, shown.displays[at], taken[at],
         shown.images[k]);
  }
  return shown;
}

}  // namespace slicecorr::tomo
