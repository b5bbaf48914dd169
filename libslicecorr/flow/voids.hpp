// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Voids of a part, from the platform on: which of them the bath has reached.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/flow_part.hpp"

namespace slicecorr::detail {

/// The cells of a slice.
struct SliceCells {
  std::vector<FlowCell> kinds;
  std::vector<int> voids;  ///< of blind cells; else -1
};

/// Takes slices one after the other. What is known of a void at a slice comes from it and from
/// earlier ones.
class Voids {
 public:
  Voids(const FlowGrid& grid, double layer_um) : grid_(grid), layer_um_(layer_um) {}

  /// `coverage`: bytes of cells, with a dark ring around.
  void add_slice(const std::vector<std::uint8_t>& coverage, SliceCells& cells);
  /// The slice before once more: the same cells, but that all that is lit has gelled material
  /// above. Only after a slice.
  void add_again(SliceCells& cells);
  /// After the last slice.
  std::vector<BlindVoid> blind() const;

 private:
  /// What joined another stands for nothing of its own any more; the first is the bath.
  struct Void {
    int parent = 0;  ///< itself: it stands for all that joined it
    double cells = 0;
    std::size_t widest = 0;     ///< cells of its greatest piece within a slice
    double x_mm = 0, y_mm = 0;  ///< middle of that
    int first = 0, last = 0;
  };
  /// A connected dark piece of a slice.
  struct Piece {
    int void_of = kLit;  ///< kLit: not known yet
    std::size_t cells = 0;
    double x_mm = 0, y_mm = 0;  ///< middle
  };
  static constexpr int kLit = -1, kBath = 0;

  int root(int v);
  void join(int a, int b);
  int add_void();
  BlindVoid described(const Void& v, bool vented) const;
  void label(const std::vector<std::uint8_t>& coverage);
  void set(SliceCells& cells, std::size_t cell, int of) const;
  void connect();
  void measure();

  FlowGrid grid_;
  double layer_um_;
  int slice_ = -1;
  std::vector<Void> voids_;
  std::vector<BlindVoid> done_;    ///< those that the bath reached
  std::vector<int> before_, now_;  ///< the void of each cell, or kLit; empty before the first slice
  std::vector<Piece> pieces_;
  std::vector<int> piece_;  ///< of each cell, or kLit
  std::vector<std::size_t> stack_;
};

}  // namespace slicecorr::detail
