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
    const RunResult refused = tried("part", {"--speed-mm-h", speed});
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

}  // namespace
}  // namespace slicecorr
