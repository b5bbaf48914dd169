// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The band that `--assume` tells, held against prints of what it guesses: hidden displays, exposures and resins
/// drawn from the published spread, each followed point by point by code of the test alone.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "films_lab.hpp"
#include "lab_columns.hpp"
#include "rounds.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "slicecorr/uncertainty.hpp"

namespace slicecorr {
namespace {

constexpr double kLayerUm = 50;
constexpr int kParts = 5;

/// What nobody measured, of one lab.
struct Hidden {
  double power = 0, ha_um = 0, multiple = 0;
  /// Doses of a layer's levels at its window, in those that gel: `multiple` of what holds at its far side.
  double full() const { return multiple * kDefaultGreenStrength * std::pow(10, kLayerUm / ha_um); }
};

/// Powers near 3.0 were measured, from 2.2 to 3.5 at most; labs differ by 10 % in heights; people expose 2 to
/// 5 times what makes a layer hold (docs/calipers.md).
Hidden draw(double published_um, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> even(0, 1);
  Hidden h;
  h.power = 2.2 + 1.3 * even(random);
  h.ha_um = published_um * std::exp(0.1 * normal(random));
  h.multiple = kLeastOfHolding * std::pow(kMostOfHolding / kLeastOfHolding, even(random));
  return h;
}

slicecorr::Setup assumed(double published_um) {
  StackInfo file;
  file.grid = {100, 100, 40, kLayerUm, kLayerUm, kLayerUm};
  file.exposure_s = 2.5;
  SetupChoices c;
  c.printer_toml = test::kUnlitPrinter;
  c.resin_toml =
      "name = \"grey\"\n[cure]\nwavelength_nm = 405\nabsorbance_height_um = 150.0\n"
      "absorbance_base = 10\ngel_dose_mj_cm2 = 6.0\n";
  c.ha_um = published_um;
  c.mode = "layerwise";
  c.assume = "typical";
  return resolve_setup(c, nullptr, &file, ChoiceNames::options);
}

/// A part, corrected by the guess, with the bands that are told of the edges where features begin.
struct Told {
  std::vector<std::uint8_t> levels;
  std::map<int, UncertainBand::EdgeBand> edges;
};

Told tell(const test::LabColumn& part, const slicecorr::Setup& setup, const Uncertainty& u) {
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, kLayerUm);
  const auto layers = static_cast<int>(part.coverage.size());
  Told told;
  told.levels = solve_column(CorrectionPlan{model, setup.process, layers, layers}, part.coverage);
  UncertainBand band(model, u, layers, 1);
  band.tell_edges([&](const UncertainBand::EdgeBand& e) {
    if (e.upper) told.edges[e.node] = e;
  });
  for (int n = layers; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    band.add_slice(n, &told.levels[k], &part.coverage[k]);
  }
  UncertainPrint print;
  band.finish([](std::size_t) { return Pixel{0, 0}; }, print);
  return told;
}

std::vector<double> doses(const std::vector<std::uint8_t>& levels, double full, double power) {
  std::vector<double> phi;
  for (const std::uint8_t g : levels) phi.push_back(full * std::pow(g / 255.0, power));
  return phi;
}

/// Share of the edges of hidden prints that lie in the bands of `u`; of what `--assume` tells without one.
double share_in_band(const char* u, int labs, double* half_um = nullptr) {
  std::mt19937 random(17);
  int edges = 0, inside = 0;
  double widths_um = 0;
  for (int lab = 0; lab < labs; ++lab) {
    const double published_um = std::uniform_real_distribution<double>(90, 350)(random);
    slicecorr::Setup setup = assumed(published_um);
    if (u) setup.uncertainty = chosen_uncertainty(u, setup, {}, ChoiceNames::options);
    const Hidden hidden = draw(published_um, random);
    const double mean_full =
        make_cure_model(setup.printer, setup.resin, setup.process, kLayerUm).phi_max();
    for (int n = 0; n < kParts; ++n) {
      const test::LabColumn part = test::random_lab_column(random);
      const Told told = tell(part, setup, *setup.uncertainty);
      const std::vector<double> is = doses(told.levels, hidden.full(), hidden.power),
                                meant = doses(told.levels, mean_full, 3);
      for (const int node : part.begins) {
        const UncertainBand::EdgeBand& e = told.edges.at(node);
        // What is told of the mean is what the test's own eyes see there, to a step of theirs.
        EXPECT_NEAR(e.nominal * kLayerUm, test::lab_edge_um(meant, published_um, kLayerUm, node, 0),
                    2 * kLayerUm / test::kLabPoints)
            << lab << " " << node;
        const double seen = test::lab_edge_um(is, hidden.ha_um, kLayerUm, node, 0) / kLayerUm;
        const double step = 1.0 / test::kLabPoints;
        ++edges;
        inside += seen >= e.weak - step && seen <= e.strong + step ? 1 : 0;
        widths_um += 0.5 * (e.strong - e.weak) * kLayerUm;
      }
    }
  }
  EXPECT_GT(edges, 10 * labs);
  if (half_um) *half_um = widths_um / edges;
  return static_cast<double>(inside) / edges;
}

// 95 % is claimed; one draw moves all edges of a lab's five parts, so labs are what counts. Bands of a third of
// the errors do not hold what is drawn: the test would see them.
TEST(AssumedBand, HoldsTheShareThatItClaims) {
  const int labs = test::rounds(60);
  double half_um = 0;
  const double share = share_in_band(nullptr, labs, &half_um);
  RecordProperty("share", std::to_string(share));
  RecordProperty("half_width_um", std::to_string(half_um));
  EXPECT_GE(share, 0.95);
  EXPECT_LT(share_in_band("ha=3.3%,dc=7.7%,light=4%", labs), 0.8);
}

}  // namespace
}  // namespace slicecorr
