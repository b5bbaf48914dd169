// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file as_printer.hpp
/// The farm as a printer, for the send buttons of slicers: it answers as PrusaLink on an SL1 does, or
/// as OctoPrint. What arrives is queued as a job by the rule of one machine of machines.toml; whoever
/// asks how the printer does is told how that machine does.
///
/// It starts no print: who asks for one with an upload is refused, and nothing is queued. It listens
/// at one address, wants a key for everything, and takes one file a request, of bounded size. Of a
/// `PrinterServer`, `stop` may be called from any thread, the rest from one. Only making one throws;
/// what is wrong with a request is its answer.
#pragma once

#include <memory>
#include <string>

#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/machines.hpp"
#include "slicecorr/farm/serve.hpp"

namespace slicecorr::farm {

struct AsPrinterOptions {
  std::string host = "127.0.0.1";
  int port = 0;            ///< 0..65535; 0: the system chooses
  std::string host_names;  ///< as in `ServeOptions`
  /// Of X-Api-Key and of a bearer; and the password of the user "maker", by digest. 8..512 characters.
  std::string key;
  std::string machine;  ///< its name in machines.toml
  /// As in `ServeOptions`.
  std::function<SubmitReply(const std::string& body, bool dry_run,
                            const std::atomic<bool>& stopping)>
      submit;
  std::int64_t most_upload_bytes = 512 << 20;
  std::int64_t most_uploads_bytes = std::int64_t{8} << 30;  ///< of all files that wait
  MachineTimes times;
};

class PrinterServer {
 public:
  /// Binds. Throws `InputError` for a machine that is not there, a rule with keys that jobs do not
  /// have, or no key; `DeviceError` when the address is taken.
  PrinterServer(const FarmFolder& folder, AsPrinterOptions options);
  ~PrinterServer();
  PrinterServer(const PrinterServer&) = delete;
  PrinterServer& operator=(const PrinterServer&) = delete;

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

}  // namespace slicecorr::farm
