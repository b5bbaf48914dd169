// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file zip_layout.hpp
/// The records of a zip archive (APPNOTE 6.3.3, sections 4.3 to 4.5), ZIP64 where numbers need it.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace slicecorr::detail {

/// An entry as both of its records tell of it.
struct ZipEntry {
  std::string name;  ///< UTF-8, at most 65,535 bytes
  std::uint64_t bytes = 0, packed_bytes = 0;
  std::uint64_t offset = 0;  ///< of its local record in the file
  std::uint32_t crc32 = 0;   ///< of its contents
  bool deflated = false;     ///< else stored
};

/// Appends the record in front of the entry's data.
void append_local_record(const ZipEntry& entry, std::vector<std::uint8_t>& out);
std::uint64_t local_record_bytes(const ZipEntry& entry);

/// What follows the last entry's data: the directory, which begins `offset` bytes into the file,
/// and the end of the archive.
std::vector<std::uint8_t> zip_directory(std::span<const ZipEntry> entries, std::uint64_t offset);

}  // namespace slicecorr::detail
