#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "words.hpp"

namespace slicecorr::farm {

namespace {

struct StatusArguments {
  FarmOptions farm;
  std::string json, state, user, label, text;
  std::int64_t limit = 20;
  JobId id = 0;
};

JobFilter filter_of(const StatusArguments& a) {
  JobFilter f;
  f.user = a.user;
  f.label = a.label;
  f.text = a.text;
  f.limit = a.limit;
  f.order = JobFilter::Order::newest;
  if (!a.state.empty()) {
    const auto state = job_state_named(a.state);
    f.states = {*state};
    if (*state == JobState::queued) f.order = JobFilter::Order::urgency;
    if (*state == JobState::done || *state == JobState::failed) f.order = JobFilter::Order::ended;
  }
  return f;
}

std::string row_of(const Job& j) {
  std::string what = j.message.substr(0, j.message.find('\n'));
  if (j.state == JobState::done && j.figures) {
    what = fmt::format("largest height error {:.2f} um", j.figures->height_max_um);
    if (j.from_cache) what += ", from the cache";
  }
  if (j.follows > 0) what = fmt::format("the same work as job {}", j.follows);
  return fmt::format("{:>6} {:<9} {:<28} {:<10} {:>4} {:<14} {}\n", j.id, name_of(j.state), j.name,
                     j.user, j.priority, name_of(j.reason), what);
}

std::string table_of(ReadModel& model, const StatusArguments& a) {
  const ReadModel::Snapshot snapshot(model);
  const Summary s = model.summary();
  std::string text;
  for (int i = 0; i < job_states; ++i) {
    text += fmt::format("{}{} {}", i ? ", " : "", s.jobs[static_cast<std::size_t>(i)],
                        name_of(static_cast<JobState>(i)));
  }
  if (s.from_cache > 0) text += fmt::format(" ({} done from the cache)", s.from_cache);
  text += "\n";
  if (s.queued_s > 0) {
    text += fmt::format("work left: {} on one core", duration_text(s.queued_s));
    if (s.eta_s > 0) text += fmt::format("; empty in about {}", duration_text(s.eta_s));
    text += s.late > 0 ? fmt::format("; {} will be late\n", s.late) : "\n";
  }
  bool any = false;
  for (const Service& v : model.services()) {
    if (!v.alive) continue;
    any = true;
    text += fmt::format("service {} on {}, process {}: {}\n", v.engine, v.host, v.pid,
                        v.doing.empty() ? "starting" : v.doing);
  }
  if (!any) text += "no service is running (slicefarm run)\n";
  const Settings settings = model.settings();
  if (settings.paused) text += "paused\n";
  if (settings.draining) text += "draining\n";
  const auto running = model.running();
  for (const RunningJob& r : running) {
    text += fmt::format("{:>6} {:<9} {:<28} {:>3.0f} %  {:<8} {} of {} layers, {}{}\n", r.job.id,
                        "running", r.job.name, 100 * r.attempt.fraction, r.attempt.stage,
                        r.attempt.layers_done, r.job.layers, duration_text(r.seconds),
                        r.eta_s >= 0 ? ", " + duration_text(r.eta_s) + " left" : "");
  }
  const auto jobs = model.jobs(filter_of(a));
  if (!jobs.empty()) {
    text += fmt::format("{:>6} {:<9} {:<28} {:<10} {:>4} {:<14}\n", "id", "state", "name", "user",
                        "prio", "reason");
  }
  for (const Job& j : jobs) text += row_of(j);
  return text;
}

std::string json_of(ReadModel& model, const StatusArguments& a) {
  const ReadModel::Snapshot snapshot(model);
  const Summary s = model.summary();
  auto json = nlohmann::ordered_json::parse(summary_json(s, model.settings(), model.services()));
  json["running"] = nlohmann::ordered_json::array();
  for (const RunningJob& r : model.running()) {
    auto job = nlohmann::ordered_json::parse(job_json(r.job));
    job["attempt"] = nlohmann::ordered_json::parse(attempt_json(r.attempt));
    job["seconds"] = r.seconds;
    job["eta_s"] = r.eta_s >= 0 ? nlohmann::ordered_json(r.eta_s) : nlohmann::ordered_json(nullptr);
    json["running"].push_back(std::move(job));
  }
  json["list"] = nlohmann::ordered_json::array();
  for (const Job& j : model.jobs(filter_of(a))) {
    json["list"].push_back(nlohmann::ordered_json::parse(job_json(j)));
  }
  return json.dump(2);
}

int status_command(const StatusArguments& a) {
  ReadModel model(a.farm.existing().database());
  if (a.json.empty()) {
    cli::print_result(table_of(model, a));
  } else {
    cli::print_or_write(a.json, json_of(model, a));
  }
  return cli::kDone;
}

std::string log_of(const FarmFolder& folder, const Attempt& a) {
  const std::string path = a.log.empty() ? folder.attempt(a.token) + "/log.txt" : a.log;
  std::ifstream file(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(file), {});
}

int logs_command(const StatusArguments& a) {
  const FarmFolder folder = a.farm.existing();
  ReadModel model(folder.database());
  const auto job = model.job(a.id);
  if (!job) throw InputError(fmt::format("job {} is not known", a.id));
  std::string text = fmt::format("job {} {}: {}\n", job->id, job->name, name_of(job->state));
  if (!job->message.empty()) text += job->message + "\n";
  for (const Event& e : model.events(0, 10'000, a.id)) {
    text += fmt::format("{}  {:<13} {}{}{}\n", local_time_text(e.at_ms), e.kind, name_of(e.reason),
                        e.reason == Reason::none ? "" : ": ", e.text);
  }
  for (const Attempt& t : model.attempts(a.id)) {
    text +=
        fmt::format("\nattempt {}, {}{}{}: {}\n", t.number, t.engine, t.node.empty() ? "" : " on ",
                    t.node, t.reason == Reason::none ? t.phase : name_of(t.reason));
    text += log_of(folder, t);
  }
  cli::print_result(text);
  return cli::kDone;
}

}  // namespace

void add_status_commands(cli::Program& program) {
  const auto a = std::make_shared<StatusArguments>();
  CLI::App* status =
      program.add("status", "What is queued, running, done and failed",
                  [a](const slicecorr::Job&, cli::Console&) { return status_command(*a); });
  a->farm.add_to(*status);
  status->add_option("--json", a->json, "Write as JSON to FILE, or - for stdout");
  status->add_option("--state", a->state, "Only jobs in this state")
      ->check(CLI::IsMember({"queued", "running", "done", "failed", "cancelled"}));
  status->add_option("--user", a->user, "Only jobs of this user");
  status->add_option("--label", a->label, "Only jobs with this label");
  status->add_option("--find", a->text, "Only jobs with this text in their name or part");
  status->add_option("--limit", a->limit, "Jobs to list at most")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  CLI::App* logs =
      program.add("logs", "What happened to a job, with the logs of its attempts",
                  [a](const slicecorr::Job&, cli::Console&) { return logs_command(*a); });
  a->farm.add_to(*logs);
  logs->add_option("ID", a->id, "Number of the job")->required();
}

}  // namespace slicecorr::farm
