// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file answers.hpp
/// What all servers of the project answer alike: headers against other sites, errors as JSON.
#pragma once

#include <httplib.h>

#include <chrono>
#include <functional>
#include <mutex>
#include <string>

namespace slicecorr::http {

inline constexpr const char* kJsonType = "application/json; charset=utf-8";
inline constexpr const char* kTextType = "text/plain; charset=utf-8";
inline constexpr const char* kHtmlType = "text/html; charset=utf-8";
inline constexpr const char* kMetricsType = "text/plain; version=0.0.4; charset=utf-8";

/// Nothing from elsewhere, no frames, no forms; the page's own script and style only.
inline constexpr const char* kShellPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src blob: data:; connect-src "
    "'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
inline constexpr const char* kBarePolicy = "default-src 'none'; frame-ancestors 'none'; sandbox";
/// " 'sha256-...'" for each style that stands in a page.
std::string style_hashes(const std::string& html);
/// Allows exactly the styles that stand in a page.
std::string policy_for_styles(const std::string& html);

/// For the handler of clients that wait for leave to send a body: the status of an answer that was
/// made with `send` in its place.
int status_before_body(httplib::Response& response);

/// Sends a text as it is: the server would compress it with settings meant for files on disks.
void send(httplib::Response& response, int status, std::string text, const char* type);
void send_error(httplib::Response& response, int status, const char* code,
                const std::string& message);
/// Headers that every answer has, where it has no others of its own.
void finish(httplib::Response& response);

/// A text that costs something to make, made again at most once in a while. Thread-safe.
class Kept {
 public:
  explicit Kept(double seconds) : seconds_(seconds) {}
  std::string get(const std::function<std::string()>& make);
  /// What was made is out of date.
  void forget();

 private:
  double seconds_;
  std::mutex mutex_;
  std::chrono::steady_clock::time_point made_{};
  bool any_ = false;
  std::string text_;
};

}  // namespace slicecorr::http
