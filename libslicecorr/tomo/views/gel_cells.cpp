// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/views/gel_cells.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "picture/embed.hpp"
#include "support/text/base64.hpp"
#include "tomo/views/page_text.hpp"

namespace slicecorr::tomo::detail {
namespace {

using slicecorr::detail::Bytes;

/// Compressed bytes of the cells in the round, and cells along a side, at most.
constexpr std::size_t kCellBudget = 1'500'000;
constexpr int kMostCells = 220;

std::size_t place_of(int nx, int ny, int x, int y, int z) {
  return (static_cast<std::size_t>(z) * static_cast<std::size_t>(ny) +
          static_cast<std::size_t>(y)) *
             static_cast<std::size_t>(nx) +
         static_cast<std::size_t>(x);
}

/// Hundredths of the time, rounded up; 0: later than is shown.
int hundredths_of(double share) {
  if (!(share <= 0.01 * kLatest)) return 0;
  const double hundredths = std::ceil(100 * share);
  if (share <= 1) return static_cast<int>(std::clamp(hundredths, 1.0, 100.0));
  return hundredths > kLatest ? 0 : static_cast<int>(std::max(101.0, hundredths));
}

}  // namespace

GelTimes gel_cells(const RoundSource& s, int voxels_per_cell) {
  int low[3] = {s.nx, s.ny, s.nz}, high[3] = {-1, -1, -1};
  for (int z = 0; z < s.nz; ++z) {
    for (int y = 0; y < s.ny; ++y) {
      for (int x = 0; x < s.nx; ++x) {
        const std::size_t k = place_of(s.nx, s.ny, x, y, z);
        const Kept what = s.kept(k, x, y);
        if (what != Kept::insert && !s.has_part(k) && !(s.share_of_time(k) <= 0.01 * kLatest)) {
          continue;
        }
        const int at[3] = {x, y, z};
        for (int i = 0; i < 3; ++i) {
          low[i] = std::min(low[i], at[i]);
          high[i] = std::max(high[i], at[i]);
        }
      }
    }
  }
  GelTimes g;
  g.voxels_per_cell = voxels_per_cell;
  g.cell_mm = voxels_per_cell * s.voxel_mm;
  const auto cells = [&](int i) {
    return std::max(1, (high[i] - low[i] + voxels_per_cell) / voxels_per_cell);
  };
  g.nx = cells(0);
  g.ny = cells(1);
  g.nz = cells(2);
  g.time.resize(place_of(g.nx, g.ny, 0, 0, g.nz));
  g.kind.resize(g.time.size());
  for (int cz = 0; cz < g.nz; ++cz) {
    for (int cy = 0; cy < g.ny; ++cy) {
      for (int cx = 0; cx < g.nx; ++cx) {
        const auto place = [&](int i, int c, int d) {
          const int sizes[3] = {s.nx, s.ny, s.nz};
          return std::min(sizes[i] - 1, std::max(0, low[i]) + c * voxels_per_cell + d);
        };
        std::uint8_t time = 0;
        Kept kind = Kept::empty;
        const auto look = [&](int dx, int dy, int dz) {
          const int x = place(0, cx, dx), y = place(1, cy, dy), z = place(2, cz, dz);
          const std::size_t k = place_of(s.nx, s.ny, x, y, z);
          kind = s.kept(k, x, y);
          time = kind == Kept::insert
                     ? std::uint8_t{0}
                     : static_cast<std::uint8_t>(hundredths_of(s.share_of_time(k)));
          const bool gels = time > 0 && time <= 100;
          return kind == (gels ? Kept::empty : Kept::part);
        };
        bool wrong = false;
        for (int d = 0; d < voxels_per_cell * voxels_per_cell * voxels_per_cell && !wrong; ++d) {
          wrong = look(d % voxels_per_cell, d / voxels_per_cell % voxels_per_cell,
                       d / (voxels_per_cell * voxels_per_cell));
        }
        if (!wrong) look(voxels_per_cell / 2, voxels_per_cell / 2, voxels_per_cell / 2);
        const std::size_t to = place_of(g.nx, g.ny, cx, cy, cz);
        g.time[to] = time;
        g.kind[to] = static_cast<std::uint8_t>(kind);
      }
    }
  }
  return g;
}

void add_round(page::Page& page, const RoundSource& source, const RoundWords& words) {
  GelTimes g;
  Bytes time, kind;
  for (int every = 1;; ++every) {
    g = gel_cells(source, every);
    const bool last = g.time.size() < 1000;
    if (!last && std::max({g.nx, g.ny, g.nz}) > kMostCells) continue;
    // As differences from one layer of cells to the next, which compress better.
    Bytes differences = g.time;
    const auto layer = static_cast<std::size_t>(g.nx) * static_cast<std::size_t>(g.ny);
    for (std::size_t k = differences.size(); k-- > layer;) {
      differences[k] = static_cast<std::uint8_t>(differences[k] - differences[k - layer]);
    }
    const std::size_t most = last ? SIZE_MAX : kCellBudget;
    if (slicecorr::detail::deflate_within(most, differences, time) &&
        slicecorr::detail::deflate_within(most, g.kind, kind) &&
        time.size() + kind.size() <= most) {
      break;
    }
  }
  int first = 100;
  for (const std::uint8_t t : g.time) {
    if (t > 0) first = std::min<int>(first, t);
  }
  nlohmann::ordered_json j;
  j["cells"] = {g.nx, g.ny, g.nz};
  j["every"] = g.voxels_per_cell;
  j["cell_mm"] = g.cell_mm;
  j["voxel_mm"] = source.voxel_mm;
  j["time_s"] = words.time_s;
  j["turns"] = words.turns;
  j["grows"] = words.grows;
  j["first"] = first;
  j["insert"] = words.insert;
  j["time"] = slicecorr::detail::base64(time);
  j["kind"] = slicecorr::detail::base64(kind);
  page += page::Markup::raw(page_round_html);
  page.scripts("tomo-data", j.dump(), {page::page_inflate_js, page::page_round_js, page_times_js});
}

}  // namespace slicecorr::tomo::detail
