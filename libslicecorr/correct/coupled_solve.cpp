// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "correct/coupled_cases.hpp"
#include "correct/coupled_solver.hpp"

namespace slicecorr::detail {

namespace {

/// Doses are single: where they pass a bound by less, rounding may have done it.
constexpr float kSlack = 2e-5F;
/// Changes of what bounds ask of the middles of layers that are noticed: a part of the least margin.
constexpr double kNoticedRule = 2e-5;
/// Changes of light that are noticed.
constexpr float kNoticed = 1e-4F;
/// Of these the first look at the nearest pixels only.
constexpr int kNearestPasses = 2;
/// Looks at all pixels around wrong ones, per slice.
constexpr int kPasses = 4;
/// Added to the curvature of one pixel's change: light is shared out between neighbours, which
/// keeps it smooth where they want the same.
constexpr float kSharing = 0.1F;
/// Changes of light that are worth it, in steps of levels.
constexpr float kLeastChange = 0.15F;
/// Weights of edges, greys, requests and wanted doses beside those of voxels.
constexpr float kEdgeWeight = 0.1F, kGreyWeight = 0.2F, kRequestWeight = 0.5F, kWantedWeight = 0.3F;
/// Of layers that are to hold at their lift: a part that does not is lost.
constexpr float kHoldWeight = 16;
/// Greatest dose wanted of a feature's pixel beside a gap: the outline runs where the dose between
/// the two is 1.
constexpr float kRimDose = 1.2F;
/// The same over the dose that layers which just hold add up to.
constexpr double kRimOfHeld = 1.05;
/// Dose wanted in pixels that are partly covered, 1 where the outline runs through their middle,
/// per share that is covered.
constexpr float kGreySlope = 0.5F;
/// How far from it is near enough.
constexpr float kGreyBand = 0.1F;

}  // namespace

void PatchSolver::show_slice(int n) {
  changes_.clear();
  before_.go_to(n, [&](std::size_t at, std::uint8_t was, std::uint8_t is) {
    int level = is;
    if (task_.first && levels_[at] != was) {
      level = std::clamp(static_cast<int>(levels_[at]) + is - was, 0, plan_.top);
    }
    if (level != levels_[at]) changes_.push_back({at, static_cast<std::uint8_t>(level)});
  });
  if (!task_.first) {
    for (const std::size_t at : altered_) {
      if (levels_[at] != before_[at]) changes_.push_back({at, before_[at]});
    }
    altered_.clear();
  }
  shown_changed_ = shown_changed_ || !changes_.empty();
  show(changes_);
  columns_.go_to(n,
                 [&](std::size_t at, std::uint8_t, std::uint8_t) { to_classify_.push_back(at); });
}

void PatchSolver::note_coverage(int n) {
  const auto take = [&](std::size_t at) {
    here_[at] = above_[at];
    to_classify_.push_back(at);
    for_neighbours(at, [&](std::size_t beside) { to_classify_.push_back(beside); });
  };
  const auto note = [&](std::size_t at, std::uint8_t, std::uint8_t) {
    coverage_changes_.push_back(at);
    to_classify_.push_back(at);
  };
  if (n == plan_.slices - 1) {
    above_.go_to(n, note);
    to_classify_ = asked_;
  }
  for (const std::size_t at : coverage_changes_) take(at);
  coverage_changes_.clear();
  if (n > 0) above_.go_to(n - 1, note);
  left_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t is) {
    if (is != 0) {
      marked_[at] &= static_cast<std::uint8_t>(~kMayChange);
      if (levels_[at] != before_[at]) {
        show(at, before_[at]);
        shown_changed_ = true;
      }
    }
    if (is == 0 && share_at(at) > 0 && PatchPlace::holds(task_.free, place().pixel(at))) {
      marked_[at] |= kMayChange;
    }
    to_classify_.push_back(at);
  });
  // What bounds ask of the middles of layers changes below a platform that sends light back.
  const double below = plan_.middle_below(n), norm = plan_.middle_norm(n);
  if (std::abs(below - below_) + std::abs(norm - norm_) > kNoticedRule) {
    below_ = below;
    norm_ = norm;
    to_classify_ = asked_;
  }
  aims_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t) { to_classify_.push_back(at); });
  for (const std::size_t at : to_classify_) {
    if (!square(square_of(at)).watched || !is_asked(at)) continue;
    wake(square_of(at));
    classify(at);
  }
  to_classify_.clear();
}

void PatchSolver::classify(std::size_t at) {
  const int cover = here_[at], above = above_[at];
  const std::uint8_t level = columns_[at];
  const auto margin = static_cast<float>(plan_.margin);
  set_free(at);
  own_[at] = light_of(level, at);
  if (left_[at] != 0) return;
  if (cover == 255) {
    least_[at] = above == 255 ? 1 + margin : 1;
    if (above == 0) most_[at] = 1 + 1.5F * margin;
    if (aims_[at] != 0) {
      // Below 1: an upper edge that gives way for the gap above it.
      const auto aim = static_cast<float>(aim_of_byte(aims_[at]));
      least_[at] = aim < 1 ? aim : std::max(least_[at], aim);
      most_[at] = std::max(most_[at], least_[at] + margin);
      return;
    }
    if (above != 255) return;
    if (level < plan_.top) over_guide_[at] = 0;
    bool rim = false;
    for_neighbours(at, [&](std::size_t beside) { rim = rim || here_[beside] == 0; });
    if (rim) soft_[at] = std::max(kRimDose, 1 + 4 * margin);
    // What holds at each lift adds up to this.
    if (rim && plan_.joint > 0) {
      soft_[at] =
          std::max(soft_[at], static_cast<float>(kRimOfHeld * plan_.joint /
                                                 plan_.columns.model.one_minus_a_of(slice())));
    }
    if (plan_.graded) {
      // As the column alone has it, as far as outlines and gaps allow.
      under_guide_[at] = 0;
      over_guide_[at] = margin;
      low_weight_[at] = high_weight_[at] = kWantedWeight;
    }
  } else if (cover == 0) {
    most_[at] = (1 - margin) * static_cast<float>(norm_);
    share_[at] = static_cast<float>(below_);
    const auto aim = static_cast<float>(aims_[at] != 0 ? aim_of_byte(aims_[at]) : 1.0);
    most_[at] *= aim;
    if (above == 255) {
      if (!plan_.layerwise) least_[at] = std::min(1.0F, aim);
    } else if (level > 0) {
      under_guide_[at] = 0;
    }
  } else {
    // On steep walls the outline runs through the pixel; on slopes the column knows better.
    if (std::abs(cover - above) < 32) {
      own_[at] = guide_[at] = 1 + kGreySlope * (static_cast<float>(cover) / 255 - 0.5F);
    }
    over_guide_[at] = under_guide_[at] = kGreyBand;
    // What is mostly covered is mostly a feature.
    low_weight_[at] = cover < 128 ? kGreyWeight / 4 : kGreyWeight;
    high_weight_[at] = cover < 128 ? kGreyWeight : kGreyWeight / 4;
    if (above == 255 && !plan_.layerwise) least_[at] = 1;
  }
}

void PatchSolver::find_aims(int n) {
  flagged_.clear();
  aimed_.clear();
  requests_from_ = next_request_;
  while (next_request_ != task_.requests.end() && next_request_->slice == n) ++next_request_;
  requests_to_ = next_request_;
  const auto gain = static_cast<float>(plan_.gain(n)), kept = static_cast<float>(plan_.kept(n));
  const std::size_t stride = place().stride;
  for (auto r = requests_from_; r != requests_to_; ++r) {
    const std::size_t at = place().at(r->x, r->y);
    rouse(square_of(at));
    flagged_.push_back(square_of(at));
    check_on(square_of(at), n);
  }
  for (const int k : watched()) {
    if (square(k).asleep) continue;
    const std::size_t first = first_of(k);
    step_square(guide_.data() + first, own_.data() + first, guide_.data() + first, stride, gain,
                kept);
    if (!task_.first && check_until_[static_cast<std::size_t>(k)] > n) continue;
    if (passes_bounds(seen_light(k) + first, below() + first, dose_.data() + first,
                      guides_of(first), bounds_of(first), stride, gain, kept,
                      task_.first ? kSlack : 0.75F * static_cast<float>(plan_.margin),
                      task_.first) ||
        lacks_own(first, seen_light(k) + first)) {
      flagged_.push_back(k);
    }
  }
  guides_stepped_ = true;
  for (const int k : flagged_) aim(k);
  if (flagged_.empty()) return;
  apply_requests();
  find_missed(missed_, 0);
  for (const int k : aimed_) changed_[static_cast<std::size_t>(k)] = look_;
  // What is tried for a pixel is weighed against what pixels around that want.
  const int far_x = 2 * plan_.near_x, far_y = 2 * plan_.near_y;
  for (const std::size_t at : missed_) {
    const int x = static_cast<int>(at % place().stride), y = static_cast<int>(at / place().stride);
    for (int j = (y - far_y) / kSquare; j <= (y + far_y) / kSquare; ++j) {
      for (int i = (x - far_x) / kSquare; i <= (x + far_x) / kSquare; ++i) aim(j * across() + i);
    }
  }
}

void PatchSolver::aim(int k) {
  if (!square(k).watched || aimed_at_[static_cast<std::size_t>(k)] == slice()) return;
  aimed_at_[static_cast<std::size_t>(k)] = slice();
  aimed_.push_back(k);
  // Not looked at yet.
  changed_[static_cast<std::size_t>(k)] = look_ + 1;
  rouse(k);
  const std::size_t first = first_of(k), stride = place().stride;
  const AimRule rule{static_cast<float>(plan_.gain(slice())),
                     static_cast<float>(plan_.kept(slice())),
                     static_cast<float>(plan_.light_of[255] * ratio_),
                     0.5F * static_cast<float>(plan_.margin / plan_.b_of(slice())),
                     kEdgeWeight,
                     task_.first};
  aim_square(seen_light(k) + first, below() + first, dose_.data() + first, guides_of(first),
             bounds_of(first), {low_weight_.data() + first, high_weight_.data() + first}, stride,
             rule,
             {lo_.data() + first, hi_.data() + first, lo_weight_.data() + first,
              hi_weight_.data() + first},
             raw_lo_.data() + first, raw_hi_.data() + first);
  const float room = static_cast<float>(plan_.margin / plan_.b_of(slice()));
  for (std::size_t y = 0; y < kSquare && plan_.joint > 0; ++y) {
    const std::size_t from = first + y * stride;
    for (std::size_t at = from; at < from + kSquare; ++at) {
      const float least = std::min(least_own(at), rule.bright);
      if (least <= 0 || least + room <= raw_lo_[at]) continue;
      raw_lo_[at] = std::min(least + room, rule.bright);
      lo_[at] = std::max(lo_[at], raw_lo_[at]);
      raw_hi_[at] = std::max(raw_hi_[at], raw_lo_[at]);
      hi_[at] = std::max(hi_[at], lo_[at]);
      lo_weight_[at] = kHoldWeight;
    }
  }
  for (std::size_t y = 0; y < kSquare && aims_any_; ++y) {
    const std::size_t from = first + y * stride;
    for (std::size_t at = from; at < from + kSquare; ++at) {
      if (is_neck(aims_[at])) lo_weight_[at] = kHoldWeight;
    }
  }
  for (std::size_t y = 0; y < kSquare; ++y) {
    const std::size_t from = first + y * stride;
    std::fill_n(looked_at_.begin() + static_cast<std::ptrdiff_t>(from), kSquare, kFree);
    if (leaving_) {
      // What leaves the bath is to be shown, too.
      for (std::size_t at = from; at < from + kSquare; ++at) {
        for (auto* field : {&lo_, &hi_, &raw_lo_, &raw_hi_}) {
          if (std::abs((*field)[at]) < kFree / 2) (*field)[at] += taken(at);
        }
      }
    }
    if (plan_.m == 1) continue;
    // From what doses take to what is blurred.
    for (std::size_t at = from; at < from + kSquare; ++at) {
      for (auto* field : {&lo_, &hi_, &raw_lo_, &raw_hi_}) {
        float& v = (*field)[at];
        if (v > 0 && v < kFree / 2) v = std::pow(v, static_cast<float>(1 / plan_.m));
      }
    }
  }
}

void PatchSolver::apply_requests() {
  for (auto r = requests_from_; r != requests_to_; ++r) {
    const std::size_t at = place().at(r->x, r->y);
    const float wanted = light_[at] - r->less;
    if (r->less > 0 && wanted < hi_[at]) {
      hi_[at] = raw_hi_[at] = std::max({wanted, raw_lo_[at], shine_of(0, at)});
      lo_[at] = std::min(lo_[at], hi_[at]);
      hi_weight_[at] = kRequestWeight;
    } else if (r->less < 0 && wanted > lo_[at]) {
      lo_[at] = raw_lo_[at] = std::min({wanted, raw_hi_[at], shine_of(255, at)});
      hi_[at] = std::max(hi_[at], lo_[at]);
      if (!is_neck(aims_[at])) lo_weight_[at] = kRequestWeight;
    }
  }
}

/// Of squares whose light has not changed since the last look nothing is missed anew: `since` is when that was.
void PatchSolver::find_missed(std::vector<std::size_t>& missed, std::uint64_t since) {
  missed.clear();
  const float *const light = light_.data(), *const raw_lo = raw_lo_.data(),
                     *const raw_hi = raw_hi_.data();
  float* const looked_at = looked_at_.data();
  for (const int k : aimed_) {
    if (changed_[static_cast<std::size_t>(k)] < since) continue;
    const std::size_t first = first_of(k);
    if (!any_missed(light + first, raw_lo + first, raw_hi + first, place().stride, kNoticed)) {
      continue;
    }
    for (std::size_t y = 0; y < kSquare; ++y) {
      const std::size_t from = first + y * place().stride;
      for (std::size_t at = from; at < from + kSquare; ++at) {
        const float v = light[at];
        if (v >= raw_lo[at] - kNoticed && v <= raw_hi[at] + kNoticed) continue;
        // What the last look did not change, another one won't.
        if (std::abs(v - looked_at[at]) < kNoticed) continue;
        looked_at[at] = v;
        missed.push_back(at);
      }
    }
  }
}

/// Wakes the squares whose light a pixel changes, and notes them for the look at hand.
void PatchSolver::touch_around(std::size_t at) {
  const SquareBox around = squares_around(at);
  // Pixels that are tried follow each other, and most have the same around them.
  if (around == last_around_) return;
  last_around_ = around;
  for (int j = around.y0; j <= around.y1; ++j) {
    for (int i = around.x0; i <= around.x1; ++i) {
      wake(j * across() + i);
      changed_[static_cast<std::size_t>(j * across() + i)] = look_;
    }
  }
}

void PatchSolver::choose() {
  const float least = kLeastChange * static_cast<float>(plan_.shine_step * scale_);
  const AimRows aim{lo_.data(), hi_.data(), lo_weight_.data(), hi_weight_.data()};
  const std::size_t stride = place().stride;
  const auto near_x = static_cast<std::size_t>(plan_.near_x),
             near_y = static_cast<std::size_t>(plan_.near_y),
             try_x = static_cast<std::size_t>(plan_.try_x),
             try_y = static_cast<std::size_t>(plan_.try_y);
  const std::size_t far = std::min<std::size_t>(near_x, kSquare / 2),
                    far_rows = std::min<std::size_t>(near_y, kSquare / 2) * stride;
  touched_.clear();
  for (int pass = 0; pass < kPasses && !missed_.empty(); ++pass) {
    tried_.clear();
    ++look_;
    last_around_ = {};
    // Those around it mend most; what they can't, those further away may.
    const std::size_t dx = pass < kNearestPasses ? try_x : near_x,
                      dy = pass < kNearestPasses ? try_y : near_y;
    for (const std::size_t at : missed_) {
      for (std::size_t y = at - dy * stride; y <= at + dy * stride; y += stride) {
        for (std::size_t j = y - dx; j <= y + dx; ++j) {
          if ((marked_[j] & (kMayChange | kTried)) != kMayChange) continue;
          marked_[j] |= kTried;
          tried_.push_back(j);
        }
      }
    }
    for (const std::size_t j : tried_) marked_[j] ^= kTried;
    if (pass & 1) std::reverse(tried_.begin(), tried_.end());
    for (const std::size_t j : tried_) {
      const std::size_t first = j - near_y * stride - near_x;
      const Pull pull = pull_of(light_.data(), aim, first, stride, plan_.near_taps.data(),
                                plan_.near_rows, plan_.near_width);
      if (pull.curvature <= 0) continue;
      const float shine = std::clamp(shine_[j] + pull.slope / (pull.curvature + kSharing),
                                     shine_of(0, j), shine_of(255, j));
      const float change = shine - shine_[j];
      if (std::abs(change) < least) continue;
      touch_around(j);
      shine_more(j, change);
      shine_[j] = shine;
      if (!(marked_[j] & kTouched)) {
        marked_[j] |= kTouched;
        touched_.push_back(j);
        for (const std::size_t row : {j - far_rows, j + far_rows}) {
          check_on(square_of(row - far), slice());
          check_on(square_of(row + far), slice());
        }
      }
    }
    if (pass + 1 < kPasses) find_missed(missed_, look_);
  }
}

void PatchSolver::give(int n) {
  if (!shown_changed_ && n != plan_.slices - 1) {
    coded_.put_again();
    return;
  }
  shown_changed_ = false;
  const auto width = static_cast<std::size_t>(task_.box.width());
  for (int y = task_.box.y0; y < task_.box.y1; ++y) {
    std::copy_n(levels_.data() + place().at(task_.box.x0, y), width,
                row_.data() + static_cast<std::size_t>(y - task_.box.y0) * width);
  }
  coded_.put(row_.data());
}

void PatchSolver::solve(int n) {
  begin(n);
  show_slice(n);
  note_coverage(n);
  find_aims(n);
  if (!flagged_.empty()) {
    choose();
    round_to_levels();
    hold();
    for (const int k : aimed_) {
      for (std::size_t y = 0; y < kSquare; ++y) {
        const std::size_t from = first_of(k) + y * place().stride;
        neutral(from, from + kSquare);
      }
    }
  }
  give(n);
  const auto gain = static_cast<float>(plan_.gain(n)), kept = static_cast<float>(plan_.kept(n));
  for (const int k : watched()) {
    if (square(k).asleep) continue;
    const std::size_t first = first_of(k);
    const float* const seen = seen_light(k);
    step_square(dose_.data() + first, seen + first, below() + first, place().stride, gain, kept);
    const int calm = square(k).touched_at - n;
    if (may_sleep() && !aims_any_ && calm >= kCalm && calm % 4 == 3 &&
        stays_inside(seen + first, dose_.data() + first, guide_.data() + first, own_.data() + first,
                     bounds_of(first), place().stride) &&
        !lacks_own(first, seen + first)) {
      sleep(k);
    }
  }
}

KeptTile solve_patch(const CoupledPlan& plan, const PatchTask& task, const PatchSources& sources,
                     BlobStore& store) {
  return PatchSolver(plan, task, sources, store).run();
}

}  // namespace slicecorr::detail
