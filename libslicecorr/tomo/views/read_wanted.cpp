// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/read_wanted.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "stack/container/container.hpp"
#include "stack/png/png.hpp"
#include "support/files/temporary.hpp"
#include "support/text/csv.hpp"
#include "tomo/views/image_folder.hpp"

namespace slicecorr::tomo {

namespace {

constexpr const char* kDoseColumn = "dose_mj_cm3";
constexpr const char* kConversionColumn = "conversion";

Box<float> read_images(const std::string& path, double white, const ExecutionContext& context) {
  using slicecorr::detail::Container;
  const auto archive =
      slicecorr::detail::open_container(path, slicecorr::detail::path_parts(path).folder, context);
  const std::vector<const Container::Entry*> images = detail::images_in(*archive);
  if (images.empty()) throw InputError(path, "", "holds no PNG image; expected one for each slice");
  Box<float> box;
  box.nz = static_cast<int>(images.size());
  for (const Container::Entry* entry : images) {
    context.check_cancelled();
    std::vector<std::uint8_t> png;
    archive->read(*entry, std::uint64_t{1} << 32, png);
    const auto header = slicecorr::detail::read_png_header(png, {path, entry->name});
    const int width = static_cast<int>(std::min<std::uint32_t>(header.width, kMostAlongAxis + 1)),
              height = static_cast<int>(std::min<std::uint32_t>(header.height, kMostAlongAxis + 1));
    if (box.nx == 0) {
      box.nx = width;
      box.ny = height;
    }
    if (width > kMostAlongAxis || width != box.nx || height != box.ny || header.bit_depth == 16) {
      throw InputError(
          path, entry->name,
          fmt::format("has {} x {} pixels of {} bits; expected {} x {} of 8 bits, as {}",
                      header.width, header.height, header.bit_depth, box.nx, box.ny,
                      images.front()->name));
    }
    const GreyImage image = decode_png(png, width, height, path, entry->name);
    for (int y = height - 1; y >= 0; --y) {
      for (int x = 0; x < width; ++x) {
        const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                        static_cast<std::size_t>(x);
        box.values.push_back(static_cast<float>(image.pixels[at] * white / 255));
      }
    }
  }
  return box;
}

}  // namespace

Box<float> read_numbers(const std::string& path, double white, const ExecutionContext& context) {
  if (path.ends_with(".npy")) return read_dose_npy(path);
  if (white > 0) return read_images(path, white, context);
  throw InputError(path, "",
                   "is no .npy; expected one, or images and what white in them stands for");
}

std::vector<CurvePoint> read_conversion_curve(const std::string& path) {
  CsvReader table = CsvReader::of_file(path, {.comments_behind_cells = true});
  CsvRow row;
  const auto wrong = [&](const std::string& what) {
    throw InputError(path, table.place(),
                     fmt::format("{}; expected a table with the columns {}, {}", what, kDoseColumn,
                                 kConversionColumn));
  };
  if (!table.next(row)) wrong("is empty");
  if (row.cells != std::vector<std::string>{kDoseColumn, kConversionColumn}) {
    wrong("has other columns");
  }
  std::vector<CurvePoint> curve;
  while (table.next(row)) {
    if (row.cells.size() != 2) wrong(fmt::format("has {} cells", row.cells.size()));
    const auto dose = number_in_text(row.cells[0]), value = number_in_text(row.cells[1]);
    if (!dose || !value || !(*dose >= 0) || !(*value >= 0 && *value <= 1) || !(*dose < 1e9)) {
      wrong(fmt::format("has '{}', '{}'", row.cells[0], row.cells[1]));
    }
    curve.push_back({*dose, *value});
  }
  if (curve.size() < 2) wrong(fmt::format("has {} points", curve.size()));
  return curve;
}

}  // namespace slicecorr::tomo
