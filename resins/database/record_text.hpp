// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Helpers that read the words of a record.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/units.hpp"
#include "support/toml/toml_plus_plus.hpp"

namespace slicecorr::resins {

/// The names that end in .csv of provenance.measurements, which is a text or a list.
std::vector<std::string> csv_names(const toml::node& measurements);

/// A provenance value as text.
std::string text_of_value(const toml::node& node);

}  // namespace slicecorr::resins
