// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The call for SDCP machines: a datagram of six letters, answered by one of JSON each. Beside it the question
// for printers that announce themselves (mdns.hpp).

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

#include "machines/mdns.hpp"
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

/// One datagram that asks, and the network that it goes out to.
struct Call {
  sockaddr_in to{};
  std::string text;
  in_addr_t from = INADDR_ANY;  ///< this computer's address there
};

class Udp {
 public:
  Udp() : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    const int yes = 1, far = 255;
    if (socket_ < 0 || ::setsockopt(socket_, SOL_SOCKET, SO_BROADCAST, &yes, sizeof yes) != 0 ||
        ::setsockopt(socket_, IPPROTO_IP, IP_MULTICAST_TTL, &far, sizeof far) != 0) {
      throw DeviceError(slicecorr::detail::errno_message("UDP", "can't be had"));
    }
  }
  ~Udp() { ::close(socket_); }
  Udp(const Udp&) = delete;
  Udp& operator=(const Udp&) = delete;

  /// Whether it went.
  bool call(const Call& call) const {
    const in_addr from{call.from};
    if (call.from != INADDR_ANY &&
        ::setsockopt(socket_, IPPROTO_IP, IP_MULTICAST_IF, &from, sizeof from) != 0) {
      return false;
    }
    return ::sendto(socket_, call.text.data(), call.text.size(), 0,
                    reinterpret_cast<const sockaddr*>(&call.to),
                    sizeof call.to) == static_cast<ssize_t>(call.text.size());
  }
  struct Answer {
    std::string text, from;
  };
  /// One answer, with the address that it came from, whatever the machine believes its own to be.
  std::optional<Answer> answer(int most_ms) const {
    pollfd fd{socket_, POLLIN, 0};
    if (::poll(&fd, 1, most_ms) <= 0) return std::nullopt;
    std::array<char, 65536> buffer{};
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t n = ::recvfrom(socket_, buffer.data(), buffer.size(), 0,
                                 reinterpret_cast<sockaddr*>(&from), &size);
    char text[INET_ADDRSTRLEN] = "";
    if (n <= 0 || !::inet_ntop(AF_INET, &from.sin_addr, text, sizeof text)) return std::nullopt;
    return Answer{std::string(buffer.data(), static_cast<std::size_t>(n)), text};
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

/// HOST or HOST:PORT.
sockaddr_in address_named(const std::string& host, int port) {
  const std::size_t colon = host.rfind(':');
  const std::string name = host.substr(0, colon);
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

/// A network that this computer is in.
struct Network {
  in_addr_t own = INADDR_ANY, everybody = INADDR_ANY;
  bool has_everybody = false, has_groups = false;
};

/// All of them, or the one where this computer has the address `own`.
std::vector<Network> networks(const std::string& own) {
  in_addr wanted{INADDR_ANY};
  if (!own.empty() && ::inet_pton(AF_INET, own.c_str(), &wanted) != 1) {
    throw InputError("'" + own + "': expected an address of this computer, as 192.168.1.10");
  }
  std::vector<Network> list;
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return list;
  for (const ifaddrs* i = all; i; i = i->ifa_next) {
    if (!i->ifa_addr || i->ifa_addr->sa_family != AF_INET || !(i->ifa_flags & IFF_UP)) continue;
    const in_addr_t here = reinterpret_cast<const sockaddr_in*>(i->ifa_addr)->sin_addr.s_addr;
    if (!own.empty() && here != wanted.s_addr) continue;
    Network network{here};
    network.has_everybody = (i->ifa_flags & IFF_BROADCAST) && i->ifa_broadaddr;
    if (network.has_everybody) {
      network.everybody = reinterpret_cast<const sockaddr_in*>(i->ifa_broadaddr)->sin_addr.s_addr;
    }
    // This computer alone is asked where somebody names its address.
    network.has_groups = (i->ifa_flags & IFF_MULTICAST) || !own.empty();
    list.push_back(network);
  }
  ::freeifaddrs(all);
  if (list.empty() && !own.empty()) {
    throw InputError(own + ": is no address of this computer");
  }
  return list;
}

/// Whom to ask: these hosts, or everybody.
std::vector<Call> calls_to(const std::vector<std::string>& hosts, const std::string& own) {
  const std::string sdcp(kCall), mdns = detail::mdns_question();
  std::vector<Call> list;
  const std::vector<Network> all = networks(own);
  const auto group = [&](const sockaddr_in& to) {
    for (const Network& n : all) {
      if (n.has_groups) list.push_back({to, mdns, n.own});
    }
  };
  for (const std::string& host : hosts) {
    const sockaddr_in to = address_named(host, detail::kMdnsPort);
    if (IN_MULTICAST(ntohl(to.sin_addr.s_addr))) {
      group(to);
      continue;
    }
    list.push_back({address_named(host, kCallPort), sdcp});
    list.push_back({to, mdns});
  }
  if (!hosts.empty()) return list;
  if (own.empty()) list.push_back({address_of(INADDR_BROADCAST, kCallPort), sdcp});
  for (const Network& n : all) {
    if (n.has_everybody) list.push_back({address_of(n.everybody, kCallPort), sdcp});
  }
  group(address_named(detail::kMdnsGroup, detail::kMdnsPort));
  return list;
}

bool is_same(const FoundMachine& a, const FoundMachine& b) {
  if (!a.id.empty() || !b.id.empty()) return a.id == b.id;
  return a.kind == b.kind && a.host == b.host && a.name == b.name;
}

/// What was found, and who has to be asked again.
class Findings {
 public:
  void take(const Udp::Answer& answer) {
    if (auto sdcp = detail::sdcp_found(answer.text, answer.from)) return add(*std::move(sdcp));
    detail::MdnsAnswer said = detail::mdns_answer(answer.text, answer.from);
    for (FoundMachine& each : said.found) add(std::move(each));
    for (std::string& each : said.unfinished) {
      const bool known = std::find(unfinished.begin(), unfinished.end(), each) != unfinished.end();
      if (!known && unfinished.size() < kMostFound) unfinished.push_back(std::move(each));
    }
  }
  std::vector<FoundMachine> list;
  std::vector<std::string> unfinished;

 private:
  void add(FoundMachine found) {
    const bool known = std::any_of(list.begin(), list.end(),
                                   [&](const FoundMachine& f) { return is_same(f, found); });
    if (!known && list.size() < kMostFound) list.push_back(std::move(found));
  }
};

}  // namespace

std::vector<FoundMachine> discover_machines(const std::vector<std::string>& hosts, double wait_s,
                                            const std::string& own_address) {
  std::vector<Call> calls = calls_to(hosts, own_address);
  const Udp udp;
  Findings findings;
  // Whoever was asked alone has answered.
  const auto all_answered = [&] { return !hosts.empty() && findings.list.size() >= hosts.size(); };
  const auto listen = [&](Steady::time_point until) {
    while (!all_answered()) {
      const auto left =
          std::chrono::duration_cast<std::chrono::milliseconds>(until - Steady::now());
      if (left.count() < 0) return;
      if (const auto answer = udp.answer(static_cast<int>(left.count()) + 1)) {
        findings.take(*answer);
      }
    }
  };
  // Datagrams get lost: twice.
  bool any = false;
  for (int i = 0; i < 2 && !all_answered(); ++i) {
    for (Call& each : calls) {
      if (i > 0 && each.text != kCall) each.text = detail::mdns_question(findings.unfinished);
      any = udp.call(each) || any;
    }
    if (!any) throw DeviceError("no call for machines could be sent: there is no network");
    listen(Steady::now() +
           std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(wait_s / 2)));
  }
  return std::move(findings.list);
}

}  // namespace slicecorr::farm
