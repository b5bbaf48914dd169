// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/targets.hpp
/// Pictures that a tomographic printer's projector shows to be set up by.
///
/// Plain values; functions are thread-safe. The same printer gives the same bytes.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::tomo {

enum class TargetKind {
  axis,       ///< where the axis of rotation is, whether it leans, how it wobbles
  focus,      ///< line pairs and a star, to focus on the plane of the axis
  scale,      ///< a ruled grid: pixels' pitch, and the distance of a pinhole
  direction,  ///< an F and a bar at four angles: which way the stage turns, mirrored or not
  light,      ///< even light of several levels: calibration and flat-field
  dose,       ///< rows of several levels, columns of several times, for a cuvette of resin at rest
  threshold,  ///< discs of several levels one above the other, for resin that turns
};

/// Levels of rows of `dose`, from the top, and of discs of `threshold`: brightest first, at equal factors of
/// light down to a tenth of it; none twice.
std::vector<int> target_levels(const Printer& printer);
/// Factors of the expected time for which columns of `dose` are lit, from the left.
std::vector<double> target_times();

struct TargetPicture {
  std::string name;  ///< "axis-comb"; the file is NAME.png
  std::string what;  ///< in words
  GreyImage image;   ///< of the projector's size, as seen from it, before any mirror
};

/// Throws `InputError` when the printer lacks a table of tomographic printing, or its image is too
/// small to hold a target (less than 64 pixels a side).
std::vector<TargetPicture> target_pictures(TargetKind kind, const Printer& printer);

}  // namespace slicecorr::tomo
