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

  struct Outcome {
    int exception = 0;              ///< of Modbus; 0: carried out
    std::optional<SimFault> fault;  ///< how the wire is to misbehave
  };
  /// Carries out a request, without its address and checks: function code and data. Functions 3, 6,
  /// 16 and 23 are known.
  Outcome carry_out(std::span<const std::uint8_t> request);

  /// All of them, from `first()` on, as they are now; those that nobody has are 0.
  std::vector<std::uint16_t> all() const;
  int first() const { return first_; }

 private:
  bool readable(int address, int count) const;
  bool writable(int address, int count) const;
  /// Modbus exception, or 0.
  int write(int address, std::span<const std::uint8_t> values, std::optional<SimFault>& fault);
  bool acceptable(const SetPoints& s) const;

  const Machine& machine_;
  const RegisterMap& map_;
  TimedModel& model_;
  int first_, end_;
  std::vector<std::uint16_t> written_;
};

}  // namespace slicecorr::bridge
