// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tune/scan_inputs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tune/matrix.hpp"

namespace slicecorr::resins {

using Eigen::Index;

namespace {

/// What is known of shrinkage and offsets before any scan: a share, and mm.
constexpr double kShrinkageSd = 0.01, kWallsSdMm = 0.03, kFirstSdMm = 0.1;
/// Spread and scatter as files say them are right to so much; the dead zone's factor, too.
constexpr double kSpreadShareSd = 0.3, kDeadZoneSd = 0.1;
/// Of scatter that no file says, um² per um: 30 um a millimetre deep.
constexpr double kScatterSd = 1;
/// Differences are taken over this share of the scale of an input.
constexpr double kDifferenceStep = 0.2;
constexpr double kNoBound = std::numeric_limits<double>::infinity();

}  // namespace

double spread_width_um(const LightSpread& spread) {
  double squares = 0, weights = 0;
  for (const SpreadGaussian& g : spread.gaussians) {
    squares += g.weight * g.sigma_um * g.sigma_um;
    weights += g.weight;
  }
  return weights > 0 ? std::sqrt(squares / weights) : 0;
}

LightSpread spread_as_wide(const LightSpread& spread, double width_um) {
  const double before = spread_width_um(spread);
  if (spread.picture || before == width_um) return spread;
  LightSpread now = spread;
  if (!(width_um > 0)) {
    now.gaussians.clear();
  } else if (!(before > 0)) {
    now.gaussians = {{width_um, 1}};
  } else {
    for (SpreadGaussian& g : now.gaussians) g.sigma_um *= width_um / before;
  }
  return now;
}

ScanInputs::ScanInputs(const Setup& setup, const TunePrior& prior, const ScanTuneOptions& options,
                       bool layerwise, bool uv)
    : spread_um_(spread_width_um(setup.printer.spread)),
      pixel_um_(setup.printer.pixel_x_um),
      growth_um_(setup.resin.shrinkage.growth_um) {
  const auto asked = [&](ScanInput input) {
    return std::find(options.seek.begin(), options.seek.end(), input) != options.seek.end();
  };
  const double scatter = setup.resin.scatter_um2_per_um;
  sought_.fill(true);
  sought_[at(ScanInput::exchange)] = layerwise;
  sought_[at(ScanInput::spread)] =
      !setup.printer.spread.picture && (spread_um_ > 0 || asked(ScanInput::spread));
  sought_[at(ScanInput::scatter)] = scatter > 0 || asked(ScanInput::scatter);
  sought_[at(ScanInput::dead_zone)] = uv && setup.resin.inhibition.has_value();

  least_.fill(-kNoBound);
  most_.fill(kNoBound);
  least_[at(ScanInput::exchange)] = -exchange_before(setup.printer);
  most_[at(ScanInput::exchange)] = 1 - exchange_before(setup.printer);
  least_[at(ScanInput::spread)] = -spread_um_;
  least_[at(ScanInput::scatter)] = -scatter;
  most_[at(ScanInput::scatter)] = kMostScatter - scatter;

  const double spread_sd = spread_um_ > 0 ? kSpreadShareSd * spread_um_ : 0.5 * pixel_um_,
               scatter_sd = scatter > 0 ? kSpreadShareSd * scatter : kScatterSd;
  const TuneMatrix usual = default_prior().covariance;
  for (std::size_t k = 0; k < kTuned; ++k) scale_[k] = std::sqrt(usual[k][k]);
  scale_[at(ScanInput::shrinkage_plane)] = scale_[at(ScanInput::shrinkage_z)] = kShrinkageSd;
  scale_[at(ScanInput::walls)] = kWallsSdMm;
  scale_[at(ScanInput::first_layers)] = kFirstSdMm;
  scale_[at(ScanInput::spread)] = spread_sd;
  scale_[at(ScanInput::scatter)] = scatter_sd;
  scale_[at(ScanInput::dead_zone)] = kDeadZoneSd;

  mean_ = Eigen::VectorXd::Zero(kScanInputs);
  before_ = Eigen::MatrixXd::Zero(kScanInputs, kScanInputs);
  for (std::size_t k = kTuned; k < kScanInputs; ++k) {
    before_(static_cast<Index>(k), static_cast<Index>(k)) = scale_[k] * scale_[k];
  }
  before_.topLeftCorner(kUnknowns, kUnknowns) = matrix_of(prior.covariance);
  for (std::size_t k = 0; k < kTuned; ++k) mean_[static_cast<Index>(k)] = prior.mean[k];
}

bool ScanInputs::predicted(std::size_t k) const {
  return sought_[k] && (k < kTuned || k >= at(ScanInput::spread));
}

double ScanInputs::within(std::size_t k, double change) const {
  return std::clamp(change, least_[k], most_[k]);
}

std::array<double, 2> ScanInputs::steps(std::size_t k, double change) const {
  // Light that spreads by much less than a pixel changes nothing at all, so a small step would say that none ever does.
  if (k == at(ScanInput::spread) && spread_um_ + change < 0.5 * pixel_um_) {
    return {0, 0.5 * pixel_um_};
  }
  const double step = kDifferenceStep * scale_[k];
  if (change - step < least_[k]) return {0, step};
  if (change + step > most_[k]) return {step, 0};
  return {step, step};
}

Setup ScanInputs::setup_at(const Setup& setup, const ScanVector& change) const {
  TuneVector x{};
  std::copy_n(change.begin(), kTuned, x.begin());
  Setup now = tuned_setup(setup, x);
  if (sought_[at(ScanInput::spread)]) {
    now.printer.spread =
        spread_as_wide(setup.printer.spread, spread_um_ + change[at(ScanInput::spread)]);
  }
  if (sought_[at(ScanInput::scatter)]) {
    now.resin.scatter_um2_per_um += change[at(ScanInput::scatter)];
  }
  if (sought_[at(ScanInput::dead_zone)] && now.resin.inhibition) {
    now.resin.inhibition->beta *= std::exp(change[at(ScanInput::dead_zone)]);
  }
  const double growth_mm = change[at(ScanInput::first_layers)];
  now.resin.shrinkage.growth_um = growth_um_ + 1e3 * (growth_mm - growth_left_mm(growth_mm));
  return now;
}

double ScanInputs::growth_left_mm(double change_mm) const {
  const double um = growth_um_ + 1e3 * change_mm;
  return 1e-3 * (um - std::clamp(um, 0.0, Shrinkage::kMostGrowthUm));
}

}  // namespace slicecorr::resins
