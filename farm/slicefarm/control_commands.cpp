// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/service.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm {

namespace {

struct ControlArguments {
  FarmOptions farm;
  std::vector<JobId> ids;
  std::vector<std::string> settings;
  int priority = 0;
  std::string ready_by;
  GcOptions gc;
};

Queue queue_of(const ControlArguments& a) { return Queue(a.farm.existing().database()); }
/// Settings may come before the first job.
Queue new_queue_of(const ControlArguments& a) { return Queue(a.farm.open().database()); }

std::string queue_folder(const ControlArguments& a) { return a.farm.existing().database(); }

int cancel_command(const ControlArguments& a, cli::Console& console) {
  Queue queue = queue_of(a);
  std::string unknown;
  for (const JobId id : a.ids) {
    switch (queue.cancel(id, user_name())) {
      case CancelOutcome::cancelled:
        console.say(fmt::format("job {}: cancelled", id));
        break;
      case CancelOutcome::asked:
        console.say(fmt::format("job {}: its worker is being ended", id));
        break;
      case CancelOutcome::too_late: {
        const auto job = ReadModel(queue_folder(a)).job(id);
        const JobState state = job ? job->state : JobState::running;
        console.say(fmt::format("job {}: {}; nothing was cancelled", id,
                                state == JobState::done        ? "is done already"
                                : state == JobState::failed    ? "has failed already"
                                : state == JobState::cancelled ? "was cancelled already"
                                                               : "is just being finished"));
        break;
      }
      case CancelOutcome::unknown:
        unknown += fmt::format("{}{}", unknown.empty() ? "" : ", ", id);
        break;
    }
  }
  if (!unknown.empty()) throw InputError(unknown + ": no such job");
  return cli::kDone;
}

int retry_command(const ControlArguments& a, cli::Console& console) {
  Queue queue = queue_of(a);
  std::string refused;
  for (const JobId id : a.ids) {
    if (queue.retry(id, user_name())) {
      console.say(fmt::format("job {}: queued again", id));
    } else {
      refused += fmt::format("{}{}", refused.empty() ? "" : ", ", id);
    }
  }
  if (!refused.empty()) {
    throw InputError(refused + ": neither failed nor cancelled; only such jobs are tried again");
  }
  return cli::kDone;
}

int priority_command(const ControlArguments& a, bool has_priority, cli::Console& console) {
  if (!has_priority && a.ready_by.empty()) throw InputError("expected --to N or --ready-by HH:MM");
  Queue queue = queue_of(a);
  std::int64_t ready_by = kNoDeadline;
  if (!a.ready_by.empty() && a.ready_by != "none") {
    const int minute = parse_minute(a.ready_by);
    if (minute < 0) {
      throw InputError("--ready-by is '" + a.ready_by + "', expected HH:MM or none");
    }
    ready_by = next_local_minute(system_clock().wall_ms(), minute);
  }
  std::string refused;
  for (const JobId id : a.ids) {
    bool changed = true;
    if (has_priority) changed = queue.set_priority(id, a.priority, user_name());
    if (!a.ready_by.empty()) changed = queue.set_ready_by(id, ready_by, user_name()) && changed;
    if (!changed) refused += fmt::format("{}{}", refused.empty() ? "" : ", ", id);
  }
  if (!refused.empty()) throw InputError(refused + ": neither queued nor running");
  console.say("changed");
  return cli::kDone;
}

int set_command(const ControlArguments& a) {
  Queue queue = new_queue_of(a);
  std::vector<std::pair<std::string, std::string>> changes;
  for (const std::string& text : a.settings) {
    const std::size_t at = text.find('=');
    if (at == text.npos) throw InputError("'" + text + "': expected NAME=VALUE");
    changes.emplace_back(text.substr(0, at), text.substr(at + 1));
  }
  queue.change_settings(changes, user_name());
  std::string list;
  for (const auto& [name, text] : setting_texts(queue.settings())) {
    list += fmt::format("{} = {}\n", name, text);
  }
  cli::print_result(list);
  return cli::kDone;
}

int change(const ControlArguments& a, bool paused, bool draining, const char* say,
           cli::Console& console) {
  Queue queue = new_queue_of(a);
  queue.change_settings({{"paused", paused ? "yes" : "no"}, {"draining", draining ? "yes" : "no"}},
                        user_name());
  console.say(say);
  return cli::kDone;
}

int gc_command(const ControlArguments& a, cli::Console& console) {
  const FarmFolder folder = a.farm.existing();
  Queue queue(folder.database());
  const GcTotals t = collect_garbage(folder, queue, a.gc);
  console.say(fmt::format("{}: {} results, {} inputs, {} leftovers, {}{}",
                          a.gc.dry_run ? "would be removed" : "removed", t.results, t.inputs,
                          t.leftovers, text::bytes(static_cast<double>(t.bytes)),
                          t.inputs_in_use ? "; inputs stay while a submission is at work" : ""));
  return cli::kDone;
}

}  // namespace

void add_control_commands(cli::Program& program) {
  const auto a = std::make_shared<ControlArguments>();
  const auto add = [&](const char* name, const char* text, auto action) {
    CLI::App* sub =
        program.add(name, text, [a, action](const ExecutionContext&, cli::Console& console) {
          return action(*a, console);
        });
    a->farm.add_to(*sub);
    return sub;
  };
  const auto add_ids = [&](CLI::App* sub) {
    sub->add_option("ID", a->ids, "Numbers of jobs")->required()->check(cli::number_in(1, 9e15));
    return sub;
  };
  using A = ControlArguments;
  using C = cli::Console;
  add_ids(add("cancel", "End jobs, running ones too",
              [](const A& args, C& c) { return cancel_command(args, c); }));
  add_ids(add("retry", "Queue failed or cancelled jobs again",
              [](const A& args, C& c) { return retry_command(args, c); }));
  const auto has_priority = std::make_shared<CLI::Option*>(nullptr);
  CLI::App* priority =
      add_ids(add("priority", "Change when queued jobs come", [has_priority](const A& args, C& c) {
        return priority_command(args, (*has_priority)->count() > 0, c);
      }));
  *has_priority = priority->add_option("--to", a->priority, "Priority: larger comes first");
  priority->add_option("--ready-by", a->ready_by, "HH:MM, or none")
      ->check(cli::value_is(cli::ValueKind::text));
  CLI::App* set = add("set", "Show settings, or change them for all services of the farm",
                      [](const A& args, C&) { return set_command(args); });
  set->add_option("NAME=VALUE", a->settings,
                  "night=20:00-07:00|off, user-running=N, user-queued=N, user-running.NAME=N, "
                  "user-queued.NAME=N, min-free-mb=N, max-attempts=N, hang-s=N, retry-delay-s=N, "
                  "cache-max-mb=N; 0 is no limit; "
                  "slurm-label.LABEL=constraint:X|partition:X|gres:X|none")
      ->check(cli::value_is(cli::ValueKind::text));
  add("pause", "Start nothing; what runs goes on", [](const A& args, C& c) {
    return change(args, true, false, "paused: nothing is started", c);
  });
  add("drain", "Start nothing; services end when nothing runs", [](const A& args, C& c) {
    return change(args, false, true, "draining: services end when nothing runs", c);
  });
  add("resume", "After pause or drain: start jobs again",
      [](const A& args, C& c) { return change(args, false, false, "resumed", c); });
  CLI::App* gc = add("gc", "Remove what nothing needs; outputs and what jobs wait for stay",
                     [](const A& args, C& c) { return gc_command(args, c); });
  gc->add_option("--older-than-days", a->gc.older_than_days,
                 "Results in the cache that were not used for so long")
      ->check(cli::number_in(0, 1e6));
  gc->add_option("--cache-max-mb", a->gc.max_mb, "Least recently used results beyond this size")
      ->check(CLI::Range(0, 1 << 30));
  gc->add_flag("--dry-run", a->gc.dry_run, "Only say what would be removed");
}

}  // namespace slicecorr::farm
