/// @file turned.hpp
/// Slices seen turned or mirrored, band by band.
#pragma once

#include <memory>
#include <string>

#include "slicecorr/orientation.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// The slices of `source`, each turned. Turns that exchange rows and columns read the source once,
/// when made, and keep it in small blocks, run-length coded, in a `PieceStore` (256 MiB in memory,
/// the rest in scratch); others read it each time. Thread-safe for reading different bands.
class TurnedSlices final : public SliceSource {
 public:
  /// `source` must outlive this.
  TurnedSlices(const SliceSource& source, const Turn& turn, const std::string& scratch_folder,
               const Job& job = {});
  ~TurnedSlices() override;
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override;
  ImageFrame frame() const override;
  void read_band(const PixelBox& band, const Sink& sink) const override;

 private:
  class Transposed;
  const SliceSource& source_;
  Turn turn_;
  Grid grid_;
  std::unique_ptr<const Transposed> transposed_;
};

}  // namespace slicecorr
