// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

#include "base/kernels.hpp"
#include "cure/inhibited_layer.hpp"
#include "cure/walkers.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

namespace {

// Loops over columns of a block, compiled for each instruction set with the same bits.

/// What columns that show `levels` get.
struct ShownLight {
  const double* by_level;
  const std::uint16_t* levels;
  double times;
};
SLICECORR_CLONES
void fade_alike(double* tail, double light, double a, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) tail[i] = (tail[i] + light) * a;
}
SLICECORR_CLONES
void fade_each(double* tail, const ShownLight& light, double a, std::size_t n) {
  const double* __restrict const by_level = light.by_level;
  const std::uint16_t* __restrict const levels = light.levels;
  const double times = light.times;
  for (std::size_t i = 0; i < n; ++i) tail[i] = (tail[i] + times * by_level[levels[i]]) * a;
}
SLICECORR_CLONES
void sum_alike(double* __restrict out, const double* __restrict tail, double light, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) out[i] = light + tail[i];
}
SLICECORR_CLONES
void sum_each(double* __restrict out, const double* __restrict tail, const ShownLight& light,
              std::size_t n) {
  const double* __restrict const by_level = light.by_level;
  const std::uint16_t* __restrict const levels = light.levels;
  const double times = light.times;
  for (std::size_t i = 0; i < n; ++i) out[i] = times * by_level[levels[i]] + tail[i];
}

/// The dose as the sum over the nearest slices by the kernel's tables; slices further away are
/// recursed. Most pixels have shown one level for long: running sums of the tables stand for these
/// slices.
class InhibitedWalker final : public DoseWalker {
 public:
  InhibitedWalker(const CureModel& model, std::size_t columns)
      : model_(model),
        kernel_(*model.inhibited()),
        near_(static_cast<std::size_t>(kernel_.near())),
        stride_(stride_of(static_cast<std::size_t>(kernel_.levels()) + 1)),
        columns_(columns),
        blocks_((columns + kBlock - 1) / kBlock),
        slots_(near_),
        fades_{{kernel_.a(), kernel_.a(), kernel_.a()}, std::sqrt(kernel_.a())},
        same_(columns, 0),
        settled_(blocks_, std::uint8_t{0}),
        single_(near_),
        layer_(kernel_) {
    turning.assign(columns, 0);
    lower.assign(columns, 0.0);
    middle.assign(columns, 0.0);
    upper.assign(columns, 0.0);
    for (auto& tail : tail_) tail.assign(columns, 0.0);
    for (int v = 0; v < 256; ++v) {
      level_of_[v] = static_cast<std::uint16_t>((v * (kernel_.levels() - 1) + 127) / 255);
    }
    for (Slot& slot : slots_) {
      slot.shown.push_back({0, 0, std::vector<std::uint16_t>(columns, off()), {}});
      slot.alike.assign(blocks_, std::uint8_t{1});
    }
    near_light_.resize(near_);
    table_.resize(static_cast<std::size_t>(kernel_.settings() * InhibitedKernel::kPlaces));
    sums_.resize(table_.size());
  }

  void add_slice(int slice, std::span<const ImageShowing> showings) override {
    for (const ImageShowing& showing : showings) prepare(setting_of(showing, slice));
    // The slot that comes free holds the slice that leaves the tables' reach.
    const Slot& before = slots_[newest_];
    newest_ = newest_ == 0 ? near_ - 1 : newest_ - 1;
    Slot& slot = slots_[newest_];
    go_to(slice);
    fade(slot);
    if (!kernel_.alike()) forget(slot, kernel_.setting_of_slice(slice));
    slot.count = std::max<std::size_t>(1, showings.size());
    if (slot.shown.size() < slot.count) slot.shown.resize(slot.count);
    const double ratio = model_.ratio(slice);
    slice_ = slice;
    for (std::size_t k = 0; k < showings.size(); ++k) {
      const ImageShowing& showing = showings[k];
      Shown& shown = slot.shown[k];
      shown.setting = setting_of(showing, slice);
      shown.weight = showing.light * ratio;
      shown.levels.resize(columns_);
      if (showing.fronts) {
        shown.amounts.resize(columns_);
        for (std::size_t i = 0; i < columns_; ++i) {
          const FrontLight& light = showing.fronts[i];
          shown.levels[i] = light.amount > 0 ? light.front : off();
          shown.amounts[i] = light.amount;
        }
        continue;
      }
      shown.amounts.clear();
      take_levels(showing.pixels, shown.levels, slot.alike);
    }
    Shown& now = slot.shown[0];
    if (showings.empty()) {
      now.weight = 0;
      now.amounts.clear();
      std::fill(now.levels.begin(), now.levels.end(), off());
      std::fill(slot.alike.begin(), slot.alike.end(), std::uint8_t{1});
    }
    if (!slot.is_plain()) std::fill(slot.alike.begin(), slot.alike.end(), std::uint8_t{0});
    // Running sums hold only while each slice shows one image with the same setting and weight.
    const Shown& last = before.shown[0];
    const bool jump = !any_ || slot.count > 1 || before.count > 1 || now.setting != last.setting ||
                      now.weight != last.weight;
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::size_t first = b * kBlock;
      if (settled_[b] && !jump && slot.alike[b] && before.alike[b] &&
          now.levels[first] == last.levels[first]) {
        continue;
      }
      count_same(b, now, last, jump);
    }
    any_ = true;

    single_ = slot.count == 1 ? single_ + 1 : 0;
    const bool continuous = model_.mode == ExposureMode::continuous;
    if (continuous) lower.swap(upper);
    send_back(continuous);
    if (single_ >= near_) {
      gather_single(continuous);
      return;
    }
    if (!continuous) gather(InhibitedKernel::lower_end, tail_at(0), lower.data());
    gather(InhibitedKernel::middle, tail_at(1), middle.data());
    gather(InhibitedKernel::upper_end, tail_at(2), upper.data());
  }

  void inside(std::size_t i, double known, InsideLayer& out) const override {
    const double far = tail_[1][i] / fades_.half;
    const Slot& newest = slots_[newest_];
    if (same_[i] >= near_ && newest.shown[0].levels[i] != off() && lower[i] >= 1.0) {
      const Shown& now = newest.shown[0];
      if (layer_.steady_above({slice_, now.setting, now.levels[i], now.of(i)}, far, known)) {
        out.crossings.clear();
        out.least = std::min({lower[i], middle[i], upper[i]});
        return;
      }
    }
    layer_.begin(far, slice_);
    std::size_t j = 0;
    if (newest.count == 1) {
      const Shown& now = newest.shown[0];
      j = same_[i];
      if (now.levels[i] != off()) {
        layer_.add(0, static_cast<int>(j) - 1, now.setting, now.levels[i], now.of(i));
      }
    }
    for (; j < near_; ++j) {
      const Slot& slot = slots_[(newest_ + j) % near_];
      for (std::size_t k = 0; k < slot.count; ++k) {
        const Shown& shown = slot.shown[k];
        if (shown.levels[i] == off()) continue;
        layer_.add(static_cast<int>(j), shown.setting, shown.levels[i], shown.of(i));
      }
    }
    look({lower[i], middle[i], upper[i]}, known, out);
  }

  bool steady(std::size_t i, SteadyLayer& out) const override {
    const Slot& newest = slots_[newest_];
    const Shown& now = newest.shown[0];
    if (same_[i] < near_ || newest.count > 1 || now.levels[i] == off() || !kernel_.alike() ||
        model_.mode != ExposureMode::layerwise) {
      return false;
    }
    out = {tail_[1][i] / fades_.half,
           lower[i],
           middle[i],
           upper[i],
           now.setting,
           now.levels[i],
           now.of(i)};
    return true;
  }
  void inside(const SteadyLayer& layer, double known, InsideLayer& out) const override {
    layer_.begin(layer.far);
    layer_.add(0, static_cast<int>(near_) - 1, layer.setting, layer.level, layer.weight);
    look({layer.lower, layer.middle, layer.upper}, known, out);
  }

 private:
  /// Looks inside the layer whose light `layer_` has been told.
  void look(const LayerFloor::Doses& doses, double known, InsideLayer& out) const {
    if (layer_.stays(doses, known)) {
      out.crossings.clear();
      out.least = doses.least();
      return;
    }
    layer_.sample(doses.lower, doses.middle, doses.upper);
    layer_.find(known, out);
  }

  /// An image of a slice.
  struct Shown {
    int setting = 0;
    double weight = 0;
    std::vector<std::uint16_t> levels;
    std::vector<float> amounts;  ///< of light by fronts; empty: of grey levels
    /// How often the light of column i counts.
    double of(std::size_t i) const {
      return amounts.empty() ? weight : weight * static_cast<double>(amounts[i]);
    }
  };
  struct Slot {
    std::vector<Shown> shown;
    std::size_t count = 1;            ///< images in use; more are kept for their memory
    std::vector<std::uint8_t> alike;  ///< whether all columns of a block show one level
    /// One image of grey levels, or none.
    bool is_plain() const { return count == 1 && shown[0].amounts.empty(); }
  };
  /// Where the doses of a place in the layer come from and go to.
  struct Place {
    const double* sums;  ///< null: no light so far
    int place;
    const double* tail;
    double* out;
  };
  /// The image of a near slice, with the tables of each place.
  struct NearLight {
    const std::uint16_t* levels;
    const float* amounts;  ///< null: of grey levels
    double weight;
    const double* by_level[3];
    double of(std::size_t i) const {
      return amounts ? weight * static_cast<double>(amounts[i]) : weight;
    }
  };
  /// The positions in a layer whose doses are kept, each with the recursed rest of its own.
  struct Kept {
    int index;
    InhibitedKernel::LayerPosition place;
  };
  static constexpr Kept kKept[3] = {{0, InhibitedKernel::lower_end},
                                    {1, InhibitedKernel::middle},
                                    {2, InhibitedKernel::upper_end}};

  /// Where layers are not alike a setting belongs to its slice: showings may have that of another model.
  int setting_of(const ImageShowing& showing, int slice) const {
    return kernel_.alike() ? showing.setting : kernel_.setting_of_slice(slice);
  }
  std::uint16_t off() const { return static_cast<std::uint16_t>(kernel_.levels()); }
  /// An odd number of cache lines, so that the entries of one level lie in different sets.
  static std::size_t stride_of(std::size_t entries) { return ((entries + 7) / 8 | 1) * 8; }
  std::size_t block_size(std::size_t b) const { return std::min(kBlock, columns_ - b * kBlock); }

  void take_levels(const std::uint8_t* pixels, std::vector<std::uint16_t>& levels,
                   std::vector<std::uint8_t>& alike) const {
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::size_t first = b * kBlock, n = block_size(b);
      alike[b] = n == kBlock && uniform(pixels + first);
      if (alike[b]) {
        std::fill_n(&levels[first], kBlock, level_of_[pixels[first]]);
      } else {
        for (std::size_t i = first; i < first + n; ++i) levels[i] = level_of_[pixels[i]];
      }
    }
  }
  void count_same(std::size_t b, const Shown& now, const Shown& last, bool jump) {
    const std::size_t first = b * kBlock, end = first + block_size(b);
    bool settled = true;
    for (std::size_t i = first; i < end; ++i) {
      const bool same = !jump && now.levels[i] == last.levels[i] && now.of(i) == last.of(i);
      same_[i] = same ? static_cast<std::uint16_t>(std::min<std::size_t>(same_[i] + 1U, near_))
                      : std::uint16_t{1};
      settled = settled && same_[i] >= near_;
      // After the same light for `near_` slices the dose can't turn: continuous exposure only
      // approaches its steady dose, and without light the dose only fades.
      turning[i] =
          same_[i] < near_ || (model_.mode == ExposureMode::layerwise && now.levels[i] != off());
    }
    settled_[b] = settled;
  }

  /// Makes the tables of a setting, with one more level for light off, and their running sums.
  void prepare(int setting) {
    if (!table_[index(setting, InhibitedKernel::upper_end)].empty()) return;
    for (const Kept& kept : kKept) {
      const int place = kept.place;
      const double* from = kernel_.table(setting, kept.place);
      std::vector<double>& table = table_[index(setting, place)];
      std::vector<double>& sums = sums_[index(setting, place)];
      table.assign(near_ * stride_, 0.0);
      sums.assign((near_ + 1) * stride_, 0.0);
      for (std::size_t j = 0; j < near_; ++j) {
        const std::size_t levels = off();
        for (std::size_t l = 0; l < levels; ++l) {
          table[j * stride_ + l] = from[j * levels + l];
          sums[(j + 1) * stride_ + l] = sums[j * stride_ + l] + table[j * stride_ + l];
        }
      }
    }
  }
  /// What a slice adds to the farthest layer of its table, the light that the platform sends back aside.
  const double* last_row(int setting, InhibitedKernel::LayerPosition place) {
    if (kernel_.alike()) return table(setting, place) + (near_ - 1) * stride_;
    std::vector<double>& row = last_rows_[index(setting, place)];
    if (row.empty()) {
      const double* const from = kernel_.last_row(setting, place);
      row.assign(from, from + off());
      row.push_back(0);
    }
    return row.data();
  }
  /// Drops the tables of a slice that leaves their reach where no other slice needs them, nor the next one.
  void forget(const Slot& leaves, int next) {
    const int setting = leaves.shown[0].setting;
    const auto needs = [&](const Slot& slot) {
      return &slot != &leaves && slot.shown[0].setting == setting;
    };
    if (setting == next || std::any_of(slots_.begin(), slots_.end(), needs)) return;
    for (const Kept& kept : kKept) {
      const std::size_t at = index(setting, kept.place);
      table_[at] = {};
      sums_[at] = {};
      last_rows_.erase(at);
    }
  }
  std::size_t index(int setting, int place) const {
    return static_cast<std::size_t>(setting * InhibitedKernel::kPlaces + place);
  }
  const double* table(int setting, int place) const { return table_[index(setting, place)].data(); }

  /// What of far light is left at a place of this layer of what it was at that of the layer below.
  struct Fades {
    double at[3];  ///< by Kept::index
    double half;   ///< from the layer's lower end to its middle
  };
  /// Goes on to the layer of a slice.
  void go_to(int slice) {
    if (kernel_.alike()) return;
    const double um = kernel_.height_um(slice), below_um = kernel_.height_um(slice + 1);
    fades_ = {{kernel_.fade(below_um), kernel_.fade(0.5 * (um + below_um)), kernel_.fade(um)},
              kernel_.fade(0.5 * um)};
  }
  /// Far light with what the platform sends back of it.
  void send_back(bool continuous) {
    back_ = !kernel_.alike() && kernel_.returned(kernel_.place_um(slice_)) != 1;
    if (!back_) return;
    for (const Kept& kept : kKept) {
      if (kept.index == 0 && continuous) continue;
      const double times =
          kernel_.returned(kernel_.place_um(slice_ + 1 - 0.25 * static_cast<int>(kept.place)));
      std::vector<double>& out = sent_back_[kept.index];
      out.resize(columns_);
      for (std::size_t i = 0; i < columns_; ++i) out[i] = times * tail_[kept.index][i];
    }
  }
  const double* tail_at(int index) const {
    return back_ ? sent_back_[index].data() : tail_[index].data();
  }

  /// The slice in `slot` is recursed from now on.
  void fade(Slot& slot) {
    for (const Kept& kept : kKept) {
      const double a = fades_.at[kept.index];
      // Only layer by layer the light at a layer's lower end is not that of the layer before.
      if (kept.index == 0 && model_.mode == ExposureMode::continuous) continue;
      if (slot.is_plain()) {
        fade_plain(slot, kept);
        continue;
      }
      double* const tail = tail_[kept.index].data();
      for (std::size_t k = 0; k < slot.count; ++k) {
        const Shown& shown = slot.shown[k];
        // Of light that was off in all slices so far there is no table yet.
        if (shown.weight == 0) continue;
        const double* const last = last_row(shown.setting, kept.place);
        for (std::size_t i = 0; i < columns_; ++i) {
          // The row of light that is off is 0.
          tail[i] += shown.of(i) * last[shown.levels[i]];
        }
      }
      for (std::size_t i = 0; i < columns_; ++i) tail[i] *= a;
    }
  }

  void fade_plain(const Slot& slot, const Kept& kept) {
    const double a = fades_.at[kept.index];
    const Shown& shown = slot.shown[0];
    // Of light that was off in all slices so far there is no table yet.
    const bool dark = shown.weight == 0;
    const double* const last = dark ? nullptr : last_row(shown.setting, kept.place);
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::size_t first = b * kBlock, n = block_size(b);
      double* const tail = &tail_[kept.index][first];
      if (dark || slot.alike[b]) {
        fade_alike(tail, dark ? 0.0 : shown.weight * last[shown.levels[first]], a, n);
      } else {
        fade_each(tail, {last, &shown.levels[first], shown.weight}, a, n);
      }
    }
  }

  /// The doses of all places, where each near slice shows one image, or none.
  void gather_single(bool continuous) {
    const Shown& now = slots_[newest_].shown[0];
    Place places[3];
    std::size_t count = 0;
    for (const Kept& kept : kKept) {
      if (kept.index == 0 && continuous) continue;
      const bool dark = now.weight == 0 && table_[index(now.setting, kept.place)].empty();
      places[count++] = {dark ? nullptr : sums_[index(now.setting, kept.place)].data(), kept.place,
                         tail_at(kept.index),
                         (kept.index == 0   ? lower
                          : kept.index == 1 ? middle
                                            : upper)
                             .data()};
    }
    for (std::size_t j = 0; j < near_; ++j) {
      const Shown& shown = slots_[(newest_ + j) % near_].shown[0];
      NearLight& light = near_light_[j];
      light = {shown.levels.data(),
               shown.amounts.empty() ? nullptr : shown.amounts.data(),
               shown.weight,
               {}};
      for (std::size_t p = 0; p < count; ++p) {
        const std::vector<double>& table = table_[index(shown.setting, places[p].place)];
        light.by_level[p] = table.empty() ? nullptr : table.data() + j * stride_;
      }
    }
    const Slot& newest = slots_[newest_];
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::size_t first = b * kBlock, n = block_size(b);
      if (!settled_[b] || !now.amounts.empty()) {
        if (count == 2) {
          sum_unsettled<2>(places, first, n);
        } else {
          sum_unsettled<3>(places, first, n);
        }
        continue;
      }
      for (std::size_t p = 0; p < count; ++p) {
        const double* const sums = places[p].sums;
        double* const out = places[p].out + first;
        const double* const tail = places[p].tail + first;
        if (!sums) {
          sum_alike(out, tail, 0.0, n);
        } else if (newest.alike[b]) {
          sum_alike(out, tail, now.weight * sums[near_ * stride_ + now.levels[first]], n);
        } else {
          sum_each(out, tail, {sums + near_ * stride_, &now.levels[first], now.weight}, n);
        }
      }
    }
  }
  /// Columns first .. first + n - 1, one by one.
  template <std::size_t kPlacesKept>
  void sum_unsettled(const Place* places, std::size_t first, std::size_t n) const {
    const Shown& now = slots_[newest_].shown[0];
    for (std::size_t i = first; i < first + n; ++i) {
      const std::size_t same = same_[i];
      double sum[kPlacesKept] = {};
      if (now.levels[i] != off()) {
        const double times = now.of(i);
        for (std::size_t p = 0; p < kPlacesKept; ++p) {
          sum[p] = times * places[p].sums[same * stride_ + now.levels[i]];
        }
      }
      for (std::size_t j = same; j < near_; ++j) {
        const NearLight& light = near_light_[j];
        const std::uint16_t level = light.levels[i];
        if (level == off()) continue;
        const double times = light.of(i);
        for (std::size_t p = 0; p < kPlacesKept; ++p) {
          sum[p] += times * light.by_level[p][level];
        }
      }
      for (std::size_t p = 0; p < kPlacesKept; ++p) {
        places[p].out[i] = sum[p] + places[p].tail[i];
      }
    }
  }

  double sum_of(int place, std::size_t i) const {
    const std::size_t same = same_[i];
    const Slot& newest = slots_[newest_];
    const Shown& now = newest.shown[0];
    double sum = 0;
    if (now.levels[i] != off()) {
      sum = now.of(i) * sums_[index(now.setting, place)][same * stride_ + now.levels[i]];
    }
    for (std::size_t k = 1; k < newest.count; ++k) {
      const Shown& shown = newest.shown[k];
      sum += shown.of(i) * table(shown.setting, place)[shown.levels[i]];
    }
    for (std::size_t j = same; j < near_; ++j) {
      const Slot& slot = slots_[(newest_ + j) % near_];
      for (std::size_t k = 0; k < slot.count; ++k) {
        const Shown& shown = slot.shown[k];
        if (shown.levels[i] == off()) continue;
        sum += shown.of(i) * table(shown.setting, place)[j * stride_ + shown.levels[i]];
      }
    }
    return sum;
  }
  void gather(int place, const double* tail, double* out) const {
    for (std::size_t i = 0; i < columns_; ++i) out[i] = sum_of(place, i) + tail[i];
  }

  const CureModel& model_;
  const InhibitedKernel& kernel_;
  std::size_t near_, stride_, columns_, blocks_;
  std::vector<Slot> slots_;  ///< the last `near_` slices
  std::size_t newest_ = 0;
  bool any_ = false;
  int slice_ = 0;      ///< that was added last
  Fades fades_;        ///< of its layer
  bool back_ = false;  ///< the platform sends light back to its layer
  std::vector<double> sent_back_[3];
  std::vector<std::uint16_t> same_;    ///< slices for which a column has shown its level
  std::vector<std::uint8_t> settled_;  ///< whether all columns of a block have done so for `near_`
  std::vector<NearLight> near_light_;
  std::size_t single_;  ///< slices since one that showed more than one image
  std::vector<double> tail_[3];
  mutable InhibitedLayer layer_;
  std::vector<std::vector<double>> table_, sums_;
  /// Of settings with layers of their own: their last rows, with one more level for light off.
  std::map<std::size_t, std::vector<double>> last_rows_;
  std::uint16_t level_of_[256];
};

}  // namespace

std::unique_ptr<DoseWalker> make_inhibited_walker(const CureModel& model, std::size_t columns) {
  return std::make_unique<InhibitedWalker>(model, columns);
}

}  // namespace slicecorr::detail
