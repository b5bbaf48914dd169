// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a prediction knows of a band while slices go past; see BandPredictor.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "predict/gel_moments.hpp"
#include "predict/joints.hpp"
#include "predict/layers_seen.hpp"
#include "predict/tile_sums.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

namespace detail {
struct BlockSums;
}  // namespace detail

struct BandPredictor::State {
  State(const CureModel& model, const PixelCurve& curve, int all_layers, std::size_t columns,
        bool in_showings);
  ~State();

  void add_slice(int slice, const std::uint8_t* pixels, const DesignRow& design);
  void add_slice(int slice, std::span<const ImageShowing> showings, const DesignRow& design);
  void add_tile(const TilePlace& place, const std::uint8_t* pixels, const DesignRow& design);
  struct TileSlice;
  /// Columns of a tile's slice that are grey, come into another class, or cross dose 1.
  void add_lanes(const TileSlice& s);
  void go_on_from(Prediction so_far);
  void keep_sides();
  bool tell_delays(DelaySink sink, int longest);
  Prediction finish(const PixelOfColumn& place);

  enum Class : std::uint8_t { gap, run, grey };
  struct Column {
    double start = 0;  ///< zeta where the present printed or unprinted stretch begins (lower end)
    std::int32_t lower = 0;         ///< node where the present class begins (lower end)
    std::uint8_t lower_height = 0;  ///< edge height of that node
    bool seeks_print =
        false;  ///< the run's lower edge is unprinted; its first printed point is sought
    bool seeks_end = false;    ///< the print reaches into this gap from below; its end is sought
    bool any_printed = false;  ///< of the present run
    bool split = false;        ///< the present run prints in more than one piece
    bool run_below = false;    ///< there is a run further down
    bool gap_seen = false;     ///< a layer of coverage 0 since the run below
    std::int32_t gap_layers = 0;
    std::int32_t gap_end = 0;  ///< node of the upper edge of the run below
    bool tooth = false;        ///< the present printed stretch began inside this gap
  };
  /// Doses of a column in a layer; `least`: of all of them inside it.
  struct LayerDose {
    double lower, middle, upper, least;
  };
  void add_plain_slice(int slice, std::span<const ImageShowing> showings, const std::uint8_t* cover,
                       const std::uint8_t* heights);
  void add_general_slice(int slice, std::span<const ImageShowing> showings,
                         const std::uint8_t* cover, const std::uint8_t* heights);
  /// Edge heights of the two nodes of a layer; 0: none.
  struct NodeHeights {
    std::uint8_t lower = 0, upper = 0;
  };
  /// `below`: dose on the far side of the layer's lower node; `crossings`: see InsideLayer.
  void event(std::size_t i, int slice, double below, LayerDose dose,
             std::span<const double> crossings, std::uint8_t coverage, NodeHeights heights);
  /// Whether an upper edge is aimed at inside the layer below its node: what the layer doses above
  /// the edge lies beyond the feature.
  bool ends_inside(std::uint8_t upper_height) const {
    return prediction_.at_heights && upper_height > kEdgeAtNode;
  }
  /// The classes of a block, with those of layers in which an edge is aimed at changed, so that they
  /// are looked at one by one. `room`: for a block.
  const std::uint8_t* classes_of_block(std::size_t b, std::size_t n, const std::uint8_t* heights,
                                       std::uint8_t* room) const;
  void look_inside(int slice, std::size_t first, std::size_t n, const std::uint8_t* cover);
  /// Keeps the layer of column i for later, where it is a steady one of a gap: the least dose of all such layers is that
  /// of the one with least from far, and is looked for once. False where it is none.
  bool put_off(std::size_t i);
  /// Looks inside the layer that was put off.
  void look_at_last(std::size_t i);
  void leave_stretch(std::size_t i);
  /// The dose crosses 1 at `zeta`; from there on upwards it is on the other side.
  void cross(std::size_t i, double zeta, bool printed, Class now);
  /// `before`, `after`: dose on the two sides of the node; `height`: its edge height.
  void enter(std::size_t i, int node, std::uint8_t height, Class next, double before, double after);
  void close_gap(std::size_t i, int top);
  /// From one place down to another, in layers of `layer_um`; both count layers as they are.
  double between(double from, double to) const {
    return model_.heights.alike() ? to - from : model_.depth(to) - model_.depth(from);
  }
  void error(std::size_t i, int node, std::uint8_t height, bool upper, double slices);
  void lose(std::size_t i, int top);

  const CureModel& model_;
  const PixelCurve& curve_;
  int all_layers_;
  bool in_showings_;
  std::unique_ptr<detail::JointWalker> joints_;  ///< with lifts
  std::unique_ptr<detail::GelMoments> moments_;  ///< where somebody asked for delays
  std::unique_ptr<BandDose> dose_;  ///< for models that are not plain, and for showings
  /// Dose at the upper end of the layer that was added last.
  std::vector<double> omega_;
  /// Per column: in a gap the least dose since it began; in a run since it began or, where print
  /// came back in it, since then.
  std::vector<double> least_;
  /// Columns of the present block whose dose was looked at inside the layer, as bits, and what was
  /// found.
  std::uint64_t looked_ = 0;
  bool passes_inside_ = false;  ///< any of these has crossings
  std::vector<InsideLayer> inside_;
  LayersSeen layers_seen_;
  /// Per column the layer that was put off; none where its weight is 0. Made when the first is.
  std::vector<SteadyLayer> put_off_;
  std::vector<Class> class_;
  std::vector<Column> columns_;
  std::vector<std::uint8_t> lower_heights_;  ///< edge heights of the next slice's lower node
  std::vector<std::uint8_t> empty_;
  /// What is left alone in the present slice, null: nothing; and its coverage, where that is grey.
  const std::uint8_t* left_alone_ = nullptr;
  std::vector<std::uint8_t> with_left_alone_;
  /// Class of all columns of a block of 32; `grey` also when they differ.
  std::vector<Class> block_class_;
  std::unique_ptr<detail::BlockSums> sums_;
  std::unique_ptr<detail::TileSums> tile_sums_;  ///< null before the first tile
  double worst_ = -1, worst_so_far_ = -1;
  std::size_t worst_column_ = 0;
  EdgeSink edge_sink_;
  RunSink run_sink_;
  GapSink gap_sink_;
  StateSink state_sink_;
  bool histograms_ = true;
  EdgeSides sides_;  ///< empty: not kept
  /// Examples whose y is the index of the column (x is 0), until `finish` knows where the band
  /// lies.
  FeatureExamples lost_, merged_, split_;
  Prediction prediction_;
};

}  // namespace slicecorr
