// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Arrays in the caller's memory: checked once, then read and written with any strides.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "slicecorr.h"
#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::c_api {

/// What an array must hold.
enum class Elements { bytes, floats };

/// A checked array of three axes. Refers to the caller's memory.
class ArrayView {
 public:
  using Shape = std::array<std::size_t, 3>;

  /// Throws `BadCall` for NULL, a struct of no known size, a type that is not among `elements`, and for
  /// arrays to be `written` in which two numbers share memory.
  ArrayView(const slicecorr_array* given, const char* name, Elements elements, bool written);

  std::size_t size(int axis) const { return a_.shape[axis]; }
  /// Throws `InputError` saying both; `axes` names the three.
  void need_shape(const Shape& expected, const char* axes) const;

  /// Reads slices [first, first + used) to [row][column][lane]; lanes from `used` on become 0. Throws
  /// `InputError` naming a number that is not finite, or too large for single precision.
  void read(std::size_t first, int used, int lanes, float* to) const;
  /// The other way.
  void write(std::size_t first, int used, int lanes, const float* from) const;

  /// Reads bytes: all of them, in order.
  tomo::Box<std::uint8_t> bytes() const;
  /// Writes the bytes or, to an array of floats, the numbers of slice `slice`, in order.
  void write_slice(std::size_t slice, const std::uint8_t* from) const;
  void write_slice(std::size_t slice, const float* from) const;

 private:
  template <class T, class Number>
  void write_rows(std::size_t slice, const Number* from) const;
  /// Whether slices lie so that four numbers of four of them can be turned in registers.
  bool has_quads() const;
  template <class T>
  void read_as(std::size_t first, int used, int lanes, float* to) const;
  template <class T>
  void write_as(std::size_t first, int used, int lanes, const float* from) const;
  [[noreturn]] void not_finite(std::size_t first, int used) const;
  char* at(std::size_t i, std::size_t j) const;
  double number(std::size_t i, std::size_t j, std::size_t k) const;

  slicecorr_array a_;
  std::string name_;
};

}  // namespace slicecorr::c_api
