// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/black_light.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "slicecorr/dose.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// So many black slices add up to what all would: beyond, light counts for nothing.
int reach(const CureModel& model) {
  if (model.gel_time()) return 2 * model.gel_time()->reach();
  constexpr double nothing = 40, most = 1e6;
  return static_cast<int>(std::min(most, std::ceil(nothing / model.least_fall())));
}

/// The same of doses that are no sums: by walking black slices up to the platform.
BlackLight most_black_by_walk(const CureModel& model, const std::vector<double>& ratios) {
  CureModel black = model;
  black.exposure_ratio = ratios;
  const std::uint8_t pixel = 0;
  BandDose dose(black, 1);
  BlackLight most;
  const int own = static_cast<int>(std::max(ratios.size(), model.own_a.size()));
  for (int n = own + reach(model); n-- > 0;) {
    dose.add_slice(n, &pixel);
    if (*dose.lower() > most.dose) most = {*dose.lower(), std::min(n, own)};
  }
  return most;
}

/// Whether lifts exchange resin that black light has reached; while nobody knows, they may.
bool exchanges(const CureModel& model) {
  return model.lifts && model.lifts->exchange.value_or(1) > 0;
}

}  // namespace

BlackLight most_black(const CureModel& model, const std::vector<double>& ratios) {
  const auto ratio = [&](std::size_t n) {
    return ratios.empty() ? 1.0 : n < ratios.size() ? ratios[n] : ratios.back();
  };
  const auto mirrored = static_cast<std::size_t>(model.mirrored_slices);
  if (exchanges(model) && !model.lifts->exchange) {
    // What a single exposure gels is sure to gel.
    BlackLight most;
    for (std::size_t n = 0; n <= std::max(ratios.size(), mirrored); ++n) {
      const double dose = model.phi_min() * ratio(n) * model.returned(static_cast<double>(n) + 1);
      if (dose > most.dose) most = {dose, static_cast<int>(n)};
    }
    return most;
  }
  if (!model.adds_up() || exchanges(model)) return most_black_by_walk(model, ratios);
  const std::size_t own = std::max(ratios.size(), model.own_a.size());
  const double left = 1.0 - model.a_of(static_cast<int>(own));
  const double steady = model.steady(model.phi_min() * ratio(own)) /
                        (model.heights.alike() ? model.one_minus_a : left);
  BlackLight most{steady, static_cast<int>(own)};
  double black = steady;
  const auto bath = static_cast<std::size_t>(model.bath_slices);
  for (std::size_t n = std::max(own, mirrored); n-- > 0;) {
    const double leaves = bath > 0 ? model.beyond * ratio(n + bath) : 0.0;
    black = model.phi_min() * (ratio(n) - leaves) +
            (model.heights.alike() ? model.a : model.a_of(static_cast<int>(n) + 1)) * black;
    // The dose of a layer is greatest beside its window.
    const double dose = black * model.returned(static_cast<double>(n) + 1);
    if (dose > most.dose) most = {dose, static_cast<int>(n)};
  }
  return most;
}

double alike_black(const CureModel& model) {
  if (exchanges(model) || !model.heights.alike()) return most_black(model, {}).dose;
  if (model.gel_time()) return most_black_by_walk(model, {}).dose;
  // A dose of 1 at the window stays if a slice adds what it loses in a layer.
  if (!model.adds_up()) return model.phi_min() / (1.0 - model.faded(1.0));
  // Beside the platform light that it sends back counts, too.
  return model.phi_min() * model.steady(model.returned(1)) / model.one_minus_a;
}

}  // namespace slicecorr::detail
