// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/metrics.hpp"

#include <cmath>

#include "slicecorr/farm/scans.hpp"
#include "slicecorr/version.hpp"
#include "support/metrics/exposition.hpp"

namespace slicecorr::farm {

namespace {

constexpr double kBytesPerMb = 1 << 20;

/// Of each printer and resin what its last print that was scanned says.
void add_scans(const std::vector<PrintsOverTime>& all, cli::Exposition& t) {
  const auto each = [&](const char* name, const char* what, auto value) {
    t.begin(name, "gauge", what);
    for (const PrintsOverTime& p : all) {
      t.value(value(p), {{"printer", p.printer}, {"resin", p.resin}});
    }
  };
  each("scans", "Scans of prints that are kept.",
       [](const PrintsOverTime& p) { return static_cast<double>(p.scans.size()); });
  each("scan_mean_um", "Mean deviation of the last print that was scanned; above 0: too much.",
       [](const PrintsOverTime& p) { return p.scans.back().mean_um; });
  each("scan_mean_abs_um", "Mean absolute deviation of the last print that was scanned.",
       [](const PrintsOverTime& p) { return p.scans.back().mean_abs_um; });
  each("scan_beyond", "1: the last print that was scanned lies beyond the band of those before.",
       [](const PrintsOverTime& p) { return beyond_in_words(p).empty() ? 0.0 : 1.0; });
}

}  // namespace

std::string metrics_text(ReadModel& model, const FarmFolder& folder, const FarmClock& clock) {
  const Overview o = read_overview(model, folder, clock);
  const std::vector<Reasons> failures = model.failures();
  const std::vector<AttemptTotals> totals = model.attempt_totals();
  const Summary& s = o.summary;
  cli::Exposition t("slicefarm_");
  t.begin("build_info", "gauge", "Version of the program.");
  t.value(1, {{"version", version}});
  t.begin("jobs", "gauge", "Jobs by state.");
  for (int i = 0; i < kJobStates; ++i) {
    t.value(static_cast<double>(s.jobs[static_cast<std::size_t>(i)]),
            {{"state", name_of(static_cast<JobState>(i))}});
  }
  t.one("jobs_following", "gauge", "Queued jobs that wait for another one with the same work.",
        static_cast<double>(s.followers));
  t.one("jobs_from_cache", "gauge", "Jobs done without work of their own.",
        static_cast<double>(s.from_cache));
  t.one("jobs_late", "gauge", "Unfinished jobs that will miss the time they were asked for.",
        static_cast<double>(s.late));
  t.begin("jobs_failed", "gauge", "Failed jobs by reason.");
  for (const Reasons& r : failures) {
    t.value(static_cast<double>(r.jobs), {{"reason", name_of(r.reason)}});
  }
  t.begin("attempts_total", "counter", "Attempts that ended; reason ok: with a result.");
  const auto each = [&](auto value) {
    for (const AttemptTotals& a : totals) {
      t.value(value(a), {{"engine", a.engine},
                         {"reason", a.reason == Reason::none ? "ok" : name_of(a.reason)}});
    }
  };
  each([](const AttemptTotals& a) { return static_cast<double>(a.attempts); });
  t.begin("attempt_seconds_total", "counter", "Time that ended attempts took.");
  each([](const AttemptTotals& a) { return a.wall_s; });
  t.begin("attempt_cpu_seconds_total", "counter", "Processor time that ended attempts took.");
  each([](const AttemptTotals& a) { return a.cpu_s; });
  t.one("events_total", "counter", "Lines of the record of events.",
        static_cast<double>(s.last_event));
  t.one("work_left_core_seconds", "gauge", "Work of queued and running jobs on one core.",
        s.queued_s);
  t.one("work_left_seconds", "gauge",
        "Until the queue is empty at the present pace; NaN: not known.",
        s.eta_s >= 0 ? s.eta_s : std::nan(""));
  t.one("running_threads", "gauge", "Threads of running jobs.", s.running_threads);
  t.one("running_memory_bytes", "gauge", "Memory that running jobs may take.",
        kBytesPerMb * static_cast<double>(s.running_memory_mb));
  t.one("cache_results", "gauge", "Results in the cache.", static_cast<double>(s.cache_entries));
  t.one("cache_bytes", "gauge", "Size of the results in the cache.",
        static_cast<double>(s.cache_bytes));
  t.begin("disk_free_bytes", "gauge", "Free room where the farm and its store are.");
  for (const DiskState& d : o.disks) {
    t.value(static_cast<double>(d.free_bytes), {{"disk", d.what}});
  }
  t.one("disk_needed_bytes", "gauge", "Nothing starts when a disk has less free room.",
        kBytesPerMb * static_cast<double>(o.settings.min_free_mb));
  t.begin("service_cores", "gauge", "Cores of each service that is alive.");
  for (const Service& v : o.services) {
    t.value(v.cores, {{"service", v.id}, {"engine", v.engine}, {"host", v.host}});
  }
  t.one("services", "gauge", "Services that are alive.", static_cast<double>(o.services.size()));
  t.one("paused", "gauge", "1: nothing starts, what runs goes on.", o.settings.paused);
  t.one("draining", "gauge", "1: nothing starts, services end when nothing runs.",
        o.settings.draining);
  t.one("night_window_open", "gauge", "1: jobs may start at this time of day.",
        in_night_window(o.settings, local_minute(o.now_ms)));
  add_scans(prints_over_time(model), t);
  return t.text();
}

}  // namespace slicecorr::farm
