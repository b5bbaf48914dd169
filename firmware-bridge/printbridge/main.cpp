// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program `printbridge`: parses, calls, prints.

#include <fmt/format.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "frames/wire.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/beam_vat.hpp"
#include "slicecorr/bridge/beam_frames.hpp"
#include "slicecorr/bridge/beam_plan.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/bridge/print_state.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/bridge/view.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/load_printer.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "view_commands.hpp"

namespace slicecorr::bridge {
namespace {

using cli::Console;

constexpr double kMmHFromUmS = 3.6;
constexpr const char* kJobEnding = ".frames";

struct Options : PrinterOptions {
  std::string stack, modbus;
  std::vector<std::string> sinks, uv_sinks;
  bool dry_run = false, lockstep = false, machine_is_clear = false;
};

void add_printer(CLI::App& app, PrinterOptions& o) {
  app.add_option("--printer", o.printer, "Printer: a name, or a .toml file")->required();
  app.add_option("--dir", o.dir,
                 "Folder of the printers' states [$SLICECORR_BRIDGE_DIR, or "
                 "~/.local/state/slicecorr/bridge]");
}

std::string minutes(double seconds) {
  return seconds < 90 ? fmt::format("{:.1f} s", seconds)
                      : fmt::format("{} min {:02d} s", static_cast<int>(seconds) / 60,
                                    static_cast<int>(seconds) % 60);
}

std::string where_it_was(int frame, double z_um, const Machine& machine) {
  if (frame < 0) return "before the first frame";
  return fmt::format("frame {}, {}", frame, place_in_words(z_um, machine.stage.um_per_deg));
}

std::string layers_in_words(const PrintPlan& plan) {
  std::string text = "layer by layer";
  if (plan.black_excess > 0.005) {
    text += fmt::format(" (black behind the lamp adds {:.1f} % of the dose that gels)",
                        plan.black_excess * 100);
  }
  return text;
}

std::string ramps_in_words(const PrintPlan& plan) {
  if (plan.lamps_follow()) {
    return fmt::format("ramps of {:.0f} um that the lamps follow", plan.ramp_um);
  }
  return fmt::format("{:.0f} um of run-up between the platform and the first slice",
                     plan.run_up_um);
}

std::string speeds_in_words(const PrintPlan& plan) {
  const double most = plan.speed_um_s * kMmHFromUmS;
  if (plan.slice_speed_um_s.empty()) return fmt::format("{:g} mm/h", most);
  return fmt::format("{:g} mm/h, slices from {:g} mm/h on", most,
                     plan.slowest_um_s() * kMmHFromUmS);
}

/// Refuses to print after a fault that nobody has looked at.
void check_latch(const Options& o, const StateFolder& folder, const Machine& machine) {
  if (const auto latch = read_latch(folder, true)) {
    throw DeviceError(
        fmt::format("printer '{}' had a fault that nobody has looked at: {}: {} ({}). Look at the "
                    "machine, then `printbridge reset --printer {}`",
                    machine.printer.name, name_of(latch->fault), latch->detail,
                    where_it_was(latch->frame, latch->z_um, machine), o.printer));
  }
}

WireHello hello_of(const Options& o, const PrintPlan& plan, const Machine& machine) {
  WireHello hello;
  hello.layer_um = plan.layer_um;
  hello.slices = static_cast<int>(plan.frames.size());
  hello.start_um = plan.start_um;
  hello.m = plan.m;
  hello.cycle_s = machine.limits.cycle_s;
  hello.lockstep = o.lockstep;
  hello.dry_run = o.dry_run;
  hello.angles = plan.angles;
  return hello;
}

/// What is printed: a stack of slices, a tomographic job, or one with beams.
struct Material {
  std::unique_ptr<StackReader> stack;
  std::unique_ptr<tomo::TomoFrames> job;
  std::unique_ptr<tomo::BeamJob> beams;
  PrintPlan plan;
  WireHello hello;
  std::unique_ptr<FrameSource> frames;
};

Material stack_to_print(const Options& o, const Machine& machine, const ExecutionContext& context) {
  Material m;
  m.stack = std::make_unique<StackReader>(o.stack, cli::folder_of(o.stack), context);
  m.plan = plan_print(*m.stack, o.stack, machine, context);
  m.hello = hello_of(o, m.plan, machine);
  m.hello.setup = Setup{*m.stack->info().printer, *m.stack->info().resin, *m.stack->info().process};
  m.hello.target_layers = m.stack->info().target_layers;
  m.frames = make_frame_source(*m.stack, machine, m.plan.uv_patterned);
  return m;
}

/// A job that is printed is as it was solved.
void check_unchanged(const std::string& path, bool has_checksums) {
  if (has_checksums) return;
  throw InputError(path, "",
                   "has no checksums of what it says and shows: it was made by another program, or "
                   "changed since; expected a job as `slicecorr` writes it");
}

Material job_to_print(const Options& o, const Machine& machine, const ExecutionContext& context) {
  Material m;
  const tomo::TomoJob job = tomo::read_job(o.stack, context);
  check_unchanged(o.stack, job.has_checksums);
  m.plan = plan_turns(job, o.stack, machine);
  m.hello = hello_of(o, m.plan, machine);
  m.hello.setup.printer = job.printer;
  m.hello.setup.resin = job.resin;
  m.hello.setup.process.speed_mm_h = m.plan.speed_um_s * kMmHFromUmS;
  m.job = std::make_unique<tomo::TomoFrames>(o.stack, job, context);
  m.frames = make_frame_source(*m.job, job.turns, machine.printer);
  return m;
}

Material beams_to_print(const Options& o, const Machine& machine, const ExecutionContext& context) {
  Material m;
  m.beams = std::make_unique<tomo::BeamJob>(tomo::read_beam_job(o.stack, context));
  check_unchanged(o.stack, m.beams->has_checksums);
  m.plan = plan_beams(*m.beams, o.stack, machine, load_beam_vat(o.printer, machine.printer));
  m.hello = hello_of(o, m.plan, machine);
  m.hello.setup = Setup{m.beams->printer, m.beams->resin, process_of(*m.beams)};
  m.frames = make_frame_source(*m.beams, machine.printer);
  const std::size_t displays = m.beams->shown.displays.size();
  if (!o.sinks.empty() && o.sinks.size() != displays) {
    throw InputError(o.stack, "",
                     fmt::format("has images for {} displays, and there are {}; expected a --sink "
                                 "for each, in their order",
                                 displays, o.sinks.size()));
  }
  if (!o.uv_sinks.empty()) throw InputError(o.stack, "", "has no UV images; expected no --uv-sink");
  return m;
}

Material material_of(const Options& o, const Machine& machine, const ExecutionContext& context) {
  if (machine.stage.turns() || o.stack.ends_with(kJobEnding)) {
    return job_to_print(o, machine, context);
  }
  if (tomo::is_beam_job(o.stack)) return beams_to_print(o, machine, context);
  return stack_to_print(o, machine, context);
}

/// The displays of the curing light.
std::unique_ptr<FrameSink> open_displays(const Options& o, const Machine& machine,
                                         const Material& material, BridgeClock& clock) {
  if (!material.beams || o.sinks.empty()) {
    return open_sinks(o.sinks, machine, material.hello, clock);
  }
  std::vector<std::unique_ptr<FrameSink>> sinks;
  for (const std::string& name : o.sinks) {
    sinks.push_back(open_sinks({name}, machine, material.hello, clock));
  }
  return make_group_sink(std::move(sinks), *material.beams, machine.printer);
}

std::string in_words(const PrintPlan& plan) {
  if (plan.turns()) {
    const double deg_s = plan.speed_um_s / plan.um_per_deg;
    return fmt::format("{} turns of {} frames, {:g} °/s, {:.1f} frames a second",
                       plan.frames.size() / static_cast<std::size_t>(plan.angles), plan.angles,
                       deg_s, plan.speed_um_s / plan.layer_um);
  }
  return fmt::format("{} slices of {:g} um, {}", plan.frames.size(), plan.layer_um,
                     plan.mode == ExposureMode::layerwise
                         ? layers_in_words(plan)
                         : fmt::format("{}, {}", speeds_in_words(plan), ramps_in_words(plan)));
}

/// Says where and why the print ended; throws but where the user stopped it.
int tell_fault(const Options& o, const Ending& end, const PrintPlan& plan, const Machine& machine,
               const StateFolder& folder) {
  // Where the machine is in a fault of its own it has to be reset even if nothing was moved.
  const bool reset = end.latched || end.fault == Fault::machine_restarted ||
                     end.fault == Fault::watchdog_tripped || end.fault == Fault::lamp_failed ||
                     end.fault == Fault::stage_failed;
  const std::string left = in_words(end.left);
  // What must be read first stands first.
  const bool sure = end.left.confirmed();
  const std::string text = fmt::format(
      "{}{}: {} ({}). {}Journal: {}. To do: {}{}", sure ? "" : left + ". ", name_of(end.fault),
      end.detail, where_it_was(end.frame, end.stage_um - plan.start_um, machine),
      sure ? "State: " + left + ". " : "", folder.file("journal.jsonl"), what_to_do(end.fault),
      reset ? fmt::format(", then `printbridge reset --printer {}`", o.printer) : "");
  if (end.fault == Fault::stopped_by_user) {
    cli::write_stderr(fmt::format("printbridge: {}\n", text));
    return cli::kInterrupted;
  }
  if (end.fault == Fault::defect) throw std::runtime_error(text);
  throw DeviceError(text);
}

/// Which displays there are. Throws `InputError` when they don't fit the machine.
void choose_displays(const Options& o, Machine& machine) {
  if (o.sinks.empty() && !o.dry_run) {
    throw InputError(
        "no display: expected --sink window, drm, unix:PATH or tcp:HOST:PORT (--sink null shows "
        "images nowhere)");
  }
  std::vector<std::string> all = o.sinks;
  all.insert(all.end(), o.uv_sinks.begin(), o.uv_sinks.end());
  check_sinks(all, o.lockstep);
  if (!o.uv_sinks.empty() && !machine.uv_display) {
    machine.uv_display = uv_display_like_blue(machine);
  }
  if (machine.uv_display && o.uv_sinks.empty() && !o.dry_run) {
    throw InputError(machine.path, "uv_display",
                     "is a display of its own for UV images; expected --uv-sink window, drm, "
                     "unix:PATH or tcp:HOST:PORT for it");
  }
}

int print(const Options& o, const ExecutionContext& context, Console& console) {
  Machine machine = load_machine(o.printer);
  machine.connect_to(o.modbus);
  choose_displays(o, machine);
  const StateFolder folder = StateFolder::of(o.dir, machine.printer);
  const PrintLock lock(folder);
  const MachineLock machine_lock(*machine.modbus);
  check_latch(o, folder, machine);
  const Material material = material_of(o, machine, context);
  const PrintPlan& plan = material.plan;
  console.say(fmt::format("{}: {}, about {} once the machine is ready", o.stack,
                          material.beams ? fmt::format("images on {} displays at once",
                                                       material.beams->shown.displays.size())
                                         : in_words(plan),
                          minutes(plan.expected_s)));

  const auto link = make_modbus_link(*machine.modbus, machine.limits, o.lockstep);
  const Status before = check_alone(*link, *make_real_clock(), machine);
  // Before anything is sent: the first order to be off makes a stopped machine idle.
  if (const auto why = against_start(machine, before, o.machine_is_clear); !why.empty()) {
    throw DeviceError("nothing was sent to the machine: " + why);
  }
  const auto clock = o.lockstep ? make_step_clock() : make_real_clock();
  const auto sink = open_displays(o, machine, material, *clock);
  std::unique_ptr<FrameSink> uv_sink;
  if (machine.uv_display) {
    WireHello hello = material.hello;
    hello.uv_display = true;
    uv_sink = open_sinks(o.uv_sinks, uv_display_machine(machine), hello, *clock);
  }

  // The print outlives its terminal; `printbridge stop` ends it from another one.
  for (const int ignored : {SIGHUP, SIGTSTP, SIGPIPE, SIGTTOU}) std::signal(ignored, SIG_IGN);
  RunOptions run;
  run.dry_run = o.dry_run;
  run.lockstep = o.lockstep;
  run.threads = context.threads > 0 ? context.threads : 2;
  run.stack = std::filesystem::absolute(o.stack).string();
  run.stop = context.cancel;
  keep_report(folder);
  const Ending end = run_print(*material.frames, plan, machine, *link, *sink, *clock, folder, run,
                               context, uv_sink.get());
  try {
    write_report(folder, false);
  } catch (const Error& e) {
    console.say(std::string("no page of the print: ") + e.what());
  }
  if (!end.trouble.empty()) console.say("not all was recorded: " + end.trouble);
  if (end.light_off.slices > 0) {
    console.say(fmt::format(
        "{} got light that is off by more than 10 %, slice {} most: {:.0f} % of it; the journal "
        "names them all",
        end.light_off.slices == 1 ? "a slice" : fmt::format("{} slices", end.light_off.slices),
        end.light_off.slice, end.light_off.light * 100));
  }
  if (end.fault == Fault::none) {
    console.say(fmt::format(
        "printed {} frames in {}{}, from the first order on; at most {} late, the stage at most {} off, {} cycles missed; "
        "page: {}",
        end.frames_shown, minutes(end.seconds), o.dry_run ? " without light" : "",
        way_in_words(std::max(0.0, end.worst_late_um), plan.um_per_deg),
        way_in_words(end.worst_stage_error_um, plan.um_per_deg), end.missed_cycles,
        folder.file("report.html")));
    return cli::kDone;
  }
  return tell_fault(o, end, plan, machine, folder);
}

StateFolder folder_of(const Options& o) { return StateFolder::of(o.dir, load_printer(o.printer)); }

int request(const Options& o, const std::string& what, Console& console) {
  const auto answer = ask_running(folder_of(o), what);
  if (!answer) throw InputError(fmt::format("printer '{}' does not print now", o.printer));
  const auto json = slicecorr::detail::try_json(*answer);
  if (!json.is_object()) throw DeviceError("the print gives no answer that can be read");
  const std::string why = slicecorr::detail::text_in(json, "why");
  if (!slicecorr::detail::flag_in(json, "accepted"))
    throw InfeasibleError(what + " is refused: " + why);
  console.say(what + ": " + why);
  return cli::kDone;
}

int reset(const Options& o, Console& console) {
  Machine machine = load_machine(o.printer);
  machine.connect_to(o.modbus);
  const StateFolder folder = StateFolder::of(o.dir, machine.printer);
  const PrintLock lock(folder);
  const MachineLock machine_lock(*machine.modbus);
  const auto latch = read_latch(folder, true);
  make_missing_report(folder);
  const auto clock = make_real_clock();
  const auto link = make_modbus_link(*machine.modbus, machine.limits);
  check_alone(*link, *clock, machine);
  const Status after = reset_machine(*link, *clock, machine);
  clear_latch(folder);
  console.say(latch ? fmt::format("reset after {}: {}", name_of(latch->fault), latch->detail)
                    : std::string("reset; nothing was latched"));
  if (const auto why = against_start(machine, after, false); !why.empty()) console.say(why);
  return cli::kDone;
}

}  // namespace
}  // namespace slicecorr::bridge

int main(int argc, char** argv) {
  using namespace slicecorr;
  using namespace slicecorr::bridge;
  cli::Program program("printbridge", "Prints corrected stacks in real time",
                       "printbridge print part.uvj --printer P --sink unix:display.sock");
  Options o;
  const auto add = [&](const char* name, const char* text, cli::Program::Action action) {
    CLI::App* const app = program.add(name, text, std::move(action));
    add_printer(*app, o);
    return app;
  };
  auto* const p =
      add("print", "Print a stack of `slicecorr correct`, or a job of `slicecorr tomo solve`",
          [&](const ExecutionContext& context, cli::Console& c) { return print(o, context, c); });
  p->add_option("STACK", o.stack,
                "The corrected stack, or the job (.frames, or of slicecorr beams)")
      ->required();
  p->add_flag("--dry-run", o.dry_run, "Move the stage and show images, with lamps off");
  p->add_option("--sink", o.sinks,
                "Where images go: window[:DISPLAY], drm[:CARD[:CONNECTOR]], unix:PATH, "
                "tcp:HOST:PORT or null; repeatable, the first is the display that counts")
      ->check(cli::value_is(cli::ValueKind::text))
      ->take_all()
      ->expected(1);
  p->add_option("--uv-sink", o.uv_sinks,
                "Where patterned UV images go that have a display of their own, as --sink")
      ->check(cli::value_is(cli::ValueKind::text))
      ->take_all()
      ->expected(1);
  p->add_flag(
      "--machine-is-clear", o.machine_is_clear,
      "Somebody has seen that no part is on the machine, where its stage stands as if there was "
      "one");
  p->add_flag("--lockstep", o.lockstep,
              "Time is that of a simulator, which waits for every exchange");
  add_view_commands([&](const char* name, const char* text, PrinterOptions& options,
                        cli::Program::Action action) {
    CLI::App* const app = program.add(name, text, std::move(action));
    add_printer(*app, options);
    return app;
  });
  for (const auto& [name, text] :
       {std::pair{"pause", "Stop at the next place where a stop leaves no mark on the part"},
        std::pair{"resume", "Go on after a pause"},
        std::pair{"stop", "End the print for good: lamps off, stage stop, black"}}) {
    const std::string what = name;
    add(name, text,
        [&o, what](const ExecutionContext&, cli::Console& c) { return request(o, what, c); });
  }
  auto* const r = add("reset", "After a fault: ask the machine whether all is well, and go on",
                      [&](const ExecutionContext&, cli::Console& c) { return reset(o, c); });
  for (CLI::App* const app : {p, r}) {
    app->add_option("--modbus", o.modbus,
                    "Where the machine is, in place of the printer file's word: tcp:HOST:PORT or "
                    "rtu:DEVICE")
        ->check(cli::value_is(cli::ValueKind::text));
  }
  program.examples({
      {"status", "printbridge status --printer P"},
      {"watch", "printbridge watch --printer P"},
      {"report", "printbridge report --printer P -o print.html"},
      {"serve", "printbridge serve --printer P --listen 127.0.0.1:8421"},
      {"lamp-log", "printbridge lamp-log --printer P -o lamp.csv"},
      {"metrics", "printbridge metrics --printer P -o print.prom"},
      {"pause", "printbridge pause --printer P"},
      {"resume", "printbridge resume --printer P"},
      {"stop", "printbridge stop --printer P"},
      {"reset", "printbridge reset --printer P"},
  });
  return program.run(argc, argv);
}
