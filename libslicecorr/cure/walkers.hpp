// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The walker interface behind `BandDose`, shared by the files of this module.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "slicecorr/dose.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

/// The kernel of a process whose UV light is on (`process.uv.kind` is not off), at a place where
/// grey levels give `level_mw_cm2`. `brightest`: see PlaceLight.
std::shared_ptr<const InhibitedKernel> make_inhibited_kernel(
    const Printer& printer, const Resin& resin, const Process& process, double layer_um,
    const std::vector<double>& level_mw_cm2, double brightest);

/// phi of the columns [first, first + n), n of at most a block, from all showings of a slice.
void block_phi(const PixelCurve& curve, std::span<const ImageShowing> showings, std::size_t first,
               std::size_t n, double* phi);

/// A piece of a layer, from `from` to `to` slices from the layer's lower end: at a distance d the dose
/// is phi + (begin - phi) a^(d - from), where it is a sum of light.
struct Stretch {
  double from, to, phi, begin;
};

/// How the doses of a band follow from its slices in one model, slices from the last to the first.
class DoseWalker {
 public:
  virtual ~DoseWalker() = default;
  virtual void add_slice(int slice, std::span<const ImageShowing> showings) = 0;
  /// See BandDose::inside.
  virtual void inside(std::size_t column, double known, InsideLayer& out) const = 0;
  /// See BandDose::steady.
  virtual bool steady(std::size_t, SteadyLayer&) const { return false; }
  virtual void inside(const SteadyLayer&, double, InsideLayer&) const {}
  /// The pieces of the layer, from its lower end on; none under UV light, and of resins with a time to gel.
  virtual void stretches(std::size_t, std::vector<Stretch>& out) const { out.clear(); }
  std::vector<double> lower, middle, upper;  ///< doses of the layer that was added last, per column
  std::vector<std::uint8_t> turning;         ///< see BandDose::turning; empty: nowhere
};

/// `doses` as light from the platform multiplies them.
std::unique_ptr<DoseWalker> with_returned_light(const CureModel& model,
                                                std::unique_ptr<DoseWalker> doses);

/// Doses of a model with an inhibited kernel.
std::unique_ptr<DoseWalker> make_inhibited_walker(const CureModel& model, std::size_t columns);

/// Doses of a model with a time to gel.
std::unique_ptr<DoseWalker> make_gel_time_walker(const CureModel& model, std::size_t columns);

}  // namespace slicecorr::detail
