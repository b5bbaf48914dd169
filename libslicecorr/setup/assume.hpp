// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What of a setup is taken from what is typical, where nobody measured a printer's light.
#pragma once

#include "slicecorr/settings.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// What the dose is assumed from.
struct Assuming {
  const SetupChoices& choices;
  ChoiceNames names;
  const StackInfo* assumed;  ///< a stack that was made by what is typical; null: none
  const StackInfo* times;    ///< an archive whose exposures print; null: none
};

/// The strength at joints of a print that `assumed` is, or is not, any more. A stack that was made by what is
/// typical says the strength with its margin, which is no part of what people say, nor of what a printer and a
/// resin that were measured need.
void assume_strength(const SetupChoices& c, const StackInfo* assumed, Process& process);

/// The dose of a resin whose layers are `layer_um` high or as `setup` lists, and the strength with its margin.
/// Throws `InputError` where nothing can be assumed.
void assume_dose(const Assuming& a, double layer_um, Setup& setup);

/// Figures of a print whose light is assumed say how sure they are, wherever that is counted.
void assume_errors(Setup& setup);

}  // namespace slicecorr::detail
