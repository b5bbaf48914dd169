// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file write_images.hpp
/// Stacks of images that are shown as they are, each for its own time: parts to measure.
/// Thread-safe.
#pragma once

#include <vector>

#include "slicecorr/pipeline.hpp"

namespace slicecorr {

/// Most that an image may be shown, s: a day.
inline constexpr double kMostImageS = 86400;

/// As `write_target` (pipeline.hpp), and throws as it does, but the stack says for how long each
/// image is shown: `image_s`, one time for each, s, above 0 and at most `kMostImageS`. What a format
/// can't say of it is told through `context`, as when stacks are converted.
StackInfo write_images(const SliceSource& images, const std::vector<double>& image_s,
                       const StackFile& file, const ExecutionContext& context = {});

}  // namespace slicecorr
