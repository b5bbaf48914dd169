// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What jobs and stacks say of a vial that is not round, or in which rods stand.
#pragma once

#include "slicecorr/process.hpp"
#include "support/json/json_node.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {

/// Fills the vial from these keys, and its radii. Throws `InputError` naming the key.
void read_shape(const JsonNode<nlohmann::json>& node, Vial& vial);

/// The keys; none of a round vial without rods.
nlohmann::ordered_json shape_json(const Vial& vial);

}  // namespace slicecorr::detail
