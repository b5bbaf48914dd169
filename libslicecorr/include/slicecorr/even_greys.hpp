// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file even_greys.hpp
/// Signs that slices were corrected already, for files that have no place to say it.
///
/// Slicers have greys at outlines, where a pixel is partly covered: lines one pixel wide, or ramps where they
/// are blurred. A correction has areas of one grey, over gaps whose top is flat or in steps of layers.
#pragma once

#include <cstdint>
#include <string>

#include "slicecorr/parallel.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {

/// What of slices lies in the middle of 3 x 3 pixels of one grey, neither black nor white.
struct EvenGreys {
  std::uint64_t pixels = 0;
  std::uint64_t lit_pixels = 0;  ///< all that are not black
  int layers = 0;                ///< with such pixels
  int first = -1;                ///< of them; -1: none
  bool operator==(const EvenGreys&) const = default;

  /// Whether they are as many as no slicer is known to make: a hundred, and one in 2000 of those lit.
  bool look_corrected() const;
  /// That, in a sentence; empty where it is not so.
  std::string in_words() const;
};

/// Looks at all slices once, in bands by all threads, the same for any number of them: pixels in the first and
/// last row of a band are not looked at. Throws as the source does, and `Cancelled`.
EvenGreys even_greys(const SliceSource& slices, const ExecutionContext& context = {});

/// Tells `in_words` of slices that another program made, where there is something to tell.
void tell_even_greys(const SliceSource& slices, StackKind kind, const ExecutionContext& context);

}  // namespace slicecorr
