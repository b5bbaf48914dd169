// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file title.hpp
/// Reports in the cache belong to a key, not to a job: their title is filled in on delivery.
#pragma once

#include <string>

namespace slicecorr::farm::detail {

/// Stands in a report where its title goes; nothing else on a page reads like this.
inline std::string title_stand_in(const std::string& key) {
  return "slicefarm-title-" + key.substr(0, 24);
}

}  // namespace slicecorr::farm::detail
