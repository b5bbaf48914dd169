// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file errno_message.hpp
/// Messages of failed system calls.
#pragma once

#include <cerrno>
#include <string>
#include <system_error>

namespace slicecorr::detail {

/// "PATH: WHAT: text of errno"; call it before anything else can change errno.
inline std::string errno_message(const std::string& path, const std::string& what,
                                 int error = errno) {
  return path + ": " + what + ": " + std::generic_category().message(error);
}

}  // namespace slicecorr::detail
