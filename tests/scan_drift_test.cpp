// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A laboratory's prints in their order: bands, what lies beyond them, what drifts.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "refusal.hpp"
#include "slicecorr/scan.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::vector<DriftPrint> prints_of(const std::vector<double>& mean_um) {
  std::vector<DriftPrint> prints;
  for (const double um : mean_um) {
    const std::string name = fmt::format("scan-{}", prints.size() + 1);
    prints.push_back({name + ".json", name, "predicted", um, 20 + std::abs(um), 40});
  }
  return prints;
}

// Ranges 2, 1, 3: their mean 2 is 2 / sqrt(pi) standard deviations.
TEST(ScanDrift, BandIsThatOfTheClosedForm) {
  const ScanDrift d = scan_drift(prints_of({1, 3, 2, 5}));
  ASSERT_EQ(d.bands.size(), 2U);
  const DriftBand& b = d.bands[0];
  EXPECT_NEAR(b.middle_um, 2.75, 1e-12);
  EXPECT_NEAR(b.high_um, 2.75 + 3 * std::sqrt(M_PI), 1e-9);
  EXPECT_NEAR(b.low_um, 2.75 - 3 * std::sqrt(M_PI), 1e-9);
  EXPECT_THAT(b.beyond, IsEmpty());
  EXPECT_FALSE(d.last_is_beyond());
}

TEST(ScanDrift, TellsWhatLeavesItsBandAndWhatDrifts) {
  // Settled for four, then far off and back.
  ScanDrift d = scan_drift(prints_of({1, 3, 2, 4, 30, 2}), 4);
  EXPECT_THAT(d.bands[0].beyond, ElementsAre(4U));
  EXPECT_FALSE(d.last_is_beyond());
  EXPECT_THAT(d.to_text(), HasSubstr("scan-5 lies beyond its band"));
  d = scan_drift(prints_of({1, 3, 2, 4, 30}), 4);
  EXPECT_TRUE(d.last_is_beyond());
  EXPECT_TRUE(nlohmann::json::parse(d.to_json())["last_is_beyond"].get<bool>());
  EXPECT_THAT(d.to_page(), AllOf(HasSubstr("<svg"), HasSubstr("scan-5"), HasSubstr("beyond")));
  // Eight that are each within the band, all on one side.
  d = scan_drift(prints_of({1, 3, 1, 3, 2.5, 2.6, 2.5, 2.6, 2.5, 2.6, 2.5}), 4);
  EXPECT_THAT(d.bands[0].beyond, IsEmpty());
  EXPECT_THAT(d.bands[0].runs, ElementsAre(10U));
  // Prints that are all the same: rounding alone does not leave the band.
  EXPECT_THAT(scan_drift(prints_of({1, 1, 1, 1.2})).bands[0].beyond, IsEmpty());
  EXPECT_THAT(scan_drift(prints_of({1, 1, 1, 1.5}), 3).bands[0].beyond, ElementsAre(3U));
}

// Of normal values three standard deviations are left by 0.3 %, and the band of 100 is known to 8 %.
TEST(ScanDrift, FewOfAQuietLaboratoryLeaveTheBand) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal(5, 2);
  std::vector<double> values;
  for (int i = 0; i < 2000; ++i) values.push_back(normal(random));
  const ScanDrift d = scan_drift(prints_of(values), 100);
  // At 2.75 standard deviations 0.6 % of 2000 are 12, and 4 of its own standard deviations more are 26.
  EXPECT_LE(d.bands[0].beyond.size(), 26U);
}

// Names of prints that lie near to each other in the chart would hide each other: one is written, all are pointed at and told.
TEST(ScanDrift, NamesDoNotOverlap) {
  const auto written = [](const ScanDrift& d) {
    const std::string svg = d.to_svg();
    std::size_t rings = 0, names = 0;
    for (std::size_t at = 0; (at = svg.find("class=\"ring\"", at)) != std::string::npos; ++at) {
      ++rings;
    }
    for (std::size_t at = 0; (at = svg.find(">scan-", at)) != std::string::npos; ++at) ++names;
    return std::pair(rings, names - 2 * d.prints.size());  // each point says its own, too
  };
  std::vector<double> values;
  for (int i = 0; i < 20; ++i) values.push_back(i % 2);
  for (int i = 0; i < 6; ++i) values.push_back(30 + 0.01 * i);
  const auto [rings, names] = written(scan_drift(prints_of(values), 20));
  EXPECT_EQ(rings, 12U);
  // A name and its ring take 9 x 7 + 28 of 540 pixels; prints lie 540 / 26 from each other: every fifth.
  EXPECT_EQ(names, 4U);
  values.resize(20);
  values.insert(values.end(), {30, 60, 90});
  const auto [apart, each] = written(scan_drift(prints_of(values), 20));
  EXPECT_EQ(apart, 6U);
  EXPECT_EQ(each, 6U);
}

TEST(ScanDrift, ReadsWhatCompareWrote) {
  ScanComparison c;
  c.scan = "folder/scan.ply";
  Deviation of_design, predicted;
  of_design.against = "design";
  predicted.against = "predicted";
  predicted.all = {"all", 10, 1.5, 2.5, 4, 9};
  c.deviations = {of_design, predicted};
  const DriftPrint p = read_comparison(c.to_json(), "a.json");
  EXPECT_EQ(p.name, "scan.ply");
  EXPECT_EQ(p.against, "predicted");
  EXPECT_EQ(p.mean_um, 1.5);
  EXPECT_EQ(p.mean_abs_um, 2.5);
  EXPECT_EQ(p.p95_um, 4);
}

TEST(ScanDrift, RefusesWhatSaysNothing) {
  EXPECT_THAT(test::refusal([] { scan_drift(prints_of({1, 2})); }), HasSubstr("3 or more"));
  EXPECT_THAT(test::refusal([] { scan_drift(prints_of({1, 2, 3}), 4); }), HasSubstr("settled"));
  std::vector<DriftPrint> mixed = prints_of({1, 2, 3});
  mixed[1].against = "design";
  EXPECT_THAT(test::refusal([&] { scan_drift(mixed); }),
              AllOf(HasSubstr("scan-2.json"), HasSubstr("design")));
  EXPECT_THAT(test::refusal([] { read_comparison("{}", "a.json"); }), HasSubstr("a.json"));
  EXPECT_THAT(
      test::refusal([] { read_comparison(R"({"scan": "s", "deviations": []})", "a.json"); }),
      AllOf(HasSubstr("a.json"), HasSubstr("deviations")));
}

}  // namespace
}  // namespace slicecorr::test
