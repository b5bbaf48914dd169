// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file layer_encoding.hpp
/// Layers in the code of a print file, made on all threads before the file is written.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "stack/blob_store.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

/// Coded layers, kept in a store that must live as long.
struct EncodedLayers {
  std::vector<BlobStore::Blob> pieces;
  std::vector<std::uint32_t>
      adlers;          ///< Adler-32 of each image as it comes back, see `images_crc32`
  CodedLayers layers;  ///< without `append`
  std::vector<std::uint8_t> as_kept;  ///< of each piece, 1 where it has the kept one's bytes
  std::uint64_t rounded_pixels = 0;   ///< whose grey values the file can't hold
};

/// Writes the pixels of a slice, row by row. Called from several threads.
using ReadPixels = std::function<void(std::size_t slice, std::uint8_t* pixels)>;

/// Codes `count` slices. A layer that shows what the same layer of `kept` shows keeps its code,
/// whoever made that; `kept` may be null. Without `with_adlers`, `adlers` are all 0.
EncodedLayers encode_layers(const LayerCodec& codec, const Grid& grid, std::size_t count,
                            const ReadPixels& read_pixels, const Container* kept,
                            const ArchiveContents& kept_contents, bool with_adlers,
                            BlobStore& store, const ExecutionContext& context);

}  // namespace slicecorr::detail
