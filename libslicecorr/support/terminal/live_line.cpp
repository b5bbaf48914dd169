// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/terminal/live_line.hpp"

#include "support/text/display_text.hpp"

namespace slicecorr::cli {

namespace {

const char* sequence(Ink ink) {
  switch (ink) {
    case Ink::dim:
      return "\033[2m";
    case Ink::bold:
      return "\033[1m";
    case Ink::good:
      return "\033[32m";
    case Ink::bad:
      return "\033[31m";
    case Ink::busy:
      return "\033[36m";
    case Ink::plain:
      break;
  }
  return "";
}

}  // namespace

Line& Line::put(const std::string& text, Ink ink) {
  const std::string shown = text::clipped(text, left_);
  left_ -= text::columns_of(shown);
  const bool ink_seen = colour_ && ink != Ink::plain && !shown.empty();
  text_ += ink_seen ? sequence(ink) + shown + "\033[0m" : shown;
  return *this;
}

Line& Line::to_the_right(const std::string& text, Ink ink) {
  const int room = left_ - text::columns_of(text);
  return room > 0 ? put(std::string(static_cast<std::size_t>(room), ' ')).put(text, ink) : *this;
}

void put_bar(Line& line, double fraction, int columns, Ink ink) {
  std::string bar = text::bar(fraction, columns);
  const std::size_t end = bar.find_last_not_of(' ') + 1;
  std::string track;
  for (std::size_t i = end; i < bar.size(); ++i) track += "░";
  bar.resize(end);
  line.put(bar, ink).put(track, Ink::dim);
}

}  // namespace slicecorr::cli
