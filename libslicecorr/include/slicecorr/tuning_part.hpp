/// @file tuning_part.hpp
/// Parts to print and measure, from which `resinctl tune` finds what resin and light really are.
///
/// `comb`: behind 20 dark slices, six teeth of 10 slices with gaps of 4, 6, 8, 12 and 16, on a
/// spine (dissertation figure 2.5(b)). `staircase`: plugs that cure on the window, platform away;
/// plug n is lit in images 1 to n, which are shown for different times.
///
/// Immutable and thread-safe.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

enum class TuningPartKind { comb, staircase };

class TuningPart final : public SliceSource {
 public:
  struct Row {
    std::string name, kind;       ///< "tooth 1 begins", "upper"; kinds: plug, upper, lower
    double designed_um = 0;       ///< from the platform; 0 of plugs
    double exposure_s = 0;        ///< of plugs
    double intensity_mw_cm2 = 0;  ///< of plugs
  };
  /// Images of the plate. `layer_um` > 0. `resin` says how long plugs take, at 1.5 to 9 times its
  /// gel dose, and may be null for a comb. Throws `InputError` where the display is too small or
  /// the resin is missing.
  TuningPart(TuningPartKind kind, const Printer& printer, const Resin* resin, double layer_um);

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return bounds_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  const std::vector<Row>& rows() const { return rows_; }
  /// A table for `resinctl tune`, to fill in.
  std::string form() const;
  /// A page to print: what to measure where with which tool.
  std::string sheet() const;

 private:
  struct Block {
    PixelBox box;
    int first, past;  ///< slices
  };
  TuningPartKind kind_;
  Grid grid_;
  PixelBox bounds_;
  std::vector<Block> blocks_;
  std::vector<Row> rows_;
  int x_px_ = 0, y_px_ = 0;  ///< middle of the teeth
};

/// What names a part in its table: 16 hex digits of all that the table says but what was measured.
std::string tuning_hash(std::string_view text);

}  // namespace slicecorr
