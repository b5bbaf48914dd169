// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file digest.hpp
/// MD5, which printers ask for, and logins by digest (RFC 7616): both sides of them.
#pragma once

#include <optional>
#include <string>

#include "support/files/sha256.hpp"

namespace slicecorr::farm::detail {

/// For one thread. Throws `DeviceError` when the library has no MD5.
class Md5 : public cli::Hash {
 public:
  Md5() : Hash(Kind::md5) {}
};
std::string md5_hex(const std::string& text);

/// What a server asks for: a header WWW-Authenticate.
struct DigestChallenge {
  std::string realm, nonce, opaque;
  bool qop_auth = false;
  bool stale = false;  ///< only the nonce was too old
};
/// Nothing where the header asks for something else, or for another algorithm than MD5.
std::optional<DigestChallenge> read_challenge(const std::string& header);

/// Who logs in.
struct DigestLogin {
  std::string user, password;
};
/// One request: "GET", "/api/version".
struct DigestRequest {
  std::string method, uri;
  unsigned count = 1;  ///< of requests with this nonce
  std::string cnonce;  ///< chosen by the client
};
/// The 32 digits that prove the password.
std::string digest_response(const DigestChallenge& challenge, const DigestLogin& login,
                            const DigestRequest& request);
/// The whole header Authorization.
std::string digest_header(const DigestChallenge& challenge, const DigestLogin& login,
                          const DigestRequest& request);
/// A member of a header "Digest a=\"b\", c=d"; empty where it is not there.
std::string digest_member(const std::string& header, const std::string& name);

}  // namespace slicecorr::farm::detail
