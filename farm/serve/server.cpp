// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <sstream>

#include "serve/api.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/serve.hpp"
#include "support/http/guarded_server.hpp"

namespace slicecorr::farm {

namespace {

http::GuardRules rules_of(const ServeOptions& o) {
  http::GuardRules rules;
  rules.loopback = http::is_loopback(o.host);
  rules.token = o.token;
  std::istringstream names(o.host_names);
  for (std::string name; std::getline(names, name, ',');) {
    if (!name.empty()) rules.host_names.push_back(name);
  }
  return rules;
}

http::ConnectionLimits limits_of(const ServeOptions& o) {
  return {o.threads,   o.most_slow, o.most_waiting, o.header_bytes,
          o.request_s, o.stall_s,   o.least_bytes_s};
}

}  // namespace

struct FarmServer::Parts {
  Parts(const FarmFolder& folder_given, ServeOptions given)
      : options(std::move(given)), folder(folder_given), server(limits_of(options)) {}
  ServeOptions options;
  FarmFolder folder;
  http::GuardedServer server;
  std::unique_ptr<detail::Api> api;
  int port = 0;
};

FarmServer::FarmServer(const FarmFolder& folder, ServeOptions options)
    : parts_(std::make_unique<Parts>(folder, std::move(options))) {
  Parts& p = *parts_;
  http::GuardRules rules = rules_of(p.options);
  if (!rules.loopback && p.options.token.empty() && p.options.accounts.empty()) {
    throw InputError(
        "beyond this machine even reading needs a token: give --token-file or --accounts");
  }
  // A farm that nobody has submitted to yet gets its record, so that the first part may come from here.
  static_cast<void>(Queue(folder.database(), *p.options.clock));
  auto& server = p.server;
  server.set_payload_max_length(
      static_cast<std::size_t>(std::max(p.options.most_upload_bytes, p.options.most_body_bytes)));
  p.port = server.bind(p.options.host, p.options.port);
  rules.port = p.port;
  p.api = std::make_unique<detail::Api>(folder, p.options, rules, server.stopping_flag());
  detail::Api* api = p.api.get();
  using Handled = httplib::Server::HandlerResponse;
  server.set_pre_routing_handler(
      [api](const httplib::Request& request, httplib::Response& response) {
        return api->before_body(request, response) ? Handled::Handled : Handled::Unhandled;
      });
  // Refused before the body is sent, where the client waits for leave to send it.
  server.set_expect_100_continue_handler(
      [api](const httplib::Request& request, httplib::Response& response) {
        return api->before_body(request, response) ? http::status_before_body(response) : 100;
      });
  const auto change = [api](const httplib::Request& request, httplib::Response& response,
                            const httplib::ContentReader& body) {
    api->change(request, response, body);
  };
  server.Post(".*", change);
  server.Put(".*", change);
  server.set_post_routing_handler(
      [](const httplib::Request&, httplib::Response& response) { http::finish(response); });
}

FarmServer::~FarmServer() = default;

int FarmServer::port() const { return parts_->port; }

std::string FarmServer::address() const {
  return http::address_text(parts_->options.host, parts_->port);
}

void FarmServer::run() { parts_->server.listen_after_bind(); }
void FarmServer::stop() { parts_->server.stop_now(); }

}  // namespace slicecorr::farm
