// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm as a printer that speaks SDCP 3: a client in another language, written from the description of
// the protocol alone, and our own adapter.

#include <thread>

#include "farm_machine_room.hpp"
#include "refusal.hpp"
#include "serve/part_form.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/as_sdcp.hpp"
#include "slicecorr/farm/read_model.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(PartForms, AreReadStrictly) {
  const std::string type = "multipart/form-data; boundary=x";
  const std::string body =
      "--x\r\nContent-Disposition: form-data; name=\"Offset\"\r\n\r\n7\r\n"
      "--x\r\nContent-Disposition: form-data; name=\"File\"; filename=\"a.goo\"\r\n\r\n\r\n--y\r\n\r\n"
      "--x--\r\n";
  const auto form = detail::read_part_form(type, body);
  ASSERT_TRUE(form);
  EXPECT_EQ(form->number("Offset"), 7);
  EXPECT_EQ(form->number("Total"), -1);
  EXPECT_EQ(form->file_name, "a.goo");
  EXPECT_EQ(form->bytes, "\r\n--y\r\n");
  for (std::size_t i = 0; i + 4 < body.size(); ++i) {
    EXPECT_FALSE(detail::read_part_form(type, body.substr(0, i))) << i;
  }
  EXPECT_FALSE(detail::read_part_form("text/plain", body));
  EXPECT_FALSE(detail::read_part_form("multipart/form-data; boundary=", body));
}

class AsSdcp : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
    made = std::make_unique<MachineRoomOfTest>(peer_kinds()[0]);
    made->spec.name = "saturn-1";
    made->spec.printer = "dual-wavelength-dlp";
    made->spec.width_px = 1280;
    made->spec.height_px = 800;
    add_machine(made->folder, made->spec);
    const std::string file = made->folder.root + "/machines.toml";
    write_file(
        file,
        text_of_file(file) +
            "[machine.job]\nresin = \"benchy-resin\"\nmode = \"continuous\"\nspeed_mm_h = 800\n");
  }
  void serve(std::vector<std::string> clients = {"127.0.0.1"}) {
    AsSdcpOptions options;
    options.like.machine = "saturn-1";
    options.like.times = quick_times();
    options.like.submit = make_submitter({made->folder, {}, "anna"});
    options.udp_port = 0;
    options.clients = std::move(clients);
    server = std::make_unique<SdcpPrinter>(made->folder, options);
    thread = std::thread([this] { server->run(); });
  }
  void TearDown() override {
    if (server) server->stop();
    if (thread.joinable()) thread.join();
  }
  json client(const std::string& file, const std::string& name, const Command& more = {}) const {
    const RunResult r = run_program(
        Command{kPeerPython, "-B", SLICECORR_SOURCE_DIR "/tests/machine_client.py", "127.0.0.1",
                std::to_string(server->port()), std::to_string(server->udp_port()), file, name} +
        more);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return json::parse(r.out, nullptr, false);
  }
  std::vector<Job> jobs() const { return ReadModel(made->folder.database()).jobs({}); }

  std::unique_ptr<MachineRoomOfTest> made;
  std::unique_ptr<SdcpPrinter> server;
  std::thread thread;
};

TEST_F(AsSdcp, WhatASlicerSendsIsQueuedByTheRule) {
  serve();
  const json told = client(made->file(1, 1280, 800), "part.goo");
  EXPECT_EQ(told["found"]["ProtocolVersion"], "V3.0.0");
  EXPECT_EQ(told["pong"], "pong");
  EXPECT_EQ(told["attributes"]["Resolution"], "1280x800");
  EXPECT_THAT(told["attributes"]["SupportFileType"], Contains("GOO"));
  EXPECT_EQ(told["wrong_place"]["messages"][0]["message"], -2);
  EXPECT_EQ(told["parts"][0]["code"], "000000");
  EXPECT_EQ(told["states"].back(), json::array({0}));
  EXPECT_THAT(told["listed"], Contains("/local/part.goo"));
  EXPECT_THAT(told["errors"], IsEmpty());
  EXPECT_NE(told["start"]["Ack"], 0) << "it starts nothing by itself";
  ASSERT_EQ(jobs().size(), 1);
  EXPECT_EQ(jobs()[0].name, "part");
  EXPECT_THAT(jobs()[0].labels, ElementsAre("for saturn-1"));
  EXPECT_EQ(jobs()[0].resin, "benchy-resin");
  EXPECT_EQ(made->peer.begun(), 0);
  // Our own adapter finds it a printer like any other, with the real one's state.
  MachineSpec spec;
  spec.name = "farm";
  spec.host = "127.0.0.1";
  spec.port = server->port();
  spec.discovery_port = server->udp_port();
  const FarmFolderOfTest other;
  MachineRoom room(open_folder(other.path()), spec, quick_times());
  EXPECT_EQ(room.look().status.state, MachineState::idle);
  room.send(made->file(2, 1280, 800));
  EXPECT_EQ(jobs().size(), 2);
  EXPECT_THAT(refusal([&] { room.start(kBothWords); }), HasSubstr("busy"));
  MachineRoom real = made->room();
  real.send(made->file(3, 1280, 800));
  real.start(kBothWords);
  EXPECT_TRUE(eventually([&] { return room.look().status.state == MachineState::printing; }));
  room.stop();
  EXPECT_EQ(made->peer.happened("ended").size(), 1);
}

TEST_F(AsSdcp, WhatDoesNotFitIsDroppedAndToldAndQueuesNothing) {
  serve();
  const json wrong = client(made->file(1, 100, 100), "part.goo");
  EXPECT_EQ(wrong["parts"][0]["code"], "000000");
  EXPECT_THAT(wrong["listed"], IsEmpty());
  EXPECT_THAT(wrong["errors"], ElementsAre(2));
  const json changed = client(made->file(2, 1280, 800), "part.goo", {"--md5"});
  EXPECT_THAT(changed["listed"], IsEmpty());
  EXPECT_THAT(changed["errors"], ElementsAre(1));
  const json hidden = client(made->file(2, 1280, 800), ".part.goo");
  EXPECT_EQ(hidden["parts"][0]["messages"][0]["message"], -3);
  EXPECT_TRUE(jobs().empty());
}

TEST_F(AsSdcp, IsNotThereForOthers) {
  serve({"127.0.0.9"});
  EXPECT_TRUE(client(made->file(1, 1280, 800), "part.goo")["found"].is_null());
  MachineSpec spec;
  spec.name = "farm";
  spec.host = "127.0.0.1";
  spec.port = server->port();
  spec.discovery_port = server->udp_port();
  EXPECT_THROW(make_adapter(spec, quick_times())->status(), DeviceError);
  AsSdcpOptions nobody;
  nobody.like.machine = "saturn-1";
  EXPECT_THAT(refusal([&] { SdcpPrinter(made->folder, nobody); }), HasSubstr("no login"));
}

}  // namespace
}  // namespace slicecorr::farm
