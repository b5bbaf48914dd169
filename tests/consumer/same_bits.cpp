// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses that headers compute in an outside program have the bits that the library gives them, also
// where the program is compiled for processors that multiply and add in one rounding.
#include <cstdio>
#include <vector>

#include "slicecorr/cure.hpp"

namespace {

constexpr int kSteps = 100000;

double phi_of(int n) { return 0.01 + 1e-5 * n; }
double below_of(int n) { return 1.7 - 1.3e-5 * n; }

[[gnu::noinline]] std::vector<double> doses(const slicecorr::CureModel& model) {
  std::vector<double> doses(kSteps);
  for (int n = 0; n < kSteps; ++n) doses[n] = model.step(phi_of(n), below_of(n));
  return doses;
}

/// The same in two roundings: what is volatile is rounded before it is added.
[[gnu::noinline]] double rounded_twice(const slicecorr::CureModel& model, int n) {
  volatile double light = phi_of(n) * model.one_minus_a;
  volatile double left = model.a * below_of(n);
  return light + left;
}

}  // namespace

int main() {
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) {
    std::printf("0 other doses: this processor can't fuse\n");
    return 0;
  }
  slicecorr::CureModel model;
  model.a = 0.9261187281287935;
  model.one_minus_a = 1 - model.a;
  const std::vector<double> ours = doses(model);
  int others = 0;
  for (int n = 0; n < kSteps; ++n) others += ours[n] != rounded_twice(model, n);
  std::printf("%d other doses\n", others);
  return others == 0 ? 0 : 1;
}
