// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// scan, scans and next.

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/scans.hpp"
#include "support/text/display_text.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm {

using Json = nlohmann::ordered_json;

namespace {

struct ScanCommand {
  FarmOptions farm;
  NewScan scan;
  std::string json;
};

int scan(const ScanCommand& o, cli::Console& console) {
  NewScan given = o.scan;
  if (given.user.empty()) given.user = user_name();
  cli::check_output(o.json, {given.path});
  const TakenScan taken = take_scan(o.farm.existing(), given);
  for (const std::string& note : taken.notes) console.say(note);
  if (!o.json.empty()) cli::print_or_write(o.json, scan_json(taken.scan) + "\n");
  if (o.json == "-") return cli::kDone;
  cli::print_result(fmt::format("{}\nkept as scan {} of job {}: {}\n{}", taken.words,
                                taken.scan.number, taken.scan.job, in_words(taken.scan),
                                taken.drift.empty() ? "" : taken.drift + "\n"));
  return cli::kDone;
}

struct ScansCommand {
  FarmOptions farm;
  JobId job = 0;
  int remove = 0;
  std::string printer, resin, json, page;
};

/// The group that was asked for, for a page.
const PrintsOverTime& chosen(const std::vector<PrintsOverTime>& all, const ScansCommand& o) {
  const PrintsOverTime* found = nullptr;
  int fitting = 0;
  for (const PrintsOverTime& p : all) {
    if ((!o.printer.empty() && p.printer != o.printer) || (!o.resin.empty() && p.resin != o.resin))
      continue;
    found = &p;
    ++fitting;
  }
  if (fitting != 1) {
    throw InputError(fmt::format(
        "{} pairs of printer and resin have such scans; expected one, by --printer and --resin",
        fitting));
  }
  if (!found->drift) {
    throw InputError(
        fmt::format("{} prints on {} with {} were scanned; expected 3 or more for a "
                    "chart",
                    found->scans.size(), found->printer, found->resin));
  }
  return *found;
}

int scans(const ScansCommand& o, cli::Console& console) {
  const FarmFolder folder = o.farm.existing();
  ReadModel model(folder.database());
  if (o.remove > 0) {
    if (o.job == 0) throw InputError("--remove is the number of a scan; expected its --job, too");
    Queue queue(folder.database());
    remove_scan(folder, queue, scan_of(model, o.job, o.remove), user_name());
    console.say(fmt::format("scan {} of job {}: removed", o.remove, o.job));
    return cli::kDone;
  }
  const std::vector<PrintsOverTime> all = prints_over_time(model);
  cli::check_output(o.json, {});
  cli::check_output(o.page, {});
  if (!o.page.empty()) {
    cli::write_text_file(o.page, chosen(all, o).drift->to_page());
    console.say(fmt::format("{}: written", o.page));
  }
  if (!o.json.empty()) cli::print_or_write(o.json, prints_over_time_json(all));
  if (o.json == "-") return cli::kDone;
  std::vector<std::vector<std::string>> rows;
  for (const KeptScan& s : model.scans(o.job)) {
    rows.push_back({std::to_string(s.job), text::printable(s.name), std::to_string(s.number),
                    text::printable(s.file), s.printer, s.resin, fmt::format("{:+.2f}", s.mean_um),
                    fmt::format("{:.2f}", s.mean_abs_um), fmt::format("{:.2f}", s.p95_um),
                    fmt::format("{:.1f}", s.worst_um)});
  }
  cli::print_result(text::table({"job", "name", "scan", "file", "printer", "resin", "mean, um",
                                 "mean absolute", "95 % within", "worst"},
                                rows, 0));
  for (const PrintsOverTime& p : all) {
    if (const std::string words = beyond_in_words(p); !words.empty()) {
      cli::print_result(words + "\n");
    }
  }
  return cli::kDone;
}

struct NextCommand {
  FarmOptions farm;
  NextAsk ask;
  std::string json;
};

int next(const NextCommand& o, const ExecutionContext& context, cli::Console& console) {
  NextAsk ask = o.ask;
  if (ask.user.empty()) ask.user = user_name();
  cli::check_output(o.json, {});
  const NextMade made = make_next(o.farm.existing(), ask, context);
  if (!o.json.empty()) {
    const Json json = {{"job", made.print.job},
                       {"of", made.print.of},
                       {"edges_mean_um", made.print.before_mean_um},
                       {"edges_p95_um", made.print.before_p95_um},
                       {"words", made.print.words},
                       {"notes", made.notes}};
    cli::print_or_write(o.json, json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
  }
  if (o.json == "-") return cli::kDone;
  for (const std::string& note : made.notes) console.say(note);
  console.say(fmt::format("{}: written", made.resin));
  console.say(fmt::format("{}: written", made.printer));
  cli::print_result(fmt::format(
      "{}\nas it is understood now, edges along z of the print of job {} are off by {:.2f} um in "
      "the mean, 95 % within {:.2f} um\njob {} is queued, corrected with what was found; its "
      "figures will be what is expected of it\n",
      made.print.words, made.print.of, made.print.before_mean_um, made.print.before_p95_um,
      made.print.job));
  return cli::kDone;
}

}  // namespace

void add_scan_commands(cli::Program& program) {
  {
    auto o = std::make_shared<ScanCommand>();
    CLI::App* app = program.add(
        "scan", "Measure a scan of a job's print against what was predicted, and keep it",
        [o](const ExecutionContext&, cli::Console& console) { return scan(*o, console); });
    o->farm.add_to(*app);
    app->add_option("JOB", o->scan.job, "Job that is done")->required();
    app->add_option("SCAN", o->scan.path, "Mesh, points or volume (.npy), in any pose")
        ->required()
        ->check(CLI::ExistingFile);
    app->add_option("--unit", o->scan.unit,
                    "Unit of the scan's numbers: auto, um, mm, cm, inch or m")
        ->check(CLI::IsMember({"auto", "um", "mm", "cm", "inch", "m"}))
        ->capture_default_str();
    app->add_option("--voxel-um", o->scan.voxel_um, "Side of a voxel, of volumes")
        ->check(cli::number_above_zero());
    app->add_option("--json", o->json, "Write what is kept as JSON to FILE, or - for stdout");
    app->add_option("--user", o->scan.user, "Who has scanned it [who runs this]")
        ->check(cli::value_is(cli::ValueKind::text));
  }
  {
    auto o = std::make_shared<ScansCommand>();
    CLI::App* app = program.add(
        "scans", "List scans of prints, chart how prints wander, remove a scan",
        [o](const ExecutionContext&, cli::Console& console) { return scans(*o, console); });
    o->farm.add_to(*app);
    app->add_option("--job", o->job, "Of this job alone");
    app->add_option("--remove", o->remove, "Number of a scan of --job whose files are to go")
        ->check(CLI::Range(1, 1'000'000));
    app->add_option("--printer", o->printer, "Of the chart, where there are several")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--resin", o->resin, "Of the chart, where there are several")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--json", o->json, "Write all as JSON to FILE, or - for stdout");
    app->add_option("--html", o->page,
                    "Write a page with the chart of one printer and resin to FILE (.html)");
  }
  {
    auto o = std::make_shared<NextCommand>();
    CLI::App* app =
        program.add("next", "Tune by the scans of a job, and queue it again with what was found",
                    [o](const ExecutionContext& context, cli::Console& console) {
                      return next(*o, context, console);
                    });
    o->farm.add_to(*app);
    app->add_option("JOB", o->ask.job, "Job that was printed and scanned")->required();
    app->add_option("--scan", o->ask.scans, "Numbers of its scans [all]")
        ->delimiter(',')
        ->check(CLI::Range(1, 1'000'000));
    app->add_option("--printer", o->ask.printer, "Printer to tune [the job's, by its name]")
        ->check(cli::value_is(cli::ValueKind::printer));
    app->add_option("--resin", o->ask.resin, "Resin to tune [the job's, by its name]")
        ->check(cli::value_is(cli::ValueKind::resin));
    app->add_option("--out", o->ask.folder, "Folder for the resin and printer that are tuned")
        ->capture_default_str()
        ->check(CLI::ExistingDirectory);
    app->add_option("--json", o->json, "Write what was made as JSON to FILE, or - for stdout");
    app->add_option("--user", o->ask.user, "User of the new job [who runs this]")
        ->check(cli::value_is(cli::ValueKind::text));
  }
}

}  // namespace slicecorr::farm
