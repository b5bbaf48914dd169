// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Checks of a definition's text, by the keys that it may hold (definition_keys.hpp).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/definition_keys.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

/// As `validate_definition`, of a text that is to stand at `path`. `kind`: empty, or what it must
/// be.
std::vector<Finding> validate_text(const std::string& text, const std::string& path,
                                   std::string_view kind = "");

/// Lower case letters, digits, '-', '.', '_', beginning with a letter or digit; at most 100.
bool is_stable_name(std::string_view name);

/// A definition has at most so many bytes: a file beyond is something else.
inline constexpr std::size_t kMostDefinitionBytes = 4U << 20;

}  // namespace slicecorr::resins
