// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file mdns.hpp
/// Printers that announce themselves in their network (mDNS, RFC 6762 and 6763): PrusaLink and
/// OctoPrint, as _octoprint._tcp. A question comes from a port of our own, so answers come to it alone;
/// no daemon is needed. Messages are made and read by the system's own resolver (glibc).
#pragma once

#include <string>
#include <vector>

#include "slicecorr/farm/machines.hpp"

namespace slicecorr::farm::detail {

/// Where such questions go.
inline constexpr const char* kMdnsGroup = "224.0.0.251";
inline constexpr int kMdnsPort = 5353;

/// The question for printers, and for what is not known yet of those with these names.
std::string mdns_question(const std::vector<std::string>& unfinished = {});

struct MdnsAnswer {
  std::vector<FoundMachine> found;
  /// Names, as DNS writes them, of those that told no port.
  std::vector<std::string> unfinished;
};
/// What an answer says that came from `host`; nothing where it is damaged or none.
MdnsAnswer mdns_answer(const std::string& datagram, const std::string& host);

}  // namespace slicecorr::farm::detail
