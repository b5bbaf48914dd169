// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_disc.hpp
/// Resin that flows under a disc or a strip: the dose that it carries to the part, the dead zone that
/// follows, and the light that makes it even (dissertation chapter IV, in the limit of a thin gap).
///
/// r is the distance from the axis over the radius (of a strip: from the middle over half the width),
/// 0..1. z is the distance from the window, h the gap's thickness, q = z/h, S the speed. With
/// tau = -k ln r, k = 2 for a disc and 1 for a strip, dose Y is carried by
///
///     F'(q) dY/dtau + F dY/dq - (c/(S h)) d2Y/dq2 = (h/S) a(r, h q),   Y = 0 at tau = 0,
///
/// without flux of Y through window and part; a = Ib e^(-z/hb) - beta Iuv e^(-z/huv) (4.2, areal). What
/// gels at r has the dose of q = 1 there; relative dose is Y over D'c. Because Rp is in r alone, no
/// result of the march depends on the radius, and h may change with r.
///
/// Y below 0 is inhibitor in store. It fades with the resin's `inhibitor_life_s`: infinite is (4.2); 0
/// is the clamp of `kinetics.hpp`: a below 0 counts as 0, and c as 0, because the still layer at the
/// window would fill up with dose. Where a is below 0 and Y above it, Y falls all
/// the same, though dose can't be undone: such places are counted. With an exponent m that is not 1 the
/// store is in units of a t, and dose grows by a^m once it is empty.
///
/// Plain functions, thread-safe. They throw `InputError` that names the value that can't be, and
/// `InfeasibleError` where no light leaves a dead zone.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/flow.hpp"

namespace slicecorr {

enum class DiscShape { disc, strip };

/// What is printed, and how fast.
struct DiscPrint {
  DiscShape shape = DiscShape::disc;
  double radius_mm = 0;   ///< Rp; of a strip half the width. > 0
  double speed_mm_h = 0;  ///< > 0
};

/// Values over r, straight lines between them; those at both ends hold beyond. `r` ascends.
struct RadialCurve {
  std::vector<double> r;
  std::vector<double> value;
  double at(double place) const;
};
/// The same value everywhere.
RadialCurve even_curve(double value);

struct DiscLight {
  RadialCurve blue_mw_cm2, uv_mw_cm2;  ///< >= 0
};
DiscLight even_light(double blue_mw_cm2, double uv_mw_cm2);

/// How finely the march goes. Both orders are second: twice as many levels and steps, a quarter of the
/// error.
struct DiscGrid {
  int levels = 64;  ///< between window and part, 4..4096
  int steps = 200;  ///< from the edge inwards, 4..100000
  double least_r =
      0.02;  ///< where the march ends; further in, values are those of there. In (0, 1)
};

/// What the march gives. Both curves have the places of its steps.
struct DiscDose {
  RadialCurve front;  ///< Omega_f, relative dose of what gels
  RadialCurve
      window;  ///< relative dose at the window. Without diffusion (c = 0) resin stays there for
               ///< ever: then it is the lowest level's mean, which grows as levels get thinner
  std::size_t undone_places = 0;  ///< where a is below 0 while Y is above
};

/// The dose that one light gives. Gap in um, > 0.
DiscDose disc_dose(const FlowResin& resin, const DiscPrint& print, const RadialCurve& gap_um,
                   const DiscLight& light, const DiscGrid& grid = {});
/// The doses of several lights in one march. Where Y is signed (infinite life) and m = 1, the dose of a
/// sum of lights is the sum of their doses; here the lights are marched each for itself, so that only
/// such resins, and clamped ones, are taken.
std::vector<DiscDose> disc_doses(const FlowResin& resin, const DiscPrint& print,
                                 const RadialCurve& gap_um, const std::vector<DiscLight>& lights,
                                 const DiscGrid& grid = {});

/// Omega_f of resin that does not flow but is passed by the window: (1/(S D'c)) of the integral of a
/// over the gap, signed or (`clamped`) where a is above 0. For m = 1.
double still_dose(const FlowResin& resin, double speed_mm_h, double gap_um, double blue_mw_cm2,
                  double uv_mw_cm2, bool clamped);

/// The suction that draws the resin in.
struct DiscSuction {
  double most_pa = 0;       ///< below the pressure outside, in the middle
  double force_n = 0;       ///< on a disc; on a strip N per mm of its length
  double fastest_mm_h = 0;  ///< at which `most_pa` is `limit_pa`
  double rim_mm_s = 0;      ///< mean velocity at the edge; half as much again in the gap's middle
  double flow_mm3_s = 0;    ///< through the edge; of a strip through both, per mm of its length
};
/// From h(r) by closed forms between its places, Q = S r/2 (strip S x). `limit_pa` in (0, 1 bar].
DiscSuction disc_suction(const FlowResin& resin, const DiscPrint& print, const RadialCurve& gap_um,
                         double limit_pa = kCavitationPa);
/// How far the platform must be from the window for the suction under the part, a disc, to be more than
/// that under the platform, um (C.2).
double part_takes_over_um(double platform_radius_mm, double part_radius_mm, double gap_um);

/// @name The dead zone that light leaves when nothing else changes
/// @{
struct DeadZoneSearch {
  double start_um = 80;  ///< > 0
  double largest_um =
      400;             ///< where h is more, it is cut off: a void. > start_um. How much resin has
                       ///< its dose from the light at the edge depends on it
  double slope = 0.7;  ///< for the flow h may not change faster, as in `DiscGrowth`. > 0
  int rounds = 600;    ///< at most; 1 or more
  double settled_um = 0.02;  ///< ends when no h changes by more in a round. > 0
};
struct DiscDeadZone {
  RadialCurve gap_um;
  DiscDose dose;          ///< with that gap; `front` is the dose at h
  double void_share = 0;  ///< of the radius: where h is cut off
  bool adheres = false;   ///< D'c is reached at the window: no dead zone lasts; h is near 0 there
  double last_change_um = 0;
  bool settled = false;
};
/// h at which the dose is 1 everywhere: rounds of h += 0.3 S (D'c - Y)/a(h), at most 5 um each. Between
/// hf and h resin rises with the part and gains a dz/S.
DiscDeadZone disc_dead_zone(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                            const DeadZoneSearch& search = {}, const DiscGrid& grid = {});
/// @}

/// @name A print from its first instant
/// @{
/// Y on cells of r and z, moved by the streamfunction (S r^2/2) F(z/hf) (strip S x F); resin whose Y is
/// D'c or more is gelled and rises with the part, h is where the lowest such is, or the platform. For
/// the flow h may not change faster than `slope`: hf(r) = min over r' of h(r') + slope |r - r'|.
/// Right where cells are not wider than about h/2: for radii up to 2 mm.
struct DiscGrowth {
  double first_gap_um = 25;  ///< between window and platform, > 0
  double seconds = 40;       ///< > 0
  double slope = 0.7;        ///< > 0
  int cells = 40;            ///< from the axis to the edge, 4..1000
  double level_um = 5;       ///< height of the cells, > 0
  double top_um = 600;       ///< how far above the window cells go, at most 2000 of them
};
struct Adhesion {
  double seconds = 0;  ///< after the first instant
  double r = 0;
};
struct DiscGrown {
  RadialCurve gap_um;  ///< h where the print ended; `top_um` where nothing is gelled below
  std::optional<Adhesion> adhesion;  ///< Y reached D'c at the window: the print ended there
  double seconds = 0;                ///< how long it was followed
  std::size_t undone_places = 0;     ///< as in `DiscDose`, cells at the end
};
DiscGrown grow_disc(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                    const DiscGrowth& growth = {});
/// Mean and standard deviation of h over where the front is level to 10 degrees (C.3, with the angle
/// that its text means: arctan |dh/dr|), and how much of the radius that is.
struct LevelFront {
  double mean_um = 0, deviation_um = 0, share = 0;
};
LevelFront level_front(const RadialCurve& gap_um, double radius_mm);
/// @}

/// @name The most even dead zone
/// @{
/// Which of the lights may differ from place to place.
enum class DiscPattern { none, blue, uv, both };

struct DiscGoal {
  DiscPattern pattern = DiscPattern::none;
  double blue_most_mw_cm2 = 0;  ///< what the projector gives, > 0
  double uv_most_mw_cm2 = 0;    ///< what the lamp gives, > 0
  bool uv_patternable = true;   ///< whether the lamp can show a pattern
  std::optional<double>
      gap_um;  ///< this one; else the best from `least_gap_um` to `largest_gap_um`
  double least_gap_um = 10, largest_gap_um = 300;
  bool by_area = true;          ///< means are over r dr (strip: dx); false: over dr (4.8)
  bool leave_out_edge = false;  ///< means leave out the outermost h, where dose 1 can't be had
  double window_most = 0.98;    ///< relative dose at the window, in (0, 1)
  /// Lights are polynomials of this degree in Bernstein's form (4.7), 1..20; or, with 2..40
  /// `free_nodes`, straight lines between so many even places.
  int degree = 5;
  int free_nodes = 0;
};
struct DiscOptimum {
  double gap_um = 0;
  DiscLight light;
  DiscDose dose;
  double mean_square = 0;   ///< of Omega_f - 1, what was made least
  double share_within = 0;  ///< of the radius: |Omega_f - 1| <= 0.1
  double window_most = 0;
  bool blue_at_cap = false, uv_at_cap = false, gap_at_limit = false;
};
/// Makes the mean of (Omega_f - 1)^2 least. For each h it is a least-squares problem with linear
/// bounds (lights within their caps at 50 places, the dose at the window at all places of the march),
/// convex where Y is signed and m = 1; else it is solved by steps of such, which takes many
/// seconds to minutes. h is scanned coarsely, then refined. A resin without
/// diffusion, whose dose at the window has no bound, gets Ib <= beta Iuv in place of `window_most`.
DiscOptimum best_disc_light(const FlowResin& resin, const DiscPrint& print, const DiscGoal& goal,
                            const DiscGrid& grid = {});
/// @}

/// How much of the radius has |Omega_f - 1| <= 0.1, 0..1.
double share_within_tenth(const RadialCurve& front);

/// What to think of results for this gap and light, in words; empty when nothing is.
std::vector<std::string> disc_remarks(const FlowResin& resin, const DiscPrint& print,
                                      const RadialCurve& gap_um, const DiscLight& light,
                                      double limit_pa = kCavitationPa, const DiscGrid& grid = {});
std::vector<std::string> disc_remarks(const DiscOptimum& optimum, const DiscGoal& goal);

}  // namespace slicecorr
