// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `--uncertain` and `--robust`, as people use them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "meshes.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class UncertainProgram : public ::testing::Test {
 protected:
  UncertainProgram() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", ""}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    std::ofstream(folder_ / "p.toml")
        << "name = \"p\"\n[display]\nwidth_px = 64\nheight_px = 64\npixel_um = 50\n"
           "[blue]\ncalibration = [[0, 1.0], [255, 100.0]]\n"
           "[stage]\nmax_speed_mm_h = 8000\n";
    resin("by-hand.toml", "");
    // What resinctl fit writes: 2 % of 868.6 um, 3 % of 50 mJ/cm², correlated by 0.9.
    resin("fitted.toml", "covariance = \"h_um, dc_mj_cm2: [[301.79, 23.452], [23.452, 2.25]]\"\n");
    // Rungs of 400 um with gaps of 200 um and 1.5 mm.
    TriangleMesh mesh = box({0, 0, 0}, {2, 2, 0.4});
    for (const double z : {0.6, 1.2}) append(mesh, box({0, 0, z}, {2, 2, z + 0.4}));
    append(mesh, box({0, 0, 3.1}, {2, 2, 3.2}));
    append(mesh, box({0, 0, 0}, {0.3, 0.3, 3.2}));
    write_stl(folder_ / "part.stl", mesh);
  }
  void resin(const std::string& name, const std::string& provenance) const {
    std::ofstream(folder_ / name)
        << "name = \"r\"\n[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 868.6\n"
           "absorbance_base = \"e\"\ngel_dose_mj_cm3 = 575.6\ndose_factor = 1.0\n"
           "[provenance]\nsource = \"test\"\n"
        << provenance;
  }
  RunResult call(const Command& arguments) const {
    Command command{SLICECORR_BIN_DIR "/slicecorr", "--quiet"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return run_program(command, options_);
  }
  void fine(const Command& arguments) const {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
  }
  void bad(int code, const Command& arguments, const std::vector<std::string>& words) const {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, code) << ::testing::PrintToString(arguments) << r.err;
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
  }
  json read_json(const std::string& name) const {
    std::ifstream in(folder_ / name);
    return json::parse(in);
  }
  static Command run(const Command& more, const std::string& speed_mm_h = "1000") {
    Command command{"run",       "part.stl", "-o",      "out.uvj",     "--layer-um",   "50",
                    "--printer", "p.toml",   "--resin", "fitted.toml", "--speed-mm-h", speed_mm_h};
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(UncertainProgram, RunAndVerifySayTheSame) {
  fine({"slice", "part.stl", "-o", "target.uvj", "--layer-um", "50", "--printer", "p.toml"});
  fine(run({"--uncertain", "ha=5%,dc=3%,light=1%"}));
  const json made = read_json("out.json");
  fine({"verify", "out.uvj", "--target", "target.uvj", "--uncertain", "ha=5%,dc=3%,light=1%",
        "--json", "v.json", "--uncertain-map", "map.png"});
  const json seen = read_json("v.json");
  EXPECT_EQ(made["uncertainty"], seen["uncertainty"]);
  const json& u = seen["uncertainty"];
  EXPECT_EQ(u["asked"], "ha=5%,dc=3%,light=1%");
  EXPECT_DOUBLE_EQ(u["sd"]["ha"].get<double>(), 0.05);
  EXPECT_GT(u["expected_mean_abs_um"].get<double>(),
            seen["height_error_um"]["mean_abs"].get<double>());
  EXPECT_GE(u["bad_mean_abs_um"].get<double>(), u["expected_mean_abs_um"].get<double>());
  EXPECT_EQ(u["upper_edges"]["edges"].get<int>() + u["lower_edges"]["edges"].get<int>(),
            seen["height_error_um"]["edges"].get<int>());
  ASSERT_EQ(seen["height_error_um"]["band95"].size(), 2U);
  EXPECT_LT(seen["height_error_um"]["band95"][0].get<double>(), 0);
  EXPECT_GT(seen["height_error_um"]["band95"][1].get<double>(), 0);
  EXPECT_EQ(u["lost_features"]["of"], seen["runs"]);
  EXPECT_EQ(u["merged_features"]["of"], seen["gaps"]);
  EXPECT_THAT(to_text(read_file(folder_ / "out.html")), HasSubstr("How sure this is"));
  const Bytes map = read_file(folder_ / "map.png");
  ASSERT_GT(map.size(), 100U);
  EXPECT_EQ(map[1], 'P');
  // Without it nothing of all this is there.
  fine(run({}));
  EXPECT_FALSE(read_json("out.json").contains("uncertainty"));
  EXPECT_FALSE(read_json("out.json")["height_error_um"].contains("band95"));
}

TEST_F(UncertainProgram, AFitIsSurerThanItsErrorsApart) {
  fine(run({"--uncertain", "fit"}));
  const double together = read_json("out.json")["uncertainty"]["expected_mean_abs_um"];
  fine(run({"--uncertain", "ha=2%,dc=3%"}));
  const double apart = read_json("out.json")["uncertainty"]["expected_mean_abs_um"];
  EXPECT_LT(together, apart);
}

TEST_F(UncertainProgram, AFitHasTheExchangeThatThePrinterFileKnows) {
  std::ofstream(folder_ / "lifting.toml")
      << "name = \"lifting\"\n[display]\nwidth_px = 64\nheight_px = 64\npixel_um = 50\n"
         "[blue]\ncalibration = [[0, 1.0], [255, 100.0]]\n"
         "[process]\nlift_exchange = 0.4\nlift_exchange_sd = 0.05\n";
  const auto print = [&](const Command& more) {
    Command command{"run",    "part.stl",  "-o",           "out.uvj", "--layer-um",
                    "50",     "--printer", "lifting.toml", "--resin", "fitted.toml",
                    "--mode", "layerwise", "--exposure-s", "3"};
    command.insert(command.end(), more.begin(), more.end());
    fine(command);
    return read_json("out.json")["uncertainty"];
  };
  json known = print({"--uncertain", "fit"});
  EXPECT_EQ(known["asked"], "fit,exchange=0.05");
  EXPECT_DOUBLE_EQ(known["sd"]["exchange"].get<double>(), 0.05);
  EXPECT_EQ(known, print({"--uncertain", "fit,exchange=0.05"}));
  // Of a share that is said for this print the file knows nothing.
  EXPECT_FALSE(print({"--uncertain", "fit", "--lift-exchange", "0.3"})["sd"].contains("exchange"));
  std::ofstream(folder_ / "half.toml")
      << "name = \"half\"\n[display]\nwidth_px = 64\nheight_px = 64\npixel_um = 50\n"
         "[blue]\ncalibration = [[0, 1.0], [255, 100.0]]\n[process]\nlift_exchange_sd = 0.05\n";
  bad(2, {"slice", "part.stl", "-o", "t.uvj", "--layer-um", "50", "--printer", "half.toml"},
      {"lift_exchange_sd", "without lift_exchange"});
}

TEST_F(UncertainProgram, RobustSaysWhatItCosts) {
  fine(run({"--uncertain", "ha=5%,dc=5%", "--robust"}));
  const json r = read_json("out.json")["uncertainty"]["robust"];
  EXPECT_GT(r["features"].get<int>() + r["gaps"].get<int>(), 0);
  EXPECT_LE(r["lost"].get<int>() + r["filled"].get<int>(),
            r["features"].get<int>() + r["gaps"].get<int>());
  EXPECT_GE(r["mean_abs_um"].get<double>(), r["plain_mean_abs_um"].get<double>());
}

TEST_F(UncertainProgram, WhatCannotBeIsRefusedByName) {
  bad(2, run({"--uncertain", "ha=50%"}), {"ha", "30 %"});
  bad(2, run({"--uncertain", "fit,ha=3%"}), {"ha", "twice"});
  bad(2, run({"--robust"}), {"--uncertain"});
  bad(2, run({"--uncertain", "fit", "--ha-um", "1900"}), {"--ha-um"});
  bad(2,
      {"run", "part.stl", "-o", "out.uvj", "--layer-um", "50", "--printer", "p.toml", "--resin",
       "by-hand.toml", "--speed-mm-h", "1000", "--uncertain", "fit"},
      {"by-hand.toml", "by hand: ha=8%"});
  bad(2, run({"--uncertain", "noise=5%", "--platform-reflectance", "0.2"}), {"noise", "platform"});
  bad(3, run({"--uncertain", "ha=5%,dc=5%", "--robust"}, "5900"), {"weak"});
  fine(run({}));
  fine({"slice", "part.stl", "-o", "target.uvj", "--layer-um", "50", "--printer", "p.toml"});
  // A stack knows its resin, but not how it was measured.
  bad(2, {"verify", "out.uvj", "--target", "target.uvj", "--uncertain", "fit"},
      {"resin's file, which is not given"});
  bad(2, {"verify", "out.uvj", "--target", "target.uvj", "--uncertain-map", "m.png"},
      {"--uncertain"});
}

}  // namespace
}  // namespace slicecorr::test
