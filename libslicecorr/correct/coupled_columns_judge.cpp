// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "correct/coupled_patch.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

namespace {

/// What an edge that is off counts in the loss, beside the middle of a layer, and how far off it
/// counts at most: it is no wrong voxel.
constexpr double kEdgeCounts = 0.1, kMostEdge = 0.25;

class ColumnsJudge {
 public:
  ColumnsJudge(const CoupledPlan& plan, const PixelBox& box, const PatchSources& sources,
               std::size_t most_misses)
      : plan_(plan),
        wants_(*plan.wants),
        kernel_(wants_.judged.inhibited()),
        box_(box),
        most_misses_(most_misses),
        place_(plan, box),
        lit_(PatchPlace::common(place_.shown, plan.display)),
        levels_(place_, place_.shown, sources.levels),
        coverage_(place_, box, sources.coverage),
        left_(place_, box, sources.left_alone),
        heights_(place_, box, sources.heights),
        shine_(pixels_of(lit_), wants_.light.front()),
        light_(pixels_of(box)),
        fronts_(kernel_ ? pixels_of(box) : 0),
        phi_(kernel_ ? 0 : pixels_of(box)),
        dose_(wants_.judged, pixels_of(box)),
        cover_(pixels_of(box), 0),
        middle_(pixels_of(box), 0) {}

  PatchFigures run() {
    share_ = intensity_shares(plan_, place_, lit_);
    uv_share_ = uv_shares(plan_, box_);
    for (int y = lit_.y0; y < lit_.y1; ++y) {
      for (int x = lit_.x0; x < lit_.x1; ++x) shine_[index_in(lit_, x, y)] *= share_at({x, y});
    }
    blur();
    for (int n = plan_.slices; n-- > 0;) judge(n);
    return std::move(figures_);
  }

 private:
  void blur() {
    before_.swap(light_);
    light_.resize(before_.size());
    plan_.blur.apply(shine_.data(), lit_, light_.data(), box_);
    if (!kernel_) return take_light();
    const double uv = kernel_uv();
    for (std::size_t i = 0; i < light_.size(); ++i) {
      if (light_[i] != before_[i] || uv != uv_before_) {
        fronts_[i] = kernel_->front_light(light_[i], uv_share_.empty() ? uv : uv * uv_share_[i]);
      }
    }
    uv_before_ = uv;
  }
  double share_at(const Pixel& p) const { return share_.empty() ? 1 : share_[place_.at(p.x, p.y)]; }
  void take_light() {
    const GelTimeKernel* const gel_time = wants_.judged.gel_time();
    for (std::size_t i = 0; i < light_.size(); ++i) {
      if (light_[i] == before_[i]) continue;
      phi_[i] = gel_time ? gel_time->phi(light_[i]) : light_[i];
    }
  }
  double kernel_uv() const {
    if (!kernel_) return uv_before_;
    return plan_.columns.model.inhibited()->uv_mw_cm2(std::max(0, slice_), 0);
  }

  void judge(int n) {
    slice_ = n;
    bool changed = kernel_uv() != uv_before_;
    levels_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t is) {
      const Pixel p = place_.pixel(at);
      if (!PatchPlace::holds(lit_, p)) return;
      shine_[index_in(lit_, p)] = share_at(p) * wants_.light[is];
      changed = true;
    });
    if (changed) blur();
    ImageShowing showing;
    if (kernel_) {
      showing.fronts = fronts_.data();
    } else {
      showing.phi = phi_.data();
    }
    dose_.add_slice(n, {&showing, 1});
    coverage_.go_to(n, [](std::size_t, std::uint8_t, std::uint8_t) {});
    left_.go_to(n, [](std::size_t, std::uint8_t, std::uint8_t) {});
    std::size_t i = 0;
    for (int y = box_.y0; y < box_.y1; ++y) {
      for (int x = box_.x0; x < box_.x1; ++x, ++i) look(n, i, place_.at(x, y));
    }
    // Those of this slice's upper node are wanted when the slice before it comes.
    heights_.go_to(n, [](std::size_t, std::uint8_t, std::uint8_t) {});
    std::copy_n(dose_.middle(), middle_.size(), middle_.begin());
  }

  void look(int n, std::size_t i, std::size_t at) {
    const std::uint8_t cover = coverage_[at], below = std::exchange(cover_[i], cover);
    if (left_[at] != 0) return;
    const double middle = dose_.middle()[i];
    if (!plan_.layerwise && cover != below && (cover == 0 || cover == 255) &&
        (below == 0 || below == 255)) {
      // The edge lies so far below node n + 1.
      const double off = heights_[at] == 0 ? 0.0 : edge_height_slices(heights_[at]);
      const double node = dose_.lower()[i], beside = off > 0 ? middle_[i] : middle;
      const double lacks = node + (beside - node) * std::min(1.0, 2 * std::abs(off)) - 1;
      figures_.loss += kEdgeCounts * std::min(lacks * lacks, kMostEdge);
    }
    if (cover != 0 && cover != 255) return;
    const bool prints = middle >= 1, full = cover == 255;
    const double miss = middle - 1;
    const bool near = !full && middle > 1 - plan_.margin;
    if (prints == full && !near) return;
    if (prints != full) {
      ++(full ? figures_.under : figures_.through);
      figures_.loss += 0.5 * miss * miss;
    }
    if (!figures_.all_misses) return;
    const Pixel p = place_.pixel(at);
    figures_.misses.push_back({n, p.x, p.y, static_cast<float>(miss), prints != full});
    figures_.all_misses = figures_.misses.size() < most_misses_;
  }

  const CoupledPlan& plan_;
  const CoupledColumns& wants_;
  const InhibitedKernel* kernel_;  ///< null without UV light
  PixelBox box_;
  std::size_t most_misses_;
  PatchPlace place_;
  PixelBox lit_;  ///< what shines on the box
  PatchBytes levels_, coverage_, left_, heights_;
  std::vector<double> share_;                   ///< of intensity; empty where light is even
  std::vector<double> uv_share_;                ///< of the box; the same
  std::vector<double> shine_, light_, before_;  ///< of pixels; the light that reaches the box
  std::vector<FrontLight> fronts_;
  std::vector<double> phi_;
  BandDose dose_;
  std::vector<std::uint8_t> cover_;  ///< of the layer before
  std::vector<double> middle_;       ///< its doses
  double uv_before_ = -1;
  int slice_ = 0;
  PatchFigures figures_;
};

}  // namespace

PatchFigures judge_patch_by_columns(const CoupledPlan& plan, const PixelBox& box,
                                    const PatchSources& sources, std::size_t most_misses) {
  return ColumnsJudge(plan, box, sources, most_misses).run();
}

}  // namespace slicecorr::detail
