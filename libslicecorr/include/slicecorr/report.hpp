// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file report.hpp
/// The page that shows a correction: figures, sections before and after, a column's dose curve.
///
/// Plain values; all functions are thread-safe. Those that draw values throw nothing of their own;
/// `gather_report` throws as `verify_stack`, and `Cancelled`.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/flow_suction.hpp"
#include "slicecorr/picture.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/simulate.hpp"
#include "slicecorr/volume.hpp"

namespace slicecorr {

/// What prints along a section, platform up: grey where it is right, red where light cures a gap,
/// blue where a feature stays liquid, pale where a designed grey voxel prints; white is empty. True
/// to scale in x and z (`pixel_x_um`, `layer_um`), at most `most_px` wide and high.
ColourImage cure_picture(const Section& section, double pixel_x_um, double layer_um, int most_px);

/// Sections of one part before and after correction, side by side, as a PNG or SVG file that explains
/// itself: with a caption, the colours' meaning and a scale bar. As `cure_picture`; both of the same
/// size.
std::string section_sheet(const Section& before, const Section& after, double pixel_x_um,
                          double layer_um, const std::string& caption, bool svg);

/// Where a section along an image row lies: "image row 12, along x of the plate at y = 3.025 mm";
/// the row alone where the source does not say how its images lie.
std::string row_in_words(const SliceSource& source, int y);

/// The grey values that are shown along a section, platform up.
ColourImage grey_picture(const Section& section, double pixel_x_um, double layer_um, int most_px);

/// The dose along a section, platform up, from white (none) over pale grey (just not gelled) and, in
/// what is gelled, from blue (1) to yellow (`most` and more): what prints, or, `wanted`, what is
/// wanted of the design. `most` > 1.
ColourImage dose_picture(const Section& section, bool wanted, double most, double pixel_x_um,
                         double layer_um, int most_px);
/// The colour of a relative dose in it, as "#rrggbb".
std::string dose_colour(double dose, double most);

/// How far the print reaches beyond its design, as seen from below or from above, as the images
/// lie: red where it reaches `scale_um` or more too far, blue where so much is missing, grey where
/// it is right; white is empty. Small maps are enlarged. `scale_um`: > 0.
ColourImage surface_picture(const SurfaceMaps& maps, bool from_below, double scale_um);

/// How sure edges are, `maps` being those of an uncertain print (uncertain_print.hpp): of upper edges
/// or of lower ones, the darker the wider the band of 95 %, darkest where it reaches `scale_um` or
/// more either way; white is empty. Small maps are enlarged. `scale_um`: > 0.
ColourImage sensitivity_picture(const SurfaceMaps& maps, bool upper, double scale_um);

/// A table of this correction beside other ways to do it.
struct ComparisonTable {
  std::vector<std::string> columns;            ///< heads
  std::vector<std::vector<std::string>> rows;  ///< the first cell names the row
  std::string note;                            ///< below the table; may be empty
};

/// Everything a report shows.
struct ReportContent {
  std::string title;
  StackInfo info;
  Setup setup;
  Prediction after;                     ///< of the stack reported
  std::optional<Prediction> before;     ///< of the target shown as it is
  std::optional<PrintSuction> suction;  ///< under the part, where it is known
  /// Pictures of a section of the target shown as it is, and of the stack.
  struct SectionPictures {
    std::string place;  ///< row_in_words
    ColourImage cure_before, cure_after, grey_before, grey_after;
    ColourImage dose_wanted, dose_after;  ///< empty where no doses are wanted
  };
  std::vector<SectionPictures> sections;
  double most_wanted = 0;            ///< greatest wanted dose, where doses are wanted
  int column_x = -1, column_y = -1;  ///< pixel of the columns below; -1: there is none
  std::vector<ProbeRow> column_before, column_after;
  /// What can be moved through; null: still pictures only.
  std::shared_ptr<const ReducedVolume> volume;
  std::optional<ComparisonTable> comparison;  ///< when the caller has one
  std::size_t worst_section = 0;              ///< of `sections`: that which is shown first
};

/// One self-contained HTML page: no network. Without scripts it still shows figures and pictures of
/// sections; with them all sections and columns of `volume`, and the part in the round.
std::string make_report(const ReportContent& content, const ExecutionContext& context = {});

/// Dose and grey level along a column as SVG: design shaded, dose curve exact inside layers. Axes
/// reach at least to `least_top_dose` and to `slices`, so that plots can be compared.
std::string column_svg(const std::vector<ProbeRow>& column, const CureModel& model,
                       const std::string& title, double least_top_dose = 1.0,
                       std::size_t slices = 0);

/// A column while it is printed, as SVG: what has gelled against time, with the window and the
/// design; and the dose along the column as it builds up, one band from each of `history.profiles`
/// to the next, at most eight of them.
std::string column_history_svg(const ColumnHistory& history, const std::string& title);

/// Both curing fronts of stationary exposures from 0 to `time_s`, as SVG. `note`: a line below; may
/// be empty.
std::string stationary_svg(const std::vector<StationaryFronts>& exposures, double time_s,
                           const std::string& title, const std::string& note = {});

/// A section at one moment, platform up, in the colours of `cure_picture`: grey gelled, red gelled
/// where nothing is designed; of the design pale grey what the window has not reached yet, pale
/// blue what is not gelled yet, blue what is not at the end of the print. The line is the window.
/// Without a design all that has gelled is grey.
ColourImage progress_picture(const SectionHistory& history, std::size_t frame, int most_px);

/// Gathers the content for `stack` against `target`: figures, the middle section, the section and
/// the column through the worst height error of the target shown as it is, and the volume of at
/// most `kReportCells` cells a side. Of a recording there is no volume: its pictures stand still.
/// `volume`: what `correct_stack` made of it, or null for reading both once more.
inline constexpr int kReportCells = 160;
ReportContent gather_report(const SliceSource& stack, const SliceSource& target, const Setup& setup,
                            const StackInfo& info, const Prediction& after,
                            const std::optional<Prediction>& before, const std::string& title,
                            const ExecutionContext& context = {},
                            std::shared_ptr<const ReducedVolume> volume = nullptr);

}  // namespace slicecorr
