// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a stack reader holds: images as blobs of bands (stack_reader.cpp), and how they are decoded
/// (stack_reader_decode.cpp).
#pragma once

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "slicecorr/stack.hpp"
#include "stack/blob_store.hpp"
#include "stack/container/binary_file.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr {

namespace detail {

/// Entries of images that are not absurdly large.
std::vector<const Container::Entry*> entries_of(const Container& archive,
                                                const std::vector<std::string>& names,
                                                const Grid& grid);

}  // namespace detail

/// A blob in the store is: first and last column + 1 (32 bits each), then the run-length code of
/// these columns in all rows of the band.
struct StackReader::Impl {
  using ArchiveContents = detail::ArchiveContents;
  using Container = detail::Container;

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

  Impl(const std::string& p, const std::string& folder, const ExecutionContext& context);
  ~Impl();

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
  std::vector<std::uint32_t> decode_layers(const detail::Container& archive,
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

}  // namespace slicecorr
