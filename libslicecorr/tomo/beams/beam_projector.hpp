// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Beams along axes as the solver's operators.
#pragma once

#include <vector>

#include "slicecorr/tomo/projection.hpp"
#include "tomo/beams/beam_grid.hpp"

namespace slicecorr::tomo::detail {

/// The deciding cells of a volume, [y][x][z], and the images of all beams, [beam][column][row].
class BeamProjector final : public Projector {
 public:
  /// `part`: of which `cells` are.
  BeamProjector(const Box<std::uint8_t>& part, const DecidingCells& cells, const BeamSetup& setup);

  Shape shape() const override { return shape_; }
  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override;
  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override;

  /// Share of a beam's light that is left at a cell.
  float left(std::size_t beam, int x, int y, int z) const {
    const int axis = beams_[beam].axis;
    return left_[beam][static_cast<std::size_t>(axis == 0 ? x : axis == 1 ? y : z)];
  }
  std::size_t cell(int x, int y, int z) const {
    return (static_cast<std::size_t>(y) * side_ + x) * shape_.lanes + z;
  }
  /// A pixel of a beam's image, and that whose light is at a cell.
  std::size_t pixel(std::size_t beam, int column, int row) const {
    return (beam * side_ + column) * rows_ + row;
  }
  std::size_t pixel(std::size_t beam, int x, int y, int z) const {
    const int axis = beams_[beam].axis;
    return pixel(beam, axis == 0 ? y : x, axis == 2 ? y : z);
  }

 private:
  std::vector<Beam> beams_;
  int nx_, ny_, nz_;
  /// Places along x, as many as along y where these are more, and the same for the columns of images;
  /// places for their rows, in whole cache lines.
  std::size_t side_, rows_;
  Shape shape_;
  /// Adds the light of a beam that goes sideways at one place along it, [row][column], or takes it from
  /// there.
  void blur(std::size_t beam, std::size_t place, const std::vector<float>& from,
            std::vector<float>& to) const;
  int place_count(std::size_t beam) const;
  int image_columns(std::size_t beam) const { return beams_[beam].axis == 0 ? ny_ : nx_; }
  int image_rows(std::size_t beam) const { return beams_[beam].axis == 2 ? ny_ : nz_; }
  /// The cell at a place along a beam, over a pixel.
  std::size_t cell_over(std::size_t beam, int place, int column, int row) const;
  void forward_sideways(const float* field, float* light, const ExecutionContext& context) const;
  void adjoint_sideways(const float* light, float* field, const ExecutionContext& context) const;

  std::vector<std::vector<CellBlur>> blurs_;  ///< by beam and place along it; empty: none
  std::vector<Array<float>> left_;  ///< by beam, of the light along it; 0 in lanes without a cell
};

}  // namespace slicecorr::tomo::detail
