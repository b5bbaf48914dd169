// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `printbridge status`, `watch`, `report`, `lamp-log`, `serve` and `metrics`.

#include "view_commands.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <memory>

#include "programs/common/run_server.hpp"
#include "programs/common/watch.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/bridge/serve.hpp"
#include "slicecorr/bridge/view.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "support/http/guard.hpp"
#include "support/terminal/terminal.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::bridge {
namespace {

/// Niceness of commands that only look: everything that prints goes first.
constexpr int kNiceLevel = 10;

struct Looker {
  explicit Looker(const PrinterOptions& o) {
    const Printer p = load_printer(o.printer);
    printer = p.name;
    folder = StateFolder::of(o.dir, p);
  }
  /// A print that ends while it is asked does not run.
  std::string status() const {
    std::optional<std::string> running;
    try {
      running = ask_running(folder, "status");
    } catch (const DeviceError&) {
      if (PrintLock::held(folder)) running = "{}";
    }
    return status_text(folder, printer, running);
  }
  Seen seen() const { return seen_in(status()); }

  std::string printer;
  StateFolder folder;
};

struct StatusOptions {
  PrinterOptions printer;
  std::string json;
};

int status(const StatusOptions& o) {
  const Looker looker(o.printer);
  const std::string json = looker.status();
  if (!o.json.empty()) {
    cli::print_or_write(o.json, json);
    return cli::kDone;
  }
  const Seen seen = seen_in(json);
  const double um_per_deg = seen.facts.um_per_deg;
  std::string out = fmt::format("printer   {}\n", looker.printer);
  if (const auto& left = seen.state.left; left && !left->confirmed()) {
    out += text::printable(in_words(*left)) + "\n";
  }
  if (seen.running && seen.known) {
    out += fmt::format("phase     {}{}\n", name_of(seen.state.phase),
                       seen.facts.dry_run ? ", without light" : "");
    out += fmt::format(
        "shown     {}, {}\n", shown_in_words(seen.facts, seen.state),
        seen.facts.turns()
            ? fmt::format("{}, {:.2f}°, {:.2f} °/s", turn_in_words(seen.facts, seen.state),
                          angle_in_turn_deg(seen.facts, seen.state),
                          seen.state.speed_um_s / um_per_deg)
            : place_in_words(seen.state.stage_um - seen.facts.start_um, 0));
    out += fmt::format("late      {} frames, at most {}\n", seen.state.late_frames,
                       way_in_words(latest_um(seen.state), um_per_deg));
    if (seen.left_s) out += fmt::format("left      {}\n", text::duration(*seen.left_s));
  } else {
    out += seen.running ? "phase     starting\n" : "phase     no print\n";
    if (seen.known) {
      Seen last = seen;
      last.state.left.reset();
      out += fmt::format("last      {}\n", live_line(last));
    }
  }
  if (const auto latch = read_latch(looker.folder, false)) {
    out += fmt::format("latched   {}: {} ({}); see the machine, then `printbridge reset`\n",
                       name_of(latch->fault), text::printable(latch->detail),
                       latch->frame < 0 ? std::string("before the first frame")
                                        : fmt::format("frame {}, {}", latch->frame,
                                                      place_in_words(latch->z_um, um_per_deg)));
  }
  cli::print_result(out);
  return cli::kDone;
}

struct WatchOptions : cli::WatchOptions {
  PrinterOptions printer;
};

/// New lines of the journal, also of the next print's.
class JournalTail {
 public:
  explicit JournalTail(std::string path) : path_(std::move(path)) {
    struct stat s {};
    if (::stat(path_.c_str(), &s) == 0) {
      inode_ = s.st_ino;
      at_ = s.st_size;
    }
  }
  /// Whole lines only; the rest comes with the next look.
  std::vector<std::string> next() {
    struct stat s {};
    if (::stat(path_.c_str(), &s) != 0) return {};
    if (s.st_ino != inode_ || s.st_size < at_) {
      inode_ = s.st_ino;
      at_ = 0;
    }
    std::vector<std::string> lines;
    std::ifstream in(path_);
    in.seekg(at_);
    for (std::string line; std::getline(in, line) && !in.eof();) {
      at_ += static_cast<off_t>(line.size()) + 1;
      if (auto text = event_line(line); !text.empty()) lines.push_back(std::move(text));
    }
    return lines;
  }

 private:
  std::string path_;
  ino_t inode_ = 0;
  off_t at_ = 0;
};

/// Each event as a line, and how far the print is every ten seconds and when its phase changes.
int watch_lines(const WatchOptions& o, const Looker& looker) {
  constexpr int every = 10;
  JournalTail journal(looker.folder.file("journal.jsonl"));
  std::string kind;
  double told_s = -every, now_s = 0;
  while (!cli::interrupted()) {
    const Seen seen = looker.seen();
    for (const std::string& line : journal.next()) cli::print_result(line + "\n");
    const std::string now =
        fmt::format("{} {} {}", seen.running, name_of(seen.state.phase), seen.known);
    if (now != kind || (seen.running && now_s - told_s >= every)) {
      cli::print_result(live_line(seen) + "\n");
      kind = now;
      told_s = now_s;
    }
    if (o.until_end && !seen.running) return cli::kDone;
    ::poll(nullptr, 0, static_cast<int>(o.interval_s * 1000));
    now_s += o.interval_s;
  }
  return cli::kInterrupted;
}

int watch(const WatchOptions& o) {
  const Looker looker(o.printer);
  const auto frame = [&](int columns, int rows, bool colour) {
    const Seen seen = looker.seen();
    return cli::WatchFrame{live_frame(seen, columns, rows, colour), !seen.running};
  };
  if (o.once) return cli::print_frame(o, frame);
  return cli::FrameTerminal::possible() ? cli::watch_terminal(o, frame) : watch_lines(o, looker);
}

struct OutputOptions {
  PrinterOptions printer;
  std::string output;
};

int report(const OutputOptions& o) {
  const Looker looker(o.printer);
  const std::string page = report_page(read_record(looker.folder, PrintLock::held(looker.folder)));
  if (o.output.empty()) {
    write_whole(looker.folder.file("report.html"), page);
    cli::print_result(looker.folder.file("report.html") + "\n");
  } else {
    cli::print_or_write(o.output, page);
  }
  return cli::kDone;
}

int lamp_log_command(const OutputOptions& o, cli::Console& console) {
  const Looker looker(o.printer);
  const LampLog log = lamp_log(read_record(looker.folder, PrintLock::held(looker.folder)));
  if (log.greatest > 1 + 1e-3) {
    console.say(fmt::format(
        "a lamp gave up to {:.1f} % of what its calibration says; the table has 100 % there: measure the "
        "printer's light anew",
        100 * log.greatest));
  }
  std::string text = log.csv;
  if (!o.output.empty() && o.output != "-") {
    cli::write_text_file(o.output, text);
    console.say(
        fmt::format("{}: {} rows, each of {} frames", o.output, log.rows, log.frames_a_row));
  } else {
    cli::print_result(text);
  }
  return cli::kDone;
}

int metrics(const OutputOptions& o) {
  const Looker looker(o.printer);
  const std::string text = metrics_text(looker.seen(), count_faults(looker.folder));
  if (o.output.empty() || o.output == "-") {
    cli::print_result(text);
  } else {
    cli::write_text_file(o.output, text);
  }
  return cli::kDone;
}

struct ServeCommand {
  PrinterOptions printer;
  std::string listen = "127.0.0.1:8421", token_file;
  std::vector<std::string> host_names;
};

int serve(const ServeCommand& o, cli::Console& console) {
  const Looker looker(o.printer);
  ServeOptions options;
  std::tie(options.host, options.port) = http::host_and_port(o.listen);
  if (!o.token_file.empty()) options.token = http::read_token_file(o.token_file);
  for (const std::string& name : o.host_names) options.host_names += name + ",";
  options.status = [&looker] { return looker.status(); };
  PrintServer server(looker.folder, options);
  http::take_sigterm();
  cli::print_result(server.address() + "\n");
  console.say("serving; nothing can be changed");
  return http::serve_until_ended([&] { server.run(); }, [&] { server.stop(); });
}

/// What only looks is never in the way of what prints.
cli::Program::Action politely(const std::function<int(cli::Console&)>& action) {
  return [action](const ExecutionContext&, cli::Console& console) {
    [[maybe_unused]] const int level = ::nice(kNiceLevel);
    return action(console);
  };
}

}  // namespace

void add_view_commands(const AddCommand& add) {
  {
    auto o = std::make_shared<StatusOptions>();
    auto* const s = add("status", "What the print does, or how the last one ended", o->printer,
                        [o](const ExecutionContext&, cli::Console&) { return status(*o); });
    s->add_option("--json", o->json, "Write JSON to this file, - for stdout");
  }
  {
    auto o = std::make_shared<WatchOptions>();
    auto* const w = add("watch", "Follow the print on the terminal; q quits", o->printer,
                        politely([o](cli::Console&) { return watch(*o); }));
    o->add_to(*w, "--until-end", "End when no print runs");
  }
  {
    auto o = std::make_shared<OutputOptions>();
    auto* const r = add("report", "Write the page of the last print, or the one that runs",
                        o->printer, politely([o](cli::Console&) { return report(*o); }));
    r->add_option("-o,--output", o->output, "The page; - for stdout [report.html of the state]");
  }
  {
    auto o = std::make_shared<OutputOptions>();
    auto* const l =
        add("lamp-log",
            "Write what the lamps gave of what was asked of them in the last print, as the table "
            "that slicecorr correct --lamp-log reads",
            o->printer, politely([o](cli::Console& c) { return lamp_log_command(*o, c); }));
    l->add_option("-o,--output", o->output, "The table (.csv); - for stdout [stdout]");
  }
  {
    auto o = std::make_shared<ServeCommand>();
    auto* const s = add("serve", "Serve a live page, state and metrics; prints its address",
                        o->printer, politely([o](cli::Console& c) { return serve(*o, c); }));
    s->add_option("--listen", o->listen, "HOST:PORT; port 0: one that is free [127.0.0.1:8421]")
        ->check(cli::value_is(cli::ValueKind::text));
    s->add_option("--token-file", o->token_file,
                  "File (mode 0600) with the token that requests beyond this machine need");
    s->add_option("--host-name", o->host_names,
                  "Further name under which browsers reach this server, as NAME")
        ->check(cli::value_is(cli::ValueKind::text));
  }
  {
    auto o = std::make_shared<OutputOptions>();
    auto* const m = add("metrics", "Write metrics for Prometheus, once", o->printer,
                        politely([o](cli::Console&) { return metrics(*o); }));
    m->add_option("-o,--output", o->output,
                  "File, which appears whole: for the textfile collector [stdout]");
  }
}

}  // namespace slicecorr::bridge
