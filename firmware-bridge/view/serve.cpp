// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bridge/serve.hpp"

#include <fmt/format.h>

#include <sstream>
#include <utility>

#include "slicecorr/bridge/view.hpp"
#include "slicecorr/error.hpp"
#include "support/chart/chart.hpp"
#include "support/http/answers.hpp"
#include "support/http/guard.hpp"
#include "support/http/guarded_server.hpp"
#include "support/page/html_page.hpp"
#include "view/page_text.hpp"

namespace slicecorr::bridge {
namespace {

http::ConnectionLimits limits() {
  http::ConnectionLimits limits;
  // The computer prints.
  limits.threads = 4;
  limits.most_slow = 12;
  limits.most_waiting = 64;
  return limits;
}

/// The page's own script and style only, and the style that all charts carry.
std::string live_policy() {
  return fmt::format(
      "default-src 'none'; script-src 'self'; style-src 'self'{}; style-src-attr 'unsafe-inline'; "
      "img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors "
      "'none'",
      http::style_hashes(chart::Picture("", "").svg()));
}

}  // namespace

struct PrintServer::Parts {
  Parts(StateFolder folder_given, ServeOptions given)
      : folder(std::move(folder_given)), options(std::move(given)), server(limits()) {}

  void answer(const httplib::Request& request, httplib::Response& response);
  void read(const httplib::Request& request, httplib::Response& response);
  PrintRecord record() const { return read_record(folder, PrintLock::held(folder)); }
  std::string status() {
    return kept_status.get([this] { return options.status(); });
  }

  StateFolder folder;
  ServeOptions options;
  http::GuardedServer server;
  http::GuardRules rules;
  const std::string policy = live_policy();
  // However many look: the print is asked five times a second, its files are read every 5 s.
  http::Kept kept_status{0.2}, kept_report{5}, kept_record{5};
  int port = 0;
};

void PrintServer::Parts::read(const httplib::Request& request, httplib::Response& response) {
  const std::string& path = request.path;
  const auto shell = [&](std::string text, const char* type) {
    http::send(response, 200, std::move(text), type);
    response.set_header("Content-Security-Policy", policy);
  };
  if (path == "/") return shell(std::string(detail::page_live_html), http::kHtmlType);
  if (path == "/live.js") {
    return shell(std::string(detail::page_live_js), "text/javascript; charset=utf-8");
  }
  if (path == "/live.css") {
    return shell(page::style({page::page_tiles_css, detail::page_print_css}),
                 "text/css; charset=utf-8");
  }
  if (path == "/healthz") return http::send(response, 200, "ok\n", http::kTextType);

  http::check_access(rules, request, http::Access::read);
  if (path == "/status.json") {
    return http::send(response, 200, status() + "\n", http::kJsonType);
  }
  if (path == "/metrics") {
    return http::send(response, 200, metrics_text(seen_in(status()), count_faults(folder)),
                      http::kMetricsType);
  }
  if (path == "/record") {
    const std::string html = kept_record.get([this] { return report_body(record()); });
    return http::send(response, 200, html, http::kHtmlType);
  }
  if (path == "/report") {
    const std::string html = kept_report.get([this] { return report_page(record()); });
    response.set_header("Content-Security-Policy", http::policy_for_styles(html));
    return http::send(response, 200, html, http::kHtmlType);
  }
  throw http::ApiError(404, "not_found", "there is nothing at this path");
}

void PrintServer::Parts::answer(const httplib::Request& request, httplib::Response& response) {
  try {
    http::check_headers(rules, request);
    if (request.method != "GET" && request.method != "HEAD") {
      response.set_header("Allow", "GET, HEAD");
      throw http::ApiError(405, "method", "expected GET or HEAD: nothing can be changed here");
    }
    http::body_bytes(request, 0);
    read(request, response);
  } catch (const http::ApiError& e) {
    http::send_error(response, e.status, e.code, e.what());
  } catch (const Error&) {
    http::send_error(response, 503, "record", "the print's record can't be read now");
  }
}

PrintServer::PrintServer(const StateFolder& folder, ServeOptions options)
    : parts_(std::make_unique<Parts>(folder, std::move(options))) {
  Parts& p = *parts_;
  p.rules.loopback = http::is_loopback(p.options.host);
  p.rules.token = p.options.token;
  std::istringstream names(p.options.host_names);
  for (std::string name; std::getline(names, name, ',');) {
    if (!name.empty()) p.rules.host_names.push_back(name);
  }
  if (!p.rules.loopback && p.rules.token.empty()) {
    throw InputError("beyond this machine reading needs a token: give --token-file");
  }
  p.port = p.server.bind(p.options.host, p.options.port);
  p.rules.port = p.port;
  p.server.set_payload_max_length(0);
  Parts* const parts = &p;
  using Handled = httplib::Server::HandlerResponse;
  p.server.set_pre_routing_handler(
      [parts](const httplib::Request& request, httplib::Response& response) {
        parts->answer(request, response);
        return Handled::Handled;
      });
  p.server.set_expect_100_continue_handler(
      [parts](const httplib::Request& request, httplib::Response& response) {
        parts->answer(request, response);
        return http::status_before_body(response);
      });
  p.server.set_post_routing_handler(
      [](const httplib::Request&, httplib::Response& response) { http::finish(response); });
}

PrintServer::~PrintServer() = default;
int PrintServer::port() const { return parts_->port; }
std::string PrintServer::address() const {
  return http::address_text(parts_->options.host, parts_->port);
}
void PrintServer::run() { parts_->server.listen_after_bind(); }
void PrintServer::stop() { parts_->server.stop_now(); }

}  // namespace slicecorr::bridge
