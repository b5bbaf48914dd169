// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicefarm watch` and `report`.

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "programs/common/watch.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/status.hpp"
#include "support/terminal/terminal.hpp"

namespace slicecorr::farm {

namespace {

struct WatchOptions : cli::WatchOptions {
  FarmOptions farm;
};

bool is_empty(const Overview& o) {
  return o.summary.jobs[static_cast<std::size_t>(JobState::queued)] == 0 &&
         o.summary.jobs[static_cast<std::size_t>(JobState::running)] == 0;
}

/// Each event as a line, and how far the running jobs are every ten seconds.
int watch_lines(const WatchOptions& o, const FarmFolder& folder, ReadModel& model) {
  constexpr std::int64_t between_lines_ms = 10'000;
  std::int64_t after = model.summary().last_event, told_ms = 0, version = -1;
  while (!cli::interrupted()) {
    if (const std::int64_t now = model.data_version(); now != version) {
      version = now;
      for (const FarmEvent& e : model.events(after, 1000)) {
        cli::print_result(fmt::format("{}  {}\n", local_time_text(e.at_ms), event_text(e)));
        after = e.seq;
      }
    }
    const std::int64_t now_ms = system_clock().steady_ms();
    if (now_ms - told_ms >= between_lines_ms || o.until_end) {
      const Overview overview = read_overview(model, folder);
      if (now_ms - told_ms >= between_lines_ms) {
        told_ms = now_ms;
        cli::print_result(overview_line(overview) + "\n");
      }
      // What happened meanwhile has been told when no event is left.
      if (o.until_end && is_empty(overview) && overview.summary.last_event <= after) break;
    }
    ::poll(nullptr, 0, static_cast<int>(o.interval_s * 1000));
  }
  return cli::interrupted() ? cli::kInterrupted : cli::kDone;
}

int watch(const WatchOptions& o) {
  const FarmFolder folder = o.farm.existing();
  ReadModel model(folder.database());
  const auto frame = [&](int columns, int rows, bool colour) {
    const LiveState state = read_live(model, folder, rows);
    return cli::WatchFrame{live_frame(state, folder, columns, rows, colour),
                           is_empty(state.overview)};
  };
  if (o.once) return cli::print_frame(o, frame);
  return cli::FrameTerminal::possible() ? cli::watch_terminal(o, frame)
                                        : watch_lines(o, folder, model);
}

struct ReportOptions {
  FarmOptions farm;
  MorningOptions what;
  std::string since, until, output, json;
};

int report(ReportOptions& o) {
  const FarmFolder folder = o.farm.existing();
  if (o.output.empty() && o.json.empty()) o.output = folder.root + "/report.html";
  const std::int64_t now_ms = system_clock().wall_ms();
  if (!o.since.empty()) o.what.from_ms = moment_of(o.since, now_ms, "--since");
  if (!o.until.empty()) o.what.until_ms = moment_of(o.until, now_ms, "--until");
  ReadModel model(folder.database());
  MorningReport morning = read_morning(folder, model, o.what);
  if (!o.json.empty()) cli::print_or_write(o.json, morning_json(morning));
  if (!o.output.empty()) {
    // Links lead from where the page is to where the parts' reports are.
    const std::string base =
        o.output == "-" ? "" : std::filesystem::absolute(o.output).lexically_normal().parent_path();
    cli::print_or_write(o.output, morning_page(morning, LinkTo{LinkTo::Kind::files, base}));
  }
  return cli::kDone;
}

}  // namespace

void add_follow_commands(cli::Program& program) {
  {
    auto o = std::make_shared<WatchOptions>();
    CLI::App* app = program.add("watch", "Follow the farm on the terminal; q quits",
                                [o](const ExecutionContext&, cli::Console&) { return watch(*o); });
    o->farm.add_to(*app);
    o->add_to(*app, "--until-empty", "End when nothing is queued or running");
  }
  {
    auto o = std::make_shared<ReportOptions>();
    CLI::App* app = program.add(
        "report",
        "Write the report of the night: what is done, what failed, how well parts will print",
        [o](const ExecutionContext&, cli::Console&) { return report(*o); });
    o->farm.add_to(*app);
    app->add_option("-o,--output", o->output, "The page; - for stdout [DIR/report.html]");
    app->add_option("--json", o->json, "Write JSON to this file; - for stdout");
    app->add_option("--since", o->since,
                    "From when: \"20:00\" (the last one), \"2026-03-01 20:00\", \"36h\" [24h]")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--until", o->until, "To when, as --since [now]")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--batch", o->what.batch, "Only jobs that were submitted together")
        ->check(CLI::PositiveNumber);
  }
  add_serve_commands(program);
}

}  // namespace slicecorr::farm
