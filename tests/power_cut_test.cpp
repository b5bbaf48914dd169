// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// After a power cut a name leads to what was written under it: what has a new name is on the disk before it has it, and
// the name is there when the program says that it has ended well. Judged by the calls to the system, in their order.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>

#include "ladder.hpp"
#include "post_fixture.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

namespace fs = std::filesystem;

class PowerCut : public PostFolder {
 protected:
  /// Runs the program and judges its calls; returns the names, below the folder, that it gave.
  std::set<std::string> judged(const Command& command) {
    const std::string log = folder_ / "power.log";
    fs::remove(log);
    RunOptions options = options_;
    options.environment["LD_PRELOAD"] = SLICECORR_POWER_CUT;
    options.environment["ASAN_OPTIONS"] = "verify_asan_link_order=0";
    options.environment["POWER_LOG"] = log;
    const RunResult r = run_program(command, options);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    using Known = std::pair<std::uint64_t, std::uint64_t>;
    std::map<Known, bool> on_disk;        // of files that were written or waited for
    std::map<Known, std::string> unsaid;  // folders with names that may be lost
    std::set<std::string> names;
    std::ifstream in(log);
    for (std::string what; in >> what;) {
      Known file;
      in >> file.first >> file.second;
      if (what == "W") on_disk[file] = false;
      if (what == "S") {
        on_disk[file] = true;
        unsaid.erase(file);
      }
      if (what != "R") continue;
      Known folder;
      std::string name;
      in >> folder.first >> folder.second;
      std::getline(in >> std::ws, name);
      names.insert(fs::path(name).filename());
      if (is_given_up(name)) continue;
      const auto seen = on_disk.find(file);
      EXPECT_TRUE(seen != on_disk.end() && seen->second) << fmt::format(
          "{}: {} has its name before its bytes are on the disk", fmt::join(command, " "), name);
      unsaid[folder] = name;
    }
    for (const auto& [folder, name] : unsaid) {
      ADD_FAILURE() << fmt::format("{}: {} may lose its name", fmt::join(command, " "), name);
    }
    return names;
  }
  /// What a power cut may spoil: of an attempt that it ends nothing is believed, entries of the cache are compared with
  /// their hashes before they are used, and logs are for people.
  static bool is_given_up(const std::string& name) {
    // What has a temporary name is nothing yet; who changes a file begins with a second name of it.
    return name.ends_with(".part") || name.find("/farm/store/attempts/") != name.npos ||
           name.find("/farm/store/cache/") != name.npos || name.find("/farm/logs/") != name.npos;
  }
  static Command program(const char* name) { return {std::string(SLICECORR_BIN_DIR) + "/" + name}; }
};

TEST_F(PowerCut, WhatProgramsWriteIsWhole) {
  using testing::Contains;
  write_stl(folder_ / "part.stl", ladder());
  make_sl1(folder_ / "part.sl1");
  const Command ours = program("slicecorr"), at{"--speed-mm-h", "800"};
  EXPECT_THAT(judged(ours + Command{"slice", "part.stl", "-o", "t.uvj", "--layer-um", "50",
                                    "--printer", "small.toml"}),
              Contains("t.uvj"));
  EXPECT_THAT(judged(ours + Command{"correct", "t.uvj", "-o", "c.uvj"} + at + kSmall),
              Contains("c.uvj"));
  EXPECT_THAT(
      judged(ours + Command{"run", "part.stl", "-o", "r.uvj", "--layer-um", "50"} + at + kSmall),
      Contains("r.uvj"));
  EXPECT_THAT(judged(ours + Command{"convert", "part.sl1", "-o", "part.tar.gz"}),
              Contains("part.tar.gz"));
  EXPECT_THAT(judged(ours + Command{"report", "c.uvj", "--target", "t.uvj", "-o", "page.html"}),
              Contains("page.html"));
  EXPECT_THAT(judged(ours + Command{"solid", "c.uvj", "-o", "solid.stl"}), Contains("solid.stl"));
  EXPECT_THAT(judged(program("slicecorr-post") + kSmall + Command{"part.sl1"}),
              Contains("part.sl1"));
}

TEST_F(PowerCut, WhatTheFarmDeliversIsWhole) {
  write_stl(folder_ / "part.stl", ladder());
  const Command farm = program("slicefarm");
  judged(farm +
         Command{"submit", "part.stl", "--dir", "farm", "--layer-um", "50", "--speed-mm-h", "800",
                 "--out", "out"} +
         kSmall);
  EXPECT_THAT(judged(farm + Command{"run", "--dir", "farm", "--until-empty"}),
              testing::Contains("part.uvj"));
}

}  // namespace
}  // namespace slicecorr::test
