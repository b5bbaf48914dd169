// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A lamp that follows what is asked of it.
#pragma once

#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::bridge::detail {

/// Light as a share of what the calibration says: first-order response of the current with the time
/// constant settle_s / ln 100, times warm-up (0.8 when cold, rising linearly with the time lit to 1
/// after warm_up_s; it cools as fast), times drift. Off is off at once: the driver is cut.
class Lamp {
 public:
  explicit Lamp(const LampDrive& drive);

  /// 0 or below min_share: off.
  void ask(double share);
  void cut();  ///< by the safety relay
  void fail() { failed_ = true; }
  void stick() { stuck_ = true; }
  bool failed() const { return failed_; }
  /// Over one second the light becomes 1 + `share` times what it should be.
  void drift(double share);

  bool on() const { return asked_ > 0; }
  double light() const { return light_at(0); }
  /// Until something about it changes its form: longer steps must not be taken.
  double steady_for_s() const;
  /// Integral of light^m over the next `time_s`, at most `steady_for_s()`.
  double integral(double time_s, double m) const;
  void advance(double time_s);

 private:
  double light_at(double time_s) const;
  double warmth_at(double time_s) const;
  double drift_at(double time_s) const;
  bool settled() const { return level_ == asked_; }

  LampDrive drive_;
  double time_constant_s_;
  double asked_ = 0, level_ = 0;
  double lit_s_ = 0;  ///< counts up while lit, down while not
  double drift_ = 0, drifting_s_ = 0;
  bool failed_ = false, stuck_ = false;
};

}  // namespace slicecorr::bridge::detail
