// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Machines over the farm's own server: who may do what, what is told, metrics, messages.

#include <httplib.h>

#include <set>
#include <thread>

#include "devtools.hpp"
#include "farm_machine_room.hpp"
#include "farm_program.hpp"
#include "slicecorr/farm/notify.hpp"
#include "slicecorr/farm/serve.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

const std::string kLooker(40, 'l'), kOperator(40, 'o');

class MachinesServed : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_peer_python()) GTEST_SKIP() << "python3 is not installed";
    made = std::make_unique<MachineRoomOfTest>(peer_kinds()[3],
                                               std::vector<std::string>{"layer-s=0.05"});
    made->spec.format = "sl1";
    add_machine(made->folder, made->spec);
    ServeOptions options;
    options.accounts = {{"lena", Role::look, kLooker}, {"pia", Role::operate, kOperator}};
    server = std::make_unique<FarmServer>(made->folder, options);
    thread = std::thread([this] { server->run(); });
    EXPECT_TRUE(
        eventually([&] { return client("").Get("/healthz").error() == httplib::Error::Success; }));
  }
  void TearDown() override {
    if (server) server->stop();
    if (thread.joinable()) thread.join();
  }
  httplib::Client client(const std::string& token) const {
    httplib::Client c("127.0.0.1", server->port());
    c.set_read_timeout(30);
    if (!token.empty()) c.set_default_headers({{"Authorization", "Bearer " + token}});
    return c;
  }
  int post(const std::string& token, const std::string& what, const json& body = json::object()) {
    const auto r =
        client(token).Post("/api/v1/machines/m-1/" + what, body.dump(), "application/json");
    said = r ? r->body : "";
    return r ? r->status : -1;
  }
  json machine() const {
    const auto r = client(kLooker).Get("/api/v1/machines");
    return r ? json::parse(r->body).at("machines").at(0) : json();
  }
  bool is(const std::string& state) const {
    return eventually([&] { return machine().value("state", "") == state; });
  }
  std::unique_ptr<MachineRoomOfTest> made;
  std::unique_ptr<FarmServer> server;
  std::thread thread;
  std::string said;
};

TEST_F(MachinesServed, AreSeenAndSteeredByWhoMay) {
  EXPECT_TRUE(is("idle"));
  EXPECT_EQ(client("").Get("/machines")->status, 200);
  EXPECT_THAT(client("").Get("/pages/machines.js")->body, HasSubstr("Stop"));
  made->room().send(made->file());
  for (const char* what : {"start", "stop", "pause", "resume", "cleared", "send"}) {
    EXPECT_EQ(post(kLooker, what), 403) << what;
    EXPECT_EQ(post("", what), 401) << what;
  }
  EXPECT_EQ(post(kOperator, "start"), 409);
  EXPECT_EQ(post(kOperator, "start", {{"plate_is_empty", true}}), 409);
  EXPECT_EQ(post(kOperator, "start", {{"plate_is_empty", 1}, {"vat_is_filled", 1}}), 400);
  EXPECT_EQ(post(kOperator, "start", {{"plate", true}}), 400);
  EXPECT_EQ(post(kOperator, "burn"), 404);
  EXPECT_EQ(post(kOperator, "send", {{"job", 99}}), 404);
  EXPECT_EQ(post(kOperator, "send", json::object()), 400);
  EXPECT_EQ(made->peer.begun(), 0);
  EXPECT_EQ(post(kOperator, "start", {{"plate_is_empty", true}, {"vat_is_filled", true}}), 200)
      << said;
  EXPECT_EQ(made->peer.begun(), 1);
  EXPECT_TRUE(is("printing"));
  const json m = machine();
  EXPECT_TRUE(m["left_s"].is_number());
  EXPECT_EQ(m["record"]["plate_full"], true);
  EXPECT_EQ(post(kOperator, "start", {{"plate_is_empty", true}, {"vat_is_filled", true}}), 409);
  const std::string metrics = client(kLooker).Get("/metrics")->body;
  EXPECT_THAT(metrics, HasSubstr("slicefarm_machine_state{machine=\"m-1\",state=\"printing\"} 1"));
  EXPECT_THAT(metrics, HasSubstr("slicefarm_machine_plate_full{machine=\"m-1\"} 1"));
  made->peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return machine()["record"]["print_state"] != "begun"; }));
  // The end is told, once, and so is a machine that falls silent.
  const auto notices = [&] {
    ReadModel model(made->folder.database());
    std::multiset<std::string> kinds;
    for (const Notice& n : notices_since(model, "f", 0).list) kinds.insert(n.kind);
    return kinds;
  };
  EXPECT_TRUE(eventually([&] { return notices().count("machine_ended") == 1; }));
  EXPECT_EQ(post(kOperator, "cleared"), 200);
  made->peer.tell("trap http-500");
  EXPECT_TRUE(eventually([&] { return notices().count("machine_trouble") == 1; }));
  EXPECT_THAT(machine().dump() + said, Not(HasSubstr("abcdefgh")));
}

TEST_F(MachinesServed, JobsAreSentOneAfterTheOtherAndNoneIsStarted) {
  const std::string file = made->folder.root + "/machines.toml";
  write_file(file,
             text_of_file(file) + "printer = \"dual-wavelength-dlp\"\nsend_when_done = true\n");
  for (const int n : {1, 2}) {
    write_file(made->path("p" + std::to_string(n) + ".stl"), bridge_stl(n));
    const RunResult r =
        run_program({kSlicefarm, "submit", made->path("p" + std::to_string(n) + ".stl"), "--for",
                     "m-1", "--resin", "benchy-resin", "--layer-um", "50", "--speed-mm-h", "800",
                     "--dir", made->folder.root});
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  ASSERT_EQ(run_program({kSlicefarm, "run", "--until-empty", "--dir", made->folder.root}).exit_code,
            0);
  EXPECT_TRUE(eventually([&] { return made->room().record().sent_jobs.size() == 1; }));
  EXPECT_EQ(made->peer.happened("upload").size(), 1);
  EXPECT_EQ(made->peer.begun(), 0);
  made->room().start(kBothWords);
  made->peer.tell("finish");
  EXPECT_TRUE(eventually([&] { return made->room().record().sent_jobs.size() == 2; }));
  EXPECT_EQ(made->peer.happened("upload").size(), 2);
  EXPECT_EQ(made->peer.begun(), 1);
}

TEST_F(MachinesServed, APersonStartsAndStopsAPrintInABrowser) {
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
  made->room().send(made->file());
  DrivenPage page;
  page.look_like(1100, 900, false);
  page.open("http://127.0.0.1:" + std::to_string(server->port()) + "/machines");
  page.wait_for("document.body.dataset.ready === 'yes'");
  page.click("#who button");
  page.set("token", kOperator);
  page.click("#ask button");
  page.wait_for("document.body.dataset.ready === 'yes' && me.role === 'operate'");
  page.wait_for("document.querySelectorAll('#machine-list input').length === 2");
  const std::string print =
      "[...document.querySelectorAll('#machine-list button')]"
      ".find((b) => b.textContent.startsWith('Print ')).click()";
  page.eval(print);
  // At the button that was pressed.
  page.wait_for("document.getElementById('said-here')?.textContent.includes('word')");
  EXPECT_EQ(made->peer.begun(), 0);
  page.eval("document.querySelectorAll('#machine-list input').forEach((i) => i.click());" + print);
  page.wait_for("document.querySelector('#machine-list button.stop') !== null");
  EXPECT_EQ(made->peer.begun(), 1);
  page.click("#machine-list button.stop");
  EXPECT_TRUE(eventually([&] { return made->peer.happened("ended").size() == 1; }));
  page.wait_for("document.getElementById('machine-list').textContent.includes('full: ')");
  EXPECT_EQ(made->peer.begun(), 1);
}

}  // namespace
}  // namespace slicecorr::farm
