// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// resinctl plot, predict and recommend as their users meet them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "resins_text.hpp"
#include "run_program.hpp"

namespace slicecorr {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

constexpr const char* kResin1 = R"(name = "resin-1"
[cure]
model = "kinetic"
m = 0.99
absorbance_height_um = 408.0
absorbance_base = "e"
critical_dose_prime = 64.0
dose_factor = 5.0
[inhibition]
beta = 0.73
absorbance_height_um = 37.8
absorbance_base = "e"
)";

/// Ember's resin of the database test in miniature: Jacobs, measured heights beside it.
constexpr const char* kMeasured = R"(name = "measured"
[cure]
model = "jacobs"
m = 1.0
absorbance_height_um = 200.0
absorbance_base = "e"
gel_dose_mj_cm2 = 10.0
dose_factor = 4.0
[provenance]
source = "a test"
measurements = ["heights.csv"]
)";

class DesignCommand : public ::testing::Test {
 protected:
  DesignCommand()
      : folder_(fs::path(::testing::TempDir()) /
                ("slicecorr-design-" + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
    write("resin-1.toml", kResin1);
    write("measured.toml", kMeasured);
    std::string csv = "intensity_mw_cm2,exposure_s,cured_height_um\n";
    int i = 0;
    for (const double blue : {5.0, 20.0}) {
      for (const double time : {4.0, 8.0, 16.0, 32.0}) {
        const double z = 200 * std::log(blue * time / 10) + (i++ % 3 - 1) * 4;
        csv += std::to_string(blue) + "," + std::to_string(time) + "," + std::to_string(z) + "\n";
      }
    }
    write("heights.csv", csv);
    csv = "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um\n";
    for (const double ratio : {1.8, 2.5, 3.5, 5.0, 6.0}) {
      const double z = std::log(0.73 * ratio) / (1 / 37.8 - 1 / 408.0) + (i++ % 3 - 1) * 0.5;
      csv += "100," + std::to_string(100 * ratio) + ",60," + std::to_string(z) + "\n";
    }
    write("zones.csv", csv);
  }
  ~DesignCommand() override { fs::remove_all(folder_); }

  void write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
  }
  std::string read(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  std::size_t files() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  test::RunResult call(const std::vector<std::string>& arguments) const {
    test::RunOptions options;
    options.folder = folder_.string();
    options.environment = {
        {"SLICECORR_DB", folder_.string()}, {"HOME", folder_.string()}, {"XDG_CONFIG_HOME", ""}};
    std::vector<std::string> command{SLICECORR_BIN_DIR "/resinctl"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return test::run_program(command, options);
  }
  test::RunResult good(const std::vector<std::string>& arguments) const {
    test::RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
    return r;
  }
  /// Wants the exit code, all words in the message, nothing on stdout, and no new file.
  void bad(int code, const std::vector<std::string>& arguments,
           const std::vector<std::string>& words) const {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const std::size_t before = files();
    const test::RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, code) << r.err;
    EXPECT_EQ(r.out, "");
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
    EXPECT_EQ(files(), before);
  }

  fs::path folder_;
};

TEST_F(DesignCommand, PlotsAResinByName) {
  // With measurements: fitted again. Without: from its parameters.
  const auto r = good({"plot", "measured", "-o", "a.svg"});
  EXPECT_EQ(r.out, "");
  EXPECT_THAT(r.err, HasSubstr("a.svg: written; jacobs fit of 8 measurements"));
  const std::string svg = read("a.svg");
  test::expect_sound_svg(svg);
  EXPECT_THAT(svg, HasSubstr("measured: working curve, Jacobs fit"));
  EXPECT_THAT(svg, HasSubstr("aim 4 × gel"));
  good({"plot", "resin-1", "-o", "b.svg"});
  test::expect_sound_svg(read("b.svg"));
  EXPECT_THAT(read("b.svg"), HasSubstr("resin-1: working curve and dead zone"));
  // The same bytes again, and from a path.
  good({"plot", "./measured.toml", "-o", "c.svg", "--quiet"});
  EXPECT_EQ(read("c.svg"), svg);
}

TEST_F(DesignCommand, PlotsEveryKind) {
  const std::vector<std::vector<std::string>> calls{
      {"heights.csv"},
      {"heights.csv", "--kind", "collapse"},
      {"zones.csv", "--resin", "resin-1"},
      {"zones.csv", "--resin", "resin-1", "--model", "deadzone-transient"},
      {"measured", "--kind", "resin"},
      {"resin-1", "--kind", "fronts", "--blue-mw-cm2", "50", "--uv-mw-cm2", "0", "--time-s", "30"},
  };
  for (const auto& arguments : calls) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    std::vector<std::string> command{"plot", "-o", "x.svg"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    good(command);
    test::expect_sound_svg(read("x.svg"));
    fs::remove(folder_ / "x.svg");
  }
  good({"plot", "measured", "-o", "x.html"});
  EXPECT_THAT(read("x.html"), HasSubstr("<!doctype html>"));
  EXPECT_THAT(read("x.html"), HasSubstr("4 times the gel dose"));
}

TEST_F(DesignCommand, PlotRefusesWhatItCannotDraw) {
  bad(2, {"plot", "nosuch", "-o", "x.svg"}, {"no resin 'nosuch'"});
  bad(2, {"plot", "nosuch.csv", "-o", "x.svg"}, {"nosuch.csv"});
  bad(2, {"plot", "resin-1", "--kind", "working-curve", "-o", "x.svg"}, {"no measurements"});
  bad(2, {"plot", "zones.csv", "-o", "x.svg"}, {"--resin"});
  bad(2, {"plot", "heights.csv", "--kind", "dead-zone", "-o", "x.svg"}, {"no dead zones"});
  bad(2, {"plot", "zones.csv", "--kind", "working-curve", "-o", "x.svg"}, {"no cured heights"});
  bad(2, {"plot", "heights.csv", "--kind", "fronts", "-o", "x.svg"}, {"fronts", "resin"});
  bad(2, {"plot", "heights.csv", "resin-1", "-o", "x.svg"}, {"one resin"});
  bad(2, {"plot", "measured", "--resin", "resin-1", "-o", "x.svg"}, {"--resin"});
  bad(2, {"plot", "measured", "--kind", "fronts", "--uv-mw-cm2", "5", "-o", "x.svg"},
      {"no inhibition"});
  bad(2, {"plot", "heights.csv", "-o", "heights.csv"}, {"is an input"});
  bad(2, {"plot", "measured", "-o", "heights.csv"}, {"a name that ends in .svg"});
  bad(2, {"plot", "measured"}, {"--output"});
  bad(4, {"plot", "measured", "-o", "nowhere/x.svg"}, {"can't be written"});
}

TEST_F(DesignCommand, PredictsFromTheReadersOptions) {
  const auto r = good({"predict", "--resin", "resin-1", "--blue-mw-cm2", "100", "--uv-mw-cm2",
                       "200", "--exposure-s", "30", "--speed-mm-h", "1000"});
  for (const char* words :
       {"5 times the gel dose", "Dose used: gel dose, 64", "Dead zone in the long run: 15.77 um",
        "114.9 um above the window after 0.9751 s", "from 16.71 um (dead zone) to 1567 um",
        "phi = 1.936"}) {
    EXPECT_THAT(r.out, HasSubstr(words));
  }
  EXPECT_EQ(r.err, "");
  // JSON on stdout, the words on stderr; and into a file.
  const auto j = good({"predict", "--resin", "resin-1", "--blue-mw-cm2", "100", "--uv-mw-cm2",
                       "200", "--exposure-s", "30", "--dose", "aim", "--json", "-"});
  EXPECT_EQ(json::parse(j.out).at("critical_dose_prime"), 320);
  EXPECT_THAT(j.err, HasSubstr("Dead zone"));
  good({"predict", "--resin", "resin-1", "--blue-mw-cm2", "100", "--json", "p.json"});
  EXPECT_EQ(json::parse(read("p.json")).at("dose"), "gel");
  // What is infeasible is said, and only a question without an answer is an error.
  const auto weak =
      good({"predict", "--resin", "resin-1", "--blue-mw-cm2", "100", "--uv-mw-cm2", "100"});
  EXPECT_THAT(weak.out, HasSubstr("cures to the window after"));
  const auto never = call({"predict", "--resin", "resin-1", "--blue-mw-cm2", "100", "--uv-mw-cm2",
                           "200", "--height-um", "10"});
  EXPECT_EQ(never.exit_code, 3);
  EXPECT_THAT(never.err, HasSubstr("never gels"));
  EXPECT_THAT(never.out, HasSubstr("Dead zone"));
}

TEST_F(DesignCommand, PredictCountsJointsLayerByLayer) {
  write("plain.toml",
        "name = \"plain\"\n[cure]\nabsorbance_height_um = 150\nabsorbance_base = 10\n"
        "gel_dose_mj_cm2 = 10\ndose_factor = 5\n");
  // 1.2 gel doses at 50 um, whatever dose correction aims at without lifts.
  const double holds_s = 0.1 * 1.2 * std::pow(10.0, 1.0 / 3);
  using test::Command, test::operator+;
  const Command ask{"predict", "--resin", "plain.toml", "--blue-mw-cm2", "100", "--layer-um", "50"};
  const auto j = nlohmann::json::parse(good(ask + Command{"--json", "-"}).out);
  EXPECT_NEAR(j["layer_by_layer"]["least_exposure_s"].get<double>(), holds_s, 1e-9);
  EXPECT_EQ(j["layer_by_layer"]["green_strength"], 1.2);
  const auto short_one = good(ask + Command{"--exposure-s", "0.2"});
  EXPECT_NE(short_one.out.find("at least 0.25854 s"), std::string::npos) << short_one.out;
  EXPECT_NE(short_one.out.find("after 0.2 s it does not"), std::string::npos) << short_one.out;
  EXPECT_NE(good(ask + Command{"--exposure-s", "0.3"}).out.find("after 0.3 s it does."),
            std::string::npos);
  // Under UV light lifts are not counted.
  const auto uv = good({"predict", "--resin", "resin-1", "--blue-mw-cm2", "100", "--uv-mw-cm2",
                        "200", "--json", "-"});
  EXPECT_FALSE(json::parse(uv.out).contains("layer_by_layer"));
}

TEST_F(DesignCommand, PredictTakesFullLightAndBlackFromAPrinter) {
  const std::string printer = SLICECORR_PRINTERS_DIR "/dual-wavelength-dlp.toml";
  const auto r = good({"predict", "--resin", SLICECORR_DB_DIR "/figure-2-2.toml", "--printer",
                       printer, "--speed-mm-h", "1000", "--dose", "aim"});
  EXPECT_THAT(r.out, HasSubstr("Fastest speed with this light: 6250 mm/h"));
  EXPECT_THAT(r.out, HasSubstr("Slowest speed: 62.5 mm/h"));
}

TEST_F(DesignCommand, PredictRefusesWhatMakesNoSense) {
  bad(2, {"predict", "--resin", "resin-1"}, {"--blue-mw-cm2", "--printer"});
  bad(2, {"predict", "--resin", "resin-1", "--blue-mw-cm2", "nan"}, {"expected a number above 0"});
  bad(2, {"predict", "--resin", "resin-1", "--blue-mw-cm2", "1", "--uv-mw-cm2", "inf"},
      {"expected a number"});
  bad(2, {"predict", "--resin", "measured", "--blue-mw-cm2", "10", "--uv-mw-cm2", "10"},
      {"no inhibition"});
}

TEST_F(DesignCommand, RecommendsAnAbsorber) {
  const std::string printer = SLICECORR_PRINTERS_DIR "/dual-wavelength-dlp.toml";
  const std::vector<std::string> ask{
      "recommend", "--resin",       SLICECORR_DB_DIR "/figure-2-2.toml",
      "--printer", printer,         "--speed-mm-h",
      "1000",      "--tolerance-um"};
  auto with = [&](std::vector<std::string> more) {
    std::vector<std::string> command = ask;
    command.insert(command.end(), more.begin(), more.end());
    return command;
  };
  const auto r = good(with({"2"}));
  for (const char* words : {"absorbance at 460 nm is", "Any height between 320 and",
                            "Without correction no absorber meets 2 um", "193.1 um", "Assumed"}) {
    EXPECT_THAT(r.out, HasSubstr(words));
  }
  const json j = json::parse(good(with({"2", "--json", "-"})).out);
  EXPECT_NEAR(j.at("range10").at("least_um"), 320, 1e-6);
  EXPECT_NEAR(j.at("absorber_factor").get<double>() * j.at("height10_um").get<double>(), 2000,
              1e-6);
  // Nothing meets the wish: exit 3 with what would, and JSON all the same.
  const auto no = call(with({"0.01", "--json", "no.json"}));
  EXPECT_EQ(no.exit_code, 3);
  EXPECT_THAT(no.err, HasSubstr("no absorber meets the wish"));
  EXPECT_THAT(no.err, HasSubstr("that tolerance would do"));
  EXPECT_FALSE(json::parse(read("no.json")).at("feasible"));
  bad(2, with({"2", "--dead-zone-um", "20"}), {"no inhibition"});
  bad(2, with({"0"}), {"expected a number above 0"});
  bad(2,
      {"recommend", "--resin", "resin-1", "--printer", printer, "--speed-mm-h", "5000",
       "--tolerance-um", "2"},
      {"beyond the stage", "2000 mm/h"});
}

}  // namespace
}  // namespace slicecorr
