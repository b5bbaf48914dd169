// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file dead_zone.hpp
/// The dead zone over the window while a stack is shown under UV light, and where it fails.
///
/// Steady dead zone of a pixel: zf = ln(beta Iuv / Ib) / (1/huv - 1/hb) (3.25). Where beta Iuv <=
/// Ib the front reaches the window when the resin there has got its gel dose, after D'c / (Ib -
/// beta Iuv)^m (physics.md §4) in slices that follow each other.
///
/// `DeadZones` are plain values, `check_window` is thread-safe, objects are for one thread at a
/// time. Nothing but `check_window` throws.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr {

/// A dead zone below this, um, is one that lamps which drift by some per cent, or resin that flows, may
/// close: printers of this kind want some 20 um of liquid under the part.
inline constexpr double kThinDeadZoneUm = 10;

/// What a print's dead zone does.
struct DeadZones {
  /// Per slice: least and greatest steady dead zone over pixels brighter than black, um; both NaN
  /// in slices without such pixels. A slice whose brightest pixel would cure to the window has 0.
  std::vector<double> least_um, greatest_um;
  std::uint64_t cured_pixels = 0;  ///< columns that cure to the window
  int cured_slice = -1;            ///< the first printed slice in which one does; -1: none
  double least() const;            ///< um, over all slices; NaN without light
  double greatest() const;
};

/// Throws `InfeasibleError` where the resin cures to the window and the process does not allow it.
void check_window(const DeadZones& zones, const Process& process);

/// Watches the window under one band.
class WindowWatch {
 public:
  /// `model.inhibited()` must be there; the model must outlive this.
  WindowWatch(const CureModel& model, int slices, std::size_t columns);
  /// Pixels (0..255) of a slice, in any order of slices that is steadily up or down; null: black.
  void add_slice(int slice, const std::uint8_t* pixels);
  /// The same of several images (dose.hpp); none: black. All slices one way or the other.
  void add_slice(int slice, std::span<const ImageShowing> showings);

 private:
  void cure(int slice, std::span<const ImageShowing> showings);

  friend class WindowTotal;
  const CureModel& model_;
  const InhibitedKernel& kernel_;
  std::size_t columns_;
  std::vector<std::uint8_t> low_, high_;  ///< per slice: least and greatest pixel above black
  /// Per slice given as showings: least and greatest dead zone, as it depends on more than levels.
  std::vector<double> least_um_, greatest_um_;
  /// Gel dose at the window from slices that follow each other; empty where no level can cure to
  /// it.
  std::vector<float> dose_;
  std::vector<bool> cured_;
  std::uint64_t count_ = 0;
  int first_ = -1;
};

/// All bands together; the order of merging does not matter.
class WindowTotal {
 public:
  WindowTotal(const CureModel& model, int slices);
  void merge(const WindowWatch& band);
  DeadZones result() const;
  /// Greatest pixel value of each slice.
  const std::vector<std::uint8_t>& brightest() const { return high_; }

 private:
  const InhibitedKernel& kernel_;
  std::vector<std::uint8_t> low_, high_;
  std::vector<double> least_um_, greatest_um_;
  std::uint64_t count_ = 0;
  int first_ = -1;
};

}  // namespace slicecorr
