// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file connection_pool.hpp
/// Who of those that are connected to a server gets a thread, and when. A request that has not come whole
/// costs a file and no thread; a client that is slow beyond that costs a thread of its own and none of those
/// that work; and where there is not enough for all, who has most gives way.
#pragma once

#include <httplib.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace slicecorr::http {

struct ConnectionLimits {
  int threads = 16;  ///< that work at a time, >= 1; one address has three quarters of them at most
  /// That wait for a client, with a body or an answer on the way, beside those that work, >= 0; one address has
  /// half of them at most.
  int most_slow = 48;
  /// Connections whose request has not come, or waits for a thread, >= 1.
  int most_waiting = 256;
  int header_bytes = 16 << 10;
  double request_s = 10;  ///< for request line and headers to come
  double stall_s = 10, least_bytes_s = 16384;
  int most_leaving = 64;  ///< connections that stay open for a moment after their answer
};

/// A connection that was accepted and has no answer yet.
struct Connection {
  int socket = -1;
  std::string from;   ///< whose share it is of (`share_of`)
  std::string bytes;  ///< of its request that were read
  /// For request line and headers to come, and for the next byte of them.
  std::chrono::steady_clock::time_point until, stalls_at;
};

inline std::chrono::steady_clock::duration seconds(double s) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(s));
}

/// The address at the other end: that of IPv4, and the first 64 bits of IPv6, which one client has for itself.
std::string share_of(int socket);

/// Threads for connections.
///
/// Connections wait at the door, with one thread for all of them, until the head of their request is whole, until it
/// is known to be none, or until its time is over. Then they are served in turns, an address after the other, in each the
/// oldest first. Where more wait than may, the address that has most of them gives way: the oldest of its connections whose
/// request has not come, else the newest of it. It is told to come again (503).
class ConnectionPool : public httplib::TaskQueue {
 public:
  using Steady = std::chrono::steady_clock;

  /// What a thread has of the pool while it serves a connection.
  class Place {
   public:
    Place(ConnectionPool& pool, const Connection& connection)
        : pool_(pool), connection_(connection) {}
    /// From here on this thread waits for its client and no longer counts among those that work; false: more wait
    /// than may, and each of them has moved bytes within the last second.
    bool slow_down();
    /// It works again, as soon as there is room for it.
    void work_again();
    /// Before and after each wait for the client, for its bytes or for room to send.
    void begin_wait(bool to_send);
    void end_wait() { waits_since_ms_ = 0; }
    bool slow() const { return slow_; }
    /// Whether another one was given this thread's room, as its client moved nothing.
    bool ended() const { return ended_; }

   private:
    friend class ConnectionPool;
    ConnectionPool& pool_;
    const Connection& connection_;
    bool slow_ = false;
    std::atomic<bool> ended_{false}, sends_{false};
    std::atomic<std::int64_t> waits_since_ms_{0};  ///< 0: it does not wait
  };

  /// `serve` answers a connection, in a thread of its own, and leaves its socket open. `stop_fd` becomes readable when the
  /// server stops. `idle` is called by who listens, whenever nobody has come for a while.
  ConnectionPool(const ConnectionLimits& limits, int stop_fd,
                 std::function<void(const Connection&, Place&)> serve, std::function<void()> idle);
  void on_idle() override { idle_(); }
  /// Runs at once: a connection is only handed to `take`.
  void enqueue(std::function<void()> connection) override { connection(); }
  void shutdown() override;
  /// A socket that was accepted, which is the pool's from here on.
  void take(int socket);

 private:
  struct Leaving {
    int socket;
    Steady::time_point until;
    std::size_t most_bytes;
  };

  // Of the door, all in its thread.
  void mind_door();
  void let_in(Connection&& connection);
  void read_at_door();
  bool has_come(Connection& connection, bool readable);
  void hand_over(Connection&& connection);
  void turn_away(int socket);
  void see_off();
  void wake_door() const;

  // Of the threads; `mutex_` is held.
  std::map<std::string, std::deque<Connection>>::iterator next();
  void tell_next();
  bool make_room(const std::string& from);
  void leave(Place& place);

  void work();
  void end_threads();

  const ConnectionLimits limits_;
  const int most_working_of_one_;
  int stop_fd_, wake_fd_;
  std::function<void(const Connection&, Place&)> serve_;
  std::function<void()> idle_;

  // Known to the door alone.
  std::list<Connection> at_door_;  ///< the oldest first
  std::deque<Leaving> leaving_;
  std::map<std::string, int> waiting_at_door_;

  std::mutex mutex_;
  std::condition_variable changed_, back_;
  bool ended_ = false, door_is_minded_ = false;
  std::vector<int> accepted_, answered_;                 ///< sockets for the door
  std::map<std::string, std::deque<Connection>> ready_;  ///< by address; none is empty
  std::size_t ready_count_ = 0;
  std::string last_served_;
  int most_working_, most_slow_, working_ = 0, returning_ = 0;
  std::map<std::string, int> working_of_, slow_of_;
  std::list<Place*> slow_;

  std::vector<std::thread> threads_;
};

}  // namespace slicecorr::http
