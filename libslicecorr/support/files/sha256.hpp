// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// SHA-256 of contents, as `sha256sum` says it.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

namespace slicecorr::cli {

/// For one thread. Throws `DeviceError` when the library has no SHA-256.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;
  void add(const void* data, std::size_t size);
  /// 64 hex digits; once, after all was added.
  std::string hex();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Throws `InputError` when the file can't be read.
std::string sha256_of_contents(const std::string& path);

}  // namespace slicecorr::cli
