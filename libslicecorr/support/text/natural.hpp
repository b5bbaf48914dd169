// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The order in which people count: "frame2" before "frame10".
#pragma once

#include <string_view>

namespace slicecorr {

/// Below 0 where `a` comes first, above 0 where `b` does: runs of digits by their number, other
/// bytes as they are. 0 for names that differ in zeros before numbers alone, or not at all.
int natural_order(std::string_view a, std::string_view b);

}  // namespace slicecorr
