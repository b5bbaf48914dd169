#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/service.hpp"
#include "slicecorr/farm/work.hpp"

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

int run_command(RunArguments& a, const slicecorr::Job& job, cli::Console& console) {
  const FarmFolder folder = a.farm.open();
  if (a.local.program.empty()) a.local.program = a.slurm.program = own_path();
  a.local.cores = job.threads;
  std::unique_ptr<Engine> engine =
      a.engine == "slurm" ? make_slurm_engine(a.slurm) : make_local_engine(a.local);
  ServiceOptions options;
  options.until_empty = a.until_empty;
  options.say = [&](const std::string& text) { console.say(text); };
  const ServiceTotals t = run_service(folder, *engine, options, *job.cancel);
  console.say(
      fmt::format("{} done, {} of them from the cache; {} failed", t.done, t.from_cache, t.failed));
  return cli::interrupted() ? cli::kInterrupted : cli::kDone;
}

int worker_command(const RunArguments& a, const slicecorr::Job& job, cli::Console&) {
  // Whatever the engine does with our output, the log is where the farm looks for it.
  const std::string path = a.folder + "/log.txt";
  const int log = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (log < 0)
    throw InputError(a.folder, "", "can't be written; expected the folder of an attempt");
  ::dup2(log, STDERR_FILENO);
  ::close(log);
  return do_work(a.folder, job.cancel,
                 [](const std::string& text) { fmt::print(stderr, "{}\n", text); });
}

}  // namespace

void add_run_commands(cli::Program& program) {
  const auto a = std::make_shared<RunArguments>();
  CLI::App* run = program.add("run", "Work: take jobs from the queue until stopped",
                              [a](const slicecorr::Job& job, cli::Console& console) {
                                return run_command(*a, job, console);
                              });
  a->farm.add_to(*run);
  run->add_option("--engine", a->engine, "Where work runs: processes here, or a Slurm cluster")
      ->check(CLI::IsMember({"local", "slurm"}))
      ->capture_default_str();
  run->add_flag("--until-empty", a->until_empty, "End when nothing is queued or running");
  run->add_option("--jobs", a->local.jobs, "Workers at a time (local) [one per core]")
      ->check(CLI::Range(1, 4096));
  run->add_option("--memory-mb", a->local.memory_mb,
                  "Memory of all workers together (local) [four fifths of what is free]")
      ->check(CLI::Range(64, 1 << 30));
  run->add_option("--partition", a->slurm.partition, "Slurm partition");
  run->add_option("--account", a->slurm.account, "Slurm account");
  run->add_option("--qos", a->slurm.qos, "Slurm quality of service");
  run->add_option("--queue-ahead", a->slurm.queue_ahead, "Tasks that may wait in Slurm")
      ->check(CLI::Range(1, 100000));
  run->add_option(
      "--label-map", a->slurm.label_map,
      "LABEL=CONSTRAINT: jobs with this label go to such nodes (Slurm); may be repeated");
  run->add_option("--sbatch-argument", a->slurm.sbatch_arguments,
                  "Given to sbatch as it is; may be repeated");
  run->add_option("--worker-program", a->local.program,
                  "Path of slicefarm on the nodes [this one]");

  CLI::App* worker = program.add("worker", "One attempt, in its folder: what engines start",
                                 [a](const slicecorr::Job& job, cli::Console& console) {
                                   return worker_command(*a, job, console);
                                 });
  worker->add_option("FOLDER", a->folder, "Folder of the attempt")->required();
  worker->group("");  // not for people
}

}  // namespace slicecorr::farm
