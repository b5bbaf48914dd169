// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <span>
#include <stdexcept>

#include "base/run_length.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/stack.hpp"
#include "stack/blob_store.hpp"
#include "stack/block_check.hpp"
#include "stack/container/binary_file.hpp"
#include "stack/flat_field_entry.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack/layer_places.hpp"
#include "stack/png/png.hpp"
#include "stack/recording_entry.hpp"

namespace slicecorr {

namespace detail {

ArchiveContents read_contents(const Container& archive) {
  const ArchiveFormat& format = recognise_format(archive);
  ArchiveContents contents = read_with_places(format, archive);
  contents.info.format = format.name();
  if (archive.has(kProvenanceEntry)) {
    if (contents.info.kind != StackKind::foreign) {
      throw InputError(archive.path(), kProvenanceEntry,
                       "is a second record beside that of the archive; expected one of them");
    }
    const std::uint64_t limit = (std::uint64_t{64} << 20) + 256 * archive.entries().size();
    read_provenance(archive.text(kProvenanceEntry, limit), archive.path(), contents);
  }
  read_flat_field(archive, contents);
  read_recording(archive, contents);
  StackInfo& info = contents.info;
  if (contents.codec) {
    contents.facts.emplace_back("grey levels", std::to_string(levels_of(contents.codec->shown())));
    if (binary_file(archive).record_is_of_another()) {
      contents.warnings.push_back("the record beside it, " + record_beside(archive.path()) +
                                  ", is of another file: it does not count");
    }
  }
  // Some formats can say mirroring only: the orientation is known where they say that.
  if (info.orientation != Orientation{}) info.orientation_known = true;
  // Archives of other programs are made for a display.
  if (info.kind == StackKind::foreign) {
    info.for_display = true;
  } else if (!info.for_display) {
    info.orientation_known = true;
  }
  check_block(contents, archive.path());
  if (info.process && info.kind != StackKind::target) {
    // The process says them, exactly.
    info.light_share.clear();
    info.layer_heights_um.clear();
  } else {
    check_lit(info, archive.path());
  }
  const Grid& grid = info.grid;
  const std::size_t images =
      contents.codec ? contents.places.size() / static_cast<std::size_t>(contents.codec->pieces())
                     : contents.images.size();
  if (grid.layers < 1 || grid.width_px < 1 || grid.height_px < 1 ||
      images != (info.exposures.empty() ? static_cast<std::size_t>(grid.layers)
                                        : info.exposures.size())) {
    throw Error("a format's reader gave no whole stack");
  }
  return contents;
}

}  // namespace detail

namespace {

using detail::ArchiveContents;
using detail::Container;

constexpr std::size_t kReaderMemory = std::size_t{128} << 20;

/// Entries of images that are not absurdly large.
std::vector<const Container::Entry*> entries_of(const Container& archive,
                                                const std::vector<std::string>& names,
                                                const Grid& grid) {
  // Twice the largest PNG pixel, 4 channels of 16 bits, and some for chunks that don't matter.
  const std::uint64_t limit = std::uint64_t{8} * static_cast<unsigned>(grid.width_px) *
                                  static_cast<unsigned>(grid.height_px) +
                              (1 << 20);
  std::vector<const Container::Entry*> entries;
  entries.reserve(names.size());
  for (const std::string& name : names) {
    const Container::Entry* const entry = archive.find(name);
    if (entry == nullptr) throw InputError(archive.path(), name, "is missing");
    if (entry->bytes > limit) {
      throw InputError(archive.path(), name,
                       "declares " + std::to_string(entry->bytes) + " bytes, expected at most " +
                           std::to_string(limit));
    }
    entries.push_back(entry);
  }
  return entries;
}

std::vector<std::string> others_of(const Container& archive, const ArchiveContents& contents) {
  std::vector<std::string> images = contents.images, others;
  images.insert(images.end(), contents.uv_images.begin(), contents.uv_images.end());
  images.insert(images.end(), contents.edge_images.begin(), contents.edge_images.end());
  std::sort(images.begin(), images.end());
  for (const Container::Entry& entry : archive.entries()) {
    if (!std::binary_search(images.begin(), images.end(), entry.name)) others.push_back(entry.name);
  }
  return others;
}

void take_missing(StackInfo& info, const MissingFacts& missing, const std::string& path) {
  Grid& grid = info.grid;
  const auto take = [&](double& size_um, double given_um, const char* what) {
    if (size_um > 0) return;
    if (!(given_um > 0)) {
      throw InputError(path, "", std::string("does not say how ") + what);
    }
    size_um = given_um;
  };
  take(grid.pixel_x_um, missing.pixel_x_um, "large its pixels are; expected a printer that does");
  take(grid.pixel_y_um, missing.pixel_y_um, "large its pixels are; expected a printer that does");
  take(grid.layer_um, missing.layer_um,
       "high its layers are; expected the layer height to be given");
}

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

/// A blob in the store is: first and last column + 1 (32 bits each), then the run-length code of
/// these columns in all rows of the band.
struct StackReader::Impl {
  std::string path;
  ArchiveContents config;
  std::vector<std::string> others;
  BlobStore store;
  int rows = 0;   ///< of a band
  int bands = 0;  ///< of an image
  /// A set of images: a blob per band and image, band by band; of size 0 where it is black.
  struct Index {
    /// Zeroed memory of the system, so that black bands take none.
    std::unique_ptr<BlobStore::Blob[], decltype(&std::free)> blobs{nullptr, &std::free};
    int images = 0;
    PixelBox lit;  ///< no pixel outside is lit in any image
  };
  Index index, uv_index, edge_index;
  Index exposure_index;    ///< all images, where layers have several; else empty
  int several_layer = -1;  ///< see `several_images_layer`
  bool images_changed = false, uv_images_changed = false, edge_heights_changed = false;
  std::unique_ptr<const EdgeHeights> edge_heights;
  std::uint64_t sum = 0;
  std::mutex mutex;  ///< of what images add up to

  Impl(const std::string& p, const std::string& folder, const ExecutionContext& context)
      : path(p), store(folder, kReaderMemory, context) {}

  BlobStore::Blob& blob(const Index& of, int band, int slice) const {
    return of.blobs[static_cast<std::size_t>(band) * static_cast<std::size_t>(of.images) +
                    static_cast<std::size_t>(slice)];
  }

  void make_index(Index& made, std::size_t images) {
    const Grid& grid = config.info.grid;
    rows = band_rows(grid);
    bands = (grid.height_px + rows - 1) / rows;
    void* const memory =
        std::calloc(static_cast<std::size_t>(bands) * images, sizeof(BlobStore::Blob));
    if (memory == nullptr) throw InputError(path, "", "has more slices than the memory can hold");
    made.blobs.reset(static_cast<BlobStore::Blob*>(memory));
    made.images = static_cast<int>(images);
  }

  struct Decoded {
    std::uint32_t adler = 1;  ///< stands for the image
    PixelBox lit;
    std::uint64_t sum = 0;
  };
  Decoded decode(const Index& into, int slice, std::span<const std::uint8_t> png,
                 const std::string& name, bool packed_rgb, bool packed_bgr);
  std::vector<std::uint32_t> decode_images(const Container& archive,
                                           const ExecutionContext& context);
  /// Makes blobs of bands of whole rows, for one image.
  struct BandTaker {
    Impl& stack;
    const Index& into;
    int slice;
    Decoded& decoded;
    std::vector<std::uint8_t> pixels{}, code{};
    void take(int y0, int y1, const std::uint8_t* first_row, std::size_t stride);
  };
  std::vector<std::uint32_t> decode_layers(const detail::BinaryFile& file,
                                           const ExecutionContext& context);
  /// The pixels of an image; returns how many of them its code lacks.
  std::size_t pixels_of(const Container& archive, std::size_t image, std::uint8_t* pixels) const;
  void take_image(const Index& into, int image, const std::uint8_t* pixels, Decoded& decoded);
  std::vector<std::uint32_t> decode_exposures(const Container& archive,
                                              const ExecutionContext& context);
  void tell_lacking(std::size_t pixels, std::size_t layer, const ExecutionContext& context) const;
  std::vector<std::uint32_t> decode_grey(Index& into, const std::vector<std::string>& names,
                                         const Container& archive, const std::string& stage,
                                         const ExecutionContext& context);
  void read_band(const Index& of, const PixelBox& box, const Sink& sink) const;
  void read_image(const Index& of, int slice, std::uint8_t* out) const;
  void copy_blob(const BlobStore::Blob& blob, const PixelBox& band, const PixelBox& box,
                 std::vector<std::uint8_t>& code, std::vector<std::uint8_t>& pixels,
                 std::uint8_t* out) const;
};

/// The edge heights of the stack that it belongs to.
class StackReader::EdgeHeights final : public SliceSource {
 public:
  explicit EdgeHeights(const Impl& stack) : stack_(stack), grid_(stack.config.info.grid) {
    ++grid_.layers;
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return stack_.edge_index.lit; }
  ImageFrame frame() const override { return image_frame(stack_.config.info); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    stack_.read_band(stack_.edge_index, band, sink);
  }

 private:
  const Impl& stack_;
  Grid grid_;
};

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

/// Decodes the layers of a binary file. What stands for the images is only found where the file says
/// what it was.
std::vector<std::uint32_t> StackReader::Impl::decode_layers(const detail::BinaryFile& file,
                                                            const ExecutionContext& context) {
  const Grid& grid = config.info.grid;
  const auto layers = static_cast<std::size_t>(grid.layers);
  const auto pieces = static_cast<std::size_t>(config.codec->pieces());
  make_index(index, layers);
  std::vector<std::uint32_t> adlers(layers);
  std::size_t most_lacking = 0, lacking_layer = 0;
  const auto width = static_cast<std::size_t>(grid.width_px);
  parallel_for(context, "read", layers, [&](std::size_t n) {
    std::vector<std::vector<std::uint8_t>> code(pieces);
    for (std::size_t p = 0; p < pieces; ++p) {
      const ArchiveContents::Place& place = config.places[n * pieces + p];
      file.read_at(place.offset, place.size, code[p], "layer " + std::to_string(n));
    }
    const auto pixels = std::make_unique_for_overwrite<std::uint8_t[]>(config.codec->pixel_count());
    const std::size_t lacking =
        config.codec->decode(code, pixels.get(), {path, static_cast<int>(n)});
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
  if (config.codec) {
    const auto pieces = static_cast<std::size_t>(config.codec->pieces());
    std::vector<std::vector<std::uint8_t>> code(pieces);
    for (std::size_t p = 0; p < pieces; ++p) {
      const ArchiveContents::Place& place = config.places[image * pieces + p];
      detail::binary_file(archive).read_at(place.offset, place.size, code[p],
                                           "layer " + std::to_string(image));
    }
    return config.codec->decode(code, pixels, {path, static_cast<int>(image)});
  }
  const std::string& name = config.images[image];
  const auto entry = entries_of(archive, {name}, grid);
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
    return decode_layers(detail::binary_file(archive), context);
  }
  const auto slices = entries_of(archive, config.images, config.info.grid);
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
  const auto images = entries_of(archive, names, config.info.grid);
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

/// Copies what the blob of `band` has of `box` to `out`, which holds the rows of `box`.
void StackReader::Impl::copy_blob(const BlobStore::Blob& blob, const PixelBox& band,
                                  const PixelBox& box, std::vector<std::uint8_t>& code,
                                  std::vector<std::uint8_t>& pixels, std::uint8_t* out) const {
  code.clear();
  store.get(blob, code);
  std::int32_t columns[2];
  std::memcpy(columns, code.data(), sizeof columns);
  const auto stride = static_cast<std::size_t>(columns[1] - columns[0]);
  pixels.resize(stride * static_cast<std::size_t>(band.height()));
  detail::run_length_decode(code.data() + sizeof columns, code.data() + code.size(), pixels.data(),
                            pixels.size());
  const int x0 = std::max(columns[0], box.x0), x1 = std::min(columns[1], box.x1);
  if (x0 >= x1) return;
  for (int y = std::max(band.y0, box.y0); y < std::min(band.y1, box.y1); ++y) {
    std::memcpy(out + static_cast<std::size_t>(y - box.y0) * static_cast<std::size_t>(box.width()) +
                    (x0 - box.x0),
                pixels.data() + static_cast<std::size_t>(y - band.y0) * stride + (x0 - columns[0]),
                static_cast<std::size_t>(x1 - x0));
  }
}

StackReader::StackReader(const std::string& path, const std::string& scratch_folder,
                         const ExecutionContext& context, const MissingFacts& missing)
    : impl_(std::make_unique<Impl>(path, scratch_folder, context)) {
  Impl& s = *impl_;
  const std::unique_ptr<Container> archive = detail::open_container(path, scratch_folder, context);
  s.config = detail::read_contents(*archive);
  take_missing(s.config.info, missing, path);
  s.others = others_of(*archive, s.config);
  const std::vector<std::uint32_t> adlers = s.decode_images(*archive, context);
  s.images_changed =
      s.config.images_crc32 && *s.config.images_crc32 != detail::images_crc32(adlers);
  if (s.images_changed) context.tell(path + ": images were changed after the stack was made");
  if (!s.config.uv_images.empty()) {
    s.uv_images_changed = s.config.uv_images_crc32 !=
                          detail::images_crc32(s.decode_grey(s.uv_index, s.config.uv_images,
                                                             *archive, "read UV", context));
    if (s.uv_images_changed) {
      context.tell(path + ": UV images were changed after the stack was made");
    }
  }
  if (!s.config.edge_images.empty()) {
    s.edge_heights_changed = s.config.edge_images_crc32 !=
                             detail::images_crc32(s.decode_grey(s.edge_index, s.config.edge_images,
                                                                *archive, "read edges", context));
    if (s.edge_heights_changed) {
      context.tell(path + ": edge heights were changed after the stack was made");
    }
    s.edge_heights = std::make_unique<const EdgeHeights>(s);
  }
}

StackReader::~StackReader() = default;

const StackInfo& StackReader::info() const { return impl_->config.info; }
const Grid& StackReader::grid() const { return impl_->config.info.grid; }
PixelBox StackReader::bounds() const { return impl_->index.lit; }
const Recording* StackReader::recording() const { return impl_->config.info.recording.get(); }
ImageFrame StackReader::frame() const { return image_frame(impl_->config.info); }
ImageFrame image_frame(const StackInfo& info) {
  ImageFrame frame;
  if (info.for_display) frame.to_display = Turn{};
  frame.orientation.reset();
  if (info.orientation_known) frame.orientation = info.orientation;
  return frame;
}
const std::vector<std::string>& StackReader::other_entries() const { return impl_->others; }
std::uint64_t StackReader::pixel_sum() const { return impl_->sum; }
bool StackReader::has_uv_images() const { return !impl_->config.uv_images.empty(); }
bool StackReader::has_checksums() const { return impl_->config.images_crc32.has_value(); }
bool StackReader::images_changed() const { return impl_->images_changed; }
bool StackReader::uv_images_changed() const { return impl_->uv_images_changed; }
const SliceSource* StackReader::edge_heights() const { return impl_->edge_heights.get(); }
bool StackReader::edge_heights_changed() const { return impl_->edge_heights_changed; }

void StackReader::Impl::read_image(const Index& of, int slice, std::uint8_t* out) const {
  const Grid& grid = config.info.grid;
  if (slice < 0 || slice >= grid.layers) throw std::out_of_range("no such slice");
  const PixelBox all{0, 0, grid.width_px, grid.height_px};
  std::fill_n(out, static_cast<std::size_t>(grid.width_px) * static_cast<unsigned>(grid.height_px),
              std::uint8_t{0});
  std::vector<std::uint8_t> code, pixels;
  for (int band = 0; band < bands; ++band) {
    const BlobStore::Blob& its = blob(of, band, slice);
    if (its.size == 0) continue;
    const int y0 = band * rows;
    copy_blob(its, {0, y0, grid.width_px, std::min(grid.height_px, y0 + rows)}, all, code, pixels,
              out);
  }
}

/// All images of layers that are exposed more than once, as what was shown of each layer.
class StackReader::Exposures final : public SliceSource {
 public:
  Exposures(const Impl& stack, double m) : stack_(stack), grid_(stack.config.info.grid) {
    const StackInfo& info = stack.config.info;
    grid_.layers = static_cast<int>(info.exposures.size());
    std::vector<Recording::Showing> shown;
    for (std::size_t k = 0; k < info.exposures.size(); ++k) {
      const LayerExposure& e = info.exposures[k];
      const SliceLight layer = detail::light_of_layer(info, e.layer);
      const double planned = layer.time_s * std::pow(layer.share, m);
      Recording::Showing showing;
      showing.image = static_cast<int>(k);
      showing.light = planned > 0 ? e.time_s * std::pow(e.light_share, m) / planned : 0;
      showing.blue_share = e.light_share;
      shown.push_back(showing);
      if (k + 1 < info.exposures.size() && info.exposures[k + 1].layer == e.layer) continue;
      recording_.add_slice(shown);
      shown.clear();
    }
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return stack_.exposure_index.lit; }
  ImageFrame frame() const override { return image_frame(stack_.config.info); }
  const Recording* recording() const override { return &recording_; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    stack_.read_band(stack_.exposure_index, band, sink);
  }

 private:
  const Impl& stack_;
  Grid grid_;
  Recording recording_;
};

std::unique_ptr<const SliceSource> StackReader::exposures(double m) const {
  if (impl_->config.info.exposures.empty()) return nullptr;
  return std::make_unique<const Exposures>(*impl_, m);
}

int StackReader::several_images_layer() const { return impl_->several_layer; }

void StackReader::read_slice(int slice, std::uint8_t* pixels) const {
  impl_->read_image(impl_->index, slice, pixels);
}

void StackReader::read_uv_slice(int slice, std::uint8_t* pixels) const {
  if (!has_uv_images()) throw std::logic_error("the stack has no UV images");
  impl_->read_image(impl_->uv_index, slice, pixels);
}

void StackReader::read_band(const PixelBox& band, const Sink& sink) const {
  if (impl_->several_layer >= 0) {
    throw InputError(
        impl_->path, fmt::format("layer {}", impl_->several_layer),
        "is exposed more than once, with images or light that differ, as in a test of exposures: what it "
        "prints is predicted (verify and probe with an own target), but it is no part to be corrected or "
        "converted");
  }
  impl_->read_band(impl_->index, band, sink);
}

void StackReader::Impl::read_band(const Index& of, const PixelBox& box, const Sink& sink) const {
  const Grid& grid = config.info.grid;
  if (box.x0 < 0 || box.y0 < 0 || box.x1 > grid.width_px || box.y1 > grid.height_px) {
    throw std::out_of_range("band reaches over the image");
  }
  const int first = box.empty() ? 0 : box.y0 / rows;
  const int last = box.empty() ? 0 : (box.y1 + rows - 1) / rows;
  std::vector<std::uint8_t> code, pixels;
  std::vector<std::uint8_t> out(static_cast<std::size_t>(box.width()) *
                                static_cast<std::size_t>(box.height()));
  for (int slice = 0; slice < of.images; ++slice) {
    bool lit = false;
    for (int band = first; band < last; ++band) {
      const BlobStore::Blob& blob = this->blob(of, band, slice);
      if (blob.size == 0) continue;
      if (!lit) std::fill(out.begin(), out.end(), std::uint8_t{0});
      lit = true;
      const int y0 = band * rows;
      const PixelBox its_rows{0, y0, grid.width_px, std::min(grid.height_px, y0 + rows)};
      copy_blob(blob, its_rows, box, code, pixels, out.data());
    }
    sink(slice, lit ? out.data() : nullptr);
  }
}

std::vector<std::pair<std::string, std::string>> print_file_facts(const std::string& path) {
  if (detail::container_kind(path) != detail::ContainerKind::binary) return {};
  return detail::read_contents(detail::BinaryFile(path)).facts;
}

StackInfo StackReader::read_info(const std::string& path) {
  const std::string scratch = std::filesystem::temp_directory_path().string();
  const std::unique_ptr<Container> archive = detail::open_container(path, scratch);
  ArchiveContents contents = detail::read_contents(*archive);
  entries_of(*archive, contents.images, contents.info.grid);
  entries_of(*archive, contents.uv_images, contents.info.grid);
  entries_of(*archive, contents.edge_images, contents.info.grid);
  return std::move(contents.info);
}

}  // namespace slicecorr
