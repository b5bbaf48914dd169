#include "slicecorr/tomo/print.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/slice.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo {

namespace {

/// From the middle of a voxel of an n x n slice to the axis.
double distance_mm(int n, int x, int y, double voxel_mm) {
  return std::hypot(x - 0.5 * (n - 1), y - 0.5 * (n - 1)) * voxel_mm;
}

Volume volume_of(const TomoGrid& grid, const Box<std::uint8_t>& part) {
  Volume volume(grid);
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        volume.coverage[grid.voxel(x, y, z)] = part.values[part.at(z, y, x)];
      }
    }
  }
  return volume;
}

/// How often a solve uses A or A^T on a block, about: the ladder ends where a rung is missed.
double expected_calls(const SolveOptions& o, std::size_t blocks) {
  const auto steps = [&](int usual) { return static_cast<double>(o.steps > 0 ? o.steps : usual); };
  const auto each = static_cast<double>(blocks);
  switch (o.method) {
    case Method::kOsmo:
      return each * 4 * steps(20);
    case Method::kKelly:
      return each * (2 * steps(10) + 4);
    case Method::kFbp:
      return each * 3;
    case Method::kLadder:
      break;
  }
  return each * 2 * (steps(60) * static_cast<double>(o.rungs.size()) + o.proof_steps);
}

/// Reports each block that A or A^T has done as progress of the solve.
class ToldProjector final : public Projector {
 public:
  ToldProjector(std::unique_ptr<Projector> projector, const ExecutionContext& context,
                double expected)
      : projector_(std::move(projector)), context_(context), expected_(expected) {}
  const TomoGrid& grid() const override { return projector_->grid(); }
  void forward(std::size_t block, const float* field, float* light) const override {
    projector_->forward(block, field, light);
    tell();
  }
  void adjoint(std::size_t block, const float* light, float* field) const override {
    projector_->adjoint(block, light, field);
    tell();
  }

 private:
  void tell() const {
    const auto done = static_cast<double>(calls_.fetch_add(1, std::memory_order_relaxed) + 1);
    context_.report("solving", std::min(done / expected_, 0.99));
  }

  std::unique_ptr<Projector> projector_;
  const ExecutionContext& context_;
  double expected_;
  mutable std::atomic<std::int64_t> calls_{0};
};

/// What is computed on, and whether the part may lie there.
Bench bench_for(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
                const Resin& resin, const PrintOptions& options) {
  require_tomographic(printer);
  const double radius_mm = part_radius_mm(part, voxel_mm);
  const Sampling sampling{
      voxel_mm, part.nz,
      options.angles > 0 ? options.angles : usual_angles(printer, radius_mm, voxel_mm)};
  Bench bench = make_bench(printer, resin, sampling);
  const double limit_mm =
      options.beyond_reach ? bench.radius_mm : std::min(bench.reach_mm, bench.radius_mm);
  if (radius_mm > limit_mm) {
    throw InputError(fmt::format(
        "the part reaches {:.3f} mm from the axis, light from all directions {:.3f} mm; expected a "
        "part scaled by at most {:.4f}{}",
        radius_mm, limit_mm, limit_mm / radius_mm,
        radius_mm <= bench.radius_mm ? ", or leave to print beyond that reach" : ""));
  }
  return bench;
}

/// Whole turns until the weakest gel voxel has its dose, and what it needs by then.
struct Turns {
  int count = 0;
  double dose_mj_cm3 = 0;
};
Turns turns_for(const Bench& bench, double turn_mj_cm3) {
  const double back = bench.resupply_mj_cm3_s * bench.exposure.turn_s;
  if (!(turn_mj_cm3 > back)) {
    throw InfeasibleError(fmt::format(
        "inhibitor comes back as fast as light takes it: {:.4g} mJ/cm³ in a turn, of which the "
        "weakest voxel of the part gets {:.4g}; expected more light, or a slower turn",
        back, turn_mj_cm3));
  }
  const double turns =
      std::ceil(bench.exposure.critical_mj_cm3 / (turn_mj_cm3 - back) * (1 - 1e-9));
  if (!(turns < 1e9)) throw InfeasibleError("the part gets too little light to gel in any time");
  const int count = std::max(1, static_cast<int>(turns));
  return {count, bench.exposure.critical_mj_cm3 + back * count};
}

}  // namespace

Box<std::uint8_t> voxelise(TriangleMesh mesh, const Printer& printer, double voxel_mm,
                           const ExecutionContext& context) {
  // The slicer's display is the square of voxels around the resin.
  Printer plate;
  plate.name = printer.name;
  plate.width_px = plate.height_px = voxels_across(printer, voxel_mm);
  plate.pixel_x_um = plate.pixel_y_um = voxel_mm * 1e3;
  plate.bit_depth = 8;
  SliceOptions options;
  options.layer_um = voxel_mm * 1e3;
  const MeshSlices slices(std::move(mesh), plate, options, context);
  const int n = plate.width_px;
  Box<std::uint8_t> part{slices.grid().layers, n, n, {}};
  part.values.assign(
      static_cast<std::size_t>(part.nz) * static_cast<std::size_t>(n) * static_cast<std::size_t>(n),
      0);
  const PixelBox whole{0, 0, n, n};
  slices.read_band(whole, [&](int z, const std::uint8_t* rows) {
    if (!rows) return;
    // Image rows run from the largest y down.
    for (int row = 0; row < n; ++row) {
      std::copy_n(rows + static_cast<std::ptrdiff_t>(row) * n, n,
                  &part.values[part.at(z, n - 1 - row, 0)]);
    }
  });
  return part;
}

Box<std::uint8_t> placed(const Box<std::uint8_t>& volume, const Printer& printer, double voxel_mm) {
  require_tomographic(printer);
  if (volume.nx != volume.ny) {
    throw InputError(
        fmt::format("the volume is {} x {} voxels across; expected as many along x as "
                    "along y",
                    volume.nx, volume.ny));
  }
  const int n = voxels_across(printer, voxel_mm);
  // An even volume has no voxel on the axis: its voxels lie half a voxel beside those of the grid.
  const int shift = (n - volume.nx - (n - volume.nx) % 2) / 2;
  Box<std::uint8_t> part{volume.nz, n, n, {}};
  part.values.assign(
      static_cast<std::size_t>(part.nz) * static_cast<std::size_t>(n) * static_cast<std::size_t>(n),
      0);
  for (int z = 0; z < volume.nz; ++z) {
    for (int y = 0; y < volume.ny; ++y) {
      for (int x = 0; x < volume.nx; ++x) {
        const std::uint8_t value = volume.values[volume.at(z, y, x)];
        if (value == 0) continue;
        const int px = x + shift, py = y + shift;
        if (px < 0 || px >= n || py < 0 || py >= n) {
          throw InputError(fmt::format(
              "voxel {}, {}, {} of the volume lies {:.3f} mm from the axis, the resin ends at {:g} "
              "mm; expected a smaller part, or smaller voxels",
              x, y, z, distance_mm(n, px, py, voxel_mm), printer.vial->inner_mm));
        }
        part.values[part.at(z, py, px)] = value;
      }
    }
  }
  return part;
}

double part_radius_mm(const Box<std::uint8_t>& part, double voxel_mm) {
  double radius = 0;
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        if (part.values[part.at(z, y, x)] == 0) continue;
        radius = std::max(radius, distance_mm(part.nx, x, y, voxel_mm));
      }
    }
  }
  return radius;
}

Bench check_print(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
                  const Resin& resin, const PrintOptions& options) {
  Bench bench = bench_for(part, voxel_mm, printer, resin, options);
  const Target target(volume_of(bench.grid, part));
  return bench;
}

Print solve_print(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
                  const Resin& resin, const PrintOptions& options,
                  const ExecutionContext& context) {
  const Bench bench = bench_for(part, voxel_mm, printer, resin, options);
  TomoJob job;
  job.printer = printer;
  job.resin = resin;
  job.sampling = {voxel_mm, part.nz, bench.grid.angles};
  const Target target(volume_of(bench.grid, part));
  const ToldProjector projector(make_projector(bench.grid, bench.rays), context,
                                expected_calls(options.solve, bench.grid.blocks()));
  // The solve is told of as a whole, none of its sums over angles by itself.
  const ExecutionContext quiet = detail::silent(context);
  SolveOptions how = options.solve;
  how.checkpoint = [&](const Light& light, double next_rung) {
    if (options.solve.checkpoint) options.solve.checkpoint(light, next_rung);
    if (how.method == Method::kLadder && next_rung < 1) {
      context.tell(fmt::format("next: void below {:g} of the gel dose", next_rung));
    }
  };
  Solution solution = solve(quiet, projector, target, bench.rays, how);
  context.report("solving", 1);
  if (solution.contrast_bound < 1) {
    throw InfeasibleError(fmt::format(
        "no light prints this part: where it is hardest, in slice {} ({:.3f} mm above the optical "
        "axis), void gets at least 1/{:.4f} of the part's least dose, whatever is shown; expected "
        "less absorption (alpha R is {:.3g}), or a part with more room",
        solution.bound_slice, (solution.bound_slice - 0.5 * (part.nz - 1)) * voxel_mm,
        solution.contrast_bound, bench.alpha_r));
  }

  // The light as bright as the projector can show it gives the number of turns; then as bright as
  // they need.
  const auto& values = solution.light.values;
  const double largest = *std::max_element(values.begin(), values.end());
  const double per_unit = dose_of_turn(bench.grid, bench.exposure);
  const double brightest = bench.mw_cm2.back() / largest;
  const Turns turns = turns_for(bench, per_unit * brightest);
  job.turns = turns.count;
  Exposure exposure = bench.exposure;
  exposure.critical_mj_cm3 = turns.dose_mj_cm3;
  exposure.most_time_s = options.most_time_s;
  Field full = solution.dose;
  for (float& d : full.values) d = static_cast<float>(d * brightest);
  const PrintTime time = plan_time(quiet, projector, target, full, exposure);

  // Rounding to levels, and the direct sum, which weighs light otherwise, may find the weakest voxel a
  // little short: a little more for all, or a turn more.
  job.part = part;
  double scale = brightest * time.scale;
  PrintFigures figures;
  constexpr int rounds = 8;
  int round = 0;
  ExecutionContext judging = quiet;
  judging.progress = [&](std::string_view, double done) {
    context.report("judging", std::min((round + done) / rounds, 0.99));
  };
  for (; round < rounds; ++round) {
    job.levels = nearest_levels(solution.light, scale, bench.mw_cm2);
    figures = figures_of(job, dose_of(job, judging), part, quiet);
    const double short_by = figures.gel_dose_mj_cm3 / figures.metrics.min_gel;
    if (short_by <= 1) break;
    scale *= short_by + 1e-4;
    if (scale <= brightest) continue;
    scale *= static_cast<double>(job.turns) / (job.turns + 1);
    ++job.turns;
  }
  context.report("judging", 1);

  Print print;
  print.history = std::move(solution.history);
  print.job = std::move(job);
  print.figures = figures;
  print.figures.contrast_bound = solution.contrast_bound;
  return print;
}

PrintFigures figures_of(const TomoJob& job, const Box<float>& dose, const Box<std::uint8_t>& part,
                        const ExecutionContext& context) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const Target target(volume_of(bench.grid, part));
  Field field(bench.grid);
  for (int z = 0; z < dose.nz; ++z) {
    for (int y = 0; y < dose.ny; ++y) {
      for (int x = 0; x < dose.nx; ++x) {
        field.values[bench.grid.voxel(x, y, z)] = dose.values[dose.at(z, y, x)];
      }
    }
  }
  PrintFigures f;
  f.turns = job.turns;
  f.print_time_s = job.turns * bench.exposure.turn_s;
  f.gel_dose_mj_cm3 = bench.exposure.critical_mj_cm3 + bench.resupply_mj_cm3_s * f.print_time_s;
  f.metrics = measure(target, field);
  f.jaccard_at_dose = jaccard(target, field, f.gel_dose_mj_cm3);
  f.efficiency = efficiency(light_of_levels(bench.grid, job.levels, bench.mw_cm2));
  f.alpha_r = bench.alpha_r;
  // Black frames throughout.
  const std::vector<std::uint16_t> black(job.levels.size(), 0);
  const Field floor = adjoint(*make_projector(bench.grid, bench.rays), context,
                              light_of_levels(bench.grid, black, bench.mw_cm2));
  f.floor_mj_cm3 = *std::max_element(floor.values.begin(), floor.values.end()) *
                   dose_of_turn(bench.grid, bench.exposure) * job.turns;
  return f;
}

std::string PrintFigures::to_json() const {
  const auto finite = [](double v) {
    return std::isfinite(v) ? nlohmann::ordered_json(v) : nlohmann::ordered_json(nullptr);
  };
  nlohmann::ordered_json j;
  j["feasible"] = feasible();
  j["ver"] = metrics.ver;
  j["pw"] = metrics.pw;
  j["trimmed_pw"] = metrics.trimmed_pw;
  j["ipdr"] = metrics.ipdr;
  j["jaccard"] = {{"best", metrics.best_jaccard}, {"dose", jaccard_at_dose}};
  j["contrast"] = finite(metrics.contrast);
  j["contrast_bound"] = finite(contrast_bound);
  j["efficiency"] = efficiency;
  j["turns"] = turns;
  j["print_time_s"] = print_time_s;
  j["alpha_r"] = alpha_r;
  j["gel_voxels"] = metrics.gel;
  j["void_voxels"] = metrics.empty;
  j["dose_mj_cm3"] = {{"to_gel", gel_dose_mj_cm3},
                      {"min_gel", metrics.min_gel},
                      {"max_gel", metrics.max_gel},
                      {"max_void", metrics.max_void},
                      {"floor", floor_mj_cm3}};
  return j.dump(2);
}

}  // namespace slicecorr::tomo
