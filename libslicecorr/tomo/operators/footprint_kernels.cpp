// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/footprint_kernels.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/kernels.hpp"
#include "tomo/operators/footprint.hpp"
#include "tomo/operators/ray_map.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Pixels that something `wide` pixels wide may meet.
int taps_for(float wide, int most) {
  return std::clamp(static_cast<int>(std::ceil(wide + 3 * kLeastBox)) + 1, 2, most);
}

/// Shares of `taps` pixels from first[z] on, around place[z]. The first edge has C 0, the last 1.
SLICECORR_CLONES
void share_out(const float* place, int n, const Boxes<float>& wide, int taps, int* first,
               float* shares) {
  const Boxes<float> boxes = wide;
  const float reach = 0.5f * static_cast<float>(taps - 1);
  float* const last = shares + static_cast<std::size_t>(taps - 1) * n;
  for (int z = 0; z < n; ++z) {
    first[z] = static_cast<int>(std::floor(place[z] - reach + 0.5f));
    last[z] = 0;
  }
  for (int tap = 0; tap + 1 < taps; ++tap) {
    float* const to = shares + static_cast<std::size_t>(tap) * n;
    for (int z = 0; z < n; ++z) {
      const float edge =
          std::floor(place[z] - reach + 0.5f) + (static_cast<float>(tap) + 0.5f) - place[z];
      const float up_to = boxes.below(edge);
      to[z] = up_to - last[z];
      last[z] = up_to;
    }
  }
  for (int z = 0; z < n; ++z) last[z] = 1 - last[z];
}

/// The same of pixels that are lit in their middles alone, so wide.
SLICECORR_CLONES
void share_out_lit(const float* place, int n, const Boxes<float>& wide, float lit, int taps,
                   int* first, float* shares) {
  const Boxes<float> boxes = wide;
  const float reach = 0.5f * static_cast<float>(taps - 1), half = lit / 2, by_lit = 1 / lit;
  for (int tap = 0; tap < taps; ++tap) {
    float* const to = shares + static_cast<std::size_t>(tap) * n;
    for (int z = 0; z < n; ++z) {
      const float low = std::floor(place[z] - reach + 0.5f);
      const float middle = low + static_cast<float>(tap) - place[z];
      first[z] = static_cast<int>(low);
      to[z] = (boxes.below(middle + half) - boxes.below(middle - half)) * by_lit;
    }
  }
}

/// Rows' shares take the light with them; pixels beside the image are kept next to it.
SLICECORR_CLONES
void finish(Footprints& out, const VoxelColumn& v, int most_across, int most_up) {
  const int n = v.slices;
  const float* const light = out.parts.data() + 2 * static_cast<std::size_t>(n);
  for (int tap = 0; tap < out.up; ++tap) {
    float* const to = out.row_shares.data() + static_cast<std::size_t>(tap) * n;
    for (int z = 0; z < n; ++z) to[z] *= light[z];
  }
  int* const column = out.first_column.data();
  int* const row = out.first_row.data();
  for (int z = 0; z < n; ++z) {
    column[z] = std::min(std::max(column[z], -most_across), v.columns);
    row[z] = std::min(std::max(row[z], -most_up), v.rows);
  }
}

}  // namespace

SLICECORR_CLONES
void places_of(const VoxelColumn& v, float* parts) {
  float* to = parts;
  for (const int p : {RayMapPart::column, RayMapPart::row, RayMapPart::light}) {
    const float* const from =
        v.parts + static_cast<std::ptrdiff_t>(p) * static_cast<std::ptrdiff_t>(v.heights);
    for (int z = 0; z < v.slices; ++z) {
      const float low = from[v.height[z]], high = from[v.height[z] + 1];
      to[z] = low + v.above[z] * (high - low);
    }
    to += v.slices;
  }
}

void make_footprints(const VoxelColumn& v, int most_across, int most_up, Footprints& out) {
  const auto n = static_cast<std::size_t>(v.slices);
  out.parts.resize(3 * n);
  places_of(v, out.parts.data());
  // How wide voxels are in pixels hardly changes along z: as in the middle.
  const auto middle = [&](int part) {
    const float* const of =
        v.parts + static_cast<std::ptrdiff_t>(part) * static_cast<std::ptrdiff_t>(v.heights);
    return 0.5F * (of[(v.heights - 1) / 2] + of[v.heights / 2]);
  };
  const float along = middle(RayMapPart::along), up = middle(RayMapPart::up),
              slope = std::abs(middle(RayMapPart::slope));
  const float third = std::hypot(along * v.turn_mm, v.soft_across);
  const Boxes<float> wide(along * v.one_mm, along * v.other_mm, third);
  const Boxes<float> high(up * v.height_mm, up * slope * v.side_mm, v.soft_up);
  out.across = taps_for(along * (v.one_mm + v.other_mm) + third, most_across);
  out.up = taps_for(up * (v.height_mm + slope * v.side_mm) + v.soft_up, most_up);
  out.first_column.resize(n);
  out.first_row.resize(n);
  out.column_shares.resize(n * static_cast<std::size_t>(out.across));
  out.row_shares.resize(n * static_cast<std::size_t>(out.up));
  const auto share = [&](const float* place, const Boxes<float>& boxes, float lit, int taps,
                         std::vector<int>& first, Array<float>& shares) {
    if (lit < 1) {
      share_out_lit(place, v.slices, boxes, lit, taps, first.data(), shares.data());
    } else {
      share_out(place, v.slices, boxes, taps, first.data(), shares.data());
    }
  };
  share(out.parts.data(), wide, v.lit_across, out.across, out.first_column, out.column_shares);
  share(out.parts.data() + n, high, v.lit_up, out.up, out.first_row, out.row_shares);
  finish(out, v, most_across, most_up);
}

SLICECORR_CLONES
void gather_footprints(const Footprints& f, int slices, int stride, const float* light,
                       float* field) {
  const int* const column = f.first_column.data();
  const int* const row = f.first_row.data();
  for (int i = 0; i < f.across; ++i) {
    const float* const a = f.column_shares.data() + static_cast<std::size_t>(i) * slices;
    for (int j = 0; j < f.up; ++j) {
      const float* const b = f.row_shares.data() + static_cast<std::size_t>(j) * slices;
      for (int z = 0; z < slices; ++z) {
        field[z] += a[z] * b[z] * light[(column[z] + i) * stride + row[z] + j];
      }
    }
  }
}

void scatter_footprints(const Footprints& f, int slices, int stride, const float* field,
                        float* light) {
  for (int z = 0; z < slices; ++z) {
    const float value = field[z];
    if (value == 0) continue;
    for (int i = 0; i < f.across; ++i) {
      const float a = f.column_shares[static_cast<std::size_t>(i) * slices + z] * value;
      float* const to =
          light + static_cast<std::ptrdiff_t>(f.first_column[z] + i) * stride + f.first_row[z];
      for (int j = 0; j < f.up; ++j) {
        to[j] += a * f.row_shares[static_cast<std::size_t>(j) * slices + z];
      }
    }
  }
}

SLICECORR_CLONES
void frame_shares(const float* at, int rows, float one, float other, int first, int count,
                  float* to) {
  const float a = std::max(one, other), b = std::max(std::min(one, other), 1e-4f * a);
  const float s = (a + b) / 2, d = (a - b) / 2;
  float* const last = to + static_cast<std::size_t>(count - 1) * rows;
  for (int r = 0; r < rows; ++r) last[r] = 0;
  for (int k = 0; k + 1 < count; ++k) {
    float* const share = to + static_cast<std::size_t>(k) * rows;
    for (int r = 0; r < rows; ++r) {
      const float x = static_cast<float>(first + k) + 0.5f - at[r], y = std::abs(x);
      const float lacks = std::max(s - y, 0.0f);
      const float half = y <= d ? y / a : 0.5f - lacks * lacks / (2 * a * b);
      const float up_to = x < 0 ? 0.5f - half : 0.5f + half;
      share[r] = up_to - last[r];
      last[r] = up_to;
    }
  }
  for (int r = 0; r < rows; ++r) last[r] = 1 - last[r];
}

SLICECORR_CLONES
void add_shares(const float* share, const float* from, int count, float* to) {
  for (int i = 0; i < count; ++i) to[i] += share[i] * from[i];
}

}  // namespace slicecorr::tomo::detail
