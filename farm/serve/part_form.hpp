// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file part_form.hpp
/// A form with a part of a file, as slicers send it to boards.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace slicecorr::farm::detail {

struct PartForm {
  std::map<std::string, std::string> fields;   ///< but for the file, at most 200 bytes each
  std::string file_name, bytes;                ///< of the field File
  std::string text(const char* key) const;     ///< empty: it is not there
  std::int64_t number(const char* key) const;  ///< at least 0; -1: none
};

/// Reads multipart/form-data; nothing where it is none, or has more than sixteen fields.
std::optional<PartForm> read_part_form(const std::string& content_type, const std::string& body);

}  // namespace slicecorr::farm::detail
