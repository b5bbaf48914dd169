// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a refusal of printbridge says is to be typed works when it is typed.

#include <gmock/gmock.h>

#include <regex>

#include "bridge_fixture.hpp"

namespace slicecorr {
namespace {

using namespace slicecorr::test;
using testing::HasSubstr;

TEST_F(BridgePrograms, NumbersOfARefusalWorkWhenTheyAreTyped) {
  part_cell_mm = 1;
  // The lamp can be as dim as it likes, and the machine asks less often than it might.
  const std::string printer = make_printer("typed", {{"min_share = 0.02", "min_share = 0"}});
  Sim sim = start_sim(printer, true);
  const auto tried = [&](const std::string& name, std::vector<std::string> more) {
    more.insert(more.begin(), {"--resin", "figure-2-2"});
    return run_program(
        print_command(make_stack(printer, name, more), printer, sim, true, {"--dry-run"}));
  };
  // Speeds whose ramps have more digits than are told, on both sides of rounding.
  for (const char* const speed : {"1998", "1777", "1903.7"}) {
    SCOPED_TRACE(speed);
    const RunResult refused = tried("part", {"--speed-mm-h", speed, "--ramp", "none"});
    ASSERT_EQ(refused.exit_code, 3) << refused.err;
    std::smatch found;
    ASSERT_TRUE(std::regex_search(refused.err, found, std::regex("--ramp-mm ([0-9.]+)")))
        << refused.err;
    const std::string told = found[1].str();
    const RunResult typed =
        tried("part", {"--speed-mm-h", speed, "--ramp", "lamp-follows", "--ramp-mm", told});
    EXPECT_EQ(typed.exit_code, 0) << told << "\n" << typed.err;
    // It is no more than it must be: a hundredth less is refused, and that refusal's number is the same.
    const RunResult less = tried("part", {"--speed-mm-h", speed, "--ramp", "lamp-follows",
                                          "--ramp-mm", std::to_string(std::stod(told) * 0.99)});
    EXPECT_EQ(less.exit_code, 3);
    EXPECT_THAT(less.err, HasSubstr("--ramp-mm " + told + " or more"));
  }
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
}

TEST_F(BridgePrograms, WhatIsPlannedIsPrintedWithoutAFurtherOption) {
  part_cell_mm = 1;
  struct Machine {
    const char *name, *resin, *limit;
    std::vector<std::pair<std::string, std::string>> changes;
  };
  const std::vector<Machine> machines{
      {"shipped", "figure-2-2", "stage", {}},
      // Faster stages: the exchanges decide, or ramps that the lamp can't follow.
      {"cycles",
       "figure-2-2",
       "machine",
       {{"cycle_s = 0.01", "cycle_s = 0.05"}, {"max_speed_mm_h = 2000", "max_speed_mm_h = 20000"}}},
      {"ramps",
       "figure-2-2",
       "machine",
       {{"min_share = 0.02", "min_share = 0.3"},
        {"max_speed_mm_h = 2000", "max_speed_mm_h = 20000"}}},
      {"slices",
       "figure-2-2",
       "",
       {{"acceleration_mm_s2 = 1.0", "acceleration_mm_s2 = 0.3\nvariable_speed = true"}}}};
  for (const Machine& m : machines) {
    SCOPED_TRACE(m.name);
    const std::string printer = make_printer(m.name, m.changes);
    const std::string speeds = folder / (std::string(m.name) + ".csv");
    std::vector<std::string> ask{program("slicecorr"),
                                 "plan",
                                 make_part(),
                                 "--printer",
                                 printer,
                                 "--resin",
                                 m.resin,
                                 "--layer-um",
                                 "50",
                                 "--antialias",
                                 "off",
                                 "--json",
                                 "-",
                                 "--quiet",
                                 "--gap-contrast",
                                 "0",
                                 "--edge-aim-um",
                                 "0.5",
                                 "--tolerance-um",
                                 "25"};
    const bool varies = m.limit[0] == 0;
    if (varies) ask.insert(ask.end(), {"--slice-speeds", speeds});
    const RunResult planned = run_program(ask);
    ASSERT_EQ(planned.exit_code, 0) << planned.err;
    const auto plan = nlohmann::json::parse(planned.out);
    if (!varies) {
      EXPECT_EQ(plan["limited_by"], m.limit) << plan["limit"];
    }
    std::vector<std::string> with{"--resin", m.resin, "--edge-aim-um", "0.5"};
    double speed = plan["speed_mm_h"];
    if (varies && !plan["slice_speed_mm_h"].empty()) {
      for (const double v : plan["slice_speed_mm_h"]) speed = std::max(speed, v);
      with.insert(with.end(), {"--slice-speed-mm-h", speeds, "--slice-lamps",
                               plan["along_z"]["lamps"].get<std::string>()});
    }
    // With a further option or two these speeds would be refused.
    EXPECT_GT(speed, 500);
    with.insert(with.end(), {"--speed-mm-h", nlohmann::json(speed).dump()});
    Sim sim = start_sim(printer, true);
    const RunResult printed = run_program(
        print_command(make_stack(printer, m.name, with), printer, sim, true, {"--dry-run"}));
    EXPECT_EQ(printed.exit_code, 0) << speed << " mm/h\n" << printed.err;
    EXPECT_EQ(sim.child->end(SIGTERM), 0);
  }
}

TEST_F(BridgePrograms, WhatTheMachineRefusesIsSaidBeforeTheWork) {
  part_cell_mm = 1;
  const std::string printer = make_printer("slow", {{"cycle_s = 0.01", "cycle_s = 0.09"}});
  make_stack(printer, "slow", {"--resin", "figure-2-2", "--speed-mm-h", "500"});
  const auto corrected = [&](const std::string& speed, std::vector<std::string> more) {
    more.insert(more.begin(), {program("slicecorr"), "correct", folder / "slow-target.uvj", "-o",
                               folder / "told.uvj", "--printer", printer, "--resin", "figure-2-2",
                               "--speed-mm-h", speed});
    return run_program(more);
  };
  // 3 exchanges of 90 ms: 50 um in 0.27 s are 666.67 mm/h.
  const RunResult fast = corrected("700", {});
  EXPECT_EQ(fast.exit_code, 0);
  EXPECT_THAT(fast.err,
              HasSubstr("printbridge will refuse this print: a slice of 50 um passes in"));
  EXPECT_THAT(fast.err, HasSubstr("print at 666.66 mm/h or slower"));
  EXPECT_THAT(corrected("666.66", {}).err, testing::Not(HasSubstr("refuse")));
  EXPECT_THAT(corrected("2000", {"--ramp", "none"}).err, HasSubstr("will refuse"));
}

// Lamps that warm up behind black, shine behind black around exposures, or give UV light within a range.
TEST_F(BridgePrograms, WhatTheLampsRefuseIsSaidBeforeTheWork) {
  part_cell_mm = 1;
  struct Case {
    const char* name;
    std::vector<std::pair<std::string, std::string>> changes;
    std::vector<std::string> with;
    const char* words;
  };
  const std::vector<std::string> layers{"--resin", "figure-2-2", "--mode",       "layerwise",
                                        "--lifts", "none",       "--exposure-s", "1"};
  const std::vector<Case> cases{
      {"warm",
       {{"settle_s = 0.005\nwarm_up_s = 0", "settle_s = 0.005\nwarm_up_s = 900"}},
       {"--resin", "figure-2-2", "--speed-mm-h", "500"},
       "the blue lamp warms up for 900 s behind black, which still gives 1 mW/cm²"},
      {"dim",
       {{"[lamps.uv]\n", "[lamps.uv]\nmin_share = 0.9\n"}},
       {"--resin", "custom-resin-1", "--speed-mm-h", "60", "--uv-mw-cm2", "200"},
       "the stack asks for 200 to 200 mW/cm² of UV light, the lamp of printer"},
      {"slow",
       {{"settle_s = 0.005\nwarm_up_s = 0", "settle_s = 20\nwarm_up_s = 0.1"}},
       layers,
       "shines behind black for 20055 ms more in each layer (cycle_s, warm_up_s)"}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    const std::string printer = make_printer(c.name, c.changes);
    const std::string stack = make_stack(printer, c.name, c.with);
    std::vector<std::string> again{program("slicecorr"),
                                   "correct",
                                   folder / (std::string(c.name) + "-target.uvj"),
                                   "-o",
                                   folder / "told.uvj",
                                   "--printer",
                                   printer};
    again.insert(again.end(), c.with.begin(), c.with.end());
    EXPECT_THAT(run_program(again).err,
                HasSubstr(std::string("printbridge will refuse this print: ")));
    EXPECT_THAT(run_program(again).err, HasSubstr(c.words));
    if (c.name == std::string("warm")) {
      const RunResult planned = run_program({program("slicecorr"), "plan", make_part(), "--printer",
                                             printer, "--resin", "figure-2-2", "--layer-um", "50",
                                             "--antialias", "off", "--gap-contrast", "0"});
      EXPECT_EQ(planned.exit_code, 3) << planned.out;
      EXPECT_THAT(planned.err, HasSubstr(c.words));
    }
    Sim sim = start_sim(printer, true);
    const RunResult refused = run_program(print_command(stack, printer, sim, true, {"--dry-run"}));
    EXPECT_EQ(refused.exit_code, 3) << refused.err;
    EXPECT_THAT(refused.err, HasSubstr(c.words));
    EXPECT_EQ(sim.child->end(SIGTERM), 0);
  }
}

}  // namespace
}  // namespace slicecorr
