// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// SDCP 3: WebSocket for requests, HTTP on the same port for files.

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include "machines/adapters.hpp"
#include "machines/http_calls.hpp"
#include "machines/sdcp.hpp"
#include "machines/web_socket.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/token.hpp"
#include "support/json/members.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

namespace {

using slicecorr::detail::member_of, slicecorr::detail::text_in, slicecorr::detail::whole_in;
using Steady = std::chrono::steady_clock;

constexpr std::int64_t kPartBytes = 1'048'576;
/// Requests that get no answer until the connection counts as lost.
constexpr int kSilent = 3;

class Sdcp3 final : public MachineAdapter {
 public:
  Sdcp3(MachineSpec machine, const MachineTimes& times)
      : machine_(std::move(machine)),
        times_(times),
        port_(machine_.port > 0 ? machine_.port : 3030) {}

  MachineFacts facts() override {
    for (int i = 0; i < kSilent; ++i) {
      came_ = {};
      static_cast<void>(request(1));
      if (wait_for([&] { return came_.facts; }, times_.answer_s / kSilent)) {
        MachineFacts facts = facts_;
        if (facts.id.empty()) facts.id = machine_.id;
        return facts;
      }
    }
    throw DeviceError(where() + ": acknowledges, but never says what it is");
  }

  MachineStatus status() override {
    for (int i = 0; i < kSilent; ++i) {
      came_ = {};
      static_cast<void>(request(0));
      if (!wait_for([&] { return came_.status; }, times_.answer_s / kSilent)) continue;
      MachineStatus status = status_;
      // Told once, of the last file, and in no status.
      if (status.trouble.empty()) status.trouble = error_;
      return status;
    }
    throw DeviceError(where() + ": acknowledges, but never says its status");
  }

  std::string upload(const MachineFile& file, const UploadProgress& progress) override {
    HttpCalls http(machine_.host, port_, times_);
    error_.clear();
    for (int begun = 0; begun < 2; ++begun) {
      if (upload_once(http, file, progress)) return file.name;
    }
    throw InputError(where() + ": holds other bytes than were sent, also when begun anew");
  }

  std::optional<HeldFile> holds(const std::string& name) override {
    const SdcpJson answer = request(258, {{"Url", "/local"}});
    const SdcpJson& list = member_of(answer, "FileList");
    if (!list.is_array()) throw DeviceError(where() + ": lists no files");
    for (const SdcpJson& entry : list) {
      const std::string path = text_in(entry, "name");
      const std::size_t slash = path.rfind('/');
      if (whole_in(entry, "type", 1) != 1 ||
          (slash == path.npos ? path : path.substr(slash + 1)) != name) {
        continue;
      }
      // Boards list no sizes, or those of the disk: what counts is that they checked the file's MD5.
      return HeldFile{};
    }
    return std::nullopt;
  }

  bool start(const std::string& name) override {
    const SdcpJson answer = request(128, {{"Filename", name}, {"StartLayer", 0}});
    const int ack = whole_in(answer, "Ack", -1);
    if (ack == 1) return false;
    if (ack != 0) throw InputError(where() + ": " + start_trouble(ack));
    return true;
  }
  void pause() override { control(129, "pause"); }
  void stop() override { control(130, "stop"); }
  void resume() override { control(131, "go on"); }

  std::optional<PrintEnd> ended(const std::string& task) override {
    if (task.empty()) return std::nullopt;
    const SdcpJson answer = request(321, {{"Id", SdcpJson::array({task})}});
    const SdcpJson& list = member_of(answer, "HistoryDetailList");
    for (std::size_t i = 0; list.is_array() && i < list.size(); ++i) {
      if (text_in(list[i], "TaskId") == task) return sdcp_end(list[i]);
    }
    return std::nullopt;
  }

 private:
  struct Came {
    bool status = false, facts = false;
  };

  std::string where() const { return host_text(machine_.host, port_); }

  void connect() {
    if (socket_) return;
    if (times_.cancel && *times_.cancel) throw Cancelled();
    socket_ = std::make_unique<WebSocket>(machine_.host, port_, times_.answer_s, times_.cancel);
    if (machine_.id.empty()) machine_.id = found_id();
  }

  /// Asked by UDP, else taken from the first message that says it.
  std::string found_id() {
    const double most_s = std::min(1.0, times_.answer_s);
    try {
      const auto found =
          discover_machines({host_text(machine_.host, machine_.discovery_port)}, most_s);
      for (const FoundMachine& f : found) return f.id;
    } catch (const DeviceError&) {
    }
    return {};
  }

  /// Takes a message; returns it where it is no push.
  SdcpJson take(const std::string& text) {
    SdcpJson message = sdcp_json(text);
    const std::string topic = text_in(message, "Topic");
    if (sdcp_status_of(message).is_object()) {
      status_ = sdcp_status(message);
      came_.status = true;
    } else if (std::string error = sdcp_error(message); !error.empty()) {
      error_ = std::move(error);
    } else if (topic.find("attributes") != topic.npos || message.contains("Attributes")) {
      facts_ = sdcp_facts(message);
      came_.facts = true;
    }
    if (machine_.id.empty()) machine_.id = text_in(message, "MainboardID");
    return message;
  }

  template <class Holds>
  bool wait_for(Holds holds, double most_s) {
    const auto until = Steady::now() + std::chrono::duration<double>(most_s);
    while (!holds()) {
      const double left = std::chrono::duration<double>(until - Steady::now()).count();
      if (left <= 0) return false;
      try {
        if (const auto text = socket_->next(left)) take(*text);
      } catch (const DeviceError&) {
        socket_.reset();
        throw;
      }
    }
    return true;
  }

  /// `Data.Data` of the answer.
  SdcpJson request(int cmd, SdcpJson data = SdcpJson::object()) {
    connect();
    SdcpRequest r{cmd, std::move(data), random_token(), machine_.id, system_clock().wall_ms()};
    try {
      socket_->send(sdcp_text(r), times_.answer_s);
      const auto until = Steady::now() + std::chrono::duration<double>(times_.answer_s);
      for (;;) {
        const double left = std::chrono::duration<double>(until - Steady::now()).count();
        const auto text = left > 0 ? socket_->next(left) : std::nullopt;
        if (!text) throw DeviceError(fmt::format("{}: no answer to request {}", where(), cmd));
        const SdcpJson message = take(*text);
        if (const SdcpJson* answer = sdcp_answer(message, r)) return *answer;
      }
    } catch (const DeviceError&) {
      socket_.reset();
      throw;
    }
  }

  void control(int cmd, const char* what) {
    const int ack = whole_in(request(cmd), "Ack", -1);
    if (ack != 0)
      throw InputError(fmt::format("{}: does not {} (it answers {})", where(), what, ack));
  }

  /// False: the machine holds other bytes than were sent.
  bool upload_once(HttpCalls& http, const MachineFile& file, const UploadProgress& progress) {
    const std::string uuid = random_token();
    for (std::int64_t at = 0; at < file.bytes; at += kPartBytes) {
      const std::int64_t bytes = std::min(kPartBytes, file.bytes - at);
      const SdcpPart part = upload_part(http, file, uuid, at, bytes);
      if (part.other_offset) return false;
      if (!part.taken) throw InputError(where() + ": " + part.trouble);
      if (progress) progress(at + bytes, file.bytes);
    }
    return true;
  }

  SdcpPart upload_part(HttpCalls& http, const MachineFile& file, const std::string& uuid,
                       std::int64_t at, std::int64_t bytes) const {
    constexpr int tries = 3;
    for (int i = 0;; ++i) {
      try {
        const HttpBody body = form_body({{"S-File-MD5", file.md5, ""},
                                         {"Check", "1", ""},
                                         {"Offset", std::to_string(at), ""},
                                         {"Uuid", uuid, ""},
                                         {"TotalSize", std::to_string(file.bytes), ""},
                                         {"File", "", file.name}},
                                        &file, at, bytes);
        const HttpAnswer answer = http.send_body("POST", "/uploadFile/upload", body);
        return sdcp_part(answer.status, answer.body);
      } catch (const DeviceError&) {
        if (i + 1 == tries) throw;
      }
    }
  }

  MachineSpec machine_;
  MachineTimes times_;
  int port_;
  std::unique_ptr<WebSocket> socket_;
  MachineStatus status_;
  MachineFacts facts_;
  std::string error_;  ///< of the file that was sent last, in words
  Came came_;
};

}  // namespace

std::unique_ptr<MachineAdapter> make_sdcp3(const MachineSpec& machine, const MachineTimes& times) {
  return std::make_unique<Sdcp3>(machine, times);
}

}  // namespace slicecorr::farm::detail
