// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The live view: what a frame shows. How it gets onto a terminal is the program's matter.

#include <fmt/format.h>

#include <algorithm>

#include "slicecorr/farm/status.hpp"
#include "support/terminal/live_line.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm {

namespace {

using cli::Ink;
using cli::Line;
using cli::put_bar;

Ink ink_of(const FarmEvent& e) {
  if (e.kind == "done") return Ink::good;
  if (e.kind == "failed" || e.kind == "disk_low" || e.kind == "service_lost" ||
      e.kind == "cache_damaged") {
    return Ink::bad;
  }
  return e.kind == "put_back" ? Ink::busy : Ink::plain;
}

/// The lines of a live view, from the title down.
class LiveFrame {
 public:
  LiveFrame(const LiveState& state, const FarmFolder& folder, int columns, int rows, bool colour)
      : state_(state), folder_(folder), columns_(columns), rows_(rows), colour_(colour) {}

  std::vector<std::string> lines() {
    put_title();
    put_counts();
    put_progress();
    put_holds();
    put_services();
    // Half of the rest for what runs, the other half for what comes next and what happened.
    if (!state_.overview.running.empty() && rest() > 2) put_running();
    if (!state_.next.empty() && rest() > 6) put_next();
    if (!state_.latest.empty() && rest() > 3) put_latest();
    while (rest() > 1) lines_.emplace_back();
    if (rest() > 0) add(line().put("q quit", Ink::dim));
    if (static_cast<int>(lines_.size()) > rows_) lines_.resize(static_cast<std::size_t>(rows_));
    return std::move(lines_);
  }

 private:
  void add(const Line& line) { lines_.push_back(line.text()); }
  Line line() const { return Line(columns_, colour_); }
  std::int64_t number(JobState st) const {
    return state_.overview.summary.jobs[static_cast<std::size_t>(st)];
  }
  int rest() const { return rows_ - static_cast<int>(lines_.size()); }
  void heading(const std::string& text) {
    lines_.emplace_back();
    add(line().put(text, Ink::bold));
  }

  void put_title();
  /// Jobs by state.
  void put_counts();
  /// How much is done of all jobs, and when the rest will be.
  void put_progress();
  /// What keeps jobs from starting; disks and cache.
  void put_holds();
  void put_services();
  void put_running();
  Line running_line(const RunningJob& r) const;
  void put_next();
  /// The last events.
  void put_latest();

  const LiveState& state_;
  const FarmFolder& folder_;
  const int columns_, rows_;
  const bool colour_;
  std::vector<std::string> lines_;
};

void LiveFrame::put_title() {
  const Overview& o = state_.overview;
  add(line()
          .put("slicefarm  ", Ink::bold)
          .put(text::printable(folder_.root), Ink::dim)
          .to_the_right(local_time_text(o.now_ms).substr(11), Ink::dim));
}

void LiveFrame::put_counts() {
  const Summary& s = state_.overview.summary;
  Line l = line();
  l.put(text::count(number(JobState::running)) + " running", Ink::busy);
  l.put(fmt::format(" · {} queued", text::count(number(JobState::queued))));
  if (s.followers > 0) {
    l.put(fmt::format(" ({} wait for the same work)", text::count(s.followers)), Ink::dim);
  }
  l.put(" · ").put(text::count(number(JobState::done)) + " done", Ink::good);
  l.put(" · ").put(text::count(number(JobState::failed)) + " failed",
                   number(JobState::failed) > 0 ? Ink::bad : Ink::plain);
  if (number(JobState::cancelled) > 0) {
    l.put(fmt::format(" · {} cancelled", text::count(number(JobState::cancelled))));
  }
  add(l);
}

void LiveFrame::put_progress() {
  const Overview& o = state_.overview;
  const Summary& s = o.summary;
  const std::int64_t ended =
      number(JobState::done) + number(JobState::failed) + number(JobState::cancelled);
  double all = 0, done = static_cast<double>(ended);
  for (const std::int64_t n : s.jobs) all += static_cast<double>(n);
  for (const RunningJob& r : o.running) done += r.attempt.fraction;
  const double fraction = all > 0 ? done / all : 0;
  Line l = line();
  put_bar(l, fraction, std::clamp(columns_ - 48, 8, 60), Ink::good);
  // Rounded down: 100 % means that nothing is left.
  l.put(fmt::format(" {:3d} %", static_cast<int>(100 * fraction + 1e-9)));
  if (number(JobState::running) + number(JobState::queued) > 0) {
    if (s.eta_s >= 0) {
      l.put(fmt::format(
          "  {} left, about {}", text::duration(s.eta_s),
          text::moment(o.now_ms + static_cast<std::int64_t>(1000 * s.eta_s), o.now_ms)));
    }
    if (s.late > 0) l.put(fmt::format("  {} late", text::count(s.late)), Ink::bad);
  }
  add(l);
}

void LiveFrame::put_holds() {
  const Overview& o = state_.overview;
  const Summary& s = o.summary;
  Line l = line();
  const std::string holds = what_holds(o);
  if (!holds.empty() && number(JobState::queued) > 0) {
    l.put("nothing starts: " + holds + "  ", Ink::bad);
  } else if (!holds.empty()) {
    l.put(holds + "  ", Ink::dim);
  }
  if (o.settings.night_from >= 0) {
    l.put(fmt::format("night {}-{}  ", minute_text(o.settings.night_from),
                      minute_text(o.settings.night_until)));
  }
  for (const DiskState& d : o.disks) {
    l.put(fmt::format("{} disk {} free  ", d.what, text::bytes(static_cast<double>(d.free_bytes))));
  }
  l.put(fmt::format("cache {}", text::bytes(static_cast<double>(s.cache_bytes))), Ink::dim);
  add(l);
}

void LiveFrame::put_services() {
  const Overview& o = state_.overview;
  const Summary& s = o.summary;
  for (std::size_t i = 0; i < o.services.size() && i < 3; ++i) {
    const Service& v = o.services[i];
    add(line().put(
        text::printable(fmt::format(
            "{} on {}: {}, {} of {} cores, {} of memory", v.engine, v.host,
            v.doing.empty() ? "working" : v.doing,
            o.services.size() == 1 ? std::to_string(s.running_threads) : std::string("-"), v.cores,
            text::bytes(1048576.0 * static_cast<double>(s.running_memory_mb)))),
        Ink::dim));
  }
}

Line LiveFrame::running_line(const RunningJob& r) const {
  // Narrow windows do without the stage and the word "layers".
  const bool wide = columns_ >= 88;
  const int name_columns = std::clamp(columns_ / 5, 8, 32);
  const int figures = 7 + 1 + 6 + (wide ? 11 + 19 + 9 + 14 : 12 + 7 + 10);
  Line l = line();
  l.put(text::padded(std::to_string(r.job.id), 6, true) + " ", Ink::dim);
  l.put(text::padded(text::printable(r.job.name), name_columns) + " ");
  if (wide) {
    const std::string& stage = r.attempt.stage.empty() ? r.attempt.phase : r.attempt.stage;
    l.put(text::padded(text::printable(stage), 10) + " ", Ink::dim);
  }
  put_bar(l, r.attempt.fraction, std::clamp(columns_ - name_columns - figures, 6, 40), Ink::busy);
  l.put(fmt::format(" {:3.0f} %", 100 * r.attempt.fraction));
  if (r.job.layers > 0) {
    l.put(text::padded(
        fmt::format("{}/{}{}", r.attempt.layers_done, r.job.layers, wide ? " layers" : ""),
        wide ? 19 : 12, true));
  }
  l.put(text::padded(r.layers_per_s > 0 ? text::figure(r.layers_per_s) + "/s" : "-", wide ? 9 : 7,
                     true));
  const std::string left = r.eta_s >= 0 ? text::duration(r.eta_s) : "-";
  l.put(text::padded(left, wide ? 14 : 10, true));
  if (r.attempt.number > 1) l.put(fmt::format(" attempt {}", r.attempt.number), Ink::bad);
  if (r.job.cancel_wanted) l.put(" cancelling", Ink::bad);
  return l;
}

void LiveFrame::put_running() {
  const Overview& o = state_.overview;
  const int running = static_cast<int>(o.running.size());
  const int shown = std::min(running, std::max(1, rest() / 2 - 2));
  heading("Running");
  for (int i = 0; i < shown; ++i) {
    add(running_line(o.running[static_cast<std::size_t>(i)]));
  }
  if (running > shown) {
    add(line().put(fmt::format("       and {} more", running - shown), Ink::dim));
  }
}

void LiveFrame::put_next() {
  const Overview& o = state_.overview;
  heading("Next");
  const int most = std::max(1, rest() / 2 - 2);
  for (int i = 0; i < most && i < static_cast<int>(state_.next.size()); ++i) {
    const Job& j = state_.next[static_cast<std::size_t>(i)];
    Line l = line();
    l.put(text::padded(std::to_string(j.id), 6, true) + " ", Ink::dim);
    l.put(text::padded(text::printable(j.name), std::clamp(columns_ / 5, 8, 32)) + " ");
    l.put(text::padded(text::printable(j.user), 10) + " ", Ink::dim);
    if (j.priority != 0) l.put(fmt::format("priority {}  ", j.priority));
    if (j.ready_by_ms != kNoDeadline) {
      l.put("by " + text::to_the_minute(j.ready_by_ms, o.now_ms) + "  ");
    }
    if (j.follows > 0) l.put(fmt::format("waits for {}  ", j.follows), Ink::dim);
    if (j.reason != Reason::none) l.put(fmt::format("after {}", name_of(j.reason)), Ink::bad);
    add(l);
  }
}

void LiveFrame::put_latest() {
  const Overview& o = state_.overview;
  heading("Latest");
  const int room = rest() - 1;  // one for the last line
  const int most = std::min(room, static_cast<int>(state_.latest.size()));
  for (std::size_t i = state_.latest.size() - static_cast<std::size_t>(std::max(0, most));
       i < state_.latest.size(); ++i) {
    const FarmEvent& e = state_.latest[i];
    add(line().put(text::moment(e.at_ms, o.now_ms) + "  ", Ink::dim).put(event_text(e), ink_of(e)));
  }
}

}  // namespace

LiveState read_live(ReadModel& model, const FarmFolder& folder, int rows, const FarmClock& clock) {
  LiveState state;
  state.overview = read_overview(model, folder, clock);
  JobFilter queued;
  queued.states = {JobState::queued};
  queued.order = JobFilter::Order::urgency;
  queued.limit = std::clamp(rows, 1, 200);
  state.next = model.jobs(queued);
  state.latest = model.last_events(std::clamp(rows, 1, 200));
  return state;
}

std::string event_text(const FarmEvent& e) {
  std::string text;
  if (e.job > 0) text += fmt::format("{} {}  ", e.job, e.name);
  text += e.kind;
  if (e.reason != Reason::none) text += fmt::format(" ({})", name_of(e.reason));
  if (!e.text.empty()) text += "  " + e.text;
  return text::printable(text);
}

std::vector<std::string> live_frame(const LiveState& state, const FarmFolder& folder, int columns,
                                    int rows, bool colour) {
  return LiveFrame(state, folder, columns, rows, colour).lines();
}

}  // namespace slicecorr::farm
