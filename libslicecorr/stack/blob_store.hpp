// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bytes that wait on a disk when they are too many for the memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"

namespace slicecorr {

/// Keeps compressed blobs of images between the steps that make and take them in different orders.
/// Holds up to a budget in memory, the rest in an unnamed scratch file in `folder`, which vanishes
/// with the process. Thread-safe. Throws `DeviceError`.
class BlobStore {
 public:
  struct Blob {
    std::uint64_t offset = 0;
    std::uint32_t size = 0;
    std::uint32_t adler = 1;  ///< Adler-32 of the blob's raw bytes, where the maker sets it
  };
  BlobStore(std::string folder, std::size_t memory_budget_bytes, const ExecutionContext& context);
  ~BlobStore();
  BlobStore(const BlobStore&) = delete;
  BlobStore& operator=(const BlobStore&) = delete;
  Blob put(const std::uint8_t* data, std::size_t size);
  /// Makes room of a blob for later ones. The blob must not be read any more.
  void drop(const Blob& blob);
  /// Appends the blob to `out`.
  void get(const Blob& blob, std::vector<std::uint8_t>& out) const;
  /// Length of the scratch file.
  std::uint64_t scratch_bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr
