// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Scans of a farm's prints over HTTP: who may, what is refused, what comes back, the next print.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>

#include <thread>

#include "farm_scans.hpp"
#include "slicecorr/farm/serve.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

const std::string kLook(40, 'l'), kAnna(40, 'a'), kOlga(40, 'o'), kOperate(40, 'p');

class FarmScansServed : public FarmScans {
 protected:
  void SetUp() override {
    FarmScans::SetUp();
    farm::ServeOptions options;
    options.accounts = {{"lena", farm::Role::look, kLook},
                        {"anna", farm::Role::submit, kAnna},
                        {"olga", farm::Role::submit, kOlga},
                        {"pia", farm::Role::operate, kOperate}};
    options.children.programs = SLICECORR_BIN_DIR;
    options.most_upload_bytes = 4'000'000;
    const farm::FarmFolder folder = farm::open_folder(farm_dir());
    options.submit = farm::make_submitter({folder, {}, "web"});
    server_ = std::make_unique<farm::FarmServer>(folder, options);
    thread_ = std::thread([this] { server_->run(); });
  }
  void TearDown() override {
    if (server_) {
      server_->stop();
      thread_.join();
    }
    FarmScans::TearDown();
  }
  httplib::Client client(const std::string& token) const {
    httplib::Client c("127.0.0.1", server_->port());
    c.set_read_timeout(60);
    c.set_default_headers({{"Authorization", "Bearer " + token}});
    return c;
  }
  int post(const std::string& token, const std::string& path, const json& body,
           json* answer = nullptr) {
    const auto r = client(token).Post(("/api/v1/" + path).c_str(), body.dump(), "application/json");
    if (answer) *answer = json::parse(r->body, nullptr, false);
    return r ? r->status : -1;
  }
  json get(const std::string& path, int status = 200) {
    const auto r = client(kLook).Get(("/api/v1/" + path).c_str());
    EXPECT_EQ(r->status, status) << path << r->body;
    return json::parse(r->body, nullptr, false);
  }
  std::string upload(const std::string& path, const std::string& token = kAnna) {
    const auto r =
        client(token).Put(("/api/v1/parts/" + fs::path(path).filename().string()).c_str(),
                          text_of_file(path), "application/octet-stream");
    EXPECT_EQ(r->status, 201) << r->body;
    return json::parse(r->body)["part"];
  }
  json ended_study(const json& begun) {
    json s = begun;
    const std::string at = "studies/" + s["study"].get<std::string>();
    EXPECT_TRUE(comes([&] {
      s = get(at);
      return s["state"] != "waiting" && s["state"] != "running";
    }));
    return s;
  }

 private:
  std::unique_ptr<farm::FarmServer> server_;
  std::thread thread_;
};

TEST_F(FarmScansServed, AScanComesInAndTheNextPrintGoesOut) {
  write_file(dir / "early.ply", "ply");
  json answer;
  EXPECT_EQ(post(kAnna, "jobs/1/scans", {{"scan", upload(dir / "early.ply")}}, &answer), 409);
  EXPECT_THAT(answer["error"]["message"].get<std::string>(), HasSubstr("the job is queued"));
  print_and_scan();
  const std::string scan = upload(dir / "printed.ply");
  // Who may: the job's own, and who operates.
  EXPECT_EQ(post(kLook, "jobs/1/scans", {{"scan", scan}}), 403);
  EXPECT_EQ(post(kOlga, "jobs/1/scans", {{"scan", scan}}), 403);
  // What is wrong is said before anything runs.
  for (const json& wrong :
       {json{{"scan", "upload:nothing"}}, json{{"scan", dir / "printed.ply"}}, json{{"unit", "mm"}},
        json{{"scan", scan}, {"unit", "ell"}}, json{{"scan", scan}, {"voxel_um", -1}},
        json{{"scan", scan}, {"unti", "mm"}}}) {
    EXPECT_EQ(post(kAnna, "jobs/1/scans", wrong), 400) << wrong;
  }
  EXPECT_EQ(post(kAnna, "jobs/7/scans", {{"scan", scan}}), 404);
  EXPECT_EQ(post(kAnna, "jobs/1/next", json::object(), &answer), 409);
  EXPECT_THAT(answer["error"]["message"].get<std::string>(), HasSubstr("no scan"));
  // Larger than parts may be: refused, or cut off while it is sent, and nothing of it is kept.
  const auto big = client(kAnna).Put("/api/v1/parts/big.ply", std::string(4'000'001, 'x'),
                                     "application/octet-stream");
  EXPECT_TRUE(!big || big->status == 413);
  for (const auto& entry : fs::recursive_directory_iterator(farm_dir() + "/uploads")) {
    EXPECT_NE(entry.path().filename(), "big.ply");
  }
  // Another part, with what is left between both.
  write_stl(dir / "ball.stl", sphere(1.9, 3));
  EXPECT_EQ(post(kAnna, "jobs/1/scans", {{"scan", upload(dir / "ball.stl")}}, &answer), 202);
  json study = ended_study(answer);
  EXPECT_EQ(study["state"], "failed");
  EXPECT_EQ(study["exit_code"], 2);
  const std::string message = study["message"];
  EXPECT_THAT(message, testing::AllOf(HasSubstr("another part"), HasSubstr(" um"),
                                      Not(HasSubstr(dir.path()))));
  EXPECT_TRUE(get("jobs/1/scans")["scans"].empty());

  ASSERT_EQ(post(kAnna, "jobs/1/scans", {{"scan", scan}, {"unit", "mm"}}, &answer), 202);
  study = ended_study(answer);
  ASSERT_EQ(study["state"], "done") << study;
  const json kept = get("jobs/1/scans")["scans"].at(0);
  EXPECT_EQ(kept["file"], "printed.ply");
  EXPECT_EQ(kept["user"], "anna");
  EXPECT_EQ(get("studies/" + study["study"].get<std::string>() + "/files/scan.json"), kept);
  EXPECT_EQ(get("jobs/1/scans/1/json")["deviations"][1]["mean_abs_um"], kept["mean_abs_um"]);
  const auto page = client(kLook).Get("/api/v1/jobs/1/scans/1/html");
  EXPECT_THAT(page->body, HasSubstr("RoundView"));
  EXPECT_THAT(page->get_header_value("Content-Security-Policy"), HasSubstr("sandbox"));
  EXPECT_EQ(client(kLook).Get("/api/v1/jobs/1/scans/1/scan")->body,
            text_of_file(dir / "printed.ply"));
  get("jobs/1/scans/2/html", 404);
  get("jobs/1/scans/1/../../farm.sqlite", 404);
  get("jobs/1/scans/1/comparison.json", 404);
  get("drift.svg?printer=small&resin=believed", 404);  // a chart needs three
  EXPECT_EQ(get("drift")["prints"][0]["scans"].size(), 1U);

  EXPECT_EQ(post(kOlga, "jobs/1/next", json::object()), 403);
  EXPECT_EQ(post(kAnna, "jobs/1/next", {{"scans", "all"}}), 400);
  ASSERT_EQ(post(kAnna, "jobs/1/next", {{"scans", {1}}}, &answer), 202);
  study = ended_study(answer);
  ASSERT_EQ(study["state"], "done") << study;
  const std::string of = "studies/" + study["study"].get<std::string>();
  const json next = get(of + "/files/next.json");
  EXPECT_EQ(next["job"], 2);
  const json job = get("jobs/2");
  EXPECT_EQ(job["user"], "anna");
  EXPECT_EQ(job["state"], "queued");
  EXPECT_EQ(job["after_scans_of"]["job"], 1);
  EXPECT_GT(job["after_scans_of"]["edges_mean_um"], 3);
  EXPECT_TRUE(get("jobs/1")["after_scans_of"].is_null());
  // The resin that was found goes into the database, for who operates.
  EXPECT_EQ(post(kAnna, "resins", {{"study", study["study"]}}), 403);
  EXPECT_EQ(post(kOperate, "resins", {{"study", study["study"]}}, &answer), 201) << answer;
  EXPECT_EQ(answer["resin"], "believed-job-1");

  EXPECT_EQ(post(kOlga, "jobs/1/scans/1/remove", json::object()), 403);
  EXPECT_EQ(post(kAnna, "jobs/1/scans/3/remove", json::object()), 404);
  EXPECT_EQ(post(kOperate, "jobs/1/scans/1/remove", json::object()), 200);
  get("jobs/1/scans/1/html", 404);
}

TEST_F(FarmScansServed, PrintsOverTimeAreChartedAndToldOf) {
  print_and_scan();
  farm::Queue queue(database());
  for (const double mean : {1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 9.0}) {
    farm::KeptScan s;
    s.job = 1;
    s.file = "scan <b>.ply";
    s.mean_um = mean;
    s.mean_abs_um = 5;
    queue.add_scan(s);
  }
  EXPECT_THAT(get("drift")["prints"][0]["beyond"].get<std::string>(), HasSubstr("beyond its band"));
  const auto svg = client(kLook).Get("/api/v1/drift.svg?printer=small&resin=believed");
  EXPECT_EQ(svg->status, 200);
  EXPECT_THAT(svg->body, HasSubstr("<svg"));
  const auto page = client(kLook).Get("/api/v1/drift.html?printer=small&resin=believed");
  EXPECT_THAT(page->body, HasSubstr("beyond"));
  EXPECT_THAT(page->get_header_value("Content-Security-Policy"), HasSubstr("sandbox"));
  get("drift.svg?printer=small", 404);
  get("drift?printer=small", 400);
  EXPECT_THAT(client(kLook).Get("/metrics")->body,
              HasSubstr("slicefarm_scan_beyond{printer=\"small\",resin=\"believed\"} 1"));
  EXPECT_THAT(client(kLook).Get("/report")->body, HasSubstr("lies beyond its band"));
  EXPECT_EQ(get("report")["scanned"][0]["scans"].size(), 9U);
}

}  // namespace
}  // namespace slicecorr::test
