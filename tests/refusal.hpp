// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a call that is to be refused says.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr::test {

inline std::string refusal(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  ADD_FAILURE() << "nothing was refused";
  return "";
}

}  // namespace slicecorr::test
