// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <limits>

#include "slicecorr/cure.hpp"

namespace slicecorr {

LevelTable::LevelTable(std::vector<double> level_phi) : phi_(std::move(level_phi)), bounds_(phi_) {
  bounds_.push_back(std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < phi_.size(); ++i) {
    const bool flat = i > 0 && phi_[i] == phi_[i - 1];
    const std::int32_t here = flat ? steps_[i - 1].here : static_cast<std::int32_t>(i);
    steps_.push_back({i > 0 ? steps_[i - 1].here : here, here});
  }
  steps_.push_back({steps_.back().here, steps_.back().here});
  const double range = phi_.back() - phi_.front();
  scale_ = range > 0 ? static_cast<double>(kBuckets) / range : 0.0;
  start_.assign(kBuckets + 2, static_cast<int>(phi_.size()));
  for (std::size_t i = phi_.size(); i-- > 0;) {
    // All levels before the first one of this bucket lie in lower buckets, so below any phi in it.
    start_[bucket(phi_[i])] = static_cast<int>(i);
  }
  for (std::size_t b = start_.size() - 1; b-- > 0;) start_[b] = std::min(start_[b], start_[b + 1]);
}

}  // namespace slicecorr
