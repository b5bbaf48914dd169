// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file display_text.hpp
/// Figures and names as people read them, on terminals and pages.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace slicecorr::text {

/// "7.3 s", "4 min 05 s", "3 h 10 min", "2 d 04 h"; "-" below 0 and for what is no number.
std::string duration(double seconds);
/// "512 B", "1.4 MB", "31.0 GB"; powers of ten.
std::string bytes(double n);
/// Two sizes that are compared, with as many digits as it takes to tell them apart: "3.1 MB" and
/// "2.0 GB", "3.14 MB" and "3.15 MB".
std::pair<std::string, std::string> bytes_apart(double a, double b);
/// "12,345".
std::string count(std::int64_t n);
/// Three digits that count, and never an exponent: "0.0123", "12.3", "4,321"; "-" for what is no
/// number.
std::string figure(double value);

/// Names and messages come from files and users: what could move a terminal's cursor, turn the
/// direction of writing or is no UTF-8 becomes "?" , line ends become spaces.
std::string printable(std::string_view text);
/// The same of a text of several lines, whose line ends and tabs stay.
std::string readable(std::string_view text);
/// Columns that a printable text takes on a terminal.
int columns_of(std::string_view text);
/// At most `columns` wide, cut with "…".
std::string clipped(std::string_view text, int columns);
/// Exactly `columns` wide.
std::string padded(std::string_view text, int columns, bool right = false);

/// A bar of `columns`, filled to `fraction` in eighths of a column.
std::string bar(double fraction, int columns);

/// Columns as wide as their widest cell; numbers to the right where the heading begins with '>'.
/// Lines are cut at `most_columns` where that is above 0.
std::string table(const std::vector<std::string>& headings,
                  const std::vector<std::vector<std::string>>& rows, int most_columns);

}  // namespace slicecorr::text
