// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file zip_pack.hpp
/// Deflating the entries of a zip ahead of their turn.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "stack/container/container_output.hpp"

namespace slicecorr::detail {

struct PackedEntry {
  std::vector<std::uint8_t> data;
  std::uint32_t crc32 = 0;  ///< of what was deflated
};

PackedEntry deflate_entry(const std::vector<std::uint8_t>& data, int level);

inline bool is_zipped_image(const std::string& name) {
  return name.ends_with(".png") || name.ends_with(".pw0Img");
}

/// Deflate level of images: higher ones take more time and hardly make them smaller.
inline int zip_image_level(ImagePacking images) { return images == ImagePacking::smallest ? 9 : 1; }

/// Bytes of entries that are deflated together.
constexpr std::uint64_t kZipBatchBytes = std::uint64_t{16} << 20;

}  // namespace slicecorr::detail
