// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/run_server.hpp"

#include <poll.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <thread>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::http {

namespace {

/// A stop must not take longer, whatever a request is doing. Open transactions are rolled back.
constexpr int kLongestStopMs = 5000;

/// A thread reads what the signal sets: an atomic without a lock may do both.
std::atomic<bool> terminated{false};
static_assert(std::atomic<bool>::is_always_lock_free);
void on_terminate(int) { terminated = true; }

}  // namespace

std::pair<std::string, int> host_and_port(const std::string& listen) {
  const std::size_t colon = listen.rfind(':');
  const auto wrong = [&] {
    throw InputError("--listen is '" + listen + "', expected HOST:PORT, 0 for a port that is free");
  };
  if (colon == std::string::npos || colon == 0) wrong();
  std::string host = listen.substr(0, colon);
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  const auto port = cli::number_of(listen.substr(colon + 1));
  if (!port || *port < 0 || *port > 65535 || *port != static_cast<int>(*port)) wrong();
  return {host, static_cast<int>(*port)};
}

void take_sigterm() {
  struct sigaction action {};
  action.sa_handler = on_terminate;
  ::sigaction(SIGTERM, &action, nullptr);
}

bool ended() { return terminated || cli::interrupted(); }

int exit_code_of_end() { return terminated ? cli::kDone : cli::kInterrupted; }

int serve_until_ended(const std::function<void()>& run, const std::function<void()>& stop,
                      const std::function<void()>& before_end) {
  std::atomic<bool> done{false};
  std::thread stopper([&] {
    while (!ended() && !done) ::poll(nullptr, 0, 50);
    stop();
    for (int waited = 0; !done; waited += 50) {
      if (waited >= kLongestStopMs) {
        // A request waits for the record or the disk: nothing that it did is half-made.
        std::_Exit(exit_code_of_end());
      }
      ::poll(nullptr, 0, 50);
    }
  });
  try {
    run();
  } catch (...) {
    done = true;
    stopper.join();
    throw;
  }
  before_end();
  const bool asked = ended();
  done = true;
  stopper.join();
  if (!asked) throw DeviceError("the server's socket is gone");
  return exit_code_of_end();
}

}  // namespace slicecorr::http
