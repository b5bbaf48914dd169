// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file predict.hpp
/// What a stack will print, measured against its design (contract: `verify --json`).
///
/// Voxel: one pixel in one layer, printed when the dose at mid-layer reaches 1. Run: consecutive
/// layers of coverage 1 in a column. Gap: the layers of coverage 0 between two runs, or between the
/// platform and a run. Surface errors are measured from where the design's own surface passes near a
/// node, where the target knows that; height errors from there as well for stacks that were
/// corrected to it, and from nodes for all others. Edges are exact, from the closed form of the dose inside a layer (A.35);
/// under UV light they are found in the dose itself, to 0.01 um.
///
/// A feature is solid when it is solid throughout, not at the middles of its layers alone. The
/// least dose inside the layers of features is taken over every point of them, both ends of each
/// layer included. A run is *split* when what prints of it lies in two pieces or more. Continuous
/// exposure splits a run at a node where its light is too weak, layer by layer exposure in front of
/// a node, UV light anywhere in a layer. Unprinted stretches at a run's two edges split nothing:
/// they are height errors; nor is a lost run split. Nor do stretches split whose least dose is 1 to
/// `kSameDose`.
///
/// Layer by layer the dose jumps at nodes. An edge is judged by the dose on its gap side: printed
/// there, the print reaches into the gap up to the end of the stretch that touches the edge. What
/// gels again further on (teeth beside the windows of later layers) is not showing of this reach:
/// it is counted as teeth, and as cured through where the middle of a layer prints. Sums are kept
/// in integers, so that no figure depends on the order of the work.
///
/// Plain values; a `BandPredictor` is for one thread at a time; functions are thread-safe. Doses
/// are relative: 1 gels the resin. Nothing throws, but `add_tile` where it may not be called:
/// `Error`.
#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/flow_doses.hpp"
#include "slicecorr/flow_suction.hpp"
#include "slicecorr/layer_areas.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/surface_maps.hpp"

namespace slicecorr {

struct JudgedBodies;
struct UncertainPrint;

/// Counts of positive numbers in bins of at most 0.1 % of their value, for quantiles of any number
/// of samples in bounded memory.
class Histogram {
 public:
  /// `value` >= 0 and finite.
  void add(double value);
  void merge(const Histogram& other);
  std::uint64_t count() const { return count_; }
  double mean() const;
  /// Sum of the samples in units of 2^-20, the same for any order of them.
  unsigned __int128 scaled_sum() const { return sum_; }
  /// Least value that a share `q` of the samples does not exceed (nearest rank), to 0.05 %; the
  /// smallest and the largest sample are exact.
  double quantile(double q) const;
  double least() const { return least_; }
  double greatest() const { return greatest_; }
  /// Samples between each two neighbours of `edges`, which rise; those below the first or above the
  /// last count in the outermost. Near an edge to the width of a bin, 0.1 %.
  std::vector<std::uint64_t> coarse(const std::vector<double>& edges) const;

 private:
  double middle_of(std::size_t bin) const;
  static constexpr int kLeastExponent = -20, kGreatestExponent = 30, kBinsPerOctave = 1024;
  std::uint64_t in_bin(std::size_t bin) const {
    return low_[bin] + (high_.empty() ? std::uint64_t{0} : high_[bin] << 16);
  }
  void carry(std::size_t bin, std::uint64_t times);
  /// Counts of the bins, their lowest 16 bits apart: what is counted lies all over the bins, and
  /// these should stay in the cache. `low_` is empty until the first sample, `high_` until a count
  /// needs it. Bin 0: below 2^-20.
  std::vector<std::uint16_t> low_;
  std::vector<std::uint64_t> high_;
  std::uint64_t count_ = 0;
  /// Sum in units of 2^-20, 128 bits: no order of summing changes it.
  unsigned __int128 sum_ = 0;
  double least_ = std::numeric_limits<double>::infinity();
  double greatest_ = -std::numeric_limits<double>::infinity();
};

/// Where a feature is lost or a gap merged: slices [first, last] of the pixel in column x, row y.
struct FeatureExample {
  int x = 0, y = 0, first = 0, last = 0;
  auto operator<=>(const FeatureExample& o) const {
    return std::tie(y, x, first, last) <=> std::tie(o.y, o.x, o.first, o.last);
  }
  bool operator==(const FeatureExample&) const = default;
};

/// The first `kMost` examples in reading order (row, column, slice), whatever the order of adding.
class FeatureExamples {
 public:
  static constexpr std::size_t kMost = 200;
  void add(const FeatureExample& example);
  void merge(const FeatureExamples& other);
  std::vector<FeatureExample> sorted() const;

 private:
  std::vector<FeatureExample> heap_;  ///< the last in order at the front
};

/// What layer by layer exposure itself does to a print; see CureModel.
struct LayerwiseFigures {
  double cut_through_um = 0;        ///< zCT of layers with the normal exposure
  double max_cut_through_um = 0;    ///< of those with the longest one
  double heterogeneity = 0;         ///< greatest over least dose in a layer, >= 1
  bool gels_further_teeth = false;  ///< see CureModel::gels_further_teeth
};
/// None for other models.
std::optional<LayerwiseFigures> layerwise_figures(const CureModel& model);

/// Layer by layer, where the platform lifts after each exposure: what each exposure by itself does
/// (docs/lifts.md). A joint is the far edge of a layer of a feature with a layer of it above, or the
/// platform.
struct JointFigures {
  /// Least dose of an exposure at its joint, in critical doses; 0 where a liquid layer lies between
  /// solid ones. Infinite without joints.
  double least = std::numeric_limits<double>::infinity();
  /// Voxels whose joint has less than `LiftModel::green_strength`, or that are a skin and no film.
  std::uint64_t not_holding_voxels = 0;
  std::uint64_t films = 0;    ///< first solid layers over gaps, that hang on their neighbours
  int liquid_layers_max = 0;  ///< first layers of a feature over a gap that no exposure gels
  /// Absolute height errors, one per designed edge, where each lift exchanges all liquid resin.
  Histogram exchanged_error_um;
  double exchanged_max_um = 0;
  /// The same where no lift exchanges any.
  Histogram staying_error_um;
  double staying_max_um = 0;
  /// `LiftModel::exchange` of the print that all other figures are of.
  std::optional<double> exchange{};
  void merge(const JointFigures& other);
};

/// The finest that light which spreads can print, by the sharper of the images' two axes.
struct FinestPrint {
  /// A line that is lit at full light between black gels in its middle if it is at least so wide.
  double line_um = 0;
  /// A gap whose edges print where they are designed, between full light, stays a tenth below the
  /// dose that gels in its middle if it is at least so wide.
  double gap_um = 0;
};

/// Wanted doses beside those that print, at mid-layer, of the voxels of coverage 1 of a region.
struct RegionDose {
  std::string name;
  std::uint64_t voxels = 0;
  double least_wanted = std::numeric_limits<double>::infinity(), greatest_wanted = 0;
  double least = std::numeric_limits<double>::infinity(), greatest = 0;
  double most_below = 0, most_above = 0;  ///< greatest difference to what is wanted, >= 0
  void add(double wanted, double dose);
  void merge(const RegionDose& other);
  double mean() const;
  double mean_wanted() const;
  double mean_off() const;  ///< of the absolute differences

 private:
  /// In units of 2^-32, so that their order does not matter.
  unsigned __int128 sum_ = 0, wanted_sum_ = 0, off_sum_ = 0;
};

/// Dose at the platform, in critical doses, from which on a feature holds there: half a hundredth below
/// what gels is about a micrometre of liquid, which no machine keeps to.
inline constexpr double kLeastAtPlatform = 0.995;

/// The figures of a prediction.
struct Prediction {
  int layers = 0;                         ///< slices shown
  double layer_um = 0;                    ///< slice height, as a rule
  LayerHeights heights{};                 ///< of layers, where they differ
  double pixel_x_um = 0, pixel_y_um = 0;  ///< width and height of a pixel
  std::uint64_t target_voxels = 0;        ///< coverage 1
  std::uint64_t printed_voxels = 0;       ///< printed, of coverage 0 or 1
  std::uint64_t cure_through_voxels = 0;  ///< printed, of coverage 0
  std::uint64_t undercure_voxels = 0;     ///< not printed, of coverage 1
  std::uint64_t grey_voxels = 0;          ///< coverage between 0 and 1, in none of the counts above
  std::uint64_t left_alone_voxels = 0;    ///< shown as they are (target.hpp), in no other count
  std::uint64_t runs = 0, gaps = 0;       ///< see the head of this file
  std::uint64_t lost_features = 0;        ///< runs with nothing printed in them
  std::uint64_t lost_thick_features = 0;  ///< of these, runs of two slices or more
  std::uint64_t one_slice_gaps = 0;       ///< gaps one slice high: they can't have both edges right
  std::uint64_t split_features = 0;       ///< runs printed in more than one piece
  /// Runs on the platform that print, but whose dose at the platform itself stays below
  /// `kLeastAtPlatform`: liquid lies between. In `runs_on_platform`, the number of all of these.
  std::uint64_t liquid_at_platform = 0, runs_on_platform = 0;
  std::uint64_t merged_features = 0;    ///< gaps with nothing unprinted in them
  std::uint64_t merged_thick_gaps = 0;  ///< of these, gaps of two slices or more
  FeatureExamples lost_examples, merged_examples, split_examples;
  Histogram height_error_um;  ///< absolute values, one per designed edge
  /// The same from the design's own surface, of edges whose height the target knows (target.hpp).
  Histogram surface_error_um;
  /// Absolute distances, in the plane of each slice and along its rows and columns, of the print's
  /// outline from each edge of the design's: a sample per side of a pixel. Where light spreads from
  /// column to column; empty where it does not, and outlines are those of pixels.
  Histogram plane_error_um;
  double plane_overreach_um = 0, plane_shortfall_um = 0;  ///< see the two below
  std::int64_t plane_signed_nm = 0;  ///< the same summed with its sign: outwards is above 0
  std::uint64_t plane_closed = 0;    ///< such edges whose print reaches the next feature, or far
  std::uint64_t plane_lost = 0;      ///< of lines where nothing prints from edge to edge, or far
  FeatureExamples plane_closed_examples, plane_lost_examples;
  std::optional<FinestPrint> finest;  ///< where light spreads; not merged, set for whole stacks
  double greatest_overreach_um = 0;   ///< furthest that the print reaches into a gap
  double greatest_shortfall_um = 0;   ///< furthest that an edge stays behind in its run
  Histogram gap_contrast;             ///< 1 less the least dose of each gap, at least 0
  std::uint64_t gap_teeth = 0;  ///< printed stretches in gaps that touch neither of their edges
  std::optional<LayerwiseFigures> layerwise;
  std::optional<JointFigures> joints;  ///< with lifts
  /// Where light was made for an even dead zone: doses in resin that flows; as `dead_zones`.
  std::optional<FlowDoses> flow;
  /// How hard the part pulls at window and vat, where it was judged with the correction.
  std::optional<PrintSuction> suction;
  std::optional<DeadZones> dead_zones;  ///< under UV light; not merged, set for whole stacks
  Histogram grey_dose_error;            ///< absolute difference of mid-layer dose and coverage
  /// Least and greatest dose at mid-layer in layers of coverage 1, the greatest in those of
  /// coverage 0; infinite without such layers. `min_inside_layers`: the least at any place in
  /// layers of coverage 1.
  /// `at_heights`: of a stack that was corrected to edge heights, whose features may end inside
  /// layers. Of such a layer only the part from the middle to the inner node counts.
  bool at_heights = false;
  double min_dose_inside = std::numeric_limits<double>::infinity();
  double min_inside_layers = std::numeric_limits<double>::infinity();
  double max_dose_inside = -std::numeric_limits<double>::infinity();
  double max_dose_outside = -std::numeric_limits<double>::infinity();
  /// Greatest dose in the middle of a layer of columns that are black in all slices; 0 without any.
  double black_alone_dose = 0;
  std::vector<RegionDose> regions;  ///< where doses are wanted; not merged, set for whole stacks
  /// Not merged, set for whole stacks; null where nobody asked.
  std::shared_ptr<const SurfaceMaps> maps;
  /// What hangs together and what is trapped (bodies.hpp); not merged, set for whole stacks; null where
  /// nobody looked.
  std::shared_ptr<const JudgedBodies> bodies;
  /// What each slice lights (layer_areas.hpp); not merged, set for whole stacks; null where nobody
  /// asked.
  std::shared_ptr<const LayerAreas> areas;
  /// How sure all of this is (uncertain_print.hpp); not merged, set for whole stacks; null where
  /// nobody asked.
  std::shared_ptr<const UncertainPrint> uncertain;
  /// Where the resin was measured at another wavelength than the printer's light has; not merged, set
  /// for whole stacks.
  std::optional<OtherWavelength> other_wavelength;
  /// Of which display the seconds of full light are that doses are told in, where it is not that of the
  /// printer; "" where nobody says. Not merged, set for whole stacks.
  std::optional<std::string> other_display;
  /// Gaps of one slice were to be filled (`OneSliceGaps::merge`); not merged, set for whole stacks.
  bool slits_merged = false;
  AssumedLight assumed =
      AssumedLight::none;  ///< light and dose were; not merged, set for whole stacks
  /// Column and row of the edge with the greatest height error (the first such pixel); -1: none.
  int worst_x = -1, worst_y = -1;

  /// How far edges are from the design: from its own surface where the target knows that, else from
  /// nodes.
  const Histogram& design_error_um() const {
    return surface_error_um.count() > 0 ? surface_error_um : height_error_um;
  }
  /// How far outlines lie outwards (above 0) or inwards on average, um; 0 without any.
  double plane_signed_um() const;
  /// Printed and designed, over printed or designed; 1 when there is neither.
  double iou() const;
  void merge(const Prediction& other);
  /// The JSON of the contract; figures without samples are null.
  std::string to_json() const;
};

/// Per column, how far the print reaches beyond the edge seen from below and the one seen from
/// above, um; see SurfaceMaps. NaN: there is none.
struct EdgeSides {
  std::vector<float> below_um, above_um;
};

/// What a slice of a design says of neighbouring columns, a byte of each for every column.
struct DesignRow {
  // NOLINTNEXTLINE(google-explicit-constructor): most designs are their coverage
  DesignRow(const std::uint8_t* its_coverage, const std::uint8_t* its_heights = nullptr,
            const std::uint8_t* its_left_alone = nullptr)
      : coverage(its_coverage), heights(its_heights), left_alone(its_left_alone) {}
  const std::uint8_t* coverage;  ///< null: empty
  const std::uint8_t* heights;   ///< edge heights of its upper node (target.hpp); null: none
  /// Not 0 for voxels that are neither of a feature nor of a gap, whatever they print; null: none.
  const std::uint8_t* left_alone;
};

/// Predicts one band, slices from the last to the first.
class BandPredictor {
 public:
  /// `all_layers` is the greater of the number of slices and of target layers. `in_showings`:
  /// slices come as showings that have places in them.
  BandPredictor(const CureModel& model, const PixelCurve& curve, int all_layers,
                std::size_t columns, bool in_showings = false);
  ~BandPredictor();

  /// Told every designed edge: its column, its node, whether it is the run's edge towards the
  /// platform, and its signed height error.
  using EdgeSink = std::function<void(std::size_t column, int node, bool upper, double um)>;
  void tell_edges(EdgeSink sink);
  /// Told every run: its column, its first and last layer, whether nothing of it prints, and whether it
  /// prints in more than one piece.
  using RunSink =
      std::function<void(std::size_t column, int first, int last, bool lost, bool split)>;
  void tell_runs(RunSink sink);
  /// Told every gap (`Prediction::gaps`): its column, its first and last layer, and its least dose.
  using GapSink = std::function<void(std::size_t column, int first, int last, double least_dose)>;
  void tell_gaps(GapSink sink);
  /// Told of the voxels of a column at which something changes on the way from the last slice to
  /// the first, and of all grey ones: the slice, its coverage, whether it prints in its middle, and
  /// whether it prints at its upper node. A voxel that is not told has the coverage of the one told
  /// before it, and prints if that one's upper node does. Before the first told voxel: coverage 0,
  /// unprinted. Several may be told.
  using StateSink = std::function<void(std::size_t column, int slice, std::uint8_t coverage,
                                       bool prints, bool prints_above)>;
  void tell_states(StateSink sink);
  /// Told of the layers of a column, from the last to the first, at which it becomes another when their
  /// middle gels, and with that of layers before: so many slices after its own each, at most `longest`; or
  /// all in the step of slices that n ends: -1 - n. Before the first told, and where layers do not gel: 0. False,
  /// and nothing is told, where moments are not known: they are where doses are sums of light and light
  /// does not spread; not of recordings. The sink gives false where nothing more is to be told.
  using DelaySink = std::function<bool(std::size_t column, int slice, int delay)>;
  bool tell_delays(DelaySink sink, int longest);
  /// Height errors are measured from edge heights, where there are some, and not from nodes: those
  /// of a stack that was corrected to them. Before the first slice.
  void aim_at_heights();
  /// Keeps the sides of columns, for `sides`. Before the first slice.
  void keep_sides();
  /// After `finish`, where they were kept.
  const EdgeSides& sides() const;
  /// Leaves the histograms of the figures empty: together they take 0.3 MB, and an uneven display
  /// has a predictor for each value of its light. Before the first slice.
  void keep_no_histograms();

  /// `pixels` null: nothing is shown (light off, after the end of the stack).
  void add_slice(int slice, const std::uint8_t* pixels, const DesignRow& design);
  /// The same of several images, see ImageShowing; none: light off.
  void add_slice(int slice, std::span<const ImageShowing> showings, const DesignRow& design);
  /// Several slices of up to `kTileColumns` neighbouring columns at once, in rows of `kTileColumns`
  /// bytes from the first slice on; `pixels` null: nothing is shown. The same figures as by
  /// `add_slice`, and much faster. Each column needs all of its slices from the last to the first;
  /// columns start at multiples of `kTileColumns`. Only where it `takes_tiles`; nothing is left alone.
  static constexpr std::size_t kTileColumns = 64;
  struct TilePlace {
    std::size_t first_column, columns;
    int first_slice, slices;
  };
  void add_tile(const TilePlace& place, const std::uint8_t* pixels, const DesignRow& design);
  /// Of plain models, without showings.
  bool takes_tiles() const;
  int all_layers() const;
  /// Doses in the middle of the layer that was added last. Only for models that are not plain, or
  /// for showings.
  const double* middle() const;
  /// Called before the first slice: `finish` adds the figures of this band to `so_far`.
  void go_on_from(Prediction so_far);
  /// Called after slice 0: closes what is open at the platform and gives the figures. Columns are
  /// `width` to a row, from (x0, y0).
  Prediction finish(int x0, int y0, int width);
  /// The same for columns that lie anywhere; `place` must rise in reading order with the column.
  using PixelOfColumn = std::function<Pixel(std::size_t column)>;
  Prediction finish(const PixelOfColumn& place);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Counts the columns of an image in which nothing is designed and nothing but black is shown.
Prediction predict_black_columns(const CureModel& model, int slices, std::uint64_t columns);
/// The same where slices show several images: `showings` gives what a column without a pixel above
/// black sees of a slice.
using BlackShowings = std::function<std::span<const ImageShowing>(int slice)>;
Prediction predict_black_columns(const CureModel& model, int slices, std::uint64_t columns,
                                 const BlackShowings& showings);

}  // namespace slicecorr
