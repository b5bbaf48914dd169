// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program `slicecorr-post`: corrects the file that a slicer just exported, or watches folders.

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <optional>

#include "post/correct_file.hpp"
#include "programs/common/figures.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "watch/done.hpp"
#include "watch/install.hpp"
#include "watch/watch.hpp"

namespace slicecorr::post {
namespace {

struct Arguments {
  PostSettings settings;
  std::string file, config, log;
  std::vector<std::string> parts;
  cli::MeshOptions meshes;
  bool again = false, undo = false, show_rule = false, json_log = false, tell_watcher = false;
  WatchOptions watch;
  std::string install, uninstall;  ///< folders
};

/// What the unit's command line needs of the options of watching, so that it watches as was asked for.
std::vector<std::string> unit_options(const CLI::App& app) {
  std::vector<std::string> options;
  for (const char* name : {"--recursive", "--new-only", "--log-json"}) {
    if (app.get_option(name)->count() > 0) options.emplace_back(name);
  }
  for (const char* name : {"--jobs", "--settle-s", "--patience-s", "--threads"}) {
    const CLI::Option* const option = app.get_option(name);
    if (option->count() > 0) {
      options.emplace_back(name);
      options.push_back(option->results().back());
    }
  }
  // Paths and programs are meant from here, not from where the unit runs.
  for (const char* name : {"--log", "--on-done", "--on-fail"}) {
    const CLI::Option* const option = app.get_option(name);
    if (option->count() == 0) continue;
    const std::string value = option->results().back();
    const bool is_path = std::string_view(name) == "--log" || value.find('/') != std::string::npos;
    options.emplace_back(name);
    options.push_back(is_path ? std::filesystem::absolute(value).lexically_normal().string()
                              : value);
  }
  return options;
}

/// Sets the watch of a folder up, or takes it away.
int install(const Arguments& a, const CLI::App& app, cli::Console& console) {
  const bool away = !a.uninstall.empty();
  const char* const name = away ? "--uninstall-watch" : "--install-watch";
  if (!a.file.empty() || !a.watch.folders.empty() || !a.parts.empty() || a.undo || a.again ||
      a.show_rule || a.watch.once || (away && !a.install.empty())) {
    throw InputError(fmt::format(
        "{} stands without FILE, --watch, --once, --part, --undo, --again and --show-rule", name));
  }
  const WatchInstall what{a.install + a.uninstall, a.config, given_on(app), unit_options(app)};
  const WatchInstalled done = away ? uninstall_watch(what) : install_watch(what);
  console.say(done.text);
  if (done.problem.empty()) return cli::kDone;
  throw DeviceError(fmt::format(
      "systemd's manager of the user could not be told ({}); {}", done.problem,
      away ? "a watch that runs goes on until it is stopped or the user signs out"
           : "the watch starts when the user signs in again, or by systemctl --user restart"));
}

/// A line of what an earlier run wrote beside a file that is another one now.
std::string taken_away(const std::string& path) {
  return fmt::format("\n  taken away: {}, of the earlier correction", path);
}

int correct_one(const Arguments& a, const PostRequest& request, const ExecutionContext& context,
                cli::Console& console) {
  if (a.undo) {
    std::string text = fmt::format("{}: is the slicer's file again", a.file);
    for (const std::string& gone : undo(a.file, request, context)) text += taken_away(gone);
    console.say(text);
    return cli::kDone;
  }
  if (a.show_rule) {
    cli::print_result(describe(preview(a.file, request)));
    return cli::kDone;
  }
  // A slicer shows all of stderr when something fails: then the error alone says most.
  ExecutionContext quiet = context;
  std::string remarks;
  if (request.slicer.by_slicer) {
    quiet.progress = nullptr;
    quiet.notice = [&](const std::string& text) { remarks += text + "\n"; };
  }
  const PostOutcome outcome = correct_file(a.file, request, quiet);
  if (outcome.left_alone) {
    console.say(fmt::format("{}: left alone, as {} says", a.file,
                            outcome.rule.empty() ? "the command line or [default]" : outcome.rule));
    return cli::kDone;
  }
  std::string text = fmt::format(
      "{}{}: {} slices corrected, {}{}\n", remarks, a.file, outcome.correction.info.grid.layers,
      in_one_line(outcome.setup.printer, outcome.setup.resin, *outcome.correction.info.process),
      outcome.rule.empty() ? "" : "; " + outcome.rule);
  for (const std::string& written : outcome.written) text += "  also written: " + written + "\n";
  for (const std::string& gone : outcome.removed) text += taken_away(gone).substr(1) + "\n";
  console.say(text + cli::summary(outcome.correction.after, outcome.correction.before) +
              cli::lifts_line(outcome.format, outcome.setup.process));
  return cli::kDone;
}

int run(const Arguments& a, const CLI::App& app, const ExecutionContext& context,
        cli::Console& console) {
  if (!a.install.empty() || !a.uninstall.empty()) return install(a, app, console);
  const bool watching = !a.watch.folders.empty();
  if (watching == !a.file.empty()) {
    throw InputError("expected a FILE, as the last argument, or --watch DIR");
  }
  if (a.undo && (a.again || a.show_rule || !a.parts.empty())) {
    throw InputError("--undo stands alone: it corrects nothing");
  }
  if (watching && (a.undo || a.again || a.show_rule)) {
    throw InputError(
        "--undo, --again and --show-rule are for one FILE; expected it without --watch");
  }
  const cli::MeshOptions plain;
  if (a.parts.empty() && (a.meshes.units != plain.units || a.meshes.scale != plain.scale ||
                          a.meshes.fit_mm > 0 || !a.meshes.rotate_deg.empty())) {
    throw InputError("--units, --scale, --fit-mm and --rotate-deg are for a part; expected --part");
  }
  PostRequest request;
  request.parts = cli::parts_inside(a.parts, a.meshes);
  request.part_options = part_options_on(app);
  request.config = load_config(a.config);
  request.given = given_on(app);
  request.again = a.again;
  request.watched = a.tell_watcher;
  if (a.tell_watcher) {
    const Done done = correct_and_tell(a.file, request, context);
    cli::print_result(done_json(done));
    return done.code;
  }
  if (!watching) {
    request.slicer = slicer_call_from_environment();
    return correct_one(a, request, context, console);
  }
  // What can't be read is not to be told of each file, an hour later.
  for (const std::string& part : request.parts.files) {
    read_mesh(part, request.parts.placement, context);
  }
  Log log(a.log, a.json_log, !context.notice);
  const WatchResult result = watch(a.watch, request, log, context);
  return result.code;
}

int run_program(int argc, char** argv) {
  Arguments a;
  cli::Program program(
      "slicecorr-post",
      "Corrects the archive of slices that a slicer just exported, in place, for light that cures "
      "through; or watches folders and corrects what is exported into them.",
      "slicecorr-post --printer prusa-sl1s --resin liqcreate-strong-x-405nm --backup part.sl1");
  CLI::App* app = nullptr;
  app = program.only([&](const ExecutionContext& context, cli::Console& console) {
    return run(a, *app, context, console);
  });
  app->add_option("FILE", a.file, "Archive to correct in place");
  cli::add_part_inside_to(*app, a.parts);
  a.settings.add_to(*app);
  a.meshes.add_turns_to(*app);
  app->add_option("--config", a.config,
                  "Rules and defaults [post.toml in the user's folder of slicecorr]");
  app->add_flag("--show-rule,--dry-run", a.show_rule,
                "Say which rule matches FILE and what would be done; change nothing");
  app->add_flag("--undo", a.undo, "Put the backup of FILE in its place");
  app->add_flag("--again", a.again, "Correct the backup of a corrected FILE anew");
  app->add_flag(kDoneFlag, a.tell_watcher)->group("");
  const char* const watching = "Watching";
  const auto grouped = [&](CLI::Option* option) { return option->group(watching); };
  grouped(app->add_option("--watch", a.watch.folders, "Folders to watch")->type_name("DIR"))
      ->expected(1, 1000);
  grouped(app->add_flag("--recursive", a.watch.recursive, "Watch the folders in them, too"));
  grouped(app->add_flag("--new-only", a.watch.new_only,
                        "Leave alone what is there at the start, except work that was cut short"));
  grouped(app->add_flag("--once", a.watch.once,
                        "Correct what is there, then stop; the exit code is that of what failed, 2 "
                        "where several failed differently"));
  grouped(app->add_option("--jobs", a.watch.jobs, "Files at once; they share the threads"))
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  grouped(app->add_option("--settle-s", a.watch.settle_s,
                          "Take a file when it has stayed the same for this long"))
      ->check(cli::number_in(0, 3600))
      ->capture_default_str();
  grouped(app->add_option("--patience-s", a.watch.patience_s,
                          "Give up a file that is no whole archive when it has stayed the same for "
                          "this long"))
      ->check(cli::number_in(0, 86400))
      ->capture_default_str();
  grouped(app->add_option("--log", a.log, "Add a line per file to FILE [stderr]"));
  grouped(app->add_flag("--log-json", a.json_log, "Lines of the log as JSON"));
  grouped(app->add_flag("--notify", a.watch.notify, "Desktop notifications through notify-send"));
  grouped(app->add_flag("--text-beside", a.watch.text_beside,
                        "Write what became of each file beside it, as FILE.txt"));
  grouped(app->add_option("--on-done", a.watch.on_done,
                          "Program to run with each corrected file as its argument"));
  grouped(app->add_option("--on-fail", a.watch.on_fail,
                          "Program to run with each file that failed as its argument"));
  grouped(
      app->add_option("--install-watch", a.install,
                      "Have systemd watch a folder whenever you are signed in, with the options "
                      "given here; outcomes are told on the desktop and beside the file")
          ->type_name("DIR"));
  grouped(
      app->add_option("--uninstall-watch", a.uninstall, "Take that away again")->type_name("DIR"));
  return program.run(argc, argv);
}

}  // namespace
}  // namespace slicecorr::post

int main(int argc, char** argv) { return slicecorr::post::run_program(argc, argv); }
