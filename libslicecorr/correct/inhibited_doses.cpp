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

void ColumnDoses::clear() {
  sampled_ = false;
  blacken();
  std::fill(levels_.begin(), levels_.end(), std::uint8_t{0});
}

void ColumnDoses::take(const std::vector<std::uint8_t>& levels, bool sampled) {
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
  levels_[i] = static_cast<std::uint8_t>(level);
  if (level == 0) return;
  const int s = plan_.setting_of(n);
  far_node_[i] += r * plan_.node_light.row(s, plan_.near - 1)[level];
  far_middle_[i] += r * plan_.middle_light.row(s, plan_.near - 1)[level];
  move_light(n, 0, level);
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
