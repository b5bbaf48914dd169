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
#include "support/http/guard.hpp"

namespace slicecorr::http {

namespace {

thread_local GuardedStream* stream_here = nullptr;

constexpr std::size_t kBufferBytes = 16 << 10;
/// Connections that the system keeps until they are accepted. Who is accepted is answered, or told to come again.
constexpr int kMostToAccept = 1024;
/// Files that a server opens for itself, and at most for each request: its record and what it sends. A client that is waited
/// for has its connection and the file that it sends or gets.
constexpr rlim_t kOwnFiles = 24, kFilesOfRequest = 6, kFilesOfSlow = 2;
/// For those that wait, whether for a thread or with one: with fewer nobody would be served well.
constexpr rlim_t kLeastBeside = 64;
/// What is larger is not sent or taken among those that work; and so long a thread that works waits for its client in all.
constexpr std::int64_t kQuickBytes = 256 << 10;
constexpr auto kQuickWait = std::chrono::milliseconds(200);

/// The connections for which there are files. Throws `DeviceError` where they are too few: a server that may open no file more
/// can't even accept who comes, and would let them wait without a word.
ConnectionLimits within_most_files(ConnectionLimits limits) {
  rlimit most{};
  if (::getrlimit(RLIMIT_NOFILE, &most) != 0) return limits;
  const auto files = [](int count) { return static_cast<rlim_t>(count); };
  const rlim_t work = kOwnFiles + kFilesOfRequest * files(limits.threads);
  const rlim_t beside = kFilesOfSlow * files(limits.most_slow) + files(limits.most_waiting) +
                        files(limits.most_leaving);
  if (most.rlim_cur < work + beside) {
    most.rlim_cur = std::min(work + beside, most.rlim_max);
    ::setrlimit(RLIMIT_NOFILE, &most);
  }
  if (most.rlim_cur >= work + beside) return limits;
  const rlim_t least = work + std::min(kLeastBeside, beside);
  if (most.rlim_cur < least) {
    throw DeviceError(fmt::format("to serve, {} files at a time are wanted, and {} are allowed: {}",
                                  least, most.rlim_cur, std::strerror(EMFILE)));
  }
  const double share = static_cast<double>(most.rlim_cur - work) / static_cast<double>(beside);
  for (int* count : {&limits.most_slow, &limits.most_waiting, &limits.most_leaving}) {
    *count = static_cast<int>(share * *count);
  }
  return limits;
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

}  // namespace

// --- stream -------------------------------------------------------------------------------------

GuardedStream::GuardedStream(const Connection& connection, ConnectionPool::Place& place,
                             int stop_fd, const ConnectionLimits& limits)
    : place_(place),
      socket_(connection.socket),
      stop_fd_(stop_fd),
      limits_(limits),
      left_(limits.header_bytes - static_cast<std::int64_t>(connection.bytes.size())),
      read_until_(std::min(connection.until, connection.stalls_at)),
      buffer_(std::max(kBufferBytes, connection.bytes.size())),
      end_(connection.bytes.size()) {
  std::copy(connection.bytes.begin(), connection.bytes.end(), buffer_.begin());
  stream_here = this;
}

GuardedStream::~GuardedStream() { stream_here = nullptr; }

GuardedStream* GuardedStream::current() { return stream_here; }

void GuardedStream::allow_body(std::int64_t bytes) {
  // Requests that wait for leave to send are checked twice.
  if (body_allowed_) return;
  body_allowed_ = true;
  left_ += bytes;
  body_left_ = bytes;
  read_until_ = Steady::now() +
                seconds(limits_.request_s + static_cast<double>(bytes) / limits_.least_bytes_s);
}

void GuardedStream::fail_body() {
  if (stream_here && (stream_here->crowded_ || stream_here->place_.ended())) {
    throw ApiError(503, "busy", "too many requests are on their way here; try again soon");
  }
  throw ApiError(400, "body", "the body is shorter than announced, or came too slowly");
}

/// Waits among those that work for a moment only.
bool GuardedStream::wait(short events, Steady::time_point until) const {
  if (Steady::now() >= until) return false;
  if (poll_until(events, {})) return true;
  if (!place_.slow()) {
    const auto begin = Steady::now();
    const bool good = poll_until(events, std::min(until, begin + kQuickWait - waited_));
    const auto now = Steady::now();
    waited_ += now - begin;
    if (good || now >= until || waited_ < kQuickWait) return good;
    if (!place_.slow_down()) {
      crowded_ = true;
      return false;
    }
  }
  place_.begin_wait(events == POLLOUT);
  const bool good = poll_until(events, until);
  place_.end_wait();
  return good && !place_.ended();
}

bool GuardedStream::poll_until(short events, Steady::time_point until) const {
  for (;;) {
    const auto left = std::max<std::int64_t>(
        0, std::chrono::ceil<std::chrono::milliseconds>(until - Steady::now()).count());
    pollfd fds[2] = {{socket_, events, 0}, {stop_fd_, POLLIN, 0}};
    const int ready = ::poll(fds, 2, static_cast<int>(std::min<std::int64_t>(left, 60'000)));
    if (ready < 0 && errno != EINTR) return false;
    if (fds[1].revents != 0) return false;
    if (fds[0].revents != 0) return true;
    if (left == 0) return false;
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
    if (body_left_ > kQuickBytes && !place_.slow_down()) {
      crowded_ = true;
      return -1;
    }
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
  if (body_left_ > 0) {
    body_left_ -= static_cast<std::int64_t>(n);
    if (body_left_ <= 0) place_.work_again();
  }
  return static_cast<ssize_t>(n);
}

ssize_t GuardedStream::write(const char* data, std::size_t size) {
  if (written_ == 0) write_since_ = Steady::now();
  // Where there is no room for it, it goes on here as long as its client takes it quickly.
  if (written_ > static_cast<double>(kQuickBytes)) static_cast<void>(place_.slow_down());
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

// --- server -------------------------------------------------------------------------------------

GuardedServer::GuardedServer(const ConnectionLimits& limits)
    : limits_(limits), stop_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (stop_fd_ < 0) throw DeviceError("the system gives no event counter");
  new_task_queue = [this] {
    // httplib's stop() does nothing before it listens: a signal that came early counts then.
    pool_ = new ConnectionPool(
        limits_, stop_fd_,
        [this](const Connection& connection, ConnectionPool::Place& place) {
          serve(connection, place);
        },
        [this] {
          if (stopping_) stop();
        });
    return pool_;
  };
  set_idle_interval(0, 300'000);
}

GuardedServer::~GuardedServer() { ::close(stop_fd_); }

int GuardedServer::bind(const std::string& host, int port) {
  limits_ = within_most_files(limits_);
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

/// Called by who listens, for each connection that was accepted.
bool GuardedServer::process_and_close_socket(socket_t socket) {
  pool_->take(socket);
  return true;
}

void GuardedServer::serve(const Connection& connection, ConnectionPool::Place& place) {
  bool closed = false;
  GuardedStream stream(connection, place, stop_fd_, limits_);
  process_request(stream, true, closed, nullptr);
}

std::string address_text(const std::string& host, int port) {
  const bool numbers = host.find(':') != std::string::npos;  // of IPv6
  return fmt::format("http://{}{}{}:{}", numbers ? "[" : "", host, numbers ? "]" : "", port);
}

}  // namespace slicecorr::http
