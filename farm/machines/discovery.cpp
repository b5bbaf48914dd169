// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The call for SDCP machines: a datagram of six letters, answered by one of JSON each.

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <string_view>

#include "machines/sdcp.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/machines.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::farm {

namespace {

using Steady = std::chrono::steady_clock;
constexpr std::string_view kCall = "M99999";
constexpr int kCallPort = 3000;
constexpr std::size_t kMostFound = 1000;

class Udp {
 public:
  Udp() : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    const int yes = 1;
    if (socket_ < 0 || ::setsockopt(socket_, SOL_SOCKET, SO_BROADCAST, &yes, sizeof yes) != 0) {
      throw DeviceError(slicecorr::detail::errno_message("UDP", "can't be had"));
    }
  }
  ~Udp() { ::close(socket_); }
  Udp(const Udp&) = delete;
  Udp& operator=(const Udp&) = delete;

  /// Whether it went.
  bool call(const sockaddr_in& to) const {
    return ::sendto(socket_, kCall.data(), kCall.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                    sizeof to) == static_cast<ssize_t>(kCall.size());
  }
  /// One answer, with the address that it came from.
  std::optional<FoundMachine> answer(int most_ms) const {
    pollfd fd{socket_, POLLIN, 0};
    if (::poll(&fd, 1, most_ms) <= 0) return std::nullopt;
    std::array<char, 65536> buffer{};
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t n = ::recvfrom(socket_, buffer.data(), buffer.size(), 0,
                                 reinterpret_cast<sockaddr*>(&from), &size);
    char text[INET_ADDRSTRLEN] = "";
    if (n <= 0 || !::inet_ntop(AF_INET, &from.sin_addr, text, sizeof text)) return std::nullopt;
    // The address that it comes from, whatever the machine believes its own to be.
    return detail::sdcp_found(std::string(buffer.data(), static_cast<std::size_t>(n)), text);
  }

 private:
  int socket_;
};

sockaddr_in address_of(in_addr_t host, int port) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = host;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  return to;
}

sockaddr_in address_named(const std::string& host) {
  const std::size_t colon = host.rfind(':');
  const std::string name = host.substr(0, colon);
  int port = kCallPort;
  if (colon != host.npos) {
    const std::string digits = host.substr(colon + 1);
    if (digits.empty() || digits.size() > 5 ||
        digits.find_first_not_of("0123456789") != digits.npos) {
      throw InputError("'" + host + "': expected HOST or HOST:PORT");
    }
    port = std::stoi(digits);
  }
  addrinfo hints{}, *list = nullptr;
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  if (::getaddrinfo(name.c_str(), nullptr, &hints, &list) != 0 || !list) {
    throw DeviceError(name + ": has no address");
  }
  const in_addr_t found = reinterpret_cast<const sockaddr_in*>(list->ai_addr)->sin_addr.s_addr;
  ::freeaddrinfo(list);
  return address_of(found, port);
}

/// To everybody, and to everybody on each network that this computer is in.
std::vector<sockaddr_in> everybody() {
  std::vector<sockaddr_in> list{address_of(INADDR_BROADCAST, kCallPort)};
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return list;
  for (const ifaddrs* i = all; i; i = i->ifa_next) {
    if (!i->ifa_addr || i->ifa_addr->sa_family != AF_INET || !(i->ifa_flags & IFF_BROADCAST) ||
        !i->ifa_broadaddr) {
      continue;
    }
    const auto* to = reinterpret_cast<const sockaddr_in*>(i->ifa_broadaddr);
    list.push_back(address_of(to->sin_addr.s_addr, kCallPort));
  }
  ::freeifaddrs(all);
  return list;
}

}  // namespace

std::vector<FoundMachine> discover_machines(const std::vector<std::string>& hosts, double wait_s) {
  std::vector<sockaddr_in> to;
  to.reserve(hosts.size());
  for (const std::string& host : hosts) to.push_back(address_named(host));
  if (hosts.empty()) to = everybody();
  const Udp udp;
  std::vector<FoundMachine> list;
  const auto listen = [&](Steady::time_point until) {
    for (;;) {
      const auto left =
          std::chrono::duration_cast<std::chrono::milliseconds>(until - Steady::now());
      if (left.count() < 0) return;
      auto found = udp.answer(static_cast<int>(left.count()) + 1);
      if (!found || list.size() >= kMostFound) continue;
      const bool known = std::any_of(list.begin(), list.end(),
                                     [&](const FoundMachine& f) { return f.id == found->id; });
      if (!known) list.push_back(*std::move(found));
      // Whoever was asked alone has answered.
      if (!hosts.empty() && list.size() >= hosts.size()) return;
    }
  };
  // Datagrams get lost: twice.
  bool any = false;
  for (int i = 0; i < 2; ++i) {
    for (const sockaddr_in& each : to) any = udp.call(each) || any;
    if (!any) throw DeviceError("no call for machines could be sent: there is no network");
    listen(Steady::now() +
           std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(wait_s / 2)));
    if (!hosts.empty() && list.size() >= hosts.size()) break;
  }
  return list;
}

}  // namespace slicecorr::farm
