// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file isa_l.hpp
/// ISA-L's functions as they are called here. Those of its own leave the upper halves of wide
/// registers in use, and until somebody clears them exp, erfc and other code of a processor's basic
/// set take twenty times as long on this thread.
#pragma once

#include <isa-l.h>

#include <cstddef>
#include <cstdint>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace slicecorr::isal {

#if defined(__x86_64__)
[[gnu::target("avx"), gnu::noinline]] inline void clear_upper_halves() { _mm256_zeroupper(); }
inline void leave_wide_registers() {
  if (__builtin_cpu_supports("avx")) clear_upper_halves();
}
#else
inline void leave_wide_registers() {}
#endif

/// Of gzip and PNG, going on from `crc`.
inline std::uint32_t crc32(std::uint32_t crc, const std::uint8_t* bytes, std::size_t size) {
  crc = ::crc32_gzip_refl(crc, bytes, size);
  leave_wide_registers();
  return crc;
}
inline int inflate(inflate_state* state) {
  const int result = ::isal_inflate(state);
  leave_wide_registers();
  return result;
}
inline int inflate_stateless(inflate_state* state) {
  const int result = ::isal_inflate_stateless(state);
  leave_wide_registers();
  return result;
}

}  // namespace slicecorr::isal
