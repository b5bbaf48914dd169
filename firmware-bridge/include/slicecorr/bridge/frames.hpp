/// @file frames.hpp
/// Images: decoded ahead in a ring by threads of their own, and shown by a sink.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/stack.hpp"

namespace slicecorr::bridge {

/// One image as the display shows it. Black frames have no pixels.
struct Frame {
  int number = -1;  ///< slice; -1: black
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> blue, uv;  ///< row by row; uv only where it is patterned
  std::uint32_t crc32 = 0;             ///< of blue, then uv
};

/// Decodes frames in order, at most `ring` ahead of the one taken last. Thread-safe.
class FrameRing {
 public:
  /// `stack` must outlive this.
  FrameRing(const StackReader& stack, bool uv_patterned, int ring, int threads);
  ~FrameRing();
  /// The next frame when it is ready, else null: an underrun, for the caller to judge.
  std::shared_ptr<const Frame> take(int number);
  /// Waits until `count` frames are ready, or all that are left. Throws what decoding threw.
  void wait_ready(int count);
  int ready() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// When a frame really appeared.
struct Shown {
  double at_s = 0;         ///< on the print's clock
  std::int64_t count = 0;  ///< images that the display has shown so far
};

/// Where images go: a display, a simulator, nowhere. One thread calls it.
class FrameSink {
 public:
  virtual ~FrameSink() = default;
  /// Shows the frame as soon as possible, not before `at_s` on the print's clock. Returns when it
  /// is shown. Throws `DeviceError` when the display is gone.
  virtual Shown show(const std::shared_ptr<const Frame>& frame, double at_s) = 0;
  /// Black at once, on every way out; never throws.
  virtual void black() noexcept = 0;
  virtual std::string describe() const = 0;
};

/// Counts and forgets.
std::unique_ptr<FrameSink> make_null_sink();

/// Sends images to printer-sim: "unix:PATH" or "tcp:HOST:PORT". Each message says number, size and
/// time and is answered when it is shown, so that the answer is what really happened.
std::unique_ptr<FrameSink> make_wire_sink(const std::string& address, const Machine& machine);

}  // namespace slicecorr::bridge
