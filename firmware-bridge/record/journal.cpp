// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <deque>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "slicecorr/bridge/record.hpp"
#include "slicecorr/error.hpp"
#include "support/files/temporary.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::bridge {
namespace {

/// "a/journal.jsonl" -> "a/journal.previous.jsonl".
void keep_previous(const std::string& path) {
  const auto dot = path.rfind('.');
  std::rename(path.c_str(), (path.substr(0, dot) + ".previous" + path.substr(dot)).c_str());
}

int begin_file(const std::string& path) {
  keep_previous(path);
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0644);
  if (file < 0) {
    throw DeviceError(fmt::format("{}: can't be written: {}", path, std::strerror(errno)));
  }
  return file;
}

/// Lines that a thread writes, so that nobody waits for the disk.
class LineWriter {
 public:
  LineWriter(const std::string& path, const std::string& header)
      : path_(path), file_(begin_file(path)) {
    detail::sync_folder(detail::path_parts(path).folder);
    thread_ = std::thread([this] { work(); });
    if (!header.empty()) add(header, false);
  }
  ~LineWriter() {
    {
      const std::scoped_lock lock(mutex_);
      ending_ = true;
    }
    wake_.notify_all();
    thread_.join();
    ::close(file_);
  }
  void add(std::string line, bool important) {
    {
      const std::scoped_lock lock(mutex_);
      lines_.push_back(std::move(line));
      urgent_ = urgent_ || important;
      ++added_;
    }
    if (important) wake_.notify_all();
  }
  void flush() {
    std::unique_lock lock(mutex_);
    const auto all = added_;
    urgent_ = true;
    wake_.notify_all();
    written_.wait(lock, [&] { return done_ >= all; });
  }
  std::string trouble() const {
    const std::scoped_lock lock(mutex_);
    return trouble_;
  }

 private:
  void work() {
    std::unique_lock lock(mutex_);
    while (true) {
      wake_.wait_for(lock, std::chrono::milliseconds(500), [&] { return ending_ || urgent_; });
      std::deque<std::string> lines = std::exchange(lines_, {});
      const auto upto = added_;
      const bool last = ending_;
      urgent_ = false;
      lock.unlock();
      std::string text;
      for (const std::string& line : lines) text += line + "\n";
      std::string trouble;
      for (std::size_t at = 0; at < text.size();) {
        const ssize_t n = ::write(file_, text.data() + at, text.size() - at);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) {
          trouble = std::strerror(errno);
          break;
        }
        at += static_cast<std::size_t>(n);
      }
      if (!text.empty() && ::fdatasync(file_) != 0 && trouble.empty()) {
        trouble = std::strerror(errno);
      }
      lock.lock();
      if (!trouble.empty()) trouble_ = path_ + ": " + trouble;
      done_ = upto;
      written_.notify_all();
      if (last && lines_.empty()) return;
    }
  }

  const std::string path_;
  const int file_;
  mutable std::mutex mutex_;
  std::condition_variable wake_, written_;
  std::deque<std::string> lines_;
  bool urgent_ = false, ending_ = false;
  std::uint64_t added_ = 0, done_ = 0;
  std::string trouble_;
  std::thread thread_;
};

}  // namespace

struct Journal::Impl {
  LineWriter writer;
  double at_s =
      0;  ///< of the last event: time does not go back for what is told of a cycle's begin
  double um_per_deg;
  Impl(const std::string& path, double per_deg) : writer(path, ""), um_per_deg(per_deg) {}
};

std::string utc_now() {
  const auto now =
      std::chrono::time_point_cast<std::chrono::milliseconds>(std::chrono::system_clock::now());
  const auto ms = now.time_since_epoch().count();
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03d}Z",
                     fmt::gmtime(static_cast<std::time_t>(ms / 1000)), ms % 1000);
}

Journal::Journal(const std::string& path, double um_per_deg)
    : impl_(std::make_unique<Impl>(path, um_per_deg)) {}
Journal::~Journal() = default;

void Journal::add(const PrintEvent& event, bool important) {
  nlohmann::ordered_json line;
  line["time"] = utc_now();
  line["at_s"] = impl_->at_s = std::max(impl_->at_s, event.at_s);
  line["what"] = event.what;
  if (!event.detail.empty()) line["detail"] = event.detail;
  line["frame"] = event.frame;
  line["stage_um"] = event.stage_um;
  if (impl_->um_per_deg > 0) line["stage_deg"] = event.stage_um / impl_->um_per_deg;
  using nlohmann::ordered_json;
  if (!event.facts.empty()) {
    line["facts"] = slicecorr::detail::try_json<ordered_json>(event.facts);
  }
  impl_->writer.add(line.dump(-1, ' ', false, ordered_json::error_handler_t::replace), important);
}

void Journal::flush() { impl_->writer.flush(); }
std::string Journal::trouble() const { return impl_->writer.trouble(); }

struct FrameLog::Impl {
  LineWriter writer;
  double start_um;
  bool turns, uv_display;
  Impl(const std::string& path, double start, bool job, bool uv)
      : writer(
            path,
            "frame,planned_z_um,z_um,planned_s,shown_s,late_um,speed_um_s,blue_share,uv_mw_cm2,blue_measured,uv_measured,late,stage_error_um,temperature_c,exposure_s,exposed_s,vblank,missed_vblanks,upload_s,present_s" +
                std::string(job ? ",job_frame,from_deg,to_deg" : "") +
                std::string(uv ? ",uv_shown_s,uv_late_um" : "")),
        start_um(start),
        turns(job),
        uv_display(uv) {}
};

FrameLog::FrameLog(const std::string& path, double start_um, bool turns, bool uv_display)
    : impl_(std::make_unique<Impl>(path, start_um, turns, uv_display)) {}
FrameLog::~FrameLog() = default;
void FrameLog::flush() { impl_->writer.flush(); }
std::string FrameLog::trouble() const { return impl_->writer.trouble(); }

void FrameLog::add(const FrameRecord& r) {
  const auto known = [](const std::optional<double>& value) {
    return value ? fmt::format("{:.6f}", *value) : std::string();
  };
  std::optional<double> uv_late_um;
  if (r.uv_stage_um) uv_late_um = *r.uv_stage_um - r.planned_um;
  const std::string vblank = r.display.vblank < 0 ? "" : std::to_string(r.display.vblank);
  impl_->writer.add(
      fmt::format(
          "{},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.4f},{:.6f},{:.4f},{:.6f},{:.4f},{},{:.4f},{},{},{},{},{},{:.6f},{:.6f}{}{}",
          r.frame, r.planned_um - impl_->start_um, r.stage_um - impl_->start_um, r.planned_s,
          r.shown_s, r.stage_um - r.planned_um, r.speed_um_s, r.blue_share, r.uv_mw_cm2,
          r.blue_measured, r.uv_measured, r.late ? 1 : 0, r.stage_error_um, known(r.temperature_c),
          known(r.exposure_s), known(r.exposed_s), vblank, r.display.missed_vblanks,
          r.display.upload_s, r.display.present_s,
          impl_->turns ? fmt::format(",{},{},{}", r.job_frame, known(r.from_deg), known(r.to_deg))
                       : std::string(),
          impl_->uv_display ? fmt::format(",{},{}", known(r.uv_shown_s), known(uv_late_um))
                            : std::string()),
      false);
}

}  // namespace slicecorr::bridge
