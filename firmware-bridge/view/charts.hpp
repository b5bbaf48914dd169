// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Pictures of a print, as SVG.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/bridge/view.hpp"

namespace slicecorr::bridge::detail {

struct Chart {
  std::string title, svg;
  std::string quiet{};  ///< where nothing happened that one would look for: what was, in words
};
/// Only those for which there is something to draw.
std::vector<Chart> charts_of(const PrintRecord& record);

/// The bounds as people read them: "0.05", "up to 0.1", "over 200".
std::vector<std::string> bound_names(const double* bounds, std::size_t count);

}  // namespace slicecorr::bridge::detail
