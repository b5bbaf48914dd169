// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_scanned.hpp
/// For pages: a job of the user `sam` that is done, and a scan of its print, made with another resin than was believed.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "farm_filled.hpp"
#include "hook.hpp"
#include "ladder.hpp"
#include "run_program.hpp"
#include "slicecorr/farm/job.hpp"

namespace slicecorr::farm::test {

inline constexpr const char* kScannedPrinter =
    "name = \"small\"\n[display]\nwidth_px = 96\nheight_px = 64\npixel_um = 50.0\n[blue]\ncalibration = "
    "[[0, 1.0], [255, 100.0]]\n";

/// Runs the programs; $SLICECORR_DB is a folder of the test's own. Gives the path of the scan, of job 1.
inline std::string print_and_scan_hook(const Farm& farm) {
  using slicecorr::test::resin_text;
  const std::string db = std::getenv("SLICECORR_DB"), at = farm.root;
  write_file(db + "/printers/small.toml", kScannedPrinter);
  write_file(db + "/believed.toml", resin_text("believed", 600, 576));
  write_file(at + "/real.toml", resin_text("real", 636, 576 * 1.04 / 1.06));
  slicecorr::test::write_stl(at + "/hook.stl", slicecorr::test::hook());
  const auto run = [](const slicecorr::test::Command& arguments) {
    slicecorr::test::RunOptions options;
    options.environment["USER"] = "sam";
    const auto r = slicecorr::test::run_program(arguments, options);
    EXPECT_EQ(r.exit_code, 0) << r.err;
  };
  const std::string slicefarm = std::string(SLICECORR_BIN_DIR) + "/slicefarm";
  run({slicefarm, "set", "--dir", at, "min-free-mb=0"});
  run({slicefarm, "submit", at + "/hook.stl", "--dir", at, "--printer", "small", "--resin",
       "believed", "--layer-um", "50", "--speed-mm-h", "600"});
  run({slicefarm, "run", "--until-empty", "--dir", at});
  run({std::string(SLICECORR_BIN_DIR) + "/slicecorr", "solid",
       stack_of(*ReadModel(farm.folder.database()).job(1)), "-o", at + "/printed.ply", "--resin",
       at + "/real.toml"});
  return at + "/printed.ply";
}

}  // namespace slicecorr::farm::test
