// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file printer_login.hpp
/// Who may use the farm as a printer: a key in a header, or a digest of it with a nonce of ours.
#pragma once

#include <httplib.h>

#include <chrono>
#include <map>
#include <mutex>
#include <string>

namespace slicecorr::farm::detail {

/// Thread-safe.
class PrinterLogin {
 public:
  explicit PrinterLogin(std::string key) : key_(std::move(key)) {}
  /// Throws `ApiError` (401, 403, 429), and puts the challenge into the response.
  void check(const httplib::Request& request, httplib::Response& response);

 private:
  using Steady = std::chrono::steady_clock;
  struct Nonce {
    Steady::time_point until;
    unsigned count = 0;  ///< of the last request that came with it
  };
  enum class Digest { right, wrong, stale };
  Digest digest(const httplib::Request& request, const std::string& header);
  std::string challenge(bool stale);
  void note_wrong();

  std::string key_;
  std::mutex mutex_;
  std::map<std::string, Nonce> nonces_;
  int wrong_ = 0;  ///< in a row
  Steady::time_point locked_until_{};
};

}  // namespace slicecorr::farm::detail
