// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file why_no_answer.hpp
/// What is said of a request that got no answer.
#pragma once

#include <fcntl.h>
#include <httplib.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

namespace slicecorr::http {

/// The library calls a process that may open no more files one without a connection: that is said as the system does.
inline std::string why_no_answer(httplib::Error error) {
  const int file = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  if (file < 0) return std::generic_category().message(errno);
  ::close(file);
  return httplib::to_string(error);
}

}  // namespace slicecorr::http
