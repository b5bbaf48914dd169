// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <string>

namespace slicecorr {

/// What ended some work, whatever was thrown.
struct Failure {
  enum class Kind {
    cancelled,
    input,
    infeasible,
    device,
    memory,  ///< none was to be had
    system,  ///< no threads, no open files to be had
    disk,    ///< a file system, told by the standard library
    defect,
  };
  Kind kind = Kind::defect;
  std::string text;  ///< for people
};

/// Of the exception that is being handled: inside `catch`.
Failure failure_at_hand();

}  // namespace slicecorr
