// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/routes.hpp"

#include <algorithm>
#include <string_view>
#include <vector>

#include "serve/api.hpp"

namespace slicecorr::farm::detail {

namespace {

constexpr Route kRoutes[] = {
    // The pages, which hold nothing of the farm.
    {"GET", "/", {}},
    {"GET", "/print", {}},
    {"GET", "/materials", {}},
    {"GET", "/machines", {}},
    {"GET", "/pages/{file}", {}},
    {"GET", "/healthz", {}},
    {"GET", "/api/v1/openapi.json", {}},
    // The farm.
    {"GET", "/report", Role::look},
    {"GET", "/metrics", Role::look},
    {"GET", "/api/v1/me", Role::look},
    {"POST", "/api/v1/tickets", Role::look},
    {"GET", "/api/v1/overview", Role::look},
    {"GET", "/api/v1/jobs", Role::look},
    {"POST", "/api/v1/jobs", Role::submit},
    {"GET", "/api/v1/jobs/{id}", Role::look},
    {"GET", "/api/v1/jobs/{id}/log", Role::look},
    {"GET", "/api/v1/jobs/{id}/files/{ending}", Role::look},
    {"POST", "/api/v1/jobs/{id}/cancel", Role::submit},
    {"POST", "/api/v1/jobs/{id}/retry", Role::submit},
    {"POST", "/api/v1/jobs/{id}/priority", Role::operate},
    {"POST", "/api/v1/jobs/{id}/print", Role::operate},
    {"GET", "/api/v1/jobs/{id}/scans", Role::look},
    {"POST", "/api/v1/jobs/{id}/scans", Role::submit},
    {"GET", "/api/v1/jobs/{id}/scans/{number}/{what}", Role::look},
    {"POST", "/api/v1/jobs/{id}/scans/{number}/remove", Role::submit},
    {"POST", "/api/v1/jobs/{id}/next", Role::submit},
    {"GET", "/api/v1/drift", Role::look},
    {"GET", "/api/v1/drift.svg", Role::look},
    {"GET", "/api/v1/drift.html", Role::look},
    {"GET", "/api/v1/events", Role::look},
    {"GET", "/api/v1/report", Role::look},
    {"GET", "/api/v1/timeline.svg", Role::look},
    {"POST", "/api/v1/pause", Role::operate},
    {"POST", "/api/v1/resume", Role::operate},
    // Before a print.
    {"PUT", "/api/v1/parts/{name}", Role::submit},
    {"POST", "/api/v1/studies", Role::submit},
    {"GET", "/api/v1/studies/{study}", Role::look},
    {"GET", "/api/v1/studies/{study}/files/{name}", Role::look},
    {"GET", "/api/v1/studies/{study}/layers/{layer}", Role::look},
    {"POST", "/api/v1/studies/{study}/cancel", Role::submit},
    // Resins, printers and machines.
    {"GET", "/api/v1/resins", Role::look},
    {"POST", "/api/v1/resins", Role::operate},
    {"GET", "/api/v1/resins/{name}/curve.svg", Role::look},
    {"GET", "/api/v1/printers", Role::look},
    {"POST", "/api/v1/printers", Role::operate},
    {"GET", "/api/v1/bridges", Role::look},
    {"GET", "/api/v1/machines", Role::look},
    {"GET", "/api/v1/machines/{name}/picture.png", Role::look},
    {"POST", "/api/v1/machines/{name}/{act}", Role::operate},
};

}  // namespace

std::span<const Route> routes() { return kRoutes; }

const Route* route_of(const std::string& method, const std::string& path) {
  const std::string_view asked = method == "HEAD" ? std::string_view("GET") : method;
  const std::vector<std::string> have = segments_of(path);
  for (const Route& route : kRoutes) {
    if (asked != route.method) continue;
    const std::vector<std::string> want = segments_of(route.path);
    const auto fits = [](const std::string& w, const std::string& h) {
      return w == h || (w.starts_with('{') && !h.empty());
    };
    if (std::equal(want.begin(), want.end(), have.begin(), have.end(), fits)) return &route;
  }
  return nullptr;
}

}  // namespace slicecorr::farm::detail
