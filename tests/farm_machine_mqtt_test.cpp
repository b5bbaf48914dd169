// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// SDCP 1: packets byte for byte, and a board in another language that comes as a client.

#include "farm_machine_room.hpp"
#include "machines/mqtt.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "support/files/sha256.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using detail::mqtt_packet;
using nlohmann::json;
using testing::HasSubstr;
using testing::MatchesRegex;

std::string hex(const std::string& bytes) {
  std::string text;
  for (const char c : bytes) {
    const auto u = static_cast<unsigned char>(c);
    text += "0123456789abcdef"[u >> 4];
    text += "0123456789abcdef"[u & 15];
  }
  return text;
}

TEST(Mqtt, PacketsAreThoseOfTheStandard) {
  const std::string p =
      detail::mqtt_publish("/sdcp/request/ABCD1234ABCD1234", R"({"Id":"x","Data":{"Cmd":0}})");
  EXPECT_EQ(p.size(), 61);
  EXPECT_EQ(hex(p.substr(0, 9)), "303b001e2f73646370");
  EXPECT_EQ(hex(mqtt_packet(0x30, std::string(321, 'x')).substr(0, 3)), "30c102");
  EXPECT_EQ(hex(mqtt_packet(0xD0, "")), "d000");
  // Packets come in pieces, and several at once.
  std::string bytes;
  const std::string both = p + mqtt_packet(0xC0, "");
  for (std::size_t i = 0; i + 1 < p.size(); ++i) {
    bytes += both[i];
    EXPECT_FALSE(detail::take_packet(bytes));
  }
  bytes += both.substr(p.size() - 1);
  EXPECT_EQ(detail::take_packet(bytes)->type(), detail::kMqttPublish);
  EXPECT_EQ(detail::take_packet(bytes)->type(), detail::kMqttPing);
  EXPECT_TRUE(bytes.empty());
  for (std::string wrong :
       {std::string("\x30\xff\xff\xff\xff\x01"), std::string("\x30\xff\xff\xff\x7f")}) {
    EXPECT_THROW(detail::take_packet(wrong), DeviceError);
  }
}

class Sdcp1 : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
  }
  const PeerKind kind{"sdcp1", MachineKind::sdcp1, "goo"};
};

TEST_F(Sdcp1, APrintFromItsFileToItsEnd) {
  MachineRoomOfTest made(kind, {"layer-s=0.05", "ignore-call"});
  const std::string part = made.file();
  {
    MachineRoom room = made.room();
    EXPECT_EQ(room.look().status.state, MachineState::idle);
    EXPECT_EQ(room.facts().width_px, 192);
  }
  // Each act may be another program; the machine comes again.
  MachineRoom room = made.room();
  const std::string name = room.send(part);
  EXPECT_EQ(made.peer.log()["files"].value(name, ""), cli::sha256_of_contents(part));
  EXPECT_EQ(made.peer.begun(), 0);
  const json order = made.peer.happened("order").at(0);
  EXPECT_THAT(order.value("url", ""), MatchesRegex("http://\\$\\{ipaddr\\}:[0-9]+/[0-9a-f]+/.*"));
  EXPECT_EQ(order["keys"],
            json({"Check", "CleanCache", "Compress", "FileSize", "Filename", "MD5", "URL"}));
  for (const json& fetched : made.peer.happened("fetched")) {
    EXPECT_EQ(fetched["status"], 200);
    EXPECT_EQ(fetched["length"], true);
  }
  EXPECT_EQ(made.peer.happened("connack").at(0)["hex"], "20020000");
  EXPECT_EQ(made.peer.happened("pingresp").at(0)["hex"], "d000");
  EXPECT_EQ(made.peer.happened("suback").at(0)["hex"], "9003000500");
  for (const json& cmd : made.peer.happened("cmd")) {
    EXPECT_EQ(cmd["topic"], "/sdcp/request/000000000001d354");
    EXPECT_EQ(cmd["has_topic"], false);
    EXPECT_GT(cmd["ms"], 1'000'000'000'000);
  }
  room.start(kBothWords);
  EXPECT_EQ(made.peer.begun(), 1);
  room.pause();
  EXPECT_TRUE(eventually([&] { return room.look().status.state == MachineState::paused; }));
  room.resume();
  made.peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return room.look().status.state == MachineState::finished; }));
  EXPECT_EQ(room.record().print_state, "finished");
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("plate is full"));
}

TEST_F(Sdcp1, HalfAFileIsNone) {
  MachineRoomOfTest made(kind, {"short"});
  MachineRoom room = made.room();
  const std::string part = made.file();
  EXPECT_THAT(refusal([&] { room.send(part); }), HasSubstr("dropped"));
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("no whole file"));
  room.send(part);
  made.peer.tell("trap lose-answer-128");
  room.start(kBothWords);  // the connection ends, and the machine is found printing
  EXPECT_EQ(made.peer.begun(), 1);
}

}  // namespace
}  // namespace slicecorr::farm
