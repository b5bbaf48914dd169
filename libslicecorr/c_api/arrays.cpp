// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "c_api/arrays.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "c_api/guard.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::c_api {

namespace {

std::size_t bytes_of(std::int32_t type) {
  return type == SLICECORR_UINT8 ? 1 : type == SLICECORR_FLOAT32 ? 4 : 8;
}

/// Numbers may lie anywhere, aligned or not.
template <class T>
T load(const char* place) {
  T value;
  std::memcpy(&value, place, sizeof value);
  return value;
}
template <class T>
void store(char* place, T value) {
  std::memcpy(place, &value, sizeof value);
}

/// All bits of the exponent are set: infinite, or no number.
bool odd(float value) { return (~std::bit_cast<std::uint32_t>(value) & 0x7f800000U) == 0; }

/// Columns that are turned before the next slices: both sides of them stay in the nearest cache.
constexpr std::size_t kTile = 64;
/// Slices and columns that are turned at once, in registers.
constexpr std::size_t kQuad = 4;

// Vectors of the compiler (GCC, Clang): every processor has them.
using Four = float __attribute__((vector_size(16)));
using FourBits = std::uint32_t __attribute__((vector_size(16)));

Four load_four(const float* from) {
  Four four;
  std::memcpy(&four, from, sizeof four);
  return four;
}
/// All bits where a number is odd, else none.
FourBits odd(Four four) {
  constexpr FourBits kExponent = {0x7f800000U, 0x7f800000U, 0x7f800000U, 0x7f800000U};
  return FourBits((std::bit_cast<FourBits>(four) & kExponent) == kExponent);
}

/// Four numbers from each of four places to four other places: rows become columns. Sets bits of
/// `wrong` where a number is odd. Steps are numbers from one place to the next.
void turn_quad(const float* from, std::ptrdiff_t from_step, float* to, std::ptrdiff_t to_step,
               FourBits& wrong) {
  const Four a = load_four(from), b = load_four(from + from_step),
             c = load_four(from + 2 * from_step), d = load_four(from + 3 * from_step);
  wrong |= odd(a) | odd(b) | odd(c) | odd(d);
  const Four ab = __builtin_shufflevector(a, b, 0, 4, 1, 5),
             cd = __builtin_shufflevector(c, d, 0, 4, 1, 5),
             ab2 = __builtin_shufflevector(a, b, 2, 6, 3, 7),
             cd2 = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  const Four rows[] = {
      __builtin_shufflevector(ab, cd, 0, 1, 4, 5), __builtin_shufflevector(ab, cd, 2, 3, 6, 7),
      __builtin_shufflevector(ab2, cd2, 0, 1, 4, 5), __builtin_shufflevector(ab2, cd2, 2, 3, 6, 7)};
  for (int i = 0; i < 4; ++i) std::memcpy(to + i * to_step, &rows[i], sizeof rows[i]);
}

/// Calls quad(lane, column) for four of both at a time, and single(lane, column) for those that are
/// left over, or all without `quads`. Tile by tile.
template <class Quad, class Single>
void for_each_tile(std::size_t columns, std::size_t lanes, bool quads, const Quad& quad,
                   const Single& single) {
  for (std::size_t begin = 0; begin < columns; begin += kTile) {
    const std::size_t end = std::min(begin + kTile, columns);
    std::size_t lane = 0;
    for (; quads && lane + kQuad <= lanes; lane += kQuad) {
      std::size_t k = begin;
      for (; k + kQuad <= end; k += kQuad) quad(lane, k);
      for (; k < end; ++k) {
        for (std::size_t l = lane; l < lane + kQuad; ++l) single(l, k);
      }
    }
    for (; lane < lanes; ++lane) {
      for (std::size_t k = begin; k < end; ++k) single(lane, k);
    }
  }
}

}  // namespace

ArrayView::ArrayView(const slicecorr_array* given, const char* name, Elements elements,
                     bool written)
    : a_(need(given, name)), name_(name) {
  check_struct(*given, "slicecorr_array");
  if (a_.reserved != 0) {
    throw BadCall(name_ + ".reserved is " + std::to_string(a_.reserved) + "; expected 0");
  }
  const bool fits = elements == Elements::bytes
                        ? a_.type == SLICECORR_UINT8
                        : a_.type == SLICECORR_FLOAT32 || a_.type == SLICECORR_FLOAT64;
  if (!fits) {
    throw BadCall(fmt::format("{}.type is {}; expected {}", name_, a_.type,
                              elements == Elements::bytes
                                  ? "SLICECORR_UINT8"
                                  : "SLICECORR_FLOAT32 or SLICECORR_FLOAT64"));
  }
  if (!a_.data) throw BadCall(name_ + ".data is NULL");
  for (const std::size_t n : a_.shape) {
    if (n >= 1 && n <= static_cast<std::size_t>(std::numeric_limits<int>::max())) continue;
    throw InputError(fmt::format("{} has {} x {} x {} numbers; expected at least 1 along each axis",
                                 name_, a_.shape[0], a_.shape[1], a_.shape[2]));
  }
  if (!written) return;
  // From the shortest stride to the longest, each must pass all that lies below it.
  std::array<std::pair<std::size_t, std::size_t>, 3> axes;
  for (std::size_t i = 0; i < 3; ++i) {
    axes[i] = {static_cast<std::size_t>(std::abs(a_.strides[i])), a_.shape[i]};
  }
  std::sort(axes.begin(), axes.end());
  std::size_t below = bytes_of(a_.type);
  for (const auto& [stride, count] : axes) {
    if (count == 1) continue;
    if (stride < below) {
      throw BadCall(name_ + " is to be written, but its numbers share memory");
    }
    below += stride * (count - 1);
  }
}

void ArrayView::need_shape(const Shape& expected, const char* axes) const {
  if (std::equal(expected.begin(), expected.end(), a_.shape)) return;
  throw InputError(fmt::format("{} has the shape ({}, {}, {}); expected ({}, {}, {}): {}", name_,
                               a_.shape[0], a_.shape[1], a_.shape[2], expected[0], expected[1],
                               expected[2], axes));
}

char* ArrayView::at(std::size_t i, std::size_t j) const {
  return static_cast<char*>(a_.data) + static_cast<std::ptrdiff_t>(i) * a_.strides[0] +
         static_cast<std::ptrdiff_t>(j) * a_.strides[1];
}

double ArrayView::number(std::size_t i, std::size_t j, std::size_t k) const {
  const char* const place = at(i, j) + static_cast<std::ptrdiff_t>(k) * a_.strides[2];
  return a_.type == SLICECORR_FLOAT32 ? load<float>(place) : load<double>(place);
}

void ArrayView::not_finite(std::size_t first, int used) const {
  for (std::size_t i = first; i < first + static_cast<std::size_t>(used); ++i) {
    for (std::size_t j = 0; j < a_.shape[1]; ++j) {
      for (std::size_t k = 0; k < a_.shape[2]; ++k) {
        const double value = number(i, j, k);
        if (!odd(static_cast<float>(value))) continue;
        throw InputError(
            fmt::format("{}[{}, {}, {}] is {}; expected finite numbers of single "
                        "precision",
                        name_, i, j, k, value));
      }
    }
  }
  throw InputError(name_ + " has changed while it was read");
}

bool ArrayView::has_quads() const {
  const auto aligned = [](auto number) {
    return number % static_cast<std::ptrdiff_t>(sizeof(float)) == 0;
  };
  return a_.type == SLICECORR_FLOAT32 && a_.strides[2] == sizeof(float) && aligned(a_.strides[0]) &&
         aligned(a_.strides[1]) && aligned(reinterpret_cast<std::intptr_t>(a_.data));
}

template <class T>
void ArrayView::read_as(std::size_t first, int used, int lanes, float* to) const {
  const std::size_t columns = a_.shape[2];
  const auto lane_count = static_cast<std::size_t>(lanes), filled = static_cast<std::size_t>(used);
  const auto slice_step = a_.strides[0] / static_cast<std::ptrdiff_t>(sizeof(float));
  unsigned wrong = 0;
  FourBits wrong_bits = {};
  for (std::size_t row = 0; row < a_.shape[1]; ++row, to += columns * lane_count) {
    const char* const from = at(first, row);
    for_each_tile(
        columns, filled, has_quads(),
        [&](std::size_t lane, std::size_t k) {
          const auto* const place = reinterpret_cast<const float*>(
              from + static_cast<std::ptrdiff_t>(lane) * a_.strides[0]);
          turn_quad(place + k, slice_step, to + k * lane_count + lane, lanes, wrong_bits);
        },
        [&](std::size_t lane, std::size_t k) {
          const auto value =
              static_cast<float>(load<T>(from + static_cast<std::ptrdiff_t>(lane) * a_.strides[0] +
                                         static_cast<std::ptrdiff_t>(k) * a_.strides[2]));
          wrong |= static_cast<unsigned>(odd(value));
          to[k * lane_count + lane] = value;
        });
    for (std::size_t k = 0; filled < lane_count && k < columns; ++k) {
      std::fill(to + k * lane_count + filled, to + (k + 1) * lane_count, 0.0F);
    }
  }
  for (int i = 0; i < 4; ++i) wrong |= wrong_bits[i];
  if (wrong != 0) not_finite(first, used);
}

template <class T>
void ArrayView::write_as(std::size_t first, int used, int lanes, const float* from) const {
  const std::size_t columns = a_.shape[2];
  const auto lane_count = static_cast<std::size_t>(lanes), filled = static_cast<std::size_t>(used);
  const auto slice_step = a_.strides[0] / static_cast<std::ptrdiff_t>(sizeof(float));
  FourBits ignored = {};
  for (std::size_t row = 0; row < a_.shape[1]; ++row, from += columns * lane_count) {
    char* const to = at(first, row);
    for_each_tile(
        columns, filled, has_quads(),
        [&](std::size_t lane, std::size_t k) {
          auto* const place =
              reinterpret_cast<float*>(to + static_cast<std::ptrdiff_t>(lane) * a_.strides[0]);
          turn_quad(from + k * lane_count + lane, lanes, place + k, slice_step, ignored);
        },
        [&](std::size_t lane, std::size_t k) {
          store(to + static_cast<std::ptrdiff_t>(lane) * a_.strides[0] +
                    static_cast<std::ptrdiff_t>(k) * a_.strides[2],
                static_cast<T>(from[k * lane_count + lane]));
        });
  }
}

void ArrayView::read(std::size_t first, int used, int lanes, float* to) const {
  if (a_.type == SLICECORR_FLOAT32) {
    read_as<float>(first, used, lanes, to);
  } else {
    read_as<double>(first, used, lanes, to);
  }
}

void ArrayView::write(std::size_t first, int used, int lanes, const float* from) const {
  if (a_.type == SLICECORR_FLOAT32) {
    write_as<float>(first, used, lanes, from);
  } else {
    write_as<double>(first, used, lanes, from);
  }
}

tomo::Box<std::uint8_t> ArrayView::bytes() const {
  const auto [n0, n1, n2] = a_.shape;
  for (const std::size_t n : a_.shape) {
    if (n > static_cast<std::size_t>(tomo::kMostAlongAxis) || n0 * n1 > tomo::kMostInBox / n2) {
      throw InputError(
          fmt::format("{} has {} x {} x {} voxels; expected at most {} along an axis and {} in all",
                      name_, n0, n1, n2, tomo::kMostAlongAxis, tomo::kMostInBox));
    }
  }
  tomo::Box<std::uint8_t> box{static_cast<int>(n0), static_cast<int>(n1), static_cast<int>(n2), {}};
  box.values.resize(n0 * n1 * n2);
  std::uint8_t* to = box.values.data();
  for (std::size_t i = 0; i < n0; ++i) {
    for (std::size_t j = 0; j < n1; ++j) {
      const char* from = at(i, j);
      for (std::size_t k = 0; k < n2; ++k, from += a_.strides[2]) *to++ = load<std::uint8_t>(from);
    }
  }
  return box;
}

template <class T, class Number>
void ArrayView::write_rows(std::size_t slice, const Number* from) const {
  for (std::size_t row = 0; row < a_.shape[1]; ++row) {
    char* to = at(slice, row);
    for (std::size_t k = 0; k < a_.shape[2]; ++k, to += a_.strides[2]) {
      store(to, static_cast<T>(*from++));
    }
  }
}

void ArrayView::write_slice(std::size_t slice, const std::uint8_t* from) const {
  write_rows<std::uint8_t>(slice, from);
}

void ArrayView::write_slice(std::size_t slice, const float* from) const {
  if (a_.type == SLICECORR_FLOAT32) {
    write_rows<float>(slice, from);
  } else {
    write_rows<double>(slice, from);
  }
}

}  // namespace slicecorr::c_api
