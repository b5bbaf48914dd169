// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Inputs that are removed or cut short while they are read: at every call that opens or reads
/// them. Then the input is wrong (2), whatever was in work; what a program had read before is whole
/// (0).
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "ladder.hpp"
#include "post_fixture.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;
using testing::Not;

class SpoiltInputs : public PostFolder {
 protected:
  RunResult run_spoilt(const std::string& path, const Command& command, const char* how, long at) {
    RunOptions options = options_;
    options.timeout = std::chrono::seconds(60);
    options.environment["LD_PRELOAD"] = SLICECORR_SPOILER;
    // Sanitizers want to be first.
    options.environment["ASAN_OPTIONS"] = "verify_asan_link_order=0";
    options.environment["SPOIL_FILE"] = path;
    options.environment["SPOIL_AT"] = std::to_string(at);
    options.environment["SPOIL_HOW"] = how;
    return run_program(command, options);
  }
  /// Runs the command with its input spoilt at the first, the last and some of the other calls that
  /// open or read it, in each of these ways.
  void spoil_everywhere(const std::string& input, const Command& command, const std::string& output,
                        const std::vector<const char*>& ways = kWays) {
    // By night, at all calls of short reads and at many of long ones.
    const long first = rounds(2), last = rounds(4), between = rounds(2);
    const Bytes sound = bytes(input);
    const std::string path = folder_ / input;
    const RunResult all = run_spoilt(path, command, ways.front(), 0);
    ASSERT_EQ(all.exit_code, 0) << input << all.err;
    const Bytes told = bytes(input + ".calls");
    const long calls = std::stol(std::string(told.begin(), told.end()));
    ASSERT_GE(calls, 2);
    for (const char* how : ways) {
      int refused = 0;
      for (long at = 1; at <= calls;
           at += at < first || at > calls - last ? 1 : std::max(1L, calls / between)) {
        SCOPED_TRACE(fmt::format("{} {} at {} of {}: {}", input, how, at, calls, command[1]));
        std::filesystem::remove(path + ".spoilt");
        std::filesystem::remove(path);
        std::filesystem::remove_all(folder_ / output);
        write_file(path, sound);
        const RunResult r = run_spoilt(path, command, how, at);
        // Threads read in any order; the number of their calls may differ by a few.
        if (!std::filesystem::exists(path + ".spoilt")) continue;
        EXPECT_THAT(r.exit_code, testing::AnyOf(0, 2)) << r.err;
        if (r.exit_code != 0) {
          ++refused;
          EXPECT_THAT(r.err, HasSubstr(std::filesystem::path(input).filename().string()));
          EXPECT_THAT(r.err, Not(HasSubstr(".part")));
          EXPECT_THAT(r.err, Not(HasSubstr(".slicecorr-post-")));
          if (output != input) {
            EXPECT_FALSE(std::filesystem::exists(folder_ / output));
          }
        }
        if (HasFailure()) return;
      }
      EXPECT_GT(refused, 0) << input << " " << how;
    }
    write_file(path, sound);
  }
  static Command program(const char* name) { return {std::string(SLICECORR_BIN_DIR) + "/" + name}; }

  static inline const std::vector<const char*> kWays{"unlink", "truncate", "empty"};
};

TEST_F(SpoiltInputs, Meshes) {
  write_stl(folder_ / "part.stl", ladder());
  spoil_everywhere("part.stl",
                   program("slicecorr") +
                       Command{"slice", "part.stl", "-o", "o.uvj", "--layer-um", "20"} +
                       Command{"--printer", "small.toml"},
                   "o.uvj");
}

TEST_F(SpoiltInputs, Archives) {
  make_sl1(folder_ / "part.sl1");
  const Command how = Command{"--speed-mm-h", "800"} + kSmall;
  const Command ours = program("slicecorr");
  ASSERT_EQ(
      run_program(ours + Command{"convert", "part.sl1", "-o", "part.tar.gz"}, options_).exit_code,
      0);
  ASSERT_EQ(
      run_program(ours + Command{"convert", "part.sl1", "-o", "part.uvj"}, options_).exit_code, 0);
  // By day each archive and each command meets each way once, by night each pair of them all ways.
  const auto ways = [](std::size_t n) {
    return by_night() ? kWays : std::vector<const char*>{kWays[n % kWays.size()]};
  };
  const std::vector<std::string> inputs{"part.sl1", "part.uvj", "part.tar.gz"};
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const std::string& input = inputs[i];
    spoil_everywhere(input,
                     ours + Command{"convert", input, "-o", "o.uvj", "--printer", "small.toml"},
                     "o.uvj", ways(i));
    spoil_everywhere(input, ours + Command{"correct", input, "-o", "o.uvj"} + how, "o.uvj",
                     ways(i + 1));
    spoil_everywhere(input, ours + Command{"info", input, "--json", "o.json"}, "o.json",
                     ways(i + 2));
  }
  // The rest of the archive is kept.
  spoil_everywhere("part.sl1", ours + Command{"correct", "part.sl1", "-o", "o.sl1"} + how, "o.sl1",
                   ways(0));
  spoil_everywhere("part.tar.gz", ours + Command{"correct", "part.tar.gz", "-o", "o.tar.gz"} + how,
                   "o.tar.gz", ways(1));
}

TEST_F(SpoiltInputs, ArchivesInPlace) {
  make_sl1(folder_ / "part.sl1");
  spoil_everywhere("part.sl1", program("slicecorr-post") + kSmall + Command{"part.sl1"},
                   "part.sl1");
}

}  // namespace
}  // namespace slicecorr::test
