// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/metrics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr::tomo {
namespace {

struct Sorted {
  std::vector<float> gel, empty;

  Sorted(const CellKinds& cells, const Array<float>& dose) {
    gel.reserve(cells.gel);
    empty.reserve(cells.empty);
    for (std::size_t i = 0; i < cells.kinds.size(); ++i) {
      if (cells.kinds[i] == Kind::gel) gel.push_back(dose[i]);
      if (cells.kinds[i] == Kind::empty) empty.push_back(dose[i]);
    }
    std::sort(gel.begin(), gel.end());
    std::sort(empty.begin(), empty.end());
  }
};

void check_dose(const CellKinds& cells, const Array<float>& dose) {
  if (dose.size() != cells.kinds.size()) {
    throw InputError("dose", "", "must have the grid of the part");
  }
}

bool in_slice(const TomoGrid& grid, std::size_t i) {
  const std::size_t block = i / grid.light_of_block();
  const int lane = static_cast<int>(i % grid.light_lanes());
  return lane < (grid.coupled() ? grid.rows : grid.lanes_used(block));
}

void check_curve(const std::vector<double>& mw_cm2) {
  if (mw_cm2.size() < 2 || mw_cm2.size() > 65536) {
    throw InputError("calibration", "", "must have 2 to 65536 levels");
  }
  for (std::size_t i = 0; i < mw_cm2.size(); ++i) {
    if (!std::isfinite(mw_cm2[i]) || mw_cm2[i] < 0 || (i > 0 && mw_cm2[i] < mw_cm2[i - 1])) {
      throw InputError("calibration", "level " + std::to_string(i),
                       "intensities must be 0 or more and not fall");
    }
  }
  if (!(mw_cm2.back() > mw_cm2.front())) {
    throw InputError("calibration", "", "the brightest level must be brighter than the darkest");
  }
}

}  // namespace

std::uint16_t nearest_level(double wanted, const std::vector<double>& mw_cm2) {
  const auto above = std::lower_bound(mw_cm2.begin(), mw_cm2.end(), wanted);
  auto level = static_cast<std::size_t>(above - mw_cm2.begin());
  if (above == mw_cm2.end()) {
    level = mw_cm2.size() - 1;
  } else if (level > 0 && wanted - mw_cm2[level - 1] <= mw_cm2[level] - wanted) {
    --level;
  }
  return static_cast<std::uint16_t>(level);
}

Metrics measure_extremes(const CellKinds& cells, const Array<float>& dose) {
  check_dose(cells, dose);
  float low = std::numeric_limits<float>::infinity(), high = -low, most_void = -low;
  Metrics m;
  for (std::size_t i = 0; i < cells.kinds.size(); ++i) {
    if (cells.kinds[i] == Kind::gel) {
      low = std::min(low, dose[i]);
      high = std::max(high, dose[i]);
      ++m.gel;
    } else if (cells.kinds[i] == Kind::empty) {
      most_void = std::max(most_void, dose[i]);
      ++m.empty;
    }
  }
  // Few of void, where there are any.
  if (most_void >= low) {
    for (std::size_t i = 0; i < cells.kinds.size(); ++i) {
      m.void_gelled += cells.kinds[i] == Kind::empty && dose[i] >= low ? 1 : 0;
    }
  }
  m.min_gel = low;
  m.max_gel = high;
  m.max_void = most_void;
  const double most = std::max(m.max_gel, m.max_void);
  m.ver = static_cast<double>(m.void_gelled) / static_cast<double>(m.gel + m.empty);
  m.pw = most > 0 ? (m.min_gel - m.max_void) / most : 0;
  m.ipdr = most > 0 ? (m.max_gel - m.min_gel) / most : 0;
  m.contrast = m.max_void > 0  ? m.min_gel / m.max_void
               : m.min_gel > 0 ? std::numeric_limits<double>::infinity()
                               : 0;
  return m;
}

Metrics measure(const CellKinds& cells, const Array<float>& dose) {
  Metrics m = measure_extremes(cells, dose);
  const Sorted d(cells, dose);
  const double most = std::max(m.max_gel, m.max_void);
  constexpr double kTrimmed = 0.0005;
  const auto gel_cut = static_cast<std::size_t>(kTrimmed * static_cast<double>(m.gel));
  const auto void_cut = static_cast<std::size_t>(kTrimmed * static_cast<double>(m.empty));
  if (most > 0) m.trimmed_pw = (d.gel[gel_cut] - d.empty[m.empty - 1 - void_cut]) / most;
  // The best t is a gel dose: between two of them raising t only drops void.
  std::size_t below = 0;
  for (std::size_t i = 0; i < m.gel; ++i) {
    while (below < m.empty && d.empty[below] < d.gel[i]) ++below;
    const double j = static_cast<double>(m.gel - i) / static_cast<double>(m.gel + m.empty - below);
    if (j > m.best_jaccard) {
      m.best_jaccard = j;
      m.best_threshold = d.gel[i];
    }
  }
  return m;
}

double jaccard(const CellKinds& cells, const Array<float>& dose, double threshold) {
  check_dose(cells, dose);
  std::size_t both = 0, wrong = 0;
  for (std::size_t i = 0; i < cells.kinds.size(); ++i) {
    if (dose[i] < threshold) continue;
    both += cells.kinds[i] == Kind::gel;
    wrong += cells.kinds[i] == Kind::empty;
  }
  return static_cast<double>(both) / static_cast<double>(cells.gel + wrong);
}

WeakVoxel weakest_voxel(const Target& target, const Array<float>& dose) {
  const TomoGrid& grid = target.grid;
  float least = std::numeric_limits<float>::infinity();
  std::array<int, 3> at{};
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = 0; y < grid.voxels; ++y) {
      for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) {
        const std::size_t v = grid.voxel(x, y, z);
        const bool asks = target.banded() ? target.least[v] > 0 : target.kinds[v] == Kind::gel;
        const float d = asks && target.banded() ? dose[v] / target.least[v] : dose[v];
        if (!asks || d >= least) continue;
        least = d;
        at = {x, y, z};
      }
    }
  }
  return {least, fmt::format("the part's voxel {}, {} in slice {}", at[0], at[1], at[2])};
}

double efficiency(const Light& light) {
  double sum = 0, most = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < light.values.size(); ++i) {
    if (!in_slice(light.grid, i)) continue;
    sum += light.values[i];
    most = std::max<double>(most, light.values[i]);
    ++count;
  }
  return most > 0 ? sum / (most * static_cast<double>(count)) : 0;
}

double dose_of_turn(const TomoGrid& grid, const Exposure& exposure) {
  return exposure.alpha_a_per_cm * exposure.turn_s / grid.angles;
}

PrintTime plan_time(const ExecutionContext& context, const Projector& projector,
                    const Target& target, const Array<float>& dose, const Exposure& exposure) {
  check_dose(target, dose);
  if (!(exposure.alpha_a_per_cm > 0) || !(exposure.turn_s > 0) || !(exposure.critical_mj_cm3 > 0) ||
      !(exposure.black_mw_cm2 >= 0) || !(exposure.most_time_s >= 0)) {
    throw InputError("exposure", "",
                     "active absorption, time of a turn and critical dose must be above 0, black "
                     "light and the limit of time 0 or more");
  }
  const TomoGrid& grid = target.grid;
  const double unit = dose_of_turn(grid, exposure);
  const WeakVoxel weakest = weakest_voxel(target, dose);
  if (!(weakest.dose > 0)) {
    throw InfeasibleError(weakest.name + " gets no light from any angle");
  }
  const double least = unit * weakest.dose;
  PrintTime time;
  const double turns = std::ceil(exposure.critical_mj_cm3 / least * (1 - 1e-12));
  time.time_s = std::max(1.0, turns) * exposure.turn_s;
  if (turns > 1e6 || (exposure.most_time_s > 0 && time.time_s > exposure.most_time_s)) {
    throw InfeasibleError(fmt::format(
        "printing takes {:.0f} turns, {:g} s, longer than allowed; more light would shorten it",
        turns, time.time_s));
  }
  time.turns = std::max(1, static_cast<int>(turns));
  time.scale = exposure.critical_mj_cm3 / (time.turns * least);
  if (exposure.black_mw_cm2 > 0) {
    Light black(grid);
    for (std::size_t i = 0; i < black.values.size(); ++i) {
      if (in_slice(grid, i)) black.values[i] = static_cast<float>(exposure.black_mw_cm2);
    }
    const Field floor = adjoint(projector, context, black);
    for (std::size_t i = 0; i < target.kinds.size(); ++i) {
      if (target.kinds[i] != Kind::empty) continue;
      time.floor_mj_cm3 = std::max(time.floor_mj_cm3, unit * time.turns * floor.values[i]);
    }
    if (time.floor_mj_cm3 >= exposure.critical_mj_cm3) {
      throw InfeasibleError("black light alone gels void: " + std::to_string(time.floor_mj_cm3) +
                            " mJ/cm3 of " + std::to_string(exposure.critical_mj_cm3) +
                            "; use a projector with a darker black or a shorter print");
    }
  }
  return time;
}

std::vector<std::uint16_t> nearest_levels(const Light& light, double mw_cm2_per_unit,
                                          const std::vector<double>& mw_cm2) {
  check_curve(mw_cm2);
  std::vector<std::uint16_t> levels(light.values.size());
  for (std::size_t i = 0; i < levels.size(); ++i) {
    levels[i] = nearest_level(light.values[i] * mw_cm2_per_unit, mw_cm2);
  }
  return levels;
}

std::vector<std::uint16_t> carried_levels(const Light& light, double mw_cm2_per_unit,
                                          const std::vector<double>& mw_cm2) {
  check_curve(mw_cm2);
  const TomoGrid& grid = light.grid;
  std::vector<std::uint16_t> levels(light.values.size());
  const std::size_t frame = grid.light_of_block() / static_cast<std::size_t>(grid.angles);
  for (std::size_t b = 0; b < grid.blocks(); ++b) {
    for (std::size_t pixel = 0; pixel < frame; ++pixel) {
      double owed = 0;
      for (int m = 0; m < grid.angles; ++m) {
        const std::size_t i =
            b * grid.light_of_block() + static_cast<std::size_t>(m) * frame + pixel;
        const double wanted = light.values[i] * mw_cm2_per_unit;
        levels[i] = nearest_level(wanted + owed, mw_cm2);
        // What no level can show is owed to nobody: it would dim or brighten all that follows.
        const bool within = wanted > mw_cm2.front() && wanted < mw_cm2.back();
        owed = within ? wanted + owed - mw_cm2[levels[i]] : 0;
      }
    }
  }
  return levels;
}

Light light_of_levels(const TomoGrid& grid, const std::vector<std::uint16_t>& levels,
                      const std::vector<double>& mw_cm2) {
  check_curve(mw_cm2);
  Light light(grid);
  if (levels.size() != light.values.size()) {
    throw InputError("levels", "", "must be as many as the grid's pixels");
  }
  for (std::size_t i = 0; i < levels.size(); ++i) {
    if (levels[i] >= mw_cm2.size()) {
      throw InputError("levels", std::to_string(i), "is above the calibration's brightest level");
    }
    if (in_slice(grid, i)) light.values[i] = static_cast<float>(mw_cm2[levels[i]]);
  }
  return light;
}

}  // namespace slicecorr::tomo
