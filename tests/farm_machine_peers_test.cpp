// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Machines in another language, written from the descriptions of their protocols alone: whole prints,
// and everything that goes wrong on the way.

#include <random>

#include "farm_machine_room.hpp"
#include "farm_program.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "support/files/sha256.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

const PeerKind kSdcp3 = peer_kinds()[0];

std::string trouble(const std::function<void()>& f) {
  try {
    f();
  } catch (const DeviceError& e) {
    return e.what();
  }
  ADD_FAILURE() << "nothing was in doubt";
  return "";
}

class MachinePeers : public testing::TestWithParam<PeerKind> {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
};
INSTANTIATE_TEST_SUITE_P(Kinds, MachinePeers, testing::ValuesIn(peer_kinds()), [](const auto& p) {
  std::string name = p.param.peer;
  std::erase(name, '-');
  return name;
});

TEST_P(MachinePeers, APrintFromItsFileToItsEnd) {
  MachineRoomOfTest made(GetParam(), {"layer-s=0.05", "split", "floats", "ignore-ping"});
  MachineRoom room = made.room();
  const std::string part = made.file();
  EXPECT_EQ(state_of(room), MachineState::idle);
  EXPECT_TRUE(room.check(part).against.empty());
  const std::string name = room.send(part);
  EXPECT_THAT(name, AllOf(HasSubstr("part-1-"), HasSubstr(GetParam().ending)));
  EXPECT_EQ(made.peer.log()["files"].value(name, ""), cli::sha256_of_contents(part));
  EXPECT_EQ(made.peer.begun(), 0) << "an upload started a print";
  // Without both words nothing starts.
  EXPECT_THAT(refusal([&] { room.start({true, false}); }), HasSubstr("word"));
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 1);
  const MachineView view = room.look();
  EXPECT_TRUE(is_print(view.status.state)) << name_of(view.status.state);
  EXPECT_TRUE(view.status.left_s.has_value());
  EXPECT_TRUE(view.record.plate_full);
  // While it prints it takes nothing else.
  const std::string other = made.file(2);
  EXPECT_THAT(refusal([&] { room.send(other); }), HasSubstr("nothing was sent"));
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("at rest"));
  EXPECT_THAT(refusal([&] { room.cleared(); }), HasSubstr("can't be empty"));
  room.pause();
  EXPECT_TRUE(eventually([&] { return state_of(room) == MachineState::paused; }));
  room.resume();
  EXPECT_TRUE(eventually([&] { return state_of(room) == MachineState::printing; }));
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return is_at_rest(state_of(room)); }));
  const std::string how = room.record().print_state;
  EXPECT_TRUE(how == "finished" || how == "ended") << how;
  // What hangs on the plate keeps the next one off.
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("plate is full"));
  EXPECT_EQ(made.peer.begun(), 1);
  room.cleared();
  // The same file is there, whole, and not sent again.
  EXPECT_EQ(room.send(part), name);
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 2);
  room.stop();
  EXPECT_TRUE(eventually([&] { return is_at_rest(state_of(room)); }));
  EXPECT_EQ(room.record().print_state, "stopped");
}

TEST_P(MachinePeers, AFileThatIsDroppedIsNotThere) {
  MachineRoomOfTest made(GetParam(), {"junk"});
  MachineRoom room = made.room();
  const std::string part = made.file();
  EXPECT_THAT(refusal([&] { room.send(part); }), HasSubstr("dropped"));
  EXPECT_EQ(room.record().file_state, "broken");
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("no whole file"));
  made.peer.tell("untrap junk");
  room.send(part);
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 1);
}

// Numbers of the protocol are told in its words (ErrorStatusReason in the history of prints, ErrorCode of the topic of
// errors), to whoever clears the plate and to whoever sent the file.
TEST(MachinePeersAlone, Sdcp3SaysInWordsWhyAPrintFailedAndAFileWasDropped) {
  if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  {
    MachineRoomOfTest made(kSdcp3, {"layer-s=5", "reason=5"});
    MachineRoom room = made.room();
    room.send(made.file());
    room.start(kBothWords);
    made.peer.tell("power");
    EXPECT_TRUE(eventually([&] {
      static_cast<void>(room.look());
      return room.record().print_state == "failed";
    })) << room.record().print_state;
    EXPECT_EQ(room.record().print_why, "there is no resin");
    EXPECT_THAT(refusal([&] { room.start(kBothWords); }),
                HasSubstr("a print ended: failed (there is no resin)"));
  }
  MachineRoomOfTest made(kSdcp3, {"junk", "error-push=1"});
  MachineRoom room = made.room();
  EXPECT_THAT(refusal([&] { room.send(made.file()); }),
              AllOf(HasSubstr("dropped"),
                    HasSubstr("it says: the checksum of the file that it got is wrong")));
}

TEST_P(MachinePeers, AnUploadThatBreaksCountsForNothing) {
  MachineRoomOfTest made(GetParam(), {"reset-at=5000"});
  MachineRoom room = made.room();
  const std::string part = made.path("long." + GetParam().ending);
  const Images images = random_images(400, 400, 30, 3);
  StackInfo info = info_of(images.grid);
  info.exposure_s = 2;
  write_stack(part, images, info);
  made.spec.width_px = 400;
  made.spec.height_px = 400;
  MachineRoom large = made.room();
  if (GetParam().kind == MachineKind::sdcp3) {
    large.send(part);  // a part that gets no answer is sent again
  } else {
    EXPECT_THAT(trouble([&] { large.send(part); }), HasSubstr("no answer"));
    EXPECT_EQ(large.record().file_state, "broken");
    large.send(part);
  }
  EXPECT_EQ(made.peer.log()["files"].value(large.record().file, ""), cli::sha256_of_contents(part));
  EXPECT_EQ(made.peer.begun(), 0);
}

TEST_P(MachinePeers, AStartThatIsDroppedIsNotRepeated) {
  MachineRoomOfTest made(GetParam(), {"start-ignored"});
  MachineRoom room = made.room();
  room.send(made.file());
  EXPECT_THAT(trouble([&] { room.start(kBothWords); }), HasSubstr("not known"));
  EXPECT_EQ(room.record().print_state, "asked");
  made.peer.tell("untrap start-ignored");
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("plate is full"));
  EXPECT_EQ(made.peer.begun(), 0);
  room.cleared();
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 1);
}

TEST_P(MachinePeers, AStartWhoseAnswerIsLostIsFoundAgain) {
  const bool sdcp = GetParam().kind == MachineKind::sdcp3;
  MachineRoomOfTest made(GetParam(), {sdcp ? "lose-answer-128" : "lose-start"});
  MachineRoom room = made.room();
  room.send(made.file());
  room.start(kBothWords);  // the status shows it
  EXPECT_EQ(made.peer.begun(), 1);
  EXPECT_EQ(room.record().print_state, "begun");
  EXPECT_EQ(made.peer.happened("answer lost").size(), 1);
}

TEST_P(MachinePeers, WrongFilesAreRefusedBeforeTheFirstByte) {
  MachineRoomOfTest made(GetParam());
  made.spec.width_px = 192;
  made.spec.height_px = 108;
  MachineRoom room = made.room();
  EXPECT_THAT(refusal([&] { room.send(made.file(1, 190, 108)); }), HasSubstr("190 x 108"));
  write_file(made.path("a.stl"), std::string("solid"));
  EXPECT_THAT(refusal([&] { room.send(made.path("a.stl")); }), HasSubstr("nothing was sent"));
  write_file(made.path("empty." + GetParam().ending), std::string());
  EXPECT_THAT(refusal([&] { room.send(made.path("empty." + GetParam().ending)); }),
              HasSubstr("is empty"));
  EXPECT_TRUE(made.peer.happened("part").empty());
  EXPECT_TRUE(made.peer.happened("upload").empty());
}

// --- SDCP 3 ---------------------------------------------------------------------------------------

class Sdcp3 : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
};

TEST_F(Sdcp3, PartsAreThoseOfTheProtocol) {
  MachineRoomOfTest made(kSdcp3);
  const auto upload = [&](std::size_t bytes) {
    std::string text(bytes, '\0');
    for (std::size_t i = 0; i < bytes; ++i) text[i] = static_cast<char>(i % 251);
    write_file(made.path("x.goo"), text);
    const std::size_t before = made.peer.happened("part").size();
    make_adapter(made.spec, quick_times())->upload(machine_file(made.path("x.goo")), {});
    std::vector<json> parts = made.peer.happened("part");
    parts.erase(parts.begin(), parts.begin() + static_cast<std::ptrdiff_t>(before));
    return parts;
  };
  const std::vector<json> parts = upload(2621440);
  ASSERT_EQ(parts.size(), 3);
  const std::pair<int, const char*> expected[] = {{0, "8f293a2f6c19b345152f7a49bb4c643c"},
                                                  {1048576, "b66f7bda0d9b13d834b1b87ede0a33bb"},
                                                  {2097152, "d753f03ae9ab80f0aa595b781db2904b"}};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(parts[i]["offset"], expected[i].first);
    EXPECT_EQ(parts[i]["own_md5"], expected[i].second);
    EXPECT_EQ(parts[i]["md5"], "3777773793cc4ccade1c3c12b410705c");
    EXPECT_EQ(parts[i]["total"], 2621440);
    EXPECT_EQ(parts[i]["uuid"], parts[0]["uuid"]);
    EXPECT_EQ(parts[i]["check"], "1");
    EXPECT_EQ(parts[i]["order"],
              json({"S-File-MD5", "Check", "Offset", "Uuid", "TotalSize", "File"}));
  }
  EXPECT_EQ(parts[2]["bytes"], 524288);
  EXPECT_EQ(upload(2097152).size(), 2);
  EXPECT_EQ(upload(1).size(), 1);
}

TEST_F(Sdcp3, ACallIsSixLetters) {
  for (const char* trap : {"none", "v1-shape"}) {
    MachinePeer peer("sdcp3", {trap});
    const auto found = discover_machines({"127.0.0.1:" + std::to_string(peer.udp)}, 2);
    ASSERT_EQ(found.size(), 1);
    EXPECT_EQ(found[0].host, "127.0.0.1") << "an address that the machine only believes to have";
    EXPECT_EQ(found[0].id, "000000000001d354");
    EXPECT_EQ(found[0].kind, *trap == 'n' ? MachineKind::sdcp3 : MachineKind::sdcp1);
    EXPECT_EQ(peer.happened("datagram").at(0)["hex"], "4d3939393939");
  }
}

TEST_F(Sdcp3, AnAnswerThatIsLostBeginsTheUploadAnew) {
  MachineRoomOfTest made(kSdcp3, {"lose-part-answer"});
  write_file(made.path("x.goo"), std::string(1500000, 'x'));
  const MachineFile file = machine_file(made.path("x.goo"));
  const auto adapter = make_adapter(made.spec, quick_times());
  adapter->upload(file, {});
  // The part that was taken is another offset when it comes again: then all begins anew.
  EXPECT_EQ(made.peer.happened("offset").size(), 1);
  const std::vector<json> parts = made.peer.happened("part");
  ASSERT_EQ(parts.size(), 4);
  EXPECT_NE(parts.front()["uuid"], parts.back()["uuid"]);
  EXPECT_TRUE(eventually([&] { return adapter->holds(file.name).has_value(); }));
  EXPECT_EQ(made.peer.log()["files"].value(file.name, ""), file.sha256);
}

TEST_F(Sdcp3, WhatIsNoAnswerToAnUploadIsNone) {
  MachineRoomOfTest made(kSdcp3, {"html"});
  MachineRoom room = made.room();
  EXPECT_THAT(refusal([&] { room.send(made.file()); }), HasSubstr("no answer to an upload"));
  made.peer.tell("untrap html");
  made.peer.tell("trap refuse-part");
  EXPECT_THAT(refusal([&] { room.send(made.file()); }), HasSubstr("can't open"));
}

TEST_F(Sdcp3, BusyIsAskedAgainAndRefusalsAreNamed) {
  MachineRoomOfTest made(kSdcp3, {"busy=3"});
  MachineRoom room = made.room();
  room.send(made.file());
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 1);
  EXPECT_EQ(made.peer.happened("busy").size(), 3);
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return is_at_rest(state_of(room)); }));
  room.cleared();
  made.peer.tell("trap start-ack=5");
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("another resolution"));
  EXPECT_FALSE(room.record().plate_full) << "nothing was begun";
  made.peer.tell("untrap start-ack");
  made.peer.tell("trap lose-cmd-128");
  EXPECT_THAT(trouble([&] { room.start(kBothWords); }), HasSubstr("not known"));
  EXPECT_EQ(made.peer.begun(), 1);
  for (const json& cmd : made.peer.happened("cmd")) {
    EXPECT_EQ(cmd["topic"], "sdcp/request/000000000001d354");
    if (cmd["cmd"] == 128) {
      EXPECT_EQ(cmd["data"].size(), 2);
    }
  }
}

TEST_F(Sdcp3, WhoNeverSaysItsStatusIsNotIdle) {
  MachineRoomOfTest made(kSdcp3, {"no-push"});
  MachineTimes times = quick_times();
  times.answer_s = 0.6 * kSlowdown;
  MachineRoom room = made.room(times);
  const MachineView view = room.look();
  EXPECT_EQ(view.status.state, MachineState::unknown);
  EXPECT_THAT(view.status.trouble, HasSubstr("never says its status"));
  EXPECT_THROW(room.send(made.file()), DeviceError);
  EXPECT_TRUE(made.peer.happened("part").empty());
}

TEST_F(Sdcp3, OldLayersAndUnknownPhases) {
  MachineRoomOfTest made(kSdcp3, {"unknown-phase", "missing", "nested-status", "phase-stays"});
  MachineRoom room = made.room();
  room.send(made.file());
  room.start(kBothWords);
  EXPECT_EQ(room.look().status.phase, "other (99)");
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return state_of(room) == MachineState::finished; }));
  EXPECT_EQ(room.record().print_state, "finished");
}

TEST_F(Sdcp3, TwoFarmsAndOtherPeoplesPrints) {
  MachineRoomOfTest made(kSdcp3);
  const FarmFolderOfTest other_made;
  const FarmFolder other = open_folder(other_made.path());
  MachineRoom room = made.room();
  MachineRoom theirs(other, made.spec, quick_times());
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

// --- others ---------------------------------------------------------------------------------------

TEST(PrusaLinkPeer, LoginsAreRenewedAndWrongOnesNotRepeated) {
  if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  MachineRoomOfTest made(peer_kinds()[1]);
  MachineRoom room = made.room();
  // More than a nonce's 30 uses.
  for (int i = 0; i < 20; ++i) EXPECT_EQ(state_of(room), MachineState::idle) << i;
  EXPECT_TRUE(made.peer.happened("wrong digest").empty());
  EXPECT_TRUE(made.peer.happened("nonce used twice").empty());
  write_file(made.spec.key_file, std::string("12345678\n"));
  MachineRoom wrong = made.room();
  for (int i = 0; i < 5; ++i) EXPECT_THAT(wrong.look().status.trouble, HasSubstr("key"));
  EXPECT_LE(made.peer.happened("wrong digest").size(), 1);
  ::chmod(made.spec.key_file.c_str(), 0644);
  MachineRoom open_to_all = made.room();
  EXPECT_THAT(open_to_all.look().status.trouble, HasSubstr("mode 0600"));
}

TEST(PrusaLinkPeer, WhatItRefusesIsTold) {
  if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  for (const int kind : {1, 2}) {
    MachineRoomOfTest made(peer_kinds()[static_cast<std::size_t>(kind)], {"full"});
    MachineRoom room = made.room();
    EXPECT_THAT(refusal([&] { room.send(made.file()); }), HasSubstr("Memory full"));
    made.peer.tell("untrap full");
    made.peer.tell("trap short");
    EXPECT_THAT(refusal([&] { room.send(made.file()); }), HasSubstr("bytes of"));
    made.peer.tell("untrap short");
    room.send(made.file());
    made.peer.tell("trap not-calibrated");
    EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("Not calibrated"));
    EXPECT_FALSE(room.record().plate_full);
    EXPECT_TRUE(made.peer.happened("print after upload").empty());
  }
}

TEST(NanoDlpPeer, PasswordsAndTimes) {
  if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  MachineRoomOfTest made(peer_kinds()[4], {"password", "layer-s=12.5"});
  EXPECT_THAT(made.room().look().status.trouble, HasSubstr("wants a password"));
  made.spec.user = "maker";
  made.spec.key_file = made.path("key");
  write_file(made.spec.key_file, std::string("abcdefgh"));
  ::chmod(made.spec.key_file.c_str(), 0600);
  MachineRoom room = made.room();
  room.send(made.file());
  EXPECT_EQ(made.peer.happened("upload").at(0)["profile"], "7");
  room.start(kBothWords);
  const MachineStatus s = room.look().status;
  EXPECT_EQ(*s.left_s, (*s.layers - *s.layer) * 12.5);
  EXPECT_TRUE(made.peer.happened("resume is not unpause").empty());
}

// --- faults at random moments ---------------------------------------------------------------------

/// Sends and starts until both are done, whatever goes wrong; people look at the machine in between.
/// Gives how many faults there were.
int print_with_faults(unsigned seed, const PeerKind& kind) {
  std::mt19937 random(seed);
  const auto below = [&](unsigned n) { return static_cast<int>(random() % n); };
  MachineRoomOfTest made(kind, {"layer-s=0.01", "layers=100000", "check-s=0.05", "list-s=0.05"});
  MachineTimes times = quick_times();
  times.shown_s = 0.15 * kSlowdown;
  times.settle_s = 0.2 * kSlowdown;
  times.listed_s = 0.3 * kSlowdown;
  times.busy_s = 0.1 * kSlowdown;
  const bool sdcp = kind.kind == MachineKind::sdcp3;
  const std::string part = made.file(seed);
  const std::string sha = cli::sha256_of_contents(part);
  const auto size = static_cast<unsigned>(fs::file_size(part));
  int begun_before = 0;
  bool done = false;
  for (int step = 0; step < 60 && !done; ++step) {
    // Fewer faults as time goes on, so that it ends.
    if (below(60) > step + 10) {
      const std::vector<std::string> traps = {"reset-at=" + std::to_string(below(size)),
                                              sdcp ? "lose-part-answer" : "lose-upload",
                                              sdcp ? "lose-answer-128" : "lose-start",
                                              sdcp ? "lose-cmd-128" : "stale",
                                              sdcp ? "lose-answer-0" : "busy",
                                              sdcp ? "lose-answer-258" : "stale",
                                              "busy"};
      made.peer.tell("trap " + traps[static_cast<std::size_t>(below(7))]);
    }
    if (below(8) == 0) made.peer.tell("power");
    // Each step is another process, as after a crash.
    MachineRoom room = made.room(times);
    try {
      room.send(part);
      room.start(kBothWords);
      done = true;
    } catch (const DeviceError&) {
    } catch (const InputError&) {
    }
    const json log = made.peer.log();
    const MachineRecord record = room.record();
    if (record.file_state == "stored") {
      EXPECT_EQ(log["files"].value(record.file, ""), sha) << "a file that is not whole counts";
    }
    const int begun = log.value("begun", -1);
    // At most one print for each time that somebody looked.
    EXPECT_LE(begun - begun_before, 1) << "a print was started twice";
    if (begun > begun_before) {
      EXPECT_TRUE(record.plate_full);
    }
    if (!done && record.plate_full) {
      // Somebody looks: ends what prints, takes it off, and says so.
      made.peer.tell("finish");
      begun_before = made.peer.begun();
      for (int i = 0; i < 50; ++i) {
        try {
          room.cleared();
          break;
        } catch (const Error&) {
        }
      }
    }
  }
  EXPECT_TRUE(done) << "seed " << seed << " " << kind.peer;
  int faults = 0;
  const json log = made.peer.log();
  for (const json& each : log["log"]) {
    const std::string what = each["what"];
    faults += what == "reset" || what == "answer lost" || what == "lost" || what == "busy" ||
              what == "power" || what == "stale";
  }
  return faults;
}

TEST(MachineFaults, NothingHalfCountsAndNothingStartsTwice) {
  if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  const int prints = rounds(6);
  int faults = 0;
  for (int i = 0; i < prints && !HasFailure(); ++i) {
    SCOPED_TRACE(i);
    faults += print_with_faults(static_cast<unsigned>(i),
                                peer_kinds()[static_cast<std::size_t>(i) % peer_kinds().size()]);
  }
  // Where nothing goes wrong nothing is shown.
  EXPECT_GT(faults, prints / 2);
  RecordProperty("prints", prints);
  RecordProperty("faults", faults);
}

}  // namespace
}  // namespace slicecorr::farm
