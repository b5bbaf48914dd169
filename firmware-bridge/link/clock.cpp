// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <time.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/bridge/link.hpp"

namespace slicecorr::bridge {
namespace {

double monotonic_s() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

class RealClock final : public BridgeClock {
 public:
  explicit RealClock(double rate) : start_s_(monotonic_s()), rate_(rate) {}
  double now_s() const override { return (monotonic_s() - start_s_) * rate_; }
  void sleep_until(double time_s) override {
    const double until = start_s_ + time_s / rate_;
    timespec t{};
    t.tv_sec = static_cast<time_t>(std::floor(until));
    t.tv_nsec = static_cast<long>((until - std::floor(until)) * 1e9);
    // A signal ends the sleep early: whoever sleeps looks at what it says.
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
  }

 private:
  double start_s_, rate_;
};

class StepClock final : public BridgeClock {
 public:
  double now_s() const override { return now_s_; }
  void sleep_until(double time_s) override { now_s_ = std::max(now_s_, time_s); }

 private:
  double now_s_ = 0;
};

}  // namespace

std::unique_ptr<BridgeClock> make_real_clock(double rate) {
  return std::make_unique<RealClock>(rate);
}
std::unique_ptr<BridgeClock> make_step_clock() { return std::make_unique<StepClock>(); }

}  // namespace slicecorr::bridge
