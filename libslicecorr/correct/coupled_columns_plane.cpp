// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <vector>

#include "correct/coupled_kernels.hpp"
#include "correct/coupled_patch.hpp"

namespace slicecorr::detail {

namespace {

/// How often the pixels around a change are gone through, there and back: what spreads evenly is right
/// soon, of what changes from pixel to pixel about a per cent is left after so many.
constexpr int kSweeps = 40;
/// How often levels are raised where a column still lacks light.
constexpr int kRaises = 2;
/// How often what is too much is taken back, a level each time.
constexpr int kLowers = 3;
/// Light that is off by less, as a share of full light, is left as it is.
constexpr double kEnough = 1e-4;

/// Share of its light that a column may lack: columns want a little more than gels.
constexpr double kMayLack = 1e-3;

class ColumnsPlane {
 public:
  ColumnsPlane(const CoupledPlan& plan, const PatchTask& task, const PatchSources& sources)
      : plan_(plan),
        wants_(*plan.wants),
        task_(task),
        place_(plan, PatchPlace::grown(task.box, plan.overlap_x, plan.overlap_y)),
        solved_(PatchPlace::common(place_.watched, task.free)),
        before_(place_, place_.shown, sources.levels),
        wanted_(place_, place_.watched, sources.columns),
        left_(place_, place_.watched, sources.left_alone),
        level_(place_.size(), 0),
        shine_(place_.size(), 0),
        light_(place_.size(), 0),
        listed_(place_.size(), -1) {
    const PixelBox lit = PatchPlace::common(place_.shown, plan.display);
    share_ = intensity_shares(plan, place_, lit);
    for (int y = lit.y0; y < lit.y1; ++y) {
      for (int x = lit.x0; x < lit.x1; ++x) shine(place_.at(x, y), light_of(place_.at(x, y), 0));
    }
    own_ = plan.taps[static_cast<std::size_t>(plan.reach_y * plan.taps_width + plan.reach_x)];
  }

  KeptTile run(BlobStore& store) {
    const PixelBox& box = task_.box;
    const auto width = static_cast<std::size_t>(box.width());
    std::vector<std::uint8_t> rows(width * static_cast<std::size_t>(box.height()));
    TileWriter writer(store, rows.size(), plan_.slices, TileWriter::From::last, task_.before);
    for (int n = plan_.slices; n-- > 0;) {
      if (!choose(n)) {
        writer.put_again();
        continue;
      }
      for (int y = box.y0; y < box.y1; ++y) {
        std::copy_n(level_.begin() + static_cast<std::ptrdiff_t>(place_.at(box.x0, y)), width,
                    rows.begin() + static_cast<std::ptrdiff_t>(y - box.y0) * box.width());
      }
      writer.put(rows.data());
    }
    return writer.finish();
  }

 private:
  void shine(std::size_t at, double light) {
    const double change = light - shine_[at];
    if (change == 0) return;
    shine_[at] = light;
    add_taps(light_.data() + at - static_cast<std::size_t>(plan_.reach_y) * place_.stride -
                 static_cast<std::size_t>(plan_.reach_x),
             place_.stride, plan_.taps.data(), plan_.taps_rows, plan_.taps_width, change);
  }
  double share_at(std::size_t at) const { return share_.empty() ? 1 : share_[at]; }
  /// Of a level at a pixel.
  double light_of(std::size_t at, int level) const {
    return share_at(at) * wants_.light[static_cast<std::size_t>(level)];
  }
  void show(std::size_t at, int level) {
    level_[at] = static_cast<std::uint8_t>(level);
    shine(at, light_of(at, level));
  }
  bool is_chosen(const Pixel& p, std::size_t at) const {
    return PatchPlace::holds(solved_, p) && left_[at] == 0 && share_at(at) > 0;
  }

  /// The pixels of slice n, from those of the slice after it; false: they stay.
  bool choose(int n) {
    cap_ = wants_.cap_of(n);
    list_.clear();
    bool any = false;
    left_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t) { list_around(n, at); });
    before_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t is) {
      const Pixel p = place_.pixel(at);
      if (is_chosen(p, at)) return;
      show(at, is);
      list_around(n, at);
      any = true;
    });
    wanted_.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t) { list_around(n, at); });
    if (n + 1 < plan_.slices && cap_ != wants_.cap_of(n + 1)) {
      for (int y = solved_.y0; y < solved_.y1; ++y) {
        for (int x = solved_.x0; x < solved_.x1; ++x) list(n, {x, y});
      }
    }
    if (list_.empty()) return any;
    std::sort(list_.begin(), list_.end());
    for (int pass = 0; pass < kSweeps; ++pass) descend(pass % 2 == 0);
    for (const std::size_t at : list_) {
      show(at, std::min(cap_, wants_.level_of(shine_[at] / share_at(at))));
    }
    for (int pass = 0; pass < kRaises; ++pass) raise();
    for (int pass = 0; pass < kLowers; ++pass) lower();
    return true;
  }

  void list(int n, const Pixel& p) {
    const std::size_t at = place_.at(p.x, p.y);
    if (listed_[at] == n || !is_chosen(p, at)) return;
    listed_[at] = n;
    list_.push_back(at);
  }
  void list_around(int n, std::size_t at) {
    const Pixel p = place_.pixel(at);
    const int reach_x = plan_.reach_x + plan_.near_x, reach_y = plan_.reach_y + plan_.near_y;
    const PixelBox box = PatchPlace::common(
        {p.x - reach_x, p.y - reach_y, p.x + reach_x + 1, p.y + reach_y + 1}, solved_);
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) list(n, {x, y});
    }
  }

  double want(std::size_t at) const { return light_of(at, wanted_[at]); }

  /// Moves each pixel by what its column lacks or has too much.
  void descend(bool forward) {
    const double enough = kEnough * wants_.full();
    for (std::size_t i = 0; i < list_.size(); ++i) {
      const std::size_t at = list_[forward ? i : list_.size() - 1 - i];
      const double lacks = want(at) - light_[at];
      if (std::abs(lacks) < enough) continue;
      shine(at, std::clamp(shine_[at] + lacks / own_, light_of(at, 0), light_of(at, cap_)));
    }
  }
  /// Features get their light, even if others get more of it then.
  void raise() {
    for (const std::size_t at : list_) {
      if (wanted_[at] == 0) continue;
      const double lacks = want(at) - light_[at];
      if (lacks < kMayLack * want(at)) continue;
      const double light = (shine_[at] + lacks / own_) / share_at(at);
      const auto end = wants_.light.begin() + cap_;
      show(at, static_cast<int>(std::lower_bound(wants_.light.begin(), end, light) -
                                wants_.light.begin()));
    }
  }

  /// Takes back what columns have too much, as far as none lacks anything then.
  void lower() {
    for (std::size_t i = list_.size(); i-- > 0;) {
      const std::size_t at = list_[i];
      const int level = level_[at];
      if (level == 0 || light_[at] - want(at) < kMayLack * want(at)) continue;
      const double less = light_of(at, level) - light_of(at, level - 1);
      if (is_needed(at, less)) continue;
      show(at, level - 1);
    }
  }
  /// Whether a column around a pixel would lack light if it shone by so much less.
  bool is_needed(std::size_t at, double less) const {
    for (int y = -plan_.reach_y; y <= plan_.reach_y; ++y) {
      for (int x = -plan_.reach_x; x <= plan_.reach_x; ++x) {
        const std::size_t other =
            at + static_cast<std::size_t>(y) * place_.stride + static_cast<std::size_t>(x);
        if (wanted_[other] == 0) continue;
        const double weight = plan_.taps[static_cast<std::size_t>(
            (y + plan_.reach_y) * plan_.taps_width + x + plan_.reach_x)];
        if (light_[other] - weight * less < want(other) * (1 - kMayLack)) return true;
      }
    }
    return false;
  }

  const CoupledPlan& plan_;
  const CoupledColumns& wants_;
  const PatchTask& task_;
  PatchPlace place_;
  PixelBox solved_;
  PatchBytes before_, wanted_, left_;
  std::vector<std::uint8_t> level_;
  std::vector<double> share_;          ///< of intensity; empty where light is even
  std::vector<double> shine_, light_;  ///< of pixels, and what reaches their columns
  std::vector<int> listed_;            ///< slice at which a pixel was listed last
  std::vector<std::size_t> list_;      ///< pixels to be chosen
  double own_ = 1;                     ///< weight of a pixel in its own column
  int cap_ = 0;
};

}  // namespace

KeptTile solve_patch_for_columns(const CoupledPlan& plan, const PatchTask& task,
                                 const PatchSources& sources, BlobStore& store) {
  return ColumnsPlane(plan, task, sources).run(store);
}

}  // namespace slicecorr::detail
