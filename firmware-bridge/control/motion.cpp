// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "control/motion.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::bridge {

void CommandedMotion::place(double position_um, double at_s, double speed_um_s) {
  position_ = target_ = position_um;
  speed_ = speed_um_s;
  time_ = at_s;
}

void CommandedMotion::move(double target_um, double speed_um_s, double acceleration_um_s2,
                           double at_s) {
  advance(at_s);
  target_ = target_um;
  most_ = std::abs(speed_um_s);
  acceleration_ = std::max(acceleration_um_s2, 1e-3);
}

void CommandedMotion::advance(double time_s) {
  double left = time_s - time_;
  if (!(left > 0)) return;
  time_ = time_s;
  // Pieces of constant acceleration, of which there are at most: stop to turn round, speed up, go
  // at constant speed, slow down.
  for (int piece = 0; piece < 8 && left > 0; ++piece) {
    const double way = target_ - position_;
    if (way == 0 && speed_ == 0) return;
    const double side = way != 0 ? std::copysign(1.0, way) : std::copysign(1.0, speed_);
    const double v = speed_ * side, d = std::abs(way), a = acceleration_;
    const double braking = v * v / (2 * a);
    double rate, time;  // of this piece, along `side`
    if (v < 0) {
      rate = a;
      time = -v / a;
    } else if (v > 0 && d <= braking * (1 + 1e-12)) {
      // The rate that stops at the target; more than `a` where the target was moved nearer.
      rate = d > 0 ? -v * v / (2 * d) : -a;
      time = v / -rate;
    } else if (v > most_) {
      rate = -a;
      time = (v - most_) / a;
    } else if (v < most_) {
      // Speed up to the speed asked for, or to where braking begins.
      rate = a;
      const double peak = std::sqrt(a * d + v * v / 2);
      time = (std::min(most_, peak) - v) / a;
      if (!(time > 0)) {
        rate = -v * v / (2 * d);
        time = v > 0 ? v / -rate : left;
      }
    } else {
      if (v == 0) return;  // no speed to go with
      rate = 0;
      time = (d - braking) / v;
    }
    const double t = std::min(time, left);
    position_ += side * (v * t + rate * t * t / 2);
    speed_ = side * (v + rate * t);
    left -= t;
    // Ends of pieces are set exactly, so that rounding leaves no rest of the way.
    if (t == time && rate < 0 && v <= most_ * (1 + 1e-12) && d <= braking * (1 + 1e-9)) {
      position_ = target_;
      speed_ = 0;
    } else if (t == time && rate > 0 && v < 0) {
      speed_ = 0;
    }
  }
}

void StageEstimate::start(double position_um, double at_s) {
  motion_.place(position_um, at_s);
  offset_ = drift_ = error_ = 0;
  measured_ = position_um;
  measured_at_ = at_s;
  past_.clear();
}

void StageEstimate::command(double target_um, double speed_um_s, double acceleration_um_s2,
                            double at_s) {
  const double position = position_um(at_s), speed = this->speed_um_s(at_s);
  motion_.place(position, at_s, speed);
  offset_ = drift_ = error_ = 0;
  motion_.move(target_um, speed_um_s, acceleration_um_s2, at_s);
}

void StageEstimate::measure(double position_um, const double* speed_um_s, double at_s,
                            double within_s) {
  const double dt = at_s - measured_at_;
  double fastest = std::abs(motion_.speed_um_s());
  motion_.advance(at_s);
  fastest = std::max({fastest, std::abs(motion_.speed_um_s()),
                      std::abs(motion_.at(at_s + within_s).speed_um_s())});
  const double way = within_s * fastest;
  const auto beyond = [&](double off) {
    return std::copysign(std::max(0.0, std::abs(off) - way), off);
  };
  const double off = position_um - motion_.position_um();
  error_ = beyond(off);
  if (dt > 0) {
    offset_ += drift_ * dt;
    const double rest = beyond(off - offset_);
    // The drift follows the measured speed where there is one, else the positions alone.
    offset_ += 0.3 * rest;
    if (speed_um_s != nullptr) {
      drift_ += 0.5 * (*speed_um_s - motion_.speed_um_s() - drift_);
    } else {
      drift_ += 0.05 * rest / dt;
    }
    // Only at constant speed: while the motion speeds up or slows down a shift would change its
    // course.
    const double forget = motion_.cruises() ? error_ * std::min(1.0, dt / forgetting_s_) : 0;
    motion_.shift(forget);
    offset_ -= forget;
  }
  measured_ = position_um;
  measured_at_ = at_s;
  past_.push_back({at_s, motion_.position_um() + offset_});
  if (past_.size() > 256) past_.pop_front();
}

double StageEstimate::position_um(double at_s) const {
  if (at_s < measured_at_ && !past_.empty()) {
    const auto after =
        std::upper_bound(past_.begin(), past_.end(), at_s,
                         [](double t, const StagePosition& p) { return t < p.at_s; });
    if (after == past_.begin()) return past_.front().position_um;
    const auto before = std::prev(after);
    if (after == past_.end()) return before->position_um;
    const double share = (at_s - before->at_s) / (after->at_s - before->at_s);
    return before->position_um + share * (after->position_um - before->position_um);
  }
  const CommandedMotion then = motion_.at(at_s);
  // A stage that has arrived does not drift.
  const double drift = then.arrived() ? 0 : drift_;
  return then.position_um() + offset_ + drift * (at_s - measured_at_);
}

double StageEstimate::speed_um_s(double at_s) const {
  const CommandedMotion then = motion_.at(at_s);
  return then.arrived() && motion_.arrived() ? drift_ : then.speed_um_s() + drift_;
}

}  // namespace slicecorr::bridge
