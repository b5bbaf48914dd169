// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Targets with edge heights, as the correction sees them: gentle slopes without their greys.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "base/coded_band.hpp"

namespace slicecorr::detail {

/// Takes the coverage of a band, slice after slice, and gives it on with what its edge heights say.
///
/// Where a surface rises gently, coverage leads in a few grey layers from full to empty, and the
/// same surface has an edge height at one of these layers' nodes: two words for one edge. There the
/// height counts. A *run* of at most `kLongestRun` grey layers of a column, between a full layer on
/// one side and an empty one on the other, that has exactly one edge height at its nodes, becomes
/// full on the full side of that node and empty on the other. What lies beyond the first and the
/// last slice counts as empty.
///
/// All other greys stay as they are: those of steep walls, whose edge lies in the plane. Of the
/// heights only those count, and are given on, that lie between a full and an empty layer of the
/// coverage that is given on.
///
/// One object for one band and thread.
class SharpEdges {
 public:
  static constexpr int kLongestRun = 24;

  /// Coverage of slice n, and edge heights of node n, valid during the call; null stands for rows
  /// of 0. After the last slice once more, without coverage, for the node after it.
  using Sink =
      std::function<void(int n, const std::uint8_t* coverage, const std::uint8_t* heights)>;

  /// `heights`: one image per node, of the same columns; must outlive this.
  /// `sharpen`: off leaves all greys as they are; heights are given on as ever.
  SharpEdges(const CodedBand& heights, Sink sink, bool sharpen = true);

  /// Takes the next slice; null is black. Slices are given on `kLongestRun` slices later.
  void add(const std::uint8_t* rows);
  /// After the last slice. Gives on all that is left.
  void finish();

 private:
  /// A slice with its upper node. Pixels are padded to whole words of `kRowWord`.
  struct Row {
    bool black = true, grey = false;
    std::vector<std::uint8_t> coverage;  ///< 0 when `black`
    std::vector<std::uint64_t> greys;    ///< of the coverage that was taken, when `grey`
    std::vector<NonZero> heights;
    std::vector<std::uint8_t> height_at;  ///< the same, by column
  };
  /// Slices from -1 on, as long as they are needed: two more than the longest run has.
  static constexpr int kRows = kLongestRun + 2;
  Row& row(int n) { return rows_[static_cast<std::size_t>(n + kRows) % kRows]; }

  void take(const std::uint8_t* rows);
  void end_runs();
  void resolve(std::size_t column);
  void give(int n);

  const CodedBand& heights_;
  const Sink sink_;
  const bool sharpen_;
  const std::size_t columns_, words_;
  int taken_ = 0, given_ = 0;  ///< slices
  Row rows_[kRows];
  std::vector<std::uint8_t> kept_;  ///< all 0 between slices
};

}  // namespace slicecorr::detail
