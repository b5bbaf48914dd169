// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Measures tomographic printing, a row of tab-separated numbers for each problem: name, goal,
/// processor seconds, seconds, VER, PW, C, bound. Rows of operators have the four last empty.
/// Usage: tomo_bench [--threads N] [--quick] [--only TEXT]; scripts/bench-tomo makes a table of it.

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <limits>
#include <string>

#include "slicecorr/tomo/solve.hpp"
#include "tomo_reference.hpp"

namespace {

using namespace slicecorr;
using namespace slicecorr::tomo;

struct Options {
  int threads = 1;
  bool quick = false;
  std::string only;
};

struct Clock {
  double cpu_s = 0, wall_s = 0;
  static Clock now() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return {
        static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec),
        std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count()};
  }
};

class Bench {
 public:
  explicit Bench(Options options) : options_(std::move(options)) {
    context_.threads = options_.threads;
  }

  bool wanted(const std::string& name) const {
    return options_.only.empty() || name.find(options_.only) != std::string::npos;
  }
  const ExecutionContext& context() const { return context_; }
  bool quick() const { return options_.quick; }

  /// The least of several runs.
  Clock least(int runs, const std::function<void()>& run) const {
    Clock least{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
    for (int i = 0; i < runs; ++i) {
      const Clock start = Clock::now();
      run();
      const Clock end = Clock::now();
      least.cpu_s = std::min(least.cpu_s, end.cpu_s - start.cpu_s);
      least.wall_s = std::min(least.wall_s, end.wall_s - start.wall_s);
    }
    return least;
  }

  void operators(const std::string& name, int slices, const RayTables& optics,
                 const std::string& goal_a, const std::string& goal_at) const {
    if (!wanted(name)) return;
    const TomoGrid grid = square_grid(256, 360, slices);
    const auto projector = make_projector(grid, optics);
    Field field(grid);
    Light light(grid);
    std::fill(field.values.begin(), field.values.end(), 1.0f);
    std::fill(light.values.begin(), light.values.end(), 1.0f);
    const int runs = slices == 1 ? 60 : 8;
    const Clock a =
        least(runs, [&] { projector->forward(0, field.values.data(), light.block(0), context_); });
    const Clock at =
        least(runs, [&] { projector->adjoint(0, light.block(0), field.values.data(), context_); });
    fmt::print("A, {}\t{}\t{:.5f}\t{:.5f}\t\t\t\t\n", name, goal_a, a.cpu_s, a.wall_s);
    fmt::print("A^T, {}\t{}\t{:.5f}\t{:.5f}\t\t\t\t\n", name, goal_at, at.cpu_s, at.wall_s);
    std::fflush(stdout);
  }

  void solved(const std::string& name, const std::string& goal, const Volume& part, double depth,
              const SolveOptions& how, const Volume* insert = nullptr) const {
    if (!wanted(name)) return;
    const RayTables optics{.alpha_per_mm = depth / part.grid.radius_mm};
    const Target target(part, insert);
    const Clock start = Clock::now();
    const auto shadow =
        insert == nullptr ? nullptr : std::make_shared<Shadow>(cast_shadow(*insert));
    const auto projector = make_projector(part.grid, optics, shadow);
    const Solution s = solve(context_, *projector, target, optics, how);
    const Clock end = Clock::now();
    const auto number = [](double x) { return std::isfinite(x) ? fmt::format("{:.4f}", x) : ""; };
    fmt::print("{}\t{}\t{:.3f}\t{:.3f}\t{:.5f}\t{:.3f}\t{}\t{}\n", name, goal,
               end.cpu_s - start.cpu_s, end.wall_s - start.wall_s, s.metrics.ver, s.metrics.pw,
               number(s.metrics.contrast), number(s.contrast_bound));
    std::fflush(stdout);
  }

 private:
  Options options_;
  ExecutionContext context_;
};

RayTables refracted() {
  RayTables tables{.alpha_per_mm = 0.5};
  for (int i = 0; i < 256; ++i) {
    const double q = (i - 127.5) / 127.5;
    tables.weight.push_back(1.4 - 0.5 * q * q);
    tables.turn_rad.push_back(0.5 * q);
  }
  return tables;
}

void measure_all(const Bench& bench) {
  bench.operators("one slice", 1, {}, ".0018", ".0012");
  bench.operators("one slice, attenuated", 1, {.alpha_per_mm = 1}, ".0032", ".0022");
  bench.operators("one slice, refracted", 1, refracted(), "", "");
  // G voxel-angles per second of the page, as seconds of 256^2 x 360 x 32.
  bench.operators("32 slices", 32, {}, ".042", ".024");
  bench.operators("32 slices, attenuated", 32, {.alpha_per_mm = 1}, ".069", ".042");

  const TomoGrid grid = square_grid(256, 360);
  const Volume one = t1(grid), two = t2(grid), three = t3(grid), insert = t3_insert(grid);
  bench.solved("T1, OSMO 20", ".15, VER 0", one, 0, osmo(20));
  bench.solved("T1, OSMO 50", ".38, VER 0", one, 0, osmo(50));
  bench.solved("T1, rung 0.8, 40 steps", ".12, PW .15", one, 0, rung(.8, 40));
  bench.solved("T2, rung 0.6, 40 steps", ".12, PW .30", two, 0, rung(.6, 40));
  bench.solved("T1, alpha R 1, rung 0.8, 60 steps", ".30, PW .15", one, 1, rung(.8, 60));
  bench.solved("T2, alpha R 1, rung 0.7, 35 steps", ".16, PW .25", two, 1, rung(.7, 35));
  bench.solved("T3 around its insert, OSMO 20", ".6", three, 0, osmo(20), &insert);
  const TomoGrid small = square_grid(64, 180, 64), large = square_grid(128, 180, 128);
  bench.solved("gyroid 64, OSMO 20", ".3, VER 0", gyroid(small), 0, osmo(20));
  bench.solved("gyroid 128, OSMO 20", "2, VER 0", gyroid(large), 0, osmo(20));

  bench.solved("T1, ladder", "2.5, PW .18", one, 0, {});
  bench.solved("T2, ladder", "2.5, PW .43", two, 0, {});
  bench.solved("T3 around its insert, ladder", "", three, 0, {}, &insert);
  bench.solved("T1, alpha R 0.5, ladder", "", one, .5, {});
  bench.solved("T2, alpha R 0.5, ladder", "", two, .5, {});
  bench.solved("T1, alpha R 1, ladder", "", one, 1, {});
  bench.solved("T2, alpha R 1, ladder", "", two, 1, {});
  bench.solved("gyroid 64, ladder", "", gyroid(small), 0, {});
  const TomoGrid half = square_grid(128, 180);
  bench.solved("T1, 128^2 x 180, alpha R 2, ladder", "C 1.006, bound 1.025", t1(half), 2, {});
  bench.solved("T2, 128^2 x 180, alpha R 2, ladder", "C 1.106, bound 1.133", t2(half), 2, {});
  bench.solved("T2, 128^2 x 180, alpha R 2.5, ladder", "bound .800", t2(half), 2.5, {});
  if (bench.quick()) return;
  bench.solved("T1, alpha R 2, ladder", "9, VER 0 or bound", one, 2, {});
  bench.solved("T2, alpha R 2, ladder", "2.5, C 1.11", two, 2, {});
  bench.solved("gyroid 64, alpha R 1, ladder", "", gyroid(small), 1, {});
  bench.solved("gyroid 128, ladder", "", gyroid(large), 0, {});
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--quick") {
      options.quick = true;
    } else if (word == "--threads" && i + 1 < argc) {
      options.threads = std::atoi(argv[++i]);
    } else if (word == "--only" && i + 1 < argc) {
      options.only = argv[++i];
    } else {
      fmt::print(stderr, "usage: tomo_bench [--threads N] [--quick] [--only TEXT]\n");
      return 2;
    }
  }
  measure_all(Bench(options));
  return 0;
}
