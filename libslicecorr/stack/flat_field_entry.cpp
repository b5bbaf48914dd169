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
  if (!info.printer) return;
  if (info.printer->flat_field) {
    output.add(kFlatFieldEntry, flat_field_png(*info.printer->flat_field));
  }
  if (info.printer->uv_flat_field) {
    output.add(kUvFlatFieldEntry, flat_field_png(*info.printer->uv_flat_field));
  }
}

namespace {

void set_field(FlatField& field, std::optional<std::uint32_t> crc32, const Printer& printer,
               const std::vector<std::uint8_t>& png, const std::string& source,
               const std::string& place) {
  check_flat_field(field, printer, source + ": " + place);
  GreyImage image = decode_png(png, field.width_px, field.height_px, source, place);
  field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(image.pixels));
  if (flat_field_crc32(field) != crc32 || field.greatest() == 0) {
    throw InputError(source, place, "is not the flat-field that the stack was corrected with");
  }
}

std::vector<std::uint8_t> read_field(const Container& archive, const FlatField& field,
                                     const char* place) {
  const Container::Entry* const entry = archive.find(place);
  if (entry == nullptr) throw InputError(archive.path(), place, "is missing");
  const std::uint64_t limit = 2 * std::uint64_t{static_cast<unsigned>(field.width_px)} *
                                  static_cast<unsigned>(field.height_px) +
                              (1 << 20);
  std::vector<std::uint8_t> png;
  archive.read(*entry, limit, png);
  return png;
}

}  // namespace

void set_flat_field(ArchiveContents& contents, const std::vector<std::uint8_t>& png,
                    const std::string& source, const std::string& place) {
  Printer& printer = *contents.info.printer;
  set_field(*printer.flat_field, contents.flat_field_crc32, printer, png, source, place);
}

void set_uv_flat_field(ArchiveContents& contents, const std::vector<std::uint8_t>& png,
                       const std::string& source, const std::string& place) {
  Printer& printer = *contents.info.printer;
  set_field(*printer.uv_flat_field, contents.uv_flat_field_crc32, printer, png, source, place);
  if (printer.uv_flat_field->least() == 0) {
    throw InputError(source, place, "is black somewhere; expected UV light at all places");
  }
}

void read_flat_field(const Container& archive, ArchiveContents& contents) {
  if (!contents.info.printer) return;
  if (contents.info.printer->flat_field) {
    const auto png = read_field(archive, *contents.info.printer->flat_field, kFlatFieldEntry);
    set_flat_field(contents, png, archive.path(), kFlatFieldEntry);
  }
  if (contents.info.printer->uv_flat_field) {
    const auto png = read_field(archive, *contents.info.printer->uv_flat_field, kUvFlatFieldEntry);
    set_uv_flat_field(contents, png, archive.path(), kUvFlatFieldEntry);
  }
}

}  // namespace slicecorr::detail
