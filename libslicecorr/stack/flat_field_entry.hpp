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

/// CRC-32 of the values, row by row.
std::uint32_t flat_field_crc32(const FlatField& field);
/// The values of the flat-field as a grey PNG.
std::vector<std::uint8_t> flat_field_png(const FlatField& field);
/// Adds the entry when the stack's printer has a flat-field.
void add_flat_field(const StackInfo& info, ContainerOutput& output);
/// Gives the flat-field that `contents` speaks of its picture. Throws `InputError` when it is not
/// the one of the block.
void set_flat_field(ArchiveContents& contents, const std::vector<std::uint8_t>& png,
                    const std::string& source, const std::string& place);
/// Reads the picture that our block speaks of. Throws `InputError` when it is missing, or not the
/// one of the block.
void read_flat_field(const Container& archive, ArchiveContents& contents);

}  // namespace slicecorr::detail
