// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Layer by layer with lifts through the programs: light that stays, figures, files that say it, what is
/// refused and what is told.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

constexpr const char* kResinText =
    "name = \"plain\"\n[cure]\nabsorbance_height_um = 150\nabsorbance_base = 10\n"
    "gel_dose_mj_cm2 = 10\n";

class LiftsProgram : public ProgramFixture {
 protected:
  LiftsProgram() {
    write_stl(folder_ / "ladder.stl", ladder());
    TriangleMesh block;
    add_box(block, {0, 0, 0}, {2, 2, 1});
    write_stl(folder_ / "block.stl", block);
    // Black without light, so that closed forms hold.
    write("small.toml",
          "name = \"small\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 50.0\n[blue]\n"
          "calibration = [[0, 0.0], [255, 100.0]]\n");
    write("plain.toml", kResinText);
    good(
        {"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer", "small.toml"});
  }
  /// 0.6 s of 100 mW/cm²: 6 gel doses at the window.
  const Command kWith{"--printer", "small.toml", "--resin",      "plain.toml",
                      "--mode",    "layerwise",  "--exposure-s", "0.6"};
  std::string text_in(const std::string& name) const { return to_text(read_file(folder_ / name)); }
  json process_of(const std::string& stack) const {
    Entries entries = unzip(folder_ / stack);
    return json::parse(to_text(entry(entries, "config.json")))["slicecorr"]["process"];
  }
};

TEST_F(LiftsProgram, ABlockOnThePlatformKeepsItsLight) {
  good({"slice", "block.stl", "-o", "design.uvj", "--layer-um", "50", "--printer", "small.toml"});
  good(Command{"correct", "design.uvj", "-o", "block.uvj"} + kWith);
  const RunResult probe = good({"probe", "block.uvj", "--x", "80", "--y", "60", "--quiet"});
  std::size_t full = 0;
  for (std::size_t at = 0; (at = probe.out.find(",255,", at)) != probe.out.npos; ++at) ++full;
  EXPECT_EQ(full, 20U);
  const json f = figures("block.uvj", "design.uvj");
  EXPECT_EQ(f["joints"]["not_holding_voxels"], 0);
  // 6 gel doses, less what 50 um take.
  EXPECT_NEAR(f["joints"]["least"].get<double>(), 6 * std::pow(10.0, -1.0 / 3), 1e-3);
}

TEST_F(LiftsProgram, FeaturesOverGapsHoldAndFiguresSayIt) {
  good(Command{"correct", "target.uvj", "-o", "part.uvj"} + kWith);
  const json f = figures("part.uvj", "target.uvj");
  EXPECT_EQ(f["joints"]["not_holding_voxels"], 0);
  EXPECT_EQ(f["joints"]["liquid_layers_max"], 0);
  EXPECT_EQ(f["joints"]["films"], 2 * 40 * 40);
  EXPECT_GE(f["joints"]["least"].get<double>(), 1.2);
  EXPECT_EQ(f["undercure_voxels"], 0);
  // hs 50, ha 150: 54.5 um for x = 0, 12 for x = 1 (docs/lifts.md); one of 256 levels of 6 gel doses more is
  // 150 log10(1 + (6 / 255) / 2.585) = 0.59 um.
  const double most = f["height_error_um"]["max_overreach"].get<double>();
  EXPECT_GE(most, 54.4);
  EXPECT_LE(most, 54.5 + 0.65);
  const double fresh_um = f["height_error_um"]["exchanged"]["max_abs"].get<double>();
  EXPECT_GE(fresh_um, 11.8);
  EXPECT_LE(fresh_um, 11.9 + 0.65);
  const json sliced = figures("target.uvj", "target.uvj", kWith);
  EXPECT_GT(sliced["height_error_um"]["exchanged"]["max_abs"].get<double>(), 60);
  // The exchange known, edges come to where they belong.
  good(Command{"correct", "target.uvj", "-o", "stays.uvj", "--lift-exchange", "0"} + kWith);
  const json stays = figures("stays.uvj", "target.uvj");
  EXPECT_EQ(stays["joints"]["not_holding_voxels"], 0);
  EXPECT_GE(stays["joints"]["liquid_layers_max"], 1);
  // The layer at the node is a level off at most: 150 log10(1 / (1 - (6 / 255) a)) = 0.71 um.
  EXPECT_LT(stays["height_error_um"]["max_abs"].get<double>(), 0.75);
  good(Command{"correct", "target.uvj", "-o", "fresh.uvj", "--lift-exchange", "1"} + kWith);
  const json fresh = figures("fresh.uvj", "target.uvj");
  EXPECT_LT(fresh["height_error_um"]["max_abs"].get<double>(), 0.75);
  EXPECT_EQ(fresh["cure_through_voxels"], 0);
  EXPECT_NEAR(fresh["height_error_um"]["max_abs"].get<double>(),
              fresh["height_error_um"]["exchanged"]["max_abs"].get<double>(), 1e-3);
}

TEST_F(LiftsProgram, FilesSayIt) {
  write("steps.toml", std::string(kSmallPrinter) + "[process]\nlifts = \"none\"\n");
  write("known.toml", std::string(kSmallPrinter) + "[process]\nlift_exchange = 0.4\n");
  write("tough.toml", std::string(kResinText) + "green_strength = 1.6\n");
  const auto made = [&](const char* printer, const char* resin, const Command& more) {
    good(Command{"correct", "target.uvj", "-o", "x.uvj", "--printer", printer, "--resin", resin,
                 "--mode", "layerwise", "--exposure-s", "0.9"} +
         more);
    return process_of("x.uvj");
  };
  EXPECT_EQ(made("small.toml", "plain.toml", {})["lifts"], "each");
  EXPECT_EQ(made("known.toml", "plain.toml", {})["lift_exchange"], 0.4);
  EXPECT_EQ(made("known.toml", "plain.toml", {"--lift-exchange", "0.2"})["lift_exchange"], 0.2);
  EXPECT_EQ(made("small.toml", "tough.toml", {})["green_strength"], 1.6);
  EXPECT_EQ(made("small.toml", "tough.toml", {"--green-strength", "2"})["green_strength"], 2.0);
  // Without lifts five gel doses are aimed at, for which 0.6 s are too short.
  const RunResult steps =
      call(Command{"correct", "target.uvj", "-o", "y.uvj", "--printer", "steps.toml", "--resin",
                   "plain.toml", "--mode", "layerwise", "--exposure-s", "0.6"});
  EXPECT_EQ(steps.exit_code, 3);
  EXPECT_THAT(steps.err, HasSubstr("does not gel through"));
  write("odd.toml", std::string(kSmallPrinter) + "[process]\nlifts = \"often\"\n");
  bad(2,
      {"correct", "target.uvj", "-o", "y.uvj", "--printer", "odd.toml", "--resin", "plain.toml",
       "--mode", "layerwise", "--exposure-s", "0.6"},
      {"odd.toml", "lifts", "often"});
}

TEST_F(LiftsProgram, WhatCantHoldIsRefusedWithATimeThatDoes) {
  const Command brief{"--printer", "small.toml", "--resin",      "plain.toml",
                      "--mode",    "layerwise",  "--exposure-s", "0.2"};
  const RunResult r = call(Command{"correct", "target.uvj", "-o", "x.uvj"} + brief);
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_THAT(r.err, HasSubstr("does not hold when the platform lifts"));
  const auto at = r.err.find("at least ");
  ASSERT_NE(at, r.err.npos);
  const std::string least = r.err.substr(at + 9, r.err.find(" s", at) - at - 9);
  good({"correct", "target.uvj", "-o", "x.uvj", "--printer", "small.toml", "--resin", "plain.toml",
        "--mode", "layerwise", "--exposure-s", least});
  // 1.2 gel doses through 50 um.
  EXPECT_NEAR(std::stod(least), 0.12 * std::pow(10.0, 1.0 / 3), 1e-4);
}

TEST_F(LiftsProgram, AColumnLiftByLift) {
  good(Command{"correct", "target.uvj", "-o", "half.uvj", "--lift-exchange", "0.5"} + kWith);
  const RunResult r =
      good({"simulate", "half.uvj", "--target", "target.uvj", "--x", "80", "--y", "60", "-o",
            "h.svg", "--csv", "fronts.csv", "--lifts-csv", "lifts.csv"});
  EXPECT_THAT(r.err, HasSubstr(", 0 does not hold; least dose at a joint"));
  const std::string picture = to_text(read_file(folder_ / "h.svg"));
  EXPECT_THAT(picture, HasSubstr("at its lift: film"));
  EXPECT_THAT(picture, HasSubstr("own dose at the joint"));
  // Each layer's own light: what the probe tells, a layer further.
  const std::string lifts = to_text(read_file(folder_ / "lifts.csv"));
  EXPECT_EQ(lifts.find("slice,z_um,window_dose,joint_dose,at_lift\n"), 0U);
  EXPECT_THAT(lifts, HasSubstr(",holds\n"));
  EXPECT_THAT(lifts, HasSubstr(",film\n"));
  EXPECT_THAT(lifts, HasSubstr(",nothing\n"));
  // The end of the print is where verify says that it ends.
  const std::string fronts = to_text(read_file(folder_ / "fronts.csv"));
  EXPECT_GT(std::count(fronts.begin(), fronts.end(), '\n'), 20);
  good({"simulate", "half.uvj", "--row", "60", "-o", "row.png"});
  bad(2, {"simulate", "half.uvj", "--row", "60", "-o", "row.png", "--lifts-csv", "x.csv"},
      {"--lifts-csv", "column"});
  bad(2,
      {"simulate", "target.uvj", "--x", "80", "--y", "60", "-o", "h.svg", "--lifts-csv", "x.csv",
       "--printer", "small.toml", "--resin", "plain.toml", "--speed-mm-h", "100"},
      {"--lifts-csv", "layer by layer"});
  // Where light spreads, too.
  write("wide.toml", std::string(kSmallPrinter) + "spread = [[30.0, 1.0]]\n");
  good({"correct", "target.uvj", "-o", "wide.uvj", "--printer", "wide.toml", "--resin",
        "plain.toml", "--mode", "layerwise", "--exposure-s", "0.9", "--lift-exchange", "0.5"});
  good({"simulate", "wide.uvj", "--row", "60", "-o", "row.png"});
  good({"simulate", "wide.uvj", "--x", "80", "--y", "60", "-o", "h.svg"});
}

TEST_F(LiftsProgram, UnderUvLightTheJointCountsTheNetDose) {
  write("uv.toml", std::string(kSmallPrinter) +
                       "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n");
  write(
      "net.toml",
      "name = \"net\"\n[cure]\nmodel = \"kinetic\"\nm = 1.0\nabsorbance_height_um = 150\n"
      "absorbance_base = 10\ncritical_dose_prime = 10\ndose_factor = 1.0\n[inhibition]\nbeta = 1.0\n"
      "absorbance_height_um = 30\nabsorbance_base = 10\n");
  const Command with{"--printer", "uv.toml",      "--resin", "net.toml",    "--mode",
                     "layerwise", "--exposure-s", "0.6",     "--uv-mw-cm2", "150"};
  const RunResult none = good(Command{"correct", "target.uvj", "-o", "none.uvj"} + with);
  EXPECT_THAT(none.err, HasSubstr("under UV light nothing is lifted"));
  EXPECT_FALSE(figures("none.uvj", "target.uvj").contains("joints"));
  good(Command{"correct", "target.uvj", "-o", "each.uvj", "--lifts", "each"} + with);
  const json f = figures("each.uvj", "target.uvj");
  EXPECT_EQ(f["joints"]["not_holding_voxels"], 0);
  EXPECT_GE(f["joints"]["least"].get<double>(), 1.2);
  EXPECT_EQ(f["undercure_voxels"], 0);
  EXPECT_TRUE(f["height_error_um"]["exchanged"]["mean_abs"].is_null());
  // Levels that are chosen for the dose at the end alone do not hold.
  const json as_none = json::parse(good(Command{"verify", "none.uvj", "--target", "target.uvj",
                                                "--json", "-", "--lifts", "each"})
                                       .out);
  EXPECT_GT(as_none["joints"]["not_holding_voxels"], 0);
  // The net dose at the far edge, of the levels that are shown.
  good({"simulate", "each.uvj", "--target", "target.uvj", "--x", "80", "--y", "60", "-o", "u.svg",
        "--lifts-csv", "lifts.csv"});
  std::istringstream lifts(to_text(read_file(folder_ / "lifts.csv")));
  std::istringstream probe(good({"probe", "each.uvj", "--x", "80", "--y", "60"}).out);
  std::string row, shown;
  std::getline(lifts, row);
  std::getline(probe, shown);
  const auto column = [](const std::string& of, int k) {
    std::istringstream in(of);
    std::string cell;
    for (int i = 0; i <= k; ++i) std::getline(in, cell, ',');
    return cell;
  };
  int grey = 0;
  while (column(shown, grey) != "grey") ++grey;
  int holding = 0;
  while (std::getline(lifts, row) && std::getline(probe, shown)) {
    if (column(row, 4) != "holds") continue;
    ++holding;
    const double blue = 1 + 99 * std::stod(column(shown, grey)) / 255;
    const double net = blue * std::pow(10, -1.0 / 3) - 150 * std::pow(10, -5.0 / 3);
    EXPECT_NEAR(std::stod(column(row, 3)), net * 0.6 / 10, 1e-6 * net) << row;
  }
  EXPECT_GT(holding, 10);
  // What lifts exchange is left out, and told.
  const RunResult exchanged = good(
      Command{"correct", "target.uvj", "-o", "y.uvj", "--lifts", "each", "--lift-exchange", "0.5"} +
      with);
  EXPECT_THAT(exchanged.err, HasSubstr("lifts exchange is not counted under UV light"));
  const RunResult brief = bad(
      3,
      Command{"correct", "target.uvj", "-o", "x.uvj", "--lifts", "each", "--green-strength", "10"} +
          with,
      {"does not hold when the platform lifts"});
  EXPECT_THAT(brief.err, HasSubstr("expose for at least"));
}

TEST_F(LiftsProgram, WhatIsNotCountedIsToldOrRefused) {
  bad(2,
      Command{"correct", "target.uvj", "-o", "x.uvj", "--printer", "small.toml", "--resin",
              "plain.toml", "--speed-mm-h", "100", "--lifts", "each"},
      {"--lifts", "layer by layer"});
  for (const char* x : {"-0.1", "1.1", "nan"}) {
    EXPECT_EQ(call(Command{"correct", "target.uvj", "-o", "x.uvj", "--lift-exchange", x} + kWith)
                  .exit_code,
              2);
  }
  // An error of the exchange needs lifts, an exchange, and room for it; it is a share.
  const auto refused = [&](const Command& more, const std::vector<std::string>& words) {
    bad(2, Command{"correct", "target.uvj", "-o", "x.uvj"} + kWith + more, words);
  };
  refused({"--uncertain", "exchange=0.1"}, {"nobody says", "lift_exchange"});
  refused({"--uncertain", "exchange=0.1", "--lifts", "none"}, {"layer by layer", "with lifts"});
  refused({"--uncertain", "exchange=0.2", "--lift-exchange", "0.1"}, {"0.1 at most"});
  refused({"--uncertain", "exchange=10%", "--lift-exchange", "0.5"}, {"exchange", "without %"});
  // Robust it goes with what holds at each lift, which has a fifth of its dose to spare.
  good(Command{"correct", "target.uvj", "-o", "robust.uvj", "--uncertain", "exchange=0.1",
               "--lift-exchange", "0.5", "--robust"} +
       kWith);
  bad(2,
      {"correct", "target.uvj", "-o", "x.uvj", "--printer", "small.toml", "--resin", "plain.toml",
       "--speed-mm-h", "100", "--uncertain", "exchange=0.1"},
      {"exchange", "layer by layer"});
  good(Command{"correct", "target.uvj", "-o", "half.uvj", "--lift-exchange", "0.5"} + kWith);
  bad(2,
      {"simulate", "half.uvj", "--x", "80", "--y", "60", "-o", "h.svg", "--lifts", "none",
       "--lift-exchange", "0.5"},
      {"lift"});
  good({"report", "half.uvj", "--target", "target.uvj", "-o", "half.html"});
  good({"section", "half.uvj", "--target", "target.uvj", "-o", "half.png"});
  // Light that spreads: together.
  write("wide.toml", std::string(kSmallPrinter) + "spread = [[30.0, 1.0]]\n");
  const RunResult wide =
      good({"correct", "target.uvj", "-o", "wide.uvj", "--printer", "wide.toml", "--resin",
            "plain.toml", "--mode", "layerwise", "--exposure-s", "0.9"});
  EXPECT_THAT(wide.err, HasSubstr(", 0 do not hold at their lift"));
  // Rims of features, lit from one side alone, hold as they do as sliced.
  const json spread = figures("wide.uvj", "target.uvj");
  EXPECT_EQ(spread["joints"]["not_holding_voxels"], 0);
  EXPECT_GE(spread["joints"]["least"].get<double>(), 1.2);
  const Command with{"--printer", "wide.toml", "--resin",      "plain.toml",
                     "--mode",    "layerwise", "--exposure-s", "0.9"};
  good(Command{"correct", "target.uvj", "-o", "alone.uvj", "--spread-correction", "off"} + with);
  const json alone = figures("alone.uvj", "target.uvj");
  EXPECT_LT(2 * spread["cure_through_voxels"].get<int>(), alone["cure_through_voxels"].get<int>());
  for (const char* x : {"0", "0.5", "1"}) {
    good(Command{"correct", "target.uvj", "-o", "half.uvj", "--lift-exchange", x} + with);
    const json known = figures("half.uvj", "target.uvj");
    EXPECT_EQ(known["joints"]["not_holding_voxels"], 0) << x;
    EXPECT_EQ(known["undercure_voxels"], 0) << x;
  }
}

// The exchange is known with an error: nothing is cut into for what is believed, and figures say how sure
// edges are for it.
TEST_F(LiftsProgram, AnExchangeThatIsKnownWithAnError) {
  const Command at{"--lift-exchange", "0.5"}, off{"--uncertain", "exchange=0.1,ha=2%"};
  good(Command{"correct", "target.uvj", "-o", "range.uvj"} + kWith + at + off);
  good(Command{"correct", "target.uvj", "-o", "sure.uvj"} + kWith + at);
  const json told = figures("range.uvj", "target.uvj", off);
  const json& u = told["uncertainty"];
  EXPECT_DOUBLE_EQ(u["sd"]["exchange"].get<double>(), 0.1);
  const json& from = u["upper_edges"]["half_width95_from_um"];
  EXPECT_GT(from["lifts"].get<double>(), 0);
  EXPECT_GT(from["resin"].get<double>(), 0);
  EXPECT_EQ(from["lamp"], 0.0);
  EXPECT_EQ(told["joints"]["not_holding_voxels"], 0);
  // x = 0 and x = 1 beside the chosen: the less is exchanged, the further edges go.
  const json& error = told["height_error_um"];
  EXPECT_GT(error["staying"]["mean_abs"], error["mean_abs"]);
  for (const char* share : {"0.3", "0.5", "0.7"}) {
    const json f = figures("range.uvj", "target.uvj", {"--lift-exchange", share});
    EXPECT_LE(f["height_error_um"]["max_shortfall"].get<double>(), 1e-6) << share;
    EXPECT_EQ(f["undercure_voxels"], 0) << share;
  }
  // Corrected for 0.5 alone it is too short where 0.7 is exchanged.
  const json sure = figures("sure.uvj", "target.uvj", {"--lift-exchange", "0.7"});
  EXPECT_GT(sure["height_error_um"]["max_shortfall"].get<double>(), 1);
  // Edges half a layer out are told, and why.
  const RunResult wide = good(Command{"correct", "target.uvj", "-o", "wide.uvj", "--lift-exchange",
                                      "0.3", "--uncertain", "exchange=0.3"} +
                              kWith);
  EXPECT_THAT(wide.err, HasSubstr("no feature is cut into for any share that is believed"));
  good(Command{"report", "range.uvj", "--target", "target.uvj", "-o", "range.html"} + off);
  const std::string page = to_text(read_file(folder_ / "range.html"));
  EXPECT_THAT(page, HasSubstr("of it from lifts"));
  EXPECT_THAT(page, HasSubstr("if all resin stays"));
}

/// A stage that takes 6 s up, 2.975 s back and 1.5 s of rest at 50 um.
constexpr const char* kStage =
    "[stage]\nlift_mm = 6\nlift_speed_mm_h = 3600\nreturn_speed_mm_h = 7200\nwait_s = 1.5\n";

TEST_F(LiftsProgram, TimesAreThoseOfAStopwatch) {
  const std::string small = text_in("small.toml");
  write("lifting.toml", small + kStage + "[vat]\nadhesion_kpa = 20\n");
  Command with = kWith;
  with[1] = "lifting.toml";
  const int layers = 50;
  const double dark_s = layers * (6 + 2.975 + 1.5), light_s = layers * 0.6;
  const RunResult run =
      good(Command{"run", "ladder.stl", "-o", "part.uvj", "--layer-um", "50"} + with);
  EXPECT_THAT(run.err, HasSubstr("largest change of lit area: layer "));
  EXPECT_THAT(run.err, HasSubstr("largest peel force: "));
  EXPECT_THAT(run.err, HasSubstr("print time 9 min 14 s, of it 0 min 30 s of light"));
  const json info = json::parse(good({"info", "part.uvj", "--json", "-"}).out);
  ASSERT_EQ(info["layers"], layers);
  EXPECT_NEAR(info["light_s"].get<double>(), light_s, 1e-9);
  EXPECT_NEAR(info["print_time_s"].get<double>(), light_s + dark_s, 1e-9);
  EXPECT_NEAR(info["layer_s"]["all"].get<double>(), 0.6 + 6 + 2.975 + 1.5, 1e-12);
  // Once in the print's own proof, once in what is read back.
  const json proof = json::parse(text_in("part.json"));
  EXPECT_EQ(proof["largest_area_change"], info["largest_area_change"]);
  EXPECT_EQ(proof["light_s"], info["light_s"]);
  EXPECT_EQ(proof["print_time_s"], info["print_time_s"]);
  EXPECT_EQ(proof["largest_peel_force"], info["largest_peel_force"]);
  EXPECT_EQ(figures("part.uvj", "target.uvj")["largest_area_change"], info["largest_area_change"]);
  EXPECT_GT(info["largest_peel_force"]["n"].get<double>(), 0);
  EXPECT_THAT(text_in("part.html"), HasSubstr("9 min 14 s, of it 0 min 30 s of light"));
  EXPECT_THAT(good({"info", "part.uvj"}).out, HasSubstr("9 min 14 s, of it 0 min 30 s of light"));
  // Nothing says how the small printer lifts.
  good(Command{"run", "ladder.stl", "-o", "other.uvj", "--layer-um", "50"} + kWith);
  const json other = json::parse(good({"info", "other.uvj", "--json", "-"}).out);
  EXPECT_TRUE(other["print_time_s"].is_null());
  EXPECT_NEAR(other["light_s"].get<double>(), light_s, 1e-9);
  EXPECT_FALSE(other.contains("largest_peel_force"));
  EXPECT_THAT(text_in("other.html"), HasSubstr("lifts not known"));
}

TEST_F(LiftsProgram, PlansTellLiftsAndWhatHolds) {
  write("lifting.toml", text_in("small.toml") + kStage);
  // Far above what lies on the platform alone: only joints bound the exposure.
  const Command ask{"plan",      "block.stl",  "--resin", "plain.toml", "--mode",
                    "layerwise", "--layer-um", "50",      "--json",     "-"};
  const json plan = json::parse(good(ask + Command{"--printer", "lifting.toml"}).out);
  // 1.2 gel doses at 50 um.
  const double holds_s = 0.1 * 1.2 * std::pow(10.0, 1.0 / 3);
  EXPECT_GE(plan["exposure_s"].get<double>(), holds_s);
  EXPECT_LE(plan["exposure_s"].get<double>(), holds_s * 1.001);
  EXPECT_NEAR(plan["light_s"].get<double>(), 20 * plan["exposure_s"].get<double>(), 1e-9);
  EXPECT_NEAR(plan["print_time_s"].get<double>(), plan["light_s"].get<double>() + 20 * 10.475,
              1e-9);
  EXPECT_NEAR(plan["layer_s"]["lift"].get<double>(), 6, 1e-12);
  const json unknown = json::parse(good(ask + Command{"--printer", "small.toml"}).out);
  EXPECT_TRUE(unknown["print_time_s"].is_null());
  Command text = ask + Command{"--printer", "small.toml"};
  text.erase(text.begin() + 8, text.begin() + 10);
  EXPECT_THAT(good(text).out, HasSubstr("lifts not known"));
}

TEST_F(LiftsProgram, PrintFilesSayTheirOwnLifts) {
  // New GOO and CTB files say 5 mm at 60 mm/min, back at 150.
  const double dark_s = 50 * (5 + 4.95 / 2.5), light_s = 50 * 0.6;
  for (const std::string file : {"part.goo", "part.ctb", "part.zip"}) {
    Command how = kWith + Command{"--format", file == "part.zip" ? "chitubox" : file.substr(5)};
    good(Command{"correct", "target.uvj", "-o", file} + how);
    const json info = json::parse(good({"info", file, "--json", "-"}).out);
    EXPECT_NEAR(info["light_s"].get<double>(), light_s, 1e-4) << file;
    EXPECT_NEAR(info["print_time_s"].get<double>(), light_s + dark_s, 1e-3) << file;
    // Theirs comes back the whole way, in whole seconds.
    EXPECT_NEAR(info["own_print_time_s"].get<double>(), light_s + 50 * 7, 1) << file;
    EXPECT_THAT(good({"info", file}).out, HasSubstr("the archive itself says 6 min "));
  }
  // What an archive says counts before the printer's own.
  write("lifting.toml", text_in("small.toml") + kStage);
  Command with = kWith;
  with[1] = "lifting.toml";
  good(Command{"convert", "target.uvj", "-o", "design.goo"});
  const json plan = json::parse(
      good(Command{"plan", "design.goo", "--resin", "plain.toml", "--printer", "lifting.toml",
                   "--mode", "layerwise", "--tolerance-um", "200", "--json", "-"})
          .out);
  EXPECT_NEAR(plan["layer_s"]["lift"].get<double>(), 5, 1e-9);
}

TEST_F(LiftsProgram, BaselinesAreJudgedWithLifts) {
  const json all = json::parse(
      good(Command{"compare", "ladder.stl", "--layer-um", "50", "--json", "-"} + kWith).out);
  for (const char* method : {"uncorrected", "erase", "z_compensation", "table", "ours"}) {
    ASSERT_TRUE(all.contains(method)) << method;
    EXPECT_TRUE(all[method].contains("joints")) << method;
    EXPECT_TRUE(all[method]["height_error_um"].contains("exchanged")) << method;
  }
  // Without greys the Z compensation is the erase.
  EXPECT_EQ(all["z_compensation"], all["erase"]);
  EXPECT_GT(all["erase"]["best_n"].get<int>(), 0);
  EXPECT_GT(all["erase"]["joints"]["liquid_layers_max"].get<int>(), 0);
  EXPECT_EQ(all["ours"]["joints"]["not_holding_voxels"], 0);
  const RunResult table = good(Command{"compare", "ladder.stl", "--layer-um", "50"} + kWith);
  EXPECT_THAT(table.out, HasSubstr("Z comp., N = "));
}

}  // namespace
}  // namespace slicecorr::test
