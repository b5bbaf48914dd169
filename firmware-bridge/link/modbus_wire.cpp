// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "link/modbus_wire.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <modbus.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "slicecorr/error.hpp"

namespace slicecorr::bridge::detail {
namespace {

/// Greatest interval between two attempts to connect, and longest wait for one, in exchanges.
constexpr int kLongestInterval = 16;
/// Attempts in a row that follow each other without an interval.
constexpr int kFreeAttempts = 2;
constexpr double kLongestTimeoutS = 10;
/// In lockstep a machine that has just answered in time may take so long once: the computer is busy.
constexpr std::chrono::steady_clock::duration kPatience = std::chrono::seconds(1);
constexpr std::size_t kTcpHeader = 7;  // transaction, protocol, length, unit
constexpr std::uint8_t kExceptionBit = 0x80, kWriteRegisters = 16;

std::uint16_t crc16(const Bytes& bytes, std::size_t count) {
  std::uint16_t crc = 0xffff;
  for (std::size_t i = 0; i < count; ++i) {
    crc = static_cast<std::uint16_t>(crc ^ bytes[i]);
    for (int bit = 0; bit < 8; ++bit) {
      crc = static_cast<std::uint16_t>((crc & 1) != 0 ? (crc >> 1) ^ 0xa001 : crc >> 1);
    }
  }
  return crc;
}

int word(const Bytes& bytes, std::size_t at) { return bytes[at] << 8 | bytes[at + 1]; }

/// What is written comes back by address and number; what is read by its number of bytes.
bool is_about(const Bytes& request, const Bytes& pdu) {
  if (pdu[0] == kWriteRegisters) return std::equal(pdu.begin() + 1, pdu.end(), request.begin() + 1);
  return pdu[1] + 2U == pdu.size();
}

std::string exception_in_words(int code) {
  constexpr std::array<const char*, 12> words{"",
                                              "illegal function",
                                              "illegal data address",
                                              "illegal data value",
                                              "device failure",
                                              "acknowledged, not done yet",
                                              "busy",
                                              "",
                                              "memory parity",
                                              "",
                                              "gateway path unavailable",
                                              "gateway target does not respond"};
  const bool known = code > 0 && code < static_cast<int>(words.size()) &&
                     *words[static_cast<std::size_t>(code)] != 0;
  return fmt::format("exception {}{}{}{}", code, known ? " (" : "",
                     known ? words[static_cast<std::size_t>(code)] : "", known ? ")" : "");
}

}  // namespace

struct ModbusWire::Line {
  explicit Line(const RegisterMap& map)
      : context(modbus_new_rtu(map.device.c_str(), map.baud, map.parity, 8, 1)) {
    if (!context) throw InputError("modbus", "device", modbus_strerror(errno));
    modbus_set_slave(context, map.unit);
  }
  ~Line() { modbus_free(context); }
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;
  modbus_t* context;
};

ModbusWire::ModbusWire(const RegisterMap& map, double response_timeout_s, bool lockstep)
    : map_(map),
      timeout_(std::chrono::duration_cast<Time::duration>(
          std::chrono::duration<double>(std::clamp(response_timeout_s, 1e-3, kLongestTimeoutS)))),
      lockstep_(lockstep) {
  if (serial()) {
    line_ = std::make_unique<Line>(map);
  } else {
    look_up();
  }
}

ModbusWire::~ModbusWire() { disconnect(); }

void ModbusWire::look_up() {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int code =
      getaddrinfo(map_.host.c_str(), std::to_string(map_.port).c_str(), &hints, &found);
  if (code != 0) {
    throw InputError("modbus", "host",
                     fmt::format("'{}' is not found: {}", map_.host, gai_strerror(code)));
  }
  std::memcpy(&address_, found->ai_addr, found->ai_addrlen);
  address_size_ = found->ai_addrlen;
  freeaddrinfo(found);
}

std::string ModbusWire::where() const {
  return serial() ? map_.device : fmt::format("{}:{}", map_.host, map_.port);
}

void ModbusWire::hurry() {
  opened_in_vain_ = 0;
  open_from_ = exchange_;
}

ModbusWire::RequestResult ModbusWire::silent(const std::string& why) {
  return fail(fmt::format("does not answer: {}: {}", where(), why));
}

ModbusWire::RequestResult ModbusWire::wrong(const std::string& why) {
  return fail(fmt::format("answers wrongly: {}: {}", where(), why));
}

ModbusWire::RequestResult ModbusWire::fail(const std::string& why) {
  error_ = why;
  // A serial line stays: what comes too late is thrown away before the next request.
  if (!serial()) disconnect();
  return RequestResult::failed;
}

ModbusWire::RequestResult ModbusWire::lost(int code) {
  error_ = fmt::format("does not answer: {}: {}", where(),
                       code == 0 ? "closes the connection" : std::strerror(code));
  disconnect();
  return RequestResult::closed;
}

bool ModbusWire::refuse_connection(int code) {
  error_ = fmt::format("does not answer: {}: {}", where(), std::strerror(code));
  disconnect();
  return false;
}

bool ModbusWire::open_line() {
  if (modbus_connect(line_->context) != 0) {
    error_ = fmt::format("does not answer: {}: {}", where(), modbus_strerror(errno));
    return false;
  }
  descriptor_ = modbus_get_socket(line_->context);
  return connected_ = true;
}

bool ModbusWire::begin_tcp() {
  descriptor_ =
      ::socket(address_.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, IPPROTO_TCP);
  if (descriptor_ < 0) return refuse_connection(errno);
  const int on = 1;
  ::setsockopt(descriptor_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  const int code =
      ::connect(descriptor_, reinterpret_cast<const sockaddr*>(&address_), address_size_);
  return code == 0 || errno == EINPROGRESS || refuse_connection(errno);
}

bool ModbusWire::connect(Time::time_point until) {
  if (connected_) return true;
  if (descriptor_ < 0) {
    if (exchange_ < open_from_) return false;
    const int doublings = std::min(opened_in_vain_ - kFreeAttempts, 8);
    open_from_ = exchange_ + 1 + (doublings < 0 ? 0 : std::min(kLongestInterval, 1 << doublings));
    ++opened_in_vain_;
    served_ = false;
    waited_ = 0;
    if (serial()) return open_line();
    if (!begin_tcp()) return false;
  }
  pollfd p{descriptor_, POLLOUT, 0};
  const auto left = std::max(Time::duration::zero(), until - Time::now());
  const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(left).count();
  const timespec wait{ns / 1000000000, ns % 1000000000};
  const int ready = ::ppoll(&p, 1, &wait, nullptr);
  if (ready == 0 || (ready < 0 && errno == EINTR)) {
    // The next exchange looks again, for a while.
    if (++waited_ > kLongestInterval) return refuse_connection(ETIMEDOUT);
    error_ = fmt::format("does not answer: {}: does not take the connection", where());
    return false;
  }
  int code = 0;
  socklen_t size = sizeof code;
  ::getsockopt(descriptor_, SOL_SOCKET, SO_ERROR, &code, &size);
  if (ready < 0 || code != 0) return refuse_connection(ready < 0 ? errno : code);
  return connected_ = true;
}

void ModbusWire::disconnect() {
  if (descriptor_ >= 0) {
    if (serial()) {
      modbus_close(line_->context);
    } else {
      ::close(descriptor_);
    }
  }
  descriptor_ = -1;
  connected_ = false;
}

bool ModbusWire::drain() {
  std::array<std::uint8_t, 512> old;
  // Who sends without end is not waited for: his next answer is a wrong one.
  for (int i = 0; i < 16; ++i) {
    const ssize_t n = ::read(descriptor_, old.data(), old.size());
    if (n > 0) continue;
    if (n < 0 && errno == EINTR) continue;
    // A serial line without anything to read says 0 or EAGAIN, as it was set up.
    return n < 0 ? errno == EAGAIN || errno == EWOULDBLOCK : serial();
  }
  return true;
}

bool ModbusWire::send(const Bytes& frame) {
  for (std::size_t at = 0; at < frame.size();) {
    const ssize_t n = serial()
                          ? ::write(descriptor_, frame.data() + at, frame.size() - at)
                          : ::send(descriptor_, frame.data() + at, frame.size() - at, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    // A buffer that has no room for some hundred bytes belongs to somebody who does not listen.
    if (n <= 0) return false;
    at += static_cast<std::size_t>(n);
  }
  return true;
}

ModbusWire::RequestResult ModbusWire::receive(Bytes& frame, std::size_t bytes,
                                              Time::time_point until) {
  while (frame.size() < bytes) {
    pollfd p{descriptor_, POLLIN, 0};
    const auto left = until - Time::now();
    if (left <= Time::duration::zero()) {
      return silent(frame.empty() ? "no answer in time"
                                  : fmt::format("{} bytes of an answer in time, expected {}",
                                                frame.size(), bytes));
    }
    const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(left).count();
    const timespec wait{ns / 1000000000, ns % 1000000000};
    const int ready = ::ppoll(&p, 1, &wait, nullptr);
    if (ready < 0 && errno != EINTR) return lost(errno);
    if (ready <= 0) continue;
    const std::size_t at = frame.size();
    frame.resize(bytes);
    const ssize_t n = ::read(descriptor_, frame.data() + at, bytes - at);
    const int code = n < 0 ? errno : 0;
    frame.resize(at + static_cast<std::size_t>(std::max<ssize_t>(n, 0)));
    if (n > 0 || code == EAGAIN || code == EINTR) continue;
    return lost(code);
  }
  return RequestResult::answered;
}

ModbusWire::RequestResult ModbusWire::receive_tcp(const Bytes& request, std::size_t data_bytes,
                                                  Time::time_point until, Bytes& pdu) {
  Bytes frame;
  if (const auto got = receive(frame, kTcpHeader + 1, until); got != RequestResult::answered)
    return got;
  const bool refused = (frame[7] & kExceptionBit) != 0;
  const int length = word(frame, 4), expected = refused ? 3 : static_cast<int>(data_bytes) + 2;
  if (word(frame, 0) != transaction_) {
    return wrong(fmt::format("answers request {}, asked was {}", word(frame, 0), transaction_));
  }
  if (word(frame, 2) != 0) {
    return wrong(fmt::format("answers in protocol {}, expected 0", word(frame, 2)));
  }
  if (frame[6] != map_.unit) {
    return wrong(fmt::format("unit {} answers, asked was {}", frame[6], map_.unit));
  }
  if ((frame[7] & ~kExceptionBit) != request[0]) {
    return wrong(fmt::format("answers function {}, asked was {}", frame[7], request[0]));
  }
  if (length != expected) {
    return wrong(fmt::format("an answer of {} bytes, expected {}", length, expected));
  }
  const auto all = kTcpHeader - 1 + static_cast<std::size_t>(length);
  if (const auto got = receive(frame, all, until); got != RequestResult::answered) return got;
  pdu.assign(frame.begin() + kTcpHeader, frame.end());
  return refused || is_about(request, pdu) ? RequestResult::answered
                                           : wrong("an answer about other registers");
}

ModbusWire::RequestResult ModbusWire::receive_line(const Bytes& request, std::size_t data_bytes,
                                                   Time::time_point until, Bytes& pdu) {
  // Nothing on a line says which request an answer belongs to: what is no right one is passed over,
  // so that a late one does not put all that follow out of step.
  Bytes frame;
  std::string why;
  const auto pass_over = [&](std::string text) {
    why = std::move(text);
    frame.erase(frame.begin());
  };
  const auto read = [&](std::size_t bytes) {
    const RequestResult got = receive(frame, bytes, until);
    return got == RequestResult::failed && !why.empty() ? wrong(why) : got;
  };
  for (;;) {
    if (const auto got = read(2); got != RequestResult::answered) return got;
    if (frame[0] != map_.unit) {
      pass_over(fmt::format("unit {} answers, asked was {}", frame[0], map_.unit));
      continue;
    }
    if ((frame[1] & ~kExceptionBit) != request[0]) {
      pass_over(fmt::format("answers function {}, asked was {}", frame[1], request[0]));
      continue;
    }
    const bool refused = (frame[1] & kExceptionBit) != 0;
    const std::size_t all = refused ? 5 : data_bytes + 4;
    if (const auto got = read(all); got != RequestResult::answered) return got;
    if (crc16(frame, all - 2) != (frame[all - 1] << 8 | frame[all - 2])) {
      pass_over("an answer with a wrong checksum");
      continue;
    }
    pdu.assign(frame.begin() + 1, frame.begin() + static_cast<std::ptrdiff_t>(all) - 2);
    if (refused || is_about(request, pdu)) return RequestResult::answered;
    pass_over("an answer about other registers");
  }
}

ModbusWire::RequestResult ModbusWire::try_once(const Bytes& request, std::size_t data_bytes,
                                               Time::time_point until, Bytes& data) {
  // An answer that comes too late would else be taken for the next one.
  if (!drain()) return lost(0);
  Bytes frame;
  if (serial()) {
    frame.push_back(static_cast<std::uint8_t>(map_.unit));
    frame.insert(frame.end(), request.begin(), request.end());
    const std::uint16_t crc = crc16(frame, frame.size());
    frame.push_back(static_cast<std::uint8_t>(crc));
    frame.push_back(static_cast<std::uint8_t>(crc >> 8));
  } else {
    ++transaction_;
    const auto length = static_cast<std::uint16_t>(request.size() + 1);
    for (const int value : {static_cast<int>(transaction_), 0, static_cast<int>(length)}) {
      frame.push_back(static_cast<std::uint8_t>(value >> 8));
      frame.push_back(static_cast<std::uint8_t>(value));
    }
    frame.push_back(static_cast<std::uint8_t>(map_.unit));
    frame.insert(frame.end(), request.begin(), request.end());
  }
  if (!send(frame)) return lost(errno);
  Bytes pdu;
  const RequestResult got = serial() ? receive_line(request, data_bytes, until, pdu)
                                     : receive_tcp(request, data_bytes, until, pdu);
  if (got != RequestResult::answered) return got;
  if ((pdu[0] & kExceptionBit) != 0) {
    exception_ = pdu[1];
    error_ = fmt::format("answers with {}: {}", exception_in_words(exception_), where());
    return RequestResult::refused;
  }
  data.assign(pdu.begin() + 1, pdu.end());
  return RequestResult::answered;
}

std::optional<Bytes> ModbusWire::ask(const Bytes& request, std::size_t data_bytes) {
  const bool patient = lockstep_ && answers_;
  const auto start = Time::now();
  const auto until = start + (patient ? std::max(timeout_, kPatience) : timeout_);
  exception_ = 0;
  answers_ = false;
  for (int attempt = 0; attempt < 2 && connect(until); ++attempt) {
    Bytes data;
    const bool served = served_;
    const RequestResult outcome = try_once(request, data_bytes, until, data);
    answers_ = (outcome == RequestResult::answered || outcome == RequestResult::refused) &&
               Time::now() - start <= timeout_;
    if (outcome == RequestResult::answered) {
      served_ = true;
      return data;
    }
    if (outcome != RequestResult::closed) break;
    // Some close after each answer. What is written may be written again; who has served is asked
    // again without an interval.
    if (served) {
      open_from_ = exchange_;
      opened_in_vain_ = std::max(0, opened_in_vain_ - 1);
    }
  }
  return std::nullopt;
}

}  // namespace slicecorr::bridge::detail
