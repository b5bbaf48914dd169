// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where a video goes: a file of its own, or through the program ffmpeg into a container.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace slicecorr::cli {

/// Takes a YUV4MPEG2 stream. The file appears under its name with `publish`, else not at all. All
/// functions throw `DeviceError`.
class VideoFile {
 public:
  VideoFile() = default;
  VideoFile(const VideoFile&) = delete;
  VideoFile& operator=(const VideoFile&) = delete;
  virtual ~VideoFile() = default;
  virtual void put(const std::uint8_t* bytes, std::size_t count) = 0;
  virtual void publish() = 0;
};

/// The stream as it is.
std::unique_ptr<VideoFile> make_y4m_file(const std::string& path);
/// Which of a projector's lights a video is in: all alike, or one, with the others black.
enum class VideoChannel { all, red, green, blue };
/// Matroska with FFV1, which loses nothing, made by the program `ffmpeg` of the search path, which
/// reads the stream from a pipe. Throws `InputError` when there is none.
std::unique_ptr<VideoFile> make_matroska_file(const std::string& path, VideoChannel channel);
/// H.264 in an MP4 file, yuv420p of 16 to 235, as players of small computers take it and show it in full;
/// made the same way. Few levels in 255 are lost. Images must have even numbers of columns and rows.
std::unique_ptr<VideoFile> make_mp4_file(const std::string& path);

}  // namespace slicecorr::cli
