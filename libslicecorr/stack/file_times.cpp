// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/file_times.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "slicecorr/error.hpp"
#include "stack/container/container_output.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/exposure_pattern.hpp"
#include "stack/layer_places.hpp"

namespace slicecorr {
namespace {

/// Heights within this share are the same, as where a stack is read.
constexpr double kSameHeight = 1e-3;

/// The heights of an archive that is changed stay, whatever its format: layers of others would be
/// printed higher or lower than they are.
void check_heights(const StackFile& file, const StackInfo& info, const StackInfo& kept) {
  if (!(info.grid.layer_um > 0) || !(kept.grid.layer_um > 0)) return;  // nobody says
  for (int n = 0; n < info.grid.layers; ++n) {
    const double um = layer_height_um(info, n);
    const double kept_um = layer_height_um(kept, std::min(n, kept.grid.layers - 1));
    if (std::abs(um - kept_um) <= kSameHeight * kept_um) continue;
    throw InputError(
        file.keep_from, "",
        fmt::format(
            "its layer {0} is {1:.6g} um high, that of the part {2:.6g} um, and the heights "
            "of a file whose settings stay are kept; expected a file with the part's "
            "heights, such as the printer's slicer makes of any part with layers of "
            "{2:.6g} um, or the part sliced with layers of {1:.6g} um",
            n, kept_um, um));
  }
}

}  // namespace

void check_file_times(const StackFile& file, const StackInfo& info) {
  if (file.keep_from.empty()) return;
  const detail::ArchiveFormat& format = detail::format_named(file.format, file.path);
  const auto kept =
      detail::open_container(file.keep_from, std::filesystem::temp_directory_path().string());
  if (format.container() != kept->kind() || !format.recognises(*kept)) return;  // said elsewhere
  const detail::ArchiveContents contents = detail::read_with_places(format, *kept);
  check_heights(file, info, contents.info);
  // Archives of images tell what they can't say; refusals are of print files that are changed.
  if (!format.codes_layers()) return;
  const bool times = detail::replaces_exposures(info, contents.info);
  const bool light = detail::shares_differ(info, contents.info);
  if (!times && !light) return;
  const StackInfo by_image = detail::image_by_image(info, contents);
  const detail::ArchiveContents images = detail::image_by_image(contents);
  // A rehearsal: all of the file but its layers, which is never finished.
  detail::CodedLayers layers{*contents.codec};
  const auto count = static_cast<std::size_t>(by_image.grid.layers);
  layers.sizes.resize(count * static_cast<std::size_t>(contents.codec->pieces()), 0);
  layers.lit_pixels.resize(count, 0);
  layers.append = [](std::size_t, std::vector<std::uint8_t>&) {};
  const auto output = detail::make_container_output(file.path, format.container(), file.keep_from,
                                                    detail::ImagePacking::deflated);
  const GreyImage preview;
  format.write({.info = by_image,
                .stem = {},
                .checksums = {},
                .preview = preview,
                .kept = kept.get(),
                .kept_contents = &images,
                .exposure_changes = times,
                .light_changes = light,
                .layers = &layers},
               *output);
}

}  // namespace slicecorr
