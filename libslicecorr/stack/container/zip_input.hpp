// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file zip_input.hpp
/// A zip archive opened for reading, distrusted.
#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "stack/container/container.hpp"

struct zip;

namespace slicecorr::detail {

/// Entries are inflated by ISA-L outside the lock of the zip handle.
class ZipInput final : public Container {
 public:
  explicit ZipInput(const std::string& path);
  ~ZipInput() override;
  void read(const Entry& entry, std::uint64_t limit, std::vector<std::uint8_t>& out) const override;

 private:
  /// What else the archive says of an entry, by its index.
  struct Packed {
    std::uint64_t bytes = 0;
    std::uint32_t crc = 0;
    std::uint16_t method = 0;
  };
  void list_entries(std::uint64_t archive_bytes);
  void read_packed(const Entry& entry, std::vector<std::uint8_t>& out) const;

  zip* zip_ = nullptr;
  mutable std::mutex mutex_;
  std::vector<Packed> packed_;
};

}  // namespace slicecorr::detail
