// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <string>

#include "slicecorr/bridge/link.hpp"
#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::bridge {
namespace {

/// The machine whatever name it is called by.
std::string machine_name(const RegisterMap& map) {
  if (map.transport == Transport::rtu) {
    struct stat status;
    // Links to a device are that device.
    if (::stat(map.device.c_str(), &status) != 0) return "line " + map.device;
    return fmt::format("line {:x}:{:x}:{:x}", status.st_rdev, status.st_dev, status.st_ino);
  }
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const std::string port = std::to_string(map.port);
  const int code = ::getaddrinfo(map.host.c_str(), port.c_str(), &hints, &found);
  if (code != 0) {
    throw InputError("modbus", "host",
                     fmt::format("'{}' is not found: {}", map.host, ::gai_strerror(code)));
  }
  std::array<char, NI_MAXHOST> text{};
  const int named = ::getnameinfo(found->ai_addr, found->ai_addrlen, text.data(), text.size(),
                                  nullptr, 0, NI_NUMERICHOST);
  std::string host = named == 0 ? text.data() : map.host;
  ::freeaddrinfo(found);
  // This computer has many addresses.
  if (host.starts_with("127.") || host == "::1") host = "localhost";
  return fmt::format("{} {} {}", host, port, map.unit);
}

}  // namespace

MachineLock::MachineLock(const RegisterMap& map) {
  // A name that is no file; only one socket can have it.
  const std::string name = "printbridge drives " + machine_name(map);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::size_t length = std::min(name.size(), sizeof address.sun_path - 1);
  std::copy_n(name.begin(), length, address.sun_path + 1);
  socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket_ < 0) {
    throw DeviceError(slicecorr::detail::errno_message("the machine", "can't be taken"));
  }
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + length);
  if (::bind(socket_, reinterpret_cast<const sockaddr*>(&address), size) == 0) return;
  const int error = errno;
  ::close(socket_);
  if (error == EADDRINUSE) {
    throw InputError("modbus", "", "another bridge on this computer is at work with this machine");
  }
  throw DeviceError(slicecorr::detail::errno_message("the machine", "can't be taken", error));
}

MachineLock::~MachineLock() { ::close(socket_); }

}  // namespace slicecorr::bridge
