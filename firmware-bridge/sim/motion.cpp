// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sim/motion.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::bridge::detail {

MotionPiece next_piece(const Motion& now, const Course& course) {
  const double a = course.acceleration_um_s2;
  const double speed = std::abs(now.speed_um_s);
  const double way = now.speed_um_s < 0 ? -1 : 1;
  const double braking_um = speed * speed / (2 * a);
  const auto brake = [&] {
    return MotionPiece{-way * a, speed / a, {now.at_um + way * braking_um, 0}};
  };
  if (!course.moving) return speed == 0 ? MotionPiece{0, INFINITY, now} : brake();

  const double distance = course.target_um - now.at_um;
  if (speed == 0 && distance == 0) return {0, INFINITY, now};
  const double side = distance < 0 ? -1 : 1;
  const double left = std::abs(distance);
  // Away from the target, or too fast to stop there: brake, then come back.
  const double slack = 1e-9 * std::max(1.0, left);
  if (speed > 0 && braking_um <= left + slack && braking_um >= left - slack) {
    return {-way * a, speed / a, {course.target_um, 0}};
  }
  if (speed > 0 && (way != side || braking_um > left)) return brake();
  const double fastest = std::max(course.speed_um_s, 0.0);
  if (speed > fastest) {
    const double time = (speed - fastest) / a;
    return {-side * a, time, {now.at_um + side * (speed + fastest) / 2 * time, side * fastest}};
  }
  if (fastest == 0) return {0, INFINITY, now};
  const double peak = std::min(fastest, std::sqrt(a * left + speed * speed / 2));
  if (peak > speed * (1 + 1e-12)) {
    const double time = (peak - speed) / a;
    return {side * a, time, {now.at_um + side * (speed + peak) / 2 * time, side * peak}};
  }
  const double time = (left - braking_um) / speed;
  return {0, time, {course.target_um - side * braking_um, now.speed_um_s}};
}

Motion within(const Motion& begin, const MotionPiece& piece, double t) {
  if (t >= piece.duration_s) return piece.end;
  return {begin.at_um + begin.speed_um_s * t + piece.acceleration_um_s2 * t * t / 2,
          begin.speed_um_s + piece.acceleration_um_s2 * t};
}

double time_to(const Motion& begin, double a, double um) {
  const double way = um - begin.at_um, v = begin.speed_um_s;
  if (way == 0) return 0;
  if (a == 0) return v != 0 && way / v > 0 ? way / v : INFINITY;
  const double root2 = v * v + 2 * a * way;
  if (root2 < 0) return INFINITY;
  // The form of the roots that does not lose digits; the lesser time that is not negative.
  const double q = -(v + std::copysign(std::sqrt(root2), v));
  const double first = q / a, second = q != 0 ? -2 * way / q : INFINITY;
  const double low = std::min(first, second), high = std::max(first, second);
  return low >= 0 ? low : high >= 0 ? high : INFINITY;
}

}  // namespace slicecorr::bridge::detail
