// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tomo/operators/ray_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "tomo/operators/ray_kernels.hpp"

// Products and sums are never fused, and sums have a fixed order, so that every instruction set
// gives the same bits.

HWY_BEFORE_NAMESPACE();
namespace slicecorr::tomo::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// What is compiled for each instruction set has names as Highway's own; offsets stay within tiles and
// images, whose pixels an int counts.
// NOLINTBEGIN(readability-identifier-naming, bugprone-implicit-widening-of-multiplication-result)

// Eight crossings at once, each in two neighbouring lanes: its lower and its upper slice, which lie
// side by side in memory.
constexpr int kCrossings = 8, kLanes = 2 * kCrossings;

using D = hn::CappedTag<float, kLanes>;
using DI = hn::RebindToSigned<D>;

/// A ray at one angle, from plane to plane: crossing j lies in plane k0 + j of the major axis,
/// counted along the ray, at a + b j of the minor one, and at slice az + bz j.
struct Line {
  float a, b, az, bz;
  float light, fade;            ///< weight of crossing 0, and of each over the one before
  int first, end;               ///< crossings that come near slices [low, high]
  std::ptrdiff_t origin;        ///< of crossing 0 in the field, at 0 of the minor axis
  std::ptrdiff_t major, minor;  ///< from crossing to crossing, and from voxel to voxel beside it
};

/// e^-x. Short steps need no more than a few terms.
float Dimmed(float x) {
  if (x > 0.25f) return std::exp(-x);
  const float y = -x;
  return 1 + y * (1 + y * (0.5f + y * (1.0f / 6 + y * (1.0f / 24 + y * (1.0f / 120)))));
}

Line LineOf(const RayWalk& walk, const WalkRay& ray, double cosine, double sine, float low,
            float high) {
  const int n = walk.grid.voxels;
  const std::ptrdiff_t lanes = walk.grid.lanes(), row = lanes * n;
  const auto c0 = static_cast<float>(cosine), s0 = static_cast<float>(sine);
  const float c = c0 * ray.cos_turn - s0 * ray.sin_turn;
  const float s = s0 * ray.cos_turn + c0 * ray.sin_turn;
  const bool along_y = std::abs(c) >= std::abs(s);
  const float middle = 0.5f * static_cast<float>(n - 1);
  // The major axis runs as major_0 + u g, the minor one as minor_0 + u h.
  const float g = along_y ? c : -s, h = along_y ? -s : c;
  const float major_0 = middle + ray.t * (along_y ? s : c);
  const float minor_0 = middle + ray.t * (along_y ? c : s);
  const float du = 1 / std::abs(g), sign = g > 0 ? 1.0f : -1.0f;
  // Planes from where the ray comes in to where it leaves, within the grid.
  const float in = sign * (major_0 - ray.half * g), out = sign * (major_0 + ray.half * g);
  const float lowest = sign > 0 ? 0 : static_cast<float>(1 - n);
  const float k0 = std::max(std::ceil(in), lowest);
  const float k1 = std::min(std::floor(out), lowest + static_cast<float>(n - 1));
  Line line;
  line.first = 0;
  line.end = std::max(0, static_cast<int>(k1 - k0) + 1);
  const float u0 = (k0 - sign * major_0) * du;
  line.a = minor_0 + u0 * h;
  line.b = du * h;
  const float way = u0 + ray.half;
  line.az = ray.entry + way * ray.rise;
  line.bz = du * ray.rise;
  const float dim = walk.alpha * ray.stretch;
  line.light = ray.share * du * Dimmed(dim * way);
  line.fade = Dimmed(dim * du);
  line.major = (sign > 0 ? 1 : -1) * (along_y ? row : lanes);
  line.minor = along_y ? lanes : row;
  line.origin = static_cast<std::ptrdiff_t>(sign * k0) * (along_y ? row : lanes);

  // Slices low and high see crossings less than one slice away.
  const float last = line.az + line.bz * static_cast<float>(line.end - 1);
  const float least = std::min(line.az, last), most = std::max(line.az, last);
  if (most <= low - 1 || least >= high + 1) {
    line.end = 0;
  } else if (least <= low - 1 || most >= high + 1) {
    // One more on each side: the weights decide.
    const float from = (low - 1 - line.az) / line.bz, to = (high + 1 - line.az) / line.bz;
    const auto count = static_cast<float>(line.end);
    line.first = static_cast<int>(std::clamp(std::floor(std::min(from, to)) - 1, 0.0f, count));
    line.end = static_cast<int>(std::clamp(std::ceil(std::max(from, to)) + 2, 0.0f, count));
  }
  return line;
}

/// Weights of a register of crossings, in pairs of slices: on both voxels of the minor axis, and on
/// the slices.
template <class V>
struct Weights {
  V near, far, slice;
};

/// Weights and offsets from the field of crossings j to j + 7; slices are kept within [low, high).
template <class Use>
HWY_INLINE void Weigh(const Line& line, int j, int voxels, int low, int high, Use use) {
  const D d;
  const DI di;
  constexpr int kWidth = hn::MaxLanes(D()), kParts = kLanes / kWidth;
  HWY_ALIGN static constexpr float kStep[kLanes] = {0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7};
  HWY_ALIGN static constexpr float kPlane[kLanes] = {0, 1, 0, 1, 0, 1, 0, 1,
                                                     0, 1, 0, 1, 0, 1, 0, 1};
  const auto one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  const auto weight = [&](auto f, auto k) {
    return hn::Max(zero, hn::Sub(one, hn::Abs(hn::Sub(f, k))));
  };
  const auto base = [&](auto f, int least, int most) {
    return hn::Min(hn::Max(hn::Floor(f), hn::Set(d, static_cast<float>(least))),
                   hn::Set(d, static_cast<float>(most)));
  };
  for (int p = 0; p < kParts; ++p) {
    const auto step = hn::Add(hn::Set(d, static_cast<float>(j)), hn::Load(d, kStep + p * kWidth));
    const auto f = hn::Add(hn::Set(d, line.a), hn::Mul(hn::Set(d, line.b), step));
    const auto fz = hn::Add(hn::Set(d, line.az), hn::Mul(hn::Set(d, line.bz), step));
    const auto k = base(f, 0, voxels - 2), kz = base(fz, low, high - 2);
    const Weights<decltype(f)> w{weight(f, k), weight(f, hn::Add(k, one)),
                                 weight(fz, hn::Add(kz, hn::Load(d, kPlane + p * kWidth)))};
    const auto at = hn::Add(
        hn::Add(
            hn::Mul(hn::ConvertTo(di, step), hn::Set(di, static_cast<std::int32_t>(line.major))),
            hn::Mul(hn::ConvertTo(di, k), hn::Set(di, static_cast<std::int32_t>(line.minor)))),
        hn::ConvertTo(di, kz));
    use(p, w, at);
  }
}

/// 1, fade, fade^2 and so on in pairs, and fade^8.
struct Fade {
  HWY_ALIGN float powers[kLanes];
  float eight;
  explicit Fade(float fade) {
    float f = 1;
    for (int k = 0; k < kCrossings; ++k) {
      powers[2 * k] = powers[2 * k + 1] = f;
      f *= fade;
    }
    eight = f;
  }
};

/// fade^n by squaring.
float Power(float fade, int n) {
  float result = 1;
  for (; n > 0; n >>= 1) {
    if (n & 1) result *= fade;
    fade *= fade;
  }
  return result;
}

/// Voxels at these offsets, both slices of each crossing: lanes have their own slice's.
#if HWY_TARGET == HWY_SCALAR
template <class At>
auto Slices(const float* field, int lane, At at) {
  return hn::Set(D(), field[hn::GetLane(at) + (lane & 1)]);
}
#else
template <class At>
auto Slices(const float* field, int /*lane*/, At at) {
  // Both slices of a crossing at once, by the even lane's offset.
  const hn::Repartition<std::int64_t, D> s64;
  const hn::Repartition<std::uint64_t, D> d64;
  // Sign-extended, in bytes.
  const auto offset = hn::ShiftRight<30>(hn::ShiftLeft<32>(hn::BitCast(s64, at)));
  const auto bytes = hn::And(offset, hn::Set(s64, ~std::int64_t{3}));
  return hn::BitCast(D(),
                     hn::GatherOffset(d64, reinterpret_cast<const std::uint64_t*>(field), bytes));
}
#endif

float ForwardRay(const RayWalk& walk, const Line& line, const float* field) {
  const D d;
  constexpr int kWidth = hn::MaxLanes(D());
  const Fade fade(line.fade);
  const float* const from = field + line.origin;
  float e = line.light * Power(line.fade, line.first);
  HWY_ALIGN float sums[kLanes] = {};
  for (int j = line.first; j < line.end; j += kCrossings, e *= fade.eight) {
    Weigh(line, j, walk.grid.voxels, 0, walk.grid.slices, [&](int p, const auto& w, auto at) {
      auto light = hn::Mul(hn::Mul(hn::Set(d, e), hn::Load(d, fade.powers + p * kWidth)), w.slice);
      if (line.end - j < kCrossings) {
        // What lies past the end is neither read nor counted.
        const auto lane = hn::Iota(d, static_cast<float>(p * kWidth));
        const auto counts = hn::Lt(lane, hn::Set(d, static_cast<float>(2 * (line.end - j))));
        light = hn::IfThenElseZero(counts, light);
        at = hn::IfThenElseZero(hn::RebindMask(DI(), counts), at);
      }
      const auto value = hn::Add(hn::Mul(w.near, Slices(from, p * kWidth, at)),
                                 hn::Mul(w.far, Slices(from + line.minor, p * kWidth, at)));
      hn::Store(hn::Add(hn::Load(d, sums + p * kWidth), hn::Mul(light, value)), d,
                sums + p * kWidth);
    });
  }
  float sum = 0;
  for (int k = 0; k < kCrossings; ++k) sum += sums[2 * k] + sums[2 * k + 1];
  return sum;
}

void AdjointRay(const RayWalk& walk, const Line& line, int low, int high, float light,
                float* field) {
  const D d;
  constexpr int kWidth = hn::MaxLanes(D());
  const hn::CappedTag<float, 2> d2;
  const Fade fade(line.fade);
  float* const to = field + line.origin;
  float e = light * (line.light * Power(line.fade, line.first));
  HWY_ALIGN float near[kLanes];
  HWY_ALIGN float far[kLanes];
  HWY_ALIGN std::int32_t at_all[kLanes];
  for (int j = line.first; j < line.end; j += kCrossings, e *= fade.eight) {
    Weigh(line, j, walk.grid.voxels, low, high, [&](int p, const auto& w, auto at) {
      const auto value =
          hn::Mul(hn::Mul(hn::Set(d, e), hn::Load(d, fade.powers + p * kWidth)), w.slice);
      hn::Store(hn::Mul(value, w.near), d, near + p * kWidth);
      hn::Store(hn::Mul(value, w.far), d, far + p * kWidth);
      hn::Store(at, DI(), at_all + p * kWidth);
    });
    const int count = std::min(kCrossings, line.end - j);
    for (int k = 0; k < count; ++k) {
      float* const voxel = to + at_all[2 * k];
      const auto add = [&](float* pair, const float* weight) {
        for (int q = 0; q < 2; q += static_cast<int>(hn::Lanes(d2))) {
          hn::StoreU(hn::Add(hn::LoadU(d2, pair + q), hn::LoadU(d2, weight + q)), d2, pair + q);
        }
      };
      add(voxel, near + 2 * k);
      add(voxel + line.minor, far + 2 * k);
    }
  }
}

void ToShadow(const RayWalk& walk, int angle, const std::uint8_t* opaque, std::uint16_t* ends) {
  const TomoGrid& grid = walk.grid;
  const auto high = static_cast<float>(grid.slices - 1);
  for (std::size_t i = 0; i < walk.rays.size(); ++i) {
    ends[i] = std::numeric_limits<std::uint16_t>::max();
    if (!(walk.rays[i].half > 0)) continue;
    const Line line = LineOf(walk, walk.rays[i], walk.cosine[angle], walk.sine[angle], 0, high);
    for (int j = line.first; j < line.end; ++j) {
      const auto step = static_cast<float>(j);
      const float beside = std::round(line.a + line.b * step),
                  slice = std::round(line.az + line.bz * step);
      if (!(beside >= 0 && beside < grid.voxels && slice >= 0 && slice < grid.slices)) continue;
      if (opaque[line.origin + j * line.major + static_cast<std::ptrdiff_t>(beside) * line.minor +
                 static_cast<std::ptrdiff_t>(slice)] == 0) {
        continue;
      }
      ends[i] = static_cast<std::uint16_t>(j);
      break;
    }
  }
}

/// The ray up to the insert.
void EndAtShadow(const RayWalk& walk, int angle, const WalkRay* ray, Line& line) {
  if (walk.ends.empty()) return;
  const std::size_t at = static_cast<std::size_t>(angle) * walk.rays.size() +
                         static_cast<std::size_t>(ray - walk.rays.data());
  line.end = std::min<int>(line.end, walk.ends[at]);
}

void Forward(const RayWalk& walk, int angle, const float* field, float* light) {
  const TomoGrid& grid = walk.grid;
  const auto high = static_cast<float>(grid.slices - 1);
  for (int c = 0; c < grid.pixels; ++c) {
    float* const out = light + grid.pixel(angle, c, 0);
    const WalkRay* ray = &walk.rays[static_cast<std::size_t>(c) * grid.rows * walk.per_pixel];
    for (int r = 0; r < grid.rows; ++r) {
      float sum = 0;
      for (int k = 0; k < walk.per_pixel; ++k, ++ray) {
        if (!(ray->half > 0)) continue;
        Line line = LineOf(walk, *ray, walk.cosine[angle], walk.sine[angle], 0, high);
        EndAtShadow(walk, angle, ray, line);
        sum += ForwardRay(walk, line, field);
      }
      out[r] = sum;
    }
    std::fill(out + grid.rows, out + grid.light_lanes(), 0.0f);
  }
}

void Adjoint(const RayWalk& walk, int first, int end, const std::vector<RowRange>& rows,
             const float* light, float* field) {
  const TomoGrid& grid = walk.grid;
  const auto low = static_cast<float>(first), high = static_cast<float>(end - 1);
  for (int m = 0; m < grid.angles; ++m) {
    for (int c = 0; c < grid.pixels; ++c) {
      const RowRange range = rows[c];
      const float* const in = light + grid.pixel(m, c, 0);
      const WalkRay* ray =
          &walk.rays[(static_cast<std::size_t>(c) * grid.rows + range.first) * walk.per_pixel];
      for (int r = range.first; r < range.end; ++r) {
        if (in[r] == 0) {
          ray += walk.per_pixel;
          continue;
        }
        for (int k = 0; k < walk.per_pixel; ++k, ++ray) {
          if (!(ray->half > 0)) continue;
          Line line = LineOf(walk, *ray, walk.cosine[m], walk.sine[m], low, high);
          EndAtShadow(walk, m, ray, line);
          AdjointRay(walk, line, first, end, in[r], field);
        }
      }
    }
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

HWY_EXPORT(Forward);
HWY_EXPORT(Adjoint);
HWY_EXPORT(ToShadow);

void walk_to_shadow(const RayWalk& walk, int angle, const std::uint8_t* opaque,
                    std::uint16_t* ends) {
  HWY_DYNAMIC_DISPATCH(ToShadow)(walk, angle, opaque, ends);
}
void walk_forward(const RayWalk& walk, int angle, const float* field, float* light) {
  HWY_DYNAMIC_DISPATCH(Forward)(walk, angle, field, light);
}
void walk_adjoint(const RayWalk& walk, int first, int end, const std::vector<RowRange>& rows,
                  const float* light, float* field) {
  HWY_DYNAMIC_DISPATCH(Adjoint)(walk, first, end, rows, light, field);
}

}  // namespace slicecorr::tomo::detail
#endif
