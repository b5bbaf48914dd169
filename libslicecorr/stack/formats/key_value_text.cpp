// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/key_value_text.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/container/container.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {

std::optional<LeadingNumber> leading_number(std::string_view text) {
  LeadingNumber number;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number.value);
  if (error != std::errc() || !std::isfinite(number.value)) return std::nullopt;
  number.length = static_cast<std::size_t>(end - text.data());
  const std::string_view rest = text.substr(number.length);
  // A unit, as far as the next blank or bracket; none begins with the letters of exponents and
  // other bases.
  const std::string_view unit = rest.substr(0, rest.find_first_of(" \t\r\n);"));
  constexpr std::string_view begins_no_unit = "eExXpP", other_than_units = "0123456789_.,'+-";
  if (!unit.empty() && begins_no_unit.find(unit.front()) != unit.npos && unit != "px" &&
      !unit.starts_with("px/")) {
    return std::nullopt;
  }
  if (unit.find_first_of(other_than_units) != unit.npos) return std::nullopt;
  // Digits after a blank are thousands that are set apart.
  const std::size_t next = rest.find_first_not_of(" \t", unit.size());
  if (unit.empty() && next != rest.npos && is_digit(rest[next])) return std::nullopt;
  return number;
}

KeyValueText::KeyValueText(std::string text, char separator, std::string file, std::string entry,
                           std::string prefix)
    : text_(std::move(text)),
      file_(std::move(file)),
      entry_(std::move(entry)),
      prefix_(std::move(prefix)),
      separator_(separator) {}

std::optional<KeyValueText::TextRange> KeyValueText::place(std::string_view key) const {
  const std::string_view all = text_;
  for (std::size_t start = 0; start < all.size();) {
    const std::size_t end = std::min(all.find('\n', start), all.size());
    std::string_view line = all.substr(start, end - start);
    std::string_view rest = trimmed(line);
    if (rest.starts_with(prefix_)) {
      rest.remove_prefix(prefix_.size());
      const std::size_t at = rest.find(separator_);
      if (at != rest.npos && trimmed(rest.substr(0, at)) == key) {
        const std::string_view value = trimmed(rest.substr(at + 1));
        const std::size_t begin = value.empty()
                                      ? static_cast<std::size_t>(rest.data() + at + 1 - all.data())
                                      : static_cast<std::size_t>(value.data() - all.data());
        return TextRange{begin, begin + value.size()};
      }
    }
    start = end + 1;
  }
  return std::nullopt;
}

std::optional<std::string> KeyValueText::find(std::string_view key) const {
  const auto at = place(key);
  if (!at) return std::nullopt;
  return text_.substr(at->begin, at->end - at->begin);
}

std::optional<double> KeyValueText::number(std::string_view key, double least, double most) const {
  const auto value = find(key);
  if (!value) return std::nullopt;
  double number = NAN;
  const auto [end, error] = std::from_chars(value->data(), value->data() + value->size(), number);
  if (error != std::errc() || end != value->data() + value->size() ||
      !(number >= least && number <= most)) {
    throw InputError(file_, entry_,
                     std::string(key) + " is " + shown_name(*value) + ", expected a number from " +
                         number_text(least) + " to " + number_text(most));
  }
  return number;
}

double KeyValueText::need_number(std::string_view key, double least, double most) const {
  const auto value = number(key, least, most);
  if (!value) throw InputError(file_, entry_, std::string(key) + " is missing");
  return *value;
}

void KeyValueText::set(std::string_view key, const std::string& value) {
  if (const auto at = place(key)) {
    text_.replace(at->begin, at->end - at->begin, value);
    return;
  }
  if (!text_.empty() && text_.back() != '\n') text_ += '\n';
  text_ += prefix_ + std::string(key);
  text_ += separator_ == '=' ? " = " : std::string(1, separator_);
  text_ += value + "\n";
}

std::string number_text(double value) {
  char text[40];
  const auto [end, error] = std::to_chars(text, text + sizeof text, value);
  (void)error;  // there is room for every number
  // Some readers take no exponent.
  std::string shortest(text, end);
  if (shortest.find('e') == std::string::npos) return shortest;
  const auto [fixed_end, fixed_error] =
      std::to_chars(text, text + sizeof text, value, std::chars_format::fixed);
  return fixed_error == std::errc() ? std::string(text, fixed_end) : shortest;
}

}  // namespace slicecorr::detail
