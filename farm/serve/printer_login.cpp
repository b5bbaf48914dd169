// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/printer_login.hpp"

#include <fmt/format.h>
#include <openssl/crypto.h>

#include <charconv>

#include "machines/digest.hpp"
#include "slicecorr/farm/token.hpp"
#include "support/http/guard.hpp"

namespace slicecorr::farm::detail {

namespace {

constexpr const char* kUser = "maker";
constexpr const char* kRealm = "prusa-sl1";
/// As the machines themselves do: a nonce lives half a minute, 30 wrong tries lock for 5 s.
constexpr auto kNonceLife = std::chrono::seconds(30);
constexpr auto kLock = std::chrono::seconds(5);
constexpr int kWrongTries = 30;
constexpr std::size_t kMostNonces = 1000;

/// Takes one time whatever was sent, but for its length.
bool same(const std::string& a, const std::string& b) {
  return a.size() == b.size() && CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

}  // namespace

PrinterLogin::Digest PrinterLogin::digest(const httplib::Request& request,
                                          const std::string& header) {
  const std::string nonce = digest_member(header, "nonce"), count = digest_member(header, "nc");
  DigestRequest asked{request.method, digest_member(header, "uri"), 0,
                      digest_member(header, "cnonce")};
  const auto [rest, error] =
      std::from_chars(count.data(), count.data() + count.size(), asked.count, 16);
  const bool plain = error == std::errc{} && rest == count.data() + count.size() &&
                     digest_member(header, "qop") == "auth" &&
                     digest_member(header, "username") == kUser &&
                     digest_member(header, "realm") == kRealm && asked.uri == request.target &&
                     asked.cnonce.size() <= 200;
  const std::string wanted =
      digest_response({kRealm, nonce, "", true, false}, {kUser, key_}, asked);
  if (!same(digest_member(header, "response"), wanted) || !plain) return Digest::wrong;
  const auto known = nonces_.find(nonce);
  // A count that came before is a request that somebody repeats.
  if (known == nonces_.end() || known->second.until < Steady::now() ||
      asked.count <= known->second.count) {
    return Digest::stale;
  }
  known->second.count = asked.count;
  return Digest::right;
}

std::string PrinterLogin::challenge(bool stale) {
  const auto now = Steady::now();
  std::erase_if(nonces_, [&](const auto& n) { return n.second.until < now; });
  if (nonces_.size() >= kMostNonces) {
    throw http::ApiError(503, "busy", "too many logins; try again soon");
  }
  const std::string nonce = random_token();
  nonces_[nonce] = {now + kNonceLife, 0};
  return fmt::format(R"(Digest realm="{}", nonce="{}", qop="auth", algorithm=MD5{})", kRealm, nonce,
                     stale ? ", stale=true" : "");
}

void PrinterLogin::note_wrong() {
  if (++wrong_ < kWrongTries) return;
  wrong_ = 0;
  locked_until_ = Steady::now() + kLock;
}

void PrinterLogin::check(const httplib::Request& request, httplib::Response& response) {
  const std::scoped_lock lock(mutex_);
  if (Steady::now() < locked_until_) {
    throw http::ApiError(429, "locked", "too many wrong keys; try again in some seconds");
  }
  if (request.get_header_value_count("Authorization") > 1 ||
      request.get_header_value_count("X-Api-Key") > 1) {
    throw http::ApiError(400, "login", "expected one login");
  }
  const std::string header = request.get_header_value("Authorization");
  const std::string given = request.get_header_value("X-Api-Key");
  if (!given.empty() || header.starts_with("Bearer ")) {
    // Both are compared, so that the time tells nothing of which it was.
    const bool by_key = same(given, key_), by_bearer = http::has_bearer(request, key_);
    if (by_key || by_bearer) {
      wrong_ = 0;
      return;
    }
    note_wrong();
    throw http::ApiError(403, "key", "the key is wrong");
  }
  bool stale = false;
  if (header.starts_with("Digest ")) {
    const Digest found = digest(request, header);
    if (found == Digest::right) {
      wrong_ = 0;
      return;
    }
    stale = found == Digest::stale;
    if (!stale) note_wrong();
  }
  response.set_header("WWW-Authenticate", challenge(stale));
  throw http::ApiError(401, "login", "expected the key, in X-Api-Key or by digest");
}

}  // namespace slicecorr::farm::detail
