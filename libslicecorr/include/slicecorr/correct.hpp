// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file correct.hpp
/// Choosing the grey levels of every slice so that the design prints (dissertation §2.3.1, A.4).
///
/// Going from the last slice to the first, slice k decides Omega(k), the dose at its upper node,
/// from Omega(k + 1), the dose really delivered at its lower one: rounding to levels does not pile
/// up. Wanted are, in this order, layers of features that print in their middle, layers of gaps
/// that don't, and edges within a tolerance of their nodes, or of the design's own surface where the
/// target knows it (edge heights), to either side; then features as bright as the cap Omega_max and gaps as dark as that leaves. For this the levels of several slices
/// before an edge are chosen together, from the doses with which all that lies above can still be
/// printed (docs/levels.md). A layer of grey coverage c aims at the relative dose c in its middle.
///
/// Layer by layer each slice makes its own layer's far edge reach 1. Under UV light a slice hardly
/// acts on its own node and is chosen for several nodes above it together (docs/inhibition.md).
///
/// Where doses are wanted, features get these in place of the most that fits (docs/graded-dose.md).
///
/// A first pass from slice 0 on notes, per column, the edges that it passes, in a log that the
/// solve takes back step by step.
///
/// Plans are immutable and may be shared between threads; a `BandCorrector` is for one thread at a
/// time; functions are thread-safe. Calls in the wrong order or number throw `Error`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dose_target.hpp"

namespace slicecorr {

namespace detail {
struct InhibitedPlan;
struct ContinuousPlan;
struct MirroredPlans;
struct TriedPlan;
}  // namespace detail

/// What all columns of a correction share.
struct CorrectionPlan {
  CorrectionPlan(CureModel cure_model, const Process& correction_process, int target_layers,
                 int all_slices);

  CureModel model;
  LevelTable levels;
  Process process;
  bool merge_one_slice_gaps;  ///< gaps of one slice count as full
  int layers;                 ///< layers of the target, N
  int all_layers;             ///< slices that will be shown, M >= N
  /// Layer by layer with lifts that exchange a known share of the resin: the greatest share that is believed.
  /// No feature is cut into for a share up to it. Nothing: the share is sure.
  std::optional<double> most_exchange{};
  /// What the columns share under UV light, with a time to gel or a resin that bleaches, and in
  /// continuous exposure without any of them; null for other models.
  std::shared_ptr<const detail::InhibitedPlan> inhibited;
  std::shared_ptr<const detail::TriedPlan> tried;
  std::shared_ptr<const detail::ContinuousPlan> continuous;
  /// The same for the nodes beside a platform that sends light back; null where none does.
  std::shared_ptr<const detail::MirroredPlans> mirrored;
};

/// The doses that are wanted of a band's features.
struct BandDoses {
  const DoseScale* scale;  ///< must outlive the corrector
  /// Writes the bytes of a layer, one per column.
  std::function<void(int layer, std::uint8_t* bytes)> read;
};

/// Number of slices to show for a target whose last lit layer is `last_lit` (0-based): the burst
/// that cures its lower edge comes after it.
int slices_with_burst(const CureModel& model, int target_layers, int last_lit);

/// Corrects one band: first all layers of the target from the first to the last, then the solve.
class BandCorrector {
 public:
  /// `leaves_alone`: whether any layer has voxels that are left alone.
  BandCorrector(const CorrectionPlan& plan, std::size_t columns, bool leaves_alone = false);
  /// For wanted doses: by sums of light, and under UV light without even light.
  /// Layers of doses are read when `solve` is called.
  BandCorrector(const CorrectionPlan& plan, std::size_t columns, BandDoses doses);
  ~BandCorrector();
  BandCorrector(BandCorrector&&) noexcept;

  /// Coverage 0..255 of the next layer, one byte per column; null for an empty layer. To be called
  /// `plan.layers` times. `heights`: the edge heights of its upper node (target.hpp), null where it
  /// has none; those between a full and an empty layer count. Where the node after the last layer
  /// has some, too, it is called once more, with null for coverage.
  /// `left_alone`: pixels 1..255 of the voxels that are shown as they are, 0 for all others; null:
  /// none. There the coverage counts for nothing: whatever prints is right.
  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights = nullptr,
                 const std::uint8_t* left_alone = nullptr);

  /// Writes the highest levels of a column of the band, one for each of `plan.all_layers` slices.
  using ColumnLevels = std::function<void(std::size_t column, std::uint8_t* levels)>;
  /// Even light (`Process::even_light`): features get these levels inside, and no slice gets more. To
  /// be called before `solve`; under UV light only.
  void keep_light(ColumnLevels most);

  /// Gives every slice from the last to the first: its grey levels (0..levels - 1) and the coverage
  /// of its layer; the pointers are valid during the call. `dark` says that the slice is all level
  /// 0 and its coverage all 0. May be called once.
  using Sink = std::function<void(int slice, const std::uint8_t* levels,
                                  const std::uint8_t* coverage, bool dark)>;
  void solve(const Sink& sink);

  /// Some neighbouring columns through some slices, rows of `kStride` bytes from the first slice
  /// on.
  struct Tile {
    static constexpr std::size_t kStride = 64;
    std::size_t first_column, columns;  ///< of the band; columns: 1..kStride
    int first_slice, slices;            ///< slices: 1 or more
    const std::uint8_t* levels;         ///< grey levels, slices * kStride bytes
    const std::uint8_t* coverage;       ///< of the layers, 0..255, as many bytes
    const std::uint8_t* heights;        ///< of their upper nodes, as many bytes; null: all 0
  };
  using TileSink = std::function<void(const Tile&)>;
  /// The same for plain models (continuous exposure, no UV light) in which no gaps are merged, for those who also look at what
  /// becomes of columns: first gives tiles, while they lie in the nearest cache, then their slices
  /// to `sink`, with null for coverage. Tiles come from the last slices to the first and, within
  /// the same slices, from the first column to the last.
  void solve(const Sink& sink, const TileSink& tiles);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The intensities phi(0..M-1) of one column before rounding to levels: every intensity between
/// phi_min and phi_max may be shown. For checks and drawings; `coverage` has `plan.layers` bytes,
/// `heights`, the edge heights of the nodes, one more or none.
std::vector<double> solve_column_exactly(const CorrectionPlan& plan,
                                         const std::vector<std::uint8_t>& coverage,
                                         const std::vector<std::uint8_t>& heights = {});

/// The grey levels of one column of a plain model of whose layers `doses` are wanted, by their bytes.
std::vector<std::uint8_t> solve_graded_column(const CorrectionPlan& plan, const DoseScale& scale,
                                              const std::vector<std::uint8_t>& coverage,
                                              const std::vector<std::uint8_t>& doses,
                                              const std::vector<std::uint8_t>& heights = {});

/// The grey levels of one column: the definition that `BandCorrector` equals, without its short
/// cuts.
std::vector<std::uint8_t> solve_column(const CorrectionPlan& plan,
                                       const std::vector<std::uint8_t>& coverage,
                                       const std::vector<std::uint8_t>& heights = {});

}  // namespace slicecorr
