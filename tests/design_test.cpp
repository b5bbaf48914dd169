// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is foretold and recommended, against the cure model itself: the recursion of the doses, the
// correction, and what check_feasible says on both sides of every limit.
#include "slicecorr/resins/design.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "custom_resin.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {
namespace {

using test::custom_resin_1;
using test::gamma_printer;
using test::linear_printer;
using ::testing::HasSubstr;

/// D figure 2.2: 50 mJ/cm² areal at 2000 um base 10.
Resin figure_2_2_resin() { return test::resin(576, 2000); }

Printer printer_with_lamp(double uv) {
  Printer p = linear_printer(1, 100);
  p.uv = UvLamp{365, false, {{0, 0}, {255, uv}}};
  return p;
}

bool feasible(const Printer& p, const Resin& r, double speed, double layer = 50) {
  try {
    const Process process = test::process(speed);
    check_feasible(make_cure_model(p, r, process, layer), p, process);
    return true;
  } catch (const InfeasibleError&) {
    return false;
  }
}

TEST(Design, MoreAbsorberKeepsTheArealDose) {
  const Resin r = figure_2_2_resin();
  const Resin half = with_height(r, units::height_e_from_10(1000));
  EXPECT_NEAR(half.absorbance_height10_um, 1000, 1e-9);
  EXPECT_NEAR(half.critical_dose_mj_cm3, 2 * 576, 1e-9);
  // The same working curve's foot: exposure to gel at the window.
  EXPECT_NEAR(make_kinetics(half, false, true).critical_dose_prime,
              make_kinetics(r, false, true).critical_dose_prime, 1e-12);
  // Kinetic resins keep D'c.
  EXPECT_EQ(with_height(custom_resin_1(), 100).critical_dose_prime, 64);
}

TEST(Design, UncorrectedEdgesEqualTheRecursion) {
  const Printer p = linear_printer(1, 100);
  for (const double m : {1.0, 0.8, 1.3}) {
    for (const double height : {300.0, 900.0, 4000.0}) {
      Resin r = figure_2_2_resin();
      r.model = CureModelKind::kinetic;
      r.m = m;
      r.critical_dose_prime = 12;
      r.absorbance_height10_um = height;
      const CureModel model = make_cure_model(p, r, test::process(900), 50);
      ASSERT_GT(model.phi_max(), 1);
      // A feature of so many slices that more would change nothing, black above and nothing below.
      const int gap = 400, slices = static_cast<int>(40 / (model.eta * units::kLn10));
      std::vector<double> phi(static_cast<std::size_t>(gap), model.phi_min());
      phi.insert(phi.end(), static_cast<std::size_t>(slices), model.phi_max());
      const auto dose = node_doses(model, phi);
      double over = -1, under = -1;
      for (int k = gap; k-- > 0;) {
        const auto n = static_cast<std::size_t>(k);
        if (dose[n] >= 1) continue;
        over = (gap - k - 1 + model.crossing(phi[n], dose[n + 1])) * 50;
        break;
      }
      for (int k = gap + slices; k-- > gap;) {
        const auto n = static_cast<std::size_t>(k);
        if (dose[n] < 1) continue;
        under = (gap + slices - k - 1 + model.crossing(phi[n], dose[n + 1])) * 50;
        break;
      }
      ASSERT_GT(over, 0);
      const UncorrectedEdges e =
          uncorrected_edges(model.phi_max(), model.phi_min(), units::height_e_from_10(height) / m);
      EXPECT_NEAR(e.over_um, over, 1e-6 * over) << m << " " << height;
      EXPECT_NEAR(e.under_um, under, 1e-6 * under) << m << " " << height;
    }
  }
  EXPECT_TRUE(std::isinf(uncorrected_edges(1, 0, 100).under_um));
  EXPECT_EQ(uncorrected_edges(0.9, 0, 100).over_um, 0);
  // D figure A.5: 202.31 um are exposed before the dose is reached.
  EXPECT_NEAR(uncorrected_edges(4.8128, 0, units::height_e_from_10(2000)).under_um, 202.31, 0.005);
}

TEST(Design, GapContrastIsTheLimitOfThinSlices) {
  // On slices the least dose lies at a node; ever thinner ones reach the closed form.
  const double gap_um = 500;
  for (const double layer : {50.0, 10.0, 2.0}) {
    const CureModel m =
        make_cure_model(linear_printer(1, 100), figure_2_2_resin(), test::process(1000), layer);
    const int gap = static_cast<int>(gap_um / layer), rung = static_cast<int>(500 / layer);
    const auto plan = test::plan_for(m, test::process(1000, 1.0), 2 * rung + gap);
    const auto dose = node_doses(
        m,
        solve_column_exactly(
            plan, test::column(2 * rung + gap, {{0, rung - 1}, {rung + gap, 2 * rung + gap - 1}})));
    double least = 2;
    for (int k = rung; k <= rung + gap; ++k)
      least = std::min(least, dose[static_cast<std::size_t>(k)]);
    const double contrast = gap_contrast(6.25, 0.0625, units::height_e_from_10(2000), gap_um);
    const double off = contrast - (1 - least);
    EXPECT_GE(off, -1e-12);
    // A node lies within a layer of the best place; the dose there changes by less than the climb.
    EXPECT_LT(off, 5.25 * layer / units::height_e_from_10(2000));
  }
  EXPECT_EQ(gap_contrast(1, 0, 100, 50), 0);
  EXPECT_EQ(gap_contrast(2, 1, 100, 50), 0);
}

/// Errors of the edges of a column that the correction in levels leaves.
double worst_edge_um(const Printer& p, const Resin& r, double speed, double layer,
                     const std::vector<std::pair<int, int>>& runs, int layers) {
  const CureModel model = make_cure_model(p, r, test::process(speed), layer);
  const auto plan = test::plan_for(model, test::process(speed), layers);
  const auto levels = solve_column(plan, test::column(layers, runs));
  std::vector<double> phi;
  for (const auto l : levels) phi.push_back(model.level_phi[l]);
  const auto dose = node_doses(model, phi);
  double worst = 0;
  // Distance from an edge at `node` to the place where the dose passes 1: into the gap where the
  // edge is printed, else into the feature. `into_gap`: -1 for an upper edge, 1 for a lower one.
  const auto error = [&](int node, int into_gap) {
    const bool printed = dose[static_cast<std::size_t>(node)] >= 1;
    const int way = printed ? into_gap : -into_gap;
    for (int k = node;; k += way) {
      const auto n = static_cast<std::size_t>(way > 0 ? k : k - 1);
      if ((dose[static_cast<std::size_t>(k + way)] >= 1) == printed) continue;
      const double below = model.crossing(phi[n], dose[n + 1]);  // from the layer's lower node
      return (std::abs(k - node) + (way > 0 ? 1 - below : below)) * layer;
    }
  };
  for (const auto& [first, last] : runs) {
    if (first > 0) worst = std::max(worst, error(first, -1));
    worst = std::max(worst, error(last + 1, 1));
  }
  return worst;
}

TEST(Design, TheCorrectionKeepsTheErrorOfOneLevel) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> share(0, 1);
  double closest = 0;
  for (int round = 0; round < 3000; ++round) {
    const double gammas[] = {1.0, 3.0, 0.6};
    const Printer p = gamma_printer(1, 100, gammas[round % 3], round % 2 ? 8 : 6);
    const double layer = 20 + 80 * share(random);
    // From just above the speed's limit (320 um) to half way to where black gels (32,000 um).
    const double height = 330 * std::pow(50, share(random));
    const Resin r = with_height(figure_2_2_resin(), units::height_e_from_10(height));
    const double bound = corrected_error_um(p, r, 1000, layer);
    // Gaps of half the contrast and more.
    const CureModel m = make_cure_model(p, r, test::process(1000), layer);
    int gap = 3;
    const double effective = units::height_e_from_10(height);
    while (gap_contrast(m.phi_max(), m.phi_min(), effective, (gap - 1) * layer) < 0.5 && gap < 4000)
      ++gap;
    std::uniform_int_distribution<int> length(3, 40), wide(gap, gap + 40);
    std::vector<std::pair<int, int>> runs;
    int at = 0;
    for (int i = 0; i < 3; ++i) {
      const int first = at + wide(random), last = first + length(random);
      runs.emplace_back(first, last);
      at = last + 1;
    }
    const double worst = worst_edge_um(p, r, 1000, layer, runs, at + 1);
    EXPECT_LE(worst, bound * (1 + 1e-6)) << "height " << height << ", layer " << layer << ", gamma "
                                         << gammas[round % 3] << ", bits " << int(p.bit_depth);
    closest = std::max(closest, worst / bound);
  }
  // The levels before an edge are chosen together: what one level does is reached only where few
  // levels are left to choose from.
  EXPECT_GT(closest, 0.5);
}

/// Whether a height (base 10) meets a wish, asked of the library piece by piece.
bool meets(const Resin& resin, const Printer& printer, const Wish& wish, double height10) {
  const double he = units::height_e_from_10(height10);
  const Resin r = with_height(resin, he);
  if (!feasible(printer, r, wish.speed_mm_h, wish.layer_um)) return false;
  if (corrected_error_um(printer, r, wish.speed_mm_h, wish.layer_um) > wish.tolerance_um) {
    return false;
  }
  if (!(wish.dead_zone_um > 0)) return true;
  if (he <= units::height_e_from_10(resin.inhibition->absorbance_height10_um)) return false;
  const Kinetics k = make_kinetics(r, true, true);
  const double blue = printer.calibration.back().intensity_mw_cm2;
  // The lamp's full light must keep the dead zone, and the least UV light that does so must leave
  // enough to gel.
  const double lamp = printer.uv->max_mw_cm2();
  if (steady_dead_zone_um(k, blue, lamp) < wish.dead_zone_um) return false;
  double low = 0, high = lamp;
  for (int i = 0; i < 100; ++i) {
    const double uv = 0.5 * (low + high);
    (steady_dead_zone_um(k, blue, uv) < wish.dead_zone_um ? low : high) = uv;
  }
  return passing_dose_prime(k, blue, high, wish.speed_mm_h) > k.critical_dose_prime;
}

/// The ends of a range are the limits: just inside the wish is met, just outside it is not.
void expect_limits(const Resin& resin, const Printer& printer, const Wish& wish,
                   const Recommendation& r) {
  ASSERT_TRUE(r.feasible);
  const double least = r.range->least_um, greatest = r.range->greatest_um;
  const double near = 1e-7;
  EXPECT_TRUE(meets(resin, printer, wish, least * (1 + near))) << least;
  EXPECT_FALSE(meets(resin, printer, wish, least * (1 - near))) << least;
  EXPECT_TRUE(meets(resin, printer, wish, greatest * (1 - near))) << greatest;
  if (greatest < 0.99e7) {
    EXPECT_FALSE(meets(resin, printer, wish, greatest * (1 + near))) << greatest;
  }
  for (int i = 1; i < 200; ++i) {
    const double height = least * std::pow(greatest / least, i / 200.0);
    EXPECT_TRUE(meets(resin, printer, wish, height)) << height;
  }
  EXPECT_GT(r.height10_um, least);
  EXPECT_LT(r.height10_um, greatest);
  EXPECT_EQ(r.present_fits, meets(resin, printer, wish, resin.absorbance_height10_um));
}

TEST(Recommend, Figure22) {
  const Resin resin = figure_2_2_resin();
  const Printer printer = linear_printer(1, 100);
  // A wide tolerance: the speed sets the least height, black light the greatest.
  const Recommendation r = recommend(resin, printer, {1000, 1000, 50, 0});
  expect_limits(resin, printer, {1000, 1000, 50, 0}, r);
  // phi_max is 6.25 at 2000 um and proportional to the height; black is a hundredth of it.
  EXPECT_NEAR(r.range->least_um, 2000 / 6.25, 1e-6);
  EXPECT_LT(r.range->greatest_um, 32000);
  EXPECT_TRUE(r.present_fits);
  EXPECT_NEAR(r.phi_max, r.height10_um / 320, 1e-9);
  EXPECT_NEAR(r.fastest_mm_h, 1000 * r.phi_max, 1e-6);
  EXPECT_NEAR(r.absorber_factor, 2000 / r.height10_um, 1e-12);
  EXPECT_NEAR(r.best_uncorrected_height10_um, 320 * 1.99, 1e-6);
  // At the recommended height the speeds are the limits of the process.
  const Resin mixed = with_height(resin, r.height_e_um);
  EXPECT_TRUE(feasible(printer, mixed, r.fastest_mm_h * (1 - 1e-9)));
  EXPECT_FALSE(feasible(printer, mixed, r.fastest_mm_h * (1 + 1e-9)));
  EXPECT_TRUE(feasible(printer, mixed, r.slowest_mm_h * (1 + 1e-9)));
  EXPECT_FALSE(feasible(printer, mixed, r.slowest_mm_h * (1 - 1e-9)));
}

TEST(Recommend, EndsAreLimitsWhateverSetsThem) {
  struct Case {
    Resin resin;
    Printer printer;
    Wish wish;
    const char* least;
    const char* greatest;
  };
  Printer no_black = linear_printer(0, 100);
  Resin kinetic = custom_resin_1(5);
  Resin steep = kinetic;
  steep.m = 1.3;
  const Case cases[] = {
      {figure_2_2_resin(), linear_printer(1, 100), {1000, 2, 50, 0}, "full light", "grey level"},
      {figure_2_2_resin(),
       gamma_printer(1, 100, 3),
       {1000, 0.8, 50, 0},
       "grey level",
       "grey level"},
      {figure_2_2_resin(), gamma_printer(1, 100, 3, 4), {400, 40, 50, 0}, "", "grey level"},
      {figure_2_2_resin(), linear_printer(20, 100), {1000, 100, 50, 0}, "full light", "grey level"},
      {figure_2_2_resin(), no_black, {1000, 1e6, 50, 0}, "full light", "no resin file"},
      {kinetic, gamma_printer(1, 100, 3), {500, 1, 25, 0}, "full light", "grey level"},
      {steep, linear_printer(1, 100), {500, 1, 25, 0}, "full light", "grey level"},
      {kinetic, printer_with_lamp(275), {300, 5, 50, 20}, "against the UV light", ""},
      {kinetic, printer_with_lamp(275), {20, 500, 50, 28}, "", "UV lamp"},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(::testing::Message()
                 << c.printer.calibration.size() << " points, " << c.wish.speed_mm_h << " mm/h, "
                 << c.wish.tolerance_um << " um, dead zone " << c.wish.dead_zone_um);
    const Recommendation r = recommend(c.resin, c.printer, c.wish);
    expect_limits(c.resin, c.printer, c.wish, r);
    EXPECT_THAT(r.least_because, HasSubstr(c.least));
    EXPECT_THAT(r.greatest_because, HasSubstr(c.greatest));
  }
}

TEST(Recommend, ChoosesTheHeightOfGreatestContrast) {
  const Resin resin = figure_2_2_resin();
  const Printer printer = linear_printer(1, 100);
  const Wish wish{1000, 2, 50, 0};
  const Recommendation r = recommend(resin, printer, wish);
  // Short gaps keep most where full light is near twice the critical intensity.
  EXPECT_NEAR(r.phi_max, 2, 0.3);
  const auto contrast = [&](double height10) {
    const double he = units::height_e_from_10(height10);
    return gap_contrast(height10 / 320, height10 / 32000, he, 100);
  };
  EXPECT_NEAR(r.gap_contrast, contrast(r.height10_um), 1e-12);
  for (double h = r.range->least_um * 1.001; h < r.range->greatest_um; h *= 1.01) {
    EXPECT_LE(contrast(h), r.gap_contrast * (1 + 1e-9)) << h;
  }
  // And so does the correction itself, on slices of 50 um.
  const auto corrected = [&](double height10) {
    const Resin mixed = with_height(resin, units::height_e_from_10(height10));
    const auto plan = test::plan_for(make_cure_model(printer, mixed, test::process(1000), 50),
                                     test::process(1000, 1.0), 42);
    const auto dose =
        node_doses(plan.model, solve_column_exactly(plan, test::column(42, {{0, 19}, {22, 41}})));
    return 1 - dose[21];
  };
  EXPECT_GT(corrected(r.height10_um), corrected(2000));
  EXPECT_GT(corrected(r.height10_um), corrected(350));
}

TEST(Recommend, WithoutCorrectionTheToleranceNeedsMoreAbsorber) {
  const Resin resin = figure_2_2_resin();
  const Printer printer = linear_printer(1, 100);
  const auto worst = [&](double height10, double intensity) {
    const double he = units::height_e_from_10(height10), phi = height10 / 320 * intensity / 100;
    const UncorrectedEdges e = uncorrected_edges(phi, height10 / 32000, he);
    return std::max(e.over_um, e.under_um);
  };
  const auto best = [&](double height10) {
    double least = 1e9;
    for (int i = 1; i <= 4000; ++i) least = std::min(least, worst(height10, i / 40.0));
    return least;
  };
  // 2 um: with correction from 320 um on, without it never.
  Recommendation r = recommend(resin, printer, {1000, 2, 50, 0});
  EXPECT_FALSE(r.range_uncorrected);
  EXPECT_NEAR(r.best_uncorrected_error_um, best(r.best_uncorrected_height10_um), 0.01);
  for (double h = 330; h < 30000; h *= 1.1) {
    EXPECT_GE(best(h), r.best_uncorrected_error_um * (1 - 1e-9)) << h;
  }
  // 250 um can be had, within a narrow range; its ends are the limits.
  r = recommend(resin, printer, {1000, 250, 50, 0});
  ASSERT_TRUE(r.range_uncorrected);
  const HeightRange& range = *r.range_uncorrected;
  EXPECT_NEAR(best(range.least_um), 250, 0.1);
  EXPECT_NEAR(best(range.greatest_um), 250, 0.1);
  EXPECT_LT(best(range.least_um * 1.01), 250);
  EXPECT_GT(best(range.least_um * 0.99), 250);
  EXPECT_GT(best(range.greatest_um * 1.01), 250);
  // The correction does it in a resin that is much clearer.
  EXPECT_GT(r.range->greatest_um, 5 * range.greatest_um);
}

/// Climbing from 1 at the lower edge with full light, falling to 1 at the upper with black, in steps: the
/// peak is the greatest of what both allow.
Peak stepped_peak(double phi_max, double phi_min, double effective, double height) {
  constexpr int steps = 400000;
  const double dz = height / steps;
  std::vector<double> falls{1};  // from the upper edge downwards
  for (int i = 0; i < steps; ++i) {
    falls.push_back(falls.back() + (falls.back() - phi_min) * dz / effective);
  }
  Peak peak;
  double climbs = 1;  // from the lower edge upwards
  for (int i = steps; i >= 0; --i) {
    const double both = std::min(climbs, falls[static_cast<std::size_t>(i)]);
    if (both > peak.omega) peak = {both, i * dz};
    climbs += (phi_max - climbs) * dz / effective;
  }
  return peak;
}

TEST(Recommend, PeaksOfFeaturesAreThoseOfTheStepwiseDose) {
  // Figure 2.2: 10, 20, 40 slices of 50 um (physics: 1.5538, 2.2955, 4.0288).
  const double effective = 2000 / std::log(10);
  for (const auto& [height, omega] :
       {std::pair{500.0, 1.5538}, {1000.0, 2.2955}, {2000.0, 4.0288}}) {
    const Peak peak = peak_of_feature(6.25, 0.0625, effective, height);
    EXPECT_NEAR(peak.omega, omega, 5e-5);
    const Peak stepped = stepped_peak(6.25, 0.0625, effective, height);
    // First order steps: each misses by its square, in all by height x slope / steps.
    EXPECT_NEAR(peak.omega, stepped.omega, 1e-4);
    EXPECT_NEAR(peak.below_top_um, stepped.below_top_um, 0.05);
    EXPECT_NEAR(height_for_peak_um(6.25, 0.0625, effective, peak.omega), height, 1e-6);
  }
  EXPECT_TRUE(std::isinf(height_for_peak_um(6.25, 0.0625, effective, 6.25)));
  const Printer printer = linear_printer(1, 100);
  Wish wish{1000, 2, 50, 0, 1.5};
  const Recommendation r = recommend(figure_2_2_resin(), printer, wish);
  ASSERT_TRUE(r.height_for_omega_um);
  EXPECT_NEAR(r.peak.omega, 1.5, 1e-9);
  EXPECT_NEAR(stepped_peak(r.phi_max, r.phi_min, r.height_e_um, *r.height_for_omega_um).omega, 1.5,
              1e-4);
  // Beyond full light no feature does, and the speed that is named would.
  wish.omega_max = 2 * r.phi_max;
  const Recommendation none = recommend(figure_2_2_resin(), printer, wish);
  EXPECT_TRUE(std::isinf(*none.height_for_omega_um));
  EXPECT_NEAR(none.peak.omega, none.phi_max, 1e-9);
  EXPECT_THAT(none.warnings, ::testing::Contains(HasSubstr("a speed below 500")));
  wish.omega_max = 1;
  EXPECT_THROW(recommend(figure_2_2_resin(), printer, wish), InputError);
}

/// Dose of what gels at r under a disc in an even gap, by Simpson along its streamline r² F(q).
/// Inhibitor in store counts below nothing.
double streamline_dose(double r, const Resin& resin, const EvenDisc& d, double speed_mm_h) {
  const double hb = d.height_e_um,
               huv = units::height_e_from_10(resin.inhibition->absorbance_height10_um);
  const auto share = [](double q) { return q * q * (3 - 2 * q); };
  double low = 0, high = 1;
  for (int i = 0; i < 60; ++i) (share((low + high) / 2) < r * r ? low : high) = (low + high) / 2;
  const double speed_um_s = speed_mm_h / 3.6;
  const auto at = [&](double q) {
    const double z = q * d.gap_um;
    const double rate = d.blue_mw_cm2 * std::exp(-z / hb) -
                        resin.inhibition->beta * d.uv_mw_cm2 * std::exp(-z / huv);
    return rate * d.gap_um / (speed_um_s * share(q));
  };
  constexpr int n = 2000;
  double sum = 0;
  for (int i = 0; i <= n; ++i) {
    sum += at(low + (1 - low) * i / n) * (i == 0 || i == n ? 1 : i % 2 ? 4 : 2);
  }
  return sum * (1 - low) / n / 3 / resin.critical_dose_prime;
}

TEST(Recommend, ADiscIsAsEvenAsItsStreamlinesSay) {
  Resin resin = custom_resin_1();
  resin.m = 1;
  resin.viscosity_pa_s = 0.3;
  Printer printer = printer_with_lamp(275);
  const Wish wish{.speed_mm_h = 300, .tolerance_um = 50, .layer_um = 50, .disc_radius_mm = 10};
  const Recommendation r = recommend(resin, printer, wish);
  ASSERT_TRUE(r.feasible && r.disc && r.disc_present && r.disc_most_even);
  const EvenDisc& d = *r.disc_present;
  EXPECT_NEAR(d.height_e_um, 408, 0.01);
  double square = 0;
  int within = 0;
  constexpr int places = 200;
  for (int i = 0; i < places; ++i) {
    const double place = (i + 0.5) / places;
    // Nearer to the axis resin stays for so long that inhibitor in store grows without bound; the flow
    // takes what it has at 0.02 there.
    const double off = streamline_dose(std::max(place, 0.02), resin, d, 300) - 1;
    square += 2 * place * off * off / places;
    within += std::abs(off) <= 0.1 ? 1 : 0;
  }
  // The flow's grid is coarse here: steps of a twelfth in ln r, whose first one takes in the outline.
  EXPECT_NEAR(d.mean_square, square, 0.05 * square);
  EXPECT_NEAR(d.share_within, 1.0 * within / places, 0.03);
  EXPECT_LE(r.disc_most_even->mean_square, r.disc->mean_square);
  // 3 mu S R²/h³ and 3 pi mu S R⁴/(2 h³).
  const double s = 300e-3 / 3600, h = d.gap_um * 1e-6, R = 0.01;
  EXPECT_NEAR(d.suction_pa, 3 * 0.3 * s * R * R / (h * h * h), 1e-6 * d.suction_pa);
  EXPECT_NEAR(d.force_n, 1.5 * 3.14159265 * 0.3 * s * R * R * R * R / (h * h * h),
              1e-6 * d.force_n);
  EXPECT_NEAR(d.fastest_mm_h, 300 * 1e5 / d.suction_pa, 1e-6 * d.fastest_mm_h);
  // Lamps that are uneven: where least blue and most UV light comes, and where it is the other way round.
  FlatField field;
  field.width_px = 2;
  field.height_px = 1;
  field.values =
      std::make_shared<const std::vector<std::uint8_t>>(std::vector<std::uint8_t>{204, 255});
  printer.uv_flat_field = field;
  const Recommendation uneven = recommend(resin, printer, wish);
  const auto said =
      std::find_if(uneven.reasons.begin(), uneven.reasons.end(), [](const std::string& text) {
        return text.starts_with(
            "By the flat-fields of the lamps 1 to 1 of this blue light and 0.8 to 1 ");
      });
  ASSERT_NE(said, uneven.reasons.end());
  const auto percent_after = [&](const std::string& words) {
    return std::stod(said->substr(said->find(words) + words.size()));
  };
  const auto within_at = [&](double uv) {
    EvenDisc there = *uneven.disc;
    there.uv_mw_cm2 *= uv;
    Resin formulated = resin;
    formulated.absorbance_height10_um = there.height_e_um * std::log(10.0);
    int count = 0;
    for (int i = 0; i < places; ++i) {
      const double place = std::max((i + 0.5) / places, 0.02);
      count += std::abs(streamline_dose(place, formulated, there, 300) - 1) <= 0.1 ? 1 : 0;
    }
    return 100.0 * count / places;
  };
  EXPECT_NEAR(percent_after("most UV light "), within_at(1), 3 + 0.5);
  EXPECT_NEAR(percent_after("least UV light "), within_at(0.8), 3 + 0.5);
  EXPECT_EQ(r.reasons.size() + 1, uneven.reasons.size());
  // Without UV light the suction alone; without viscosity nothing.
  printer.uv.reset();
  const Recommendation dry = recommend(resin, printer, wish);
  EXPECT_FALSE(dry.disc_present);
  EXPECT_EQ(dry.disc->gap_um, 80);
  resin.viscosity_pa_s = 0;
  EXPECT_THROW(recommend(resin, printer, wish), InputError);
}

TEST(Recommend, SaysWhatWouldMakeItFeasible) {
  const Resin resin = figure_2_2_resin();
  Recommendation r = recommend(resin, linear_printer(1, 100), {1000, 0.01, 50, 0});
  EXPECT_FALSE(r.feasible);
  ASSERT_FALSE(r.ways_out.empty());
  EXPECT_THAT(r.ways_out[0], HasSubstr("one grey level moves an edge by"));
  // The tolerance that it names can be had.
  const double named = std::stod(r.ways_out[0].substr(r.ways_out[0].find(" by ") + 4));
  EXPECT_TRUE(recommend(resin, linear_printer(1, 100), {1000, named, 50, 0}).feasible);
  EXPECT_FALSE(recommend(resin, linear_printer(1, 100), {1000, named * 0.98, 50, 0}).feasible);

  // A dead zone: too thick at this speed, but not at the one that is named.
  const Resin one = custom_resin_1(5);
  const Wish wish{1000, 5, 50, 30};
  r = recommend(one, printer_with_lamp(275), wish);
  EXPECT_FALSE(r.feasible);
  ASSERT_EQ(r.ways_out.size(), 2U);
  const std::string& speed = r.ways_out[1];
  const double slower = std::stod(speed.substr(speed.find("of ") + 3));
  Wish slow = wish;
  slow.speed_mm_h = slower;
  EXPECT_TRUE(recommend(one, printer_with_lamp(275), slow).feasible) << speed;
  slow.speed_mm_h = slower * 1.02;
  EXPECT_FALSE(recommend(one, printer_with_lamp(275), slow).feasible) << speed;
  // A lamp that is too weak at any height, and none.
  r = recommend(one, printer_with_lamp(120), wish);
  // 137 mW/cm² keep a dead zone, but not the one asked for: the lamp that is named does.
  const double lamp = std::stod(r.ways_out[0].substr(r.ways_out[0].find("a UV lamp of ") + 13));
  EXPECT_GT(lamp, 137);
  EXPECT_TRUE(recommend(one, printer_with_lamp(lamp), wish).feasible) << r.ways_out[0];
  EXPECT_FALSE(recommend(one, linear_printer(1, 100), wish).feasible);
}

TEST(Recommend, RefusesWhatMakesNoSense) {
  const Resin resin = figure_2_2_resin();
  Printer printer = linear_printer(1, 100);
  EXPECT_THROW(recommend(resin, printer, {0, 2, 50, 0}), InputError);
  EXPECT_THROW(recommend(resin, printer, {1000, 0, 50, 0}), InputError);
  EXPECT_THROW(recommend(resin, printer, {1000, 2, 50, 10}), InputError);  // no inhibition
  printer.max_speed_mm_h = 900;
  EXPECT_THROW(recommend(resin, printer, {1000, 2, 50, 0}), InputError);
  Resin empty = resin;
  empty.critical_dose_mj_cm3 = 0;
  EXPECT_THROW(recommend(empty, linear_printer(1, 100), {1000, 2, 50, 0}), InputError);
}

TEST(Recommend, JsonHasItsFigures) {
  const auto j = nlohmann::json::parse(
      recommend(figure_2_2_resin(), linear_printer(1, 100), {1000, 2, 50, 0}).to_json());
  EXPECT_TRUE(j.at("feasible"));
  EXPECT_NEAR(j.at("range10").at("least_um"), 320, 1e-6);
  EXPECT_TRUE(j.at("uncorrected").at("range10").is_null());
  EXPECT_GT(j.at("text").size(), 5U);
  const auto no = nlohmann::json::parse(
      recommend(figure_2_2_resin(), linear_printer(1, 100), {1000, 0.01, 50, 0}).to_json());
  EXPECT_FALSE(no.at("feasible"));
  EXPECT_TRUE(no.at("range10").is_null());
  EXPECT_FALSE(no.at("ways_out").empty());
}

}  // namespace
}  // namespace slicecorr::resins
