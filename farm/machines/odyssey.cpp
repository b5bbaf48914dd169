// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Odyssey: REST, whose answers of 200 say only that a request was read.

#include <fmt/format.h>

#include <algorithm>

#include "machines/adapters.hpp"
#include "machines/json_answers.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::farm::detail {

namespace {

class Odyssey final : public MachineAdapter {
 public:
  Odyssey(const MachineSpec& machine, const MachineTimes& times)
      : http_(machine.host, machine.port > 0 ? machine.port : 12357, times) {
    http_.answer_within(times.listed_s);
  }

  MachineFacts facts() override {
    static_cast<void>(ask("/status"));
    MachineFacts facts;
    facts.model = "Odyssey";
    facts.formats = {"sl1"};
    return facts;
  }

  MachineStatus status() override {
    const Json json = ask("/status");
    const Json& data = member_of(json, "print_data");
    const Json& file = member_of(data, "file_data");
    MachineStatus s;
    const auto layer = number_in(json, "layer"), layers = number_in(data, "layer_count");
    const auto whole = [](double n) { return static_cast<int>(std::clamp(n, 0.0, 2e9)); };
    const std::string said = text_in(json, "status");
    if (said == "Idle") {
      const bool whole_print = layer && layers && *layers > 0 && *layer >= *layers;
      s.state = whole_print ? MachineState::finished : MachineState::idle;
      if (!whole_print) return s;
    } else if (said == "Printing") {
      s.state = loose_flag(json, "paused") ? MachineState::paused : MachineState::printing;
    } else if (said == "Shutdown") {
      s.state = MachineState::failed;
      s.trouble = "shut down: its hardware has a fault";
      return s;
    } else {
      s.state = MachineState::busy;
      s.phase = "other (" + shown_text(json, "status") + ")";
      return s;
    }
    if (layer) s.layer = whole(*layer);
    if (layers) s.layers = whole(*layers);
    s.file = shown_text(file, "name");
    const auto all_s = number_in(data, "print_time");
    if (all_s && layer && layers && *layers > 0 && *all_s >= 0) {
      s.left_s = *all_s * std::clamp(1 - *layer / *layers, 0.0, 1.0);
    }
    return s;
  }

  std::string upload(const MachineFile& file, const UploadProgress& progress) override {
    HttpBody body = form_body({{"file", "", file.name}}, &file, 0, file.bytes);
    body.progress = progress;
    check_answer(http_.send_body("POST", "/files", body), http_.where(), "the file");
    return file.name;
  }

  std::optional<HeldFile> holds(const std::string& name) override {
    constexpr int most_pages = 1000;
    for (int page = 0; page < most_pages; ++page) {
      const Json json =
          ask(fmt::format("/files?location=Local&page_index={}&page_size=100&subdirectory=", page));
      const Json& files = member_of(json, "files");
      if (!files.is_array()) throw DeviceError(http_.where() + ": lists no files");
      for (const Json& each : files) {
        const Json& data = member_of(each, "file_data");
        if (text_in(data, "name") != name) continue;
        HeldFile held;
        if (const auto size = number_in(data, "file_size"); size && *size >= 0 && *size < 1e15) {
          held.bytes = static_cast<std::int64_t>(*size);
        }
        return held;
      }
      if (!member_of(json, "next_index").is_number()) break;
    }
    return std::nullopt;
  }

  bool start(const std::string& name) override {
    act("/print/start?file_path=" + path_segment(name) + "&location=Local", "the start");
    return true;
  }
  std::string picture(const MachineStatus& status) override {
    if (status.file.empty()) return {};
    const HttpAnswer answer = http_.get("/file/thumbnail?file_path=" + path_segment(status.file) +
                                        "&location=Local&size=Large");
    return answer.ok() ? answer.body : "";
  }
  void pause() override { act("/print/pause", "the pause"); }
  void resume() override { act("/print/resume", "going on"); }
  void stop() override { act("/print/cancel", "the stop"); }

 private:
  Json ask(const std::string& path) {
    const HttpAnswer answer = http_.get(path);
    check_answer(answer, http_.where(), path);
    return json_of(answer, http_.where());
  }
  void act(const std::string& path, const char* what) {
    check_answer(http_.send_text("POST", path, "", "application/json"), http_.where(), what);
  }

  HttpCalls http_;
};

}  // namespace

std::unique_ptr<MachineAdapter> make_odyssey(const MachineSpec& machine,
                                             const MachineTimes& times) {
  return std::make_unique<Odyssey>(machine, times);
}

}  // namespace slicecorr::farm::detail
