// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file png_archive.hpp
/// Images for stacks that are kept for long: packed as small as possible, which takes time.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace slicecorr::detail {

/// Packs the chunks of one image, as `IdatEncoder` made them, once more and all together: by zlib
/// at its highest level and by `RunDeflater`, of which the smaller one is taken (zlib where
/// patterns are intricate, the other where the display is large). For one image, not thread-safe.
class SmallIdat {
 public:
  SmallIdat();
  ~SmallIdat();
  /// The next chunk, which has `raw_bytes` bytes in it.
  void add(std::span<const std::uint8_t> chunk, std::size_t raw_bytes);
  /// Appends an IDAT chunk with the whole zlib stream. `adler`: of all raw bytes.
  void finish(std::uint32_t adler, std::vector<std::uint8_t>& out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::detail
