#include <algorithm>
#include <cmath>

#include "cure/gel_time_cut.hpp"
#include "cure/walkers.hpp"

namespace slicecorr::detail {

namespace {

/// The nodes that matter are kept in a ring of rows, one value per column each.
class GelTimeWalker final : public DoseWalker {
 public:
  GelTimeWalker(const CureModel& model, std::size_t columns)
      : model_(model),
        kernel_(*model.gel_time),
        cut_(kernel_),
        columns_(columns),
        rows_(static_cast<std::size_t>(kernel_.reach()) + 2),
        state_(rows_),
        light_(rows_),
        same_(columns, 0),
        alike_(columns, kForEver),
        hint_(2 * columns, 0) {
    for (auto* dose : {&lower, &middle, &upper}) dose->assign(columns, 0.0);
    turning.assign(layerwise() ? 0 : columns, 0);
    own_.resize(columns);
    // The node after the last slice, without light.
    state_.front().assign(columns, {});
    light_.front().assign(columns, {});
    for (int v = 0; v < 256; ++v) {
      curve_[v] = kernel_.light(level_of_pixel(v, kernel_.levels()));
    }
  }

  void add_slice(int slice, std::span<const ImageShowing> showings) override {
    take_light(showings, model_.ratio(slice));
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
        const Below below{*this, i};
        int& near = hint_[2 * i];
        int& far = hint_[2 * i + 1];
        if (layerwise()) lower[i] = cut_.dose(own_[i], {1, 1}, below, near);
        middle[i] = cut_.dose(own_[i], cut_.middle(), below, near);
        upper[i] = cut_.dose(own_[i], cut_.node(), below, far);
      }
      if (!layerwise()) {
        // Under one light all along to its cut the dose only goes to where that light would have it.
        same_[i] = own_[i] == row(light_, 0)[i] ? same_[i] + 1 : 1;
        turning[i] = same_[i] <= hint_[2 * i + 1] + 1;
      }
    }
    push();
  }

  void inside(std::size_t i, double, InsideLayer& out) const override;

 private:
  static constexpr int kForEver = 1 << 30;
  static constexpr int kSamples = 16;
  using Row = std::vector<CutLight>;

  /// What lies below the layer that was added last; before `push`, with `lag` 0.
  struct Below {
    const GelTimeWalker& walker;
    std::size_t column;
    int lag = 0;
    int count() const { return walker.known_ - lag; }
    double x(int j) const { return walker.row(walker.state_, j + lag)[column].x; }
    double y(int j) const { return walker.row(walker.state_, j + lag)[column].y; }
    CutLight light(int j) const { return walker.row(walker.light_, j + lag)[column]; }
  };

  bool layerwise() const { return kernel_.layer_by_layer(); }
  const Row& row(const std::vector<Row>& ring, int j) const {
    const std::size_t at = newest_ + static_cast<std::size_t>(j);
    return ring[at < rows_ ? at : at - rows_];
  }

  void take_light(std::span<const ImageShowing> showings, double ratio) {
    std::fill(own_.begin(), own_.end(), CutLight{});
    for (const ImageShowing& showing : showings) {
      const double times = showing.light * ratio;
      for (std::size_t i = 0; i < columns_; ++i) {
        const CutLight l = showing.phi ? kernel_.light_of(kernel_.intensity_mw_cm2(showing.phi[i]))
                                       : curve_[showing.pixels[i]];
        own_[i].x += times * l.x;
        own_[i].y += times * l.y;
      }
    }
  }

  /// Makes the slice that was added last the first of those below.
  void push() {
    const std::size_t before = newest_;
    newest_ = newest_ == 0 ? rows_ - 1 : newest_ - 1;
    Row &state = state_[newest_], &light = light_[newest_];
    state.resize(columns_);
    light.resize(columns_);
    for (std::size_t i = 0; i < columns_; ++i) {
      state[i] = cut_.step(own_[i], state_[before][i]);
      light[i] = own_[i];
      if (i == 0) continue;
      const bool alike = state[i] == state[i - 1] && light[i] == light[i - 1];
      alike_[i] = alike ? std::min(alike_[i] + 1, kForEver) : 0;
    }
    known_ = std::min(known_ + 1, static_cast<int>(rows_) - 1);
  }

  const CureModel& model_;
  const GelTimeKernel& kernel_;
  GelTimeCut cut_;
  std::size_t columns_, rows_;
  std::vector<Row> state_, light_;  ///< by node, and by the slice below it, from `newest_` on
  std::size_t newest_ = 0;
  int known_ = 1;           ///< nodes in the ring
  Row own_;                 ///< of the slice that was added last
  std::vector<int> same_;   ///< slices for which a column has had one light
  std::vector<int> alike_;  ///< nodes for which it is as the column before it
  std::vector<int> hint_;   ///< cuts, of the middle and the upper node
  CutLight curve_[256];
};

void GelTimeWalker::inside(std::size_t i, double, InsideLayer& out) const {
  // The slice has been pushed: what lies below its layer begins one node further down.
  const Below below{*this, i, 1};
  int hint = hint_[2 * i];
  const auto at = [&](double t) { return cut_.dose(own_[i], kernel_.fade(t), below, hint); };
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
