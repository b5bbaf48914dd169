// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Changes of single keys in a TOML text that leave everything else as it stands, comments and
/// order included.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::resins {

/// A TOML text that is edited key by key. Every change is checked: the text must then parse to the
/// old values with the new one among them, else `InputError` (a table written inline, say).
class TomlEdit {
 public:
  /// `source` names the text in messages. Throws `InputError` when it is not TOML.
  TomlEdit(std::string text, std::string source);

  /// Sets `key` of `table` (empty: the root) to `value`, which is written as TOML. A new key goes
  /// to the end of its table, in the root after `name`; a new table to the end of the text.
  void set(std::string_view table, std::string_view key, std::string_view value);
  /// Removes a key with its whole lines; comments stay. Nothing happens when it is not there.
  void remove(std::string_view table, std::string_view key);
  /// Puts `comment` (lines that begin with #) right above a key, in place of comment lines that
  /// stand there; empty: takes those away.
  void set_comment(std::string_view table, std::string_view key, std::string_view comment);
  bool has(std::string_view table, std::string_view key) const;
  const std::string& text() const { return text_; }

 private:
  std::string text_, source_;
};

/// A text in quotes, escaped.
std::string toml_text(std::string_view text);
/// A list of texts in quotes.
std::string toml_texts(const std::vector<std::string>& texts);
/// A number with up to `digits` significant digits, so that it reads as one with a fraction.
std::string toml_number(double value, int digits = 7);

}  // namespace slicecorr::resins
