// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/service.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/verdict.hpp"

namespace slicecorr::farm {

namespace {

struct RunArguments {
  FarmOptions farm;
  std::string engine = "local", folder;
  LocalEngineOptions local;
  SlurmEngineOptions slurm;
  bool until_empty = false;
};

std::string own_path() {
  std::error_code error;
  const auto path = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) throw DeviceError("/proc/self/exe: can't be read: " + error.message());
  return path.string();
}

std::unique_ptr<Engine> make_engine(RunArguments& a, const FarmFolder& folder,
                                    const ExecutionContext& context) {
  if (a.local.program.empty()) a.local.program = own_path();
  if (a.engine == "local") {
    a.local.cores = context.threads;
    return make_local_engine(a.local);
  }
  a.slurm.program = std::filesystem::absolute(a.local.program).string();
  a.slurm.store = folder.store;
  Queue queue(folder.database());
  for (const auto& [label, text] : queue.settings().slurm_labels) {
    if (text != "none") a.slurm.label_map.push_back(label + "=" + text);
  }
  return make_slurm_engine(a.slurm);
}

/// Names jobs that ended since then and do not print as designed, or are to be looked at.
void tell_verdicts(const FarmFolder& folder, std::int64_t since_ms, cli::Console& console) {
  constexpr std::int64_t kMost = 20;
  JobFilter filter;
  filter.states = {JobState::done};
  filter.ended_since_ms = since_ms;
  filter.order = JobFilter::Order::ended;
  filter.limit = 100'000;
  std::int64_t found = 0;
  for (const Job& job : ReadModel(folder.database()).jobs(filter)) {
    const auto& verdict = job.figures ? job.figures->verdict : std::nullopt;
    if (!verdict || verdict->outcome == name_of(Outcome::as_designed)) continue;
    if (++found <= kMost) {
      console.say(fmt::format("job {} {}: {}", job.id, job.name, verdict->words));
    }
  }
  if (found > kMost) {
    console.say(fmt::format("{} more that are not as designed: slicefarm status names them",
                            found - kMost));
  }
}

int run_command(RunArguments& a, const ExecutionContext& context, cli::Console& console) {
  const FarmFolder folder = a.farm.open();
  const std::unique_ptr<Engine> engine = make_engine(a, folder, context);
  ServiceOptions options;
  options.until_empty = a.until_empty;
  options.say = [&](const std::string& text) { console.say(text); };
  const std::int64_t began_ms = system_clock().wall_ms();
  const ServiceTotals t = run_service(folder, *engine, options, *context.cancel);
  console.say(
      fmt::format("{} done, {} of them from the cache; {} failed", t.done, t.from_cache, t.failed));
  if (a.until_empty) tell_verdicts(folder, began_ms, console);
  if (cli::interrupted()) return cli::kInterrupted;
  // Without --until-empty a service ends because it was told to, and that is no failure of it.
  return a.until_empty && t.failed > 0 ? cli::kMissed : cli::kDone;
}

int nodes_command(RunArguments& a, const ExecutionContext& context) {
  std::string text = fmt::format("{:<20} {:<18} {:>10} {:>17}  {}\n", "node", "state", "cores used",
                                 "memory used, MB", "labels");
  for (const FarmNode& n : make_engine(a, a.farm.existing(), context)->nodes()) {
    text +=
        fmt::format("{:<20} {:<18} {:>10} {:>17}  {}\n", n.name, n.state,
                    fmt::format("{}/{}", n.cores_used, n.cores),
                    fmt::format("{}/{}", n.memory_used_mb, n.memory_mb), fmt::join(n.labels, ","));
  }
  cli::print_result(text);
  return cli::kDone;
}

int worker_command(const RunArguments& a, const ExecutionContext& context, cli::Console&) {
  // Whatever the engine does with our output, the log is where the farm looks for it.
  const std::string path = a.folder + "/log.txt";
  const int log = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (log < 0)
    throw InputError(a.folder, "", "can't be written; expected the folder of an attempt");
  ::dup2(log, STDERR_FILENO);
  ::close(log);
  return do_work(a.folder, context.cancel,
                 [](const std::string& text) { cli::write_stderr(text + "\n"); });
}

void add_engine_options(CLI::App& app, RunArguments& a) {
  a.farm.add_to(app);
  app.add_option("--engine", a.engine, "Where work runs: processes here, or a Slurm cluster")
      ->check(CLI::IsMember({"local", "slurm"}))
      ->capture_default_str();
  app.add_option("--partition", a.slurm.partition, "Slurm partition")
      ->check(cli::value_is(cli::ValueKind::text));
}

}  // namespace

void add_run_commands(cli::Program& program) {
  const auto a = std::make_shared<RunArguments>();
  CLI::App* run = program.add("run", "Work: take jobs from the queue until stopped",
                              [a](const ExecutionContext& context, cli::Console& console) {
                                return run_command(*a, context, console);
                              });
  add_engine_options(*run, *a);
  run->add_flag("--until-empty", a->until_empty,
                "End when nothing is queued or running; exit code 5 when jobs failed meanwhile");
  run->add_option("--jobs", a->local.jobs, "Workers at a time (local) [one per core]")
      ->check(CLI::Range(1, 4096));
  run->add_option("--memory-mb", a->local.memory_mb,
                  "Memory of all workers together (local) [four fifths of what is free]")
      ->check(CLI::Range(64, 1 << 30));
  run->add_option("--account", a->slurm.account, "Slurm account")
      ->check(cli::value_is(cli::ValueKind::text));
  run->add_option("--qos", a->slurm.qos, "Slurm quality of service")
      ->check(cli::value_is(cli::ValueKind::text));
  run->add_option("--queue-ahead", a->slurm.queue_ahead,
                  "Tasks given to Slurm at a time [twice the partition's cores]")
      ->check(CLI::Range(1, 100000));
  run->add_option("--slurm-throttle", a->slurm.throttle, "Tasks of an array that run at a time")
      ->check(CLI::Range(1, 100000));
  run->add_option(
         "--slurm-time-factor", a->slurm.time_factor,
         "Slurm's time limit: this many times the estimate, half an hour at least; 0: none")
      ->check(cli::number_in(0, 1000))
      ->capture_default_str();
  run->add_option("--slurm-poll-s", a->slurm.poll_s,
                  "Between two questions to Slurm; more when it is slow to answer")
      ->check(cli::number_in(0.1, 600))
      ->capture_default_str();
  run->add_option("--sbatch-argument", a->slurm.sbatch_arguments,
                  "Given to sbatch as it is; may be repeated")
      ->check(cli::value_is(cli::ValueKind::text));
  run->add_option("--worker-program", a->local.program,
                  "Path of slicefarm on the nodes [this one]");

  CLI::App* nodes = program.add(
      "nodes", "The engine's machines, and how busy they are",
      [a](const ExecutionContext& context, cli::Console&) { return nodes_command(*a, context); });
  add_engine_options(*nodes, *a);

  CLI::App* worker = program.add("worker", "One attempt, in its folder: what engines start",
                                 [a](const ExecutionContext& context, cli::Console& console) {
                                   return worker_command(*a, context, console);
                                 });
  worker->add_option("FOLDER", a->folder, "Folder of the attempt")->required();
  worker->group("");  // not for people
}

}  // namespace slicecorr::farm
