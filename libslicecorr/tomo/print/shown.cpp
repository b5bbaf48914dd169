// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The table of what was shown.
#include "slicecorr/tomo/shown.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include "slicecorr/error.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::tomo {

namespace {

enum Column : std::size_t { kFrame, kFrom, kTo, kExposed, kShare };
constexpr std::array<std::string_view, 5> kColumns{"job_frame", "from_deg", "to_deg", "exposed_s",
                                                   "blue_measured"};
/// A million turns, and more than ten years.
constexpr double kMostDeg = 3.6e8, kMostS = 1e9, kMostShare = 1e3;

}  // namespace

Shown read_shown(const std::string& path, int angles) {
  CsvReader table = CsvReader::of_file(path);
  CsvRow row;
  if (!table.next(row)) throw InputError(path, "", "is empty; expected a table of what was shown");
  std::array<std::size_t, kColumns.size()> at{};
  for (std::size_t c = 0; c < kColumns.size(); ++c) {
    while (at[c] < row.cells.size() && row.cells[at[c]] != kColumns[c]) ++at[c];
    if (at[c] == row.cells.size()) {
      throw InputError(path, table.place(),
                       fmt::format("has no column '{}'; expected a table of printbridge "
                                   "(frames.csv) or printer-sim, of a vial that turned",
                                   kColumns[c]));
    }
  }
  const std::size_t width = row.cells.size();
  Shown shown;
  while (table.next(row)) {
    if (row.cells.size() != width) {
      throw InputError(path, table.place(),
                       fmt::format("has {} cells; expected {}", row.cells.size(), width));
    }
    if (row.cells[at[kTo]].empty() || row.cells[at[kExposed]].empty()) {
      ++shown.without_end;
      continue;
    }
    const auto number = [&](Column c, double least, double most) {
      const auto value = number_in_text(row.cells[at[c]]);
      if (!value || !(*value >= least && *value <= most)) {
        throw InputError(path, table.place() + ", " + std::string(kColumns[c]),
                         fmt::format("is '{}'; expected a number from {:g} to {:g}",
                                     row.cells[at[c]], least, most));
      }
      return *value;
    };
    const double frame = number(kFrame, kBlackFrame, angles - 1);
    if (frame != std::floor(frame)) {
      throw InputError(path, table.place() + ", job_frame",
                       fmt::format("is {}; expected a whole number", row.cells[at[kFrame]]));
    }
    shown.showings.push_back({static_cast<int>(frame), number(kFrom, -kMostDeg, kMostDeg),
                              number(kTo, -kMostDeg, kMostDeg), number(kExposed, 0, kMostS),
                              number(kShare, 0, kMostShare)});
  }
  const auto lit = [](const Showing& s) { return s.exposed_s * s.share > 0; };
  if (std::none_of(shown.showings.begin(), shown.showings.end(), lit)) {
    throw InputError(path, "",
                     "has no light in it, as of a dry run; expected a row for each frame that was "
                     "shown, with its light");
  }
  return shown;
}

double Shown::light_s() const {
  double sum_s = 0;
  for (const Showing& s : showings) {
    if (s.frame != kBlackFrame) sum_s += s.exposed_s * s.share;
  }
  return sum_s;
}

}  // namespace slicecorr::tomo
