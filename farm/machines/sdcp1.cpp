// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// SDCP 1, with the roles turned round: this program is broker and server of files, and the machine, told
// by a datagram where they are, comes as their client.

#include <arpa/inet.h>
#include <fmt/format.h>
#include <httplib.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <thread>

#include "machines/adapters.hpp"
#include "machines/http_calls.hpp"
#include "machines/mqtt.hpp"
#include "machines/sdcp.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/token.hpp"
#include "support/files/errno_message.hpp"
#include "support/json/members.hpp"

namespace slicecorr::farm::detail {

namespace {

using slicecorr::detail::member_of, slicecorr::detail::text_in, slicecorr::detail::whole_in;
using Steady = std::chrono::steady_clock;

double seconds_since(Steady::time_point begin) {
  return std::chrono::duration<double>(Steady::now() - begin).count();
}

/// The way to a machine: its address, and ours as it sees it.
class Way {
 public:
  explicit Way(const MachineSpec& machine)
      : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    addrinfo hints{}, *list = nullptr;
    hints.ai_family = AF_INET;
    hints.ai_socktype = SOCK_DGRAM;
    if (socket_ < 0 || ::getaddrinfo(machine.host.c_str(), nullptr, &hints, &list) != 0 || !list) {
      if (socket_ >= 0) ::close(socket_);
      throw DeviceError(machine.host + ": has no address");
    }
    sockaddr_in to = *reinterpret_cast<const sockaddr_in*>(list->ai_addr);
    ::freeaddrinfo(list);
    to.sin_port = htons(static_cast<std::uint16_t>(machine.discovery_port));
    sockaddr_in own{};
    socklen_t size = sizeof own;
    // Nothing is sent by it: the system says by which of our addresses it would go.
    const bool good = ::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
                      ::getsockname(socket_, reinterpret_cast<sockaddr*>(&own), &size) == 0;
    char text[INET_ADDRSTRLEN] = "";
    theirs = ::inet_ntop(AF_INET, &to.sin_addr, text, sizeof text) ? text : "";
    ours = ::inet_ntop(AF_INET, &own.sin_addr, text, sizeof text) ? text : "";
    if (!machine.own_address.empty()) ours = machine.own_address;
    if (!good) {
      ::close(socket_);
      throw DeviceError(machine.host + ": there is no way to it");
    }
  }
  ~Way() { ::close(socket_); }
  Way(const Way&) = delete;
  Way& operator=(const Way&) = delete;
  void call(const std::string& text) const {
    static_cast<void>(::send(socket_, text.data(), text.size(), 0));
  }
  std::string theirs, ours;

 private:
  int socket_;
};

/// Gives one file to one address, under a path that nobody guesses, as long as it lives.
class FileGiver {
 public:
  FileGiver(const MachineFile& file, const Way& way)
      : path("/" + random_token() + "/" + file.name) {
    const auto give = [this, &file, theirs = way.theirs](const httplib::Request& request,
                                                         httplib::Response& response) {
      if (request.remote_addr != theirs || request.path != path) {
        response.status = 404;
        return;
      }
      const auto in = std::make_shared<std::ifstream>(file.path, std::ios::binary);
      response.set_content_provider(
          static_cast<std::size_t>(file.bytes), "application/octet-stream",
          [this, in](std::size_t at, std::size_t size, httplib::DataSink& sink) {
            std::string bytes(std::min(size, std::size_t{64} << 10), '\0');
            in->clear();
            in->seekg(static_cast<std::streamoff>(at));
            in->read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
            const auto n = static_cast<std::size_t>(in->gcount());
            given = static_cast<std::int64_t>(at + n);
            return n > 0 && sink.write(bytes.data(), n);
          });
    };
    server_.Get(".*", give);
    server_.set_read_timeout(10);
    server_.set_write_timeout(60);
    port = server_.bind_to_any_port(way.ours);
    if (port <= 0) throw DeviceError(way.ours + ": no port for the file");
    thread_ = std::thread([this] {
      server_.listen_after_bind();
      ended_ = true;
    });
  }
  ~FileGiver() {
    // Who is told to stop before it has begun does not hear it.
    while (!ended_) {
      server_.stop();
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    thread_.join();
  }
  FileGiver(const FileGiver&) = delete;
  FileGiver& operator=(const FileGiver&) = delete;
  std::string path;
  int port = 0;
  std::atomic<std::int64_t> given{0};

 private:
  httplib::Server server_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

class Sdcp1 final : public MachineAdapter {
 public:
  Sdcp1(MachineSpec machine, const MachineTimes& times)
      : machine_(std::move(machine)), times_(times) {}
  ~Sdcp1() override {
    try {
      if (broker_ && broker_->connected()) publish(64, SdcpJson::object());
    } catch (const Error&) {
      // It will notice that we are gone.
    }
  }
  bool one_asker() const override { return true; }

  MachineFacts facts() override {
    came_ = {};
    static_cast<void>(request(1));
    if (!wait_for([&] { return came_.facts; }, times_.answer_s)) {
      throw DeviceError(machine_.host + ": never says what it is");
    }
    if (facts_.id.empty()) facts_.id = machine_.id;
    return facts_;
  }

  MachineStatus status() override {
    came_ = {};
    static_cast<void>(request(0));
    if (!wait_for([&] { return came_.status; }, times_.answer_s)) {
      throw DeviceError(machine_.host + ": never says its status");
    }
    return status_;
  }

  std::string upload(const MachineFile& file, const UploadProgress& progress) override {
    connect();
    const FileGiver giver(file, *way_);
    const SdcpJson answer =
        request(256, {{"Check", 0},
                      {"CleanCache", 1},
                      {"Compress", 0},
                      {"FileSize", file.bytes},
                      {"Filename", file.name},
                      {"MD5", file.md5},
                      // The machine puts in the address at which it found us.
                      {"URL", fmt::format("http://${{ipaddr}}:{}{}", giver.port, giver.path)}});
    if (const int ack = whole_in(answer, "Ack", 0); ack != 0) {
      throw InputError(fmt::format("{}: takes no file (it answers {})", machine_.host, ack));
    }
    auto moved = Steady::now();
    std::int64_t before = 0;
    for (;;) {
      came_ = {};
      static_cast<void>(request(0));
      wait_for([&] { return came_.status; }, std::max(times_.look_s, 0.05));
      const std::int64_t given = giver.given;
      if (given != before) moved = Steady::now();
      before = given;
      if (progress) progress(std::min(given, file.bytes), file.bytes);
      if (transfer_file_ == file.name && transfer_ == 3) {
        throw InputError(machine_.host + ": says that the transfer failed; it dropped the file");
      }
      if (transfer_file_ == file.name && transfer_ == 2 && is_at_rest(status_.state)) {
        return file.name;
      }
      if (seconds_since(moved) > times_.stall_s) {
        throw DeviceError(machine_.host + ": took nothing of the file for too long");
      }
      wait_for([] { return false; }, times_.look_s);
    }
  }

  std::optional<HeldFile> holds(const std::string& name) override {
    // It lists no files; what it says of the last transfer is all that is known.
    static_cast<void>(status());
    if (transfer_file_ != name || transfer_ != 2) return std::nullopt;
    return HeldFile{};
  }

  bool start(const std::string& name) override {
    const int ack = whole_in(request(128, {{"Filename", name}, {"StartLayer", 0}}), "Ack", -1);
    if (ack == 1) return false;
    if (ack != 0) throw InputError(machine_.host + ": " + start_trouble(ack));
    return true;
  }
  void pause() override { control(129, "pause"); }
  void stop() override { control(130, "stop"); }
  void resume() override { control(131, "go on"); }

 private:
  struct Came {
    bool status = false, facts = false;
  };

  void connect() {
    if (times_.cancel && *times_.cancel) throw Cancelled();
    if (broker_ && broker_->connected()) return;
    if (!way_) way_ = std::make_unique<Way>(machine_);
    if (machine_.id.empty()) {
      const auto found = discover_machines({host_text(machine_.host, machine_.discovery_port)},
                                           std::min(2.0, times_.answer_s));
      if (found.empty()) throw DeviceError(machine_.host + ": does not answer a call");
      machine_.id = found.front().id;
    }
    broker_ = std::make_unique<MqttBroker>(way_->ours, way_->theirs);
    const auto begin = Steady::now();
    const std::string topic = "/sdcp/request/" + machine_.id;
    for (auto called = begin - std::chrono::hours(1); !broker_->subscribed(topic);) {
      if (times_.cancel && *times_.cancel) throw Cancelled();
      if (seconds_since(begin) > times_.answer_s) {
        broker_.reset();
        throw DeviceError(machine_.host +
                          ": does not connect to this computer; does a firewall keep it off?");
      }
      if (!broker_->connected() && seconds_since(called) > 1) {
        way_->call(fmt::format("M66666 {}", broker_->port()));
        called = Steady::now();
      }
      if (const auto message = broker_->next(0.1)) take(*message);
    }
  }

  void take(const MqttMessage& message) {
    const SdcpJson json = sdcp_json(message.payload);
    if (message.topic == "/sdcp/status/" + machine_.id) {
      const SdcpJson& status = sdcp_status_of(json);
      status_ = sdcp_status(json, true);
      const SdcpJson& transfer = member_of(status, "FileTransferInfo");
      transfer_ = whole_in(transfer, "Status", 0);
      const std::string file = text_in(transfer, "Filename");
      transfer_file_ = file.substr(file.rfind('/') + 1);
      came_.status = true;
    } else if (message.topic == "/sdcp/attributes/" + machine_.id) {
      facts_ = sdcp_facts(json);
      came_.facts = true;
    } else if (message.topic == "/sdcp/response/" + machine_.id) {
      answer_ = json;
    }
  }

  template <class Holds>
  bool wait_for(Holds holds, double most_s) {
    const auto begin = Steady::now();
    while (!holds()) {
      const double left = std::min(most_s - seconds_since(begin), 0.2);
      if (left <= 0) return false;
      if (times_.cancel && *times_.cancel) throw Cancelled();
      if (const auto message = broker_->next(left)) take(*message);
      if (!broker_->connected()) throw DeviceError(machine_.host + ": the connection ended");
    }
    return true;
  }

  SdcpRequest publish(int cmd, SdcpJson data) {
    SdcpRequest r{cmd, std::move(data), random_token(), machine_.id, system_clock().wall_ms()};
    broker_->publish("/sdcp/request/" + machine_.id, sdcp_text(r, true));
    return r;
  }

  SdcpJson request(int cmd, SdcpJson data = SdcpJson::object()) {
    connect();
    const SdcpRequest r = publish(cmd, std::move(data));
    const SdcpJson* found = nullptr;
    const bool answered = wait_for(
        [&] {
          found = sdcp_answer(answer_, r);
          return found != nullptr;
        },
        times_.answer_s);
    if (!answered)
      throw DeviceError(fmt::format("{}: no answer to request {}", machine_.host, cmd));
    return *found;
  }

  void control(int cmd, const char* what) {
    const int ack = whole_in(request(cmd), "Ack", -1);
    if (ack != 0) {
      throw InputError(fmt::format("{}: does not {} (it answers {})", machine_.host, what, ack));
    }
  }

  MachineSpec machine_;
  MachineTimes times_;
  std::unique_ptr<Way> way_;
  std::unique_ptr<MqttBroker> broker_;
  MachineStatus status_;
  MachineFacts facts_;
  SdcpJson answer_;
  int transfer_ = 0;
  std::string transfer_file_;
  Came came_;
};

}  // namespace

std::unique_ptr<MachineAdapter> make_sdcp1(const MachineSpec& machine, const MachineTimes& times) {
  return std::make_unique<Sdcp1>(machine, times);
}

}  // namespace slicecorr::farm::detail
