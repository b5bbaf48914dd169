// What all columns under UV light share: tables of light, lags and bounds.
#include <algorithm>
#include <cmath>
#include <utility>

#include "correct/band_solvers.hpp"
#include "correct/inhibited_column.hpp"

namespace slicecorr::detail {

/// What nodes inside features demand.
static constexpr double kInside = 1.003;

ExtraLight::ExtraLight(const InhibitedKernel& kernel, InhibitedKernel::LayerPosition place)
    : near_(kernel.near()), levels_(kernel.levels()), a_(kernel.a()) {
  for (int s = 0; s < kernel.settings(); ++s) {
    const double* from = kernel.table(s, place);
    std::vector<double> table(static_cast<std::size_t>(near_ * levels_));
    std::vector<double> sums(static_cast<std::size_t>((near_ + 1) * levels_), 0.0);
    for (int j = 0; j < near_; ++j) {
      for (int l = 0; l < levels_; ++l) {
        const auto at = static_cast<std::size_t>(j * levels_ + l);
        table[at] = std::max(0.0, from[at] - from[static_cast<std::size_t>(j * levels_)]);
        sums[at + static_cast<std::size_t>(levels_)] = sums[at] + table[at];
      }
    }
    tables_.push_back(std::move(table));
    sums_.push_back(std::move(sums));
  }
}

double ExtraLight::one(int setting, int l, int j) const {
  const std::vector<double>& t = tables_[static_cast<std::size_t>(setting)];
  if (j < near_) return t[static_cast<std::size_t>(j * levels_ + l)];
  return t[static_cast<std::size_t>((near_ - 1) * levels_ + l)] * std::pow(a_, j - near_ + 1);
}

double ExtraLight::sum(int setting, int l, int j) const {
  const std::vector<double>& s = sums_[static_cast<std::size_t>(setting)];
  const auto at = static_cast<std::size_t>(std::min(j, near_) * levels_ + l);
  if (j <= near_) return s[at];
  const double last = tables_[static_cast<std::size_t>(setting)]
                             [static_cast<std::size_t>((near_ - 1) * levels_ + l)];
  return s[at] + last * a_ * (1.0 - std::pow(a_, j - near_)) / (1.0 - a_);
}

InhibitedPlan::InhibitedPlan(const CureModel& model, bool merge, int target_layers, int all_slices)
    : kernel(model.inhibited),
      node_light(*kernel, InhibitedKernel::upper_end),
      middle_light(*kernel, InhibitedKernel::middle),
      near(kernel->near()),
      levels(kernel->levels()),
      layers(target_layers),
      all_layers(all_slices),
      layer_um(model.layer_um),
      merge_one_slice_gaps(merge) {
  for (int s = 0; s < kernel->settings(); ++s) caps.push_back(kernel->highest_usable_level(s));
  const int strongest = kernel->strongest_setting();
  const int cap = caps[static_cast<std::size_t>(strongest)];
  steady = cap;
  while (steady > 0 && kernel->steady_dose(strongest, steady - 1) >= 1.0) --steady;
  // Layer by layer the dose ripples between nodes: the least in a layer is what has to gel.
  double ripple = 1.0;
  if (model.mode == ExposureMode::layerwise) {
    constexpr int samples = InhibitedKernel::samples;
    const float* const fine = kernel->fine(strongest);
    double sum[samples] = {};
    for (int j = 0; j < near; ++j) {
      for (int i = 0; i < samples; ++i) {
        const double light = fine[static_cast<std::size_t>(j * levels + steady) * samples +
                                  static_cast<std::size_t>(i)];
        sum[i] += j + 1 < near ? light : light / (1.0 - kernel->a());
      }
    }
    ripple = sum[samples - 1] / *std::min_element(sum, sum + samples);
  }
  inside = kInside * ripple;
  holding = steady;
  while (holding < levels && kernel->steady_dose(strongest, holding) < inside) ++holding;
  for (const double r : model.exposure_ratio) uniform = uniform && r == 1.0;
  uniform = uniform && kernel->settings() == 1;
  if (!uniform) {
    for (int n = 0; n < all_layers; ++n) ratio.push_back(model.ratio(n));
  }
  const ExtraLight& extra = node_light;
  reach = 1;
  while (reach < 100000 && extra.sum(strongest, cap, reach) < 1.0) ++reach;
  // The distance at which a slice of the steady level acts most, and shorter ones: short lags keep
  // gaps narrow, long ones suit thin features.
  int peak = 0;
  for (int j = 1; j < near; ++j) {
    if (extra.one(strongest, steady, j) > extra.one(strongest, steady, peak)) peak = j;
  }
  for (const int lag : {peak / 2, peak / 3, 2 * peak / 3, peak / 4, peak}) {
    const int at_least = std::max(lag, 1);
    if (std::find(lags.begin(), lags.end(), at_least) == lags.end()) lags.push_back(at_least);
  }
  const auto count = static_cast<std::size_t>(all_layers);
  const auto dark = [&](InhibitedKernel::LayerPosition place) {
    std::vector<double> dose(count, 0.0);
    double far = 0;  // of slices near or more layers away
    for (int k = all_layers; k-- > 0;) {
      far *= kernel->a();
      if (k + near < all_layers) {
        const int n = k + near;
        far += kernel->a() * model.ratio(n) *
               kernel->table(kernel->setting_of_slice(n), place)[(near - 1) * levels];
      }
      double sum = far;
      for (int j = 0; j < near && k + j < all_layers; ++j) {
        sum +=
            model.ratio(k + j) * kernel->table(kernel->setting_of_slice(k + j), place)[j * levels];
      }
      dose[static_cast<std::size_t>(k)] = sum;
      if (place == InhibitedKernel::upper_end) dark_far[static_cast<std::size_t>(k)] = far;
    }
    return dose;
  };
  dark_far.resize(count);
  dark_node = dark(InhibitedKernel::upper_end);
  dark_middle = dark(InhibitedKernel::middle);
  if (model.mode != ExposureMode::layerwise) return;
  constexpr std::size_t samples = InhibitedKernel::samples;
  dark_fine.resize(count * samples);
  for (int k = 0; k < all_layers; ++k) {
    float* const out = &dark_fine[static_cast<std::size_t>(k) * samples];
    for (std::size_t i = 0; i < samples; ++i) {
      const double t = static_cast<double>(i + 1) / samples;
      double sum = dark_far[static_cast<std::size_t>(k)] * std::pow(kernel->a(), t - 1.0);
      for (int j = 0; j < near && k + j < all_layers; ++j) {
        sum += model.ratio(k + j) * kernel->fine(kernel->setting_of_slice(
                                        k + j))[static_cast<std::size_t>(j * levels) * samples + i];
      }
      out[i] = static_cast<float>(sum);
    }
  }
}

int inhibited_slices(const CureModel& model, int target_layers, int last_lit) {
  const InhibitedPlan plan(model, false, 1, 1);
  // Whoever is promised its dose late gets it by light further away.
  return std::max(target_layers, last_lit + 1 + plan.reach + plan.lags.front() + 2);
}

}  // namespace slicecorr::detail
