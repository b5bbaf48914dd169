// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/solve/best_light.hpp"

#include <algorithm>

namespace slicecorr::tomo::detail {

void scale(Array<float>& values, double factor) {
  for (float& v : values) v *= static_cast<float>(factor);
}

float largest(const Array<float>& values) {
  return *std::max_element(values.begin(), values.end());
}

void Best::resume(const Solution& best) {
  solution_ = best;
  solution_.metrics = measure(target_, best.dose);
  any_ = true;
}

void Best::offer(const Light& light, const Field& dose, const Metrics& m) {
  const Metrics& best = solution_.metrics;
  const bool better = m.ver < best.ver || (m.ver == best.ver && m.pw > best.pw);
  if (any_ && !better) return;
  any_ = true;
  solution_.light.values = light.values;
  solution_.dose.values = dose.values;
  solution_.metrics = m;
}

void Best::finish() {
  const double least = solution_.metrics.min_gel;
  if (!(least > 0)) return;
  scale(solution_.light.values, 1 / least);
  scale(solution_.dose.values, 1 / least);
  solution_.metrics = measure(target_, solution_.dose);
}

}  // namespace slicecorr::tomo::detail
