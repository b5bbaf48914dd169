// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file memory_limit.hpp
/// Whether programs that this one runs can be bound in their memory.
#pragma once

namespace slicecorr {

/// Sanitizers map far more for themselves than any job takes.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kLimitsMemory = false;
#else
inline constexpr bool kLimitsMemory = true;
#endif

}  // namespace slicecorr
