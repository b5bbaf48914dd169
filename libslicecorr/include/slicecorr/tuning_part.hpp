// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tuning_part.hpp
/// Parts to measure, which tell what printer and resin really are: each as slices, as a table to
/// fill in and as a sheet that says what to measure where. (Lines and gaps: test_part.hpp.)
///
/// `comb`: behind 20 dark slices, six teeth of 10 slices with gaps of 4, 6, 8, 12 and 16, on a
/// spine (dissertation figure 2.5(b)). It is corrected and printed continuously.
/// `lift_comb`: behind 20 dark slices, six teeth of 1, 2, 4, 8, 16 and 32 slices with gaps of 16, on a
/// spine. It is corrected as if lifts exchanged nothing, and printed layer by layer: the light of a few lifts and that
/// of many tell the share of resin that a lift exchanges from the absorbance height (docs/tuning.md).
/// All others cure on the window, platform away (dissertation §3.2.3, §3.2.4):
/// `staircase`: six plugs of each of up to three intensities, at 1.5 to 9 times the gel dose. They
/// are lit from the first image on and go dark one after the other.
/// `wedge`: steps of one piece, at 1.3 to 9 times the gel dose, by grey levels in one image.
/// `dead_zone`: plugs of twelve intensities over a factor of ten, under even UV light.
/// `flat_field`: a grid of plugs over all of the plate, at full light.
///
/// Immutable and thread-safe.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/measuring_form.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

enum class TuningPartKind { comb, staircase, wedge, dead_zone, flat_field, lift_comb };
/// "dead-zone"
const char* word_of(TuningPartKind kind);

class TuningPart final : public SliceSource {
 public:
  /// A place that is measured.
  struct Row {
    std::string name, kind;       ///< "tooth 1 begins", "upper"; kinds: plug, upper, lower
    PixelBox box{};               ///< of its light
    double designed_um = 0;       ///< of edges, from the platform
    double intensity_mw_cm2 = 0;  ///< of plugs, where they are, black counted
    double shown_s = 0;           ///< how long a plug is lit
    double dark_s = 0;            ///< how long it is dark after that
    double dark_mw_cm2 = 0;       ///< light of black pixels there
    /// Time in this light alone that gives the plug's dose: `shown_s`, and what black light adds.
    double exposure_s = 0;
  };
  /// What parts need besides the printer.
  struct Ask {
    double layer_um = 50;          ///< > 0
    const Resin* resin = nullptr;  ///< of staircase, wedge and flat_field
    double uv_mw_cm2 = 0;          ///< of dead_zone, > 0
    double exposure_s = 30;        ///< of dead_zone, > 0
  };
  /// Images of the plate. Throws `InputError` where the display is too small or not dark enough, or
  /// where something is missing.
  TuningPart(TuningPartKind kind, const Printer& printer, const Ask& ask);

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return bounds_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  TuningPartKind kind() const { return kind_; }
  /// Whether it is teeth and gaps, corrected and printed.
  bool is_comb() const {
    return kind_ == TuningPartKind::comb || kind_ == TuningPartKind::lift_comb;
  }
  const std::vector<Row>& rows() const { return rows_; }
  /// For how long each image is shown; none of combs.
  const std::vector<double>& image_s() const { return image_s_; }
  /// The column of a comb that goes through all teeth.
  int x_px() const { return x_px_; }
  int y_px() const { return y_px_; }
  /// The table to fill in.
  MeasuringForm form() const;
  /// A page to print: what to show, what to measure where with which tool, and what to do with the
  /// table, whose file is called `form_file`; the printer's is called `printer_file`.
  std::string sheet(const std::string& form_file, const std::string& printer_file) const;

 private:
  struct Block {
    PixelBox box;
    int first, past;  ///< slices
    std::uint8_t value;
  };
  void make_comb(const Printer& printer);
  void make_staircase(const Printer& printer);
  void make_wedge(const Printer& printer);
  void make_dead_zone(const Printer& printer);
  void make_flat_field(const Printer& printer);
  /// The boxes of a grid of plugs in the middle of the plate, row by row; `apart`: with dark between
  /// them.
  std::vector<PixelBox> boxes(const Printer& printer, int columns, int rows, bool apart) const;

  TuningPartKind kind_;
  Ask ask_;
  std::string printer_name_;
  Grid grid_;
  PixelBox bounds_;
  std::vector<Block> blocks_;
  std::vector<Row> rows_;
  std::vector<double> image_s_;
  int x_px_ = 0, y_px_ = 0;
  int columns_ = 0;         ///< of the grid of a flat-field
  double height_e_um_ = 0;  ///< absorbance height of the resin, base e
};

}  // namespace slicecorr
