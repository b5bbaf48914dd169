// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/layer_encoding.hpp"

#include <atomic>
#include <cstring>
#include <memory>

#include "stack/coded_images.hpp"
#include "stack/png/png.hpp"

namespace slicecorr::detail {

EncodedLayers encode_layers(const LayerCodec& codec, const Grid& grid, std::size_t count,
                            const ReadPixels& read_pixels, const Container* kept,
                            const ArchiveContents& kept_contents, bool with_adlers,
                            BlobStore& store, const ExecutionContext& context) {
  const auto pieces = static_cast<std::size_t>(codec.pieces());
  EncodedLayers coded{std::vector<BlobStore::Blob>(count * pieces),
                      std::vector<std::uint32_t>(count),
                      {.codec = codec},
                      std::vector<std::uint8_t>(count * pieces),
                      0};
  coded.layers.sizes.resize(count * pieces);
  coded.layers.lit_pixels.resize(count);
  std::atomic<std::uint64_t> rounded_pixels{0};
  parallel_for(context, "pack", count, [&](std::size_t slice) {
    const std::size_t pixel_count = codec.pixel_count();
    const auto pixels = std::make_unique_for_overwrite<std::uint8_t[]>(pixel_count);
    std::vector<std::vector<std::uint8_t>> made, old;
    read_pixels(slice, pixels.get());
    std::uint64_t lit = 0, rounded = 0;
    const ShownGrey& shown = codec.shown();
    each_pixel_run(pixels.get(), pixel_count, [&](std::uint8_t& v, std::size_t n) {
      const std::uint8_t to = shown[v];
      if (to != 0) lit += n;
      if (to == v) return;
      rounded += n;
      std::memset(&v, to, n);
    });
    rounded_pixels += rounded;
    if (with_adlers) {
      coded.adlers[slice] =
          adler_of({grid.width_px, 0, grid.width_px, grid.height_px, pixels.get()});
    }
    codec.encode(static_cast<int>(slice), pixels.get(), made);
    if (kept != nullptr && slice < coded_image_count(kept_contents)) {
      read_code(*kept, kept_contents, slice, old);
      if (old != made) {
        const auto old_pixels = std::make_unique_for_overwrite<std::uint8_t[]>(pixel_count);
        codec.decode(old, old_pixels.get(), {kept->path(), static_cast<int>(slice)});
        if (std::memcmp(old_pixels.get(), pixels.get(), pixel_count) == 0) made = old;
      }
      for (std::size_t p = 0; p < pieces; ++p) {
        coded.as_kept[slice * pieces + p] = made[p] == old[p];
      }
    }
    coded.layers.lit_pixels[slice] = lit;
    for (std::size_t p = 0; p < pieces; ++p) {
      coded.layers.sizes[slice * pieces + p] = made[p].size();
      coded.pieces[slice * pieces + p] = store.put(made[p].data(), made[p].size());
    }
  });
  coded.rounded_pixels = rounded_pixels;
  return coded;
}

}  // namespace slicecorr::detail
