// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file uvj_config.hpp
/// `config.json` of a UVJ archive, with our block under the key "slicecorr".
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/settings.hpp"
#include "slicecorr/stack.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

/// Newest version of our block that this program reads. Stacks say 1 as long as they hold nothing
/// else: continuous exposure at one speed, without UV light. 2 has exposure schedules of any kind,
/// 3 a flat-field, 4 is a recorded stack, 5 a target with edge heights, 6 a bath that ends or light that
/// spreads, 7 even light, 8 slices with speeds of their own, 9 such with lamps that stay, 10 a resin that
/// bleaches, 11 light below full or layers of different heights, 12 light in other units than mW/cm², 13
/// grey by pulses, uneven UV light or a lamp that fades, 14 a UV lamp that fades.
inline constexpr int kUvjBlockFormat = 15;

/// Words of the block, in the order of UvKind.
inline const std::vector<std::string> kNamesOfUv{"off", "constant", "per_slice", "patterned"};
/// A word of a setting as blocks have it: lamp_follows.
inline std::string block_word(std::string_view word) {
  std::string text(word);
  std::replace(text.begin(), text.end(), '-', '_');
  return text;
}
inline std::string block_key(const Setting& s) {
  return std::string(s.block_key.empty() ? s.name : s.block_key);
}

std::string write_uvj_config(const StackInfo& info, const ImageChecksums& checksums);

/// The same changed to what `info` says of layers, with our block; of exposures only when
/// `exposure_changes`. All else that `original` holds stays.
std::string change_uvj_config(const std::string& original, const StackInfo& info,
                              const ImageChecksums& checksums, bool exposure_changes,
                              bool light_changes);

/// Throws `InputError` naming the key and what was expected. Names of images are not filled in.
ArchiveContents parse_uvj_config(std::string_view text, const std::string& file);

/// Our block alone, with its checksum, for formats that have no place for it; see
/// `kProvenanceEntry`.
std::string write_provenance(const StackInfo& info, const ImageChecksums& checksums);
/// The same of a setup alone, without a checksum: texts that carry it have their own.
std::string setup_block(const StackInfo& info);
/// Takes the block into `contents`, with the names of UV images where there are some.
void read_provenance(std::string_view text, const std::string& file, ArchiveContents& contents);

/// "uv/00000012.png".
std::string uv_image_name(int slice);
/// "slicecorr/surface/00000012.png".
std::string edge_image_name(int node);

/// Our fingerprint of a stack's images: CRC-32 of the slices' Adler-32 values, each as four bytes,
/// highest first.
std::uint32_t images_crc32(const std::vector<std::uint32_t>& slice_adlers);

}  // namespace slicecorr::detail
