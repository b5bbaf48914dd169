// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/beams.hpp
/// Printing whole parts with a few still images at once: collimated beams along the axes of a vat.
///
/// Each beam has an image across its axis, in shares of the brightest light. The light at a cell is
///
///     I = sum over beams of share(across) exp(-alpha path),
///
/// path from the vat's wall, at which the beam comes in, to the middle of the cell (thesis of 2018,
/// chapter 3, with absorption). Light that goes sideways (`BeamSetup::spread`, `scatter_um2_per_um`) is
/// that of an image blurred by as much as it is at that path, in the mean over the cell; beyond the
/// image it is dark. A volume is [z][y][x], z upwards; images of beams along x are
/// [z][y], along y [z][x], along z [y][x].
///
/// Grey images are found by the ladder (tomo/ladder.hpp), which finds light for a vial that turns,
/// too. All functions are thread-safe and give the same bytes for any number of threads.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::tomo {

/// `silhouette`: lit where any of the part lies on the ray; `end_on`: where nothing but part does,
/// from wall to wall; `grey`: as the solver finds them.
enum class BeamImages { silhouette, end_on, grey };
/// "silhouette", "end-on", "grey".
const char* name_of(BeamImages images);
/// Throws `InputError` for other names.
BeamImages beam_images_named(std::string_view name);

struct Beam {
  int axis = 0;           ///< 0 x, 1 y, 2 z
  bool from_end = false;  ///< comes in where the axis ends, and goes against it
  bool operator==(const Beam&) const = default;
};
/// 2: along x and y; 3: along all; 4: x and y from both sides; 6: all from both sides. Throws
/// `InputError` for other numbers.
std::vector<Beam> beams_of(int count);
/// The side that it comes from: "-x", "+x" and so on.
std::string side_of(const Beam& beam);

struct BeamSetup {
  std::vector<Beam> beams;
  double cell_mm = 0;       ///< side of a cell, > 0
  double alpha_per_mm = 0;  ///< absorption, >= 0, base e
  /// Inside of the vat along x, y, z, at least the volume, which is in its middle; 0: the volume
  /// reaches from wall to wall.
  std::array<double, 3> vat_mm{};
  BeamImages images = BeamImages::silhouette;
  int steps = 0;  ///< of the solver per rung; 0: its own
  /// How the light of displays spreads at the wall; empty: not at all.
  std::vector<SpreadGaussian> spread = {};
  double scatter_um2_per_um = 0;  ///< as `Resin::scatter_um2_per_um`, of the path
  bool goes_sideways() const { return !spread.empty() || scatter_um2_per_um > 0; }
  /// From the wall to the near side of the first of `cells` cells.
  double before_mm(int axis, int cells) const {
    const double vat = vat_mm[static_cast<std::size_t>(axis)];
    return vat > 0 ? 0.5 * (vat - cells * cell_mm) : 0;
  }
};

/// Takes over how light of these goes sideways. Throws `InputError` for a spread that is a picture.
void take_spread(BeamSetup& setup, const Printer& printer, const Resin& resin);

/// One beam's image, shares of the brightest light, 0..1.
struct BeamImage {
  Beam beam;
  int rows = 0, columns = 0;
  std::vector<float> share;
  float at(int row, int column) const {
    return share[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                 static_cast<std::size_t>(column)];
  }
};

/// How well light separates a part from the rest.
struct BeamFigures {
  double least_inside = 0, most_outside = 0;
  /// The first over the second; infinite where outside is dark, 0 where some of the part is.
  double contrast = 0;
  std::size_t part_cells = 0, outside_cells = 0;
  std::size_t unlit_cells = 0;  ///< of the part
  std::size_t wrong_cells = 0;  ///< outside, with at least `least_inside`
  double ver = 0;               ///< `wrong_cells` over all cells
  /// Jaccard index |P and T| / |P or T| of P = {light >= least_inside}: when all of the part has
  /// gelled. Where some of the part is dark, the best one.
  double jaccard = 0;
  /// The best index of P = {light >= t}, and its t.
  double best_jaccard = 0, threshold = 0;
};
/// `part`: 255 part, 0 empty, else neither; `light` of the same size.
BeamFigures figures_of(const Box<std::uint8_t>& part, const Box<float>& light);

/// Light of these images at each cell of a box of this size, in double precision, cell by cell: it
/// shares with what the solver computes light by no more than what absorption leaves along a beam, and
/// what a cell gets of a blurred neighbour's.
Box<float> light_of(int nz, int ny, int nx, const std::vector<BeamImage>& images,
                    const BeamSetup& setup, const ExecutionContext& context = {});

/// Images of a part, and what they print.
struct BeamPrint {
  std::vector<BeamImage> images;
  Box<float> light;  ///< in units of the brightest light
  BeamFigures figures;
  /// What silhouettes of these beams mark out, where all of them meet: cells of it beyond the part,
  /// and its Jaccard index with the part.
  std::size_t hull_cells = 0;
  double hull_jaccard = 0;
  /// Grey images: no images at all have a higher contrast; infinite where nothing was proven.
  double contrast_bound = std::numeric_limits<double>::infinity();
  /// Cells that stand against the part, as x, y, z, the worst first, 200 at most: outside, with as
  /// much light as the part; of grey images those that the proof of the bound weighs.
  std::vector<std::array<int, 3>> in_the_way;
};

/// `part`: the whole vat, or as much of it as there is. Throws `InputError` for values out of range,
/// volumes larger than the vat, and parts without cells in or outside of them; `Cancelled`.
BeamPrint find_beams(const Box<std::uint8_t>& part, const BeamSetup& setup,
                     const ExecutionContext& context = {});

/// Bytes that `find_beams` takes, about.
double bytes_of_beams(const Box<std::uint8_t>& part, const BeamSetup& setup);

/// Cuts a part to cells: exact coverage of their squares in 256 levels, at their mid-heights, in as
/// few cells as hold it. Throws `InputError` for parts without triangles and for too many cells.
Box<std::uint8_t> cut_cells(TriangleMesh mesh, double cell_mm,
                            const ExecutionContext& context = {});

/// The volume with empty cells around it, up to the walls of the vat. Throws `InputError` when it is
/// larger than the vat.
Box<std::uint8_t> filled_vat(const Box<std::uint8_t>& volume, const BeamSetup& setup);

/// The most absorption, 1/mm, at which these images still have a contrast above 1; 0 where they have
/// none without any. Throws as `find_beams`.
double most_absorption_per_mm(const Box<std::uint8_t>& part, const std::vector<BeamImage>& images,
                              const BeamSetup& setup, const ExecutionContext& context = {});

/// Seconds until resin gels in light of so many mW/cm2; infinite in the dark.
using GelTimeOf = std::function<double(double mw_cm2)>;
/// By the resin's gel dose (Jacobs: D / (alpha_a I)), its gel D'c (kinetic: D'c / I^m) or its time to
/// gel (A / I + B / sqrt(I)); with what inhibitors take before. Not the dose that correction aims at.
GelTimeOf time_to_gel_of(const Resin& resin);

/// From when all of the part has gelled until something else does, s. Empty (last <= first) where
/// there is no such time; `last_s` is infinite where outside is dark.
struct TimeWindow {
  double first_s = 0, last_s = 0;
  bool open() const { return last_s > first_s; }
  /// Between both by the same factor; where outside is dark, twice the first.
  double middle_s() const;
};
TimeWindow time_window(const BeamFigures& figures, const GelTimeOf& gel_time,
                       double brightest_mw_cm2);

}  // namespace slicecorr::tomo
