// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file model.hpp
/// A printer to test against, without wires: stage, lamps, interlocks and watchdog over time. Its
/// state follows from closed forms between events, so that nothing depends on how often it is asked
/// and the light that each slice got is exact. A `PrinterModel` belongs to one thread at a time
/// (sim/timed_model.hpp shares one); all else is plain values and thread-safe functions. Only
/// `parse_sim_fault` throws.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::bridge {

/// A fault on demand: WHAT[=VALUE][@TIMEs|@frame:N]; docs/printer-sim.md lists them. Without a moment it
/// is there from the beginning.
struct SimFault {
  std::string what;
  double value = 0;  ///< in the unit of `SimFaultKind::value`; where not given, the standard one
  std::optional<double> at_s;   ///< on the model's clock
  std::optional<int> at_frame;  ///< when this frame, or a later one, is shown; from 0
};
/// Throws `InputError` naming what is known.
SimFault parse_sim_fault(const std::string& text);
struct SimFaultKind {
  std::string_view name;
  std::string_view where;  ///< "wire", "machine", "display" or "uv display"
  std::string_view value;  ///< what VALUE is; empty: it takes none
  double standard = 0;     ///< VALUE where none is given
  std::string_view what;   ///< in words
};
const std::vector<SimFaultKind>& sim_fault_kinds();

/// Something that the machine did, in its order.
struct SimEvent {
  double at_s = 0;  ///< on the model's clock
  /// "blue on", "blue off", "uv on", "uv off", "stage moves", "stage stops", "frame 17", "black",
  /// "uv frame 17", "uv black" (of a UV display),
  /// "watchdog", "fault", "reset", "run", "off", "stop", and the names of faults as they begin.
  std::string what;
  double stage_um = 0;  ///< above the window; an arc of a stage that turns
};

/// Stands for black where an image is named by its place in the order shown.
inline constexpr int kBlackImage = -1;

/// What was shown while the stage was within one slice.
struct SliceExposure {
  struct Showing {
    int image = kBlackImage;        ///< which of the lit images, in their order from 0
    double light_s = 0;             ///< integral of (share of blue)^m over the time it was shown
    double uv_mw_cm2 = 0;           ///< mean intensity while it was shown
    double from_um = 0, to_um = 0;  ///< stage positions, from the first slice's begin
    double speed_um_s = 0, blue_share = 0;  ///< means while it was shown
    double time_s = 0;                      ///< how long it was shown
  };
  std::vector<Showing> showings;
};

/// What decides of which slice light is.
struct SliceFacts {
  double layer_um = 0;  ///< 0: nothing is recorded
  double start_um = 0;  ///< stage position of the first slice's begin
  double m = 1;         ///< exponent of intensity
  /// Layer by layer slice n is what is shown within half a layer of the stage at
  /// start_um + (n + 1) layer_um; else from start_um + n layer_um on, one layer long.
  bool layerwise = false;
};

class PrinterModel {
 public:
  /// Time begins at 0, the stage stands at its home. Lamps are cold and dark.
  PrinterModel(Machine machine, std::vector<SimFault> faults, double layer_um = 0, double m = 1);
  ~PrinterModel();
  /// Records exposures from now on; forgets what was recorded.
  void record(const SliceFacts& facts);
  /// Lets time pass to `time_s`; a time before now does nothing.
  void advance(double time_s);
  double now_s() const;
  /// Takes set-points over, as its own controller would; feeds the watchdog when the heartbeat is
  /// another one. A latched fault is kept until `Command::reset` finds its cause gone.
  void take(const SetPoints& set_points);
  Status status() const;

  /// An image appears at the present time, or later by a fault. Null: black.
  void show(const std::shared_ptr<const Frame>& frame);
  struct Display {
    int number = kBlackFrame;       ///< on it now
    double since_s = 0;             ///< when it appeared, on the model's clock
    std::int64_t count = 0;         ///< images shown so far, black ones, too
    std::optional<double> later_s;  ///< a late image will appear then
    bool gone = false;              ///< does not answer any more
  };
  const Display& display() const;
  /// The same of the UV display (`Machine::uv_display`); images have UV light in `blue`.
  void show_uv(const std::shared_ptr<const Frame>& frame);
  const Display& uv_display() const;

  /// Whether the wire shall misbehave now, and how; asked once per exchange.
  std::optional<SimFault> wire_fault();

  const std::vector<SimEvent>& events() const;
  /// Told every image that was lit, once, with its place in the order; for recorders. Where there is
  /// a UV display, what that showed is in `on_uv_display`, null: black; a new image on either makes
  /// a new one.
  using ImageSink = std::function<void(int image, const std::shared_ptr<const Frame>&)>;
  void tell_images(ImageSink sink);
  /// Per slice. What was lit before the first slice is counted with the first.
  const std::vector<SliceExposure>& exposures() const;
  bool lamps_dark() const;
  bool at_rest() const;  ///< the drive of the stage does not move
  /// When the watchdog will trip unless fed; nothing where it is not armed.
  std::optional<double> watchdog_at_s() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::bridge
