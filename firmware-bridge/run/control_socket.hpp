// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The Unix socket over which a running print is asked. One line in, one line of JSON out.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "slicecorr/bridge/print_state.hpp"
#include "slicecorr/bridge/record.hpp"

namespace slicecorr::bridge {

/// Where the control thread and those who ask meet: the control thread only ever tries, and comes
/// back in its next cycle when somebody else is here.
class Counter {
 public:
  /// Control thread: the state that `status` tells. False: somebody else is here, try again.
  bool offer(const PrintState& state);
  /// Control thread: a request, if there is one and nobody else is here.
  std::optional<std::string> take();
  /// Control thread: what is answered to it.
  void answer(std::string json);
  /// Others: waits for the answer, at most `timeout_s`.
  std::optional<std::string> ask(const std::string& request, double timeout_s);
  /// Others: nothing before the first one.
  std::optional<PrintState> state() const;

 private:
  mutable std::mutex mutex_;
  std::condition_variable answered_;
  std::optional<PrintState> state_;
  std::optional<std::string> request_, answer_, waiting_answer_;
};

/// Serves the counter in a thread of its own.
class ControlSocket {
 public:
  /// `text` makes the answer to `status`, in that thread, given how many were answered before.
  using Text = std::function<std::string(const PrintState&, std::uint64_t)>;
  ControlSocket(const StateFolder& folder, Counter& counter, Text text);
  ~ControlSocket();

 private:
  void work();
  void serve(int client);

  const StateFolder folder_;
  Counter& counter_;
  const Text text_;
  std::uint64_t answered_ = 0;
  int listener_ = -1, wake_[2] = {-1, -1};
  std::thread thread_;
};

}  // namespace slicecorr::bridge
