// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tomo/operators/lane_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tomo/operators/beam_kernels.hpp"

// Products and sums are never fused, so that every instruction set gives the same bits.

HWY_BEFORE_NAMESPACE();
namespace slicecorr::tomo::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// What is compiled for each instruction set has names as Highway's own; offsets stay within tiles and
// images, whose pixels an int counts.
// NOLINTBEGIN(readability-identifier-naming, bugprone-implicit-widening-of-multiplication-result)

// Slices in lanes: places and weights are the same for all, so they are worked out once per voxel
// and angle, into small tables, and the lanes follow them; so do the turns of the slice by 90
// degrees, where the angles have them.

constexpr int kColumns = 16, kRows = kAdjointRows;  // of a tile
constexpr int kTileVoxels = kColumns * kRows;
constexpr int kBatch = 4;  // angles whose terms a voxel adds while its sum is in registers

/// A tile in coordinates of its own: voxel (k, r) is (x0, y0) + k (xk, yk) + r (xr, yr) of a grid.
struct Tile {
  int x0, y0, xk, yk, xr, yr;
  int x(int k, int r) const { return x0 + k * xk + r * xr; }
  int y(int k, int r) const { return y0 + k * yk + r * yr; }
  /// Turned by 90 degrees: voxel (x, y) of a grid goes to (n-1-y, x).
  Tile turned(int n) const { return {n - 1 - y0, x0, -yk, xk, -yr, xr}; }
  std::ptrdiff_t origin(int n) const { return static_cast<std::ptrdiff_t>(y0) * n + x0; }
  std::ptrdiff_t along(int n) const { return static_cast<std::ptrdiff_t>(yk) * n + xk; }
  std::ptrdiff_t across(int n) const { return static_cast<std::ptrdiff_t>(yr) * n + xr; }
};

struct TileTable {
  int at[kTileVoxels];  // first of the two pixels
  float w0[kTileVoxels], w1[kTileVoxels];
  float u[kTileVoxels];  // with a shadow
};

void Fill(const ParallelBeam& beam, int m, const Tile& tile, int columns, int rows,
          TileTable& table) {
  const int n = beam.grid.voxels, last = beam.grid.pixels - 2;
  const BeamAngle& angle = beam.angles[m];
  const auto step = static_cast<float>(angle.cx * tile.xk + angle.cy * tile.yk);
  const float* ex = nullptr;
  const float* ey = nullptr;
  if (beam.attenuated) {
    ex = beam.ex.data() + static_cast<std::size_t>(m) * n;
    ey = beam.ey.data() + static_cast<std::size_t>(m) * n;
  }
  for (int r = 0; r < rows; ++r) {
    // The base in double, what is added to it small: weights are right to 1e-6.
    const double base = angle.f0 + angle.cx * tile.x(0, r) + angle.cy * tile.y(0, r);
    const double whole = std::floor(base);
    const auto part = static_cast<float>(base - whole);
    const int start = static_cast<int>(whole);
    int* at = table.at + r * kColumns;
    float* w0 = table.w0 + r * kColumns;
    float* w1 = table.w1 + r * kColumns;
    for (int k = 0; k < kColumns; ++k) {
      const float f = part + static_cast<float>(k) * step;
      const float below = std::floor(f);
      const float w = f - below;
      const int i = start + static_cast<int>(below);
      // At the ends of the detector one of the two pixels is missing, beyond them both.
      const float in0 = i >= 0 && i <= last + 1 ? 1.0f - w : 0.0f;
      const float in1 = i >= -1 && i <= last ? w : 0.0f;
      w0[k] = i == -1 ? in1 : i == last + 1 ? 0.0f : in0;
      w1[k] = i == -1 ? 0.0f : i == last + 1 ? in0 : in1;
      at[k] = std::min(std::max(i, 0), last);
    }
    if (beam.attenuated) {
      // Along a row one of the two is the same.
      const bool along_x = tile.xk != 0;
      const float* e = along_x ? ex + tile.x0 + r * tile.xr : ey + tile.y0 + r * tile.yr;
      const float row = along_x ? ey[tile.y(0, r)] : ex[tile.x(0, r)];
      const int sign = along_x ? tile.xk : tile.yk;
      for (int k = 0; k < columns; ++k) {
        const float both = e[k * sign] * row;
        w0[k] *= both;
        w1[k] *= both;
      }
    }
    if (beam.shadow) {
      const std::size_t from = static_cast<std::size_t>(m) * n;
      for (int k = 0; k < columns; ++k) {
        table.u[r * kColumns + k] = beam.ux[from + tile.x(k, r)] + beam.uy[from + tile.y(k, r)];
      }
    }
  }
}

/// Light of `b` at the two pixels of a table's entry, weighted and summed.
template <class D, class V>
HWY_INLINE V Lit(D d, const float* p, const float* h, std::size_t next, V w0, V w1, V u) {
  V b0 = hn::Load(d, p), b1 = hn::Load(d, p + next);
  if (h != nullptr) {
    b0 = hn::IfThenElseZero(hn::Lt(u, hn::Load(d, h)), b0);
    b1 = hn::IfThenElseZero(hn::Lt(u, hn::Load(d, h + next)), b1);
  }
  return hn::Add(hn::Mul(w0, b0), hn::Mul(w1, b1));
}

/// Adds to a tile's voxels what `angles` tables and T turns from `turn` on give.
template <int L, int T, bool kShadow>
void AddTile(const TileTable* tables, int angles, const float* const light[T],
             const float* const hit[T], std::size_t frame, const Tile* seen, int n,
             const int (*ranges)[2], int rows, float* field) {
  const hn::CappedTag<float, L> d;
  constexpr int kWidth = hn::MaxLanes(d), V = L / kWidth;
  using Vec = decltype(hn::Zero(d));
  for (int r = 0; r < rows; ++r) {
    float* sums[T];
    std::ptrdiff_t step[T];
    for (int t = 0; t < T; ++t) {
      sums[t] = field + (seen[t].origin(n) + r * seen[t].across(n)) * L;
      step[t] = seen[t].along(n) * L;
    }
    for (int k = ranges[r][0]; k < ranges[r][1]; ++k) {
      const int entry = r * kColumns + k;
      Vec acc[T][V];
      for (int t = 0; t < T; ++t) {
        for (int v = 0; v < V; ++v) acc[t][v] = hn::Load(d, sums[t] + k * step[t] + v * kWidth);
      }
      for (int a = 0; a < angles; ++a) {
        const TileTable& table = tables[a];
        const std::size_t at = a * frame + static_cast<std::size_t>(table.at[entry]) * L;
        const Vec w0 = hn::Set(d, table.w0[entry]), w1 = hn::Set(d, table.w1[entry]);
        const Vec u = kShadow ? hn::Set(d, table.u[entry]) : hn::Zero(d);
        for (int t = 0; t < T; ++t) {
          const float* p = light[t] + at;
          const float* h = kShadow ? hit[t] + at : nullptr;
          for (int v = 0; v < V; ++v) {
            acc[t][v] = hn::Add(acc[t][v], Lit(d, p + v * kWidth,
                                               kShadow ? h + v * kWidth : nullptr, L, w0, w1, u));
          }
        }
      }
      for (int t = 0; t < T; ++t) {
        for (int v = 0; v < V; ++v) hn::Store(acc[t][v], d, sums[t] + k * step[t] + v * kWidth);
      }
    }
  }
}

template <int L, int T>
void AddTurns(const ParallelBeam& beam, const TileTable* tables, int angles, int m0, int turn,
              const float* hit, const float* light, const Tile* seen, const int (*ranges)[2],
              int rows, float* field) {
  const int n = beam.grid.voxels;
  const std::size_t frame = static_cast<std::size_t>(beam.grid.pixels) * L;
  const float *lights[T], *hits[T];
  for (int t = 0; t < T; ++t) {
    const std::size_t first = m0 + static_cast<std::size_t>(turn + t) * beam.base_angles();
    lights[t] = light + first * frame;
    hits[t] = hit == nullptr ? nullptr : hit + first * frame;
  }
  if (hit == nullptr) {
    AddTile<L, T, false>(tables, angles, lights, hits, frame, seen, n, ranges, rows, field);
  } else {
    AddTile<L, T, true>(tables, angles, lights, hits, frame, seen, n, ranges, rows, field);
  }
}

/// A tile and the tiles that it is turned to share nothing with others: all of their light, for
/// `piece` of the rows of tiles of a quarter of the slice.
template <int L>
void AdjointTiles(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                  std::size_t piece) {
  const int n = beam.grid.voxels, base = beam.base_angles();
  const bool quarters = beam.turns > 1;
  // A quarter of the slice: turned by 90 degrees it makes up the others. Where N is odd the axis'
  // own voxel is in none, and is turned to itself.
  const int wide = quarters ? (n + 1) / 2 : n, high = quarters ? n / 2 : n;
  static thread_local TileTable tables[kBatch];
  const auto all_light = [&](const Tile& tile, const int(*ranges)[2], int rows, int orbit) {
    Tile seen[4 + 4];
    seen[0] = tile;
    for (int i = 1; i < 8; ++i) seen[i] = seen[i - 1].turned(n);
    int columns = 0;
    for (int r = 0; r < rows; ++r) columns = std::max(columns, ranges[r][1]);
    for (int m0 = 0; m0 < base; m0 += kBatch) {
      const int angles = std::min(kBatch, base - m0);
      for (int i = 0; i < orbit; ++i) {
        for (int a = 0; a < angles; ++a) Fill(beam, m0 + a, seen[i], columns, rows, tables[a]);
        // Turned by i, and lit i + turn turns later.
        if (beam.turns == 1) {
          AddTurns<L, 1>(beam, tables, angles, m0, 0, hit, light, seen, ranges, rows, field);
        } else if (orbit == 1) {
          for (int t = 0; t < beam.turns; ++t) {
            AddTurns<L, 1>(beam, tables, angles, m0, t, hit, light, seen + t, ranges, rows, field);
          }
        } else {
          for (int t = 0; t < beam.turns; t += 2) {
            AddTurns<L, 2>(beam, tables, angles, m0, t, hit, light, seen + i + t, ranges, rows,
                           field);
          }
        }
      }
    }
  };
  const int y0 = static_cast<int>(piece) * kRows;
  if (y0 >= high) {
    const int alone[kRows][2] = {{0, 1}};
    all_light({n / 2, n / 2, 1, 0, 0, 1}, alone, 1, 1);
    return;
  }
  const int rows = std::min(kRows, high - y0);
  int first = wide, end = 0;
  for (int y = y0; y < y0 + rows; ++y) {
    if (beam.inside[y].first >= beam.inside[y].end) continue;
    first = std::min(first, beam.inside[y].first);
    end = std::max(end, std::min(beam.inside[y].end, wide));
  }
  for (int x0 = first; x0 < end; x0 += kColumns) {
    int ranges[kRows][2];
    for (int r = 0; r < rows; ++r) {
      const TomoGrid::Range row = beam.inside[y0 + r];
      ranges[r][0] = std::max(row.first - x0, 0);
      ranges[r][1] = std::max(std::min({row.end - x0, kColumns, wide - x0}), ranges[r][0]);
    }
    all_light({x0, y0, 1, 0, 0, 1}, ranges, rows, quarters ? 4 : 1);
  }
}

/// Rays of one angle through a tile, row by row. Pixels that neighbours share are summed in
/// registers; `tile` runs so that pixels rise.
template <int L, bool kShadow>
void ScatterTile(const TileTable& table, const float* hit, const float* field, const Tile& seen,
                 int n, const int (*ranges)[2], int rows, float* light) {
  const hn::CappedTag<float, L> d;
  constexpr int kWidth = hn::MaxLanes(d), V = L / kWidth;
  using Vec = decltype(hn::Zero(d));
  const std::ptrdiff_t step = seen.along(n) * L;
  const auto add_to = [&](int pixel, const Vec* acc) {
    float* p = light + static_cast<std::size_t>(pixel) * L;
    for (int v = 0; v < V; ++v) {
      hn::Store(hn::Add(hn::Load(d, p + v * kWidth), acc[v]), d, p + v * kWidth);
    }
  };
  for (int r = 0; r < rows; ++r) {
    const int k0 = ranges[r][0], k1 = ranges[r][1];
    if (k0 >= k1) continue;
    const int* at = table.at + r * kColumns;
    const float* w0s = table.w0 + r * kColumns;
    const float* w1s = table.w1 + r * kColumns;
    const float* p = field + (seen.origin(n) + r * seen.across(n)) * L;
    Vec low[V], high[V];
    for (int v = 0; v < V; ++v) low[v] = high[v] = hn::Zero(d);
    int pixel = at[k0];
    for (int k = k0; k < k1; ++k) {
      const int i = at[k];
      if (i != pixel) {
        add_to(pixel, low);
        if (i == pixel + 1) {
          for (int v = 0; v < V; ++v) low[v] = high[v];
        } else {
          add_to(pixel + 1, high);
          for (int v = 0; v < V; ++v) low[v] = hn::Zero(d);
        }
        for (int v = 0; v < V; ++v) high[v] = hn::Zero(d);
        pixel = i;
      }
      const Vec w0 = hn::Set(d, w0s[k]), w1 = hn::Set(d, w1s[k]);
      const float* q = p + k * step;
      if constexpr (kShadow) {
        const Vec u = hn::Set(d, table.u[r * kColumns + k]);
        const float* h = hit + static_cast<std::size_t>(i) * L;
        for (int v = 0; v < V; ++v) {
          const Vec value = hn::Load(d, q + v * kWidth);
          const Vec to0 = hn::Mul(w0, value), to1 = hn::Mul(w1, value);
          low[v] = hn::Add(low[v], hn::IfThenElseZero(hn::Lt(u, hn::Load(d, h + v * kWidth)), to0));
          high[v] =
              hn::Add(high[v], hn::IfThenElseZero(hn::Lt(u, hn::Load(d, h + L + v * kWidth)), to1));
        }
      } else {
        for (int v = 0; v < V; ++v) {
          const Vec value = hn::Load(d, q + v * kWidth);
          low[v] = hn::Add(low[v], hn::Mul(w0, value));
          high[v] = hn::Add(high[v], hn::Mul(w1, value));
        }
      }
    }
    add_to(pixel, low);
    add_to(pixel + 1, high);
  }
}

/// All voxels' light on the frames of `piece` of the angles, and of these turned.
template <int L>
void ForwardAngles(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                   std::size_t piece) {
  const int n = beam.grid.voxels, base = beam.base_angles();
  const std::size_t frame = static_cast<std::size_t>(beam.grid.pixels) * L;
  const int m0 = static_cast<int>(piece) * kForwardAngles;
  const int m1 = std::min(m0 + kForwardAngles, base);
  for (int t = 0; t < beam.turns; ++t) {
    std::fill_n(light + (m0 + static_cast<std::size_t>(t) * base) * frame, (m1 - m0) * frame, 0.0f);
  }
  static thread_local TileTable tables[kForwardAngles];
  // Along the axis that lines cross in the smaller steps, towards rising pixels.
  for (int way = 0; way < 4; ++way) {
    const bool along_x = way < 2, falls = way % 2 == 1;
    int chosen[kForwardAngles], count = 0;
    for (int m = m0; m < m1; ++m) {
      const BeamAngle& a = beam.angles[m];
      const double c = along_x ? a.cx : a.cy;
      if ((std::abs(a.cx) <= std::abs(a.cy)) == along_x && (c < 0) == falls) chosen[count++] = m;
    }
    if (count == 0) continue;
    for (int r0 = 0; r0 < n; r0 += kRows) {
      const int rows = std::min(kRows, n - r0);
      int first = n, end = 0;
      for (int r = r0; r < r0 + rows; ++r) {
        if (beam.inside[r].first >= beam.inside[r].end) continue;
        first = std::min(first, beam.inside[r].first);
        end = std::max(end, beam.inside[r].end);
      }
      for (int k0 = first; k0 < end; k0 += kColumns) {
        const int columns = std::min(kColumns, end - k0);
        int ranges[kRows][2];
        for (int r = 0; r < rows; ++r) {
          const TomoGrid::Range row = beam.inside[r0 + r];
          // The disc is its own mirror image.
          ranges[r][0] = std::max(row.first - k0, 0);
          ranges[r][1] = std::max(std::min(row.end - k0, columns), ranges[r][0]);
        }
        const int at = falls ? n - 1 - k0 : k0, sign = falls ? -1 : 1;
        Tile seen = along_x ? Tile{at, r0, sign, 0, 0, 1} : Tile{r0, at, 0, sign, 1, 0};
        for (int c = 0; c < count; ++c) Fill(beam, chosen[c], seen, columns, rows, tables[c]);
        for (int t = 0; t < beam.turns; ++t) {
          for (int c = 0; c < count; ++c) {
            const std::size_t m = chosen[c] + static_cast<std::size_t>(t) * base;
            if (hit == nullptr) {
              ScatterTile<L, false>(tables[c], nullptr, field, seen, n, ranges, rows,
                                    light + m * frame);
            } else {
              ScatterTile<L, true>(tables[c], hit + m * frame, field, seen, n, ranges, rows,
                                   light + m * frame);
            }
          }
          seen = seen.turned(n);
        }
      }
    }
  }
}

void LaneAdjoint(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                 std::size_t piece) {
  switch (beam.grid.lanes()) {
    case 16:
      return AdjointTiles<16>(beam, hit, light, field, piece);
    default:
      return AdjointTiles<32>(beam, hit, light, field, piece);
  }
}

void LaneForward(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                 std::size_t piece) {
  switch (beam.grid.lanes()) {
    case 16:
      return ForwardAngles<16>(beam, hit, field, light, piece);
    default:
      return ForwardAngles<32>(beam, hit, field, light, piece);
  }
}

}  // namespace
// NOLINTNEXTLINE(google-readability-namespace-comments)
}  // namespace HWY_NAMESPACE
}  // namespace slicecorr::tomo::detail
HWY_AFTER_NAMESPACE();
// NOLINTEND(readability-identifier-naming, bugprone-implicit-widening-of-multiplication-result)

#if HWY_ONCE
namespace slicecorr::tomo::detail {

HWY_EXPORT(LaneAdjoint);
HWY_EXPORT(LaneForward);

void lane_adjoint(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                  const ExecutionContext& context) {
  std::fill_n(field, beam.grid.voxels_of_block(), 0.0f);
  const int n = beam.grid.voxels;
  // With turns, rows of tiles of a quarter, and of an odd slice the voxel on the axis.
  const int high = beam.turns > 1 ? n / 2 : n;
  const int pieces = (high + kAdjointRows - 1) / kAdjointRows + (beam.turns > 1 ? n % 2 : 0);
  parallel_for(context, "", static_cast<std::size_t>(pieces), [&](std::size_t piece) {
    HWY_DYNAMIC_DISPATCH(LaneAdjoint)(beam, hit, light, field, piece);
  });
}

void lane_forward(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                  const ExecutionContext& context) {
  const int pieces = (beam.base_angles() + kForwardAngles - 1) / kForwardAngles;
  parallel_for(context, "", static_cast<std::size_t>(pieces), [&](std::size_t piece) {
    HWY_DYNAMIC_DISPATCH(LaneForward)(beam, hit, field, light, piece);
  });
}

}  // namespace slicecorr::tomo::detail
#endif
