// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The machine's display, at the other end of the frame wire.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "frames/wire.hpp"
#include "sim/timed_model.hpp"

namespace slicecorr::bridge {

/// Serves one bridge after the other in a thread of its own.
class FrameServer {
 public:
  /// `uv_display`: it is the UV display of `machine`. `hello` is told what is printed, before its first image; what it throws ends the connection.
  /// `complain` is told why a connection ended.
  FrameServer(const std::string& address, const Machine& machine, bool uv_display,
              TimedModel& model, std::function<void(const WireHello&)> hello,
              std::function<void(const std::string&)> complain);
  ~FrameServer();
  const std::string& address() const { return listener_.address; }
  bool busy() const { return busy_; }

 private:
  void run();
  void serve(const WireSocket& socket);
  WireMessage answer(WireMessage&& message, bool& greeted);
  WireMessage show(WireMessage&& message);

  /// Which of the model's displays.
  const PrinterModel::Display& display(const PrinterModel& model) const {
    return uv_display_ ? model.uv_display() : model.display();
  }

  const Machine& machine_;
  const bool uv_display_;
  int width_px_, height_px_;
  bool shows_both_;  ///< an image of UV light beside each blue one
  TimedModel& model_;
  std::function<void(const WireHello&)> hello_;
  std::function<void(const std::string&)> complain_;
  WireListener listener_;
  std::atomic<bool> stop_{false}, busy_{false};
  std::thread thread_;
};

}  // namespace slicecorr::bridge
