// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file description.hpp
/// What the API says of itself.
#pragma once

#include <string>

namespace slicecorr::farm::detail {

/// openapi.json with the keys of jobs and studies, which are those of jobs files. Thread-safe.
const std::string& api_description();

}  // namespace slicecorr::farm::detail
