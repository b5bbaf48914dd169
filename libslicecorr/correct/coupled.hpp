// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The coupled correction: grey levels of all slices where light spreads sideways, at the window
/// and with depth. Each pixel's level acts on the doses of its neighbours, so columns can't be
/// solved alone.
///
/// It sets out from the columns' own levels and goes in rounds. A round solves square *patches* of
/// pixels, each alone and through all slices, from the last to the first: whatever doses miss at a
/// slice, the light of that slice mends as far as it can, by descent on the weighted squares of what
/// is missed, one pixel after the other; then it is rounded to levels, and the dose that these
/// deliver goes on to the next slice. Around a patch, pixels are solved with it (and thrown away),
/// and beyond them have the levels of the round before. The doses of columns alone are the guide:
/// they know which edges lie ahead. Between rounds all voxels are judged, in double precision, by
/// the levels as they are; from the second round on only patches with wrong voxels are solved again,
/// and what is wrong asks the slices below it for more or less light.
///
/// Under UV light patches are solved in another way (coupled_columns.hpp); the rest is the same.
///
/// A round reads what the one before it left, and sums are taken in a fixed order: results do not
/// depend on the number of threads. Levels are those of the best round so far, by the number of
/// wrong voxels, then by half the sum of squares of what doses miss: never worse than the columns'.
///
/// Memory: `CoupledOptions::memory_bytes` of coverage, up to three sets of levels and places of wrong
/// voxels, all coded, the rest in a scratch file; and the arrays of one patch per thread.
///
/// How to use: `solve_columns`, then `improve` until it says no more; `read` in any order. For one
/// caller at a time; it uses threads itself.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/coded_band.hpp"
#include "correct/coupled_cases.hpp"
#include "correct/coupled_patch.hpp"
#include "correct/coupled_plan.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

/// Settings that serve tests, too.
struct CoupledOptions {
  int rounds = 20;
  /// How far from 1 doses are aimed at; 0: as levels ask.
  double margin = 0;
  int patch_px = 128;
  /// Where light is uneven: what pixels get of the plan's light.
  LightShares shares{};
  bool hand_on = true;                ///< see `CoupledPlan::hands_on`
  const DoseTarget* doses = nullptr;  ///< that are wanted; must outlive the correction
  /// What does not fit into so many bytes is kept in a nameless file in `scratch_folder`; empty: the
  /// working folder.
  std::size_t memory_bytes = std::size_t{64} << 20;
  std::string scratch_folder = {};
  UnevenUv uv{};  ///< under UV light alone
  const std::vector<DistanceBlur>* distances =
      nullptr;  ///< see `CoupledPlan::distances`; must outlive the correction
};

/// What is wrong after a round; round 0: the columns alone.
struct CoupledRound {
  int round = 0;
  std::uint64_t through = 0;  ///< voxels of gaps that cure
  std::uint64_t under = 0;    ///< voxels of features that don't
  std::uint64_t parted =
      0;  ///< layer by layer: of features that part from the layer above, or do not hold
  std::uint64_t unmet = 0;    ///< doses that are wanted beside what the design asks
  double loss = 0;            ///< half the sum of squares of what doses miss
  std::uint64_t patches = 0;  ///< that were solved
  bool lifted = false;        ///< with lifts: what does not hold counts before all else
  bool unmet_first =
      false;  ///< doses that are wanted are those of necks, which count before the rest
  /// What is wrong in a case counts for some voxels that are wrong as said.
  static constexpr std::uint64_t kUnmetCounts = 4;
  std::uint64_t wrong() const { return through + under + parted + kUnmetCounts * unmet; }
  bool better_than(const CoupledRound& o) const {
    if (lifted && parted != o.parted) return parted < o.parted;
    if (unmet_first && unmet != o.unmet) return unmet < o.unmet;
    return wrong() != o.wrong() ? wrong() < o.wrong() : loss < o.loss;
  }
};

class CoupledCorrection {
 public:
  /// Pixels in `bounds` may be lit; all others of `display` are black. The plan and blur
  /// must outlive this. Throws as `CoupledPlan`.
  CoupledCorrection(const CorrectionPlan& columns, const LightBlur& blur, const PixelBox& bounds,
                    const PixelBox& display, const CoupledOptions& options = {});
  ~CoupledCorrection();

  /// Takes coverage, edge heights and what is left alone (null: none) of the next layer of a box of
  /// rows; as `BandCorrector::add_layer`, all `CorrectionPlan::layers` of them, heights perhaps once
  /// more.
  using LayerSink = std::function<void(int layer, const std::uint8_t* coverage,
                                       const std::uint8_t* heights, const std::uint8_t* left)>;
  using DesignReader = std::function<void(const PixelBox& box, const LayerSink& sink)>;
  /// Levels of columns alone in a box of rows, slices from the last to the first.
  using ColumnLevels = std::function<CodedBand(const PixelBox& box)>;
  /// Reads the design in boxes of rows, on several threads, solves its columns and judges them.
  /// `leaves_alone`: something is left alone. `levels`: where columns are solved, if not by the
  /// plan, as where light is uneven.
  void solve_columns(const DesignReader& read, bool leaves_alone, const ExecutionContext& context,
                     const ColumnLevels& levels = {});

  /// One more round, of which `context` hears as the stage "round"; false, with nothing done, where
  /// nothing is wrong, no round has gained anything for some time, or the rounds are over.
  bool improve(const ExecutionContext& context);
  const CoupledRound& columns_alone() const { return first_; }
  const CoupledRound& last() const { return now_; }
  const CoupledRound& best() const { return best_; }

  /// Necks of one voxel (coupled_necks.hpp) that are lost.
  struct NeckFigures {
    std::uint64_t before = 0, after = 0;
  };
  /// After the rounds, where doses are sums of light: goes on with rounds in which necks that are lost count
  /// before all else that is wrong, and keeps the levels with which the fewest are. Does nothing where none
  /// is, or there were to be no rounds.
  NeckFigures hold_necks(const ExecutionContext& context);

  /// Features that are lost in the weak case and gaps that fill in the strong one.
  struct CaseFigures {
    std::uint64_t lost = 0, filled = 0;
    std::uint64_t as_said = 0;  ///< of these, with inputs as said, too
    std::uint64_t sum() const { return lost + filled; }
  };
  struct Held {
    CaseFigures before, after;
    std::uint64_t aims = 0;  ///< doses that were wanted for it
  };
  /// After the rounds, where doses are sums of light that does not scatter: goes on with rounds in which
  /// what fails in the cases is asked for other doses, and keeps the levels with which the fewest fail of
  /// those that have no more fail as said. The models are those of prints with all inputs off.
  Held hold_in(const CureModel& weak, const CureModel& strong, const ExecutionContext& context);

  /// Takes the grey levels of a slice in a box, row by row; null: black.
  using LevelSink = std::function<void(int slice, const std::uint8_t* levels)>;
  /// The best levels of a box, from the first slice to the last; black beyond the bounds.
  /// Thread-safe.
  void read(const PixelBox& box, const LevelSink& sink) const;
  /// Wrong voxels of the best levels, patch by patch, at most `most` of them. Of patches with very
  /// many only the first, by slices from the last one on.
  std::vector<Miss> wrong_voxels(std::size_t most) const;
  /// Bytes of coverage, levels and wrong voxels, in memory and in the scratch file.
  std::size_t bytes() const;

 private:
  struct Tile;
  struct Figures;
  std::vector<PatchBytes::Source> sources(const PixelBox& box, KeptTile Tile::*which) const;
  std::vector<std::size_t> tiles_in(const PixelBox& box) const;
  PatchSources sources_of(const PixelBox& watched) const;
  /// Solves the columns of some tiles beside each other.
  /// Where columns alone come from; see `solve_columns`.
  struct Columns {
    const DesignReader& read;
    bool leaves_alone;
    const ColumnLevels& levels;
  };
  void solve_tiles(Tile* tiles, std::size_t count, const Columns& columns,
                   const ExecutionContext& context);
  void judge(const std::vector<std::size_t>& which, const ExecutionContext& context);
  std::vector<Miss> misses_of(const Figures& figures) const;
  /// Tiles whose doses feel the light of others, these included.
  std::vector<std::size_t> seen_from(const std::vector<std::size_t>& changed) const;
  /// Whether a tile is to be solved in the next round.
  bool is_wanted(const Tile& tile) const;
  PatchTask task_of(const Tile& tile) const;
  std::vector<KeptTile> want_again_of_columns(const std::vector<std::size_t>& which,
                                              const ExecutionContext& context);
  void keep_best();
  void go_back_to_best();
  std::vector<CaseTrouble> fails_in(const CasePlans& plans, const ExecutionContext& context) const;
  void want(const std::vector<CaseTrouble>& troubles);
  std::vector<Miss> necks_lost(const ExecutionContext& context) const;
  void want(const std::vector<Miss>& necks);
  /// Has the doses that are wanted asked for, in so many rounds at most, and goes back to the best of these.
  void ask(int rounds, const ExecutionContext& context);

  CoupledPlan plan_;
  CoupledOptions options_;
  PixelBox bounds_, box_;
  int across_ = 0;
  std::unique_ptr<BlobStore> store_;  ///< of what tiles hold
  std::vector<Tile> tiles_;
  CoupledRound first_, now_, best_;
  int without_gain_ = 0;
};

}  // namespace slicecorr::detail
