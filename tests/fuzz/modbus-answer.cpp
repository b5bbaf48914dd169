// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as what a machine answers over Modbus, for clang's fuzzer. In every second the number of the request is right,
// so that more than the head is looked at. The bridge has a status of all that the map names, or says what is wrong.
#include <atomic>
#include <mutex>
#include <thread>

#include "modbus_peer.hpp"
#include "slicecorr/bridge/link.hpp"

using namespace slicecorr;

namespace {

/// Answers each request with the bytes that it was given.
class Machine {
 public:
  Machine() {
    std::thread([this] { work(); }).detach();
  }
  int port() const { return listening_.port; }
  void answer(std::string bytes) {
    const std::scoped_lock lock(mutex_);
    answer_ = std::move(bytes);
  }

 private:
  void work() {
    for (;;) {
      const int client = ::accept(listening_.socket, nullptr, nullptr);
      if (client < 0) continue;
      char request[300];
      for (ssize_t n = 0; (n = ::recv(client, request, sizeof request, 0)) > 0;) {
        std::string bytes;
        {
          const std::scoped_lock lock(mutex_);
          bytes = answer_;
        }
        if (n >= 2 && bytes.size() >= 2 && bytes.size() % 2 == 0) {
          bytes[0] = request[0];
          bytes[1] = request[1];
        }
        if (::send(client, bytes.data(), bytes.size(), MSG_NOSIGNAL) < 0) break;
      }
      ::close(client);
    }
  }
  fuzz::Listening listening_;
  std::mutex mutex_;
  std::string answer_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Machine& peer = *new Machine;
  static const bridge::Machine machine = [] {
    bridge::Machine m = test::machine_of(test::kSmallMachine);
    m.modbus->port = peer.port();
    m.limits.response_timeout_s = 0.005;
    return m;
  }();
  peer.answer(fuzz::text_of(data, size));
  const auto link = bridge::make_modbus_link(*machine.modbus, machine.limits);
  for (int i = 0; i < 3; ++i) {
    bridge::SetPoints points;
    if (!link->exchange(points) && link->last_error().empty()) fuzz::fail("nothing is said");
    link->write_alone(points, bridge::Alone::lamps);
  }
  return 0;
}
