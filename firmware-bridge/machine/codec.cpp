// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Set-points and status as registers. 32 bits are two registers; never floating point on the wire:
// libraries and controllers don't agree on the order of its bytes.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "machine/names.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {

namespace {

using Registers = std::vector<std::uint16_t>;

class Block {
 public:
  Block(const RegisterMap& map, int address, Registers& registers)
      : map_(map), address_(address), registers_(registers) {}

  void put(const Register& reg, double value) {
    const std::size_t at = static_cast<std::size_t>(reg.address - address_);
    if (reg.type == RegisterType::bit) {
      const auto mask = static_cast<std::uint16_t>(1U << reg.bit);
      registers_[at] =
          static_cast<std::uint16_t>(value != 0 ? registers_[at] | mask : registers_[at] & ~mask);
      return;
    }
    // What is no number must not light a lamp.
    const double raw = ((std::isnan(value) ? 0 : value) - reg.offset) / reg.scale;
    const double held =
        std::clamp(std::round(raw), detail::least_raw(reg), detail::greatest_raw(reg));
    const auto bits = static_cast<std::uint32_t>(static_cast<std::int64_t>(held));
    if (reg.registers() == 1) {
      registers_[at] = static_cast<std::uint16_t>(bits);
      return;
    }
    const bool big = map_.word_order == WordOrder::big;
    registers_[at + (big ? 0 : 1)] = static_cast<std::uint16_t>(bits >> 16);
    registers_[at + (big ? 1 : 0)] = static_cast<std::uint16_t>(bits);
  }

 private:
  const RegisterMap& map_;
  int address_;
  Registers& registers_;
};

class View {
 public:
  View(const RegisterMap& map, int address, const Registers& registers)
      : map_(map), address_(address), registers_(registers) {}

  std::int64_t raw(const Register& reg) const {
    const std::size_t at = static_cast<std::size_t>(reg.address - address_);
    const std::uint16_t first = registers_[at];
    switch (reg.type) {
      case RegisterType::bit:
        return (first >> reg.bit) & 1;
      case RegisterType::u16:
        return first;
      case RegisterType::i16:
        return static_cast<std::int16_t>(first);
      default:
        break;
    }
    const bool big = map_.word_order == WordOrder::big;
    const std::uint32_t high = registers_[at + (big ? 0 : 1)], low = registers_[at + (big ? 1 : 0)];
    const std::uint32_t bits = high << 16 | low;
    return reg.type == RegisterType::i32 ? static_cast<std::int32_t>(bits)
                                         : static_cast<std::int64_t>(bits);
  }
  double value(const Register& reg) const {
    return static_cast<double>(raw(reg)) * reg.scale + reg.offset;
  }

 private:
  const RegisterMap& map_;
  int address_;
  const Registers& registers_;
};

const Register* find(const std::map<Signal, Register>& map, Signal signal) {
  const auto at = map.find(signal);
  return at == map.end() ? nullptr : &at->second;
}

template <typename Key>
int raw_of(const std::map<Key, int>& words, Key key) {
  const auto at = words.find(key);
  return at == words.end() ? static_cast<int>(key) : at->second;
}

template <typename Key>
const Key* key_of(const std::map<Key, int>& words, std::int64_t raw) {
  for (const auto& [key, value] : words) {
    if (value == raw) return &key;
  }
  return nullptr;
}

void check_size(const Registers& registers, int count) {
  if (static_cast<int>(registers.size()) != count) {
    throw DeviceError(fmt::format("{} registers came; expected {}", registers.size(), count));
  }
}

}  // namespace

std::vector<RegisterRun> write_runs(const RegisterMap& map, std::span<const Signal> signals) {
  std::vector<RegisterRun> all;
  for (const auto& [signal, reg] : map.write) {
    if (std::find(signals.begin(), signals.end(), signal) == signals.end()) continue;
    all.push_back({reg.address, reg.registers()});
  }
  std::sort(all.begin(), all.end(),
            [](const RegisterRun& a, const RegisterRun& b) { return a.address < b.address; });
  std::vector<RegisterRun> runs;
  for (const RegisterRun& next : all) {
    if (!runs.empty() && runs.back().address + runs.back().count == next.address) {
      runs.back().count += next.count;
    } else {
      runs.push_back(next);
    }
  }
  return runs;
}

std::vector<RegisterRun> write_runs(const RegisterMap& map) {
  std::vector<Signal> signals;
  for (const auto& [signal, reg] : map.write) signals.push_back(signal);
  auto runs = write_runs(map, signals);
  const auto has = [&](const RegisterRun& run, Signal signal) {
    const auto at = map.write.find(signal);
    return at != map.write.end() && at->second.address >= run.address &&
           at->second.address < run.address + run.count;
  };
  // What is most dangerous when it is not taken goes first.
  const auto place = [&](const RegisterRun& run) {
    if (has(run, Signal::sequence)) return 3;
    if (has(run, Signal::heartbeat)) return 2;
    return has(run, Signal::blue_share) || has(run, Signal::uv_mw_cm2) ? 0 : 1;
  };
  std::stable_sort(runs.begin(), runs.end(),
                   [&](const RegisterRun& a, const RegisterRun& b) { return place(a) < place(b); });
  return runs;
}

int requests_of(const RegisterMap& map) {
  return map.exchange == Exchange::fc23 ? 1 : static_cast<int>(write_runs(map).size()) + 1;
}

Registers encode(const RegisterMap& map, const SetPoints& s) {
  Registers registers(static_cast<std::size_t>(map.write_count), 0);
  Block block(map, map.write_address, registers);
  const auto value_of = [&](Signal signal) -> double {
    switch (signal) {
      case Signal::sequence:
        return s.sequence;
      case Signal::heartbeat:
        return s.heartbeat;
      case Signal::command:
        return raw_of(map.commands, s.command);
      case Signal::watchdog_s:
        return s.watchdog_s;
      case Signal::target_um:
        return s.target_um;
      case Signal::speed_um_s:
        return s.speed_um_s;
      case Signal::acceleration_um_s2:
        return s.acceleration_um_s2;
      case Signal::blue_share:
        return s.blue_share;
      case Signal::uv_mw_cm2:
        return s.uv_mw_cm2;
      case Signal::frame:
        return s.frame;
      case Signal::job:
        return s.job;
      default:
        return 0;
    }
  };
  for (const auto& [signal, reg] : map.write) block.put(reg, value_of(signal));
  return registers;
}

SetPoints decode_set_points(const RegisterMap& map, const Registers& registers) {
  check_size(registers, map.write_count);
  const View view(map, map.write_address, registers);
  SetPoints s;
  for (const auto& [signal, reg] : map.write) {
    const double value = view.value(reg);
    switch (signal) {
      case Signal::sequence:
        s.sequence = static_cast<std::uint16_t>(view.raw(reg));
        break;
      case Signal::heartbeat:
        s.heartbeat = static_cast<std::uint16_t>(view.raw(reg));
        break;
      case Signal::command: {
        const Command* command = key_of(map.commands, view.raw(reg));
        if (!command) throw DeviceError(fmt::format("{} is no command", view.raw(reg)));
        s.command = *command;
        break;
      }
      case Signal::watchdog_s:
        s.watchdog_s = value;
        break;
      case Signal::target_um:
        s.target_um = value;
        break;
      case Signal::speed_um_s:
        s.speed_um_s = value;
        break;
      case Signal::acceleration_um_s2:
        s.acceleration_um_s2 = value;
        break;
      case Signal::blue_share:
        s.blue_share = value;
        break;
      case Signal::uv_mw_cm2:
        s.uv_mw_cm2 = value;
        break;
      case Signal::frame:
        s.frame = static_cast<std::int32_t>(std::lround(value));
        break;
      case Signal::job:
        s.job = view.raw(reg) != 0;
        break;
      default:
        break;
    }
  }
  return s;
}

Registers encode(const RegisterMap& map, const Status& s) {
  Registers registers(static_cast<std::size_t>(map.read_count), 0);
  Block block(map, map.read_address, registers);
  const auto value_of = [&](Signal signal) -> double {
    switch (signal) {
      case Signal::sequence_echo:
        return s.sequence_echo;
      case Signal::state:
        return raw_of(map.states, s.state);
      case Signal::stage_um:
        return s.stage_um;
      case Signal::stage_speed_um_s:
        return s.stage_speed_um_s.value_or(0);
      case Signal::blue_measured:
        return s.blue_measured;
      case Signal::uv_measured:
        return s.uv_measured.value_or(0);
      case Signal::temperature_c:
        return s.temperature_c.value_or(0);
      case Signal::door_open:
        return s.door_open;
      case Signal::stop_pressed:
        return s.stop_pressed;
      case Signal::lamp_failed:
        return s.lamp_failed;
      case Signal::stage_failed:
        return s.stage_failed;
      case Signal::over_temperature:
        return s.over_temperature;
      case Signal::watchdog_tripped:
        return s.watchdog_tripped;
      case Signal::latched:
        return s.latched.value_or(false);
      case Signal::job_kept:
        return s.job_kept.value_or(false);
      case Signal::machine_time_s:
        return s.machine_time_s.value_or(0);
      default:
        return 0;
    }
  };
  for (const auto& [signal, reg] : map.read) block.put(reg, value_of(signal));
  return registers;
}

Status decode_status(const RegisterMap& map, const Registers& registers) {
  check_size(registers, map.read_count);
  const View view(map, map.read_address, registers);
  Status s;
  const auto number = [&](Signal signal) -> std::optional<double> {
    const Register* reg = find(map.read, signal);
    return reg ? std::optional(view.value(*reg)) : std::nullopt;
  };
  const auto bit = [&](Signal signal) {
    const Register* reg = find(map.read, signal);
    return reg && view.raw(*reg) != 0;
  };
  if (const Register* reg = find(map.read, Signal::state)) {
    const MachineState* state = key_of(map.states, view.raw(*reg));
    if (!state) {
      throw DeviceError(
          fmt::format("register {}: {} is no state of this machine", reg->address, view.raw(*reg)));
    }
    s.state = *state;
  }
  if (const Register* reg = find(map.read, Signal::sequence_echo)) {
    s.sequence_echo = static_cast<std::uint16_t>(view.raw(*reg));
  }
  s.stage_um = number(Signal::stage_um).value_or(0);
  s.blue_measured = number(Signal::blue_measured).value_or(0);
  s.stage_speed_um_s = number(Signal::stage_speed_um_s);
  s.temperature_c = number(Signal::temperature_c);
  s.machine_time_s = number(Signal::machine_time_s);
  s.uv_measured = number(Signal::uv_measured);
  s.door_open = bit(Signal::door_open);
  s.stop_pressed = bit(Signal::stop_pressed);
  s.lamp_failed = bit(Signal::lamp_failed);
  s.stage_failed = bit(Signal::stage_failed);
  s.over_temperature = bit(Signal::over_temperature);
  s.watchdog_tripped = bit(Signal::watchdog_tripped);
  if (map.read.contains(Signal::latched)) s.latched = bit(Signal::latched);
  if (map.read.contains(Signal::job_kept)) s.job_kept = bit(Signal::job_kept);
  return s;
}

}  // namespace slicecorr::bridge
