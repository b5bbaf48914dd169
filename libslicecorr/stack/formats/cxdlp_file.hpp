// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file cxdlp_file.hpp
/// What versions of CXDLP share, and version 4, whose tables are of CTB's kind (docs/print-files.md).
#pragma once

#include <string>

#include "stack/formats/binary_block.hpp"

namespace slicecorr::detail {

/// Throws `InputError` unless the checksum at `check_at` is that of all bytes before it: in version 2
/// their exclusive or, else a CRC-32. Version 1 has none.
void check_cxdlp_sum(const BinaryFile& file, int version, std::uint64_t check_at);
/// A span becomes the checksum of all that is written before it.
void fill_cxdlp_sum(FileChange& change, std::size_t span, int version, const BinaryOutput& output);

/// Version 4, from its head on, which starts at `head_at`, behind the model. Throws as
/// `ArchiveFormat::read`.
ArchiveContents read_cxdlp4(const BinaryFile& file, std::uint64_t head_at,
                            const std::string& model);
void change_cxdlp4(const ArchiveRequest& request, std::uint64_t head_at, BinaryOutput& output);

}  // namespace slicecorr::detail
