// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/coarser_section.hpp"

#include <algorithm>

namespace slicecorr::detail {

FlowSection coarser(const FlowSection& fine, int factor) {
  FlowSection s;
  s.width = (fine.width + factor - 1) / factor;
  s.height = (fine.height + factor - 1) / factor;
  s.pitch_x_um = fine.pitch_x_um * factor;
  s.pitch_y_um = fine.pitch_y_um * factor;
  s.cells.assign(s.size(), FlowCell::bath);
  s.coverage.assign(s.size(), 0);
  if (!fine.voids.empty()) s.voids.assign(s.size(), 0);
  std::vector<int> blind(s.size(), 0);
  for (int y = 0; y < fine.height; ++y) {
    for (int x = 0; x < fine.width; ++x) {
      const std::size_t from = fine.index(x, y), to = s.index(x / factor, y / factor);
      const bool whole = fine.coverage.empty() || fine.cells[from] == FlowCell::blind;
      s.coverage[to] += !whole                               ? fine.coverage[from]
                        : fine.cells[from] == FlowCell::bath ? 0.0F
                                                             : 1.0F;
      if (fine.cells[from] != FlowCell::blind) continue;
      ++blind[to];
      if (!fine.voids.empty()) s.voids[to] = fine.voids[from];
    }
  }
  const float all = static_cast<float>(factor) * static_cast<float>(factor);
  for (std::size_t k = 0; k < s.size(); ++k) {
    s.coverage[k] = std::min(1.0F, s.coverage[k] / all);
    if (s.coverage[k] < 0.5F) continue;
    const bool mostly_blind = 2 * static_cast<float>(blind[k]) > s.coverage[k] * all;
    s.cells[k] = mostly_blind ? FlowCell::blind : FlowCell::part;
  }
  return s;
}

std::vector<double> sums_on_coarser(const FlowSection& fine, const FlowSection& coarse, int factor,
                                    const std::vector<double>& values) {
  if (values.empty()) return {};
  std::vector<double> sums(coarse.size(), 0.0);
  for (int y = 0; y < fine.height; ++y) {
    for (int x = 0; x < fine.width; ++x) {
      const std::size_t from = fine.index(x, y);
      if (fine.cells[from] != FlowCell::part) continue;
      sums[coarse.index(x / factor, y / factor)] += values[from];
    }
  }
  return sums;
}

std::vector<double> on_finer(const FlowSection& fine, const FlowSection& coarse,
                             const std::vector<double>& values) {
  struct Between {
    int first, second;
    double share;
  };
  const auto between = [](int at, int cells) {
    const double place = std::clamp(0.5 * at - 0.25, 0.0, cells - 1.0);
    const int first = std::min(static_cast<int>(place), std::max(0, cells - 2));
    return Between{first, std::min(first + 1, cells - 1), place - first};
  };
  std::vector<double> result(fine.size());
  for (int y = 0; y < fine.height; ++y) {
    const Between down = between(y, coarse.height);
    for (int x = 0; x < fine.width; ++x) {
      const Between across = between(x, coarse.width);
      const auto along = [&](int row) {
        const double a = values[coarse.index(across.first, row)];
        return a + across.share * (values[coarse.index(across.second, row)] - a);
      };
      const double upper = along(down.first);
      result[fine.index(x, y)] = upper + down.share * (along(down.second) - upper);
    }
  }
  return result;
}

}  // namespace slicecorr::detail
