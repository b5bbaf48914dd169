// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tomo/operators/slice_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "tomo/operators/slice_kernels.hpp"

// Products and sums are never fused, so that every instruction set gives the same bits.

HWY_BEFORE_NAMESPACE();
namespace slicecorr::tomo::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// What is compiled for each instruction set has names as Highway's own; offsets stay within tiles and
// images, whose pixels an int counts.
// NOLINTBEGIN(readability-identifier-naming, bugprone-implicit-widening-of-multiplication-result)

// One slice: voxels or pixels in lanes.

constexpr int kGroup = 16;
using Group = hn::CappedTag<float, kGroup>;
constexpr int kGroupWidth = hn::MaxLanes(Group()), kGroupVectors = kGroup / kGroupWidth;
using GroupVec = decltype(hn::Zero(Group()));
using Index = hn::RebindToSigned<Group>;
using IndexVec = decltype(hn::Zero(Index()));

// The whole part of numbers in 0..2^21, given less 0.5, as a number and as an index. Where they are
// whole it may be one less, the rest then is 1: weights don't jump there.
struct Whole {
  GroupVec number;
  IndexVec index;
  HWY_INLINE explicit Whole(GroupVec less_half) {
    const Group d;
    // Beside 1.5 * 2^23 single precision has whole numbers only.
    const GroupVec magic = hn::Set(d, 12582912.0f);
    const GroupVec rounded = hn::Add(less_half, magic);
    number = hn::Sub(rounded, magic);
    index = hn::Sub(hn::BitCast(Index(), rounded), hn::BitCast(Index(), magic));
  }
};

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
#else
  const float* p;
  HWY_INLINE explicit Row32(const float* from) : p(from) {}
  HWY_INLINE GroupVec Pick(IndexVec index) const { return hn::GatherIndex(Group(), p, index); }
#endif
};

constexpr int kRowsAtOnce = kAdjointRows;

// Light of T turns of each angle, with zeros before and behind, on `rows` of voxels.
template <int T>
struct TurnedLight {
  const float* light[T];  // pixel 0
  const float* hit[T];    // same place, or null
};

// Of the pixels that 16 voxels may see, those that the indices name.
template <bool kFine>
struct PixelRow {
  const float* p;
  HWY_INLINE explicit PixelRow(const float* from) : p(from) {}
  HWY_INLINE GroupVec Pick(IndexVec index) const { return Pick16(p, index); }
};
template <>
struct PixelRow<true> {
  Row32 row;
  HWY_INLINE explicit PixelRow(const float* from) : row(from) {}
  HWY_INLINE GroupVec Pick(IndexVec index) const { return row.Pick(index); }
};

// Angles whose lines cross voxels along the lanes by at most 0.71 voxels each: that is up to 0.71
// pixels, or up to 1.42 fine ones. Turns of the slice share places and weights, each has an output
// of its own.
template <int T, bool kFine, bool kAttenuated, bool kShadow>
void AdjointRows(const ParallelBeam& beam, const LaneAngle* angles, const TurnedLight<T>* lights,
                 std::size_t count, int r0, std::size_t stride, float* const out[T]) {
  const Group d;
  const Index di;
  const int n = beam.grid.voxels;
  int first = n, end = 0;
  const int rows = std::min(kRowsAtOnce, n - r0);
  for (int r = r0; r < r0 + rows; ++r) {
    if (beam.inside[r].first < beam.inside[r].end) {
      first = std::min(first, beam.inside[r].first);
      end = std::max(end, beam.inside[r].end);
    }
  }
  for (int x0 = first / kGroup * kGroup; x0 < end; x0 += kGroup) {
    GroupVec acc[kRowsAtOnce][T][kGroupVectors];
    for (auto& row : acc) {
      for (auto& turn : row) {
        for (auto& v : turn) v = hn::Zero(d);
      }
    }
    for (std::size_t m = 0; m < count; ++m) {
      const LaneAngle& angle = angles[m];
      // Where f falls along the lanes, the row of pixels begins earlier.
      const int shift = angle.c < 0 ? (kFine ? 23 : 12) : 0;
      const GroupVec c = hn::Set(d, static_cast<float>(angle.c)), half = hn::Set(d, 0.5f);
      const GroupVec from = hn::Set(d, static_cast<float>(shift));
      GroupVec places[kGroupVectors];
      for (int v = 0; v < kGroupVectors; ++v) {
        const GroupVec k = hn::Iota(d, static_cast<float>(v * kGroupWidth));
        places[v] = hn::Sub(hn::Add(hn::Mul(k, c), from), half);
      }
      double f = angle.f0 + angle.c * x0 + angle.cr * r0 + 65536;  // positive: truncated is floor
#pragma GCC unroll 8
      for (int r = 0; r < kRowsAtOnce; ++r) {
        const int whole = static_cast<int>(f);
        const GroupVec part = hn::Set(d, static_cast<float>(f - whole));
        const std::ptrdiff_t begin = whole - 65536 - shift;
        f += angle.cr;
#pragma GCC unroll 8
        for (int v = 0; v < kGroupVectors; ++v) {
          const GroupVec at = hn::Add(part, places[v]);
          const Whole whole_at(at);
          const IndexVec i = whole_at.index;
          const GroupVec w = hn::Add(hn::Sub(at, whole_at.number), half);
          const IndexVec i1 = hn::Add(i, hn::Set(di, 1));
          GroupVec u, e;
          if constexpr (kShadow) {
            u = hn::Add(hn::LoadU(d, angle.u + x0 + v * kGroupWidth),
                        hn::Set(d, angle.u_rows[std::min(r0 + r, n - 1)]));
          }
          if constexpr (kAttenuated) {
            e = hn::Mul(hn::LoadU(d, angle.e + x0 + v * kGroupWidth),
                        hn::Set(d, angle.e_rows[std::min(r0 + r, n - 1)]));
          }
#pragma GCC unroll 8
          for (int t = 0; t < T; ++t) {
            const PixelRow<kFine> row(lights[m].light[t] + begin);
            GroupVec b0 = row.Pick(i), b1 = row.Pick(i1);
            if constexpr (kShadow) {
              const PixelRow<kFine> hits(lights[m].hit[t] + begin);
              b0 = hn::IfThenElseZero(hn::Lt(u, hits.Pick(i)), b0);
              b1 = hn::IfThenElseZero(hn::Lt(u, hits.Pick(i1)), b1);
            }
            GroupVec value = hn::Add(b0, hn::Mul(w, hn::Sub(b1, b0)));
            if constexpr (kAttenuated) value = hn::Mul(value, e);
            acc[r][t][v] = hn::Add(acc[r][t][v], value);
          }
        }
      }
    }
    for (int r = 0; r < rows; ++r) {
      for (int t = 0; t < T; ++t) {
        for (int v = 0; v < kGroupVectors; ++v) {
          hn::StoreU(acc[r][t][v], d, out[t] + (r0 + r) * stride + x0 + v * kGroupWidth);
        }
      }
    }
  }
}

// The frames of T turns of an angle whose lines cross voxels along the lanes by at least 0.71
// pixels each; the slice is turned instead of the light. Three voxels weigh in on a pixel, on a fine
// one two.
template <int T, bool kFine, bool kAttenuated, bool kShadow>
void ForwardPixels(const ParallelBeam& beam, const LaneAngle& angle, const float* const voxels[T],
                   const float* const hit[T], std::size_t stride, float* const out[T]) {
  const Group d;
  const Index di;
  const int n = beam.grid.voxels, pixels = beam.grid.pixels;
  const double sign = angle.c > 0 ? 1 : -1, size = std::abs(angle.c), inverse = 1 / angle.c;
  const int shift = angle.c < 0 ? 23 : 0;
  const double norm = std::hypot(angle.c, angle.cr), radius = 0.5 * (n - 1) * norm;
  const double centre = 0.5 * (pixels - 1);
  const GroupVec one = hn::Set(d, 1.0f), half_one = hn::Set(d, 0.5f);
  const GroupVec vsize = hn::Set(d, static_cast<float>(size));
  const GroupVec c1 = hn::Set(d, static_cast<float>(size) - 1.0f);
  const GroupVec c2 = hn::Set(d, 2.0f - 2.0f * static_cast<float>(size));
  GroupVec places[kGroupVectors];
  for (int v = 0; v < kGroupVectors; ++v) {
    const GroupVec k = hn::Iota(d, static_cast<float>(v * kGroupWidth));
    places[v] = hn::Add(hn::Mul(k, hn::Set(d, static_cast<float>(inverse))),
                        hn::Set(d, static_cast<float>(shift) - 0.5f));
  }
  for (int j0 = 0; j0 < pixels; j0 += kGroup) {
    GroupVec acc[T][kGroupVectors];
    for (auto& turn : acc) {
      for (auto& v : turn) v = hn::Zero(d);
    }
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
      GroupVec lit_to[T][kGroupVectors];
      for (int t = 0; t < T; ++t) {
        for (int v = 0; v < kGroupVectors; ++v) {
          lit_to[t][v] = kShadow ? hn::LoadU(d, hit[t] + j0 + v * kGroupWidth) : hn::Zero(d);
        }
      }
      for (int r = ra; r <= rb; ++r) {
        const TomoGrid::Range range = beam.inside[r];
        const double base = (j0 - sign - angle.f0 - angle.cr * r) * inverse + 65536;
        const int whole = static_cast<int>(base);
        const int at = whole - 65536 - shift + 1;
        if (at >= range.end || at + 32 <= range.first) continue;
        const GroupVec part = hn::Set(d, static_cast<float>(base - whole));
#pragma GCC unroll 8
        for (int v = 0; v < kGroupVectors; ++v) {
          const GroupVec g = hn::Add(part, places[v]);
          const Whole whole_g(g);
          const IndexVec i = whole_g.index;
          const IndexVec i1 = hn::Add(i, hn::Set(di, 1)), i2 = hn::Add(i, hn::Set(di, 2));
          const GroupVec ahead = hn::Add(hn::Sub(whole_g.number, g), half_one);
          // The first voxel lies so many pixels behind the last place that weighs nothing.
          const GroupVec behind = hn::Mul(ahead, vsize);
          GroupVec w0, w1, w2;
          if constexpr (kFine) {
            w0 = hn::Max(hn::Zero(d), hn::Sub(one, hn::Abs(hn::Sub(behind, one))));
            w1 = hn::Max(hn::Zero(d), hn::Sub(one, hn::Abs(hn::Add(behind, c1))));
          } else {
            w0 = behind;
            w1 = hn::Sub(one, hn::Abs(hn::Add(behind, c1)));
            w2 = hn::Max(hn::Zero(d), hn::Sub(c2, behind));
          }
          if constexpr (kAttenuated) {
            const Row32 e(angle.e + at);
            const GroupVec e_row = hn::Set(d, angle.e_rows[r]);
            w0 = hn::Mul(hn::Mul(w0, e_row), e.Pick(i));
            w1 = hn::Mul(hn::Mul(w1, e_row), e.Pick(i1));
            if constexpr (!kFine) w2 = hn::Mul(hn::Mul(w2, e_row), e.Pick(i2));
          }
          GroupVec u0, u1, u2;
          if constexpr (kShadow) {
            const Row32 us(angle.u + at);
            const GroupVec ur = hn::Set(d, angle.u_rows[r]);
            u0 = hn::Add(us.Pick(i), ur);
            u1 = hn::Add(us.Pick(i1), ur);
            u2 = hn::Add(us.Pick(i2), ur);
          }
#pragma GCC unroll 8
          for (int t = 0; t < T; ++t) {
            const Row32 row(voxels[t] + r * stride + at);
            GroupVec v0 = hn::Mul(w0, row.Pick(i)), v1 = hn::Mul(w1, row.Pick(i1)), v2;
            if constexpr (!kFine) v2 = hn::Mul(w2, row.Pick(i2));
            if constexpr (kShadow) {
              v0 = hn::IfThenElseZero(hn::Lt(u0, lit_to[t][v]), v0);
              v1 = hn::IfThenElseZero(hn::Lt(u1, lit_to[t][v]), v1);
              if constexpr (!kFine) v2 = hn::IfThenElseZero(hn::Lt(u2, lit_to[t][v]), v2);
            }
            GroupVec sum = hn::Add(v0, v1);
            if constexpr (!kFine) sum = hn::Add(sum, v2);
            acc[t][v] = hn::Add(acc[t][v], sum);
          }
        }
      }
    }
    for (int t = 0; t < T; ++t) {
      for (int v = 0; v < kGroupVectors; ++v) {
        const int from = j0 + v * kGroupWidth;
        if (from + kGroupWidth <= pixels) {
          hn::StoreU(acc[t][v], d, out[t] + from);
        } else {
          float part[kGroup];
          hn::StoreU(acc[t][v], d, part);
          for (int k = 0; k < kGroupWidth && from + k < pixels; ++k) out[t][from + k] = part[k];
        }
      }
    }
  }
}

template <int T, bool kFine>
void AdjointTurns(const ParallelBeam& beam, const LaneAngle* angles, const TurnedLight<T>* lights,
                  std::size_t count, bool shadow, int r0, std::size_t stride, float* const out[T]) {
  if (beam.attenuated) {
    shadow ? AdjointRows<T, kFine, true, true>(beam, angles, lights, count, r0, stride, out)
           : AdjointRows<T, kFine, true, false>(beam, angles, lights, count, r0, stride, out);
  } else {
    shadow ? AdjointRows<T, kFine, false, true>(beam, angles, lights, count, r0, stride, out)
           : AdjointRows<T, kFine, false, false>(beam, angles, lights, count, r0, stride, out);
  }
}

template <int T, bool kFine>
void ForwardTurns(const ParallelBeam& beam, const LaneAngle& angle, const float* const voxels[T],
                  const float* const hit[T], std::size_t stride, float* const out[T]) {
  if (beam.attenuated) {
    hit[0] != nullptr ? ForwardPixels<T, kFine, true, true>(beam, angle, voxels, hit, stride, out)
                      : ForwardPixels<T, kFine, true, false>(beam, angle, voxels, hit, stride, out);
  } else {
    hit[0] != nullptr
        ? ForwardPixels<T, kFine, false, true>(beam, angle, voxels, hit, stride, out)
        : ForwardPixels<T, kFine, false, false>(beam, angle, voxels, hit, stride, out);
  }
}

// The rows from r0 on, for all angles of one direction and up to two turns.
void SliceAdjoint(const ParallelBeam& beam, SliceWork& work, bool along_x, int turn, int r0) {
  const std::vector<LaneAngle>& angles = beam.slice->flat.angles[along_x];
  const std::vector<int>& chosen = beam.slice->flat.chosen[along_x];
  const auto base = static_cast<std::size_t>(beam.base_angles());
  const auto hit = [&](std::size_t a) { return work.shadow ? work.hit.row(a) : nullptr; };
  if (beam.turns == 1) {
    static thread_local std::vector<TurnedLight<1>> lights;
    lights.clear();
    for (const int m : chosen) lights.push_back({{work.light.row(m)}, {hit(m)}});
    float* out[1] = {work.out[along_x][0].data()};
    const auto add = beam.slice->fine ? AdjointTurns<1, true> : AdjointTurns<1, false>;
    return add(beam, angles.data(), lights.data(), lights.size(), work.shadow, r0, work.stride,
               out);
  }
  static thread_local std::vector<TurnedLight<2>> lights;
  lights.clear();
  for (const int m : chosen) {
    const std::size_t a = m + turn * base, b = a + base;
    lights.push_back({{work.light.row(a), work.light.row(b)}, {hit(a), hit(b)}});
  }
  float* out[2] = {work.out[along_x][turn].data(), work.out[along_x][turn + 1].data()};
  const auto add = beam.slice->fine ? AdjointTurns<2, true> : AdjointTurns<2, false>;
  add(beam, angles.data(), lights.data(), lights.size(), work.shadow, r0, work.stride, out);
}

void SliceForward(const ParallelBeam& beam, const SliceWork& work, bool along_x, std::size_t k,
                  float* light) {
  const auto m = static_cast<std::size_t>(beam.slice->steep.chosen[along_x][k]);
  const LaneAngle& angle = beam.slice->steep.angles[along_x][k];
  const auto base = static_cast<std::size_t>(beam.base_angles());
  const auto pixels = static_cast<std::size_t>(beam.grid.pixels);
  const auto hit = [&](std::size_t a) { return work.shadow ? work.hit.row(a) : nullptr; };
  const Padded* voxels = work.voxels[along_x];
  if (beam.turns == 1) {
    const float *slices[1] = {voxels[0].row(0)}, *hits[1] = {hit(m)};
    float* out[1] = {light + m * pixels};
    const auto project = beam.slice->fine ? ForwardTurns<1, true> : ForwardTurns<1, false>;
    return project(beam, angle, slices, hits, voxels[0].stride, out);
  }
  for (int t = 0; t < beam.turns; t += 2) {
    const std::size_t a = m + t * base, b = a + base;
    const float *slices[2] = {voxels[t].row(0), voxels[t + 1].row(0)}, *hits[2] = {hit(a), hit(b)};
    float* out[2] = {light + a * pixels, light + b * pixels};
    const auto project = beam.slice->fine ? ForwardTurns<2, true> : ForwardTurns<2, false>;
    project(beam, angle, slices, hits, voxels[t].stride, out);
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

HWY_EXPORT(SliceAdjoint);
HWY_EXPORT(SliceForward);

void slice_adjoint_rows(const ParallelBeam& beam, SliceWork& work, bool along_x, int turn, int r0) {
  HWY_DYNAMIC_DISPATCH(SliceAdjoint)(beam, work, along_x, turn, r0);
}
void slice_forward_angle(const ParallelBeam& beam, const SliceWork& work, bool along_x,
                         std::size_t k, float* light) {
  HWY_DYNAMIC_DISPATCH(SliceForward)(beam, work, along_x, k, light);
}

}  // namespace slicecorr::tomo::detail
#endif
