// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "slicecorr/farm/morning.hpp"
#include "slicecorr/lift_times.hpp"
#include "support/chart/chart.hpp"
#include "support/json/read_json.hpp"
#include "support/page/html_page.hpp"
#include "views/moment_text.hpp"
#include "views/page_text.hpp"
#include "views/time_axis.hpp"

namespace slicecorr::farm {

using Json = nlohmann::ordered_json;
using namespace page;
using text::printable;

namespace {

/// A path as a link: everything but letters, digits and a few marks in percent.
std::string link_text(const std::string& path) {
  std::string out;
  for (const char c : path) {
    const auto u = static_cast<unsigned char>(c);
    const bool plain = (u >= '0' && u <= '9') || (u >= 'A' && u <= 'Z') || (u >= 'a' && u <= 'z') ||
                       c == '/' || c == '-' || c == '_' || c == '.' || c == '~';
    out += plain ? std::string(1, c) : fmt::format("%{:02X}", u);
  }
  return out;
}

Markup report_link(const Job& job, const LinkTo& links) {
  const bool there = std::any_of(job.files.begin(), job.files.end(),
                                 [](const ResultFile& f) { return f.ending == "html"; });
  const std::string name = printable(job.name);
  if (!there) return name;
  std::string to;
  if (links.kind == LinkTo::Kind::server) {
    to = fmt::format("api/v1/jobs/{}/files/html", job.id);
  } else {
    const std::string path = job.output("html");
    to = links.base.empty()
             ? "file://" + link_text(path)
             : link_text(std::filesystem::path(path).lexically_relative(links.base).string());
    // A first segment with a colon would read as a scheme.
    if (!links.base.empty()) to = "./" + to;
  }
  return markup(R"(<a href="{}">{}</a>)", to, name);
}

std::string time_of_day(const MorningReport& r, std::int64_t ms) {
  return text::moment(ms, r.until_ms);
}

Markup reason_list(const std::vector<Reasons>& reasons) {
  Markup text;
  for (const Reasons& r : reasons) {
    text += markup("{}{} <code>{}</code>", text.empty() ? "" : ", ", text::count(r.jobs),
                   name_of(r.reason));
  }
  return text;
}

double jobs_per_h(const MorningReport& r) {
  return r.working_s > 0 ? static_cast<double>(r.done) * 3600 / r.working_s : 0;
}

double hours(const MorningReport& r) { return static_cast<double>(r.until_ms - r.from_ms) / 3.6e6; }

Markup figures(const MorningReport& r) {
  const Summary& s = r.overview.summary;
  const auto left = s.jobs[static_cast<std::size_t>(JobState::queued)];
  const auto running = s.jobs[static_cast<std::size_t>(JobState::running)];
  Tiles tiles;
  tiles.add(text::count(r.done),
            r.from_cache > 0
                ? fmt::format("done, {} of them from the cache", text::count(r.from_cache))
                : "done",
            r.done > 0 ? "good" : "");
  tiles.add(text::count(r.failed), "failed", r.failed > 0 ? "bad" : "");
  if (r.with_defects > 0) {
    tiles.add(text::count(r.with_defects), "done, but with a warning", "bad");
  }
  if (r.cancelled > 0) tiles.add(text::count(r.cancelled), "cancelled");
  tiles.add(
      text::count(left + running),
      running > 0 ? fmt::format("still to do, {} running", text::count(running)) : "still to do");
  tiles.add(r.working_s > 0 ? text::figure(jobs_per_h(r)) : "-",
            "jobs an hour while something ran");
  tiles.add(r.working_s > 0 ? fmt::format("{:.2f}", r.core_s / r.working_s) : "-",
            r.cores > 0 ? fmt::format("of {} {} busy while something ran", r.cores,
                                      r.cores == 1 ? "core" : "cores")
                        : "cores busy while something ran");
  tiles.add(text::bytes(static_cast<double>(r.delivered_bytes)), "written");
  return tiles;
}

Markup failures(const MorningReport& r) {
  if (r.failed == 0) return markup("<h2>What failed</h2><p>Nothing.</p>");
  Markup html = markup(R"(<h2 id="failed">What failed, and why</h2><p>{}.</p>)",
                       reason_list(r.failed_reasons));
  bool open = true;
  for (const auto& f : r.failures) {
    // The first ones can be read at once, and on paper.
    html += markup(
        R"(<details class="failure"{}><summary><b>{} {}</b> <code>{}</code> <span class="dim">{}</span></summary><p>{}</p>)",
        open ? " open" : "", f.job.id, printable(f.job.name), name_of(f.job.reason),
        time_of_day(r, f.job.ended_ms), printable(f.job.message));
    open = &f - r.failures.data() < 4;
    std::string parts;
    for (const std::string& p : f.job.parts) parts += (parts.empty() ? "" : ", ") + printable(p);
    html += markup(
        R"(<p class="dim">{}; by {}; {}</p>)", parts, printable(f.job.user),
        f.attempts.size() == 1 ? "one attempt" : fmt::format("{} attempts", f.attempts.size()));
    if (f.attempts.size() > 1) {
      std::vector<Markup> tries;
      for (const Attempt& a : f.attempts) {
        tries.push_back(markup("<code>{}</code> {}{}", name_of(a.reason), printable(a.message),
                               a.node.empty() ? "" : " on " + printable(a.node)));
      }
      html += markup("<ol>{}</ol>", items(tries));
    }
    std::string log;
    for (const std::string& line : f.log_lines) log += line + "\n";
    if (!log.empty()) html += markup(R"(<pre class="log">{}</pre>)", log);
    html += markup("</details>");
  }
  const auto more = r.failed - static_cast<std::int64_t>(r.failures.size());
  if (more > 0) {
    html += markup("<p>and {} more: <code>slicefarm status --state failed</code></p>",
                   text::count(more));
  }
  return html;
}

Markup how_many(const std::vector<Job>& shown, std::int64_t all) {
  if (all <= static_cast<std::int64_t>(shown.size())) return {};
  return markup(R"(<p class="dim">The worst {} of {}.</p>)", shown.size(), text::count(all));
}

Markup worst(const MorningReport& r, const LinkTo& links) {
  if (r.worst.empty()) return {};
  Table table("jobs", "Height errors");
  table.columns("Part", "largest", "95 % within", "mean", "lost", "merged", "cured through",
                "layers", "job");
  for (const Job& j : r.worst) {
    const ResultFigures f = j.figures.value_or(ResultFigures{});
    const auto um = [&](double v) {
      return j.figures ? text::figure(v) + " um" : std::string("-");
    };
    const auto n = [&](std::int64_t v) { return j.figures ? text::count(v) : std::string("-"); };
    table.row(report_link(j, links), um(f.height_max_um), um(f.height_p95_um),
              um(f.height_mean_um));
    table.cell(n(f.lost_features), f.lost_features > 0 ? "bad" : "");
    table.cell(n(f.merged_features), f.merged_features > 0 ? "bad" : "");
    table.cells(n(f.cure_through_voxels), n(f.layers), j.id);
  }
  return markup("<h2>Height errors, worst first</h2>{}{}", table,
                how_many(r.worst, r.done - r.tomographic_done));
}

/// Tomographic prints have no heights: what void and part get, and how long it takes.
Markup tomographic(const MorningReport& r, const LinkTo& links) {
  if (r.tomographic.empty()) return {};
  Table table("jobs", "Tomographic prints");
  table.columns("Part", "contrast", "bound", "VER", "turns", "print time", "slices", "job");
  for (const Job& j : r.tomographic) {
    const ResultFigures f = j.figures.value_or(ResultFigures{});
    const TomoFigures t = f.tomo.value_or(TomoFigures{});
    table.row(report_link(j, links));
    table.cell(text::figure(t.contrast), !t.feasible ? "bad" : "");
    table.cell(text::figure(t.contrast_bound));
    table.cell(text::figure(t.ver), t.ver > 0 ? "bad" : "");
    table.cells(text::count(t.turns), text::duration(t.print_time_s), text::count(f.layers), j.id);
  }
  return markup("<h2>Tomographic prints, least contrast first</h2>{}{}", table,
                how_many(r.tomographic, r.tomographic_done));
}

/// What scans of the time say, and whether prints wander.
Markup scanned(const MorningReport& r) {
  if (r.scanned.empty()) return {};
  Markup beyond;
  Table table("jobs", "Scans of prints");
  table.columns("Print", "printer", "resin", "mean", "mean absolute", "95 % within", "worst",
                "when");
  for (const PrintsOverTime& p : r.scanned) {
    const std::string words = beyond_in_words(p);
    if (!words.empty()) beyond += markup(R"(<p class="holds">{}.</p>)", words);
    for (const KeptScan& s : p.scans) {
      if (s.at_ms < r.from_ms || s.at_ms >= r.until_ms) continue;
      const bool last = &s == &p.scans.back();
      table.row(fmt::format("{} {}, scan {}", s.job, s.name, s.number), s.printer, s.resin);
      table.cell(fmt::format("{:+.2f} um", s.mean_um), last && !words.empty() ? "bad" : "");
      table.cells(fmt::format("{:.2f} um", s.mean_abs_um), fmt::format("{:.2f} um", s.p95_um),
                  fmt::format("{:.1f} um", s.worst_um), time_of_day(r, s.at_ms));
    }
  }
  return markup("<h2>Scans of prints</h2>{}{}", beyond, table);
}

/// A column of the table of all jobs, and the order that a reader may ask for.
struct JobColumn {
  const char *name, *title;
  std::function<Markup(const Job&)> cell;
  /// Smaller comes first.
  std::function<double(const Job&)> rank;
};

double state_rank(const Job& j) {
  if (j.state == JobState::failed) return 0;
  if (j.state == JobState::cancelled) return 1;
  return j.message.empty() ? 3 : 2;
}

std::vector<JobColumn> job_columns(const MorningReport& r, const LinkTo& links) {
  // Prints without a figure come last.
  const auto worst_first = [](const Job& j, double value) {
    return j.figures ? -value : std::numeric_limits<double>::infinity();
  };
  const auto largest = [](const Job& j) { return j.figures ? j.figures->height_max_um : 0.0; };
  const auto lost = [](const Job& j) {
    return j.figures ? static_cast<double>(j.figures->lost_features + j.figures->merged_features)
                     : 0.0;
  };
  const auto seconds = [](const Job& j) {
    return j.started_ms > 0 ? static_cast<double>(j.ended_ms - j.started_ms) / 1000 : 0.0;
  };
  const bool heights = std::any_of(r.jobs.begin(), r.jobs.end(),
                                   [](const Job& j) { return j.figures && !j.figures->tomo; });
  std::vector<JobColumn> columns{
      {"job", "job", [](const Job& j) { return std::to_string(j.id); },
       [](const Job& j) { return static_cast<double>(j.id); }},
      {"part", "part", [&links](const Job& j) { return report_link(j, links); }, {}},
      {"state", "how it ended",
       [](const Job& j) {
         if (j.state != JobState::done) {
           return markup(R"(<b class="bad">{}</b> {})", name_of(j.state), printable(j.message));
         }
         const std::string comes_to =
             j.figures && j.figures->verdict ? printable(j.figures->verdict->words) : "";
         if (j.message.empty()) {
           return comes_to.empty() ? Markup("done") : markup("done: {}", comes_to);
         }
         if (!comes_to.empty()) {
           return markup(R"(<b class="warn">done</b>: {} But {})", comes_to,
                         printable(text::without_folders(j.message)));
         }
         return markup(R"(<b class="warn">done</b>, but {})",
                       printable(text::without_folders(j.message)));
       },
       state_rank},
      {"ended", "ended", [&r](const Job& j) { return time_of_day(r, j.ended_ms); },
       [](const Job& j) { return -static_cast<double>(j.ended_ms); }},
      {"took", "took",
       [seconds](const Job& j) {
         return j.from_cache     ? std::string("cache")
                : seconds(j) > 0 ? text::duration(seconds(j))
                                 : std::string("-");
       },
       [seconds](const Job& j) { return -seconds(j); }}};
  if (heights) {
    columns.push_back({"error", "largest height error",
                       [largest](const Job& j) {
                         return j.figures && !j.figures->tomo ? text::figure(largest(j)) + " um"
                                                              : std::string("-");
                       },
                       [=](const Job& j) { return worst_first(j, largest(j)); }});
    columns.push_back({"lost", "lost and merged",
                       [lost](const Job& j) {
                         return j.figures && !j.figures->tomo
                                    ? text::count(static_cast<std::int64_t>(lost(j)))
                                    : std::string("-");
                       },
                       [=](const Job& j) { return worst_first(j, lost(j)); }});
  }
  const auto stack_time = [](const Job& j) {
    return j.figures ? j.figures->time : std::optional<StackTime>();
  };
  if (std::any_of(r.jobs.begin(), r.jobs.end(), stack_time)) {
    columns.push_back({"print", "print time",
                       [stack_time](const Job& j) {
                         const std::optional<StackTime> t = stack_time(j);
                         if (!t) return std::string("-");
                         PrintTime time;
                         time.light_s = t->light_s;
                         if (t->print_s) time.dark_s = *t->print_s - t->light_s;
                         return print_time_in_words(time);
                       },
                       [stack_time](const Job& j) {
                         const std::optional<StackTime> t = stack_time(j);
                         return t ? -t->print_s.value_or(t->light_s)
                                  : std::numeric_limits<double>::infinity();
                       }});
  }
  columns.push_back({"user", "user", [](const Job& j) { return printable(j.user); }, {}});
  return columns;
}

/// All jobs of the time in a table that sorts without a script: each row has its rank in every
/// order, and the order that is chosen picks one of them.
Markup all_jobs(const MorningReport& r, const LinkTo& links) {
  if (r.jobs.empty()) return {};
  const std::vector<JobColumn> columns = job_columns(r, links);
  const std::int64_t ended = r.done + r.failed + r.cancelled;
  Markup html = markup(R"(<h2 id="jobs">All {} that ended</h2>)",
                       ended == 1 ? "jobs" : text::count(ended) + " jobs");
  std::string style = fmt::format(".all{{grid-template-columns:repeat({},auto)}}", columns.size());
  Markup choices, head, rows;
  std::vector<std::string> ranks(r.jobs.size());
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const JobColumn& column = columns[c];
    head += markup(R"(<span role="columnheader">{}</span>)", column.title);
    std::vector<std::size_t> order(r.jobs.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      if (column.rank) return column.rank(r.jobs[a]) < column.rank(r.jobs[b]);
      return column.cell(r.jobs[a]).html() < column.cell(r.jobs[b]).html();
    });
    for (std::size_t i = 0; i < order.size(); ++i) {
      ranks[order[i]] += fmt::format("--{}:{};", column.name, i + 1);
    }
    choices +=
        markup(R"(<label><input type="radio" name="order" id="by-{0}"{1}> {2}</label>)",
               column.name, column.name == std::string("state") ? " checked" : "", column.title);
    style += fmt::format(".sorted:has(#by-{0}:checked) .row>span{{order:var(--{0})}}", column.name);
  }
  for (std::size_t i = 0; i < r.jobs.size(); ++i) {
    style += fmt::format(".j{}{{{}}}", i, ranks[i]);
    rows += markup(R"(<div class="row j{}" role="row">)", i);
    for (const JobColumn& column : columns) {
      rows += markup(R"(<span role="cell">{}</span>)", column.cell(r.jobs[i]));
    }
    rows += markup("</div>");
  }
  html += markup(
      R"(<style>{}</style><div class="sorted"><fieldset><legend>Sort by</legend>{}</fieldset><div class="scroll" tabindex="0" role="region" aria-label="All jobs"><div class="all" role="table"><div class="row head" role="row">{}</div>{}</div></div></div>)",
      Markup::raw(style), choices, head, rows);
  if (ended > std::ssize(r.jobs)) {
    html += markup(R"(<p class="dim">The last {} of {}.</p>)", r.jobs.size(), text::count(ended));
  }
  return html;
}

/// Throughput and cores over the time, one below the other.
std::string charts(const MorningReport& r) {
  using chart::Point;
  const auto hour = [&](std::int64_t ms) { return static_cast<double>(ms - r.from_ms) / 3.6e6; };
  chart::Axis time{"local time", false, 0, hours(r)};
  for (const auto& tick : detail::time_ticks(r.from_ms, r.until_ms, 8)) {
    time.ticks.push_back({hour(tick.ms), tick.label});
  }
  std::vector<Point> floor, done, busy;
  std::vector<double> done_values, busy_values{static_cast<double>(r.cores)};
  for (const auto& slot : r.slots) {
    const std::int64_t end = std::min(slot.from_ms + r.slot_ms, r.until_ms);
    const double rate = slot.done * 3.6e6 / static_cast<double>(r.slot_ms);
    for (const std::int64_t ms : {slot.from_ms, end}) {
      floor.push_back({hour(ms), 0});
      done.push_back({hour(ms), rate});
      busy.push_back({hour(ms), slot.cores_busy});
    }
    done_values.push_back(rate);
    busy_values.push_back(slot.cores_busy);
  }
  chart::Picture picture("Jobs done and cores busy",
                         fmt::format("Jobs done an hour and mean cores busy, in slots of {}",
                                     text::duration(static_cast<double>(r.slot_ms) / 1000)));
  chart::Panel jobs(time, chart::axis_over("jobs an hour", false, done_values, true), 130, false);
  jobs.band(floor, done, chart::Style::series, 2);
  jobs.line(done, chart::Style::series, 2);
  chart::Axis busy_axis = chart::axis_over("cores busy", false, busy_values, true);
  busy_axis.high *= 1.2;  // room for the words of the line
  chart::Panel cores(time, busy_axis, 130);
  cores.band(floor, busy, chart::Style::series, 0);
  cores.line(busy, chart::Style::series, 0);
  if (r.cores > 0)
    cores.horizontal(r.cores, fmt::format("{} {}", r.cores, r.cores == 1 ? "core" : "cores"));
  picture.add(jobs);
  picture.add(cores);
  return picture.svg();
}

Markup disk(const MorningReport& r) {
  Table table;
  const Summary& s = r.overview.summary;
  table.row("Written by jobs of this time", text::bytes(static_cast<double>(r.delivered_bytes)));
  table.row(fmt::format("Cache, {} results", text::count(s.cache_entries)),
            text::bytes(static_cast<double>(s.cache_bytes)));
  table.row("Copies of inputs", text::bytes(static_cast<double>(r.inputs_bytes)));
  for (const DiskState& d : r.overview.disks) {
    table.row(fmt::format("Free where the {} is, of {}", d.what,
                          text::bytes(static_cast<double>(d.total_bytes))),
              text::bytes(static_cast<double>(d.free_bytes)));
  }
  return table;
}

}  // namespace

std::string morning_page(const MorningReport& r, const LinkTo& links) {
  const std::string title = fmt::format("Farm, {} to {}", local_time_text(r.from_ms).substr(0, 16),
                                        local_time_text(r.until_ms).substr(0, 16));
  Page page(title, {page_tiles_css, detail::page_farm_css});
  page += markup(R"(<p class="dim">{}{}</p>)", printable(r.root),
                 r.batch > 0 ? fmt::format(", batch {}", r.batch) : "");
  page += figures(r);
  if (const std::string holds = what_holds(r.overview);
      !holds.empty() && r.overview.summary.jobs[static_cast<std::size_t>(JobState::queued)] > 0) {
    page += markup(R"(<p class="holds">Jobs wait and nothing starts: {}.</p>)", printable(holds));
  }
  if (r.overview.summary.late > 0) {
    page += markup(R"(<p class="holds">{} unfinished jobs will miss their time.</p>)",
                   text::count(r.overview.summary.late));
  }
  page += markup(
      R"(<h2>Workers</h2><div class="scroll" tabindex="0" role="region" aria-label="Workers over time"><figure class="wide">{}</figure></div>)",
      Markup::raw(timeline_svg(r)));
  if (!r.attempt_reasons.empty()) {
    page += markup("<p>Attempts that ended without a result: {}. {} attempts in all.</p>",
                   reason_list(r.attempt_reasons), text::count(r.attempts));
  }
  page += failures(r);
  page += worst(r, links);
  page += tomographic(r, links);
  page += scanned(r);
  page += all_jobs(r, links);
  if (r.attempts == 0 && r.done == 0) {
    page += markup("<h2>Disk</h2>{}", disk(r));
  } else {
    page += markup(
        R"(<h2>Over time, and on the disk</h2><div class="side"><div class="scroll" tabindex="0" role="group" aria-label="Scrolls"><figure>{}</figure></div><div>{}</div></div>)",
        Markup::raw(charts(r)), disk(r));
  }
  return page.html();
}

std::string morning_json(const MorningReport& r) {
  Json json;
  json["dir"] = r.root;
  json["from_ms"] = r.from_ms;
  json["until_ms"] = r.until_ms;
  json["batch"] = r.batch > 0 ? Json(r.batch) : Json(nullptr);
  json["done"] = r.done;
  json["from_cache"] = r.from_cache;
  json["failed"] = r.failed;
  json["cancelled"] = r.cancelled;
  json["jobs_per_h"] = jobs_per_h(r);
  json["attempts"] = r.attempts;
  json["core_s"] = r.core_s;
  json["working_s"] = r.working_s;
  json["cores"] = r.cores;
  json["cores_busy"] = r.working_s > 0 ? r.core_s / r.working_s : 0.0;
  json["delivered_bytes"] = r.delivered_bytes;
  json["inputs_bytes"] = r.inputs_bytes;
  const auto reasons = [](const std::vector<Reasons>& list) {
    Json object = Json::object();
    for (const Reasons& x : list) object[name_of(x.reason)] = x.jobs;
    return object;
  };
  json["failed_reasons"] = reasons(r.failed_reasons);
  json["attempt_reasons"] = reasons(r.attempt_reasons);
  json["failures"] = Json::array();
  for (const auto& f : r.failures) {
    Json one = slicecorr::detail::own_json<Json>(job_json(f.job));
    one["log_tail"] = f.log_lines;
    one["tries"] = Json::array();
    for (const Attempt& a : f.attempts)
      one["tries"].push_back(slicecorr::detail::own_json<Json>(attempt_json(a)));
    json["failures"].push_back(std::move(one));
  }
  json["worst"] = Json::array();
  for (const Job& j : r.worst)
    json["worst"].push_back(slicecorr::detail::own_json<Json>(job_json(j)));
  json["tomographic"] = Json::array();
  for (const Job& j : r.tomographic)
    json["tomographic"].push_back(slicecorr::detail::own_json<Json>(job_json(j)));
  json["jobs"] = Json::array();
  for (const Job& j : r.jobs)
    json["jobs"].push_back(slicecorr::detail::own_json<Json>(job_json(j)));
  json["with_defects"] = r.with_defects;
  json["scanned"] =
      slicecorr::detail::own_json<Json>(prints_over_time_json(r.scanned)).at("prints");
  json["slot_ms"] = r.slot_ms;
  json["slots"] = Json::array();
  for (const auto& s : r.slots) {
    json["slots"].push_back(
        {{"from_ms", s.from_ms}, {"done", s.done}, {"cores_busy", s.cores_busy}});
  }
  json["farm"] = slicecorr::detail::own_json<Json>(overview_json(r.overview));
  return json.dump(2, ' ', false, Json::error_handler_t::replace);
}

}  // namespace slicecorr::farm
