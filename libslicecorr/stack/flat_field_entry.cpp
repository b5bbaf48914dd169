// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/flat_field_entry.hpp"

#include <algorithm>

#include "slicecorr/error.hpp"
#include "stack/isa_l.hpp"

namespace slicecorr::detail {

std::uint32_t flat_field_crc32(const FlatField& field) {
  std::uint32_t crc = 0;
  constexpr std::size_t piece = std::size_t{1} << 30;
  for (std::size_t at = 0; at < field.values->size(); at += piece) {
    crc = isal::crc32(crc, field.values->data() + at, std::min(piece, field.values->size() - at));
  }
  return crc;
}

std::vector<std::uint8_t> flat_field_png(const FlatField& field) {
  return encode_png(GreyImage{field.width_px, field.height_px, *field.values});
}

void add_flat_field(const StackInfo& info, ContainerOutput& output) {
  if (!info.printer || !info.printer->flat_field) return;
  output.add(kFlatFieldEntry, flat_field_png(*info.printer->flat_field));
}

void set_flat_field(ArchiveContents& contents, const std::vector<std::uint8_t>& png,
                    const std::string& source, const std::string& place) {
  FlatField& field = *contents.info.printer->flat_field;
  check_flat_field(field, *contents.info.printer, source + ": " + place);
  GreyImage image = decode_png(png, field.width_px, field.height_px, source, place);
  field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(image.pixels));
  if (flat_field_crc32(field) != contents.flat_field_crc32 || field.greatest() == 0) {
    throw InputError(source, place, "is not the flat-field that the stack was corrected with");
  }
}

void read_flat_field(const Container& archive, ArchiveContents& contents) {
  if (!contents.info.printer || !contents.info.printer->flat_field) return;
  const FlatField& field = *contents.info.printer->flat_field;
  const Container::Entry* const entry = archive.find(kFlatFieldEntry);
  if (entry == nullptr) throw InputError(archive.path(), kFlatFieldEntry, "is missing");
  const std::uint64_t limit = 2 * std::uint64_t{static_cast<unsigned>(field.width_px)} *
                                  static_cast<unsigned>(field.height_px) +
                              (1 << 20);
  std::vector<std::uint8_t> png;
  archive.read(*entry, limit, png);
  set_flat_field(contents, png, archive.path(), kFlatFieldEntry);
}

}  // namespace slicecorr::detail
