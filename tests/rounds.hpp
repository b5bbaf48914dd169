// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file rounds.hpp
/// How many rounds a random test does. Its seed is fixed, so the first rounds are the same every
/// time; at night there are more of them.
#pragma once

#include <algorithm>
#include <cstdlib>

namespace slicecorr::test {

/// `by_day`, times SLICECORR_TEST_ROUNDS where that is set to a number above 1.
inline int rounds(int by_day) {
  const char* text = std::getenv("SLICECORR_TEST_ROUNDS");
  return by_day * std::max(1, text ? std::atoi(text) : 1);
}

/// Whether all of what the day takes a part of is to run.
inline bool by_night() { return rounds(1) > 1; }

}  // namespace slicecorr::test
