// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// JSON of the print's state, both ways. Reading forgives: what is missing or of another type is as
/// if it was not said.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "slicecorr/bridge/print_state.hpp"
#include "support/json/members.hpp"

namespace slicecorr::bridge::detail {

using Json = nlohmann::ordered_json;

using slicecorr::detail::flag_in;
using slicecorr::detail::number_in;
using slicecorr::detail::text_in;
using slicecorr::detail::whole_in;

PrintFacts facts_in(const Json& json);
PrintState state_in(const Json& json);
PrintAround around_in(const Json& json);

/// The JSON as text; bytes that are no UTF-8 are replaced.
std::string dumped(const Json& json, int indent = -1);

}  // namespace slicecorr::bridge::detail
