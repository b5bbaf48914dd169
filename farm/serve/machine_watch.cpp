// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/machine_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "serve/studies.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "support/http/guard.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/metrics/exposition.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

using http::ApiError;
using Json = nlohmann::ordered_json;

namespace {

constexpr auto kBetweenLooks = std::chrono::seconds(3);
/// A machine that says nothing twice is told of; once may be chance.
constexpr int kSilentLooks = 2;
/// What could not be sent by itself is tried again after this.
constexpr auto kAfterTrouble = std::chrono::seconds(60);
/// The newest jobs of a machine among which the next one is.
constexpr std::int64_t kMostLookedThrough = 200;

/// Whoever looks does not wait as long as whoever acts.
MachineTimes times_of_looks() {
  MachineTimes times;
  times.answer_s = 3;
  return times;
}

/// What is refused, and what is not known, as answers.
template <class Work>
auto answered(const FarmFolder& folder, Work work) {
  try {
    return work();
  } catch (const InputError& e) {
    throw ApiError(409, "machine", without_folders(e.what(), folder));
  } catch (const DeviceError& e) {
    throw ApiError(503, "machine", without_folders(e.what(), folder));
  }
}

bool said(const Json& body, const char* key) { return slicecorr::detail::flag_in(body, key); }

}  // namespace

MachineWatch::MachineWatch(FarmFolder folder) : folder_(std::move(folder)) {
  thread_ = std::thread([this] { watch(); });
}

MachineWatch::~MachineWatch() {
  {
    const std::scoped_lock lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
  for (auto& [name, sending] : sending_) {
    if (sending.thread.joinable()) sending.thread.join();
  }
}

void MachineWatch::watch() {
  for (;;) {
    read_file();
    look_at_all();
    send_next();
    std::unique_lock lock(mutex_);
    if (changed_.wait_for(lock, kBetweenLooks, [&] { return stopping_.load(); })) return;
  }
}

void MachineWatch::read_file() {
  std::vector<MachineSpec> specs;
  std::string trouble;
  try {
    specs = read_machines(folder_);
  } catch (const Error& e) {
    trouble = e.what();
  }
  std::erase_if(specs, [](const MachineSpec& m) { return m.kind == MachineKind::bridge; });
  const std::scoped_lock lock(mutex_);
  trouble_ = trouble;
  if (!trouble.empty()) return;  // those that were known stay
  std::erase_if(machines_, [&](const auto& known) {
    return std::none_of(specs.begin(), specs.end(),
                        [&](const MachineSpec& m) { return m.name == known.first; });
  });
  for (const MachineSpec& m : specs) {
    const std::string text =
        fmt::format("{} {} {} {} {} {} {} {} {} {}", m.send_when_done, name_of(m.kind), m.host,
                    m.port, m.printer, m.id, m.key_file, m.login, m.user, m.discovery_port);
    Watched& w = machines_[m.name];
    if (w.room && w.spec == text) continue;
    MachineTimes times = times_of_looks();
    times.cancel = &stopping_;
    try {
      w.room = std::make_unique<MachineRoom>(folder_, m, times);
      w.view.record = w.room->record();
    } catch (const Error& e) {
      w.view.status.trouble = text::printable(e.what());
    }
    w.view.machine = m;
    w.spec = text;
  }
}

void MachineWatch::look_at_all() {
  std::vector<Watched*> all;
  {
    const std::scoped_lock lock(mutex_);
    for (auto& [name, w] : machines_) {
      if (w.room) all.push_back(&w);
    }
  }
  // Only this thread takes machines away, so what is pointed to stays.
  std::vector<std::thread> threads;
  threads.reserve(all.size());
  for (Watched* w : all) {
    threads.emplace_back([this, w] {
      MachineView now;
      try {
        now = w->room->look();
      } catch (const Error&) {
        return;  // the server stops
      }
      const bool silent = now.status.state == MachineState::unknown;
      // What is on it is asked for its picture once.
      const std::string what = now.record.file + '/' + now.record.sha256 + '/' +
                               now.record.file_state + '/' +
                               (is_print(now.status.state) ? now.status.file : std::string());
      const bool other = !silent && what != w->picture_of;  // this thread alone writes it
      const std::string picture = other ? w->room->picture(now) : std::string();
      const std::scoped_lock lock(mutex_);
      if (other) {
        w->picture = picture;
        w->picture_of = what;
        ++w->picture_number;
      }
      w->silent = silent ? w->silent + 1 : 0;
      const bool troubled =
          w->silent >= kSilentLooks || (!silent && now.status.state == MachineState::failed);
      tell(*w, now, troubled);
      // What a silent machine said last of its print is still what is known.
      if (silent) now.record = w->view.record;
      w->view = std::move(now);
      w->looked = true;
      w->troubled = troubled;
    });
  }
  for (std::thread& t : threads) t.join();
}

void MachineWatch::send_next() {
  std::vector<std::pair<std::string, const MachineRoom*>> ready;
  {
    const std::scoped_lock lock(mutex_);
    for (const auto& [name, w] : machines_) {
      const auto s = sending_.find(name);
      const bool waits =
          s != sending_.end() &&
          (s->second.running || s->second.not_before > std::chrono::steady_clock::now());
      if (w.view.machine.send_when_done && w.looked && !waits && is_at_rest(w.view.status.state)) {
        ready.emplace_back(name, w.room.get());
      }
    }
  }
  for (const auto& [name, room] : ready) {
    try {
      // As it is on the disk now: a file may have been sent since the last look.
      const MachineRecord r = room->record();
      const bool printed = r.print_file == r.file && !r.print_state.empty() &&
                           r.print_state != "asked" && r.print_state != "begun";
      if (r.file_state == "stored" && !printed) continue;  // what was sent last is printed first
      ReadModel model(folder_.database());
      JobFilter filter;
      filter.label = "for " + name;
      filter.states = {JobState::done};
      filter.order = JobFilter::Order::newest;
      filter.limit = kMostLookedThrough;
      std::optional<Job> next;
      for (const Job& job : model.jobs(filter)) {
        const bool sent =
            std::find(r.sent_jobs.begin(), r.sent_jobs.end(), job.id) != r.sent_jobs.end();
        if (!sent && (!next || job.id < next->id)) next = job;
      }
      if (next) send(name, *next);
    } catch (const std::exception& e) {
      const std::scoped_lock lock(mutex_);
      sending_[name].message = without_folders(text::printable(e.what()), folder_);
      sending_[name].not_before = std::chrono::steady_clock::now() + kAfterTrouble;
    }
  }
}

void MachineWatch::tell(const Watched& before, const MachineView& now, bool troubled) {
  const std::string& name = now.machine.name;
  std::vector<std::pair<std::string, std::string>> events;
  const MachineRecord& was = before.view.record;
  const MachineRecord& is = now.record;
  const bool open = was.print_state == "asked" || was.print_state == "begun";
  if (now.status.state != MachineState::unknown && open && is.print_state != was.print_state) {
    if (is.print_state == "begun") {
      events.emplace_back("machine_began", fmt::format("{} prints {}", name, is.print_file));
    } else if (!is.print_state.empty()) {
      events.emplace_back("machine_ended",
                          fmt::format("{}: the print of {} is {}{}; its plate waits to be cleared",
                                      name, is.print_file, is.print_state,
                                      is.print_why.empty() ? "" : " (" + is.print_why + ")"));
    }
  }
  if (troubled && !before.troubled) {
    events.emplace_back(
        "machine_trouble",
        fmt::format("{}: {}", name, now.status.trouble.empty() ? "failed" : now.status.trouble));
  }
  try {
    if (events.empty()) return;
    Queue queue(folder_.database());
    for (const auto& [kind, text] : events) queue.add_event(kind, text::printable(text));
  } catch (const Error&) {
    // The record is told of by whoever reads it; machines are looked at all the same.
  }
}

MachineSpec MachineWatch::spec_of(const std::string& name) const {
  const std::vector<MachineSpec> specs = answered(folder_, [&] { return read_machines(folder_); });
  for (const MachineSpec& m : specs) {
    if (m.name == name) return m;
  }
  throw ApiError(404, "machine", "there is no machine of this name");
}

Json MachineWatch::json_of(const std::string& name) {
  const Watched& w = machines_.at(name);
  Json json = slicecorr::detail::own_json<Json>(view_json(w.view));
  json["looked"] = w.looked;
  json["picture"] = w.picture.empty() ? 0 : w.picture_number;
  const auto sending = sending_.find(name);
  if (sending != sending_.end()) {
    const Sending& s = sending->second;
    json["sending"] = {{"job", s.job}, {"name", s.name},       {"done", s.done},
                       {"all", s.all}, {"running", s.running}, {"message", s.message}};
  }
  return json;
}

std::string MachineWatch::picture(const std::string& name) {
  const std::scoped_lock lock(mutex_);
  const auto watched = machines_.find(name);
  return watched == machines_.end() ? std::string() : watched->second.picture;
}

Json MachineWatch::list() {
  const std::scoped_lock lock(mutex_);
  Json list = Json::array();
  for (const auto& [name, w] : machines_) list.push_back(json_of(name));
  Json json = {{"machines", list}};
  if (!trouble_.empty()) json["trouble"] = without_folders(trouble_, folder_);
  return json;
}

Json MachineWatch::act(const std::string& name, const std::string& what, const Json& body) {
  const bool known =
      what == "start" || what == "pause" || what == "resume" || what == "stop" || what == "cleared";
  if (!known) {
    throw ApiError(404, "not_found", "expected send, start, pause, resume, stop or cleared");
  }
  const MachineSpec machine = spec_of(name);
  // What printbridge drives is started by its jobs (bridges.hpp), and steered as all others are.
  const bool starts = what == "start" || what == "cleared";
  if (machine.kind == MachineKind::bridge && starts) {
    throw ApiError(404, "machine", "its prints are started by POST /api/v1/jobs/{id}/print");
  }
  return answered(folder_, [&]() -> Json {
    MachineTimes times;
    times.cancel = &stopping_;
    MachineRoom room(folder_, machine, times);
    if (what == "start") room.start({said(body, "plate_is_empty"), said(body, "vat_is_filled")});
    if (what == "pause") room.pause();
    if (what == "resume") room.resume();
    if (what == "stop") room.stop();
    if (what == "cleared") room.cleared();
    MachineView now = room.look();
    const std::scoped_lock lock(mutex_);
    const auto watched = machines_.find(name);
    if (watched != machines_.end()) {
      tell(watched->second, now, watched->second.troubled);
      watched->second.view = now;
    }
    return slicecorr::detail::own_json<Json>(view_json(now));
  });
}

void MachineWatch::send(const std::string& name, const Job& job) {
  const MachineSpec machine = spec_of(name);
  if (machine.kind == MachineKind::bridge) {
    throw ApiError(404, "machine", "its prints are started by POST /api/v1/jobs/{id}/print");
  }
  const std::string path = answered(folder_, [&] { return stack_for(machine, job); });
  const std::scoped_lock lock(mutex_);
  Sending& s = sending_[name];
  if (s.running) throw ApiError(409, "machine", "a file is being sent to it");
  if (s.thread.joinable()) s.thread.join();
  s.job = job.id;
  s.name = job.name;
  s.message.clear();
  s.done = s.all = 0;
  s.running = true;
  s.thread = std::thread([this, machine, path, name, id = job.id] {
    std::string message;
    try {
      MachineTimes times;
      times.cancel = &stopping_;
      MachineRoom room(folder_, machine, times);
      room.send(path, id, [&](std::int64_t done, std::int64_t all) {
        const std::scoped_lock now(mutex_);
        sending_[name].done = done;
        sending_[name].all = all;
      });
    } catch (const std::exception& e) {
      message = without_folders(text::printable(e.what()), folder_);
    }
    const std::scoped_lock now(mutex_);
    sending_[name].running = false;
    sending_[name].message = message;
    if (!message.empty()) {
      sending_[name].not_before = std::chrono::steady_clock::now() + kAfterTrouble;
    }
  });
}

std::string MachineWatch::metrics() {
  const std::scoped_lock lock(mutex_);
  if (machines_.empty()) return {};
  cli::Exposition t("slicefarm_");
  t.begin("machine_state", "gauge", "1 for the state in which a machine was seen last.");
  for (const auto& [name, w] : machines_) {
    t.value(1, {{"machine", name}, {"state", name_of(w.view.status.state)}});
  }
  t.begin("machine_plate_full", "gauge", "1: nothing starts there before it is cleared.");
  for (const auto& [name, w] : machines_) {
    t.value(w.view.record.plate_full, {{"machine", name}});
  }
  t.begin("machine_left_seconds", "gauge", "Until the end of its print; NaN: none, or not said.");
  for (const auto& [name, w] : machines_) {
    t.value(is_print(w.view.status.state) ? w.view.status.left_s.value_or(NAN) : NAN,
            {{"machine", name}});
  }
  return t.text();
}

}  // namespace slicecorr::farm::detail
