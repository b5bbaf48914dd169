// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/convert.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string_view>
#include <utility>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "stack/container/container.hpp"
#include "stack/png/png.hpp"
#include "support/files/temporary.hpp"
#include "support/text/ascii.hpp"
#include "support/text/natural.hpp"
#include "tomo/print/voxels.hpp"
#include "tomo/views/image_folder.hpp"

namespace slicecorr::tomo {

namespace {

using slicecorr::detail::Container;

/// How many images of this step make a turn.
int images_of_turn(double step_deg) {
  if (!(step_deg > 0 && step_deg <= 120)) {
    throw InputError(fmt::format(
        "an angle of {:g}° from image to image; expected more than 0 and at most 120", step_deg));
  }
  const double images = 360 / step_deg, whole = std::round(images);
  if (!(whole <= 100000)) {
    throw InputError(fmt::format(
        "steps of {:g}° are {:.0f} images in a turn; expected at most 100000", step_deg, images));
  }
  // What a turn may be off by: a thousandth of a step, for steps that are told in few digits.
  if (std::abs(images - whole) > 1e-3) {
    throw InputError(fmt::format(
        "steps of {:g}° do not divide a whole turn: 360° are {:.3f} of them; expected {:.7g}° ({:.0f} "
        "images)",
        step_deg, images, 360 / whole, whole));
  }
  return static_cast<int>(whole);
}

}  // namespace

std::vector<const Container::Entry*> detail::images_in(const Container& archive) {
  std::vector<const Container::Entry*> images;
  for (const Container::Entry& entry : archive.entries()) {
    if (entry.name.find('/') != std::string::npos) continue;
    if (lower_case(entry.name).ends_with(".png")) images.push_back(&entry);
  }
  std::sort(images.begin(), images.end(), [](const auto* a, const auto* b) {
    const int order = natural_order(a->name, b->name);
    return order != 0 ? order < 0 : a->name < b->name;
  });
  for (std::size_t i = 1; i < images.size(); ++i) {
    if (natural_order(images[i - 1]->name, images[i]->name) != 0) continue;
    throw InputError(
        archive.path(), images[i]->name,
        fmt::format("has the number of {}; expected one image for each", images[i - 1]->name));
  }
  return images;
}

namespace {

GreyImage read_image(const Container& archive, const Container::Entry& entry,
                     const Printer& printer) {
  std::vector<std::uint8_t> png;
  archive.read(entry, std::uint64_t{1} << 32, png);
  const auto header = slicecorr::detail::read_png_header(png, {archive.path(), entry.name});
  if (static_cast<int>(header.width) != printer.width_px ||
      static_cast<int>(header.height) != printer.height_px) {
    throw InputError(
        archive.path(), entry.name,
        fmt::format("has {} x {} pixels; expected {} x {}, as printer '{}' shows", header.width,
                    header.height, printer.width_px, printer.height_px, printer.name));
  }
  if (header.bit_depth == 16) {
    throw InputError(archive.path(), entry.name,
                     "has 16 bits for each pixel; expected 8, as projectors are given");
  }
  GreyImage image =
      decode_png(png, printer.width_px, printer.height_px, archive.path(), entry.name);
  const int levels = printer.levels();
  for (std::size_t k = 0; k < image.pixels.size(); ++k) {
    const int value = image.pixels[k];
    if (pixel_of_level(level_of_pixel(value, levels), levels) == value) continue;
    const auto width = static_cast<std::size_t>(image.width_px);
    throw InputError(archive.path(), entry.name,
                     fmt::format("column {}, row {} is {}, which is none of the {} levels of "
                                 "printer '{}'",
                                 k % width, k / width, value, levels, printer.name));
  }
  return image;
}

/// Slices that cover all rows that are lit: as many as the part's and pairs of others, so that it
/// stays middled.
int slices_for(const std::vector<bool>& lit, const Printer& printer, const Resin& resin,
               double voxel_mm, int part_slices) {
  // Rays that spread light more than their own height.
  const bool shared = slices_share_light(printer, resin);
  if (shared && part_slices > 1) return part_slices;
  double reach = 0;
  for (std::size_t row = 0; row < lit.size(); ++row) {
    if (lit[row]) reach = std::max(reach, std::abs(pixel_z_mm(printer, static_cast<int>(row))));
  }
  if (shared) reach *= height_on_axis(printer, index_of(resin));
  const double most = 2 * static_cast<double>(lit.size()) + part_slices;
  int slices = part_slices;
  if (slices == 0) {
    // Rows in the middle of slices, where they can be.
    const double offset = pixel_z_mm(printer, 0) / voxel_mm;
    slices = std::abs(offset - std::round(offset)) < 0.25 ? 1 : 2;
  }
  // Light that rises is told apart by several slices.
  if (shared && slices == 1) slices = 3;
  while (slices < most && reach > (0.5 * slices) * voxel_mm) slices += 2;
  return slices;
}

}  // namespace

TomoJob job_of_images(const ImageSequence& sequence, const Printer& printer, const Resin& resin,
                      const Box<std::uint8_t>& part, double voxel_mm,
                      const ExecutionContext& context) {
  require_tomographic(printer);
  TomoJob job;
  job.printer = printer;
  job.resin = resin;
  job.turns = sequence.turns;
  if (sequence.turns < 1 || sequence.turns > 1000000000) {
    throw InputError(fmt::format("{} turns; expected 1 to 1000000000", sequence.turns));
  }
  if (sequence.direction) job.printer.rotation->direction = *sequence.direction;
  const int angles = images_of_turn(sequence.angle_step_deg);
  const auto archive = slicecorr::detail::open_container(
      sequence.path, slicecorr::detail::path_parts(sequence.path).folder, context);
  const std::vector<const Container::Entry*> images = detail::images_in(*archive);
  if (images.size() != static_cast<std::size_t>(angles)) {
    throw InputError(sequence.path, "",
                     fmt::format("holds {} PNG images; expected {}, a turn of steps of {:g}°",
                                 images.size(), angles, sequence.angle_step_deg));
  }
  // All of them are looked at before anything is made: where is light?
  std::vector<bool> lit(static_cast<std::size_t>(printer.height_px), false);
  const auto width = static_cast<std::size_t>(printer.width_px);
  const auto each = [&](const char* stage, const std::function<void(int, const GreyImage&)>& take) {
    for (int i = 0; i < angles; ++i) {
      context.check_cancelled();
      take(i, read_image(*archive, *images[static_cast<std::size_t>(i)], printer));
      context.report(stage, static_cast<double>(i + 1) / angles);
    }
  };
  each("looking at images", [&](int, const GreyImage& image) {
    for (std::size_t row = 0; row < lit.size(); ++row) {
      const auto first = image.pixels.begin() + static_cast<std::ptrdiff_t>(row * width);
      if (!lit[row]) {
        lit[row] = std::any_of(first, first + static_cast<std::ptrdiff_t>(width),
                               [](std::uint8_t v) { return v > 0; });
      }
    }
  });

  job.sampling.voxel_mm = voxel_mm > 0 ? voxel_mm : printer.pixel_y_um * 1e-3;
  job.sampling.angles = angles;
  job.sampling.slices = slices_for(lit, printer, resin, job.sampling.voxel_mm, part.nz);
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& grid = bench.grid;
  const auto slice_size =
      static_cast<std::size_t>(grid.voxels) * static_cast<std::size_t>(grid.voxels);
  job.part = {grid.slices, grid.voxels, grid.voxels, {}};
  job.part.values.assign(slice_size * static_cast<std::size_t>(grid.slices), 0);
  if (!part.values.empty()) {
    const Box<std::uint8_t> there = placed(part, printer, job.sampling.voxel_mm);
    const auto below = static_cast<std::size_t>((grid.slices - there.nz) / 2);
    std::copy(there.values.begin(), there.values.end(),
              job.part.values.begin() + static_cast<std::ptrdiff_t>(below * slice_size));
    if (below > 0) {
      context.tell(fmt::format(
          "{}: images have light above or below the part: {} slices of void are added to each side",
          sequence.path, below));
    }
  }

  if (printer.vial->traced()) {
    job.insert = detail::beside_resin(job.part, printer, job.sampling.voxel_mm);
  }
  job.levels.assign(grid.blocks() * grid.light_of_block(), 0);
  const int levels = printer.levels();
  std::size_t beside = 0;
  // Of level light, the rows of a slice: what falls on it is their mean.
  struct Shown {
    double mw_cm2 = 0;
    int rows = 0, least = 0, most = 0;  ///< and the levels among them
  };
  const auto rows = static_cast<std::size_t>(grid.light_rows());
  std::vector<Shown> shown(static_cast<std::size_t>(grid.pixels) * rows);
  std::size_t meant = 0;
  each("reading images", [&](int frame, const GreyImage& image) {
    const int m = bench.frame_of_angle(frame);
    std::fill(shown.begin(), shown.end(), Shown{});
    for (int column = 0; column < image.width_px; ++column) {
      for (int row = 0; row < image.height_px; ++row) {
        const std::uint8_t pixel =
            image.pixels[static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column)];
        const FramePlaces::Lit lit = bench.places.lit_by(m, column, row);
        if (!lit.any()) {
          beside += pixel > 0;
          continue;
        }
        Shown& of =
            shown[static_cast<std::size_t>(lit.pixel) * rows + static_cast<std::size_t>(lit.row)];
        const int level = level_of_pixel(pixel, levels);
        of.least = of.rows == 0 ? level : std::min(of.least, level);
        of.most = std::max(of.most, level);
        of.mw_cm2 += bench.mw_cm2[static_cast<std::size_t>(level)];
        ++of.rows;
      }
    }
    for (int i = 0; i < grid.pixels; ++i) {
      for (std::size_t r = 0; r < rows; ++r) {
        const Shown& of = shown[static_cast<std::size_t>(i) * rows + r];
        if (of.rows == 0) continue;
        const bool differ = of.least != of.most;
        meant += differ ? 1 : 0;
        job.levels[grid.pixel(m, i, static_cast<int>(r))] =
            differ ? nearest_level(of.mw_cm2 / of.rows, bench.mw_cm2)
                   : static_cast<std::uint16_t>(of.least);
      }
    }
  });
  if (meant > 0) {
    context.tell(fmt::format(
        "{}: images have finer rows than slices of {:g} mm: {} times rows of one slice differ, and the job "
        "shows all of them the nearest level to their mean light, which is what the slice gets; voxels of "
        "{:g} mm keep each row as it is",
        sequence.path, job.sampling.voxel_mm, meant, printer.pixel_y_um * 1e-3));
  }
  if (beside > 0) {
    context.tell(fmt::format("{}: {} pixels have light that passes by the resin: it is left out",
                             sequence.path, beside));
  }
  return job;
}

}  // namespace slicecorr::tomo
