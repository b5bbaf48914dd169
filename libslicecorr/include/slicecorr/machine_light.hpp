// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file machine_light.hpp
/// What the lamps of a machine that printbridge drives do to a print beside its images: they warm up behind
/// black, shine behind black around exposures, and give UV light within a range (docs/bridge.md). One set of
/// rules for who plans, corrects, queues and prints; how the stage moves is in machine_motion.hpp.
///
/// Plain values; all functions are thread-safe.
#pragma once

#include <vector>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/machine_motion.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// A print as the lamps see it.
struct LitPrint {
  const Printer& printer;
  const Resin& resin;
  const Process& process;
  double layer_um = 0;  ///< > 0
  int slices = 0;       ///< >= 0
};

/// UV light of slice `n` of a lamp that floods the window, mW/cm². `full_mw_cm2`: the greatest blue light,
/// over which a dead zone that is asked for is to stand; `kinetics` as for UV light, at the aim.
double flood_mw_cm2(const UvSchedule& uv, const Kinetics& kinetics, double full_mw_cm2, int n);

/// Share of the dose that gels which black gives in each layer around its exposure, layer by layer without
/// UV light; 0 elsewhere.
double black_excess(const LitPrint& print, const MachineMotion& machine);

/// Throws `InfeasibleError` where the lamp that warms up behind black half gels the resin, or black around
/// exposures gives more than is borne.
void check_black_light(const LitPrint& print, const MachineMotion& machine);

/// Throws `InfeasibleError` where the UV lamp gives less or more than slices ask for: `uv_mw_cm2` has one
/// value for each, the last holds for later ones. The printer has a UV lamp.
void check_uv_range(const LitPrint& print, const MachineMotion& machine,
                    const std::vector<double>& uv_mw_cm2);

/// All of it for a print that is planned or was corrected; patterned UV light is within the lamp's range.
void check_lamps(const LitPrint& print, const MachineMotion& machine);

}  // namespace slicecorr
