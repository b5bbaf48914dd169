// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file routes.hpp
/// Every request that the server knows, and who may make it. openapi.json describes the same list; a
/// test compares them.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "slicecorr/farm/serve.hpp"

namespace slicecorr::farm::detail {

struct Route {
  const char* method;        ///< GET answers HEAD, too
  const char* path;          ///< "/api/v1/jobs/{id}/log": what is in braces stands for one segment
  std::optional<Role> role;  ///< none: everybody who reaches the server
};

std::span<const Route> routes();

/// The route of a request; null: there is none. `path` without its query.
const Route* route_of(const std::string& method, const std::string& path);

}  // namespace slicecorr::farm::detail
