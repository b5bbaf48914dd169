// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A resin that shrinks, through the programs: parts are made larger once, what was not made for it is told, prints come
/// out as designed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "hook.hpp"
#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class ShrinkageProgram : public ProgramFixture {
 protected:
  ShrinkageProgram() {
    // Seconds of work; other tests and builds may run beside it.
    options_.timeout = std::chrono::minutes(5);
    write_stl(folder_ / "hook.stl", hook());
    write("small.toml", kSmallPrinter);
    write("plain.toml", resin_text("plain", 600, 576));
    write("shrinks.toml", resin_text("shrinks", 600, 576,
                                     "[shrinkage]\nplane = 2\nz = 3\n[first_layers]\ngrowth_um = "
                                     "80\nheight_um = 300\n"));
  }
  RunResult slice(const std::string& output, const Command& more = {}) const {
    return good(
        Command{"slice", "hook.stl", "-o", output, "--layer-um", "50", "--printer", "small.toml"} +
        more);
  }
  RunResult correct(const std::string& target, const std::string& output,
                    const std::string& resin) const {
    return good({"correct", target, "-o", output, "--printer", "small.toml", "--resin", resin,
                 "--speed-mm-h", "600"});
  }
  json info(const std::string& stack) const {
    return json::parse(good({"info", stack, "--json", "-"}).out);
  }
};

TEST_F(ShrinkageProgram, PartsAreMadeLargerOnceAndToldSo) {
  slice("plain.uvj");
  const RunResult larger = slice("larger.uvj", {"--resin", "shrinks.toml"});
  EXPECT_THAT(larger.out + larger.err,
              AllOf(HasSubstr("1.0204"), HasSubstr("1.0309"), HasSubstr("first layers")));
  EXPECT_FALSE(info("plain.uvj").contains("made_for"));
  const json made = info("larger.uvj")["made_for"];
  EXPECT_EQ(made["plane_per_cent"], 2);
  EXPECT_EQ(made["z_per_cent"], 3);
  EXPECT_EQ(made["first_layers_growth_um"], 80);
  // 3 mm / 0.97 are 62 slices.
  EXPECT_EQ(info("plain.uvj")["layers"], 60);
  EXPECT_EQ(info("larger.uvj")["layers"], 62);
  // What fits is silent, what does not is told; both may be corrected.
  RunResult r = correct("larger.uvj", "a.uvj", "shrinks.toml");
  EXPECT_THAT(r.err + r.out, Not(HasSubstr("slice the mesh anew")));
  EXPECT_EQ(info("a.uvj")["made_for"], made);
  EXPECT_EQ(info("a.uvj")["shrinkage"], made);
  r = correct("plain.uvj", "b.uvj", "shrinks.toml");
  EXPECT_THAT(r.err + r.out, AllOf(HasSubstr("does not shrink"), HasSubstr("slice the mesh anew")));
  r = correct("larger.uvj", "c.uvj", "plain.toml");
  EXPECT_THAT(r.err + r.out, HasSubstr("slice the mesh anew"));
}

TEST_F(ShrinkageProgram, PrintsComeOutAsDesigned) {
  good({"run", "hook.stl", "-o", "part.uvj", "--layer-um", "50", "--printer", "small.toml",
        "--resin", "shrinks.toml", "--speed-mm-h", "600"});
  EXPECT_EQ(json::parse(to_text(read_file(folder_ / "part.json")))["made_for"]["z_per_cent"], 3);
  slice("plain-target.uvj");
  correct("plain-target.uvj", "plain.uvj", "shrinks.toml");
  // Both printed with the resin as it is, and measured against the design.
  const auto off = [&](const std::string& stack) {
    good({"solid", stack, "-o", "printed.ply"});
    const json j = json::parse(good({"scan", "compare", "printed.ply", "--stack", stack, "--design",
                                     "hook.stl", "--json", "-"})
                                   .out);
    // The scan is what was predicted.
    EXPECT_LT(j["deviations"][1]["max_abs_um"].get<double>(), 0.01);
    return j["deviations"][0]["mean_abs_um"].get<double>();
  };
  const double made_for_it = off("part.uvj"), not_made_for_it = off("plain.uvj");
  // Half of 2 % of 2.2 mm and of 3 % of 3 mm are 22 and 45 um at the ends; walls lie to a third of a pixel of 50 um.
  EXPECT_GT(not_made_for_it, 15);
  EXPECT_LT(made_for_it, 0.6 * not_made_for_it);
}

TEST_F(ShrinkageProgram, AScanFindsItAndTheNextPrintIsMadeForIt) {
  slice("target.uvj");
  correct("target.uvj", "part.uvj", "plain.toml");
  // Growth is sought up to 500 um, which a resin's file that says none has.
  write("grows.toml",
        resin_text("grows", 600, 576,
                   "[shrinkage]\nplane = 2\nz = 3\n[first_layers]\ngrowth_um = 80\n"));
  good({"solid", "part.uvj", "-o", "printed.ply", "--resin", "grows.toml"});
  const RunResult r = good({"tune", "--scan", "printed.ply", "--stack", "part.uvj", "--printer",
                            "small.toml", "--resin", "plain.toml", "-o", "tuned.toml", "--next",
                            "part2.uvj", "--target", "hook.stl"});
  EXPECT_THAT(r.out, AllOf(HasSubstr("slices of meshes count it"),
                           HasSubstr("not sought: light that spreads")));
  const json made = info("part2.uvj")["made_for"];
  EXPECT_NEAR(made["plane_per_cent"].get<double>(), 2, 0.3) << r.out;
  EXPECT_NEAR(made["z_per_cent"].get<double>(), 3, 0.3) << r.out;
  EXPECT_NEAR(made["first_layers_growth_um"].get<double>(), 80, 30) << r.out;
}

}  // namespace
}  // namespace slicecorr::test
