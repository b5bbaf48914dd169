// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/http/connection_pool.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <string_view>
#include <system_error>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/process/threads.hpp"

namespace slicecorr::http {

namespace {

using Steady = ConnectionPool::Steady;

constexpr std::string_view kComeAgain =
    "HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 2\r\n"
    "Content-Length: 0\r\n\r\n";
/// Without a byte for so long a client gives its room to another one.
constexpr std::int64_t kPatienceMs = 1000;
/// How long, and for how many bytes, a connection stays open after its answer.
constexpr auto kFarewell = std::chrono::seconds(1);
constexpr std::size_t kFarewellBytes = 1 << 20;

std::int64_t now_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(Steady::now().time_since_epoch())
      .count();
}

void one_less(std::map<std::string, int>& counts, const std::string& of) {
  const auto found = counts.find(of);
  if (found != counts.end() && --found->second == 0) counts.erase(found);
}

int count_of(const std::map<std::string, int>& counts, const std::string& of) {
  const auto found = counts.find(of);
  return found == counts.end() ? 0 : found->second;
}

/// Whether no byte more decides what becomes of a request: its head is whole, or has a line that ends as none of HTTP does.
bool is_decided(std::string_view bytes, std::size_t from) {
  for (std::size_t at = from; (at = bytes.find('\n', at)) != bytes.npos; ++at) {
    if (at == 0 || bytes[at - 1] != '\r') return true;
    if (at >= 3 && bytes.substr(at - 3, 4) == "\r\n\r\n") return true;
    if (at == 1) return true;  // an empty line before any other
  }
  return false;
}

}  // namespace

std::string share_of(int socket) {
  sockaddr_storage address{};
  socklen_t length = sizeof address;
  if (::getpeername(socket, reinterpret_cast<sockaddr*>(&address), &length) != 0) return {};
  if (address.ss_family == AF_INET) {
    const auto& a = reinterpret_cast<const sockaddr_in&>(address);
    return {reinterpret_cast<const char*>(&a.sin_addr), sizeof a.sin_addr};
  }
  if (address.ss_family != AF_INET6) return {};
  const auto& a = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
  const auto* bytes = reinterpret_cast<const char*>(&a);
  return IN6_IS_ADDR_V4MAPPED(&a) ? std::string(bytes + 12, 4) : std::string(bytes, 8);
}

ConnectionPool::ConnectionPool(const ConnectionLimits& limits, int stop_fd,
                               std::function<void(const Connection&, Place&)> serve,
                               std::function<void()> idle)
    : limits_(limits),
      most_working_of_one_(std::max(1, limits.threads - limits.threads / 4)),
      stop_fd_(stop_fd),
      wake_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      serve_(std::move(serve)),
      idle_(std::move(idle)),
      most_working_(std::max(1, limits.threads)),
      most_slow_(std::max(0, limits.most_slow)) {
  if (wake_fd_ < 0) throw DeviceError("the system gives no event counter");
  {
    const std::scoped_lock lock(mutex_);
    threads_ = slicecorr::detail::start_threads(1 + most_working_ + most_slow_, [this] { work(); });
    // Where the system gives fewer threads, fewer wait for their clients.
    const int given = static_cast<int>(threads_.size()) - 1;
    most_working_ = std::min(most_working_, given);
    most_slow_ = std::min(most_slow_, given - most_working_);
  }
  if (most_working_ > 0) return;
  end_threads();
  throw std::system_error(EAGAIN, std::generic_category());
}

void ConnectionPool::end_threads() {
  {
    const std::scoped_lock lock(mutex_);
    ended_ = true;
  }
  changed_.notify_all();
  back_.notify_all();
  wake_door();
  for (std::thread& t : threads_) t.join();
}

void ConnectionPool::shutdown() {
  end_threads();
  for (const int socket : accepted_) ::close(socket);
  for (const int socket : answered_) ::close(socket);
  ::close(wake_fd_);
}

void ConnectionPool::wake_door() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(wake_fd_, &one, sizeof one);
}

void ConnectionPool::take(int socket) {
  {
    const std::scoped_lock lock(mutex_);
    accepted_.push_back(socket);
  }
  wake_door();
}

// --- door ---------------------------------------------------------------------------------------

void ConnectionPool::mind_door() {
  std::vector<int> accepted, answered;
  for (;;) {
    {
      const std::scoped_lock lock(mutex_);
      accepted.swap(accepted_);
      answered.swap(answered_);
      if (ended_) break;
    }
    const auto now = Steady::now();
    for (const int socket : accepted) {
      let_in({socket,
              share_of(socket),
              {},
              now + seconds(limits_.request_s),
              now + seconds(limits_.stall_s)});
    }
    for (const int socket : answered) {
      ::shutdown(socket, SHUT_WR);
      leaving_.push_back({socket, now + kFarewell, kFarewellBytes});
    }
    accepted.clear();
    answered.clear();
    read_at_door();
  }
  for (const int socket : accepted) turn_away(socket);
  for (const int socket : answered) ::close(socket);
  for (const Connection& c : at_door_) ::close(c.socket);
  const std::scoped_lock lock(mutex_);
  for (const auto& [from, list] : ready_) {
    for (const Connection& c : list) turn_away(c.socket);
  }
  for (const Leaving& l : leaving_) ::close(l.socket);
}

void ConnectionPool::let_in(Connection&& connection) {
  std::unique_lock lock(mutex_);
  if (at_door_.size() + ready_count_ >=
      static_cast<std::size_t>(std::max(1, limits_.most_waiting))) {
    std::map<std::string, int> counts = waiting_at_door_;
    for (const auto& [from, list] : ready_) counts[from] += static_cast<int>(list.size());
    const auto most =
        std::max_element(counts.begin(), counts.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    const std::string from =
        counts[connection.from] >= most->second ? connection.from : most->first;
    const auto oldest = std::find_if(at_door_.begin(), at_door_.end(),
                                     [&](const Connection& c) { return c.from == from; });
    int socket = connection.socket;
    if (oldest != at_door_.end()) {
      socket = oldest->socket;
      one_less(waiting_at_door_, from);
      at_door_.erase(oldest);
    } else if (from != connection.from) {
      const auto list = ready_.find(from);
      socket = list->second.back().socket;
      list->second.pop_back();
      if (list->second.empty()) ready_.erase(list);
      --ready_count_;
    }
    turn_away(socket);
    if (socket == connection.socket) return;
  }
  ++waiting_at_door_[connection.from];
  at_door_.push_back(std::move(connection));
}

/// What is sent fits into the system's buffers, whatever the client does.
void ConnectionPool::turn_away(int socket) {
  [[maybe_unused]] const ssize_t n =
      ::send(socket, kComeAgain.data(), kComeAgain.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
  ::shutdown(socket, SHUT_WR);
  leaving_.push_back({socket, Steady::now() + kFarewell, kFarewellBytes});
}

void ConnectionPool::hand_over(Connection&& connection) {
  const std::scoped_lock lock(mutex_);
  one_less(waiting_at_door_, connection.from);
  ready_[connection.from].push_back(std::move(connection));
  ++ready_count_;
  tell_next();
}

/// Reads what came of a request; whether it goes to a thread now.
bool ConnectionPool::has_come(Connection& c, bool readable) {
  const auto now = Steady::now();
  if (now >= std::min(c.until, c.stalls_at)) return true;
  if (!readable) return false;
  c.stalls_at = now + seconds(limits_.stall_s);
  const auto most = static_cast<std::size_t>(limits_.header_bytes);
  char piece[4096];
  while (c.bytes.size() < most) {
    const ssize_t n =
        ::recv(c.socket, piece, std::min(sizeof piece, most - c.bytes.size()), MSG_DONTWAIT);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return false;
    if (n <= 0) return true;  // who serves it finds out what that means
    const std::size_t known = c.bytes.size();
    c.bytes.append(piece, static_cast<std::size_t>(n));
    if (is_decided(c.bytes, known)) return true;
  }
  return true;
}

void ConnectionPool::read_at_door() {
  see_off();
  std::vector<pollfd> fds{{wake_fd_, POLLIN, 0}, {stop_fd_, POLLIN, 0}};
  auto until = Steady::now() + std::chrono::minutes(1);
  for (const Connection& c : at_door_) {
    fds.push_back({c.socket, POLLIN, 0});
    until = std::min({until, c.until, c.stalls_at});
  }
  for (const Leaving& l : leaving_) {
    fds.push_back({l.socket, POLLIN, 0});
    until = std::min(until, l.until);
  }
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Steady::now()).count();
  if (::poll(fds.data(), fds.size(), static_cast<int>(std::max<std::int64_t>(0, left))) < 0) {
    return;
  }
  if (fds[0].revents != 0) {
    std::uint64_t times = 0;
    [[maybe_unused]] const ssize_t n = ::read(wake_fd_, &times, sizeof times);
  }
  if (fds[1].revents != 0) {
    // The server stops: nothing is read any more, and the end of it all comes by `wake_fd_`, unless it just did.
    pollfd wake{wake_fd_, POLLIN, 0};
    if (fds[0].revents == 0) ::poll(&wake, 1, -1);
    return;
  }
  std::size_t i = 2;
  for (auto c = at_door_.begin(); c != at_door_.end(); ++i) {
    const auto here = c++;
    if (!has_come(*here, fds[i].revents != 0)) continue;
    hand_over(std::move(*here));
    at_door_.erase(here);
  }
  for (Leaving& l : leaving_) {
    if (fds[i++].revents == 0) continue;
    char nowhere[4096];
    const ssize_t n = ::recv(l.socket, nowhere, sizeof nowhere, MSG_DONTWAIT);
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (n <= 0 || static_cast<std::size_t>(n) > l.most_bytes) {
      l.until = {};
    } else {
      l.most_bytes -= static_cast<std::size_t>(n);
    }
  }
}

/// An answer that was written may be lost when the client still sends: the system resets the connection. So
/// what comes is thrown away for a moment first; of too many, the oldest have had theirs.
void ConnectionPool::see_off() {
  while (leaving_.size() > static_cast<std::size_t>(limits_.most_leaving)) {
    ::close(leaving_.front().socket);
    leaving_.pop_front();
  }
  const auto now = Steady::now();
  std::erase_if(leaving_, [&](const Leaving& l) {
    if (now < l.until) return false;
    ::close(l.socket);
    return true;
  });
}

// --- threads ------------------------------------------------------------------------------------

/// The next address in turn that may have one more thread.
std::map<std::string, std::deque<Connection>>::iterator ConnectionPool::next() {
  if (working_ >= most_working_) return ready_.end();
  auto at = ready_.upper_bound(last_served_);
  for (std::size_t i = 0; i < ready_.size(); ++i, ++at) {
    if (at == ready_.end()) at = ready_.begin();
    if (count_of(working_of_, at->first) < most_working_of_one_) return at;
  }
  return ready_.end();
}

/// Who was begun with is ended first.
void ConnectionPool::tell_next() {
  if (working_ >= most_working_) return;
  if (returning_ > 0) {
    back_.notify_one();
  } else if (ready_count_ > 0) {
    changed_.notify_one();
  }
}

void ConnectionPool::work() {
  std::unique_lock lock(mutex_);
  if (!std::exchange(door_is_minded_, true)) {
    lock.unlock();
    return mind_door();
  }
  for (;;) {
    auto from = ready_.end();
    changed_.wait(lock,
                  [&] { return ended_ || (returning_ == 0 && (from = next()) != ready_.end()); });
    if (ended_) return;
    const Connection connection = std::move(from->second.front());
    from->second.pop_front();
    if (from->second.empty()) ready_.erase(from);
    --ready_count_;
    last_served_ = connection.from;
    ++working_;
    ++working_of_[connection.from];
    tell_next();
    Place place(*this, connection);
    lock.unlock();
    serve_(connection, place);
    lock.lock();
    leave(place);
    answered_.push_back(connection.socket);
    wake_door();
    tell_next();
  }
}

void ConnectionPool::leave(Place& place) {
  if (!place.slow_) {
    --working_;
    one_less(working_of_, place.connection_.from);
  } else if (!place.ended_) {
    slow_.remove(&place);
    one_less(slow_of_, place.connection_.from);
  }
}

/// Room for one more that waits for its client. Who has most, and waits longest for a byte, gives way.
bool ConnectionPool::make_room(const std::string& from) {
  const int most_of_one = (most_slow_ + 1) / 2;
  const bool own = count_of(slow_of_, from) >= most_of_one;
  if (!own && static_cast<int>(slow_.size()) < most_slow_) return true;
  if (slow_.empty()) return false;
  const auto most =
      std::max_element(slow_of_.begin(), slow_of_.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  const std::string whose = own ? from : most->first;
  const std::int64_t now = now_ms();
  Place* longest = nullptr;
  std::int64_t waited_ms = kPatienceMs;
  for (Place* p : slow_) {
    const std::int64_t since = p->waits_since_ms_;
    if (p->connection_.from != whose || since == 0 || now - since < waited_ms) continue;
    waited_ms = now - since;
    longest = p;
  }
  if (!longest) return false;
  // Its thread wakes up and ends what it does; its socket is open until then.
  longest->ended_ = true;
  slow_.remove(longest);
  one_less(slow_of_, whose);
  // Who was sending is told why; who was reading has part of an answer.
  ::shutdown(longest->connection_.socket, longest->sends_ ? SHUT_RDWR : SHUT_RD);
  return true;
}

bool ConnectionPool::Place::slow_down() {
  if (slow_) return true;
  const std::scoped_lock lock(pool_.mutex_);
  if (!pool_.make_room(connection_.from)) return false;
  pool_.slow_.push_back(this);
  ++pool_.slow_of_[connection_.from];
  slow_ = true;
  --pool_.working_;
  one_less(pool_.working_of_, connection_.from);
  pool_.tell_next();
  return true;
}

void ConnectionPool::Place::work_again() {
  if (!slow_) return;
  std::unique_lock lock(pool_.mutex_);
  pool_.leave(*this);
  slow_ = false;
  ++pool_.returning_;
  pool_.back_.wait(lock, [this] { return pool_.ended_ || pool_.working_ < pool_.most_working_; });
  --pool_.returning_;
  ++pool_.working_;
  ++pool_.working_of_[connection_.from];
  pool_.tell_next();
}

void ConnectionPool::Place::begin_wait(bool to_send) {
  sends_ = to_send;
  waits_since_ms_ = now_ms();
}

}  // namespace slicecorr::http
