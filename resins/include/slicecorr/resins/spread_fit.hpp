// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file spread_fit.hpp
/// How far light spreads, from what a lab can measure: how wide lines and gaps printed, or how a
/// straight edge of the image (a knife edge) looks to a camera or a scan.
///
/// Light at depth d above the window is the image, blurred by Gaussians whose variances are
/// sigma² + kappa d (spread of the printer, scatter of the resin). Light is counted in shares of
/// full light, `dark` is that of black pixels.
///
/// *Widths.* A long line of light, `designed` wide, gives at x from its middle
///
///     b(x) = sum of weight (Phi((x + w/2) / s) - Phi((x - w/2) / s)),
///
/// light dark + (light - dark) b there, and beside it dark; a gap the same with 1 - b. It prints
/// where dose (light)^m 10^(-m d / ha) reaches 1: `dose` is that of even full light at the window,
/// over the dose at which edges lie. Where the platform moves and all slices show the same, a point
/// that is d from the end of the print has seen all depths up to d, each by its share
/// m/he e^(-m u/he) du; then `dose` is that of even full light far from the end.
///
/// *Edges.* low + (high - low) sum of weight Phi((x - at) / s), averaged over the pixels of the
/// camera.
///
/// Residuals are measured less found: um of width, shares of an edge's step. Functions are
/// thread-safe.
#pragma once

#include <array>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

enum class WidthKind { line, gap };

/// A line or gap whose width was measured.
struct PrintedWidth {
  int line = 0;  ///< of the file
  WidthKind kind = WidthKind::line;
  double designed_um = 0;  ///< as wide as it is in the image, > 0
  double printed_um = 0;   ///< >= 0; 0: no line was printed, or the gap was closed
  /// Still: where it was measured above the window. Moving: how far from the end of the print;
  /// NaN: far.
  double depth_um = std::numeric_limits<double>::quiet_NaN();
  double level = std::numeric_limits<double>::quiet_NaN();  ///< grey level; NaN: `light` counts
  double light = 1;     ///< of lit pixels, in shares of full light, > 0
  double error_um = 1;  ///< scatter against that of other rows, > 0
};

/// What an edge shows at one place, or the mean of pixels at about one distance from it.
struct EdgeSample {
  int line = 0;  ///< of the file; 0: of a picture
  double at_um = 0, intensity = 0;
  double pixels = 1;        ///< that it is the mean of
  double variance_um2 = 0;  ///< of their places
};

/// A knife edge at one depth.
struct KnifeEdge {
  std::string source;
  double depth_um = 0;  ///< of resin between window and where it was looked at, >= 0
  /// What a sample takes in: a box so wide across the edge, and another one; 0: a point.
  std::array<double, 2> box_um{};
  double angle_deg = 0;  ///< of a picture: how far it leans from the nearer axis
  std::vector<EdgeSample> samples;
  std::vector<std::string> notes;
};

/// Either widths or edges.
struct SpreadMeasurements {
  std::string source;
  std::vector<PrintedWidth> widths;
  std::vector<KnifeEdge> edges;
};

/// A table of widths, with the columns kind (line or gap), designed_um, printed_um, and depth_um,
/// level or light, error_um as needed; or of an edge, with position_um and intensity, and depth_um,
/// edge (a number that tells scans apart) as needed; in any order, a header names them. `box_um`:
/// what a sample of an edge takes in. Rows of widths whose printed_um is empty are passed over.
/// Throws `InputError` naming file and line.
SpreadMeasurements read_spread_table(const std::string& path, double box_um = 0);

/// A camera's picture of one straight edge, upright or level within 20 degrees; PNG of 8 or 16
/// bits, linear in light. Throws `InputError` when there is no such edge in it, or it is
/// overexposed.
KnifeEdge read_edge_picture(const std::string& path, double pitch_um, double depth_um);

struct SpreadFitOptions {
  int gaussians = 1;                    ///< 1 or 2
  std::map<std::string, double> fixed;  ///< parameters that are held at a value
  std::set<std::string> held;           ///< that are held where they begin
  std::set<std::string> free;           ///< that are fitted though they are held without this
  bool keep_outliers = false;           ///< count them, too
  bool moving = false;                  ///< widths of a print whose platform moved
  std::optional<double> dose;           ///< that the schedule gives; it is held then
  /// What dark pixels give and levels are, and the spread to begin with; null: nothing is known.
  const Printer* printer = nullptr;
  /// Absorbance height and exponent, and the scatter to begin with; null: of depth and exponent
  /// nothing is known.
  const Resin* resin = nullptr;
};

struct SpreadParameter {
  /// sigma_um, sigma2_um, weight2 (of the second), scatter_um2_per_um, dose, dark.
  std::string name;
  std::string unit;
  double value = 0;
  bool fitted = false;
  double standard_error = 0;     ///< where fitted
  std::array<double, 2> ci95{};  ///< where fitted
};

struct SpreadResidual {
  std::string source;
  int line = 0;
  double depth_um = 0;
  WidthKind kind = WidthKind::line;  ///< of a width
  double designed_um = 0;            ///< of a width
  std::size_t edge = 0;              ///< which, of an edge
  double at_um = 0;                  ///< of an edge: from where it lies
  double measured = 0;               ///< um; of an edge, in shares of its step
  double found = 0;                  ///< the same, by the fit; <= 0: nothing prints
  bool left_out = false;             ///< an outlier, or a width of 0
};

struct SpreadFit {
  std::string source;
  bool of_widths = false;
  std::vector<SpreadParameter> parameters;
  std::vector<SpreadResidual> residuals;
  std::vector<std::string> notes;  ///< sentences
  int measurements = 0;            ///< that count
  int freedom = 0;
  double rms = 0;              ///< um; of edges, of their step
  std::string light = "blue";  ///< table of the printer file that it is for: "blue" or "uv"

  const SpreadParameter& parameter(const std::string& name) const;
  LightSpread spread() const;
  std::string to_text() const;
  std::string to_json() const;
  /// Lines for the printer file, and for the resin file where scatter was found.
  std::string to_toml() const;
};

/// Fitted are sigma_um, with two Gaussians sigma2_um and weight2, of widths dose unless the schedule
/// gives it, scatter_um2_per_um where there are several depths; dark unless freed is that of the
/// printer, else 0. Measurements that can't belong to the others (p < 0.01 for the worst of all) are
/// left out, up to a fifth. Throws `InputError` for unknown names, too few rows, values that look
/// like millimetres, rows that contradict each other, and those that leave something open (with what
/// to measure next).
SpreadFit fit_spread(const SpreadMeasurements& measured, const SpreadFitOptions& options = {});

/// The text of a printer file with the spread that was found, the rest of it as it stands; of a resin
/// file with the scatter. Throw `InputError` where the file is none, or
/// the fit does not tell it: an interval that reaches below 0, or a scatter that was not fitted.
std::string printer_with_spread(const std::string& text, const std::string& source,
                                const SpreadFit& fit);
std::string resin_with_scatter(const std::string& text, const std::string& source,
                               const SpreadFit& fit);

/// How wide lines and gaps of each width print, measured and found; or edges with what is left.
std::string spread_fit_svg(const SpreadFit& fit);

}  // namespace slicecorr::resins
