// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file process.hpp
/// The printer, the resin and how they are run: read from TOML, checked, and kept with every stack.
///
/// Plain values; all functions are thread-safe (while nobody changes the environment). All `load_*`
/// and `parse_*` functions throw `InputError` naming file, line, key and what was expected; of the
/// others those that throw say so.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/definition_keys.hpp"
#include "slicecorr/distortion.hpp"
#include "slicecorr/even_light.hpp"
#include "slicecorr/grid.hpp"
#include "slicecorr/lift_times.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/resin_chemistry.hpp"
#include "slicecorr/shrinkage.hpp"
#include "slicecorr/tomographic_parts.hpp"
#include "slicecorr/vat_window.hpp"

namespace slicecorr {

/// One measured point of a projector: grey level and intensity at the window.
struct CalibrationPoint {
  double level = 0;             ///< grey level or the lamp's control value, >= 0
  double intensity_mw_cm2 = 0;  ///< at the window, >= 0
  bool operator==(const CalibrationPoint&) const = default;
};

/// A round spot of light: a normal distribution over the window.
struct SpreadGaussian {
  double sigma_um = 0;  ///< along each axis, >= 0; 0: light stays where it is
  double weight = 1;    ///< share of the light, 0..1
  bool operator==(const SpreadGaussian&) const = default;
};

/// The light around a point of an image, as it was measured. The picture lies like the images that
/// the display shows, with the point in the middle of its middle pixel.
struct SpreadPicture {
  int width_px = 0, height_px = 0;  ///< odd
  double pitch_um = 0;              ///< side of its pixels at the window, > 0
  /// Relative intensity row by row, not all 0; shared, never changed.
  std::shared_ptr<const std::vector<std::uint8_t>> values;
  bool operator==(const SpreadPicture& o) const;
};

/// How the light of a point of an image spreads over the window: a sum of Gaussians or a picture;
/// neither: not at all.
struct LightSpread {
  std::vector<SpreadGaussian> gaussians;  ///< weights add up to 1 within `kSpreadWeights`
  std::optional<SpreadPicture> picture;
  /// Whether all light stays where it is.
  bool none() const;
  bool operator==(const LightSpread&) const = default;
};
/// By how much weights may miss 1; they are scaled to it.
inline constexpr double kSpreadWeights = 1e-3;
/// Most Gaussians that a spread may have.
inline constexpr int kMostSpreadGaussians = 16;
/// Most pixels along a side of a measured spread.
inline constexpr int kMostSpreadPixels = 511;
/// Light beyond so many sigma on either side of a Gaussian is left out: less than 1e-6 of it.
inline constexpr double kSpreadReachSigmas = 4.8917;

/// The lamp that inhibits curing near the window.
struct UvLamp {
  double wavelength_nm = 0;  ///< 0 when not given
  bool patterned = false;    ///< an image of its own per slice; else it floods the window
  /// Control value (flood) or grey level (patterned) and intensity; both never fall.
  std::vector<CalibrationPoint> calibration;
  LightSpread spread = {};  ///< of patterned light; that of a flood stays even
  double max_mw_cm2() const { return calibration.back().intensity_mw_cm2; }
  double min_mw_cm2() const { return calibration.front().intensity_mw_cm2; }
  bool operator==(const UvLamp&) const = default;
};

/// How evenly a display shines: a picture of relative intensity that covers all of it. The picture
/// may have any size; between the middles of its pixels the light is linear (docs/flat-field.md).
struct FlatField {
  int width_px = 0, height_px = 0;  ///< of the picture, 1..65536
  /// Row by row, not all 0; shared, never changed.
  std::shared_ptr<const std::vector<std::uint8_t>> values;
  /// What stands for the intensities of the calibration, 1..255: a place of value v gets v /
  /// reference of them.
  int reference = 255;
  /// The picture lies like the plate (its row 0 at the largest y), not like the display's images.
  bool of_plate = false;
  std::uint8_t least() const;
  std::uint8_t greatest() const;
  bool operator==(const FlatField& o) const;
};

/// Layer by layer: what happens between exposures (docs/lifts.md). each: the platform lifts, so every
/// layer must hold by its own exposure; none: it only steps, and doses count at the end alone.
enum class Lifts { none, each };
/// Whose light was taken for a printer's that nobody measured (assumed_light.hpp).
enum class AssumedLight { none, mono_lcd_405, dlp_385, dlp_405 };
/// What `Process::lift_exchange` is where nobody knows it.
inline constexpr double kUnknownExchange = -1;

/// Most that `Printer::suction_limit_pa` may be, Pa: beyond a bar resin cavitates.
inline constexpr double kMostSuctionPa = 101325;

/// Most that `[stage]` of a printer file may say of a lift and of the wait after it, and that wait
/// where it does not say one.
inline constexpr double kMostLiftMm = 1e3, kMostLiftWaitS = 600, kDefaultLiftWaitS = 0.5;

/// Most that `Printer::adhesion_kpa` may be, kPa.
inline constexpr double kMostAdhesionKpa = 1e5;

/// Most that `Printer::resin_depth_um` may be, um.
inline constexpr double kMostDepthUm = 1e7;

/// In what the curing light is told (light_unit.hpp).
enum class LightUnit {
  mw_cm2,     ///< mW/cm² at the window; doses are mJ/cm²
  brightest,  ///< shares of the brightest level's light; doses are seconds of it
};

/// How a display makes a grey level: less light all the time, or full light for a share of it.
enum class GreyLight { steady, pulsed };

/// A printer file (contract: "Printer file").
struct Printer {
  std::string name;
  int width_px = 0;          ///< 1..65536
  int height_px = 0;         ///< 1..65536
  double pixel_x_um = 0;     ///< > 0
  double pixel_y_um = 0;     ///< > 0
  int bit_depth = 8;         ///< 1..8; all 2^bit_depth levels exist
  double wavelength_nm = 0;  ///< of the curing light; 0 when not given
  /// Levels rise strictly from 0 to 2^bit_depth - 1, intensities never fall and are not negative.
  std::vector<CalibrationPoint> calibration;
  double max_speed_mm_h = 0;  ///< 0 when not given
  double travel_mm = 0;       ///< 0 when not given
  std::optional<UvLamp> uv;
  /// How the plate lies in the images that the display shows; nothing when the file does not say.
  std::optional<Orientation> orientation{};
  std::optional<FlatField> flat_field{};  ///< of the curing light; nothing: even
  LightSpread spread{};                   ///< of the curing light, at the window
  /// What tomographic printing needs, all three (`require_tomographic` in vial.hpp).
  std::optional<Vial> vial{};
  std::optional<Optics> optics{};
  std::optional<Rotation> rotation{};
  /// Resin above the window, um, out of which the part is pulled: resin further away has run off
  /// and takes no more light. 0: so deep that it doesn't matter.
  double resin_depth_um = 0;
  /// Share of the light that the platform sends back, 0..1.
  double platform_reflectance = 0;
  /// Most suction under the part that vat and window bear, Pa; 0 when not given.
  double suction_limit_pa = 0;
  /// Layer by layer, where nothing else is said: as in `Process`.
  Lifts lifts = Lifts::each;
  double lift_exchange = kUnknownExchange;
  /// What the platform does between two exposures (`[stage]`); nothing where the file does not say
  /// how far it lifts.
  std::optional<LiftMotion> lift_motion{};
  /// Measured pull per lit area with which a layer comes off the window, kPa; 0 when not given.
  double adhesion_kpa = 0;
  /// That of `calibration`. Where it is the brightest level's light, that is 1, and there is no UV
  /// lamp.
  LightUnit unit = LightUnit::mw_cm2;
  /// What `calibration` says of a grey level is the mean in time, either way.
  GreyLight grey = GreyLight::steady;
  /// Pulses: the exponent of the resin that is printed, which no file of a printer says
  /// (`for_resin` in cure.hpp); 1: not said, or nothing that matters.
  double grey_m = 1;
  /// How evenly the UV lamp shines (`[uv] flat_field`); nothing: even.
  std::optional<FlatField> uv_flat_field{};
  /// Lit share of the area of a pixel: a square in its middle; the rest is dark, >0..1. The calibration
  /// says the mean of both. It counts in tomographic printing.
  double fill_factor = 1;
  std::optional<Bath> bath{};  ///< of a tomographic printer
  /// Where its pixels land (`[display] distortion`); nothing: on an even grid. It counts where outlines are
  /// made of meshes, and, where there is no `flat_field`, in light.
  std::optional<Distortion> distortion{};
  FlowWindow window{};   ///< how the vat's window gives way (`[window]`)
  UnreadWords unread{};  ///< words of its file that count for nothing
  /// Standard deviation of `lift_exchange`, as what measured it says; 0: not said.
  double lift_exchange_sd = 0;
  /// Its light is made up, as its file says (`measurements = "none: a model printer"` in `[provenance]`).
  bool model = false;
  int levels() const { return 1 << bit_depth; }
  bool operator==(const Printer&) const = default;
};

/// How its platform lifts, by what its file says.
inline std::optional<LiftTimes> lift_times_of(const Printer& printer) {
  if (!printer.lift_motion) return std::nullopt;
  return LiftTimes{*printer.lift_motion, *printer.lift_motion};
}

/// Images of the plate of a printer, as `slice` makes them: those of its display turned back, so
/// that a portrait display has width and height exchanged. `layers` and `layer_um` are 0.
Grid plate_grid(const Printer& printer);

/// From images that lie like `frame` to those that the printer's display shows.
Turn turn_to_display(const ImageFrame& frame, const Printer& printer);

/// All that the printer's display shows, as images that lie like `frame`. `layers` and `layer_um`
/// are 0.
Grid images_of(const Printer& printer, const ImageFrame& frame);

enum class CureModelKind { jacobs, kinetic, gel_time };
/// "jacobs", "kinetic", "gel-time".
const char* name_of(CureModelKind model);

/// Dose that the correction aims at over the gel dose, where nothing else is said (dissertation
/// §2.3.2).
inline constexpr double kDefaultDoseFactor = 5.0;

/// How UV light keeps resin liquid near the window (dissertation chapter III).
struct Inhibition {
  double beta = 0;                    ///< areal: UV counts beta times against blue, > 0
  double absorbance_height10_um = 0;  ///< base 10, of the UV light; less than that of the blue
  double m = 1;                       ///< exponent under inhibition; that of the cure by default
  double critical_dose_prime = 0;     ///< gel dose that belongs to `m`; 0: the cure's number
  double wavelength_nm = 0;           ///< of the UV light it was measured with; 0 when not given
  bool operator==(const Inhibition&) const = default;
};

/// How a resin bleaches while light passes (bleaching.hpp).
struct Bleaching {
  double absorbance_height10_um = 0;  ///< base 10, bleached: not below that of the fresh resin
  double dose_mj_cm2 = 0;             ///< Eb: of light that takes what bleaches to 1/e, > 0
  bool operator==(const Bleaching&) const = default;
};

/// Light that a resin scatters forward (Henyey and Greenstein): what a collimated beam loses on its way,
/// the share of it that goes on in another direction, and the mean cosine of that direction. Absorption is
/// what is left, extinction (1 - albedo).
struct Turbidity {
  double extinction_per_cm = 0;  ///< base e; 0: nothing is scattered
  double albedo = 0;             ///< 0..1
  double anisotropy = 0;         ///< g, 0.9..0.995
  bool scatters() const { return extinction_per_cm > 0 && albedo > 0; }
  bool operator==(const Turbidity&) const = default;
};

/// A resin file (contract: "Resin file"), resolved to what the cure model needs.
struct Resin {
  std::string name;
  CureModelKind model = CureModelKind::jacobs;
  double m = 1.0;  ///< exponent of intensity, 0 < m <= 2; 1 where a time to gel counts
  double absorbance_height10_um = 0;  ///< base 10: intensity falls to 1/10
  /// Volumetric dose that the correction aims at, mJ/cm³ (m = 1).
  double critical_dose_mj_cm3 = 0;
  /// Areal dose analogue D'c of kinetic fits, (mW/cm²)^m·s; 0 when the volumetric dose counts.
  double critical_dose_prime = 0;
  /// Of a resin of model gel-time: A and B of t_gel = A/i + B/sqrt(i) (gel_time.hpp) times
  /// `dose_factor`, mJ/cm² and sqrt(mW/cm²)·s, both above 0; 0 for other models. No other dose counts
  /// then. (A file with B = 0 is read as Jacobs' law, one with A = 0 as the kinetic one of m = 1/2.)
  double gel_a_mj_cm2 = 0, gel_b_sqrt_mw_cm2_s = 0;
  bool has_gel_time() const { return model == CureModelKind::gel_time; }
  /// Measured gel dose, mJ/cm³, kept beside the dose aimed at; 0 when not given.
  double gel_dose_mj_cm3 = 0;
  /// Dose aimed at over gel dose; 1 when the file gives the dose aimed at.
  double dose_factor = 1;
  std::optional<Inhibition> inhibition;
  /// Absorption by what cures, 1/cm (base e): at most all of it, which the absorbance height says;
  /// 0: all of it. Volumetric doses count what this absorbs.
  double active_absorption_per_cm = 0;
  double n = 0;  ///< refractive index for the curing light, 1..3; 0 when not given
  /// Dose that inhibitors take before resin begins to gel, mJ/cm³, on top of the gel dose; >= 0.
  /// It counts in tomographic printing, as does what is resupplied of it, mJ/cm³/s.
  double inhibition_dose_mj_cm3 = 0;
  double inhibition_resupply_mj_cm3_s = 0;
  /// Diffusion of the dose that resin has taken, m²/s; 0: it stays where it is. It counts in
  /// tomographic printing.
  double dose_diffusion_m2_s = 0;
  /// Scatter of the curing light: at a depth of d um its variance along each axis has grown by so
  /// many um² times d, 0..`kMostScatter`; 0: it goes straight on.
  double scatter_um2_per_um = 0;
  /// Dynamic viscosity of the liquid resin, Pa·s; 0 when not given. Resin flow needs it.
  double viscosity_pa_s = 0;
  /// How long inhibitor that UV light has made stays in liquid resin, s, >= 0; infinite: until blue
  /// light uses it up. It counts where resin flows.
  double inhibitor_life_s = std::numeric_limits<double>::infinity();
  /// What light starts in it (chemistry.hpp); nothing where the file does not say it.
  std::optional<Chemistry> chemistry{};
  /// Nothing: light changes nothing in what it passes. Else m is 1.
  std::optional<Bleaching> bleaching{};
  double green_strength = 0;  ///< measured (`Process::green_strength`); 0: not given
  double wavelength_nm = 0;   ///< of the curing light it was measured with; 0 when not given
  /// The printer with which it was tuned, as `printer_and_light` (same_light.hpp) names it, and the
  /// only one that it goes with; empty: it was not tuned.
  std::string tuned_with{};
  /// The printer whose full light the seconds of `unit` `brightest` are; empty where nobody says.
  std::string display{};
  /// That of all doses; the printer's must be the same. `brightest`: model jacobs, without inhibition,
  /// bleaching or chemistry.
  LightUnit unit = LightUnit::mw_cm2;
  /// Whether they were told per area (mJ/cm²): then another height changes them, not what they are at
  /// a surface. Seconds of full light and D'c are of a surface always.
  bool areal_critical_dose = false, areal_gel_dose = false;
  Shrinkage
      shrinkage{};  ///< what becomes of its parts' lengths; nothing where its file says nothing
  Turbidity
      turbidity{};  ///< how it scatters light forward, one kick at a time; nothing: it does not
  UnreadWords unread{};  ///< words of its file that count for nothing
  bool bleaches() const { return bleaching.has_value(); }
  /// Whether doses are sums of what each exposure adds (supports.hpp: where other laws are not counted).
  bool adds_up() const { return !has_gel_time() && !bleaches(); }
  bool operator==(const Resin&) const = default;
};

/// Most that `dose_diffusion_m2_s` may be: a thousand times what small molecules do in water.
inline constexpr double kMostDiffusion = 1e-6;

/// Most that `viscosity_pa_s` may be: pitch.
inline constexpr double kMostViscosity = 1e9;

/// Most that `inhibitor_life_s` may be where it is not infinite.
inline constexpr double kMostLifeS = 1e9;

/// Most that `scatter_um2_per_um` may be: light a millimetre deep is spread over as much again.
inline constexpr double kMostScatter = 1e3;

/// Throws `InputError` where the resin shrinks, or its first layers grow: that is not counted in `what`, a word
/// or a few.
void refuse_shrinkage(const Resin& resin, const char* what);

/// Absorption of the curing light, base e, 1/cm: that of its absorbance height.
double absorption_per_cm(const Resin& resin);
/// The part of it that cures.
double curing_absorption_per_cm(const Resin& resin);
/// Height by which areal and volumetric doses of a resin convert, base e, um: that over which what
/// cures alone would dim the light to 1/e. The absorbance height where all that absorbs cures.
double dose_height_e_um(const Resin& resin);

enum class OneSliceGaps { open, merge };

/// What features over gaps do, continuous: gel early a shelf of theirs, so that little hangs on nothing
/// while it prints, or be as bright as their edges leave everywhere.
enum class Overhangs { bright, early };

/// Where the edges of a design lie whose target knows their heights (target.hpp): at the nodes of
/// its slices, or at these heights.
enum class Surface { slices, mesh };

/// continuous: the platform moves while slices are shown (dissertation §2.3). layerwise: it stands
/// still for each exposure and moves between them (appendix A.6).
enum class ExposureMode { continuous, layerwise };

/// How the UV lamp is driven.
enum class UvKind {
  off,
  constant,   ///< one intensity for all slices
  per_slice,  ///< one intensity per slice, over the whole window
  patterned,  ///< an image per slice: one intensity per pixel, from its grey level
};
struct UvSchedule {
  UvKind kind = UvKind::off;
  double uv_mw_cm2 = 0;     ///< constant: the intensity
  double dead_zone_um = 0;  ///< per_slice, patterned: steady dead zone to hold; 0: not asked
  /// per_slice: intensity of each slice, mW/cm²; the last holds for slices after it. patterned:
  /// that of a fully lit pixel, where the lamp is not as its calibration says; where `even_light`
  /// has a pattern of UV light, the mean over what is lit.
  std::vector<double> slice_mw_cm2;
  bool operator==(const UvSchedule&) const = default;
};

/// What happens while the stage speeds up and slows down (continuous).
enum class Ramp {
  none,          ///< not said
  lamp_follows,  ///< the lamps follow the speed: I^m / s stays the same, and with it all doses
  outside,       ///< the stage ramps before the first and after the last lit slice
};

/// What the lamps do where slices have speeds of their own (continuous).
enum class SliceLamps {
  follow,  ///< they follow the speed: I^m / s stays the same, and with it all doses
  stay,    ///< they stay as they are: a slice at half the speed gets twice the dose
};

/// The default of `Process::green_strength`.
inline constexpr double kDefaultGreenStrength = 1.2;

/// The dose that a resin is aimed at and the one at which it gels, in words: "230 mJ/cm³", "320
/// (mW/cm²)^0.99·s, 5 times its gel dose".
std::string dose_in_words(const Resin& resin);

/// The default of `Process::gap_shortfall`, slices. In figure 2.2 of the dissertation a gap of one
/// slice without light costs the feature above it 0.17 of a slice: such gaps may stay dark.
inline constexpr double kDefaultGapShortfall = 0.18;

/// Most that `Process::edge_aim_um` may be.
inline constexpr double kMostEdgeAimUm = 100;

/// What `Process::omega_max` is where nothing is capped.
inline constexpr double kNoCap = 1e300;

/// Thickest gap between part and window that is taken, um: beyond, the gap is no thin one.
inline constexpr double kMostGapUm = 1000;

/// How a stack is exposed and corrected.
struct Process {
  static constexpr int kDefaultSpreadRounds = 20, kMostSpreadRounds = 1000;
  double speed_mm_h = 0;  ///< print speed, > 0 in continuous mode
  /// Continuous: speed at each slice where some go slower, each above 0 and at most `speed_mm_h`;
  /// the last holds for later slices; empty: `speed_mm_h` throughout. Between slices the stage
  /// changes its speed in the faster one.
  std::vector<double> slice_speed_mm_h;
  /// follow: at the speed v lamps give (v / speed_mm_h)^(1/m) of their light, which leaves I^m / v and
  /// all doses as they are at `speed_mm_h`. stay: a slice of the speed v counts for speed_mm_h / v of
  /// what it does at `speed_mm_h`, black as well as full light; while the stage changes its speed
  /// within a slice the lamps follow that of the slice.
  SliceLamps slice_lamps = SliceLamps::follow;
  /// Cap of the relative dose inside features, >= 1; from `kNoCap` on none.
  double omega_max = kNoCap;
  OneSliceGaps one_slice_gaps = OneSliceGaps::open;
  /// Continuous: how much of the feature above an open gap of one slice may stay unprinted at its
  /// lower edge, in slices, 0 to 0.5: the more, the darker the gap. More stays unprinted only where
  /// no sequence of grey levels avoids it.
  double gap_shortfall = kDefaultGapShortfall;
  /// Continuous: how near to where they belong edges are aimed at, um; 0: as near as grey levels lead
  /// without much search, some 0.05 um. Levels that place edges more finely leave the light of low gaps
  /// less free: aimed at less finely, gaps of two and three slices are darker.
  double edge_aim_um = 0;
  Overhangs overhangs = Overhangs::bright;
  /// Of a corrected stack: what its edges were aimed at, and so what its height errors are measured
  /// from. Without edge heights always `slices`.
  Surface surface = Surface::slices;
  /// Whether the cap holds for features on the platform, too. Nothing lies behind them to protect,
  /// so they may be exposed fully whatever the cap: the dissertation's own choice for its rails.
  bool cap_platform_features = true;
  ExposureMode mode = ExposureMode::continuous;
  double exposure_s = 0;         ///< layerwise: of normal layers, > 0
  double bottom_exposure_s = 0;  ///< layerwise: of the first `bottom_layers`; 0: as normal
  int bottom_layers = 0;         ///< layerwise: how many layers get `bottom_exposure_s`, >= 0
  /// Layers after the bottom ones over which the exposure goes linearly from theirs to the normal
  /// one, >= 0: the k-th of F layers is k / (F + 1) of the way, so that none of them has the
  /// exposure of the bottom or of normal layers.
  int fade_layers = 0;
  /// layerwise: exposure of each layer, in place of the bottom's; the last holds for later layers.
  std::vector<double> layer_exposure_s;
  /// Share of the light for which the calibration holds that each layer gets, above 0 and at most 1; the
  /// last holds for later layers; empty: all of it.
  std::vector<double> light_share{};
  /// Height of each layer where they differ, um, above 0; the last holds for later layers; empty: all are as
  /// high as the stack says.
  std::vector<double> layer_heights_um{};
  /// layerwise: whether the platform lifts after each exposure.
  Lifts lifts = Lifts::none;
  /// With lifts: critical doses of its own exposure that a layer has at its far edge where it holds,
  /// 1 to 10.
  double green_strength = kDefaultGreenStrength;
  /// With lifts: part of the first layer over a gap that has gelled where that is a film, above 0 and
  /// at most 1.
  double skin = 0.5;
  /// With lifts: share of the liquid resin that each exchanges, 0 to 1, or `kUnknownExchange`.
  double lift_exchange = kUnknownExchange;
  /// layerwise: light and dose of the print were assumed, not measured.
  AssumedLight assumed = AssumedLight::none;
  UvSchedule uv;
  Ramp ramp = Ramp::none;
  double ramp_mm = 0;  ///< distance over which the stage reaches its speed; 0: not said
  /// Correct and show stacks whose resin cures to the window.
  bool allow_window_cure = false;
  /// Where light spreads: rounds in which columns are corrected together, at most; 0: each alone.
  int spread_rounds = kDefaultSpreadRounds;
  /// What makes the dead zone even although resin flows, and the light that does. What was asked for
  /// is known before that light is found (`find_even_light` in even_dead_zone.hpp).
  EvenDeadZone even_dead_zone = EvenDeadZone::off;
  std::optional<EvenLight> even_light{};
  /// Share of the calibration's light that the lamp still gives at each slice, as it fades, above 0 and
  /// at most 1; the last holds for later slices; empty: all of it. Nothing tells a printer to do so, as
  /// `light_share` does: `as_lamp_shines` makes one of both for what counts light.
  std::vector<double> lamp_share{};
  /// The same of the UV lamp.
  std::vector<double> uv_lamp_share{};
  bool operator==(const Process&) const = default;
};

/// What the UV lamp does, in words; empty when it is off.
std::string uv_in_words(const UvSchedule& uv);

/// Height of a slice, um, where those that do not differ are `layer_um` high.
double slice_height_um(const Process& process, double layer_um, int slice);
/// Speed at a slice, mm/h (continuous).
double slice_speed_mm_h(const Process& process, int slice);
/// Whether slices count for more where they go slower.
bool slices_differ(const Process& process);
/// Speeds in words: "800 mm/h", "150 to 800 mm/h from slice to slice".
std::string speeds_in_words(const Process& process);
/// Exposure of a layer, s (layerwise).
double layer_exposure_s(const Process& process, int layer);
/// Share of the light that a layer gets, and that of the last layers, for which models are made.
double light_share(const Process& process, int layer);
double usual_light_share(const Process& process);
/// The same print with the lamp's own share (`lamp_share`) in `light_share`: what resin gets. Once that is
/// done, doing it again changes nothing.
Process as_lamp_shines(Process process);
/// Whether layers get different shares of the light.
bool light_differs(const Process& process);
/// Shares in words: "50.2 % of full light, 100 % for the first 2 layers"; empty where all is full.
std::string light_share_in_words(const Process& process);
/// Shares that a lamp still gives: "100 %", "70 to 100 %".
std::string shares_in_words(const std::vector<double>& shares);
/// All of them in words (layerwise): "8 s each; the first layer 20 s, then 3 in steps between".
std::string exposures_in_words(const Process& process);

/// How long a slice is shown, and with what share of the intensity that its grey levels stand for.
struct SliceLight {
  double time_s = 0;  ///< > 0
  double share = 1;   ///< 0..1
};
/// Layer by layer the exposure, at the layer's share of the light. Continuous the time in which the stage passes the
/// slice; where the lamp follows the ramp, with constant acceleration v_n / v = sqrt(z / ramp), z
/// the distance of the middle of the slice from the nearer end of the print, and the share
/// (v_n / v)^(1/m), which leaves I^m / s and with it all doses as they are; the same where slices go
/// slower and the lamps follow. Where they stay the share is that of the ramp alone. It is one of the
/// layer's own share (`light_share`). Slices of different heights (`layer_heights_um`) are passed in times of
/// their own.
SliceLight slice_light(const Process& process, double m, double layer_um, int slice, int slices);
/// Time in which all slices are shown, s: without what lies between them layer by layer.
double light_on_s(const Process& process, double m, double layer_um, int slices);

/// Where definitions of a kind ("printer" or "resin") are looked for, first to last:
/// `$SLICECORR_DB`, the user's folder, the installed database (beside the running program, then at
/// the configured prefix), the source tree; each directly, then in its subfolder `printers` or
/// `resins`.
std::vector<std::string> definition_folders(std::string_view kind);
/// `$XDG_CONFIG_HOME/slicecorr` or `~/.config/slicecorr`; empty when neither variable is set.
std::string user_definition_folder();

struct Definition {
  std::string name, path;
};
/// All definitions of a kind by name; one that a folder further up hides is left out.
std::vector<Definition> list_definitions(std::string_view kind);
/// "printer" or "resin" by what the file holds; nothing when it is neither or can't be read.
std::optional<std::string> kind_of_definition(const std::string& path);
/// Path of a printer or resin: `name` is a path to a .toml file, or a name looked up as NAME.toml
/// in `definition_folders`. Throws `InputError` with what is known when there is none.
std::string find_definition(const std::string& name, std::string_view kind);

/// A printer from the text of its file, without the picture of the flat-field, of which only the
/// keys are checked; load_printer.hpp reads that, too.
Printer parse_printer(std::string_view text, const std::string& source);

/// How evenly a printer's display shines, in words: "80 to 100 % of the calibration"; empty when
/// the printer has no flat-field.
std::string light_in_words(const Printer& printer);

/// A map of pixels must have the display's shape; a few measured places may lie in any raster, but
/// not turned. Throws `InputError`, naming `path`, when a picture is wider than high where what it
/// covers is higher than wide, when both its sides have 64 pixels and more and their proportion
/// is off by more than 2 %, or when it has more pixels than the display and than a camera (1e8).
/// Looks at sizes alone.
void check_flat_field(const FlatField& field, const Printer& printer, const std::string& path);

/// A spread in words: "Gaussian, sigma 40 um"; empty for none.
std::string spread_in_words(const LightSpread& spread);
/// A measured spread must have odd sides, some light, its centre within a pixel of its middle, and
/// reach no further than the display is wide and high. Throws `InputError`, naming `path`.
void check_spread_picture(const SpreadPicture& picture, const Printer& printer,
                          const std::string& path);

/// Changes to a resin from the command line.
struct ResinOverrides {
  std::optional<double> dc_mj_cm3;    ///< dose to aim at; only for m = 1
  std::optional<double> ha_um;        ///< base 10
  std::optional<double> dose_factor;  ///< as `Resin::dose_factor`; for all resins
};
/// The resin with these changes, the same whether they are made to a file or to what it was read to.
/// Another height leaves doses as they were told, per area or per volume. Throws `InputError` when a
/// value is out of range, two of them set the dose, or a dose in mJ/cm³ is given for an m other
/// than 1.
Resin with_overrides(Resin resin, const ResinOverrides& overrides);
Resin load_resin(const std::string& name_or_path, const ResinOverrides& overrides = {});
Resin parse_resin(std::string_view text, const std::string& source,
                  const ResinOverrides& overrides = {});

}  // namespace slicecorr
