// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tar_reader.hpp
/// The entries of a tar.gz one after the other, distrusted.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

struct archive_entry;

namespace slicecorr::detail {

/// Reads the archive once, from its start to its end. Every function throws `InputError` when the
/// gzip or the tar is damaged or can't be read any more, when bytes follow one of them, and when an
/// entry is a link, a device or named to lie elsewhere. Not thread-safe.
class TarReader {
 public:
  explicit TarReader(const std::string& path);
  ~TarReader();
  TarReader(const TarReader&) = delete;
  TarReader& operator=(const TarReader&) = delete;

  /// Goes to the next file or folder; false when there is none, and all bytes have been checked.
  bool next();
  /// What stands before the contents; valid until `next`, and may be changed.
  archive_entry* header() const;
  bool is_folder() const;
  /// The entry's name, without "./" in front.
  const std::string& name() const;
  /// Bytes of the contents, as the header declares them.
  std::uint64_t bytes() const;
  /// The next bytes of the contents: as many as fit, fewer only at their end, where it is 0.
  std::size_t read(std::span<std::uint8_t> out);

  /// How much of the file has been read, 0 to 1.
  double fraction() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::detail
