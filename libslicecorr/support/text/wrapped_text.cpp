// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/text/wrapped_text.hpp"

#include <algorithm>

namespace slicecorr {
namespace {

/// Characters, not bytes.
std::size_t characters(std::string_view text) {
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
  }));
}

/// How deep what goes on stands: at least 20 characters are left beside it.
std::size_t depth(std::string_view line, std::size_t width) {
  const std::size_t first = std::min(line.find_first_not_of(' '), line.size());
  const std::size_t gap = line.find("  ", first);
  const std::size_t after = gap == line.npos ? line.npos : line.find_first_not_of(' ', gap);
  return after != line.npos && after + 20 <= width ? after : first;
}

/// The last space behind `from` with at most `room` characters before it, else the first one.
std::size_t cut_of(std::string_view line, std::size_t from, std::size_t room) {
  std::size_t cut = line.npos;
  for (std::size_t at = line.find(' ', from); at != line.npos; at = line.find(' ', at + 1)) {
    const bool fits = characters(line.substr(0, at)) <= room;
    if (fits || cut == line.npos) cut = at;
    if (!fits) break;
  }
  return cut;
}

void wrap(std::string_view line, std::size_t width, std::string& out) {
  const std::size_t deep = depth(line, width);
  std::size_t from = deep, room = width;
  while (characters(line) > room) {
    const std::size_t cut = cut_of(line, from, room);
    if (cut == line.npos) break;
    out.append(line.substr(0, cut)).append("\n").append(deep, ' ');
    line.remove_prefix(std::min(line.find_first_not_of(' ', cut), line.size()));
    from = 0;
    room = width - std::min(deep, width - 20);
  }
  out.append(line);
}

}  // namespace

std::string wrapped_text(std::string_view text, std::size_t width) {
  std::string out;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    if (width >= 40) {
      wrap(text.substr(0, end), width, out);
    } else {
      out.append(text.substr(0, end));
    }
    if (end < text.size()) out += '\n';
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return out;
}

}  // namespace slicecorr
