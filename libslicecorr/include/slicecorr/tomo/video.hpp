// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/video.hpp
/// The frames of a tomographic job as a video without loss, for players that show it to a projector.
///
/// Thread-safe. Memory: one image, whatever the length.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/job.hpp"

namespace slicecorr::tomo {

struct VideoOptions {
  int turns = 0;      ///< 0: those of the job
  double fps = 0;     ///< images a second; 0: as many as the job shows at its speed
  double tail_s = 1;  ///< of black after the last turn; rounded up to whole images
};

/// What a video holds.
struct VideoPlan {
  int width_px = 0, height_px = 0;
  /// Images a second, as a fraction that is off by less than 1e-9.
  std::int64_t rate = 0, per_s = 1;
  int turns = 0;
  std::int64_t images = 0;  ///< with the tail
  std::int64_t tail = 0;    ///< black images at the end
  /// At which the vial must turn, so that each image falls on its angle.
  double deg_s = 0;
  double fps() const { return static_cast<double>(rate) / static_cast<double>(per_s); }
  double time_s() const { return static_cast<double>(images) / fps(); }
};
/// Throws `InputError` for numbers out of range, and for more images a second than the projector
/// shows.
VideoPlan plan_video(const TomoJob& job, const VideoOptions& options = {});

using VideoSink = std::function<void(const std::uint8_t* bytes, std::size_t count)>;
/// Gives the video piece by piece: YUV4MPEG2 with grey images of full range (Cmono,
/// XCOLORRANGE=FULL), pixels as they are in the job's images. What the sink throws passes through.
void write_y4m(const TomoJob& job, const VideoPlan& plan, const VideoSink& sink,
               const ExecutionContext& context = {});

}  // namespace slicecorr::tomo
