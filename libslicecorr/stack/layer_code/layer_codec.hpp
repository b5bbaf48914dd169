// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file layer_codec.hpp
/// The layers of a binary print file: how grey pixels become coded bytes and back.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace slicecorr::detail {

/// What comes back of each grey value after it was coded.
using ShownGrey = std::array<std::uint8_t, 256>;
ShownGrey all_grey();
/// The values that a code of `levels` equal steps knows, rounded to the nearest.
ShownGrey grey_in_steps(int levels);
int levels_of(const ShownGrey& shown);

/// The longest run that a length of 28 bits tells.
inline constexpr std::size_t kMostIn28Bits = (std::size_t{1} << 28) - 1;

/// Where coded bytes come from, for messages.
struct LayerName {
  const std::string& file;
  int layer = 0;  ///< from 0
  /// Throws `InputError` naming file and layer.
  [[noreturn]] void fail(const std::string& what) const;
};

/// The code of the layers of one file. A layer is one or several *pieces* of bytes, each with a place
/// of its own in the file. Stateless once made; thread-safe.
class LayerCodec {
 public:
  virtual ~LayerCodec() = default;
  LayerCodec(int width_px, int height_px, const ShownGrey& shown)
      : width_px_(width_px), height_px_(height_px), shown_(shown) {}
  std::size_t pixel_count() const {
    return static_cast<std::size_t>(width_px_) * static_cast<std::size_t>(height_px_);
  }
  const ShownGrey& shown() const { return shown_; }
  /// Pieces of a layer, 1 or more.
  virtual int pieces() const { return 1; }
  /// Decodes a layer into `pixel_count()` bytes, row by row. Returns how many pixels the code lacks at
  /// the end, which are black; more than a row, and everything else that is wrong, throws
  /// `InputError`.
  virtual std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces,
                             std::uint8_t* pixels, const LayerName& name) const = 0;
  /// Replaces `pieces` by the code of pixels whose values are all among `shown()`.
  virtual void encode(int layer, const std::uint8_t* pixels,
                      std::vector<std::vector<std::uint8_t>>& pieces) const = 0;

 protected:
  int width_px_, height_px_;
  ShownGrey shown_;
};

/// Pixels that are filled run by run, never beyond their end.
class PixelFill {
 public:
  PixelFill(std::uint8_t* pixels, std::size_t count, const LayerName& name)
      : pixels_(pixels), count_(count), name_(name) {}
  void put(std::uint8_t value, std::size_t count);
  std::size_t room() const { return count_ - at_; }
  /// Fills what lacks with black, and returns how much it is; more than a row is refused.
  std::size_t finish(int width_px);

 private:
  std::uint8_t* pixels_;
  std::size_t count_, at_ = 0;
  const LayerName& name_;
};

/// Calls `take(pixel, count)` for each longest run of equal pixels; `pixel` is the first of them.
template <class Pixel, class Take>
void each_pixel_run(Pixel* pixels, std::size_t count, const Take& take);

/// The cipher of Chitubox and its kin: words of four bytes, lowest first, are changed by a sequence
/// that starts at `start` and goes on by `step`. The same call codes and decodes.
void apply_word_cipher(std::uint32_t start, std::uint32_t step, std::vector<std::uint8_t>& bytes);

}  // namespace slicecorr::detail

#include "base/run_end.hpp"

namespace slicecorr::detail {

template <class Pixel, class Take>
void each_pixel_run(Pixel* pixels, std::size_t count, const Take& take) {
  for (std::size_t i = 0; i < count;) {
    const std::size_t end = run_end(pixels, i, count);
    take(pixels[i], end - i);
    i = end;
  }
}

}  // namespace slicecorr::detail
