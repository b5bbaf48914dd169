// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_errors.hpp
/// What a call that is to find faults of a submission says of them.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "slicecorr/farm/submit.hpp"

namespace slicecorr::test {

/// Place and message of each; empty where there are none.
inline std::vector<std::string> errors_of(const std::function<void()>& action) {
  std::vector<std::string> list;
  try {
    action();
  } catch (const farm::SubmitErrors& e) {
    for (const farm::SubmitError& one : e.errors()) list.push_back(one.where + ": " + one.message);
  }
  return list;
}

}  // namespace slicecorr::test
