// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file peel.hpp
/// A disc that is pulled off a window that gives way, in numbers without units.
///
/// With x = r/R, H = h/h0, tau = S t/h0, sigma = s/s0, s0 = 3 mu S R²/h0³ and the window's rise W = w/h0,
///
///     dH/dtau = -(1/4) div(H³ grad sigma),  sigma(1) = 0,  H = 1 + tau - W,  H = 1 at tau = 0,
///     W = springs sigma, or -lap W = film sigma with W(1) = -ln(Rs/R) W'(1), or that of rubber
/// (rubber.hpp); plus arm F/F_r on each. A film that
/// stretches has the tension T (1 + stretch 1/(Rs/R)² int W'² x dx), even over its span (Berger).
///
/// Finite volumes whose cells get narrower towards the outline, where the part peels, in steps of second
/// order (BDF) that grow by a hundredth; H³ by rounds within each. Pure functions.
#pragma once

namespace slicecorr::detail {

/// How soft the window is; 0 is stiff. Springs, film or rubber, and an arm with either.
struct Softness {
  double springs = 0;      ///< c s0/h0
  double film = 0;         ///< s0 R²/(T h0)
  double span_ratio = 5;   ///< Rs/R of the film, > 1
  double arm = 0;          ///< F_r/(k h0)
  double stretch = 0;      ///< Y h0²/(R² T) of a film that stretches
  double rubber = 0;       ///< s0 R/(G h0) of rubber on glass
  double thickness = 0.2;  ///< t/R of it, > 0
};

struct Peel {
  double share = 1;  ///< greatest force over that of a rigid window, pi R² s0/2
  double tau = 0;    ///< when
};
/// Throws nothing; `share` is right to half a per cent where groups are at most 1e4.
Peel peel(const Softness& softness);

}  // namespace slicecorr::detail
