// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Requests and answers of Modbus over TCP or a serial line, one after the other.
#pragma once

#include <sys/socket.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::bridge::detail {

using Bytes = std::vector<std::uint8_t>;

/// A client's end. Frames are read here and not by libmodbus, which takes answers of other units
/// and of any length, and bounds the time between two bytes only. What can't be trusted closes a
/// TCP connection; an exception is an answer and does not.
class ModbusWire {
 public:
  /// Throws `InputError` when the host is not found or the device can't be one. `lockstep`: as in
  /// `make_modbus_link`.
  ModbusWire(const RegisterMap& map, double response_timeout_s, bool lockstep);
  ~ModbusWire();
  ModbusWire(const ModbusWire&) = delete;
  ModbusWire& operator=(const ModbusWire&) = delete;

  /// Another exchange begins: intervals between attempts to connect are counted in exchanges, so
  /// that they are the same in lockstep.
  void begin_exchange() { ++exchange_; }
  /// All of an exchange was answered: the next loss is a first one.
  void exchange_was_good() { opened_in_vain_ = 0; }
  /// The next attempt to connect waits for no interval, which begin anew.
  void hurry();

  /// Sends a request (function code 3, 4, 16 or 23, and data) and gives its answer's data, without
  /// the function code, all of it in time. Nothing: `error` says what
  /// it does instead ("does not answer: ..."), and `exception` is
  /// the code that the machine answered with, or 0.
  /// `data_bytes`: of a right answer.
  std::optional<Bytes> ask(const Bytes& request, std::size_t data_bytes);
  const std::string& error() const { return error_; }
  int exception() const { return exception_; }

 private:
  using Time = std::chrono::steady_clock;
  enum class RequestResult { answered, refused, failed, closed };

  void look_up();
  bool connect(Time::time_point until);
  bool open_line();
  bool begin_tcp();
  bool refuse_connection(int code);
  void disconnect();
  RequestResult try_once(const Bytes& request, std::size_t data_bytes, Time::time_point until,
                         Bytes& data);
  RequestResult silent(const std::string& why);
  RequestResult wrong(const std::string& why);
  RequestResult fail(const std::string& why);
  RequestResult lost(int code);
  /// Throws away what nobody asked for; false where the other end has closed.
  bool drain();
  bool send(const Bytes& frame);
  /// Reads until there are so many bytes.
  RequestResult receive(Bytes& frame, std::size_t bytes, Time::time_point until);
  RequestResult receive_tcp(const Bytes& request, std::size_t data_bytes, Time::time_point until,
                            Bytes& pdu);
  RequestResult receive_line(const Bytes& request, std::size_t data_bytes, Time::time_point until,
                             Bytes& pdu);
  std::string where() const;
  bool serial() const { return map_.transport == Transport::rtu; }

  const RegisterMap map_;
  const Time::duration timeout_;
  const bool lockstep_;
  bool answers_ = true;  ///< the request before was answered in time
  struct Line;           ///< the serial device, opened by libmodbus
  std::unique_ptr<Line> line_;
  sockaddr_storage address_{};
  socklen_t address_size_ = 0;
  int descriptor_ = -1;  ///< connecting or connected
  bool connected_ = false;
  bool served_ = false;  ///< a request was carried out on this connection
  std::uint16_t transaction_ = 0;
  std::int64_t exchange_ = 0, open_from_ = 0;  ///< the next attempt to connect, not before
  int opened_in_vain_ = 0, waited_ = 0;
  int exception_ = 0;
  std::string error_ = "was asked nothing";
};

}  // namespace slicecorr::bridge::detail
