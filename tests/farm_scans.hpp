// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_scans.hpp
/// A farm with a job whose print was made with another resin than was believed, and its scan.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "farm_fixture.hpp"
#include "hook.hpp"
#include "ladder.hpp"
#include "slicecorr/farm/scans.hpp"

namespace slicecorr::test {

/// A hook that was corrected for 600 um and printed with 636.
class FarmScans : public FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    write_stl(dir / "hook.stl", hook());
    fs::create_directories(dir / "db/printers");
    write_file(dir / "db/believed.toml", resin_text("believed", 600, 576));
    write_file(dir / "db/printers/small.toml", kSmallPrinterToml);
    ::setenv("SLICECORR_DB", (dir / "db").c_str(), 1);
    write_file(dir / "real.toml", resin_text("real", 636, 576 * 1.04 / 1.06));
    const RunResult r = farm("submit", {dir / "hook.stl", "--printer", "small", "--resin",
                                        "believed", "--layer-um", "50", "--speed-mm-h", "600"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    quick_settings();
  }
  void TearDown() override { ::unsetenv("SLICECORR_DB"); }
  void print_and_scan() {
    ASSERT_EQ(run_all().exit_code, 0);
    const RunResult r = program(
        "slicecorr", {"solid", stack(1), "-o", dir / "printed.ply", "--resin", dir / "real.toml"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  std::string stack(farm::JobId id) const {
    return farm::stack_of(*farm::ReadModel(database()).job(id));
  }
  std::vector<farm::KeptScan> kept() const { return farm::ReadModel(database()).scans(); }
  double off(const std::string& stack) const {
    const RunResult r =
        program("slicecorr", {"verify", stack, "--target", dir / "target.uvj", "--printer",
                              dir / "small.toml", "--resin", dir / "real.toml", "--json", "-"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return nlohmann::json::parse(r.out)["height_error_um"]["mean_abs"];
  }
};

}  // namespace slicecorr::test
