// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/digest.hpp"

#include <fmt/format.h>

#include "support/text/ascii.hpp"

namespace slicecorr::farm::detail {

std::string md5_hex(const std::string& text) {
  Md5 md5;
  md5.add(text.data(), text.size());
  return md5.hex();
}

std::string digest_member(const std::string& header, const std::string& name) {
  // From member to member, so that a value that looks like one is none.
  std::size_t at = header.find(' ');
  while (at < header.size()) {
    at = header.find_first_not_of(" \t,", at);
    if (at == header.npos) break;
    const std::size_t equals = header.find('=', at);
    if (equals == header.npos) break;
    const std::string key = lower_case(trimmed(header.substr(at, equals - at)));
    std::string value;
    at = equals + 1;
    if (at < header.size() && header[at] == '"') {
      for (++at; at < header.size() && header[at] != '"'; ++at) {
        if (header[at] == '\\' && at + 1 < header.size()) ++at;
        value += header[at];
      }
      ++at;
    } else {
      const std::size_t end = std::min(header.find(',', at), header.size());
      value = trimmed(header.substr(at, end - at));
      at = end;
    }
    if (key == name) return value;
  }
  return {};
}

std::optional<DigestChallenge> read_challenge(const std::string& header) {
  if (lower_case(header.substr(0, 7)) != "digest ") return std::nullopt;
  DigestChallenge challenge;
  challenge.realm = digest_member(header, "realm");
  challenge.nonce = digest_member(header, "nonce");
  challenge.opaque = digest_member(header, "opaque");
  challenge.stale = lower_case(digest_member(header, "stale")) == "true";
  const std::string algorithm = lower_case(digest_member(header, "algorithm"));
  const std::string qop = lower_case(digest_member(header, "qop"));
  // "auth", "auth,auth-int"
  for (std::size_t at = 0; at < qop.size();) {
    const std::size_t end = std::min(qop.find(',', at), qop.size());
    challenge.qop_auth = challenge.qop_auth || trimmed(qop.substr(at, end - at)) == "auth";
    at = end + 1;
  }
  if (challenge.nonce.empty() || (!algorithm.empty() && algorithm != "md5") ||
      (!qop.empty() && !challenge.qop_auth)) {
    return std::nullopt;
  }
  return challenge;
}

std::string digest_response(const DigestChallenge& challenge, const DigestLogin& login,
                            const DigestRequest& request) {
  const std::string ha1 = md5_hex(login.user + ":" + challenge.realm + ":" + login.password);
  const std::string ha2 = md5_hex(request.method + ":" + request.uri);
  if (!challenge.qop_auth) return md5_hex(ha1 + ":" + challenge.nonce + ":" + ha2);
  return md5_hex(fmt::format("{}:{}:{:08x}:{}:auth:{}", ha1, challenge.nonce, request.count,
                             request.cnonce, ha2));
}

std::string digest_header(const DigestChallenge& challenge, const DigestLogin& login,
                          const DigestRequest& request) {
  std::string header = fmt::format(
      R"(Digest username="{}", realm="{}", nonce="{}", uri="{}", response="{}", algorithm=MD5)",
      login.user, challenge.realm, challenge.nonce, request.uri,
      digest_response(challenge, login, request));
  if (challenge.qop_auth) {
    header += fmt::format(R"(, qop=auth, nc={:08x}, cnonce="{}")", request.count, request.cnonce);
  }
  if (!challenge.opaque.empty()) header += fmt::format(R"(, opaque="{}")", challenge.opaque);
  return header;
}

}  // namespace slicecorr::farm::detail
