// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a prediction looks at inside layers, where their ends and middles do not say enough.

#include <algorithm>
#include <limits>

#include "base/coded_band.hpp"
#include "cure/inhibited_layer.hpp"
#include "predict/band_state.hpp"

namespace slicecorr {

bool BandPredictor::State::put_off(std::size_t i) {
  SteadyLayer now;
  if (!dose_->steady(i, now)) return false;
  if (put_off_.empty()) put_off_.resize(columns_.size());
  if (!put_off_[i].same_light(now)) look_at_last(i);
  SteadyLayer& kept = put_off_[i];
  if (kept.weight == 0 || now.far < kept.far) kept = now;
  return true;
}

void BandPredictor::State::look_at_last(std::size_t i) {
  if (put_off_.empty() || put_off_[i].weight == 0) return;
  InsideLayer inside;
  dose_->inside(put_off_[i], least_[i], inside);
  least_[i] = std::min(least_[i], inside.least);
  put_off_[i].weight = 0;
}

/// Looks inside the layer of those columns of a block whose dose may turn there and where it
/// matters: the dose may pass 1, or be the least so far. Light falls by a in a slice at most, so
/// the dose at a place bounds the doses beside it.
void BandPredictor::State::look_inside(int slice, std::size_t first, std::size_t n,
                                       const std::uint8_t* cover) {
  constexpr double never = std::numeric_limits<double>::infinity();
  looked_ = 0;
  passes_inside_ = false;
  const std::uint8_t* const turning = dose_->turning();
  if (!turning || detail::all_zero(turning + first, n)) return;
  const double *const lower = dose_->lower() + first, *const middle = dose_->middle() + first,
                      *const upper = dose_->upper() + first;
  // Where resin ends, light that leaves counts, too: with a time to gel its root does.
  const bool ends =
      model_.inhibited() ? model_.inhibited()->ends() : model_.gel_time() && model_.bath_slices > 0;
  const double fall = (ends ? model_.a : model_.root_a_of(slice)) * (1.0 - kSameDose);
  std::size_t last = n;  // looked at
  double last_known = 0;
  const bool smooth =
      (model_.inhibited() || model_.gel_time()) && model_.mode == ExposureMode::continuous;
  for (std::size_t i = 0; i < n; ++i) {
    if (!turning[first + i]) continue;
    double low = std::min(lower[i], middle[i]) * fall;
    double high = std::max(middle[i], upper[i]) / fall;
    if (smooth) {
      const detail::SmoothBounds bounds(lower[i], middle[i], upper[i]);
      low = std::max(low, bounds.low);
      high = std::min(high, bounds.high);
    }
    const bool passes = low < 1.0 && high >= 1.0;
    double known = -never;
    if (cover[i] == 255) {
      known = prediction_.min_inside_layers;
    } else if (cover[i] == 0 && (columns_[first + i].run_below || class_[first + i] == run)) {
      known = class_[first + i] == gap ? least_[first + i] : never;
    }
    const double least = std::min({lower[i], middle[i], upper[i]});
    if (!passes && low >= std::min(known, least)) continue;
    if (!passes && cover[i] == 0 && class_[first + i] == gap && put_off(first + i)) continue;
    // A neighbour with the same doses at both ends and in the middle has had the same light.
    const bool alike = last < n && lower[i] == lower[last] && middle[i] == middle[last] &&
                       upper[i] == upper[last] && known <= last_known;
    if (alike) {
      inside_[i] = inside_[last];
    } else {
      // The same of any column of the slice.
      LayersSeen::Layer& seen = layers_seen_.of(lower[i], middle[i], upper[i]);
      if (!seen.is(slice, lower[i], middle[i], upper[i]) || known > seen.known) {
        dose_->inside(first + i, known, seen.inside);
        seen.take(slice, lower[i], middle[i], upper[i]);
        seen.known = known;
      }
      inside_[i] = seen.inside;
      last_known = seen.known;
    }
    last = i;
    looked_ |= std::uint64_t{1} << i;
    passes_inside_ = passes_inside_ || !inside_[i].crossings.empty();
  }
}

}  // namespace slicecorr
