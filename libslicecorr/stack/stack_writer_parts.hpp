// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file stack_writer_parts.hpp
/// What a `StackWriter` holds: the pieces that its encoders made, and how they become an archive.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/stack.hpp"
#include "stack/blob_store.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/layer_encoding.hpp"
#include "stack/png/png.hpp"

namespace slicecorr {

struct StackWriter::Impl {
  using Pieces = std::vector<BlobStore::Blob>;

  /// The piece of a band without light, by its number of rows.
  struct Black {
    std::vector<std::uint8_t> chunk;
    std::uint32_t adler = 1, grey_adler = 1;
  };

  Grid grid;
  ExecutionContext context;
  StackFile file;
  const detail::ArchiveFormat& format;
  std::unique_ptr<detail::Container> kept;  ///< the archive that is changed; null for a new one
  detail::ArchiveContents kept_contents;
  detail::PixelCode code;
  detail::LayerCodecPtr codec;  ///< of formats with a code of their own for layers
  std::unique_ptr<detail::ContainerOutput> output;
  BlobStore store;
  int rows = 0;  ///< of a band
  /// Pieces by slice; of size 0 where black, empty until a band is begun.
  std::vector<Pieces> bands, uv_bands;
  std::vector<Pieces> edge_bands;  ///< edge heights by node; empty where the archive keeps none
  /// Adler-32 of the pieces' grey rows, where the bytes in the PNG are not the grey values.
  std::vector<std::vector<std::uint32_t>> grey_adlers;
  std::optional<std::array<std::uint8_t, 256>> uv_of_pixel;
  UvRows uv_rows;    ///< counts over `uv_of_pixel`, whose first is that of black
  std::mutex mutex;  ///< of beginning a band

  Impl(const StackFile& f, const Grid& g, const ExecutionContext& j);
  void open_kept();

  int rows_of(std::size_t band) const {
    return std::min(rows, grid.height_px - static_cast<int>(band) * rows);
  }
  std::size_t raw_size(std::size_t band) const {
    return detail::raw_stride(grid.width_px) * static_cast<std::size_t>(rows_of(band));
  }
  void begin_band(std::size_t band);
  /// Pixels of `value`, rows with their filter bytes.
  std::vector<std::uint8_t> plain_band(std::size_t band, std::uint8_t value) const {
    std::vector<std::uint8_t> raw(raw_size(band), value);
    const std::size_t stride = detail::raw_stride(grid.width_px);
    for (std::size_t at = 0; at < raw.size(); at += stride) raw[at] = 0;
    return raw;
  }
  std::map<int, Black> make_black(std::uint8_t value, const detail::PixelCode& pixels) const;
  /// Checksums of all slices of one set of images, which are then added to the archive.
  struct Images {
    const std::vector<Pieces>& bands;
    detail::PixelCode code;
    std::map<int, Black> black;
    std::vector<std::uint32_t> adlers;       ///< of the PNGs' bytes
    std::vector<std::uint32_t> grey_adlers;  ///< of grey rows: what stands for the image
    std::vector<std::uint64_t> sizes;
    Pieces small;  ///< data of each slice as one chunk, where files are to be small
    bool lit(std::size_t band, std::size_t slice) const {
      return !bands[band].empty() && bands[band][slice].size != 0;
    }
  };
  Images gather(const std::vector<Pieces>& from, std::uint8_t background, std::size_t layers,
                const detail::PixelCode& pixels) const;
  void make_small(Images& images);
  void add_images(const std::vector<std::string>& names, const Images& images);
  std::string stem() const;
  /// Whether the exposures of what is written are others than those of the kept archive.
  bool changes_exposures(const StackInfo& info) const;
  bool changes_light(const StackInfo& info) const;
  void check_layers(const StackInfo& info) const;
  void write_archive(const StackInfo& info, const GreyImage& preview);
  void read_pixels(std::size_t slice, std::uint8_t* pixels) const;
  void write_coded(const StackInfo& info, const GreyImage& preview);
  void add_coded(const std::vector<std::string>& names, const detail::EncodedLayers& coded);
  void check_rewritten(const std::string& written, const StackInfo& info) const;
};

}  // namespace slicecorr
