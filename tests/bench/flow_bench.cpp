// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resin flow under a disc of n cells across, on one thread: suction, a sweep, its adjoint, the best light.
// `numbers`: of 8 bytes that stay allocated, per cell.
#include <benchmark/benchmark.h>
#include <malloc.h>

#include "flow_shapes.hpp"

namespace slicecorr {
namespace {

double allocated_bytes() {
  const auto info = mallinfo2();
  return static_cast<double>(info.uordblks + info.hblkhd);
}

struct Problem {
  FlowSection section;
  GapPressure pressure;
  explicit Problem(const benchmark::State& state)
      : section(test::disc_section(10e3, static_cast<int>(state.range(0)))),
        pressure(solve_pressure(section)) {}
  SectionSweep sweep() const {
    const double gap = 80;
    return {section, pressure, test::chapter_iv_resin2(), 300, {&gap, 1}};
  }
  double cells() const {
    return static_cast<double>(
        std::count(section.cells.begin(), section.cells.end(), FlowCell::part));
  }
  void count(benchmark::State& state) const { state.counters["cells"] = cells(); }
};

void Pressure(benchmark::State& state) {
  const Problem p(state);
  for (auto _ : state) benchmark::DoNotOptimize(solve_pressure(p.section));
  p.count(state);
  state.counters["iterations"] = p.pressure.iterations;
}
BENCHMARK(Pressure)->Arg(64)->Arg(113)->Arg(357)->Arg(505)->Unit(benchmark::kMillisecond);

void Prepare(benchmark::State& state) {
  const Problem p(state);
  for (auto _ : state) benchmark::DoNotOptimize(p.sweep());
  p.count(state);
  const double before = allocated_bytes();
  const SectionSweep sweep = p.sweep();
  state.counters["numbers"] = (allocated_bytes() - before) / 8 / p.cells();
}
BENCHMARK(Prepare)->Arg(64)->Arg(113)->Unit(benchmark::kMillisecond);

void Dose(benchmark::State& state) {
  const Problem p(state);
  const SectionSweep sweep = p.sweep();
  const double blue = 164, uv = 275;
  for (auto _ : state) benchmark::DoNotOptimize(sweep.dose({&blue, 1}, {&uv, 1}));
  p.count(state);
}
BENCHMARK(Dose)->Arg(64)->Arg(113)->Unit(benchmark::kMillisecond);

void Adjoint(benchmark::State& state) {
  const Problem p(state);
  const SectionSweep sweep = p.sweep();
  const std::vector<double> weight(p.section.size(), 1.0);
  for (auto _ : state) benchmark::DoNotOptimize(sweep.adjoint(weight, weight));
  p.count(state);
}
BENCHMARK(Adjoint)->Arg(64)->Arg(113)->Unit(benchmark::kMillisecond);

void Optimise(benchmark::State& state) {
  const Problem p(state);
  SectionGoal goal;
  goal.pattern = static_cast<FlowPattern>(state.range(1));
  goal.max_blue_mw_cm2 = 200;
  goal.max_uv_mw_cm2 = 275;
  ExecutionContext one;
  one.threads = 1;
  for (auto _ : state) {
    const SectionOptimum o =
        optimise_section(p.section, p.pressure, test::chapter_iv_resin2(), 300, goal, one);
    state.counters["share"] = o.summary.within_10;
    state.counters["gap_um"] = o.gap_um;
  }
  p.count(state);
}
BENCHMARK(Optimise)
    ->Args({113, static_cast<int>(FlowPattern::constant)})
    ->Args({113, static_cast<int>(FlowPattern::blue)})
    ->Args({113, static_cast<int>(FlowPattern::both)})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace slicecorr
