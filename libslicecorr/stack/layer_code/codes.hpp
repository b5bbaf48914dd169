// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file codes.hpp
/// The run-length codes of binary print files, one per file code_*.cpp (docs/print-files.md).
#pragma once

#include <memory>

#include "stack/layer_code/layer_codec.hpp"

namespace slicecorr::detail {

using LayerCodecPtr = std::shared_ptr<const LayerCodec>;

/// Chitubox CTB: values of 7 bits, lengths of 7 to 28 bits, and a cipher where `key` is not 0.
LayerCodecPtr ctb_code(int width_px, int height_px, std::uint32_t key);

/// cbddlp and photon: `sets` images of one bit; a pixel is as bright as sets light it. In one piece
/// each, or all in one, as Photon Workshop's PWS has them.
/// The set that most pixels are lit in comes first, or the one that fewest are lit in.
enum class SetOrder { most_lit_first, least_lit_first };
LayerCodecPtr bit_sets_code(int width_px, int height_px, int sets, bool in_one_piece,
                            SetOrder order = SetOrder::most_lit_first);
/// Lit pixels of one set by its code, whatever is wrong with it.
std::uint64_t lit_in_bit_set(const std::vector<std::uint8_t>& code);

/// PHZ and FDG: values of 7 bits of which 7C is the brightest, then how often they repeat.
enum class PhzCipher { phz, fdg };
LayerCodecPtr phz_code(int width_px, int height_px, std::uint32_t key, PhzCipher cipher);

/// Elegoo's GOO: all grey values, with a check byte.
LayerCodecPtr goo_code(int width_px, int height_px, bool sixteen_levels);

/// Photon Workshop's PW0: nibbles of grey and of length. `dark_codes` are what the file's own table
/// shows for the codes 1 to 15; see Photon Workshop in docs/print-files.md.
LayerCodecPtr pw0_code(int width_px, int height_px, bool two_levels);

/// Longer's LGS: nibbles of grey, and of length in as many as it takes.
LayerCodecPtr lgs_code(int width_px, int height_px);

/// Creality's CXDLP: vertical lines of one grey value each. A layer starts with its area, which stays.
LayerCodecPtr cxdlp_code(int width_px, int height_px);
/// CXDLP's lines in a layer's piece.
inline constexpr std::size_t kCxdlpLineBytes = 6;

}  // namespace slicecorr::detail
