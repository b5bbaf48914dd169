// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a person sees of real prints, by way of the programs: page, watch, serve, metrics.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <httplib.h>

#include <cmath>
#include <filesystem>
#include <numeric>
#include <regex>

#include "bridge_fixture.hpp"
#include "devtools.hpp"
#include "exposition_reader.hpp"
#include "rounds.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/bridge/view.hpp"
#include "terminal_screen.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
namespace test = slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using End = PrintRecord::End;

const std::string kOfPrinter = "{printer=\"dual-wavelength-dlp\"}";
std::string of_printer_and(const std::string& label, const std::string& value) {
  return "{printer=\"dual-wavelength-dlp\"," + label + "=\"" + value + "\"}";
}

template <typename Counts>
std::uint64_t sum_of(const Counts& counts) {
  return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
}

class BridgeView : public BridgePrograms {
 protected:
  StateFolder state_folder() const { return {folder.path() + "/state/dual-wavelength-dlp"}; }
  std::string page() const { return text_of(state_folder().file("report.html")); }
  PrintRecord record() const { return read_record(state_folder(), false); }
  void reset(const std::string& printer) {
    Sim mended = start_sim(printer, true);
    EXPECT_EQ(bridge({"reset"}, printer, {"--modbus", address_of(mended.modbus)}).exit_code, 0);
  }
  /// A print in real time, from when it shows frames. At 150 mm/h it takes a minute: those that are
  /// looked at have not ended meanwhile, however busy the machine is.
  struct Running {
    std::string printer;
    Sim sim;
    std::unique_ptr<Child> print;
  };
  Running start_print(int speed_mm_h = 150) {
    Running r;
    r.printer = make_printer("patient", patient());
    const std::string stack = make_stack(
        r.printer, "part", {"--resin", "figure-2-2", "--speed-mm-h", std::to_string(speed_mm_h)});
    r.sim = start_sim(r.printer, false);
    r.print = std::make_unique<Child>(print_command(stack, r.printer, r.sim, false),
                                      folder / "print.err");
    EXPECT_TRUE(wait_until([&] { return happened(r.sim.events, "frame 1"); }))
        << text_of(folder / "print.err");
    return r;
  }
};

TEST_F(BridgeView, APrintLeavesItsPage) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  EXPECT_THAT(bridge({"report"}, printer, {"-o", "-"}).out, HasSubstr("No print is recorded"));
  Sim sim = start_sim(printer, true);
  const RunResult r = run_program(print_command(stack, printer, sim, true));
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("report.html"));
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("part.uvj: done"));
  EXPECT_THAT(html, HasSubstr("How late frames were"));
  // What was counted while it printed is what its rows say, and what status tells.
  const PrintRecord rec = record();
  ASSERT_TRUE(rec.last);
  EXPECT_EQ(rec.lateness.um, rec.last->lateness.um);
  EXPECT_EQ(rec.lateness.ms, rec.last->lateness.ms);
  EXPECT_EQ(rec.frames.size(), static_cast<std::size_t>(rec.facts.frames));
  EXPECT_EQ(sum_of(rec.lateness.um), rec.frames.size());
  const json s = status(printer);
  EXPECT_EQ(s["lateness_um"]["counts"], json(rec.lateness.um));
  EXPECT_EQ(s["frames_shown"], rec.facts.frames);
  EXPECT_TRUE(s.contains("seconds"));
  for (const FrameRow& f : rec.frames) {
    EXPECT_TRUE(std::isfinite(f.stage_error_um) && std::isfinite(f.temperature_c));
    EXPECT_FALSE(f.late);
  }
  // The page at any time is the page that the print wrote.
  EXPECT_EQ(bridge({"report"}, printer, {"-o", "-"}).out, html + "\n");
  // The next print keeps it.
  Sim next = start_sim(printer, true);
  ASSERT_EQ(run_program(print_command(stack, printer, next, true, {"--dry-run"})).exit_code, 0);
  EXPECT_EQ(text_of(state_folder().file("report.previous.html")), html);
  EXPECT_THAT(page(), HasSubstr("dry run"));
  EXPECT_EQ(read_record(state_folder(), false, true).frames.size(), rec.frames.size());
}

TEST_F(BridgeView, PagesOfLateFramesAndOfFaults) {
  part_cell_mm = 1;
  const std::string printer =
      make_printer("late", {{"max_late_frames = 0", "max_late_frames = 3"}});
  const std::string stack = make_stack(printer);
  {
    Sim sim = start_sim(printer, true, {"--fault", "late-frame=0.1@frame:11"});
    const RunResult r = run_program(print_command(stack, printer, sim, true));
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const PrintRecord rec = record();
    EXPECT_EQ(status(printer)["late_frames"], 1);
    const auto late = std::count_if(rec.frames.begin(), rec.frames.end(),
                                    [](const FrameRow& f) { return f.late; });
    EXPECT_EQ(late, 1);
    ASSERT_GT(rec.frames.size(), 11U);
    EXPECT_TRUE(rec.frames[11].late);
    EXPECT_GT(rec.frames[11].late_um, 5);
    EXPECT_EQ(rec.lateness.um, rec.last->lateness.um);
    const auto told = std::find_if(rec.events.begin(), rec.events.end(),
                                   [](const RecordedEvent& e) { return e.what == "late frame"; });
    ASSERT_NE(told, rec.events.end());
    EXPECT_EQ(told->frame, 11) << "the late one, not the one before it";
    EXPECT_THAT(page(), HasSubstr("Late frames, the worst first"));
    EXPECT_THAT(page(), HasSubstr("<title>frame 11: "));
    EXPECT_THAT(page(), HasSubstr("<td class=\"words\">late frame</td>"));
  }
  const std::vector<std::pair<std::string, std::string>> faults{
      {"door@frame:9", "door_open"},
      {"lamp-drifts=0.3@frame:7", "lamp_mismatch"},
      {"freeze-display@frame:8", "wrong_frame"}};
  for (const auto& [fault, name] : faults) {
    SCOPED_TRACE(fault);
    Sim sim = start_sim(printer, true, {"--fault", fault});
    EXPECT_EQ(run_program(print_command(stack, printer, sim, true)).exit_code, 4);
    const PrintRecord rec = record();
    EXPECT_EQ(rec.end, End::failed);
    EXPECT_EQ(name_of(rec.fault), name);
    EXPECT_TRUE(rec.remarks.empty()) << testing::PrintToString(rec.remarks);
    const std::string html = page();
    EXPECT_THAT(html, HasSubstr("part.uvj: failed"));
    EXPECT_THAT(html, HasSubstr(std::string(what_to_do(rec.fault))));
    // The order, as it was.
    std::size_t at = 0;
    for (const std::string& what :
         {"fault " + name, std::string("phase lamps_off"), std::string("phase stopping"),
          std::string("phase blacking"), std::string("phase failed"), std::string("latched")}) {
      const std::size_t next = html.find("<td class=\"words\">" + what + "</td>", at);
      EXPECT_NE(next, html.npos) << what;
      at = next == html.npos ? at : next;
    }
    const auto m = check_metrics(bridge({"metrics"}, printer).out);
    EXPECT_EQ(m.at("printbridge_faults_total" + of_printer_and("reason", name)), 1);
    EXPECT_EQ(m.at("printbridge_latched" + kOfPrinter), 1);
    reset(printer);
  }
}

TEST_F(BridgeView, LayerByLayerAndUnderUvLight) {
  part_cell_mm = 0.6;
  part_cells = 1;
  const std::string printer = make_printer("plain", quick());
  const std::string layers = make_stack(
      printer, "part",
      {"--resin", "figure-2-2", "--mode", "layerwise", "--exposure-s", "0.3", "--ha-um", "110"});
  {
    Sim sim = start_sim(printer, true);
    ASSERT_EQ(run_program(print_command(layers, printer, sim, true)).exit_code, 0);
    const PrintRecord rec = record();
    EXPECT_TRUE(rec.facts.layerwise);
    EXPECT_EQ(rec.frames.size(), static_cast<std::size_t>(rec.facts.frames));
    for (const FrameRow& f : rec.frames) {
      // The simulator shows images at the moment that it is told: only rounding is left.
      EXPECT_NEAR(f.exposed_s, f.exposure_s, 1e-5) << f.frame;
      EXPECT_FALSE(f.late);
    }
    EXPECT_EQ(rec.lateness.ms, rec.last->lateness.ms);
    EXPECT_EQ(sum_of(rec.lateness.ms), rec.frames.size());
    EXPECT_EQ(sum_of(rec.lateness.um), 0U);
    EXPECT_THAT(page(), HasSubstr("layer by layer"));
    EXPECT_THAT(page(), HasSubstr("Exposures"));
    EXPECT_THAT(page(), Not(HasSubstr("mm/h")));
    check_metrics(bridge({"metrics"}, printer).out);
  }
  {
    // A fault in the middle of an exposure: the layer's row is there, without an end.
    Sim sim = start_sim(printer, true, {"--fault", "door@frame:4"});
    EXPECT_EQ(run_program(print_command(layers, printer, sim, true)).exit_code, 4);
    const PrintRecord rec = record();
    ASSERT_EQ(rec.frames.size(), 5U);
    EXPECT_TRUE(std::isfinite(rec.frames[3].exposed_s));
    EXPECT_FALSE(std::isfinite(rec.frames[4].exposed_s));
    EXPECT_EQ(rec.frames[4].exposure_s, 0.3);
    reset(printer);
  }
  const std::string stack = make_stack(
      printer, "uv", {"--resin", "custom-resin-1", "--speed-mm-h", "300", "--uv-mw-cm2", "200"});
  Sim sim = start_sim(printer, true);
  ASSERT_EQ(run_program(print_command(stack, printer, sim, true)).exit_code, 0);
  EXPECT_TRUE(record().facts.uv);
  EXPECT_THAT(page(), HasSubstr("UV, mW/cm²"));
  const auto m = check_metrics(bridge({"metrics"}, printer).out);
  EXPECT_TRUE(m.contains("printbridge_uv_mw_cm2" + of_printer_and("of", "asked")));
}

TEST_F(BridgeView, APrintThatWasKilledHasAPageToo) {
  Running r = start_print();
  EXPECT_THAT(bridge({"report"}, r.printer, {"-o", "-"}).out, HasSubstr("It prints"));
  EXPECT_EQ(r.print->end(SIGKILL), 128 + SIGKILL);
  const RunResult made = bridge({"report"}, r.printer);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_EQ(made.out, state_folder().file("report.html") + "\n");
  EXPECT_THAT(page(), HasSubstr("part.uvj: cut off"));
  EXPECT_THAT(page(), HasSubstr("was killed, or the power failed"));
  // Who never asks for it has it after the reset.
  const std::string made_before = page();
  std::filesystem::remove(state_folder().file("report.html"));
  EXPECT_EQ(bridge({"reset"}, r.printer, {"--modbus", address_of(r.sim.modbus)}).exit_code, 0);
  EXPECT_EQ(page(), made_before);
}

TEST_F(BridgeView, AFullDiskOrAWrongPlaceIsSaid) {
  const std::string printer = make_printer("plain");
  RunResult r = bridge({"report"}, printer, {"-o", folder / "nowhere/page.html"});
  EXPECT_EQ(r.exit_code, 4);
  EXPECT_THAT(r.err, HasSubstr("nowhere/page.html"));
  EXPECT_EQ(bridge({"report"}, printer, {"-o", "/dev/full"}).exit_code, 4);
  EXPECT_EQ(bridge({"metrics"}, printer, {"-o", folder / "nowhere/x.prom"}).exit_code, 4);
  EXPECT_EQ(bridge({"watch"}, printer, {"--interval-s", "0"}).exit_code, 2);
  EXPECT_EQ(bridge({"report"}, folder / "no-such-printer.toml").exit_code, 2);
  // A file of metrics appears whole, and nothing is left beside it.
  const std::string prom = folder / "printbridge.prom";
  ASSERT_EQ(bridge({"metrics"}, printer, {"-o", prom}).exit_code, 0);
  check_metrics(text_of(prom));
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    EXPECT_NE(entry.path().extension(), ".part");
  }
}

TEST_F(BridgeView, WatchOnATerminal) {
  Running r = start_print();
  Terminal terminal({program("printbridge"), "watch", "--printer", r.printer, "--dir",
                     folder / "state", "--interval-s", "0.05"},
                    100, 36);
  const auto shows = [&](const char* text) {
    return terminal.screen().find(text) != std::string::npos;
  };
  ASSERT_TRUE(terminal.until([&] { return shows("printing for") && shows("q quit"); }))
      << terminal.raw;
  EXPECT_TRUE(terminal.second_screen);
  EXPECT_FALSE(terminal.cursor);
  for (const char* what : {"part.uvj", "mm/h, planned", "asked", "frames ready", "up to "}) {
    EXPECT_THAT(terminal.screen(), HasSubstr(what));
  }
  // It goes on by itself.
  const auto frame_shown = [&] {
    std::smatch m;
    const std::string screen = terminal.screen();
    return std::regex_search(screen, m, std::regex("shown +([0-9]+) of")) ? std::stoi(m[1]) : -1;
  };
  const int before = frame_shown();
  ASSERT_TRUE(terminal.until([&] { return frame_shown() > before + 1; })) << terminal.screen();
  EXPECT_EQ(bridge({"stop"}, r.printer).exit_code, 0);
  EXPECT_EQ(r.print->wait(), 130);
  ASSERT_TRUE(terminal.until([&] {
    return shows("no print runs") && shows("stopped_by_user") && shows("printbridge reset");
  })) << terminal.screen();
  terminal.type("q");
  EXPECT_EQ(terminal.end(), 0);
  EXPECT_FALSE(terminal.second_screen);
  EXPECT_TRUE(terminal.cursor);
}

TEST_F(BridgeView, WatchThroughAPipe) {
  const std::string plain = make_printer("plain");
  // Nothing was printed.
  const RunResult none = bridge({"watch", "--until-end"}, plain);
  ASSERT_EQ(none.exit_code, 0) << none.err;
  EXPECT_EQ(none.out, "no print runs\n");
  EXPECT_THAT(bridge({"watch", "--once"}, plain).out, HasSubstr("no print runs"));
  Running r = start_print();
  test::RunOptions options;
  bool stopped = false;
  options.signal = SIGCONT;
  options.signal_when = [&](const std::string& out, const std::string&) {
    if (!stopped && out.find("frames shown") != std::string::npos) {
      stopped = true;
      EXPECT_EQ(bridge({"stop"}, r.printer).exit_code, 0);
    }
    return false;
  };
  const RunResult w = run_program({program("printbridge"), "watch", "--printer", r.printer, "--dir",
                                   folder / "state", "--interval-s", "0.05", "--until-end"},
                                  options);
  ASSERT_EQ(w.exit_code, 0) << w.err;
  EXPECT_EQ(r.print->wait(), 130);
  EXPECT_EQ(w.out.find('\033'), w.out.npos);
  EXPECT_THAT(w.out, HasSubstr("fault stopped_by_user"));
  EXPECT_THAT(w.out, HasSubstr("no print runs"));
  const RunResult last = bridge({"status"}, r.printer);
  EXPECT_THAT(last.out, HasSubstr("phase     no print"));
  EXPECT_THAT(last.out, HasSubstr("the last, part.uvj, ended with stopped_by_user"));
  EXPECT_THAT(last.out, HasSubstr("latched   stopped_by_user"));
}

TEST_F(BridgeView, AskingDoesNotHoldUpThePrint) {
  part_cell_mm = 1;
  Running r = start_print(800);
  // As fast as it answers. The socket's thread counts its answers, the control thread how often it
  // has told something: that goes by its clock, whoever asks.
  const int questions = (test::by_night() ? 1000 : 300) / test::kSlowdown;
  std::int64_t first = -1, told = 0;
  double at_s = 0;
  for (int i = 0; i < questions; ++i) {
    const auto answer = ask_running(state_folder(), "status");
    ASSERT_TRUE(answer) << i;
    const json j = json::parse(*answer, nullptr, false);
    ASSERT_TRUE(j.is_object() && j.contains("asked")) << *answer;
    if (first < 0) first = j["asked"];
    ASSERT_EQ(j["asked"], first + i) << "answered by the thread of the socket alone";
    told = j["told"];
    at_s = j["at_s"];
  }
  // Four times a second and once at the beginning, by the print's own clock.
  EXPECT_LE(told, std::floor(at_s / 0.25) + 1);
  EXPECT_LT(told, questions / 2);
  EXPECT_EQ(r.print->wait(), 0) << text_of(folder / "print.err");
  const json s = status(r.printer);
  EXPECT_EQ(s["late_frames"], 0);
  EXPECT_EQ(s["frames_shown"], s["frames"]);
}

int status_of(const httplib::Result& result) { return result ? result->status : -1; }

TEST_F(BridgeView, ServesWhileItPrints) {
  Running r = start_print();
  Child served({program("printbridge"), "serve", "--printer", r.printer, "--dir", folder / "state",
                "--listen", "127.0.0.1:0"});
  const std::string address = served.line();
  httplib::Client client(address);
  const auto metrics = client.Get("/metrics");
  ASSERT_EQ(status_of(metrics), 200);
  EXPECT_THAT(metrics->get_header_value("Content-Type"), HasSubstr("version=0.0.4"));
  auto m = check_metrics(metrics->body);
  EXPECT_EQ(m.at("printbridge_up" + kOfPrinter), 1);
  EXPECT_GE(m.at("printbridge_frames_shown_total" + kOfPrinter), 1);
  EXPECT_EQ(m.at("printbridge_frame_lateness_um_count" + kOfPrinter),
            m.at("printbridge_frames_shown_total" + kOfPrinter));
  EXPECT_TRUE(promtool_agrees(metrics->body));
  const auto now = client.Get("/status.json");
  ASSERT_EQ(status_of(now), 200);
  const json j = json::parse(now->body);
  EXPECT_EQ(j["running"], true);
  EXPECT_EQ(j["phase"], "printing");
  // The page and its parts: nothing from elsewhere, nothing that others could put in.
  for (const char* path : {"/", "/live.js", "/live.css", "/record", "/report", "/healthz"}) {
    const auto answer = client.Get(path);
    ASSERT_EQ(status_of(answer), 200) << path;
    EXPECT_FALSE(answer->body.empty()) << path;
    EXPECT_THAT(answer->get_header_value("Content-Security-Policy"),
                HasSubstr("default-src 'none'"));
    EXPECT_EQ(answer->get_header_value("X-Content-Type-Options"), "nosniff");
  }
  EXPECT_THAT(client.Get("/report")->body, HasSubstr("It prints"));
  // Only looking, only from here.
  EXPECT_EQ(status_of(client.Post("/status.json", "{}", "application/json")), 405);
  EXPECT_EQ(status_of(client.Delete("/")), 405);
  EXPECT_EQ(status_of(client.Get("/nothing")), 404);
  EXPECT_EQ(status_of(client.Get("/../frames.csv")), 404);
  EXPECT_EQ(status_of(client.Get("/metrics", {{"Host", "evil.example"}})), 403);
  EXPECT_EQ(status_of(client.Get("/metrics", {{"Origin", "http://evil.example"}})), 403);
  EXPECT_EQ(bridge({"serve"}, r.printer, {"--listen", "0.0.0.0:0"}).exit_code, 2)
      << "beyond this machine only with a token";
  EXPECT_EQ(bridge({"serve"}, r.printer, {"--listen", "nowhere"}).exit_code, 2);
  const std::string port = address.substr(address.rfind(':') + 1);
  EXPECT_EQ(bridge({"serve"}, r.printer, {"--listen", "127.0.0.1:" + port}).exit_code, 4)
      << "somebody is there";
  // The print ends; the server goes on and says so.
  EXPECT_EQ(bridge({"stop"}, r.printer).exit_code, 0);
  EXPECT_EQ(r.print->wait(), 130);
  ASSERT_TRUE(wait_until([&] {
    m = check_metrics(client.Get("/metrics")->body);
    return m.at("printbridge_up" + kOfPrinter) == 0;
  }));
  EXPECT_EQ(m.at("printbridge_latched" + kOfPrinter), 1);
  EXPECT_EQ(m.at("printbridge_faults_total" + of_printer_and("reason", "stopped_by_user")), 1);
  EXPECT_EQ(served.end(SIGTERM), 0);
}

TEST_F(BridgeView, BeyondTheMachineReadingNeedsTheToken) {
  const std::string printer = make_printer("plain");
  const std::string file = folder / "token", token = "0123456789abcdef0123456789abcdef";
  write_file(file, to_bytes(token + "\n"));
  std::filesystem::permissions(file, static_cast<std::filesystem::perms>(0600));
  Child served({program("printbridge"), "serve", "--printer", printer, "--dir", folder / "state",
                "--listen", "0.0.0.0:0", "--token-file", file});
  const std::string address = served.line();
  httplib::Client client("127.0.0.1", std::stoi(address.substr(address.rfind(':') + 1)));
  for (const char* path : {"/status.json", "/metrics", "/record", "/report", "/nothing"}) {
    EXPECT_EQ(status_of(client.Get(path)), 401) << path;
  }
  EXPECT_EQ(status_of(client.Get("/")), 200) << "the page without data";
  client.set_bearer_token_auth(token);
  EXPECT_EQ(status_of(client.Get("/metrics")), 200);
  EXPECT_EQ(served.end(SIGINT), 130);
}

TEST_F(BridgeView, TheLivePageInABrowser) {
  part_cell_mm = 1;
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed";
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true, {"--fault", "door@frame:9"});
  EXPECT_EQ(run_program(print_command(stack, printer, sim, true)).exit_code, 4);
  Child served({program("printbridge"), "serve", "--printer", printer, "--dir", folder / "state",
                "--listen", "127.0.0.1:0"});
  DrivenPage page;
  page.open(served.line() + "/");
  page.wait_for("document.body.innerHTML.includes('phase lamps_off')");
  const std::string dom = page.dom();
  for (const char* what : {"no print runs", "door_open: ", "latest frame", "How late frames were",
                           "phase lamps_off"}) {
    EXPECT_THAT(dom, HasSubstr(what));
  }
  EXPECT_THAT(page.complaints(), IsEmpty());
}

}  // namespace
}  // namespace slicecorr::bridge
