// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file frames.hpp
/// Images: decoded ahead in a ring by threads of their own, and shown by a sink. `FrameSource` and
/// `FrameRing` are thread-safe; a `FrameSink` belongs to one thread. Functions are thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/bridge/link.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/job.hpp"

namespace slicecorr::bridge {

/// One image as the display shows it. Black frames have no pixels.
struct Frame {
  int number = kBlackFrame;  ///< of the slice, from 0
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> blue, uv;  ///< 0..255, row by row; uv only where it is patterned
  std::uint32_t crc32 = 0;             ///< of blue, then uv
  /// What the UV display shows with it, where there is one of its own: its pixels are in `blue`.
  std::shared_ptr<const Frame> on_uv_display = {};
};

/// What frames are made from.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual int frames() const = 0;  ///< how many there are
  /// Frame `number`, 0..frames() - 1. Thread-safe. Throws `InputError` or `DeviceError` when its
  /// image can't be read.
  virtual std::shared_ptr<const Frame> make(int number) const = 0;
  /// Memory that a frame takes, bytes; 0: not known.
  virtual std::size_t frame_bytes() const { return 0; }
};
/// The slices of a stack as the printer's displays show them, turned where they show the plate; UV
/// images beside the blue ones, or, where `machine` has a UV display, for that one. A display that
/// shows UV images is dark where the stack has none. `stack` must outlive this.
std::unique_ptr<FrameSource> make_frame_source(const StackReader& stack, const Machine& machine,
                                               bool uv_patterned);

/// The frames of a job, turn after turn, as the printer's display shows them; `turns` >= 1. `job`
/// must outlive this.
std::unique_ptr<FrameSource> make_frame_source(const tomo::TomoFrames& job, int turns,
                                               const Printer& printer);

/// Makes frames in order, at most `ring` ahead of the one taken last, with threads of its own;
/// fewer where they would take more than `kMostBytes`, but three always. Thread-safe.
class FrameRing {
 public:
  static constexpr std::size_t kMostBytes = 256U << 20;  ///< that all frames in it may take
  /// `source` must outlive this. `ring`: frames, 1 or more; `threads`: 1 or more.
  FrameRing(const FrameSource& source, int ring, int threads);
  ~FrameRing();
  /// Frame `number` when it is ready, else null: an underrun, for the caller to judge. Frames
  /// before it are forgotten, it and those after it stay. Throws what making it threw.
  std::shared_ptr<const Frame> take(int number);
  /// Waits until frame `number` and `count` - 1 after it are ready, or all that are left. Throws
  /// what making them threw.
  void wait_ready(int number, int count);
  /// Frames that can be taken now, from the one taken last on. Never waits.
  int ready() const;
  int capacity() const;  ///< frames that it holds at most

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// How a display brought an image to light, as far as it knows.
struct DisplayTimes {
  static constexpr std::int64_t kUnknownVblank = -1;
  /// Number of the vertical blank from which on the image was scanned out.
  std::int64_t vblank = kUnknownVblank;
  /// Vertical blanks, >= 0, that went by between handing the image over and that one.
  int missed_vblanks = 0;
  double upload_s = 0;   ///< time to bring the pixels into the display's memory; 0: not known
  double present_s = 0;  ///< from there to the light, as far as the display can tell; 0: not known
};

/// What the display says after a frame was given to it.
struct Shown {
  int number = kBlackFrame;  ///< of the image that is on the display now
  double at_s = 0;           ///< when it appeared, on the print's clock
  std::int64_t count = 0;    ///< images that the display has shown so far
  DisplayTimes times;
};

/// Where images go: a display, a simulator, nowhere.
class FrameSink {
 public:
  virtual ~FrameSink() = default;
  /// Shows the frame as soon as possible, not before `at_s` on the print's clock; a display that
  /// tells when it scans out, at the vertical blank nearest to it. Returns when it is shown. Throws
  /// `DeviceError` when the display is gone.
  virtual Shown show(const std::shared_ptr<const Frame>& frame, double at_s) = 0;
  /// Black at once, on every way out; never throws, gives up after a second.
  virtual void black() noexcept = 0;
  /// For displays that are models, in lockstep: time passes up to here. Throws as `show`.
  virtual void tick(double /*at_s*/) {}
  /// Called now and then while nothing is to be shown. Throws as `show` when the display is gone,
  /// covered or moved meanwhile.
  virtual void check() {}
  virtual std::string describe() const = 0;
};

/// Shows nothing: counts the images that it is given and forgets them.
std::unique_ptr<FrameSink> make_null_sink(BridgeClock& clock);

struct WireHello;
/// Sends images to printer-sim: "unix:PATH" or "tcp:HOST:PORT" (frames/wire.hpp). Each message is
/// answered when its image is shown, so that the answer is what really happened. `clock` must
/// outlive the sink. Throws `InputError` and `DeviceError`.
std::unique_ptr<FrameSink> make_wire_sink(const std::string& address, const WireHello& hello,
                                          BridgeClock& clock);

}  // namespace slicecorr::bridge
