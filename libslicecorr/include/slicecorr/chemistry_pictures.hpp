// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file chemistry_pictures.hpp
/// Pictures of patterns that gel. Plain functions, thread-safe; they throw nothing of their own.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/chemistry_pattern.hpp"
#include "slicecorr/picture.hpp"

namespace slicecorr {

/// When each cell gelled: from yellow, the first, to dark blue, the last; what was meant to gel and did
/// not is red, what stayed liquid is white, and the dark that gelled is paler than the lit.
ColourImage gel_time_picture(const PatternRun& run, const LightPattern& target);
/// The same as a file with a scale, the times of its colours and words; `svg`, or else as PNG. Cells are
/// drawn as whole pixels, so that what is small fills the sheet.
std::string gel_time_sheet(const PatternRun& run, const LightPattern& target, double cell_um,
                           const std::string& name, bool svg);

/// How like the target what has gelled is, over time: the image as it is shown, and corrected where
/// there is one. `name`: of the resin.
std::string overlap_svg(const PatternRun& even, const PatternRun* corrected,
                        const LightPattern& target, double end_s, const std::string& name);

/// 8-bit grey of a pattern, a pixel for `refine` x `refine` cells, which are averaged.
std::vector<std::uint8_t> grey_of_pattern(const LightPattern& pattern, int refine = 1);

}  // namespace slicecorr
