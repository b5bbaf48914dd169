// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What others on the machine can do to a farm: docs/threats.md names these tests.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "farm_filled.hpp"
#include "farm_program.hpp"
#include "farm_served.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "stack_fixture.hpp"
#include "support/http/guard.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using slicecorr::test::kSlicefarm;
using slicecorr::test::run_program;
using slicecorr::test::RunOptions;
using test::Farm;
using test::fill;
using test::kToken;
using ::testing::HasSubstr;
using ::testing::Not;

void open_to_all(const std::string& path, bool open) {
  fs::permissions(path, fs::perms::others_write,
                  open ? fs::perm_options::add : fs::perm_options::remove);
}

// Its notify.toml names programs, its record says which parts and where results go.
TEST(FarmThreats, WhatEverybodyMayChangeIsNotBelieved) {
  Farm farm;
  for (const char* name : {"/notify.toml", "/machines.toml", "/bridges.toml"}) {
    test::write_file(farm.root + name, "");
  }
  ASSERT_NO_THROW(open_folder(farm.root));
  for (const char* name :
       {"", "/farm.sqlite", "/notify.toml", "/machines.toml", "/bridges.toml", "/logs", "/results",
        "/store", "/store/inputs", "/store/attempts", "/store/cache"}) {
    const std::string path = farm.root + name;
    ASSERT_TRUE(fs::exists(path)) << path;
    open_to_all(path, true);
    const auto result = run_program({kSlicefarm, "pause", "--dir", farm.root});
    EXPECT_EQ(result.exit_code, 2) << name;
    EXPECT_THAT(result.err, HasSubstr(path + ": may be changed by every user")) << name;
    open_to_all(path, false);
  }
  // Those of a group are trusted as its user is.
  fs::permissions(farm.root, fs::perms::group_write, fs::perm_options::add);
  EXPECT_EQ(run_program({kSlicefarm, "pause", "--dir", farm.root}).exit_code, 0);
}

TEST(FarmThreats, WhatItMakesOthersCannotWriteTo) {
  const slicecorr::test::TemporaryFolder folder;
  const mode_t before = ::umask(0);
  const std::string root = folder / "above/farm";
  const FarmFolder made = open_folder(root);
  EXPECT_EQ(run_program({kSlicefarm, "pause", "--dir", root}).exit_code, 0);
  ::umask(before);
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(root)) {
    ++files;
    if (!entry.is_directory()) continue;
    EXPECT_EQ(entry.status().permissions() & fs::perms::others_write, fs::perms::none)
        << entry.path();
  }
  EXPECT_GT(files, 5);
}

TEST(FarmThreats, ATokenStandsInNoFileAndNoMessage) {
  Farm farm;
  fill(farm);
  const std::string other(kToken.rbegin(), kToken.rend());
  test::write_file(farm.root + "/token", kToken + "\n");
  fs::permissions(farm.root + "/token", fs::perms::owner_read | fs::perms::owner_write);
  RunOptions options;
  options.signal = SIGTERM;
  std::string answers;
  options.signal_when = [&](const std::string& out, const std::string&) {
    if (out.find('\n') == std::string::npos) return false;
    httplib::Client client(out.substr(0, out.find('\n')));
    const auto ask = [&](const std::string& path, const httplib::Headers& headers) {
      if (const auto r = client.Get(path, headers)) {
        answers += r->body;
        for (const auto& [name, value] : r->headers) answers += name + value;
      }
      if (const auto r = client.Post(path, headers, kToken, "application/json")) answers += r->body;
    };
    const httplib::Headers right{{"Authorization", "Bearer " + kToken}};
    for (const std::string& path : {std::string("/api/v1/pause"), std::string("/api/v1/jobs"),
                                    "/" + kToken, "/api/v1/jobs?token=" + kToken}) {
      ask(path, right);
      ask(path, {{"Authorization", "Bearer " + other}});
      ask(path, {{"Authorization", "Basic " + kToken}, {"Cookie", kToken}});
    }
    return true;
  };
  const auto result = run_program({kSlicefarm, "serve", "--dir", farm.root, "--listen",
                                   "127.0.0.1:0", "--token-file", farm.root + "/token"},
                                  options);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_GT(answers.size(), 100U);
  for (const std::string& secret : {kToken, other}) {
    EXPECT_THAT(result.out + result.err + answers, Not(HasSubstr(secret)));
    for (const auto& entry : fs::recursive_directory_iterator(farm.root)) {
      if (!entry.is_regular_file() || entry.path() == farm.root + "/token") continue;
      std::ifstream file(entry.path(), std::ios::binary);
      const std::string text(std::istreambuf_iterator<char>(file), {});
      EXPECT_EQ(text.find(secret), std::string::npos) << entry.path();
    }
  }
}

TEST(FarmThreats, WhoHoldsATokenLeavesNoCore) {
  const slicecorr::test::TemporaryFolder folder;
  const std::string path = folder / "token", accounts = folder / "accounts";
  test::write_file(path, kToken + "\n");
  test::write_file(accounts, "operate pia " + kToken + "\n");
  for (const std::string& file : {path, accounts}) {
    fs::permissions(file, fs::perms::owner_read | fs::perms::owner_write);
    const pid_t child = ::fork();
    if (child == 0) {
      // Tests before this one may have read tokens, too.
      ::prctl(PR_SET_DUMPABLE, 1);
      const bool before = ::prctl(PR_GET_DUMPABLE) == 1;
      if (file == path) {
        http::read_token_file(file);
      } else {
        read_accounts_file(file);
      }
      ::_exit(before && ::prctl(PR_GET_DUMPABLE) == 0 ? 0 : 1);
    }
    int status = -1;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(status, 0) << file;
  }
}

}  // namespace
}  // namespace slicecorr::farm
