// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file token.hpp
/// Names that nobody else draws: of attempts, services, uploads and batches of a cluster.
#pragma once

#include <string>

namespace slicecorr::farm {

/// 32 hex digits from the system's random source. Throws `DeviceError` when it gives none.
/// Thread-safe.
std::string random_token();

}  // namespace slicecorr::farm
