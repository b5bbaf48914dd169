// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/robust_edges.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slicecorr/target.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// Aims are whole steps; edges first move by several at once, where that gains no more by fewer.
constexpr double kAimStep = 0.0025;
constexpr int kMostSteps = 60;
constexpr int kFirstStride = 4;
/// Two neighbours that each fail when the other is mended let the edges beyond them move on, pass by pass:
/// so many may pass without a gain, at first and later.
constexpr int kFirstPatience = 60, kPatience = 12;

}  // namespace

double MovedEdge::place() const { return node + (height ? edge_height_slices(height) : 0.0); }

double EdgeMover::most_aim(const CureModel& model) {
  return std::min(1.0 + kMostSteps * kAimStep, 0.5 * (1.0 + model.phi_max()));
}

void EdgeMover::put(MovedEdge& edge) const {
  edge.at_node = edge.node;
  edge.at_height = edge.height;
  if (!edge.moved()) return;
  const double dose = 1.0 + kAimStep * edge.aim;
  const double per_slice = model_.eta * units::kLn10;
  const double p0 = model_.phi_min(), p1 = model_.phi_max();
  const double at = edge.place() + (edge.upper ? -std::log((dose - p0) / (1 - p0)) / per_slice
                                               : std::log((p1 - 1) / (p1 - dose)) / per_slice);
  edge.at_node = static_cast<int>(std::lround(at));
  edge.at_height = edge_height_byte(at - edge.at_node);
}

bool EdgeMover::aim(MovedEdges& column, std::size_t k, int steps) const {
  MovedEdge b = column[k];
  b.aim = std::min(steps, kMostSteps);
  if (b.aim == column[k].aim) return false;
  const double dose = 1.0 + kAimStep * b.aim;
  if (dose > most_ || dose <= 0.5 * (1.0 + model_.phi_min())) return false;
  put(b);
  const int above = k > 0 ? column[k - 1].at_node : 0;
  const int below = k + 1 < column.size() ? column[k + 1].at_node : std::numeric_limits<int>::max();
  if (b.at_node <= above || b.at_node >= below) return false;
  column[k] = b;
  return true;
}

RobustScore::RobustScore(const std::vector<RobustTrouble>& troubles)
    : as_said(0), cases(troubles.size()) {
  for (const RobustTrouble& t : troubles) {
    as_said += t.nominal;
    miss += t.miss;
  }
}

AimSearch::AimSearch(const EdgeMover& mover, bool gives_up, MovedEdges column)
    : mover_(&mover),
      gives_up_(gives_up),
      now_(std::move(column)),
      best_(now_),
      stride_(kFirstStride),
      patience_(kFirstPatience) {}

bool AimSearch::given_up(const RobustTrouble& t) const {
  return std::any_of(given_up_.begin(), given_up_.end(),
                     [&](const RobustTrouble& g) { return g.same_place(t); });
}

bool AimSearch::go_on(const std::vector<RobustTrouble>& troubles) {
  const RobustScore score(troubles);
  if (score < least_) {
    least_ = score;
    best_ = now_;
    failing_ = troubles;
    passes_ = 0;
  } else {
    ++passes_;
  }
  if (troubles.empty()) return false;
  if (passes_ <= patience_ && push(troubles)) return true;
  patience_ = kPatience;
  while (give_way()) {
    now_ = best_;
    passes_ = 0;
    if (push(failing_)) return true;
  }
  return false;
}

/// Finer steps, or one failure less that is cared for; false: neither is left.
bool AimSearch::give_way() {
  if (stride_ > 1) {
    stride_ /= 2;
    return true;
  }
  if (!gives_up_) return false;
  const RobustTrouble* worst = nullptr;
  int others = 0;
  for (const RobustTrouble& t : failing_) {
    if (given_up(t)) continue;
    ++others;
    if (!worst || t.miss > worst->miss) worst = &t;
  }
  if (others < 2) return false;
  given_up_.push_back(*worst);
  stride_ = kFirstStride;
  return true;
}

/// Moves the edges beside what fails; false: there is no room.
bool AimSearch::push(const std::vector<RobustTrouble>& troubles) {
  std::vector<int> up(now_.size(), 0), down(now_.size(), 0);
  for (const RobustTrouble& t : troubles) {
    // What is given up is still to print with inputs as said.
    if (!t.nominal && given_up(t)) continue;
    for (std::size_t k = 0; k < now_.size(); ++k) {
      if (!now_[k].movable || (now_[k].node != t.top && now_[k].node != t.bottom)) continue;
      ++(t.gap ? down : up)[k];
    }
  }
  bool changed = false;
  for (std::size_t k = 0; k < now_.size(); ++k) {
    if ((up[k] > 0) == (down[k] > 0)) continue;  // neither, or wanted both ways
    changed = mover_->aim(now_, k, now_[k].aim + (up[k] > 0 ? stride_ : -stride_)) || changed;
  }
  return changed;
}

}  // namespace slicecorr::detail
