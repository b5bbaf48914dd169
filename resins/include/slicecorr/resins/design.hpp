// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file design.hpp
/// What a resin and a printer will do, and the absorber that a wish needs. docs/design.md has the
/// formulas with their sources.
///
/// Heights are base e unless their name says 10, doses areal, both as in kinetics.hpp. All
/// functions are pure and thread-safe and throw `InputError` when the resin lacks what is asked
/// for.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::resins {

/// What correction aims at, beside the gel dose, in a sentence or two.
std::string aim_words(const Resin& resin);

/// An exposure to foretell. Fields that are 0 are not asked for.
struct Question {
  double blue_mw_cm2 = 0;   ///< > 0
  double uv_mw_cm2 = 0;     ///< >= 0
  bool aim = false;         ///< with the dose that correction aims at, instead of the gel dose
  double exposure_s = 0;    ///< of a stationary exposure
  double height_um = 0;     ///< when does the resin gel this far above the window?
  double speed_mm_h = 0;    ///< of continuous printing
  double layer_um = 50;     ///< > 0
  double black_mw_cm2 = 0;  ///< light of a black pixel: for the slowest speed
  /// What places of the display get of this light, by its flat-field; > 0.
  double least_light = 1, greatest_light = 1;
  bool dark_places = false;  ///< some get none at all
  /// Takes them from the printer's flat-field; without one they stay.
  void take_flat_field(const Printer& printer);
};

/// Continuous printing under constant light: the inside of a long part.
struct Passing {
  double phi = 0;                        ///< dose in critical doses
  double critical_intensity_mw_cm2 = 0;  ///< blue that gives phi = 1, with the UV light asked for
  double fastest_mm_h = 0;               ///< the speed at which phi is 1
  double slowest_mm_h = 0;               ///< at it and below black gels; 0 without light of black
  double slice_time_s = 0;               ///< in which the window passes a slice
  /// Slices of this light that lift the dose from 0 to 1, without UV; 0 when it never does.
  int slices_to_gel = 0;
};

struct Forecast {
  Question question;
  LightUnit unit = LightUnit::mw_cm2;  ///< of all that is named for mW; the resin's
  Kinetics kinetics;
  bool gel_dose_known = true;
  /// After `exposure_s`; nothing when nothing has gelled by then. Without UV the front is the
  /// window and the back the cured height.
  std::optional<CuringFronts> fronts;
  double cured_height_without_uv_um = 0;  ///< below 0 when nothing gels
  double steady_dead_zone_um = 0;         ///< 0: none lasts; infinite: nothing ever gels
  FirstGel first;
  double window_time_s = 0;          ///< infinite while a dead zone lasts
  double exposure_for_height_s = 0;  ///< infinite: never
  /// Layer by layer: from so long on a layer of `layer_um` holds when the platform lifts, its far edge
  /// having `green_strength` gel doses; nothing where lifts are not counted (UV light, a time to gel, a
  /// resin that bleaches).
  std::optional<double> layer_holds_s{};
  double green_strength = 0;
  std::optional<Passing> passing;
  /// The same at the dimmest and the brightest place; null where all get the same light.
  std::shared_ptr<const Forecast> dimmest, brightest;
  /// Under UV light: `front_settled_s` and `back_settled_s`; nothing without.
  std::optional<double> front_settled_s{}, back_settled_s{};
  std::vector<std::string> sentences;  ///< all of it for people
  /// What has no answer: a height that is never reached. Empty when all has one.
  std::string unanswered;
  std::string to_json() const;
};
Forecast predict(const Resin& resin, const Question& question);
/// When the front is within a tenth of the dead zone that lasts, zf = 1.1 zf(infinite) (dissertation figure
/// 3.6 d), s; infinite where none lasts. The first gel may be nearer: then it is that time.
double front_settled_s(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2);
/// From when on the back is at least nine tenths of the height that it would have without UV light (figure
/// 3.6 c), s.
double back_settled_s(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2);

/// A wish for continuous printing with correction.
struct Wish {
  double speed_mm_h = 0;    ///< > 0
  double tolerance_um = 0;  ///< > 0: error of edges that is allowed
  double layer_um = 50;     ///< > 0
  double dead_zone_um = 0;  ///< wanted in the long run under full blue light; 0: not asked
  double omega_max = 0;     ///< dose that features are to reach inside, over 1; 0: not asked
  /// A disc under which resin flows; 0: not asked. Needs a viscosity; with UV lamp and inhibition its dead
  /// zone is told, too.
  double disc_radius_mm = 0;
};

/// Where a corrected feature, whose dose is 1 at both edges, is brightest (A.38 to A.41).
struct Peak {
  double omega = 0;         ///< its greatest dose
  double below_top_um = 0;  ///< where, below its upper edge
};
/// Of a feature of this height. 0 <= phi_min < 1 < phi_max.
Peak peak_of_feature(double phi_max, double phi_min, double effective_um, double height_um);
/// Least height of a feature whose peak is `omega`, > 1; infinite from phi_max on.
double height_for_peak_um(double phi_max, double phi_min, double effective_um, double omega);

/// The most even dead zone that constant light leaves under a disc, with its resin (5.2.2).
struct EvenDisc {
  double height_e_um = 0;                 ///< absorbance height of the curing light
  double gap_um = 0;                      ///< even gap whose doses are nearest to 1
  double blue_mw_cm2 = 0, uv_mw_cm2 = 0;  ///< the lights that do so, within what the printer has
  double share_within = 0;                ///< of the radius: dose within a tenth of 1
  double mean_square = 0;                 ///< of dose - 1, by area
  double suction_pa = 0, force_n = 0;     ///< in that gap
  double fastest_mm_h = 0;                ///< at which the vat's limit, or 1 bar, is reached
  bool gap_at_limit = false;  ///< a gap beyond those that are looked at might be more even
};

/// Edges of a long feature that is shown at one intensity, without correction.
struct UncorrectedEdges {
  double over_um = 0;   ///< cured above its upper edge
  double under_um = 0;  ///< not cured at its lower edge; infinite when it never gels
};
/// `effective_um`: he / m. Exact for features many heights long (A.32 with constant phi).
UncorrectedEdges uncorrected_edges(double phi, double phi_min, double effective_um);
/// 1 less the least dose in a gap between two corrected features, both with dose 1 at the gap.
double gap_contrast(double phi_max, double phi_min, double effective_um, double gap_um);
/// The same resin with more or less absorber: another absorbance height, the same areal doses.
Resin with_height(const Resin& resin, double height_e_um);

/// A range of absorbance heights, base 10; the ends are the limits and don't belong to it.
struct HeightRange {
  double least_um = 0, greatest_um = 0;
};

/// What to do and why, in figures.
struct Recommendation {
  bool feasible = false;
  double present_height10_um = 0;
  bool present_fits = false;
  /// Where the wish is met, with correction and without (all lit pixels at the best one intensity).
  std::optional<HeightRange> range, range_uncorrected;
  std::string least_because, greatest_because;  ///< what the ends are set by

  // At the height to formulate for: the one of the range with the greatest contrast in gaps.
  double height_e_um = 0, height10_um = 0;
  double absorber_factor = 1;                 ///< absorbance over that of the resin now
  double phi_max = 0, phi_min = 0;            ///< of full light and of black
  double fastest_mm_h = 0, slowest_mm_h = 0;  ///< speeds at which it prints
  double corrected_error_um = 0;              ///< most that one grey level moves an edge
  double um_per_percent_of_light = 0;   ///< way of an upper edge when the light changes by 1 %
  UncorrectedEdges uncorrected;         ///< of slices shown as they are, at full light
  double burst_um = 0;                  ///< full light needed below a feature
  double gap_um = 0, gap_contrast = 0;  ///< a gap's height, and 1 less its least dose
  double uv_needed_mw_cm2 = 0, phi_with_uv = 0;  ///< for the dead zone; full light under it

  double best_uncorrected_error_um = 0;  ///< of all absorbers, at this speed
  double best_uncorrected_height10_um = 0;

  /// What the height means over a display whose light is uneven.
  struct Places {
    double least_light = 1, greatest_light = 1;  ///< of the calibration; least of those with any
    double share_met = 1;                        ///< of the display, where the wish is met
    double fastest_mm_h = 0, slowest_mm_h = 0;   ///< at which all places print that get light
  };
  std::optional<Places> places;

  /// With `Wish::omega_max`: the least feature that reaches it; infinite height: none.
  std::optional<double> height_for_omega_um{};
  Peak peak{};  ///< of that feature, and of a long one where there is none
  /// With `Wish::disc_radius_mm`: at the height to formulate for, at the present one, and the most even of
  /// some heights over the range. Without UV light the suction alone, in the gap that is assumed.
  std::optional<EvenDisc> disc{}, disc_present{}, disc_most_even{};

  std::vector<std::string> reasons;   ///< sentences
  std::vector<std::string> warnings;  ///< sentences
  std::vector<std::string> ways_out;  ///< what would make it feasible
  std::string to_json() const;
};
Recommendation recommend(const Resin& resin, const Printer& printer, const Wish& wish);

/// Most that one grey level moves an edge of a corrected feature, beside gaps in which the dose
/// falls to half the critical one: upper edges `CureModel::level_step_um`, lower ones through the
/// burst below them. In shorter gaps edges may move further. Infinite when nothing prints.
double corrected_error_um(const Printer& printer, const Resin& resin, double speed_mm_h,
                          double layer_um);

}  // namespace slicecorr::resins
