// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file optics_fit.hpp
/// Where a tomographic printer's axes, lens and vial are, from pins that were found in its light.
///
/// A pin stands in the vial, filled with resin, at a known distance from the axis. The stage is
/// turned, and at each angle that column of the image is looked for whose light falls on the pin;
/// where the pin bears a mark of known height, also the row. The ray of a pixel in the resin is the
/// closed form of vial.hpp, so a pin's column and row are found for any printer; Ceres moves the
/// printer until they are those measured. Residuals are in pixels.
///
/// Functions are thread-safe.
#pragma once

#include <array>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

struct OpticsPoint {
  int line = 0;          ///< of the file
  double angle_deg = 0;  ///< that the stage has turned, in the direction in which it prints
  double radius_mm = 0;  ///< of the pin from the axis, >= 0
  double pin_deg = 0;    ///< where it stands in the vial, counterclockwise seen from above
  /// Height of its mark above any datum; NaN: no mark, and `row_px` is the row looked at.
  double z_mm = std::numeric_limits<double>::quiet_NaN();
  double column_px = std::numeric_limits<double>::quiet_NaN();  ///< NaN: not measured
  double row_px = std::numeric_limits<double>::quiet_NaN();     ///< NaN: at the optical axis
  double sigma_px = 1;  ///< scatter against that of other points, > 0
};

struct OpticsPoints {
  std::string source;
  std::vector<OpticsPoint> points;
};

/// A table with the columns angle_deg, radius_mm and column_px, and pin_deg, z_mm, row_px, sigma_px
/// as far as it has them, in any order; a header names them. Throws `InputError` naming file and
/// line.
OpticsPoints read_optics_points(const std::string& path);

struct OpticsFitOptions {
  std::map<std::string, double> fixed;  ///< parameters that are held at a value
  std::set<std::string> held;           ///< that are held at the printer's
  std::set<std::string> free;           ///< that are fitted though they are held without this
  bool keep_outliers = false;           ///< count them, too
};

struct OpticsParameter {
  std::string name;  ///< key of the printer file; n: the resin's; pin_deg, z_mm: of the pins
  std::string unit;
  double before = 0, value = 0;
  bool fitted = false;
  double standard_error = 0;     ///< where fitted
  std::array<double, 2> ci95{};  ///< where fitted
};

/// Measured less found, pixels; NaN where not measured.
struct OpticsResidual {
  int line = 0;
  double angle_deg = 0, radius_mm = 0, pin_deg = 0;
  double column_px = 0, row_px = 0;
  bool column_left_out = false, row_left_out = false;  ///< outliers
};

struct OpticsFit {
  std::string source;
  Printer printer;  ///< with what was found
  double n = 0;     ///< index of the resin
  std::vector<OpticsParameter> parameters;
  std::vector<OpticsResidual> residuals;
  std::vector<std::string> notes;  ///< sentences
  int measurements = 0;            ///< columns and rows that count
  int freedom = 0;
  double rms_px = 0;
  /// Pixels (rms) by which points of the same angle are off from each other, where angles have several;
  /// and whether that is as little as reading explains (1 pixel), so that vial and lens are the machine's.
  double apart_px = 0;
  bool fits = true;

  const OpticsParameter& parameter(const std::string& name) const;
  std::string to_text() const;
  std::string to_json() const;
  /// Lines for the printer file; of the resin's index as a comment.
  std::string to_toml() const;
  /// How far the axis goes astray at each angle: the mean of the residuals there and what the
  /// printer's file says already, as a file of `[rotation] wobble`.
  std::string wobble_csv() const;
};

/// `n`: the resin's index to begin with. Fitted are axis_right_px, n unless the bath has it, with
/// a pinhole distance_mm, with several rows tilt_deg, with marks and a pinhole axis_up_px; and the
/// pins' own pin_deg, and z_mm of their datum. Held unless freed: outer_mm, inner_mm, n_wall. Points
/// that can't belong to the others (p < 0.01 for the worst of all) are left out, up to a fifth.
/// Throws `InputError` for unknown names, too few points, those that leave something open (with
/// what to measure next), too many outliers, and where the stage turns the other way than the
/// printer's file says.
OpticsFit fit_optics(const OpticsPoints& points, const Printer& printer, double n,
                     const OpticsFitOptions& options = {});

/// The text of a printer file with what was found in its keys, the rest of it as it stands. Throws
/// `InputError` where the text is no file of a tomographic printer.
std::string printer_with_optics(const std::string& text, const std::string& source,
                                const OpticsFit& fit);

/// Where that printer shows a point: its column, and its row where it has a mark (else the row that
/// was looked at). `pins_deg`, `datum_mm`: of all pins. NaN where no pixel's light comes to it.
struct SeenAt {
  double column = 0, row = 0;
};
SeenAt seen_at(const Printer& printer, double n, const OpticsPoint& point, double pins_deg,
               double datum_mm);

/// Residuals by angle, and columns measured against those found.
std::string optics_fit_svg(const OpticsFit& fit);

}  // namespace slicecorr::resins
