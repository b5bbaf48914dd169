// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/file_times.hpp"

#include <filesystem>

#include "stack/container/container_output.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/exposure_pattern.hpp"
#include "stack/layer_places.hpp"

namespace slicecorr {

void check_file_times(const StackFile& file, const StackInfo& info) {
  const detail::ArchiveFormat& format = detail::format_named(file.format, file.path);
  // Archives of images tell what they can't say; refusals are of print files that are changed.
  if (!format.codes_layers() || file.keep_from.empty()) return;
  const auto kept =
      detail::open_container(file.keep_from, std::filesystem::temp_directory_path().string());
  if (format.container() != kept->kind() || !format.recognises(*kept)) return;  // said elsewhere
  const detail::ArchiveContents contents = detail::read_with_places(format, *kept);
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
