// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/npy.hpp
/// Volumes as files of NumPy (.npy, format 1.0 to 3.0).
///
/// Axes are (z, y, x), z upwards, x fastest. Plain functions, thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace slicecorr::tomo {

/// A box of numbers: [z][y][x].
template <class T>
struct Box {
  int nz = 0, ny = 0, nx = 0;  ///< >= 1
  std::vector<T> values;
  std::size_t at(int z, int y, int x) const {
    return (static_cast<std::size_t>(z) * static_cast<std::size_t>(ny) +
            static_cast<std::size_t>(y)) *
               static_cast<std::size_t>(nx) +
           static_cast<std::size_t>(x);
  }
};

/// Numbers along an axis and in all at most.
inline constexpr int kMostAlongAxis = 65536;
inline constexpr std::size_t kMostInBox = std::size_t{1} << 33;

/// Reads a part: unsigned bytes as they are, truth values as 0 and 255. Two axes are one slice.
/// Throws `InputError` naming file and place for other types, arrays in Fortran's order, sizes out
/// of range, and files that are shorter or longer than their header says.
Box<std::uint8_t> read_part_npy(const std::string& path);
/// The same for doses: numbers of 32 or 64 bits, little-endian; all must be finite.
Box<float> read_dose_npy(const std::string& path);
/// Written under a temporary name, then renamed. Throws `DeviceError`.
void write_npy(const std::string& path, const Box<std::uint8_t>& box);
void write_npy(const std::string& path, const Box<float>& box);

}  // namespace slicecorr::tomo
