// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The code of cbddlp and photon: a byte is a pixel in its top bit and a count of up to 7D. Grey is how
// many of N such images, the sets, light a pixel: the printer shows each for its share of the time.
#include <algorithm>

#include "slicecorr/error.hpp"
#include "stack/layer_code/codes.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kMostRun = 0x7d;

class BitSetsCode final : public LayerCodec {
 public:
  BitSetsCode(int width_px, int height_px, int sets, bool in_one_piece, SetOrder order)
      : LayerCodec(width_px, height_px, grey_in_steps(sets + 1)),
        sets_(sets),
        in_one_piece_(in_one_piece),
        order_(order) {
    for (int lit = 0; lit <= sets; ++lit) {
      grey_of_lit_.push_back(static_cast<std::uint8_t>((2 * lit * 255 + sets) / (2 * sets)));
    }
  }
  int pieces() const override { return in_one_piece_ ? 1 : sets_; }

  std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces, std::uint8_t* pixels,
                     const LayerName& name) const override {
    std::fill_n(pixels, pixel_count(), std::uint8_t{0});
    std::size_t lacking = 0;
    std::span<const std::uint8_t> code;
    for (int s = 0; s < sets_; ++s) {
      if (!in_one_piece_) {
        code = pieces[static_cast<std::size_t>(s)];
      } else if (s == 0) {
        code = pieces[0];
      }
      lacking = std::max(lacking, add_set(code, pixels, name));
      if (!in_one_piece_ && !code.empty()) name.fail("runs of pixels go beyond the image");
    }
    if (in_one_piece_ && !code.empty()) name.fail("runs of pixels go beyond the image");
    for (std::size_t i = 0; i < pixel_count(); ++i) pixels[i] = grey_of_lit_[pixels[i]];
    return lacking;
  }

  void encode(int, const std::uint8_t* pixels,
              std::vector<std::vector<std::uint8_t>>& pieces) const override {
    pieces.resize(static_cast<std::size_t>(this->pieces()));
    for (std::vector<std::uint8_t>& piece : pieces) piece.clear();
    for (int s = 0; s < sets_; ++s) {
      std::vector<std::uint8_t>& out = pieces[in_one_piece_ ? 0 : static_cast<std::size_t>(s)];
      const std::uint8_t least = grey_of_lit_[static_cast<std::size_t>(
          order_ == SetOrder::most_lit_first ? s + 1 : sets_ - s)];
      std::size_t waiting = 0;
      bool lit = false;
      each_pixel_run(pixels, pixel_count(), [&](std::uint8_t grey, std::size_t count) {
        const bool now = grey >= least;
        if (now != lit) {
          put(lit, waiting, out);
          waiting = 0;
          lit = now;
        }
        waiting += count;
      });
      put(lit, waiting, out);
    }
  }

 private:
  /// Counts the lit pixels of one set, and takes its bytes away from `code`.
  std::size_t add_set(std::span<const std::uint8_t>& code, std::uint8_t* pixels,
                      const LayerName& name) const {
    std::size_t at = 0, i = 0;
    const std::size_t count = pixel_count();
    for (; i < code.size() && at < count; ++i) {
      const std::size_t run = code[i] & 0x7f;
      if (run == 0) name.fail("a run has no pixels");
      if (run > count - at) name.fail("runs of pixels go beyond the image");
      if (code[i] & 0x80) {
        for (std::size_t k = at; k < at + run; ++k) ++pixels[k];
      }
      at += run;
    }
    code = code.subspan(i);
    if (count - at > static_cast<std::size_t>(width_px_)) {
      name.fail("its code ends after " + std::to_string(at) + " pixels, expected " +
                std::to_string(count));
    }
    return count - at;
  }
  static void put(bool lit, std::size_t count, std::vector<std::uint8_t>& out) {
    const std::uint8_t bit = lit ? 0x80 : 0;
    out.insert(out.end(), count / kMostRun, static_cast<std::uint8_t>(bit | kMostRun));
    if (count % kMostRun > 0) out.push_back(static_cast<std::uint8_t>(bit | count % kMostRun));
  }

  int sets_;
  bool in_one_piece_;
  SetOrder order_;
  std::vector<std::uint8_t> grey_of_lit_;
};

}  // namespace

std::uint64_t lit_in_bit_set(const std::vector<std::uint8_t>& code) {
  std::uint64_t lit = 0;
  for (const std::uint8_t byte : code) lit += byte & 0x80 ? byte & 0x7f : 0;
  return lit;
}

LayerCodecPtr bit_sets_code(int width_px, int height_px, int sets, bool in_one_piece,
                            SetOrder order) {
  return std::make_shared<BitSetsCode>(width_px, height_px, sets, in_one_piece, order);
}

}  // namespace slicecorr::detail
