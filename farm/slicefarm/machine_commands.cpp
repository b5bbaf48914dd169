// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicefarm machines`.

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/machines.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "support/json/read_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm {

namespace {

struct MachineCommand {
  FarmOptions farm;
  std::string machine, what, json;
  std::vector<std::string> names;  ///< of machines, or hosts to ask
  double wait_s = 3, interval_s = 5;
  bool once = false;
  StartWords words;
};

struct AddCommand {
  FarmOptions farm;
  MachineSpec machine;
  std::string kind, address;
  std::vector<int> resolution_px;
};

std::string machine_text(const MachineView& v) {
  const MachineStatus& s = v.status;
  std::string text = name_of(s.state);
  if (!s.phase.empty()) text += " (" + s.phase + ")";
  if (s.layer && s.layers && is_print(s.state)) {
    text += fmt::format(", layer {} of {}", *s.layer, *s.layers);
  }
  if (s.left_s && is_print(s.state)) text += ", " + text::duration(*s.left_s) + " left";
  return text;
}

std::string plate_text(const MachineRecord& r) {
  return r.plate_full ? "full: " + r.plate_why : "not known to be full";
}

/// Asks all of them at once.
std::vector<MachineView> look_at(const FarmFolder& folder,
                                 const std::vector<MachineSpec>& machines) {
  std::vector<MachineView> views(machines.size());
  std::vector<std::thread> threads;
  threads.reserve(machines.size());
  for (std::size_t i = 0; i < machines.size(); ++i) {
    views[i].machine = machines[i];
    threads.emplace_back([&, i] {
      try {
        views[i] = MachineRoom(folder, machines[i]).look();
      } catch (const std::exception& e) {
        views[i].status.trouble = text::printable(e.what());
      }
    });
  }
  for (std::thread& t : threads) t.join();
  return views;
}

std::vector<MachineSpec> machines_of(const MachineCommand& o, const FarmFolder& folder) {
  if (o.names.empty()) return read_machines(folder);
  std::vector<MachineSpec> list;
  for (const std::string& name : o.names) list.push_back(machine_named(folder, name));
  return list;
}

std::string table_of(const std::vector<MachineView>& views) {
  std::vector<std::vector<std::string>> rows;
  rows.reserve(views.size());
  for (const MachineView& v : views) {
    rows.push_back({v.machine.name, name_of(v.machine.kind), v.machine.printer, machine_text(v),
                    v.status.file, plate_text(v.record), v.status.trouble});
  }
  return text::table({"machine", "kind", "printer", "state", "file", "plate", "trouble"}, rows, 0);
}

int list(const MachineCommand& o, cli::Console& console) {
  const FarmFolder folder = o.farm.open();
  const std::vector<MachineView> views = look_at(folder, machines_of(o, folder));
  if (!o.json.empty()) {
    std::string text = "[";
    for (const MachineView& v : views) text += (text.size() > 1 ? "," : "") + view_json(v);
    cli::print_or_write(o.json, text + "]");
    if (o.json == "-") return cli::kDone;
  }
  if (views.empty()) console.say("machines.toml names none; slicefarm machines add adds one");
  cli::print_result(table_of(views));
  return cli::kDone;
}

int watch(const MachineCommand& o) {
  const FarmFolder folder = o.farm.open();
  const std::vector<MachineSpec> machines = machines_of(o, folder);
  if (machines.empty()) throw InputError("machines.toml names no machine");
  std::vector<std::string> told(machines.size());
  while (!cli::interrupted()) {
    const std::vector<MachineView> views = look_at(folder, machines);
    for (std::size_t i = 0; i < views.size(); ++i) {
      std::string line = machine_text(views[i]);
      if (!views[i].status.trouble.empty()) line += "; " + views[i].status.trouble;
      if (line == told[i]) continue;
      told[i] = line;
      cli::print_result(fmt::format("{}  {}: {}\n", local_time_text(system_clock().wall_ms()),
                                    views[i].machine.name, line));
    }
    if (o.once) return cli::kDone;
    const auto until = system_clock().steady_ms() + static_cast<std::int64_t>(o.interval_s * 1000);
    while (!cli::interrupted() && system_clock().steady_ms() < until) ::poll(nullptr, 0, 50);
  }
  return cli::kInterrupted;
}

int discover(const MachineCommand& o, cli::Console& console) {
  const std::vector<FoundMachine> found = discover_machines(o.names, o.wait_s, o.what);
  if (!o.json.empty()) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const FoundMachine& f : found) {
      list.push_back({{"kind", name_of(f.kind)},
                      {"address", f.host},
                      {"name", f.name},
                      {"model", f.model},
                      {"id", f.id},
                      {"protocol", f.version},
                      {"firmware", f.firmware}});
    }
    cli::print_or_write(o.json,
                        list.dump(-1, ' ', false, decltype(list)::error_handler_t::replace));
    if (o.json == "-") return cli::kDone;
  }
  if (found.empty()) {
    console.say(fmt::format(
        "no machine answered within {:g} s; others than SDCP, PrusaLink and OctoPrint machines are "
        "added by their address",
        o.wait_s));
    return cli::kDone;
  }
  std::vector<std::vector<std::string>> rows;
  rows.reserve(found.size());
  for (const FoundMachine& f : found) {
    rows.push_back({f.host, name_of(f.kind), f.name, f.model, f.id, f.firmware});
  }
  cli::print_result(text::table({"address", "kind", "name", "model", "id", "firmware"}, rows, 0));
  console.say(
      "SDCP machines answer a call, PrusaLink and OctoPrint announce themselves; others are added by "
      "their address");
  return cli::kDone;
}

int add(AddCommand& o, cli::Console& console) {
  const FarmFolder folder = o.farm.open();
  MachineSpec& m = o.machine;
  m.kind = *machine_kind_named(o.kind);
  set_address(m, o.address);
  if (!o.resolution_px.empty()) {
    m.width_px = o.resolution_px.at(0);
    m.height_px = o.resolution_px.at(1);
  }
  if (!m.key_file.empty()) m.key_file = std::filesystem::absolute(m.key_file).lexically_normal();
  add_machine(folder, m);
  console.say(m.name + ": added; slicefarm machines test " + m.name + " asks it");
  return cli::kDone;
}

int test(const MachineCommand& o) {
  const FarmFolder folder = o.farm.open();
  MachineRoom room(folder, machine_named(folder, o.machine));
  const MachineFacts f = room.facts();
  std::string text =
      fmt::format("model      {}\nfirmware   {}\nid         {}\nresolution {}\nreads      ",
                  f.model, f.firmware, f.id,
                  f.width_px > 0 ? fmt::format("{} x {}", f.width_px, f.height_px) : "not said");
  for (const std::string& format : f.formats) text += format + " ";
  const MachineView view = room.look();
  text += (f.formats.empty() ? "not said" : "") + std::string("\nstate      ") +
          machine_text(view) + "\nplate      " + plate_text(view.record) + "\n";
  if (!view.status.trouble.empty()) text += "trouble    " + view.status.trouble + "\n";
  bool good = view.status.state != MachineState::unknown;
  if (!o.what.empty()) {
    const MachineCheck check = room.check(o.what);
    for (const std::string& each : check.against) text += "against    " + each + "\n";
    for (const std::string& each : check.unchecked) text += "unchecked  " + each + "\n";
    if (check.against.empty()) text += "the file may be sent\n";
    cli::print_result(text);
    return check.against.empty() ? cli::kDone : cli::kInput;
  }
  cli::print_result(text);
  return good ? cli::kDone : cli::kDevice;
}

/// A file, or the stack of a job that is done.
std::pair<std::string, JobId> what_to_send(const MachineCommand& o, const FarmFolder& folder) {
  const bool number = o.what.find_first_not_of("0123456789") == o.what.npos;
  if (!number || o.what.size() > 15) return {o.what, 0};
  const JobId id = std::stoll(o.what);
  const auto job = ReadModel(o.farm.existing().database()).job(id);
  if (!job) throw InputError("job " + o.what + " is not known");
  return {stack_for(machine_named(folder, o.machine), *job), id};
}

int send(const MachineCommand& o, const ExecutionContext& context, cli::Console& console) {
  const FarmFolder folder = o.farm.open();
  const auto [path, job] = what_to_send(o, folder);
  MachineTimes times;
  times.cancel = context.cancel;
  MachineRoom room(folder, machine_named(folder, o.machine), times);
  for (const std::string& each : room.check(path).unchecked) console.say("not compared: " + each);
  const std::string name = room.send(path, job, [&](std::int64_t done, std::int64_t all) {
    context.report("sending", static_cast<double>(done) / static_cast<double>(all));
  });
  console.clear();
  cli::print_result(name + "\n");
  console.say(o.machine + " lists it; nothing was started");
  return cli::kDone;
}

using Act = void (*)(MachineRoom&, const MachineCommand&);

int act(const MachineCommand& o, Act what, const char* said, cli::Console& console) {
  const FarmFolder folder = o.farm.open();
  MachineRoom room(folder, machine_named(folder, o.machine));
  what(room, o);
  console.say(o.machine + ": " + said);
  return cli::kDone;
}

void add_adding(cli::Program& program, CLI::App* group) {
  const auto o = std::make_shared<AddCommand>();
  CLI::App* app =
      program.add_to(group, "add", "Add a machine to machines.toml",
                     [o](const ExecutionContext&, cli::Console& c) { return add(*o, c); });
  o->farm.add_to(*app);
  const auto text = [&](const char* name, std::string& value, const char* what) {
    return app->add_option(name, value, what)->check(cli::value_is(cli::ValueKind::text));
  };
  MachineSpec& m = o->machine;
  text("NAME", m.name, "Its name here: small letters, digits, - and _")->required();
  std::vector<std::string> kinds;
  kinds.reserve(kMachineKinds);
  for (int i = 0; i < kMachineKinds; ++i) kinds.emplace_back(name_of(static_cast<MachineKind>(i)));
  std::erase(kinds, "bridge");
  app->add_option("--kind", o->kind, "What it speaks")->required()->check(CLI::IsMember(kinds));
  text("--address", o->address, "HOST or HOST:PORT")->required();
  app->add_option("--printer", m.printer, "Printer whose jobs may be sent to it [any]")
      ->check(cli::value_is(cli::ValueKind::printer));
  text("--format", m.format, "Ending of the files that it reads, as ctb [as it says]");
  app->add_option("--resolution-px", o->resolution_px, "Its display, as WIDTH,HEIGHT [as it says]")
      ->delimiter(',')
      ->expected(2)
      ->check(CLI::Range(1, 100'000));
  text("--id", m.id, "MainboardID of SDCP [asked for]");
  app->add_option("--login", m.login, "How it wants its key [of its kind]")
      ->check(CLI::IsMember({"digest", "key", "none"}));
  text("--user", m.user, "User of a login with a password [maker]");
  app->add_option("--key-file", m.key_file, "File (mode 0600) with its key or password")
      ->check(cli::value_is(cli::ValueKind::file));
  text("--profile", m.profile, "Number of NanoDLP's resin profile [its only one]");
  app->add_flag("--send-when-done", m.send_when_done,
                "slicefarm serve sends jobs for it when they are done; it starts none");
  text("--page", m.page, "Address of a page of its own, for a link");
  text("--own-address", m.own_address,
       "SDCP 1: address of this computer at which the machine finds what it is sent");
  app->add_option("--discovery-port", m.discovery_port, "UDP port of SDCP's calls [3000]")
      ->check(CLI::Range(1, 65535));
}

}  // namespace

void add_machine_commands(cli::Program& program) {
  CLI::App* group =
      program.add_group("machines", "Printers on the network: send, start, watch, stop");
  const auto command = [&](const char* name, const char* what, auto action) {
    const auto o = std::make_shared<MachineCommand>();
    CLI::App* app = program.add_to(
        group, name, what, [o, action](const ExecutionContext& context, cli::Console& console) {
          return action(*o, context, console);
        });
    return std::pair(o, app);
  };
  using C = MachineCommand;
  using X = ExecutionContext;
  {
    const auto [o, app] =
        command("discover", "Look for printers on this network: SDCP, PrusaLink, OctoPrint",
                [](const C& c, const X&, cli::Console& s) { return discover(c, s); });
    app->add_option("HOST", o->names, "Ask these alone, as HOST or HOST:PORT [everybody]")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--own-address", o->what,
                    "Only in the network where this computer has this address [all]")
        ->check(cli::value_is(cli::ValueKind::text));
    app->add_option("--wait-s", o->wait_s, "How long to listen [3]")
        ->check(cli::number_in(0.1, 60));
    app->add_option("--json", o->json, "Write JSON to this file; - for stdout");
  }
  add_adding(program, group);
  const auto names = [](C& c, CLI::App& app) {
    c.farm.add_to(app);
    app.add_option("MACHINE", c.names, "Only these [all]")
        ->check(cli::value_is(cli::ValueKind::text));
  };
  {
    const auto [o, app] = command("list", "Ask all machines what they do",
                                  [](const C& c, const X&, cli::Console& s) { return list(c, s); });
    names(*o, *app);
    app->add_option("--json", o->json, "Write JSON to this file; - for stdout");
  }
  {
    const auto [o, app] = command("watch", "A line for each change, until stopped",
                                  [](const C& c, const X&, cli::Console&) { return watch(c); });
    names(*o, *app);
    app->add_option("--interval-s", o->interval_s, "Between two looks [5]")
        ->check(cli::number_in(0.2, 3600));
    app->add_flag("--once", o->once, "Look once");
  }
  const auto one = [](C& c, CLI::App& app) {
    c.farm.add_to(app);
    return app.add_option("MACHINE", c.machine, "Its name in machines.toml")
        ->required()
        ->check(cli::value_is(cli::ValueKind::text));
  };
  {
    const auto [o, app] =
        command("test", "Ask a machine what it is, and whether a file may be sent",
                [](const C& c, const X&, cli::Console&) { return test(c); });
    one(*o, *app);
    app->add_option("FILE", o->what, "A file that is compared with it")
        ->check(cli::value_is(cli::ValueKind::file));
  }
  {
    const auto [o, app] =
        command("send", "Upload a job's stack, or a file; starts nothing",
                [](const C& c, const X& x, cli::Console& s) { return send(c, x, s); });
    app->add_option("JOB", o->what, "Number of a job that is done, or a file")
        ->required()
        ->check(cli::value_is(cli::ValueKind::file));
    one(*o, *app);
  }
  const auto acting = [&](const char* name, const char* what, Act how, const char* said) {
    const auto [o, app] = command(name, what, [how, said](const C& c, const X&, cli::Console& s) {
      return act(c, how, said, s);
    });
    one(*o, *app);
    return std::pair(o, app);
  };
  {
    const auto [o, app] = acting(
        "start", "Print the file that was sent last",
        [](MachineRoom& room, const C& c) {
          if (!c.words.plate_is_empty || !c.words.vat_is_filled) {
            throw InputError(
                "nothing was started: expected --plate-is-empty and --vat-is-filled from somebody "
                "who has looked at the machine");
          }
          room.start(c.words);
        },
        "prints");
    app->add_flag("--plate-is-empty", o->words.plate_is_empty,
                  "Somebody looked: the plate is empty");
    app->add_flag("--vat-is-filled", o->words.vat_is_filled,
                  "Somebody looked: resin is in the vat");
  }
  acting(
      "pause", "Pause the print", [](MachineRoom& room, const C&) { room.pause(); },
      "pauses after its layer");
  acting(
      "resume", "Go on with a paused print", [](MachineRoom& room, const C&) { room.resume(); },
      "goes on");
  acting(
      "stop", "End the print", [](MachineRoom& room, const C&) { room.stop(); }, "stops");
  acting(
      "cleared", "Say that somebody looked and the plate is empty",
      [](MachineRoom& room, const C&) { room.cleared(); }, "may print again");
}

}  // namespace slicecorr::farm
