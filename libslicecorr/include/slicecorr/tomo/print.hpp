// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/print.hpp
/// From a part to the job that prints it, and from a job to what it prints.
///
/// Thread-safe; the same results for any number of threads.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "slicecorr/tomo/solve.hpp"
#include "slicecorr/tomo/surface.hpp"
#include "slicecorr/tomo/wanted.hpp"

namespace slicecorr::tomo {

/// Cuts a part to voxels: exact coverage of their squares in 256 levels, at their mid-heights. The
/// part's box is middled on the axis. Throws `InputError` when it reaches over the resin.
Box<std::uint8_t> voxelise(TriangleMesh mesh, const Printer& printer, double voxel_mm,
                           const ExecutionContext& context = {});
/// A part of several in one vial, and where the middle of its box is to lie: from the axis, and
/// upwards from the optical axis; with `on_base` its lowest point along z.
struct PlacedPart {
  std::string name;  ///< for errors
  TriangleMesh mesh;
  Point3 at_mm{};
  bool on_base = false;
};
/// All of them, and z of the middle of their slices.
struct PlacedVoxels {
  Box<std::uint8_t> part;
  double middle_z_mm = 0;
};
/// The same of parts at their places; slices reach from the lowest to the highest. Throws
/// `InputError` naming parts that reach over the resin, and two that overlap.
PlacedVoxels voxelise(std::vector<PlacedPart> parts, const Printer& printer, double voxel_mm,
                      const ExecutionContext& context = {});
/// Where the axis and the foot of the lowest slice lie in the coordinates of a part, mm.
struct PartFrame {
  double axis_x_mm = 0, axis_y_mm = 0, low_z_mm = 0;
};
/// As `voxelise` puts them: the middle of the part's box, and its least z.
PartFrame frame_of(const TriangleMesh& part, const ExecutionContext& context = {});
/// Cuts an insert to voxels of `part`, which were cut of a mesh with this frame: it keeps its place
/// beside the part. Coverage; what lies above or below the part's slices is left out, as it shades
/// none of them. Where the part fills a voxel of which the insert takes less than half, they touch,
/// and the part has it. Throws `InputError` for inserts outside of the vial, and for those that lie
/// above or below all of the part.
Box<std::uint8_t> voxelise_insert(TriangleMesh insert, const PartFrame& frame,
                                  const Box<std::uint8_t>& part, const Printer& printer,
                                  double voxel_mm, const ExecutionContext& context = {});
/// A volume of voxels of this side on the grid of the vial: middled, with nothing around it. Throws
/// `InputError` when it is not square, or something of it lies outside the vial.
Box<std::uint8_t> placed(const Box<std::uint8_t>& volume, const Printer& printer, double voxel_mm);
/// The same of numbers.
Box<float> placed(const Box<float>& volume, const Printer& printer, double voxel_mm, float around);
/// The same, its middle moved by so much. Throws also where that is not by whole voxels.
Box<std::uint8_t> placed(const Box<std::uint8_t>& volume, const Printer& printer, double voxel_mm,
                         const std::array<double, 2>& by_mm);
/// Greatest distance of a covered voxel from the axis, mm.
double part_radius_mm(const Box<std::uint8_t>& part, double voxel_mm);

/// What a job prints; doses are effective ones of the whole print (`dose_of`).
struct PrintFigures {
  Metrics metrics;
  double jaccard_at_dose = 0;  ///< of what reaches the gel dose
  double efficiency = 0;       ///< mean over largest light
  int turns = 0;
  double print_time_s = 0;
  double alpha_r = 0;
  double gel_dose_mj_cm3 = 0;  ///< that gels, with what inhibitors take before
  double floor_mj_cm3 = 0;     ///< most that black light alone leaves anywhere
  /// No light whatever has a higher contrast in that time; infinite when nothing was proven.
  double contrast_bound = std::numeric_limits<double>::infinity();
  /// Share of the part's voxels with less than the gel dose: by their means, and in their middles,
  /// where that was looked for.
  double gel_below_dose = 0;
  std::optional<double> gel_centres_below_dose = std::nullopt;
  /// Of voxels that the part fills in part; none where doses are wanted.
  SurfaceFigures surface = {};
  /// Where doses are wanted.
  std::optional<WantedFigures> wanted = std::nullopt;
  /// What is not as designed when the print ends, in words; empty: all of the part has gelled, and no void.
  std::string_view fault() const;
  bool feasible() const { return fault().empty(); }
  /// The keys of the contract, as JSON.
  std::string to_json() const;
};

/// Where a part that no light prints fails: the slice that the bound of contrast is of, and the best
/// that was found for it.
struct Evidence {
  int slice = 0;
  double z_mm = 0;  ///< of the slice, from the optical axis
  double voxel_mm = 0;
  double bound = 0;  ///< of contrast, below 1
  /// This slice alone. Doses are over the gel dose at which as much of the part is short as void has
  /// too much, as a factor: the root of the part's least dose times void's most.
  Box<float> dose;
  Box<std::uint8_t> part, insert;  ///< `insert` may be empty
  std::vector<bool> beyond;        ///< columns beyond a wall that is not round, [y][x]; or empty
};

struct PrintOptions {
  SolveOptions solve;
  /// What turns with the part and lets no light through: > 0 opaque, on the part's grid; empty: none.
  Box<std::uint8_t> insert;
  int angles = 0;  ///< 0: `usual_angles`
  /// 0: no limit. With one, light is found that prints in that time (`SolveOptions::cap`).
  double most_time_s = 0;
  bool beyond_reach = false;  ///< gel where not all directions reach is allowed
  /// Called before a part is refused because of the bound of its contrast. May be null.
  std::function<void(const Evidence&)> evidence = nullptr;
  /// File in which the solver leaves what it has, after a rung or step, to go on from; empty: none.
  /// It stays when the solve ends, whichever way: whoever has the result removes it.
  std::string checkpoint = {};
  double checkpoint_s = 5;  ///< not more often than this; 0: always
  /// Goes on from that file, if it is there, to the same bytes as a solve that was not stopped.
  bool resume = false;
  /// z of the middle of the part's slices, upwards from the optical axis.
  double middle_z_mm = 0;
  /// Doses that are wanted in place of the part, which is `part_of` them; or none. The ladder alone
  /// looks for them.
  DoseBands wanted = {};
  /// Frames in which each angle's light is shown, one after the other, by levels that make up for each other:
  /// an odd number; the job then has as many angles. 1: one; 0: as many as gain contrast where few levels are
  /// used, and the printer says how many it shows.
  int hold = 0;
};

struct Print {
  TomoJob job;
  PrintFigures figures;  ///< of the frames with their grey levels
};

/// What `solve_print` refuses of its inputs, without looking for light: throws `InputError` for parts
/// outside of the vial or its reach, for inserts of another grid, outside of the vial, or in the
/// part, and as `make_bench` and `Target`; `InfeasibleError` where less time is allowed than a turn
/// takes. Gives what it would be computed on.
Bench check_print(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
                  const Resin& resin, const PrintOptions& options = {});

/// Throws as `check_print`, `InputError` for a checkpoint that is damaged or of another solve;
/// `InfeasibleError` when the bound of contrast is below 1, when a voxel of the part is lit from no
/// angle, when black light gels resin, when inhibitor comes back faster than light takes it, when
/// dose spreads farther than the resin is wide, and when it takes longer than allowed. Where dose
/// spreads in the resin, light is found up to three times, each for as many turns as the one before
/// needs. Progress is of two stages, "solving" and "judging".
Print solve_print(const Box<std::uint8_t>& part, double voxel_mm, const Printer& printer,
                  const Resin& resin, const PrintOptions& options = {},
                  const ExecutionContext& context = {});

/// The doses that a job's frames leave, mJ/cm³ of the whole print, the mean of each voxel, under square
/// pixels and while the vial turns: a direct sum over angles in double precision. It shares nothing with
/// the operators that look for light, and with those of proofs the share of a pixel that a voxel gets,
/// what an insert hides, how images are blurred, and Snell's law (docs/kernels/tomography.md): [z][y][x], 0 outside of the resin
/// and in inserts. Behind an insert a voxel is dark when the line from its middle against the
/// light meets an opaque voxel's square.
/// In resin that changes they are effective doses: where inhibitor comes back, what light has brought
/// less what came back, never below 0, at most while the last turn lasted; and after they have spread
/// in the resin (`Resin::dose_diffusion_m2_s`). Throws `InputError` where they spread farther than
/// the resin is wide.
/// `at`: the same in the middles of voxels, of which an insert has what holds the middle.
Box<float> dose_of(const TomoJob& job, const ExecutionContext& context = {},
                   JudgedAt at = JudgedAt::means);
/// Share of the voxels of a part whose dose gels less than all of it.
double share_below_gel(const TomoJob& job, const Box<float>& dose, const Box<std::uint8_t>& part);
/// Figures of these doses, against the job's part or another on its grid.
PrintFigures figures_of(const TomoJob& job, const Box<float>& dose, const Box<std::uint8_t>& part,
                        const ExecutionContext& context = {});

}  // namespace slicecorr::tomo
