/// Measures tomographic printing: seconds of one thread for the operators and the solvers, one row
/// each. Usage: tomo_bench [all]; `all` adds what takes long.

#include <fmt/format.h>

#include <ctime>
#include <functional>
#include <limits>
#include <string>

#include "slicecorr/tomo/solve.hpp"
#include "tomo_reference.hpp"

namespace {

using namespace slicecorr;
using namespace slicecorr::tomo;

double cpu_s() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// The least of several runs.
double least_s(int runs, const std::function<void()>& run) {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < runs; ++i) {
    const double start = cpu_s();
    run();
    least = std::min(least, cpu_s() - start);
  }
  return least;
}

void operators(int slices, double alpha, const std::string& name,
               const RayTables* optics = nullptr) {
  const TomoGrid grid = square_grid(256, 360, slices);
  RayTables own{.alpha_per_mm = alpha};
  const auto projector = make_projector(grid, optics == nullptr ? own : *optics);
  Field field(grid);
  Light light(grid);
  std::fill(field.values.begin(), field.values.end(), 1.0f);
  const int runs = slices == 1 ? 40 : 4;
  ExecutionContext one;
  one.threads = 1;
  const double a = least_s(runs, [&] { projector->forward(0, field.block(0), light.block(0), one); });
  const double at = least_s(runs, [&] { projector->adjoint(0, light.block(0), field.block(0), one); });
  const double work = 256.0 * 256 * 360 * slices * 1e-9;
  fmt::print("{:44} A {:.4f} s ({:.1f} G/s)  A^T {:.4f} s ({:.1f} G/s)\n", name, a, work / a, at,
             work / at);
}

struct Run {
  std::string name;
  Volume part;
  double depth = 0;
  SolveOptions options = {};
  const Volume* insert = nullptr;
};

void solved(const Run& run) {
  ExecutionContext context;
  context.threads = 1;
  const RayTables optics{.alpha_per_mm = run.depth / run.part.grid.radius_mm};
  const Target target(run.part, run.insert);
  const double start = cpu_s();
  const auto shadow =
      run.insert == nullptr ? nullptr : std::make_shared<Shadow>(cast_shadow(*run.insert));
  const auto projector = make_projector(run.part.grid, optics, shadow);
  const Solution s = solve(context, *projector, target, optics, run.options);
  fmt::print("{:44} {:.3f} s  VER {:.5f}  PW {:.3f}  C {:.4f}  bound {:.4f}  mean/max {:.3f}\n",
             run.name, cpu_s() - start, s.metrics.ver, s.metrics.pw, s.metrics.contrast,
             s.contrast_bound, efficiency(s.light));
}

}  // namespace

int main(int argc, char** argv) {
  const bool all = argc > 1 && std::string(argv[1]) == "all";
  operators(1, 0, "one slice");
  operators(1, 1, "one slice, attenuated");
  operators(32, 0, "32 slices");
  operators(32, 1, "32 slices, attenuated");
  RayTables refracted{.alpha_per_mm = 0.5};
  for (int i = 0; i < 256; ++i) {
    const double q = (i - 127.5) / 127.5;
    refracted.weight.push_back(1.4 - 0.5 * q * q);
    refracted.turn_rad.push_back(0.5 * q);
  }
  operators(1, 0, "one slice, refracted", &refracted);

  const TomoGrid grid = square_grid(256, 360);
  const Volume one = t1(grid), two = t2(grid), insert = t3_insert(grid);
  solved({"T1, OSMO 20", one, 0, osmo(20)});
  solved({"T1, OSMO 50", one, 0, osmo(50)});
  solved({"T2, OSMO 20", two, 0, osmo(20)});
  solved({"T1, rung 0.8, 40 steps", one, 0, rung(.8, 40)});
  solved({"T2, rung 0.6, 40 steps", two, 0, rung(.6, 40)});
  solved({"T1, alpha R 1, rung 0.8, 60 steps", one, 1, rung(.8, 60)});
  solved({"T2, alpha R 1, rung 0.7, 35 steps", two, 1, rung(.7, 35)});
  solved({"T3 around its insert, OSMO 20", t3(grid), 0, osmo(20), &insert});
  TomoGrid cube = square_grid(64, 180, 64);
  solved({"gyroid 64, OSMO 20", gyroid(cube), 0, osmo(20)});
  if (!all) return 0;
  solved({"T1, ladder", one, 0});
  solved({"T2, ladder", two, 0});
  solved({"T1, alpha R 2, ladder", one, 2});
  solved({"T2, alpha R 2, ladder", two, 2});
  cube = square_grid(128, 180, 128);
  solved({"gyroid 128, OSMO 20", gyroid(cube), 0, osmo(20)});
  solved({"gyroid 128, rung 0.9", gyroid(cube), 0, rung(.9, 40)});
  return 0;
}
