// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Saving, history and search: nothing is lost, whoever writes at the same time or dies.
#include "slicecorr/resins/database.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

std::string resin(const std::string& name, const std::string& notes) {
  return "# kept\nname = \"" + name + "\"\nnotes = \"" + notes +
         "\"\n[cure] # too\nabsorbance_height_um = 100\nabsorbance_base = \"e\"\n"
         "gel_dose_mj_cm2 = 5.0\n";
}

std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

class Database : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) / ("slicecorr-database-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    ::setenv("SLICECORR_DB", folder_.c_str(), 1);
  }
  void TearDown() override {
    ::unsetenv("SLICECORR_DB");
    fs::remove_all(folder_);
  }
  Saved save(const std::string& name, const std::string& notes, const std::string& message = "",
             Replace replace = Replace::keep_history) {
    return save_definition(folder_.string(), name, resin(name, notes), "resin", replace, message);
  }
  fs::path path(const std::string& name) const { return folder_ / (name + ".toml"); }
  fs::path folder_;
};

TEST_F(Database, VersionsAreNumberedAndKept) {
  EXPECT_EQ(save("a", "one", "first").version, 1);
  const Saved second = save("a", "two", "because\nof\tthis");
  EXPECT_EQ(second.version, 2);
  EXPECT_TRUE(second.replaced);
  EXPECT_EQ(second.path, path("a").string());
  const auto versions = history("a");
  ASSERT_EQ(versions.size(), 2U);
  EXPECT_EQ(versions[0].number, 1);
  EXPECT_EQ(versions[0].message, "first");
  EXPECT_FALSE(versions[0].current);
  EXPECT_EQ(versions[1].number, 2);
  EXPECT_EQ(versions[1].message, "because of this");
  EXPECT_TRUE(versions[1].current);
  EXPECT_THAT(versions[1].date, testing::MatchesRegex("20[0-9]+-[0-9]+-[0-9]+T[0-9:]+Z"));
  EXPECT_THAT(text_of_version("a", 1), HasSubstr("notes = \"one\""));
  EXPECT_THAT(text_of_version("a", 2), HasSubstr("notes = \"two\""));
  EXPECT_EQ(text_of(path("a")), text_of_version("a", 2));
  EXPECT_THROW(text_of_version("a", 3), InputError);
}

TEST_F(Database, TheNumberIsSetAndCommentsStay) {
  save("a", "one");
  EXPECT_EQ(text_of(path("a")),
            "# kept\nname = \"a\"\nversion = 1\nnotes = \"one\"\n[cure] # too\n"
            "absorbance_height_um = 100\nabsorbance_base = \"e\"\ngel_dose_mj_cm2 = 5.0\n");
}

TEST_F(Database, TheSameTextIsNotSavedAgain) {
  save("a", "one");
  const Saved again = save("a", "one", "again", Replace::refuse);
  EXPECT_TRUE(again.unchanged);
  EXPECT_EQ(again.version, 1);
  EXPECT_EQ(history("a").size(), 1U);
}

TEST_F(Database, NothingIsReplacedUnasked) {
  save("a", "one");
  const std::string before = text_of(path("a"));
  EXPECT_THROW(save("a", "two", "", Replace::refuse), InputError);
  EXPECT_EQ(text_of(path("a")), before);
  EXPECT_EQ(history("a").size(), 1U);
}

TEST_F(Database, SomeoneElsesChangeIsNoticed) {
  save("a", "one");
  save("a", "two");
  const auto write = [&](int expected) {
    return save_definition(folder_.string(), "a", resin("a", "three"), "resin",
                           Replace::keep_history, "", expected);
  };
  EXPECT_THROW(write(1), InputError);
  EXPECT_THAT(text_of(path("a")), HasSubstr("two"));
  EXPECT_EQ(write(2).version, 3);
  EXPECT_THROW(
      save_definition(folder_.string(), "b", resin("b", ""), "resin", Replace::refuse, "", 1),
      InputError);
}

TEST_F(Database, WrongTextsAndNamesAreRefused) {
  const auto refused = [&](const std::string& name, const std::string& text, const char* kind) {
    try {
      save_definition(folder_.string(), name, text, kind, Replace::keep_history, "");
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("nothing was refused");
  };
  EXPECT_THAT(refused("a", "name = \"a\"\n[cure]\nm = 1\n", "resin"),
              HasSubstr("absorbance_height_um"));
  EXPECT_THAT(refused("a", resin("b", ""), "resin"), HasSubstr("the file is a.toml"));
  EXPECT_THAT(refused("a", resin("a", ""), "printer"), HasSubstr("is a resin; expected a printer"));
  for (const char* name : {"", "../a", "A", "a b", ".a", "a/b", "a.toml"}) {
    EXPECT_THAT(refused(name, resin("a", ""), "resin"), HasSubstr("name")) << name;
  }
  EXPECT_FALSE(fs::exists(folder_ / "a.toml"));
}

TEST_F(Database, WhatWasChangedByHandIsKept) {
  save("a", "one");
  save("a", "two");
  // Someone writes past the library: with the number of an old version, then no TOML at all.
  std::string edited = text_of(path("a"));
  edited.replace(edited.find("version = 2"), 11, "version = 1");
  edited += "# by hand\n";
  std::ofstream(path("a")) << edited;
  EXPECT_EQ(save("a", "three").version, 3);
  EXPECT_EQ(text_of_version("a", 2), edited);
  const auto versions = history("a");
  EXPECT_EQ(versions[1].message, "changed by hand");
  std::ofstream(path("a")) << "broken [";
  // It stands in the place of the version that it was made from.
  EXPECT_EQ(save("a", "four").version, 4);
  EXPECT_EQ(text_of_version("a", 3), "broken [");
  EXPECT_THAT(text_of_version("a", 1), HasSubstr("one"));
  EXPECT_THAT(text_of_version("a", 4), HasSubstr("four"));
}

TEST_F(Database, NumbersGoOnAfterAFileWasRemoved) {
  save("a", "one");
  save("a", "two");
  fs::remove(path("a"));
  EXPECT_EQ(save("a", "three").version, 2);  // the second was never replaced: it is gone
  EXPECT_THAT(text_of_version("a", 1), HasSubstr("one"));
}

TEST_F(Database, MeasurementsAreStoredOnce) {
  const fs::path csv = folder_ / "in.txt";
  fs::create_directories(folder_);
  std::ofstream(csv) << "1,2\n";
  EXPECT_EQ(save_measurements(folder_.string(), "a", csv.string()), "a.csv");
  EXPECT_EQ(save_measurements(folder_.string(), "a", csv.string()), "a.csv");
  std::ofstream(csv) << "3,4\n";
  EXPECT_EQ(save_measurements(folder_.string(), "a", csv.string()), "a-2.csv");
  EXPECT_EQ(text_of(folder_ / "a.csv"), "1,2\n");
  EXPECT_EQ(text_of(folder_ / "a-2.csv"), "3,4\n");
}

TEST_F(Database, FoldersThatCannotBeWritten) {
  fs::create_directories(folder_);
  std::ofstream(folder_ / "file") << "x";
  EXPECT_THROW(save_definition((folder_ / "file").string(), "a", resin("a", ""), "resin",
                               Replace::refuse, ""),
               DeviceError);
}

/// Numbers of all versions, once each.
std::multiset<int> numbers_of(const std::string& name) {
  std::multiset<int> numbers;
  for (const Version& v : history(name)) numbers.insert(v.number);
  return numbers;
}

void expect_versions_one_to(int last, const std::string& name) {
  const auto numbers = numbers_of(name);
  EXPECT_EQ(numbers.size(), static_cast<std::size_t>(last));
  for (int n = 1; n <= last; ++n) EXPECT_EQ(numbers.count(n), 1U) << n;
}

/// Every version says what it is and is a resin.
void expect_every_version_valid(const std::string& name) {
  for (const Version& v : history(name)) {
    const ResinRecord r = parse_record(text_of(v.path), v.path);
    EXPECT_EQ(r.version, v.number) << v.path;
    EXPECT_EQ(r.resin.gel_dose_mj_cm3, 500) << v.path;
  }
}

TEST_F(Database, ConcurrentThreadsLoseNothing) {
  const int writers = 8, changes = test::by_night() ? 25 : 10;
  std::vector<std::thread> threads;
  for (int t = 0; t < writers; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < changes; ++i) {
        save("a", std::to_string(t) + "." + std::to_string(i));
      }
    });
  }
  for (std::thread& t : threads) t.join();
  expect_versions_one_to(writers * changes, "a");
  expect_every_version_valid("a");
  std::set<std::string> notes;
  for (const Version& v : history("a")) notes.insert(load_record(v.path).notes);
  EXPECT_EQ(notes.size(), static_cast<std::size_t>(writers * changes));
}

TEST_F(Database, ConcurrentProcessesLoseNothing) {
  const int writers = 8, changes = test::by_night() ? 25 : 10;
  std::vector<pid_t> children;
  for (int p = 0; p < writers; ++p) {
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      int code = 0;
      try {
        for (int i = 0; i < changes; ++i) {
          save("a", std::to_string(p) + "." + std::to_string(i));
        }
      } catch (...) {
        code = 1;
      }
      ::_exit(code);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) {
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    EXPECT_EQ(status, 0);
  }
  expect_versions_one_to(writers * changes, "a");
  expect_every_version_valid("a");
}

TEST_F(Database, AKillAtAnyMomentLosesNothing) {
  save("a", "start");
  std::mt19937 random(7);  // the delays differ; what must hold does not depend on them
  std::uniform_int_distribution<int> delay_us(0, 20000 * test::kSlowdown);
  int last = 1, kills = 0, kills_within_a_change = 0;
  const int rounds = test::by_night() ? 60 : 25;
  for (int round = 0; round < rounds; ++round) {
    int started[2];
    ASSERT_EQ(::pipe(started), 0);
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      (void)!::write(started[1], "x", 1);
      for (int i = 0;; ++i) save("a", std::to_string(round) + "." + std::to_string(i));
    }
    char byte = 0;
    ASSERT_EQ(::read(started[0], &byte, 1), 1);
    std::this_thread::sleep_for(std::chrono::microseconds(delay_us(random)));
    ASSERT_EQ(::kill(child, SIGKILL), 0);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status)) << "the child ended on its own";
    ::close(started[0]);
    ::close(started[1]);
    ++kills;
    // The file is whole, and so is every version before it.
    const ResinRecord r = load_record(path("a").string());
    EXPECT_GE(r.version, last);
    last = r.version;
    expect_versions_one_to(last, "a");
    std::error_code ec;
    for (const auto& entry : fs::recursive_directory_iterator(folder_, ec)) {
      kills_within_a_change += entry.path().extension() == ".part";
    }
    kills_within_a_change += fs::exists(folder_ / ".history/a" / (std::to_string(last) + ".toml"));
  }
  EXPECT_EQ(kills, rounds);
  // Else the kills came between changes and the test shows nothing.
  EXPECT_GT(kills_within_a_change, 0);
  expect_every_version_valid("a");
  // The folder still works.
  EXPECT_EQ(save("a", "after").version, last + 1);
  expect_versions_one_to(last + 1, "a");
}

// --- Differences

/// Applies a unified difference; fails where it does not fit.
std::vector<std::string> patched(const std::string& old_text, const std::string& diff) {
  std::vector<std::string> old_lines, out;
  std::istringstream in(old_text);
  for (std::string l; std::getline(in, l);) old_lines.push_back(l);
  std::istringstream lines(diff);
  std::size_t at = 0;
  for (std::string l; std::getline(lines, l);) {
    if (l.starts_with("---") || l.starts_with("+++")) continue;
    if (l.starts_with("@@")) {
      std::size_t start = 0, count = 0;
      EXPECT_EQ(std::sscanf(l.c_str(), "@@ -%zu,%zu", &start, &count), 2);
      const std::size_t first = count == 0 ? start : start - 1;
      while (at < first) out.push_back(old_lines.at(at++));
      continue;
    }
    if (l[0] != '+') {
      EXPECT_EQ(l.substr(1), old_lines.at(at));
      ++at;
    }
    if (l[0] != '-') out.push_back(l.substr(1));
  }
  while (at < old_lines.size()) out.push_back(old_lines[at++]);
  return out;
}

TEST(Difference, ClosedForms) {
  EXPECT_EQ(difference("a\nb\n", "a\nb\n", "x", "y"), "");
  EXPECT_EQ(difference("", "", "x", "y"), "");
  EXPECT_EQ(difference("a\n", "b\n", "x", "y"), "--- x\n+++ y\n@@ -1,1 +1,1 @@\n-a\n+b\n");
  EXPECT_EQ(difference("", "b\n", "x", "y"), "--- x\n+++ y\n@@ -0,0 +1,1 @@\n+b\n");
  EXPECT_EQ(difference("1\n2\n3\n4\n5\n6\n7\n8\n9\n", "1\n2\n3\n4\n5\n6\n7\n8\nx\n", "x", "y"),
            "--- x\n+++ y\n@@ -6,4 +6,4 @@\n 6\n 7\n 8\n-9\n+x\n");
}

TEST(Difference, LeadsFromTheOldTextToTheNew) {
  std::mt19937 random(1);
  const auto make = [&] {
    std::string text;
    const unsigned lines = random() % 40;
    for (unsigned i = 0; i < lines; ++i) text += std::string(1, char('a' + random() % 5)) + "\n";
    return text;
  };
  for (int i = 0; i < test::rounds(500); ++i) {
    const std::string a = make(), b = make();
    std::string joined;
    for (const std::string& l : patched(a, difference(a, b, "x", "y"))) joined += l + "\n";
    ASSERT_EQ(joined, b) << difference(a, b, "x", "y");
  }
}

// --- Search

TEST_F(Database, Search) {
  const auto put = [&](const std::string& name, const std::string& words, const std::string& cure) {
    save_definition(folder_.string(), name,
                    "name = \"" + name + "\"\n" + words + "[cure]\nabsorbance_base = \"e\"\n" +
                        "gel_dose_mj_cm2 = 5.0\n" + cure,
                    "resin", Replace::refuse, "");
  };
  put("zz-1", "maker = \"Acme Resins\"\nchemistry = \"acrylate\"\n",
      "absorbance_height_um = 100\nwavelength_nm = 405\n");
  put("zz-2", "maker = \"Acme Resins\"\nnotes = \"Tough\"\n",
      "absorbance_height_um = 200\nwavelength_nm = 385\n");
  put("zz-3", "chemistry = \"epoxy\"\n", "absorbance_height_um = 300\n");
  const auto names = [](const Query& q) {
    std::string all;
    for (const ResinRecord& r : find_records(q)) {
      if (r.name.starts_with("zz-")) all += r.name.substr(3);
    }
    return all;
  };
  EXPECT_EQ(names({}), "123");
  EXPECT_EQ(names({.words = "zz"}), "123");
  EXPECT_EQ(names({.words = "acme tough"}), "2");
  EXPECT_EQ(names({.words = "zz acme epoxy"}), "");
  EXPECT_EQ(names({.maker = "acme"}), "12");
  EXPECT_EQ(names({.chemistry = "EPOXY"}), "3");
  EXPECT_EQ(names({.wavelength_nm = 395}), "12");
  EXPECT_EQ(names({.wavelength_nm = 396}), "1");
  EXPECT_EQ(names({.least_height_um = 100, .greatest_height_um = 200}), "12");
  EXPECT_EQ(names({.greatest_height_um = 99.9}), "");
  // A broken file does not hide the others.
  std::ofstream(path("zz-4")) << "[cure]\nm = \n";
  std::vector<Finding> problems;
  EXPECT_GE(find_records({}, &problems).size(), 3U);
  ASSERT_EQ(problems.size(), 1U);
  EXPECT_THAT(problems[0].message, HasSubstr("zz-4.toml"));
}

TEST_F(Database, NamesAreFoundAndNearOnesOffered) {
  save("zz-resin", "x");
  EXPECT_EQ(locate("zz-resin").kind, "resin");
  EXPECT_EQ(locate("ember").kind, "printer");
  EXPECT_EQ(locate(path("zz-resin").string()).name, "zz-resin");
  try {
    locate("zz-resim");
    ADD_FAILURE() << "found";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("did you mean 'zz-resin'?"));
  }
  EXPECT_THROW(locate("gone.toml"), InputError);
}

}  // namespace
}  // namespace slicecorr::resins
