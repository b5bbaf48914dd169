// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Chooses the light of a patch for a round, slice by slice: coupled_solve.cpp seeks it, coupled_levels.cpp
/// rounds it to levels and gives what is to hold its own exposure.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "correct/coupled_patch.hpp"

namespace slicecorr::detail {

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
        aims_(place(), place().watched, sources.aims),
        aims_any_(!sources.aims.empty()),
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
    changed_.assign(aimed_at_.size(), 0);
    fades_ = static_cast<int>(std::ceil(std::log(kFaded) / std::log(plan.slowest)));
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
  static constexpr float kFree = 1e30F;  ///< a bound that nothing reaches
  /// What is left of a change of dose where it is not looked for any more.
  static constexpr double kFaded = 0.05;
  /// Weight of guides beside those of voxels.
  static constexpr float kGuideWeight = 0.2F;
  /// Marks of pixels: their levels may change; they are looked at; they have changed.
  static constexpr std::uint8_t kMayChange = 1, kTried = 2, kTouched = 4;

  BoundRows bounds_of(std::size_t first) {
    // Layer by layer the least level that holds a layer is all that columns take.
    return {least_.data() + first,
            most_.data() + first,
            share_.data() + first,
            over_guide_.data() + first,
            under_guide_.data() + first,
            soft_.data() + first,
            plan_.layerwise || aims_any_ ? 1.0F : kFree};
  }
  /// Guides of a square as bounds take them: those of voxels whose dose is wanted hold nothing back.
  const float* guides_of(std::size_t first) {
    if (!aims_any_ && !plan_.graded) return guide_.data() + first;
    bound_guide_.resize(guide_.size());
    const auto margin = static_cast<float>(plan_.margin);
    for (std::size_t y = 0; y < kSquare; ++y) {
      const std::size_t from = first + y * place().stride;
      for (std::size_t at = from; at < from + kSquare; ++at) {
        // Of wanted doses just 1 is not to be missed by rounding.
        const float own = plan_.graded && here_[at] == 255 && above_[at] == 255
                              ? std::max(guide_[at], 1.0F) + margin
                              : guide_[at];
        bound_guide_[at] = aims_[at] == 0 ? own : here_[at] == 0 ? 0.0F : 1.0F;
      }
    }
    return bound_guide_.data() + first;
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
  void find_missed(std::vector<std::size_t>& missed, std::uint64_t since);
  void touch_around(std::size_t at);
  void set_level(std::size_t at, int level);
  void round_to_levels();
  /// The same for few levels: what a pixel of a feature has too much is handed on to those beside it
  /// that are not decided, and what it has less than they want it must not lack.
  void hand_on();
  void give(int n);
  /// With lifts: the least light that reaches a pixel by its slice's own exposure; 0: none is asked.
  float least_own(std::size_t at) const {
    if (here_[at] != 255 || left_[at] != 0) return 0;
    return static_cast<float>(plan_.least_own(slice(), static_cast<double>(own_[at])));
  }
  /// Whether some of a square gets less; `seen`: as of `seen_light`.
  bool lacks_own(std::size_t first, const float* seen) const;
  /// What lacks some after rounding gets it, of its own pixel, then of those of features around it.
  void hold();

  const PatchTask& task_;
  PatchBytes before_, columns_, above_, left_, aims_;
  bool aims_any_;                   ///< whether doses are wanted
  std::vector<float> bound_guide_;  ///< where they are
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
  std::vector<int> aimed_at_;           ///< by square: the slice of its last aims
  std::vector<std::uint64_t> changed_;  ///< by square: the look in which its light was changed last
  std::uint64_t look_ = 0;
  SquareBox last_around_;
  double below_ = -1, norm_ = -1;  ///< of the middles of layers, as bounds have them
  bool shown_changed_ = true;
  int fades_ = 0;  ///< slices after which little is left of a change of dose
};

}  // namespace slicecorr::detail
