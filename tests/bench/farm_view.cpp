// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How quick everything that is seen stays: farm_view [JOBS]. A fifth of the jobs is done, one in a
// hundred of these failed, the rest waits. Prints a table: what, how often, time of one.

#include <fmt/format.h>
#include <stdlib.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "bench/farm_bench.hpp"
#include "slicecorr/farm/metrics.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/status.hpp"

namespace {

using namespace slicecorr::farm;
using slicecorr::bench::job_of;
using slicecorr::bench::measure;

}  // namespace

int main(int argc, char** argv) {
  const int jobs = argc > 1 ? std::atoi(argv[1]) : 100'000;
  std::string root = (std::filesystem::temp_directory_path() / "farm-view-XXXXXX").string();
  if (jobs <= 0 || !::mkdtemp(root.data())) return 2;
  const FarmFolder folder = open_folder(root);
  {
    Queue queue(folder.database());
    std::vector<NewJob> list;
    for (int i = 0; i < jobs; ++i) list.push_back(job_of(i));
    queue.submit(list, "user", "bench");
    ClaimRequest request;
    request.service = queue.start_service("local", 2, 100'000);
    request.engine = "local";
    request.free_memory_mb = 100'000;
    for (int i = 0; i < jobs / 5; ++i) {
      const Claim claim = *queue.claim(request);
      AttemptEnd end;
      end.wall_s = 2;
      end.cpu_s = 1.9;
      end.node = "night";
      if (i % 100 == 0) {
        end.reason = Reason::bad_input;
        end.message = "slice 7 of 12: entry has a wrong checksum";
        queue.give_up(claim.token, end);
        continue;
      }
      ResultRecord result;
      result.files = {{"uvj", 1'000'000, std::string(64, 'a')}, {"html", 1000, "b"}};
      result.figures.height_max_um = i % 977;
      queue.begin_commit(claim.token);
      queue.finish(claim.token, result, end, false);
    }
    for (int i = 0; i < 2; ++i) queue.claim(request);
  }
  ReadModel model(folder.database());
  fmt::print("| with {} jobs, {} of them ended | times | median | longest |\n|---|---|---|---|\n",
             jobs, jobs / 5);
  measure("status: counts, what runs, 50 jobs", 20, [&] {
    JobFilter f;
    f.limit = 50;
    status_text(read_status(model, folder, f), folder, 120);
  });
  measure("a frame of watch", 20,
          [&] { live_frame(read_live(model, folder, 40), folder, 120, 40, true); });
  measure("the page's overview", 20, [&] { overview_json(read_overview(model, folder)); });
  const auto list = [&](const std::string& what, const std::function<void(JobFilter&)>& change) {
    measure("the page's list, " + what, 20, [&] {
      JobFilter f;
      f.limit = 20;
      change(f);
      model.count(f);
      model.jobs(f);
    });
  };
  list("queued", [](JobFilter& f) {
    f.states = {JobState::queued};
    f.order = JobFilter::Order::urgency;
  });
  list("failed", [](JobFilter& f) {
    f.states = {JobState::failed};
    f.order = JobFilter::Order::ended;
  });
  list("worst height errors", [](JobFilter& f) {
    f.states = {JobState::done};
    f.order = JobFilter::Order::worst_height;
  });
  list("a name searched", [](JobFilter& f) { f.text = "part-0424"; });
  list("a user's, from the 5000th on", [](JobFilter& f) {
    f.user = "user-3";
    f.offset = 5000;
  });
  measure("the last 15 events", 20, [&] { model.last_events(15); });
  measure("the morning's page", 5, [&] {
    morning_page(read_morning(folder, model, {}), {LinkTo::Kind::server, ""});
  });
  measure("metrics", 20, [&] { metrics_text(model, folder); });
  std::filesystem::remove_all(root);
  return 0;
}
