// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Addresses of the frame wire: Unix and TCP sockets.

#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>

#include "frames/wire.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

/// Connections that wait to be taken.
constexpr int kBacklog = 64;

struct Address {
  bool unix_socket = false;
  std::string host;  ///< or path
  std::string port;
};

Address parse(const std::string& text) {
  Address a;
  if (text.rfind("unix:", 0) == 0 && text.size() > 5) {
    a.unix_socket = true;
    a.host = text.substr(5);
    if (a.host.size() >= sizeof(sockaddr_un::sun_path)) {
      throw InputError(text, "",
                       fmt::format("the path is too long for a socket, expected less than {} bytes",
                                   sizeof(sockaddr_un::sun_path)));
    }
    return a;
  }
  const auto colon = text.rfind(':');
  if (text.rfind("tcp:", 0) == 0 && colon != std::string::npos && colon > 4) {
    a.host = text.substr(4, colon - 4);
    a.port = text.substr(colon + 1);
    if (a.host.size() > 2 && a.host.front() == '[' && a.host.back() == ']') {
      a.host = a.host.substr(1, a.host.size() - 2);
    }
    const bool digits = !a.port.empty() && a.port.size() <= 5 &&
                        a.port.find_first_not_of("0123456789") == std::string::npos;
    if (digits && std::stoi(a.port) <= 65535) return a;
  }
  throw InputError(text, "", "is no address, expected unix:PATH or tcp:HOST:PORT");
}

sockaddr_un unix_address(const std::string& path) {
  sockaddr_un u{};
  u.sun_family = AF_UNIX;
  std::memcpy(u.sun_path, path.c_str(), path.size() + 1);
  return u;
}

using Addresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;
Addresses look_up(const Address& a, const std::string& text, bool passive) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = passive ? AI_PASSIVE : 0;
  addrinfo* found = nullptr;
  const int code = getaddrinfo(a.host.c_str(), a.port.c_str(), &hints, &found);
  if (code != 0) throw InputError(text, "", gai_strerror(code));
  return {found, &freeaddrinfo};
}

void no_delay(int descriptor) {
  const int on = 1;
  ::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

[[noreturn]] void failed(const std::string& address, const char* what) {
  throw DeviceError(fmt::format("{}: {}: {}", address, what, std::strerror(errno)));
}

}  // namespace

WireSocket connect_wire(const std::string& address) {
  const Address a = parse(address);
  if (a.unix_socket) {
    WireSocket s(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const sockaddr_un u = unix_address(a.host);
    if (!s || ::connect(s.get(), reinterpret_cast<const sockaddr*>(&u), sizeof u) != 0) {
      failed(address, "no display answers there");
    }
    return s;
  }
  const Addresses found = look_up(a, address, false);
  for (const addrinfo* i = found.get(); i != nullptr; i = i->ai_next) {
    WireSocket s(::socket(i->ai_family, i->ai_socktype | SOCK_CLOEXEC, i->ai_protocol));
    if (s && ::connect(s.get(), i->ai_addr, i->ai_addrlen) == 0) {
      no_delay(s.get());
      return s;
    }
  }
  failed(address, "no display answers there");
}

WireListener listen_wire(const std::string& address) {
  const Address a = parse(address);
  if (a.unix_socket) {
    const sockaddr_un u = unix_address(a.host);
    struct stat there {};
    if (::lstat(a.host.c_str(), &there) == 0) {
      if (!S_ISSOCK(there.st_mode)) throw InputError(address, "", "exists and is no socket");
      WireSocket probe(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
      if (::connect(probe.get(), reinterpret_cast<const sockaddr*>(&u), sizeof u) == 0) {
        throw InputError(address, "", "another program listens there");
      }
      ::unlink(a.host.c_str());
    }
    WireSocket s(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    // Before it has a name: who is neither its user nor of its group never reaches it, whatever the umask.
    if (!s || ::fchmod(s.get(), 0660) != 0 ||
        ::bind(s.get(), reinterpret_cast<const sockaddr*>(&u), sizeof u) != 0 ||
        ::listen(s.get(), kBacklog) != 0) {
      failed(address, "can't listen");
    }
    return {std::move(s), address};
  }
  const Addresses found = look_up(a, address, true);
  for (const addrinfo* i = found.get(); i != nullptr; i = i->ai_next) {
    WireSocket s(::socket(i->ai_family, i->ai_socktype | SOCK_CLOEXEC, i->ai_protocol));
    if (!s) continue;
    const int on = 1;
    ::setsockopt(s.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (::bind(s.get(), i->ai_addr, i->ai_addrlen) != 0 || ::listen(s.get(), kBacklog) != 0)
      continue;
    sockaddr_storage bound{};
    socklen_t size = sizeof bound;
    ::getsockname(s.get(), reinterpret_cast<sockaddr*>(&bound), &size);
    const int port =
        ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(bound).sin6_port
                                          : reinterpret_cast<const sockaddr_in&>(bound).sin_port);
    const std::string host = a.host.find(':') == std::string::npos ? a.host : "[" + a.host + "]";
    return {std::move(s), fmt::format("tcp:{}:{}", host, port)};
  }
  failed(address, "can't listen");
}

}  // namespace slicecorr::bridge
