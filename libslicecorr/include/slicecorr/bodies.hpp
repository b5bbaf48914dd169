// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file bodies.hpp
/// What of a print hangs together while it prints, and what it traps: bodies of solid voxels that hang on
/// nothing, cavities that nothing leaves, cups that pull (docs/bodies.md).
///
/// Slices come from the platform on, as they print. A voxel gels while its own slice is shown or, by the
/// light of later ones, some slices after it: so many are its delay. When a slice is done, two voxels that
/// have gelled hang together where they share a face. What is solid in slice 0 hangs on the platform. An
/// *island* is a body that hangs on nothing when the slice is done in which it begins to gel, whether or
/// not something joins it later; a *loose body* is one that never hangs on the platform.
///
/// A *void* is a body of voxels that are not solid, by faces, too. Outside is all beside the box of what
/// is lit. A void that the slices so far leave no way to the outside is a *cup* while it is open
/// towards the window: it pulls. Where a slice closes it, no resin leaves it again: it is a *sealed
/// cavity*, unless it lies on the platform, which it opens to when the part is taken off.
///
/// A pass over runs of voxels: memory is that of the runs of a slice, of the bodies that they belong
/// to and of what is found, never that of voxels.
///
/// Plain values; a `BodyTracker` is for one thread at a time; functions are thread-safe.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slicecorr/grid.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// Slices count from 0, past ones are one further; pixels are those of the images.
struct Island {
  int first = 0;   ///< the lowest slice that has voxels of it
  int begins = 0;  ///< slice that is shown when the first of them gels
  int until = -1;  ///< slice that is shown when it comes to hang on the platform; -1: none
  std::uint64_t voxels = 0;    ///< gelled before slice `until`, or before it joined an older island
  double column = 0, row = 0;  ///< middle of these voxels; pixel 0 has its middle at 0.5
  int x = 0, y = 0;            ///< its first pixel in slice `first`, in reading order
  bool operator==(const Island&) const = default;
};

struct SealedCavity {
  int first = 0, past = 0;  ///< slices that have voxels of it
  std::uint64_t voxels = 0;
  double column = 0, row = 0;  ///< middle
  int x = 0, y = 0;            ///< its first pixel in slice `first`
  bool operator==(const SealedCavity&) const = default;
};

/// What ends a cup.
enum class CupEnd {
  closed,      ///< a slice closes it: a sealed cavity, or one on the platform
  opened,      ///< a slice opens it to the side
  print_ends,  ///< it is open towards the window to the end
};

struct Cup {
  int first = 0, past = 0;  ///< slices in which it is a cup
  CupEnd end = CupEnd::print_ends;
  int widest = 0;              ///< the first slice in which its opening is as wide as ever
  std::uint64_t opening = 0;   ///< voxels of that
  double column = 0, row = 0;  ///< middle of its voxels
  int x = 0, y = 0;            ///< its first pixel in slice `first`
  bool operator==(const Cup&) const = default;
};

/// Where a body hangs by less than it should: by what patches of neighbouring slices share, each patch
/// being voxels of a slice that hang together in it; in slice 0 by its own area on the platform.
struct Neck {
  int slice = 0;               ///< that of the upper patch
  std::uint64_t voxels = 0;    ///< by which it hangs
  std::uint64_t borne = 0;     ///< voxels of all that hangs by them
  double column = 0, row = 0;  ///< middle
  bool operator==(const Neck&) const = default;
};

/// What a stack of slices holds.
struct Bodies {
  /// So many of each kind are listed at most, the largest first; of equals the one that begins first.
  static constexpr std::size_t kMost = 200;
  /// So many islands that wait to hang on the platform are known at most: what begins when there are
  /// more is counted, but not listed once it has joined another.
  static constexpr std::size_t kMostWaiting = 100000;

  Grid grid;
  LayerHeights heights{};  ///< of slices, where they differ
  ImageFrame frame;
  /// Whether delays were known: else all counts as if it gelled in its own slice.
  bool in_time = true;
  std::uint64_t on_platform = 0;   ///< bodies that hang on it
  std::uint64_t loose_bodies = 0;  ///< bodies that never do
  std::uint64_t islands_in_all = 0, sealed_in_all = 0, cups_in_all = 0;
  std::uint64_t sealed_voxels = 0;  ///< of all sealed cavities
  std::vector<Island> islands;
  std::vector<SealedCavity> sealed_cavities;
  std::vector<Cup> cups;
  double least_neck_mm2 = 0;  ///< what was asked for; 0: nobody looked for necks
  std::uint64_t necks_in_all = 0;
  std::vector<Neck> necks;  ///< the largest are those that bear most
  /// Pixels of the widest patch of a slice; known where somebody looked for necks.
  std::uint64_t widest = 0;
  /// Slices after which it was looked again what hangs on nothing: what does so between two looks alone
  /// is not known; `begins` and `until` are slices of looks, the last of which comes after the last slice.
  int time_step = 1;

  double slice_um(int slice) const { return heights.place_um(slice, grid.layer_um); }
  /// 0 where slices are of different heights: which voxels lie where is not kept.
  double voxels_mm3(std::uint64_t voxels) const;
  double pixels_mm2(std::uint64_t pixels) const;
  /// On the plate; where nothing says how it lies in the images, from their upper left corner.
  PlatePlace place(double column, double row) const;
  /// Whether no body is in any slice as wide as each was to hang: none was judged, and none hangs by as much.
  bool none_so_wide() const {
    return widest > 0 && pixels_mm2(widest) < least_neck_mm2 * (1 - 1e-9);
  }
  /// Whether some body hangs on nothing when it begins, or by less than was asked for.
  bool any_loose() const { return islands_in_all + necks_in_all > 0 || none_so_wide(); }
  /// `loose_bodies`, `islands`, `sealed_cavities` and `cups` of the contract.
  std::string to_json() const;
};

/// A print beside its design. What is designed is solid where at least half of a voxel is covered, but
/// voxels that are not covered whole are aimed at doses below 1, so that not all of them print: what
/// hangs by such voxels alone may print loose.
struct JudgedBodies {
  Bodies printed;
  Bodies designed;  ///< without what is trapped
  /// Loose bodies of the voxels that are covered whole; known where the print has more than the design.
  std::optional<std::uint64_t> loose_whole{};
  /// Whether some body hangs on nothing when it begins, in the print or by design: light of later slices
  /// may join what had nothing to hang on while it was made.
  bool any_loose() const { return printed.any_loose() || designed.any_loose(); }
  /// Loose bodies that neither the design nor its whole voxels have: the light's own.
  std::uint64_t cut_loose() const {
    const std::uint64_t other = std::max(designed.loose_bodies, loose_whole.value_or(0));
    return printed.loose_bodies > other ? printed.loose_bodies - other : 0;
  }
  /// Others that the design joins by voxels that it covers in part.
  std::uint64_t joined_in_part() const {
    return printed.loose_bodies > designed.loose_bodies
               ? printed.loose_bodies - designed.loose_bodies - cut_loose()
               : 0;
  }
};

/// In a sentence each, what of bodies a person should know; empty where all is well. Cups are told
/// where the widest opens over at least `kCupToldMm2`: curved surfaces have many that are only pixels
/// wide.
inline constexpr double kCupToldMm2 = 1;
std::vector<std::string> bodies_in_words(const Bodies& bodies);
/// The same of a print, with what its light cuts loose.
std::vector<std::string> bodies_in_words(const JudgedBodies& bodies);
/// Of these what makes a print go wrong or stay wet: bodies that hang on nothing, sealed cavities.
std::vector<std::string> warnings_of(const JudgedBodies& bodies);

/// What is looked for besides bodies that hang on nothing.
struct BodyAsk {
  bool voids = true;          ///< what is trapped
  double least_neck_mm2 = 0;  ///< area by which a body must hang; 0: any. Needs a scale.
  /// What hangs on nothing is looked for after so many slices each; a power of two.
  int time_step = 1;
  bool solids = true;  ///< bodies; else only what else is asked for
  int strip_rows = 0;  ///< rows that are followed apart; no figure depends on it. 0: all together.
};

/// Follows bodies and voids slice by slice. Voids are those between what is solid in the end, whenever it
/// gels.
class BodyTracker {
 public:
  static constexpr int kLongestDelay = 1023;
  /// Columns [begin, end) of a row.
  struct Run {
    int begin = 0, end = 0;
    int delay = 0;  ///< slices after their own until they gel, 0..kLongestDelay
    /// What is above them in their columns gels in the same slice as they do, not as long after its own.
    bool at_once = false;
    bool operator==(const Run&) const = default;
  };
  /// `box`: of all that is solid in any slice.
  BodyTracker(const PixelBox& box, const Grid& grid, const ImageFrame& frame,
              const BodyAsk& ask = {});
  ~BodyTracker();
  BodyTracker(BodyTracker&&) noexcept;
  /// What is solid in row `y` of the slice at hand, inside the box, and when it gels: runs from left to
  /// right; neighbours that touch have other delays. Rows that are not set are as in the slice before, empty
  /// before the first one. At most once a row and slice, and not beside what follows.
  void set_row(int y, std::span<const Run> runs);
  /// Which voxels of a row are solid, by those that are otherwise than in the slice before; twice is not at
  /// all.
  void flip_row(int y, std::span<const Run> runs);
  /// When voxels of a row gel, solid ones from the slice at hand on, until something else is said of them
  /// or they are solid no more. What is not told gels in its own slice. At most once a row and slice. Of
  /// runs `at_once` something else is to be said when the slice is past in which they gel.
  void set_delays(int y, std::span<const Run> runs);
  /// Ends the slice at hand, and `more` after it that are like it.
  void end_slice(int more = 0);
  /// After the last slice.
  Bodies finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The bodies of images alone, whatever prints: a voxel is solid where its pixel has at least half of
/// the full value. Not of corrected stacks, whose images are light. Throws as reading does, and
/// `Cancelled`.
Bodies find_bodies(const SliceSource& images, const ExecutionContext& context = {},
                   const BodyAsk& ask = {});

}  // namespace slicecorr
