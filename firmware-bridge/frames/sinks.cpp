// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "frames/wire.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

/// How long a display may take to answer an image, and black; in lockstep, where how busy a computer
/// is must not count, any of them.
constexpr double kAnswerS = 2, kBlackS = 1, kLockstepAnswerS = 5;

/// A display that was started a moment ago is waited for.
WireSocket connect_patiently(const std::string& address) {
  using namespace std::chrono_literals;
  const auto until = std::chrono::steady_clock::now() + 2s;
  for (;;) {
    try {
      return connect_wire(address);
    } catch (const DeviceError&) {
      if (std::chrono::steady_clock::now() > until) throw;
      std::this_thread::sleep_for(20ms);
    }
  }
}

class NullSink final : public FrameSink {
 public:
  explicit NullSink(BridgeClock& clock) : clock_(clock) {}
  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    clock_.sleep_until(at_s);
    return {frame ? frame->number : kBlackFrame, std::max(at_s, clock_.now_s()), ++count_, {}};
  }
  void black() noexcept override { ++count_; }
  std::string describe() const override { return "nowhere"; }

 private:
  BridgeClock& clock_;
  std::int64_t count_ = 0;
};

class WireSink final : public FrameSink {
 public:
  WireSink(std::string address, const WireHello& hello, BridgeClock& clock)
      : address_(std::move(address)),
        clock_(clock),
        lockstep_(hello.lockstep),
        socket_(connect_patiently(address_)) {
    const double before = clock_.now_s();
    const WireMessage answer = ask(message_of(hello), answer_s());
    // The other end has a clock of its own.
    offset_s_ = (before + clock_.now_s()) / 2 - answer.at_s;
  }

  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    const WireMessage message = message_of(frame.get(), at_s - offset_s_);
    if (!lockstep_) clock_.sleep_until(at_s);
    const double before = clock_.now_s();
    const WireMessage answer = ask(message, answer_s());
    Shown shown{answer.number, answer.at_s + offset_s_, answer.count, {}};
    if (!lockstep_) shown.at_s = std::clamp(shown.at_s, before, clock_.now_s());
    return shown;
  }

  void tick(double at_s) override {
    if (!lockstep_) return;
    WireMessage message;
    message.kind = WireKind::tick;
    message.at_s = at_s - offset_s_;
    ask(message, answer_s());
  }

  void black() noexcept override {
    try {
      ask(message_of(nullptr, clock_.now_s() - offset_s_), kBlackS);
    } catch (...) {
      // Lamps are off by now, and the display may be what failed.
    }
  }

  std::string describe() const override { return address_; }

 private:
  double answer_s() const { return lockstep_ ? kLockstepAnswerS : kAnswerS; }

  WireMessage ask(const WireMessage& message, double timeout_s) {
    if (broken_) throw DeviceError("frame wire: broken");
    // Until it is answered: a message cut short leaves nothing to go on with.
    broken_ = true;
    send_message(socket_, message, timeout_s);
    WireMessage answer;
    if (!receive_message(socket_, answer, timeout_s)) {
      throw DeviceError("frame wire: " + address_ + " is gone");
    }
    if (answer.kind != WireKind::answer) throw DeviceError("frame wire: no answer came back");
    broken_ = false;
    return answer;
  }

  const std::string address_;
  BridgeClock& clock_;
  const bool lockstep_;
  WireSocket socket_;
  double offset_s_ = 0;  ///< the print's clock less the other end's
  bool broken_ = false;
};

}  // namespace

std::unique_ptr<FrameSink> make_null_sink(BridgeClock& clock) {
  return std::make_unique<NullSink>(clock);
}

std::unique_ptr<FrameSink> make_wire_sink(const std::string& address, const WireHello& hello,
                                          BridgeClock& clock) {
  return std::make_unique<WireSink>(address, hello, clock);
}

}  // namespace slicecorr::bridge
