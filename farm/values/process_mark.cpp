// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "values/process_mark.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <climits>
#include <cstdlib>
#include <fstream>

namespace slicecorr::farm::detail {

ProcessMark mark_of(long pid) {
  ProcessMark mark;
  mark.pid = pid;
  char space[PATH_MAX];
  const ssize_t n = ::readlink("/proc/self/ns/pid", space, sizeof space);
  if (n > 0) mark.space.assign(space, static_cast<std::size_t>(n));
  std::ifstream file(fmt::format("/proc/{}/stat", pid));
  std::string line;
  if (!std::getline(file, line)) return mark;
  // The name, in parentheses, may hold anything; the start is the 20th field after it, and
  // `close` + 1 is the space before the first.
  const std::size_t close = line.rfind(')');
  if (close == line.npos || close + 2 >= line.size() || line[close + 2] == 'Z') return mark;
  std::size_t at = close + 1;
  for (int field = 1; field < 20 && at != line.npos; ++field) at = line.find(' ', at + 1);
  if (at != line.npos) mark.start = std::atoll(line.c_str() + at);
  return mark;
}

}  // namespace slicecorr::farm::detail
