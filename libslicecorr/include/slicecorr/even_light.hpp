// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file even_light.hpp
/// Light that makes dose and dead zone even although resin flows (docs/even-dead-zone.md): how much
/// of each lamp's light every place gets in every slice.
///
/// Plain values on coarse cells, for some slices; bilinear from cells to pixels, linear between
/// slices, and flat outside of both. All functions are thread-safe. Values that don't fit throw
/// `InputError`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace slicecorr {

struct Grid;

/// What is chosen so that the dead zone becomes even.
enum class EvenDeadZone {
  off,
  constant,  ///< one intensity of each lamp for all of a slice
  blue,      ///< the curing light by place
  uv,        ///< the UV light by place
  both,
};
/// As options and stacks name it: "off", "constant", "blue", "uv", "both".
const char* name_of(EvenDeadZone even);

/// The light of each place. Bytes are shares of full light, of 255.
struct EvenLight {
  int columns = 0, rows = 0;       ///< cells, 1..kMostCells each
  double pitch_um = 0;             ///< side of a cell, > 0
  double left_um = 0, top_um = 0;  ///< of the first cell in the image, from its upper left corner
  double gap_um = 0;               ///< dead zone that the light is for, > 0
  std::vector<int> slices;         ///< whose light follows, rising, from 0 on
  /// Curing light inside features: slice by slice, row by row; none is 0; shared, never changed.
  std::shared_ptr<const std::vector<std::uint8_t>> blue;
  /// UV light in the same order where the lamp shows images; else null: then the process has one
  /// intensity per slice.
  std::shared_ptr<const std::vector<std::uint8_t>> uv;

  static constexpr int kMostCells = 4096;

  std::size_t cells() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  std::uint8_t least_blue() const;
  std::uint8_t greatest_blue() const;
  bool operator==(const EvenLight& o) const;
};

/// Throws `InputError`, naming `source`, when sizes, slices or values of a light don't fit each other.
void check_even_light(const EvenLight& light, const std::string& source);

/// Fills the cells of one slice where `known` is 0 outwards from those where it is not: round by
/// round each next cell gets the mean of its neighbours, along sides and corners. Without any known
/// cell values stay.
void extend_outwards(std::span<double> values, std::span<const std::uint8_t> known, int columns,
                     int rows);

/// Values that a slow lamp can follow: none lower than given, and from one to the next no change
/// by more than `step` (> 0) per slice; `slices`: where they are, rising.
std::vector<double> slowed(std::vector<double> values, std::span<const int> slices, double step);

/// The light of the pixels of a stack. Immutable; `light` must outlive it.
class EvenPixels {
 public:
  /// Of images with pixels as those of `images`.
  EvenPixels(const EvenLight& light, const Grid& images);
  /// Shares of full curing light of the pixel in column x of row y in slices 0..n - 1, of 255: the
  /// nearest whole numbers.
  void blue_of(int x, int y, std::span<std::uint8_t> shares) const;
  /// Shares of full UV light of the pixels x0..x0 + n - 1 of a row in one slice, of 255, not rounded.
  void uv_of_row(int slice, int x0, int y, std::span<double> shares) const;

 private:
  /// Between which two cells or slices something lies, and how near to the second, 0..1.
  struct Between {
    std::size_t first = 0, second = 0;
    double share = 0;
  };
  Between between(double at, int cells) const;
  Between between_slices(int slice) const;
  double value(const std::vector<std::uint8_t>& bytes, std::size_t slice, const Between& x,
               const Between& y) const;

  const EvenLight& light_;
  double pixel_x_um_, pixel_y_um_;
};

}  // namespace slicecorr
