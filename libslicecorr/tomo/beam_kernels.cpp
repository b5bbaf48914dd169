#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tomo/beam_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "tomo/beam_kernels.hpp"

// Products and sums are never fused, so that every instruction set gives the same bits.

HWY_BEFORE_NAMESPACE();
namespace slicecorr::tomo::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// ---- Slices in lanes ---------------------------------------------------------------------------
// Places and weights are the same for all lanes, so they are worked out once per voxel and angle,
// into small tables, and the lanes follow them.

constexpr int kTileRows = 8, kTileColumns = 16, kTileVoxels = kTileRows * kTileColumns;
constexpr int kBatch = 8;  // angles whose terms a voxel adds while its sum is in registers

struct TileTable {
  int at[kBatch][kTileVoxels];  // first of the two pixels
  float w0[kBatch][kTileVoxels], w1[kBatch][kTileVoxels];
};

void FillTile(const Beam& beam, int first_angle, int angles, int x0, int y0, TileTable& table) {
  const int n = beam.grid.voxels, last = beam.grid.pixels - 2;
  for (int a = 0; a < angles; ++a) {
    const int m = first_angle + a;
    const BeamAngle& angle = beam.angles[m];
    for (int r = 0; r < kTileRows; ++r) {
      // The base in double, what is added to it small: weights are right to 1e-6.
      const double base = angle.f0 + angle.cx * x0 + angle.cy * (y0 + r);
      const double whole = std::floor(base);
      const auto part = static_cast<float>(base - whole);
      const auto step = static_cast<float>(angle.cx);
      const int start = static_cast<int>(whole);
      int* at = table.at[a] + r * kTileColumns;
      float* w0 = table.w0[a] + r * kTileColumns;
      float* w1 = table.w1[a] + r * kTileColumns;
      for (int k = 0; k < kTileColumns; ++k) {
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
        const float* ex = beam.ex.data() + static_cast<std::size_t>(m) * n;
        const float ey = beam.ey[static_cast<std::size_t>(m) * n + std::min(y0 + r, n - 1)];
        for (int k = 0; k < kTileColumns; ++k) {
          const float e = ex[std::min(x0 + k, n - 1)] * ey;
          w0[k] *= e;
          w1[k] *= e;
        }
      }
    }
  }
}

template <int L>
void AdjointLanes(const Beam& beam, const float* hit, const float* light, float* field) {
  const hn::CappedTag<float, L> d;
  constexpr int kWidth = hn::MaxLanes(d), V = L / kWidth;
  using Vec = decltype(hn::Zero(d));
  const int n = beam.grid.voxels, count = static_cast<int>(beam.angles.size());
  const std::size_t frame = static_cast<std::size_t>(beam.grid.pixels) * L;
  std::fill_n(field, beam.grid.voxels_of_block(), 0.0f);
  static thread_local TileTable table;
  for (int y0 = 0; y0 < n; y0 += kTileRows) {
    const int y1 = std::min(y0 + kTileRows, n);
    int first = n, end = 0;
    for (int y = y0; y < y1; ++y) {
      if (beam.inside[y].first < beam.inside[y].end) {
        first = std::min(first, beam.inside[y].first);
        end = std::max(end, beam.inside[y].end);
      }
    }
    for (int x0 = first; x0 < end; x0 += kTileColumns) {
      for (int m0 = 0; m0 < count; m0 += kBatch) {
        const int angles = std::min(kBatch, count - m0);
        FillTile(beam, m0, angles, x0, y0, table);
        const float* batch = light + m0 * frame;
        for (int y = y0; y < y1; ++y) {
          const int xa = std::max(x0, beam.inside[y].first);
          const int xb = std::min(x0 + kTileColumns, beam.inside[y].end);
          for (int x = xa; x < xb; ++x) {
            const int t = (y - y0) * kTileColumns + x - x0;
            float* sum = field + (static_cast<std::size_t>(y) * n + x) * L;
            Vec acc[V];
            for (int v = 0; v < V; ++v) acc[v] = hn::Load(d, sum + v * kWidth);
            for (int a = 0; a < angles; ++a) {
              const std::size_t at = static_cast<std::size_t>(table.at[a][t]) * L;
              const float* p = batch + a * frame + at;
              const Vec w0 = hn::Set(d, table.w0[a][t]), w1 = hn::Set(d, table.w1[a][t]);
              if (hit == nullptr) {
                for (int v = 0; v < V; ++v) {
                  const Vec b0 = hn::Load(d, p + v * kWidth);
                  const Vec b1 = hn::Load(d, p + L + v * kWidth);
                  acc[v] = hn::Add(acc[v], hn::Add(hn::Mul(w0, b0), hn::Mul(w1, b1)));
                }
              } else {
                const std::size_t m = m0 + a;
                const Vec u = hn::Set(d, beam.ux[m * n + x] + beam.uy[m * n + y]);
                const float* h = hit + m * frame + at;
                for (int v = 0; v < V; ++v) {
                  const Vec b0 = hn::IfThenElseZero(hn::Lt(u, hn::Load(d, h + v * kWidth)),
                                                    hn::Load(d, p + v * kWidth));
                  const Vec b1 = hn::IfThenElseZero(hn::Lt(u, hn::Load(d, h + L + v * kWidth)),
                                                    hn::Load(d, p + L + v * kWidth));
                  acc[v] = hn::Add(acc[v], hn::Add(hn::Mul(w0, b0), hn::Mul(w1, b1)));
                }
              }
            }
            for (int v = 0; v < V; ++v) hn::Store(acc[v], d, sum + v * kWidth);
          }
        }
      }
    }
  }
}

constexpr int kBandRows = 16;
constexpr int kMostNeighbours = 64;

// For a pixel and the rows of a band: the first voxel that weighs in, and the weights from there.
struct PixelTable {
  int at[kBandRows];
  float w[kMostNeighbours][kBandRows];
};

template <int L>
void ForwardLanes(const Beam& beam, const float* hit, const float* field, float* light) {
  const hn::CappedTag<float, L> d;
  constexpr int kWidth = hn::MaxLanes(d), V = L / kWidth;
  using Vec = decltype(hn::Zero(d));
  const int n = beam.grid.voxels, pixels = beam.grid.pixels;
  const auto count = beam.angles.size();
  std::fill_n(light, count * pixels * L, 0.0f);
  PixelTable table;
  // Bands of rows along x for steep lines, of columns along y for the others, one band after the
  // other, so that a band stays in the cache for all angles.
  for (const bool along_x : {true, false}) {
    const std::size_t voxel_step = along_x ? L : static_cast<std::size_t>(n) * L;
    const std::size_t row_step = along_x ? static_cast<std::size_t>(n) * L : L;
    for (int r0 = 0; r0 < n; r0 += kBandRows) {
      const int rows = std::min(kBandRows, n - r0);
      int firsts[kBandRows] = {}, ends[kBandRows] = {};
      for (int r = 0; r < rows; ++r) {
        firsts[r] = beam.inside[r0 + r].first;
        ends[r] = beam.inside[r0 + r].end;
      }
      for (std::size_t m = 0; m < count; ++m) {
        const BeamAngle& angle = beam.angles[m];
        if ((std::abs(angle.cx) >= std::abs(angle.cy)) != along_x) continue;
        const double c = along_x ? angle.cx : angle.cy, cr = along_x ? angle.cy : angle.cx;
        const double sign = c > 0 ? 1 : -1, size = std::abs(c);
        const int near = std::min({static_cast<int>(2 / size) + 1, kMostNeighbours, n});
        // The pixels that the band's voxels reach.
        double least = 1e30, most = -1e30;
        for (int r = r0; r < r0 + rows; ++r) {
          if (beam.inside[r].first >= beam.inside[r].end) continue;
          for (const int x : {beam.inside[r].first, beam.inside[r].end - 1}) {
            const double f = angle.f0 + c * x + cr * r;
            least = std::min(least, f);
            most = std::max(most, f);
          }
        }
        const int j0 = static_cast<int>(std::max(0.0, std::floor(least)));
        const int j1 = static_cast<int>(std::min<double>(pixels - 1, std::ceil(most)));
        const float* e_along = nullptr;
        float e_band[kBandRows] = {};
        if (beam.attenuated) {
          e_along = (along_x ? beam.ex : beam.ey).data() + m * n;
          std::copy_n((along_x ? beam.ey : beam.ex).data() + m * n + r0, rows, e_band);
        }
        const auto step = static_cast<float>(-cr / c), fsize = static_cast<float>(size);
        for (int j = j0; j <= j1; ++j) {
          // Voxels x with |f - j| < 1 begin behind g, where f = j - sign.
          const double base = (j - sign - angle.f0 - cr * r0) / c;
          const double whole = std::floor(base);
          const auto part = static_cast<float>(base - whole);
          const int start = static_cast<int>(whole);
          // Loops over all rows of a full band, innermost: they become vector code.
          float e0[kBandRows];
          for (int r = 0; r < kBandRows; ++r) {
            const float g = part + static_cast<float>(r) * step;
            const float below = std::floor(g);
            const int wanted = start + static_cast<int>(below) + 1;
            const int at = std::min(std::max(wanted, 0), n - near);
            table.at[r] = at;
            e0[r] = (below + 1.0f - g + static_cast<float>(at - wanted)) * fsize - 1.0f;
          }
          for (int k = 0; k < near; ++k) {
            const float ahead = static_cast<float>(k) * fsize;
            for (int r = 0; r < kBandRows; ++r) {
              const float w = std::max(0.0f, 1.0f - std::abs(e0[r] + ahead));
              const int x = table.at[r] + k;
              table.w[k][r] = x >= firsts[r] && x < ends[r] ? w : 0.0f;
            }
          }
          if (beam.attenuated) {
            for (int k = 0; k < near; ++k) {
              for (int r = 0; r < kBandRows; ++r) {
                table.w[k][r] *= e_along[table.at[r] + k] * e_band[r];
              }
            }
          }
          float* sum = light + (m * pixels + j) * L;
          Vec acc[V];
          for (int v = 0; v < V; ++v) acc[v] = hn::Load(d, sum + v * kWidth);
          Vec lit_to[V];
          for (Vec& v : lit_to) v = hn::Zero(d);
          if (hit != nullptr) {
            for (int v = 0; v < V; ++v) {
              lit_to[v] = hn::Load(d, hit + (m * pixels + j) * L + v * kWidth);
            }
          }
          const float* band = field + r0 * row_step;
          for (int r = 0; r < rows; ++r) {
            const float* p = band + r * row_step + table.at[r] * voxel_step;
            for (int k = 0; k < near; ++k) {
              const float weight = table.w[k][r];
              const Vec w = hn::Set(d, weight);
              const float* q = p + k * voxel_step;
              if (hit == nullptr) {
                for (int v = 0; v < V; ++v) {
                  acc[v] = hn::Add(acc[v], hn::Mul(w, hn::Load(d, q + v * kWidth)));
                }
              } else {
                const int x = along_x ? table.at[r] + k : r0 + r;
                const int y = along_x ? r0 + r : table.at[r] + k;
                const Vec u = hn::Set(d, beam.ux[m * n + x] + beam.uy[m * n + y]);
                for (int v = 0; v < V; ++v) {
                  const Vec value = hn::Mul(w, hn::Load(d, q + v * kWidth));
                  acc[v] = hn::Add(acc[v], hn::IfThenElseZero(hn::Lt(u, lit_to[v]), value));
                }
              }
            }
          }
          for (int v = 0; v < V; ++v) hn::Store(acc[v], d, sum + v * kWidth);
        }
      }
    }
  }
}

// ---- One slice: voxels or pixels in lanes ------------------------------------------------------

constexpr int kGroup = 16;
using Group = hn::CappedTag<float, kGroup>;
constexpr int kGroupWidth = hn::MaxLanes(Group()), kGroupVectors = kGroup / kGroupWidth;
using GroupVec = decltype(hn::Zero(Group()));
using Index = hn::RebindToSigned<Group>;
using IndexVec = decltype(hn::Zero(Index()));

// Of 16, or of 32, numbers from p on those that the indices name.
HWY_INLINE GroupVec Pick16(const float* p, IndexVec index) {
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
  return GroupVec{_mm512_permutexvar_ps(index.raw, _mm512_loadu_ps(p))};
#else
  return hn::GatherIndex(Group(), p, index);
#endif
}
struct Row32 {
#if HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL
  __m512 low, high;
  HWY_INLINE explicit Row32(const float* p)
      : low(_mm512_loadu_ps(p)), high(_mm512_loadu_ps(p + 16)) {}
  HWY_INLINE GroupVec Pick(IndexVec index) const {
    return GroupVec{_mm512_permutex2var_ps(low, index.raw, high)};
  }
  HWY_INLINE void Scale(const float* by) {
    low = _mm512_mul_ps(low, _mm512_loadu_ps(by));
    high = _mm512_mul_ps(high, _mm512_loadu_ps(by + 16));
  }
#else
  const float* p;
  float scaled[32];
  HWY_INLINE explicit Row32(const float* from) : p(from) {}
  HWY_INLINE GroupVec Pick(IndexVec index) const { return hn::GatherIndex(Group(), p, index); }
  HWY_INLINE void Scale(const float* by) {
    for (int i = 0; i < 32; ++i) scaled[i] = p[i] * by[i];
    p = scaled;
  }
#endif
};

constexpr int kRowsAtOnce = 8;

// Angles whose lines cross voxels along the lanes by at most 0.71 pixels each.
struct LaneAngle {
  double c, cr, f0;         // pixels per voxel along lanes and rows, place of voxel (0, 0)
  const float* light;       // pixel 0, with zeros before and behind
  const float* hit;         // same place, or null
  const float *e, *e_rows;  // attenuation along lanes and rows
  const float *u, *u_rows;
};

template <bool kAttenuated, bool kShadow>
void AdjointRows(const Beam& beam, const std::vector<LaneAngle>& angles, std::size_t stride,
                 float* out) {
  const Group d;
  const Index di;
  const int n = beam.grid.voxels;
  for (int r0 = 0; r0 < n; r0 += kRowsAtOnce) {
    int first = n, end = 0;
    const int rows = std::min(kRowsAtOnce, n - r0);
    for (int r = r0; r < r0 + rows; ++r) {
      if (beam.inside[r].first < beam.inside[r].end) {
        first = std::min(first, beam.inside[r].first);
        end = std::max(end, beam.inside[r].end);
      }
    }
    if (first >= end) continue;
    for (int x0 = first / kGroup * kGroup; x0 < end; x0 += kGroup) {
      GroupVec acc[kRowsAtOnce][kGroupVectors];
      for (auto& row : acc) {
        for (auto& v : row) v = hn::Zero(d);
      }
      for (const LaneAngle& angle : angles) {
        // Where f falls along the lanes, the row of pixels begins 12 earlier.
        const int shift = angle.c < 0 ? 12 : 0;
        const GroupVec c = hn::Set(d, static_cast<float>(angle.c));
        const GroupVec from = hn::Set(d, static_cast<float>(shift));
        GroupVec places[kGroupVectors];
        for (int v = 0; v < kGroupVectors; ++v) {
          const GroupVec k = hn::Iota(d, static_cast<float>(v * kGroupWidth));
          places[v] = hn::Add(hn::Mul(k, c), from);
        }
        double f = angle.f0 + angle.c * x0 + angle.cr * r0 + 65536;  // positive: truncated is floor
#pragma GCC unroll 8
        for (int r = 0; r < kRowsAtOnce; ++r) {
          const int whole = static_cast<int>(f);
          const GroupVec part = hn::Set(d, static_cast<float>(f - whole));
          const float* p = angle.light + (whole - 65536 - shift);
          f += angle.cr;
          for (int v = 0; v < kGroupVectors; ++v) {
            const GroupVec at = hn::Add(part, places[v]);
            const IndexVec i = hn::ConvertTo(di, at);
            const GroupVec w = hn::Sub(at, hn::ConvertTo(d, i));
            const IndexVec i1 = hn::Add(i, hn::Set(di, 1));
            GroupVec b0 = Pick16(p, i), b1 = Pick16(p, i1);
            if constexpr (kShadow) {
              const float* h = angle.hit + (whole - 65536 - shift);
              const GroupVec u = hn::Add(hn::LoadU(d, angle.u + x0 + v * kGroupWidth),
                                         hn::Set(d, angle.u_rows[std::min(r0 + r, n - 1)]));
              b0 = hn::IfThenElseZero(hn::Lt(u, Pick16(h, i)), b0);
              b1 = hn::IfThenElseZero(hn::Lt(u, Pick16(h, i1)), b1);
            }
            GroupVec value = hn::Add(b0, hn::Mul(w, hn::Sub(b1, b0)));
            if constexpr (kAttenuated) {
              const GroupVec e = hn::Mul(hn::LoadU(d, angle.e + x0 + v * kGroupWidth),
                                         hn::Set(d, angle.e_rows[std::min(r0 + r, n - 1)]));
              value = hn::Mul(value, e);
            }
            acc[r][v] = hn::Add(acc[r][v], value);
          }
        }
      }
      for (int r = 0; r < rows; ++r) {
        for (int v = 0; v < kGroupVectors; ++v) {
          hn::StoreU(acc[r][v], d, out + (r0 + r) * stride + x0 + v * kGroupWidth);
        }
      }
    }
  }
}

constexpr int kVoxelPad = 56;

template <bool kAttenuated, bool kShadow>
void ForwardPixels(const Beam& beam, const LaneAngle& angle, const float* voxels,
                   std::size_t stride, float* out) {
  const Group d;
  const Index di;
  const int n = beam.grid.voxels, pixels = beam.grid.pixels;
  const double sign = angle.c > 0 ? 1 : -1, size = std::abs(angle.c), inverse = 1 / angle.c;
  const int shift = angle.c < 0 ? 23 : 0;
  const double norm = std::hypot(angle.c, angle.cr), radius = 0.5 * (n - 1) * norm;
  const double centre = 0.5 * (pixels - 1);
  const GroupVec one = hn::Set(d, 1.0f), vsize = hn::Set(d, static_cast<float>(size));
  const GroupVec c1 = hn::Set(d, static_cast<float>(size) - 1.0f);
  const GroupVec c2 = hn::Set(d, 2.0f - 2.0f * static_cast<float>(size));
  GroupVec places[kGroupVectors];
  for (int v = 0; v < kGroupVectors; ++v) {
    const GroupVec k = hn::Iota(d, static_cast<float>(v * kGroupWidth));
    places[v] = hn::Add(hn::Mul(k, hn::Set(d, static_cast<float>(inverse))),
                        hn::Set(d, static_cast<float>(shift)));
  }
  for (int j0 = 0; j0 < pixels; j0 += kGroup) {
    GroupVec acc[kGroupVectors];
    for (auto& v : acc) v = hn::Zero(d);
    // The rows in which the strip of these pixels crosses the disc; t and u in pixels.
    const double t0 = j0 - 1 - centre, t1 = j0 + kGroup - centre;
    const double nearest = t0 > 0 ? t0 : t1 < 0 ? -t1 : 0;
    if (nearest <= radius) {
      const double half = std::sqrt(radius * radius - nearest * nearest);
      const double across = angle.cr / (norm * norm), along = size / (norm * norm) * half;
      const double middle = 0.5 * (n - 1);
      const double low = middle + std::min(t0 * across, t1 * across) - along;
      const double high = middle + std::max(t0 * across, t1 * across) + along;
      const int ra = static_cast<int>(std::max(0.0, std::floor(low)));
      const int rb = static_cast<int>(std::min<double>(n - 1, std::ceil(high)));
      GroupVec lit_to[kGroupVectors];
      for (auto& v : lit_to) v = hn::Zero(d);
      if constexpr (kShadow) {
        for (int v = 0; v < kGroupVectors; ++v) {
          lit_to[v] = hn::LoadU(d, angle.hit + j0 + v * kGroupWidth);
        }
      }
      for (int r = ra; r <= rb; ++r) {
        const TomoGrid::Range range = beam.inside[r];
        const double base = (j0 - sign - angle.f0 - angle.cr * r) * inverse + 65536;
        const int whole = static_cast<int>(base);
        const int at = whole - 65536 - shift + 1;
        if (at >= range.end || at + 32 <= range.first) continue;
        const GroupVec part = hn::Set(d, static_cast<float>(base - whole));
        Row32 row(voxels + r * stride + at);
        if constexpr (kAttenuated) row.Scale(angle.e + at);
        for (int v = 0; v < kGroupVectors; ++v) {
          const GroupVec g = hn::Add(part, places[v]);
          const IndexVec i = hn::ConvertTo(di, g);
          const IndexVec i1 = hn::Add(i, hn::Set(di, 1)), i2 = hn::Add(i, hn::Set(di, 2));
          const GroupVec ahead = hn::Sub(hn::Add(hn::ConvertTo(d, i), one), g);
          const GroupVec w0 = hn::Mul(ahead, vsize);
          const GroupVec w1 = hn::Sub(one, hn::Abs(hn::Add(w0, c1)));
          const GroupVec w2 = hn::Max(hn::Zero(d), hn::Sub(c2, w0));
          GroupVec v0 = hn::Mul(w0, row.Pick(i)), v1 = hn::Mul(w1, row.Pick(i1)),
                   v2 = hn::Mul(w2, row.Pick(i2));
          if constexpr (kShadow) {
            const Row32 us(angle.u + at);
            const GroupVec ur = hn::Set(d, angle.u_rows[r]);
            v0 = hn::IfThenElseZero(hn::Lt(hn::Add(us.Pick(i), ur), lit_to[v]), v0);
            v1 = hn::IfThenElseZero(hn::Lt(hn::Add(us.Pick(i1), ur), lit_to[v]), v1);
            v2 = hn::IfThenElseZero(hn::Lt(hn::Add(us.Pick(i2), ur), lit_to[v]), v2);
          }
          GroupVec sum = hn::Add(hn::Add(v0, v1), v2);
          if constexpr (kAttenuated) sum = hn::Mul(sum, hn::Set(d, angle.e_rows[r]));
          acc[v] = hn::Add(acc[v], sum);
        }
      }
    }
    for (int v = 0; v < kGroupVectors; ++v) {
      float part[kGroup];
      hn::StoreU(acc[v], d, part);
      const int from = j0 + v * kGroupWidth;
      for (int k = 0; k < kGroupWidth && from + k < pixels; ++k) out[from + k] = part[k];
    }
  }
}

// A table with room before and behind each row, whose numbers are `fill`.
struct Padded {
  std::size_t stride = 0;
  int before = 0;
  Array<float> numbers;

  void Make(const float* from, std::size_t rows, int count, int pad, float fill) {
    before = pad;
    stride = (count + 2 * static_cast<std::size_t>(pad) + 15) / 16 * 16;
    numbers.assign(rows * stride + 32, fill);
    for (std::size_t r = 0; r < rows; ++r) {
      std::copy_n(from + r * count, count, numbers.data() + r * stride + pad);
    }
  }
  const float* Row(std::size_t r) const { return numbers.data() + r * stride + before; }
};

struct SliceWork {
  Padded light, hit, ex, ey, ux, uy, rows, columns;
  Array<float> along, across;
};

LaneAngle MakeLaneAngle(const Beam& beam, const SliceWork& work, std::size_t m, bool along_x) {
  const BeamAngle& a = beam.angles[m];
  LaneAngle angle{};
  angle.c = along_x ? a.cx : a.cy;
  angle.cr = along_x ? a.cy : a.cx;
  angle.f0 = a.f0;
  if (beam.attenuated) {
    angle.e = along_x ? work.ex.Row(m) : work.ey.Row(m);
    angle.e_rows = along_x ? work.ey.Row(m) : work.ex.Row(m);
  }
  if (beam.hit != nullptr) {
    angle.u = along_x ? work.ux.Row(m) : work.uy.Row(m);
    angle.u_rows = along_x ? work.uy.Row(m) : work.ux.Row(m);
  }
  return angle;
}

void MakeTables(const Beam& beam, const float* hit, int pixel_pad, SliceWork& work) {
  const int n = beam.grid.voxels;
  const std::size_t count = beam.angles.size();
  if (beam.attenuated) {
    work.ex.Make(beam.ex.data(), count, n, kVoxelPad, 0);
    work.ey.Make(beam.ey.data(), count, n, kVoxelPad, 0);
  }
  if (hit != nullptr) {
    work.ux.Make(beam.ux.data(), count, n, kVoxelPad, 0);
    work.uy.Make(beam.uy.data(), count, n, kVoxelPad, 0);
    work.hit.Make(hit, count, beam.grid.pixels, pixel_pad, 0);
  }
}

SliceWork& ThreadWork() {
  static thread_local SliceWork work;
  return work;
}

void AdjointSlice(const Beam& beam, const float* hit, const float* light, float* field) {
  SliceWork& work = ThreadWork();
  const int n = beam.grid.voxels, pixels = beam.grid.pixels;
  const std::size_t count = beam.angles.size();
  // Groups reach up to 15 voxels and 7 rows out of the disc.
  const double step = beam.grid.voxel_mm() / beam.grid.pixel_mm;
  const int pad = std::max(0, static_cast<int>(0.5 * (n - 1) * step - 0.5 * (pixels - 1))) + 48;
  work.light.Make(light, count, pixels, pad, 0);
  MakeTables(beam, hit, pad, work);
  const std::size_t stride = (static_cast<std::size_t>(n) + 15) / 16 * 16;
  work.along.assign(stride * n, 0);
  work.across.assign(stride * n, 0);
  std::vector<LaneAngle> angles;
  for (const bool along_x : {true, false}) {
    angles.clear();
    for (std::size_t m = 0; m < count; ++m) {
      if ((std::abs(beam.angles[m].cx) <= std::abs(beam.angles[m].cy)) != along_x) continue;
      angles.push_back(MakeLaneAngle(beam, work, m, along_x));
      angles.back().light = work.light.Row(m);
      if (hit != nullptr) angles.back().hit = work.hit.Row(m);
    }
    float* out = (along_x ? work.along : work.across).data();
    if (beam.attenuated) {
      hit == nullptr ? AdjointRows<true, false>(beam, angles, stride, out)
                     : AdjointRows<true, true>(beam, angles, stride, out);
    } else {
      hit == nullptr ? AdjointRows<false, false>(beam, angles, stride, out)
                     : AdjointRows<false, true>(beam, angles, stride, out);
    }
  }
  std::fill_n(field, static_cast<std::size_t>(n) * n, 0.0f);
  constexpr int kTile = 16;
  for (int y0 = 0; y0 < n; y0 += kTile) {
    for (int x0 = 0; x0 < n; x0 += kTile) {
      for (int y = y0; y < std::min(y0 + kTile, n); ++y) {
        const int xa = std::max(x0, beam.inside[y].first);
        const int xb = std::min(x0 + kTile, beam.inside[y].end);
        for (int x = xa; x < xb; ++x) {
          field[static_cast<std::size_t>(y) * n + x] =
              work.along[y * stride + x] + work.across[x * stride + y];
        }
      }
    }
  }
}

void ForwardSlice(const Beam& beam, const float* hit, const float* field, float* light) {
  SliceWork& work = ThreadWork();
  const int n = beam.grid.voxels, pixels = beam.grid.pixels;
  const std::size_t count = beam.angles.size();
  MakeTables(beam, hit, 48, work);
  // Rows of x, and rows of y, both with 0 outside of the disc.
  Padded& rows = work.rows;
  Padded& columns = work.columns;
  for (Padded* p : {&rows, &columns}) {
    p->before = kVoxelPad;
    p->stride = (n + 2 * static_cast<std::size_t>(kVoxelPad) + 15) / 16 * 16;
    p->numbers.assign(n * p->stride + 32, 0.0f);
  }
  constexpr int kTile = 16;
  for (int y0 = 0; y0 < n; y0 += kTile) {
    for (int x0 = 0; x0 < n; x0 += kTile) {
      for (int y = y0; y < std::min(y0 + kTile, n); ++y) {
        const int xa = std::max(x0, beam.inside[y].first);
        const int xb = std::min(x0 + kTile, beam.inside[y].end);
        for (int x = xa; x < xb; ++x) {
          const float value = field[static_cast<std::size_t>(y) * n + x];
          rows.numbers[y * rows.stride + kVoxelPad + x] = value;
          columns.numbers[x * columns.stride + kVoxelPad + y] = value;
        }
      }
    }
  }
  for (std::size_t m = 0; m < count; ++m) {
    const bool along_x = std::abs(beam.angles[m].cx) >= std::abs(beam.angles[m].cy);
    LaneAngle angle = MakeLaneAngle(beam, work, m, along_x);
    if (hit != nullptr) angle.hit = work.hit.Row(m);
    const Padded& from = along_x ? rows : columns;
    const float* voxels = from.Row(0);
    float* out = light + m * pixels;
    if (beam.attenuated) {
      hit == nullptr ? ForwardPixels<true, false>(beam, angle, voxels, from.stride, out)
                     : ForwardPixels<true, true>(beam, angle, voxels, from.stride, out);
    } else {
      hit == nullptr ? ForwardPixels<false, false>(beam, angle, voxels, from.stride, out)
                     : ForwardPixels<false, true>(beam, angle, voxels, from.stride, out);
    }
  }
}

// The kernels of one slice hold as many pixels or voxels in registers as lines cross when voxels
// and pixels are about as wide; then a voxel is never wider than a pixel.
bool Fits(const Beam& beam) {
  const double step = beam.grid.voxel_mm() / beam.grid.pixel_mm;
  return step >= 0.95 && step <= 1 + 1e-9;
}

void Adjoint(const Beam& beam, const float* hit, const float* light, float* field) {
  switch (beam.grid.lanes()) {
    case 1:
      return Fits(beam) ? AdjointSlice(beam, hit, light, field)
                        : AdjointLanes<1>(beam, hit, light, field);
    case 16:
      return AdjointLanes<16>(beam, hit, light, field);
    default:
      return AdjointLanes<32>(beam, hit, light, field);
  }
}

void Forward(const Beam& beam, const float* hit, const float* field, float* light) {
  switch (beam.grid.lanes()) {
    case 1:
      return Fits(beam) ? ForwardSlice(beam, hit, field, light)
                        : ForwardLanes<1>(beam, hit, field, light);
    case 16:
      return ForwardLanes<16>(beam, hit, field, light);
    default:
      return ForwardLanes<32>(beam, hit, field, light);
  }
}

}  // namespace
// NOLINTNEXTLINE(google-readability-namespace-comments)
}  // namespace HWY_NAMESPACE
}  // namespace slicecorr::tomo::detail
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slicecorr::tomo::detail {

HWY_EXPORT(Adjoint);
HWY_EXPORT(Forward);

void beam_adjoint(const Beam& beam, const float* hit, const float* light, float* field) {
  HWY_DYNAMIC_DISPATCH(Adjoint)(beam, hit, light, field);
}
void beam_forward(const Beam& beam, const float* hit, const float* field, float* light) {
  HWY_DYNAMIC_DISPATCH(Forward)(beam, hit, field, light);
}

}  // namespace slicecorr::tomo::detail
#endif
