// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/projection/block_solver.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>

#include "support/numbers/bracket.hpp"
#include "tomo/projection/column_loops.hpp"

namespace slicecorr::tomo::detail {
namespace {

constexpr float kNoBound = std::numeric_limits<float>::infinity();

struct Limits {
  Array<float> least, most;
  Array<float> per_least, per_most;  ///< of bands

  Limits(const BlockCells& cells, std::size_t count, std::size_t padded, const Penalty& penalty)
      : least(padded, -kNoBound), most(padded, kNoBound) {
    const auto rung = static_cast<float>(penalty.rung);
    if (cells.least != nullptr) {
      per_least.resize(padded);
      per_most.resize(padded);
      for (std::size_t i = 0; i < count; ++i) {
        const bool lower = cells.least[i] > 0;
        if (lower) least[i] = cells.least[i];
        most[i] = cells.most[i] * (lower ? 1 : rung);
        per_least[i] = lower ? 1 / cells.least[i] : 0;
        per_most[i] = 1 / cells.most[i];
      }
      return;
    }
    for (std::size_t i = 0; i < count; ++i) {
      if (cells.kinds[i] == Kind::gel) {
        least[i] = 1;
        most[i] = static_cast<float>(penalty.most_dose);
      } else if (cells.kinds[i] == Kind::empty) {
        most[i] = rung;
      }
    }
  }
  Asked asked() const { return {least.data(), most.data()}; }
  bool banded() const { return !per_least.empty(); }
};

/// Where the slope of a convex loss crosses 0 in (0, end], for each column; `end` where it does not.
template <class SlopeAt>
Doubles minima(const SlopeAt& slope_at, const Doubles& end) {
  const Doubles at_low = slope_at(Doubles{}), at_high = slope_at(end);
  Doubles found{};
  std::array<FalsePosition, kColumns> roots{};
  std::array<bool, kColumns> done{};
  for (std::size_t c = 0; c < end.size(); ++c) {
    roots[c] = {0, end[c], at_low[c], at_high[c]};
    done[c] = true;
    if (!(end[c] > 0) || at_low[c] >= 0) continue;
    found[c] = end[c];
    done[c] = at_high[c] <= 0;
  }
  for (int i = 0; i < 12; ++i) {
    if (std::all_of(done.begin(), done.end(), [](bool d) { return d; })) break;
    Doubles t{};
    for (std::size_t c = 0; c < end.size(); ++c) {
      if (!done[c]) t[c] = roots[c].chord();
    }
    const Doubles s = slope_at(t);
    for (std::size_t c = 0; c < end.size(); ++c) {
      if (done[c]) continue;
      FalsePosition& root = roots[c];
      root.take(t[c], s[c], !(s[c] < 0));
      done[c] = root.high - root.low <= 1e-3 * root.high;
      found[c] = root.low > 0 ? root.low : root.high;
    }
  }
  return found;
}

Floats to_floats(const Doubles& numbers) {
  Floats f;
  for (std::size_t c = 0; c < f.size(); ++c) f[c] = static_cast<float>(numbers[c]);
  return f;
}

class Solver {
 public:
  Solver(const Projector& projector, std::size_t block, const BlockCells& cells,
         const Penalty& penalty, int memory, const ExecutionContext& context)
      : projector_(projector),
        block_(block),
        context_(context),
        loops_(projector.shape().problem_lanes(), context),
        voxels_(projector.shape().field_of_block),
        pixels_(projector.shape().light_of_block),
        cap_(static_cast<float>(penalty.cap)),
        limits_(cells, voxels_, loops_.padded(voxels_), penalty),
        dose_(loops_.padded(voxels_)),
        excess_(dose_.size()),
        change_(dose_.size()),
        light_(loops_.padded(pixels_)),
        gradient_(light_.size()),
        before_(light_.size()),
        direction_(light_.size()),
        memory_(static_cast<std::size_t>(memory)) {}

  BlockRun run(int steps, bool may_leave, float* light, float* dose) {
    const int lanes = loops_.lanes();
    BlockRun run;
    run.slices.resize(static_cast<std::size_t>(projector_.shape().problems_of(block_)));
    for (std::size_t i = 0; i < pixels_; ++i) light_[i] = std::clamp(light[i], 0.0f, cap_);
    live_.fill(0);
    const std::size_t used = lanes == 1 ? kColumns : run.slices.size();
    std::fill_n(live_.begin(), used, 1.0f);
    projector_.adjoint(block_, light_.data(), dose_.data(), context_);
    step_dose_by({});
    const auto keep = [&] {
      for (std::size_t l = 0; l < run.slices.size(); ++l) {
        if (run.slices[l].empty() || live_[l] > 0) run.slices[l].push_back(now_[l]);
        if (now_[l].loss == 0) live_[l] = 0;
      }
      if (lanes == 1) live_.fill(live_[0]);
    };
    keep();
    const auto at_work = [&] {
      return std::count(live_.begin(), live_.begin() + static_cast<std::ptrdiff_t>(used), 1.0f);
    };
    const auto at_first = at_work();
    for (; run.steps < steps && at_work() > 0; ++run.steps) {
      if (may_leave && lanes > 1 && 2 * at_work() <= at_first && run.steps > 0) break;
      context_.check_cancelled();
      step();
      keep();
    }
    std::copy_n(light_.data(), pixels_, light);
    // Without what rounding left in sums over steps.
    projector_.adjoint(block_, light_.data(), dose_.data(), context_);
    std::copy_n(dose_.data(), voxels_, dose);
    return run;
  }

 private:
  /// Dose and excess t along the change, and what they are like.
  void step_dose_by(const Floats& t) {
    const Asked asked = limits_.asked();
    std::mutex mutex;
    Floats low, high{}, most{};
    low.fill(kNoBound);
    const auto loss = loops_.sum(dose_.size(), 1, [&](const Stretch& s, double* sums) {
      float extremes[3 * 16] = {};
      std::fill_n(extremes, 16, kNoBound);
      step_dose(s, asked, change_.data(), t.data() + s.first, dose_.data(), excess_.data(), sums,
                extremes);
      if (limits_.banded()) {
        std::fill_n(extremes, 16, kNoBound);
        std::fill_n(extremes + 16, 16, 0.0F);
        extremes_in_bands(s, limits_.per_least.data(), limits_.per_most.data(), dose_.data(),
                          extremes);
      }
      const std::scoped_lock lock(mutex);
      for (int k = 0; k < 16; ++k) {
        low[s.first + k] = std::min(low[s.first + k], extremes[k]);
        high[s.first + k] = std::max(high[s.first + k], extremes[16 + k]);
        most[s.first + k] = std::max(most[s.first + k], extremes[32 + k]);
      }
    });
    if (loops_.lanes() == 1) {
      low.fill(*std::min_element(low.begin(), low.begin() + 16));
      high.fill(*std::max_element(high.begin(), high.begin() + 16));
      most.fill(*std::max_element(most.begin(), most.begin() + 16));
    }
    const auto gelled = loops_.sum(dose_.size(), 1, [&](const Stretch& s, double* sums) {
      if (limits_.banded()) {
        count_above(s, limits_.per_most.data(), dose_.data(), low.data() + s.first, sums);
      } else {
        count_void(s, asked, dose_.data(), low.data() + s.first, sums);
      }
    });
    for (std::size_t c = 0; c < now_.size(); ++c) {
      now_[c] = {loss[0][c], low[c], high[c], most[c], gelled[0][c]};
    }
  }

  void step() {
    gradient_.swap(before_);
    projector_.forward(block_, excess_.data(), gradient_.data(), context_);
    if (pending_) {
      Pair& pair = memory_[next_];
      loops_.each(light_.size(), [&](const Stretch& s) {
        change_of_gradient(s, gradient_.data(), before_.data(), pair.y.data());
      });
      next_ = (next_ + 1) % memory_.size();
      used_ = std::min(used_ + 1, memory_.size());
      pending_ = false;
    }
    // Pairs from the oldest to the newest.
    Quadratic of{light_.data(), gradient_.data(), cap_, live_.data(), {}, {}};
    std::vector<std::size_t> order;
    for (std::size_t k = 0; k < used_; ++k) {
      order.push_back((next_ + memory_.size() - used_ + k) % memory_.size());
      of.steps.push_back(memory_[order.back()].s.data());
      of.changes.push_back(memory_[order.back()].y.data());
    }
    const auto sums = loops_.sum(light_.size(), of.sums(),
                                 [&](const Stretch& s, double* to) { products(s, of, to); });
    for (std::size_t c = 0; c < live_.size(); ++c) {
      if (sums[0][c] == 0) live_[c] = 0;
    }
    std::vector<Floats> factors(1 + 2 * used_);
    std::array<bool, kColumns> plain{};
    for (std::size_t c = 0; c < live_.size(); ++c) {
      plain[c] = live_[c] > 0 && !newton(of, order, sums, c, factors);
    }
    const bool any_plain = std::any_of(plain.begin(), plain.end(), [](bool p) { return p; });
    if (any_plain) go_down_alone(of, sums[0], plain, factors);

    // To the end of the step within the bounds; between here and there all is allowed, and the dose
    // is linear, so the best place costs no further projection.
    loops_.each(light_.size(), [&](const Stretch& s) {
      const auto here = of_columns(factors, s.first);
      descend(s, of, here.data(), direction_.data());
    });
    projector_.adjoint(block_, direction_.data(), change_.data(), context_);
    const Asked asked = limits_.asked();
    Doubles end{};
    for (std::size_t c = 0; c < end.size(); ++c) end[c] = live_[c];
    const Doubles t = minima(
        [&](const Doubles& at) {
          const Floats places = to_floats(at);
          return loops_.sum(dose_.size(), 1, [&](const Stretch& s, double* to) {
            slope(s, asked, dose_.data(), change_.data(), places.data() + s.first, to);
          })[0];
        },
        end);
    for (std::size_t c = 0; c < t.size(); ++c) {
      if (!(live_[c] > 0) || t[c] > 0) continue;
      if (plain[c]) live_[c] = 0;
      for (Pair& pair : memory_) pair.good[c] = false;
    }
    const Floats by = to_floats(t);
    Pair& pair = memory_[next_];
    if (pair.s.empty()) {
      pair.s.resize(light_.size());
      pair.y.resize(light_.size());
    }
    loops_.each(light_.size(), [&](const Stretch& s) {
      step_light(s, direction_.data(), by.data() + s.first, cap_, light_.data(), pair.s.data());
    });
    for (std::size_t c = 0; c < t.size(); ++c) pair.good[c] = t[c] > 0;
    pending_ = true;
    step_dose_by(by);
  }

  /// Factors of L-BFGS for a column from the products of its free pixels; false without a memory.
  bool newton(const Quadratic& of, const std::vector<std::size_t>& order,
              const std::vector<Doubles>& sums, std::size_t c, std::vector<Floats>& factors) const {
    const auto n = static_cast<int>(order.size());
    const auto at = [&](int kind) { return sums[static_cast<std::size_t>(kind)][c]; };
    const auto yy = [&](int i, int j) { return at(i >= j ? of.yy(i, j) : of.yy(j, i)); };
    std::vector<double> rho(order.size()), a(order.size()), b(order.size());
    double gamma = 0;
    for (int i = 0; i < n; ++i) {
      const double sy = at(of.sy(i, i));
      if (!memory_[order[i]].good[c] || !(sy > 1e-10 * yy(i, i)) || !(yy(i, i) > 0)) continue;
      rho[i] = 1 / sy;
      gamma = sy / yy(i, i);
    }
    if (gamma == 0) return false;
    for (int i = n - 1; i >= 0; --i) {
      double sq = at(of.sq(i));
      for (int j = i + 1; j < n; ++j) sq -= a[j] * at(of.sy(i, j));
      a[i] = rho[i] * sq;
    }
    for (int i = 0; i < n; ++i) {
      double yr = at(of.yq(i));
      for (int j = 0; j < n; ++j) yr -= a[j] * yy(i, j);
      yr *= gamma;
      for (int j = 0; j < i; ++j) yr += b[j] * at(of.sy(j, i));
      b[i] = a[i] - rho[i] * yr;
    }
    double down = gamma * at(0);
    for (int i = 0; i < n; ++i) down += b[i] * at(of.sq(i)) - gamma * a[i] * at(of.yq(i));
    if (!(down > 0)) return false;
    factors[0][c] = static_cast<float>(gamma);
    for (int i = 0; i < n; ++i) {
      factors[1 + i][c] = static_cast<float>(b[i]);
      factors[1 + n + i][c] = static_cast<float>(-gamma * a[i]);
    }
    return true;
  }

  /// Without a memory, along the gradient as far as the loss falls when no bound is in the way.
  void go_down_alone(const Quadratic& of, const Doubles& steepest,
                     const std::array<bool, kColumns>& plain, std::vector<Floats>& factors) {
    loops_.each(light_.size(), [&](const Stretch& s) { free_gradient(s, of, direction_.data()); });
    projector_.adjoint(block_, direction_.data(), change_.data(), context_);
    const auto bent = loops_.sum(dose_.size(), 1, [&](const Stretch& s, double* to) {
      curvature(s, excess_.data(), change_.data(), to);
    });
    for (std::size_t c = 0; c < plain.size(); ++c) {
      if (!plain[c]) continue;
      for (Floats& f : factors) f[c] = 0;
      factors[0][c] = static_cast<float>(bent[0][c] > 0 ? steepest[c] / bent[0][c] : 1);
    }
  }

  static std::vector<float> of_columns(const std::vector<Floats>& factors, int first) {
    std::vector<float> some(factors.size() * 16);
    for (std::size_t i = 0; i < factors.size(); ++i) {
      std::copy_n(factors[i].data() + first, 16, some.data() + i * 16);
    }
    return some;
  }

  struct Pair {
    Array<float> s, y;
    std::array<bool, kColumns> good{};
  };

  const Projector& projector_;
  std::size_t block_;
  const ExecutionContext& context_;
  ColumnLoops loops_;
  std::size_t voxels_, pixels_;
  float cap_;
  Limits limits_;
  Array<float> dose_, excess_, change_, light_, gradient_, before_, direction_;
  std::vector<Pair> memory_;
  std::size_t next_ = 0, used_ = 0;
  bool pending_ = false;
  Floats live_{};
  std::array<SliceStep, kColumns> now_;
};

}  // namespace

std::vector<double> best_scales(const Shape& shape, const BlockCells& cells, const float* dose,
                                const Penalty& penalty, const ExecutionContext& context) {
  const std::size_t count = shape.field_of_block;
  const ColumnLoops loops(shape.problem_lanes(), context);
  const Limits limits(cells, count, loops.padded(count), penalty);
  Array<float> zero(loops.padded(count)), change(loops.padded(count));
  std::copy_n(dose, count, change.data());
  const auto lanes = static_cast<std::size_t>(shape.problem_lanes());
  Doubles most{};
  for (std::size_t i = 0; i < count; ++i) {
    if (cells.kinds[i] == Kind::gel) most[i % lanes] = std::max<double>(most[i % lanes], dose[i]);
  }
  if (lanes == 1) most.fill(most[0]);
  // Beyond, all of the gel would have to be at 100 times its dose.
  Doubles end{};
  for (std::size_t c = 0; c < end.size(); ++c) end[c] = most[c] > 0 ? 100 / most[c] : 0;
  const Asked asked = limits.asked();
  const Doubles found = minima(
      [&](const Doubles& at) {
        const Floats places = to_floats(at);
        return loops.sum(count, 1, [&](const Stretch& s, double* to) {
          slope(s, asked, zero.data(), change.data(), places.data() + s.first, to);
        })[0];
      },
      end);
  std::vector<double> scales(lanes, 0.0);
  for (std::size_t l = 0; l < lanes; ++l) {
    if (most[l] > 0) scales[l] = found[l];
  }
  return scales;
}

BlockRun solve_block(const Projector& projector, std::size_t block, const BlockCells& cells,
                     const Penalty& penalty, int steps, int memory, bool may_leave,
                     const ExecutionContext& context, float* light, float* dose) {
  Solver solver(projector, block, cells, penalty, memory, context);
  return solver.run(steps, may_leave, light, dose);
}

}  // namespace slicecorr::tomo::detail
