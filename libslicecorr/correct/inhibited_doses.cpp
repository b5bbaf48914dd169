// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_doses.hpp"

namespace slicecorr::detail {

ColumnDoses::ColumnDoses(const InhibitedPlan& plan) : plan_(plan) {
  const std::size_t count = static_cast<std::size_t>(plan.all_layers) + 1;
  levels_.resize(count);
  near_node_.resize(count);
  near_middle_.resize(count);
  far_node_.resize(count + 1);
  far_middle_.resize(count + 1);
  for (int i = 0; i < kSamples; ++i) {
    fade_[i] =
        static_cast<float>(std::pow(plan.kernel->a(), static_cast<double>(i + 1) / kSamples - 1.0));
  }
}

void ColumnDoses::blacken() {
  std::fill(near_node_.begin(), near_node_.end(), 0.0);
  std::fill(near_middle_.begin(), near_middle_.end(), 0.0);
  std::fill(far_node_.begin(), far_node_.end(), 0.0);
  std::fill(far_middle_.begin(), far_middle_.end(), 0.0);
  if (sampled_) near_fine_.assign(levels_.size() * kSamples, 0.0F);
}

void ColumnDoses::set_floors(const std::vector<Level>& floors) {
  floors_ = floors;
  for (auto* dose : {&floor_node_, &floor_middle_, &floor_far_}) dose->clear();
  floor_fine_.clear();
  if (floors.empty()) return;
  floor_node_ = plan_.dark_node;
  floor_middle_ = plan_.dark_middle;
  floor_far_ = plan_.dark_far;
  floor_fine_ = plan_.dark_fine;
  const double a = plan_.kernel->a();
  double far_node = 0, far_middle = 0;  // of slices near and more layers away
  for (int k = plan_.all_layers; k-- > 0;) {
    far_node *= a;
    far_middle *= a;
    if (const int n = k + plan_.near; n < plan_.all_layers && floor(n) > 0) {
      const double r = a * plan_.ratio_of(n);
      const int s = plan_.setting_of(n);
      far_node += r * plan_.node_light.row(s, plan_.near - 1)[floor(n)];
      far_middle += r * plan_.middle_light.row(s, plan_.near - 1)[floor(n)];
    }
    const auto i = static_cast<std::size_t>(k);
    floor_far_[i] += far_node;
    floor_node_[i] += far_node;
    floor_middle_[i] += far_middle;
    for (int j = 0; j < plan_.near && k + j < plan_.all_layers; ++j) {
      const int n = k + j, s = plan_.setting_of(n);
      if (floor(n) == 0) continue;
      floor_node_[i] += plan_.ratio_of(n) * plan_.node_light.row(s, j)[floor(n)];
      floor_middle_[i] += plan_.ratio_of(n) * plan_.middle_light.row(s, j)[floor(n)];
    }
    if (floor_fine_.empty()) continue;
    float* const out = &floor_fine_[i * kSamples];
    for (int t = 0; t < kSamples; ++t) out[t] += static_cast<float>(far_node) * fade_[t];
    for (int j = 0; j < plan_.near && k + j < plan_.all_layers; ++j) {
      const int n = k + j;
      if (floor(n) == 0) continue;
      const float* const table = plan_.kernel->fine(plan_.setting_of(n)) +
                                 static_cast<std::size_t>(j * plan_.levels) * kSamples;
      const float* const more = table + static_cast<std::ptrdiff_t>(floor(n)) * kSamples;
      for (int t = 0; t < kSamples; ++t) {
        out[t] += static_cast<float>(plan_.ratio_of(n)) * (more[t] - table[t]);
      }
    }
  }
}

void ColumnDoses::clear() {
  sampled_ = false;
  blacken();
  std::fill(levels_.begin(), levels_.end(), Level{0});
  std::copy(floors_.begin(), floors_.end(), levels_.begin());
}

void ColumnDoses::take(const std::vector<Level>& levels, bool sampled) {
  levels_ = levels;
  sampled_ = sampled;
  rebuild();
}

void ColumnDoses::rebuild() {
  blacken();
  for (int n = plan_.all_layers; n-- > 0;) add(n, level(n));
}

void ColumnDoses::add(int n, int level) {
  const auto i = static_cast<std::size_t>(n);
  const double r = plan_.ratio_of(n), a = plan_.kernel->a();
  far_node_[i] = a * far_node_[i + 1];
  far_middle_[i] = a * far_middle_[i + 1];
  levels_[i] = static_cast<Level>(level);
  const int least = floor(n);
  if (level == least) return;
  const int s = plan_.setting_of(n);
  const double *const node_row = plan_.node_light.row(s, plan_.near - 1),
                      *const middle_row = plan_.middle_light.row(s, plan_.near - 1);
  // Extra light of level 0 is 0.
  far_node_[i] += r * (node_row[level] - node_row[least]);
  far_middle_[i] += r * (middle_row[level] - middle_row[least]);
  move_light(n, least, level);
}

/// Replaces the light that slice n gives the layers within reach of the tables: that of level
/// `from` by that of level `to`.
void ColumnDoses::move_light(int n, int from, int to) {
  const int s = plan_.setting_of(n);
  const double r = plan_.ratio_of(n);
  const int end = std::min(plan_.near, n + 1);
  for (int j = 0; j < end; ++j) {
    const auto k = static_cast<std::size_t>(n - j);
    const double* node_row = plan_.node_light.row(s, j);
    const double* middle_row = plan_.middle_light.row(s, j);
    near_node_[k] += r * (node_row[to] - node_row[from]);
    near_middle_[k] += r * (middle_row[to] - middle_row[from]);
  }
  if (!sampled_) return;
  const float* const table = plan_.kernel->fine(s);
  for (int j = 0; j < end; ++j) {
    const float* const more = table + static_cast<std::size_t>(j * plan_.levels + to) * kSamples;
    const float* const less = table + static_cast<std::size_t>(j * plan_.levels + from) * kSamples;
    float* const out = &near_fine_[static_cast<std::size_t>(n - j) * kSamples];
    for (int i = 0; i < kSamples; ++i) out[i] += static_cast<float>(r) * (more[i] - less[i]);
  }
}

}  // namespace slicecorr::detail
