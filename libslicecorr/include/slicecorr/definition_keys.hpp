// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file definition_keys.hpp
/// What a printer or resin file may hold: one table for those who read it, for its checks and for its
/// documents; and the words of a file that are not in it. Pure and thread-safe.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr {

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

/// All keys of a kind of file, "resin" or "printer", in the order in which documents list them.
std::span<const KeyRule> definition_keys(std::string_view kind);
/// The rule of a key of a table; nothing where there is none.
const KeyRule* key_rule(std::string_view kind, std::string_view table, std::string_view key);
/// "cure.model"; the key alone at the root.
std::string full_key(std::string_view table, std::string_view key);

/// A word of a file that no program reads.
struct UnknownKey {
  int line = 0;
  std::string key;      ///< with its table before it
  std::string message;  ///< "unknown key; did you mean 'm'?"; "stands outside of its table; ..."
};
/// All of a file's text; none where it is no TOML, which its reader says.
std::vector<UnknownKey> unknown_keys(std::string_view text, std::string_view kind);

/// What of a definition's file counts for nothing. Definitions that differ in it alone are the same.
struct UnreadWords {
  std::vector<std::string> sentences;  ///< "FILE:LINE: KEY: MESSAGE, and counts for nothing"
  bool operator==(const UnreadWords&) const { return true; }
};
/// `unknown_keys` of the text that stands at `source`: the first ten, and how many more there are.
UnreadWords unread_words(std::string_view text, const std::string& source, std::string_view kind);

}  // namespace slicecorr
