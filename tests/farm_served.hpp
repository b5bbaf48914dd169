// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_served.hpp
/// A farm's server in the test's own process.
#pragma once

#include <httplib.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "farm_filled.hpp"
#include "slicecorr/farm/serve.hpp"

namespace slicecorr::farm::test {

inline const std::string kToken(64, 'k');

/// A server in this process, on a port of its own.
class Served {
 public:
  explicit Served(Farm& farm, ServeOptions options = {}) {
    options.clock = &farm.clock;
    server_ = std::make_unique<FarmServer>(farm.folder, std::move(options));
    thread_ = std::thread([this] { server_->run(); });
    port = server_->port();
  }
  ~Served() {
    server_->stop();
    thread_.join();
  }
  httplib::Client client() const {
    httplib::Client c("127.0.0.1", port);
    c.set_read_timeout(60);
    return c;
  }
  httplib::Client authorised() const {
    httplib::Client c = client();
    c.set_default_headers({{"Authorization", "Bearer " + kToken}});
    return c;
  }
  int port = 0;

 private:
  std::unique_ptr<FarmServer> server_;
  std::thread thread_;
};

inline ServeOptions with_token() {
  ServeOptions options;
  options.token = kToken;
  return options;
}

inline nlohmann::json body_of(const httplib::Result& result) {
  return result ? nlohmann::json::parse(result->body, nullptr, false) : nlohmann::json();
}

inline int status_of(const httplib::Result& result) { return result ? result->status : -1; }

}  // namespace slicecorr::farm::test
