// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/sha256.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <fstream>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::cli {

struct Hash::Impl {
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  ~Impl() { EVP_MD_CTX_free(context); }
};

Hash::Hash(Kind kind) : impl_(std::make_unique<Impl>()) {
  const bool md5 = kind == Kind::md5;
  if (!impl_->context ||
      EVP_DigestInit_ex(impl_->context, md5 ? EVP_md5() : EVP_sha256(), nullptr) != 1) {
    throw DeviceError(md5 ? "MD5 is not available, which machines ask for"
                          : "SHA-256 is not available");
  }
}

Hash::~Hash() = default;

void Hash::add(const void* data, std::size_t size) { EVP_DigestUpdate(impl_->context, data, size); }

std::string Hash::hex() {
  unsigned char bytes[EVP_MAX_MD_SIZE];
  unsigned size = 0;
  EVP_DigestFinal_ex(impl_->context, bytes, &size);
  std::string text;
  for (unsigned i = 0; i < size; ++i) text += fmt::format("{:02x}", bytes[i]);
  return text;
}

std::string sha256_of_contents(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(slicecorr::detail::errno_message(path, "can't be read"));
  std::string buffer(std::size_t{1} << 20, '\0');
  Sha256 hash;
  while (file) {
    file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    hash.add(buffer.data(), static_cast<std::size_t>(file.gcount()));
  }
  if (!file.eof()) throw InputError(path, "", "can't be read");
  return hash.hex();
}

}  // namespace slicecorr::cli
