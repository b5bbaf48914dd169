// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What others on the machine can do to a bridge: docs/threats.md names these tests.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>

#include "frames/wire.hpp"
#include "slicecorr/bridge/record.hpp"
#include "slicecorr/error.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::bridge {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

TEST(BridgeThreats, AStateThatEverybodyMayChangeIsNotBelieved) {
  const slicecorr::test::TemporaryFolder folder;
  Printer printer;
  printer.name = "one";
  const mode_t before = ::umask(0);
  const StateFolder made = StateFolder::of(folder.path(), printer);
  ::umask(before);
  EXPECT_EQ(fs::status(made.path).permissions() & fs::perms::others_write, fs::perms::none);
  fs::permissions(made.path, fs::perms::others_write, fs::perm_options::add);
  try {
    StateFolder::of(folder.path(), printer);
    FAIL() << "a latch that anybody can take away";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("may be changed by every user"));
  }
}

TEST(BridgeThreats, ASocketIsOfItsUserAndGroupWhateverTheUmask) {
  const slicecorr::test::TemporaryFolder folder;
  const mode_t before = ::umask(0);
  const WireListener listener = listen_wire("unix:" + (folder / "s"));
  ::umask(before);
  struct stat s {};
  ASSERT_EQ(::stat((folder / "s").c_str(), &s), 0);
  EXPECT_EQ(s.st_mode & 0777, 0660U);
}

}  // namespace
}  // namespace slicecorr::bridge
