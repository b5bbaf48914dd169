// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "chemistry/consumption.hpp"

#include <algorithm>
#include <cmath>

#include "chemistry/light.hpp"

namespace slicecorr::detail {

Consumption::Consumption(const Chemistry& c, int width, int height, Sides sides, double cell_um,
                         double spread_um, double full_mw_cm2)
    : oxygen_um2_s_(*c.oxygen_um2_s),
      cell_um_(cell_um),
      used_per_s_(radicals_mol_l_s(c, full_mw_cm2) / c.oxygen_mol_l),
      weights_(spread_weights(spread_um, cell_um)),
      filter_(width, height, sides) {}

void Consumption::set_time(double T_s) {
  const double per_cell = oxygen_um2_s_ / (cell_um_ * cell_um_);
  // The waves of the cells' own diffusion, as `run_pattern` has it, and of their spread of light.
  const auto symbol = [](double theta) {
    const double s2 = std::sin(theta / 2) * std::sin(theta / 2);
    return 4 * (s2 + s2 * s2 / 3);
  };
  const auto spread = [&](double theta) {
    double sum = weights_[0];
    for (std::size_t j = 1; j < weights_.size(); ++j) {
      sum += 2 * weights_[j] * std::cos(static_cast<double>(j) * theta);
    }
    return sum;
  };
  filter_.set([&](double tx, double ty) {
    const double rate = per_cell * (symbol(tx) + symbol(ty));
    const double life = rate * T_s < 1e-9 ? T_s : -std::expm1(-rate * T_s) / rate;
    return used_per_s_ * life * spread(tx) * spread(ty);
  });
  most_ = used_per_s_ * T_s;
}

std::vector<double> find_light(Consumption& A, const LightWanted& wanted, std::vector<double> start,
                               int steps, const ExecutionContext& context) {
  const std::size_t n = start.size();
  std::vector<double> x = std::move(start), y = x, gradient(n);
  const double length = 1 / (2 * A.most() * A.most());
  double t = 1;
  for (int step = 0; step < steps; ++step) {
    context.check_cancelled();
    context.report("finding light", static_cast<double>(step) / steps);
    gradient = y;
    A.apply(gradient, context);
    for (std::size_t k = 0; k < n; ++k) {
      const double u = gradient[k], want = wanted.used_up[k];
      gradient[k] = want >= 0  ? 2 * (u - want)
                    : want < 0 ? 2 * std::max(0.0, u - wanted.most_elsewhere)
                               : 0;
    }
    A.apply(gradient, context);
    const double next_t = (1 + std::sqrt(1 + 4 * t * t)) / 2, w = (t - 1) / next_t;
    double climbs = 0;
    for (std::size_t k = 0; k < n; ++k) {
      const double next = std::clamp(y[k] - length * gradient[k], wanted.least[k], wanted.most[k]);
      climbs += gradient[k] * (next - x[k]);
      y[k] = next + w * (next - x[k]);
      x[k] = next;
    }
    t = next_t;
    // Momentum begins anew where it would climb.
    if (climbs > 0) {
      t = 1;
      y = x;
    }
  }
  context.report("finding light", 1);
  return x;
}

}  // namespace slicecorr::detail
