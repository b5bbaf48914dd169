// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The keys of either kind of file, each in a table of its own.
#pragma once

#include <span>

#include "slicecorr/definition_keys.hpp"

namespace slicecorr::detail {

std::span<const KeyRule> resin_keys();
std::span<const KeyRule> printer_keys();

}  // namespace slicecorr::detail
