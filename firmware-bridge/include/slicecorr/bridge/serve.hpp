// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file serve.hpp
/// A print over HTTP, for reading only: live page, report, state, metrics. A process of its own,
/// which asks the print as everybody does. Of a `PrintServer`, `stop` may be called from any
/// thread, the rest from one.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "slicecorr/bridge/record.hpp"

namespace slicecorr::bridge {

struct ServeOptions {
  std::string host = "127.0.0.1";
  int port = 0;            ///< 0..65535; 0: the system chooses
  std::string token;       ///< what reading needs beyond loopback
  std::string host_names;  ///< further names in Host headers that are ours, separated by commas
  /// The JSON of `printbridge status`. Called by several threads.
  std::function<std::string()> status;
};

class PrintServer {
 public:
  /// Binds. Throws `InputError` for an address beyond loopback without a token, `DeviceError` when
  /// it can't be had.
  PrintServer(const StateFolder& folder, ServeOptions options);
  ~PrintServer();
  PrintServer(const PrintServer&) = delete;
  PrintServer& operator=(const PrintServer&) = delete;

  int port() const;
  /// "http://127.0.0.1:8123".
  std::string address() const;
  /// Serves until `stop`; then open requests are cut off.
  void run();
  /// Ends `run`. May be called from any thread.
  void stop();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace slicecorr::bridge
