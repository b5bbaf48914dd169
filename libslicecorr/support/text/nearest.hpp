// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// For messages about words that are not known.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace slicecorr {

/// The known word that is most like `word`; empty when none is near.
std::string nearest(std::string_view word, std::span<const std::string_view> known);

}  // namespace slicecorr
