// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file plan.hpp
/// How fast a part can be printed, and what limits it (docs/plan.md).
///
/// Closed forms first. With full light P = smax / s and black p0 = smin / s critical intensities at the
/// speed s, lam = ha / ln 10 and a = 10^-eta (cure.hpp), a gap of g slices between tall neighbours whose
/// edges are both right has j dark slices above its lower end and g - j of full light, and the contrast
///
///     max over j = 1..g-1 of min((1 - p0)(1 - a^j), (P - 1)(a^-(g-j) - 1)),
///
/// at least c where, for some j,
///
///     1 + c / (a^-(g-j) - 1) <= P <= (1 - c / (1 - a^j)) / r,   r = smin / smax:
///
/// a union of intervals of speed, which may have holes. An error delta of the light moves upper edges by
/// lam delta / (1 - p0) and lower ones by lam delta / (P - 1).
///
/// `plan_print` takes these as a guess and finds the fastest print with real corrections and predictions
/// of the part's distinct columns.
///
/// Plain values; all functions are thread-safe. `InputError` for what does not fit, `InfeasibleError`
/// where nothing prints the part, `Cancelled`.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/flow_suction.hpp"
#include "slicecorr/machine_motion.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/verdict.hpp"

namespace slicecorr {

/// Speeds, both ends belong to it, mm/h.
struct SpeedRange {
  double least_mm_h = 0, greatest_mm_h = 0;
  bool operator==(const SpeedRange&) const = default;
};
/// What is in both; ranges rise and do not touch.
std::vector<SpeedRange> common(const std::vector<SpeedRange>& a, const std::vector<SpeedRange>& b);

/// The light of a printer in a resin, as planning sees it: all doses are inversely proportional to the
/// speed.
struct PlanLight {
  double smax_mm_h = 0;  ///< where full light just gels the resin; > 0
  double smin_mm_h = 0;  ///< where black does; >= 0, < `smax_mm_h`
  double layer_um = 0;   ///< hs, > 0
  double lam_um = 0;     ///< height over which the dose falls to 1/e, m counted; > 0

  double a() const;
  /// Full light and black in critical intensities.
  double full(double speed_mm_h) const { return smax_mm_h / speed_mm_h; }
  double black(double speed_mm_h) const { return smin_mm_h / speed_mm_h; }
  /// Height of full light that lifts the dose from 0 to 1, um; infinite where it never does.
  double burst_um(double speed_mm_h) const;
};
/// Of a plain model at the speed of its process.
PlanLight plan_light(const CureModel& model, double speed_mm_h);

/// Contrast of a gap of `slices`, at least 0; 0 for one slice, which can't have both edges right.
double gap_contrast(const PlanLight& light, int slices, double speed_mm_h);
/// Where it is at least `contrast` > 0.
std::vector<SpeedRange> gap_speeds(const PlanLight& light, int slices, double contrast);
/// The same of a gap between the platform and a feature: nothing must cure in it but that feature's edge.
std::vector<SpeedRange> platform_gap_speeds(const PlanLight& light, int slices, double contrast);

struct BestGap {
  double speed_mm_h = 0, contrast = 0;
};
/// The speed with the greatest contrast, in whole slices.
BestGap best_gap(const PlanLight& light, int slices);

/// Where an error of the light of `light_error` (a share) moves no edge further than `tolerance_um`.
/// Nothing where that is not more than lam times the error, which is what any speed costs.
std::optional<SpeedRange> tolerated_speeds(const PlanLight& light, double tolerance_um,
                                           double light_error);

// ------------------------------------------------------------------------- of a part

/// What a printer file says of a stage whose speed may change while it prints.
struct StageChange {
  bool variable_speed = false;    ///< `[stage] variable_speed`
  double acceleration_mm_s2 = 0;  ///< `[stage] acceleration_mm_s2`
  /// What the machine takes that printbridge drives by that file; nothing: it drives none. Plans keep to it.
  std::optional<MachineMotion> motion{};
};
/// Of a printer by its name or file. Throws `InputError` naming file, line and key.
StageChange load_stage_change(const std::string& name_or_path);
/// The same of the text of such a file; `source` names it.
StageChange parse_stage_change(const std::string& text, const std::string& source);

/// The greatest speed of each slice that is within its limit, at most `most_mm_h`, and changes by no more
/// than the acceleration allows: |change of s²| <= 2 A hs from slice to slice. Limits > 0, mm/h, may be
/// infinite. Throws `InputError` for an acceleration or a limit that is not above 0.
std::vector<double> speeds_within(const std::vector<double>& limits_mm_h, double most_mm_h,
                                  double acceleration_mm_s2, double layer_um);

/// Settings that planning may choose besides the speed.
struct PlanFree {
  bool lamp = false;       ///< less of the curing light, where stage or suction keep the print slow
  bool omega_max = false;  ///< the cap of the dose inside features
  bool edge_aim = false;   ///< how finely edges are placed: less so low gaps are darker
  bool uv = false;         ///< less UV light than the process says
  /// Doses to aim at over the gel dose, in place of the resin's, each at least 1; empty: as it is. A
  /// lower one prints faster, and softer.
  std::vector<double> dose_factors;
};

struct PlanAsk {
  double tolerance_um = 25;                 ///< of every edge, > 0
  double gap_contrast = kLeastGapContrast;  ///< of every gap, 0..1
  double light_error = 0.01;                ///< of the light, a share; 0: none
  /// Gaps lower than this are told and left out; 0: those of one slice, which can't have both edges right.
  double least_gap_um = 0;
  PlanFree free;
  /// Where the stage can change its speed slices get speeds of their own. By light, where columns stand
  /// alone, without UV light: lamps stay as they are, and a part takes less time than at one speed. Slices
  /// that suction holds back go slower than others, and the lamps follow, so that doses stay.
  StageChange stage;
  int curve_points = 9;  ///< of the curve over speed; 0: none
  int tolerance_points =
      7;  ///< of the curve over tolerance, besides the one asked for; 0: no curve
  /// Most columns that are looked at before a result is tried on all of them; > 0.
  int most_columns = 6000;
};

/// Where something is: slices [first, last] of the pixel in column x, row y; -1: nowhere.
struct PlanPlace {
  int x = -1, y = -1, first = -1, last = -1;
};

/// A correction of the part and what it prints.
struct PlanPoint {
  double speed_mm_h = 0;  ///< continuous
  double exposure_s = 0;  ///< layer by layer, of normal layers
  bool keeps = false;     ///< tolerance and contrast
  bool prints = false;    ///< there is a correction; else only `why` counts
  std::string
      limited_by;  ///< a word: light, black, contrast, edges, lost, split, joints, stage, ...; empty: nothing
  std::string why;                         ///< the same as a sentence
  PlanPlace place;                         ///< of that
  double max_abs_um = 0, mean_abs_um = 0;  ///< of edges that are planned for; the mean over pixels
  PlanPlace max_abs_at;
  double contrast = 1;  ///< least of the gaps that are planned for
  PlanPlace contrast_at;
  std::uint64_t lost = 0, split = 0, narrow = 0,
                off = 0;  ///< columns' runs, gaps and edges that fail
  int extra_slices = 0;   ///< after the part's end
  double time_s = 0;      ///< in which slices are shown
  /// What lies between them layer by layer; nothing: not known.
  std::optional<double> dark_s = 0.0;
  PrintTime print_time() const { return {time_s, dark_s}; }
  bool all_columns = false;  ///< of the part; else of those that are critical
};

/// Gaps of one height.
struct PlanGap {
  int slices = 0;
  bool at_platform = false, left_out = false;
  bool beside_grey = false;  ///< a grey layer lies in it: closed forms do not speak of it
  std::uint64_t count = 0;   ///< pixels
  PlanPlace place;           ///< of the first
  /// Closed forms, where gaps are planned for and lie between full slices: where the contrast is kept, and
  /// what is best. Continuous exposure without UV light.
  std::vector<SpeedRange> ranges;
  std::optional<BestGap> best;
};

struct PlanFeature {
  int slices = 0;
  std::uint64_t count = 0;
  PlanPlace place;
};

/// What another input would buy, by the closed forms.
struct PlanStep {
  std::string change;                ///< "absorbance height 20 % lower"
  std::optional<double> speed_mm_h;  ///< nothing: no speed keeps what is asked for
  std::optional<SpeedRange> range;   ///< the fastest that does
  bool held_back = false;            ///< by stage or suction
  std::optional<BestGap> best;       ///< of the limiting gap
};

/// The fastest print with edges within another tolerance.
struct PlanTolerance {
  double tolerance_um = 0;
  std::optional<PlanPoint> at;  ///< nothing: no speed keeps it
  std::string limited_by;       ///< a word
};

/// A way in which the part may lie on the platform.
struct PlanOrientation {
  std::array<double, 3> rotate_deg{};  ///< as `Placement::rotate_deg`
  bool prints = false, chosen = false;
  double speed_mm_h = 0, exposure_s = 0;  ///< one of them
  PrintTime time;
  int layers = 0;
  std::string limited_by;  ///< a word; where it does not print a sentence
};

struct PrintPlan {
  ExposureMode mode = ExposureMode::continuous;
  PlanAsk ask;
  Setup setup;  ///< with the speed or exposure found, and the settings chosen
  double layer_um = 0;
  int layers = 0;
  PlanPoint at;  ///< what was found
  std::optional<PlanPoint>
      faster;  ///< by half a percent: what fails; nothing where a bound forbids it
  std::optional<PlanPoint> slower;  ///< by a tenth
  std::string limited_by, limit;    ///< a word and a sentence
  PlanPlace limit_place;
  std::vector<PlanPoint> curve;           ///< rising speeds
  std::vector<PlanTolerance> tolerances;  ///< rising; what each would allow at one speed
  std::vector<PlanPoint> tried;           ///< all corrections in the order of their making
  std::optional<PlanLight> light;         ///< of plain models
  std::vector<SpeedRange> ranges;         ///< closed forms together
  std::vector<PlanGap> gaps;              ///< the lowest first
  std::vector<PlanFeature> features;
  std::vector<PlanStep> steps;  ///< the first is the present input
  std::optional<PrintSuction> suction;
  double stage_mm_h = 0;  ///< the stage's own; 0: not given
  double lamp_share = 1;  ///< of the calibration's light
  /// Where slices have speeds of their own; the last holds on; else empty. `setup` has them, too, and
  /// says whether the lamps follow.
  std::vector<double> slice_speed_mm_h;
  /// By light: what a print with these speeds keeps, corrected and predicted as all others.
  std::optional<PlanPoint> along_z;
  double uniform_time_s = 0;          ///< at the one speed of `at`, or the one that suction allows
  std::optional<double> dose_factor;  ///< chosen in place of the resin's
  std::string with;  ///< which of the free settings was chosen; empty: as `setup` said
  std::vector<std::string> chosen;  ///< free settings and what became of them
  std::vector<std::string> notes;   ///< what is not counted
  /// Those among which this plan was chosen, by whoever planned them all; else empty.
  std::vector<PlanOrientation> orientations;
  std::uint64_t part_columns = 0, distinct_columns = 0, judged_columns = 0;
  /// `slice_speed_mm_h` as a table slice,speed_mm_h, which `correct --slice-speed-mm-h` takes.
  std::string slice_speeds_csv() const;
  std::string to_json() const;
  /// Speed against contrast and edge errors as SVG.
  std::string svg(const std::string& title) const;
};

/// The fastest print of `whole_target`, or layer by layer the one with the least exposure. The speed or
/// exposure that `asked` says does not count. Throws `InfeasibleError` where no speed keeps what is asked
/// for, naming the nearest contrast or tolerance with gap and place; `InputError` for wanted doses, what is
/// left alone, UV light that changes and light for an even dead zone. Where light spreads columns are
/// planned as if they stood alone, and where it is uneven for the least and the most light of the part.
PrintPlan plan_print(const SliceSource& whole_target, const Setup& asked, const PlanAsk& ask,
                     const ExecutionContext& context = {});

}  // namespace slicecorr
