// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A stage that accelerates, cruises and brakes with a constant acceleration.
#pragma once

#include <limits>

namespace slicecorr::bridge::detail {

struct Motion {
  double at_um = 0, speed_um_s = 0;
};

/// Where it is going; `moving` false: it brakes and stays where it then is.
struct Course {
  bool moving = false;
  double target_um = 0;
  double speed_um_s = 0;  ///< greatest
  double acceleration_um_s2 = 1;
};

/// The way up to the next change of acceleration, with what holds exactly at its end.
struct MotionPiece {
  double acceleration_um_s2 = 0;
  double duration_s = std::numeric_limits<double>::infinity();
  Motion end;
};
MotionPiece next_piece(const Motion& now, const Course& course);

/// After `time_s` of a piece.
Motion within(const Motion& begin, const MotionPiece& piece, double time_s);

/// Time until a moving stage is at `um` within a piece that lasts long enough; infinite when it
/// does not get there.
double time_to(const Motion& begin, double acceleration_um_s2, double um);

}  // namespace slicecorr::bridge::detail
