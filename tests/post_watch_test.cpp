// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// slicecorr-post watching folders: what comes is corrected once it is whole, failures stop
/// nothing, and kills at any moment lose nothing.
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>
#include <thread>

#include "post_fixture.hpp"
#include "rounds.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Clock = std::chrono::steady_clock;
namespace fs = std::filesystem;

/// A program that runs beside the test; what it says on stderr is read as it comes.
class Running {
 public:
  Running(const Command& command, const RunOptions& options) {
    int err[2];
    EXPECT_EQ(::pipe2(err, O_CLOEXEC), 0);
    const TextList argv(command), envp(environment_with(options.environment));
    child_ = ::vfork();
    if (child_ == 0) {
      ::dup2(err[1], STDERR_FILENO);
      ::close_range(3, ~0U, CLOSE_RANGE_CLOEXEC);  // files that the test has open are not its own
      if (::chdir(options.folder.c_str()) == 0) {
        ::execve(argv.data()[0], argv.data(), envp.data());
      }
      ::_exit(127);
    }
    ::close(err[1]);
    err_ = err[0];
  }
  ~Running() {
    if (child_ > 0) stop(SIGKILL);
    ::close(err_);
  }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;

  /// Reads until `text` was said `times` times, or it ended, or a minute is over.
  ::testing::AssertionResult says(const std::string& text, int times = 1) {
    const auto end = Clock::now() + std::chrono::minutes(1);
    while (count(text) < times) {
      pollfd file{err_, POLLIN, 0};
      char buffer[4096];
      const bool there = ::poll(&file, 1, 100) > 0;
      const ssize_t n = there ? ::read(err_, buffer, sizeof buffer) : 0;
      if (there && n <= 0) {
        return ::testing::AssertionFailure() << "ended without '" << text << "':\n" << said_;
      }
      said_.append(buffer, static_cast<std::size_t>(n));
      if (Clock::now() > end) {
        return ::testing::AssertionFailure() << "no '" << text << "' in a minute:\n" << said_;
      }
    }
    return ::testing::AssertionSuccess();
  }
  int count(const std::string& text) const {
    int found = 0;
    for (auto at = said_.find(text); at != std::string::npos; at = said_.find(text, at + 1)) {
      ++found;
    }
    return found;
  }
  int stop(int signal) {
    ::kill(child_, signal);
    return wait();
  }
  int wait() {
    char buffer[4096];
    for (ssize_t n; (n = ::read(err_, buffer, sizeof buffer)) > 0;) {
      said_.append(buffer, static_cast<std::size_t>(n));
    }
    int status = 0;
    ::waitpid(child_, &status, 0);
    child_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  const std::string& said() const { return said_; }
  pid_t pid() const { return child_; }

 private:
  pid_t child_ = -1;
  int err_ = -1;
  std::string said_;
};

const Command kWatch{SLICECORR_BIN_DIR "/slicecorr-post", "--threads", "2", "--settle-s", "0.05"};

class Watch : public PostFolder {
 protected:
  Watch() {
    fs::create_directory(folder_ / "in");
    make_sl1(folder_ / "export.sl1");
    whole_ = bytes("export.sl1");
    good(kSmall + Command{"export.sl1"});
    corrected_ = bytes("export.sl1");
    EXPECT_NE(whole_, corrected_);
  }
  Command watching(const Command& more = {}) const {
    return kWatch + kSmall + more + Command{"--watch", "in"};
  }
  void put(const std::string& name) const { write_file(folder_ / name, whole_); }

  Bytes whole_, corrected_;
};

TEST_F(Watch, WhatIsThereAndWhatComes) {
  put("in/there.sl1");
  put("in/there.sl1.orig");
  put("in/.hidden.sl1");
  write("in/readme.txt", "no archive");
  write_file(folder_ / "in/done.sl1", corrected_);
  Running watch(watching(), options_);
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/there.sl1")));
  put("in/written.sl1");
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/written.sl1")));
  put("elsewhere.sl1");
  fs::rename(folder_ / "elsewhere.sl1", folder_ / "in/moved.SL1");
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/moved.SL1")));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  for (const char* name : {"in/there.sl1", "in/written.sl1", "in/moved.SL1", "in/done.sl1"}) {
    EXPECT_EQ(bytes(name), corrected_) << name;
  }
  EXPECT_EQ(bytes("in/there.sl1.orig"), whole_);
  EXPECT_EQ(bytes("in/.hidden.sl1"), whole_);
  EXPECT_EQ(watch.count(" corrected "), 3) << "each once, although our own files appear, too";
  EXPECT_EQ(watch.count(" failed "), 0) << watch.said();
  EXPECT_THAT(names("in"),
              ::testing::ElementsAre(".hidden.sl1", "done.sl1", "moved.SL1", "readme.txt",
                                     "there.sl1", "there.sl1.orig", "written.sl1"));
}

/// The processes that a process has started.
std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> children;
  for (const auto& task : fs::directory_iterator(fmt::format("/proc/{}/task", parent))) {
    std::ifstream in(task.path() / "children");
    for (pid_t child; in >> child;) children.push_back(child);
  }
  return children;
}

TEST_F(Watch, AFileThatKillsItsReaderIsSetAside) {
  Running watch(watching({"--on-fail", "/bin/true"}), options_);
  ASSERT_TRUE(watch.says("watching"));
  put("in/a.sl1");
  std::vector<pid_t> children;
  const auto end = Clock::now() + std::chrono::seconds(30);
  while ((children = children_of(watch.pid())).empty() && Clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  ASSERT_FALSE(children.empty());
  ::kill(children[0], SIGSEGV);
  ASSERT_TRUE(watch.says("failed " + (folder_ / "in/a.sl1")));
  EXPECT_THAT(watch.said(), HasSubstr("ended the program that read it"));
  EXPECT_THAT(watch.said(), HasSubstr("it is set aside as a.sl1.set-aside"));
  // Others are corrected all the same, and one of the same name too.
  put("in/b.sl1");
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/b.sl1")));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  EXPECT_EQ(bytes("in/a.sl1.set-aside"), whole_);
  EXPECT_FALSE(fs::exists(folder_ / "in/a.sl1"));
  // After a restart nothing meets it again.
  Running again(watching({"--once"}), options_);
  EXPECT_EQ(again.wait(), 0) << again.said();
  EXPECT_EQ(again.count(" failed "), 0) << again.said();
}

TEST_F(Watch, SlowWritersAreWaitedFor) {
  Running watch(watching({"--patience-s", "600"}), options_);
  ASSERT_TRUE(watch.says("watching"));
  const auto half = static_cast<std::ptrdiff_t>(whole_.size() / 2);
  const auto write_part = [&](std::ofstream& out, std::ptrdiff_t from, std::ptrdiff_t to) {
    out.write(reinterpret_cast<const char*>(whole_.data()) + from, to - from);
    out.flush();
  };
  const auto end = static_cast<std::ptrdiff_t>(whole_.size());
  {
    // One keeps its file open, the other closes it between the halves.
    std::ofstream open(folder_ / "in/open.sl1", std::ios::binary);
    write_part(open, 0, half);
    {
      std::ofstream closed(folder_ / "in/closed.sl1", std::ios::binary);
      write_part(closed, 0, half);
    }
    // Others do not have to wait for them.
    put("in/quick.sl1");
    ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/quick.sl1")));
    EXPECT_EQ(watch.count("open.sl1"), 0) << watch.said();
    write_part(open, half, end);
  }
  {
    std::ofstream closed(folder_ / "in/closed.sl1", std::ios::binary | std::ios::app);
    write_part(closed, half, end);
  }
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/open.sl1")));
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/closed.sl1")));
  EXPECT_EQ(watch.stop(SIGINT), 130);
  EXPECT_EQ(watch.count(" failed "), 0) << watch.said();
  EXPECT_EQ(bytes("in/open.sl1"), corrected_);
  EXPECT_EQ(bytes("in/closed.sl1"), corrected_);
}

TEST_F(Watch, FileThatIsStillOpenAtTheStart) {
  std::ofstream open(folder_ / "in/open.sl1", std::ios::binary);
  open.write(reinterpret_cast<const char*>(whole_.data()),
             static_cast<std::streamsize>(whole_.size() / 2));
  open.flush();
  put("in/other.sl1");
  Running watch(watching({"--patience-s", "0"}), options_);
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/other.sl1")));
  open.write(reinterpret_cast<const char*>(whole_.data()) + whole_.size() / 2,
             static_cast<std::streamsize>(whole_.size() - whole_.size() / 2));
  open.close();
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/open.sl1")));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  EXPECT_EQ(watch.count(" failed "), 0) << watch.said();
}

TEST_F(Watch, FailuresStopNothingAndAreNotTriedAgainUntilTheyChange) {
  Bytes half = whole_;
  half.resize(half.size() / 2);
  write_file(folder_ / "in/bad.sl1", half);
  Sl1Options too_short;
  too_short.exposure_s = too_short.first_s = 0.01;
  make_sl1(folder_ / "in/faint.sl1", too_short);
  Running watch(watching({"--patience-s", "0.1", "--log-json"}), options_);
  ASSERT_TRUE(watch.says("\"event\":\"failed\"", 2));
  put("in/good.sl1");
  ASSERT_TRUE(watch.says("\"event\":\"corrected\""));
  EXPECT_EQ(watch.count("\"event\":\"failed\""), 2) << watch.said();
  EXPECT_EQ(bytes("in/bad.sl1"), half);
  write_file(folder_ / "in/bad.sl1", whole_);
  ASSERT_TRUE(watch.says("\"event\":\"corrected\"", 2));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  EXPECT_EQ(watch.count("\"event\":\"failed\""), 2) << watch.said();
  EXPECT_EQ(bytes("in/bad.sl1"), corrected_);

  std::istringstream lines(watch.said());
  int faint = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.front() != '{') continue;
    const auto j = nlohmann::json::parse(line);
    if (j.value("file", "") != folder_ / "in/faint.sl1") continue;
    ++faint;
    EXPECT_EQ(j["code"], 3);
    EXPECT_THAT(j["message"].get<std::string>(), HasSubstr("expose for at least"));
  }
  EXPECT_EQ(faint, 1);
}

TEST_F(Watch, AnExportOverACorrectedFileIsCorrectedAnew) {
  put("in/part.sl1");
  Running watch(watching({"--backup=replace"}), options_);
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/part.sl1")));
  Sl1Options other;
  other.seed = 1;
  make_sl1(folder_ / "part.sl1", other);
  const Bytes second = bytes("part.sl1");
  write_file(folder_ / "in/part.sl1", second);
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/part.sl1"), 2));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  EXPECT_EQ(bytes("in/part.sl1.orig"), second);
}

TEST_F(Watch, SeveralAtOnceAndOnce) {
  for (int i = 0; i < 6; ++i) put("in/part" + std::to_string(i) + ".sl1");
  write("in/bad.sl1", "nothing");
  const RunResult r =
      run_program(watching({"--jobs", "3", "--once", "--patience-s", "0"}), options_);
  EXPECT_EQ(r.exit_code, 2) << r.err;
  for (int i = 0; i < 6; ++i) EXPECT_EQ(bytes("in/part" + std::to_string(i) + ".sl1"), corrected_);
  EXPECT_EQ(names("in").size(), 7U);
  fs::remove(folder_ / "in/bad.sl1");
  EXPECT_EQ(run_program(watching({"--once"}), options_).exit_code, 0);
}

TEST_F(Watch, FoldersInFolders) {
  fs::create_directories(folder_ / "in/a/b");
  put("in/a/b/deep.sl1");
  fs::create_directory(folder_ / "new");
  put("new/came along.sl1");
  Running watch(watching({"--recursive"}), options_);
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/a/b/deep.sl1")));
  fs::rename(folder_ / "new", folder_ / "in/a/new");
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/a/new/came along.sl1")));
  put("in/a/new/later.sl1");
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/a/new/later.sl1")));
  // A folder that moves away is left.
  fs::rename(folder_ / "in/a/new", folder_ / "away");
  put("away/outside.sl1");
  put("in/last.sl1");
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/last.sl1")));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  EXPECT_EQ(bytes("away/outside.sl1"), whole_);
}

// Who may write into the folder has no file elsewhere changed by whom he watches for.
TEST_F(Watch, LinksAreNotFollowed) {
  fs::create_directories(folder_ / "elsewhere");
  put("elsewhere/theirs.sl1");
  put("elsewhere/below.sl1");
  put("in/own.sl1");
  fs::create_symlink(folder_ / "elsewhere/theirs.sl1", folder_ / "in/link.sl1");
  fs::create_directory_symlink(folder_ / "elsewhere", folder_ / "in/folder");
  const RunResult r = run_program(watching({"--once", "--recursive"}), options_);
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("link.sl1: is a link; what lies in a watched folder itself"));
  EXPECT_EQ(bytes("elsewhere/theirs.sl1"), whole_);
  EXPECT_EQ(bytes("elsewhere/below.sl1"), whole_);
  EXPECT_NE(bytes("in/own.sl1"), whole_);
}

TEST_F(Watch, OneWatcherPerFolder) {
  Running watch(watching(), options_);
  ASSERT_TRUE(watch.says("watching"));
  const RunResult second = run_program(watching(), options_);
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_THAT(second.err, HasSubstr("is watched by another slicecorr-post"));
  EXPECT_EQ(watch.stop(SIGKILL), 137);
  // Nothing that a killed watcher leaves keeps the next one away.
  EXPECT_EQ(run_program(watching({"--once"}), options_).exit_code, 0);
  const RunResult none = run_program(kWatch + Command{"--watch", "nowhere"}, options_);
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.err, HasSubstr("nowhere: is not a folder"));
}

TEST_F(Watch, EndsWhenItsFoldersAreGone) {
  Running watch(watching(), options_);
  ASSERT_TRUE(watch.says("watching"));
  fs::remove_all(folder_ / "in");
  EXPECT_EQ(watch.wait(), 4) << watch.said();
  EXPECT_THAT(watch.said(), HasSubstr("all watched folders are gone"));
}

TEST_F(Watch, NewOnlyLeavesOldFilesButEndsWorkThatWasCutShort) {
  put("in/old.sl1");
  put("in/cut.sl1");
  const std::string killed = "in/" + work_folder_of_the_dead();
  fs::create_directory(folder_ / killed);
  write(killed + "/in-work", std::string("cut.sl1\0", 8));
  write(killed + "/cut.sl1", "half of it");
  Running watch(watching({"--new-only"}), options_);
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/cut.sl1")));
  put("in/new.sl1");
  ASSERT_TRUE(watch.says("corrected " + (folder_ / "in/new.sl1")));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  EXPECT_EQ(bytes("in/old.sl1"), whole_);
  EXPECT_THAT(names("in"), ::testing::ElementsAre("cut.sl1", "new.sl1", "old.sl1"));
}

TEST_F(Watch, ProgramsAreToldWithoutAShell) {
  write("tell", "#!/bin/sh\nprintf '%s|%s\\n' \"$#\" \"$1\" > \"" + (folder_ / "told") + "\"\n");
  fs::permissions(folder_ / "tell", fs::perms::owner_all);
  ASSERT_EQ(::mkfifo((folder_ / "told").c_str(), 0600), 0);
  const int told = ::open((folder_ / "told").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(told, 0);
  const auto next_line = [&] {
    std::string line;
    pollfd file{told, POLLIN, 0};
    char c = 0;
    while (::poll(&file, 1, 60000) > 0 && ::read(told, &c, 1) == 1 && c != '\n') line += c;
    return line;
  };
  // A name that a shell would take apart.
  const std::string name = "in/a $(touch hurt); b.sl1";
  Running watch(watching({"--on-done", folder_ / "tell", "--on-fail", folder_ / "no such program",
                          "--patience-s", "0"}),
                options_);
  ASSERT_TRUE(watch.says("watching"));
  put(name);
  EXPECT_EQ(next_line(), "1|" + (folder_ / name));
  write("in/bad.sl1", "nothing");
  ASSERT_TRUE(watch.says("not-told"));
  EXPECT_EQ(watch.stop(SIGTERM), 130);
  EXPECT_FALSE(there("hurt"));
  ::close(told);
}

TEST_F(Watch, LogIsAddedToAndMayBeRotated) {
  write("log", "a line of before\n");
  put("in/a.sl1");
  {
    Running watch(watching({"--log", "log", "--on-done", "/bin/echo"}), options_);
    const auto corrected_in = [&](const std::string& log, const std::string& name) {
      for (int i = 0; i < 6000; ++i) {
        if (there(log) && text(log).find("corrected " + (folder_ / name)) != std::string::npos) {
          return true;
        }
        ::poll(nullptr, 0, 10);
      }
      return false;
    };
    ASSERT_TRUE(corrected_in("log", "in/a.sl1"));
    fs::rename(folder_ / "log", folder_ / "log.1");
    put("in/b.sl1");
    ASSERT_TRUE(corrected_in("log", "in/b.sl1"));
    EXPECT_EQ(watch.stop(SIGTERM), 130);
  }
  EXPECT_THAT(text("log.1"), ::testing::StartsWith("a line of before\n"));
  EXPECT_THAT(text("log.1"), Not(HasSubstr("b.sl1")));
  EXPECT_THAT(text("log"), Not(HasSubstr("a.sl1")));
}

TEST_F(Watch, KilledAtAnyMomentNothingIsLost) {
  Sl1Options o;
  o.layers = 150;
  std::vector<Bytes> old_files, new_files;
  const std::vector<std::string> parts = {"in/a.sl1", "in/b.sl1", "in/c.sl1"};
  for (std::size_t i = 0; i < parts.size(); ++i) {
    o.seed = static_cast<int>(i);
    make_sl1(folder_ / parts[i], o);
    old_files.push_back(bytes(parts[i]));
  }
  const Command once = watching({"--jobs", "2", "--once"});
  const auto start = Clock::now();
  const RunResult first = run_program(once, options_);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  auto whole_us =
      std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - start).count();
  for (const auto& part : parts) new_files.push_back(bytes(part));

  std::mt19937 random(1);
  int killed = 0;
  const int kills = by_night() ? rounds(10) : 5;
  for (int i = 0; i < kills; ++i) {
    for (std::size_t k = 0; k < parts.size(); ++k) write_file(folder_ / parts[k], old_files[k]);
    const auto at = std::chrono::microseconds(static_cast<long>(
        static_cast<double>(random()) / 4294967296.0 * static_cast<double>(whole_us)));
    {
      Running watch(once, options_);
      std::this_thread::sleep_for(at);  // the moment itself, nothing is awaited
      const bool hit = watch.stop(SIGKILL) == 137;
      killed += hit;
      // On a busy machine the first run took longer than the others do.
      if (!hit) whole_us -= whole_us / 10;
    }
    for (std::size_t k = 0; k < parts.size(); ++k) {
      const Bytes left = bytes(parts[k]);
      ASSERT_TRUE(left == old_files[k] || left == new_files[k]) << "kill " << i << parts[k];
    }
    const RunResult next = run_program(once, options_);
    ASSERT_EQ(next.exit_code, 0) << next.err;
    for (std::size_t k = 0; k < parts.size(); ++k) ASSERT_EQ(bytes(parts[k]), new_files[k]);
    ASSERT_EQ(names("in").size(), 3U) << ::testing::PrintToString(names("in"));
  }
  EXPECT_GE(killed, kills / 5) << "of those that should have been killed while they ran";
}

}  // namespace
}  // namespace slicecorr::test
