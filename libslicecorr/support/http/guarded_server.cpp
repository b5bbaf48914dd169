// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/http/guarded_server.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/http/answers.hpp"
#include "support/process/threads.hpp"

namespace slicecorr::http {

namespace {

thread_local GuardedStream* stream_here = nullptr;
thread_local bool turned_away_here = false;

constexpr std::size_t kBufferBytes = 16 << 10;
/// Connections that the system keeps until they are accepted. Who is accepted is answered, or told to come again.
constexpr int kMostToAccept = 1024;
/// Files that a server opens for itself, and at most for each request: its record and what it sends.
constexpr rlim_t kOwnFiles = 24, kFilesOfRequest = 6;

/// A server that may open no file more can't even accept who comes, and would let them wait without a word.
void check_most_files(const ConnectionLimits& limits) {
  rlimit most{};
  if (::getrlimit(RLIMIT_NOFILE, &most) != 0) return;
  const auto wanted = kOwnFiles + kFilesOfRequest * static_cast<rlim_t>(limits.threads) +
                      static_cast<rlim_t>(limits.most_waiting);
  if (most.rlim_cur < wanted) {
    most.rlim_cur = std::min(wanted, most.rlim_max);
    ::setrlimit(RLIMIT_NOFILE, &most);
  }
  if (most.rlim_cur >= wanted) return;
  throw DeviceError(fmt::format("to serve, {} files at a time are wanted, and {} are allowed: {}",
                                wanted, most.rlim_cur, std::strerror(EMFILE)));
}

std::chrono::steady_clock::duration seconds(double s) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(s));
}

void address_of(const sockaddr_storage& address, std::string& ip, int& port) {
  char text[INET6_ADDRSTRLEN] = {};
  if (address.ss_family == AF_INET) {
    const auto& a = reinterpret_cast<const sockaddr_in&>(address);
    ::inet_ntop(AF_INET, &a.sin_addr, text, sizeof text);
    port = ntohs(a.sin_port);
  } else if (address.ss_family == AF_INET6) {
    const auto& a = reinterpret_cast<const sockaddr_in6&>(address);
    ::inet_ntop(AF_INET6, &a.sin6_addr, text, sizeof text);
    port = ntohs(a.sin6_port);
  }
  ip = text;
}

/// Whether a line of the head is a header that asks for a part of an answer.
bool asks_for_a_part(std::string_view line) {
  for (const std::string_view name : {"range", "if-range"}) {
    if (line.size() <= name.size()) continue;
    const bool same = std::equal(name.begin(), name.end(), line.begin(), [](char a, char b) {
      return a == (b >= 'A' && b <= 'Z' ? b - 'A' + 'a' : b);
    });
    const std::size_t after = line.find_first_not_of(" \t", name.size());
    if (same && after != line.npos && line[after] == ':') return true;
  }
  return false;
}

/// An answer that was written may be lost when the client still sends: the system resets the
/// connection. So what comes is thrown away for a moment first.
void close_gently(int socket, int stop_fd) {
  ::shutdown(socket, SHUT_WR);
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(1);
  std::size_t most = 1 << 20;
  char nowhere[4096];
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        until - std::chrono::steady_clock::now());
    pollfd fds[2] = {{socket, POLLIN, 0}, {stop_fd, POLLIN, 0}};
    if (left.count() <= 0 || ::poll(fds, 2, static_cast<int>(left.count())) <= 0) break;
    if (fds[1].revents != 0) break;
    const ssize_t n = ::recv(socket, nowhere, sizeof nowhere, MSG_DONTWAIT);
    if (n <= 0 || static_cast<std::size_t>(n) > most) break;
    most -= static_cast<std::size_t>(n);
  }
  ::close(socket);
}

}  // namespace

// --- stream -------------------------------------------------------------------------------------

GuardedStream::GuardedStream(int socket, int stop_fd, const ConnectionLimits& limits)
    : socket_(socket),
      stop_fd_(stop_fd),
      limits_(limits),
      left_(limits.header_bytes),
      read_until_(Steady::now() + seconds(limits.request_s)),
      buffer_(kBufferBytes) {
  stream_here = this;
}

GuardedStream* GuardedStream::current() { return stream_here; }

void GuardedStream::allow_body(std::int64_t bytes) {
  // Requests that wait for leave to send are checked twice.
  if (body_allowed_) return;
  body_allowed_ = true;
  left_ += bytes;
  read_until_ = Steady::now() +
                seconds(limits_.request_s + static_cast<double>(bytes) / limits_.least_bytes_s);
}

bool GuardedStream::wait(short events, Steady::time_point until) const {
  for (;;) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(until - Steady::now()).count();
    if (left <= 0) return false;
    pollfd fds[2] = {{socket_, events, 0}, {stop_fd_, POLLIN, 0}};
    const int ready = ::poll(fds, 2, static_cast<int>(std::min<long long>(left, 60'000)));
    if (ready < 0 && errno != EINTR) return false;
    if (fds[1].revents != 0) return false;
    if (fds[0].revents != 0) return true;
  }
}

bool GuardedStream::is_readable() const { return line_at_ < line_.size() || bytes_come(); }

bool GuardedStream::bytes_come() const {
  return begin_ < end_ ||
         wait(POLLIN, std::min(read_until_, Steady::now() + seconds(limits_.stall_s)));
}

bool GuardedStream::is_writable() const {
  return wait(POLLOUT, Steady::now() + seconds(limits_.stall_s));
}

ssize_t GuardedStream::read(char* data, std::size_t size) {
  if (line_at_ == line_.size()) {
    if (!in_head_) return read_bytes(data, size);
    const ssize_t n = read_line();
    if (n <= 0) return n;
  }
  const std::size_t n = std::min(size, line_.size() - line_at_);
  std::memcpy(data, line_.data() + line_at_, n);
  line_at_ += n;
  return static_cast<ssize_t>(n);
}

/// The next line of the head that the server is to see; without its end where no more comes. A line
/// that ends as none of HTTP does would be a line to one of us and none to the other: it ends the
/// connection.
ssize_t GuardedStream::read_line() {
  do {
    line_.clear();
    line_at_ = 0;
    for (char c = 0; c != '\n';) {
      const ssize_t n = read_bytes(&c, 1);
      if (n <= 0 && line_.empty()) return n;
      if (n <= 0) break;
      line_ += c;
    }
    const bool ended = line_.ends_with('\n');
    if (ended && (!line_.ends_with("\r\n") || line_.find('\r') + 2 != line_.size())) {
      line_.clear();
      return -1;
    }
  } while (asks_for_a_part(line_));
  in_head_ = line_ != "\r\n";
  return static_cast<ssize_t>(line_.size());
}

ssize_t GuardedStream::read_bytes(char* data, std::size_t size) {
  // The server reads headers byte by byte.
  if (begin_ == end_) {
    const auto most = static_cast<std::size_t>(
        std::clamp<std::int64_t>(left_, 0, static_cast<std::int64_t>(buffer_.size())));
    if (most == 0) return -1;
    for (;;) {
      if (!bytes_come()) return -1;
      const ssize_t n = ::recv(socket_, buffer_.data(), most, MSG_DONTWAIT);
      if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
      if (n <= 0) return n;
      left_ -= n;
      begin_ = 0;
      end_ = static_cast<std::size_t>(n);
      break;
    }
  }
  const std::size_t n = std::min(size, end_ - begin_);
  std::memcpy(data, buffer_.data() + begin_, n);
  begin_ += n;
  return static_cast<ssize_t>(n);
}

ssize_t GuardedStream::write(const char* data, std::size_t size) {
  if (written_ == 0) write_since_ = Steady::now();
  for (;;) {
    const auto pace_until = write_since_ + seconds(limits_.request_s + limits_.stall_s +
                                                   written_ / limits_.least_bytes_s);
    if (!wait(POLLOUT, std::min(pace_until, Steady::now() + seconds(limits_.stall_s)))) return -1;
    const ssize_t n = ::send(socket_, data, size, MSG_DONTWAIT | MSG_NOSIGNAL);
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (n > 0) written_ += static_cast<double>(n);
    return n;
  }
}

void GuardedStream::get_remote_ip_and_port(std::string& ip, int& port) const {
  sockaddr_storage address{};
  socklen_t length = sizeof address;
  if (::getpeername(socket_, reinterpret_cast<sockaddr*>(&address), &length) == 0) {
    address_of(address, ip, port);
  }
}

void GuardedStream::get_local_ip_and_port(std::string& ip, int& port) const {
  sockaddr_storage address{};
  socklen_t length = sizeof address;
  if (::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &length) == 0) {
    address_of(address, ip, port);
  }
}

// --- pool ---------------------------------------------------------------------------------------

BoundedPool::BoundedPool(const ConnectionLimits& limits, std::function<void()> idle)
    : most_waiting_(static_cast<std::size_t>(limits.most_waiting)), idle_(std::move(idle)) {
  threads_ = slicecorr::detail::start_threads(limits.threads, [this] { work(); });
}

bool BoundedPool::turning_away() { return turned_away_here; }

void BoundedPool::enqueue(std::function<void()> connection) {
  {
    const std::scoped_lock lock(mutex_);
    if (waiting_.size() < most_waiting_ && !ended_) {
      waiting_.push_back(std::move(connection));
      changed_.notify_one();
      return;
    }
  }
  turned_away_here = true;
  connection();
  turned_away_here = false;
}

void BoundedPool::work() {
  for (;;) {
    std::function<void()> connection;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return ended_ || !waiting_.empty(); });
      if (waiting_.empty()) return;
      connection = std::move(waiting_.front());
      waiting_.pop_front();
      turned_away_here = ended_;
    }
    connection();
  }
}

void BoundedPool::shutdown() {
  {
    const std::scoped_lock lock(mutex_);
    ended_ = true;
  }
  changed_.notify_all();
  for (std::thread& t : threads_) t.join();
}

// --- server -------------------------------------------------------------------------------------

GuardedServer::GuardedServer(const ConnectionLimits& limits)
    : limits_(limits), stop_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (stop_fd_ < 0) throw DeviceError("the system gives no event counter");
  new_task_queue = [this] {
    // httplib's stop() does nothing before it listens: a signal that came early counts then.
    return new BoundedPool(limits_, [this] {
      if (stopping_) stop();
    });
  };
  set_idle_interval(0, 300'000);
}

GuardedServer::~GuardedServer() { ::close(stop_fd_); }

int GuardedServer::bind(const std::string& host, int port) {
  check_most_files(limits_);
  set_tcp_nodelay(true);
  // Not SO_REUSEPORT, which httplib sets: a second server would get half of the connections.
  set_socket_options([](socket_t socket) {
    const int yes = 1;
    ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  set_exception_handler(
      [](const httplib::Request&, httplib::Response& response, const std::exception_ptr&) {
        send_error(response, 500, "defect", "a defect of the program");
      });
  // Answers that httplib gives by itself: requests that can't be read.
  set_error_handler([](const httplib::Request&, httplib::Response& response) {
    if (response.body.empty() && response.content_length_ == 0) {
      send_error(response, response.status, "request", "the request can't be served");
    }
  });
  if (port == 0) {
    port = bind_to_any_port(host);
  } else if (!bind_to_port(host, port)) {
    throw DeviceError(fmt::format(
        "{}:{} can't be listened to: in use, or no address of this machine", host, port));
  }
  if (port <= 0) throw DeviceError(host + " can't be listened to: no address of this machine");
  // httplib lets five wait to be accepted: of sixty who come at once the others waited for seconds, some for a minute.
  ::listen(svr_sock_, kMostToAccept);
  return port;
}

void GuardedServer::stop_now() {
  stopping_ = true;
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = ::write(stop_fd_, &one, sizeof one);
  stop();
}

bool GuardedServer::process_and_close_socket(socket_t socket) {
  if (BoundedPool::turning_away()) {
    static constexpr std::string_view busy =
        "HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 2\r\n"
        "Content-Length: 0\r\n\r\n";
    [[maybe_unused]] const ssize_t n =
        ::send(socket, busy.data(), busy.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    ::close(socket);
    return false;
  }
  bool closed = false, good = false;
  {
    GuardedStream stream(socket, stop_fd_, limits_);
    good = process_request(stream, true, closed, nullptr);
    stream_here = nullptr;
  }
  if (stopping_) {
    ::close(socket);
  } else {
    close_gently(socket, stop_fd_);
  }
  return good;
}

std::string address_text(const std::string& host, int port) {
  const bool numbers = host.find(':') != std::string::npos;  // of IPv6
  return fmt::format("http://{}{}{}:{}", numbers ? "[" : "", host, numbers ? "]" : "", port);
}

}  // namespace slicecorr::http
