/// @file model.hpp
/// A printer to test against, without wires: stage, lamps, interlocks and watchdog over time.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::bridge {

/// A fault on demand: WHAT[=VALUE][@TIMEs|@frame:N]; docs/bridge.md lists them:
/// late-reply, wrong-reply, drop, disconnect (wire); stuck-stage, stage-slips=UM, lamp-fails,
/// lamp-drifts=SHARE, uv-fails, door, stop-button, hot, restart (machine); freeze-display.
struct SimFault {
  std::string what;
  double value = 0;
  std::optional<double> at_s;
  std::optional<int> at_frame;
};
/// Throws `InputError` naming what is known.
SimFault parse_sim_fault(const std::string& text);

/// Something that the machine did, in its order.
struct SimEvent {
  double at_s = 0;
  std::string what;  ///< "blue on", "blue off", "uv on", "uv off", "stage moves", "stage stops",
                     ///< "frame 17", "black", "watchdog", "door", ...
  double stage_um = 0;
};

/// What was shown while the stage was within one slice.
struct SliceExposure {
  struct Part {
    int image = -1;        ///< which of the images shown, in their order; -1: black
    double light_s = 0;    ///< integral of (share of blue)^m over the time it was shown
    double uv_mw_cm2 = 0;  ///< mean while it was shown
    double from_um = 0, to_um = 0, speed_um_s = 0, blue_share = 0;  ///< means
  };
  std::vector<Part> parts;
};

class PrinterModel {
 public:
  PrinterModel(Machine machine, std::vector<SimFault> faults, double layer_um, double m);
  ~PrinterModel();
  /// Lets time pass to `time_s`, in steps small enough not to show.
  void advance(double time_s);
  double now_s() const;
  /// Takes set-points over, as its own controller would; feeds the watchdog.
  void take(const SetPoints& set_points);
  Status status() const;
  /// An image appears at the present time.
  void show(const std::shared_ptr<const Frame>& frame);
  /// Whether the wire shall misbehave now, and how; asked once per exchange.
  std::optional<SimFault> wire_fault();

  const std::vector<SimEvent>& events() const;
  /// Told every image that was lit, once, with its place in the order; for recorders.
  using ImageSink = std::function<void(int image, const std::shared_ptr<const Frame>&)>;
  void tell_images(ImageSink sink);
  const std::vector<SliceExposure>& exposures() const;
  bool lamps_dark() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::bridge
