// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file heights.hpp
/// Heights that the cure law predicts, with exact derivatives.
///
/// One law with ten parameters serves all models; a model is a choice of what is free:
///
///     cured height   zc = h ln I + (h / m) (ln t - ln D'c)                        (3.15)
///     with A and B   zc = h (ln I - ln ig),  ig = ((B + sqrt(B² + 4 A t)) / (2 t))², where one is above 0
///     bleaching      zc = int from Dc to I t of dD / G(D)  (bleaching.hpp), where Eb is above 0
///     steady front   zf = L ln(rho),  L = 1 / (1/huv - 1/h),  rho = beta Iuv / Ib (3.25)
///     front at t     root of (Ib e^(-z/h) - beta Iuv e^(-z/huv))^m' t = D'c       (3.22)
///
/// Heights may come out negative: the laws go on smoothly past the window, so that a solver finds
/// its way back. Pure functions.
#pragma once

#include <array>

namespace slicecorr::resins {

/// Parameters of the law. Jacobs' law is the one with m = 1: D'c is Dc then.
enum Slot {
  kHeight,
  kExponent,
  kDose,
  kBeta,
  kUvHeight,
  kUvExponent,
  kGelA,
  kGelB,
  kBleachedHeight,
  kBleachingDose,
  kSlots
};
/// Values by slot, or derivatives with respect to them. Heights um, base e; doses areal.
using Slots = std::array<double, kSlots>;

/// Logarithms of what a sample was exposed to: mW/cm² and s.
struct Exposure {
  double ln_blue = 0, ln_uv = 0, ln_time = 0;
};

/// A height and its derivatives by slot.
struct Height {
  double um = 0;
  Slots by{};
  /// False where the front's law has no root: the first gel is still to come. The height is then
  /// the continuation described at `front_height`.
  bool gels = true;
};

Height cured_height(const Slots& law, const Exposure& e);
Height steady_height(const Slots& law, const Exposure& e);

/// With d = z - z0 (z0, t0: place and time of the first gel), w = d / huv, q = huv / h and
/// s = ln(t / t0) / m', the root obeys
///
///     (e^(-q w) - q e^(-w)) / (1 - q) = e^(-s)
///
/// which depends on q and s alone; w(s, q) and its derivatives follow by the implicit function
/// theorem. At s = 0 the root ends with an infinite slope, so below s = `kLeastS` the tangent is
/// taken instead: the height grows with ln(t0 / t), finite and smooth.
/// Needs huv < h.
Height front_height(const Slots& law, const Exposure& e);
inline constexpr double kLeastS = 1e-3;

/// Where the first resin gels, um; may be negative.
double first_gel_height(const Slots& law, const Exposure& e);

}  // namespace slicecorr::resins
