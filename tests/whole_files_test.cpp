/// Outputs appear whole or not at all, also when programs are killed; folders and zips that are
/// written again; what the names of entries may hold.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <filesystem>
#include <random>

#include "ladder.hpp"
#include "post_fixture.hpp"
#include "run_program.hpp"
#include "slicecorr/pipeline.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class WholeFiles : public PostFolder {
 protected:
  RunResult slicecorr(const Command& arguments,
                      std::chrono::milliseconds timeout = std::chrono::seconds(60)) const {
    RunOptions options = options_;
    options.timeout = timeout;
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr"} + arguments, options);
  }
  RunResult sound(const Command& arguments) const {
    RunResult r = slicecorr(arguments);
    EXPECT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
    return r;
  }
  /// Names of temporary files in the folder.
  std::vector<std::string> left_over() const {
    std::vector<std::string> names;
    for (const auto& e : std::filesystem::directory_iterator(folder_.path())) {
      const std::string name = e.path().filename().string();
      if (name.find(".part") != std::string::npos) names.push_back(name);
    }
    return names;
  }
};

TEST_F(WholeFiles, AKilledRunLeavesNoPageOfAnotherStack) {
  TriangleMesh block;
  add_box(block, {-2, -1, 0}, {2, 1, 2});
  write_stl(folder_ / "a.stl", ladder());
  write_stl(folder_ / "b.stl", block);
  const auto run = [&](const std::string& part, const std::string& to) {
    return Command{"run",        part + ".stl", "-o",           to + ".uvj",
                   "--layer-um", "20",          "--speed-mm-h", "800"} +
           kSmall;
  };
  const std::vector<std::string> kinds{".uvj", ".json", ".html"};
  for (const char* part : {"a", "b"}) {
    sound(run(part, "out"));
    for (const std::string& kind : kinds) {
      std::filesystem::rename(folder_ / ("out" + kind), folder_ / (part + kind));
    }
  }
  const auto begin = std::chrono::steady_clock::now();
  sound(run("b", "out"));
  const std::chrono::duration<double, std::milli> whole = std::chrono::steady_clock::now() - begin;
  std::string now = "b";
  std::mt19937 random(3);
  int killed = 0;
  for (int round = 0; round < 40; ++round) {
    const std::string next = now == "a" ? "b" : "a";
    std::uniform_real_distribution<double> share(0.3, 1.1);
    const RunResult r =
        slicecorr(run(next, "out"),
                  std::chrono::milliseconds(1 + static_cast<int>(whole.count() * share(random))));
    killed += r.timed_out;
    const Bytes stack = bytes("out.uvj");
    const std::string is = stack == bytes("a.uvj") ? "a" : "b";
    ASSERT_EQ(stack, bytes(is + ".uvj"));
    // What lies beside it is of it, or is not there.
    for (const char* kind : {".json", ".html"}) {
      if (there(std::string("out") + kind)) {
        EXPECT_EQ(bytes(std::string("out") + kind), bytes(is + kind))
            << kind << " of another stack";
      }
    }
    if (!r.timed_out) {
      EXPECT_EQ(is, next);
    }
    now = is;
  }
  EXPECT_GT(killed, 3);
  sound(run("a", "out"));
  for (const std::string& kind : kinds) EXPECT_EQ(bytes("out" + kind), bytes("a" + kind)) << kind;
  EXPECT_EQ(left_over(), std::vector<std::string>{});
}

TEST_F(WholeFiles, WhatKilledProcessesLeftIsRemovedByTheNext) {
  make_sl1(folder_ / "part.sl1");
  sound({"convert", "part.sl1", "-o", "out.uvj"});
  // One that is no more, one that is; and one for another file.
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ::waitpid(child, nullptr, 0);
  const std::string dead = fmt::format(".out.uvj.{}-0.part", child);
  const std::string living = fmt::format(".out.uvj.{}-0.part", ::getpid());
  const std::string other = fmt::format(".mine.uvj.{}-0.part", child);
  for (const std::string& name : {dead, dead + ".a1B2c3", living, other}) write(name, "x");
  sound({"convert", "part.sl1", "-o", "out.uvj"});
  EXPECT_THAT(left_over(), testing::UnorderedElementsAre(living, other));
  write(fmt::format(".page.html.{}-7.part", child), "x");
  sound({"correct", "out.uvj", "-o", "c.uvj", "--speed-mm-h", "800", "--printer", "small.toml",
         "--resin", "figure-2-2", "--ha-um", "110"});
  sound({"report", "c.uvj", "--target", "out.uvj", "-o", "page.html"});
  EXPECT_THAT(left_over(), testing::UnorderedElementsAre(living, other));
}

TEST_F(WholeFiles, AFolderOfSlicesIsOursToReplaceAndKeepsItsSizes) {
  make_sl1(folder_ / "part.sl1");
  sound({"convert", "part.sl1", "-o", "slices/"});
  EXPECT_TRUE(there("slices/slicecorr.json"));
  // The second time, and with what is in it as its own.
  const RunResult again = sound({"convert", "part.sl1", "-o", "slices/"});
  EXPECT_THAT(again.err, HasSubstr("exposure times"));
  const StackInfo info = StackReader::read_info(folder_ / "slices");
  EXPECT_EQ(info.kind, StackKind::foreign);
  EXPECT_EQ(info.grid.layer_um, 50);
  EXPECT_EQ(info.grid.pixel_x_um, 50);
  sound({"convert", "slices", "-o", "back.uvj"});
  EXPECT_EQ(read_images(StackReader(folder_ / "back.uvj", folder_.path())),
            read_images(StackReader(folder_ / "part.sl1", folder_.path())));
  EXPECT_EQ(StackReader::read_info(folder_ / "back.uvj").kind, StackKind::foreign);
  // Images in it may be painted on: nothing was promised of them.
  write_file(folder_ / "slices/00000003.png",
             encode_png(GreyImage{160, 120, Bytes(160 * 120, 255)}));
  EXPECT_THAT(sound({"convert", "slices", "-o", "painted.uvj"}).err, Not(HasSubstr("changed")));
  // A folder of others is still not replaced.
  std::filesystem::create_directory(folder_ / "mine");
  write_file(folder_ / "mine/00000000.png", encode_png(GreyImage{2, 1, {7, 9}}));
  const RunResult r = slicecorr({"convert", "part.sl1", "-o", "mine/"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("was not written by slicecorr"));
}

TEST_F(WholeFiles, ANameThatFitsSeveralFormatsIsTakenForThatOfTheInput) {
  make_sl1(folder_ / "part.sl1");
  sound({"convert", "part.sl1", "-o", "in.zip", "--format", "chitubox"});
  const Command how = Command{"--speed-mm-h", "800"} + kSmall;
  sound(Command{"correct", "in.zip", "-o", "out.zip"} + how);
  EXPECT_EQ(StackReader::read_info(folder_ / "out.zip").format, "chitubox");
  // With an input of another format it is still to be said.
  const RunResult r = slicecorr(Command{"correct", "part.sl1", "-o", "other.zip"} + how);
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("several formats end like this"));
  // What the printers of one maker call their archives.
  sound(Command{"correct", "part.sl1", "-o", "out.m1"} + how);
  EXPECT_EQ(StackReader::read_info(folder_ / "out.m1").format, "sl1");
}

TEST_F(WholeFiles, AZeroByteInANameIsRefused) {
  make_sl1(folder_ / "part.sl1");
  Bytes data = bytes("part.sl1");
  const std::string name = "notes of someone else.bin";
  int changed = 0;
  for (auto at = data.begin();; ++changed) {
    at = std::search(at, data.end(), name.begin(), name.end());
    if (at == data.end()) break;
    at[5] = 0;
  }
  ASSERT_EQ(changed, 2);
  write_file(folder_ / "zero.sl1", data);
  for (const Command& command :
       {Command{"info", "zero.sl1"},
        Command{"correct", "zero.sl1", "-o", "o.sl1", "--speed-mm-h", "800"} + kSmall}) {
    const RunResult r = slicecorr(command);
    EXPECT_EQ(r.exit_code, 2);
    EXPECT_THAT(r.err, HasSubstr("zero byte"));
  }
  // A blank is a blank.
  sound({"info", "part.sl1"});
}

TEST_F(WholeFiles, PrintFilesOfTheNordinGroupAreKnownInTheirFolder) {
  Entries entries;
  entries.emplace_back("printfile/print_settings.json",
                       to_bytes("{\"Header\": {\"Schema version\": \"5.0\"}, "
                                "\"Default layer settings\": {}, \"Layers\": []}"));
  entries.emplace_back("slices/0000.png", encode_png(GreyImage{2, 1, {7, 9}}));
  make_zip(folder_ / "n.zip", entries);
  const RunResult r = slicecorr({"info", "n.zip"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, AllOf(HasSubstr("printfile/print_settings.json"), HasSubstr("Nordin group")));
}

TEST_F(WholeFiles, FoldersWhereNothingMayBeWrittenAreNamed) {
  make_sl1(folder_ / "part.sl1");
  std::filesystem::create_directory(folder_ / "closed");
  std::filesystem::permissions(folder_.path(), std::filesystem::perms(0755));
  std::filesystem::permissions(folder_ / "closed", std::filesystem::perms(0555));
  RunOptions options = options_;
  options.unprivileged = true;
  for (const char* output : {"closed/o.uvj", "closed/o.tar.gz", "closed/o/"}) {
    const RunResult r =
        run_program({SLICECORR_BIN_DIR "/slicecorr", "convert", "part.sl1", "-o", output}, options);
    EXPECT_EQ(r.exit_code, 4) << output;
    EXPECT_THAT(r.err, AllOf(HasSubstr("closed/o"), HasSubstr("Permission denied"),
                             Not(HasSubstr(".part")), Not(HasSubstr("convert: done"))));
  }
  // In place, in a folder that is closed.
  std::filesystem::permissions(folder_ / "closed", std::filesystem::perms(0755));
  std::filesystem::copy_file(folder_ / "part.sl1", folder_ / "closed/part.sl1");
  std::filesystem::permissions(folder_ / "closed", std::filesystem::perms(0555));
  const RunResult r = run_program(
      Command{SLICECORR_BIN_DIR "/slicecorr-post"} + kSmall + Command{"closed/part.sl1"}, options);
  EXPECT_EQ(r.exit_code, 4);
  EXPECT_THAT(r.err, AllOf(HasSubstr("closed"), HasSubstr("Permission denied"),
                           Not(HasSubstr("correct: done"))));
  std::filesystem::permissions(folder_ / "closed", std::filesystem::perms(0755));
}

}  // namespace
}  // namespace slicecorr::test
