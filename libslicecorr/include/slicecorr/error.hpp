// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file error.hpp
/// The exceptions of the library. Nothing in the library prints, exits or aborts: it throws one of
/// these. Every message says what happened, where (file and place) and what was expected instead.
/// Plain values, thread-safe as such are. Memory that is not to be had is `std::bad_alloc`.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace slicecorr {

/// Base of all errors of the library.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An input that can't be read or does not fit: wrong usage, a damaged file, a value out of range.
class InputError : public Error {
 public:
  using Error::Error;
  /// `file` and `place` (line, key, entry; may be empty) come first in the message.
  InputError(const std::string& file, const std::string& place, const std::string& message)
      : Error(file + (place.empty() ? "" : ": " + place) + ": " + message) {}
};

/// The physics does not allow it. The message says what would make it feasible.
class InfeasibleError : public Error {
 public:
  using Error::Error;
};

/// A file system or device failed: disk full, output folder gone.
class DeviceError : public Error {
 public:
  using Error::Error;
};

/// The caller asked to stop (`ExecutionContext::cancel`). Nothing half-made is left behind.
class Cancelled : public Error {
 public:
  Cancelled() : Error("cancelled") {}
};

}  // namespace slicecorr
