// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Patches of a coupled correction: how wrong one is, and its levels for another round.
#pragma once

#include <cstdint>
#include <vector>

#include "correct/coupled_field.hpp"
#include "correct/coupled_plan.hpp"

namespace slicecorr::detail {

/// A square whose light has stayed the same for so many slices may fall asleep.
inline constexpr int kCalm = 3;

/// A voxel that misses what is wanted of it, or a gap's that nearly does.
struct Miss {
  std::int32_t slice = 0, x = 0, y = 0;
  float excess = 0;    ///< dose over what it should be at most, below 0: under what at least
  bool wrong = false;  ///< in the middle of its layer on the wrong side of 1, or parted
  bool own = false;    ///< with lifts: of what the slice's own exposure leaves
};

/// What of a patch is wrong.
struct PatchFigures {
  std::uint64_t through = 0, under = 0;  ///< voxels of gaps that cure, of features that don't
  /// Layer by layer: of features that part from the one above; with lifts, that do not hold.
  std::uint64_t parted = 0;
  std::uint64_t unmet = 0;  ///< doses that are wanted beside what the design asks
  double loss = 0;
  /// From the last slice to the first.
  std::vector<Miss> misses;
  bool all_misses = true;  ///< else they are too many, and these the first ones
  std::uint64_t wrong() const { return through + under + parted; }
};

/// Where the bytes of a patch come from: coverage of layers, levels of slices.
struct PatchSources {
  std::vector<PatchBytes::Source> coverage, levels, columns;
  /// What is left alone, not 0, the first slice first: it is shown as columns show it, and nothing
  /// is asked of its doses. Empty where nothing is.
  std::vector<PatchBytes::Source> left_alone;
  /// Doses that are wanted of voxels beside what the design asks (`aim_byte`); empty where none are.
  std::vector<PatchBytes::Source> aims;
  std::vector<PatchBytes::Source> heights;  ///< of edges, at nodes; where columns want their light
};

/// Judges the voxels of `box`, in double precision, and keeps some `most_misses` of their misses.
PatchFigures judge_patch(const CoupledPlan& plan, const PixelBox& box, const PatchSources& sources,
                         std::size_t most_misses);
/// The same where columns want their light (coupled_columns.hpp). The loss is that of the middles of layers and of edges.
PatchFigures judge_patch_by_columns(const CoupledPlan& plan, const PixelBox& box,
                                    const PatchSources& sources, std::size_t most_misses);

/// Light that is asked for at a slice: by so much less (below 0: more).
struct Request {
  std::int32_t slice = 0, x = 0, y = 0;
  float less = 0;
};
/// The requests of misses to the slices from theirs on, each place of a slice once, the last slices
/// first.
/// `urgency`: how much more is asked for than would do if every slice gave it.
std::vector<Request> requests_of(const CoupledPlan& plan, const std::vector<Miss>& misses,
                                 double urgency);

/// What is chosen for a patch in a round.
struct PatchTask {
  PixelBox box;                      ///< of the patch
  const KeptTile* before = nullptr;  ///< its levels after the round before
  PixelBox free;  ///< pixels whose levels may change; others, around them, are kept
  /// The first round sets out from the levels of columns, and keeps what it changes of them while
  /// they stay as they are; later ones change what is asked for.
  bool first = true;
  std::vector<Request> requests;
};
/// Levels of `task.box`, kept in `store`.
KeptTile solve_patch(const CoupledPlan& plan, const PatchTask& task, const PatchSources& sources,
                     BlobStore& store);
/// The same for the light that columns want: `PatchSources::columns`. `first` and
/// `requests` are not looked at.
KeptTile solve_patch_for_columns(const CoupledPlan& plan, const PatchTask& task,
                                 const PatchSources& sources, BlobStore& store);
/// Where they do: what the columns of `box` want, which is `wanted`, but that the columns at `wrong`
/// are solved again among neighbours that show `PatchSources::levels`.
KeptTile want_again(const CoupledPlan& plan, const PixelBox& box, const KeptTile& wanted,
                    const std::vector<Pixel>& wrong, const PatchSources& sources, BlobStore& store);

}  // namespace slicecorr::detail
