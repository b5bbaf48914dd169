// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Keys of printer and resin files with a slip in them, through the programs: they count for nothing, and
/// whoever reads the file says so.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* kOfPrinter =
    "slip.toml:9: stage.max_sped_mm_h: unknown key; did you mean 'max_speed_mm_h'? It counts for nothing";
constexpr const char* kOfResin =
    "goo.toml:6: cure.dose_facto: unknown key; did you mean 'dose_factor'? It counts for nothing";

class UnreadWordsProgram : public ProgramFixture {
 protected:
  UnreadWordsProgram() {
    write_stl(folder_ / "ladder.stl", ladder());
    const std::string stage = std::string(kSmallPrinter) + "[stage]\n";
    write("slip.toml", stage + "max_sped_mm_h = 500\n");
    write("right.toml", stage + "max_speed_mm_h = 500\n");
    write("goo.toml",
          "name = \"goo\"\n[cure]\nabsorbance_height_um = 400\nabsorbance_base = 10\n"
          "gel_dose_mj_cm3 = 100\ndose_facto = 2\n");
  }
  const Command kSlip{"--printer", "slip.toml", "--resin", "goo.toml"};
  const Command kSpeed{"--speed-mm-h", "800"};
};

TEST_F(UnreadWordsProgram, AreToldByWhoReadsTheFile) {
  for (const Command& command :
       {Command{"run", "ladder.stl", "-o", "out.uvj", "--layer-um", "50"} + kSlip + kSpeed,
        Command{"compare", "ladder.stl", "--layer-um", "50"} + kSlip + kSpeed,
        Command{"correct", "out-target.uvj", "-o", "again.uvj"} + kSlip + kSpeed,
        Command{"verify", "out.uvj", "--target", "out-target.uvj"} + kSlip + kSpeed,
        Command{"slice", "ladder.stl", "-o", "sliced.uvj", "--layer-um", "50"} + kSlip,
        Command{"testpart", "staircase", "-o", "part.uvj"} + kSlip}) {
    const RunResult r = call(command);
    EXPECT_THAT(r.err, HasSubstr(kOfPrinter)) << ::testing::PrintToString(command) << r.exit_code;
    EXPECT_THAT(r.err, HasSubstr(kOfResin)) << ::testing::PrintToString(command) << r.exit_code;
  }
  // It counts for nothing: the speed that was meant as a limit is none. As it should stand it is one.
  bad(2,
      Command{"run", "ladder.stl", "-o", "x.uvj", "--layer-um", "50", "--printer", "right.toml",
              "--resin", "goo.toml"} +
          kSpeed,
      {"500", "800"});
}

TEST_F(UnreadWordsProgram, NothingIsToldOfFilesWithoutASlip) {
  const RunResult r = good({"run", "ladder.stl", "-o", "out.uvj", "--layer-um", "50", "--printer",
                            "right.toml", "--resin", "benchy-resin", "--speed-mm-h", "400"});
  EXPECT_THAT(r.err, Not(HasSubstr("counts for nothing")));
}

}  // namespace
}  // namespace slicecorr::test
