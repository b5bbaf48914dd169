// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program `printer-sim`: a printer to test against.

#include <fmt/format.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "programs/common/program.hpp"
#include "recorder.hpp"
#include "sim/frame_server.hpp"
#include "sim/modbus_server.hpp"
#include "sim/timed_model.hpp"
#include "slicecorr/bridge/model.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"
#include "turn_recorder.hpp"

namespace {

using namespace slicecorr;
using namespace slicecorr::bridge;

struct Options {
  std::string printer, listen, frames, uv_frames, output, events, stack;
  std::vector<std::string> faults;
  std::string modbus;
  bool lockstep = false, check_machine = false;
  double time_rate = 1;
};

std::atomic<bool> terminated{false};
void on_terminate(int) { terminated = true; }

std::string default_listen(const RegisterMap& map) {
  if (map.transport == Transport::rtu) return map.device;
  return fmt::format("127.0.0.1:{}", map.port);
}

/// Events as JSON, one per line, each written before the machine goes on.
class EventLog {
 public:
  /// `um_per_deg`: as in `Stage`.
  EventLog(const std::string& path, TimedModel& model, double um_per_deg) : path_(path) {
    if (path.empty()) return;
    out_.open(path, std::ios::trunc);
    if (!out_) throw DeviceError(path + ": can't be written");
    model.on_event([this, um_per_deg](const SimEvent& e) {
      nlohmann::ordered_json line{{"at_s", e.at_s}, {"event", e.what}, {"stage_um", e.stage_um}};
      if (um_per_deg > 0) line["stage_deg"] = e.stage_um / um_per_deg;
      out_ << line.dump() << '\n' << std::flush;
    });
  }
  void check() const {
    if (!path_.empty() && !out_) throw DeviceError(path_ + ": can't be written");
  }

 private:
  std::string path_;
  std::ofstream out_;
};

std::string fault_help() {
  std::string text = "WHAT[=VALUE][@TIMEs|@frame:N], repeatable: ";
  for (const SimFaultKind& kind : sim_fault_kinds()) {
    if (text.back() != ' ') text += ", ";
    text += std::string(kind.name);
    if (!kind.value.empty()) text += fmt::format("[={}]", kind.value);
  }
  return text;
}

std::vector<std::string> fault_names() {
  std::vector<std::string> names;
  for (const SimFaultKind& kind : sim_fault_kinds()) names.emplace_back(kind.name);
  return names;
}

/// Checks a real machine (--check) instead of simulating one.
int check(const Options& o) {
  if (o.lockstep || o.time_rate != 1 || !o.listen.empty() || !o.frames.empty() ||
      !o.uv_frames.empty() || !o.output.empty() || !o.events.empty() || !o.stack.empty() ||
      !o.faults.empty()) {
    throw InputError("--check-machine goes with --printer and --modbus alone");
  }
  Machine machine = load_machine(o.printer);
  machine.connect_to(o.modbus);
  const MachineLock lock(*machine.modbus);
  const auto clock = make_real_clock();
  int good = 0, bad = 0;
  check_machine([&] { return make_modbus_link(*machine.modbus, machine.limits); }, *clock, machine,
                [&](const MachineCheck& c) {
                  using Found = MachineCheck::Found;
                  good += c.found == Found::good ? 1 : 0;
                  bad += c.found == Found::bad ? 1 : 0;
                  const char* const word = c.found == Found::good  ? "ok        "
                                           : c.found == Found::bad ? "WRONG     "
                                                                   : "not tested";
                  cli::print_result(fmt::format("{}  {}: {}\n", word, c.what, c.detail));
                });
  if (bad > 0 || cli::interrupted()) {
    throw DeviceError(
        fmt::format("{} of {} things that the machine must do are wrong", bad, good + bad));
  }
  return cli::kDone;
}

int run(const Options& o, const ExecutionContext& context, cli::Console& console) {
  if (o.check_machine) return check(o);
  if (!o.modbus.empty()) throw InputError("--modbus goes with --check-machine");
  if (!o.output.empty()) {
    cli::check_output(o.output, {o.stack});
    if (o.frames.empty() && o.stack.empty()) {
      throw InputError("-o needs the images: expected --frames, or --stack beside it");
    }
    if (!std::filesystem::is_directory(cli::folder_of(o.output))) {
      throw DeviceError(o.output + ": its folder does not exist");
    }
  }
  if (o.lockstep && o.time_rate != 1) {
    throw InputError("--time-rate and --lockstep contradict each other");
  }
  Machine machine = load_machine(o.printer);
  if (!machine.modbus) {
    throw InputError(machine.path, "modbus", "missing; expected the register map of a machine");
  }
  if (!o.uv_frames.empty()) {
    if (o.frames.empty()) throw InputError("--uv-frames goes with --frames, for blue images");
    if (!machine.uv_display) machine.uv_display = uv_display_like_blue(machine);
  } else if (machine.uv_display && !o.frames.empty()) {
    throw InputError(machine.path, "uv_display",
                     "is a display of its own for UV images; expected --uv-frames beside --frames");
  }
  const bool turns = machine.stage.turns();
  const std::string ending = turns ? ".csv" : ".uvj";
  if (!o.output.empty() && !o.output.ends_with(ending)) {
    throw InputError(o.output, "",
                     fmt::format("expected a name that ends with {}{}", ending,
                                 turns ? ": what a vial was shown is a table" : ""));
  }
  if (turns && !o.stack.empty()) {
    throw InputError("--stack is for stages that move along a line; jobs come with --frames");
  }
  std::vector<SimFault> faults;
  for (const std::string& text : o.faults) faults.push_back(parse_sim_fault(text));

  PrinterModel printer(machine, std::move(faults));
  TimedModel model(printer, {o.lockstep, o.time_rate, machine.limits.cycle_s});
  EventLog events(o.events, model, machine.stage.um_per_deg);
  std::unique_ptr<PrintRecorder> recorder;
  if (turns) {
    recorder = std::make_unique<TurnRecorder>(o.output, machine, model);
  } else {
    recorder = std::make_unique<Recorder>(o.output, o.stack, machine, model, context);
  }
  ModbusServer modbus(o.listen.empty() ? default_listen(*machine.modbus) : o.listen, machine,
                      model);
  std::unique_ptr<FrameServer> display;
  if (!o.frames.empty()) {
    display = std::make_unique<FrameServer>(
        o.frames, machine, false, model, [&](const WireHello& hello) { recorder->begin(hello); },
        [&](const std::string& why) { console.say(why); });
  }
  std::unique_ptr<FrameServer> uv_display;
  if (!o.uv_frames.empty()) {
    uv_display = std::make_unique<FrameServer>(
        o.uv_frames, machine, true, model, [](const WireHello&) {},
        [&](const std::string& why) { console.say("UV display: " + why); });
  }

  struct sigaction action {};
  action.sa_handler = on_terminate;
  sigaction(SIGTERM, &action, nullptr);
  nlohmann::ordered_json ready{{"ready", true}, {"modbus", modbus.address()}};
  if (display) ready["frames"] = display->address();
  if (uv_display) ready["uv_frames"] = uv_display->address();
  cli::print_result(ready.dump() + "\n");

  // In lockstep a machine that nobody speaks to any more has all the time there is: its watchdog
  // must act, too.
  bool was_watched = false;
  modbus.serve([&] {
    model.with([](PrinterModel&) {});
    const bool watched = display && display->busy();
    const bool left = modbus.everybody_left() || (was_watched && !watched && !modbus.busy());
    if (left && !watched && o.lockstep) model.run_out();
    was_watched = watched;
    return !terminated && !cli::interrupted();
  });

  display.reset();
  uv_display.reset();
  model.run_out();
  const auto written = recorder->finish();
  for (const std::string& file : written) console.say(fmt::format("{}: written", file));
  if (written.empty() && !o.output.empty()) {
    console.say(fmt::format("nothing was printed: {} is not written", o.output));
  }
  events.check();
  return terminated ? cli::kDone : cli::kInterrupted;
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  cli::Program program(
      "printer-sim",
      "A printer to test against: Modbus, stage, lamps, interlocks and watchdog, with faults on "
      "demand. Records what was shown and lit as a stack. Ends with SIGTERM.",
      "printer-sim --printer dual-wavelength-dlp --listen 127.0.0.1:0 --frames tcp:127.0.0.1:0 -o "
      "shown.uvj");
  CLI::App* app = program.only([&](const ExecutionContext& context, cli::Console& console) {
    return run(o, context, console);
  });
  app->add_option("--printer", o.printer, "Name or .toml file of the printer, with [modbus]")
      ->required();
  app->add_option("--listen", o.listen,
                  "HOST:PORT (port 0: a free one) or the path of a serial device [as the printer "
                  "file says, on 127.0.0.1]");
  app->add_option("--frames", o.frames, "unix:PATH or tcp:HOST:PORT: takes the images there")
      ->check(cli::value_is(cli::ValueKind::text));
  app->add_option("--uv-frames", o.uv_frames,
                  "unix:PATH or tcp:HOST:PORT: takes the images of a UV display there, of printers "
                  "with patterned UV light")
      ->check(cli::value_is(cli::ValueKind::text));
  app->add_option("-o,--output", o.output,
                  "Recorded stack, .uvj; of a vial that turns a table, .csv: written at the end");
  app->add_option("--record-events", o.events, "What the machine does, as JSON, one per line");
  app->add_option("--stack", o.stack,
                  "The stack that will be printed [printbridge says it over --frames]");
  app->add_option("--fault", o.faults, fault_help())
      ->expected(1)
      ->take_all()
      ->check(cli::value_such_as(fault_names()));
  app->add_flag("--lockstep", o.lockstep,
                "Time passes by exchanges and images alone: the same print is the same every time");
  app->add_option("--time-rate", o.time_rate, "How many times as fast as real time [1]")
      ->check(cli::number_in(0.001, 1000));
  app->add_flag("--check-machine", o.check_machine,
                "Drives a real machine through every command without light, and reports: its stage "
                "moves by a millimetre, or turns by a quarter");
  app->add_option("--modbus", o.modbus,
                  "Where that machine is [as the printer file says]: tcp:HOST:PORT or rtu:DEVICE")
      ->check(cli::value_is(cli::ValueKind::text));
  return program.run(argc, argv);
}
