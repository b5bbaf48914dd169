// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file accounts.hpp
/// Who asks, and what they may.
#pragma once

#include <httplib.h>

#include <chrono>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "serve/routes.hpp"
#include "support/http/guard.hpp"

namespace slicecorr::farm::detail {

/// Who makes a request.
struct Asker {
  std::string name;  ///< empty: nobody in particular
  Role role = Role::look;
};

/// The accounts of a server. Thread-safe.
class Accounts {
 public:
  /// `loopback`: whoever reaches the server may look.
  Accounts(std::vector<Account> accounts, bool loopback)
      : accounts_(std::move(accounts)), loopback_(loopback) {}
  /// Who asks; throws `ApiError` where they may not do what needs `role`. `changes`: the request is
  /// no mere reading.
  Asker asker(const httplib::Request& request, Role role, bool changes) const;

 private:
  std::vector<Account> accounts_;
  bool loopback_;
};

/// Leave to read one path for a short while, for links: a browser sends no token when it follows one.
/// Thread-safe.
class Tickets {
 public:
  /// "PATH?ticket=...". Throws `ApiError` for paths that no link leads to.
  std::string give(const std::string& path);
  bool valid(const std::string& ticket, const std::string& path);

 private:
  struct Ticket {
    std::string path;
    std::chrono::steady_clock::time_point until;
  };
  std::mutex mutex_;
  std::map<std::string, Ticket> tickets_;
};

}  // namespace slicecorr::farm::detail
