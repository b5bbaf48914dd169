// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file mqtt.hpp
/// As much of an MQTT 3.1.1 broker as one printer needs, which is its only client: packets, and a
/// server that lets in one address alone.
#pragma once

#include <chrono>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace slicecorr::farm::detail {

/// One packet: its first byte, and what follows its length.
struct MqttPacket {
  unsigned char head = 0;
  std::string body;
  int type() const { return head >> 4; }
};
inline constexpr int kMqttConnect = 1, kMqttPublish = 3, kMqttSubscribe = 8, kMqttUnsubscribe = 10,
                     kMqttPing = 12, kMqttDisconnect = 14;
/// Longest packet that is taken, bytes.
inline constexpr std::size_t kMostPacketBytes = std::size_t{1} << 20;

/// Takes the first packet off `bytes`; nothing where it is not whole yet. Throws `DeviceError` for what
/// is none, or is too long.
std::optional<MqttPacket> take_packet(std::string& bytes);
std::string mqtt_packet(unsigned char head, const std::string& body);
/// With quality 0.
std::string mqtt_publish(const std::string& topic, const std::string& payload);

struct MqttMessage {
  std::string topic, payload;
};

/// For one thread. Throws `DeviceError`.
class MqttBroker {
 public:
  /// Listens at an address of this computer, at a port that is free, for `client` alone (an IPv4
  /// address).
  MqttBroker(const std::string& address, std::string client);
  ~MqttBroker();
  MqttBroker(const MqttBroker&) = delete;
  MqttBroker& operator=(const MqttBroker&) = delete;

  int port() const { return port_; }
  bool connected() const { return peer_ >= 0; }
  /// Whether the client wants what is published under this topic.
  bool subscribed(const std::string& topic) const;
  void publish(const std::string& topic, const std::string& payload);
  /// Works until a message has come, at most so long; nothing where none has.
  std::optional<MqttMessage> next(double most_s);

 private:
  void accept_client();
  void read_some();
  void handle(const MqttPacket& packet);
  void send(const std::string& bytes);
  void drop();

  std::string client_;
  int listener_ = -1, peer_ = -1, port_ = 0;
  std::string bytes_;
  std::set<std::string> topics_;
  std::deque<MqttMessage> came_;
};

}  // namespace slicecorr::farm::detail
