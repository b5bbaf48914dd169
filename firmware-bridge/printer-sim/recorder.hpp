// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What was shown and lit, as a stack.
#pragma once

#include <future>
#include <memory>
#include <string>
#include <vector>

#include "frames/wire.hpp"
#include "sim/timed_model.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/recording_writer.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::bridge {

/// Keeps what was shown and lit. Throws `DeviceError` when it can't be written.
class PrintRecorder {
 public:
  virtual ~PrintRecorder() = default;
  virtual void begin(const WireHello& hello) = 0;
  /// Writes what there is, and gives the files that were written.
  virtual std::vector<std::string> finish() = 0;
};

/// Records one print at a time. A print that had light is kept: the next one is written beside it,
/// as shown-2.uvj after shown.uvj.
class Recorder final : public PrintRecorder {
 public:
  /// `path` empty: nothing is recorded. `stack`: the one that will be printed, for bridges that
  /// don't say it; may be empty. Throws `InputError` when it can't be printed.
  Recorder(std::string path, const std::string& stack, const Machine& machine, TimedModel& model,
           const ExecutionContext& context);
  void begin(const WireHello& hello) override;
  std::vector<std::string> finish() override;

 private:
  bool lit() const;
  /// `frame`: of both displays.
  void record_image(const Frame& frame);
  Recording recording();

  std::string path_, first_path_;
  int prints_ = 0;  ///< with light
  /// Written while the next print begins.
  std::vector<std::future<std::string>> written_;
  const Machine& machine_;
  TimedModel& model_;
  ExecutionContext context_;
  Process process_;
  double layer_um_ = 0;
  double m_ = 1;  ///< exponent of light
  int slices_ = 0;
  std::unique_ptr<RecordingWriter> writer_;
};

}  // namespace slicecorr::bridge
