// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

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

/// Where those who show images leave what became of them, in its order. Thread-safe.
class ImageNewsBox {
 public:
  void add(const FrameReport& report);
  void fault(Fault what, const std::string& detail);
  ImageNews take();

 private:
  std::mutex mutex_;
  ImageNews news_;
};

/// Shows images on one display.
class Images {
 public:
  /// `lockstep`: no thread; images are shown in `show_next`. `uv_display`: shows what frames have
  /// for that one.
  Images(FrameRing& ring, FrameSink& sink, BridgeClock& clock, ImageNewsBox& news, bool lockstep,
         bool uv_display);
  ~Images();
  /// The image to show next, `kBlackFrame`, which goes before all that waits.
  void show(int number, double at_s);
  /// Lockstep: when the next image is to be shown; nothing: there is none.
  std::optional<double> next_s() const;
  /// Lockstep: shows it.
  void show_next();
  /// Lockstep: the display's time passes.
  void tick(double at_s);
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
  ImageNewsBox& news_;
  const bool lockstep_, uv_display_;
  std::int64_t count_ = -1;  ///< of the display, when last heard of
  std::mutex mutex_;
  std::condition_variable asked_;
  std::optional<Request> request_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace slicecorr::bridge
