#include "slicecorr/farm/job.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <utility>

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

std::string Job::output(const std::string& ending) const {
  return (std::filesystem::path(output_folder) / (name + "." + ending)).string();
}

}  // namespace slicecorr::farm
