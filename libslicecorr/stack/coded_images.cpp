// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/coded_images.hpp"

#include <string>

#include "slicecorr/error.hpp"
#include "stack/container/binary_file.hpp"

namespace slicecorr::detail {
namespace {

/// Of a pixel, in any of our codes for entries of zips; a run of one pixel takes two.
constexpr std::uint64_t kMostBytesOfAPixel = 2;

}  // namespace

std::size_t coded_image_count(const ArchiveContents& contents) {
  const std::size_t pieces =
      contents.images.empty() ? contents.places.size() : contents.images.size();
  return pieces / static_cast<std::size_t>(contents.codec->pieces());
}

void read_code(const Container& archive, const ArchiveContents& contents, std::size_t image,
               std::vector<std::vector<std::uint8_t>>& pieces) {
  const auto count = static_cast<std::size_t>(contents.codec->pieces());
  pieces.resize(count);
  for (std::size_t p = 0; p < count; ++p) {
    const std::size_t piece = image * count + p;
    if (contents.images.empty()) {
      const ArchiveContents::Place& place = contents.places[piece];
      binary_file(archive).read_at(place.offset, place.size, pieces[p],
                                   "layer " + std::to_string(image));
      continue;
    }
    const std::string& name = contents.images[piece];
    const Container::Entry* const entry = archive.find(name);
    if (entry == nullptr) throw InputError(archive.path(), shown_name(name), "is missing");
    archive.read(*entry, kMostBytesOfAPixel * (contents.codec->pixel_count() + 1), pieces[p]);
  }
}

std::size_t decode_image(const Container& archive, const ArchiveContents& contents,
                         std::size_t image, std::uint8_t* pixels) {
  std::vector<std::vector<std::uint8_t>> pieces;
  read_code(archive, contents, image, pieces);
  return contents.codec->decode(pieces, pixels, {archive.path(), static_cast<int>(image)});
}

}  // namespace slicecorr::detail
