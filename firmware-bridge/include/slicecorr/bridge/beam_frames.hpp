// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file beam_frames.hpp
/// Images of a print with beams, on as many displays as it has. Thread-safe as frames.hpp says.
#pragma once

#include <memory>
#include <vector>

#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/tomo/beams_job.hpp"

namespace slicecorr::bridge {

/// The one frame of the job: the image of its first display.
std::unique_ptr<FrameSource> make_frame_source(const tomo::BeamJob& job, const Printer& printer);

/// Shows each display's own image of the job, wherever the first display's is to be shown, one after
/// the other; black on all. `sinks`: one for each display of the job, in their order. Throws
/// `InputError` when there are more or fewer.
std::unique_ptr<FrameSink> make_group_sink(std::vector<std::unique_ptr<FrameSink>> sinks,
                                           const tomo::BeamJob& job, const Printer& printer);

}  // namespace slicecorr::bridge
