// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The live view: what a frame shows. How it gets onto a terminal is the program's matter.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <sstream>

#include "slicecorr/bridge/view.hpp"
#include "support/json/read_json.hpp"
#include "support/terminal/live_line.hpp"
#include "support/text/display_text.hpp"
#include "view/charts.hpp"
#include "view/state_json.hpp"

namespace slicecorr::bridge {
namespace {

using cli::Ink;
using cli::Line;

/// 0 for what would be written as "0.00" or "-0.00" with two decimals.
double calm(double value) { return std::abs(value) < 0.005 ? 0 : value; }

double height_um(const Seen& seen) { return seen.facts.frames * seen.facts.layer_um; }

double z_um(const Seen& seen) { return seen.state.stage_um - seen.facts.start_um; }

double done(const Seen& seen) {
  return seen.facts.frames > 0 ? 1.0 * seen.state.frames_shown / seen.facts.frames : 0;
}

std::string stack_name(const Seen& seen) {
  return text::printable(std::filesystem::path(seen.facts.stack).filename().string());
}

bool failed(const Seen& seen) { return seen.state.fault != Fault::none; }

bool not_confirmed(const Seen& seen) { return seen.state.left && !seen.state.left->confirmed(); }

/// The text broken at blanks into lines of at most `columns` characters.
std::vector<std::string> wrapped(const std::string& text, int columns) {
  std::vector<std::string> lines(1);
  std::istringstream in(text);
  for (std::string word; in >> word;) {
    std::string& last = lines.back();
    if (last.empty()) {
      last = word;
    } else if (static_cast<int>(last.size() + 1 + word.size()) <= columns) {
      last += " " + word;
    } else {
      lines.push_back(word);
    }
  }
  return lines;
}

/// "was done in 4 min 05 s", "failed".
std::string how_it_ended(const Seen& seen) {
  if (seen.state.phase == Phase::done && !failed(seen)) {
    return seen.around.seconds ? "was done in " + text::duration(*seen.around.seconds) : "was done";
  }
  return failed(seen) ? fmt::format("ended with {}", name_of(seen.state.fault))
                      : std::string("was cut off");
}

template <typename Bounds, typename Counts>
void put_histogram(std::vector<std::string>& lines, int columns, bool colour, int room,
                   const Bounds& bounds, const Counts& counts, const char* unit) {
  const auto most = *std::max_element(counts.begin(), counts.end());
  if (most == 0) return;
  const auto names = detail::bound_names(bounds.data(), bounds.size());
  // From the first to the last that holds something; the last ones when there is no room for all.
  std::size_t first = 0, last = counts.size() - 1;
  while (counts[first] == 0) ++first;
  while (counts[last] == 0) --last;
  if (static_cast<int>(last - first) + 1 > room) {
    first = last + 1 - static_cast<std::size_t>(std::max(1, room));
  }
  for (std::size_t i = first; i <= last && static_cast<int>(i - first) < room; ++i) {
    Line line(columns, colour);
    const bool beyond = i + 1 == counts.size();
    line.put(text::padded(beyond ? fmt::format("over {:g} {}", bounds.back(), unit)
                                 : fmt::format("up to {} {}", names[i], unit),
                          14, true) +
                 " ",
             Ink::dim);
    // Logarithmic: one late frame among ten thousand is seen.
    const double share = counts[i] == 0 ? 0
                                        : (1 + std::log10(static_cast<double>(counts[i]))) /
                                              (1 + std::log10(static_cast<double>(most)));
    line.put(text::bar(share, std::clamp(columns - 30, 4, 40)) + " ", Ink::busy);
    line.put(text::count(static_cast<std::int64_t>(counts[i])));
    lines.push_back(line.text());
  }
}

std::string lamp_text(double asked, const std::optional<double>& measured, const char* unit,
                      int digits) {
  return fmt::format(
      "{:.{}f}{} asked, {} measured", asked, digits, unit,
      measured ? fmt::format("{:.{}f}{}", *measured, digits, unit) : std::string("not"));
}

/// The lines of a live view, from the head down.
class LiveFrame {
 public:
  LiveFrame(const Seen& seen, int columns, int rows, bool colour)
      : seen_(seen), columns_(columns), rows_(rows), colour_(colour) {}

  std::vector<std::string> lines() {
    put_head();
    if (seen_.known) put_bar();
    // What is wrong comes before all figures.
    if (seen_.latched || failed(seen_)) put_fault();
    if (seen_.known) {
      lines_.emplace_back();
      put_motion();
      put_lamps();
      put_timing();
      put_lateness();
    }
    put_foot();
    return std::move(lines_);
  }

 private:
  Line line() const { return Line(columns_, colour_); }
  void add(const Line& l) { lines_.push_back(l.text()); }
  void fact(const char* name, const std::string& text, Ink ink = Ink::plain) {
    add(line().put(text::padded(name, 13), Ink::dim).put(text, ink));
  }
  int rest() const { return rows_ - static_cast<int>(lines_.size()); }

  /// Whose printer, and what it prints.
  void put_head();
  void put_bar();
  void put_fault();
  /// Frames, z, speed, and how far the stage is off.
  void put_motion();
  std::string stage_text(double per_um, const char* unit, int digits, bool borne) const;
  void put_lamps();
  /// What may come too late, and what did.
  void put_timing();
  void put_lateness();
  void put_foot();

  const Seen& seen_;
  const int columns_, rows_;
  const bool colour_;
  std::vector<std::string> lines_;
};

void LiveFrame::put_head() {
  const PrintFacts& f = seen_.facts;
  const PrintState& s = seen_.state;
  Line head = line();
  head.put("printbridge  ", Ink::bold).put(text::printable(seen_.printer), Ink::dim);
  add(head);
  if (not_confirmed(seen_)) {
    for (const std::string& part : wrapped(text::printable(in_words(*s.left)), columns_)) {
      add(line().put(part, Ink::bad));
    }
  }
  if (!seen_.running) {
    add(line().put("no print runs"));
    if (seen_.known) {
      add(line()
              .put("the last, ")
              .put(stack_name(seen_), Ink::bold)
              .put(", " + how_it_ended(seen_), failed(seen_) ? Ink::bad : Ink::good));
    }
  } else if (!seen_.known) {
    add(line().put("a print begins"));
  } else {
    add(line()
            .put(std::string(name_of(s.phase)), failed(seen_) ? Ink::bad : Ink::busy)
            .put(fmt::format(" for {}  ", text::duration(s.at_s - s.phase_since_s)), Ink::dim)
            .put(stack_name(seen_), Ink::bold)
            .put(f.dry_run ? "  without light" : "", Ink::bad));
  }
}

void LiveFrame::put_bar() {
  const PrintState& s = seen_.state;
  Line bar = line();
  cli::put_bar(bar, done(seen_), std::clamp(columns_ - 48, 8, 60),
               failed(seen_) ? Ink::bad : Ink::good);
  bar.put(fmt::format(" {:3d} %  ", static_cast<int>(100 * done(seen_) + 1e-9)));
  if (seen_.running) {
    bar.put(text::duration(s.at_s) + " elapsed");
    if (seen_.left_s) bar.put(", " + text::duration(*seen_.left_s) + " left");
  }
  add(bar);
}

void LiveFrame::put_fault() {
  const PrintState& s = seen_.state;
  const Fault fault = failed(seen_) ? s.fault : seen_.latched_fault;
  const std::string& detail = failed(seen_) ? s.detail : seen_.latched_detail;
  lines_.emplace_back();
  add(line().put(fmt::format("{}: {}", name_of(fault), text::printable(detail)), Ink::bad));
  add(line().put(fmt::format("to do: {}{}", what_to_do(fault),
                             seen_.latched && !seen_.running ? ", then `printbridge reset`" : ""),
                 Ink::bold));
}

std::string LiveFrame::stage_text(double per_um, const char* unit, int digits, bool borne) const {
  const PrintState& s = seen_.state;
  const double most = s.worst_stage_error_um * per_um;
  // After a fault the stage is where it stopped, not where it should be: that is no error.
  std::string text = failed(seen_)
                         ? fmt::format("{:.{}f}{} off at most until the fault", most, digits, unit)
                         : fmt::format("{:.{}f}{} off now, {:.{}f} at most",
                                       calm(s.stage_error_um) * per_um, digits, unit, most, digits);
  if (borne) text += fmt::format(", {:g} borne", seen_.facts.tolerance_um * per_um);
  return text;
}

void LiveFrame::put_motion() {
  const PrintFacts& f = seen_.facts;
  const PrintState& s = seen_.state;
  fact("shown",
       shown_in_words(f, s) + (s.frame < 0 && seen_.running ? "; black is shown now" : ""));
  if (f.turns()) {
    const double deg = 1 / f.um_per_deg;
    fact("angle", fmt::format("{:.2f}°, {}", angle_in_turn_deg(f, s), turn_in_words(f, s)));
    fact("speed",
         fmt::format("{:.2f} °/s, planned {:.2f}", s.speed_um_s * deg, f.speed_um_s * deg));
    fact("stage", stage_text(deg, "°", 3, true));
    return;
  }
  fact("z", fmt::format("{:.3f} of {:.3f} mm", z_um(seen_) * 1e-3, height_um(seen_) * 1e-3));
  if (f.layerwise) {
    fact("stage", stage_text(1, " um", 2, false));
  } else {
    fact("speed",
         fmt::format("{:.1f} mm/h, planned {:.1f}", s.speed_um_s * 3.6, f.speed_um_s * 3.6));
    fact("stage", stage_text(1, " um", 2, true));
  }
}

void LiveFrame::put_lamps() {
  const PrintFacts& f = seen_.facts;
  const PrintState& s = seen_.state;
  // After a fault, only what was measured since.
  const bool stale = s.left && !s.left->heard;
  const std::optional<double> blue = stale ? std::nullopt : std::optional(s.blue_measured * 100);
  fact("blue lamp", lamp_text(s.blue_share * 100, blue, " %", 1));
  if (f.uv) {
    fact("UV lamp", lamp_text(s.uv_mw_cm2, stale ? std::nullopt : s.uv_measured, " mW/cm²", 2));
  }
  if (s.temperature_c) fact("temperature", fmt::format("{:.1f} °C", *s.temperature_c));
}

void LiveFrame::put_timing() {
  const PrintFacts& f = seen_.facts;
  const PrintState& s = seen_.state;
  if (seen_.around.ready_frames) {
    const int ready = *seen_.around.ready_frames;
    const bool low = ready < std::min(f.ring_frames / 2, f.frames - s.frames_shown);
    fact("frames ready", fmt::format("{} of {}", ready, f.ring_frames),
         low ? Ink::bad : Ink::plain);
  }
  fact("missed",
       fmt::format("{} cycles of {:g} ms", text::count(s.missed_cycles), f.cycle_s * 1e3));
  fact("late", fmt::format("{} frames", text::count(s.late_frames)),
       s.late_frames > 0 ? Ink::bad : Ink::plain);
  const Lateness& l = s.lateness;
  fact("worst", f.layerwise ? fmt::format("exposure {:.2f} ms too long", l.worst_ms)
                            : fmt::format("{} late, {:.2f} ms",
                                          way_in_words(latest_um(s), f.um_per_deg), l.worst_ms));
}

void LiveFrame::put_lateness() {
  const PrintFacts& f = seen_.facts;
  const Lateness& l = seen_.state.lateness;
  const int room = rest() - 2;
  if (room > 0) {
    lines_.emplace_back();
    if (f.layerwise) {
      put_histogram(lines_, columns_, colour_, room, Lateness::kBoundsMs, l.ms, "ms");
    } else if (f.turns()) {
      put_histogram(lines_, columns_, colour_, room, Lateness::kBoundsDeg, l.deg, "°");
    } else {
      put_histogram(lines_, columns_, colour_, room, Lateness::kBoundsUm, l.um, "um");
    }
  }
}

void LiveFrame::put_foot() {
  while (rest() > 1) lines_.emplace_back();
  if (rest() > 0) add(line().put("q quit; the print goes on without this view", Ink::dim));
  if (rest() < 0) lines_.resize(static_cast<std::size_t>(std::max(0, rows_)));
}

}  // namespace

std::string live_line(const Seen& seen) {
  const PrintState& s = seen.state;
  if (not_confirmed(seen)) {
    Seen rest = seen;
    rest.state.left.reset();
    return text::printable(in_words(*s.left)) + "; " + live_line(rest);
  }
  if (!seen.running) {
    std::string text = "no print runs";
    if (seen.known) {
      text += fmt::format("; the last, {}, {}: {} shown", stack_name(seen), how_it_ended(seen),
                          shown_in_words(seen.facts, s));
    }
    if (seen.latched) {
      text += fmt::format("; latched: {}: {}; to do: {}, then printbridge reset",
                          name_of(seen.latched_fault), text::printable(seen.latched_detail),
                          what_to_do(seen.latched_fault));
    }
    return text;
  }
  if (!seen.known) return "a print begins";
  const PrintFacts& f = seen.facts;
  const bool turns = f.turns();
  std::string text = fmt::format("{}, {} shown, ", name_of(s.phase), shown_in_words(f, s));
  text += turns ? fmt::format("{}, {:.2f}°", turn_in_words(f, s), angle_in_turn_deg(f, s))
                : fmt::format("z {:.3f} mm", z_um(seen) * 1e-3);
  if (failed(seen)) {
    return text + fmt::format(", {}: {}; to do: {}", name_of(s.fault), text::printable(s.detail),
                              what_to_do(s.fault));
  }
  text += seen.facts.layerwise
              ? fmt::format(", worst exposure {:.2f} ms too long", s.lateness.worst_ms)
              : fmt::format(", {}, worst {} late",
                            turns ? fmt::format("{:.2f} °/s", s.speed_um_s / f.um_per_deg)
                                  : fmt::format("{:.1f} mm/h", s.speed_um_s * 3.6),
                            way_in_words(latest_um(s), f.um_per_deg));
  text += fmt::format(", {} late", s.late_frames);
  if (seen.left_s) text += ", " + text::duration(*seen.left_s) + " left";
  return text;
}

std::string event_line(const std::string& journal_line) {
  const detail::Json json = slicecorr::detail::try_json<detail::Json>(journal_line);
  const std::string what = detail::text_in(json, "what"), more = detail::text_in(json, "detail");
  if (what.empty()) return {};
  const int frame = detail::whole_in(json, "frame", kBlackFrame);
  return text::clipped(
      text::printable(fmt::format("{}  {:10.3f} s  {}{}{}", detail::text_in(json, "time"),
                                  detail::number_in(json, "at_s", 0), what,
                                  frame < 0 ? "" : fmt::format(" (frame {})", frame),
                                  more.empty() ? "" : ": " + more)),
      500);
}

std::vector<std::string> live_frame(const Seen& seen, int columns, int rows, bool colour) {
  return LiveFrame(seen, columns, rows, colour).lines();
}

}  // namespace slicecorr::bridge
