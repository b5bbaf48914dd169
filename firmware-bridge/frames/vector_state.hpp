// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What assembly code leaves behind in vector registers.
#pragma once

namespace slicecorr::detail {

/// ISA-L's checksums and packer return with the upper halves of vector registers in use. The
/// processor then has to keep them through each SSE instruction of this thread, which makes loops
/// four times as slow (`tests/bench/bridge_frames.cpp`: 0.16 and 0.64 ms to pack a frame), until
/// somebody clears them.
inline void clear_vector_state() {
#if defined(__x86_64__) || defined(__i386__)
  static const bool has_them = __builtin_cpu_supports("avx");
  if (has_them) asm volatile("vzeroupper" ::: "memory");
#endif
}

}  // namespace slicecorr::detail
