// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is done to a machine, and what is looked at and written down before and after.

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "machines/record.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/machines.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/stack_preview.hpp"
#include "support/files/lasting_folder.hpp"
#include "support/files/temporary.hpp"
#include "support/json/read_json.hpp"
#include "support/text/ascii.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Steady = std::chrono::steady_clock;

namespace {

std::string joined(const std::vector<std::string>& list) {
  std::string text;
  for (const std::string& each : list) text += (text.empty() ? "" : ", ") + each;
  return text;
}

std::string ending_of(const std::string& path) {
  const std::string ending = lower_case(fs::path(path).extension().string());
  return ending.empty() ? ending : ending.substr(1);
}

}  // namespace

struct MachineRoom::Parts {
  Parts(const FarmFolder& farm, MachineSpec given, MachineTimes wanted,
        std::unique_ptr<MachineAdapter> with)
      : machine(std::move(given)), times(wanted), adapter(std::move(with)) {
    const std::string folder = farm.root + "/machines";
    slicecorr::detail::make_lasting_folder(folder);
    path = folder + "/" + machine.name + ".json";
    lock_path = folder + "/" + machine.name + ".lock";
    picture_path = folder + "/" + machine.name + ".png";
  }

  MachineAdapter& ask() {
    if (!adapter) adapter = make_adapter(machine, times);
    return *adapter;
  }

  /// The right to act, for one act. Who only looks has it for a moment, which is waited for.
  std::unique_ptr<detail::ActLock> act() const {
    const auto until = Steady::now() + std::chrono::duration<double>(times.answer_s);
    for (;;) {
      auto lock = std::make_unique<detail::ActLock>(lock_path);
      if (lock->held()) return lock;
      if (Steady::now() >= until) {
        throw InputError(machine.name + ": something else is being done to it now");
      }
      pause_s(0.05);
    }
  }

  void pause_s(double seconds) const {
    const auto until = Steady::now() + std::chrono::duration<double>(seconds);
    do {
      if (times.cancel && *times.cancel) throw Cancelled();
      const double left = std::chrono::duration<double>(until - Steady::now()).count();
      if (left <= 0) return;
      ::poll(nullptr, 0, std::clamp(static_cast<int>(left * 1000) + 1, 1, 50));
    } while (true);
  }

  /// Asks the machine and writes down what follows for its print. Throws as the adapter.
  MachineStatus status_now(MachineRecord& record) {
    MachineStatus status = ask().status();
    const std::string before = record_json(record);
    detail::follow(record, status, system_clock().wall_ms(), [&](const std::string& task) {
      try {
        return ask().ended(task);
      } catch (const DeviceError&) {
        return std::optional<PrintEnd>();
      }
    });
    if (record_json(record) != before) detail::write_record(path, record);
    return status;
  }

  /// Looks until something holds; false when it does not in time. Answers that fail to come are
  /// waited for, too.
  template <class Holds>
  bool shows(MachineRecord& record, double most_s, Holds holds) {
    const auto until = Steady::now() + std::chrono::duration<double>(most_s);
    for (;;) {
      try {
        if (holds(status_now(record))) return true;
      } catch (const DeviceError&) {
        // The connection may come back in time.
      }
      if (Steady::now() >= until) return false;
      pause_s(times.look_s);
    }
  }

  MachineStatus at_rest(MachineRecord& record) {
    MachineStatus status = status_now(record);
    if (!is_at_rest(status.state)) {
      throw InputError(fmt::format("{}: is {}{}, expected a machine at rest", machine.name,
                                   name_of(status.state),
                                   status.phase.empty() ? "" : " (" + status.phase + ")"));
    }
    return status;
  }

  /// Keeps the picture in the file that was sent; none where it has none.
  void keep_picture(const std::string& sent) const;
  void wait_until_listed(MachineRecord& record, const std::string& name, std::int64_t bytes);
  void ask_for_print(MachineRecord& record);

  template <class Act, class Holds>
  void steer(const char* what, Act act_now, Holds holds) {
    MachineRecord record = detail::read_record(path);
    const MachineStatus before = status_now(record);
    if (!is_print(before.state)) throw InputError(machine.name + ": prints nothing");
    act_now(record);
    if (!shows(record, times.shown_s, holds)) {
      throw DeviceError(fmt::format("{}: took the word to {}, but does not show it; look at it",
                                    machine.name, what));
    }
  }

  MachineSpec machine;
  MachineTimes times;
  std::unique_ptr<MachineAdapter> adapter;
  std::string path, lock_path, picture_path;
};

MachineRoom::MachineRoom(const FarmFolder& folder, MachineSpec machine, MachineTimes times,
                         std::unique_ptr<MachineAdapter> adapter)
    : parts_(std::make_unique<Parts>(folder, std::move(machine), times, std::move(adapter))) {}
MachineRoom::~MachineRoom() = default;

MachineRecord MachineRoom::record() const { return detail::read_record(parts_->path); }

MachineFacts MachineRoom::facts() { return parts_->ask().facts(); }

MachineView MachineRoom::look() {
  Parts& p = *parts_;
  MachineView view;
  view.machine = p.machine;
  try {
    // Without the right to act what was seen is not written down: whoever acts does that.
    const detail::ActLock lock(p.lock_path);
    view.record = record();
    if (lock.held()) {
      view.status = p.status_now(view.record);
    } else if (p.ask().one_asker()) {
      view.status.state = MachineState::busy;
      view.status.phase = "something is being done to it";
    } else {
      view.status = p.ask().status();
    }
  } catch (const Cancelled&) {
    throw;
  } catch (const Error& e) {
    view.status = {};
    view.status.trouble = text::printable(e.what());
  }
  return view;
}

MachineCheck MachineRoom::check(const std::string& path) {
  Parts& p = *parts_;
  MachineCheck result;
  std::optional<StackInfo> info;
  try {
    info = StackReader::read_info(path);
  } catch (const InputError& e) {
    result.against.emplace_back(e.what());
  }
  const MachineFacts facts = p.ask().facts();
  const bool it_says = p.machine.format.empty() && !facts.formats.empty();
  const std::vector<std::string> formats = it_says ? facts.formats : formats_read_by(p.machine);
  const std::string ending = ending_of(path);
  if (formats.empty()) {
    result.unchecked.emplace_back("which files it reads: neither it nor machines.toml says so");
  } else if (std::find(formats.begin(), formats.end(), ending) == formats.end()) {
    result.against.push_back(fmt::format("the file ends in .{}, the machine reads {}",
                                         text::printable(ending), joined(formats)));
  }
  const bool said = p.machine.width_px > 0;
  const int width = said ? p.machine.width_px : facts.width_px;
  const int height = said ? p.machine.height_px : facts.height_px;
  if (width == 0) {
    result.unchecked.emplace_back(
        "the resolution: neither it nor machines.toml says so (resolution_px)");
  } else if (info && (info->grid.width_px != width || info->grid.height_px != height)) {
    result.against.push_back(fmt::format("the file has {} x {} pixels, the machine {} x {}",
                                         info->grid.width_px, info->grid.height_px, width, height));
  }
  if (!p.machine.id.empty() && !facts.id.empty() && facts.id != p.machine.id &&
      p.machine.kind == MachineKind::sdcp3) {
    result.against.push_back("another machine answers at this address: " + facts.id);
  }
  MachineRecord record = detail::read_record(p.path);
  const MachineStatus status = p.ask().status();
  if (!is_at_rest(status.state)) {
    result.against.push_back(std::string("the machine is ") + name_of(status.state));
  }
  return result;
}

void MachineRoom::Parts::wait_until_listed(MachineRecord& record, const std::string& name,
                                           std::int64_t bytes) {
  const double most_s =
      times.check_s + static_cast<double>(bytes) / 1e7 + (ask().lists_late() ? times.listed_s : 0);
  const double settle_s = ask().lists_late() ? times.listed_s : times.settle_s;
  const auto begin = Steady::now();
  auto rests_since = begin;
  std::string trouble;
  for (;;) {
    const auto now = Steady::now();
    try {
      const MachineStatus status = status_now(record);
      trouble = status.trouble;
      if (!is_at_rest(status.state)) {
        rests_since = now;
      } else if (const auto held = ask().holds(name)) {
        if (held->bytes < 0 || held->bytes == bytes) return;
        throw InputError(fmt::format("{}: lists the file with {} bytes of {}", machine.name,
                                     held->bytes, bytes));
      }
    } catch (const DeviceError&) {
      // Boards fall silent while they check; a connection may come back.
    }
    const auto seconds = [&](Steady::time_point since) {
      return std::chrono::duration<double>(now - since).count();
    };
    if (seconds(rests_since) > settle_s) {
      throw InputError(machine.name +
                       ": took the whole file, then dropped it: it does not list it" +
                       (trouble.empty() ? "" : "; it says: " + trouble));
    }
    if (seconds(begin) > most_s) {
      throw DeviceError(machine.name + ": did not finish checking the file in time");
    }
    pause_s(times.look_s);
  }
}

void MachineRoom::Parts::keep_picture(const std::string& sent) const {
  // Pictures are for people: what goes wrong with one spoils nothing.
  try {
    const std::vector<std::uint8_t> png = preview_png(sent);
    slicecorr::detail::Temporary part{slicecorr::detail::make_temporary(picture_path)};
    std::ofstream file(part.path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
    file.close();
    if (!file) throw DeviceError(picture_path + ": can't be written");
    slicecorr::detail::put_in_place(part, picture_path);
  } catch (const std::exception&) {
    std::error_code error;
    fs::remove(picture_path, error);
  }
}

std::string MachineRoom::picture(const MachineView& seen) {
  Parts& p = *parts_;
  const MachineRecord& record = seen.record;
  const std::string& prints = seen.status.file;
  const bool others = is_print(seen.status.state) && !prints.empty() &&
                      !detail::same_file(prints, record.file) &&
                      !detail::same_file(prints, record.print_file);
  std::string text;
  if (others) {
    try {
      text = p.ask().picture(seen.status);
    } catch (const Error&) {
      return {};
    }
  } else if (!record.file.empty()) {
    std::ifstream file(p.picture_path, std::ios::binary);
    text.resize(kMostPreviewBytes + 1);
    file.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(std::max<std::streamsize>(file.gcount(), 0)));
  }
  return is_preview_png({text.begin(), text.end()}) ? text : "";
}

std::string MachineRoom::send(const std::string& path, long long job,
                              const UploadProgress& progress) {
  Parts& p = *parts_;
  const auto lock = p.act();
  MachineRecord record = detail::read_record(p.path);
  MachineFile file = machine_file(path);
  const MachineCheck found = check(path);
  if (!found.against.empty()) {
    throw InputError(p.machine.name + ": " + joined(found.against) + "; nothing was sent");
  }
  constexpr int most_names = 10;
  for (int again = 0; p.ask().holds(file.name); ++again) {
    if (record.file == file.name && record.sha256 == file.sha256 && record.file_state == "stored") {
      return file.name;  // the same file, whole, sent before
    }
    // Whatever lies there is not known to be whole, and is not ours to replace.
    if (again == most_names) {
      throw InputError(p.machine.name + ": has too many files called as " + file.name);
    }
    file.name = sent_name(file.real_name, file.sha256, again + 1);
  }
  record.file = file.name;
  record.real_name = file.real_name;
  record.sha256 = file.sha256;
  record.bytes = file.bytes;
  record.job = job;
  record.file_state = "uploading";
  p.keep_picture(path);
  detail::write_record(p.path, record);
  try {
    record.file = p.ask().upload(file, progress);
    p.wait_until_listed(record, record.file, file.bytes);
  } catch (...) {
    record.file_state = "broken";
    detail::write_record(p.path, record);
    throw;
  }
  record.file_state = "stored";
  constexpr std::size_t most_jobs = 1000;
  if (job > 0) record.sent_jobs.push_back(job);
  if (record.sent_jobs.size() > most_jobs) record.sent_jobs.erase(record.sent_jobs.begin());
  detail::write_record(p.path, record);
  return record.file;
}

void MachineRoom::Parts::ask_for_print(MachineRecord& record) {
  const auto until = Steady::now() + std::chrono::duration<double>(times.busy_s);
  while (!ask().start(record.print_file)) {
    if (Steady::now() >= until)
      throw InputError(machine.name + ": stays busy; nothing was started");
    pause_s(times.look_s);
  }
}

void MachineRoom::start(const StartWords& words) {
  Parts& p = *parts_;
  const auto lock = p.act();
  if (!words.plate_is_empty || !words.vat_is_filled) {
    throw InputError(p.machine.name +
                     ": nothing was started: expected somebody's word that the plate is empty and "
                     "the vat is filled");
  }
  MachineRecord record = detail::read_record(p.path);
  if (record.file_state != "stored") {
    throw InputError(p.machine.name + ": has no whole file of this farm; send one before");
  }
  p.at_rest(record);
  if (record.plate_full) {
    throw InputError(p.machine.name + ": its plate is full (" + record.plate_why +
                     "); look at it, then say that it is cleared");
  }
  if (!p.ask().holds(record.file)) {
    record.file_state = "broken";
    detail::write_record(p.path, record);
    throw InputError(p.machine.name + ": lists the file " + record.file + " no longer");
  }
  const MachineRecord before = record;
  record.print_file = record.file;
  record.print_task.clear();
  record.print_state = "asked";
  record.print_why.clear();
  record.last_layer = record.layers = 0;
  record.print_asked_ms = system_clock().wall_ms();
  record.print_ended_ms = 0;
  record.stop_asked = false;
  record.plate_full = true;
  record.plate_why = "a print was asked for";
  // Before the word goes out: whatever breaks from here on, no second one follows by itself.
  detail::write_record(p.path, record);
  std::string lost;
  try {
    p.ask_for_print(record);
  } catch (const InputError&) {
    detail::write_record(p.path, before);  // the machine said that nothing began
    throw;
  } catch (const DeviceError& e) {
    lost = e.what();
  }
  const bool shown = p.shows(record, p.times.shown_s,
                             [&](const MachineStatus&) { return record.print_state != "asked"; });
  if (!shown) {
    throw DeviceError(fmt::format(
        "{}: whether the print began is not known ({}); nothing is started again before somebody "
        "has looked and said that the plate is cleared",
        p.machine.name, lost.empty() ? "it took the word and does not show it" : lost));
  }
}

void MachineRoom::pause() {
  Parts& p = *parts_;
  const auto lock = p.act();
  p.steer(
      "pause", [&](MachineRecord&) { p.ask().pause(); },
      [](const MachineStatus& s) {
        return s.state == MachineState::pausing || s.state == MachineState::paused;
      });
}

void MachineRoom::resume() {
  Parts& p = *parts_;
  const auto lock = p.act();
  p.steer(
      "go on", [&](MachineRecord&) { p.ask().resume(); },
      [](const MachineStatus& s) {
        return s.state == MachineState::printing || s.state == MachineState::resuming;
      });
}

void MachineRoom::stop() {
  Parts& p = *parts_;
  // Whatever else is being done to it: a stop does not wait.
  const detail::ActLock lock(p.lock_path);
  p.steer(
      "stop",
      [&](MachineRecord& record) {
        record.stop_asked = true;
        if (lock.held()) detail::write_record(p.path, record);
        p.ask().stop();
      },
      [](const MachineStatus& s) {
        return s.state == MachineState::stopping || !is_print(s.state);
      });
}

void MachineRoom::cleared() {
  Parts& p = *parts_;
  const auto lock = p.act();
  MachineRecord record = detail::read_record(p.path);
  try {
    const MachineStatus status = p.status_now(record);
    if (is_print(status.state)) {
      throw InputError(p.machine.name + ": is " + name_of(status.state) +
                       ", so its plate can't be empty");
    }
  } catch (const DeviceError&) {
    // Whoever says so has looked; before a start the machine must answer anyway.
  }
  if (record.print_state == "asked" || record.print_state == "begun") {
    record.print_state = "ended";
    record.print_ended_ms = system_clock().wall_ms();
  }
  record.plate_full = false;
  record.plate_why.clear();
  detail::write_record(p.path, record);
}

std::string view_json(const MachineView& view) {
  const MachineStatus& s = view.status;
  const auto number = [](const auto& value) { return value ? Json(*value) : Json(nullptr); };
  Json json = {{"name", view.machine.name},
               {"kind", name_of(view.machine.kind)},
               {"printer", view.machine.printer},
               {"page", view.machine.page},
               {"state", name_of(s.state)},
               {"phase", s.phase},
               {"layer", number(s.layer)},
               {"layers", number(s.layers)},
               {"run_s", number(s.run_s)},
               {"left_s", number(s.left_s)},
               {"file", s.file},
               {"trouble", s.trouble},
               {"record", slicecorr::detail::own_json<Json>(record_json(view.record))}};
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace slicecorr::farm
