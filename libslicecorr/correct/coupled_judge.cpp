// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <iterator>
#include <tuple>
#include <utility>

#include "correct/coupled_cases.hpp"
#include "correct/coupled_patch.hpp"
#include "cure/margin.hpp"

namespace slicecorr::detail {

namespace {

class PatchJudge : public PatchField<double> {
 public:
  PatchJudge(const CoupledPlan& plan, const PixelBox& box, const PatchSources& sources,
             std::size_t most_misses)
      : PatchField(plan, PatchPlace::grown(box, plan.halo_x, plan.halo_y)),
        box_(box),
        most_misses_(most_misses),
        near_(1 - plan.margin),
        near_at_nodes_(near_ * plan.norm / (1 + plan.below)),
        levels_at_(place(), place().shown, sources.levels),
        coverage_(place(), box, sources.coverage),
        above_(place(), box, sources.coverage),
        left_(place(), box, sources.left_alone),
        aims_(place(), box, sources.aims),
        aims_any_(!sources.aims.empty()),
        columns_(place(), place().watched, sources.columns),
        kind_(place().size(), 0),
        next_(place().size(), 0) {
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) kind_[place().at(x, y)] = -1;
    }
    if (plan.joint > 0 || plan.graded) {
      guide_.assign(place().size(), 0);
      own_.resize(place().size());
      for (std::size_t at = 0; at < own_.size(); ++at) own_[at] = light_of(0, at);
    }
  }
  PatchFigures run() {
    for (int n = plan_.slices; n-- > 0;) judge(n);
    figures_.through = sums_.through;
    figures_.under = sums_.under;
    figures_.parted = sums_.parted;
    figures_.loss = sums_.loss;
    figures_.misses = std::move(misses_);
    return std::move(figures_);
  }

 private:
  void judge(int n) {
    begin(n);
    middle_ = {plan_.middle_below(n), plan_.middle_norm(n)};
    const double gain = plan_.gain(n), kept = plan_.kept(n);
    changes_.clear();
    levels_at_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t is) {
      changes_.push_back({at, is});
    });
    show(changes_);
    const auto note = [&](std::size_t at, std::uint8_t, std::uint8_t) {
      const std::uint8_t cover = coverage_[at];
      // The platform is a layer to hold on to.
      const bool holds = plan_.layerwise && (n == 0 || above_[at] == 255);
      kind_[at] = left_[at] != 0 ? 0 : cover == 255 ? (holds ? 2 : 1) : cover == 0 ? -1 : 0;
      wake(square_of(at));
    };
    if (!guide_.empty()) {
      columns_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t is) {
        wake(square_of(at));
        own_[at] = light_of(is, at);
      });
    }
    if (plan_.layerwise && n > 0) above_.go_to(n - 1, note);
    coverage_.go_to(n, note);
    left_.go_to(n, note);
    aims_.go_to(n, [](std::size_t, std::uint8_t, std::uint8_t) {});
    if (plan_.layerwise && n == 0) {
      for (int y = box_.y0; y < box_.y1; ++y) {
        for (int x = box_.x0; x < box_.x1; ++x) note(place().at(x, y), 0, 0);
      }
    }
    for (const int k : watched()) {
      if (square(k).asleep) continue;
      const std::size_t first = first_of(k), stride = place().stride;
      const double* const seen = seen_light(k);
      step_square(next_.data() + first, seen + first, below() + first, stride, gain, kept);
      if (!guide_.empty()) {
        step_square(guide_.data() + first, own_.data() + first, guide_.data() + first, stride, gain,
                    kept);
      }
      if (plan_.joint > 0) {
        judge_lifted(n, first, seen);
      } else if (judge_square(next_.data() + first, dose_.data() + first, kind_.data() + first,
                              stride, middle_, near_, sums_)) {
        collect(n, first);
      }
      if (aims_any_) judge_aims(n, first);
      if (plan_.graded) judge_graded(first);
      for (std::size_t y = 0; y < kSquare; ++y) {
        std::copy_n(next_.data() + first + y * stride, kSquare, dose_.data() + first + y * stride);
      }
      const int calm = square(k).touched_at - n;
      if (may_sleep() && !aims_any_ && !plan_.graded && calm >= kCalm && calm % 4 == 3 && !lacks_ &&
          stays_right(seen + first, dose_.data() + first, kind_.data() + first, stride,
                      near_at_nodes_)) {
        sleep(k);
      }
    }
  }
  /// With lifts: each exposure by itself, too, and gaps are wrong only where a column alone is right.
  void judge_lifted(int n, std::size_t first, const double* seen) {
    lacks_ = false;
    const auto miss = [&](std::size_t k, double excess, bool wrong, bool own) {
      if (misses_.size() >= most_misses_) {
        figures_.all_misses = false;
        return;
      }
      const Pixel p = place().pixel(k);
      misses_.push_back({n, p.x, p.y, static_cast<float>(excess), wrong, own});
    };
    for (std::size_t y = 0; y < kSquare; ++y) {
      const std::size_t from = first + y * place().stride;
      for (std::size_t k = from; k < from + kSquare; ++k) {
        if (kind_[k] == 0) continue;
        const double middle = middle_.of(next_[k], dose_[k]);
        if (kind_[k] < 0) {
          const double alone = middle_.of(guide_[k], guide_[k]) * (1 + 1e-6);
          if (middle < near_ || middle < alone) continue;
          if (middle >= 1) {
            const double over = middle - std::max(1.0, alone);
            sums_.loss += over * over / 2;
            ++sums_.through;
          }
          miss(k, std::max(middle - std::max(near_, alone), 1e-9), middle >= 1, false);
          continue;
        }
        const double lacks = std::max(0.0, 1 - next_[k]);
        sums_.loss += lacks * lacks / 2;
        sums_.under += middle < 1;
        if (lacks > 0) miss(k, -lacks, middle < 1, false);
        const double held = plan_.gain(n) * (seen[k] - plan_.least_own(n, own_[k]));
        if (held >= -kMargin) continue;
        sums_.loss += held * held / 2;
        ++sums_.parted;
        lacks_ = true;
        miss(k, held, true, true);
      }
    }
  }
  /// Doses inside features are to be those of the columns alone; pixels beside gaps have their outline.
  void judge_graded(std::size_t first) {
    for (std::size_t y = 0; y < kSquare; ++y) {
      const std::size_t from = first + y * place().stride;
      for (std::size_t k = from; k < from + kSquare; ++k) {
        const std::size_t beside[] = {k - 1, k + 1, k - place().stride, k + place().stride};
        if (kind_[k] <= 0 || std::any_of(std::begin(beside), std::end(beside),
                                         [&](std::size_t at) { return kind_[at] < 0; })) {
          continue;
        }
        // A margin more, as the solver aims, and as far off is well.
        const double off = std::abs(next_[k] - std::max(1.0, guide_[k]) - plan_.margin);
        if (off > plan_.margin) sums_.loss += (off - plan_.margin) * (off - plan_.margin) / 2;
      }
    }
  }
  /// Doses that are wanted beside what the design asks.
  void judge_aims(int n, std::size_t first) {
    for (std::size_t y = 0; y < kSquare; ++y) {
      const std::size_t from = first + y * place().stride;
      for (std::size_t k = from; k < from + kSquare; ++k) {
        if (aims_[k] == 0 || gives_way(aims_[k]) || kind_[k] == 0) continue;
        const double wanted = aim_of_byte(aims_[k]);
        const double excess = (kind_[k] > 0 ? next_[k] : middle_.of(next_[k], dose_[k])) - wanted;
        if (kind_[k] > 0 ? excess >= 0 : excess < 0) continue;
        ++figures_.unmet;
        sums_.loss += excess * excess / 2;
        if (!figures_.all_misses || misses_.size() >= most_misses_) {
          figures_.all_misses = false;
          continue;
        }
        const Pixel p = place().pixel(k);
        misses_.push_back({n, p.x, p.y, static_cast<float>(excess), true});
      }
    }
  }
  /// `dose_` is still at the lower node, `next_` at the upper one.
  void collect(int n, std::size_t first) {
    if (!figures_.all_misses) return;
    for (std::size_t y = 0; y < kSquare; ++y) {
      for (std::size_t k = first + y * place().stride; k < first + y * place().stride + kSquare;
           ++k) {
        const double middle = middle_.of(next_[k], dose_[k]);
        double excess = 0;
        if (kind_[k] > 0 && next_[k] < 1) excess = next_[k] - 1;
        if (kind_[k] > 0 && middle < 1) excess = std::min(excess, middle - 1);
        if (kind_[k] < 0 && middle >= near_) excess = middle - near_;
        if (kind_[k] < 0 && middle >= near_ && excess <= 0) excess = 1e-9;
        if (excess == 0) continue;
        const Pixel p = place().pixel(k);
        const bool parted = kind_[k] > 1 && next_[k] < 1;
        const bool wrong = kind_[k] > 0 ? middle < 1 || parted : middle >= 1;
        misses_.push_back({n, p.x, p.y, static_cast<float>(excess), wrong});
      }
    }
    figures_.all_misses = misses_.size() < most_misses_;
  }

  PixelBox box_;
  std::size_t most_misses_;
  MiddleRule middle_{0, 1};  ///< of the slice at hand
  double near_;              ///< of the middles of gaps
  double near_at_nodes_;  ///< where both nodes of a gap's layer are below it, its middle is near_
  PatchBytes levels_at_, coverage_, above_, left_, aims_;
  bool aims_any_;  ///< whether doses are wanted
  PatchBytes columns_;
  bool lacks_ = false;  ///< with lifts: something of the square that was judged last does not hold
  std::vector<double> kind_, next_;
  std::vector<Change> changes_;
  SquareSums sums_;
  PatchFigures figures_;
  std::vector<Miss> misses_;
};

}  // namespace

PatchFigures judge_patch(const CoupledPlan& plan, const PixelBox& box, const PatchSources& sources,
                         std::size_t most_misses) {
  return PatchJudge(plan, box, sources, most_misses).run();
}

std::vector<Request> requests_of(const CoupledPlan& plan, const std::vector<Miss>& misses,
                                 double urgency) {
  // With an urgency of 1 the requests of all slices together undo the miss, if all are granted.
  const double share = urgency * (1 - plan.a * plan.fading) / plan.b;
  // Less than a part of a level step leads nowhere.
  const double least = plan.shine_step / 3;
  std::vector<Request> requests;
  for (const Miss& miss : misses) {
    if (miss.own) {
      requests.push_back({miss.slice, miss.x, miss.y, static_cast<float>(miss.excess / plan.b)});
      continue;
    }
    double less = miss.excess * share;
    for (int k = 0; k <= plan.depth && miss.slice + k < plan.slices; ++k, less *= plan.fading) {
      if (std::abs(less) < least) break;
      requests.push_back({miss.slice + k, miss.x, miss.y, static_cast<float>(less)});
    }
  }
  const auto key = [](const Request& r) { return std::tuple(-r.slice, r.y, r.x); };
  std::sort(requests.begin(), requests.end(), [&](const Request& l, const Request& r) {
    return std::tuple(key(l), l.less) < std::tuple(key(r), r.less);
  });
  // Of one place the greatest of each sign count.
  std::size_t kept = 0;
  for (std::size_t i = 0; i < requests.size();) {
    Request sum = requests[i];
    float low = 0, high = 0;
    for (; i < requests.size() && key(requests[i]) == key(sum); ++i) {
      low = std::min(low, requests[i].less);
      high = std::max(high, requests[i].less);
    }
    sum.less = low + high;
    if (std::abs(sum.less) >= least) requests[kept++] = sum;
  }
  requests.resize(kept);
  return requests;
}

}  // namespace slicecorr::detail
