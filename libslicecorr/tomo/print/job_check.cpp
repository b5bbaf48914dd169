// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/job_check.hpp"

#include <fmt/format.h>

#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/block_check.hpp"
#include "stack/isa_l.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::tomo::detail {

using slicecorr::detail::kBlockCrc32Key;
using Node = slicecorr::detail::JsonNode<nlohmann::json>;

namespace {
constexpr const char* kImagesKey = "images_crc32";
constexpr std::int64_t kMostCrc = 0xffffffff;
}  // namespace

void ImagesCrc::add(const GreyImage& image) {
  const auto add = [&](const std::uint8_t* data, std::size_t size) {
    crc_ = isal::crc32(crc_, data, size);
  };
  for (const int side : {image.width_px, image.height_px}) {
    const auto n = static_cast<std::uint32_t>(side);
    const std::uint8_t bytes[4] = {static_cast<std::uint8_t>(n >> 24),
                                   static_cast<std::uint8_t>(n >> 16),
                                   static_cast<std::uint8_t>(n >> 8), static_cast<std::uint8_t>(n)};
    add(bytes, sizeof bytes);
  }
  add(image.pixels.data(), image.pixels.size());
}

void add_checksums(nlohmann::ordered_json& config, std::uint32_t images_crc32) {
  config[kImagesKey] = images_crc32;
  // Of what is read: texts that are no UTF-8 change when they are written.
  config[kBlockCrc32Key] =
      slicecorr::detail::block_crc32(slicecorr::detail::own_json(config.dump()));
}

bool check(const Node& config, std::uint32_t images_crc32, const std::string& path,
           const ExecutionContext& context) {
  if (!config.has(kBlockCrc32Key) || !config.has(kImagesKey)) {
    context.tell(path +
                 ": has no checksums of what it says and shows: another program made it, or it was "
                 "changed since; it is taken as it stands");
    return false;
  }
  const auto said = [&](const char* key) {
    return static_cast<std::uint32_t>(config[key].whole(0, kMostCrc));
  };
  if (said(kBlockCrc32Key) != slicecorr::detail::block_crc32(config.json())) {
    throw InputError(path, "",
                     "what it says was changed after the job was made (checksum): its images were "
                     "computed for another printer, resin or time; expected the job as `slicecorr` "
                     "wrote it");
  }
  if (said(kImagesKey) != images_crc32) {
    throw InputError(path, "",
                     "its images were changed after the job was made (checksum), or stand in "
                     "another order; expected the job as `slicecorr` wrote it");
  }
  return true;
}

void check_number(const Node& said, double follows, const std::string& from) {
  const double value = said.number(-slicecorr::detail::JsonSource::kLargest,
                                   slicecorr::detail::JsonSource::kLargest);
  // As texts of other programs may round it.
  if (std::abs(value - follows) > 1e-6 * std::abs(follows)) {
    said.fail(fmt::format("{:.10g}, as {} says", follows, from));
  }
}

}  // namespace slicecorr::tomo::detail
