// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Judges whether lamps do what they are asked.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>

#include "slicecorr/bridge/plan.hpp"

namespace slicecorr::bridge {

/// One lamp's set-points over time, in shares of full light, and what was measured of it.
class LampJudge {
 public:
  LampJudge(const LampDrive& drive, double cycle_s) : drive_(drive), cycle_s_(cycle_s) {}
  /// The `count`-th set-points go out with this share.
  void asked(double share, std::uint64_t count, double at_s);
  /// All set-points up to the `count`-th were taken over by this time: what was asked before holds
  /// until then.
  void confirmed(std::uint64_t count, double at_s);
  /// What is wrong with a measured share, in words; nothing when it lies within what was asked
  /// during the time that the lamp may take to follow. `rising`: while it warms up too little
  /// light is right.
  std::optional<std::string> judge(double share, double at_s, bool rising) const;
  /// When the machine is known to have taken over what was asked last.
  std::optional<double> confirmed_at_s() const;
  /// Whether `share` was asked for long enough for the lamp to follow, and `measured` agrees with
  /// it.
  bool settled_at(double share, double measured, double at_s) const;

 private:
  std::pair<double, double> range(double at_s) const;
  struct Asked {
    double at_s, share;
    std::uint64_t count;
    bool confirmed;
  };
  LampDrive drive_;
  double cycle_s_;
  std::deque<Asked> asked_;
};

}  // namespace slicecorr::bridge
