// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a fault left of lamps and stage, in latch.json, status.json and the journal.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>

#include "slicecorr/bridge/control.hpp"

namespace slicecorr::bridge {

nlohmann::ordered_json left_json(const Left& left);
/// Nothing where the JSON is not what `left_json` writes.
std::optional<Left> left_in(const nlohmann::ordered_json& json);

}  // namespace slicecorr::bridge
