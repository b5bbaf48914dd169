/// Where the stage should be and where it is.
#pragma once

#include <cstddef>
#include <deque>

namespace slicecorr::bridge {

/// The motion that was commanded: constant acceleration up to a speed, then down to a target.
class CommandedMotion {
 public:
  /// There, standing or going.
  void place(double position_um, double at_s, double speed_um_s = 0);
  void move(double target_um, double speed_um_s, double acceleration_um_s2, double at_s);
  /// Lets the motion go on; never back in time.
  void advance(double time_s);
  /// The whole motion is a bit further: the slow part of what is measured.
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

/// Follows the measured positions: their difference from the commanded motion, and how fast it
/// changes. Ramps are the commanded motion's, so that they need no settling here.
class StageEstimate {
 public:
  void start(double position_um, double at_s);
  /// A new motion, from where the stage is and as fast as it goes.
  void command(double target_um, double speed_um_s, double acceleration_um_s2, double at_s);
  /// A measurement of some time within `within_s` of `at_s`: what the stage may have gone in that
  /// time is no difference. `speed_um_s` null where the machine has none.
  void measure(double position_um, const double* speed_um_s, double at_s, double within_s = 0);
  /// Position and speed at a time, past (as far as is remembered) or to come.
  double position_um(double at_s) const;
  double speed_um_s(double at_s) const;
  /// Measured less commanded.
  double error_um() const { return error_; }
  double measured_um() const { return measured_; }
  double measured_at_s() const { return measured_at_; }
  const CommandedMotion& commanded() const { return motion_; }
  /// Over what time a lasting difference counts as the stage's own idea of its speed. Frames and
  /// lamps follow the measured stage, so that it does no harm.
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
