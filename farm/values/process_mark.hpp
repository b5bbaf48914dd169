// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file process_mark.hpp
/// Which process a number stands for: numbers are given anew. Thread-safe.
#pragma once

#include <cstdint>
#include <string>

namespace slicecorr::farm::detail {

/// What tells a process from one with the same number before or after it, or elsewhere.
struct ProcessMark {
  long pid = 0;
  std::int64_t start = 0;  ///< clock ticks after the machine's start; 0: there is none
  std::string space;       ///< of process numbers: containers have their own
};
ProcessMark mark_of(long pid);

}  // namespace slicecorr::farm::detail
