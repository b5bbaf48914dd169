// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The keys of definition files, in the order in which documents list them.
#pragma once

#include <span>

#include "database/schema.hpp"

namespace slicecorr::resins {

std::span<const KeyRule> resin_rules();
std::span<const KeyRule> printer_rules();

}  // namespace slicecorr::resins
