// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// NanoDLP: pages and JSON over HTTP, states changed by GET, a cookie where there is a password.

#include <fmt/format.h>

#include <algorithm>

#include "machines/adapters.hpp"
#include "machines/json_answers.hpp"
#include "slicecorr/error.hpp"
#include "support/http/guard.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

namespace {

class NanoDlp final : public MachineAdapter {
 public:
  NanoDlp(const MachineSpec& machine, const MachineTimes& times)
      : profile_(machine.profile),
        user_(machine.user.empty() ? "admin" : machine.user),
        http_(machine.host, machine.port > 0 ? machine.port : 80, times) {
    if (!machine.key_file.empty()) password_ = http::read_token_file(machine.key_file, 1);
    http_.answer_within(times.listed_s);
  }

  MachineFacts facts() override {
    const Json status = ask("/status");
    MachineFacts facts;
    facts.model = "NanoDLP";
    facts.firmware = shown_text(status, "Build");
    facts.id = shown_text(status, "Hostname");
    return facts;
  }

  MachineStatus status() override {
    const Json json = ask("/status");
    MachineStatus s;
    const auto state = number_in(json, "State");
    const bool prints = loose_flag(json, "Printing") || (state && *state != 0);
    if (!state && !member_of(json, "Printing").is_boolean() &&
        !member_of(json, "Printing").is_number()) {
      throw DeviceError(http_.where() + ": says nothing of its state");
    }
    if (loose_flag(json, "Panicked")) s.trouble = "the last print had a fault";
    if (loose_flag(json, "Halted")) s.trouble = "halts; a forced stop on its own page ends it";
    if (!prints) {
      s.state = MachineState::idle;
      return s;
    }
    const int number = state ? static_cast<int>(*state) : 5;
    s.state = loose_flag(json, "Paused") || number == 3 ? MachineState::paused
              : number == 2                             ? MachineState::pausing
              : number == 4                             ? MachineState::stopping
                                                        : MachineState::printing;
    if (number > 5) s.phase = fmt::format("other ({})", number);
    const auto layer = number_in(json, "LayerID"), layers = number_in(json, "LayersCount");
    if (layer && *layer >= 0) s.layer = static_cast<int>(std::min(*layer, 2e9));
    if (layers && *layers > 0) s.layers = static_cast<int>(std::min(*layers, 2e9));
    const auto layer_ns = number_in(json, "LayerTime");
    if (layer && layers && layer_ns && *layers >= *layer && *layer_ns >= 0) {
      s.left_s = (*layers - *layer) * *layer_ns / 1e9;
    }
    s.file = shown_text(json, "Path");
    return s;
  }

  std::string upload(const MachineFile& file, const UploadProgress& progress) override {
    HttpBody body = form_body(
        {{"Path", file.name, ""}, {"ProfileID", profile(), ""}, {"ZipFile", "", file.name}}, &file,
        0, file.bytes);
    body.progress = progress;
    // Logged in before the long body goes.
    static_cast<void>(ask("/status"));
    taken(http_.send_body("POST", "/plate/add", body), "the file");
    return file.name;
  }

  std::optional<HeldFile> holds(const std::string& name) override {
    return plate(name).empty() ? std::nullopt : std::optional(HeldFile{});
  }
  bool lists_late() const override { return true; }

  bool start(const std::string& name) override {
    const std::string id = plate(name);
    if (id.empty()) throw InputError(http_.where() + ": lists no plate of this name");
    taken(http_.get("/printer/start/" + id), "the start");
    return true;
  }
  void pause() override { taken(http_.get("/printer/pause"), "the pause"); }
  // `resume` takes up an aborted plate; what goes on with a paused print is `unpause`.
  void resume() override { taken(http_.get("/printer/unpause"), "going on"); }
  void stop() override { taken(http_.get("/printer/stop"), "the stop"); }

 private:
  static bool wants_login(const HttpAnswer& answer) {
    return answer.status == 401 || (answer.status >= 300 && answer.status < 400 &&
                                    answer.location.find("login") != answer.location.npos);
  }

  void log_in() {
    if (password_.empty() || tried_) {
      throw InputError(http_.where() + ": wants a password, " +
                       (password_.empty() ? "expected key_file in machines.toml"
                                          : "and does not take the one of key_file"));
    }
    tried_ = true;
    const HttpAnswer answer =
        http_.send_text("POST", "/login",
                        "username=" + path_segment(user_) + "&password=" + path_segment(password_),
                        "application/x-www-form-urlencoded");
    if (!answer.cookie.empty()) http_.set_cookie(answer.cookie);
  }

  HttpAnswer get(const std::string& path) {
    HttpAnswer answer = http_.get(path);
    if (!wants_login(answer)) return answer;
    log_in();
    answer = http_.get(path);
    if (wants_login(answer)) log_in();  // says why
    tried_ = false;
    return answer;
  }
  Json ask(const std::string& path) {
    const HttpAnswer answer = get(path);
    check_answer(answer, http_.where(), path);
    return json_of(answer, http_.where());
  }
  /// 200 and 302 both mean that it was taken; not what leads to the login.
  void taken(const HttpAnswer& answer, const char* what) const {
    if (wants_login(answer)) throw InputError(http_.where() + ": wants a password");
    if (answer.status != 302 && answer.status != 303) check_answer(answer, http_.where(), what);
  }

  std::string profile() {
    if (!profile_.empty()) return profile_;
    const Json list = ask("/json/db/profiles.json");
    std::string names, only;
    for (const Json& p : list) {
      const auto id = number_in(p, "ProfileID");
      if (!id) continue;
      only = fmt::format("{:.0f}", *id);
      names += (names.empty() ? "" : ", ") + only + " (" + shown_text(p, "Title") + ")";
    }
    if (names.empty()) throw InputError(http_.where() + ": has no resin profile to print with");
    if (names.find(", ") != names.npos) {
      throw InputError(http_.where() +
                       ": has several resin profiles, expected profile in machines.toml: one of " +
                       text::clipped(names, 300));
    }
    return only;
  }

  /// Number of the plate that is listed with its layers; empty: none.
  std::string plate(const std::string& name) {
    const Json list = ask("/plates/list/json");
    for (const Json& p : list) {
      const auto id = number_in(p, "PlateID");
      if (text_in(p, "Path") != name || !id || number_in(p, "LayersCount", 0) < 1) continue;
      return fmt::format("{:.0f}", *id);
    }
    return {};
  }

  std::string profile_, user_, password_;
  bool tried_ = false;
  HttpCalls http_;
};

}  // namespace

std::unique_ptr<MachineAdapter> make_nanodlp(const MachineSpec& machine,
                                             const MachineTimes& times) {
  return std::make_unique<NanoDlp>(machine, times);
}

}  // namespace slicecorr::farm::detail
