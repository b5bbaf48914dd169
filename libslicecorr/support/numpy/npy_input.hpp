// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Files of NumPy (.npy, format 1.0 to 3.0), read number by number.
#pragma once

#include <array>
#include <cstddef>
#include <fstream>
#include <string>
#include <vector>

namespace slicecorr::detail {

/// How a file of NumPy begins, before the version.
inline constexpr char kNpyMagic[] = "\x93NUMPY";

/// What the header says of the array.
struct NpyHeader {
  std::string type;
  bool fortran = false;
  std::vector<std::size_t> shape;
};

/// What an array may have at most along an axis, and in all.
struct NpyBounds {
  std::size_t along_axis, in_all;
};

/// A file up to its numbers, then these. All throws `InputError` naming file and place.
class NpyInput {
 public:
  explicit NpyInput(const std::string& path);

  const NpyHeader& header() const { return header_; }
  [[noreturn]] void wrong(const std::string& what) const;
  /// Its size along z, y and x, checked; two axes are one slice.
  std::array<int, 3> size(const NpyBounds& bounds) const;
  template <class T>
  void numbers(T* out, std::size_t count) {
    take(reinterpret_cast<char*>(out), count * sizeof(T));
  }
  /// Nothing must follow.
  void finish();

 private:
  void take(char* out, std::size_t size);

  std::string path_;
  std::ifstream file_;
  NpyHeader header_;
};

}  // namespace slicecorr::detail
