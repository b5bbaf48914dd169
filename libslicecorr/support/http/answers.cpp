// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/http/answers.hpp"

#include <openssl/sha.h>

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "support/text/base64.hpp"

namespace slicecorr::http {

std::string style_hashes(const std::string& html) {
  std::string hashes;
  for (std::size_t at = 0; (at = html.find("<style>", at)) != std::string::npos;) {
    at += 7;
    const std::size_t end = html.find("</style>", at);
    if (end == std::string::npos) break;
    std::vector<std::uint8_t> digest(SHA256_DIGEST_LENGTH);
    ::SHA256(reinterpret_cast<const unsigned char*>(html.data() + at), end - at, digest.data());
    hashes += " 'sha256-" + slicecorr::detail::base64(digest) + "'";
    at = end;
  }
  return hashes;
}

std::string policy_for_styles(const std::string& html) {
  const std::string hashes = style_hashes(html);
  return "default-src 'none'; style-src" + (hashes.empty() ? " 'none'" : hashes) +
         "; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
}

void send(httplib::Response& response, int status, std::string text, const char* type) {
  response.status = status;
  if (text.empty()) {
    response.set_content("", type);
    return;
  }
  const auto body = std::make_shared<const std::string>(std::move(text));
  response.set_content_provider(body->size(), type,
                                [body](std::size_t at, std::size_t size, httplib::DataSink& sink) {
                                  // The server asks for what headers ask of it.
                                  if (at > body->size() || size > body->size() - at) return false;
                                  return sink.write(body->data() + at, size);
                                });
}

int status_before_body(httplib::Response& response) {
  // The server says no length of answers that come in place of leave to send, but for errors.
  if (response.status < 400)
    response.set_header("Content-Length", std::to_string(response.content_length_));
  return response.status;
}

void send_error(httplib::Response& response, int status, const char* code,
                const std::string& message) {
  const nlohmann::ordered_json json = {
      {"error", {{"status", status}, {"code", code}, {"message", message}}}};
  send(response, status,
       json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n",
       kJsonType);
  if (status == 401) response.set_header("WWW-Authenticate", "Bearer");
  if (status == 405 && !response.has_header("Allow"))
    response.set_header("Allow", "GET, HEAD, POST, PUT");
  if (status == 503) response.set_header("Retry-After", "5");
}

std::string Kept::get(const std::function<std::string()>& make) {
  const std::scoped_lock lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  if (!any_ || std::chrono::duration<double>(now - made_).count() > seconds_) {
    text_ = make();
    made_ = std::chrono::steady_clock::now();
    any_ = true;
  }
  return text_;
}

void Kept::forget() {
  const std::scoped_lock lock(mutex_);
  any_ = false;
}

void finish(httplib::Response& response) {
  const auto otherwise = [&](const char* name, const char* value) {
    if (!response.has_header(name)) response.set_header(name, value);
  };
  otherwise("Content-Security-Policy", kBarePolicy);
  otherwise("X-Content-Type-Options", "nosniff");
  otherwise("X-Frame-Options", "DENY");
  otherwise("Referrer-Policy", "no-referrer");
  otherwise("Cross-Origin-Resource-Policy", "same-origin");
  otherwise("Cross-Origin-Opener-Policy", "same-origin");
  otherwise("Cache-Control", "no-store");
}

}  // namespace slicecorr::http
