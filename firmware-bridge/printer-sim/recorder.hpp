/// What was shown and lit, as a stack.
#pragma once

#include <memory>
#include <string>

#include "frames/wire.hpp"
#include "sim/timed_model.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::bridge {

/// Records one print at a time; the last one that began counts.
class Recorder {
 public:
  /// `path` empty: nothing is recorded. `stack`: the one that will be printed, for bridges that
  /// don't say it; may be empty. Throws `InputError` when it can't be printed.
  Recorder(std::string path, const std::string& stack, const Machine& machine, TimedModel& model,
           const Job& job);
  void begin(const WireHello& hello);
  /// Writes what there is; false when nothing was printed. Throws `DeviceError`.
  bool finish();

 private:
  std::string path_;
  const Machine& machine_;
  TimedModel& model_;
  Job job_;
  Process process_;
  double layer_um_ = 0;
  int slices_ = 0;
  std::unique_ptr<RecordingWriter> writer_;
};

}  // namespace slicecorr::bridge
