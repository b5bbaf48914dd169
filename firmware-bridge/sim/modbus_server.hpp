// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The machine's end of Modbus: several clients over TCP, or one serial line.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "sim/timed_model.hpp"

namespace slicecorr::bridge {

class ModbusServer {
 public:
  /// `where`: HOST:PORT, port 0 for a free one, or the path of a serial device. All must outlive
  /// this. Throws `InputError` and `DeviceError`.
  ModbusServer(const std::string& where, const Machine& machine, TimedModel& model);
  ~ModbusServer();
  /// With the port that was taken.
  const std::string& address() const;
  /// Serves while `idle`, which is called at least every few milliseconds, says so.
  void serve(const std::function<bool()>& idle);
  /// Somebody is connected (TCP).
  bool busy() const;
  /// Whether the last client has gone since this was asked, even if another has come.
  bool everybody_left();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::bridge
