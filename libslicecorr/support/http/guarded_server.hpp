// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file guarded_server.hpp
/// cpp-httplib's server behind limits that it does not have itself: on the bytes and the time of a
/// request, on connections (`connection_pool.hpp`), and on how long a stop may take. One request per connection.
#pragma once

#include <httplib.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "support/http/connection_pool.hpp"

namespace slicecorr::http {

/// A connection that counts bytes and time. It leaves out the headers of a request that ask for a
/// part of an answer (Range, If-Range): every answer is whole, whatever they say.
class GuardedStream : public httplib::Stream {
 public:
  GuardedStream(const Connection& connection, ConnectionPool::Place& place, int stop_fd,
                const ConnectionLimits& limits);
  ~GuardedStream() override;
  GuardedStream(const GuardedStream&) = delete;
  GuardedStream& operator=(const GuardedStream&) = delete;
  /// From here on so many bytes of body may come.
  void allow_body(std::int64_t bytes);

  bool is_readable() const override;
  bool is_writable() const override;
  ssize_t read(char* data, std::size_t size) override;
  ssize_t write(const char* data, std::size_t size) override;
  void get_remote_ip_and_port(std::string& ip, int& port) const override;
  void get_local_ip_and_port(std::string& ip, int& port) const override;
  socket_t socket() const override { return socket_; }

  /// The one that this thread works on.
  static GuardedStream* current();
  /// Throws `ApiError`, which says why the body of the request that this thread works on did not come whole.
  [[noreturn]] static void fail_body();

 private:
  using Steady = std::chrono::steady_clock;
  bool wait(short events, Steady::time_point until) const;
  bool poll_until(short events, Steady::time_point until) const;
  bool bytes_come() const;
  ssize_t read_bytes(char* data, std::size_t size);
  ssize_t read_line();

  ConnectionPool::Place& place_;
  int socket_, stop_fd_;
  ConnectionLimits limits_;
  std::int64_t left_;           ///< bytes that may still come
  std::int64_t body_left_ = 0;  ///< of them, of the body that was announced
  mutable bool crowded_ = false;
  mutable Steady::duration waited_{};
  bool body_allowed_ = false;
  Steady::time_point read_until_, write_since_{};
  double written_ = 0;
  std::vector<char> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  bool in_head_ = true;  ///< up to the empty line that ends the headers
  std::string line_;     ///< of the head, read and not taken yet from `line_at_` on
  std::size_t line_at_ = 0;
};

class GuardedServer : public httplib::Server {
 public:
  explicit GuardedServer(const ConnectionLimits& limits);
  ~GuardedServer() override;
  /// The port; `port` 0: one that is free. Throws `DeviceError` when it can't be had.
  int bind(const std::string& host, int port);
  /// Ends `listen_after_bind`, also one that has not begun yet; requests that are being read or answered
  /// are cut off.
  void stop_now();
  bool stopping() const { return stopping_; }
  const std::atomic<bool>& stopping_flag() const { return stopping_; }

 private:
  bool process_and_close_socket(socket_t socket) override;
  void serve(const Connection& connection, ConnectionPool::Place& place);

  ConnectionLimits limits_;
  int stop_fd_ = -1;
  ConnectionPool* pool_ = nullptr;  ///< as long as it listens
  std::atomic<bool> stopping_{false};
};

/// "http://127.0.0.1:8123".
std::string address_text(const std::string& host, int port);

}  // namespace slicecorr::http
