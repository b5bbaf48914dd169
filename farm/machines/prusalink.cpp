// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// PrusaLink, with its own calls where the machine has them, else with OctoPrint's; and OctoPrint.

#include <fmt/format.h>

#include "machines/adapters.hpp"
#include "machines/http_calls.hpp"
#include "machines/json_answers.hpp"
#include "slicecorr/error.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

namespace {

class PrusaLink final : public MachineAdapter {
 public:
  PrusaLink(const MachineSpec& machine, const MachineTimes& times)
      : octoprint_(machine.kind == MachineKind::octoprint),
        http_(machine.host, machine.port > 0 ? machine.port : 80, times,
              HttpLogin::of(machine, octoprint_ ? HttpLogin::Kind::key : HttpLogin::Kind::digest)) {
    http_.answer_within(times.listed_s);
  }

  MachineFacts facts() override {
    const Json version = json_of(ask("/api/version"), http_.where());
    MachineFacts facts;
    facts.model = shown_text(version, "text");
    facts.firmware = shown_text(version, "server");
    facts.id = shown_text(version, "hostname");
    return facts;
  }

  MachineStatus status() override { return v1() ? status_v1() : status_legacy(); }

  std::string upload(const MachineFile& file, const UploadProgress& progress) override {
    HttpBody body;
    HttpAnswer answer;
    if (v1()) {
      body.path = file.path;
      body.bytes = file.bytes;
      body.type = "application/octet-stream";
      body.progress = progress;
      answer =
          http_.send_body("PUT", file_path(file.name), body, "/api/version", {{"Overwrite", "?0"}});
    } else {
      body = form_body({{"file", "", file.name}}, &file, 0, file.bytes);
      body.progress = progress;
      answer = http_.send_body("POST", "/api/files/local", body, "/api/version");
    }
    check(answer, "the file");
    // The server may have cleaned the name.
    const Json json = slicecorr::detail::try_json<Json>(answer.body, kAnswerBounds);
    const Json& local = member_of(member_of(json, "files"), "local");
    std::string name = text_in(local, "path");
    if (name.empty()) name = text_in(local, "name");
    if (name.starts_with("local/")) name.erase(0, 6);
    if (name.starts_with('/')) name.erase(0, 1);
    return name.empty() ? file.name : name;
  }

  std::optional<HeldFile> holds(const std::string& name) override {
    const HttpAnswer answer = http_.get(file_path(name));
    if (answer.status == 404) return std::nullopt;
    check(answer, "a list of files");
    const Json json = json_of(answer, http_.where());
    HeldFile held;
    if (const auto size = number_in(json, "size"); size && *size >= 0 && *size < 1e15) {
      held.bytes = static_cast<std::int64_t>(*size);
    }
    return held;
  }

  bool start(const std::string& name) override {
    const HttpAnswer answer = v1() ? http_.send_text("POST", file_path(name), "", kJson)
                                   : http_.send_text("POST", file_path(name),
                                                     R"({"command":"select","print":true})", kJson);
    // "#10506" is busy; other conflicts stay what they are: not calibrated, no room.
    if (answer.status == 409 &&
        (answer.body.find("10506") != answer.body.npos || answer.body.empty())) {
      return false;
    }
    check(answer, "the start");
    return true;
  }
  std::string picture(const MachineStatus& status) override {
    if (status.file.empty()) return {};
    const HttpAnswer job = http_.get(v1() ? "/api/v1/job" : "/api/job");
    if (job.status != 200) return {};
    const Json json = json_of(job, http_.where());
    const Json& file = member_of(v1() ? json : member_of(json, "job"), "file");
    const Json& refs = member_of(file, "refs");
    for (const char* name : {"thumbnail", "thumbnailBig", "thumbnailSmall"}) {
      const std::string path = path_of(text_in(refs, name));
      if (path.empty()) continue;
      const HttpAnswer answer = http_.get(path);
      return answer.ok() ? answer.body : "";
    }
    return {};
  }
  void pause() override { control("pause"); }
  void resume() override { control("resume"); }
  void stop() override { control("cancel"); }

 private:
  static constexpr const char* kJson = "application/json";

  HttpAnswer ask(const std::string& path) {
    HttpAnswer answer = http_.get(path);
    check(answer, path.c_str());
    return answer;
  }
  void check(const HttpAnswer& answer, const char* what) const {
    check_answer(answer, http_.where(), what);
  }

  /// Whether the machine has PrusaLink's own calls, asked once.
  bool v1() {
    if (octoprint_) return false;
    if (!v1_) {
      const Json version = json_of(ask("/api/version"), http_.where());
      v1_ = loose_flag(member_of(version, "capabilities"), "upload-by-put");
    }
    return *v1_;
  }
  std::string file_path(const std::string& name) {
    std::string path = v1() ? "/api/v1/files/local" : "/api/files/local";
    // A folder of the machine's own may be in the name that it gave.
    for (std::size_t at = 0; at <= name.size();) {
      const std::size_t slash = std::min(name.find('/', at), name.size());
      path += "/" + path_segment(name.substr(at, slash - at));
      at = slash + 1;
    }
    return path;
  }

  /// The path of an address, whose host is what the machine believes to be called: it is asked where it
  /// answers. Empty where it is none.
  static std::string path_of(const std::string& address) {
    const std::size_t scheme = address.find("://");
    const std::size_t slash =
        scheme == address.npos ? 0 : std::min(address.find('/', scheme + 3), address.size());
    std::string path;
    for (const char c : address.substr(slash)) {
      // Names with spaces stand in some answers as they are; nothing else leaves the line.
      const bool plain = c > ' ' && c < 0x7F;
      path += plain ? std::string(1, c) : path_segment(std::string(1, c));
    }
    return path.starts_with('/') && path.size() < 1000 ? path : "";
  }

  static void read_times(const Json& from, const char* run, const char* left, MachineStatus& s) {
    if (const auto n = number_in(from, run); n && *n >= 0) s.run_s = *n;
    if (const auto n = number_in(from, left); n && *n >= 0) s.left_s = *n;
  }

  MachineStatus status_v1() {
    const Json json = json_of(ask("/api/v1/status"), http_.where());
    const Json& printer = member_of(json, "printer");
    const Json& job = member_of(json, "job");
    const std::string said = text_in(printer, "state");
    constexpr std::pair<const char*, MachineState> states[] = {
        {"IDLE", MachineState::idle},       {"READY", MachineState::idle},
        {"BUSY", MachineState::busy},       {"PRINTING", MachineState::printing},
        {"PAUSED", MachineState::paused},   {"FINISHED", MachineState::finished},
        {"STOPPED", MachineState::stopped}, {"ERROR", MachineState::failed},
        {"ATTENTION", MachineState::busy}};
    MachineStatus s;
    s.state = MachineState::busy;
    s.phase = "other (" + text::printable(said.substr(0, 40)) + ")";
    for (const auto& [name, state] : states) {
      if (said != name) continue;
      s.state = state;
      s.phase.clear();
    }
    if (said == "ATTENTION") {
      s.trouble = "wants somebody's attention";
      if (job.is_object()) s.state = MachineState::paused;
    }
    if (member_of(json, "transfer").is_object() && is_at_rest(s.state)) {
      s.state = MachineState::uploading;
    }
    if (!job.is_object()) return s;
    if (const auto id = number_in(job, "id")) s.task = fmt::format("{:.0f}", *id);
    read_times(job, "time_printing", "time_remaining", s);
    const HttpAnswer more = http_.get("/api/v1/job");
    if (more.status == 200) {
      const Json now = json_of(more, http_.where());
      s.file = shown_text(member_of(now, "file"), "name");
    }
    return s;
  }

  MachineStatus status_legacy() {
    const HttpAnswer answer = http_.get("/api/printer");
    MachineStatus s;
    if (answer.status == 409) {
      // OctoPrint without a machine behind it.
      s.trouble = "is not connected to its machine";
      return s;
    }
    check(answer, "/api/printer");
    const Json printer = json_of(answer, http_.where());
    const Json& flags = member_of(member_of(printer, "state"), "flags");
    constexpr std::pair<const char*, MachineState> states[] = {
        {"error", MachineState::failed},        {"closedOrError", MachineState::failed},
        {"cancelling", MachineState::stopping}, {"pausing", MachineState::pausing},
        {"resuming", MachineState::resuming},   {"paused", MachineState::paused},
        {"printing", MachineState::printing},   {"finished", MachineState::finished},
        {"busy", MachineState::busy},           {"operational", MachineState::idle},
        {"ready", MachineState::idle}};
    s.state = MachineState::busy;
    s.phase = shown_text(member_of(printer, "state"), "text");
    for (const auto& [name, state] : states) {
      if (!loose_flag(flags, name)) continue;
      s.state = state;
      s.phase.clear();
      break;
    }
    if (s.state == MachineState::failed) {
      s.trouble = shown_text(member_of(printer, "state"), "text");
    }
    const Json job = json_of(ask("/api/job"), http_.where());
    if (!is_print(s.state) && s.state != MachineState::finished) return s;
    const Json& file = member_of(member_of(job, "job"), "file");
    s.file = shown_text(file, "path");
    if (s.file.empty()) s.file = shown_text(file, "name");
    if (s.file.starts_with("local/")) s.file.erase(0, 6);
    if (const auto n = number_in(file, "layers"); n && *n > 0) s.layers = static_cast<int>(*n);
    // `completion` is percent or a share, as the server likes: times say the same.
    read_times(member_of(job, "progress"), "printTime", "printTimeLeft", s);
    return s;
  }

  void control(const std::string& what) {
    if (!v1()) {
      const std::string text = what == "cancel"
                                   ? R"({"command":"cancel"})"
                                   : fmt::format(R"({{"command":"pause","action":"{}"}})", what);
      return check(http_.send_text("POST", "/api/job", text, kJson), what.c_str());
    }
    const std::string task = status_v1().task;
    if (task.empty()) throw InputError(http_.where() + ": prints nothing");
    const std::string path = "/api/v1/job/" + task;
    check(what == "cancel" ? http_.remove(path)
                           : http_.send_text("PUT", path + "/" + what, "", kJson),
          what.c_str());
  }

  bool octoprint_;
  HttpCalls http_;
  std::optional<bool> v1_;
};

}  // namespace

std::unique_ptr<MachineAdapter> make_prusalink(const MachineSpec& machine,
                                               const MachineTimes& times) {
  return std::make_unique<PrusaLink>(machine, times);
}

}  // namespace slicecorr::farm::detail
