// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file run_end.hpp
/// Runs of equal bytes.
#pragma once

#include <cstddef>
#include <cstdint>

namespace slicecorr::detail {

/// End of the run of equal bytes that starts at `i`, below `n`.
std::size_t run_end(const std::uint8_t* data, std::size_t i, std::size_t n);

}  // namespace slicecorr::detail
