// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/plane_edges.hpp"

#include <algorithm>
#include <boost/math/special_functions/erf.hpp>
#include <cmath>

#include "base/coded_band.hpp"

namespace slicecorr::detail {

namespace {

/// Where more greys than this lie side by side a wall is so slanted that its outline is no line.
constexpr int kMostGreys = 4;

/// Where on its way from `inner` >= 1 to `outer` < 1 the dose passes 1, 0..1; `high` and `low`: the
/// doses that it comes from and goes to.
double passing(double inner, double outer, double high, double low) {
  const auto distance = [&](double dose) {
    const double share = (dose - low) / (high - low);
    return boost::math::erfc_inv(2.0 * std::clamp(share, 1e-12, 1.0 - 1e-12));
  };
  const double from = distance(inner), to = distance(outer);
  return to > from ? std::clamp((distance(1.0) - from) / (to - from), 0.0, 1.0) : 0.5;
}

}  // namespace

PlaneEdges::PlaneEdges(const Grid& grid, const PixelBox& field, const PixelBox& window, int reach)
    : field_(field),
      window_(window),
      reach_(reach),
      pitch_x_um_(grid.pixel_x_um),
      pitch_y_um_(grid.pixel_y_um),
      at_edge_(static_cast<std::size_t>(field.width())) {}

void PlaneEdges::add(int slice, const double* dose, const std::uint8_t* coverage) {
  if (!coverage) return;
  const auto width = static_cast<std::size_t>(field_.width());
  const std::vector<std::uint8_t> nothing(width, 0);
  for (int y = window_.y0; y < window_.y1; ++y) {
    const std::size_t first = static_cast<std::size_t>(y - field_.y0) * width;
    const std::uint8_t* const row = coverage + first;
    if (all_zero(row, width)) continue;
    const std::uint8_t* const above = y > field_.y0 ? row - width : nothing.data();
    const std::uint8_t* const below = y + 1 < field_.y1 ? row + width : nothing.data();
    for (std::size_t x = 0; x < width; ++x) {
      const std::uint8_t left = x > 0 ? row[x - 1] : std::uint8_t{0};
      const std::uint8_t right = x + 1 < width ? row[x + 1] : std::uint8_t{0};
      at_edge_[x] = row[x] == 255 && (left & right & above[x] & below[x]) != 255;
    }
    const int rows_above = y - field_.y0, rows_below = field_.y1 - 1 - y;
    const auto stride = static_cast<std::ptrdiff_t>(width);
    for (std::size_t x = 0; x < width; ++x) {
      if (!at_edge_[x]) continue;
      const int left = static_cast<int>(x), right = static_cast<int>(width - 1 - x);
      const std::size_t at = first + x;
      measure(slice, at, {-1, right, left, pitch_x_um_}, dose, coverage);
      measure(slice, at, {1, left, right, pitch_x_um_}, dose, coverage);
      measure(slice, at, {-stride, rows_below, rows_above, pitch_y_um_}, dose, coverage);
      measure(slice, at, {stride, rows_above, rows_below, pitch_y_um_}, dose, coverage);
    }
  }
}

/// Pixels are counted from the one at hand, 0, outwards; a pixel's middle lies at its number.
void PlaneEdges::measure(int slice, std::size_t at, const Axis& axis, const double* dose,
                         const std::uint8_t* coverage) {
  const auto index = [&](int k) {
    return static_cast<std::size_t>(static_cast<std::ptrdiff_t>(at) + k * axis.step);
  };
  const auto covered = [&](int k) { return coverage[index(k)]; };
  const auto dosed = [&](int k) { return dose[index(k)]; };
  int outside = 1;  // the first pixel of coverage 0
  double edge = 0.5;
  while (outside <= axis.after && covered(outside) != 0) {
    if (covered(outside) == 255 || outside > kMostGreys) return;
    edge += covered(outside) / 255.0;
    ++outside;
  }
  if (outside > axis.after) return;  // what lies beyond isn't known

  // The levels between which the dose passes 1: as far as it rises or falls on.
  const auto passing_after = [&](int k) {
    int high = k, low = k + 1;
    while (high > -axis.before && dosed(high - 1) > dosed(high)) --high;
    while (low < axis.after && dosed(low + 1) < dosed(low)) ++low;
    return k + passing(dosed(k), dosed(k + 1), dosed(high), dosed(low));
  };
  // The pair of pixels between whose middles the edge lies; what prints there ends beside it.
  int k = static_cast<int>(std::floor(edge));
  double print = 0;
  bool closed = false, lost = false, seen = true;
  const bool between = dosed(k) >= 1.0 && dosed(k + 1) < 1.0;
  if (between) {
    print = passing_after(k);
  } else if (dosed(k + 1) >= 1.0) {
    // Outwards, as far as to the next feature.
    const int furthest = std::min(axis.after, outside + reach_);
    int next = outside;
    while (next < furthest && covered(next + 1) == 0 && dosed(next) >= 1.0) ++next;
    ++k;
    while (k < next && dosed(k) >= 1.0) ++k;
    if (dosed(k) < 1.0) {
      print = passing_after(k - 1);
    } else {
      closed = true;
      seen = next < furthest;
      print = next + 0.5;
    }
  } else {
    // Inwards, as far as to the feature's other side.
    const int furthest = -std::min(axis.before, reach_);
    while (k > furthest && (k > 0 || covered(k - 1) == 255) && dosed(k) < 1.0) --k;
    if (dosed(k) >= 1.0) {
      print = passing_after(k);
    } else {
      lost = true;
      seen = k > furthest;
      print = k - 0.5;
    }
  }
  const double um = (print - edge) * axis.pitch_um;
  Prediction& p = figures_;
  if (seen) {
    p.plane_error_um.add(std::abs(um));
    p.plane_signed_nm += std::llround(1000 * um);
  }
  if (seen && um > 0) p.plane_overreach_um = std::max(p.plane_overreach_um, um);
  if (seen && um < 0) p.plane_shortfall_um = std::max(p.plane_shortfall_um, -um);
  if (closed) {
    ++p.plane_closed;
    closed_.add(at, slice);
  }
  if (lost) {
    ++p.plane_lost;
    lost_.add(at, slice);
  }
}

void PlaneEdges::Places::add(std::size_t at, int slice) {
  const auto [entry, is_new] = open_.try_emplace(at, Slices{slice, slice});
  Slices& slices = entry->second;
  if (is_new || slices.first == slice) return;
  if (slices.first != slice + 1) {
    ended_.emplace_back(at, slices);
    slices.last = slice;
  }
  slices.first = slice;
}

void PlaneEdges::Places::add_to(FeatureExamples& examples, const PixelBox& field) const {
  const auto put = [&](std::size_t at, const Slices& slices) {
    const auto width = static_cast<std::size_t>(field.width());
    examples.add({field.x0 + static_cast<int>(at % width), field.y0 + static_cast<int>(at / width),
                  slices.first, slices.last});
  };
  for (const auto& [at, slices] : ended_) put(at, slices);
  for (const auto& [at, slices] : open_) put(at, slices);
}

void PlaneEdges::add_to(Prediction& figures) const {
  figures.merge(figures_);
  closed_.add_to(figures.plane_closed_examples, field_);
  lost_.add_to(figures.plane_lost_examples, field_);
}

}  // namespace slicecorr::detail
