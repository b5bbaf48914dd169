// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tar_fixture.hpp
/// tar.gz archives made and taken apart byte by byte, past the library and libarchive.
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "stack_fixture.hpp"

namespace slicecorr::test {

struct TarEntry {
  std::string name;
  Bytes data = {};
  char type = '0';
  int mode = 0644, uid = 0, gid = 0;
  long mtime = 0;
  std::string user = {}, group = {}, link = {};
  bool operator==(const TarEntry&) const = default;
};

/// One header of 512 bytes (POSIX ustar) and the contents, filled up to 512 bytes.
inline Bytes tar_blocks(const TarEntry& entry) {
  char header[512] = {};
  const auto text = [&](int at, std::size_t most, const std::string& value) {
    EXPECT_LE(value.size(), most);
    std::memcpy(header + at, value.data(), std::min(most, value.size()));
  };
  const auto octal = [&](int at, int digits, long value) {
    std::snprintf(header + at, static_cast<std::size_t>(digits) + 1, "%0*lo", digits,
                  static_cast<unsigned long>(value));
  };
  text(0, 100, entry.name);
  octal(100, 7, entry.mode);
  octal(108, 7, entry.uid);
  octal(116, 7, entry.gid);
  octal(124, 11, static_cast<long>(entry.data.size()));
  octal(136, 11, entry.mtime);
  std::memset(header + 148, ' ', 8);
  header[156] = entry.type;
  text(157, 100, entry.link);
  std::memcpy(header + 257, "ustar\00000", 8);
  text(265, 31, entry.user);
  text(297, 31, entry.group);
  unsigned sum = 0;
  for (const char c : header) sum += static_cast<unsigned char>(c);
  std::snprintf(header + 148, 8, "%06o", sum);
  Bytes bytes(sizeof header + (entry.data.size() + 511) / 512 * 512);
  std::copy(header, header + sizeof header, bytes.begin());
  std::copy(entry.data.begin(), entry.data.end(), bytes.begin() + sizeof header);
  return bytes;
}

inline Bytes make_tar(const std::vector<TarEntry>& entries) {
  Bytes tar;
  for (const TarEntry& entry : entries) {
    const Bytes blocks = tar_blocks(entry);
    tar.insert(tar.end(), blocks.begin(), blocks.end());
  }
  tar.resize(tar.size() + 1024);
  return tar;
}

inline Bytes gzip(const Bytes& bytes, int level = 6) {
  z_stream z{};
  EXPECT_EQ(deflateInit2(&z, level, Z_DEFLATED, 31, 8, Z_DEFAULT_STRATEGY), Z_OK);
  Bytes out(deflateBound(&z, bytes.size()) + 64);
  z.next_in = const_cast<Bytef*>(bytes.data());
  z.avail_in = static_cast<uInt>(bytes.size());
  z.next_out = out.data();
  z.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(deflate(&z, Z_FINISH), Z_STREAM_END);
  out.resize(z.total_out);
  deflateEnd(&z);
  return out;
}

inline Bytes gunzip(const Bytes& bytes) {
  z_stream z{};
  EXPECT_EQ(inflateInit2(&z, 31), Z_OK);
  Bytes out, block(1 << 20);
  z.next_in = const_cast<Bytef*>(bytes.data());
  z.avail_in = static_cast<uInt>(bytes.size());
  int result = Z_OK;
  while (result == Z_OK) {
    z.next_out = block.data();
    z.avail_out = static_cast<uInt>(block.size());
    result = inflate(&z, Z_NO_FLUSH);
    out.insert(out.end(), block.data(), z.next_out);
  }
  EXPECT_EQ(result, Z_STREAM_END);
  EXPECT_EQ(z.avail_in, 0u);
  inflateEnd(&z);
  return out;
}

/// Only what plain ustar headers say; anything else fails the test, but for the headers of the
/// first tar when `old` ones are expected.
inline std::vector<TarEntry> parse_tar(const Bytes& tar, bool old = false) {
  std::vector<TarEntry> entries;
  std::size_t at = 0;
  while (at + 512 <= tar.size() && tar[at] != 0) {
    const char* const header = reinterpret_cast<const char*>(&tar[at]);
    const auto text = [&](int from, std::size_t most) {
      return std::string(header + from, strnlen(header + from, most));
    };
    const auto octal = [&](int from, std::size_t most) {
      return std::strtol(text(from, most).c_str(), nullptr, 8);
    };
    EXPECT_EQ(text(257, 6), old ? "" : "ustar");
    EXPECT_EQ(text(345, 155), "");
    TarEntry entry;
    entry.name = text(0, 100);
    entry.mode = static_cast<int>(octal(100, 8)) & 07777;
    entry.uid = static_cast<int>(octal(108, 8));
    entry.gid = static_cast<int>(octal(116, 8));
    entry.mtime = octal(136, 12);
    entry.type = header[156];
    entry.link = text(157, 100);
    if (!old) entry.user = text(265, 32);
    if (!old) entry.group = text(297, 32);
    const auto size = static_cast<std::size_t>(octal(124, 12));
    at += 512;
    if (at + size > tar.size()) {
      ADD_FAILURE() << entry.name << " reaches over the end";
      return entries;
    }
    entry.data.assign(tar.begin() + static_cast<std::ptrdiff_t>(at),
                      tar.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += (size + 511) / 512 * 512;
    entries.push_back(std::move(entry));
  }
  EXPECT_GE(tar.size(), at + 1024) << "the two blocks of zeros at the end are missing";
  for (; at < tar.size(); ++at) EXPECT_EQ(tar[at], 0) << at;
  return entries;
}

inline std::vector<TarEntry> read_tar_gz(const std::string& path) {
  return parse_tar(gunzip(read_file(path)));
}

inline void make_tar_gz(const std::string& path, const std::vector<TarEntry>& entries) {
  write_file(path, gzip(make_tar(entries)));
}

}  // namespace slicecorr::test
