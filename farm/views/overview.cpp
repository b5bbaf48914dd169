// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "slicecorr/farm/status.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::vector<DiskState> disk_states(const FarmFolder& folder) {
  std::vector<DiskState> disks;
  std::vector<dev_t> seen;
  for (const auto& [what, path] :
       {std::pair{"farm", folder.root}, std::pair{"store", folder.store}}) {
    struct stat place {};
    if (::stat(path.c_str(), &place) == 0) {
      if (std::find(seen.begin(), seen.end(), place.st_dev) != seen.end()) continue;
      seen.push_back(place.st_dev);
    }
    DiskState disk{what, path};
    struct statvfs s {};
    if (::statvfs(path.c_str(), &s) == 0) {
      disk.free_bytes =
          static_cast<std::int64_t>(s.f_bavail) * static_cast<std::int64_t>(s.f_frsize);
      disk.total_bytes =
          static_cast<std::int64_t>(s.f_blocks) * static_cast<std::int64_t>(s.f_frsize);
    }
    disks.push_back(std::move(disk));
  }
  return disks;
}

Overview read_overview(ReadModel& model, const FarmFolder& folder, const FarmClock& clock) {
  Overview o;
  {
    const ReadModel::Snapshot snapshot(model);
    o.now_ms = clock.wall_ms();
    o.summary = model.summary();
    o.settings = model.settings();
    o.services = model.services();
    o.running = model.running();
  }
  std::erase_if(o.services, [](const Service& s) { return !s.alive; });
  o.disks = disk_states(folder);
  return o;
}

std::string what_holds(const Overview& o) {
  if (o.settings.draining) return "draining";
  if (o.settings.paused) return "paused";
  if (!in_night_window(o.settings, local_minute(o.now_ms))) return "outside the night window";
  for (const DiskState& d : o.disks) {
    if (d.free_bytes >= 0 && d.free_bytes < o.settings.min_free_mb << 20) return "disk full";
  }
  return o.services.empty() ? "no service is running" : "";
}

std::string overview_json(const Overview& o) {
  Json json = slicecorr::detail::own_json<Json>(summary_json(o.summary, o.settings, o.services));
  json["now_ms"] = o.now_ms;
  json["holds"] = what_holds(o);
  json["running"] = Json::array();
  for (const RunningJob& r : o.running) {
    Json job = slicecorr::detail::own_json<Json>(job_json(r.job));
    job["attempt"] = slicecorr::detail::own_json<Json>(attempt_json(r.attempt));
    job["seconds"] = r.seconds;
    job["layers_per_s"] = r.layers_per_s;
    job["eta_s"] = r.eta_s >= 0 ? Json(r.eta_s) : Json(nullptr);
    json["running"].push_back(std::move(job));
  }
  json["disks"] = Json::array();
  for (const DiskState& d : o.disks) {
    json["disks"].push_back({{"what", d.what},
                             {"path", d.path},
                             {"free_bytes", d.free_bytes},
                             {"total_bytes", d.total_bytes}});
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string log_tail(const FarmFolder& folder, const Attempt& attempt, std::int64_t most_bytes) {
  // Where a log is follows from the attempt; the path in the record is not asked, so that nothing
  // else can ever be read through it.
  if (attempt.token.find_first_not_of("0123456789abcdef") != std::string::npos) return {};
  for (const std::string& path :
       {folder.log(attempt.job, attempt.number), folder.attempt(attempt.token) + "/log.txt"}) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) continue;
    struct stat s {};
    std::string text;
    if (::fstat(file, &s) == 0 && S_ISREG(s.st_mode)) {
      const std::int64_t from = std::max<std::int64_t>(0, s.st_size - most_bytes);
      text.resize(static_cast<std::size_t>(s.st_size - from));
      const ssize_t n = ::pread(file, text.data(), text.size(), from);
      text.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
      // What is cut off begins in the middle of a line; a line that is all there is stays.
      if (const std::size_t next = text.find('\n') + 1; from > 0 && next < text.size()) {
        text.erase(0, next);
      }
    }
    ::close(file);
    if (!text.empty()) return text;
  }
  return {};
}

}  // namespace slicecorr::farm
