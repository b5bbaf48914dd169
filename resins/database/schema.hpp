// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a definition file may hold: one table for the checks, the documents and `validate
/// --schema`.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

enum class KeyType {
  text,
  texts,        ///< a list of texts
  number,       ///< from `low` (itself only when `low_counts`) to `high`
  whole,        ///< whole number from `low` to `high`
  choice,       ///< one of `choices`
  base,         ///< 10 or "e"
  pixel,        ///< a number or [x, y]
  calibration,  ///< [[level, mW/cm²], ...] or the name of a .csv file
  spread,       ///< [[sigma um, weight], ...] or the name of a picture
  mirror,       ///< true, false or one of `choices`
  truth,        ///< true or false
  file,         ///< name of a file beside this one
  notes,        ///< any keys: texts, numbers, dates, lists of texts
  parts,        ///< any keys: numbers from `low` to `high`
  anything,
};

/// One key, or with `key` "*" all keys of a table that names its own.
struct KeyRule {
  std::string_view table = "";  ///< empty: the root
  std::string_view key = "";
  KeyType type = KeyType::text;
  double low = 0, high = 0;
  bool low_counts = false;
  bool required = false;
  bool also_at_top = false;       ///< it may stand at the top of the file in place of in its table
  std::string_view choices = "";  ///< separated by |
  std::string_view what = "";     ///< for people
};

/// `kind`: "resin" or "printer".
std::span<const KeyRule> schema(std::string_view kind);

/// As `validate_definition`, of a text that is to stand at `path`. `kind`: empty, or what it must
/// be.
std::vector<Finding> validate_text(const std::string& text, const std::string& path,
                                   std::string_view kind = "");

/// Lower case letters, digits, '-', '.', '_', beginning with a letter or digit; at most 100.
bool is_stable_name(std::string_view name);

/// A definition has at most so many bytes: a file beyond is something else.
inline constexpr std::size_t kMostDefinitionBytes = 4U << 20;

}  // namespace slicecorr::resins
