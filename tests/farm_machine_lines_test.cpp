// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What docs/machines.md promises of prints and of keys, line by line, on machines of all kinds.

#include <httplib.h>

#include "bridge_fixture.hpp"
#include "farm_machine_room.hpp"
#include "farm_program.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;

class MachineLines : public testing::TestWithParam<PeerKind> {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
};

TEST_P(MachineLines, APowerCutLeavesThePlateFullAndStartsNothing) {
  MachineRoomOfTest made(GetParam());
  MachineRoom room = made.room();
  room.send(made.file());
  room.start(kBothWords);
  EXPECT_TRUE(is_print(state_of(room)));
  made.peer.tell("power");
  EXPECT_TRUE(eventually([&] { return is_at_rest(state_of(room)); }));
  EXPECT_TRUE(room.record().plate_full);
  EXPECT_NE(room.record().print_state, "finished");
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("plate is full"));
  EXPECT_EQ(made.peer.begun(), 1);
  room.cleared();
  // The file outlasts the reboot, and is not sent again.
  const std::size_t parts = made.peer.happened("part").size() + made.peer.happened("upload").size();
  room.send(made.file());
  EXPECT_EQ(made.peer.happened("part").size() + made.peer.happened("upload").size(), parts);
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 2);
}

TEST_P(MachineLines, OtherPeoplesPrintsFillThePlate) {
  MachineRoomOfTest made(GetParam());
  MachineRoom room = made.room();
  room.send(made.file());
  made.peer.tell("print theirs." + GetParam().ending);
  EXPECT_TRUE(eventually([&] { return is_print(state_of(room)); }));
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("at rest"));
  EXPECT_THAT(refusal([&] { room.send(made.file(2)); }), HasSubstr("nothing was sent"));
  EXPECT_TRUE(room.record().plate_full);
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return is_at_rest(state_of(room)); }));
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("did not start"));
  EXPECT_EQ(made.peer.begun(), 1);
  room.cleared();
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 2);
}

TEST_P(MachineLines, TwoFarmsOnOneMachineStartOnePrint) {
  MachineRoomOfTest made(GetParam());
  const FarmFolderOfTest other_made;
  MachineRoom room = made.room();
  MachineRoom theirs(open_folder(other_made.path()), made.spec, quick_times());
  room.send(made.file(1));
  theirs.send(made.file(2));
  theirs.start(kBothWords);
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("at rest"));
  EXPECT_TRUE(room.look().record.plate_full);
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return is_at_rest(state_of(room)); }));
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("did not start"));
  EXPECT_EQ(made.peer.begun(), 1);
}

TEST_P(MachineLines, AnotherAddressIsStillTheSameMachine) {
  MachineRoomOfTest made(GetParam());
  {
    MachineRoom room = made.room();
    room.send(made.file());
    room.start(kBothWords);
  }
  // It is reached under another name from now on: nothing is lost, nothing starts.
  made.spec.host = "localhost";
  MachineRoom room = made.room();
  EXPECT_TRUE(is_print(state_of(room)));
  EXPECT_EQ(room.record().print_state, "begun");
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return is_at_rest(state_of(room)); }));
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("plate is full"));
  // At an address where nobody is nothing is sent, and what is known stays.
  made.spec.host = "127.0.0.1";
  made.spec.port = 9;
  MachineRoom nobody = made.room();
  EXPECT_EQ(nobody.look().status.state, MachineState::unknown);
  EXPECT_TRUE(nobody.record().plate_full);
  EXPECT_EQ(made.peer.begun(), 1);
}

INSTANTIATE_TEST_SUITE_P(All, MachineLines, testing::ValuesIn(peer_kinds()), [](const auto& info) {
  std::string name = info.param.peer;
  std::erase(name, '-');
  return name;
});

// --- the farm as a program ------------------------------------------------------------------------

/// `slicefarm serve` of a farm, until it is ended.
class Served {
 public:
  explicit Served(const FarmFolder& folder)
      : err(folder.root + ".err"),
        child_({kSlicefarm, "serve", "--listen", "127.0.0.1:0", "--dir", folder.root}, err) {
    const std::string line = child_.line();
    const std::size_t colon = line.rfind(':');
    port_ = colon == line.npos ? 0 : std::atoi(line.c_str() + colon + 1);
  }
  std::string get(const std::string& path) const {
    httplib::Client client("127.0.0.1", port_);
    client.set_read_timeout(30);
    const auto answer = client.Get(path);
    return answer ? answer->body : "";
  }
  json machines() const {
    const json all = json::parse(get("/api/v1/machines"), nullptr, false);
    return all.is_object() ? all["machines"] : json::array();
  }
  int end(int signal) { return child_.end(signal); }
  /// The most memory that it had, MiB.
  double most_mib() const {
    std::istringstream status(text_of_file("/proc/" + std::to_string(child_.pid()) + "/status"));
    for (std::string line; std::getline(status, line);) {
      if (line.starts_with("VmHWM:")) return std::atof(line.c_str() + 6) / 1024;
    }
    return 0;
  }
  const std::string err;

 private:
  Child child_;
  int port_ = 0;
};

class MachineFarms : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
};

TEST_F(MachineFarms, APrintSurvivesTheFarmsEnd) {
  MachineRoomOfTest made(peer_kinds()[1]);
  add_machine(made.folder, made.spec);
  made.room().send(made.file());
  {
    Served served(made.folder);
    made.room().start(kBothWords);
    EXPECT_TRUE(eventually([&] {
      const json all = served.machines();
      return !all.empty() && all[0]["state"] == "printing";
    }));
    served.end(SIGKILL);
  }
  EXPECT_EQ(made.peer.log()["printing"], true);
  made.peer.tell("finish");
  // Whoever comes back asks what became of it.
  Served again(made.folder);
  EXPECT_TRUE(eventually([&] {
    const json all = again.machines();
    return !all.empty() && all[0]["record"]["print_state"] == "finished";
  }));
  EXPECT_EQ(again.machines()[0]["record"]["plate_full"], true);
  EXPECT_EQ(made.peer.begun(), 1);
}

TEST_F(MachineFarms, KeysAreInNoLogPageRecordOrMessage) {
  for (const std::size_t kind : {1U, 3U, 4U}) {
    const bool nano = peer_kinds()[kind].peer == "nanodlp";
    MachineRoomOfTest made(peer_kinds()[kind], nano ? std::vector<std::string>{"password"}
                                                    : std::vector<std::string>{});
    made.spec.key_file = made.path("key");
    made.spec.user = nano ? "maker" : "";
    write_file(made.spec.key_file, std::string("abcdefgh\n"));
    ::chmod(made.spec.key_file.c_str(), 0600);
    add_machine(made.folder, made.spec);
    std::string all;
    {
      made.room().send(made.file());
      Served served(made.folder);
      EXPECT_TRUE(eventually([&] {
        const json list = served.machines();
        return !list.empty() && list[0]["record"]["file_state"] == "stored";
      }));
      // A login that fails tells of itself, too.
      write_file(made.spec.key_file, std::string("ijklmnop\n"));
      const RunResult wrong =
          run_program({kSlicefarm, "machines", "test", made.spec.name, "--dir", made.folder.root});
      EXPECT_NE(wrong.exit_code, 0);
      all += wrong.out + wrong.err;
      for (const char* page : {"/machines", "/api/v1/machines", "/metrics", "/report",
                               "/api/v1/events", "/api/v1/overview"}) {
        const std::string text = served.get(page);
        EXPECT_FALSE(text.empty()) << page;
        all += text;
      }
      EXPECT_THAT(served.get("/machines"), HasSubstr("without encryption"));
      EXPECT_EQ(served.end(SIGTERM), 0);
      all += text_of_file(served.err);
    }
    for (const auto& entry : fs::recursive_directory_iterator(made.folder.root)) {
      if (entry.is_regular_file() && entry.path() != made.spec.key_file) {
        all += text_of_file(entry.path());
      }
    }
    EXPECT_THAT(all, HasSubstr(made.spec.name));
    EXPECT_EQ(all.find("abcdefgh"), all.npos) << peer_kinds()[kind].peer;
    EXPECT_EQ(all.find("ijklmnop"), all.npos) << peer_kinds()[kind].peer;
  }
}

TEST_F(MachineFarms, FiftyMachinesAreWatchedWithinAMebibyteEach) {
  constexpr int many = 50;
  MachinePeer peer("odyssey");
  const auto most_with = [&](int count) {
    const FarmFolderOfTest made;
    const FarmFolder folder = open_folder(made.path());
    std::string text;
    for (int i = 0; i < count; ++i) {
      text += "[[machine]]\nname = \"m" + std::to_string(i) +
              "\"\nkind = \"odyssey\"\naddress = \"127.0.0.1:" + std::to_string(peer.port) + "\"\n";
    }
    write_file(folder.root + "/machines.toml", text);
    Served served(folder);
    EXPECT_TRUE(eventually([&] {
      const json all = served.machines();
      return std::count_if(all.begin(), all.end(),
                           [](const json& m) { return m["state"] == "idle"; }) == count;
    }));
    const double mib = served.most_mib();
    EXPECT_EQ(served.end(SIGTERM), 0);
    return mib;
  };
  const double one = most_with(1), all = most_with(many);
  RecordProperty("one_mib", std::to_string(one));
  RecordProperty("fifty_mib", std::to_string(all));
  // A thread, a connection and an answer of some hundred bytes for each machine.
  EXPECT_LT(all - one, many * 1.0 * kSlowdown);
}

TEST_F(MachineFarms, AnotherMachineAtTheAddressIsRefused) {
  MachineRoomOfTest made(peer_kinds()[0]);
  made.spec.id = "00000000000abcde";
  MachineRoom room = made.room();
  EXPECT_THAT(refusal([&] { room.send(made.file()); }), HasSubstr("another machine answers"));
  EXPECT_TRUE(made.peer.happened("part").empty());
}

}  // namespace
}  // namespace slicecorr::farm
