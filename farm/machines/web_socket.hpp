// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file web_socket.hpp
/// A connection to a machine that speaks WebSocket (RFC 6455), by Boost.Beast.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>

namespace slicecorr::farm::detail {

/// At the path /websocket, where SDCP has it. For one thread. Throws `DeviceError` where there is no connection, or it ends; messages above
/// 8 MiB end it.
class WebSocket {
 public:
  /// `most_s`: until it stands. `cancel`: where it is set, all that waits gives up; null: never.
  WebSocket(const std::string& host, int port, double most_s, const std::atomic<bool>* cancel);
  ~WebSocket();
  WebSocket(const WebSocket&) = delete;
  WebSocket& operator=(const WebSocket&) = delete;
  /// Sends a text. `most_s`: until it has gone.
  void send(const std::string& text, double most_s);
  /// The next text, whole; nothing where none comes in this time.
  std::optional<std::string> next(double most_s);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace slicecorr::farm::detail
