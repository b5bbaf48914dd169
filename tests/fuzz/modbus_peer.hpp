// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file modbus_peer.hpp
/// A small machine for fuzzers, and ports of this computer.
#pragma once

#include "fuzz.hpp"
#include "raw_client.hpp"
#include "sim_fixture.hpp"

namespace slicecorr::fuzz {

/// A socket that listens on a free port of this computer.
struct Listening {
  Listening() : socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof address;
    if (::bind(socket, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
        ::listen(socket, 16) != 0 ||
        ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &length) != 0) {
      std::abort();
    }
    port = ntohs(address.sin_port);
  }
  int socket, port = 0;
};

}  // namespace slicecorr::fuzz
