// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/node_table.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/kernels.hpp"
#include "tomo/operators/footprint.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Tables of directions are those of the nearest of so many, evenly from an axis of voxels to a
/// diagonal.
constexpr int kTables = 256;

struct Spread {
  int pixels = 0, taps = 0, lanes = 1;
  const int* first = nullptr;
  const float* shares = nullptr;
};

SLICECORR_CLONES
void spread_lines(const Spread& s, const float* from, float* to) {
  for (int i = 0; i < s.pixels; ++i) {
    float* const node = to + s.first[i];
    const float* const share = s.shares + static_cast<std::ptrdiff_t>(i) * s.taps;
    const float light = from[i];
    for (int t0 = 0; t0 < s.taps; t0 += 8) {
      for (int t = t0; t < t0 + 8; ++t) node[t] += share[t] * light;
    }
  }
}
SLICECORR_CLONES
void gather_lines(const Spread& s, const float* from, float* to) {
  for (int i = 0; i < s.pixels; ++i) {
    const float* const node = from + s.first[i];
    const float* const share = s.shares + static_cast<std::ptrdiff_t>(i) * s.taps;
    float sum[8] = {};
    for (int t0 = 0; t0 < s.taps; t0 += 8) {
      for (int t = 0; t < 8; ++t) sum[t] += share[t0 + t] * node[t0 + t];
    }
    to[i] = ((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]));
  }
}
SLICECORR_CLONES
void spread_lanes(const Spread& s, const float* from, float* to) {
  const std::ptrdiff_t n = s.lanes;
  for (int i = 0; i < s.pixels; ++i, from += n) {
    for (int t = 0; t < s.taps; ++t) {
      const float share = s.shares[static_cast<std::ptrdiff_t>(i) * s.taps + t];
      if (share == 0) continue;
      float* const node = to + (s.first[i] + t) * n;
      for (std::ptrdiff_t l = 0; l < n; ++l) node[l] += share * from[l];
    }
  }
}
SLICECORR_CLONES
void gather_lanes(const Spread& s, const float* from, float* to) {
  const std::ptrdiff_t n = s.lanes;
  for (int i = 0; i < s.pixels; ++i, to += n) {
    for (std::ptrdiff_t l = 0; l < n; ++l) to[l] = 0;
    for (int t = 0; t < s.taps; ++t) {
      const float share = s.shares[static_cast<std::ptrdiff_t>(i) * s.taps + t];
      if (share == 0) continue;
      const float* const node = from + (s.first[i] + t) * n;
      for (std::ptrdiff_t l = 0; l < n; ++l) to[l] += share * node[l];
    }
  }
}

}  // namespace

NodeRow nodes_between(int pixels, const NodePlaces& places, const PixelProfile& profile) {
  NodeRow row;
  row.pixels = pixels;
  row.profile = profile;
  row.apart = places.voxel / 2;
  const auto taps =
      static_cast<int>(std::ceil((1 + places.widest + profile.soft + 2 * kLeastBox) / row.apart)) +
      1;
  row.taps = (taps + 7) / 8 * 8;
  // The middle of both ends is a node, as it is of even lines.
  int half = static_cast<int>(std::ceil((places.high - places.low) / 2 / row.apart)) + 2;
  half = std::max(half, row.taps / 2);
  row.nodes = 2 * half + 1;
  row.first = (places.low + places.high) / 2 - half * row.apart;
  return row;
}

NodeTable::NodeTable(const NodeRow& row, const std::vector<double>& one,
                     const std::vector<double>& other)
    : row_(row) {
  const auto taps = static_cast<std::size_t>(row.taps);
  first_.resize(static_cast<std::size_t>(row.pixels));
  shares_.resize(first_.size() * taps);
  for (int i = 0; i < row.pixels; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double wide = one[at] * one[at] + other[at] * other[at];
    // What is left of the voxel beside what lies between nodes.
    const double left = std::max(0.0, 1 - 2 * row.apart * row.apart / std::max(wide, 1e-12));
    const Boxes<double> boxes(std::sqrt(left) * one[at], std::sqrt(left) * other[at],
                              row.profile.soft);
    const double half = row.profile.lit / 2;
    const auto first =
        static_cast<int>(std::ceil((i - 0.5 - boxes.reach() - row.first) / row.apart));
    first_[at] = std::clamp(first, 0, row.nodes - row.taps);
    for (std::size_t t = 0; t < taps; ++t) {
      const double from = i - row.at(first_[at] + static_cast<int>(t));
      shares_[at * taps + t] =
          static_cast<float>((boxes.below(from + half) - boxes.below(from - half)) / (2 * half));
    }
  }
}

void NodeTable::spread(int lanes, const float* from, float* to) const {
  std::fill_n(to, static_cast<std::size_t>(row_.nodes) * static_cast<std::size_t>(lanes), 0.0F);
  const Spread s{row_.pixels, row_.taps, lanes, first_.data(), shares_.data()};
  lanes == 1 ? spread_lines(s, from, to) : spread_lanes(s, from, to);
}

void NodeTable::gather(int lanes, const float* from, float* to) const {
  const Spread s{row_.pixels, row_.taps, lanes, first_.data(), shares_.data()};
  lanes == 1 ? gather_lines(s, from, to) : gather_lanes(s, from, to);
}

DirectionTables::DirectionTables(const NodeRow& row, const std::vector<double>& voxel,
                                 const std::vector<double>& angles_rad) {
  std::vector<int> known(kTables + 1, -1);
  std::vector<double> one(voxel.size()), other(voxel.size());
  for (const double th : angles_rad) {
    const double c = std::abs(std::cos(th)), s = std::abs(std::sin(th));
    const double angle = std::atan2(std::min(c, s), std::max(c, s));
    const auto which =
        static_cast<std::size_t>(std::lround(angle / (0.25 * std::numbers::pi) * kTables));
    if (known[which] < 0) {
      const double of_table = 0.25 * std::numbers::pi * static_cast<double>(which) / kTables;
      for (std::size_t i = 0; i < voxel.size(); ++i) {
        one[i] = voxel[i] * std::cos(of_table);
        other[i] = voxel[i] * std::sin(of_table);
      }
      known[which] = static_cast<int>(tables_.size());
      tables_.emplace_back(row, one, other);
    }
    of_direction_.push_back(known[which]);
  }
}

}  // namespace slicecorr::tomo::detail
