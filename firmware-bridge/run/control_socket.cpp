// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "run/control_socket.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <utility>

#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

constexpr std::size_t kLongestRequest = 4096, kLongestAnswer = 1 << 20;

/// The socket's address by way of its folder's descriptor: paths of folders may be longer than
/// what fits in an address.
struct SocketAddress {
  int folder = -1;
  sockaddr_un address{};
  explicit SocketAddress(const StateFolder& state)
      : folder(::open(state.path.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC)) {
    address.sun_family = AF_UNIX;
    const std::string path = fmt::format("/proc/self/fd/{}/control.sock", folder);
    std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  }
  ~SocketAddress() {
    if (folder >= 0) ::close(folder);
  }
  const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&address); }
};

/// A line, within a time.
std::optional<std::string> read_line(int descriptor, std::size_t longest, int timeout_ms,
                                     bool* closed = nullptr) {
  std::string line;
  const auto until = std::chrono::steady_clock::now() + std::chrono::milliseconds(timeout_ms);
  while (line.size() < longest) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        until - std::chrono::steady_clock::now());
    pollfd p{descriptor, POLLIN, 0};
    if (left.count() <= 0 || ::poll(&p, 1, static_cast<int>(left.count())) <= 0) return {};
    char some[4096];
    const ssize_t n = ::recv(descriptor, some, sizeof some, MSG_DONTWAIT);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    if (n <= 0) {
      if (closed != nullptr) *closed = true;
      return {};
    }
    // One line is all that anybody sends.
    line.append(some, static_cast<std::size_t>(n));
    if (const auto end = line.find('\n'); end != std::string::npos) return line.substr(0, end);
  }
  return {};
}

void send_line(int descriptor, const std::string& text) {
  const std::string line = text + "\n";
  for (std::size_t at = 0; at < line.size();) {
    pollfd p{descriptor, POLLOUT, 0};
    if (::poll(&p, 1, 1000) <= 0) return;
    const ssize_t n =
        ::send(descriptor, line.data() + at, line.size() - at, MSG_DONTWAIT | MSG_NOSIGNAL);
    if (n < 0 && errno != EAGAIN && errno != EINTR) return;
    if (n > 0) at += static_cast<std::size_t>(n);
  }
}

}  // namespace

bool Counter::offer(const PrintState& state) {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (lock) state_ = state;
  return lock.owns_lock();
}

std::optional<std::string> Counter::take() {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return {};
  if (waiting_answer_) {
    answer_ = std::exchange(waiting_answer_, {});
    answered_.notify_all();
  }
  return std::exchange(request_, {});
}

void Counter::answer(std::string json) {
  waiting_answer_ = std::move(json);
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return;  // with the next `take`
  answer_ = std::exchange(waiting_answer_, {});
  answered_.notify_all();
}

std::optional<std::string> Counter::ask(const std::string& request, double timeout_s) {
  std::unique_lock lock(mutex_);
  answer_.reset();
  request_ = request;
  const bool there = answered_.wait_for(lock, std::chrono::duration<double>(timeout_s),
                                        [&] { return answer_.has_value(); });
  request_.reset();
  return there ? std::exchange(answer_, {}) : std::nullopt;
}

std::optional<PrintState> Counter::state() const {
  const std::scoped_lock lock(mutex_);
  return state_;
}

ControlSocket::ControlSocket(const StateFolder& folder, Counter& counter, Text text)
    : folder_(folder), counter_(counter), text_(std::move(text)) {
  const SocketAddress address(folder_);
  // The print's lock is held: what is left here is of a print that is no more.
  ::unlink(folder_.file("control.sock").c_str());
  listener_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  // Before it has a name: who is neither its user nor of its group never reaches it, whatever the umask.
  if (listener_ < 0 || ::fchmod(listener_, 0660) != 0 ||
      ::bind(listener_, address.get(), sizeof address.address) != 0 ||
      ::listen(listener_, 8) != 0 || ::pipe2(wake_, O_CLOEXEC) != 0) {
    const int code = errno;
    if (listener_ >= 0) ::close(listener_);
    throw DeviceError(fmt::format("{}: {}", folder_.file("control.sock"), std::strerror(code)));
  }
  thread_ = std::thread([this] { work(); });
}

ControlSocket::~ControlSocket() {
  ::close(wake_[1]);
  thread_.join();
  ::close(wake_[0]);
  ::close(listener_);
  ::unlink(folder_.file("control.sock").c_str());
}

void ControlSocket::work() {
  while (true) {
    pollfd p[2] = {{listener_, POLLIN, 0}, {wake_[0], POLLIN, 0}};
    if (::poll(p, 2, -1) < 0 && errno != EINTR) return;
    if (p[1].revents != 0) return;
    const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    if (client < 0) continue;
    serve(client);
    ::close(client);
  }
}

void ControlSocket::serve(int client) {
  const auto request = read_line(client, kLongestRequest, 1000);
  if (!request) return;
  if (*request == "status") {
    const auto state = counter_.state();
    return send_line(client, state ? text_(*state, answered_++) : "{}");
  }
  if (*request != "pause" && *request != "resume" && *request != "stop") {
    return send_line(client,
                     R"({"accepted":false,"why":"expected status, pause, resume or stop"})");
  }
  const auto answer = counter_.ask(*request, 2);
  send_line(client, answer.value_or(R"({"accepted":false,"why":"the print does not answer"})"));
}

std::optional<std::string> ask_running(const StateFolder& folder, const std::string& request) {
  const SocketAddress address(folder);
  const int s = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (s < 0 || ::connect(s, address.get(), sizeof address.address) != 0) {
    if (s >= 0) ::close(s);
    return {};
  }
  send_line(s, request);
  bool closed = false;
  auto answer = read_line(s, kLongestAnswer, 5000, &closed);
  ::close(s);
  if (closed) return {};  // the print has just ended
  if (!answer) throw DeviceError(folder.file("control.sock") + ": the print does not answer");
  return answer;
}

}  // namespace slicecorr::bridge
