// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "slicecorr/bridge/view.hpp"
#include "slicecorr/error.hpp"
#include "support/chart/chart.hpp"
#include "support/page/html_page.hpp"
#include "support/text/display_text.hpp"
#include "view/charts.hpp"
#include "view/page_text.hpp"

namespace slicecorr::bridge {
namespace {

using namespace page;
using End = PrintRecord::End;

constexpr int kLongestText = 600;
/// Rows that a table of events may have before it is put into a box that scrolls.
constexpr std::size_t kLongestUntouched = 60;
constexpr std::size_t kMostEvents = 600, kFirstEvents = 200, kMostLate = 300;

/// What comes from files and machines, for the page.
std::string shown(std::string_view text) {
  // Cut before it is looked at: a damaged line may be a file long.
  const std::string cut(text.substr(0, std::size_t{4} * kLongestText));
  return text::clipped(text::printable(cut), kLongestText);
}

std::string figure(double value, const char* format_unit, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}{}", value, digits, format_unit)
                              : std::string("-");
}

/// Tenths, where two times are to be compared.
std::string seconds(double s) { return s < 600 ? fmt::format("{:.1f} s", s) : text::duration(s); }

const char* word_of(End end) {
  switch (end) {
    case End::none:
      return "no print";
    case End::running:
      return "prints now";
    case End::done:
      return "done";
    case End::failed:
      return "failed";
    case End::cut_off:
      return "cut off";
  }
  return "";
}

/// When a phase was entered first; NaN when it never was.
double entered_s(const PrintRecord& r, const std::string& phase) {
  for (const RecordedEvent& e : r.events) {
    if (e.what == "phase " + phase) return e.at_s;
  }
  return NAN;
}

double fault_at_s(const PrintRecord& r) {
  for (const RecordedEvent& e : r.events) {
    if (e.what.starts_with("fault ")) return e.at_s;
  }
  return NAN;
}

/// Of the slices: from the first light to the last slice's end, or as far as it came.
double printed_s(const PrintRecord& r) {
  const double from = entered_s(r, "printing");
  double until = entered_s(r, "blue_off");
  if (!std::isfinite(until)) until = entered_s(r, "lamps_off");
  if (!std::isfinite(until) && !r.events.empty()) until = r.events.back().at_s;
  if (!std::isfinite(until) && !r.frames.empty()) until = r.frames.back().shown_s;
  return until - from;
}

int late_frames(const PrintRecord& r) {
  if (r.last) return r.last->late_frames;
  return static_cast<int>(
      std::count_if(r.frames.begin(), r.frames.end(), [](const FrameRow& f) { return f.late; }));
}

/// A length of the stage's way, and what is to be said of it besides.
struct Length {
  std::string value, more;
};
Length length(const PrintFacts& f, double um) {
  if (!f.turns()) return {fmt::format("{:.2f} um", um), ""};
  return {fmt::format("{:.3f}°", um / f.um_per_deg), fmt::format(", {:.2f} um at the wall", um)};
}
std::string borne(const PrintFacts& f, double um) {
  return f.turns() ? fmt::format("{:.3g}°", um / f.um_per_deg) : fmt::format("{:g} um", um);
}

/// A place on the stage's way, from the first frame on; the title of its column.
std::string place(const PrintFacts& f, double um) {
  return f.turns() ? figure(um / f.um_per_deg, "", 2) : figure(um * 1e-3, "", 3);
}
const char* place_title(const PrintFacts& f) { return f.turns() ? "° on from the first" : "z, mm"; }

/// The latest frame of the chart beside; what the chart can't show, a frame that never came, and what
/// counts as late there because it is early, are said with it.
void put_latest(const PrintRecord& r, Tiles& tiles) {
  const Lateness& l = r.lateness;
  const Length late_by = length(r.facts, l.worst_um);
  std::string what = fmt::format("the latest frame{}; in time {:.2f} ms", late_by.more, l.worst_ms);
  double earliest_um = 0;
  for (const FrameRow& f : r.frames) earliest_um = std::fmin(earliest_um, f.late_um);
  if (r.facts.max_late_um > 0 && earliest_um < -r.facts.max_late_um) {
    what += "; the earliest came " + length(r.facts, -earliest_um).value + " too early";
  }
  if (r.last && latest_um(*r.last) > l.worst_um + Lateness::kBoundsUm[0]) {
    what +=
        "; one had not appeared " + length(r.facts, latest_um(*r.last)).value + " after its place";
  }
  tiles.add(late_by.value, what);
}

Markup tiles(const PrintRecord& r) {
  Tiles tiles;
  const bool bad = r.end == End::failed || r.end == End::cut_off;
  tiles.add(word_of(r.end),
            r.fault != Fault::none ? std::string(name_of(r.fault))
            : r.facts.dry_run      ? "dry run: without light"
                                   : "how it ended",
            r.end == End::done ? "good"
            : bad              ? "bad"
                               : "");
  const int count = r.last ? r.last->frames_shown : static_cast<int>(r.frames.size());
  tiles.add(text::count(count),
            r.facts.frames > 0
                ? fmt::format("of {} frames shown{}", text::count(r.facts.frames),
                              count > 0 ? fmt::format(", numbers 0 to {}", count - 1) : "")
                : "frames shown",
            r.facts.frames > 0 && count < r.facts.frames && bad ? "bad" : "");
  const int late = late_frames(r);
  tiles.add(text::count(late), "late", late > 0 ? "bad" : "");
  if (!r.frames.empty()) {
    const Lateness& l = r.lateness;
    if (r.facts.layerwise) {
      tiles.add(fmt::format("{:.2f} ms", l.worst_ms), "longest exposure too long by");
    } else {
      put_latest(r, tiles);
    }
  }
  double stage = r.last ? r.last->worst_stage_error_um : NAN;
  if (!r.last) {
    for (const FrameRow& f : r.frames) {
      if (std::isfinite(f.stage_error_um)) stage = std::fmax(stage, std::abs(f.stage_error_um));
    }
  }
  if (std::isfinite(stage)) {
    const Length off = length(r.facts, stage);
    tiles.add(off.value, r.facts.tolerance_um > 0
                             ? fmt::format("largest error of the stage{}; {} borne", off.more,
                                           borne(r.facts, r.facts.tolerance_um))
                             : "largest error of the stage" + off.more);
  }
  const double took = printed_s(r);
  const char* const printed = r.facts.turns() ? "turns with spin-up" : "slices";
  if (std::isfinite(took)) {
    tiles.add(seconds(took), r.facts.expected_s > 0 ? fmt::format("for the {}, planned {}", printed,
                                                                  seconds(r.facts.expected_s))
                                                    : fmt::format("for the {}", printed));
  }
  return tiles;
}

/// What a person must see before anything else.
Markup alarm(const PrintRecord& r) {
  if (!r.left) return {};
  const std::string words = shown(in_words(*r.left));
  return r.left->confirmed()
             ? markup(R"(<p class="holds">{}</p>)", words)
             : markup(R"(<p class="holds alarm" role="alert"><b>{}</b></p>)", words);
}

Markup what_happened(const PrintRecord& r) {
  if (r.end == End::running) {
    return markup(R"(<p class="holds">It prints; this page is of what was recorded so far.</p>)");
  }
  if (r.fault != Fault::none) {
    return markup(R"(<p class="holds"><b>{}</b>: {}, {}. To do: {}</p>)", name_of(r.fault),
                  shown(r.detail),
                  r.fault_frame < 0 ? std::string("with black on the display")
                  : !std::isfinite(r.fault_z_um)
                      ? fmt::format("at frame {}", r.fault_frame)
                      : fmt::format("at frame {}, {}", r.fault_frame,
                                    place_in_words(r.fault_z_um, r.facts.um_per_deg)),
                  what_to_do(r.fault));
  }
  if (r.end == End::cut_off) {
    const RecordedEvent& last = r.events.back();
    return markup(
        R"(<p class="holds">The program was killed, or the power failed: the journal has no end. Its last line of the print is <code>{}</code> at {}. Look at the machine before the next print.</p>)",
        shown(last.what == kJournalEnd && r.events.size() > 1 ? r.events[r.events.size() - 2].what
                                                              : last.what),
        figure(last.at_s, " s", 3));
  }
  return {};
}

Markup facts_table(const PrintRecord& r) {
  Table table("facts");
  const auto row = [&](const char* what, const std::string& value) {
    if (!value.empty()) table.row(what, value);
  };
  const PrintFacts& f = r.facts;
  if (!r.events.empty()) row("Begun", shown(r.events.front().time));
  row(f.turns() ? "Frames" : "Stack", shown(f.stack));
  row("Printer", shown(f.printer));
  row("Display", shown(f.display));
  if (r.facts_known && f.turns()) {
    row("How", fmt::format("{} turns of {} frames at {:g} °/s{}; a degree is {:.1f} um at the "
                           "vial's inner wall",
                           f.frames / f.angles, f.angles, f.speed_um_s / f.um_per_deg,
                           f.dry_run ? ", without light" : "", f.um_per_deg));
  } else if (r.facts_known) {
    row("How", fmt::format("{}{}{}, {} slices of {:g} um",
                           f.layerwise ? std::string("layer by layer")
                                       : fmt::format("continuous at {:g} mm/h", f.speed_um_s * 3.6),
                           f.uv ? ", under UV light" : "", f.dry_run ? ", without light" : "",
                           text::count(f.frames), f.layer_um));
  }
  if (r.facts_known) {
    row("What is borne",
        fmt::format("frames {} late, and {} of them later; the stage {} off",
                    borne(f, f.max_late_um), f.max_late_frames, borne(f, f.tolerance_um)));
  }
  if (r.seconds) row("Whole print", seconds(*r.seconds));
  row("Control thread", shown(r.threads));
  if (r.last) {
    row("Cycles missed",
        fmt::format("{} (of {:g} ms)", text::count(r.last->missed_cycles), f.cycle_s * 1e3));
  }
  for (const std::string& remark : r.remarks) row("Not readable", shown(remark));
  return table;
}

template <typename Bounds, typename Counts>
void add_counts(Table& table, const std::string& unit, const Bounds& bounds, const Counts& counts) {
  table.row("up to, " + unit);
  for (const auto& name : detail::bound_names(bounds.data(), bounds.size()))
    table.head(name, "col");
  table.row("frames");
  for (const auto n : counts) table.cell(text::count(static_cast<std::int64_t>(n)));
}

Markup late_table(const PrintRecord& r) {
  std::vector<const FrameRow*> late;
  for (const FrameRow& f : r.frames) {
    if (f.late) late.push_back(&f);
  }
  if (late.empty()) return {};
  const bool turns = r.facts.turns();
  const auto how_late = [&](const FrameRow& f) {
    return r.facts.layerwise ? (f.exposed_s - f.exposure_s) * 1e3 : f.late_um;
  };
  std::stable_sort(late.begin(), late.end(), [&](const FrameRow* a, const FrameRow* b) {
    const double x = std::abs(how_late(*a)), y = std::abs(how_late(*b));
    return std::isfinite(x) && (!std::isfinite(y) || x > y);
  });
  // Too early counts as late, too, and is negative.
  Table table({}, "Late frames", true);
  table.column("frame");
  if (turns) table.column("turn");
  table.column(place_title(r.facts));
  table.column(r.facts.layerwise ? "late, ms of exposure" : turns ? "late, °" : "late, um");
  if (turns) table.column("um at the wall");
  table.columns("late, ms", "shown at, s");
  for (std::size_t i = 0; i < std::min(late.size(), kMostLate); ++i) {
    const FrameRow& f = *late[i];
    table.row(f.frame);
    if (turns) table.cells(f.frame / r.facts.angles + 1);
    table.cell(place(r.facts, f.z_um));
    if (turns) table.cell(figure(f.late_um / r.facts.um_per_deg, "", 3));
    table.cells(figure(how_late(f), "", 2), figure((f.shown_s - f.planned_s) * 1e3, "", 2),
                figure(f.shown_s, "", 3));
  }
  Markup html = markup("<h2>Late frames, the worst first</h2>{}", table);
  if (late.size() > kMostLate) {
    html += markup(R"(<p class="dim">The worst {} of {}; all are in frames.csv.</p>)", kMostLate,
                   text::count(static_cast<std::int64_t>(late.size())));
  }
  return html;
}

bool of_the_fault(const RecordedEvent& e) {
  static constexpr const char* kOrder[] = {"phase lamps_off", "phase stopping", "phase blacking",
                                           "phase failed",    "lamps off",      "stage stop",
                                           "black",           "latched",        "light"};
  return e.what.starts_with("fault ") ||
         std::any_of(std::begin(kOrder), std::end(kOrder),
                     [&](const char* what) { return e.what == what; });
}

Markup event_table(const PrintRecord& r) {
  if (r.events.empty()) return {};
  const double fault_s = fault_at_s(r);
  const bool fault = std::isfinite(fault_s);
  Table table("events", "Events", r.events.size() > kLongestUntouched);
  table.column("at, s");
  if (fault) table.column("since the fault, ms");
  for (const char* head : {"what", "detail"}) table.column(head, "words");
  table.columns("frame", place_title(r.facts));
  for (std::size_t i = 0; i < r.events.size(); ++i) {
    // Of many, how it began and how it ended.
    if (r.events.size() > kMostEvents && i == kFirstEvents) {
      const std::size_t left_out = r.events.size() - kMostEvents;
      table.row("…");
      table.cell(text::count(static_cast<std::int64_t>(left_out)) + " lines are left out", {},
                 fault ? 5 : 4);
      i += left_out;
    }
    const RecordedEvent& e = r.events[i];
    table.begin(of_the_fault(e) ? "fault" : "");
    table.head(figure(e.at_s, "", 3));
    if (fault) {
      table.cell(e.at_s >= fault_s && of_the_fault(e) ? figure((e.at_s - fault_s) * 1e3, "", 1)
                                                      : "");
    }
    for (const auto& text : {e.what, e.detail}) table.cell(shown(text), "words");
    table.cells(e.frame < 0 ? std::string() : std::to_string(e.frame),
                place(r.facts, e.stage_um - r.facts.start_um));
  }
  return markup(
      "<h2>What happened</h2>{}{}",
      fault
          ? markup(
                R"(<p class="dim">Marked: the fault and its order: lamps off, stage stop, black.</p>)")
          : Markup(),
      table);
}

std::string title_of(const PrintRecord& r) {
  if (r.end == End::none) return "No print";
  const std::string name = std::filesystem::path(r.facts.stack).filename().string();
  return fmt::format("Print of {}: {}", name.empty() ? "a stack" : shown(name), word_of(r.end));
}

}  // namespace

std::string report_body(const PrintRecord& r) {
  if (r.end == End::none) {
    Markup html = markup("<p>No print is recorded in {}.</p>", shown(r.folder));
    for (const std::string& remark : r.remarks) html += markup("<p>{}.</p>", shown(remark));
    return html.html();
  }
  Markup html = alarm(r) + tiles(r) + what_happened(r) + facts_table(r);
  const auto charts = detail::charts_of(r);
  if (!charts.empty()) {
    // Charts where something happened; of the others a line, and they are folded.
    Markup figures, folded;
    std::string quiet;
    for (const detail::Chart& c : charts) {
      (c.quiet.empty() ? figures : folded) +=
          scrolled(markup("<figure>{}</figure>", Markup::raw(c.svg)));
      // Two charts of the same say it once.
      if (!c.quiet.empty() && quiet.find(c.quiet) == std::string::npos) {
        quiet += (quiet.empty() ? "" : "; ") + c.quiet;
      }
    }
    if (!quiet.empty()) {
      quiet.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(quiet.front())));
      figures += markup(R"(<details><summary>{}.</summary>{}</details>)", quiet, folded);
    }
    Table table;
    if (r.facts.turns()) add_counts(table, "°", Lateness::kBoundsDeg, r.lateness.deg);
    if (!r.facts.turns() && !r.facts.layerwise) {
      add_counts(table, "um", Lateness::kBoundsUm, r.lateness.um);
    }
    add_counts(table, "ms", Lateness::kBoundsMs, r.lateness.ms);
    html += markup(
        R"(<h2>Frame by frame</h2><div class="charts">{}</div><details><summary>Numbers of the histogram</summary>{}</details>)",
        figures, table);
  }
  return (html + late_table(r) + event_table(r)).html();
}

std::string report_page(const PrintRecord& r) {
  Page page(title_of(r), {page_tiles_css, detail::page_print_css});
  page += markup(R"(<p class="dim">{}</p>)", shown(r.folder));
  page += Markup::raw(report_body(r));
  return page.html();
}

void write_report(const StateFolder& folder, bool running) {
  write_whole(folder.file("report.html"), report_page(read_record(folder, running)));
}

void make_missing_report(const StateFolder& folder) {
  std::error_code error;
  if (std::filesystem::exists(folder.file("report.html"), error)) return;
  try {
    if (read_record(folder, false).end != End::none) write_report(folder, false);
  } catch (const std::exception&) {
    // A page is not worth a print.
  }
}

void keep_report(const StateFolder& folder) {
  make_missing_report(folder);
  const std::string now = folder.file("report.html"), before = folder.file("report.previous.html");
  if (std::rename(now.c_str(), before.c_str()) != 0) std::remove(before.c_str());
}

}  // namespace slicecorr::bridge
