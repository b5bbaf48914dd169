// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The grey levels of a printer as a file of few levels can show them.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "slicecorr/error.hpp"
#include "slicecorr/file_greys.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "stack/container/container.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr {
namespace {

int pixel_of(int level, int levels) { return (2 * level * 255 + levels - 1) / (2 * (levels - 1)); }

/// Whether every level comes back as itself.
bool holds_levels(const detail::ShownGrey& shown, int levels) {
  for (int level = 0; level < levels; ++level) {
    const int value = shown[static_cast<std::size_t>(pixel_of(level, levels))];
    if ((2 * value * (levels - 1) + 255) / 510 != level) return false;
  }
  return shown[255] == 255 && shown[0] == 0;
}

/// Intensity at a place between the printer's levels.
double intensity_at(const Printer& printer, double level) {
  const auto& points = printer.calibration;
  const auto above = std::find_if(points.begin(), points.end(),
                                  [&](const CalibrationPoint& p) { return p.level >= level; });
  if (above == points.begin() || above->level == level) return above->intensity_mw_cm2;
  const CalibrationPoint &a = *std::prev(above), &b = *above;
  return a.intensity_mw_cm2 +
         (b.intensity_mw_cm2 - a.intensity_mw_cm2) * (level - a.level) / (b.level - a.level);
}

}  // namespace

namespace {

/// Null where all grey values are held, and where nothing is known: what is not made from nothing.
detail::LayerCodecPtr codec_of(const StackFile& file, const detail::ArchiveFormat& format,
                               const Grid& grid) {
  if (file.keep_from.empty()) return format.new_codec(grid);
  const auto kept =
      detail::open_container(file.keep_from, std::filesystem::temp_directory_path().string());
  if (format.container() != kept->kind() || !format.recognises(*kept)) {
    throw InputError(file.keep_from, "",
                     "is no archive of the format " + std::string(format.name()));
  }
  return format.read(*kept).codec;
}

}  // namespace

FileGreys greys_of_file(const StackFile& file, const Grid& grid) {
  const detail::ArchiveFormat& format = detail::format_named(file.format, file.path);
  if (!format.codes_layers()) return detail::all_grey();
  const detail::LayerCodecPtr codec = codec_of(file, format, grid);
  return codec ? codec->shown() : detail::all_grey();
}

bool file_holds_levels(const detail::ShownGrey& shown, const Printer& printer) {
  return holds_levels(shown, printer.levels());
}

Printer printer_for_file(const Printer& printer, const StackFile& file, const Grid& grid,
                         const ExecutionContext& context) {
  const detail::ArchiveFormat& format = detail::format_named(file.format, file.path);
  if (!format.codes_layers()) return printer;
  const detail::LayerCodecPtr codec = codec_of(file, format, grid);
  if (!codec || holds_levels(codec->shown(), printer.levels())) return printer;
  const detail::ShownGrey& shown = codec->shown();
  const int in_file = detail::levels_of(shown);
  const std::string& path = file.keep_from.empty() ? file.path : file.keep_from;
  if (in_file == 2) {
    throw InputError(
        path, "",
        fmt::format(
            "holds black and white only, but the correction needs grey, of which printer {} "
            "has {} levels; expected a file that the slicer exports with anti-aliasing, or a "
            "printer file with bit_depth = 1 where black and white is meant",
            printer.name, printer.levels()));
  }
  Printer few = printer;
  do {
    --few.bit_depth;
  } while (few.bit_depth > 1 && !holds_levels(shown, few.levels()));
  few.calibration.clear();
  for (int level = 0; level < few.levels() && light_is_measured(printer); ++level) {
    const int value = shown[static_cast<std::size_t>(pixel_of(level, few.levels()))];
    few.calibration.push_back({static_cast<double>(level),
                               intensity_at(printer, value * (printer.levels() - 1) / 255.0)});
  }
  context.tell(
      fmt::format("{}: the format {} holds {} grey levels: corrected with {} of printer {}'s "
                  "{}; what is rounded goes into the next slices",
                  path, format.name(), in_file, few.levels(), printer.name, printer.levels()));
  return few;
}

}  // namespace slicecorr
