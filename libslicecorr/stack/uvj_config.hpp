/// @file uvj_config.hpp
/// `config.json` of a UVJ archive, with our block under the key "slicecorr".
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// Newest version of our block that this program reads, and the one it writes.
inline constexpr int uvj_block_format = 1;

struct UvjConfig {
  StackInfo info;
  /// `images_crc32` of our block; absent in foreign archives.
  std::optional<std::uint32_t> images_crc32;
  std::vector<std::string> warnings;
};

/// Largest image of a stack.
inline constexpr std::int64_t max_image_pixels = 1'000'000'000;

std::string write_uvj_config(const StackInfo& info, std::uint32_t images_crc32);

/// Throws `InputError` naming the key and what was expected.
UvjConfig parse_uvj_config(std::string_view text, const std::string& file);

/// Our fingerprint of a stack's images: CRC-32 of the slices' Adler-32 values, each as four bytes,
/// highest first.
std::uint32_t images_crc32(const std::vector<std::uint32_t>& slice_adlers);

}  // namespace slicecorr::detail
