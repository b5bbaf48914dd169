// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file raw_client.hpp
/// A client of a server that sends any bytes, what clients may put into headers, and what every
/// answer has to be.
#pragma once

#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <string>
#include <vector>

namespace slicecorr::test {

/// A connection that sends what it likes.
class Raw {
 public:
  explicit Raw(int port) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected = ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~Raw() { ::close(socket_); }
  Raw(const Raw&) = delete;
  Raw& operator=(const Raw&) = delete;
  /// False when the server has closed the connection.
  bool send(const std::string& text) {
    std::size_t at = 0;
    while (at < text.size()) {
      const ssize_t n = ::send(socket_, text.data() + at, text.size() - at, MSG_NOSIGNAL);
      if (n <= 0) return false;
      at += static_cast<std::size_t>(n);
    }
    return true;
  }
  /// All that comes until the server closes; "(nothing)" after a minute.
  std::string rest() {
    std::string text;
    for (;;) {
      pollfd fd{socket_, POLLIN, 0};
      const int ready = ::poll(&fd, 1, 60'000);
      if (ready < 0 && errno == EINTR) continue;  // a fuzzer has alarms
      if (ready <= 0) return "(nothing)";
      char buffer[4096];
      const ssize_t n = ::recv(socket_, buffer, sizeof buffer, 0);
      if (n <= 0) return text;
      text.append(buffer, static_cast<std::size_t>(n));
    }
  }
  /// Nothing more comes from here.
  void end_sending() { ::shutdown(socket_, SHUT_WR); }
  bool connected = false;

 private:
  int socket_;
};

/// Lines of headers, each to be sent alone; some are several lines, or none that HTTP allows.
inline std::vector<std::string> asked_headers() {
  std::vector<std::string> lines = {
      "X-Nothing: 1",
      "Range: bytes=0-200000,0-1",
      "Range: bytes=4-200",
      "Range: bytes=99-",
      "Range: bytes=-18446744073709551615",
      "Range: bytes=1-,-1,0-0",
      "range: bytes=0-0\r\nRange: bytes=5-6",
      "If-Range: \"x\"\r\nRange: bytes=4-200",
      "If-Range: Wed, 21 Oct 2015 07:28:00 GMT\r\nRange: bytes=4-",
      "If-Match: *",
      "If-Match: \"a\", \"b\"",
      "If-None-Match: *",
      "If-None-Match: W/\"x\"",
      "If-Modified-Since: Wed, 21 Oct 2015 07:28:00 GMT",
      "If-Unmodified-Since: Thu, 01 Jan 1970 00:00:00 GMT",
      "If-Modified-Since: never",
      "Expect: 100-continue",
      "Expect: 100-continue, 100-continue",
      "Expect: 200-ok",
      "Expect: 100-continue\r\nContent-Length: 5",
      "Transfer-Encoding: chunked",
      "Transfer-Encoding: chunked\r\n\r\n0\r\n",
      "Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\nx",
      "Transfer-Encoding: chunked\r\n\r\n-1\r\nx",
      "Transfer-Encoding: chunked\r\nContent-Length: 3",
      "Transfer-Encoding: gzip, chunked",
      "Transfer-Encoding: identity",
      "Transfer-Encoding : chunked",
      "Transfer-Encoding:\tchunked",
      "Transfer-Encoding: xchunked",
      "Transfer-Encoding: chunked\r\nTransfer-Encoding: identity",
      "TE: trailers",
      "TE: deflate;q=0.5",
      "Trailer: Host",
      "Content-Encoding: gzip",
      "Content-Encoding: br\r\nContent-Length: 4\r\n\r\nabcd",
      "Content-Encoding: deflate, gzip",
      "Accept-Encoding: gzip",
      "Accept-Encoding: br, gzip, deflate, zstd, *;q=0",
      "Accept-Encoding: identity;q=0",
      "Accept: application/x-nothing",
      "Accept: */*;q=99999999999999999999",
      "Accept-Charset: utf-16",
      "Accept-Language: de",
      "Connection: keep-alive",
      "Connection: close, Host",
      "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
      "Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: AAMAAABkAAQAAP__",
      "Upgrade: TLS/1.0",
      "Keep-Alive: timeout=99999, max=99999",
      "Proxy-Connection: keep-alive",
      "Via: 1.0 a",
      "Max-Forwards: 0",
      "Forwarded: for=127.0.0.1",
      "X-Forwarded-For: 127.0.0.1",
      "X-Forwarded-Host: evil.example",
      "X-HTTP-Method-Override: DELETE",
      "X-Original-URL: /api/v1/overview",
      "Host: evil.example",
      "Host:",
      "Host: 127.0.0.1:1\r\nHost: 127.0.0.1:2",
      "Origin: http://evil.example",
      "Origin: null",
      "Referer: http://evil.example/",
      "Cookie: " + std::string(2000, 'c'),
      "Authorization: Bearer",
      "Authorization: Bearer " + std::string(600, 'k'),
      "Authorization: Basic Og==",
      "Authorization: Bearer a\r\nAuthorization: Bearer b",
      "Proxy-Authorization: Basic Og==",
      "Content-Type: multipart/form-data; boundary=x\r\nContent-Length: 5\r\n\r\n--x--",
      "Content-Type: multipart/form-data\r\nContent-Length: 5\r\n\r\n--x--",
      "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 7\r\n\r\n%=%&a=%",
      "Content-Type: application/json\r\nContent-Length: 2\r\n\r\n{}",
      "Content-Type:",
      "Content-Disposition: attachment; filename=../x",
      "Content-Range: bytes 0-1/*",
      "Content-MD5: x",
      "Content-Length: 2\r\n\r\n{}GET / HTTP/1.1\r\n\r\n",
      "Content-Length: 3\r\nContent-Length: 4\r\n\r\nabcd",
      "Content-Length: 3, 3\r\n\r\nabc",
      "content-length: 1\r\n\r\n",
      "Date: yesterday",
      "Cache-Control: no-cache, max-age=-1",
      "Pragma: no-cache",
      "Warning: 199 - x",
      "From: a@b",
      "User-Agent: " + std::string(4000, 'u'),
      "Upgrade-Insecure-Requests: 1",
      "DNT: 1",
      "Early-Data: 1",
      "Access-Control-Request-Method: PUT\r\nOrigin: http://evil.example",
      "Sec-Fetch-Site: cross-site",
      "Want-Digest: sha-256",
      "Prefer: return=minimal",
      "Depth: infinity",
      "Destination: /x",
      // Lines that HTTP does not allow, or no more.
      "X-Folded: a\r\n b\r\n\tc",
      "Range: bytes=4-\r\n 200",
      "Content-Length: 1\r\n 0",
      " Leading: 1",
      ": no name",
      "no colon",
      "Na me: 1",
      "Name\x01: 1",
      "X: \x7f\x80\xff",
      std::string("X: a\0b", 6),
      "X: a\rb",
      "X: a\nRange: bytes=4-200",
      "\nRange: bytes=4-200",
      "X: %0d%0aRange: bytes=4-200",
      "X: " + std::string(20000, 'x'),
      std::string(20000, 'n') + ": x",
      std::string(20000, ':'),
  };
  for (const char* length :
       {"0", "1", "-1", "-0", "+1", "00", "0x1", "1e3", "9223372036854775807",
        "9223372036854775808", "18446744073709551614", "18446744073709551615",
        "18446744073709551616", "99999999999999999999999999", "", " ", "a", "1 2", "1;2"}) {
    lines.push_back(std::string("Content-Length: ") + length);
  }
  std::string many;
  for (int i = 0; i < 400; ++i) many += fmt::format("{}X-{}: 1", i == 0 ? "" : "\r\n", i);
  lines.push_back(many);
  return lines;
}

/// What is wrong with an answer; empty where nothing is: it is one answer, as long as it says, with
/// no part of it asked for, and holds nothing that is secret. No answer at all is right, too: the
/// request was none.
inline std::string fault_of_answer(std::string answer, bool head, const std::string& secret) {
  if (answer == "(nothing)") return "no end in a minute";
  if (!secret.empty() && answer.find(secret) != answer.npos) return "a secret";
  for (const std::string go_on = "HTTP/1.1 100 Continue\r\n\r\n"; answer.starts_with(go_on);) {
    answer.erase(0, go_on.size());
  }
  if (answer.empty()) return {};
  const std::size_t end = answer.find("\r\n\r\n");
  if (!answer.starts_with("HTTP/1.1 ") || end == answer.npos) return "no answer of HTTP";
  const std::string headers = answer.substr(0, end + 2);
  const std::size_t bytes = answer.size() - end - 4;
  if (headers.find("Content-Range") != headers.npos) return "a part";
  if (answer.starts_with("HTTP/1.1 206")) return "a part";
  const std::string name = "\r\nContent-Length: ";
  const std::size_t at = headers.find(name);
  if (at == headers.npos) return bytes == 0 ? "" : "no length";
  if (headers.find(name, at + 1) != headers.npos) return "two lengths";
  const std::string said =
      headers.substr(at + name.size(), headers.find('\r', at + 2) - at - name.size());
  return said == std::to_string(bytes) || (head && bytes == 0) ? "" : "says " + said + " bytes";
}

}  // namespace slicecorr::test
