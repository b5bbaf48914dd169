// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Beams along axes as the solver's operators.
#pragma once

#include <vector>

#include "slicecorr/tomo/projector.hpp"
#include "tomo/beams/beam_grid.hpp"

namespace slicecorr::tomo::detail {

/// The deciding cells of a volume. Their grid couples all slices; an angle is a beam, and angles
/// beyond the last are dark. Columns of cells that the square grid has besides hold nothing.
class BeamProjector final : public Projector {
 public:
  /// `part`: of which `cells` are.
  BeamProjector(const Box<std::uint8_t>& part, const DecidingCells& cells, const BeamSetup& setup);

  const TomoGrid& grid() const override { return grid_; }
  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override;
  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override;
  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override;

  const std::vector<Beam>& beams() const { return beams_; }
  int nx() const { return nx_; }
  int ny() const { return ny_; }
  int nz() const { return nz_; }
  /// Share of a beam's light that is left at a cell.
  float left(std::size_t beam, int x, int y, int z) const {
    const int axis = beams_[beam].axis;
    return left_[beam][static_cast<std::size_t>(axis == 0 ? x : axis == 1 ? y : z)];
  }
  /// Where the light of a beam at a cell stands.
  std::size_t pixel(std::size_t beam, int x, int y, int z) const {
    const int axis = beams_[beam].axis, k = static_cast<int>(beam);
    if (axis == 0) return grid_.pixel(k, y, z);
    if (axis == 1) return grid_.pixel(k, x, z);
    return grid_.pixel(k, x, y);
  }

 private:
  std::vector<Beam> beams_;
  int nx_, ny_, nz_;
  TomoGrid grid_;
  std::vector<Array<float>> left_;  ///< by beam, of the light along it; 0 in lanes without a cell
};

}  // namespace slicecorr::tomo::detail
