// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file http_calls.hpp
/// Requests to machines over HTTP, within bounds: no redirect is followed, answers have at most
/// 8 MiB, a file goes from the disk, and what takes too long without a byte ends.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "machines/digest.hpp"
#include "slicecorr/farm/machines.hpp"

namespace slicecorr::farm::detail {

/// Longest answer that is read.
inline constexpr std::size_t kMostAnswerBytes = std::size_t{8} << 20;

struct HttpAnswer {
  int status = 0;
  std::string body, type, location, challenge;
  std::string cookie;  ///< "name=value" of Set-Cookie
  bool ok() const { return status >= 200 && status < 300; }
};

using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

/// A body: text, then bytes of a file, then text.
struct HttpBody {
  std::string before, after, path;
  std::int64_t from = 0, bytes = 0;  ///< of the file
  std::string type;                  ///< Content-Type
  UploadProgress progress;           ///< bytes of the file that went, of `bytes`
};

/// A field of a form; a file where `file_name` is not empty.
struct FormField {
  std::string name, value, file_name;
};
/// A form as multipart/form-data, whose last field may be bytes of a file.
HttpBody form_body(const std::vector<FormField>& fields, const MachineFile* file = nullptr,
                   std::int64_t from = 0, std::int64_t bytes = 0);

/// How requests prove who asks.
struct HttpLogin {
  enum class Kind { none, key, digest } kind = Kind::none;
  std::string user, secret;
  static HttpLogin of(const MachineSpec& machine, Kind otherwise);
};

/// For one thread. Throws `DeviceError` where there is no answer, one that is too long or none of HTTP.
class HttpCalls {
 public:
  HttpCalls(std::string host, int port, const MachineTimes& times, HttpLogin login = {});
  HttpAnswer get(const std::string& path) { return call("GET", path, {}, nullptr); }
  HttpAnswer remove(const std::string& path) { return call("DELETE", path, {}, nullptr); }
  /// A short body.
  HttpAnswer send_text(const char* method, const std::string& path, const std::string& text,
                       const std::string& type);
  /// A long one, which is sent once: with digest the login is renewed by a GET of `prime` before.
  HttpAnswer send_body(const char* method, const std::string& path, const HttpBody& body,
                       const std::string& prime = {}, const HttpHeaders& headers = {});
  /// For the answer to an upload, s.
  void answer_within(double seconds) { answer_s_ = seconds; }
  void set_cookie(const std::string& cookie) { cookie_ = cookie; }
  /// "127.0.0.1:80", for messages.
  std::string where() const;

 private:
  HttpAnswer call(const char* method, const std::string& path, const HttpHeaders& headers,
                  const HttpBody* body);
  HttpAnswer call_once(const char* method, const std::string& path, HttpHeaders headers,
                       const HttpBody* body);
  std::string authorization(const char* method, const std::string& path);

  std::string host_;
  int port_;
  MachineTimes times_;
  HttpLogin login_;
  double answer_s_ = 0;
  std::optional<DigestChallenge> challenge_;
  unsigned count_ = 0;
  bool refused_ = false;  ///< with a fresh nonce
  std::string cookie_;
};

/// What an answer that is no success says, for people: its JSON's title and message, else its status.
std::string http_trouble(const HttpAnswer& answer);
/// One segment of a path, percent-encoded.
std::string path_segment(const std::string& text);
/// "127.0.0.1:80", "[::1]:80".
std::string host_text(const std::string& host, int port);

}  // namespace slicecorr::farm::detail
