// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light of one slice with which oxygen is used up as if none came from beside.
///
/// Where oxygen diffuses in the plane of a slice, the dark around feeds small features and edges, and
/// they gel late. What each place is to use up is what its own light would without that: until the
/// brightest place runs out, at T, that is u = T Ri(i) / O(0). The light that is found uses up as much
/// although oxygen diffuses (consumption.hpp), and is then changed in a few rounds by when cells gel by
/// the full equations; the best round counts. What is not to gel keeps the light that it has, and
/// keeps some oxygen.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/chemistry_pattern.hpp"

namespace slicecorr::detail {

/// An image of a slice.
struct OxygenImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> level;  ///< that is shown, row by row
  std::vector<std::uint8_t> solid;  ///< 1: is to gel
};

/// What all images of a print share.
struct OxygenLight {
  double cell_um = 0;
  double spread_um = 0;  ///< sigma of light that spreads like a Gaussian
  /// Intensity of each level where the layer gels last, never falling.
  std::vector<double> level_mw_cm2;
  double margin = 0.15;  ///< share of its oxygen that everything else keeps until T, 0..1
  /// Least light of what is to gel, over what it has. Where neighbours use up the oxygen of a cell it would
  /// need none till T, and not cure after that.
  double least_share = 0.75;
  int steps = 80;  ///< of the search, >= 1
  int rounds = 3;  ///< in which light is changed by what the full equations say, >= 0
};

/// How far light does what it is to. Sums over cells, so that slices add up.
struct OxygenTally {
  /// Of oxygen used up by T, over what is wanted: the sum of what is missed, either way, and the least of one
  /// cell; as the search leaves it, before the rounds.
  double missed = 0, least = 1;
  /// By the full equations at the end of the exposure: end groups used up over those without diffusion,
  /// of cells that would gel by this exposure alone; and how many of these have less than half.
  double cure = 0;
  double off =
      0;  ///< of the same cells: how far times to gel are from those without diffusion, |ln|
  std::size_t behind = 0, dark_gelled = 0;
  void add(const OxygenTally& o);
};

struct EvenOxygen {
  std::vector<std::uint8_t> level;
  double by_s = 0;  ///< T
  std::size_t solid = 0, judged = 0;
  std::size_t short_of_light = 0;  ///< cells that stay below 1 - margin of what they should use up
  double brightest = 1;            ///< most light of a cell, over what it had
  OxygenTally before, after;
};

/// Cells around what is lit that count for it: beyond, oxygen does not know of it.
int oxygen_reach(const Chemistry& c, const OxygenLight& light, double exposure_s);
/// When the brightest of what is to gel runs out of oxygen, or the exposure ends: T.
double oxygen_time_s(const Chemistry& c, double mw_cm2, double exposure_s);
/// Steps in time of the judge.
PatternSetup judging_setup(const OxygenLight& light, double exposure_s);

/// `image` must have dark all around as far as `oxygen_reach`, and something to gel. Throws as
/// `run_pattern`.
EvenOxygen even_oxygen(const Chemistry& c, const OxygenImage& image, const OxygenLight& light,
                       double exposure_s, const ExecutionContext& context);

}  // namespace slicecorr::detail
