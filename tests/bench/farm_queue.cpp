// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How quick a long queue stays: farm_queue [JOBS]. Prints a table: what, how often, time of one.

#include <fmt/format.h>
#include <stdlib.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "bench/farm_bench.hpp"
#include "run_program.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/metrics.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/serve.hpp"
#include "slicecorr/farm/status.hpp"

namespace {

using namespace slicecorr::farm;
using slicecorr::bench::job_of;
using slicecorr::bench::measure;

}  // namespace

int main(int argc, char** argv) {
  const int jobs = argc > 1 ? std::atoi(argv[1]) : 100'000;
  std::string folder = (std::filesystem::temp_directory_path() / "farm-queue-XXXXXX").string();
  if (jobs <= 0 || !::mkdtemp(folder.data())) return 2;
  const FarmFolder farm = open_folder(folder);
  const std::string path = farm.database();
  Queue queue(path);
  std::vector<NewJob> list;
  for (int i = 0; i < jobs; ++i) list.push_back(job_of(i));
  fmt::print("| with {} jobs queued | times | median | longest |\n|---|---|---|---|\n", jobs);
  measure("submit all, one transaction", 1, [&] { queue.submit(list, "user", "bench"); });
  measure("submit one more", 20,
          [&, i = jobs]() mutable { queue.submit({job_of(i++)}, "user", "bench"); });
  const std::string service = queue.start_service("local", 2, 100'000);
  ClaimRequest request;
  request.service = service;
  request.engine = "local";
  request.free_memory_mb = 100'000;
  std::vector<Claim> claims;
  measure("claim", 500, [&] { claims.push_back(*queue.claim(request)); });
  std::size_t next = 0;
  ResultRecord result;
  result.files = {{"uvj", 1, "a"}};
  measure("commit (two transactions)", 400, [&] {
    const std::string& token = claims[next++].token;
    queue.begin_commit(token);
    queue.finish(token, result, {}, false);
  });
  measure("put back", 50, [&] {
    AttemptEnd end;
    end.reason = Reason::lease_lost;
    queue.give_up(claims[next++].token, end);
  });
  queue.change_settings({{"user-running", "1"}}, "bench");
  for (std::size_t i = next; i < claims.size(); ++i) {
    AttemptEnd end;
    end.reason = Reason::stopped;
    queue.give_up(claims[i].token, end);
  }
  for (int i = 0; i < 10; ++i) queue.claim(request);
  measure("claim when every user has as many as allowed", 20, [&] { queue.claim(request); });
  ReadModel model(path);
  measure("status: summary", 20, [&] { model.summary(); });
  measure("status: summary and 20 newest jobs", 20, [&] {
    JobFilter f;
    f.limit = 20;
    f.order = JobFilter::Order::newest;
    model.summary();
    model.jobs(f);
  });
  measure("20 most urgent jobs", 20, [&] {
    JobFilter f;
    f.states = {JobState::queued};
    f.limit = 20;
    f.order = JobFilter::Order::urgency;
    model.jobs(f);
  });
  measure("20 worst height errors", 20, [&] {
    JobFilter f;
    f.states = {JobState::done};
    f.limit = 20;
    f.order = JobFilter::Order::worst_height;
    model.jobs(f);
  });
  measure("search a name", 20, [&] {
    JobFilter f;
    f.text = "part-04242";
    f.limit = 20;
    model.jobs(f);
  });
  measure("newest 100 events", 20, [&] { model.last_events(100); });
  JobFilter page;
  page.limit = 40;
  measure("status --json, data", 20, [&] { status_json(read_status(model, farm, page), farm); });
  measure("/api/v1/overview", 20, [&] { overview_json(read_overview(model, farm)); });
  measure("/metrics", 20, [&] { metrics_text(model, farm); });
  measure("/report", 5, [&] { morning_page(read_morning(farm, model, {}), {}); });
  // What the page asks for, through the server; curl's own start included.
  FarmServer server(farm, {});
  std::thread serving([&] { server.run(); });
  for (const std::string what :
       {"/", "/api/v1/overview", "/api/v1/jobs?limit=100", "/api/v1/jobs?limit=100&order=urgency",
        "/api/v1/jobs?limit=100&text=part-04242", "/metrics"}) {
    measure("curl " + what, 10, [&] {
      const auto answer = slicecorr::test::run_program({"curl", "-sSf", server.address() + what});
      if (answer.exit_code != 0) fmt::print(stderr, "{}\n", answer.err);
    });
  }
  server.stop();
  serving.join();
  // The program itself, its start of a quarter of a second and more included.
  const std::string bin =
      std::filesystem::read_symlink("/proc/self/exe").parent_path().string() + "/slicefarm";
  const auto program = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), bin);
    arguments.insert(arguments.end(), {"--dir", folder});
    const auto result = slicecorr::test::run_program(arguments);
    if (result.exit_code != 0) fmt::print(stderr, "{}\n", result.err);
  };
  measure("slicefarm status", 5, [&] { program({"status"}); });
  measure("slicefarm status --json -", 5, [&] { program({"status", "--json", "-"}); });
  measure("slicefarm status --find part-04242", 5, [&] {
    program({"status", "--find", "part-04242"});
  });
  measure("slicefarm cancel", 5, [&, i = 50'000]() mutable {
    program({"cancel", std::to_string(std::min(i++, jobs))});
  });
  fmt::print("\nDatabase: {:.1f} MB\n",
             static_cast<double>(std::filesystem::file_size(path)) / 1e6);
  std::filesystem::remove_all(folder);
  return 0;
}
