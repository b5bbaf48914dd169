// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file block_check.hpp
/// Whether the parameters that a stack of ours carries are those that it was written with.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

/// Key of our block with its checksum.
inline constexpr const char* kBlockCrc32Key = "block_crc32";

/// CRC-32 of what the block says but for the checksum: of its JSON without white space, keys in the
/// order of their bytes, numbers as the shortest text of the same double. So it is the same for
/// any layout, order of keys and way of writing the same numbers and letters.
std::uint32_t block_crc32(const nlohmann::json& block);

/// Throws `InputError` naming both values where the block of `contents` contradicts what the
/// archive says besides (layers, times, size of images), and where its checksum is that of other
/// parameters. Sizes of pixels and layers are compared where the block is read.
void check_block(const ArchiveContents& contents, const std::string& file);

/// Throws `InputError` where the exposure times that an archive says (`exposure_s` and what belongs
/// to it in `says`) are others than `plan` has, as far as archives can say them: by more than 1 %
/// and the rounding to milliseconds. `rounding`: share by which times of slices that pass by follow
/// from rounded heights.
void check_times(const StackInfo& plan, const StackInfo& says, const std::string& file,
                 double rounding = 0);

}  // namespace slicecorr::detail
