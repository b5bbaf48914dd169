#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tomo/ray_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "tomo/ray_kernels.hpp"

// Products and sums are never fused, and sums have a fixed order, so that every instruction set
// gives the same bits.

HWY_BEFORE_NAMESPACE();
namespace slicecorr::tomo::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Eight samples at once, each in two neighbouring lanes: its lower and its upper plane of voxels,
// which lie side by side in memory.
constexpr int kSamples = 8, kLanes = 2 * kSamples;

using D = hn::CappedTag<float, kLanes>;
using DI = hn::RebindToSigned<D>;

/// The line of a ray at one angle: places of its sample j are a + b j.
struct Line {
  float ax, bx, ay, by, az, bz;
  int first, end;  ///< samples that come near slices [low, high]
};

Line LineOf(const RayWalk& walk, const WalkRay& ray, double cosine, double sine, float low,
            float high) {
  const auto c0 = static_cast<float>(cosine), s0 = static_cast<float>(sine);
  const float c = c0 * ray.cos_turn - s0 * ray.sin_turn;
  const float s = s0 * ray.cos_turn + c0 * ray.sin_turn;
  const float middle = 0.5f * static_cast<float>(walk.grid.voxels - 1);
  Line line{middle + ray.t * c - ray.u0 * s,
            -ray.du * s,
            middle + ray.t * s + ray.u0 * c,
            ray.du * c,
            ray.z0,
            ray.dz,
            0,
            ray.samples};
  // Planes low and high see samples less than one plane away.
  const float last = ray.z0 + ray.dz * static_cast<float>(ray.samples - 1);
  const float least = std::min(ray.z0, last), most = std::max(ray.z0, last);
  if (most <= low - 1 || least >= high + 1) {
    line.end = 0;
  } else if (least <= low - 1 || most >= high + 1) {
    // One more on each side: the weights decide.
    const float a = (low - 1 - ray.z0) / ray.dz, b = (high + 1 - ray.z0) / ray.dz;
    const float from = std::floor(std::min(a, b)) - 1, to = std::ceil(std::max(a, b)) + 2;
    const auto count = static_cast<float>(ray.samples);
    line.first = static_cast<int>(std::clamp(from, 0.0f, count));
    line.end = static_cast<int>(std::clamp(to, 0.0f, count));
  }
  return line;
}

/// What eight samples weigh, `part` of them in one register.
template <class V>
struct Weights {
  V x0, x1, y0, y1, z;
};

/// Places of samples, and offsets of their lower planes in the field, 64 bits each.
struct Batch {
  HWY_ALIGN std::uint64_t at[kSamples];
  HWY_ALIGN float w00[kLanes], w10[kLanes], w01[kLanes], w11[kLanes];
};

/// Weights and offsets of samples j to j + 7; z planes are kept within [low, high - 1]. `e` has
/// their light, in pairs.
template <class Use>
HWY_INLINE void Weigh(const Line& line, int j, int voxels, int lanes, int low, int high, Use use) {
  const D d;
  const DI di;
  constexpr int kWidth = hn::MaxLanes(D()), kParts = kLanes / kWidth;
  HWY_ALIGN static constexpr float kStep[kLanes] = {0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7};
  HWY_ALIGN static constexpr float kPlane[kLanes] = {0, 1, 0, 1, 0, 1, 0, 1,
                                                     0, 1, 0, 1, 0, 1, 0, 1};
  const auto one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  const auto near = [&](auto f, auto k) {
    return hn::Max(zero, hn::Sub(one, hn::Abs(hn::Sub(f, k))));
  };
  const auto base = [&](auto f, float least, float most) {
    return hn::Min(hn::Max(hn::Floor(f), hn::Set(d, least)), hn::Set(d, most));
  };
  const auto last = static_cast<float>(voxels - 2);
  for (int p = 0; p < kParts; ++p) {
    const auto step = hn::Add(hn::Set(d, static_cast<float>(j)), hn::Load(d, kStep + p * kWidth));
    const auto fx = hn::Add(hn::Set(d, line.ax), hn::Mul(hn::Set(d, line.bx), step));
    const auto fy = hn::Add(hn::Set(d, line.ay), hn::Mul(hn::Set(d, line.by), step));
    const auto fz = hn::Add(hn::Set(d, line.az), hn::Mul(hn::Set(d, line.bz), step));
    const auto kx = base(fx, 0, last), ky = base(fy, 0, last);
    const auto kz = base(fz, static_cast<float>(low), static_cast<float>(high - 2));
    const auto wz = near(fz, hn::Add(kz, hn::Load(d, kPlane + p * kWidth)));
    const Weights<decltype(wz)> w{near(fx, kx), near(fx, hn::Add(kx, one)), near(fy, ky),
                                  near(fy, hn::Add(ky, one)), wz};
    const auto column =
        hn::Add(hn::Mul(hn::ConvertTo(di, ky), hn::Set(di, voxels)), hn::ConvertTo(di, kx));
    const auto at = hn::Add(hn::Mul(column, hn::Set(di, lanes)), hn::ConvertTo(di, kz));
    use(p, w, at);
  }
}

/// 1, fade, fade^2 and so on in pairs, and fade^8.
struct Fade {
  HWY_ALIGN float powers[kLanes];
  float eight;
  explicit Fade(float fade) {
    float f = 1;
    for (int k = 0; k < kSamples; ++k) {
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

/// Voxels at these offsets from `field`, both planes of each sample: lanes have their own plane's.
#if HWY_TARGET == HWY_SCALAR
template <class At>
auto Planes(const float* field, int lane, At at) {
  return hn::Set(D(), field[static_cast<std::uint32_t>(hn::GetLane(at)) + (lane & 1)]);
}
#else
template <class At>
auto Planes(const float* field, int /*lane*/, At at) {
  // Both planes of a sample at once, by the even lane's offset in bytes.
  const hn::Repartition<std::uint64_t, D> d64;
  const hn::RebindToSigned<decltype(d64)> s64;
  const auto offset =
      hn::ShiftLeft<2>(hn::And(hn::BitCast(d64, at), hn::Set(d64, std::uint64_t{0xffffffff})));
  return hn::BitCast(D(), hn::GatherOffset(d64, reinterpret_cast<const std::uint64_t*>(field),
                                           hn::BitCast(s64, offset)));
}
#endif

float ForwardRay(const RayWalk& walk, const WalkRay& ray, const Line& line, const float* field) {
  const D d;
  constexpr int kWidth = hn::MaxLanes(D());
  const int n = walk.grid.voxels, lanes = walk.grid.lanes();
  const std::size_t next_x = lanes, next_y = next_x * n;
  const Fade fade(ray.fade);
  float e = ray.start * Power(ray.fade, line.first);
  HWY_ALIGN float sums[kLanes] = {};
  for (int j = line.first; j < line.end; j += kSamples, e *= fade.eight) {
    Weigh(line, j, n, lanes, 0, walk.grid.slices, [&](int p, const auto& w, auto at) {
      const auto load = [&](std::size_t more) { return Planes(field + more, p * kWidth, at); };
      const auto near_y = hn::Add(hn::Mul(w.x0, load(0)), hn::Mul(w.x1, load(next_x)));
      const auto far_y = hn::Add(hn::Mul(w.x0, load(next_y)), hn::Mul(w.x1, load(next_y + next_x)));
      auto value = hn::Add(hn::Mul(w.y0, near_y), hn::Mul(w.y1, far_y));
      value = hn::Mul(value, w.z);
      auto light = hn::Mul(hn::Set(d, e), hn::Load(d, fade.powers + p * kWidth));
      if (line.end - j < kSamples) {
        // Samples past the end count nothing.
        const auto lane = hn::Iota(d, static_cast<float>(p * kWidth));
        light = hn::IfThenElseZero(hn::Lt(lane, hn::Set(d, static_cast<float>(2 * (line.end - j)))),
                                   light);
      }
      hn::Store(hn::Add(hn::Load(d, sums + p * kWidth), hn::Mul(light, value)), d,
                sums + p * kWidth);
    });
  }
  float sum = 0;
  for (int k = 0; k < kSamples; ++k) sum += sums[2 * k] + sums[2 * k + 1];
  return sum;
}

void AdjointRay(const RayWalk& walk, const WalkRay& ray, const Line& line, int low, int high,
                float light, float* field) {
  const D d;
  constexpr int kWidth = hn::MaxLanes(D());
  const hn::CappedTag<float, 2> d2;
  const int n = walk.grid.voxels, lanes = walk.grid.lanes();
  const std::size_t next_x = lanes, next_y = static_cast<std::size_t>(lanes) * n;
  const Fade fade(ray.fade);
  float e = light * (ray.start * Power(ray.fade, line.first));
  HWY_ALIGN std::int32_t at_all[kLanes];
  Batch batch;
  for (int j = line.first; j < line.end; j += kSamples, e *= fade.eight) {
    Weigh(line, j, n, lanes, low, high, [&](int p, const auto& w, auto at) {
      const auto value =
          hn::Mul(hn::Mul(hn::Set(d, e), hn::Load(d, fade.powers + p * kWidth)), w.z);
      const auto y0 = hn::Mul(value, w.y0), y1 = hn::Mul(value, w.y1);
      hn::Store(hn::Mul(y0, w.x0), d, batch.w00 + p * kWidth);
      hn::Store(hn::Mul(y0, w.x1), d, batch.w10 + p * kWidth);
      hn::Store(hn::Mul(y1, w.x0), d, batch.w01 + p * kWidth);
      hn::Store(hn::Mul(y1, w.x1), d, batch.w11 + p * kWidth);
      hn::Store(at, DI(), at_all + p * kWidth);
    });
    const int count = std::min(kSamples, line.end - j);
    for (int k = 0; k < count; ++k) {
      float* const to = field + static_cast<std::uint32_t>(at_all[2 * k]);
      const auto add = [&](float* voxel, const float* weight) {
        for (int q = 0; q < 2; q += static_cast<int>(hn::Lanes(d2))) {
          hn::StoreU(hn::Add(hn::LoadU(d2, voxel + q), hn::LoadU(d2, weight + q)), d2, voxel + q);
        }
      };
      add(to, batch.w00 + 2 * k);
      add(to + next_x, batch.w10 + 2 * k);
      add(to + next_y, batch.w01 + 2 * k);
      add(to + next_y + next_x, batch.w11 + 2 * k);
    }
  }
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
        if (ray->samples == 0) continue;
        const Line line = LineOf(walk, *ray, walk.cosine[angle], walk.sine[angle], 0, high);
        sum += ForwardRay(walk, *ray, line, field);
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
          if (ray->samples == 0) continue;
          const Line line = LineOf(walk, *ray, walk.cosine[m], walk.sine[m], low, high);
          AdjointRay(walk, *ray, line, first, end, in[r], field);
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

#if HWY_ONCE
namespace slicecorr::tomo::detail {

HWY_EXPORT(Forward);
HWY_EXPORT(Adjoint);

void walk_forward(const RayWalk& walk, int angle, const float* field, float* light) {
  HWY_DYNAMIC_DISPATCH(Forward)(walk, angle, field, light);
}
void walk_adjoint(const RayWalk& walk, int first, int end, const std::vector<RowRange>& rows,
                  const float* light, float* field) {
  HWY_DYNAMIC_DISPATCH(Adjoint)(walk, first, end, rows, light, field);
}

}  // namespace slicecorr::tomo::detail
#endif
