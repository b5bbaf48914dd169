// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The farm over HTTP: page, API, metrics; who may what; clients that mean harm.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "farm_filled.hpp"
#include "farm_program.hpp"
#include "farm_served.hpp"
#include "ladder.hpp"
#include "raw_client.hpp"
#include "run_program.hpp"
#include "serve/routes.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/serve.hpp"
#include "slicecorr/farm/status.hpp"
#include "support/http/guard.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using slicecorr::test::asked_headers;
using slicecorr::test::fault_of_answer;
using slicecorr::test::kSlicefarm;
using slicecorr::test::Raw;
using slicecorr::test::run_program;
using slicecorr::test::RunOptions;
using test::body_of;
using test::Farm;
using test::fill;
using test::Filled;
using test::kToken;
using test::Served;
using test::status_of;
using test::with_token;
using ::testing::HasSubstr;
using ::testing::Not;

std::string host_line(const Served& served) {
  return fmt::format("Host: 127.0.0.1:{}\r\n", served.port);
}

// --- reading ------------------------------------------------------------------------------------

TEST(Serve, OverviewJobsEventsLogsFiles) {
  Farm farm;
  const Filled f = fill(farm);
  const Served served(farm);
  auto client = served.client();
  json j = body_of(client.Get("/api/v1/overview"));
  EXPECT_EQ(j["jobs"]["failed"], 11);
  EXPECT_EQ(j["running"][0]["id"], f.running);
  EXPECT_EQ(j["running"][0]["attempt"]["layers_done"], 462);
  j = body_of(client.Get("/api/v1/jobs?state=failed,cancelled&order=ended&limit=5&offset=2"));
  EXPECT_EQ(j["total"], 12);
  ASSERT_EQ(j["jobs"].size(), 5U);
  EXPECT_EQ(j["jobs"][0]["id"], f.failed[9]);
  j = body_of(client.Get("/api/v1/jobs?label=rush"));
  EXPECT_EQ(j["jobs"][0]["name"], "benchy-日本");
  j = body_of(client.Get("/api/v1/jobs?text=elephant&user=anna"));
  EXPECT_EQ(j["total"], 2);
  j = body_of(client.Get("/api/v1/jobs?state=done&order=worst&limit=1"));
  EXPECT_EQ(j["jobs"][0]["id"], f.nasty);
  // Every state and reason of the record, one by one.
  for (std::size_t i = 0; i < f.failed.size(); ++i) {
    j = body_of(client.Get(fmt::format("/api/v1/jobs/{}", f.failed[i]).c_str()));
    EXPECT_EQ(j["reason"], name_of(test::kFinalReasons[i]));
    ASSERT_EQ(j["tries"].size(), 1U);
    const auto log = client.Get(fmt::format("/api/v1/jobs/{}/log", f.failed[i]).c_str());
    EXPECT_THAT(log->body,
                HasSubstr(fmt::format("last line of fails-{}", name_of(test::kFinalReasons[i]))));
    EXPECT_EQ(log->get_header_value("Content-Type"), "text/plain; charset=utf-8");
  }
  const auto log =
      client.Get(fmt::format("/api/v1/jobs/{}/log?bytes=20&attempt=1", f.again).c_str());
  EXPECT_EQ(log->body, "half of a log\n");
  j = body_of(client.Get("/api/v1/events?limit=3"));
  ASSERT_EQ(j["events"].size(), 3U);
  const std::int64_t last = j["events"][2]["seq"];
  j = body_of(client.Get(fmt::format("/api/v1/events?after={}", last - 1).c_str()));
  EXPECT_EQ(j["events"].size(), 1U);
  j = body_of(client.Get(fmt::format("/api/v1/events?job={}", f.again).c_str()));
  EXPECT_EQ(j["events"].back()["reason"], "worker_killed");
  const auto page = client.Get(fmt::format("/api/v1/jobs/{}/files/html", f.done[0]).c_str());
  ASSERT_EQ(status_of(page), 200);
  EXPECT_THAT(page->body, HasSubstr("the part's page"));
  EXPECT_THAT(page->get_header_value("Content-Security-Policy"),
              HasSubstr("sandbox allow-scripts;"));
  EXPECT_THAT(page->get_header_value("Content-Security-Policy"), Not(HasSubstr("same-origin")));
  const auto stack = client.Get(fmt::format("/api/v1/jobs/{}/files/uvj", f.done[0]).c_str());
  EXPECT_EQ(stack->body, std::string(5000, 'z'));
  EXPECT_EQ(stack->get_header_value("Content-Disposition"),
            "attachment; filename*=UTF-8''gyroid-0.uvj");
  const auto range = client.Get(fmt::format("/api/v1/jobs/{}/files/uvj", f.done[0]).c_str(),
                                {httplib::make_range_header({{10, 19}})});
  EXPECT_EQ(range->status, 200) << "answers are whole";
  EXPECT_EQ(range->body.size(), 5000U);
  // An output that is another one now is not given out.
  test::write_file(fmt::format("{}/gyroid-1.html", farm.folder.results(f.done[1])), "changed");
  EXPECT_EQ(status_of(client.Get(fmt::format("/api/v1/jobs/{}/files/html", f.done[1]).c_str())),
            410);
  fs::remove(fmt::format("{}/gyroid-2.html", farm.folder.results(f.done[2])));
  fs::create_symlink("/etc/hostname",
                     fmt::format("{}/gyroid-2.html", farm.folder.results(f.done[2])));
  EXPECT_EQ(status_of(client.Get(fmt::format("/api/v1/jobs/{}/files/html", f.done[2]).c_str())),
            410);
  EXPECT_EQ(status_of(client.Get(fmt::format("/api/v1/jobs/{}/files/exe", f.done[0]).c_str())),
            404);
  EXPECT_EQ(status_of(client.Head("/api/v1/overview")), 200);
  EXPECT_EQ(client.Get("/healthz")->body, "ok\n");
}

TEST(Serve, HeadersOfEveryAnswer) {
  Farm farm;
  const Filled f = fill(farm);
  const Served served(farm);
  auto client = served.client();
  for (const std::string& path :
       {std::string("/"), std::string("/pages/live.js"), std::string("/pages/style.css"),
        std::string("/report"), std::string("/metrics"), std::string("/api/v1/overview"),
        std::string("/api/v1/jobs"), std::string("/api/v1/report"),
        std::string("/api/v1/timeline.svg"), std::string("/nothing"),
        std::string("/api/v1/jobs?limit=x"),
        fmt::format("/api/v1/jobs/{}/files/html", f.done[0])}) {
    const auto answer = client.Get(path.c_str());
    ASSERT_TRUE(answer) << path;
    const std::string policy = answer->get_header_value("Content-Security-Policy");
    EXPECT_EQ(answer->get_header_value_count("Content-Security-Policy"), 1U) << path;
    EXPECT_THAT(policy, HasSubstr("default-src 'none'")) << path;
    EXPECT_THAT(policy, HasSubstr("frame-ancestors 'none'")) << path;
    EXPECT_EQ(answer->get_header_value("X-Content-Type-Options"), "nosniff") << path;
    EXPECT_EQ(answer->get_header_value("Cache-Control"), "no-store") << path;
    EXPECT_EQ(answer->get_header_value_count("Access-Control-Allow-Origin"), 0U) << path;
    EXPECT_EQ(answer->get_header_value_count("Set-Cookie"), 0U) << path;
    if (path == "/" || path == "/report") {
      EXPECT_THAT(policy, Not(HasSubstr("unsafe"))) << path;
    }
  }
  // The report's styles are named by their hashes.
  EXPECT_THAT(client.Get("/report")->get_header_value("Content-Security-Policy"),
              HasSubstr("style-src 'sha256-"));
}

TEST(Serve, NothingElseIsThere) {
  Farm farm;
  const Filled f = fill(farm);
  test::write_file(farm.root + "/secret.txt", "secret");
  const Served served(farm, with_token());
  const std::string id = std::to_string(f.done[0]);
  for (const std::string& path : {std::string("/farm.sqlite"),
                                  std::string("/../farm.sqlite"),
                                  std::string("/..%2ffarm.sqlite"),
                                  std::string("/%2e%2e/farm.sqlite"),
                                  std::string("/api/v1/../../farm.sqlite"),
                                  std::string("/api/v1/jobs/..%2f..%2fsecret.txt"),
                                  "/api/v1/jobs/" + id + "/log/..%2f..",
                                  "/api/v1/jobs/" + id + "/files/..%2f..%2f..%2fsecret.txt",
                                  "/api/v1/jobs/" + id + "/files/html%00",
                                  "/api/v1/jobs/" + id + "/files/",
                                  "/api/v1/jobs/" + id + "/",
                                  std::string("/api/v1/jobs/0"),
                                  std::string("/api/v1/jobs/-1"),
                                  std::string("/api/v1/jobs/01"),
                                  std::string("/api/v1/jobs/1e3"),
                                  std::string("/api/v1/jobs/99999999999999999999"),
                                  std::string("/api/v1/jobs/1%20"),
                                  std::string("//"),
                                  std::string("/api"),
                                  std::string("/api/v1"),
                                  std::string("/api/v2/jobs"),
                                  std::string("/uploads/"),
                                  std::string("/etc/passwd"),
                                  std::string("//etc/passwd"),
                                  std::string("/%0d%0aSet-Cookie:x=1"),
                                  std::string("/<script>alert(1)</script>")}) {
    Raw raw(served.port);
    ASSERT_TRUE(raw.send("GET " + path + " HTTP/1.1\r\n" + host_line(served) + "\r\n"));
    const std::string answer = raw.rest();
    EXPECT_THAT(answer, HasSubstr("HTTP/1.1 404")) << path;
    EXPECT_THAT(answer, Not(HasSubstr("secret"))) << path;
    EXPECT_THAT(answer, Not(HasSubstr("SQLite"))) << path;
    // What was asked for is not repeated.
    EXPECT_THAT(answer, Not(HasSubstr("alert"))) << path;
    EXPECT_THAT(answer, Not(HasSubstr("Set-Cookie"))) << path;
  }
  auto client = served.client();
  for (const char* query :
       {"limit=-1", "limit=1001", "limit=ten", "limit=1&limit=2", "state=asleep", "order=random",
        "batch=0", "nothing=1", "offset=9999999999999999999", "state=done,,failed"}) {
    EXPECT_EQ(status_of(client.Get((std::string("/api/v1/jobs?") + query).c_str())), 400) << query;
  }
  // Texts that mean something to SQL are texts.
  const json j = body_of(client.Get("/api/v1/jobs?text=%27%20OR%201%3D1%20--&user=%22%3B%20DROP"));
  EXPECT_EQ(j["total"], 0);
}

// --- who may ------------------------------------------------------------------------------------

TEST(Access, ChangesNeedTheToken) {
  Farm farm;
  const Filled f = fill(farm);
  const Served served(farm, with_token());
  const std::vector<std::string> changes{"/api/v1/pause",
                                         "/api/v1/resume",
                                         "/api/v1/jobs",
                                         fmt::format("/api/v1/jobs/{}/cancel", f.queued),
                                         fmt::format("/api/v1/jobs/{}/retry", f.failed[0]),
                                         fmt::format("/api/v1/jobs/{}/priority", f.queued)};
  for (const std::string& given :
       {std::string(), "Bearer " + kToken.substr(1), "Bearer " + kToken + "k",
        std::string("Bearer "), std::string("Bearer"), "Basic " + kToken, kToken,
        "Bearer  " + kToken, std::string("Bearer ") + std::string(5000, 'k')}) {
    auto client = served.client();
    if (!given.empty()) client.set_default_headers({{"Authorization", given}});
    for (const std::string& path : changes) {
      const auto answer = client.Post(path.c_str(), R"({"priority":3})", "application/json");
      EXPECT_EQ(status_of(answer), 401) << path << " " << given;
      EXPECT_EQ(answer->get_header_value("WWW-Authenticate"), "Bearer");
    }
    EXPECT_EQ(status_of(client.Put("/api/v1/parts/a.stl", "solid", "model/stl")), 401);
  }
  auto model = farm.model();
  EXPECT_FALSE(model.settings().paused);
  EXPECT_EQ(model.job(f.queued)->state, JobState::queued);
  EXPECT_EQ(model.job(f.queued)->priority, 5);
  EXPECT_EQ(model.job(f.failed[0])->state, JobState::failed);
  EXPECT_FALSE(fs::exists(farm.root + "/uploads"));
  // Twice the header is no header.
  Raw raw(served.port);
  raw.send("POST /api/v1/pause HTTP/1.1\r\n" + host_line(served) + "Authorization: Bearer " +
           kToken + "\r\nAuthorization: Bearer " + kToken + "\r\nContent-Length: 0\r\n\r\n");
  EXPECT_THAT(raw.rest(), HasSubstr("HTTP/1.1 401"));
  // Without a token nothing can be changed at all.
  const Served reading(farm);
  EXPECT_EQ(status_of(reading.authorised().Post("/api/v1/pause", "", "application/json")), 403);
}

TEST(Access, ChangesWithTheToken) {
  Farm farm;
  const Filled f = fill(farm);
  const Served served(farm, with_token());
  auto client = served.authorised();
  const auto post = [&](const std::string& path, const std::string& body = "") {
    return client.Post(path.c_str(), body, "application/json");
  };
  EXPECT_EQ(body_of(post("/api/v1/pause"))["paused"], true);
  EXPECT_TRUE(farm.model().settings().paused);
  EXPECT_EQ(body_of(post("/api/v1/resume"))["paused"], false);
  EXPECT_FALSE(farm.model().settings().paused);
  EXPECT_EQ(body_of(post(fmt::format("/api/v1/jobs/{}/cancel", f.queued)))["state"], "cancelled");
  EXPECT_EQ(farm.model().job(f.queued)->state, JobState::cancelled);
  EXPECT_EQ(status_of(post(fmt::format("/api/v1/jobs/{}/cancel", f.running))), 202);
  EXPECT_TRUE(farm.model().job(f.running)->cancel_wanted);
  EXPECT_EQ(status_of(post(fmt::format("/api/v1/jobs/{}/cancel", f.done[0]))), 409);
  EXPECT_EQ(status_of(post("/api/v1/jobs/4711/cancel")), 404);
  EXPECT_EQ(status_of(post(fmt::format("/api/v1/jobs/{}/retry", f.failed[0]))), 200);
  EXPECT_EQ(farm.model().job(f.failed[0])->state, JobState::queued);
  EXPECT_EQ(status_of(post(fmt::format("/api/v1/jobs/{}/retry", f.failed[0]))), 409);
  EXPECT_EQ(status_of(post("/api/v1/jobs/4711/retry")), 404);
  const std::string priority = fmt::format("/api/v1/jobs/{}/priority", f.follower);
  EXPECT_EQ(status_of(post(priority, R"({"priority":-7})")), 200);
  EXPECT_EQ(farm.model().job(f.follower)->priority, -7);
  EXPECT_EQ(status_of(post(priority, R"({"priority":3,"ready_by":"06:00"})")), 200);
  EXPECT_EQ(farm.model().job(f.follower)->priority, 3);
  const std::int64_t six = farm.model().job(f.follower)->ready_by_ms;
  EXPECT_GT(six, farm.clock.wall_ms());
  EXPECT_EQ(local_minute(six), 6 * 60);
  EXPECT_EQ(body_of(post(priority, R"({"ready_by":"none"})"))["ready_by_ms"], json());
  EXPECT_EQ(farm.model().job(f.follower)->ready_by_ms, kNoDeadline);
  // Nothing is changed when one of two is wrong.
  EXPECT_EQ(status_of(post(priority, R"({"priority":9,"ready_by":"soon"})")), 400);
  EXPECT_EQ(farm.model().job(f.follower)->priority, 3);
  for (const char* bad :
       {"", "{}", "[]", "7", R"({"priority":"high"})", R"({"priority":1.5})",
        R"({"priority":1e300})", R"({"priority":1,"state":"done"})", R"({"ready_by":6})",
        "{\"priority\":", "\xff\xfe", R"({"priority":99999999999})"}) {
    EXPECT_EQ(status_of(post(priority, bad)), 400) << bad;
  }
  EXPECT_EQ(status_of(post("/api/v1/jobs/1/explode")), 404);
  EXPECT_EQ(status_of(post("/api/v1/drain")), 404);
  EXPECT_EQ(status_of(client.Delete("/api/v1/jobs/1")), 405);
  EXPECT_EQ(status_of(client.Options("/api/v1/jobs")), 405);
  EXPECT_EQ(status_of(client.Patch("/api/v1/jobs", "{}", "application/json")), 405);
  EXPECT_EQ(status_of(client.Post(priority.c_str(), R"({"priority":1})", "text/plain")), 415);
  EXPECT_EQ(status_of(post("/api/v1/pause?now=1")), 400);
  // Who did it is in the record.
  bool found = false;
  for (const FarmEvent& e : farm.model().events(0, 1000, f.queued)) {
    found = found || (e.kind == "cancelled" && e.text.find("api") != std::string::npos);
  }
  EXPECT_TRUE(found);
}

TEST(Access, OtherHostsAndOrigins) {
  Farm farm;
  ServeOptions options = with_token();
  options.host_names = "farm.example,Other.Example";
  const Served served(farm, options);
  const auto get = [&](const std::string& headers, const std::string& what = "GET") {
    Raw raw(served.port);
    raw.send(what + " /api/v1/overview HTTP/1.1\r\n" + headers + "\r\n");
    return raw.rest().substr(0, 12);
  };
  const std::string port = std::to_string(served.port);
  for (const std::string& host :
       {"127.0.0.1:" + port, "localhost:" + port, "LOCALHOST:" + port, "[::1]:" + port,
        "127.0.0.53:" + port, std::string("farm.example"), std::string("farm.example:443")}) {
    EXPECT_EQ(get("Host: " + host + "\r\n"), "HTTP/1.1 200") << host;
  }
  for (const std::string& host :
       {"evil.example:" + port, std::string("evil.example"), "127.0.0.1.evil.example:" + port,
        "localhost.evil.example:" + port, std::string("127.0.0.1"), "127.0.0.1:" + port + "1",
        std::string("127.0.0.1:-1"), std::string(""), "192.168.1.7:" + port, "[::2]:" + port,
        "farm.example.evil.example:" + port, "127.0.0.1:" + port + "@evil.example"}) {
    EXPECT_EQ(get("Host: " + host + "\r\n"), host.empty() ? "HTTP/1.1 400" : "HTTP/1.1 403")
        << host;
  }
  EXPECT_EQ(get(""), "HTTP/1.1 400");
  EXPECT_EQ(get("Host: 127.0.0.1:" + port + "\r\nHost: evil.example\r\n"), "HTTP/1.1 400");
  const std::string ours = "Host: 127.0.0.1:" + port + "\r\n";
  EXPECT_EQ(get(ours + "Origin: http://127.0.0.1:" + port + "\r\n"), "HTTP/1.1 200");
  EXPECT_EQ(get("Host: farm.example\r\nOrigin: https://farm.example\r\n"), "HTTP/1.1 200");
  for (const std::string origin :
       {"http://evil.example", "null", "https://127.0.0.1", "file://", "http://localhost"}) {
    EXPECT_EQ(get(ours + "Origin: " + origin + "\r\n"), "HTTP/1.1 403") << origin;
    // With the right token, too: a page elsewhere must not use it.
    EXPECT_EQ(get(ours + "Authorization: Bearer " + kToken + "\r\nOrigin: " + origin +
                      "\r\nContent-Length: 0\r\n",
                  "POST"),
              "HTTP/1.1 403");
  }
  EXPECT_EQ(get(ours + "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: no-cors\r\n"),
            "HTTP/1.1 403");
  EXPECT_EQ(get(ours + "Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: navigate\r\n"),
            "HTTP/1.1 200");
  EXPECT_EQ(get(ours + "Sec-Fetch-Site: same-origin\r\n"), "HTTP/1.1 200");
}

TEST(Access, BeyondTheMachineReadingNeedsTheToken) {
  Farm farm;
  fill(farm);
  ServeOptions options;
  options.host = "0.0.0.0";
  EXPECT_THROW(FarmServer(farm.folder, options), InputError);
  options.token = kToken;
  const Served served(farm, options);
  auto client = served.client();
  EXPECT_EQ(status_of(client.Get("/")), 200);
  EXPECT_EQ(status_of(client.Get("/pages/live.js")), 200);
  for (const char* path :
       {"/api/v1/overview", "/api/v1/jobs", "/api/v1/jobs/1", "/api/v1/jobs/1/log",
        "/api/v1/events", "/metrics", "/report", "/api/v1/report", "/api/v1/timeline.svg",
        "/api/v1/jobs/1/files/html", "/api/v1/nothing"}) {
    EXPECT_EQ(status_of(client.Get(path)), 401) << path;
  }
  EXPECT_EQ(status_of(served.authorised().Get("/api/v1/overview")), 200);
  EXPECT_EQ(status_of(served.authorised().Get("/metrics")), 200);
}

TEST(Access, TokenFiles) {
  Farm farm;
  const std::string path = farm.root + "/token";
  const auto with = [&](const std::string& text, unsigned mode) {
    test::write_file(path, text);
    fs::permissions(path, static_cast<fs::perms>(mode));
    return http::read_token_file(path);
  };
  EXPECT_EQ(with(kToken + "\n", 0600), kToken);
  EXPECT_EQ(with(kToken + "\r\nsecond line\n", 0400), kToken);
  fs::permissions(path, static_cast<fs::perms>(0600));
  for (const unsigned mode : {0644U, 0640U, 0604U, 0660U, 0620U}) {
    EXPECT_THROW(with(kToken, mode), InputError) << mode;
  }
  for (const std::string& text :
       {std::string(), std::string("short"), std::string(31, 'a'), std::string(513, 'a'),
        kToken + " " + kToken, kToken + "\x01", "\n" + kToken}) {
    EXPECT_THROW(with(text, 0600), InputError) << text;
  }
  EXPECT_THROW(http::read_token_file(farm.root), InputError);
  EXPECT_THROW(http::read_token_file(farm.root + "/nothing"), InputError);
}

// --- clients that mean harm ---------------------------------------------------------------------

TEST(Harm, BodiesThatAreTooLargeOrLie) {
  Farm farm;
  const Filled f = fill(farm);
  ServeOptions options = with_token();
  options.most_body_bytes = 1000;
  options.most_upload_bytes = 100'000;
  options.submit = [](const std::string&, bool, const std::atomic<bool>&) {
    return SubmitReply{201, "{}"};
  };
  const Served served(farm, options);
  const auto send = [&](const std::string& line, const std::string& headers,
                        const std::string& body) {
    Raw raw(served.port);
    raw.send(line + " HTTP/1.1\r\n" + host_line(served) + "Authorization: Bearer " + kToken +
             "\r\n" + headers + "\r\n" + body);
    return raw.rest().substr(0, 12);
  };
  const std::string type = "Content-Type: application/json\r\n";
  // Said to be too large: refused before anything of it is read.
  EXPECT_EQ(send("POST /api/v1/jobs", type + "Content-Length: 1001\r\n", ""), "HTTP/1.1 413");
  EXPECT_EQ(send("POST /api/v1/jobs", type + "Content-Length: 99999999999\r\n", ""),
            "HTTP/1.1 413");
  EXPECT_EQ(send("PUT /api/v1/parts/a.stl", "Content-Length: 100001\r\n", ""), "HTTP/1.1 413");
  for (const char* length : {"-1", "+5", "0x10", "5,5", "", "99999999999999999999", "5 5"}) {
    EXPECT_EQ(send("POST /api/v1/jobs", type + "Content-Length: " + length + "\r\n", "{}"),
              "HTTP/1.1 400")
        << length;
  }
  EXPECT_EQ(send("POST /api/v1/jobs", type + "Content-Length: 2\r\nContent-Length: 3\r\n", "{}"),
            "HTTP/1.1 400");
  EXPECT_EQ(
      send("POST /api/v1/jobs", type + "Transfer-Encoding: chunked\r\n", "2\r\n{}\r\n0\r\n\r\n"),
      "HTTP/1.1 411");
  EXPECT_EQ(send("PUT /api/v1/parts/a.stl", "Transfer-Encoding: chunked\r\n", ""), "HTTP/1.1 411");
  EXPECT_EQ(send("PUT /api/v1/parts/a.stl", "", ""), "HTTP/1.1 411");
  EXPECT_EQ(send("PUT /api/v1/parts/a.stl", "Content-Length: 0\r\n", ""), "HTTP/1.1 400");
  EXPECT_EQ(
      send("POST /api/v1/jobs", type + "Content-Encoding: gzip\r\nContent-Length: 2\r\n", "{}"),
      "HTTP/1.1 415");
  EXPECT_EQ(send("PUT /api/v1/parts/a.stl",
                 "Content-Type: multipart/form-data; boundary=x\r\nContent-Length: 2\r\n", "{}"),
            "HTTP/1.1 415");
  EXPECT_EQ(send("GET /api/v1/overview", "Content-Length: 5\r\n", "hello"), "HTTP/1.1 413");
  // A second request behind the first is not one: no smuggling.
  EXPECT_EQ(send("POST /api/v1/resume", "Content-Length: 0\r\n",
                 "POST /api/v1/pause HTTP/1.1\r\n" + host_line(served) + "Authorization: Bearer " +
                     kToken + "\r\nContent-Length: 0\r\n\r\n"),
            "HTTP/1.1 200");
  EXPECT_FALSE(farm.model().settings().paused);
  // Malformed JSON.
  for (const std::string& body :
       {std::string("{"), std::string("nul"), std::string("[1]"), std::string(900, '['),
        std::string("\"\\ud800\""), std::string("{}x")}) {
    EXPECT_EQ(
        send("POST /api/v1/jobs", type + fmt::format("Content-Length: {}\r\n", body.size()), body),
        "HTTP/1.1 400")
        << body;
  }
  EXPECT_EQ(send("POST /api/v1/jobs", type + "Content-Length: 2\r\n", "{}"), "HTTP/1.1 201");
  EXPECT_EQ(send("PUT /api/v1/parts/a.stl", "Content-Length: 5\r\n", "solid"), "HTTP/1.1 201");
  for (const char* name : {"..", ".hidden", "-o", "a%00b.stl", "%ff.stl", "a%5cb"}) {
    EXPECT_EQ(send(std::string("PUT /api/v1/parts/") + name, "Content-Length: 5\r\n", "solid"),
              "HTTP/1.1 400")
        << name;
  }
  // These are other paths.
  for (const char* name : {"a%2fb.stl", "..%2fa.stl", "a%0ab.stl"}) {
    EXPECT_EQ(send(std::string("PUT /api/v1/parts/") + name, "Content-Length: 5\r\n", "solid"),
              "HTTP/1.1 404")
        << name;
  }
  EXPECT_EQ(send("PUT /api/v1/parts/", "Content-Length: 5\r\n", "solid"), "HTTP/1.1 404");
  EXPECT_EQ(send("PUT /api/v1/parts/a/b.stl", "Content-Length: 5\r\n", "solid"), "HTTP/1.1 404");
  // Of all these uploads one is there, whole.
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(farm.root + "/uploads")) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  ASSERT_EQ(files.size(), 1U);
  EXPECT_EQ(files[0].filename(), "a.stl");
}

// Every answer is whole, whatever part of it a header asks for: a server that takes ranges from an
// answer's maker that does not look at them hands out its memory.
TEST(Harm, AnswersAreWholeWhateverIsAskedFor) {
  Farm farm;
  const Filled f = fill(farm);
  const Served served(farm, with_token());
  std::vector<std::string> asked = {"bytes=0-200000,0-1",
                                    "bytes=4-200",
                                    "bytes=99-",
                                    "bytes=-1",
                                    "bytes=-0",
                                    "bytes=0-0",
                                    "bytes=1-",
                                    "bytes=2-1",
                                    "bytes=",
                                    "bytes",
                                    "",
                                    "bytes=-",
                                    "bytes=a-b",
                                    "items=0-1",
                                    "bytes=0-1,",
                                    ",",
                                    "bytes=0 -1",
                                    "bytes= 0-1",
                                    "bytes=0x1-",
                                    "bytes=1e3-",
                                    "bytes=+1-2",
                                    "bytes=--5",
                                    "BYTES=0-1",
                                    "bytes=0-1;x",
                                    "bytes=0-18446744073709551615",
                                    "bytes=18446744073709551615-",
                                    "bytes=-18446744073709551615",
                                    "bytes=9223372036854775807-9223372036854775808",
                                    "bytes=0-99999999999999999999999999"};
  for (const int first : {0, 1, 2, 3, 4, 63, 64, 4095, 4096, 65535}) {
    for (const int last : {0, 1, 3, 200, 4096, 65536, 200000, 2147483647}) {
      asked.push_back(fmt::format("bytes={}-{}", first, last));
      asked.push_back(fmt::format("bytes=0-0, {}-{}", first, last));
    }
  }
  std::string many = "bytes=0-1";
  for (int i = 0; i < 1500; ++i) many += ",0-1";
  asked.push_back(many);
  ASSERT_GE(asked.size(), 180U);
  const std::vector<std::string> names = {"Range", "range", "rAnGe", "Range ", "Range\t"};
  for (const std::string& path :
       {std::string("/healthz"), std::string("/nothing"), std::string("/api/v1/overview"),
        fmt::format("/api/v1/jobs/{}/files/html", f.done[0])}) {
    const auto ask = [&](const std::string& header) {
      Raw raw(served.port);
      raw.send("GET " + path + " HTTP/1.1\r\n" + host_line(served) + header + "\r\n");
      return raw.rest();
    };
    const std::string whole = ask("");
    const std::size_t body = whole.find("\r\n\r\n");
    ASSERT_NE(body, std::string::npos) << path;
    for (std::size_t i = 0; i < asked.size(); ++i) {
      const std::string header = names[i % names.size()] + ": " + asked[i] + "\r\n";
      const std::string answer = ask(i % 3 == 0   ? "If-Range: \"x\"\r\n" + header
                                     : i % 3 == 1 ? header + "Range: bytes=4-200\r\n"
                                                  : header);
      EXPECT_EQ(answer.substr(0, 12), whole.substr(0, 12)) << path << " " << header.substr(0, 80);
      EXPECT_THAT(answer, Not(HasSubstr("Content-Range"))) << path << " " << header.substr(0, 80);
      const std::size_t at = answer.find("\r\n\r\n");
      ASSERT_NE(at, std::string::npos) << path << " " << header.substr(0, 80);
      // What the farm is doing may have changed, its length not by much.
      if (path != "/api/v1/overview") {
        EXPECT_EQ(answer.substr(at), whole.substr(body)) << path << " " << header.substr(0, 80);
      }
    }
  }
}

// Every header that HTTP knows, and what clients may make of it, to every route: each answer is one
// whole answer, with nothing in it but what belongs there.
TEST(Harm, EveryHeaderToEveryRoute) {
  Farm farm;
  const Filled f = fill(farm);
  ServeOptions options = with_token();
  options.submit = [](const std::string&, bool, const std::atomic<bool>&) {
    return SubmitReply{201, "{}"};
  };
  const Served served(farm, options);
  std::vector<std::pair<std::string, std::string>> routes = {
      {"GET", "/nothing"},    {"DELETE", "/"},  {"OPTIONS", "*"},
      {"TRACE", "/"},         {"PRI", "*"},     {"CONNECT", "127.0.0.1:1"},
      {"HEAD", "/healthz"},   {"get", "/"},     {"GET", "http://127.0.0.1/healthz"},
      {"GET", "/..%2f..%2f"}, {"GET", "/?%ff"}, {"GET", "//healthz"}};
  for (const detail::Route& route : detail::routes()) {
    std::string path(route.path);
    for (std::size_t at = 0; (at = path.find('{')) != path.npos;) {
      const std::string name = path.substr(at, path.find('}') - at + 1);
      path.replace(at, name.size(),
                   name == "{id}"       ? std::to_string(f.done[0])
                   : name == "{ending}" ? "html"
                                        : "x");
    }
    routes.emplace_back(route.method, path);
  }
  ASSERT_GE(routes.size(), 45U);
  const std::vector<std::string> headers = asked_headers();
  ASSERT_GE(headers.size(), 120U);
  std::map<std::string, int> answers;
  int n = 0;
  for (const auto& [method, path] : routes) {
    for (const std::string& header : headers) {
      Raw raw(served.port);
      // With and without leave to see it.
      const std::string token =
          ++n % 2 == 0 ? "Authorization: Bearer " + kToken + "\r\n" : std::string();
      raw.send(method + " " + path + " HTTP/1.1\r\n" + host_line(served) + token + header +
               "\r\n\r\n");
      raw.end_sending();
      const std::string answer = raw.rest();
      const std::string fault = fault_of_answer(answer, method == "HEAD", kToken);
      EXPECT_EQ(fault, "") << method << " " << path << " " << header.substr(0, 100) << "\n"
                           << answer.substr(0, 400);
      ++answers[answer.substr(0, 12)];
    }
  }
  // None of them is a defect, none ends the server.
  EXPECT_EQ(answers["HTTP/1.1 500"], 0);
  EXPECT_GT(answers["HTTP/1.1 200"], 500);
  EXPECT_EQ(status_of(served.authorised().Get("/api/v1/overview")), 200);
}

TEST(Harm, SlowManyAndEndless) {
  Farm farm;
  fill(farm);
  ServeOptions options = with_token();
  options.threads = 2;
  options.most_waiting = 2;
  options.request_s = 0.5;
  options.stall_s = 0.5;
  options.header_bytes = 4096;
  const Served served(farm, options);
  {
    // Headers that never end, and one that is too long.
    Raw endless(served.port);
    std::string lines = "GET / HTTP/1.1\r\n";
    for (int i = 0; i < 2000 && endless.send(lines); ++i) lines = fmt::format("X-{}: y\r\n", i);
    EXPECT_THAT(endless.rest(), Not(HasSubstr("200 OK")));
    Raw wide(served.port);
    wide.send("GET / HTTP/1.1\r\nX: " + std::string(100'000, 'y'));
    EXPECT_THAT(wide.rest(), Not(HasSubstr("200 OK")));
    Raw line(served.port);
    line.send("GET /" + std::string(9000, 'a'));
    EXPECT_THAT(line.rest(), Not(HasSubstr("200 OK")));
    Raw binary(served.port);
    std::string noise;
    for (int i = 0; i < 3000; ++i) noise += static_cast<char>(i * 7919 % 251);
    binary.send(noise + "\r\n\r\n");
    EXPECT_THAT(binary.rest(), Not(HasSubstr("200 OK")));
  }
  // A byte now and then: every connection ends by itself.
  {
    std::vector<std::unique_ptr<Raw>> slow;
    for (int i = 0; i < 2; ++i) {
      slow.push_back(std::make_unique<Raw>(served.port));
      ASSERT_TRUE(slow.back()->send("GET / HT"));
    }
    for (const auto& raw : slow) EXPECT_NE(raw->rest(), "(nothing)");
    // A body that is announced and never comes.
    Raw body(served.port);
    body.send("PUT /api/v1/parts/a.stl HTTP/1.1\r\n" + host_line(served) +
              "Authorization: Bearer " + kToken + "\r\nContent-Length: 5000\r\n\r\nsolid");
    EXPECT_THAT(body.rest(), HasSubstr("HTTP/1.1 400"));
    EXPECT_TRUE(!fs::exists(farm.root + "/uploads") || fs::is_empty(farm.root + "/uploads"));
  }
  // More at once than there is room for: some are turned away, the server lives.
  {
    std::vector<std::unique_ptr<Raw>> many;
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < 40; ++i) many.push_back(std::make_unique<Raw>(served.port));
    int away = 0;
    for (const auto& raw : many) away += raw->rest().find("503") != std::string::npos;
    const double took_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    // The two that came last wait, and as many anew after each `request_s`.
    EXPECT_GE(away, 40 - 2 * (1 + static_cast<int>(took_s / options.request_s)));
    EXPECT_LT(away, 40);
  }
  auto client = served.client();
  EXPECT_EQ(status_of(client.Get("/api/v1/overview")), 200);
  // A reader that takes nothing does not hold a thread for ever: both threads answer again.
  std::vector<std::unique_ptr<Raw>> deaf;
  for (int i = 0; i < 2; ++i) {
    deaf.push_back(std::make_unique<Raw>(served.port));
    deaf.back()->send("GET /api/v1/jobs?limit=1000 HTTP/1.1\r\n" + host_line(served) + "\r\n");
  }
  // Turned away at most until a thread has taken up what waits.
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  int status = 503;
  while (status == 503 && std::chrono::steady_clock::now() < end) {
    status = status_of(client.Get("/api/v1/overview"));
  }
  EXPECT_EQ(status, 200);
}

TEST(Harm, StopsWhileClientsHoldOn) {
  Farm farm;
  fill(farm);
  ServeOptions options = with_token();
  options.request_s = 3600;
  options.stall_s = 3600;
  options.clock = &farm.clock;
  FarmServer server(farm.folder, options);
  std::thread thread([&] { server.run(); });
  std::vector<std::unique_ptr<Raw>> slow;
  for (int i = 0; i < 20; ++i) {
    slow.push_back(std::make_unique<Raw>(server.port()));
    slow.back()->send("GET / HTTP/1.1\r\nHost");
  }
  Raw body(server.port());
  body.send(
      fmt::format("PUT /api/v1/parts/a.stl HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nAuthorization: Bearer "
                  "{}\r\nContent-Length: 5000\r\n\r\nsolid",
                  server.port(), kToken));
  // The test's own limit would end a stop that hangs.
  server.stop();
  thread.join();
  for (const auto& raw : slow) EXPECT_NE(raw->rest(), "(nothing)");
  EXPECT_TRUE(!fs::exists(farm.root + "/uploads") || fs::is_empty(farm.root + "/uploads"));
}

// --- submitting ---------------------------------------------------------------------------------

/// With the real checks: parts are read, physics is asked, jobs are in the queue.
TEST(Submit, UploadedPartsAndWhatIsRefused) {
  Farm farm;
  slicecorr::test::write_stl(farm.root + "/ladder.stl", slicecorr::test::ladder());
  std::ifstream file(farm.root + "/ladder.stl", std::ios::binary);
  const std::string stl(std::istreambuf_iterator<char>(file), {});
  fs::create_directories(farm.root + "/shop");
  fs::copy_file(farm.root + "/ladder.stl", farm.root + "/shop/ladder.stl");
  fs::create_symlink(farm.root + "/ladder.stl", farm.root + "/shop/link.stl");
  ServeOptions options = with_token();
  options.submit = make_submitter({farm.folder, {farm.root + "/shop"}, "web"});
  const Served served(farm, options);
  auto client = served.authorised();
  const auto uploaded = client.Put("/api/v1/parts/ladder%20one.stl", stl, "model/stl");
  ASSERT_EQ(status_of(uploaded), 201) << uploaded->body;
  const std::string part = body_of(uploaded)["part"];
  EXPECT_THAT(part, testing::MatchesRegex("upload:[0-9a-f]*/ladder one.stl"));
  const auto job_with = [&](const json& changes) {
    json job = {{"part", part},
                {"printer", "dual-wavelength-dlp"},
                {"resin", "benchy-resin"},
                {"layer_um", 50},
                {"speed_mm_h", 800}};
    job.update(changes);
    return json{{"jobs", json::array({job})}}.dump();
  };
  const auto post = [&](const std::string& body, const char* path = "/api/v1/jobs") {
    return client.Post(path, body, "application/json");
  };
  auto answer = post(job_with(json::object()), "/api/v1/jobs?dry_run=1");
  ASSERT_EQ(status_of(answer), 200) << answer->body;
  EXPECT_GT(body_of(answer)["estimates"][0]["layers"].get<int>(), 0);
  EXPECT_THAT(body_of(answer)["notices"].dump(),
              testing::HasSubstr("resin 'benchy-resin' is from the database"));
  EXPECT_EQ(farm.model().count({}), 0);
  answer = post(job_with({{"priority", 3}, {"labels", {"web"}}}));
  ASSERT_EQ(status_of(answer), 201) << answer->body;
  const JobId id = body_of(answer)["ids"][0];
  const auto job = farm.model().job(id);
  ASSERT_TRUE(job);
  EXPECT_EQ(job->user, "web");
  EXPECT_EQ(job->priority, 3);
  EXPECT_EQ(job->state, JobState::queued);
  // A path in an allowed folder will do; others, links out of it and outputs elsewhere will not.
  answer = post(job_with({{"part", farm.root + "/shop/ladder.stl"}, {"name", "from-shop"}}));
  EXPECT_EQ(status_of(answer), 201) << answer->body;
  const std::int64_t jobs = farm.model().count({});
  for (const json& bad :
       std::vector<json>{{{"part", farm.root + "/ladder.stl"}},
                         {{"part", farm.root + "/shop/../ladder.stl"}},
                         {{"part", farm.root + "/shop/link.stl"}},
                         {{"part", "/etc/passwd"}},
                         {{"part", "ladder.stl"}},
                         {{"part", "upload:../../ladder.stl"}},
                         {{"part", "upload:" + std::string(32, 'a') + "/../../../etc/passwd"}},
                         {{"part", "upload:" + std::string(32, 'a') + "/not-there.stl"}},
                         {{"out", "/tmp/elsewhere"}},
                         {{"printer", "/etc/printer.toml"}},
                         {{"resin", "../resin.toml"}},
                         {{"resin", "no-such-resin"}},
                         {{"speed_mm_h", -3}},
                         {{"layer_um", "thick"}},
                         {{"explode", true}},
                         {{"name", "../../up"}}}) {
    answer = post(job_with(bad));
    EXPECT_EQ(status_of(answer), 400) << bad.dump() << answer->body;
    EXPECT_FALSE(body_of(answer)["error"]["message"].get<std::string>().empty());
  }
  EXPECT_EQ(farm.model().count({}), jobs);
  for (const char* bad : {"{}", R"({"jobs":[]})", R"({"jobs":7})", R"({"jobs":[7]})"}) {
    EXPECT_EQ(status_of(post(bad)), 400) << bad;
  }
}

/// The commands of the documentation, one after the other, as somebody would type them.
TEST(Docs, CurlExamplesRun) {
  if (!fs::exists("/usr/bin/curl") || !fs::exists("/usr/bin/jq")) {
    GTEST_SKIP() << "curl or jq is not installed";
  }
  std::ifstream in(std::string(SLICECORR_SOURCE_DIR) + "/docs/farm-api.md");
  std::string script = "set -e\n";
  int commands = 0;
  bool open = false;
  for (std::string line; std::getline(in, line);) {
    const bool begins = line.starts_with("    curl ") || line.starts_with("    while curl ") ||
                        line.find("=$(curl ") != std::string::npos;
    if (!begins && !open) continue;
    commands += begins;
    open = line.ends_with("\\");
    script += line + "\n";
  }
  ASSERT_GE(commands, 20);
  Farm farm;
  const Filled f = fill(farm);
  slicecorr::test::write_stl(farm.root + "/part.stl", slicecorr::test::ladder());
  test::write_file(farm.root + "/token", kToken + "\n");
  ServeOptions options = with_token();
  options.submit = make_submitter({farm.folder, {}, "web"});
  options.children.programs = SLICECORR_BIN_DIR;
  std::string heights = "dose_mj_cm2,cured_height_um\n";
  for (const int dose : {15, 20, 30, 50, 80}) {
    heights += fmt::format("{},{:.1f}\n", dose, 200 * std::log(dose / 10.0));
  }
  test::write_file(farm.root + "/heights.csv", heights);
  // What is added goes to a database of the test's own.
  fs::create_directories(farm.root + "/db");
  ::setenv("SLICECORR_DB", (farm.root + "/db").c_str(), 1);
  const Served served(farm, options);
  RunOptions run;
  run.timeout = std::chrono::minutes(3);
  run.folder = farm.root;
  run.environment = {{"FARM", fmt::format("http://127.0.0.1:{}", served.port)},
                     {"JOB", std::to_string(f.again)},
                     {"FAILED", std::to_string(f.failed[4])},
                     {"http_proxy", ""},
                     {"no_proxy", "*"}};
  const auto result = run_program({"/bin/sh", "-c", script}, run);
  EXPECT_EQ(result.exit_code, 0) << script << result.out << result.err;
  // What they were to do is done.
  auto model = farm.model();
  JobFilter filter;
  filter.user = "web";
  EXPECT_EQ(model.count(filter), 1);
  EXPECT_EQ(model.job(f.again)->state, JobState::cancelled);
  EXPECT_EQ(model.job(f.failed[4])->state, JobState::queued);
  EXPECT_FALSE(model.settings().paused);
  EXPECT_TRUE(fs::exists(farm.root + "/curve.svg"));
  EXPECT_THAT(result.out, HasSubstr("lab-printer"));
  ::unsetenv("SLICECORR_DB");
}

// --- the program --------------------------------------------------------------------------------

TEST(Program, ServesUntilItIsTold) {
  Farm farm;
  fill(farm);
  test::write_file(farm.root + "/token", kToken + "\n");
  fs::permissions(farm.root + "/token", fs::perms::owner_read | fs::perms::owner_write);
  for (const int signal : {SIGTERM, SIGINT}) {
    RunOptions options;
    options.signal = signal;
    bool asked = false;
    options.signal_when = [&](const std::string& out, const std::string&) {
      if (out.find('\n') == std::string::npos) return false;
      httplib::Client client(out.substr(0, out.find('\n')));
      EXPECT_EQ(status_of(client.Get("/api/v1/overview")), 200);
      client.set_default_headers({{"Authorization", "Bearer " + kToken}});
      EXPECT_EQ(status_of(client.Post("/api/v1/pause", "", "application/json")), 200);
      asked = true;
      return true;
    };
    const auto result = run_program({kSlicefarm, "serve", "--dir", farm.root, "--listen",
                                     "127.0.0.1:0", "--token-file", farm.root + "/token"},
                                    options);
    EXPECT_TRUE(asked);
    EXPECT_FALSE(result.timed_out);
    EXPECT_EQ(result.exit_code, signal == SIGTERM ? 0 : 130) << result.err;
    EXPECT_EQ(result.out.rfind("http://127.0.0.1:", 0), 0U);
    EXPECT_THAT(result.out + result.err, Not(HasSubstr(kToken)));
  }
  EXPECT_TRUE(farm.model().settings().paused);
}

TEST(Program, WrongUsage) {
  Farm farm;
  const auto run = [&](std::vector<std::string> more) {
    std::vector<std::string> command{kSlicefarm, "serve", "--dir", farm.root};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command);
  };
  for (const char* listen :
       {"127.0.0.1", ":80", "127.0.0.1:x", "127.0.0.1:70000", "127.0.0.1:-1", "0.0.0.0:0"}) {
    const auto result = run({"--listen", listen});
    EXPECT_EQ(result.exit_code, 2) << listen << result.err;
  }
  test::write_file(farm.root + "/token", kToken);
  fs::permissions(farm.root + "/token", static_cast<fs::perms>(0644));
  auto result = run({"--listen", "127.0.0.1:0", "--token-file", farm.root + "/token"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err, HasSubstr("mode 0600"));
  // A port that is taken.
  const Served served(farm);
  result = run({"--listen", fmt::format("127.0.0.1:{}", served.port)});
  EXPECT_EQ(result.exit_code, 4) << result.err;
}

}  // namespace
}  // namespace slicecorr::farm
