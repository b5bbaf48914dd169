// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file recording_writer.hpp
/// Writes what a machine really showed as a recorded stack (recording.hpp).
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "slicecorr/parallel.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr {

/// Takes the images of a print as they appear and writes the recorded stack at the end. Memory is
/// bounded: images are kept compressed, beyond 64 MiB in an unnamed scratch file beside `path`. For
/// one thread at a time. Throws `DeviceError` when a disk fails.
class RecordingWriter {
 public:
  /// `print`: what the corrected stack that is printed says of itself, with printer, resin and
  /// process. `path` ends in ".uvj". Throws `InputError` when it does not, its folder is not there,
  /// or `print` lacks one of the three.
  RecordingWriter(const std::string& path, const StackInfo& print,
                  const ExecutionContext& context = {});
  ~RecordingWriter();
  RecordingWriter(const RecordingWriter&) = delete;
  RecordingWriter& operator=(const RecordingWriter&) = delete;

  /// The next image, as large as the stack's; `uv`: that of a patterned UV lamp, null: none. Gives
  /// its index, from 0.
  int add_image(const std::uint8_t* blue, const std::uint8_t* uv = nullptr);
  int images() const;

  /// Writes the archive: complete or not at all. Its `other_uv_images` are filled in here. Goes on
  /// where `context` is cancelled: a print that was stopped has a record, too. A recording without
  /// images gets a black one, since an archive must have one. Throws as `check_recording`, and
  /// `DeviceError`.
  void finish(Recording shown);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr
