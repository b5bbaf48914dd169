/// Who shows images: a thread of its own, or, in lockstep, the control thread.
#pragma once

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "slicecorr/bridge/control.hpp"
#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/bridge/link.hpp"

namespace slicecorr::bridge {

/// What became of images since the last cycle.
struct ImageNews {
  std::vector<FrameReport> reports;
  Fault fault = Fault::none;
  std::string detail;
};

class Images {
 public:
  /// `lockstep`: no thread; images are shown in `show_due`.
  Images(FrameRing& ring, FrameSink& sink, BridgeClock& clock, bool lockstep);
  ~Images();
  /// The image to show next, `kBlackFrame`, which goes before all that waits.
  void show(int number, double at_s);
  /// Lockstep: shows what is due before `until_s`.
  void show_due(double until_s);
  /// Lockstep: the display's time passes.
  void tick(double at_s);
  ImageNews news();
  /// Ends the thread.
  void end();

 private:
  struct Request {
    int number;
    double at_s;
  };
  void work();
  void check();
  void show_one(const Request& request);
  void fault(Fault what, const std::string& detail);

  FrameRing& ring_;
  FrameSink& sink_;
  BridgeClock& clock_;
  const bool lockstep_;
  std::int64_t count_ = -1;  ///< of the display, when last heard of
  std::mutex mutex_;
  std::condition_variable asked_;
  std::optional<Request> request_;
  ImageNews news_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace slicecorr::bridge
