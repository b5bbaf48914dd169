// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Doses in bands as the solver is asked for them.
#pragma once

#include <memory>

#include "slicecorr/process.hpp"
#include "slicecorr/tomo/solve.hpp"
#include "slicecorr/tomo/volume.hpp"
#include "slicecorr/tomo/wanted.hpp"

namespace slicecorr::tomo::detail {

/// Throws `InputError` for wanted doses of another grid than the part's, and for resin whose doses do not grow
/// as light does.
void check_wanted(const DoseBands& wanted, const Box<std::uint8_t>& part, const Resin& resin);

/// Throws `InputError` for a voxel that wants a dose where there is no resin: farther from the axis than all of it,
/// or where `beside` is opaque.
void check_wanted_in_resin(const DoseBands& wanted, const Box<std::uint8_t>& beside,
                           double voxel_mm);

/// Gives a target its bands, in gel doses; cells of weight 0, and in the insert, are free.
void add_bands(const DoseBands& wanted, const Box<std::uint8_t>& insert, double gel_dose_mj_cm3,
               Target& target);

/// The same problem with the weights of its cells in operators and bands: D' = s D, s their roots. Its light
/// is that of `target` and `projector`.
Target weighed(Target target);
std::shared_ptr<const Projector> weighed(std::shared_ptr<const Projector> projector,
                                         const Target& target);

/// What was found with weights, as `projector` and `target` without them have it. The contrast is the slack of
/// the bands.
void without_weights(const ExecutionContext& context, const Projector& projector,
                     const Target& target, Solution& found);

}  // namespace slicecorr::tomo::detail
