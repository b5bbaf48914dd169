// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/mdns.hpp"

#include <arpa/nameser.h>
#include <resolv.h>

#include <array>
#include <map>
#include <string_view>

#include "support/text/ascii.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

namespace {

constexpr const char* kService = "_octoprint._tcp.local";
constexpr int kHttpPort = 80;
/// Of what foreign answers say.
constexpr std::size_t kMostPrinters = 100, kMostAsked = 8;
constexpr int kMostShown = 100;

/// What one answer says of one printer.
struct Announced {
  int port = 0;
  std::map<std::string, std::string> texts;
};

bool is_printer(const std::string& name) {
  return lower_case(name).ends_with(std::string(".") + kService);
}

/// The first part of a name, without what DNS puts before letters: "Big\032one" is "Big one".
std::string first_label(const std::string& name) {
  std::string label;
  for (std::size_t i = 0; i < name.size() && name[i] != '.'; ++i) {
    if (name[i] != '\\') {
      label += name[i];
      continue;
    }
    const std::string digits = name.substr(i + 1, 3);
    if (digits.size() == 3 && digits.find_first_not_of("0123456789") == digits.npos) {
      label += static_cast<char>(std::stoi(digits));
      i += 3;
    } else if (++i < name.size()) {
      label += name[i];
    }
  }
  return label;
}

std::string shown(const std::string& text) {
  return text::clipped(text::printable(text), kMostShown);
}

/// "model=SL1", each with a byte for its length before it.
std::map<std::string, std::string> texts_of(std::string_view data) {
  std::map<std::string, std::string> texts;
  while (!data.empty()) {
    const std::size_t size = static_cast<std::uint8_t>(data[0]);
    const std::string_view one = data.substr(1, size);
    data.remove_prefix(std::min(data.size(), size + 1));
    const std::size_t equals = one.find('=');
    if (equals == one.npos) continue;
    texts.emplace(lower_case(std::string(one.substr(0, equals))), one.substr(equals + 1));
  }
  return texts;
}

FoundMachine machine_of(const std::string& name, const Announced& said, const std::string& host) {
  const auto text = [&](const char* key) {
    const auto at = said.texts.find(key);
    return at == said.texts.end() ? std::string() : shown(at->second);
  };
  FoundMachine found;
  found.host = said.port == kHttpPort ? host : host + ":" + std::to_string(said.port);
  found.name = shown(first_label(name));
  found.model = text("model");
  found.id = text("uuid");
  found.firmware = text("version");
  found.version = text("api");
  const bool prusa = lower_case(text("vendor")).find("prusa") != std::string::npos ||
                     lower_case(found.model).starts_with("sl1");
  found.kind = prusa ? MachineKind::prusalink : MachineKind::octoprint;
  return found;
}

/// Takes what a record says.
void take(const ns_msg& message, const ns_rr& record, std::map<std::string, Announced>& printers) {
  const u_char* data = ns_rr_rdata(record);
  const std::size_t size = ns_rr_rdlen(record);
  const std::string name = ns_rr_name(record);
  if (ns_rr_type(record) == ns_t_ptr && lower_case(name) == kService) {
    std::array<char, NS_MAXDNAME> target{};
    if (::ns_name_uncompress(ns_msg_base(message), ns_msg_end(message), data, target.data(),
                             target.size()) < 0) {
      return;
    }
    if (is_printer(target.data()) && printers.size() < kMostPrinters) printers[target.data()];
    return;
  }
  if (!is_printer(name) || printers.size() >= kMostPrinters) return;
  constexpr std::size_t port_at = 4, least = 7;
  if (ns_rr_type(record) == ns_t_srv && size >= least)
    printers[name].port = ns_get16(data + port_at);
  if (ns_rr_type(record) == ns_t_txt) {
    printers[name].texts = texts_of({reinterpret_cast<const char*>(data), size});
  }
}

}  // namespace

std::string mdns_question(const std::vector<std::string>& unfinished) {
  std::array<u_char, NS_PACKETSZ> bytes{};
  u_char* at = bytes.data() + NS_HFIXEDSZ;
  int questions = 0;
  const auto ask = [&](const char* name, ns_type type) {
    const auto left = static_cast<int>(bytes.data() + bytes.size() - at) - NS_QFIXEDSZ;
    const int size = left > 0 ? ::dn_comp(name, at, left, nullptr, nullptr) : -1;
    if (size < 0) return;
    ::ns_put16(type, at + size);
    ::ns_put16(ns_c_in, at + size + NS_INT16SZ);
    at += size + NS_QFIXEDSZ;
    ++questions;
  };
  ask(kService, ns_t_ptr);
  for (std::size_t i = 0; i < unfinished.size() && i < kMostAsked; ++i) {
    ask(unfinished[i].c_str(), ns_t_srv);
    ask(unfinished[i].c_str(), ns_t_txt);
  }
  constexpr std::size_t count_at = 4;
  ::ns_put16(static_cast<u_int>(questions), bytes.data() + count_at);
  return {reinterpret_cast<const char*>(bytes.data()), reinterpret_cast<const char*>(at)};
}

MdnsAnswer mdns_answer(const std::string& datagram, const std::string& host) {
  MdnsAnswer answer;
  ns_msg message;
  if (datagram.size() > NS_MAXMSG ||
      ::ns_initparse(reinterpret_cast<const u_char*>(datagram.data()),
                     static_cast<int>(datagram.size()), &message) < 0 ||
      ::ns_msg_getflag(message, ns_f_qr) == 0) {
    return answer;
  }
  std::map<std::string, Announced> printers;
  for (const ns_sect section : {ns_s_an, ns_s_ar}) {
    for (int i = 0; i < ns_msg_count(message, section); ++i) {
      ns_rr record;
      if (::ns_parserr(&message, section, i, &record) < 0) break;
      take(message, record, printers);
    }
  }
  for (const auto& [name, said] : printers) {
    if (said.port > 0) {
      answer.found.push_back(machine_of(name, said, host));
    } else {
      answer.unfinished.push_back(name);
    }
  }
  return answer;
}

}  // namespace slicecorr::farm::detail
