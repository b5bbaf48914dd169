// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What benches have of light that is traced: vials that are not round, or have rods.
#pragma once

#include <memory>
#include <optional>

#include "slicecorr/process.hpp"
#include "slicecorr/tomo/bench.hpp"

namespace slicecorr::tomo::detail {

/// The printer with walls and light for which closed forms are nearly right: a tube without rods, or one
/// that is as wide as walls that are not round and bends nothing, as flat ones do to light at right angles.
Printer closed_like(const Printer& printer, double n_resin);

/// Throws `InputError` naming what of printer and resin does not go with it.
void check_traced(const Printer& printer, const Resin& resin);
/// The same for an insert: light knows walls and rods, and no other ones.
void check_traced_insert(const Bench& bench, const Volume& insert);

/// Columns of the grid's light, and rows where it rises, as they are traced.
std::shared_ptr<const TracedLight> traced_light(const Printer& printer, double n_resin,
                                                const Bench& bench);

/// How far light of the middle column has risen next to the axis, for an n_outside kz of 1; nothing where a
/// rod stands there.
std::optional<double> rise_on_axis(const TracedLight& light);

}  // namespace slicecorr::tomo::detail
