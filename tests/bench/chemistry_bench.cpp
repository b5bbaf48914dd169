// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Cell steps of photochemistry per second on one thread: reactions alone, with diffusion in the plane, and CVODE on the
// same cell. A cell step is one cell over one step of 10 ms, of which CVODE takes many of its own.
#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

#include "chemistry/reaction_kernels.hpp"
#include "cvode_peer.hpp"
#include "slicecorr/chemistry_cell.hpp"
#include "slicecorr/chemistry_pattern.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {
namespace {

constexpr double kStep = 0.01, kIntensity = 100;

const Chemistry& hydrogel() {
  static const Chemistry c =
      *load_resin(SLICECORR_SOURCE_DIR "/resins/db/model-hydrogel.toml").chemistry;
  return c;
}

/// 4096 lit cells from the start to 3 s: inhibited, then curing.
void Reactions(benchmark::State& state) {
  constexpr std::size_t n = 4096;
  constexpr int steps = 300;
  const Chemistry& c = hydrogel();
  detail::ReactionStep step = detail::reaction_of(c);
  step.h = kStep;
  const std::vector<double> broken(n, -std::expm1(-initiation_per_s(c, kIntensity) * kStep / 2));
  for (auto _ : state) {
    std::vector<double> I(n, c.initiator_mol_l), Ir(n), P0(n, c.groups_mol_l), P1(n), P2(n), P3(n),
        O(n, c.oxygen_mol_l), gel(n);
    const detail::CellArrays cells{I.data(),  Ir.data(), P0.data(), P1.data(),
                                   P2.data(), P3.data(), O.data(),  nullptr};
    for (int k = 0; k < steps; ++k)
      detail::react(step, broken.data(), cells, n, gel.data(), nullptr);
    benchmark::DoNotOptimize(gel.data());
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) * n * steps);
}
BENCHMARK(Reactions)->Unit(benchmark::kMillisecond);

/// 1600 x 900 um at 5 um, half of it lit in stripes, for 2 s.
void Pattern(benchmark::State& state) {
  LightPattern p{320, 180, std::vector<float>(320 * 180, 0.0F)};
  for (std::size_t k = 0; k < p.share.size(); ++k) p.share[k] = k % 20 < 10 ? 1.0F : 0.0F;
  PatternSetup s;
  s.cell_um = 5;
  s.intensity_mw_cm2 = kIntensity;
  s.light_s = 2;
  s.step_s = kStep;
  ExecutionContext one;
  one.threads = 1;
  std::size_t steps = 0;
  for (auto _ : state) steps += run_pattern(hydrogel(), p, s, one).steps;
  state.SetItemsProcessed(static_cast<std::int64_t>(steps * p.share.size()));
}
BENCHMARK(Pattern)->Unit(benchmark::kMillisecond);

/// One cell over 3 s to a relative error of 1e-6.
void Cvode(benchmark::State& state) {
  for (auto _ : state) {
    test::CvodePeer peer(hydrogel(), {kIntensity}, 1, 0, 1e-6);
    peer.advance_to(3);
    benchmark::DoNotOptimize(peer.at(0, test::CvodePeer::P0));
  }
  state.SetItemsProcessed(
      static_cast<std::int64_t>(static_cast<double>(state.iterations()) * 3 / kStep));
}
BENCHMARK(Cvode)->Unit(benchmark::kMillisecond);

/// The same by our own steps of a single cell.
void OneCell(benchmark::State& state) {
  CellQuestion q;
  q.light = {{3, kIntensity}};
  q.tolerance = 1e-4;
  for (auto _ : state) benchmark::DoNotOptimize(run_cell(hydrogel(), q).gel_time_s);
  state.SetItemsProcessed(
      static_cast<std::int64_t>(static_cast<double>(state.iterations()) * 3 / kStep));
}
BENCHMARK(OneCell)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace slicecorr
