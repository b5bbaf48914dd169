// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "control/lamps.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace slicecorr::bridge {

void LampJudge::asked(double share, std::uint64_t count, double at_s) {
  if (!asked_.empty() && asked_.back().share == share) return;
  asked_.push_back({at_s, share, count, false});
  // Of the set-points before the time that matters the last one is kept: it was in force then.
  while (asked_.size() > 2 && asked_[1].confirmed &&
         asked_[1].at_s < at_s - drive_.settle_s - 10 * cycle_s_ - 1) {
    asked_.pop_front();
  }
}

void LampJudge::confirmed(std::uint64_t count, double at_s) {
  for (auto a = asked_.rbegin(); a != asked_.rend() && !a->confirmed; ++a) {
    if (a->count > count) continue;
    a->confirmed = true;
    a->at_s = std::max(a->at_s, at_s);
  }
}

std::pair<double, double> LampJudge::range(double at_s) const {
  // Two cycles more, because an answer confirms set-points, not what the lamp's driver makes of
  // them.
  const double from_s = at_s - drive_.settle_s - 2 * cycle_s_;
  double least = 0, most = 0;
  bool first = true;
  for (std::size_t i = 0; i < asked_.size(); ++i) {
    const bool last = i + 1 == asked_.size();
    if (!last && asked_[i + 1].confirmed && asked_[i + 1].at_s < from_s) continue;
    least = first ? asked_[i].share : std::min(least, asked_[i].share);
    most = first ? asked_[i].share : std::max(most, asked_[i].share);
    first = false;
  }
  return {least, most};
}

std::optional<std::string> LampJudge::judge(double share, double at_s, bool rising) const {
  const auto [least, most] = range(at_s);
  if (share <= most + drive_.tolerance && (rising || share >= least - drive_.tolerance)) return {};
  return least == most
             ? fmt::format("is at {:.1f} % of full light, asked {:.1f} %, tolerance {:g} %",
                           share * 100, most * 100, drive_.tolerance * 100)
             : fmt::format(
                   "is at {:.1f} % of full light, asked {:.1f} to {:.1f} %, tolerance {:g} %",
                   share * 100, least * 100, most * 100, drive_.tolerance * 100);
}

std::optional<double> LampJudge::confirmed_at_s() const {
  if (asked_.empty() || !asked_.back().confirmed) return std::nullopt;
  return asked_.back().at_s;
}

bool LampJudge::settled_at(double share, double measured, double at_s) const {
  const auto [least, most] = range(at_s);
  return least == most && most == share && std::abs(measured - share) <= drive_.tolerance;
}

}  // namespace slicecorr::bridge
