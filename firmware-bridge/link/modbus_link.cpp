// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The client end of Modbus: set-points and status as requests.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <vector>

#include "link/modbus_wire.hpp"
#include "slicecorr/bridge/link.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

using detail::Bytes;

constexpr std::uint8_t kReadHolding = 3, kReadInput = 4, kWriteRegisters = 16, kWriteAndRead = 23;
constexpr int kIllegalFunction = 1;
constexpr std::array kLampSignals{Signal::blue_share, Signal::uv_mw_cm2};
constexpr std::array kCommandSignals{Signal::command};

void put_word(Bytes& bytes, int value) {
  bytes.push_back(static_cast<std::uint8_t>(value >> 8));
  bytes.push_back(static_cast<std::uint8_t>(value));
}

class ModbusLink final : public Link {
 public:
  ModbusLink(const RegisterMap& map, const MachineLimits& limits, bool lockstep)
      : map_(map), runs_(write_runs(map)), wire_(map, limits.response_timeout_s, lockstep) {}

  std::optional<Status> exchange(const SetPoints& set_points) override {
    wire_.begin_exchange();
    auto registers = encode(map_, set_points);
    std::optional<Status> status;
    if (map_.exchange == Exchange::fc23) {
      status = ask_status(written(Bytes{kWriteAndRead}, runs_.front(), registers, true));
    } else {
      std::string first_error;
      for (const RegisterRun& run : runs_) {
        if (write(run, registers)) continue;
        if (!first_error.empty()) continue;
        first_error = error_;
        // An exchange that has failed feeds no watchdog.
        SetPoints rest = set_points;
        rest.heartbeat = heartbeat_;
        registers = encode(map_, rest);
      }
      if (first_error.empty()) {
        status = read_status();
      } else {
        error_ = first_error;
      }
    }
    heartbeat_ = set_points.heartbeat;
    if (status) {
      wire_.exchange_was_good();
      hurried_ = false;
    }
    return status;
  }

  bool write_alone(const SetPoints& set_points, Alone what) override {
    if (!hurried_) wire_.hurry();
    hurried_ = true;
    const auto registers = encode(map_, set_points);
    const auto runs =
        what == Alone::lamps ? write_runs(map_, kLampSignals) : write_runs(map_, kCommandSignals);
    bool all = true;
    for (const RegisterRun& run : runs) {
      if (write(run, registers)) continue;
      // A machine of function 23 may have no other.
      const bool other = map_.exchange == Exchange::fc23 && wire_.exception() == kIllegalFunction;
      if (!other || !ask_status(written(Bytes{kWriteAndRead}, run, registers, true))) all = false;
    }
    return all;
  }

  std::optional<Status> look() override {
    wire_.begin_exchange();
    return read_status();
  }

  std::string last_error() const override { return error_; }

 private:
  std::uint16_t at(const std::vector<std::uint16_t>& registers, int address) const {
    return registers[static_cast<std::size_t>(address - map_.write_address)];
  }

  /// A request that writes a run, and reads the status where it does both.
  Bytes written(Bytes request, const RegisterRun& run, const std::vector<std::uint16_t>& registers,
                bool reads) const {
    if (reads) {
      put_word(request, map_.read_address);
      put_word(request, map_.read_count);
    }
    put_word(request, run.address);
    put_word(request, run.count);
    request.push_back(static_cast<std::uint8_t>(2 * run.count));
    for (int i = 0; i < run.count; ++i) put_word(request, at(registers, run.address + i));
    return request;
  }

  bool write(const RegisterRun& run, const std::vector<std::uint16_t>& registers) {
    const Bytes request = written(Bytes{kWriteRegisters}, run, registers, false);
    if (wire_.ask(request, 4)) return true;
    error_ = fmt::format("{} (writing registers {} to {})", wire_.error(), run.address,
                         run.address + run.count - 1);
    return false;
  }

  std::optional<Status> read_status() {
    Bytes request{map_.exchange == Exchange::fc16_fc4 ? kReadInput : kReadHolding};
    put_word(request, map_.read_address);
    put_word(request, map_.read_count);
    return ask_status(request);
  }

  std::optional<Status> ask_status(const Bytes& request) {
    const auto bytes = static_cast<std::size_t>(2 * map_.read_count);
    const auto answer = wire_.ask(request, bytes + 1);
    if (!answer) {
      error_ = wire_.error();
      return std::nullopt;
    }
    std::vector<std::uint16_t> registers;
    for (std::size_t i = 1; i + 1 < answer->size(); i += 2) {
      registers.push_back(static_cast<std::uint16_t>((*answer)[i] << 8 | (*answer)[i + 1]));
    }
    try {
      return decode_status(map_, registers);
    } catch (const Error& e) {
      error_ = std::string("answers, but ") + e.what();
      return std::nullopt;
    }
  }

  const RegisterMap map_;
  const std::vector<RegisterRun> runs_;
  detail::ModbusWire wire_;
  std::uint16_t heartbeat_ = 0;  ///< of the exchange before
  bool hurried_ = false;         ///< since the last good exchange
  std::string error_ = "was asked nothing";
};

}  // namespace

std::unique_ptr<Link> make_modbus_link(const RegisterMap& map, const MachineLimits& limits,
                                       bool lockstep) {
  return std::make_unique<ModbusLink>(map, limits, lockstep);
}

}  // namespace slicecorr::bridge
