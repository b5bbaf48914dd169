// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file dose_combs_fit.hpp
/// Which critical dose prints teeth as designed, from a plate of combs that were corrected for several
/// (`slicecorr testpart dose-combs`).
///
/// Too high a dose makes the correction's light too bright: teeth begin too early, seen from the platform, by about the
/// absorbance height (base e) times the logarithm of the dose; where they end hardly moves. At the right dose every
/// edge lies where it is designed, whatever the rest of the model says. So the dose is where the mean over a comb's
/// beginnings of teeth passes 0, on a straight line in the logarithm of the dose between the two combs beside it.
///
/// Plain values; pure and thread-safe. Throws `InputError`.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

struct DoseCombsFit {
  struct Comb {
    double dose_factor = 0;  ///< times the gel dose
    int measured = 0, edges = 0;
    double growth_um = 0;  ///< by how much its teeth begin too early, in the mean
    double rms_um = 0;     ///< of edges from where they are designed
    double stderr_um = 0;  ///< of the growth, from the scatter over its teeth; NaN of a single one
  };
  std::vector<Comb> combs;  ///< of those with a beginning that was measured, rising
  double dose_factor = 0;   ///< found
  double stderr_ln =
      0;  ///< of its logarithm, from the scatter of edges; NaN where that is not known
  std::size_t best = 0;  ///< the comb whose edges are least off
  /// By how much the line between the two combs beside it may be off besides: an eighth of their step.
  double line_ln = 0;
  std::string to_text() const;
};

/// Whether a file is such a table.
bool is_dose_combs_table(const std::string& path);
/// Throws where fewer than two combs were measured, where teeth end elsewhere than any dose moves them (places from
/// another zero), and where growth does not pass 0 between them: then the dose lies
/// below the least or above the greatest, which is said.
DoseCombsFit fit_dose_combs(const std::string& path);
/// The resin's file that aims at so many times its gel dose, under a new name. Throws where it does not say its
/// gel dose.
std::string resin_with_dose_factor(const std::string& text, const std::string& source,
                                   const std::string& name, const DoseCombsFit& fit);

}  // namespace slicecorr::resins
