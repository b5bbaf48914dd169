// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sim/registers.hpp"

#include <modbus.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"

namespace slicecorr::bridge {

namespace {

constexpr int kReadRegisters = 0x03, kReadInput = 0x04, kWriteRegister = 0x06,
              kWriteRegisters = 0x10, kWriteAndRead = 0x17;

int word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return bytes[at] << 8 | bytes[at + 1];
}

}  // namespace

Registers::Registers(const Machine& machine, const RegisterMap& map, TimedModel& model)
    : machine_(machine),
      map_(map),
      model_(model),
      runs_(write_runs(map)),
      first_(map.write_address),
      end_(map.write_address + map.write_count) {
  if (!has_input()) {
    first_ = std::min(first_, map.read_address);
    end_ = std::max(end_, map.read_address + map.read_count);
  }
  SetPoints begin;
  begin.watchdog_s = machine.limits.watchdog_s;
  written_ = encode(map_, begin);
}

bool Registers::writable(int address, int count) const {
  return std::any_of(runs_.begin(), runs_.end(), [&](const RegisterRun& run) {
    return address >= run.address && address + count <= run.address + run.count;
  });
}

bool Registers::readable(int address, int count, bool input) const {
  for (int a = address; a < address + count; ++a) {
    const bool status = a >= map_.read_address && a < map_.read_address + map_.read_count;
    if (status && input == has_input()) continue;
    if (input || !writable(a, 1)) return false;
  }
  return true;
}

std::vector<std::uint16_t> Registers::status() const {
  std::vector<std::uint16_t> registers;
  model_.with([&](PrinterModel& model) { registers = encode(map_, model.status()); });
  return registers;
}

std::vector<std::uint16_t> Registers::holding() const {
  std::vector<std::uint16_t> registers(static_cast<std::size_t>(end_ - first_), 0);
  std::copy(written_.begin(), written_.end(), registers.begin() + (map_.write_address - first_));
  if (!has_input()) {
    const auto now = status();
    std::copy(now.begin(), now.end(), registers.begin() + (map_.read_address - first_));
  }
  return registers;
}

std::vector<std::uint16_t> Registers::input() const {
  return has_input() ? status() : std::vector<std::uint16_t>();
}

bool Registers::acceptable(const SetPoints& s) const {
  // Half a step of a register is rounding.
  const auto within = [&](Signal signal, double value, double least, double greatest) {
    const auto reg = map_.write.find(signal);
    const double slack = reg == map_.write.end() ? 0 : std::abs(reg->second.scale);
    return value >= least - slack && value <= greatest + slack;
  };
  const Stage& stage = machine_.stage;
  const double uv = machine_.printer.uv ? machine_.printer.uv->max_mw_cm2() : 0;
  return within(Signal::target_um, s.target_um, 0, stage.travel_um) &&
         within(Signal::speed_um_s, s.speed_um_s, 0, stage.fastest_um_s()) &&
         within(Signal::acceleration_um_s2, s.acceleration_um_s2, 0, stage.acceleration_um_s2) &&
         within(Signal::blue_share, s.blue_share, 0, machine_.blue.max_share) &&
         within(Signal::uv_mw_cm2, s.uv_mw_cm2, 0, uv) &&
         within(Signal::watchdog_s, s.watchdog_s, 0, machine_.limits.watchdog_s) &&
         s.frame >= kBlackFrame;
}

int Registers::write(int address, std::span<const std::uint8_t> values,
                     std::optional<SimFault>& fault) {
  const int count = static_cast<int>(values.size() / 2);
  if (!writable(address, count)) return MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS;
  std::vector<std::uint16_t> changed = written_;
  for (int i = 0; i < count; ++i) {
    changed[static_cast<std::size_t>(address - map_.write_address + i)] =
        static_cast<std::uint16_t>(word(values, static_cast<std::size_t>(2 * i)));
  }
  SetPoints set_points;
  try {
    set_points = decode_set_points(map_, changed);
  } catch (const DeviceError&) {
    return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
  }
  if (!acceptable(set_points)) return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
  written_ = std::move(changed);
  model_.with_exchange([&](PrinterModel& model) {
    model.take(set_points);
    fault = model.wire_fault();
  });
  return 0;
}

Registers::Reply Registers::carry_out(std::span<const std::uint8_t> r) {
  Reply outcome;
  const auto refuse = [&](int exception) {
    outcome.exception = exception;
    return outcome;
  };
  if (r.empty()) return refuse(MODBUS_EXCEPTION_ILLEGAL_FUNCTION);
  const int function = r[0];
  const bool reads = function == kReadRegisters || (function == kReadInput && has_input());
  if (!reads && function != kWriteRegister && function != kWriteRegisters &&
      function != kWriteAndRead) {
    return refuse(MODBUS_EXCEPTION_ILLEGAL_FUNCTION);
  }
  const auto wrong = [&] { return refuse(MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE); };
  if (r.size() < 5) return wrong();
  const int address = word(r, 1), count = word(r, 3);
  if (reads) {
    if (r.size() != 5 || count < 1 || count > MODBUS_MAX_READ_REGISTERS) return wrong();
    if (!readable(address, count, function == kReadInput)) {
      return refuse(MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS);
    }
    return outcome;
  }
  if (function == kWriteRegister) {
    if (r.size() != 5) return wrong();
    return refuse(write(address, r.subspan(3, 2), outcome.fault));
  }
  // The two that write several: number of registers, then of bytes, then these.
  const bool both = function == kWriteAndRead;
  const std::size_t head = both ? 10 : 6;
  if (r.size() < head) return wrong();
  const int to = both ? word(r, 5) : address, written = both ? word(r, 7) : count;
  const int most = both ? MODBUS_MAX_WR_WRITE_REGISTERS : MODBUS_MAX_WRITE_REGISTERS;
  if (written < 1 || written > most || r[head - 1] != 2 * written ||
      r.size() != head + static_cast<std::size_t>(2 * written)) {
    return wrong();
  }
  if (both) {
    if (count < 1 || count > MODBUS_MAX_WR_READ_REGISTERS) return wrong();
    if (!readable(address, count, false)) return refuse(MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS);
  }
  return refuse(write(to, r.subspan(head), outcome.fault));
}

}  // namespace slicecorr::bridge
