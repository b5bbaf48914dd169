// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/zip_layout.hpp"

#include <algorithm>
#include <stdexcept>

#include "support/text/utf8.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint64_t kMax16 = 0xffff, kMax32 = 0xffffffff;
constexpr std::uint64_t kVersionPlain = 10, kVersionDeflate = 20, kVersionZip64 = 45;
/// Made on Unix, after version 6.3 of the format.
constexpr std::uint64_t kMadeBy = 3 << 8 | 63;
constexpr std::uint64_t kOrdinaryFile = std::uint64_t{0100666} << 16;
constexpr std::uint64_t kFirstOf1980 = 1 << 5 | 1;
constexpr std::uint64_t kUtf8Name = 1 << 11;
constexpr std::uint64_t kZip64Tag = 1;

/// `count` bytes, lowest first.
void put(std::uint64_t value, int count, std::vector<std::uint8_t>& out) {
  for (int i = 0; i < count; ++i) out.push_back(static_cast<std::uint8_t>(value >> 8 * i));
}

/// A number in the place for it, or all ones, and then it is in the ZIP64 record.
std::uint64_t or_ones(std::uint64_t value, std::uint64_t ones) { return std::min(value, ones); }

bool is_large(const ZipEntry& entry) { return std::max(entry.bytes, entry.packed_bytes) >= kMax32; }

/// From the version needed to the CRC: the same in both records.
void put_head(const ZipEntry& entry, bool zip64, std::vector<std::uint8_t>& out) {
  const bool ascii = std::all_of(entry.name.begin(), entry.name.end(),
                                 [](char c) { return static_cast<unsigned char>(c) < 128; });
  put(zip64 ? kVersionZip64 : entry.deflated ? kVersionDeflate : kVersionPlain, 2, out);
  put(ascii || !is_utf8(entry.name) ? 0 : kUtf8Name, 2, out);
  put(entry.deflated ? 8 : 0, 2, out);
  put(0, 2, out);  // midnight
  put(kFirstOf1980, 2, out);
  put(entry.crc32, 4, out);
}

/// Sizes and the length of the name.
void put_sizes(const ZipEntry& entry, std::vector<std::uint8_t>& out) {
  if (entry.name.size() > kMax16) throw std::invalid_argument("the name of an entry is too long");
  put(is_large(entry) ? kMax32 : entry.packed_bytes, 4, out);
  put(is_large(entry) ? kMax32 : entry.bytes, 4, out);
  put(entry.name.size(), 2, out);
}

void put_directory_record(const ZipEntry& entry, std::vector<std::uint8_t>& out) {
  const bool large = is_large(entry), far = entry.offset >= kMax32;
  put(0x02014b50, 4, out);
  put(kMadeBy, 2, out);
  put_head(entry, large || far, out);
  put_sizes(entry, out);
  const std::uint64_t zip64_bytes = (large ? 16 : 0) + (far ? 8 : 0);
  put(zip64_bytes == 0 ? 0 : zip64_bytes + 4, 2, out);
  put(0, 2, out);  // no comment
  put(0, 2, out);  // on the first disk
  put(0, 2, out);  // not known to be text
  put(kOrdinaryFile, 4, out);
  put(or_ones(entry.offset, kMax32), 4, out);
  out.insert(out.end(), entry.name.begin(), entry.name.end());
  if (zip64_bytes == 0) return;
  put(kZip64Tag, 2, out);
  put(zip64_bytes, 2, out);
  if (large) {
    put(entry.bytes, 8, out);
    put(entry.packed_bytes, 8, out);
  }
  if (far) put(entry.offset, 8, out);
}

}  // namespace

void append_local_record(const ZipEntry& entry, std::vector<std::uint8_t>& out) {
  const bool large = is_large(entry);
  put(0x04034b50, 4, out);
  put_head(entry, large, out);
  put_sizes(entry, out);
  put(large ? 20 : 0, 2, out);
  out.insert(out.end(), entry.name.begin(), entry.name.end());
  if (!large) return;
  put(kZip64Tag, 2, out);
  put(16, 2, out);
  put(entry.bytes, 8, out);
  put(entry.packed_bytes, 8, out);
}

std::uint64_t local_record_bytes(const ZipEntry& entry) {
  return 30 + entry.name.size() + (is_large(entry) ? 20 : 0);
}

std::vector<std::uint8_t> zip_directory(std::span<const ZipEntry> entries, std::uint64_t offset) {
  std::vector<std::uint8_t> out;
  for (const ZipEntry& entry : entries) put_directory_record(entry, out);
  const std::uint64_t bytes = out.size(), count = entries.size();
  if (count >= kMax16 || bytes >= kMax32 || offset >= kMax32) {
    put(0x06064b50, 4, out);
    put(44, 8, out);  // bytes of this record that follow
    put(kVersionZip64, 2, out);
    put(kVersionZip64, 2, out);
    put(0, 4, out);
    put(0, 4, out);
    put(count, 8, out);
    put(count, 8, out);
    put(bytes, 8, out);
    put(offset, 8, out);
    put(0x07064b50, 4, out);  // where that record is
    put(0, 4, out);
    put(offset + bytes, 8, out);
    put(1, 4, out);
  }
  put(0x06054b50, 4, out);
  put(0, 2, out);
  put(0, 2, out);
  put(or_ones(count, kMax16), 2, out);
  put(or_ones(count, kMax16), 2, out);
  put(or_ones(bytes, kMax32), 4, out);
  put(or_ones(offset, kMax32), 4, out);
  put(0, 2, out);  // no comment
  return out;
}

}  // namespace slicecorr::detail
