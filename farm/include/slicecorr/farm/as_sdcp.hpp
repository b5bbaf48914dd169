// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file as_sdcp.hpp
/// The farm as a printer that speaks SDCP 3, for the slicers that send to whatever answers as one. It
/// says that it is the model of the machine of machines.toml behind it, takes files in parts, checks
/// them, and queues them as jobs by that machine's rule; whoever asks how it does is told how that
/// machine does.
///
/// SDCP knows no login. So it answers the addresses that are named and nobody else: to all others it is
/// not there. It starts no print. Of an `SdcpPrinter`, `stop` may be called from any thread, the rest
/// from one. Only making one throws.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "slicecorr/farm/as_printer.hpp"

namespace slicecorr::farm {

struct AsSdcpOptions {
  AsPrinterOptions like;  ///< address, machine, bounds and `submit`; of these `key` has no use here
  int udp_port = 3000;    ///< for calls; 0: one that is free
  std::vector<std::string> clients;  ///< IPv4 addresses that are answered; at least one
};

class SdcpPrinter {
 public:
  /// Binds. Throws `InputError` for a machine that is not there, a wrong rule, or no clients;
  /// `DeviceError` when an address is taken.
  SdcpPrinter(const FarmFolder& folder, AsSdcpOptions options);
  ~SdcpPrinter();
  SdcpPrinter(const SdcpPrinter&) = delete;
  SdcpPrinter& operator=(const SdcpPrinter&) = delete;

  int port() const;
  int udp_port() const;
  void run();
  void stop();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace slicecorr::farm
