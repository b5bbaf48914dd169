// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/job.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm {

namespace {

constexpr std::array<const char*, kJobStates> kStateNames{"queued", "running", "done", "failed",
                                                          "cancelled"};

struct ReasonRow {
  Reason reason;
  const char* name;
  bool retried, counted;
};
constexpr ReasonRow kReasons[] = {
    {Reason::none, "", false, false},
    {Reason::bad_input, "bad_input", false, true},
    {Reason::infeasible, "infeasible", false, true},
    {Reason::input_gone, "input_gone", false, true},
    {Reason::too_large, "too_large", false, true},
    {Reason::worker_killed, "worker_killed", true, true},
    {Reason::worker_crashed, "worker_crashed", true, true},
    {Reason::hung, "hung", true, true},
    {Reason::lease_lost, "lease_lost", true, false},
    {Reason::stopped, "stopped", true, false},
    {Reason::out_of_memory, "out_of_memory", true, true},
    {Reason::disk_full, "disk_full", true, false},
    {Reason::device_failed, "device_failed", true, true},
    {Reason::output_invalid, "output_invalid", true, true},
    {Reason::engine_failed, "engine_failed", true, true},
    {Reason::cancelled, "cancelled", false, false},
};

const ReasonRow& row_of(Reason reason) {
  return *std::find_if(std::begin(kReasons), std::end(kReasons),
                       [&](const ReasonRow& r) { return r.reason == reason; });
}

}  // namespace

const char* name_of(JobState state) { return kStateNames[static_cast<std::size_t>(state)]; }

std::optional<JobState> job_state_named(std::string_view name) {
  for (std::size_t i = 0; i < kStateNames.size(); ++i) {
    if (name == kStateNames[i]) return static_cast<JobState>(i);
  }
  return std::nullopt;
}

const char* name_of(Reason reason) { return row_of(reason).name; }

Reason reason_named(std::string_view name) {
  for (const ReasonRow& r : kReasons) {
    if (name == r.name) return r.reason;
  }
  return Reason::none;
}

bool is_retried(Reason reason) { return row_of(reason).retried; }
bool is_counted(Reason reason) { return row_of(reason).counted; }

std::string in_words(const ResultFigures& f) {
  if (!f.tomo) {
    std::string text = fmt::format("largest height error {} um", text::figure(f.height_max_um));
    if (f.lost_features > 0) text += fmt::format(", {} lost", text::count(f.lost_features));
    if (f.time) {
      text += f.time->print_s
                  ? fmt::format(", prints in {}", text::duration(*f.time->print_s))
                  : fmt::format(", {} of light, lifts not known", text::duration(f.time->light_s));
    }
    return f.verdict ? fmt::format("{} ({})", f.verdict->words, text) : text;
  }
  const TomoFigures& t = *f.tomo;
  std::string text =
      fmt::format("contrast {}, VER {}, prints in {}",
                  std::isfinite(t.contrast) ? text::figure(t.contrast) : "without bound",
                  text::figure(t.ver), text::duration(t.print_time_s));
  if (!t.feasible) {
    text += t.contrast < 1 ? "; misses: void gels before the part does"
                           : "; misses: not all of the part gels, or some void does, too";
  }
  return text;
}

std::string result_name(const std::string& name, const std::string& ending) {
  return name + (ending.starts_with('-') ? "" : ".") + ending;
}

std::string Job::output(const std::string& ending) const {
  return (std::filesystem::path(output_folder) / result_name(name, ending)).string();
}

std::string in_words(const KeptScan& s) {
  const std::string side = std::abs(s.mean_um) < 0.005 ? "neither too much nor too little"
                           : s.mean_um > 0 ? fmt::format("too much by {:.2f} um", s.mean_um)
                                           : fmt::format("too little by {:.2f} um", -s.mean_um);
  return fmt::format(
      "off by {:.2f} um in the mean ({}), 95 % within {:.2f} um, {:.1f} um at the worst place",
      s.mean_abs_um, side, s.p95_um, s.worst_um);
}

std::string stack_of(const Job& job) {
  if (job.state != JobState::done) {
    throw InputError(
        fmt::format("job {} is {}, expected one that is done", job.id, name_of(job.state)));
  }
  const auto stack = std::find_if(job.files.begin(), job.files.end(), [](const ResultFile& f) {
    return f.ending != "html" && f.ending != "json";
  });
  std::error_code error;
  if (stack == job.files.end() ||
      static_cast<std::int64_t>(std::filesystem::file_size(job.output(stack->ending), error)) !=
          stack->bytes ||
      error) {
    throw InputError(
        fmt::format("job {}: its output was moved or changed since it was done", job.id));
  }
  return job.output(stack->ending);
}

}  // namespace slicecorr::farm
