// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_window.hpp
/// A window that gives way under suction: how far it rises towards the part, and how that changes the
/// force that pulls a layer off it.
///
/// Three kinds, and an arm with each or none. *Springs* (a compressible layer, Winkler): the window rises
/// by c s where the suction is s. *A film* under the tension T, free over the radius Rs, that may stretch
/// (even tension, Berger): -T lap w = s. *An arm*, the stiffness k of what holds window or part: F/k.
/// *Rubber on glass* keeps its volume: it rises in the middle by sinking at the outline (nu 1/2; rubber.hpp).
///
/// While a part rises without a pause (`window_rest`) light sets the gap from the window's own surface: the
/// front follows, so that suction, dose and dead zone are those of a rigid window, and flat features are
/// bent as far as the window is. When a layer is pulled off from a gap h0 (`window_pull`), gap and
/// suction change together: the part peels from its outline inwards.
///
/// Sections count as a disc of the same area, with their own greatest suction and force over a rigid window.
/// For square and triangle that makes forces of springs too low by up to 4 %, of films by up to 11 %, where
/// windows are very soft. Sources: thin-film and porous-medium equations; M. Berger, J. Appl. Mech. 22, 465
/// (1955); E. Winkler, Die Lehre von der Elasticität und Festigkeit (1867).
///
/// Plain values; all functions are pure and thread-safe. `InputError` for what does not fit.
#pragma once

#include <optional>

#include "slicecorr/vat_window.hpp"

namespace slicecorr {

/// A section over a rigid window.
struct PulledSection {
  double area_mm2 = 0, suction_pa = 0, force_n = 0;       ///< > 0; the suction is the greatest
  double gap_um = 0, speed_mm_h = 0, viscosity_pa_s = 0;  ///< > 0
  double radius_mm() const;                               ///< of a disc of that area
};

/// Printed without a pause: the front follows the window.
struct WindowRest {
  double middle_um = 0;  ///< rise of the window in the middle of the section
  double rim_um = 0;  ///< at its outline, of rubber below 0; features are domed by the difference
  double slope = 0;   ///< greatest, of the window: beyond 0.5 none of this holds
  /// Time in which the slowest part of a change of speed falls to 1/e; 0 of an arm alone. Meanwhile the
  /// part grows at S - dw/dt. Of a film, at the tension that it has at rest. Of rubber the most that it
  /// is, 12 mu t³/(E h³): of any suction s that is 0 outside of the section, with its Fourier transform,
  /// integral(L s²) / integral(h³ k² s²/(12 mu)) <= the greatest L 12 mu/(h³ k²), which is that at k = 0.
  double time_s = 0;
  bool at_most = false;  ///< `time_s` is a bound
};
/// Throws `InputError` where the film's span lies inside of the section.
WindowRest window_rest(const FlowWindow& window, const PulledSection& section);

/// Pulled off from the gap at the speed, the window flat and at rest before.
struct WindowPull {
  double force_n = 0;    ///< the greatest
  double share = 1;      ///< of the force over a rigid window
  double exponent = 1;   ///< of speed: force goes as S to it
  double travel_um = 0;  ///< of the stage, until then
};
/// As `window_rest`. 10 to 300 ms of processor time.
WindowPull window_pull(const FlowWindow& window, const PulledSection& section);

/// The speed beyond which a flat window of springs snaps on to the section before the front has followed
/// (c s0/h0 = 1/4, any section), mm/h. Nothing for other windows.
std::optional<double> window_snap_mm_h(const FlowWindow& window, const PulledSection& section);

}  // namespace slicecorr
