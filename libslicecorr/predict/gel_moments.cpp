// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/gel_moments.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "base/byte_bits.hpp"
#include "slicecorr/dose.hpp"

namespace slicecorr::detail {

bool GelMoments::known(const CureModel& model) {
  return std::holds_alternative<SumOfLight>(model.law) && model.heights.alike();
}

GelMoments::GelMoments(const CureModel& model, const PixelCurve& curve, std::size_t columns,
                       int longest, Sink sink)
    : model_(model), curve_(curve), sink_(std::move(sink)) {
  // What comes later is less than what doses are compared to.
  const double slices = std::log(kSameDose) / std::log(model.a);
  longest_ = static_cast<int>(std::min<double>(longest, std::ceil(slices)));
  const bool steady = model.mode == ExposureMode::continuous;
  const auto count = static_cast<std::size_t>(longest_) + 1;
  double left = model.root_a;  // of light at the window of slice m + j, or at its far edge
  for (std::size_t j = 0; j < count; ++j) {
    if (!steady) {
      weights_.push_back(left);
      rest_.push_back(left / model.one_minus_a);
      left *= model.a;
      continue;
    }
    weights_.push_back(j == 0 ? 1.0 - model.root_a : left * model.one_minus_a);
    rest_.push_back(j == 0 ? 1.0 : left);
    if (j > 0) left *= model.a;
  }
  rest_.push_back(left / (steady ? 1.0 : model.one_minus_a));
  if (const auto bath = static_cast<std::size_t>(model.bath_slices); bath > 0 && bath < count) {
    // A slice that ends the bath in the middle of a layer counts until it does.
    if (steady) weights_[bath] *= (1.0 - model.root_a) / model.one_minus_a;
    std::fill(weights_.begin() + static_cast<std::ptrdiff_t>(bath + (steady ? 1 : 0)),
              weights_.end(), 0.0);
  }
  if (model.lifts) keeps_ = 1.0 - model.lifts->exchange.value_or(0.0);
  brightest_ = model.phi_max() * model.greatest_ratio();
  if (model.is_plain()) {
    plain_.emplace(model, curve, columns, longest_, brightest_ * rest_.back());
    return;
  }
  columns_.resize(columns);
  while (ring_ < count) ring_ *= 2;
  const std::size_t blocks = (columns + kLanes - 1) / kLanes;
  pixels_.resize(blocks * ring_ * kLanes);
  active_.resize(blocks, 0);
  last_.resize(blocks, -1);
  same_light_.resize(curve.size());
  const std::vector<double>& ratio = model.exposure_ratio;
  equally_long_.resize(ratio.size());
  for (std::size_t n = ratio.size(); n-- > 0;) {
    equally_long_[n] = n + 1 == ratio.size() ? std::numeric_limits<int>::max() - 1
                       : ratio[n] == ratio[n + 1]
                           ? std::min(equally_long_[n + 1], std::numeric_limits<int>::max() - 2) + 1
                           : 1;
  }
}

int GelMoments::equally_long(int slice) const {
  const auto n = static_cast<std::size_t>(slice);
  return n < equally_long_.size() ? equally_long_[n] : std::numeric_limits<int>::max();
}

const GelMoments::SameLight& GelMoments::same_light(std::uint8_t pixel) {
  SameLight& same = same_light_[pixel];
  if (!same.sums.empty()) return same;
  const double phi = curve_[pixel];
  double sum = 0;
  same.sums.push_back(sum);
  for (const double weight : weights_) {
    sum = keeps_ * sum + weight * phi;
    same.sums.push_back(sum);
    same.gels = sum >= 1.0;
    if (same.gels || sum + brightest_ * rest_[same.sums.size() - 1] < 1.0) {
      same.known_after = static_cast<int>(same.sums.size()) - 1;
      return same;
    }
  }
  same.known_after = std::numeric_limits<int>::max();
  return same;
}

bool GelMoments::look(std::size_t column, int slice) {
  Column& c = columns_[column];
  const std::size_t block = column / kLanes, lane = column % kLanes;
  const int last = last_[block];
  // Light from the platform makes doses greater, so that the rest may be, too.
  const double returned = model_.returned(slice + 0.5);
  double sum = 0;
  bool gels = false, known = false;
  int j = 0;
  if (slice >= model_.mirrored_slices && model_.ratio(slice) == 1.0) {
    const SameLight& same = same_light(row(block, slice)[lane]);
    const int alike = std::min({static_cast<int>(c.alike), last - slice + 1, equally_long(slice),
                                static_cast<int>(same.sums.size()) - 1});
    known = same.known_after <= alike;
    gels = known && same.gels;
    j = known ? same.known_after - 1 : alike;
    sum = same.sums[static_cast<std::size_t>(alike)];
  }
  for (; !known && j <= longest_ && slice + j <= last; ++j) {
    const auto k = static_cast<std::size_t>(j);
    const double phi = model_.ratio(slice + j) * curve_[row(block, slice + j)[lane]];
    sum = keeps_ * sum + weights_[k] * phi;
    gels = sum * returned >= 1.0;
    if (gels || (sum + brightest_ * rest_[k + 1]) * returned < 1.0) break;
  }
  // What does so at last, by less than what doses are compared to.
  const bool late = j > longest_;
  const int delay = late ? longest_ : gels ? j : 0;
  if (delay != c.delay) {
    c.delay = static_cast<std::uint16_t>(delay);
    wanted_ = sink_(column, slice, delay);
  }
  const int looked = std::min(j, longest_) + 1;
  const bool to_the_end = slice + j > last;
  const bool mirrored = slice <= model_.mirrored_slices;
  return to_the_end || mirrored || c.alike < looked || equally_long(slice) < looked;
}

void GelMoments::add_slice(int slice, std::size_t first, std::size_t columns,
                           const std::uint8_t* pixels) {
  if (plain_) return plain_->add_slice(slice, first, columns, pixels, sink_);
  if (!pixels || !wanted_) return;
  const bool all = slice < model_.mirrored_slices || equally_long(slice) == 1;
  for (std::size_t begin = 0; begin < columns; begin += kLanes) {
    const std::size_t block = (first + begin) / kLanes, n = std::min(kLanes, columns - begin);
    std::uint8_t* const now = row(block, slice);
    std::copy_n(pixels + begin, n, now);
    std::uint64_t changed = 0;
    if (last_[block] < 0) {
      last_[block] = slice;
      changed = ~std::uint64_t{0} >> (kLanes - n);
    } else {
      changed = differing(now, row(block, slice + 1));
    }
    std::uint64_t& active = active_[block];
    active |= all ? ~std::uint64_t{0} >> (kLanes - n) : changed;
    for (std::uint64_t lanes = active; lanes != 0 && wanted_; lanes &= lanes - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(lanes));
      Column& c = columns_[block * kLanes + i];
      const bool other = (changed >> i & 1) != 0;
      c.alike = static_cast<std::uint16_t>(other ? 1 : std::min(c.alike + 1, 0xFFFF));
      if (!look(block * kLanes + i, slice)) active &= ~(std::uint64_t{1} << i);
    }
  }
}

}  // namespace slicecorr::detail
