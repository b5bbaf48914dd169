// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The wall between the C functions and the library: nothing that is thrown gets through it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

#include "slicecorr.h"

namespace slicecorr::c_api {

/// The calling program is wrong.
struct BadCall : std::runtime_error {
  using std::runtime_error::runtime_error;
};
struct UnknownName : std::runtime_error {
  using std::runtime_error::runtime_error;
};
/// A limit that the caller set is not kept.
struct Missed : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Text of the last failure in this thread.
std::string& thread_error() noexcept;
/// The code of the exception being handled; its text goes to the thread and to `own`, which may be
/// null.
slicecorr_status failed(std::string* own) noexcept;
slicecorr_status succeeded(std::string* own) noexcept;

/// Runs `body` and turns what it throws into a code and a text.
template <class Body>
slicecorr_status guarded(std::string* own, Body&& body) noexcept {
  try {
    std::forward<Body>(body)();
  } catch (...) {
    return failed(own);
  }
  return succeeded(own);
}

/// The text that a handle keeps, for `guarded`.
template <class Handle>
std::string* error_of(Handle* handle) noexcept {
  return handle ? &handle->error : nullptr;
}

/// `pointer`, which must not be null.
template <class T>
T& need(T* pointer, const char* what) {
  if (!pointer) throw BadCall(std::string(what) + " is NULL");
  return *pointer;
}

/// Where a new handle goes; null until there is one.
template <class T>
class Output {
 public:
  Output(T** place, const char* what) : place_(&need(place, what)) { *place_ = nullptr; }
  template <class Owner>
  void give(Owner&& owner) {
    *place_ = std::forward<Owner>(owner).release();
  }

 private:
  T** place_;
};

/// Sizes with which a struct may come: the first version's, or a later one's, even if unknown here.
void check_struct_size(std::size_t size, std::size_t first_version, const char* type);
/// That of a struct which the caller filled: one of a later version must say nothing there.
template <class Struct>
void check_struct(const Struct& given, const char* type) {
  check_struct_size(given.struct_size, sizeof(Struct), type);
  const char* const bytes = reinterpret_cast<const char*>(&given);
  if (std::any_of(bytes + sizeof(Struct), bytes + given.struct_size,
                  [](char byte) { return byte != 0; })) {
    throw BadCall(std::string(type) + " says something that this version of the library can't do");
  }
}

}  // namespace slicecorr::c_api
