// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Images of an archive become blobs of bands.
#include <algorithm>
#include <cstring>
#include <memory>

#include "base/run_length.hpp"
#include "slicecorr/error.hpp"
#include "stack/coded_images.hpp"
#include "stack/png/png.hpp"
#include "stack/stack_reader_parts.hpp"

namespace slicecorr {

namespace {

std::uint64_t load(const std::uint8_t* p) {
  std::uint64_t v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

std::uint64_t sum_of(const std::uint8_t* p, std::size_t n) {
  std::uint64_t sum = 0;
  // A sum of so many pixels fits 32 bits, of which a vector holds twice as many as of 64.
  constexpr std::size_t most = std::size_t{1} << 24;
  for (std::size_t at = 0; at < n; at += most) {
    std::uint32_t part = 0;
    for (std::size_t i = at, end = std::min(n, at + most); i < end; ++i) part += p[i];
    sum += part;
  }
  return sum;
}

/// First non-zero byte, or `n`.
int first_lit(const std::uint8_t* row, int n) {
  int x = 0;
  while (x + 32 <= n &&
         (load(row + x) | load(row + x + 8) | load(row + x + 16) | load(row + x + 24)) == 0) {
    x += 32;
  }
  while (x + 8 <= n && load(row + x) == 0) x += 8;
  while (x < n && row[x] == 0) ++x;
  return x;
}

/// End of the non-zero bytes, but not below `least`.
int end_lit(const std::uint8_t* row, int least, int n) {
  while (n - 32 >= least &&
         (load(row + n - 8) | load(row + n - 16) | load(row + n - 24) | load(row + n - 32)) == 0) {
    n -= 32;
  }
  while (n - 8 >= least && load(row + n - 8) == 0) n -= 8;
  while (n > least && row[n - 1] == 0) --n;
  return n;
}

/// Smallest box around the lit pixels of some rows, each `stride` bytes after the one before.
PixelBox lit_box(const std::uint8_t* first_row, std::size_t stride, int width, int rows) {
  PixelBox box{width, rows, 0, 0};
  for (int y = 0; y < rows; ++y) {
    const std::uint8_t* const row = first_row + stride * static_cast<unsigned>(y);
    const int first = first_lit(row, width);
    if (first == width) continue;
    box.x0 = std::min(box.x0, first);
    box.x1 = end_lit(row, std::max(box.x1, first + 1), width);
    box.y0 = std::min(box.y0, y);
    box.y1 = y + 1;
  }
  return box.empty() ? PixelBox{} : box;
}

}  // namespace

void StackReader::Impl::BandTaker::take(int y0, int y1, const std::uint8_t* first_row,
                                        std::size_t stride) {
  const PixelBox box = lit_box(first_row, stride, stack.config.info.grid.width_px, y1 - y0);
  if (box.empty()) return;
  decoded.lit = decoded.lit.united({box.x0, y0 + box.y0, box.x1, y0 + box.y1});
  const auto width = static_cast<std::size_t>(box.width());
  pixels.clear();
  for (int y = 0; y < y1 - y0; ++y) {
    const std::uint8_t* const row = first_row + stride * static_cast<unsigned>(y) + box.x0;
    pixels.insert(pixels.end(), row, row + width);
  }
  decoded.sum += sum_of(pixels.data(), pixels.size());
  const std::int32_t columns[2] = {box.x0, box.x1};
  code.resize(sizeof columns);
  std::memcpy(code.data(), columns, sizeof columns);
  detail::run_length_encode(pixels.data(), pixels.size(), code);
  stack.blob(into, y0 / stack.rows, slice) = stack.store.put(code.data(), code.size());
}

/// Decodes one image into blobs.
StackReader::Impl::Decoded StackReader::Impl::decode(const Index& into, int slice,
                                                     std::span<const std::uint8_t> png,
                                                     const std::string& name, bool packed_rgb,
                                                     bool packed_bgr) {
  const Grid& grid = config.info.grid;
  Decoded decoded;
  BandTaker bands_of{*this, into, slice, decoded};
  const auto take = [&](int y0, int y1, const std::uint8_t* raw) {
    if (raw != nullptr) bands_of.take(y0, y1, raw + 1, detail::raw_stride(grid.width_px));
  };
  decoded.adler = detail::decode_png_bands(png, grid.width_px, grid.height_px, rows, {path, name},
                                           take, packed_rgb, packed_bgr);
  return decoded;
}

/// Decodes layers that have a code of their own. What stands for the images is only found where the file says
/// what it was.
std::vector<std::uint32_t> StackReader::Impl::decode_layers(const Container& archive,
                                                            const ExecutionContext& context) {
  const Grid& grid = config.info.grid;
  const auto layers = static_cast<std::size_t>(grid.layers);
  make_index(index, layers);
  std::vector<std::uint32_t> adlers(layers);
  std::size_t most_lacking = 0, lacking_layer = 0;
  const auto width = static_cast<std::size_t>(grid.width_px);
  parallel_for(context, "read", layers, [&](std::size_t n) {
    const auto pixels = std::make_unique_for_overwrite<std::uint8_t[]>(config.codec->pixel_count());
    const std::size_t lacking = detail::decode_image(archive, config, n, pixels.get());
    if (config.images_crc32) {
      adlers[n] = detail::adler_of({grid.width_px, 0, grid.width_px, grid.height_px, pixels.get()});
    }
    Decoded decoded;
    BandTaker taker{*this, index, static_cast<int>(n), decoded};
    for (int y = 0; y < grid.height_px; y += rows) {
      taker.take(y, std::min(grid.height_px, y + rows),
                 pixels.get() + width * static_cast<std::size_t>(y), width);
    }
    const std::scoped_lock lock(mutex);
    index.lit = index.lit.united(decoded.lit);
    sum += decoded.sum;
    if (lacking > most_lacking || (lacking > 0 && lacking == most_lacking && n < lacking_layer)) {
      most_lacking = lacking;
      lacking_layer = n;
    }
  });
  tell_lacking(most_lacking, lacking_layer, context);
  return adlers;
}

void StackReader::Impl::tell_lacking(std::size_t pixels, std::size_t layer,
                                     const ExecutionContext& context) const {
  if (pixels == 0) return;
  context.tell(path + ": the code of layers ends too early, that of layer " +
               std::to_string(layer) + " by " + std::to_string(pixels) +
               " pixels, which are taken as black");
}

std::size_t StackReader::Impl::pixels_of(const Container& archive, std::size_t image,
                                         std::uint8_t* pixels) const {
  const Grid& grid = config.info.grid;
  if (config.codec) return detail::decode_image(archive, config, image, pixels);
  const std::string& name = config.images[image];
  const auto entry = detail::entries_of(archive, {name}, grid);
  std::vector<std::uint8_t> png;
  archive.read(*entry.front(), entry.front()->bytes, png);
  const auto width = static_cast<std::size_t>(grid.width_px);
  const std::size_t stride = detail::raw_stride(grid.width_px);
  detail::decode_png_bands(
      png, grid.width_px, grid.height_px, rows, {path, name},
      [&](int y0, int y1, const std::uint8_t* raw) {
        for (int y = y0; y < y1; ++y) {
          std::uint8_t* const to = pixels + width * static_cast<std::size_t>(y);
          if (raw == nullptr) {
            std::memset(to, 0, width);
          } else {
            std::memcpy(to, raw + stride * static_cast<std::size_t>(y - y0) + 1, width);
          }
        }
      },
      config.packed_rgb, config.packed_bgr);
  return 0;
}

void StackReader::Impl::take_image(const Index& into, int image, const std::uint8_t* pixels,
                                   Decoded& decoded) {
  const Grid& grid = config.info.grid;
  const auto width = static_cast<std::size_t>(grid.width_px);
  BandTaker taker{*this, into, image, decoded};
  for (int y = 0; y < grid.height_px; y += rows) {
    taker.take(y, std::min(grid.height_px, y + rows), pixels + width * static_cast<std::size_t>(y),
               width);
  }
}

/// Decodes the images of layers that are exposed more than once: each by itself, and of each layer the
/// brightest of every pixel, spots left out.
std::vector<std::uint32_t> StackReader::Impl::decode_exposures(const Container& archive,
                                                               const ExecutionContext& context) {
  const Grid& grid = config.info.grid;
  const std::vector<LayerExposure>& exposures = config.info.exposures;
  const auto layers = static_cast<std::size_t>(grid.layers);
  std::vector<std::size_t> first_of(layers + 1, exposures.size());
  for (std::size_t k = exposures.size(); k-- > 0;) {
    first_of[static_cast<std::size_t>(exposures[k].layer)] = k;
  }
  make_index(index, layers);
  make_index(exposure_index, exposures.size());
  std::vector<std::uint32_t> adlers(layers);
  std::size_t most_lacking = 0, lacking_layer = 0;
  parallel_for(context, "read", layers, [&](std::size_t n) {
    const std::size_t count =
        static_cast<std::size_t>(grid.width_px) * static_cast<std::size_t>(grid.height_px);
    const auto pixels = std::make_unique_for_overwrite<std::uint8_t[]>(count);
    const auto all = std::make_unique<std::uint8_t[]>(count);
    bool several = false, begun = false;
    double share = 0;
    std::size_t lacking = 0;
    Decoded lit, whole;
    for (std::size_t k = first_of[n]; k < first_of[n + 1]; ++k) {
      lacking = std::max(lacking, pixels_of(archive, k, pixels.get()));
      take_image(exposure_index, static_cast<int>(k), pixels.get(), lit);
      if (exposures[k].spot) continue;
      if (begun) {
        several = several || share != exposures[k].light_share ||
                  std::memcmp(all.get(), pixels.get(), count) != 0;
      }
      share = exposures[k].light_share;
      begun = true;
      for (std::size_t i = 0; i < count; ++i) all[i] = std::max(all[i], pixels[i]);
    }
    take_image(index, static_cast<int>(n), all.get(), whole);
    adlers[n] = detail::adler_of({grid.width_px, 0, grid.width_px, grid.height_px, all.get()});
    const std::scoped_lock lock(mutex);
    index.lit = index.lit.united(whole.lit);
    exposure_index.lit = exposure_index.lit.united(lit.lit);
    sum += whole.sum;
    const auto layer = static_cast<int>(n);
    if (several && (several_layer < 0 || layer < several_layer)) several_layer = layer;
    if (lacking > most_lacking || (lacking > 0 && lacking == most_lacking && n < lacking_layer)) {
      most_lacking = lacking;
      lacking_layer = n;
    }
  });
  tell_lacking(most_lacking, lacking_layer, context);
  return adlers;
}

std::vector<std::uint32_t> StackReader::Impl::decode_images(const Container& archive,
                                                            const ExecutionContext& context) {
  if (!config.info.exposures.empty()) {
    for (const std::string& warning : config.warnings) context.tell(path + ": " + warning);
    return decode_exposures(archive, context);
  }
  if (config.codec) {
    for (const std::string& warning : config.warnings) context.tell(path + ": " + warning);
    return decode_layers(archive, context);
  }
  const auto slices = detail::entries_of(archive, config.images, config.info.grid);
  for (const std::string& warning : config.warnings) context.tell(path + ": " + warning);
  make_index(index, slices.size());
  std::vector<std::uint32_t> adlers(slices.size());
  parallel_for(context, "read", slices.size(), [&](std::size_t i) {
    std::vector<std::uint8_t> png;
    archive.read(*slices[i], slices[i]->bytes, png);
    const Decoded decoded = decode(index, static_cast<int>(i), png, slices[i]->name,
                                   config.packed_rgb, config.packed_bgr);
    adlers[i] = decoded.adler;
    const std::scoped_lock lock(mutex);
    index.lit = index.lit.united(decoded.lit);
    sum += decoded.sum;
  });
  return adlers;
}

/// Decodes a second set of images, which are plain grey, whatever the slices are. UV images follow
/// from the slices, and nothing is computed from them. But the printer shows them, so they are
/// checked and kept.
std::vector<std::uint32_t> StackReader::Impl::decode_grey(Index& into,
                                                          const std::vector<std::string>& names,
                                                          const Container& archive,
                                                          const std::string& stage,
                                                          const ExecutionContext& context) {
  const auto images = detail::entries_of(archive, names, config.info.grid);
  make_index(into, images.size());
  std::vector<std::uint32_t> adlers(images.size());
  parallel_for(context, stage, images.size(), [&](std::size_t i) {
    std::vector<std::uint8_t> png;
    archive.read(*images[i], images[i]->bytes, png);
    const Decoded decoded = decode(into, static_cast<int>(i), png, images[i]->name, false, false);
    adlers[i] = decoded.adler;
    const std::scoped_lock lock(mutex);
    into.lit = into.lit.united(decoded.lit);
  });
  return adlers;
}

}  // namespace slicecorr
