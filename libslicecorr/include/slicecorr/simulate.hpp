// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file simulate.hpp
/// How a print cures while it is made: dose and gelled stretches of one pixel column, or of an
/// image row, against time; and the curing fronts of a stationary exposure.
///
/// A slice adds to a point in proportion to what has been shown of it: layer by layer the share of
/// its exposure, continuous the part of its path that the window has gone, so that at a share f of
/// slice n the window stands at z_w = (n + f) hs and
///
///     Omega(zeta) = phi_n (1 - a^(n + f - zeta))   inside layer n,                        (A.35)
///
/// from whose upper end on the recursion (A.32) goes.
/// Under UV light the kernel of inhibited.hpp is integrated up to the window. Relative doses are
/// those of the dose that the correction aims at, as everywhere else. At the end of the last slice
/// all of it equals `column_dose`. Time is the time for which slices are shown: layer by layer the
/// lifts between them are not in it. Where lifts exchange resin, doses are the greatest that a place has
/// had: it has gelled, or forgets.
///
/// Plain values, immutable clocks; all functions are thread-safe. What is out of range throws
/// `InputError`, a cancelled `context` `Cancelled`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

/// When which slice is shown, with the times of `slice_light`: longer where the stage ramps and the
/// lamp follows. The window goes through a slice at one speed.
class PrintClock {
 public:
  PrintClock(const Process& process, double m, double layer_um, int slices);
  /// A moment: `share` (0..1) of `slice` has been shown, of earlier slices all, of later none.
  struct Moment {
    int slice = 0;
    double share = 0;
  };
  /// The end of a slice belongs to it, not to the next one. Clamped to the print.
  Moment at(double time_s) const;
  double time_s(const Moment& moment) const;
  double total_s() const { return start_s_.back(); }
  int slices() const { return static_cast<int>(start_s_.size()) - 1; }

 private:
  std::vector<double> start_s_;  ///< of each slice, and the end of the last
};

/// Relative dose that the slice at a moment has added so far at a point that lies `x` slices above
/// where the window stands at the slice's end: x = slice + 1 - zeta > 0. `level`: grey level of the
/// pixel.
double added_dose(const CureModel& model, const PrintClock::Moment& moment, int level, double x);
/// The same of light that spreads under UV light; the model's kernel is by fronts.
double added_dose(const CureModel& model, const PrintClock::Moment& moment, const FrontLight& light,
                  double x);
/// The same of a slice that gives the column the relative intensity `phi`; without UV light.
double added_dose_of_light(const CureModel& model, const PrintClock::Moment& moment, double phi,
                           double x);

/// A gelled stretch of a column. z is measured from the platform.
struct GelledInterval {
  double front_um = 0;  ///< end towards the window
  double back_um = 0;   ///< end towards the platform, less than `front_um`
};

struct HistoryStep {
  double time_s = 0;       ///< since the first slice's begin
  int slice = 0;           ///< that is being shown
  double share = 0;        ///< of the slice that has been shown, 0..1
  double z_window_um = 0;  ///< layer by layer the lower end of the layer that is exposed
  std::vector<GelledInterval> gelled;  ///< from the platform to the window
};

/// Relative dose along a column at one moment, from the platform to the window. Layer by layer the
/// dose jumps at nodes: these are there twice, seen from the layer before and from the one after.
struct DoseProfile {
  double time_s = 0;  ///< as in HistoryStep, like the next two
  int slice = 0;
  double share = 0;
  std::vector<double> z_um, dose;  ///< from the platform; relative
};

/// What a layer of a column does when the platform lifts after its exposure (docs/lifts.md).
enum class AtLift : std::uint8_t {
  nothing,       ///< no feature there, or one that fills its pixel in part
  holds,         ///< it hangs on the layer above it, or on the platform
  film,          ///< over a gap: it hangs on its neighbours in the plane
  liquid,        ///< over a gap: later exposures cure it
  does_not_hold  ///< liquid or too weak where it should hang on what is above it
};
/// For people: "does not hold".
std::string name_of(AtLift state);
struct LayerAtLift {
  AtLift state = AtLift::nothing;
  /// What its own exposure leaves in it, in gel doses: at its window, and where it meets the layer above.
  double window_dose = 0, joint_dose = 0;
};

struct ColumnHistory {
  ExposureMode mode = ExposureMode::continuous;
  double layer_um = 0;
  double total_s = 0;  ///< for which slices are shown
  std::vector<HistoryStep> steps;
  std::vector<DoseProfile> profiles;
  std::vector<LayerAtLift> lifts;  ///< layer by layer, of each layer; empty without lifts
  double green_strength = 0;       ///< G, of a joint that holds; 0 without lifts
  /// Coverage 0..1 of the design per layer; empty when there is none.
  std::vector<double> design;
  /// Under UV light, per slice: steady dead zone of the pixel, and where in it resin gels first,
  /// both above the window; NaN where the pixel is black. Empty without UV light.
  std::vector<double> dead_zone_um, first_gel_um;
};

struct ColumnOptions {
  /// Steps in which a slice is followed, 1..10000; 0: so many that curves look smooth.
  int substeps = 0;
  /// Moments at which the dose along the column is kept, s, within the print.
  std::vector<double> profile_times_s;
};

/// Dose is sampled at this many places per layer, and at its end.
inline constexpr int kSamplesPerLayer = 8;

/// Follows a column whose slices show `pixels` (0..255), first slice first. Without UV light ends
/// of gelled stretches are exact, with it they come from the dose at `kSamplesPerLayer` places,
/// which is 1 there to 1e-3. Throws `InputError` when an option is out of range.
ColumnHistory simulate_column(const CureModel& model, const Process& process,
                              const std::vector<std::uint8_t>& pixels,
                              const ColumnOptions& options = {},
                              const ExecutionContext& context = {});
/// The same of a pixel of a stack. `target` may be null.
ColumnHistory simulate_column(const SliceSource& stack, const SliceSource* target,
                              const Setup& setup, int x, int y, const ColumnOptions& options = {},
                              const ExecutionContext& context = {});
/// A column at each of its lifts, by the same rules as the joints of a prediction (predict.hpp). `model`:
/// with lifts. `phi`: relative intensity of each slice with its exposure. `design`: coverage 0..1; empty:
/// what is lit above black. Throws `InputError` where the model has no lifts, or UV light.
std::vector<LayerAtLift> lifts_of(const CureModel& model, const std::vector<double>& phi,
                                  const std::vector<double>& design);
/// Ends of `groups` runs of slices of about equal number, s: moments that show how a dose builds
/// up.
std::vector<double> group_times_s(const PrintClock& clock, int groups);
/// The clock of a stack.
PrintClock print_clock(const Setup& setup, const Grid& grid);

/// What has gelled along an image row at some moments; data are layer by layer.
struct SectionHistory {
  int y = 0, x0 = 0, width = 0, layers = 0;  ///< columns [x0, x0 + width)
  double pixel_x_um = 0, layer_um = 0;
  std::vector<std::uint8_t> coverage;  ///< of the design, 0..255; empty when there is none
  struct Still {
    double time_s = 0;  ///< this and the next three: as in HistoryStep
    int slice = 0;
    double share = 0;
    double z_window_um = 0;
    bool ended = false;                ///< all slices have been shown
    std::vector<std::uint8_t> gelled;  ///< 1 where the middle of the layer has gelled
  };
  std::vector<Still> frames;
};
SectionHistory simulate_section(const SliceSource& stack, const SliceSource* target,
                                const Setup& setup, int y, const std::vector<double>& times_s,
                                const ExecutionContext& context = {});

/// Both fronts against time over a window that stands still; z is measured from the window.
struct StationaryFronts {
  double blue_mw_cm2 = 0, uv_mw_cm2 = 0;
  FirstGel first;           ///< infinite when nothing ever gels
  double dead_zone_um = 0;  ///< steady
  double window_s = 0;      ///< when the front reaches the window; infinite while it does not
  struct Point {
    double time_s = 0, front_um = 0, back_um = 0;
  };
  /// From the first gel on, with the whole multiples of `time_s` / 200; empty when nothing gels.
  std::vector<Point> points;
};
/// Intensities >= 0, `time_s` > 0.
StationaryFronts simulate_stationary(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                                     double time_s);

}  // namespace slicecorr
