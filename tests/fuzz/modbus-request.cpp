// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as what a client sends to the simulated machine over Modbus, for clang's fuzzer. It goes on serving, and its
// lamps stay off: nobody feeds its watchdog.
#include <thread>

#include "modbus_peer.hpp"
#include "sim/modbus_server.hpp"
#include "sim/timed_model.hpp"

using namespace slicecorr;

namespace {

struct Machine {
  Machine()
      : machine(test::machine_of(test::kSmallMachine)),
        printer(machine, {}),
        model(printer, {false, 1, machine.limits.cycle_s}),
        server("127.0.0.1:0", machine, model) {
    const std::string address = server.address();
    port = std::stoi(address.substr(address.rfind(':') + 1));
    std::thread([this] { server.serve([] { return true; }); }).detach();
  }
  bridge::Machine machine;
  bridge::PrinterModel printer;
  bridge::TimedModel model;
  bridge::ModbusServer server;
  int port = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Machine& machine = *new Machine;
  test::Raw raw(machine.port);
  if (!raw.connected) fuzz::fail("the machine is gone");
  raw.send(fuzz::text_of(data, size));
  raw.end_sending();
  if (raw.rest() == "(nothing)") fuzz::fail("the connection stays open");
  return 0;
}
