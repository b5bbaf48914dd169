// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Even light (even_light.hpp) in our block.
#pragma once

#include <nlohmann/json.hpp>

#include "slicecorr/process.hpp"
#include "support/json/json_node.hpp"

namespace slicecorr::detail {

nlohmann::ordered_json even_light_json(const EvenLight& light);
/// Every value is checked; throws `InputError` naming the key.
EvenLight read_even_light(const JsonNode<nlohmann::json>& node);

}  // namespace slicecorr::detail
