#include "tomo/block_solver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/kernels.hpp"

namespace slicecorr::tomo::detail {
namespace {

/// Sums go into 16 lanes in a fixed order, so that they are vector code with the same result on
/// every processor.
constexpr std::size_t kLanes = 16;

SLICECORR_CLONES
double dot(const float* a, const float* b, std::size_t count) {
  double total = 0;
  std::size_t i = 0;
  while (i + kLanes <= count) {
    float sum[kLanes] = {};
    const std::size_t end = std::min(i + 64 * kLanes, count / kLanes * kLanes);
    for (; i < end; i += kLanes) {
      for (std::size_t k = 0; k < kLanes; ++k) sum[k] += a[i + k] * b[i + k];
    }
    for (const float s : sum) total += s;
  }
  for (; i < count; ++i) total += static_cast<double>(a[i]) * b[i];
  return total;
}

SLICECORR_CLONES
void add(float factor, const float* x, float* to, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) to[i] += factor * x[i];
}

/// Limits of each voxel: below `least` and above `most` dose costs.
struct Limits {
  Array<float> least, most;

  Limits(const Kind* kinds, std::size_t count, const Penalty& penalty)
      : least(count, -std::numeric_limits<float>::infinity()),
        most(count, std::numeric_limits<float>::infinity()) {
    for (std::size_t i = 0; i < count; ++i) {
      if (kinds[i] == Kind::kGel) {
        least[i] = 1;
        most[i] = static_cast<float>(penalty.most_dose);
      } else if (kinds[i] == Kind::kVoid) {
        most[i] = static_cast<float>(penalty.rung);
      }
    }
  }
};

/// excess = (D - most)+ - (least - D)+, half of the derivative of the loss by the dose.
SLICECORR_CLONES
void excess_of(const float* dose, const float* least, const float* most, float* excess,
               std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const float above = dose[i] - most[i], below = least[i] - dose[i];
    excess[i] = (above > 0 ? above : 0) - (below > 0 ? below : 0);
  }
}

/// Half of the derivative of the loss along D + t d.
SLICECORR_CLONES
double slope(const float* dose, const float* d, float t, const float* least, const float* most,
             std::size_t count) {
  double total = 0;
  std::size_t i = 0;
  while (i + kLanes <= count) {
    float sum[kLanes] = {};
    const std::size_t end = std::min(i + 64 * kLanes, count / kLanes * kLanes);
    for (; i < end; i += kLanes) {
      for (std::size_t k = 0; k < kLanes; ++k) {
        const float at = dose[i + k] + t * d[i + k];
        const float above = at - most[i + k], below = least[i + k] - at;
        sum[k] += ((above > 0 ? above : 0) - (below > 0 ? below : 0)) * d[i + k];
      }
    }
    for (const float s : sum) total += s;
  }
  for (; i < count; ++i) {
    const float at = dose[i] + t * d[i];
    total += (std::max(0.0f, at - most[i]) - std::max(0.0f, least[i] - at)) * d[i];
  }
  return total;
}

/// Where the slope of a convex loss crosses 0 in (0, end]; `end` when it does not.
template <class Slope>
double minimum(const Slope& slope_at, double end) {
  double low = 0, high = end, at_low = slope_at(0.0), at_high = slope_at(end);
  if (at_high <= 0) return end;
  if (at_low >= 0) return 0;
  // False position; an end that stays twice counts half (Illinois).
  int side = 0;
  for (int i = 0; i < 12; ++i) {
    const double t = (low * at_high - high * at_low) / (at_high - at_low);
    const double s = slope_at(t);
    if (s < 0) {
      low = t;
      at_low = s;
      if (side == -1) at_high *= 0.5;
      side = -1;
    } else {
      high = t;
      at_high = s;
      if (side == 1) at_low *= 0.5;
      side = 1;
    }
    if (high - low <= 1e-3 * high) break;
  }
  return low > 0 ? low : high;
}

BlockStep judge(const Kind* kinds, const float* dose, const float* excess, std::size_t count) {
  BlockStep step;
  step.loss = dot(excess, excess, count);
  step.min_gel = std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < count; ++i) {
    if (kinds[i] == Kind::kNeither) continue;
    step.max_dose = std::max(step.max_dose, dose[i]);
    if (kinds[i] == Kind::kGel) {
      step.min_gel = std::min(step.min_gel, dose[i]);
    } else {
      step.max_void = std::max(step.max_void, dose[i]);
    }
  }
  if (step.max_void >= step.min_gel) {
    for (std::size_t i = 0; i < count; ++i) {
      step.void_gelled += kinds[i] == Kind::kVoid && dose[i] >= step.min_gel;
    }
  }
  return step;
}

/// The pairs of steps and changes of gradient that L-BFGS remembers.
class Memory {
 public:
  Memory(std::size_t pairs, std::size_t count)
      : s_(pairs, Array<float>(count)), y_(pairs, Array<float>(count)), rho_(pairs), a_(pairs) {}

  void forget() { used_ = 0; }
  /// s = b_new - b, y = g_new - g.
  void keep(const float* b_new, const float* b, const float* g_new, const float* g) {
    Array<float>& s = s_[next_];
    Array<float>& y = y_[next_];
    for (std::size_t i = 0; i < s.size(); ++i) {
      s[i] = b_new[i] - b[i];
      y[i] = g_new[i] - g[i];
    }
    const double sy = dot(s.data(), y.data(), s.size()), yy = dot(y.data(), y.data(), y.size());
    if (!(sy > 1e-10 * yy) || yy <= 0) return;
    rho_[next_] = 1 / sy;
    gamma_ = sy / yy;
    next_ = (next_ + 1) % s_.size();
    used_ = std::min(used_ + 1, s_.size());
  }
  bool empty() const { return used_ == 0; }
  /// q becomes H q on the free pixels; elsewhere q is and stays 0.
  void multiply(float* q, const std::uint8_t* free, std::size_t count) {
    for (std::size_t k = 0; k < used_; ++k) {
      const std::size_t i = (next_ + s_.size() - 1 - k) % s_.size();
      a_[i] = rho_[i] * dot(s_[i].data(), q, count);
      add(static_cast<float>(-a_[i]), y_[i].data(), q, count);
      mask(q, free, count);
    }
    for (std::size_t i = 0; i < count; ++i) q[i] *= static_cast<float>(gamma_);
    for (std::size_t k = used_; k-- > 0;) {
      const std::size_t i = (next_ + s_.size() - 1 - k) % s_.size();
      const double b = rho_[i] * dot(y_[i].data(), q, count);
      add(static_cast<float>(a_[i] - b), s_[i].data(), q, count);
      mask(q, free, count);
    }
  }
  static void mask(float* q, const std::uint8_t* free, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) q[i] = free[i] != 0 ? q[i] : 0.0f;
  }

 private:
  std::vector<Array<float>> s_, y_;
  std::vector<double> rho_, a_;
  double gamma_ = 1;
  std::size_t next_ = 0, used_ = 0;
};

}  // namespace

double best_scale(const Kind* kinds, std::size_t count, const float* dose, const Penalty& penalty) {
  const Limits limits(kinds, count, penalty);
  const Array<float> zero(count, 0.0f);
  float most = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (kinds[i] == Kind::kGel) most = std::max(most, dose[i]);
  }
  if (most <= 0) return 1;
  // Beyond, all of the gel would have to be at 100 times its dose.
  return minimum(
      [&](double t) {
        return slope(zero.data(), dose, static_cast<float>(t), limits.least.data(),
                     limits.most.data(), count);
      },
      100.0 / most);
}

std::vector<BlockStep> solve_block(const Projector& projector, std::size_t block, const Kind* kinds,
                                   const Penalty& penalty, int steps, int memory,
                                   const ExecutionContext& context, float* light, float* dose) {
  const TomoGrid& grid = projector.grid();
  const std::size_t voxels = grid.voxels_of_block(), pixels = grid.light_of_block();
  const Limits limits(kinds, voxels, penalty);
  const auto cap = static_cast<float>(penalty.cap);
  Array<float> excess(voxels), change(voxels), gradient(pixels), old_gradient(pixels),
      direction(pixels), next(pixels);
  std::vector<std::uint8_t> free(pixels);
  Memory pairs(memory, pixels);

  for (std::size_t i = 0; i < pixels; ++i) light[i] = std::clamp(light[i], 0.0f, cap);
  projector.adjoint(block, light, dose, context);
  std::vector<BlockStep> history;
  for (int step = 0;; ++step) {
    excess_of(dose, limits.least.data(), limits.most.data(), excess.data(), voxels);
    history.push_back(judge(kinds, dose, excess.data(), voxels));
    if (step == steps || history.back().loss == 0) break;
    context.check_cancelled();
    gradient.swap(old_gradient);
    projector.forward(block, excess.data(), gradient.data(), context);
    if (step > 0) pairs.keep(light, next.data(), gradient.data(), old_gradient.data());

    // Pixels at a bound that the gradient pushes against stay there.
    double steepest = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      const bool held = (light[i] <= 0 && gradient[i] > 0) || (light[i] >= cap && gradient[i] < 0);
      free[i] = !held;
      direction[i] = held ? 0.0f : gradient[i];
      steepest += static_cast<double>(direction[i]) * direction[i];
    }
    if (steepest == 0) break;
    if (!pairs.empty()) {
      pairs.multiply(direction.data(), free.data(), pixels);
      if (!(dot(direction.data(), gradient.data(), pixels) > 0)) {
        pairs.forget();
        for (std::size_t i = 0; i < pixels; ++i) direction[i] = free[i] != 0 ? gradient[i] : 0.0f;
      }
    }
    if (pairs.empty()) {
      // Without a memory, as far as the loss falls when no bound is in the way.
      projector.adjoint(block, direction.data(), change.data(), context);
      double curvature = 0;
      for (std::size_t i = 0; i < voxels; ++i) {
        if (excess[i] != 0) curvature += static_cast<double>(change[i]) * change[i];
      }
      const auto length = static_cast<float>(curvature > 0 ? steepest / curvature : 1);
      for (float& d : direction) d *= length;
    }
    // `next` is the end of the step within the bounds; between here and there all is allowed, and
    // the dose is linear, so the best place costs no further projection.
    for (std::size_t i = 0; i < pixels; ++i) {
      next[i] = std::clamp(light[i] - direction[i], 0.0f, cap);
      direction[i] = next[i] - light[i];
    }
    projector.adjoint(block, direction.data(), change.data(), context);
    const double t = minimum(
        [&](double at) {
          return slope(dose, change.data(), static_cast<float>(at), limits.least.data(),
                       limits.most.data(), voxels);
        },
        1.0);
    if (t == 0) {
      if (pairs.empty()) break;
      pairs.forget();
    }
    std::copy_n(light, pixels, next.data());  // the light before this step
    if (t == 1) {
      for (std::size_t i = 0; i < pixels; ++i)
        light[i] = std::clamp(light[i] + direction[i], 0.0f, cap);
    } else {
      const auto part = static_cast<float>(t);
      for (std::size_t i = 0; i < pixels; ++i) {
        light[i] = std::clamp(light[i] + part * direction[i], 0.0f, cap);
      }
    }
    add(static_cast<float>(t), change.data(), dose, voxels);
  }
  // Without what rounding left in sums over steps.
  projector.adjoint(block, light, dose, context);
  return history;
}

}  // namespace slicecorr::tomo::detail
