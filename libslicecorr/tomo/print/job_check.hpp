// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Whether what a job says, and its images, are those that it was written with.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "slicecorr/parallel.hpp"
#include "slicecorr/stack.hpp"
#include "support/json/json_node.hpp"

namespace slicecorr::tomo::detail {

/// Most bytes that a PNG of an image may have: that of one that does not deflate.
constexpr std::uint64_t png_limit(int width, int height) {
  return 2 * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height) + (1 << 16);
}

/// CRC-32 of the pixels of images, in order, with their sizes.
class ImagesCrc {
 public:
  void add(const GreyImage& image);
  std::uint32_t value() const { return crc_; }

 private:
  std::uint32_t crc_ = 0;
};

/// Adds the checksums of the images and of all that `config` says.
void add_checksums(nlohmann::ordered_json& config, std::uint32_t images_crc32);

/// Of a config as it was read, and its images. Throws `InputError` where what it says, or an image,
/// was changed. False where it has no checksums, which `context.notice` is told.
bool check(const slicecorr::detail::JsonNode<nlohmann::json>& config, std::uint32_t images_crc32,
           const std::string& path, const ExecutionContext& context);
/// Throws `InputError` where a number that follows from the rest is another.
void check_number(const slicecorr::detail::JsonNode<nlohmann::json>& said, double follows,
                  const std::string& from);

}  // namespace slicecorr::tomo::detail
