// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as what comes to the socket of a print, for clang's fuzzer: a line is answered by a line of JSON, or the
// connection ends. The control thread gets requests that it knows, and nothing else.
#include <sys/socket.h>
#include <sys/un.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "fuzz.hpp"
#include "run/control_socket.hpp"

using namespace slicecorr;
using namespace slicecorr::bridge;

namespace {

struct Served {
  Served()
      : state{folder.path()},
        socket(state, counter, [](const PrintState&, std::uint64_t) { return std::string("{}"); }) {
    counter.offer({});
    std::thread([this] {
      for (;;) {
        if (const auto request = counter.take()) {
          if (*request != "pause" && *request != "resume" && *request != "stop") {
            fuzz::fail("asked of the control thread: " + *request);
          }
          counter.answer("{}");
        }
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
    }).detach();
  }
  fuzz::Folder folder;
  Counter counter;
  StateFolder state;
  ControlSocket socket;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Served& served = *new Served;
  const int client = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  served.state.file("control.sock").copy(address.sun_path, sizeof address.sun_path - 1);
  if (::connect(client, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    fuzz::fail("the socket is gone");
  }
  std::string text = fuzz::text_of(data, size) + "\n";
  ::send(client, text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  ::shutdown(client, SHUT_WR);
  std::string answer;
  char some[4096];
  for (ssize_t n = 0; (n = ::recv(client, some, sizeof some, 0)) > 0;) {
    answer.append(some, static_cast<std::size_t>(n));
  }
  ::close(client);
  if (!answer.empty() && (answer.back() != '\n' || !nlohmann::json::accept(answer))) {
    fuzz::fail("an answer that is no line of JSON: " + answer);
  }
  return 0;
}
