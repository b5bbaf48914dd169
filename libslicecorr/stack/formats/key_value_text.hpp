// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Texts of lines "key = value" that are read, and changed in place.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace slicecorr::detail {

/// A number at the beginning of a text that a unit may follow: "8000", "4e3 ms )", "21.16px/mm".
struct LeadingNumber {
  double value = 0;
  std::size_t length = 0;  ///< of the number's text
};
/// Nothing where the text begins with none, and where what follows could be a part of it: "8_000",
/// "8,000", "8 000", "0x1F40", "8e". Whoever changes such a number must not leave half of it.
std::optional<LeadingNumber> leading_number(std::string_view text);

/// "key = value" or ";key:value" lines: what is before and after `separator`, trimmed.
class KeyValueText {
 public:
  KeyValueText(std::string text, char separator, std::string file, std::string entry,
               std::string prefix = "");
  std::optional<std::string> find(std::string_view key) const;
  /// Throws `InputError` when the value is there and no number from `least` to `most`.
  std::optional<double> number(std::string_view key, double least, double most) const;
  /// As above; throws also when it is missing.
  double need_number(std::string_view key, double least, double most) const;
  /// Replaces the value in its line, leaving the rest of the text as it is; adds a line at the end
  /// when the key is not there.
  void set(std::string_view key, const std::string& value);
  const std::string& text() const { return text_; }

 private:
  struct TextRange {
    std::size_t begin = 0, end = 0;  ///< of the value
  };
  std::optional<TextRange> place(std::string_view key) const;
  std::string text_, file_, entry_, prefix_;
  char separator_;
};

/// As short as it can be and still read back as the same number.
std::string number_text(double value);

}  // namespace slicecorr::detail
