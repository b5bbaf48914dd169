// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomographic.hpp
/// What a tomographic print will take, found out of its inputs.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/farm/submit.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/memory_need.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/print.hpp"

namespace slicecorr::farm::detail {

/// What a request asks of a tomographic print, into `spec`: all but its inputs, and angles as they were
/// asked for; and its printer and resin. Throws `InputError` naming what is missing.
std::pair<Printer, Resin> resolve_tomographic(const JobRequest& request, WorkSpec& spec);

struct TomoNeeds {
  int slices = 0;                      ///< along z
  int angles = 0;                      ///< frames of a turn
  std::int64_t voxels = 0;             ///< of the grid: all of the resin beside the part
  std::int64_t voxel_angle_steps = 0;  ///< the time goes with them
  std::int64_t bytes = 0;              ///< of the outputs, about
  MemoryNeeds memory;
};

/// Reads a part as a worker will, and asks what `solve_print` asks of it. Throws `InputError` as
/// `read_mesh`, `read_part_npy`, `voxelise`, `placed` and `check_print`.
TomoNeeds look_at_tomographic(const WorkSpec& spec, const std::vector<std::string>& paths,
                              const Printer& printer, const Resin& resin,
                              const ExecutionContext& context);

/// Of a print on this grid. Half as much again as was seen, as `memory_needs`.
MemoryNeeds tomo_memory_needs(const tomo::Bench& bench, tomo::Method method);

/// Voxels times angles times steps of a print: those of the solve, and what judging it costs. The
/// ladder's steps are those of a rung, times its rungs: it ends where one is missed.
std::int64_t voxel_angle_steps(const tomo::TomoGrid& grid, const tomo::SolveOptions& options);

/// Solves of one class take the same time per voxel, angle and step.
std::string tomo_rate_class(const TomoWork& tomo, int slices);
/// Units a second on one core before the farm has measured any: cautious for grids of 100 voxels.
double guessed_units_per_s(int slices);

}  // namespace slicecorr::farm::detail
