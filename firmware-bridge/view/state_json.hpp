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

namespace slicecorr::bridge::detail {

using Json = nlohmann::ordered_json;

std::optional<double> number_in(const Json& json, const char* key);
double number_in(const Json& json, const char* key, double otherwise);
/// The whole number at `key`, cut to what an int holds; `otherwise` where there is none.
int whole_in(const Json& json, const char* key, int otherwise);
bool flag_in(const Json& json, const char* key);
std::string text_in(const Json& json, const char* key);

PrintFacts facts_in(const Json& json);
PrintState state_in(const Json& json);
PrintAround around_in(const Json& json);

/// The JSON as text; bytes that are no UTF-8 are replaced.
std::string dumped(const Json& json, int indent = -1);

}  // namespace slicecorr::bridge::detail
