// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sim/lamp.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace slicecorr::bridge::detail {

namespace {

constexpr double kColdLight = 0.8, kDriftTimeS = 1;
constexpr double kSettled = 1e-12;  ///< nearer than this the level is what was asked
constexpr double kMomentS = 1e-9;   ///< shorter times to go are over: they would not move a clock
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Gauss-Legendre, 8 points: positive nodes and their weights.
constexpr std::array<double, 4> kNodes{0.1834346424956498, 0.5255324099163290, 0.7966664774136267,
                                       0.9602898564975363};
constexpr std::array<double, 4> kWeights{0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                                         0.1012285362903763};

template <typename F>
double gauss(double from, double to, const F& f) {
  const double middle = (from + to) / 2, half = (to - from) / 2;
  double sum = 0;
  for (std::size_t i = 0; i < kNodes.size(); ++i) {
    sum += kWeights[i] * (f(middle - half * kNodes[i]) + f(middle + half * kNodes[i]));
  }
  return sum * half;
}

}  // namespace

Lamp::Lamp(const LampDrive& drive)
    : drive_(drive), time_constant_s_(drive.settle_s / std::log(100.0)) {}

void Lamp::ask(double share) {
  if (stuck_) return;
  const double held = std::clamp(share, 0.0, drive_.max_share);
  asked_ = held < drive_.min_share ? 0 : held;
  if (asked_ == 0 || time_constant_s_ == 0 || std::abs(level_ - asked_) <= kSettled) {
    level_ = asked_;
  }
}

void Lamp::cut() {
  stuck_ = false;
  ask(0);
}

void Lamp::drift(double share) {
  drift_ = share;
  drifting_s_ = 0;
}

double Lamp::warmth_at(double time_s) const {
  if (drive_.warm_up_s <= 0) return 1;
  const double lit = std::min(drive_.warm_up_s, lit_s_ + time_s);
  return kColdLight + (1 - kColdLight) * lit / drive_.warm_up_s;
}

double Lamp::drift_at(double time_s) const {
  return 1 + drift_ * std::min(1.0, (drifting_s_ + time_s) / kDriftTimeS);
}

double Lamp::light_at(double time_s) const {
  if (failed_ || asked_ == 0) return 0;
  const double level =
      settled() ? asked_ : asked_ + (level_ - asked_) * std::exp(-time_s / time_constant_s_);
  return std::max(0.0, level * warmth_at(time_s) * drift_at(time_s));
}

double Lamp::steady_for_s() const {
  double time = kInfinity;
  if (drift_ != 0 && drifting_s_ < kDriftTimeS) time = std::min(time, kDriftTimeS - drifting_s_);
  if (asked_ == 0) return time;
  if (!settled()) {
    time = std::min(time, time_constant_s_ * std::log(std::abs(level_ - asked_) / kSettled));
  }
  if (lit_s_ < drive_.warm_up_s) time = std::min(time, drive_.warm_up_s - lit_s_);
  return std::max(time, kMomentS);
}

double Lamp::integral(double time_s, double m) const {
  if (failed_ || asked_ == 0 || time_s <= 0) return 0;
  const bool warm = drive_.warm_up_s <= lit_s_;
  const bool even = drift_ == 0 || drifting_s_ >= kDriftTimeS;
  if (settled() && warm && even) return std::pow(light_at(0), m) * time_s;
  if (warm && even && m == 1) {
    const double gone = -std::expm1(-time_s / time_constant_s_);
    return std::max(0.0, drift_at(0)) *
           (asked_ * time_s + (level_ - asked_) * time_constant_s_ * gone);
  }
  const auto f = [&](double t) { return std::pow(light_at(t), m); };
  if (settled()) return gauss(0, time_s, f);
  // From the dark light^m begins like t^m, which no polynomial follows: steps that grow from there.
  double sum = 0, at = 0;
  double step = level_ < 0.1 * asked_ ? time_constant_s_ * 1e-6 : time_constant_s_ / 2;
  while (at < time_s) {
    const double to = std::min(time_s, at + step);
    sum += gauss(at, to, f);
    at = to;
    step = std::min(2 * step, time_constant_s_ / 2);
  }
  return sum;
}

void Lamp::advance(double time_s) {
  if (!settled()) {
    level_ = asked_ + (level_ - asked_) * std::exp(-time_s / time_constant_s_);
    // The rounding of levels near 1 is 1e-4 of this.
    if (std::abs(level_ - asked_) <= kSettled * 1.01) level_ = asked_;
  }
  lit_s_ = std::clamp(lit_s_ + (asked_ > 0 ? time_s : -time_s), 0.0, drive_.warm_up_s);
  if (drive_.warm_up_s - lit_s_ < kMomentS) lit_s_ = drive_.warm_up_s;
  if (drift_ != 0) drifting_s_ += time_s;
  if (kDriftTimeS - drifting_s_ < kMomentS) drifting_s_ = kDriftTimeS;
}

}  // namespace slicecorr::bridge::detail
