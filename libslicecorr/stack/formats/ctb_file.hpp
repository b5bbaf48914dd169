// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file ctb_file.hpp
/// The tables of CTB, cbddlp and photon files, which are of one family (docs/print-files.md).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "stack/formats/binary_block.hpp"

namespace slicecorr::detail {

enum class CtbFamily { ctb, photon, phz, fdg };

/// Where the numbers of a head stand. 0: the head has none.
struct CtbFields {
  std::size_t bed_mm, total_mm, layer_mm, exposure_s, bottom_exposure_s, light_off_s;
  std::size_t bottom_layers, bottom_layers_again;
  std::size_t resolution, large_preview, small_preview, table, count, print_time_s, projector;
  std::size_t light, key, machine_name;
  std::size_t head_bytes;
};
const CtbFields& ctb_fields(CtbFamily family);

/// What a file is by its first four bytes.
inline constexpr std::uint32_t kPhotonMagic = 0x12fd0019, kCtbMagic = 0x12fd0086,
                               kCtb4Magic = 0x12fd0106, kCtbGkTwoMagic = 0xff220810,
                               kPhzMagic = 0x9fda83ae, kFdgMagic = 0xbd3c7ac8;
inline constexpr std::uint64_t kCtbRecordBytes = 0x24, kCtbLayerHeadBytes = 0x54;
inline constexpr std::uint64_t kCtbHeadBytes = 0x70, kPhoton1HeadBytes = 0x6c, kPhzHeadBytes = 0xd8;
inline constexpr std::uint64_t kCtbPrintBytes = 0x3c, kCtbSlicerBytes = 0x4c, kCtb4Bytes = 464;

struct CtbPreview {
  BinaryBlock head;  ///< 32 bytes
  std::uint64_t data_offset = 0, data_bytes = 0;
};

struct CtbFile {
  CtbFamily family = CtbFamily::ctb;
  CtbFields fields{};
  std::uint32_t version = 0;
  std::uint32_t width_px = 0, height_px = 0, layers = 0, sets = 1, key = 0;
  SetOrder set_order = SetOrder::most_lit_first;
  BinaryBlock head;
  std::vector<CtbPreview> previews;
  std::optional<BinaryBlock> print, slicer, v4, resin;
  BinaryBlock table;  ///< sets * layers records, set by set
  struct Layer {
    std::uint64_t offset = 0, bytes = 0;  ///< of the code
    std::uint64_t head_bytes = 0;  ///< of what stands before it: a copy of the record and more
  };
  std::vector<Layer> records;      ///< as in the table
  std::vector<BinaryBlock> heads;  ///< of version 3 on, of each record
  std::string machine, resin_name;

  std::size_t record(std::size_t layer, std::size_t set) const { return set * layers + layer; }
  bool has_layer_flag() const { return slicer && slicer->u8(0x27) != 0; }
  /// Whether the file says if printers heed settings of single layers, and they do not.
  bool goes_by_head() const { return family == CtbFamily::ctb && slicer && !has_layer_flag(); }
};

/// Previews of CTB's kind, whose offsets stand at `offsets` of a head, the large one's first; their spans are
/// added. Throws `InputError`.
std::vector<CtbPreview> read_ctb_previews(const BinaryFile& file, const BinaryBlock& head,
                                          const std::array<std::size_t, 2>& offsets,
                                          std::vector<NamedSpan>& spans);

/// Throws `InputError` on anything damaged, or that reaches out of the file or over something else.
CtbFile read_ctb(const BinaryFile& file, CtbFamily family);

/// Previews of CTB's kind: words of RGB565, of which the lowest bit of green says that a count of more
/// of the same follows.
std::vector<std::uint8_t> encode_ctb_preview(const GreyImage& preview, int width_px, int height_px);
/// The picture of such code; what the code does not reach stays black.
GreyImage decode_ctb_preview(const BinaryFile& file, const CtbPreview& preview);

/// Another version of a file with what a request says: `change_ctb` in place, `write_new_ctb` anew.
void change_ctb(const ArchiveRequest& request, CtbFamily family, BinaryOutput& output);
void write_new_ctb(const ArchiveRequest& request, BinaryOutput& output);

}  // namespace slicecorr::detail
