// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file coded_images.hpp
/// Images that a format codes in its own way: pieces of a binary file, or entries of a zip.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

/// How many images there are; `contents.codec` is not null.
std::size_t coded_image_count(const ArchiveContents& contents);
/// Replaces `pieces` by the code of an image. Throws `InputError` where an entry is missing or larger than
/// any code of its pixels. Thread-safe.
void read_code(const Container& archive, const ArchiveContents& contents, std::size_t image,
               std::vector<std::vector<std::uint8_t>>& pieces);
/// The pixels of an image; returns how many of them its code lacks (see `LayerCodec::decode`).
std::size_t decode_image(const Container& archive, const ArchiveContents& contents,
                         std::size_t image, std::uint8_t* pixels);

}  // namespace slicecorr::detail
