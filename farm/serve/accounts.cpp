// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/accounts.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/serve.hpp"
#include "slicecorr/farm/token.hpp"

namespace slicecorr::farm {

const char* name_of(Role role) {
  switch (role) {
    case Role::look:
      return "look";
    case Role::submit:
      return "submit";
    case Role::operate:
      return "operate";
  }
  return "";
}

std::vector<Account> read_accounts_file(const std::string& path) {
  std::ifstream in(path);
  struct stat s {};
  if (!in || ::stat(path.c_str(), &s) != 0 || !S_ISREG(s.st_mode)) {
    throw InputError(path, "", "can't be read; expected a file with accounts");
  }
  if ((s.st_mode & 077) != 0 || s.st_uid != ::geteuid()) {
    throw InputError(path, "", "may be read by others; expected a file of your own, mode 0600");
  }
  std::vector<Account> accounts;
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    std::istringstream words(line);
    std::string role, rest;
    Account a;
    if (!(words >> role) || role.starts_with('#')) continue;
    const auto wrong = [&](const std::string& what) {
      throw InputError(path, fmt::format("line {}", number), what);
    };
    if (!(words >> a.name >> a.token) || words >> rest) wrong("expected ROLE NAME TOKEN");
    if (role == "look") {
      a.role = Role::look;
    } else if (role == "submit") {
      a.role = Role::submit;
    } else if (role == "operate") {
      a.role = Role::operate;
    } else {
      wrong("expected the role look, submit or operate");
    }
    const auto plain = [](char c) { return c > 0x20 && c < 0x7F; };
    if (a.name.size() > 100 || !std::all_of(a.name.begin(), a.name.end(), plain)) {
      wrong("expected a name of at most 100 letters, digits and marks");
    }
    if (a.token.size() < 32 || a.token.size() > 512 ||
        !std::all_of(a.token.begin(), a.token.end(), plain)) {
      wrong("expected a token of 32 to 512 letters, digits and marks");
    }
    for (const Account& other : accounts) {
      if (other.token == a.token) wrong("has the token of " + other.name);
      if (other.name == a.name) wrong("names " + a.name + " again");
    }
    accounts.push_back(std::move(a));
  }
  if (accounts.empty()) throw InputError(path, "", "holds no account; expected ROLE NAME TOKEN");
  http::keep_out_of_cores();
  return accounts;
}

namespace detail {

namespace {
constexpr auto kTicketLife = std::chrono::seconds(60);
constexpr std::size_t kMostTickets = 1000;
}  // namespace

Asker Accounts::asker(const httplib::Request& request, Role role, bool changes) const {
  // All are compared, so that the time tells nothing.
  const Account* found = nullptr;
  for (const Account& a : accounts_) {
    if (http::has_bearer(request, a.token)) found = &a;
  }
  // Who shows a token means to be somebody: one that is wrong is said, also where anybody may look.
  // What a proxy asks for itself (Basic) is none of the farm's.
  const bool wrong = !found && !accounts_.empty() &&
                     request.get_header_value("Authorization").starts_with("Bearer ");
  if (wrong) throw http::ApiError(401, "token", "this token is none of this farm's");
  if (!found && loopback_ && !changes) return {};
  if (!found && accounts_.empty()) {
    throw http::ApiError(403, "read_only",
                         "this server changes nothing (no --token-file, no --accounts)");
  }
  if (!found) {
    throw http::ApiError(401, "token", "expected the header 'Authorization: Bearer TOKEN'");
  }
  if (found->role < role) {
    throw http::ApiError(403, "role",
                         fmt::format("this account may {}, and this needs one that may {}",
                                     name_of(found->role), name_of(role)));
  }
  return {found->name, found->role};
}

std::string Tickets::give(const std::string& path) {
  const Route* route = route_of("GET", path);
  const std::string known = route ? route->path : "";
  if (known != "/report" && known != "/api/v1/jobs/{id}/files/{ending}" &&
      known != "/api/v1/studies/{study}/files/{name}" &&
      known != "/api/v1/jobs/{id}/scans/{number}/{what}" && known != "/api/v1/drift.html") {
    throw http::ApiError(400, "path", "expected the path of the report or of a file");
  }
  const auto now = std::chrono::steady_clock::now();
  const std::scoped_lock lock(mutex_);
  std::erase_if(tickets_, [&](const auto& t) { return t.second.until < now; });
  if (tickets_.size() >= kMostTickets) throw http::ApiError(503, "busy", "too many tickets");
  const std::string ticket = random_token();
  tickets_[ticket] = {path, now + kTicketLife};
  return path + "?ticket=" + ticket;
}

bool Tickets::valid(const std::string& ticket, const std::string& path) {
  const std::scoped_lock lock(mutex_);
  const auto found = tickets_.find(ticket);
  return found != tickets_.end() && found->second.path == path &&
         found->second.until >= std::chrono::steady_clock::now();
}

}  // namespace detail

}  // namespace slicecorr::farm
