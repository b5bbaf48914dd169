// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file layer_places.hpp
/// Where an archive's images stand along the height: layers of different heights, and layers that are
/// exposed more than once (docs/print-files.md).
#pragma once

#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

/// What an archive of this format says, with heights and exposures of its layers. Throws as
/// `ArchiveFormat::read`, and `InputError` where an image stands below the one before it.
ArchiveContents read_with_places(const ArchiveFormat& format, const Container& archive);

/// A layer of `info` for each image of the archive that is changed, with its times and shares of light, as
/// its format writes them; what is added comes after them. The same where each layer has one image.
StackInfo image_by_image(const StackInfo& info, const ArchiveContents& kept);
/// Contents whose layers are its images.
ArchiveContents image_by_image(const ArchiveContents& contents);
/// The layer that an image of the archive that is changed shows.
int layer_of_image(const ArchiveContents& kept, std::size_t image);
/// Whether an image stays as it is, whatever its layer shows.
bool is_spot(const ArchiveContents& kept, std::size_t image);

}  // namespace slicecorr::detail
