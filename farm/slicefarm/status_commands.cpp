// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicefarm status` and `logs`.

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <memory>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/status.hpp"

namespace slicecorr::farm {

namespace {

struct StatusOptions {
  FarmOptions farm;
  std::vector<std::string> states;
  std::string json, order;
  JobId id = 0;  ///< 0: all
  JobFilter filter;
};

int terminal_columns() {
  winsize size{};
  const bool known = ::isatty(STDOUT_FILENO) == 1 &&
                     ::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return known ? size.ws_col : 0;
}

/// The head of what is told of a job: what it is, what it came to, and where that is.
std::string job_in_words(const Job& job) {
  std::string text = fmt::format("job {} {}: {}\n", job.id, job.name, name_of(job.state));
  if (!job.message.empty()) text += job.message + "\n";
  if (job.figures) text += in_words(*job.figures) + "\n";
  if (job.state == JobState::done) {
    for (const ResultFile& f : job.files) text += job.output(f.ending) + "\n";
  } else {
    text += fmt::format("results come into {}\n", job.output_folder);
  }
  return text;
}

Job known_job(ReadModel& model, JobId id) {
  auto job = model.job(id);
  if (!job) throw InputError(fmt::format("job {} is not known", id));
  return *std::move(job);
}

int status_of_one(const StatusOptions& o) {
  const FarmFolder folder = o.farm.existing();
  ReadModel model(folder.database());
  const Job job = known_job(model, o.id);
  if (!o.json.empty()) {
    cli::print_or_write(o.json, job_json(job));
    if (o.json == "-") return cli::kDone;
  }
  cli::print_result(job_in_words(job));
  return cli::kDone;
}

int status(StatusOptions& o) {
  if (o.id > 0) return status_of_one(o);
  const FarmFolder folder = o.farm.existing();
  for (const std::string& name : o.states) {
    o.filter.states.push_back(*job_state_named(name));
  }
  using Order = JobFilter::Order;
  if (o.order == "newest") o.filter.order = Order::newest;
  if (o.order == "urgency") o.filter.order = Order::urgency;
  if (o.order == "ended") o.filter.order = Order::ended;
  if (o.order == "worst") o.filter.order = Order::worst_height;
  ReadModel model(folder.database());
  const StatusPage page = read_status(model, folder, o.filter);
  if (!o.json.empty()) {
    cli::print_or_write(o.json, status_json(page, folder));
    if (o.json == "-") return cli::kDone;
  }
  cli::print_result(status_text(page, folder, terminal_columns()));
  return cli::kDone;
}

struct LogOptions {
  FarmOptions farm;
  JobId id = 0;
  int attempt = 0;
};

int logs(const LogOptions& o) {
  constexpr std::int64_t most_bytes = 64 << 20;
  const FarmFolder folder = o.farm.existing();
  ReadModel model(folder.database());
  const Job job = known_job(model, o.id);
  std::string text;
  if (o.attempt == 0) {
    text = job_in_words(job);
    for (const FarmEvent& e : model.events(0, 10'000, o.id)) {
      text += fmt::format("{}  {:<13} {}{}{}\n", local_time_text(e.at_ms), e.kind,
                          name_of(e.reason), e.reason == Reason::none ? "" : ": ", e.text);
    }
  }
  bool any = false;
  for (const Attempt& a : model.attempts(o.id)) {
    if (o.attempt > 0 && a.number != o.attempt) continue;
    any = true;
    text +=
        fmt::format("\nattempt {}, {}{}{}: {}\n", a.number, a.engine, a.node.empty() ? "" : " on ",
                    a.node, a.reason == Reason::none ? a.phase : name_of(a.reason));
    text += log_tail(folder, a, most_bytes);
    if (text.back() != '\n') text += '\n';
  }
  if (!any && o.attempt > 0) {
    throw InputError(fmt::format("job {} has no attempt {}", o.id, o.attempt));
  }
  cli::print_result(text);
  return cli::kDone;
}

}  // namespace

void add_status_commands(cli::Program& program) {
  {
    auto o = std::make_shared<StatusOptions>();
    CLI::App* app = program.add("status", "What is queued, running, done and failed",
                                [o](const ExecutionContext&, cli::Console&) { return status(*o); });
    o->farm.add_to(*app);
    CLI::Option* const one =
        app->add_option("ID", o->id, "Only this job: what it came to, and where its results are")
            ->check(cli::number_in(1, 9e15));
    app->add_option("--state", o->states,
                    "Only jobs in these states: queued,running,done,failed,cancelled")
        ->delimiter(',')
        ->check(CLI::IsMember({"queued", "running", "done", "failed", "cancelled"}));
    app->add_option("--user", o->filter.user, "Only jobs of this user")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--label", o->filter.label, "Only jobs with this label")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--batch", o->filter.batch, "Only jobs that were submitted together")
        ->check(CLI::PositiveNumber);
    app->add_option("--find", o->filter.text, "Only jobs with this text in their name or a part's")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--order", o->order,
                    "newest, urgency, ended or worst (height error) [by state, or by id]")
        ->check(CLI::IsMember({"newest", "urgency", "ended", "worst"}));
    o->filter.limit = 40;
    app->add_option("--limit", o->filter.limit, "Show at most this many jobs [40]")
        ->check(CLI::Range(0, 1'000'000));
    app->add_option("--offset", o->filter.offset,
                    "Leave out this many jobs before the first one shown")
        ->check(CLI::NonNegativeNumber);
    for (const char* const of_many :
         {"--state", "--user", "--label", "--batch", "--find", "--order", "--limit", "--offset"}) {
      app->get_option(of_many)->excludes(one);
    }
    app->add_option("--json", o->json, "Write JSON to this file; - for stdout");
  }
  {
    auto o = std::make_shared<LogOptions>();
    CLI::App* app = program.add("logs", "What happened to a job, with the logs of its attempts",
                                [o](const ExecutionContext&, cli::Console&) { return logs(*o); });
    o->farm.add_to(*app);
    app->add_option("ID", o->id, "Number of the job")->required()->check(cli::number_in(1, 9e15));
    app->add_option("--attempt", o->attempt, "Only the log of this attempt")
        ->check(CLI::PositiveNumber);
  }
}

}  // namespace slicecorr::farm
