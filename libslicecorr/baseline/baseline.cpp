// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/baseline.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/kernels.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

/// "First layer" of a run on the platform: old enough for any N.
constexpr std::int32_t kPlatform = std::numeric_limits<std::int32_t>::min();

/// Keeps the pixels of runs that began in layer `newest` or before.
SLICECORR_CLONES
void keep_begun(const std::uint8_t* __restrict coverage, const std::int32_t* __restrict first,
                std::int32_t newest, std::uint8_t* __restrict out, std::size_t columns) {
  for (std::size_t i = 0; i < columns; ++i) {
    out[i] = static_cast<std::uint8_t>(first[i] <= newest ? coverage[i] : 0);
  }
}

SLICECORR_CLONES
void subtract(const std::uint8_t* __restrict coverage, const std::uint8_t* __restrict one,
              const std::uint8_t* __restrict two, const std::uint8_t* __restrict three,
              const std::uint8_t* __restrict four, std::uint8_t* __restrict out,
              std::size_t columns) {
  for (std::size_t i = 0; i < columns; ++i) {
    const int left = coverage[i] - (one[i] ? kGreyTable[0] : 0) - (two[i] ? kGreyTable[1] : 0) -
                     (three[i] ? kGreyTable[2] : 0) - (four[i] ? kGreyTable[3] : 0);
    out[i] = static_cast<std::uint8_t>(left > 0 ? left : 0);
  }
}

}  // namespace

BandErase::BandErase(std::size_t columns) : first_(columns, 0), before_(columns), empty_(columns) {}

void BandErase::add_layer(const std::uint8_t* coverage) {
  using detail::kBlock;
  const std::uint8_t* rows = coverage ? coverage : empty_.data();
  const auto layer = static_cast<std::int32_t>(ends_end_.size());
  const std::size_t columns = first_.size();
  for (std::size_t b = 0; b < columns; b += kBlock) {
    const std::size_t end = std::min(b + kBlock, columns);
    if (std::memcmp(&before_[b], rows + b, end - b) == 0) continue;
    for (std::size_t i = b; i < end; ++i) {
      if (rows[i] && !before_[i]) {
        first_[i] = layer > 0 ? layer : kPlatform;
      } else if (!rows[i] && before_[i]) {
        ends_.push_back({static_cast<std::uint32_t>(i), first_[i]});
      }
    }
    std::memcpy(&before_[b], rows + b, end - b);
  }
  ends_end_.push_back(ends_.size());
}

BandErase::Walk::Walk(const BandErase& band, int erased_layers)
    : band_(band),
      erased_layers_(erased_layers),
      layer_(static_cast<int>(band.ends_end_.size())),
      first_(band.first_),  // of the runs that end with the last layer
      out_(band.first_.size()) {}

const std::uint8_t* BandErase::Walk::next(const std::uint8_t* coverage) {
  const auto below = static_cast<std::size_t>(layer_--);
  if (below < band_.ends_end_.size()) {
    for (std::size_t i = band_.ends_end_[below - 1]; i < band_.ends_end_[below]; ++i) {
      first_[band_.ends_[i].column] = band_.ends_[i].first;
    }
  }
  keep_begun(coverage, first_.data(), layer_ - erased_layers_, out_.data(), out_.size());
  return out_.data();
}

BandGreyTable::BandGreyTable(std::size_t columns) : out_(columns) {
  for (auto& layer : later_) layer.assign(columns, 0);
}

const std::uint8_t* BandGreyTable::next(const std::uint8_t* coverage) {
  subtract(coverage, later_[0].data(), later_[1].data(), later_[2].data(), later_[3].data(),
           out_.data(), out_.size());
  std::rotate(later_.begin(), later_.end() - 1, later_.end());
  std::memcpy(later_[0].data(), coverage, out_.size());
  return out_.data();
}

int cure_through_slices(const CureModel& model) {
  constexpr int most = 1'000'000;
  if (!model.is_plain()) {
    // What a long feature leaves, until black light of one more slice gels nothing. Layers with the
    // longest exposure stand for all.
    CureModel longest = model;
    longest.level_phi.front() *= model.greatest_ratio();
    longest.level_phi.back() *= model.greatest_ratio();
    longest.exposure_ratio.clear();
    // Of the thinnest layers it takes the most.
    double thinnest = 1;
    if (!model.heights.alike()) {
      const std::vector<double>& um = model.heights.um();
      const auto n = std::min_element(um.begin(), um.end()) - um.begin();
      const auto layer = static_cast<int>(n);
      thinnest = model.height(layer);
      longest.heights = LayerHeights({um[static_cast<std::size_t>(n)]});
      longest.own_a = {model.a_of(layer)};
      longest.own_root_a = {model.root_a_of(layer)};
      longest.own_one_minus_a = {model.one_minus_a_of(layer)};
    }
    // There phi is not what doses are made of.
    if (model.gel_time()) longest.exposure_ratio = {model.greatest_ratio()};
    const double decades = model.least_fall() * thinnest / units::kLn10;
    const int high = static_cast<int>(std::min<double>(most, std::ceil(16.0 / decades) + 1));
    const std::uint8_t full = 255, black = 0;
    BandDose dose(longest, 1);
    int slice = high + most;
    while (slice-- > most) dose.add_slice(slice, &full);
    for (int n = 0; n < most; ++n) {
      dose.add_slice(most - 1 - n, &black);
      if (*dose.lower() < 1.0) return n;
    }
    return most;
  }
  // The dose of a high feature is phi_max, and falls towards phi_min in the dark above it.
  const double fall = (model.phi_max() - model.phi_min()) / (1.0 - model.phi_min());
  const double slices = std::ceil(std::log10(fall) / model.eta);
  return static_cast<int>(std::clamp(slices, 0.0, 1e6));
}

}  // namespace slicecorr
