// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_doses.hpp"

#include <utility>

namespace slicecorr::detail {

ColumnDoses::ColumnDoses(const InhibitedPlan& plan)
    : plan_(plan), reach_(static_cast<std::size_t>(plan.node_light.reach())) {
  const std::size_t count = static_cast<std::size_t>(plan.all_layers) + 1;
  levels_.resize(count);
  near_node_.resize(reach_ + count);
  near_middle_.resize(reach_ + count);
  const std::size_t looked_at = count + 1 + static_cast<std::size_t>(plan.near);
  far_node_.resize(looked_at);
  far_middle_.resize(looked_at);
  for (int i = 0; i < kSamples; ++i) {
    fade_[i] =
        static_cast<float>(std::pow(plan.kernel->a(), static_cast<double>(i + 1) / kSamples - 1.0));
  }
}

/// Takes all light away; slices after `last` will not get any.
void ColumnDoses::blacken(int last) {
  const auto used = static_cast<std::ptrdiff_t>(last_) + 1;
  const auto reach = static_cast<std::ptrdiff_t>(reach_);
  for (auto* near : {&near_node_, &near_middle_}) {
    std::fill(near->begin(), near->begin() + reach + used, 0.0);
  }
  for (auto* far : {&far_node_, &far_middle_}) std::fill(far->begin(), far->begin() + used, 0.0);
  last_ = last;
  if (!sampled_) return;
  near_fine_.resize(levels_.size() * kSamples);
  const auto samples = (static_cast<std::ptrdiff_t>(last_sampled_) + 1) * kSamples;
  std::fill(near_fine_.begin(), near_fine_.begin() + samples, 0.0F);
  last_sampled_ = last;
}

void ColumnDoses::set_floors(const std::vector<Level>& floors) {
  if (!floors_.empty() || !floors.empty()) std::fill(levels_.begin(), levels_.end(), Level{0});
  floors_ = floors;
  for (auto* dose : {&floor_node_, &floor_middle_, &floor_far_}) dose->clear();
  floor_fine_.clear();
  if (floors.empty()) return;
  floor_node_ = plan_.dark_node;
  floor_middle_ = plan_.dark_middle;
  floor_far_ = plan_.dark_far;
  floor_fine_ = plan_.dark_fine;
  double far_node = 0, far_middle = 0;  // of slices near and more layers away
  for (int k = plan_.all_layers; k-- > 0;) {
    const double node_left = plan_.node_fade(k), middle_left = plan_.middle_fade(k);
    far_node *= node_left;
    far_middle *= middle_left;
    if (const int n = k + plan_.near; n < plan_.all_layers && floor(n) > 0) {
      const int s = plan_.setting_of(n);
      far_node += node_left * plan_.ratio_of(n) * plan_.node_light.last(s, floor(n));
      far_middle += middle_left * plan_.ratio_of(n) * plan_.middle_light.last(s, floor(n));
    }
    const auto i = static_cast<std::size_t>(k);
    floor_far_[i] += far_node;
    floor_node_[i] += far_node * plan_.node_back(k);
    floor_middle_[i] += far_middle * plan_.middle_back(k);
    for (int j = 0; j < plan_.near && k + j < plan_.all_layers; ++j) {
      const int n = k + j, s = plan_.setting_of(n);
      if (floor(n) == 0) continue;
      floor_node_[i] += plan_.ratio_of(n) * plan_.node_light.close(s, floor(n), j);
      floor_middle_[i] += plan_.ratio_of(n) * plan_.middle_light.close(s, floor(n), j);
    }
    if (floor_fine_.empty()) continue;
    float* const out = &floor_fine_[i * kSamples];
    const float* const fade =
        plan_.sample_fades.empty() ? fade_ : plan_.sample_fades.data() + i * kSamples;
    for (int t = 0; t < kSamples; ++t) out[t] += static_cast<float>(far_node) * fade[t];
    for (int j = 0; j < plan_.near && k + j < plan_.all_layers; ++j) {
      const int n = k + j;
      if (floor(n) == 0) continue;
      const float* const table =
          plan_.kernel->fine(plan_.setting_of(n)) + static_cast<std::ptrdiff_t>(j) * kSamples;
      const float* const more =
          table + static_cast<std::ptrdiff_t>(floor(n) * plan_.near) * kSamples;
      for (int t = 0; t < kSamples; ++t) {
        out[t] += static_cast<float>(plan_.ratio_of(n)) * (more[t] - table[t]);
      }
    }
  }
}

void ColumnDoses::clear() {
  sampled_ = false;
  // Levels of slices after the last one lit are those of their floors already.
  std::fill_n(levels_.begin(), last_ + 1, Level{0});
  std::copy(floors_.begin(), floors_.end(), levels_.begin());
  blacken(-1);
}

void ColumnDoses::take(const std::vector<Level>& levels, bool sampled) {
  levels_ = levels;
  sampled_ = sampled;
  rebuild();
}

void ColumnDoses::rebuild() {
  int last = plan_.all_layers - 1;
  while (last >= 0 && level(last) == floor(last)) --last;
  blacken(last);
  for (int n = last; n >= 0; --n) add(n, level(n));
}

void ColumnDoses::add(int n, int level) {
  const auto i = static_cast<std::size_t>(n);
  const double r = plan_.ratio_of(n);
  const int farthest = n - plan_.near + 1;
  far_node_[i] = plan_.node_fade(farthest) * far_node_[i + 1];
  far_middle_[i] = plan_.middle_fade(farthest) * far_middle_[i + 1];
  levels_[i] = static_cast<Level>(level);
  last_ = std::max(last_, n);
  const int least = floor(n);
  if (level == least) return;
  const int s = plan_.setting_of(n);
  // Extra light of level 0 is 0.
  far_node_[i] += r * (plan_.node_light.last(s, level) - plan_.node_light.last(s, least));
  far_middle_[i] += r * (plan_.middle_light.last(s, level) - plan_.middle_light.last(s, least));
  move_light(n, least, level);
  move_samples(n, least, level);
}

void ColumnDoses::add_same(int n, int end) {
  const int level = this->level(n + 1), last = plan_.near - 1;
  const double a = plan_.kernel->a(), r = plan_.ratio_of(n);
  const double node =
      r * (plan_.node_light.close(0, level, last) - plan_.node_light.close(0, 0, last));
  const double middle =
      r * (plan_.middle_light.close(0, level, last) - plan_.middle_light.close(0, 0, last));
  for (int k = n; k >= end; --k) {
    const auto i = static_cast<std::size_t>(k);
    far_node_[i] = a * far_node_[i + 1] + node;
    far_middle_[i] = a * far_middle_[i + 1] + middle;
  }
  std::fill(levels_.begin() + end, levels_.begin() + n + 1, static_cast<Level>(level));
  // The layers that these slices reach beyond the last of them have what those beyond slice n + 1 had;
  // the others have all of it.
  for (auto* near : {&near_node_, &near_middle_}) {
    const auto at = near->begin() + static_cast<std::ptrdiff_t>(reach_);
    kept_.assign(at + n + 2 - plan_.near, at + n + 1);
    std::fill(at + end, at + n + 1, at[n + 1]);
    std::copy(kept_.begin(), kept_.end(), at + end + 1 - plan_.near);
  }
}

void ColumnDoses::add_dark(int n, int end) {
  if (n < end) return;
  const double a = plan_.kernel->a();
  auto i = static_cast<std::size_t>(n) + 1;
  double node = far_node_[i], middle = far_middle_[i];
  if (node == 0 && middle == 0) return;
  last_ = std::max(last_, n);
  for (const auto stop = static_cast<std::size_t>(end); i > stop && plan_.fades.empty();) {
    --i;
    far_node_[i] = node = a * node;
    far_middle_[i] = middle = a * middle;
  }
  for (int k = n; k >= end && !plan_.fades.empty(); --k) {
    const auto at = static_cast<std::size_t>(k);
    const int farthest = k - plan_.near + 1;
    far_node_[at] = node = plan_.node_fade(farthest) * node;
    far_middle_[at] = middle = plan_.middle_fade(farthest) * middle;
  }
}

/// What slices from `next` on give node k, all of them beyond the reach of the tables, where layers are not alike.
double ColumnDoses::far_of_own(int k, int next) const {
  return far_node_[static_cast<std::size_t>(next)] *
         plan_.far_light.fade(next - plan_.near + 1, k) * plan_.node_back(k);
}

/// Replaces the light that slice n gives the layers within reach of the tables: that of level
/// `from` by that of level `to`.
void ColumnDoses::move_light(int n, int from, int to) {
  const int s = plan_.setting_of(n);
  const double r = plan_.ratio_of(n);
  const ExtraLight &node = plan_.node_light, &middle = plan_.middle_light;
  // The slice's own layer is the last of those that are changed; what passes the first is lost.
  const auto first = static_cast<std::size_t>(n) + 1;
  last_ = std::max(last_, n);
  const double *const from_node = from == 0 ? nullptr : node.upwards(s, from),
                      *const from_middle = from == 0 ? nullptr : middle.upwards(s, from);
  change_light({from_node, from_middle, node.upwards(s, to), middle.upwards(s, to), r, reach_},
               near_node_.data() + first, near_middle_.data() + first);
}

/// The same inside layers, where that is asked for.
void ColumnDoses::move_samples(int n, int from, int to) {
  if (!sampled_) return;
  const int s = plan_.setting_of(n);
  const double r = plan_.ratio_of(n);
  last_sampled_ = std::max(last_sampled_, n);
  const float* const table = plan_.kernel->fine(s);
  const auto row = static_cast<std::ptrdiff_t>(plan_.near) * kSamples;
  change_samples({table + from * row, table + to * row, static_cast<float>(r),
                  static_cast<std::size_t>(std::min(plan_.near, n + 1))},
                 &near_fine_[static_cast<std::size_t>(n) * kSamples]);
}

void ColumnDoses::remember(int n) {
  const auto at = [](std::size_t i) { return static_cast<std::ptrdiff_t>(i); };
  // As move_light() counts: what slice n - 1 reaches begins one layer further up.
  kept_from_ = static_cast<std::size_t>(n);
  for (auto [from, to] : {std::pair{&near_node_, &kept_node_}, {&near_middle_, &kept_middle_}}) {
    const auto begin = from->begin() + at(kept_from_);
    to->assign(begin, begin + at(reach_) + 1);
  }
  if (!sampled_) return;
  kept_fine_from_ = static_cast<std::size_t>(std::max(0, n - plan_.near)) * kSamples;
  kept_fine_.assign(near_fine_.begin() + at(kept_fine_from_),
                    near_fine_.begin() + at(static_cast<std::size_t>(n) + 1) * kSamples);
}

void ColumnDoses::recall() {
  const auto at = [](std::size_t i) { return static_cast<std::ptrdiff_t>(i); };
  std::copy(kept_node_.begin(), kept_node_.end(), near_node_.begin() + at(kept_from_));
  std::copy(kept_middle_.begin(), kept_middle_.end(), near_middle_.begin() + at(kept_from_));
  if (!sampled_) return;
  std::copy(kept_fine_.begin(), kept_fine_.end(), near_fine_.begin() + at(kept_fine_from_));
}

}  // namespace slicecorr::detail
