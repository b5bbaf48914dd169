// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/mqtt.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::farm::detail {

namespace {

using slicecorr::detail::errno_message;
constexpr std::size_t kMostWaiting = 1000, kMostTopics = 100;
constexpr int kSendMs = 10'000;

[[noreturn]] void no_mqtt(const char* what) {
  throw DeviceError(std::string("the machine sends what is no MQTT: ") + what);
}

std::string number16(std::size_t n) {
  return {static_cast<char>(n >> 8U & 0xFFU), static_cast<char>(n & 0xFFU)};
}

/// A text with its length before it, from `at` on.
std::string text_at(const std::string& body, std::size_t& at) {
  if (body.size() < at + 2) no_mqtt("a text without its length");
  const std::size_t size = static_cast<std::size_t>(static_cast<unsigned char>(body[at])) << 8U |
                           static_cast<unsigned char>(body[at + 1]);
  if (body.size() < at + 2 + size) no_mqtt("a text that is too short");
  std::string text = body.substr(at + 2, size);
  at += 2 + size;
  return text;
}

/// Whether a filter means a topic: + is one level, # all that follow.
bool means(std::string_view filter, std::string_view topic) {
  for (;;) {
    const std::size_t f = filter.find('/'), t = topic.find('/');
    const std::string_view level = filter.substr(0, f);
    if (level == "#") return true;
    if (level != "+" && level != topic.substr(0, t)) return false;
    if (f == filter.npos || t == topic.npos) return f == t || filter.substr(f) == "/#";
    filter.remove_prefix(f + 1);
    topic.remove_prefix(t + 1);
  }
}

}  // namespace

std::optional<MqttPacket> take_packet(std::string& bytes) {
  std::size_t size = 0, at = 1;
  for (unsigned shift = 0;; shift += 7, ++at) {
    if (shift > 21) no_mqtt("a length of more than four bytes");
    if (at >= bytes.size()) return std::nullopt;
    const auto byte = static_cast<unsigned char>(bytes[at]);
    size |= static_cast<std::size_t>(byte & 0x7FU) << shift;
    if ((byte & 0x80U) == 0) break;
  }
  if (size > kMostPacketBytes) no_mqtt("a packet of more than 1 MiB");
  ++at;
  if (bytes.size() < at + size) return std::nullopt;
  MqttPacket packet{static_cast<unsigned char>(bytes[0]), bytes.substr(at, size)};
  bytes.erase(0, at + size);
  return packet;
}

std::string mqtt_packet(unsigned char head, const std::string& body) {
  std::string bytes(1, static_cast<char>(head));
  std::size_t left = body.size();
  do {
    const std::size_t more = left > 127 ? 0x80U : 0U;
    bytes += static_cast<char>((left & 0x7FU) | more);
    left >>= 7U;
  } while (left > 0);
  return bytes + body;
}

std::string mqtt_publish(const std::string& topic, const std::string& payload) {
  return mqtt_packet(kMqttPublish << 4, number16(topic.size()) + topic + payload);
}

MqttBroker::MqttBroker(const std::string& address, std::string client)
    : client_(std::move(client)),
      listener_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
  sockaddr_in at{};
  at.sin_family = AF_INET;
  socklen_t size = sizeof at;
  auto* const any = reinterpret_cast<sockaddr*>(&at);
  if (listener_ < 0 || ::inet_pton(AF_INET, address.c_str(), &at.sin_addr) != 1 ||
      ::bind(listener_, any, sizeof at) != 0 || ::listen(listener_, 4) != 0 ||
      ::getsockname(listener_, any, &size) != 0) {
    const std::string why = errno_message(address, "can't be listened at");
    if (listener_ >= 0) ::close(listener_);
    throw DeviceError(why);
  }
  port_ = ntohs(at.sin_port);
}

MqttBroker::~MqttBroker() {
  drop();
  ::close(listener_);
}

void MqttBroker::drop() {
  if (peer_ >= 0) ::close(peer_);
  peer_ = -1;
  bytes_.clear();
  topics_.clear();
}

bool MqttBroker::subscribed(const std::string& topic) const {
  for (const std::string& filter : topics_) {
    if (means(filter, topic)) return true;
  }
  return false;
}

void MqttBroker::send(const std::string& bytes) {
  for (std::size_t at = 0; at < bytes.size();) {
    const ssize_t n = ::send(peer_, bytes.data() + at, bytes.size() - at, MSG_NOSIGNAL);
    if (n > 0) {
      at += static_cast<std::size_t>(n);
      continue;
    }
    pollfd fd{peer_, POLLOUT, 0};
    const bool wait = n < 0 && (errno == EAGAIN || errno == EINTR);
    if (!wait || ::poll(&fd, 1, kSendMs) <= 0) {
      drop();
      throw DeviceError("the machine closed its connection");
    }
  }
}

void MqttBroker::publish(const std::string& topic, const std::string& payload) {
  if (!connected()) throw DeviceError("the machine is not connected");
  send(mqtt_publish(topic, payload));
}

void MqttBroker::accept_client() {
  sockaddr_in from{};
  socklen_t size = sizeof from;
  const int fd =
      ::accept4(listener_, reinterpret_cast<sockaddr*>(&from), &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
  char text[INET_ADDRSTRLEN] = "";
  if (fd < 0) return;
  ::inet_ntop(AF_INET, &from.sin_addr, text, sizeof text);
  // Nobody else's business.
  if (client_ != text) {
    ::close(fd);
    return;
  }
  drop();  // one that comes again has forgotten the connection before
  peer_ = fd;
}

void MqttBroker::handle(const MqttPacket& p) {
  switch (p.type()) {
    case kMqttConnect:
      return send(mqtt_packet(0x20, std::string("\0\0", 2)));
    case kMqttSubscribe: {
      std::size_t at = 2;
      std::string granted = p.body.substr(0, 2);
      while (at < p.body.size()) {
        const std::string topic = text_at(p.body, at);
        if (at >= p.body.size() || topics_.size() >= kMostTopics) no_mqtt("a bad subscription");
        ++at;  // the quality that is wished; ours is 0
        topics_.insert(topic);
        granted += '\0';
      }
      return send(mqtt_packet(0x90, granted));
    }
    case kMqttUnsubscribe: {
      std::size_t at = 2;
      while (at < p.body.size()) topics_.erase(text_at(p.body, at));
      return send(mqtt_packet(0xB0, p.body.substr(0, 2)));
    }
    case kMqttPublish: {
      std::size_t at = 0;
      MqttMessage message;
      message.topic = text_at(p.body, at);
      const unsigned quality = p.head >> 1U & 3U;
      if (quality > 0) {
        if (p.body.size() < at + 2) no_mqtt("a message without its number");
        const std::string number = p.body.substr(at, 2);
        at += 2;
        send(mqtt_packet(quality == 1 ? 0x40 : 0x50, number));
      }
      message.payload = p.body.substr(at);
      came_.push_back(std::move(message));
      if (came_.size() > kMostWaiting) came_.pop_front();
      return;
    }
    case 6:  // the second half of quality 2
      return send(mqtt_packet(0x70, p.body.substr(0, 2)));
    case kMqttPing:
      return send(mqtt_packet(0xD0, ""));
    case kMqttDisconnect:
      return drop();
    default:
      return;
  }
}

void MqttBroker::read_some() {
  char buffer[65536];
  const ssize_t n = ::recv(peer_, buffer, sizeof buffer, 0);
  if (n < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (n <= 0) return drop();
  bytes_.append(buffer, static_cast<std::size_t>(n));
  try {
    while (connected()) {
      const auto packet = take_packet(bytes_);
      if (!packet) return;
      handle(*packet);
    }
  } catch (const DeviceError&) {
    drop();
    throw;
  }
}

std::optional<MqttMessage> MqttBroker::next(double most_s) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(most_s);
  while (came_.empty()) {
    const double left =
        std::chrono::duration<double>(until - std::chrono::steady_clock::now()).count();
    if (left <= 0) return std::nullopt;
    pollfd fds[2] = {{listener_, POLLIN, 0}, {peer_, POLLIN, 0}};
    if (::poll(fds, connected() ? 2 : 1, static_cast<int>(left * 1000) + 1) <= 0) continue;
    if (fds[0].revents != 0) {
      accept_client();
    } else if (connected() && fds[1].revents != 0) {
      read_some();
    }
    // Whoever waits for the connection alone looks now.
    if (came_.empty() && fds[0].revents != 0) return std::nullopt;
    if (came_.empty() && !topics_.empty()) return std::nullopt;
  }
  MqttMessage message = std::move(came_.front());
  came_.pop_front();
  return message;
}

}  // namespace slicecorr::farm::detail
