/// The workings of doses under UV light, which have files of their own.
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

/// Doses of a model with an inhibited kernel.
std::unique_ptr<BandDose::Walker> make_inhibited_walker(const CureModel& model,
                                                        std::size_t columns);

}  // namespace slicecorr::detail
