// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/memory_need.hpp"

#include <algorithm>
#include <cmath>

#include "correct/inhibited_plan.hpp"
#include "correct/solved_columns.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

namespace {

/// Bytes.
constexpr double kMb = 1 << 20;

/// Half as much again as was seen; and what programs keep of memory that was given back, for the next band: of a lattice
/// 295 MB were taken where the sum is 264, with two threads 417 where it is 323.
constexpr double kToBeSure = 1.5, kKeptForNext = 1.3;

/// Of any job: 31 are the cells of the report.
constexpr double kProgramMb = 70;

/// Curves of the plans of one value of light, beside its levels: 2 of 8 bytes a slice.
constexpr double kPlanBytes = 16 * 1024, kPlanBytesPerSlice = 16;
/// A band's columns are taken apart by their light: slices before and after, run-length coded, for
/// each value. Seen: 250 bytes with 156 values side by side in all bands.
constexpr double kLightBytesPerSlice = 256;
/// Two sets of models are in use while the report is made. One of them has plans, whose own tables
/// are 4 for each 5 of the model.
constexpr double kTableSets = 2.8;
/// In each thread, the doses before and after of the columns of a band that are drawn have tables
/// of their own for each value: as many as the model, and their running sums.
constexpr double kTableSetsPerThread = 4;
/// Lamps that change by themselves from slice to slice take so few settings, mostly.
constexpr int kLampSettings = 30;

/// Rows of a band at most, and what is kept of each of its columns where they are solved one by one: its
/// runs and changes of levels, and, of each slice in the bath, what the corrected and the uncorrected
/// prediction hold. Searches of a plan, and the plan.
constexpr double kBandRows = 32, kColumnBytes = 320, kCutBytes = 200, kBathBytes = 2,
                 kSearchBytes = 256 * 1024;

/// Tables of all models of a display: `PlaceModels` lets up to 64 neighbouring values share one
/// where they would take more than 256 MiB.
double all_tables_bytes(const MemoryFacts& f) {
  const double least = std::ceil(f.lights / 64.0) * f.tables_bytes;
  return std::min(f.lights * f.tables_bytes, std::max(256 * kMb, least) + f.tables_bytes);
}

/// What hangs together is looked for in all predictions: changes of voxels are kept, at most so much (more
/// waits on the disk), and of a band at work each change of each column. Seen of a lattice, the most
/// there is: 340 bytes a column. While it is followed, runs of a slice and what waits to gel: seen of a
/// lattice on 7.9 million columns, 15 bytes for each column of its box.
constexpr double kBodiesMb = 16, kBodiesBytesPerVoxel = 0.05, kBodiesColumnBytes = 384,
                 kFollowedColumnBytes = 16;

/// A solved column that is kept; most take some hundred.
constexpr double kSolvedBytes = 2048;

/// Where columns are corrected together: 64 MB of what is kept while rounds go on, the rest of which
/// waits on the disk, and the patches of a thread.
constexpr double kTogetherMb = 80;

}  // namespace

bool corrects_together(const Setup& setup) {
  return light_spreads(setup.printer, setup.resin, setup.process) &&
         setup.process.spread_rounds > 0;
}

MemoryNeeds memory_needs(const MemoryFacts& f) {
  const double mesh = 100.0 * static_cast<double>(f.triangles) / kMb;
  const double pieces = std::min(64.0, 0.2 * static_cast<double>(f.voxels) / kMb);
  double thread = 16 + 32.0 * f.width_px * 100 / kMb + 8192.0 * f.slices / kMb;
  Grid grid;
  grid.width_px = f.width_px;
  grid.layers = f.slices;
  thread += f.width_px * band_rows(grid) * kBodiesColumnBytes / kMb;
  const double columns = static_cast<double>(f.voxels) / std::max(f.slices, 1);
  const double bodies =
      std::min(kBodiesMb, kBodiesBytesPerVoxel * static_cast<double>(f.voxels) / kMb) +
      kFollowedColumnBytes * columns / kMb;
  const double tables = all_tables_bytes(f) / kMb;
  double models = kTableSets * tables;
  thread += kTableSetsPerThread * tables;
  if (f.stepwise || f.bath_slices > 0) {
    const double column = (f.stepwise ? kColumnBytes : 0) + kBathBytes * f.bath_slices;
    thread += f.width_px * kBandRows * column / kMb + f.mirrored_slices * kSearchBytes / kMb;
    models += f.mirrored_slices * kPlanBytes / kMb;
  }
  if (f.cut_slices > 0) {
    // Both predictions walk the band: a byte for each slice that matters, and a state for every 16th.
    thread += 2 * f.width_px * kBandRows * (2.0 * f.cut_slices + kCutBytes) / kMb;
  }
  if (f.lights > 1) {
    models += 2 * f.lights * (kPlanBytes + kPlanBytesPerSlice * f.slices) / kMb;
    thread += f.lights * kLightBytesPerSlice * f.slices / kMb;
  }
  if (f.solved_whole) {
    models += std::min<double>(detail::SolvedColumns::kMostBytes, kSolvedBytes * columns) / kMb;
  }
  if (f.together) models += kTogetherMb;
  const double times = kToBeSure * kKeptForNext;
  return {
      static_cast<std::int64_t>(times * (kProgramMb + mesh + pieces + bodies + models + thread)),
      static_cast<std::int64_t>(times * thread)};
}

void look_at_light(const SliceSource& slices, const Printer& printer, const Process& process,
                   const CorrectionPlan& plan, MemoryFacts& facts) {
  facts.slices = plan.all_layers;
  facts.lights = 1;
  if (light_is_uneven(printer, process)) {
    Printer mapped = printer;
    if (!mapped.flat_field) mapped.flat_field = printer.uv_flat_field;
    const auto counts = LightMap(mapped, slices.grid(), slices.frame()).counts(slices.bounds());
    facts.lights = static_cast<int>(
        std::count_if(counts.begin(), counts.end(), [](std::uint64_t n) { return n > 0; }));
    // Of pairs of lights there may be as many as there are values.
    if (printer.flat_field && printer.uv_flat_field && process.uv.kind != UvKind::off) {
      facts.lights = 255;
    }
  }
  const bool continuous = plan.model.is_continuous();
  const bool sums = !plan.inhibited && !plan.tried;
  facts.stepwise = sums && (facts.left_alone || !plan.model.is_plain());
  facts.bath_slices = plan.model.bath_slices;
  facts.mirrored_slices = continuous ? std::min(plan.model.mirrored_slices, plan.all_layers) : 0;
  if (plan.model.gel_time())
    facts.cut_slices = std::min(
        std::max(plan.model.gel_time()->reach(), plan.model.bath_slices + 1), facts.slices);
  facts.solved_whole = !sums || facts.stepwise;
  if (!plan.model.inhibited()) return;
  facts.tables_bytes = plan.model.inhibited()->table_bytes();
  if (plan.inhibited) facts.tables_bytes += plan.inhibited->far_light.bytes();
  const UvSchedule& uv = process.uv;
  if (uv.kind == UvKind::per_slice && uv.slice_mw_cm2.empty()) {
    facts.tables_bytes *= std::min(kLampSettings, facts.slices);
  }
}

}  // namespace slicecorr
