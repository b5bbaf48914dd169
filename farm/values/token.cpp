// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/token.hpp"

#include <fmt/format.h>
#include <sys/random.h>

#include <cerrno>

#include "slicecorr/error.hpp"

namespace slicecorr::farm {

std::string random_token() {
  unsigned char bytes[16];
  std::size_t have = 0;
  while (have < sizeof bytes) {
    const ssize_t n = ::getrandom(bytes + have, sizeof bytes - have, 0);
    if (n < 0 && errno != EINTR) throw DeviceError("the system gives no random numbers");
    if (n > 0) have += static_cast<std::size_t>(n);
  }
  std::string text;
  for (const unsigned char b : bytes) text += fmt::format("{:02x}", b);
  return text;
}

}  // namespace slicecorr::farm
