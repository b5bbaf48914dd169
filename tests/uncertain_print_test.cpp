// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How sure predictions are: against their own predictor, against draws of the inputs, and against
// figures that were computed apart.
#include "slicecorr/uncertain_print.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <tuple>

#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::figure_2_2;
using test::plan_for;
using test::process;

Uncertainty off_by(const std::string& text, ExposureMode mode = ExposureMode::continuous) {
  return parse_uncertainty(text, mode, 100, {});
}

/// Errors as a fit of six doses from 1.5 to 9 gel doses leaves them, with those of light and speed
/// beside: ln ha is off by `ha`, the areal dose by 1.43806 times as much, correlated with it.
Uncertainty as_fitted(double ha) {
  const auto percent = [](double share) { return std::to_string(100 * share) + "%"; };
  Uncertainty u = off_by("ha=" + percent(ha) + ",dc=" + percent(1.43806 * ha) +
                         ",light=" + percent(0.6 * ha) + ",speed=" + percent(0.2 * ha));
  u.covariance[1] = u.covariance[4] = 0.90492 * ha * 1.43806 * ha;
  return u;
}

/// A draw of these: ln ha, and ln of all that acts like light.
std::pair<double, double> drawn_as_fitted(double ha, std::mt19937& random) {
  std::normal_distribution<double> normal;
  const double a = normal(random), b = normal(random);
  const double ln_dc = 1.43806 * ha * (0.90492 * a + std::sqrt(1 - 0.90492 * 0.90492) * b);
  const double light = 0.6 * ha * normal(random), speed = 0.2 * ha * normal(random);
  return {ha * a, light - speed - ln_dc};
}

/// A model whose levels are just the intensities of a solution, and the column in these.
struct ExactColumn {
  ExactColumn(const CorrectionPlan& plan, const std::vector<std::uint8_t>& design)
      : model(plan.model), coverage(design) {
    const std::vector<double> phi = solve_column_exactly(plan, design);
    model.level_phi = phi;
    std::sort(model.level_phi.begin(), model.level_phi.end());
    model.level_phi.erase(std::unique(model.level_phi.begin(), model.level_phi.end()),
                          model.level_phi.end());
    const auto levels = static_cast<int>(model.level_phi.size());
    for (const double p : phi) {
      const auto at = std::lower_bound(model.level_phi.begin(), model.level_phi.end(), p);
      pixels.push_back(static_cast<std::uint8_t>(
          pixel_of_level(static_cast<int>(at - model.level_phi.begin()), levels)));
    }
    coverage.resize(phi.size(), 0);
  }
  CureModel model;
  std::vector<std::uint8_t> coverage, pixels;
};

using EdgeKey = std::pair<int, bool>;
using Edges = std::map<EdgeKey, UncertainBand::EdgeBand>;

struct Seen {
  Edges edges;
  struct Doubt {
    bool gap;
    int first, last;
    double p;
  };
  std::vector<Doubt> doubts;
  UncertainPrint print;
};

Seen look_at(const CureModel& model, const std::vector<std::uint8_t>& coverage,
             const std::vector<std::uint8_t>& pixels, const Uncertainty& u,
             const std::vector<std::uint8_t>& heights = {}) {
  Seen seen;
  const auto all = static_cast<int>(pixels.size());
  UncertainBand band(model, u, all, 1);
  if (!heights.empty()) band.aim_at_heights();
  band.tell_edges([&](const UncertainBand::EdgeBand& e) { seen.edges[{e.node, e.upper}] = e; });
  band.tell_doubts([&](std::size_t, bool gap, int first, int last, double p) {
    seen.doubts.push_back({gap, first, last, p});
  });
  for (int n = all; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    band.add_slice(n, &pixels[k], &coverage[k], k < heights.size() ? &heights[k] : nullptr);
  }
  band.finish([](std::size_t) { return Pixel{0, 0}; }, seen.print);
  return seen;
}

/// Height errors in slices as the predictor finds them.
std::map<EdgeKey, double> predicted(const CureModel& model,
                                    const std::vector<std::uint8_t>& coverage,
                                    const std::vector<std::uint8_t>& pixels,
                                    const std::vector<std::uint8_t>& heights = {},
                                    Prediction* figures = nullptr) {
  std::map<EdgeKey, double> errors;
  const PixelCurve curve = pixel_curve(model);
  BandPredictor predictor(model, curve, static_cast<int>(pixels.size()), 1);
  if (!heights.empty()) predictor.aim_at_heights();
  predictor.tell_edges([&](std::size_t, int node, bool upper, double um) {
    errors[{node, upper}] = um / model.layer_um;
  });
  for (std::size_t n = pixels.size(); n-- > 0;) {
    predictor.add_slice(static_cast<int>(n), &pixels[n],
                        {&coverage[n], n < heights.size() ? &heights[n] : nullptr});
  }
  const Prediction p = predictor.finish(0, 0, 1);
  if (figures) *figures = p;
  return errors;
}

/// The model of a print whose inputs are off: areal doses.
CureModel off(CureModel model, double ln_ha, double ln_light) {
  model.eta *= std::exp(-ln_ha);
  model.a = std::exp(-model.eta * units::kLn10);
  model.one_minus_a = -std::expm1(-model.eta * units::kLn10);
  model.root_a = std::exp(-0.5 * model.eta * units::kLn10);
  for (double& phi : model.level_phi) phi *= std::exp(ln_ha + ln_light);
  return model;
}

std::vector<std::uint8_t> random_column(std::mt19937& random, int least, int most) {
  std::uniform_int_distribution<int> length(least, most);
  std::vector<std::uint8_t> c(static_cast<std::size_t>(length(random)), 0);
  for (int runs = 4; runs-- > 0;) {
    c.insert(c.end(), static_cast<std::size_t>(length(random)), 255);
    c.insert(c.end(), static_cast<std::size_t>(length(random)), 0);
  }
  return c;
}

// The nominal print among the three is the prediction's own, whatever the column.
TEST(UncertainPrint, NominalErrorsAreThoseOfThePrediction) {
  std::mt19937 random(5);
  const Uncertainty u = off_by("ha=5%,dc=3%");
  Process layer_by_layer;
  layer_by_layer.mode = ExposureMode::layerwise;
  layer_by_layer.exposure_s = 0.35;
  const CureModel layerwise =
      make_cure_model(test::linear_printer(1, 100), test::resin(576, 110), layer_by_layer, 50);
  for (int round = 0; round < test::rounds(60); ++round) {
    const bool continuous = round % 3 != 0;
    const CureModel model = continuous ? figure_2_2(600 + 40.0 * round) : layerwise;
    auto coverage = random_column(random, 1, 9);
    std::vector<std::uint8_t> pixels, heights;
    for (const std::uint8_t c : coverage) {
      // Off by so much that edges lie in other layers, features vanish and gaps fill.
      const int v =
          c == 255 ? 30 + static_cast<int>(random() % 100) : static_cast<int>(random() % 8);
      pixels.push_back(static_cast<std::uint8_t>(v));
    }
    if (round % 2) {
      for (std::size_t n = 0; n < coverage.size(); ++n) {
        heights.push_back(static_cast<std::uint8_t>(64 + random() % 128));
      }
      if (continuous) heights.clear();  // those of inner edges ask for more than nodes say
    }
    const auto expected = predicted(model, coverage, pixels, heights);
    const Seen seen = look_at(model, coverage, pixels, u, heights);
    ASSERT_EQ(seen.edges.size(), expected.size());
    for (const auto& [key, slices] : expected) {
      EXPECT_NEAR(seen.edges.at(key).nominal, slices, 1e-7)
          << "round " << round << " node " << key.first << (key.second ? " upper" : " lower");
      EXPECT_LE(seen.edges.at(key).weak, seen.edges.at(key).nominal + 1e-9);
      EXPECT_GE(seen.edges.at(key).strong, seen.edges.at(key).nominal - 1e-9);
    }
  }
}

TEST(UncertainPrint, BandsOfFigure22AtFivePercent) {
  const CorrectionPlan plan = plan_for(figure_2_2(), process(1000), 50);
  const ExactColumn f(plan, column(50, {{11, 20}, {31, 40}}));
  const Seen seen = look_at(f.model, f.coverage, f.pixels, as_fitted(0.05));
  struct Row {
    int node;
    bool upper;
    double from_um, to_um;
  };
  for (const Row& r : {Row{11, true, 465.8, 640.5}, Row{21, false, 1030.7, 1065.8},
                       Row{31, true, 1452.9, 1659.3}, Row{41, false, 2023.7, 2072.4}}) {
    const auto& e = seen.edges.at({r.node, r.upper});
    const double sign = r.upper ? -1 : 1;
    const double weak = 50 * (r.node + sign * e.weak), strong = 50 * (r.node + sign * e.strong);
    EXPECT_NEAR(std::min(weak, strong), r.from_um, 0.1);  // of covariances of five digits
    EXPECT_NEAR(std::max(weak, strong), r.to_um, 0.1);
    EXPECT_NEAR(e.nominal, 0, 1e-9);
  }
}

TEST(UncertainPrint, CovarianceOfAFitNarrowsBands) {
  const CorrectionPlan plan = plan_for(figure_2_2(), process(1000), 50);
  const ColumnGradient g(plan.model, solve_column_exactly(plan, column(50, {{11, 20}, {31, 40}})));
  Uncertainty u = off_by("ha=1%,dc=1.43806%,light=0.6%,speed=0.2%");
  const auto sd_um = [&] {
    return DoseVariance(u, 1).sd_ln(g.at(11)) / std::abs(dose_per_um(plan.model, 0.0625));
  };
  EXPECT_NEAR(sd_um(), 16.9, 0.05);
  u.covariance[1] = u.covariance[4] = 0.90492 * 0.01 * 0.0143806;
  EXPECT_NEAR(sd_um(), 8.9, 0.05);
}

// Errors apart by source add up in their squares to the whole.
TEST(UncertainPrint, SourcesAddUp) {
  const Uncertainty u =
      off_by("ha=3%,dc=2%,m=0.01,light=1%,stray=0.1,time=0.5%,exchange=0.1,flat=1%,noise=2%",
             ExposureMode::layerwise);
  const DoseVariance variance(u, 0.9);
  const DoseGradient g{0.9, 0.5, 0.04, 0.3, 0.01, 0, -0.2};
  double sum = 0;
  for (std::size_t s = 0; s < kErrorSources; ++s) {
    const double part = variance.of(g, static_cast<ErrorSource>(s));
    EXPECT_GT(part, 0);
    sum += part;
  }
  EXPECT_NEAR(variance.of(g), sum, 1e-15);
}

TEST(UncertainPrint, TwoSliceGapFillsAsOftenAsDrawn) {
  const CorrectionPlan plan = plan_for(figure_2_2(), process(1000), 60);
  const ExactColumn f(plan, column(60, {{10, 19}, {22, 31}}));
  const Seen seen = look_at(f.model, f.coverage, f.pixels, as_fitted(0.03));
  double told = -1;
  for (const auto& d : seen.doubts) {
    if (d.gap && d.first == 20 && d.last == 21) told = d.p;
  }
  EXPECT_GT(told, 0.01);
  std::mt19937 random(17);
  const int draws = 20000;
  int filled = 0;
  for (int k = 0; k < draws; ++k) {
    const auto [ln_ha, ln_light] = drawn_as_fitted(0.03, random);
    const CureModel drawn = off(f.model, ln_ha, ln_light);
    const std::vector<double> dose = [&] {
      std::vector<double> phi;
      const PixelCurve curve = pixel_curve(drawn);
      for (const std::uint8_t v : f.pixels) phi.push_back(curve[v]);
      return node_doses(drawn, phi);
    }();
    filled += dose[20] >= 1 && dose[21] >= 1 && dose[22] >= 1;
  }
  // Four standard deviations of the count, and what first order misses: bends of the dose are of the
  // order of the squares of errors, 0.03² of a dose, or 0.03 of a standard deviation.
  EXPECT_NEAR(filled / static_cast<double>(draws), told, 4 * std::sqrt(told / draws) + 0.003);
}

/// Share of draws in which edges lie in their bands.
struct Coverage {
  std::uint64_t inside = 0, draws = 0;
  double share() const { return static_cast<double>(inside) / static_cast<double>(draws); }
};

void draw(const CureModel& model, const std::vector<std::uint8_t>& coverage,
          const std::vector<std::uint8_t>& pixels, double ha, int draws, std::mt19937& random,
          Coverage& out, double* mean_abs = nullptr) {
  const Seen seen = look_at(model, coverage, pixels, as_fitted(ha));
  double sum = 0;
  for (int k = 0; k < draws; ++k) {
    const auto [ln_ha, ln_light] = drawn_as_fitted(ha, random);
    const CureModel drawn = off(model, ln_ha, ln_light);
    for (const auto& [key, error] : predicted(drawn, coverage, pixels)) {
      const auto& e = seen.edges.at(key);
      ++out.draws;
      out.inside += error >= e.weak && error <= e.strong;
      sum += std::abs(error) * model.layer_um / static_cast<double>(seen.edges.size());
    }
  }
  if (mean_abs) *mean_abs = sum / draws - seen.print.expected_mean_abs_um();
}

TEST(UncertainPrint, BandsOfFigure22Cover95Percent) {
  const CorrectionPlan plan = plan_for(figure_2_2(), process(1000), 50);
  const ExactColumn f(plan, column(50, {{11, 20}, {31, 40}}));
  std::mt19937 random(23);
  for (const double ha : {0.01, 0.05, 0.10}) {
    Coverage c;
    double expected_off = 0;
    draw(f.model, f.coverage, f.pixels, ha, 4000, random, c, &expected_off);
    RecordProperty("share_at_" + std::to_string(static_cast<int>(std::lround(100 * ha))),
                   std::to_string(c.share()));
    // One draw moves all four edges: 4000 draws count, of which four standard deviations.
    EXPECT_NEAR(c.share(), 0.95, 4 * std::sqrt(0.95 * 0.05 / 4000)) << ha;
    // Half a normal distribution to either side: right to some percent of its mean.
    EXPECT_NEAR(expected_off, 0, 300 * ha * 0.1) << ha;
  }
}

TEST(UncertainPrint, BandsOfRandomColumnsCover95Percent) {
  std::mt19937 random(29);
  const int columns = test::rounds(60);
  for (const auto& [ha, least] :
       {std::pair{0.01, 0.935}, std::pair{0.03, 0.925}, std::pair{0.05, 0.90}}) {
    Coverage c;
    for (int k = 0; k < columns; ++k) {
      const auto design = random_column(random, 2, 14);
      const CorrectionPlan plan =
          plan_for(figure_2_2(), process(1000), static_cast<int>(design.size()));
      const ExactColumn f(plan, design);
      draw(f.model, f.coverage, f.pixels, ha, 100, random, c);
    }
    RecordProperty("share_at_" + std::to_string(static_cast<int>(std::lround(100 * ha))),
                   std::to_string(c.share()));
    EXPECT_GT(c.share(), least) << ha;
    EXPECT_LT(c.share(), 0.965) << ha;
  }
}

// What may vanish is found, and with its probability: a capped feature has no dose to lose.
TEST(UncertainPrint, AFeatureAtItsDoseVanishesInHalfOfThePrints) {
  const CorrectionPlan plan = plan_for(figure_2_2(), process(1000, 1.0), 50);
  const ExactColumn f(plan, column(50, {{11, 20}, {31, 40}}));
  const Seen seen = look_at(f.model, f.coverage, f.pixels, off_by("ha=2%"));
  int found = 0;
  for (const auto& d : seen.doubts) {
    if (d.gap) continue;
    EXPECT_NEAR(d.p, 0.5, 0.02);
    ++found;
  }
  EXPECT_EQ(found, 2);
  EXPECT_EQ(seen.print.may_vanish, 2U);
  EXPECT_NEAR(seen.print.lost.value(), 1.0, 0.04);
  EXPECT_EQ(seen.print.places.sorted().size(), 2U);
}

TEST(UncertainPrint, NothingIsSaidWhereDosesAreNotKnown) {
  Printer deep = test::linear_printer(1, 100);
  deep.resin_depth_um = 1000;
  const CureModel model = make_cure_model(deep, test::resin(576, 2000), process(1000), 50);
  EXPECT_THROW(UncertainBand(model, off_by("ha=5%"), 10, 1), InputError);
}

/// Layer by layer with lifts that exchange a share of the resin: 6 gel doses at the window, hs 50 um.
CureModel lifted(double exchange, double ha_um) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 0.6;
  p.lifts = Lifts::each;
  p.lift_exchange = exchange;
  // The areal dose that gels stays: 10 mJ/cm².
  const double hb_um = ha_um / units::kLn10;
  return make_cure_model(test::linear_printer(0, 100),
                         test::resin(units::volumetric_from_areal(10, hb_um), ha_um), p, 50);
}

// Draws of the exchange and of the absorbance height, each print predicted anew: edges are off by as much
// as is told, where doses are nearly straight.
TEST(UncertainPrint, EdgesWhereLiftsExchangeResinAreOffAsDrawn) {
  struct Case {
    double exchange, sd, ha;
  };
  for (const Case& c :
       {Case{0.3, 0.02, 0}, Case{0.3, 0.02, 0.02}, Case{0.6, 0.04, 0.01}, Case{0.2, 0.01, 0.01}}) {
    const CureModel model = lifted(c.exchange, 400);
    std::vector<std::uint8_t> coverage = column(140, {{60, 79}, {100, 139}}), pixels = coverage;
    for (std::uint8_t& v : pixels) v = v ? 120 : 0;
    std::string text = "exchange=" + std::to_string(c.sd);
    if (c.ha > 0) text += ",ha=" + std::to_string(100 * c.ha) + "%";
    const Seen seen = look_at(model, coverage, pixels, off_by(text, ExposureMode::layerwise));
    std::mt19937 random(29);
    std::normal_distribution<double> normal;
    std::map<EdgeKey, std::pair<double, double>> sums;
    constexpr int draws = 2000;
    for (int k = 0; k < draws; ++k) {
      const double x = c.exchange + c.sd * normal(random);
      const double ha_um = 400 * std::exp(c.ha * normal(random));
      for (const auto& [key, error] : predicted(lifted(x, ha_um), coverage, pixels)) {
        sums[key].first += error / draws;
        sums[key].second += error * error / draws;
      }
    }
    int upper = 0;
    for (const auto& [key, sum] : sums) {
      const auto& e = seen.edges.at(key);
      const double drawn = std::sqrt(std::max(0.0, sum.second - sum.first * sum.first));
      const double told = (e.strong - e.weak) / (2 * kSdsOf95);
      if (!key.second) {
        EXPECT_NEAR(told, 0, 1e-9);
        continue;
      }
      ++upper;
      // Four standard deviations of that of 2000 draws, 1.6 %, and the second order.
      EXPECT_NEAR(drawn / told, 1, 4 * 0.016 + 0.03) << c.exchange << " node " << key.first;
      EXPECT_GT(told, 0.02);
    }
    EXPECT_EQ(upper, 2);
    EXPECT_GT(seen.print.upper.mean(
                  seen.print.upper.by_source_um[static_cast<std::size_t>(ErrorSource::lifts)]),
              0);
    EXPECT_EQ(seen.print.upper.mean(
                  seen.print.upper.by_source_um[static_cast<std::size_t>(ErrorSource::resin)]) > 0,
              c.ha > 0);
  }
}

// Without an error of the exchange the nominal print where lifts exchange resin is the prediction's, too.
TEST(UncertainPrint, NominalErrorsWhereLiftsExchangeResin) {
  std::mt19937 random(31);
  const Uncertainty u = off_by("ha=5%,noise=1%,exchange=0.05", ExposureMode::layerwise);
  for (const double exchange : {0.05, 0.4, 1.0}) {
    const CureModel model = lifted(exchange, 150);
    for (int round = 0; round < test::rounds(20); ++round) {
      const auto coverage = random_column(random, 1, 9);
      std::vector<std::uint8_t> pixels;
      for (const std::uint8_t c : coverage) {
        pixels.push_back(static_cast<std::uint8_t>(c ? 60 + random() % 196 : random() % 8));
      }
      const auto expected = predicted(model, coverage, pixels);
      const Seen seen = look_at(model, coverage, pixels, u);
      ASSERT_EQ(seen.edges.size(), expected.size());
      for (const auto& [key, slices] : expected) {
        EXPECT_NEAR(seen.edges.at(key).nominal, slices, 1e-7) << exchange << " " << round;
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr
