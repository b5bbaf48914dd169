// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file cxdlp_sum.hpp
/// The checksum at the end of CXDLP files of versions 3 and 4, from its definition.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace slicecorr::test {

/// CRC-32, bit by bit: start 0, no inversion at the end.
inline std::uint32_t cxdlp_sum(const std::uint8_t* bytes, std::size_t count) {
  std::uint32_t crc = 0;
  for (std::size_t i = 0; i < count; ++i) {
    crc ^= bytes[i];
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
  }
  return crc;
}

/// Makes the checksum of changed bytes right, so that what else is in them is looked at.
inline void set_cxdlp_sum(std::uint8_t* bytes, std::size_t count) {
  if (count < 19 || std::memcmp(bytes + 4, "CXSW3DV2", 8) != 0 || bytes[14] < 3) return;
  const std::uint32_t crc = cxdlp_sum(bytes, count - 4);
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[count - 4 + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  }
}

}  // namespace slicecorr::test
