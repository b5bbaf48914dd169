// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sim/frame_server.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "slicecorr/error.hpp"

namespace slicecorr::bridge {

namespace {

constexpr int kLookMs = 20;
constexpr double kWholeS = 5;         ///< a message that has begun must be whole by then
constexpr double kMostAheadS = 3600;  ///< nobody asks for more time at once

bool wait_for_input(int descriptor) {
  pollfd p{descriptor, POLLIN, 0};
  return ::poll(&p, 1, kLookMs) > 0;
}

}  // namespace

FrameServer::FrameServer(const std::string& address, const Machine& machine, bool uv_display,
                         TimedModel& model, std::function<void(const WireHello&)> hello,
                         std::function<void(const std::string&)> complain)
    : machine_(machine),
      uv_display_(uv_display),
      width_px_(uv_display ? machine.uv_display->width_px : machine.printer.width_px),
      height_px_(uv_display ? machine.uv_display->height_px : machine.printer.height_px),
      shows_both_(machine.printer.uv && machine.printer.uv->patterned && !machine.uv_display),
      model_(model),
      hello_(std::move(hello)),
      complain_(std::move(complain)),
      listener_(listen_wire(address)) {
  // Who has to wait for a place in the queue tries again after a second only.
  ::listen(listener_.socket.get(), 64);
  thread_ = std::thread([this] { run(); });
}

FrameServer::~FrameServer() {
  stop_ = true;
  thread_.join();
  if (listener_.address.starts_with("unix:")) ::unlink(listener_.address.substr(5).c_str());
}

void FrameServer::run() {
  while (!stop_) {
    if (!wait_for_input(listener_.socket.get())) continue;
    const WireSocket socket(::accept4(listener_.socket.get(), nullptr, nullptr, SOCK_CLOEXEC));
    if (!socket) continue;
    busy_ = true;
    try {
      serve(socket);
    } catch (const std::exception& e) {
      complain_(e.what());
    }
    busy_ = false;
  }
}

void FrameServer::serve(const WireSocket& socket) {
  bool greeted = false;
  WireMessage message;
  while (!stop_) {
    if (!wait_for_input(socket.get())) continue;
    if (!receive_message(socket, message, kWholeS)) return;
    const WireMessage reply = answer(std::move(message), greeted);
    bool gone = false;
    model_.with([&](PrinterModel& model) { gone = display(model).gone; });
    // Before the bridge sees it: time goes on by its exchanges.
    if (gone) return model_.no_more_ticks();
    send_message(socket, reply, kWholeS);
  }
}

WireMessage FrameServer::answer(WireMessage&& message, bool& greeted) {
  WireMessage reply;
  reply.kind = WireKind::answer;
  const auto now = [&] {
    model_.with([&](PrinterModel& model) {
      reply.at_s = model.now_s();
      reply.number = display(model).number;
      reply.count = display(model).count;
    });
  };
  if (greeted != (message.kind != WireKind::hello)) {
    throw DeviceError(greeted ? "frame wire: a second hello"
                              : "frame wire: expected a hello first");
  }
  if (model_.lockstep() && message.kind != WireKind::hello) {
    now();
    if (message.at_s > reply.at_s + kMostAheadS) {
      throw DeviceError(
          fmt::format("frame wire: asks for {:g} s at {:g} s", message.at_s, reply.at_s));
    }
  }
  switch (message.kind) {
    case WireKind::hello: {
      const WireHello hello = hello_of(message);
      if (hello.lockstep != model_.lockstep()) {
        throw DeviceError(hello.lockstep
                              ? "frame wire: the bridge runs in lockstep; expected real time"
                              : "frame wire: the bridge runs in real time; expected lockstep");
      }
      if ((hello.angles > 0) != machine_.stage.turns()) {
        throw DeviceError(hello.angles > 0
                              ? "frame wire: the bridge prints a job; this stage does not turn"
                              : "frame wire: the bridge prints a stack; this stage turns a vial");
      }
      if (hello.uv_display != uv_display_) {
        throw DeviceError(uv_display_
                              ? "frame wire: this is the UV display; the bridge has blue "
                                "images for it (--sink, --uv-sink)"
                              : "frame wire: this is the display of blue images; the bridge "
                                "has those of a UV display for it (--sink, --uv-sink)");
      }
      hello_(hello);
      if (!uv_display_) model_.begin(hello.cycle_s);
      greeted = true;
      now();
      return reply;
    }
    case WireKind::tick:
      model_.tick(message.at_s);
      now();
      return reply;
    case WireKind::frame:
      return show(std::move(message));
    case WireKind::answer:
      break;
  }
  throw DeviceError("frame wire: an answer to nothing");
}

WireMessage FrameServer::show(WireMessage&& message) {
  const bool has_uv = (message.flags & kWireUv) != 0;
  if (message.number >= 0 &&
      (static_cast<int>(message.width_px) != width_px_ ||
       static_cast<int>(message.height_px) != height_px_ || has_uv != shows_both_)) {
    throw DeviceError(fmt::format(
        "frame wire: frame {} of {} x {} pixels, {} UV; this display has {} x {}, {} UV",
        message.number, message.width_px, message.height_px, has_uv ? "with" : "without", width_px_,
        height_px_, shows_both_ ? "with" : "without"));
  }
  const double at_s = message.at_s;
  const auto frame = frame_of(std::move(message));
  std::optional<double> later_s;
  model_.with_at(at_s, [&](PrinterModel& model) {
    uv_display_ ? model.show_uv(frame) : model.show(frame);
    later_s = display(model).later_s;
  });
  // The answer is what really happened: it waits for an image that is late.
  while (later_s && !stop_) {
    if (!model_.lockstep()) std::this_thread::sleep_for(model_.real(0.001));
    model_.with_at(*later_s, [&](PrinterModel& model) { later_s = display(model).later_s; });
  }
  WireMessage reply;
  reply.kind = WireKind::answer;
  model_.with([&](PrinterModel& model) {
    reply.number = display(model).number;
    reply.at_s = display(model).since_s;
    reply.count = display(model).count;
  });
  return reply;
}

}  // namespace slicecorr::bridge
