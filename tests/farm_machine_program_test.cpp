// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicefarm machines`, as people run it.

#include "farm_machine_room.hpp"
#include "farm_program.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

class MachineProgram : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
  RunResult machines(const Command& arguments) {
    return run_program(Command{kSlicefarm, "machines"} + arguments +
                       Command{"--dir", dir / "farm"});
  }
  FarmFolderOfTest dir;
};

TEST_F(MachineProgram, FromItsAddressToAPrint) {
  MachineRoomOfTest made(peer_kinds()[0], {"layer-s=0.05"});
  const std::string address = "127.0.0.1:" + std::to_string(made.peer.port);
  const RunResult found =
      run_program({kSlicefarm, "machines", "discover", "127.0.0.1:" + std::to_string(made.peer.udp),
                   "--json", "-"});
  EXPECT_EQ(found.exit_code, 0) << found.err;
  EXPECT_EQ(json::parse(found.out).at(0)["kind"], "sdcp3");
  const RunResult added =
      machines({"add", "saturn-1", "--kind", "sdcp3", "--address", address, "--printer", "saturn",
                "--discovery-port", std::to_string(made.peer.udp)});
  EXPECT_EQ(added.exit_code, 0) << added.err;
  EXPECT_EQ(machines({"add", "saturn-1", "--kind", "sdcp3", "--address", address}).exit_code, 2);
  const std::string part = made.file();
  const RunResult tested = machines({"test", "saturn-1", part});
  EXPECT_EQ(tested.exit_code, 0) << tested.err;
  EXPECT_THAT(tested.out, HasSubstr("192 x 108"));
  EXPECT_THAT(tested.out, HasSubstr("may be sent"));
  EXPECT_EQ(machines({"test", "saturn-1", made.file(2, 100, 100)}).exit_code, 2);
  const RunResult sent = machines({"send", part, "saturn-1"});
  EXPECT_EQ(sent.exit_code, 0) << sent.err;
  EXPECT_THAT(sent.out, HasSubstr("part-1-"));
  EXPECT_EQ(machines({"start", "saturn-1"}).exit_code, 2);
  EXPECT_EQ(made.peer.begun(), 0);
  const Command start{"start", "saturn-1", "--plate-is-empty", "--vat-is-filled"};
  const RunResult started = machines(start);
  EXPECT_EQ(started.exit_code, 0) << started.err;
  const RunResult listed = machines({"list", "--json", "-"});
  const json one = json::parse(listed.out).at(0);
  EXPECT_EQ(one["state"], "printing");
  EXPECT_EQ(one["record"]["plate_full"], true);
  EXPECT_EQ(machines({"stop", "saturn-1"}).exit_code, 0);
  EXPECT_EQ(machines(start).exit_code, 2) << "the plate is full";
  EXPECT_EQ(machines({"cleared", "saturn-1"}).exit_code, 0);
  EXPECT_THAT(machines({"watch", "--once"}).out, HasSubstr("saturn-1: idle"));
  EXPECT_EQ(made.peer.begun(), 1);
  EXPECT_EQ(machines({"list", "nobody"}).exit_code, 2);
}

TEST_F(MachineProgram, KeysAreNowhereToBeSeen) {
  MachineRoomOfTest made(peer_kinds()[3]);
  const RunResult added =
      machines({"add", "octo", "--kind", "octoprint", "--address",
                "127.0.0.1:" + std::to_string(made.peer.port), "--key-file", made.spec.key_file});
  EXPECT_EQ(added.exit_code, 0) << added.err;
  std::string all = added.out + added.err;
  for (const Command& each : {Command{"test", "octo"}, Command{"list", "--json", "-"},
                              Command{"send", made.file(), "octo"}}) {
    const RunResult r = machines(each);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    all += r.out + r.err;
  }
  for (const auto& entry : fs::recursive_directory_iterator(dir / "farm")) {
    if (entry.is_regular_file()) all += text_of_file(entry.path());
  }
  EXPECT_THAT(all, Not(HasSubstr("abcdefgh")));
  // A machine that does not answer is told, and is no error of the list.
  made.peer.tell("trap http-500");
  EXPECT_THAT(machines({"list"}).out, HasSubstr("answers 500"));
  EXPECT_EQ(machines({"test", "octo"}).exit_code, 4);
}

}  // namespace
}  // namespace slicecorr::farm
