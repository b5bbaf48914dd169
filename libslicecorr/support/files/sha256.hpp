// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Hashes of contents, as `sha256sum` and `md5sum` say them.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

namespace slicecorr::cli {

/// For one thread. Throws `DeviceError` when the library does not have it.
class Hash {
 public:
  enum class Kind { sha256, md5 };
  explicit Hash(Kind kind);
  ~Hash();
  Hash(const Hash&) = delete;
  Hash& operator=(const Hash&) = delete;
  void add(const void* data, std::size_t size);
  /// 64 or 32 hex digits; once, after all was added.
  std::string hex();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

class Sha256 : public Hash {
 public:
  Sha256() : Hash(Kind::sha256) {}
};

/// Throws `InputError` when the file can't be read.
std::string sha256_of_contents(const std::string& path);

}  // namespace slicecorr::cli
