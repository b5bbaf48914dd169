// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machine/parse_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "machine/names.hpp"
#include "support/text/nearest.hpp"

namespace slicecorr::bridge::detail {

namespace {

// Modbus application protocol 1.1b3: function 23; function 16; functions 3, 4 and 23.
constexpr int kMostWritten = 121, kMostWrittenAlone = 123, kMostRead = 125;

/// What a signal must be able to carry.
struct Need {
  double least = 0, greatest = 0;
  double step = 0;     ///< greatest that still says enough; 0: any
  bool whole = false;  ///< a count or word: scale 1
};

Need need_of(Signal signal, const Machine& m) {
  const double fastest = m.stage.fastest_um_s();
  const double uv = m.printer.uv ? m.printer.uv->max_mw_cm2() : 0;
  switch (signal) {
    case Signal::sequence:
    case Signal::heartbeat:
    case Signal::sequence_echo:
      return {0, 65535, 0, true};
    case Signal::command:
    case Signal::state:
      return {0, 0, 0, true};
    case Signal::watchdog_s:
      return {0, m.limits.watchdog_s, m.limits.watchdog_s / 10, false};
    case Signal::target_um:
    case Signal::stage_um:
      return {0, m.stage.travel_um, m.stage.tolerance_um / 2, false};
    case Signal::speed_um_s:
      return {0, fastest, m.stage.max_speed_um_s / 1000, false};
    case Signal::stage_speed_um_s:
      return {-fastest, fastest, m.stage.max_speed_um_s / 100, false};
    case Signal::acceleration_um_s2:
      return {0, m.stage.acceleration_um_s2, m.stage.acceleration_um_s2 / 100, false};
    case Signal::blue_share:
    case Signal::blue_measured:
      return {0, m.blue.max_share, m.blue.tolerance / 2, false};
    case Signal::uv_mw_cm2:
    case Signal::uv_measured:
      return {0, uv, uv * m.uv.tolerance / 2, false};
    case Signal::frame:
      return {-1, 32766, 0, true};
    case Signal::temperature_c:
      return {0, m.limits.max_temperature_c, 5, false};
    case Signal::machine_time_s:
      return {0, 0, 0, false};
    case Signal::job:
    case Signal::job_kept:
      return {0, 1, 0, true};
    default:
      return {0, 1, 0, false};  // bits
  }
}

/// Whether the signal is an angle on the wire, and um of arc here.
bool is_angle(Signal signal, const Machine& m) {
  return m.stage.turns() && name_of(signal, true) != name_of(signal, false);
}

bool is_bit(Signal signal) { return signal >= Signal::door_open && signal <= Signal::latched; }

void check_range(const TomlTable& table, std::string_view key, const Register& reg,
                 const Need& need) {
  const double one = least_raw(reg) * reg.scale + reg.offset;
  const double other = greatest_raw(reg) * reg.scale + reg.offset;
  const double slack = std::abs(reg.scale) / 2;
  if (std::min(one, other) > need.least + slack || std::max(one, other) < need.greatest - slack) {
    table.fail(key,
               fmt::format("holds {:g} to {:g}; this machine needs {:g} to {:g}",
                           std::min(one, other), std::max(one, other), need.least, need.greatest));
  }
  if (need.whole && std::abs(reg.scale) != 1) {
    table.fail(key, fmt::format("has scale {:g}; expected 1, it counts", reg.scale));
  }
  if (need.step > 0 && std::abs(reg.scale) > need.step) {
    table.fail(key, fmt::format("has steps of {:g}; expected at most {:g} for this machine",
                                std::abs(reg.scale), need.step));
  }
}

Register parse_register(const TomlTable& signals, std::string_view key, Signal signal,
                        const Machine& machine) {
  const auto given = signals.table(key);
  const TomlTable& t = *given;
  constexpr std::array<std::string_view, 5> known{"address", "type", "bit", "scale", "offset"};
  only_keys(t, known);
  Register reg;
  reg.address = t.required_integer("address", 0, 65535);
  constexpr std::array<std::string_view, 5> types{"u16", "i16", "u32", "i32", "bit"};
  const std::string type = t.text("type", is_bit(signal) ? "bit" : "u16");
  const auto found = std::find(types.begin(), types.end(), type);
  if (found == types.end()) {
    t.fail("type",
           fmt::format("is '{}'; expected \"u16\", \"i16\", \"u32\", \"i32\" or \"bit\"", type));
  }
  reg.type = static_cast<RegisterType>(found - types.begin());
  if (reg.type == RegisterType::bit && !is_bit(signal)) {
    t.fail("type", "is \"bit\"; expected a register, this is no yes or no");
  }
  if (t.has("bit") && reg.type != RegisterType::bit) {
    t.fail("bit", "is given; expected type = \"bit\" beside it");
  }
  reg.bit = t.integer("bit", 0, 15, 0);
  reg.scale = t.number("scale", -1e9, 1e9, true).value_or(1);
  if (std::abs(reg.scale) < 1e-12) t.fail("scale", "is 0; expected value = raw * scale + offset");
  reg.offset = t.number("offset", -1e9, 1e9, true).value_or(0);
  if (reg.address + reg.registers() > 65536) {
    t.fail("address", "is 65535; expected room for two registers");
  }
  if (is_bit(signal)) return reg;
  Need need = need_of(signal, machine);
  if (!is_angle(signal, machine)) {
    check_range(signals, key, reg, need);
    return reg;
  }
  const double um_per_deg = machine.stage.um_per_deg;
  need = {need.least / um_per_deg, need.greatest / um_per_deg, need.step / um_per_deg, false};
  check_range(signals, key, reg, need);
  reg.scale *= um_per_deg;
  reg.offset *= um_per_deg;
  return reg;
}

std::map<Signal, Register> parse_signals(const TomlTable& table, bool written,
                                         const Machine& machine) {
  const bool turns = machine.stage.turns();
  std::vector<std::string_view> known;
  for (const SignalName& n : signal_names()) {
    if (n.written == written) known.push_back(name_of(n.signal, turns));
  }
  only_keys(table, known);
  std::map<Signal, Register> found;
  for (const SignalName& n : signal_names()) {
    const std::string_view name = name_of(n.signal, turns);
    if (n.written != written || !table.has(name)) continue;
    found[n.signal] = parse_register(table, name, n.signal, machine);
  }
  using enum Signal;
  std::vector<Signal> needed =
      written ? std::vector{sequence, heartbeat, command, target_um, speed_um_s, blue_share}
              : std::vector{sequence_echo, state, stage_um, blue_measured};
  if (machine.printer.uv) needed.push_back(written ? uv_mw_cm2 : uv_measured);
  // A stage that turns without an encoder must say at least how fast it does.
  if (turns && !written && found.contains(stage_speed_um_s)) std::erase(needed, stage_um);
  for (const Signal signal : needed) {
    if (!found.contains(signal)) {
      table.fail(name_of(signal, turns), fmt::format("missing; expected {{ address = ... }}"));
    }
  }
  return found;
}

struct Used {
  std::string name;
  int bit = -1;  ///< -1: all of it
};

void check_overlaps(const TomlTable& table, const std::map<Signal, Register>& signals, bool turns,
                    std::multimap<int, Used>& used) {
  for (const auto& [signal, reg] : signals) {
    const int bit = reg.type == RegisterType::bit ? reg.bit : -1;
    for (int a = reg.address; a < reg.address + reg.registers(); ++a) {
      const auto [begin, end] = used.equal_range(a);
      for (auto other = begin; other != end; ++other) {
        if (bit >= 0 && other->second.bit >= 0 && bit != other->second.bit) continue;
        table.fail(name_of(signal, turns),
                   fmt::format("overlaps {} at address {}; expected registers of its own",
                               other->second.name, a));
      }
      used.emplace(a, Used{table.prefix() + std::string(name_of(signal, turns)), bit});
    }
  }
}

/// First and number of registers that hold all of the signals.
void measure(const std::map<Signal, Register>& signals, int& address, int& count) {
  int first = 65536, end = 0;
  for (const auto& [signal, reg] : signals) {
    first = std::min(first, reg.address);
    end = std::max(end, reg.address + reg.registers());
  }
  address = first;
  count = end - first;
}

void check_written(const TomlTable& t, const RegisterMap& map) {
  const auto runs = write_runs(map);
  const bool at_once = map.exchange == Exchange::fc23;
  const int most = at_once ? kMostWritten : kMostWrittenAlone;
  // One request writes the whole block: what lies between would be overwritten with 0.
  if (at_once && runs.size() > 1) {
    int written = 0;
    for (const RegisterRun& run : runs) written += run.count;
    t.fail("write", fmt::format("leaves out {} of the registers {} to {}, which function 23 writes "
                                "at once; expected none between its signals, or exchange = "
                                "\"fc16+fc3\" or \"fc16+fc4\"",
                                map.write_count - written, map.write_address,
                                map.write_address + map.write_count - 1));
  }
  for (const RegisterRun& run : runs) {
    if (run.count <= most) continue;
    t.fail("write", fmt::format("covers {} registers, {} to {}; Modbus writes at most {} at once",
                                run.count, run.address, run.address + run.count - 1, most));
  }
}

template <typename Key>
std::map<Key, int> parse_words(const TomlTable& modbus, std::string_view key,
                               std::span<const std::string_view> names, const Register& reg) {
  std::map<Key, int> words;
  const auto table = modbus.table(key);
  if (table) only_keys(*table, names);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const int standard = static_cast<int>(i);
    const int value = table ? table->integer(names[i], -32768, 65535, standard) : standard;
    const TomlTable& place = table ? *table : modbus;
    if (value < least_raw(reg) || value > greatest_raw(reg)) {
      place.fail(names[i], fmt::format("is {}, which its register can't hold", value));
    }
    for (const auto& [other, used] : words) {
      if (used == value) {
        place.fail(names[i], fmt::format("is {}, as is {}; expected different values", value,
                                         names[static_cast<std::size_t>(other)]));
      }
    }
    words[static_cast<Key>(i)] = value;
  }
  return words;
}

template <typename Choice>
Choice choose(const TomlTable& table, std::string_view key,
              std::initializer_list<std::string_view> words) {
  const std::string word = table.text(key, std::string(*words.begin()));
  const auto found = std::find(words.begin(), words.end(), word);
  if (found == words.end()) {
    std::string list;
    for (const auto w : words) list += fmt::format("{}\"{}\"", list.empty() ? "" : " or ", w);
    table.fail(key, fmt::format("is '{}'; expected {}", word, list));
  }
  return static_cast<Choice>(found - words.begin());
}

void parse_wire(const TomlTable& t, RegisterMap& map) {
  map.transport = choose<Transport>(t, "transport", {"tcp", "rtu"});
  map.word_order = choose<WordOrder>(t, "word_order", {"big", "little"});
  map.exchange = choose<Exchange>(t, "exchange", {"fc23", "fc16+fc3", "fc16+fc4"});
  map.host = t.text("host", map.host);
  if (map.host.empty()) t.fail("host", "is empty; expected a name or an address");
  map.port = t.integer("port", 0, 65535, map.port);
  map.device = t.text("device", "");
  map.baud = t.integer("baud", 300, 10000000, map.baud);
  const std::string parity = t.text("parity", "N");
  if (parity != "N" && parity != "E" && parity != "O") {
    t.fail("parity", fmt::format("is '{}'; expected \"N\", \"E\" or \"O\"", parity));
  }
  map.parity = parity[0];
  map.unit = t.integer("unit", map.transport == Transport::rtu ? 1 : 0,
                       map.transport == Transport::rtu ? 247 : 255, map.unit);
  if (map.transport == Transport::rtu && map.device.empty()) {
    t.fail("device", "missing; expected the serial device of an rtu machine");
  }
}

}  // namespace

void only_keys(const TomlTable& table, std::span<const std::string_view> known) {
  for (const auto& [key, node] : table.raw()) {
    const std::string_view name = key.str();
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    const std::string near = nearest(name, known);
    table.fail(name, near.empty() ? "unknown key; docs/printer-files.md lists those known"
                                  : fmt::format("unknown key; did you mean '{}'?", near));
  }
}

RegisterMap parse_map(const TomlTable& modbus, const Machine& machine) {
  constexpr std::array<std::string_view, 13> known{
      "transport",  "host",     "port",  "device", "baud",     "parity", "unit",
      "word_order", "exchange", "write", "read",   "commands", "states"};
  only_keys(modbus, known);
  RegisterMap map;
  parse_wire(modbus, map);
  const TomlTable write = modbus.required_table("write"), read = modbus.required_table("read");
  map.write = parse_signals(write, true, machine);
  map.read = parse_signals(read, false, machine);
  if (map.write.contains(Signal::job) != map.read.contains(Signal::job_kept)) {
    modbus.fail("read", "has only one of write.job and read.job_kept; expected both or none");
  }
  std::multimap<int, Used> used;
  const bool turns = machine.stage.turns();
  check_overlaps(write, map.write, turns, used);
  // Input registers have addresses of their own.
  if (map.exchange == Exchange::fc16_fc4) used.clear();
  check_overlaps(read, map.read, turns, used);
  measure(map.write, map.write_address, map.write_count);
  measure(map.read, map.read_address, map.read_count);
  check_written(modbus, map);
  if (map.read_count > kMostRead) {
    modbus.fail("read",
                fmt::format("covers {} registers, {} to {}; Modbus reads at most {} at once",
                            map.read_count, map.read_address, map.read_address + map.read_count - 1,
                            kMostRead));
  }
  map.commands =
      parse_words<Command>(modbus, "commands", kCommandNames, map.write.at(Signal::command));
  map.states = parse_words<MachineState>(modbus, "states", kStateNames, map.read.at(Signal::state));
  return map;
}

}  // namespace slicecorr::bridge::detail
