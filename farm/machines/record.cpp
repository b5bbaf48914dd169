// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/record.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/files/temporary.hpp"
#include "support/files/text_file.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm {

namespace {

using Json = nlohmann::ordered_json;
using slicecorr::detail::errno_message;

Json object_of(const MachineRecord& r) {
  return {{"version", 1},
          {"file", r.file},
          {"real_name", r.real_name},
          {"sha256", r.sha256},
          {"bytes", r.bytes},
          {"job", r.job},
          {"file_state", r.file_state},
          {"print_file", r.print_file},
          {"print_task", r.print_task},
          {"print_state", r.print_state},
          {"print_why", r.print_why},
          {"last_layer", r.last_layer},
          {"layers", r.layers},
          {"print_asked_ms", r.print_asked_ms},
          {"print_ended_ms", r.print_ended_ms},
          {"sent_jobs", r.sent_jobs},
          {"stop_asked", r.stop_asked},
          {"plate_full", r.plate_full},
          {"plate_why", r.plate_why}};
}

}  // namespace

std::string record_json(const MachineRecord& record) {
  return object_of(record).dump(-1, ' ', false, Json::error_handler_t::replace);
}

namespace detail {

MachineRecord read_record(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return {};
  const auto damaged = [&]() -> DeviceError {
    return DeviceError(path +
                       ": can't be read: what is on the plate is not known; look at the "
                       "machine, then remove this file");
  };
  const auto text = text_of_file(path, 1 << 20);
  if (!text) throw damaged();
  using slicecorr::detail::flag_in, slicecorr::detail::number_in, slicecorr::detail::text_in,
      slicecorr::detail::whole_in;
  const Json json = slicecorr::detail::try_json<Json>(*text, {1 << 20, 4, 5000});
  if (!json.is_object() || whole_in(json, "version", 0) != 1) throw damaged();
  const auto number = [&](const char* key) {
    return static_cast<std::int64_t>(number_in(json, key, 0.0));
  };
  MachineRecord r;
  r.file = text_in(json, "file");
  r.real_name = text_in(json, "real_name");
  r.sha256 = text_in(json, "sha256");
  r.bytes = number("bytes");
  r.job = number("job");
  r.file_state = text_in(json, "file_state");
  r.print_file = text_in(json, "print_file");
  r.print_task = text_in(json, "print_task");
  r.print_state = text_in(json, "print_state");
  r.print_why = text_in(json, "print_why");
  r.last_layer = whole_in(json, "last_layer", 0);
  r.layers = whole_in(json, "layers", 0);
  r.print_asked_ms = number("print_asked_ms");
  r.print_ended_ms = number("print_ended_ms");
  const Json& jobs = slicecorr::detail::member_of(json, "sent_jobs");
  for (const Json& job : jobs.is_array() ? jobs : Json::array()) {
    if (job.is_number_integer()) r.sent_jobs.push_back(job.get<long long>());
  }
  r.stop_asked = flag_in(json, "stop_asked");
  r.plate_full = flag_in(json, "plate_full");
  r.plate_why = text_in(json, "plate_why");
  return r;
}

void write_record(const std::string& path, const MachineRecord& record) {
  slicecorr::detail::Temporary part{slicecorr::detail::make_temporary(path)};
  {
    std::ofstream out(part.path);
    out << object_of(record).dump(1, ' ', false, Json::error_handler_t::replace) << "\n";
    if (!out.flush()) throw DeviceError(errno_message(path, "can't be written"));
  }
  slicecorr::detail::put_in_place(part, path);
}

bool same_file(const std::string& a, const std::string& b) {
  const auto last = [](const std::string& path) { return path.substr(path.rfind('/') + 1); };
  return last(a) == last(b);
}

void follow(MachineRecord& r, const MachineStatus& status, std::int64_t wall_ms,
            const std::function<std::optional<PrintEnd>(const std::string& task)>& ended) {
  if (status.state == MachineState::unknown) return;
  const bool named = !status.file.empty();
  const bool ours = !named || same_file(status.file, r.print_file);
  if (is_print(status.state)) {
    if (r.print_state == "asked" && ours) {
      r.print_state = "begun";
      r.print_task = status.task;
    } else if (r.print_state == "begun" &&
               (!ours ||
                (!r.print_task.empty() && !status.task.empty() && status.task != r.print_task))) {
      r.print_state = "ended";
      r.print_ended_ms = wall_ms;
    }
    if (r.print_state == "begun" && ours) {
      if (r.print_task.empty()) r.print_task = status.task;
      r.last_layer = status.layer.value_or(r.last_layer);
      r.layers = status.layers.value_or(r.layers);
    } else {
      r.plate_full = true;
      r.plate_why = "a print that this farm did not start was seen";
    }
    return;
  }
  const bool over = is_at_rest(status.state) || status.state == MachineState::failed;
  if (r.print_state != "begun" || !over) return;
  MachineState how = status.state;
  r.print_why = how == MachineState::failed ? status.trouble : "";
  if (how == MachineState::idle) {
    if (const auto said = ended(r.print_task)) {
      how = said->state;
      r.print_why = said->why;
    } else if (r.stop_asked) {
      how = MachineState::stopped;
    } else if (r.layers > 0 && r.last_layer >= r.layers) {
      how = MachineState::finished;
    }
  }
  r.print_state = how == MachineState::idle ? "ended" : name_of(how);
  r.print_ended_ms = wall_ms;
  r.plate_why = "a print ended: " + r.print_state;
  if (!r.print_why.empty()) r.plate_why += " (" + r.print_why + ")";
}

ActLock::ActLock(const std::string& path) {
  file_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (file_ < 0) throw DeviceError(errno_message(path, "can't be made"));
  held_ = ::flock(file_, LOCK_EX | LOCK_NB) == 0;
}

ActLock::~ActLock() { ::close(file_); }

}  // namespace detail

}  // namespace slicecorr::farm
