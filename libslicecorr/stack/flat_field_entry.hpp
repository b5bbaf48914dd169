// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flat_field_entry.hpp
/// The picture of a printer's flat-field in the archives of stacks that were corrected with it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr::detail {

inline constexpr const char* kFlatFieldEntry = "slicecorr/flat-field.png";
/// That of the UV lamp.
inline constexpr const char* kUvFlatFieldEntry = "slicecorr/uv-flat-field.png";

/// CRC-32 of the values, row by row.
std::uint32_t flat_field_crc32(const FlatField& field);
/// The values of the flat-field as a grey PNG.
std::vector<std::uint8_t> flat_field_png(const FlatField& field);
/// Adds the entries of the flat-fields that the stack's printer has.
void add_flat_field(const StackInfo& info, ContainerOutput& output);
/// Gives the flat-field that `contents` speaks of its picture. Throws `InputError` when it is not
/// the one of the block.
void set_flat_field(ArchiveContents& contents, const std::vector<std::uint8_t>& png,
                    const std::string& source, const std::string& place);
/// The same of the UV lamp's.
void set_uv_flat_field(ArchiveContents& contents, const std::vector<std::uint8_t>& png,
                       const std::string& source, const std::string& place);
/// Reads the pictures that our block speaks of. Throws `InputError` when one is missing, or not the
/// one of the block.
void read_flat_field(const Container& archive, ArchiveContents& contents);

}  // namespace slicecorr::detail
