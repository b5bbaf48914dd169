// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// resinctl fit as its users call it: files in, JSON and resin files out, errors with exit codes.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "fit_designs.hpp"
#include "run_program.hpp"
#include "slicecorr/process.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

std::string csv_of(const resins::Measurements& m) {
  std::string text;
  if (!m.cured.empty()) text = "intensity_mw_cm2,exposure_s,cured_height_um\n";
  for (const auto& c : m.cured) {
    text += fmt::format("{},{},{}\n", c.blue_mw_cm2, c.exposure_s, c.height_um);
  }
  if (!m.dead_zones.empty()) text = "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um\n";
  for (const auto& z : m.dead_zones) {
    text += fmt::format("{},{},{},{}\n", z.blue_mw_cm2, z.uv_mw_cm2, z.exposure_s, z.dead_zone_um);
  }
  return text;
}

class FitCommand : public ::testing::Test {
 protected:
  FitCommand() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", folder_.path()}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    resins::Measurements heights = with_scatter(joint, 1), zones = heights;
    heights.dead_zones.clear();
    zones.cured.clear();
    write("heights.csv", csv_of(heights));
    write("zones.csv", csv_of(zones));
    write("resin2.toml",
          "name = \"resin2\"\n[cure]\nmodel = \"kinetic\"\nm = 1.03\n"
          "absorbance_height_um = 1631.0\nabsorbance_base = \"e\"\n"
          "critical_dose_prime = 238.0\ndose_factor = 5.0\n");
  }
  void write(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, to_bytes(text));
  }
  RunResult call(Command arguments) const {
    arguments.insert(arguments.begin(), {SLICECORR_BIN_DIR "/resinctl", "fit"});
    return run_program(arguments, options_);
  }
  json good(const Command& arguments) const {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return json::parse(r.out, nullptr, false);
  }
  /// Exit 2, all words on stderr, nothing on stdout, no new file.
  void bad(const Command& arguments, const std::vector<std::string>& words) const {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const auto before = folder_.count();
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    EXPECT_EQ(r.out, "");
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
    EXPECT_EQ(folder_.count(), before);
  }

  const Design joint = joint_design();
  TemporaryFolder folder_;
  RunOptions options_;
};

void expect_near_truth(const json& result, const std::string& name, double truth) {
  const json& p = result.at("parameters").at(name);
  // Five standard errors: one seeded run, known to be a fair one.
  EXPECT_NEAR(p.at("value").get<double>(), truth, 5 * p.at("stderr").get<double>()) << name;
  ASSERT_EQ(p.at("ci95").size(), 2U) << name;
  EXPECT_LT(p["ci95"][0].get<double>(), p["value"].get<double>()) << name;
  EXPECT_GT(p["ci95"][1].get<double>(), p["value"].get<double>()) << name;
}

TEST_F(FitCommand, JsonHasTheKeysOfTheContract) {
  const json jacobs = good({"heights.csv", "--model", "jacobs", "--json", "-"});
  expect_near_truth(jacobs, "h_um", 1631);
  EXPECT_TRUE(jacobs["parameters"].contains("dc_mj_cm2"));
  const json kinetic = good({"heights.csv", "--model", "kinetic", "--json", "-"});
  EXPECT_EQ(kinetic.at("model"), "kinetic");
  for (const auto& [name, value] :
       {std::pair{"h_um", 1631.0}, {"m", 1.03}, {"critical_dose_prime", 238.0}}) {
    expect_near_truth(kinetic, name, value);
  }
  EXPECT_EQ(kinetic.at("n"), 54);
  EXPECT_NEAR(kinetic.at("r2").get<double>(), 0.958, 0.03);
  EXPECT_GT(kinetic.at("rmse_um").get<double>(), 0);
  EXPECT_TRUE(kinetic.at("outliers").is_array());
  EXPECT_TRUE(kinetic.at("warnings").is_array());
  EXPECT_EQ(kinetic.at("covariance").at("names").size(), 3U);
  EXPECT_EQ(kinetic.at("points").size(), 54U);
  EXPECT_TRUE(kinetic.at("reciprocity").at("holds").get<bool>());

  const json zone =
      good({"zones.csv", "--model", "deadzone-transient", "--resin", "resin2", "--json", "-"});
  for (const auto& [name, value] : {std::pair{"beta", 4.84}, {"huv_um", 100.0}, {"m", 1.29}}) {
    expect_near_truth(zone, name, value);
  }
  // The gel dose, not the one aimed at.
  EXPECT_NEAR(zone.at("blue_law").at("critical_dose_prime").get<double>(), 238, 1e-9);
  const json steady =
      good({"zones.csv", "--model", "deadzone-steady", "--resin", "resin2.toml", "--json", "-"});
  EXPECT_EQ(steady.at("parameters").size(), 2U);
  const json all = good({"heights.csv", "zones.csv", "--model", "joint", "--json", "-"});
  for (const auto& [name, value] : joint.truth) expect_near_truth(all, name, value);
}

TEST_F(FitCommand, TextGoesWhereTheJsonDoesNot) {
  const RunResult text = call({"heights.csv", "--model", "kinetic"});
  EXPECT_THAT(text.out, AllOf(HasSubstr("critical_dose_prime"), HasSubstr("Reciprocity holds")));
  EXPECT_EQ(text.err, "");
  const RunResult both = call({"heights.csv", "--model", "kinetic", "--json", "-"});
  EXPECT_THAT(both.err, HasSubstr("Reciprocity holds"));
  EXPECT_EQ(call({"heights.csv", "--model", "kinetic", "--json", "-", "--quiet"}).err, "");
  const RunResult file = call({"heights.csv", "--model", "kinetic", "--json", "fit.json"});
  EXPECT_EQ(file.out, text.out);
  EXPECT_EQ(to_text(read_file(folder_ / "fit.json")), both.out);
}

TEST_F(FitCommand, OptionsReachTheFit) {
  const json held = good({"heights.csv", "--model", "kinetic", "--fix", "m=1", "--bound",
                          "h_um=100:3000", "--json", "-"});
  EXPECT_EQ(held["parameters"]["m"]["value"], 1);
  EXPECT_TRUE(held["parameters"]["m"]["stderr"].is_null());
  EXPECT_TRUE(held["parameters"]["m"]["fixed"].get<bool>());
  const json two = good(
      {"heights.csv", "--model", "kinetic", "--fix", "m=1", "--fix", "h_um=1600", "--json", "-"});
  EXPECT_EQ(two["free_parameters"], 1);
  const Command resampled = {"heights.csv", "--model",   "kinetic", "--bootstrap", "200",
                             "--seed",      "7",         "--json",  "-",           "--loss",
                             "cauchy",      "--weights", "scatter"};
  const json boot = good(resampled);
  EXPECT_EQ(boot["parameters"]["m"]["bootstrap95"].size(), 2U);
  Command one_thread = resampled;
  one_thread.insert(one_thread.end(), {"--threads", "1"});
  EXPECT_EQ(good(one_thread), boot);
  const json shared =
      good({"heights.csv", "zones.csv", "--model", "joint", "--one-m", "--json", "-"});
  EXPECT_FALSE(shared["parameters"].contains("m_uv"));
}

TEST_F(FitCommand, ResinFilesAreMadeAndCompleted) {
  good({"heights.csv", "--model", "kinetic", "--json", "-", "-o", "mine.toml"});
  const Resin resin = load_resin(folder_ / "mine.toml");
  EXPECT_EQ(resin.name, "mine");
  EXPECT_NEAR(resin.absorbance_height10_um / (1631 * 2.302585), 1, 0.3);
  EXPECT_FALSE(resin.inhibition);
  // Correction aims at a multiple of what was measured.
  EXPECT_EQ(resin.dose_factor, kDefaultDoseFactor);

  bad({"heights.csv", "--model", "kinetic", "-o", "mine.toml"}, {"mine.toml", "is there already"});
  good({"zones.csv", "--model", "deadzone-transient", "--resin", "mine.toml", "--json", "-", "-o",
        "mine.toml"});
  const Resin both = load_resin(folder_ / "mine.toml");
  ASSERT_TRUE(both.inhibition);
  EXPECT_NEAR(both.inhibition->beta / 4.84, 1, 0.5);
  EXPECT_NEAR(both.absorbance_height10_um / resin.absorbance_height10_um, 1, 1e-6);
}

TEST_F(FitCommand, WrongUsageIsExplained) {
  bad({}, {"DATA"});
  bad({"heights.csv"}, {"--model"});
  bad({"heights.csv", "--model", "cubic"}, {"cubic"});
  bad({"none.csv", "--model", "kinetic"}, {"none.csv"});
  bad({"heights.csv", "heights.csv", "--model", "kinetic"}, {"heights.csv", "twice"});
  bad({"zones.csv", "--model", "kinetic"}, {"no cured heights", "cured_height_um"});
  bad({"zones.csv", "--model", "deadzone-steady"}, {"--resin", "joint"});
  bad({"zones.csv", "--model", "deadzone-steady", "--resin", "nobody"}, {"nobody"});
  bad({"heights.csv", "--model", "kinetic", "--fix", "m"}, {"--fix m", "NAME=VALUE"});
  bad({"heights.csv", "--model", "kinetic", "--fix", "m=one"}, {"--fix m=one", "NAME=VALUE"});
  bad({"heights.csv", "--model", "kinetic", "--fix", "m=1", "--fix", "m=2"}, {"m twice"});
  bad({"heights.csv", "--model", "kinetic", "--fix", "beta=1"}, {"'beta' is no parameter"});
  bad({"heights.csv", "--model", "kinetic", "--bound", "m=1"}, {"--bound m=1", "NAME=LOW:HIGH"});
  bad({"heights.csv", "--model", "kinetic", "--bound", "m=1:x"}, {"--bound", "NAME=LOW:HIGH"});
  bad({"heights.csv", "--model", "kinetic", "--one-m"}, {"joint"});
  bad({"heights.csv", "--model", "kinetic", "-o", "mine.txt"}, {"mine.txt", "NAME.toml"});
  bad({"heights.csv", "--model", "kinetic", "-o", "mine.toml", "--name", "other"},
      {"mine.toml", "other.toml"});
  bad({"heights.csv", "--model", "kinetic", "--json", "heights.csv"}, {"is an input"});
  write("text.csv", "intensity_mw_cm2,exposure_s,cured_height_um\n20,4,60\n20,five,70\n");
  bad({"text.csv", "--model", "kinetic"}, {"text.csv: line 3, column 2 (exposure_s)", "'five'"});
}

TEST_F(FitCommand, HelpTellsColumnsAndModels) {
  const RunResult r = call({"--help"});
  EXPECT_EQ(r.exit_code, 0);
  for (const char* word : {"intensity_mw_cm2,exposure_s,cured_height_um", "deadzone-transient",
                           "--resin", "critical_dose_prime", "sigma_um"}) {
    EXPECT_THAT(r.out, HasSubstr(word));
  }
}

}  // namespace
}  // namespace slicecorr::test
