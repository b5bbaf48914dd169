// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where the stage should be and where it is.
#pragma once

#include <cstddef>
#include <deque>

namespace slicecorr::bridge {

/// The motion that was commanded: constant acceleration up to a speed, then down to a target.
class CommandedMotion {
 public:
  /// Puts the motion there, standing or going at a speed.
  void place(double position_um, double at_s, double speed_um_s = 0);
  void move(double target_um, double speed_um_s, double acceleration_um_s2, double at_s);
  /// Lets the motion go on; never back in time.
  void advance(double time_s);
  /// Moves the whole motion on: for differences from the measured stage that last.
  void shift(double by_um) { position_ += by_um; }
  double position_um() const { return position_; }
  double speed_um_s() const { return speed_; }
  double time_s() const { return time_; }
  double target_um() const { return target_; }
  bool arrived() const { return position_ == target_ && speed_ == 0; }
  bool cruises() const { return speed_ == most_ || speed_ == -most_; }
  /// Position and speed at a later time.
  CommandedMotion at(double time_s) const {
    CommandedMotion m = *this;
    m.advance(time_s);
    return m;
  }

 private:
  double position_ = 0, speed_ = 0, time_ = 0;  ///< speed signed
  double target_ = 0, most_ = 0, acceleration_ = 1;
};

/// Estimates where the stage is: the commanded motion plus an offset, which follows the measured
/// positions, and a drift of the offset. Ramps are part of the commanded motion, so the estimate
/// need not settle after them.
class StageEstimate {
 public:
  void start(double position_um, double at_s);
  /// Begins a new motion from the estimated position and speed.
  void command(double target_um, double speed_um_s, double acceleration_um_s2, double at_s);
  /// The motion goes on to its target with another speed. What it differs from the measured stage
  /// stays known.
  void change_speed(double speed_um_s, double acceleration_um_s2, double at_s) {
    motion_.move(motion_.target_um(), speed_um_s, acceleration_um_s2, at_s);
  }
  /// Takes a measurement that was true some time within `within_s` of `at_s`: the way that the
  /// stage may go in that time does not count as a difference. `speed_um_s`: null where none is
  /// measured.
  void measure(double position_um, const double* speed_um_s, double at_s, double within_s = 0);
  /// Position and speed at a time, past (as far as is remembered) or to come.
  double position_um(double at_s) const;
  double speed_um_s(double at_s) const;
  /// Measured less commanded position.
  double error_um() const { return error_; }
  double measured_um() const { return measured_; }
  const CommandedMotion& commanded() const { return motion_; }
  /// Time over which a lasting difference is taken into the commanded motion: a stage whose speed
  /// is a little off. That does no harm, since frames and lamps follow the measured stage.
  void set_forgetting_s(double s) { forgetting_s_ = s; }

 private:
  CommandedMotion motion_;
  double offset_ = 0, drift_ = 0;  ///< estimate less commanded, um, um/s
  double error_ = 0, measured_ = 0, measured_at_ = 0, forgetting_s_ = 2;
  struct StagePosition {
    double at_s, position_um;
  };
  std::deque<StagePosition> past_;
};

}  // namespace slicecorr::bridge
