// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/http/guard.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <openssl/crypto.h>
#include <openssl/sha.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>

#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::http {

namespace {

bool is_ip(const std::string& host) {
  in_addr v4{};
  in6_addr v6{};
  return ::inet_pton(AF_INET, host.c_str(), &v4) == 1 ||
         ::inet_pton(AF_INET6, host.c_str(), &v6) == 1;
}

/// Host and port of "name:80", "[::1]:80", "name"; port -1: not said, -2: no number.
std::pair<std::string, int> parts_of(const std::string& text) {
  std::string host = text;
  int port = -1;
  const std::size_t from = text.starts_with('[') ? text.find(']') : 0;
  if (from == std::string::npos) return {"", -2};
  if (const std::size_t colon = text.find(':', from); colon != std::string::npos) {
    const char* begin = text.data() + colon + 1;
    const char* end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(begin, end, port);
    if (error != std::errc{} || rest != end || port < 1 || port > 65535) port = -2;
    host.resize(colon);
  }
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  return {lower_case(host), port};
}

std::array<unsigned char, SHA256_DIGEST_LENGTH> digest(std::string_view text) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> out{};
  ::SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), out.data());
  return out;
}

}  // namespace

bool is_loopback(const std::string& ip) {
  return ip == "::1" || ip == "localhost" || (is_ip(ip) && ip.starts_with("127."));
}

void check_headers(const GuardRules& rules, const httplib::Request& request) {
  if (request.get_header_value_count("Host") != 1) {
    throw ApiError(400, "host", "expected one Host header");
  }
  // A name that somebody else's DNS points here would let their page speak to us as one of its own.
  // Numbers can't be pointed anywhere.
  const std::string host_text = request.get_header_value("Host");
  const auto [host, port] = parts_of(host_text);
  const bool port_fits = port == rules.port || (port == -1 && rules.port == 80);
  const bool ours = host == "localhost" || (is_ip(host) && (!rules.loopback || is_loopback(host)));
  const bool named =
      std::find(rules.host_names.begin(), rules.host_names.end(), host) != rules.host_names.end();
  if (!(ours && port_fits) && !named) {
    throw ApiError(403, "host", "the Host header names another server (see --host-name)");
  }
  if (request.has_header("Origin") &&
      lower_case(request.get_header_value("Origin")) != "http://" + lower_case(host_text) &&
      !(named &&
        lower_case(request.get_header_value("Origin")) == "https://" + lower_case(host_text))) {
    throw ApiError(403, "origin", "requests from pages of other origins are refused");
  }
  const std::string site = request.get_header_value("Sec-Fetch-Site");
  if ((site == "cross-site" || site == "same-site") &&
      request.get_header_value("Sec-Fetch-Mode") != "navigate") {
    throw ApiError(403, "origin", "requests from pages of other sites are refused");
  }
  // Many small ranges of one file cost much more than the file.
  if (request.ranges.size() > 1) throw ApiError(416, "range", "expected one range at most");
}

bool has_bearer(const httplib::Request& request, const std::string& token) {
  constexpr std::string_view scheme = "bearer ";
  const std::string given = request.get_header_value("Authorization");
  const bool bearer = given.size() > scheme.size() &&
                      lower_case(given.substr(0, scheme.size())) == scheme &&
                      request.get_header_value_count("Authorization") == 1;
  // Hashes have one length, and comparing them takes one time, whatever was sent.
  const auto wanted = digest(token);
  const auto have = digest(bearer ? std::string_view(given).substr(scheme.size()) : "");
  const bool same = CRYPTO_memcmp(wanted.data(), have.data(), wanted.size()) == 0;
  return bearer && same;
}

void check_access(const GuardRules& rules, const httplib::Request& request, Access access) {
  if (access == Access::shell || (access == Access::read && rules.loopback)) return;
  if (rules.token.empty()) {
    throw ApiError(403, "read_only", "this server changes nothing (no --token-file)");
  }
  if (!has_bearer(request, rules.token)) {
    throw ApiError(401, "token", "expected the header 'Authorization: Bearer TOKEN'");
  }
}

std::int64_t body_bytes(const httplib::Request& request, std::int64_t most) {
  if (request.has_header("Transfer-Encoding")) {
    throw ApiError(411, "length", "expected a Content-Length, not chunks");
  }
  if (request.has_header("Content-Encoding")) {
    throw ApiError(415, "encoding", "expected a body that is not compressed");
  }
  const auto lengths = request.get_header_value_count("Content-Length");
  if (lengths == 0) return 0;
  const std::string text = request.get_header_value("Content-Length");
  std::int64_t bytes = -1;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), bytes);
  if (lengths > 1 || error != std::errc{} || rest != text.data() + text.size() || bytes < 0 ||
      text.starts_with('-') || text.starts_with('+')) {
    throw ApiError(400, "length", "the Content-Length is no number of bytes");
  }
  if (bytes > most) throw ApiError(413, "too_large", "the body is larger than this server takes");
  return bytes;
}

void keep_out_of_cores() { ::prctl(PR_SET_DUMPABLE, 0, 0, 0, 0); }

std::string read_token_file(const std::string& path, std::size_t least) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) throw InputError(path, "", "can't be read; expected a file with a token");
  struct stat s {};
  char text[1024];
  ssize_t n = -1;
  const bool plain = ::fstat(file, &s) == 0 && S_ISREG(s.st_mode);
  if (plain) n = ::read(file, text, sizeof text);
  ::close(file);
  if (!plain || n < 0) throw InputError(path, "", "is no file; expected one with a token");
  if ((s.st_mode & 077) != 0 || s.st_uid != ::geteuid()) {
    throw InputError(path, "", "may be read by others; expected a file of your own, mode 0600");
  }
  std::string token(text, static_cast<std::size_t>(n));
  token.resize(std::min(token.find_first_of("\r\n"), token.size()));
  const bool printable =
      std::all_of(token.begin(), token.end(), [](char c) { return c > 0x20 && c < 0x7F; });
  if (token.size() < least || token.size() > 512 || !printable) {
    throw InputError(path, "",
                     fmt::format("holds no token; expected a line of {} to 512 letters, digits and "
                                 "marks without spaces",
                                 least));
  }
  keep_out_of_cores();
  return token;
}

}  // namespace slicecorr::http
