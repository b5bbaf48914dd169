// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file dose_derivatives.hpp
/// How the dose of a column changes with what it was computed from.
///
/// Symbols are those of cure.hpp; L = ln10 eta, t the distance from a layer's lower node in slices,
/// e = a^t, w = Omega(n + 1). Derivatives go the same way as the dose, from the last slice to the
/// first. Continuous, with dphi the derivative of the slice's own intensity, and inside layer n
///
///     dOmega = dphi (1 - e) + e dw + [ln ha] e L t (w - phi)
///
/// of which t = 1 is the recursion from node to node. Layer by layer, where near = phi' + w,
///
///     dOmega = e (dphi' + dw) + [ln ha] L t e near
///
/// Light, dose to aim at and speed act alike, and no print tells them apart: Omega's derivative is m
/// Omega by ln light, -Omega by ln Dc and by ln s (layer by layer + Omega by ln te). ln ha is taken
/// with the *areal* dose Dc held, as working curves give it: phi then grows with ha, dphi = phi
/// (layer by layer 0). With the volumetric dose held it is less by Omega. Stray light is added to all
/// levels, dphi = m phi / I per mW/cm². By m, with D'c held where I = Iref, dphi = phi (ln(I / Iref)
/// - 1 / m) (layer by layer without the 1 / m), and the term of ln ha times -1 / m. Noise: the
/// variance of Omega for slices whose phi is off by 1, relatively and each by itself,
///
///     V = (phi (1 - e))² + e² V(n + 1),     layer by layer   e² (phi'² + V(n + 1))
///
/// Where lifts exchange a share x of the liquid (docs/lifts.md) the dose is the greatest D_k of the lifts k
/// from the layer's own on, and its derivatives are those of that one, in which the light of slice j
/// counts (1 - x)^(k - j) times, and with x changes by -(k - j) (1 - x)^(k - j - 1).
///
/// A dose of 1 moves by -dOmega / (dOmega / dz), `dose_per_um`. Where the light changes at a node, so
/// does that slope: an edge at a node moves otherwise to the one side than to the other.
///
/// Plain values; a `BandDerivatives` is for one thread at a time; functions are thread-safe. Errors
/// are `InputError`: of models whose derivatives aren't known (`check_derivatives`).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"

namespace slicecorr {

/// A relative dose and its derivatives.
struct DoseGradient {
  double dose = 0;      ///< Omega
  double ln_ha = 0;     ///< by ln ha, the areal dose held; >= 0
  double stray = 0;     ///< by stray light, per mW/cm²
  double m = 0;         ///< by the exponent, per 1
  double variance = 0;  ///< V: of Omega, for slices off by 1 each, relatively
  double light = 0;     ///< by differences: by ln of the curing light alone
  double exchange = 0;  ///< by the share of resin that a lift exchanges, per 1; <= 0
  double ln_ha_volumetric() const { return ln_ha - dose; }
  double ln_dc() const { return -dose; }
  double ln_light(double exponent) const { return exponent * dose; }
  /// Mean depth that the light of this dose has crossed, in absorbance heights (base e); layer by
  /// layer likewise: q of d ln Omega / d ln ha.
  double depth() const { return ln_ha / dose; }
};

/// Whether the dose's derivatives have a recursion: doses are sums of light, in resin without end, below a
/// platform that takes up all light, in layers of one height. Elsewhere they are differences between
/// models (`NearbyModels`).
bool derives_by_recursion(const CureModel& model);
/// Throws `InputError`, naming what, where they have none.
void check_derivatives(const CureModel& model);

/// The intensity of a slice, and its derivatives.
struct LightGradient {
  double phi = 0, stray = 0, m = 0;
};
/// `phi` >= 0; `reference_mw_cm2`: Iref, > 0. At no light and m < 1 the derivative by stray light is
/// infinite.
LightGradient light_gradient(const CureModel& model, double phi, double reference_mw_cm2 = 1);

/// The dose at the distance `t` above a layer's lower node, 0..1 slices; `below`: at that node, on
/// the far side of it, from which the light of the next slice (continuous) or its dose (layer by
/// layer) goes on.
DoseGradient step_gradient(const CureModel& model, const LightGradient& light,
                           const DoseGradient& below, double t = 1);

/// d Omega / dz where the dose is 1, z growing from the platform, per um: of a layer whose slice has
/// the intensity `phi` (continuous).
double dose_per_um(const CureModel& model, double phi);

/// The doses of one column whose slices have the intensities `phi`, first slice first.
class ColumnGradient {
 public:
  /// `phi`: of every slice, >= 0; layer by layer phi' at the normal exposure. Throws as
  /// `check_derivatives`.
  ColumnGradient(const CureModel& model, const std::vector<double>& phi,
                 double reference_mw_cm2 = 1);
  /// Of grey values 0..255 (`pixel_curve`).
  ColumnGradient(const CureModel& model, const std::vector<std::uint8_t>& pixels,
                 double reference_mw_cm2 = 1);

  int slices() const { return static_cast<int>(light_.size()); }
  /// Layer by layer with the slice's own exposure.
  double phi(int slice) const { return light_[static_cast<std::size_t>(slice)].phi; }
  /// At node `node`, 0..slices(), as layer `node` has it (layer by layer: W, its far edge).
  const DoseGradient& at_node(int node) const { return nodes_[static_cast<std::size_t>(node)]; }
  /// At `z` slices from the platform, 0..slices(). A node belongs to the layer above it.
  DoseGradient at(double z) const;
  /// By how much an edge at `z` slices moves away from the platform, um, per unit of what `change`
  /// is the derivative by: seen from the layer above it (`from_above`), or the one below.
  double edge_um(double z, double change, bool from_above) const;

 private:
  CureModel model_;
  std::vector<LightGradient> light_;
  std::vector<DoseGradient> nodes_;
  std::vector<DoseGradient> windows_;  ///< of each layer; empty unless lifts exchange resin
};

/// The resin with so many times its absorbance height, the areal dose held: a volumetric one falls as the
/// height grows.
Resin with_height_times(Resin resin, double factor);

/// The process whose pattern of UV light is the same over each level although the resin turns out to be
/// `off` and the curing light `brighter`: the dead zone is what changes.
Process with_pattern_held(Process process, const Resin& of, const Resin& off, double brighter);

/// Models of a process with one input off by a little: where the dose's derivatives have no recursion, they
/// are differences of the doses of these.
struct NearbyModels {
  static constexpr double kStep =
      1e-3;  ///< of ln ha, ln light and m; of stray light 1e-3 of full light
  double stray_mw_cm2 = 0;
  CureModel ha, light, stray, m;
};
/// UV light, if any, is of known intensities, or a pattern, of which stray light is not known. `layer_um`: slice height;
/// `reference_mw_cm2`: Iref of the exponent; 0: it is not off. An error of the height is that of fresh resin
/// where it bleaches. Throws as `make_cure_model`, and where the exponent is off and the resin has none
/// that could be: with a time to gel, where it bleaches, and under UV light where its dose is in mJ/cm³.
NearbyModels nearby_models(const Printer& printer, const Resin& resin, const Process& process,
                           double layer_um, double reference_mw_cm2);

/// Doses of a band of columns, slices from the last to the first, as `BandDose` has them.
class BandDerivatives {
 public:
  /// What besides ln ha is wanted: the rest stays 0.
  struct Wanted {
    bool stray = false, m = false, noise = false;
    double reference_mw_cm2 = 1;  ///< Iref
    bool light = false;           ///< the curing light apart from Omega: by differences
    bool exchange = false;        ///< the share of resin that a lift exchanges
    /// Above 0: not the derivative by it but the slope between shares so far to either side, within 0..1.
    /// Where one exposure decides alone, doses do not change with the share, but may a little further on.
    double exchange_step = 0;
  };
  /// `model` must outlive this, and `nearby`: with it derivatives are differences, whatever the model.
  /// Throws as `check_derivatives` without; noise is not known by differences.
  BandDerivatives(const CureModel& model, std::size_t columns, const Wanted& wanted,
                  const NearbyModels* nearby = nullptr);
  ~BandDerivatives();
  BandDerivatives(BandDerivatives&&) noexcept;

  /// Slice `slice` shows `pixels` (0..255, one per column); null: light off.
  void add_slice(int slice, const std::uint8_t* pixels);
  /// The same of light that spreads (`ImageShowing::phi`); none: light off. Without UV light; of several
  /// images at most with recursions.
  void add_slice(int slice, std::span<const ImageShowing> showings);
  /// Whether derivatives are differences: then the dose inside layers is the parabola through their
  /// ends and middle, layer by layer and under UV light of logarithms.
  bool by_differences() const { return differences_ != nullptr; }
  /// Of the slice added last, at the distance `t` above its layer's lower node, 0..1 slices.
  DoseGradient at(std::size_t column, double t) const;
  /// Intensity that the slice added last has in a column.
  double phi(std::size_t column) const { return light_.phi[column]; }
  /// Per column, of the slice added last: at the layer's upper node, and at its lower one just
  /// inside it (continuous: that of the slice before).
  struct Fields {
    /// Those not wanted are empty.
    std::vector<double> dose, ln_ha, stray, m, variance, light, exchange;
  };
  const Fields& upper() const { return upper_; }
  const Fields& lower() const { return lower_; }
  const CureModel& model() const { return model_; }

 private:
  struct Lights {
    std::vector<double> phi, stray, m;
  };
  struct Differences;
  struct Exchanged;
  void take_light(int slice, const std::uint8_t* pixels);
  void step();
  void take_differences(int slice, std::span<const ImageShowing> showings);
  void step_continuous();
  void step_layerwise();
  void step_exchanged();
  const CureModel& model_;
  Wanted wanted_;
  PixelCurve phi_of_, stray_of_, m_of_;  ///< by pixel
  Lights light_;
  Fields lower_, upper_;
  std::unique_ptr<Differences> differences_;
  std::unique_ptr<Exchanged> exchanged_;
};

}  // namespace slicecorr
