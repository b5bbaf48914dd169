// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A page of somebody else in a real browser on the farm's machine: it reads nothing and changes nothing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "devtools.hpp"
#include "farm_filled.hpp"
#include "farm_served.hpp"

namespace slicecorr::farm {
namespace {

using slicecorr::test::chromium;
using slicecorr::test::DrivenPage;
using test::Farm;
using test::fill;
using test::kToken;
using test::Served;
using test::with_token;

/// Another's server, whose page holds every way to send a request to the farm.
class Elsewhere {
 public:
  explicit Elsewhere(const std::string& farm) {
    server_.Get("/", [](const httplib::Request&, httplib::Response& r) {
      r.set_content("<!doctype html><title>elsewhere</title><body>", "text/html");
    });
    server_.Get("/form", [farm](const httplib::Request& q, httplib::Response& r) {
      r.set_content("<!doctype html><body><form method=post enctype=text/plain action='" + farm +
                        q.get_param_value("to") + "'><input name='{\"a\":\"' value='\"}'></form>",
                    "text/html");
    });
    port = server_.bind_to_any_port("127.0.0.1");
    thread_ = std::thread([this] { server_.listen_after_bind(); });
    while (!server_.is_running()) ::usleep(1000);
  }
  ~Elsewhere() {
    server_.stop();
    thread_.join();
  }
  int port = 0;

 private:
  httplib::Server server_;
  std::thread thread_;
};

class Rebinding : public ::testing::Test {
 protected:
  void SetUp() override {
    if (chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
    fill(farm_);
    served_ = std::make_unique<Served>(farm_, with_token());
    ours_ = fmt::format("http://127.0.0.1:{}", served_->port);
  }
  Farm farm_;
  std::unique_ptr<Served> served_;
  std::string ours_;
};

// The name of another that, asked again, leads to this machine: its pages then count as of one origin with the farm's.
TEST_F(Rebinding, ANameThatLeadsHereSeesNothing) {
  DrivenPage page;
  page.open(fmt::format("http://evil.example:{}/", served_->port));
  page.wait_for("document.readyState === 'complete'");
  EXPECT_EQ(page.eval("location.hostname"), "evil.example");
  EXPECT_EQ(page.eval("document.getElementById('who') === null"), true);
  EXPECT_EQ(page.eval("fetch('/api/v1/jobs').then(r => r.status, () => 403)"), 403);
  EXPECT_EQ(page.eval("fetch('/api/v1/pause', {method: 'POST', headers: {Authorization: 'Bearer " +
                      kToken + "'}}).then(r => r.status, () => 403)"),
            403);
  page.open(fmt::format("http://evil.example:{}/api/v1/jobs", served_->port));
  page.wait_for("document.readyState === 'complete'");
  EXPECT_THAT(page.eval("document.body.innerText").get<std::string>(),
              ::testing::HasSubstr("names another server"));
  EXPECT_FALSE(farm_.model().settings().paused);
}

TEST_F(Rebinding, APageOfAnotherSiteChangesAndReadsNothing) {
  const Elsewhere other(ours_);
  DrivenPage page;
  page.open(fmt::format("http://evil.example:{}/", other.port));
  page.wait_for("document.title === 'elsewhere'");
  const std::string auth = "headers: {Authorization: 'Bearer " + kToken + "'}";
  for (const std::string how : {"{method: 'POST'}", "{method: 'POST', mode: 'no-cors'}",
                                "{method: 'POST', mode: 'no-cors', body: '{}'}"}) {
    page.eval("fetch('" + ours_ + "/api/v1/pause', " + how + ").catch(() => 0).then(() => 0)");
  }
  page.eval("fetch('" + ours_ + "/api/v1/pause', {method: 'POST', " + auth +
            "}).catch(() => 0).then(() => 0)");
  // What it might read, by any element.
  EXPECT_EQ(page.eval("fetch('" + ours_ + "/api/v1/jobs').then(() => 'read', () => 'refused')"),
            "refused");
  EXPECT_EQ(page.eval("new Promise(done => { const i = new Image(); i.onload = () => done('read'); "
                      "i.onerror = () => done('refused'); i.src = '" +
                      ours_ + "/api/v1/timeline.svg'; })"),
            "refused");
  EXPECT_EQ(
      page.eval("new Promise(done => { const s = document.createElement('script'); s.onload = "
                "() => done('read'); s.onerror = () => done('refused'); s.src = '" +
                ours_ + "/pages/live.js'; document.body.append(s); })"),
      "refused");
  EXPECT_EQ(
      page.eval("new Promise(done => { const f = document.createElement('iframe'); f.onload = "
                "() => { let seen; try { seen = f.contentDocument !== null } catch { seen = "
                "false } done(seen); }; f.src = '" +
                ours_ + "/'; document.body.append(f); })"),
      false);
  for (const char* to : {"/api/v1/pause", "/api/v1/drain", "/api/v1/jobs/1/cancel"}) {
    page.open(fmt::format("http://evil.example:{}/form?to={}", other.port, to));
    page.wait_for("document.forms.length === 1");
    page.eval("document.forms[0].submit()");
    page.wait_for("location.href.startsWith('" + ours_ +
                  "') && document.readyState === 'complete'");
  }
  EXPECT_FALSE(farm_.model().settings().paused);
  EXPECT_FALSE(farm_.model().settings().draining);
}

}  // namespace
}  // namespace slicecorr::farm
