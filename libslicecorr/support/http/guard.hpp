// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file guard.hpp
/// Who may ask for what: Host and Origin headers, tokens, the size of bodies. Looked at before
/// anything of a request's body is read.
#pragma once

#include <httplib.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace slicecorr::http {

/// A request that is answered with an error. The message never repeats what the client sent.
class ApiError : public std::runtime_error {
 public:
  ApiError(int status, const char* code, const std::string& message)
      : std::runtime_error(message), status(status), code(code) {}
  int status;
  const char* code;
};

struct GuardRules {
  bool loopback = true;  ///< bound to an address of loopback: reading needs no token
  int port = 0;
  std::string token;  ///< empty: no changes
  std::vector<std::string> host_names;
};

/// What a request is, as far as rights go.
enum class Access {
  shell,  ///< the page without data: free
  read,
  change,
};

/// Whether an address is one of loopback: "127.0.0.1", "::1".
bool is_loopback(const std::string& ip);

/// Throws `ApiError`.
void check_headers(const GuardRules& rules, const httplib::Request& request);
void check_access(const GuardRules& rules, const httplib::Request& request, Access access);

/// Whether the request's one Authorization header is "Bearer" and this token; takes one time whatever
/// was sent.
bool has_bearer(const httplib::Request& request, const std::string& token);

/// Size of the body that a request announces; 0 without one. Throws `ApiError` for bodies without a
/// length, encoded ones, and those above `most`.
std::int64_t body_bytes(const httplib::Request& request, std::int64_t most);

/// This process holds a secret: it leaves no core, and no other process of the user looks into its memory.
void keep_out_of_cores();

/// Reads a bearer token: the first line of a file that only its owner can read (mode 0600 or 0400),
/// `least` to 512 printable characters; it is kept out of cores. Throws `InputError`.
std::string read_token_file(const std::string& path, std::size_t least = 32);

}  // namespace slicecorr::http
