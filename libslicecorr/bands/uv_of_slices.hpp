// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// UV light of one intensity per slice, which follows from the brightest pixel that a correction shows of each.
#pragma once

#include <vector>

#include "slicecorr/place_models.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// Intensities of UV light, each `step` times less than the one before, down from a greatest one: so few that each
/// can have tables of its own.
struct UvLadder {
  double greatest, least, step;
  /// An intensity rounded up to it.
  double up(double uv_mw_cm2) const;
  /// Of all slices, with longer steps where places have tables of their own, so that fewer fit: dark slices get what
  /// the dimmest of the others needs.
  void put(const PlaceModels& models, std::vector<double>& slices_mw_cm2);
};

/// Whether the UV light of slices is still to be chosen.
bool chooses_uv_of_slices(const Process& process);

/// The process of the setup with UV light of each slice that holds its dead zone over blue light of
/// `brightest_mw_cm2`, as slices with the usual share of the light show it, wherever in the slice that may be; of few
/// intensities. `models`: of full light. Throws `InfeasibleError` with the slice where the lamp has faded too far.
Process with_uv_of_slices(const Setup& setup, const PlaceModels& models,
                          const std::vector<double>& brightest_mw_cm2);

}  // namespace slicecorr::detail
