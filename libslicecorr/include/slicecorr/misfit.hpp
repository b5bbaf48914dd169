// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file misfit.hpp
/// What `resolve_setup` throws where a setting has no place in a print as the other settings have it: who
/// says settings for many prints at once can leave that one out of this print.
///
/// A plain value; functions are thread-safe.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "slicecorr/error.hpp"

namespace slicecorr {

/// A setting is of the other mode of exposure, changes nothing, or says again what another one says.
class MisfitError : public InputError {
 public:
  /// `settings`: names as in `settings()`, of which one is too many.
  MisfitError(std::vector<std::string> settings, const std::string& message)
      : InputError(message), settings_(std::move(settings)) {}
  const std::vector<std::string>& settings() const { return settings_; }

 private:
  std::vector<std::string> settings_;
};

}  // namespace slicecorr
