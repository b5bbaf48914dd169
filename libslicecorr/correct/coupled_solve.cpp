// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "correct/coupled_patch.hpp"

namespace slicecorr::detail {

namespace {

constexpr float kFree = 1e30F;  ///< a bound that nothing reaches
/// Doses are single: where they pass a bound by less, rounding may have done it.
constexpr float kSlack = 2e-5F;
/// Changes of light that are noticed.
constexpr float kNoticed = 1e-4F;
/// Of these the first look at the nearest pixels only.
constexpr int kNearestPasses = 2;
/// Looks at all pixels around wrong ones, per slice.
constexpr int kPasses = 4;
/// What is left of a change of dose where it is not looked for any more.
constexpr double kFaded = 0.05;
/// Added to the curvature of one pixel's change: light is shared out between neighbours, which
/// keeps it smooth where they want the same.
constexpr float kSharing = 0.1F;
/// Changes of light that are worth it, in steps of levels.
constexpr float kLeastChange = 0.15F;
/// Weights of what serves later slices, or edges, beside those of voxels.
constexpr float kGuideWeight = 0.2F, kEdgeWeight = 0.1F, kGreyWeight = 0.2F, kRequestWeight = 0.5F;
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
/// Marks of pixels: their levels may change; they are looked at; they have changed.
constexpr std::uint8_t kMayChange = 1, kTried = 2, kTouched = 4;

class PatchSolver : public PatchField<float> {
 public:
  PatchSolver(const CoupledPlan& plan, const PatchTask& task, const PatchSources& sources,
              BlobStore& store)
      : PatchField(plan, PatchPlace::grown(task.box, plan.overlap_x, plan.overlap_y)),
        task_(task),
        before_(place(), place().shown, sources.levels),
        columns_(place(), place().watched, sources.columns),
        above_(place(), place().watched, sources.coverage),
        left_(place(), place().watched, sources.left_alone),
        here_(place().size(), 0),
        next_request_(task.requests.begin()),
        row_(static_cast<std::size_t>(task.box.width()) *
             static_cast<std::size_t>(task.box.height())),
        coded_(store, row_.size(), plan.slices, TileWriter::From::last, task.before) {
    const std::size_t size = place().size();
    guide_.assign(size, 0);
    own_.resize(size);
    for (std::size_t at = 0; at < size; ++at) own_[at] = light_of(0, at);
    for (auto* field : {&least_, &under_guide_, &lo_, &raw_lo_, &looked_at_})
      field->assign(size, 0);
    for (auto* field : {&most_, &share_, &over_guide_, &soft_, &hi_, &low_weight_, &high_weight_,
                        &raw_hi_, &lo_weight_, &hi_weight_}) {
      field->assign(size, 0);
    }
    for (std::size_t at = 0; at < size; ++at) set_free(at);
    neutral(0, size);
    aimed_at_.assign(size / (std::size_t{kSquare} * kSquare), -1);
    check_until_.assign(aimed_at_.size(), plan.slices);
    fades_ = static_cast<int>(std::ceil(std::log(kFaded) / std::log(plan.a)));
    if (!task.first) {
      std::vector<int> near;
      for (const Request& r : task.requests) {
        const int k = square_of(place().at(r.x, r.y));
        if (near.empty() || near.back() != k) near.push_back(k);
      }
      watch_around(std::move(near));
    }
    if (plan.hands_on) credit_.assign(size, 0);
    marked_.assign(size, 0);
    const PixelBox free = PatchPlace::common(place().watched, task.free);
    for (int y = free.y0; y < free.y1; ++y) {
      for (int x = free.x0; x < free.x1; ++x) {
        const std::size_t at = place().at(x, y);
        // Where no light comes nothing can be chosen.
        if (share_at(at) > 0) marked_[at] = kMayChange;
      }
    }
    const PixelBox w = PatchPlace::common(place().watched, plan.display);
    for (int y = w.y0; y < w.y1; ++y) {
      for (int x = w.x0; x < w.x1; ++x) asked_.push_back(place().at(x, y));
    }
  }
  KeptTile run() {
    // Pieces above the last request, and above what it changed, stay.
    const int end =
        task_.first || task_.requests.empty()
            ? 0
            : std::max(0, task_.requests.back().slice - fades_) / kPieceSlices * kPieceSlices;
    for (int n = plan_.slices; n-- > end;) solve(n);
    return coded_.finish();
  }

 private:
  BoundRows bounds_of(std::size_t first) {
    // Layer by layer the least level that holds a layer is all that columns take.
    return {least_.data() + first,         most_.data() + first,        share_.data() + first,
            over_guide_.data() + first,    under_guide_.data() + first, soft_.data() + first,
            plan_.layerwise ? 1.0F : kFree};
  }
  void set_free(std::size_t at) {
    least_[at] = -kFree;
    most_[at] = over_guide_[at] = under_guide_[at] = soft_[at] = kFree;
    share_[at] = 0;
    low_weight_[at] = high_weight_[at] = kGuideWeight;
  }
  void neutral(std::size_t from, std::size_t to) {
    std::fill(lo_.begin() + static_cast<std::ptrdiff_t>(from),
              lo_.begin() + static_cast<std::ptrdiff_t>(to), -kFree);
    std::fill(hi_.begin() + static_cast<std::ptrdiff_t>(from),
              hi_.begin() + static_cast<std::ptrdiff_t>(to), kFree);
  }
  void solve(int n);
  void show_slice(int n);
  void note_coverage(int n);
  void classify(std::size_t at);
  bool is_asked(std::size_t at) const {
    const Pixel p = place().pixel(at);
    return PatchPlace::holds(place().watched, p) && PatchPlace::holds(plan_.display, p);
  }
  /// The pixels beside one, as far as they are watched.
  template <class Each>
  void for_neighbours(std::size_t at, const Each& each) const {
    const Pixel p = place().pixel(at);
    const PixelBox& w = place().watched;
    if (p.x > w.x0) each(at - 1);
    if (p.x + 1 < w.x1) each(at + 1);
    if (p.y > w.y0) each(at - place().stride);
    if (p.y + 1 < w.y1) each(at + place().stride);
  }
  /// Squares that miss something get aims, as do those around what they miss.
  void find_aims(int n);
  void aim(int k);
  /// The light of a square changes at slice `n`, which its doses feel for some slices.
  void check_on(int k, int n) { check_until_[static_cast<std::size_t>(k)] = n - fades_; }
  void apply_requests();
  void choose();
  void find_missed(std::vector<std::size_t>& missed);
  void set_level(std::size_t at, int level);
  void round_to_levels();
  /// The same for few levels: what a pixel of a feature has too much is handed on to those beside it
  /// that are not decided, as `levels_of_plane` does, and what it has less than they want it must
  /// not lack.
  void hand_on();
  void give(int n);
  /// With lifts: the least light that reaches a pixel by its slice's own exposure; 0: none is asked.
  float least_own(std::size_t at) const {
    if (here_[at] != 255 || left_[at] != 0) return 0;
    return static_cast<float>(plan_.least_own(static_cast<double>(own_[at])));
  }
  /// Whether some of a square gets less; `seen`: as of `seen_light`.
  bool lacks_own(std::size_t first, const float* seen) const;
  /// What lacks some after rounding gets it, of its own pixel, then of those of features around it.
  void hold();

  const PatchTask& task_;
  PatchBytes before_, columns_, above_, left_;
  std::vector<std::uint8_t> here_, marked_;
  std::vector<Request>::const_iterator next_request_, requests_from_, requests_to_;
  std::vector<std::uint8_t> row_;
  TileWriter coded_;
  std::vector<std::size_t> asked_;

  /// What is asked of doses, by pixel: at least `least_` (or the guide, if that is less), at most
  /// `most_` - `share_` times the dose below (or the guide); softly at most `over_guide_` above the
  /// guide and at most `soft_`, at least `under_guide_` below the guide.
  std::vector<float> least_, most_, share_, over_guide_, under_guide_, soft_;
  std::vector<float> low_weight_, high_weight_;  ///< of guides
  /// The same of lights of the slice, with some room (`lo_`, `hi_`) and without.
  std::vector<float> lo_, hi_, lo_weight_, hi_weight_, raw_lo_, raw_hi_;
  std::vector<float> credit_;     ///< light that pixels were handed; empty where none is
  std::vector<float> looked_at_;  ///< lights of pixels that were missed, when they were looked at

  std::vector<Change> changes_;
  std::vector<std::size_t> coverage_changes_, to_classify_, altered_, touched_, missed_, tried_;
  std::vector<int> flagged_, aimed_;
  /// In later rounds, by square: the slice down to which doses are held against their bounds.
  std::vector<int> check_until_;
  std::vector<int> aimed_at_;  ///< by square: the slice of its last aims
  bool shown_changed_ = true;
  int fades_ = 0;  ///< slices after which little is left of a change of dose
};

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
    if (above != 255) return;
    if (level < plan_.top) over_guide_[at] = 0;
    bool rim = false;
    for_neighbours(at, [&](std::size_t beside) { rim = rim || here_[beside] == 0; });
    if (rim) soft_[at] = std::max(kRimDose, 1 + 4 * margin);
    // What holds at each lift adds up to this.
    if (rim && plan_.joint > 0) {
      soft_[at] = std::max(soft_[at], static_cast<float>(kRimOfHeld * plan_.joint / plan_.b));
    }
  } else if (cover == 0) {
    most_[at] = (1 - margin) * static_cast<float>(plan_.middle_norm);
    share_[at] = static_cast<float>(plan_.middle_below);
    if (above == 255) {
      if (!plan_.layerwise) least_[at] = 1;
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
  const auto gain = static_cast<float>(plan_.b), kept = static_cast<float>(plan_.a);
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
                      guide_.data() + first, bounds_of(first), stride, gain, kept,
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
  find_missed(missed_);
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
  rouse(k);
  const std::size_t first = first_of(k), stride = place().stride;
  const AimRule rule{static_cast<float>(plan_.b),
                     static_cast<float>(plan_.a),
                     static_cast<float>(plan_.light_of[255] * ratio_),
                     0.5F * static_cast<float>(plan_.margin / plan_.b),
                     kEdgeWeight,
                     task_.first};
  aim_square(seen_light(k) + first, below() + first, dose_.data() + first, guide_.data() + first,
             bounds_of(first), {low_weight_.data() + first, high_weight_.data() + first}, stride,
             rule,
             {lo_.data() + first, hi_.data() + first, lo_weight_.data() + first,
              hi_weight_.data() + first},
             raw_lo_.data() + first, raw_hi_.data() + first);
  const float room = static_cast<float>(plan_.margin / plan_.b);
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
  for (std::size_t y = 0; y < kSquare; ++y) {
    const std::size_t from = first + y * stride;
    std::fill_n(looked_at_.begin() + static_cast<std::ptrdiff_t>(from), kSquare, kFree);
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
      lo_weight_[at] = kRequestWeight;
    }
  }
}

void PatchSolver::find_missed(std::vector<std::size_t>& missed) {
  missed.clear();
  for (const int k : aimed_) {
    const std::size_t first = first_of(k);
    if (!any_missed(light_.data() + first, raw_lo_.data() + first, raw_hi_.data() + first,
                    place().stride, kNoticed)) {
      continue;
    }
    for (std::size_t y = 0; y < kSquare; ++y) {
      const std::size_t from = first + y * place().stride;
      for (std::size_t at = from; at < from + kSquare; ++at) {
        const float v = light_[at];
        if (v >= raw_lo_[at] - kNoticed && v <= raw_hi_[at] + kNoticed) continue;
        // What the last look did not change, another one won't.
        if (std::abs(v - looked_at_[at]) < kNoticed) continue;
        looked_at_[at] = v;
        missed.push_back(at);
      }
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
      wake_around(j);
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
    find_missed(missed_);
  }
}

void PatchSolver::set_level(std::size_t at, int level) {
  if (level != levels_[at]) {
    shown_changed_ = true;
    levels_[at] = static_cast<std::uint8_t>(level);
    if (!task_.first) altered_.push_back(at);
  }
  const float shine = shine_of(levels_[at], at);
  if (shine == shine_[at]) return;
  shine_more(at, shine - shine_[at]);
  shine_[at] = shine;
}

void PatchSolver::round_to_levels() {
  if (plan_.hands_on) return hand_on();
  const LevelTable& table = plan_.columns.levels;
  for (const std::size_t at : touched_) {
    marked_[at] ^= kTouched;
    const double phi = phi_at(at, shine_[at]);
    const auto [below, above] = table.around(phi);
    set_level(at, table.phi(above) - phi < phi - table.phi(below) ? above : below);
  }
  // Features are not left under their dose by rounding.
  const float room = static_cast<float>(plan_.margin / plan_.b);
  for (const std::size_t at : touched_) {
    if (here_[at] != 255 || light_[at] >= raw_lo_[at] - room || levels_[at] >= plan_.top) continue;
    if (raw_lo_[at] >= shine_of(255, at)) continue;
    set_level(at, levels_[at] + 1);
  }
}

bool PatchSolver::lacks_own(std::size_t first, const float* seen) const {
  if (plan_.joint <= 0) return false;
  for (std::size_t y = 0; y < kSquare; ++y) {
    const std::size_t from = y * place().stride;
    for (std::size_t k = from; k < from + kSquare; ++k) {
      if (seen[k] < least_own(first + k)) return true;
    }
  }
  return false;
}

void PatchSolver::hold() {
  if (plan_.joint <= 0) return;
  const LevelTable& table = plan_.columns.levels;
  const std::size_t stride = place().stride;
  const auto tap = [&](int x, int y) {
    return plan_.near_taps[static_cast<std::size_t>((plan_.near_y + y) * plan_.near_width +
                                                    plan_.near_x + x)];
  };
  const auto raise = [&](std::size_t at, float more) {
    if (!(marked_[at] & kMayChange) || here_[at] != 255 || levels_[at] >= plan_.top) return false;
    const float shine = std::min(shine_[at] + more, shine_of(255, at));
    const int level = table.at_least(phi_at(at, static_cast<double>(shine) * (1 - 1e-6)));
    if (level <= levels_[at]) return false;
    wake_around(at);
    check_on(square_of(at), slice());
    set_level(at, level);
    return true;
  };
  constexpr int passes = 12, alone = 4;
  bool any = true;
  for (int pass = 0; pass < passes && any; ++pass) {
    any = false;
    for (const int k : aimed_) {
      for (std::size_t y = 0; y < kSquare; ++y) {
        const std::size_t from = first_of(k) + y * stride;
        for (std::size_t at = from; at < from + kSquare; ++at) {
          const float least = least_own(at);
          if (least <= 0) continue;
          const float wanted =
              plan_.m == 1 ? least : std::pow(least, static_cast<float>(1 / plan_.m));
          const float lacks = wanted * (1 + 1e-5F) - light_[at];
          if (lacks <= 0) continue;
          if (raise(at, lacks / tap(0, 0))) {
            any = true;
            continue;
          }
          if (pass < alone) continue;
          for (int j = -1; j <= 1; ++j) {
            for (int i = -1; i <= 1; ++i) {
              const std::size_t beside =
                  at + static_cast<std::size_t>(i) + stride * static_cast<std::size_t>(j);
              if (i != 0 || j != 0)
                any = raise(beside, lacks / (8 * std::max(tap(i, j), 0.01F))) || any;
            }
          }
        }
      }
    }
    if (!any && pass < alone) {
      pass = alone - 1;
      any = true;
    }
  }
}

void PatchSolver::hand_on() {
  const LevelTable& table = plan_.columns.levels;
  const auto phi_of = [&](double shine, std::size_t at) {
    return phi_at(at, std::max(shine, 0.0));
  };
  // Row by row, every second row of the display from its end.
  std::sort(touched_.begin(), touched_.end(), [&](std::size_t l, std::size_t r) {
    const Pixel p = place().pixel(l), q = place().pixel(r);
    if (p.y != q.y) return p.y < q.y;
    return p.y % 2 == 0 ? p.x < q.x : p.x > q.x;
  });
  const std::size_t stride = place().stride;
  const std::size_t beside[] = {1, stride - 1, stride, stride + 1};
  const auto weight = [&](std::size_t step) {
    const bool x = step != stride, y = step != 1;
    return plan_.near_taps[static_cast<std::size_t>(
        (plan_.near_y + (y ? 1 : 0)) * plan_.near_width + plan_.near_x + (x ? 1 : 0))];
  };
  const auto each_beside = [&](std::size_t at, const auto& each) {
    for (const std::size_t step : beside) {
      each(at + step, weight(step));
      each(at - step, weight(step));
    }
  };
  const float own =
      plan_.near_taps[static_cast<std::size_t>(plan_.near_y * plan_.near_width + plan_.near_x)];
  for (const std::size_t at : touched_) {
    const bool feature = here_[at] == 255;
    const float wanted = shine_[at];
    float aimed = wanted - credit_[at], least = shine_of(0, at);
    credit_[at] = 0;
    if (feature) {
      // Not so dark that it, or a pixel beside it that is decided, has less than it needs.
      const auto needs = [&](std::size_t k, float w) {
        const float lacks = std::min(raw_lo_[k], shine_of(255, k)) - light_[k];
        least = std::max(least, wanted + (k == at ? lacks : std::min(0.0F, lacks)) / w);
      };
      needs(at, own);
      each_beside(at, [&](std::size_t k, float w) {
        if (here_[k] == 255 && !(marked_[k] & kTouched)) needs(k, w);
      });
    }
    marked_[at] ^= kTouched;
    const double phi = phi_of(aimed, at);
    const auto [below, above] = table.around(phi);
    int level = table.phi(above) - phi < phi - table.phi(below) ? above : below;
    if (feature && shine_of(static_cast<std::uint8_t>(level), at) < least) {
      level = table.at_least(phi_of(std::min(least, shine_of(255, at)), at));
    }
    set_level(at, level);
    const float surplus = shine_[at] - aimed;
    if (!feature || surplus <= 0) continue;
    float all = 0;
    const auto takes = [&](std::size_t k) {
      return here_[k] == 255 && (marked_[k] & kTouched) != 0;
    };
    each_beside(at, [&](std::size_t k, float w) { all += takes(k) ? w : 0; });
    if (all <= 0) continue;
    each_beside(at, [&](std::size_t k, float w) {
      if (takes(k)) credit_[k] += surplus * w / all;
    });
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
  const auto gain = static_cast<float>(plan_.b), kept = static_cast<float>(plan_.a);
  for (const int k : watched()) {
    if (square(k).asleep) continue;
    const std::size_t first = first_of(k);
    const float* const seen = seen_light(k);
    step_square(dose_.data() + first, seen + first, below() + first, place().stride, gain, kept);
    const int calm = square(k).touched_at - n;
    if (scattered_.empty() && calm >= kCalm && calm % 4 == 3 &&
        stays_inside(seen + first, dose_.data() + first, guide_.data() + first, own_.data() + first,
                     bounds_of(first), place().stride) &&
        !lacks_own(first, seen + first)) {
      sleep(k);
    }
  }
}

}  // namespace

KeptTile solve_patch(const CoupledPlan& plan, const PatchTask& task, const PatchSources& sources,
                     BlobStore& store) {
  return PatchSolver(plan, task, sources, store).run();
}

}  // namespace slicecorr::detail
