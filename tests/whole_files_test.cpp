// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Outputs appear whole or not at all, also when programs are killed; folders and zips that are
/// written again; what the names of entries may hold.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <random>

#include "few_files.hpp"
#include "killed_after.hpp"
#include "ladder.hpp"
#include "post_fixture.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "stack_fixture.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"

namespace slicecorr::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class WholeFiles : public PostFolder {
 protected:
  static Command slicecorr_command(const Command& arguments) {
    return Command{SLICECORR_BIN_DIR "/slicecorr"} + arguments;
  }
  RunResult slicecorr(const Command& arguments) const {
    return run_program(slicecorr_command(arguments), options_);
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
  std::chrono::duration<double, std::micro> whole = std::chrono::steady_clock::now() - begin;
  std::string now = "b";
  std::mt19937 random(3);
  int killed = 0;
  const int rounds = by_night() ? test::rounds(16) : 10;
  for (int round = 0; round < rounds || (killed <= 3 && round < 6 * rounds); ++round) {
    const std::string next = now == "a" ? "b" : "a";
    std::uniform_real_distribution<double> share(0.3, 1.1);
    const bool hit = killed_after(
        slicecorr_command(run(next, "out")), options_,
        std::chrono::microseconds(static_cast<std::int64_t>(whole.count() * share(random))));
    killed += hit;
    // On a busy machine the first run took longer than the others do.
    if (!hit) whole *= 0.9;
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
    if (!hit) {
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
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ::waitpid(child, nullptr, 0);
  using detail::Maker, detail::text_of;
  const Maker we = detail::this_process();
  Maker dead = we, reborn = we, before = we, elsewhere = we;
  dead.pid = elsewhere.pid = child;
  ++reborn.started;  // our number had been another's
  before.boot ^= 1;  // before a power cut
  ++elsewhere.room;  // in a container of its own, whose processes we do not see
  const std::string stem = ".out.uvj.", end = "-0.part";
  const std::vector<std::string> gone{stem + text_of(dead) + end,
                                      stem + text_of(dead) + end + ".a1B2c3",
                                      stem + text_of(dead) + end + "-wal",
                                      stem + text_of(dead) + end + "-shm",
                                      stem + text_of(dead) + end + "-journal",
                                      stem + text_of(reborn) + end,
                                      stem + text_of(before) + end,
                                      ".mine.uvj." + text_of(dead) + end,
                                      std::string(detail::kWorkFolder) + text_of(dead) + "-a1B2c3"};
  const std::vector<std::string> kept{stem + text_of(we) + end, stem + text_of(elsewhere) + end,
                                      ".hers.part", ".his.12-3.part"};
  const auto leave = [&] {
    for (const auto* names : {&gone, &kept}) {
      for (const std::string& name : *names) {
        if (name.starts_with(detail::kWorkFolder)) {
          std::filesystem::create_directory(folder_ / name);
          write(name + "/out.uvj", "x");
        } else {
          write(name, "x");
        }
      }
    }
  };
  const auto hidden = [&] {
    std::vector<std::string> names;
    for (const auto& e : std::filesystem::directory_iterator(folder_.path())) {
      const std::string name = e.path().filename().string();
      if (name.front() == '.') names.push_back(name);
    }
    return names;
  };
  // Of any program that makes a file there.
  leave();
  sound({"convert", "part.sl1", "-o", "out.uvj"});
  EXPECT_THAT(hidden(), testing::UnorderedElementsAreArray(kept));
  leave();
  sound({"info", "part.sl1", "--json", "info.json"});
  EXPECT_THAT(hidden(), testing::UnorderedElementsAreArray(kept));
  leave();
  sound({"correct", "out.uvj", "-o", "c.uvj", "--speed-mm-h", "800", "--printer", "small.toml",
         "--resin", "figure-2-2", "--ha-um", "110"});
  EXPECT_THAT(hidden(), testing::UnorderedElementsAreArray(kept));
  leave();
  const RunResult post = run_program(
      Command{SLICECORR_BIN_DIR "/slicecorr-post"} + kSmall + Command{"part.sl1"}, options_);
  EXPECT_EQ(post.exit_code, 0) << post.err;
  EXPECT_THAT(hidden(), testing::UnorderedElementsAreArray(kept));
  // What was in work stays known to who watches the folder, for a day.
  const std::string work = gone.back();
  leave();
  write(work + "/in-work", std::string("theirs.sl1\0", 11));
  sound({"convert", "part.sl1", "-o", "out.uvj"});
  EXPECT_FALSE(there(work + "/out.uvj"));
  EXPECT_TRUE(there(work + "/in-work"));
  std::filesystem::last_write_time(
      folder_ / (work + "/in-work"),
      std::filesystem::file_time_type::clock::now() - std::chrono::hours(25));
  sound({"convert", "part.sl1", "-o", "out.uvj"});
  EXPECT_THAT(hidden(), testing::UnorderedElementsAreArray(kept));
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
                       to_bytes("{\"Header\": {\"Schema version\": \"5.0\"}, \"Default layer "
                                "settings\": {}, \"Layers\": []}"));
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

TEST_F(WholeFiles, OutputsThatMayNotBeWrittenAreRefusedBeforeTheWork) {
  namespace fs = std::filesystem;
  make_sl1(folder_ / "part.sl1");
  write_stl(folder_ / "part.stl", ladder());
  const Command how = Command{"--speed-mm-h", "800"} + kSmall;
  sound(Command{"correct", "part.sl1", "-o", "c.sl1"} + how);
  fs::permissions(folder_.path(), fs::perms(0755));
  fs::create_directory(folder_ / "closed");
  // Files that are write-protected in a folder that is not.
  fs::create_directory(folder_ / "open");
  fs::permissions(folder_ / "open", fs::perms(0777));
  const std::vector<std::string> names{"o.uvj",  "o.sl1", "o.tar.gz", "o.html",
                                       "o.json", "o.png", "o.stl",    "o.svg"};
  const std::string theirs = "not ours";
  for (const std::string folder : {"closed", "open"}) {
    for (const std::string& name : names) {
      write_file(folder_ / (folder + "/" + name), Bytes(theirs.begin(), theirs.end()));
      fs::permissions(folder_ / (folder + "/" + name), fs::perms(0444));
    }
  }
  fs::permissions(folder_ / "closed", fs::perms(0555));
  // As /tmp is: files of others may be written to, but not replaced.
  fs::create_directory(folder_ / "sticky");
  fs::permissions(folder_ / "sticky", fs::perms(01777));
  for (const std::string& name : names) {
    write_file(folder_ / ("sticky/" + name), Bytes(theirs.begin(), theirs.end()));
    fs::permissions(folder_ / ("sticky/" + name), fs::perms(0666));
  }
  fs::create_directory(folder_ / "own");
  fs::permissions(folder_ / "own", fs::perms(0777));
  RunOptions options = options_;
  options.unprivileged = true;
  const Command slicecorr{SLICECORR_BIN_DIR "/slicecorr"};
  const Command mesh{"--printer", "small.toml", "--layer-um", "20"};
  // By day each command tries one of the three folders, by night all.
  std::size_t turn = 0;
  for (const std::string folder : {"closed", "open", "sticky"}) {
    if (folder == "sticky" && ::geteuid() != 0) continue;  // all files are ours
    ++turn;
    const auto at = [&](const char* name) { return folder + "/" + name; };
    const Command of_target = Command{"--target", "part.sl1"};
    std::size_t number = turn + 1;
    for (const auto& [command, named] : std::vector<std::pair<Command, std::string>>{
             {Command{"slice", "part.stl", "-o", at("o.uvj")} + mesh, at("o.uvj")},
             {Command{"correct", "part.sl1", "-o", at("o.sl1")} + how, at("o.sl1")},
             {{"convert", "part.sl1", "-o", at("o.tar.gz")}, at("o.tar.gz")},
             {{"info", "part.sl1", "--json", at("o.json")}, at("o.json")},
             {Command{"verify", "c.sl1", "--json", at("o.json")} + of_target, at("o.json")},
             {Command{"report", "c.sl1", "-o", at("o.html")} + of_target, at("o.html")},
             {Command{"section", "c.sl1", "-o", at("o.png")} + of_target, at("o.png")},
             {{"solid", "c.sl1", "-o", at("o.stl")}, at("o.stl")},
             {{"solid", "c.sl1", "-o", "own/s.stl", "--json", at("o.json")}, at("o.json")},
             {Command{"run", "part.stl", "-o", at("new.uvj"), "--layer-um", "20"} + how,
              folder == "closed" ? at("new.uvj") : ""},
             {Command{"run", "part.stl", "-o", at("o.uvj"), "--layer-um", "20"} + how, at("o.uvj")},
         }) {
      const bool chosen = ++number % 3 == 0 || by_night() || ::geteuid() != 0;
      if (named.empty() || !chosen) continue;
      SCOPED_TRACE(::testing::PrintToString(command));
      const RunResult r = run_program(slicecorr + command, options);
      EXPECT_EQ(r.exit_code, 4) << r.err;
      EXPECT_THAT(r.err, HasSubstr("slicecorr: " + named + ": can't be "));
      EXPECT_THAT(r.err, AllOf(Not(HasSubstr(".part")), Not(HasSubstr(": done"))));
    }
    // The page of a run that could write its stack.
    if (folder != "closed") {
      fs::remove(folder_ / (folder + "/o.uvj"));
      const RunResult r = run_program(
          slicecorr + Command{"run", "part.stl", "-o", at("o.uvj"), "--layer-um", "20"} + how,
          options);
      EXPECT_EQ(r.exit_code, 4) << r.err;
      EXPECT_THAT(r.err, AllOf(HasSubstr("slicecorr: " + at("o.html") + ": can't be "),
                               Not(HasSubstr(": done"))));
      EXPECT_FALSE(fs::exists(folder_ / (folder + "/o.uvj")));
    }
    for (const std::string& name : names) {
      if (name == "o.uvj") continue;
      EXPECT_EQ(bytes(folder + "/" + name), Bytes(theirs.begin(), theirs.end())) << name;
    }
  }
  fs::permissions(folder_ / "closed", fs::perms(0755));
  EXPECT_EQ(left_over(), std::vector<std::string>());
}

TEST_F(WholeFiles, WriteProtectedArchivesAreNotCorrectedInPlace) {
  namespace fs = std::filesystem;
  fs::permissions(folder_.path(), fs::perms(0755));
  fs::create_directory(folder_ / "open");
  make_sl1(folder_ / "open/part.sl1");
  const Bytes before = bytes("open/part.sl1");
  fs::permissions(folder_ / "open", fs::perms(0777));
  fs::permissions(folder_ / "open/part.sl1", fs::perms(0444));
  RunOptions options = options_;
  options.unprivileged = true;
  const auto post = [&](const Command& more) {
    return run_program(
        Command{SLICECORR_BIN_DIR "/slicecorr-post"} + kSmall + more + Command{"open/part.sl1"},
        options);
  };
  RunResult r = post({});
  EXPECT_EQ(r.exit_code, 4) << r.err;
  EXPECT_THAT(r.err, AllOf(HasSubstr("open/part.sl1: can't be written: Permission denied"),
                           Not(HasSubstr("done")), Not(HasSubstr(".slicecorr-post-"))));
  EXPECT_EQ(bytes("open/part.sl1"), before);
  // Nor where its report could not be put in place.
  fs::permissions(folder_ / "open/part.sl1", fs::perms(0666));
  write_file(folder_ / "open/part.sl1.html", {});
  fs::permissions(folder_ / "open/part.sl1.html", fs::perms(0444));
  r = post({"--report=html"});
  EXPECT_EQ(r.exit_code, 4) << r.err;
  EXPECT_THAT(r.err, AllOf(HasSubstr("part.sl1.html: can't be written"), Not(HasSubstr("done"))));
  EXPECT_EQ(bytes("open/part.sl1"), before);
  // One that can't be read is a wrong input.
  fs::permissions(folder_ / "open/part.sl1", fs::perms(0));
  EXPECT_EQ(post({}).exit_code, 2);
}

// Who takes it for no file would begin anew, over what stands in it.
TEST_F(WholeFiles, NoMoreFilesIsNoWordAboutAFile) {
  write("there", "text");
  EXPECT_EQ(text_of_file(folder_ / "there"), "text");
  EXPECT_EQ(text_of_file(folder_ / "not there"), std::nullopt);
  const NoMoreFiles none;
  for (const bool or_none : {true, false}) {
    try {
      or_none ? text_of_file(folder_ / "there").value_or("") : read_text_file(folder_ / "there");
      FAIL();
    } catch (const DeviceError& e) {
      EXPECT_THAT(e.what(), HasSubstr("there: can't be read: Too many open files"));
    }
  }
}

// In a folder that others may change, a link may stand where our file was a moment ago.
TEST_F(WholeFiles, ModesAreGivenToNoFileBehindALink) {
  for (const char* name : {"open", "secret", "own"}) write(name, "x");
  std::filesystem::permissions(folder_ / "open", std::filesystem::perms(0666));
  for (const char* name : {"secret", "own"}) {
    std::filesystem::permissions(folder_ / name, std::filesystem::perms(0600));
  }
  std::filesystem::create_symlink("secret", (folder_ / "swapped"));
  detail::copy_mode(folder_ / "open", folder_ / "swapped");
  detail::copy_mode(folder_ / "open", folder_ / "own");
  EXPECT_EQ(std::filesystem::status(folder_ / "secret").permissions(),
            std::filesystem::perms(0600));
  EXPECT_EQ(std::filesystem::status(folder_ / "own").permissions(), std::filesystem::perms(0666));
}

}  // namespace
}  // namespace slicecorr::test
