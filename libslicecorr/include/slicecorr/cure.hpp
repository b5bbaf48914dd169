// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file cure.hpp
/// The dose that slices leave behind under continuous exposure (dissertation §2.3, appendix A.2).
///
/// Symbols are those of the source: eta = hs / ha (base 10), a = 10^-eta, phi = I / Ic the relative
/// intensity of a slice, Omega = D / Dc the relative dose, zeta = z / hs the position in slices.
/// Resin gels where Omega >= 1. From the last node to the first
///
///     Omega(k) = phi_k (1 - a) + a Omega(k + 1),   Omega(M) = 0                           (A.32)
///
/// and inside layer n exactly
///
///     Omega(zeta) = phi_n + (Omega(n + 1) - phi_n) 10^-((n + 1 - zeta) eta)               (A.35)
///
/// which is monotone in the layer. An exponent m other than 1 (kinetic resins) keeps all of this,
/// with eta = m hs / (hb ln 10) and phi = I^m hb / (m s D'c).
///
/// Layer by layer (appendix A.6) each slice is shown for a time te while the platform stands still.
/// phi' = I^m te / D'c is what it adds at the window, W(n) the dose at the far edge of layer n:
///
///     W(n) = (phi'_n + W(n + 1)) a,   W(M) = 0
///     Omega(zeta) = (phi'_n + W(n + 1)) 10^-((n + 1 - zeta) eta)   in layer n
///
/// so the dose jumps at every node: the sawtooth.
///
/// A bath of resin of a depth of B slices above the window ends there: what is further away has run
/// off, and takes no more light. Doses are the sums over the next B slices alone, which is the same
/// as to take a^B of what slice n + B shows from what slice n does (`in_bath`):
///
///     phi_n - a^B phi_(n + B)   in place of phi_n, in all of the above
///
/// inside layers, too: the part of slice n + B that still reaches a point shrinks as that of slice n
/// grows.
///
/// A platform that sends back the share rho of the light that reaches it does so through as much
/// resin as lies above a point, twice: whatever the slice, the intensity at zeta slices from the
/// platform is
///
///     1 + rho 10^(-2 zeta hs / ha)
///
/// times what it were without, and the dose that to the power of m (`returned`). Sums and recursions
/// stay those above; what they give is multiplied. Inside a layer the dose may then have a minimum.
///
/// Where slices differ in height, slice n is h_n high and leaves a_n = 10^(-m h_n / ha) of a dose:
///
///     Omega(n) = phi_n (1 - a_n) + a_n Omega(n + 1)
///
/// phi is the dose after a long run of slices, whatever their heights: at one speed a higher slice is
/// shown for longer, and its light is spread over more of the way. A slice cut into several of the same
/// light gives the same doses.
///
/// Where slices are passed at speeds of their own and the lamps stay as they are, a slice at the speed
/// v counts for speed / v of what it does at the print's speed: phi_n = ratio(n) phi, black as well as
/// full light, and all of the above stays.
///
/// Where the resin bleaches (bleaching.hpp) a slice takes the dose on by dOmega/ds = phi G(1) -
/// G(Omega), s towards the platform, in place of (A.32): a long run of phi = 1 gels just as here. Layer
/// by layer phi' adds up at the window as above, and falls in the layer by dOmega/ds = -G(Omega).
///
/// Under inhibiting UV light none of this holds near the window: see inhibited.hpp. Nor does it for
/// resins of which a time to gel is known: see gel_time.hpp.
///
/// Models and tables are immutable once made and may be shared between threads; functions are pure
/// and thread-safe. What throws says so.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "slicecorr/bleaching.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

class GelTimeKernel;
class InhibitedKernel;

struct CureModel;
/// The features that count in a model (supports.hpp): UV light of any kind as constant.
std::vector<Feature> features_of(const CureModel& model);

/// By what law light becomes dose. Each has both modes of exposure.
struct SumOfLight {};  ///< (A.32), layer by layer W(n)
/// Under UV light (inhibited.hpp); never null.
struct UnderUv {
  std::shared_ptr<const InhibitedKernel> kernel;
};
/// Of a resin whose time to gel counts (gel_time.hpp): phi is the dose after a long run of slices,
/// layer by layer that of one exposure at the window, and `eta` and `a` are those of light. Never null.
struct WithGelTime {
  std::shared_ptr<const GelTimeKernel> kernel;
};
/// Of a resin that bleaches: lengths in slices, doses in critical ones.
struct WithBleaching {
  BleachingLaw law;
};
using DoseLaw = std::variant<SumOfLight, UnderUv, WithGelTime, WithBleaching>;

/// Layer by layer, where the platform lifts after each exposure (docs/lifts.md).
struct LiftModel {
  /// G, 1 or more: dose at the far edge of a layer that holds.
  double green_strength = kDefaultGreenStrength;
  double skin = 0.5;  ///< part of a layer that has gelled in a film
  double film = 1;    ///< a^-skin: least dose of a film at its window
  /// Whether the correction lets no layer stay liquid on purpose although the exchange is known: where light
  /// spreads and resin is exchanged, what is beside a column decides what of it is liquid.
  bool each_holds = false;
  /// x, share of the liquid that a lift exchanges; nothing: unknown.
  std::optional<double> exchange{};
};

/// A printer, a resin and an exposure schedule in dimensionless form.
struct CureModel {
  ExposureMode mode = ExposureMode::continuous;
  double layer_um = 0;                   ///< hs, > 0
  double eta = 0;                        ///< m hs / ha, base 10, > 0
  double a = 0;                          ///< 10^-eta: what is left of a dose one node further up
  double one_minus_a = 0;                ///< 1 - a, without cancellation
  double root_a = 0;                     ///< 10^(-eta/2): half a layer
  double m = 1;                          ///< exponent of intensity, 0 < m <= 2
  double critical_intensity_mw_cm2 = 0;  ///< Ic: the intensity of phi = 1
  /// phi of each grey level, never falling; layer by layer phi' at the normal exposure.
  std::vector<double> level_phi;
  /// What each slice counts for over a normal one: layer by layer its exposure, continuous the
  /// print's speed over its own where lamps stay, and both the m-th power of its share of the light; the
  /// last holds for later slices, empty: 1.
  std::vector<double> exposure_ratio;
  std::optional<LiftModel> lifts{};  ///< layer by layer, by sums of light alone
  /// By sums of light: heights of layers where they differ, what each leaves of a dose through all and
  /// through half of it, and 1 less the first. Lengths in layers are then those of `layer_um`.
  LayerHeights heights{};
  std::vector<double> own_a{}, own_root_a{}, own_one_minus_a{};
  double a_of(int layer) const { return own_a.empty() ? a : own_a[own(layer)]; }
  double one_minus_a_of(int layer) const {
    return own_a.empty() ? one_minus_a : own_one_minus_a[own(layer)];
  }
  double root_a_of(int layer) const { return own_a.empty() ? root_a : own_root_a[own(layer)]; }
  /// Height of a layer, in layers of `layer_um`.
  double height(int layer) const {
    return heights.alike() ? 1.0 : heights.of(layer, layer_um) / layer_um;
  }
  double eta_of(int layer) const { return eta * height(layer); }
  /// How far a place is from the platform, in layers of `layer_um`; `zeta` counts layers as they are.
  double depth(double zeta) const {
    return heights.alike() ? zeta : heights.place_um(zeta, layer_um) / layer_um;
  }
  /// With lifts: the least dose of a film at the window of a layer.
  double film_of(int layer) const;
  DoseLaw law;
  /// Of the law `UnderUv`, and of `WithGelTime`; null for other laws.
  const InhibitedKernel* inhibited() const {
    const auto* of = std::get_if<UnderUv>(&law);
    return of ? of->kernel.get() : nullptr;
  }
  const GelTimeKernel* gel_time() const {
    const auto* of = std::get_if<WithGelTime>(&law);
    return of ? of->kernel.get() : nullptr;
  }
  /// Null for laws other than `WithBleaching`.
  const BleachingLaw* bleaching() const {
    const auto* of = std::get_if<WithBleaching>(&law);
    return of ? &of->law : nullptr;
  }
  /// Whether doses are sums of what each slice adds.
  bool adds_up() const { return !gel_time() && !bleaching(); }
  /// Continuous, by sums of light: (A.32) describes the dose, where the bath ends with what slices
  /// count for in it.
  bool is_continuous() const {
    return mode == ExposureMode::continuous && std::holds_alternative<SumOfLight>(law);
  }
  /// Whether the recursion (A.32) describes the dose as it stands.
  bool is_plain() const {
    return is_continuous() && bath_slices == 0 && mirrored_slices == 0 && exposure_ratio.empty() &&
           heights.alike();
  }
  /// Depth of the resin above the window, in whole slices; 0: what is beyond it doesn't matter.
  int bath_slices = 0;
  /// a^bath_slices: what would be left of a slice's light at the end of the bath; 0 without one.
  double beyond = 0;
  /// What a slice of intensity `phi` counts for, the one `bath_slices` after it having `far`.
  double in_bath(double phi, double far) const { return phi - beyond * far; }
  /// Continuous: the dose after a long run of slices of intensity `phi`.
  double steady(double phi) const { return phi * (1.0 - beyond); }
  double reflectance = 0;  ///< of the platform, 0..1
  /// Slices from the platform on in which the light that it sends back counts; 0: nowhere.
  int mirrored_slices = 0;
  /// By how much light from the platform multiplies the dose at `zeta` slices from it.
  double returned(double zeta) const { return zeta < mirrored_slices ? with_returned(zeta) : 1.0; }
  double with_returned(double zeta) const;
  std::size_t own(int layer) const {
    return std::min(static_cast<std::size_t>(std::max(0, layer)), own_a.size() - 1);
  }
  /// What a slice counts for over a normal one.
  double ratio(int slice) const {
    if (exposure_ratio.empty()) return 1.0;
    const auto n = static_cast<std::size_t>(slice);
    return n < exposure_ratio.size() ? exposure_ratio[n] : exposure_ratio.back();
  }
  /// Over all slices.
  double greatest_ratio() const;
  double least_ratio() const;
  double phi_min() const { return level_phi.front(); }
  double phi_max() const { return level_phi.back(); }

  /// phi of an intensity at the window, and the intensity of a phi >= 0.
  double phi(double intensity_mw_cm2) const;
  double intensity_mw_cm2(double phi) const;

  /// Dose one node above `below` = Omega(k + 1) after a slice of intensity `phi`.
  double step(double phi, double below) const { return phi * one_minus_a + a * below; }
  /// The same through slice `slice`, of its own height.
  double step_in(int slice, double phi, double below) const {
    return phi * one_minus_a_of(slice) + a_of(slice) * below;
  }
  /// Dose in the middle of the layer.
  double middle(double phi, double below) const { return phi * (1.0 - root_a) + root_a * below; }
  double middle_in(int slice, double phi, double below) const {
    return phi * (1.0 - root_a_of(slice)) + root_a_of(slice) * below;
  }
  /// Distance from the layer's lower node, in slices (0..1), at which the dose is 1. Needs the
  /// doses of the two nodes on different sides of 1.
  double crossing(double phi, double below) const { return crossing(phi, below, eta); }
  /// The same in a layer of this eta (`eta_of`), as a part of it.
  double crossing(double phi, double below, double layer_eta) const;
  /// Slices of phi_max from slice `first` on that lift the dose from 0 to 1: what a part needs after its
  /// end. 0 layer by layer, where each layer gels in its own exposure.
  int slices_to_gel(int first = 0) const;
  /// How far one level step moves the upper edge of a feature, at most: hs dphi (1 - a) / (ln10 eta
  /// (1 - phi_min)), dphi the greatest step up to phi = 1. What the projector can do. Layer by
  /// layer hs dphi' a / (ln10 eta) with the greatest step up to phi' = 1 / a.
  double level_step_um() const;
  /// Highest dose that a feature of `slices` slices with both edges at 1 can reach (A.41).
  double highest_dose(double slices) const;

  /// Layer by layer: least height that cures above a feature whose far edge gets just the critical
  /// dose, ha log10(1 + phi'_min) (A.50), in layers of `exposure` times the normal exposure.
  double cut_through_um(double exposure = 1.0) const;
  /// Layer by layer: greatest over least dose in a layer, 10^eta (A.54).
  double heterogeneity() const { return 1.0 / a; }
  /// Layer by layer: what is left at a layer's far edge of a dose at its window, and the dose at the
  /// window that leaves `far` there; not with a time to gel, or under UV light.
  double faded(double near) const {
    return bleaching() ? bleaching()->after(near, 1.0, 0.0) : near * a;
  }
  double before_fading(double far) const {
    return bleaching() ? bleaching()->after(far, -1.0, 0.0) : far / a;
  }
  /// How much a layer of `layer_um` dims a dose at the least, base e: that of bleached resin; not with a time to
  /// gel, or under UV light.
  double least_fall() const { return bleaching() ? bleaching()->bleached() : eta * units::kLn10; }
  /// Layer by layer: whether the layer after next above such a feature gels again beside its
  /// window: phi'_min >= (1 - a) / (1 + a).
  bool gels_further_teeth(double exposure = 1.0) const {
    return phi_min() * exposure >= one_minus_a / (1.0 + a);
  }
};

/// The light at a place on a display that does not shine evenly.
struct PlaceLight {
  double factor = 1;  ///< share of the calibration's intensities that the place gets, >= 0
  /// The share at the brightest place. UV light is set for that place: there is one UV lamp or
  /// pattern for the whole window.
  double brightest = 1;
};
/// The printer as a place sees it that gets `factor` of its curing light.
Printer dimmed(const Printer& printer, double factor);
/// The printer as a resin sees it: grey by pulses counts by the resin's exponent m. A level that shows
/// full light If for the share s of the time, and black Ib else, does s If^m + (1 - s) Ib^m and not what
/// its mean (s If + (1 - s) Ib)^m would. `level_intensities` tells the steady light that does as much
/// from then on; black and full light stay as they are.
Printer for_resin(Printer printer, const Resin& resin);
/// The printer with the share of its light that layers get as a rule (`usual_light_share`).
Printer as_lit(const Printer& printer, const Process& process);

/// The model of a process. `layer_um` is the slice height. Does not ask whether the process is
/// feasible, nor for the printer's flat-field: `light` says what the place gets (place_models.hpp).
/// Throws `InputError` as `make_kinetics`, where an exposure or a UV lamp is missing, where the
/// resin is less deep than a slice, and where two features of the print do not go together
/// (supports.hpp); `InfeasibleError` as `InhibitedKernel`.
CureModel make_cure_model(const Printer& printer, const Resin& resin, const Process& process,
                          double layer_um, const PlaceLight& light = {});

/// Throws `InfeasibleError` when the light never gels the resin (phi_max <= 1) or black gels it
/// (phi_min >= 1), naming the limiting speed and the intensity that would do; `InputError` when the
/// speed is beyond the stage's. Layer by layer: when full light does not reach the critical dose at
/// the far edge of a layer (phi'_max a < 1), or black adds up to it beside the window (for layers
/// alike phi'_min >= 1 - a), naming the layer, the exposure and the intensity that would do.
void check_feasible(const CureModel& model, const Printer& printer, const Process& process);

/// Intensity of every grey level of a printer, mW/cm², linear between the points of its
/// calibration.
std::vector<double> level_intensities(const Printer& printer);

/// The same of a patterned UV lamp; throws `InputError` when the printer has none.
std::vector<double> uv_level_intensities(const Printer& printer);

/// Doses Omega(0..M) at the nodes for the intensities phi(0..M-1) of a column, by the recursion;
/// continuous, without UV light.
std::vector<double> node_doses(const CureModel& model, const std::vector<double>& phi);

/// phi of every pixel value 0..255 of a stack; layer by layer phi' at the normal exposure.
using PixelCurve = std::array<double, 256>;

/// Pixel values stand for levels of the printer: value v is level round(v * (levels - 1) / 255).
PixelCurve pixel_curve(const CureModel& model);
/// The level that a pixel value (0..255) stands for, and the pixel value that stands for a level;
/// `levels`: how many the printer has, 2..256.
int level_of_pixel(int value, int levels);
int pixel_of_level(int level, int levels);

/// Finds grey levels by their phi.
class LevelTable {
 public:
  explicit LevelTable(std::vector<double> level_phi);
  int size() const { return static_cast<int>(phi_.size()); }
  double phi(int level) const { return phi_[static_cast<std::size_t>(level)]; }
  const double* data() const { return phi_.data(); }
  /// Lowest level of the greatest phi.
  int highest() const { return steps_.back().here; }
  /// Lowest level whose phi is at least `phi`; the lowest of the brightest when there is none.
  int at_least(double phi) const { return around(phi).at_least; }
  /// Lowest level of the greatest phi that is at most `phi`; 0 when there is none.
  int at_most(double phi) const { return around(phi).at_most; }
  /// at_most() and at_least() by one look.
  struct Around {
    int at_most, at_least;
  };
  Around around(double phi) const {
    int level = start_[bucket(phi)];
    // Most often one step or none. The bound past the last level is infinite: no phi is above it.
    while (bounds_[static_cast<std::size_t>(level)] < phi) ++level;
    const Steps steps = steps_[static_cast<std::size_t>(level)];
    const bool exact = bounds_[static_cast<std::size_t>(level)] <= phi;
    return {exact ? steps.here : steps.before, steps.here};
  }

 private:
  // Fine enough that a linear curve of 256 levels has at most one level per bucket.
  static constexpr std::size_t kBuckets = 1024;
  std::size_t bucket(double phi) const {
    const double x = (phi - phi_.front()) * scale_;
    // Written without branches: the order of levels is nothing that a processor could predict.
    const double low = x > 0 ? x : 0;
    return static_cast<std::size_t>(static_cast<std::int32_t>(low < kBuckets ? low : kBuckets));
  }
  std::vector<double> phi_;
  std::vector<double> bounds_;  ///< phi of each level, and infinity
  /// For each level: the lowest level of the same phi (`here`), and that of the level before it
  /// (`before`; of the first level, itself). One entry more, for phi above all levels, has the last
  /// level's `here` as both.
  struct Steps {
    std::int32_t before, here;
  };
  std::vector<Steps> steps_;
  std::vector<int> start_;  ///< per bucket of phi: first level that may lie in it
  double scale_ = 0;
};

}  // namespace slicecorr
