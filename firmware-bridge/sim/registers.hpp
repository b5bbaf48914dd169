// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Registers of the machine: what requests do, whatever wire they come by.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "sim/timed_model.hpp"

namespace slicecorr::bridge {

class Registers {
 public:
  Registers(const Machine& machine, const RegisterMap& map, TimedModel& model);

  struct Reply {
    int exception = 0;              ///< of Modbus; 0: carried out
    std::optional<SimFault> fault;  ///< how the wire is to misbehave
  };
  /// Carries out a request, without its address and checks: function code and data. Functions 3, 6,
  /// 16 and 23 are known, and 4 where the map reads by it.
  Reply carry_out(std::span<const std::uint8_t> request);

  /// All of them, from the first on, as they are now; those that nobody has are 0. Input registers
  /// only where the map reads by function 4.
  std::vector<std::uint16_t> holding() const;
  std::vector<std::uint16_t> input() const;
  int first_holding() const { return first_; }
  int first_input() const { return has_input() ? map_.read_address : 0; }

 private:
  bool has_input() const { return map_.exchange == Exchange::fc16_fc4; }
  bool readable(int address, int count, bool input) const;
  std::vector<std::uint16_t> status() const;
  bool writable(int address, int count) const;
  /// Modbus exception, or 0.
  int write(int address, std::span<const std::uint8_t> values, std::optional<SimFault>& fault);
  bool acceptable(const SetPoints& s) const;

  const Machine& machine_;
  const RegisterMap& map_;
  TimedModel& model_;
  const std::vector<RegisterRun> runs_;
  int first_, end_;
  std::vector<std::uint16_t> written_;
};

}  // namespace slicecorr::bridge
