// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file definition_json.hpp
/// Printers and resins as JSON, as stacks and jobs record them.
#pragma once

#include <nlohmann/json.hpp>

#include "slicecorr/orientation.hpp"
#include "slicecorr/process.hpp"
#include "support/json/json_node.hpp"

namespace slicecorr::detail {

nlohmann::ordered_json orientation_json(const Orientation& orientation);
Orientation read_orientation(const JsonNode<nlohmann::json>& node);

/// Of a flat-field only what it is: its picture is a file of its own.
nlohmann::ordered_json printer_json(const Printer& printer);
nlohmann::ordered_json resin_json(const Resin& resin);

/// Every value is checked; throws `InputError` naming the key. A flat-field comes without its
/// picture.
Printer read_printer(const JsonNode<nlohmann::json>& node);
Resin read_resin(const JsonNode<nlohmann::json>& node);
Shrinkage read_shrinkage(const JsonNode<nlohmann::json>& node);

}  // namespace slicecorr::detail
