// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What descriptions of resins and of printers are made of.
#pragma once

#include <map>
#include <string>

namespace slicecorr::resinctl {

/// "what  value", or nothing without a value.
std::string line(const char* what, const std::string& value);
/// Where each figure of a file comes from; empty where it does not say.
std::string provenance_text(const std::map<std::string, std::string>& provenance);

}  // namespace slicecorr::resinctl
