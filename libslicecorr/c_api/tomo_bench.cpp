// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Benches of tomographic printing and their operators.

#include "c_api/tomo_bench.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/filter.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::c_api {

namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

struct BenchProperty {
  const char *name, *what;
  double (*value)(const BenchFacts&);
};

const BenchProperty kBenchProperties[] = {
    {"voxels", "voxels along x and along y",
     [](const BenchFacts& b) { return double(b.grid.voxels); }},
    {"slices", "slices along z", [](const BenchFacts& b) { return double(b.grid.slices); }},
    {"rows", "rows of light: the slices, or where these share light those of the image",
     [](const BenchFacts& b) { return double(b.grid.light_rows()); }},
    {"angles", "frames of a turn", [](const BenchFacts& b) { return double(b.grid.angles); }},
    {"pixels", "pixels along t", [](const BenchFacts& b) { return double(b.grid.pixels); }},
    {"radius_mm", "distance of the outermost voxels from the axis",
     [](const BenchFacts& b) { return b.grid.radius_mm; }},
    {"voxel_mm", "side of a voxel", [](const BenchFacts& b) { return b.grid.voxel_mm(); }},
    {"pixel_mm", "from one pixel's line to the next, in the resin",
     [](const BenchFacts& b) { return b.grid.pixel_mm; }},
    {"absorption_per_cm", "of the resin, base e",
     [](const BenchFacts& b) { return 10 * b.alpha_per_mm; }},
    {"alpha_r", "absorption times the resin's radius",
     [](const BenchFacts& b) {
       return b.printed ? b.printed->alpha_r : b.alpha_per_mm * b.grid.radius_mm;
     }},
    {"reach_mm", "radius up to which light comes from all directions",
     [](const BenchFacts& b) { return b.printed ? b.printed->reach_mm : kUnknown; }},
    {"turn_s", "time of a turn",
     [](const BenchFacts& b) { return b.printed ? b.printed->exposure.turn_s : kUnknown; }},
    {"turn_mj_cm3", "dose of one turn for each unit of A^T of light in mW/cm²",
     [](const BenchFacts& b) {
       return b.printed ? tomo::dose_of_turn(b.grid, b.printed->exposure) : kUnknown;
     }},
    {"to_gel_mj_cm3", "dose that gels",
     [](const BenchFacts& b) {
       return b.printed ? b.printed->exposure.critical_mj_cm3 : kUnknown;
     }},
    {"black_mw_cm2", "of the darkest grey level",
     [](const BenchFacts& b) { return b.printed ? b.printed->mw_cm2.front() : kUnknown; }},
    {"most_mw_cm2", "of the brightest grey level",
     [](const BenchFacts& b) { return b.printed ? b.printed->mw_cm2.back() : kUnknown; }},
};

/// The projector, whose light the insert ends.
void complete(slicecorr_tomo_bench& bench, const slicecorr_array* insert) {
  std::optional<tomo::Volume> opaque;
  if (insert) opaque = volume_of(bench.grid, ArrayView(insert, "insert", Elements::bytes, false));
  if (bench.printed) {
    bench.projector = tomo::make_projector(*bench.printed, opaque ? &*opaque : nullptr);
    return;
  }
  bench.projector = tomo::make_projector(
      bench.grid, bench.rays,
      opaque ? std::make_shared<tomo::Shadow>(tomo::cast_shadow(*opaque)) : nullptr);
}

std::unique_ptr<slicecorr_tomo_bench> bench_of_numbers(const slicecorr_tomo_grid& given) {
  check_struct(given, "slicecorr_tomo_grid");
  auto bench = std::make_unique<slicecorr_tomo_bench>();
  TomoGrid& grid = bench->grid;
  grid.voxels = given.voxels;
  grid.slices = given.slices;
  grid.angles = given.angles;
  grid.pixels = given.pixels == 0 ? given.voxels : given.pixels;
  grid.radius_mm = given.radius_mm;
  grid.pixel_mm = given.pixel_mm == 0 ? grid.voxel_mm() : given.pixel_mm;
  grid.check();
  bench->rays.alpha_per_mm = given.absorption_per_cm / 10;
  return bench;
}

std::unique_ptr<slicecorr_tomo_bench> bench_of_setup(const slicecorr_setup& setup, int slices) {
  const auto [printer, resin] = chosen_definitions(setup.choices, ChoiceNames::fields);
  require_tomographic(printer);
  tomo::Sampling sampling;
  sampling.voxel_mm = voxel_mm_of(setup);
  sampling.slices = slices;
  sampling.angles = setup.choices.angles;
  if (slices < 1 || slices > tomo::kMostAlongAxis) {
    throw InputError(fmt::format("slices is {}; expected 1 to {}", slices, tomo::kMostAlongAxis));
  }
  if (sampling.angles <= 0) {
    const double radius_mm = printer.vial->traced() ? printer.vial->inner_mm
                                                    : std::min(reach_mm(printer, index_of(resin)),
                                                               printer.vial->inner_mm);
    sampling.angles = tomo::usual_angles(printer, radius_mm, sampling.voxel_mm);
  }
  auto bench = std::make_unique<slicecorr_tomo_bench>();
  bench->printed = tomo::make_bench(printer, resin, sampling);
  bench->grid = bench->printed->grid;
  bench->rays = bench->printed->rays;
  return bench;
}

/// A block of slices that an operator works on.
struct Block {
  std::size_t number, first_slice;
  int slices;
  BlockMemory::Lease& memory;
  const ExecutionContext& context;
};

/// Rows of its light.
int rows_of(const TomoGrid& grid, const Block& block) {
  return grid.coupled() ? grid.rows : block.slices;
}

/// Runs an operator on each block.
template <class Operator>
void run_blocks(const slicecorr_tomo_bench& bench, slicecorr_job* job, const char* stage,
                const Operator& block) {
  const ExecutionContext context = job_of(job);
  const TomoGrid& grid = bench.grid;
  const ExecutionContext inside = tomo::inside_block(context, grid.blocks());
  parallel_for(context, stage, grid.blocks(), [&](std::size_t b) {
    BlockMemory::Lease memory(bench.memory, grid);
    block(Block{b, b * static_cast<std::size_t>(grid.lanes()), grid.lanes_used(b), memory, inside});
  });
  context.check_cancelled();
}

}  // namespace

BlockMemory::Lease::Lease(BlockMemory& home, const TomoGrid& grid) : home_(home) {
  {
    const std::scoped_lock lock(home_.mutex_);
    if (!home_.free_.empty()) {
      pair_ = std::move(home_.free_.back());
      home_.free_.pop_back();
      return;
    }
  }
  pair_ = std::make_unique<Pair>();
  pair_->field.resize(grid.voxels_of_block());
  pair_->light.resize(grid.light_of_block());
}

BlockMemory::Lease::~Lease() {
  try {
    const std::scoped_lock lock(home_.mutex_);
    home_.free_.push_back(std::move(pair_));
  } catch (...) {
    // Without memory for the list this pair is freed.
    pair_.reset();
  }
}

ArrayView::Shape volume_shape(const TomoGrid& grid) {
  return {static_cast<std::size_t>(grid.slices), static_cast<std::size_t>(grid.voxels),
          static_cast<std::size_t>(grid.voxels)};
}

ArrayView::Shape light_shape(const TomoGrid& grid) {
  return {static_cast<std::size_t>(grid.light_rows()), static_cast<std::size_t>(grid.angles),
          static_cast<std::size_t>(grid.pixels)};
}

void write_light(const tomo::Light& light, const ArrayView& to) {
  const TomoGrid& grid = light.grid;
  for (std::size_t b = 0; b < grid.blocks(); ++b) {
    to.write(b * static_cast<std::size_t>(grid.lanes()),
             grid.coupled() ? grid.rows : grid.lanes_used(b), grid.light_lanes(), light.block(b));
  }
}

std::optional<double> bench_number(const BenchFacts& facts, std::string_view name) {
  for (const BenchProperty& p : kBenchProperties) {
    if (p.name == name) return p.value(facts);
  }
  return std::nullopt;
}

Names bench_property_names() {
  Names names;
  for (const BenchProperty& p : kBenchProperties) names.emplace_back(p.name, p.what);
  return names;
}

tomo::Volume volume_of(const TomoGrid& grid, const ArrayView& bytes) {
  bytes.need_shape(volume_shape(grid), kVolumeAxes);
  const tomo::Box<std::uint8_t> box = bytes.bytes();
  tomo::Volume volume(grid);
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = 0; y < grid.voxels; ++y) {
      for (int x = 0; x < grid.voxels; ++x) {
        volume.coverage[grid.voxel(x, y, z)] = box.values[box.at(z, y, x)];
      }
    }
  }
  return volume;
}

double voxel_mm_of(const slicecorr_setup& setup) {
  if (setup.choices.voxel_mm > 0) return setup.choices.voxel_mm;
  throw InputError("no size of voxels; expected voxel_mm");
}

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;

slicecorr_status slicecorr_tomo_bench_create(const slicecorr_tomo_grid* grid,
                                             const slicecorr_array* insert,
                                             slicecorr_tomo_bench** bench) {
  return guarded(nullptr, [&] {
    Output output(bench, "bench");
    auto made = bench_of_numbers(need(grid, "grid"));
    complete(*made, insert);
    output.give(std::move(made));
  });
}

slicecorr_status slicecorr_tomo_bench_new(const slicecorr_setup* setup, int slices,
                                          const slicecorr_array* insert,
                                          slicecorr_tomo_bench** bench) {
  return guarded(nullptr, [&] {
    Output output(bench, "bench");
    auto made = bench_of_setup(need(setup, "setup"), slices);
    complete(*made, insert);
    output.give(std::move(made));
  });
}

void slicecorr_tomo_bench_free(slicecorr_tomo_bench* bench) { delete bench; }

slicecorr_status slicecorr_tomo_bench_number(const slicecorr_tomo_bench* bench, const char* name,
                                             double* value) {
  return guarded(nullptr, [&] {
    const slicecorr_tomo_bench& b = need(bench, "bench");
    need(value, "value");
    const auto found = bench_number(
        {b.grid, b.rays.alpha_per_mm, b.printed ? &*b.printed : nullptr}, &need(name, "name"));
    if (!found) unknown_name(name, "property", bench_property_names());
    *value = *found;
  });
}

slicecorr_status slicecorr_tomo_forward(const slicecorr_tomo_bench* bench,
                                        const slicecorr_array* volume, const slicecorr_array* light,
                                        slicecorr_job* job) {
  return guarded(error_of(job), [&] {
    const slicecorr_tomo_bench& b = need(bench, "bench");
    const ArrayView from(volume, "volume", Elements::floats, false);
    const ArrayView to(light, "light", Elements::floats, true);
    from.need_shape(volume_shape(b.grid), kVolumeAxes);
    to.need_shape(light_shape(b.grid), kLightAxes);
    run_blocks(b, job, "project", [&](const auto& block) {
      float *const field = block.memory.field(), *const lines = block.memory.light();
      from.read(block.first_slice, block.slices, b.grid.lanes(), field);
      b.projector->forward(block.number, field, lines, block.context);
      to.write(block.first_slice, rows_of(b.grid, block), b.grid.light_lanes(), lines);
    });
  });
}

slicecorr_status slicecorr_tomo_adjoint(const slicecorr_tomo_bench* bench,
                                        const slicecorr_array* light, const slicecorr_array* volume,
                                        slicecorr_job* job) {
  return guarded(error_of(job), [&] {
    const slicecorr_tomo_bench& b = need(bench, "bench");
    const ArrayView from(light, "light", Elements::floats, false);
    const ArrayView to(volume, "volume", Elements::floats, true);
    from.need_shape(light_shape(b.grid), kLightAxes);
    to.need_shape(volume_shape(b.grid), kVolumeAxes);
    run_blocks(b, job, "add up", [&](const auto& block) {
      float *const field = block.memory.field(), *const lines = block.memory.light();
      from.read(block.first_slice, rows_of(b.grid, block), b.grid.light_lanes(), lines);
      b.projector->adjoint(block.number, lines, field, block.context);
      to.write(block.first_slice, block.slices, b.grid.lanes(), field);
    });
  });
}

slicecorr_status slicecorr_tomo_filtered_start(const slicecorr_tomo_bench* bench,
                                               const slicecorr_array* part, const char* window,
                                               const slicecorr_array* light, slicecorr_job* job) {
  return guarded(error_of(job), [&] {
    const slicecorr_tomo_bench& b = need(bench, "bench");
    const ArrayView from(part, "part", Elements::bytes, false);
    const ArrayView to(light, "light", Elements::floats, true);
    to.need_shape(light_shape(b.grid), kLightAxes);
    const auto filter =
        window ? slicecorr::tomo::window_named(window) : slicecorr::tomo::Window::hamming;
    const slicecorr::ExecutionContext context = job_of(job);
    const slicecorr::tomo::Target target(volume_of(b.grid, from));
    const slicecorr::tomo::Light start =
        slicecorr::tomo::filtered_start(context, target, b.rays, filter);
    write_light(start, to);
    context.check_cancelled();
  });
}
