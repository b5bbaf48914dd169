// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "cure/gel_time_cut.hpp"
#include "cure/walkers.hpp"

namespace slicecorr::detail {

namespace {

/// Of each column the pixels of the slices that matter are kept, and the state of the recursions at every
/// 16th node; what lies between is computed anew where a cut is looked for.
class GelTimeWalker final : public DoseWalker {
 public:
  GelTimeWalker(const CureModel& model, std::size_t columns)
      : model_(model),
        kernel_(*model.gel_time()),
        cut_(model),
        columns_(columns),
        slots_(static_cast<std::size_t>(cut_.reach()) + std::size_t{2} * kStride),
        marks_(slots_.size() / kStride + 2),
        own_(columns),
        state_(columns),
        same_(columns, 0),
        alike_(columns, kForEver),
        hint_(2 * columns, 0) {
    for (auto* dose : {&lower, &middle, &upper}) dose->assign(columns, 0.0);
    turning.assign(layerwise() && model.mirrored_slices == 0 ? 0 : columns, 0);
    // The node after the last slice, without light.
    marks_[mark_at(node_)].assign(columns, {});
    for (int v = 0; v < 256; ++v) {
      curve_[v] = kernel_.light(level_of_pixel(v, kernel_.levels()));
    }
  }

  void add_slice(int slice, std::span<const ImageShowing> showings) override {
    before_.swap(own_);
    slice_ = slice;
    layer_of_node_ = slice + 1 - node_;
    const CutLight at_lower = cut_.returned(slice + 1.0), at_middle = cut_.returned(slice + 0.5),
                   at_upper = cut_.returned(slice);
    const bool always = cut_.ends() || cut_.mirrors(slice);
    take_light(showings, kernel_.in_slice(slice, {1, 1}, model_.ratio(slice)));
    if (!layerwise()) lower.swap(upper);
    for (std::size_t i = 0; i < columns_; ++i) {
      // Neighbours with the same light all along have the same doses.
      const bool copy = i > 0 && alike_[i] > cut_.reach() && own_[i] == own_[i - 1];
      if (copy) {
        middle[i] = middle[i - 1];
        upper[i] = upper[i - 1];
        if (layerwise()) lower[i] = lower[i - 1];
        hint_[2 * i] = hint_[2 * i - 2];
        hint_[2 * i + 1] = hint_[2 * i - 1];
      } else {
        const Below below(*this, i, node_);
        int& near = hint_[2 * i];
        int& far = hint_[2 * i + 1];
        if (layerwise()) lower[i] = cut_.dose(slice, own_[i], {1, 1}, below, near, at_lower);
        middle[i] = cut_.dose(slice, own_[i], cut_.middle(slice), below, near, at_middle);
        upper[i] = cut_.dose(slice, own_[i], cut_.node(slice), below, far, at_upper);
      }
      if (!layerwise()) {
        // Under one light all along to its cut the dose only goes to where that light would have it.
        const bool same = node_ != kLast && own_[i] == before_[i];
        same_[i] = same ? std::min(same_[i] + 1, kForEver) : 1;
        turning[i] = always || same_[i] <= hint_[2 * i + 1] + 1;
      } else if (!turning.empty()) {
        turning[i] = always;
      }
    }
    push();
  }

  void inside(std::size_t i, double, InsideLayer& out) const override;

 private:
  static constexpr int kForEver = 1 << 29;
  static constexpr int kSamples = 16;
  /// Nodes are counted from the last one down, which has this number.
  static constexpr int kLast = 1 << 30;
  static constexpr int kStride = 16;
  static_assert(kLast % kStride == 0);

  /// What a slice showed: pixels and how often they count, or where there are more images, or light that
  /// spreads, what it comes to.
  struct Slot {
    std::vector<std::uint8_t> pixels;
    std::vector<CutLight> light;
    CutLight weight{};
  };

  /// The nodes below a layer, the first of which is `node`.
  class Below {
   public:
    Below(const GelTimeWalker& walker, std::size_t column, int node)
        : walker_(walker), column_(column), node_(node) {}
    int count() const {
      return std::min(kLast - node_, static_cast<int>(walker_.slots_.size()) - 2 * kStride) + 1;
    }
    double x(int j) const { return state(j).x; }
    double y(int j) const { return state(j).y; }
    CutLight light(int j) const { return walker_.light(node_ + j, column_); }

   private:
    const CutLight& state(int j) const {
      const int node = node_ + j, mark = (node + kStride - 1) / kStride * kStride;
      if (mark != mark_) compute(mark);
      return states_[mark - node];
    }
    /// The states between a mark and the one before it, as far as there are.
    void compute(int mark) const {
      mark_ = mark;
      states_[0] = walker_.marks_[walker_.mark_at(mark)][column_];
      for (int q = 1; q < kStride && mark - q >= node_; ++q) {
        states_[q] = walker_.cut_.step(walker_.light(mark - q, column_), states_[q - 1],
                                       walker_.layer_of(mark - q));
      }
    }

    const GelTimeWalker& walker_;
    std::size_t column_;
    int node_;
    mutable int mark_ = -1;
    mutable CutLight states_[kStride];
  };

  bool layerwise() const { return kernel_.layer_by_layer(); }
  std::size_t slot_at(int slice) const { return static_cast<std::size_t>(slice) % slots_.size(); }
  std::size_t mark_at(int node) const {
    return static_cast<std::size_t>(node / kStride) % marks_.size();
  }
  CutLight light(int slice, std::size_t column) const {
    const Slot& slot = slots_[slot_at(slice)];
    if (!slot.light.empty()) return slot.light[column];
    if (slot.pixels.empty()) return {};
    const CutLight& l = curve_[slot.pixels[column]];
    return {slot.weight.x * l.x, slot.weight.y * l.y};
  }

  /// The layer below a node.
  int layer_of(int node) const { return node + layer_of_node_; }

  /// Fills `own_` and the slot of the slice above `node_`.
  void take_light(std::span<const ImageShowing> showings, const CutLight& ratio) {
    Slot& slot = slots_[slot_at(node_ - 1)];
    slot.pixels.clear();
    slot.light.clear();
    own_.assign(columns_, CutLight{});
    if (showings.empty()) return;
    if (showings.size() == 1 && !showings.front().phi) {
      const ImageShowing& whole = showings.front();
      slot.weight = {whole.light * ratio.x, whole.light * ratio.y};
      slot.pixels.assign(whole.pixels, whole.pixels + columns_);
      for (std::size_t i = 0; i < columns_; ++i) {
        const CutLight& l = curve_[slot.pixels[i]];
        own_[i] = {slot.weight.x * l.x, slot.weight.y * l.y};
      }
      return;
    }
    for (const ImageShowing& showing : showings) {
      for (std::size_t i = 0; i < columns_; ++i) {
        const CutLight l = showing.phi ? kernel_.light_of(kernel_.intensity_mw_cm2(showing.phi[i]))
                                       : curve_[showing.pixels[i]];
        own_[i].x += showing.light * ratio.x * l.x;
        own_[i].y += showing.light * ratio.y * l.y;
      }
    }
    slot.light = own_;
  }

  /// Makes the slice that was added last the first of those below.
  void push() {
    --node_;
    for (std::size_t i = 0; i < columns_; ++i) {
      state_[i] = cut_.step(own_[i], state_[i], slice_);
      if (i == 0) continue;
      const bool alike = state_[i] == state_[i - 1] && own_[i] == own_[i - 1];
      alike_[i] = alike ? std::min(alike_[i] + 1, kForEver) : 0;
    }
    if (node_ % kStride == 0) marks_[mark_at(node_)] = state_;
  }

  const CureModel& model_;
  const GelTimeKernel& kernel_;
  GelTimeCut cut_;
  std::size_t columns_;
  std::vector<Slot> slots_;                   ///< by slice
  std::vector<std::vector<CutLight>> marks_;  ///< states by node, every `kStride`
  int slice_ = 0;                             ///< that was added last
  int layer_of_node_ = 0;                     ///< what to add to a node for its layer
  int node_ = kLast;                          ///< the lower one of the layer that comes next
  std::vector<CutLight> own_, before_;        ///< light of the slices that were added last
  std::vector<CutLight> state_;               ///< at `node_`
  std::vector<int> same_;                     ///< slices for which a column has had one light
  std::vector<int> alike_;                    ///< nodes for which it is as the column before it
  std::vector<int> hint_;                     ///< cuts, of the middle and the upper node
  CutLight curve_[256];
};

void GelTimeWalker::inside(std::size_t i, double, InsideLayer& out) const {
  // The slice has been pushed: what lies below its layer begins one node further down.
  const Below below(*this, i, node_ + 1);
  int hint = hint_[2 * i];
  const auto at = [&](double t) {
    return cut_.dose(slice_, own_[i], cut_.fade(slice_, t), below, hint,
                     cut_.returned(slice_ + 1 - t));
  };
  out.crossings.clear();
  out.least = std::min(lower[i], upper[i]);
  const bool turns = !turning.empty() && turning[i];
  if (!turns && (lower[i] >= 1.0) == (upper[i] >= 1.0)) return;
  const auto cross = [&](double from, double to) {
    const bool before = at(from) >= 1.0;
    while (to - from > 1e-9) {
      const double t = 0.5 * (from + to);
      ((at(t) >= 1.0) == before ? from : to) = t;
    }
    out.crossings.push_back(0.5 * (from + to));
  };
  if (!turns) return cross(0.0, 1.0);
  double dose[kSamples + 1];
  for (int k = 1; k < kSamples; ++k) dose[k] = at(static_cast<double>(k) / kSamples);
  dose[0] = lower[i];
  dose[kSamples / 2] = middle[i];
  dose[kSamples] = upper[i];
  double from = 0;
  bool printed = dose[0] >= 1.0;
  const auto look_to = [&](double t, double value) {
    out.least = std::min(out.least, value);
    if ((value >= 1.0) != printed) cross(from, t);
    printed = value >= 1.0;
    from = t;
  };
  constexpr double step = 1.0 / kSamples;
  for (int k = 1; k <= kSamples; ++k) {
    const double here = dose[k];
    // A turn lies within a sample on either side: by a parabola, which is off by the cube of the
    // distance.
    if (k < kSamples) {
      const double left = here - dose[k - 1], right = dose[k + 1] - here;
      if (left * right < 0) {
        const double t = k * step + 0.5 * step * (left + right) / (left - right);
        const double value = at(t);
        if (t < k * step) look_to(t, value);
        look_to(k * step, here);
        if (t > k * step) look_to(t, value);
        continue;
      }
    }
    look_to(k * step, here);
  }
}

}  // namespace

std::unique_ptr<DoseWalker> make_gel_time_walker(const CureModel& model, std::size_t columns) {
  return std::make_unique<GelTimeWalker>(model, columns);
}

}  // namespace slicecorr::detail
