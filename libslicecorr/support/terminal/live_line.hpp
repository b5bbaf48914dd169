// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Lines of a view on a terminal.
#pragma once

#include <string>

namespace slicecorr::cli {

enum class Ink { plain, dim, bold, good, bad, busy };

/// A line of pieces with their colours, never wider than the frame.
class Line {
 public:
  Line(int columns, bool colour) : left_(columns), colour_(colour) {}
  Line& put(const std::string& text, Ink ink = Ink::plain);
  /// The rest of the line up to a text at its end.
  Line& to_the_right(const std::string& text, Ink ink);
  int left() const { return left_; }
  const std::string& text() const { return text_; }

 private:
  int left_;
  bool colour_;
  std::string text_;
};

/// A bar on its track.
void put_bar(Line& line, double fraction, int columns, Ink ink);

}  // namespace slicecorr::cli
