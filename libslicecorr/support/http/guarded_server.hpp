// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file guarded_server.hpp
/// cpp-httplib's server behind limits that it does not have itself: on the bytes and the time of a
/// request, on connections, and on how long a stop may take. One request per connection.
#pragma once

#include <httplib.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace slicecorr::http {

struct ConnectionLimits {
  int threads = 16, most_waiting = 64, header_bytes = 16 << 10;
  double request_s = 10, stall_s = 10, least_bytes_s = 16384;
};

/// A connection that counts bytes and time. It leaves out the headers of a request that ask for a
/// part of an answer (Range, If-Range): every answer is whole, whatever they say.
class GuardedStream : public httplib::Stream {
 public:
  GuardedStream(int socket, int stop_fd, const ConnectionLimits& limits);
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

 private:
  using Steady = std::chrono::steady_clock;
  bool wait(short events, Steady::time_point until) const;
  bool bytes_come() const;
  ssize_t read_bytes(char* data, std::size_t size);
  ssize_t read_line();

  int socket_, stop_fd_;
  ConnectionLimits limits_;
  std::int64_t left_;  ///< bytes that may still come
  bool body_allowed_ = false;
  Steady::time_point read_until_, write_since_{};
  double written_ = 0;
  std::vector<char> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  bool in_head_ = true;  ///< up to the empty line that ends the headers
  std::string line_;     ///< of the head, read and not taken yet from `line_at_` on
  std::size_t line_at_ = 0;
};

/// Threads for connections; those beyond the limit are turned away at once.
class BoundedPool : public httplib::TaskQueue {
 public:
  /// `idle` is called by who listens, whenever nobody has come for a while.
  BoundedPool(const ConnectionLimits& limits, std::function<void()> idle);
  void on_idle() override { idle_(); }
  void enqueue(std::function<void()> connection) override;
  void shutdown() override;
  /// Whether the connection that this thread works on is to be turned away.
  static bool turning_away();

 private:
  void work();

  std::size_t most_waiting_;
  std::function<void()> idle_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> waiting_;
  bool ended_ = false;
  std::vector<std::thread> threads_;
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

  ConnectionLimits limits_;
  int stop_fd_ = -1;
  std::atomic<bool> stopping_{false};
};

/// "http://127.0.0.1:8123".
std::string address_text(const std::string& host, int port);

}  // namespace slicecorr::http
