// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/volume_reducer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "bands/bands.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

/// Flags of a voxel: its design, and whether it prints.
constexpr std::uint8_t kPrints = 1, kDesign = 2, kFull = 4, kGrey = 8;

std::uint8_t state_of(std::uint8_t coverage, bool prints) {
  const std::uint8_t kind = coverage == 255 ? kFull : coverage != 0 ? kGrey : std::uint8_t{0};
  return static_cast<std::uint8_t>(kind | (coverage >= 128 ? kDesign : 0) | (prints ? kPrints : 0));
}

std::uint8_t flags_of(std::uint8_t state) {
  if (state & kGrey) return kCellGrey;
  if (state & kFull) return state & kPrints ? 0 : kCellUndercure;
  return state & kPrints ? kCellCureThrough : 0;
}

/// Of two errors in a cell the larger; of equals the positive one, so that the order does not
/// matter.
std::uint8_t worse_error(std::uint8_t a, std::uint8_t b) {
  const auto size = [](std::uint8_t code) { return code ? std::abs(code - 128) : -1; };
  return size(a) != size(b) ? (size(a) > size(b) ? a : b) : std::max(a, b);
}

/// Adds a slice further towards the platform; turned by `turn_light` in the end.
void note_light(ReducedVolume::LightRuns& runs, std::uint32_t code) {
  if (!runs.empty() && runs.back().code == code &&
      runs.back().slices < ReducedVolume::kMostLightSlices) {
    ++runs.back().slices;
    return;
  }
  runs.push_back({code & ReducedVolume::kLightCodes, 1U});
}

/// Turns runs, noted from the last slice down by the slice where each begins, into runs from the
/// first slice up with the number of their slices.
void count_slices(ReducedVolume::Runs& runs) {
  std::reverse(runs.begin(), runs.end());
  std::uint32_t begin = 0;
  for (ReducedVolume::Run& run : runs) {
    const std::uint32_t end = run.slices + 1;
    run.slices = end - begin;
    begin = end;
  }
  runs.shrink_to_fit();
}

}  // namespace

VolumeReducer::VolumeReducer(const PlaceModels& models, const PixelBox& box, int target_layers,
                             int stack_layers, int levels, int most_cells)
    : models_(models), target_layers_(target_layers), stack_layers_(stack_layers), levels_(levels) {
  ReducedVolume& v = volume_;
  v.box = box;
  v.under_uv = models.of_uv();
  if (box.empty()) return;
  v.layers = std::max(target_layers, stack_layers);
  if (v.layers > ReducedVolume::kMostLayers) {
    throw InputError(fmt::format("a report of {} slices; expected at most {}", v.layers,
                                 ReducedVolume::kMostLayers));
  }
  const auto fit = [&](int size, int& step, int& cells) {
    step = (size + most_cells - 1) / most_cells;
    cells = (size + step - 1) / step;
  };
  fit(box.width(), v.step_x, v.nx);
  fit(box.height(), v.step_y, v.ny);
  fit(v.layers, v.step_z, v.nz);
  for (ReducedPrint* p : {&v.before, &v.after}) {
    for (auto* grid : {&p->state, &p->dose, &p->grey, &p->error}) grid->assign(v.cells(), 0);
  }
  v.columns.resize(static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny));
  ranks_.resize(v.columns.size());
  rows_ = std::vector<CellRow>(static_cast<std::size_t>(v.ny));
  for (int j = 0; j < v.ny; ++j) {
    rows_[static_cast<std::size_t>(j)].pixel_rows_left =
        std::min(v.step_y, box.height() - j * v.step_y);
  }
  cell_layer_.resize(static_cast<std::size_t>(v.layers));
  for (std::size_t n = 0; n < cell_layer_.size(); ++n) {
    cell_layer_[n] = static_cast<std::uint32_t>(n / static_cast<std::size_t>(v.step_z));
  }
}

std::uint32_t VolumeReducer::light_code(double phi) const {
  if (!(phi > 0)) return 0;
  const double share =
      std::log(phi / volume_.least_light) / std::log(volume_.greatest_light / volume_.least_light);
  const double steps = ReducedVolume::kLightCodes - 1;
  return 1 + static_cast<std::uint32_t>(std::lround(std::clamp(share, 0.0, 1.0) * steps));
}

void VolumeReducer::settle(int j) {
  ReducedVolume& v = volume_;
  CellRow& row = rows_[static_cast<std::size_t>(j)];
  const auto size = [](int at, int step, int all) {
    return static_cast<std::uint64_t>(std::min(step, all - at * step));
  };
  std::size_t in = 0;
  for (int i = 0; i < v.nx; ++i) {
    for (int k = 0; k < v.nz; ++k, ++in) {
      const std::uint64_t voxels = size(i, v.step_x, v.box.width()) *
                                   size(j, v.step_y, v.box.height()) * size(k, v.step_z, v.layers);
      const auto half = [&](const std::vector<std::uint32_t>& counts, int flag) {
        return 2 * std::uint64_t{counts[in]} >= voxels ? flag : 0;
      };
      const std::size_t c = cell(i, j, k);
      const int design = half(row.designed, kCellDesigned);
      v.before.state[c] |=
          static_cast<std::uint8_t>(design | half(row.printed_before, kCellPrinted));
      v.after.state[c] |= static_cast<std::uint8_t>(design | half(row.printed_after, kCellPrinted));
    }
  }
  for (auto* counts : {&row.designed, &row.printed_before, &row.printed_after}) {
    counts->clear();
    counts->shrink_to_fit();
  }
}

VolumeReducer::Band::Band(VolumeReducer& volume, const PixelBox& band)
    : volume_(volume), band_(band), cells_(columns_of(band), kNoCell) {
  const ReducedVolume& v = volume.volume_;
  const int y0 = std::max(band.y0, v.box.y0), y1 = std::min(band.y1, v.box.y1);
  j0_ = (y0 - v.box.y0) / v.step_y;
  j1_ = (y1 - 1 - v.box.y0) / v.step_y + 1;
  const auto nx = static_cast<std::size_t>(v.nx), nz = static_cast<std::size_t>(v.nz);
  std::size_t at = static_cast<std::size_t>(y0 - band.y0) * static_cast<std::size_t>(band.width());
  for (int y = y0; y < y1; ++y) {
    const auto j = static_cast<std::size_t>((y - v.box.y0) / v.step_y - j0_);
    for (int x = band.x0; x < band.x1; ++x) {
      const auto i = static_cast<std::size_t>((x - v.box.x0) / v.step_x);
      cells_[at++] = static_cast<std::uint32_t>((j * nx + i) * nz);
    }
  }
  const std::size_t cells = static_cast<std::size_t>(j1_ - j0_) * nx * nz;
  for (Print* p : {&before_, &after_}) {
    p->state.assign(cells_.size(), 0);
    p->highest.assign(cells_.size(), v.layers - 1);
    p->wrong.assign(cells_.size(), 0);
    p->flags.assign(cells, 0);
    p->error.assign(cells, 0);
  }
  for (Counts* c : {&before_.printed, &after_.printed, &designed_}) {
    c->partly.assign(cells, 0);
    c->filled.assign(cells, 0);
  }
}

void VolumeReducer::Band::Counts::add(const VolumeReducer& volume, std::size_t column, int low,
                                      int high) {
  const auto step = static_cast<std::uint32_t>(volume.volume_.step_z);
  const std::uint32_t k0 = volume.cell_layer_[static_cast<std::size_t>(low)];
  const std::uint32_t k1 = volume.cell_layer_[static_cast<std::size_t>(high)];
  const auto l = static_cast<std::uint32_t>(low), h = static_cast<std::uint32_t>(high);
  if (k0 == k1) {
    partly[column + k0] += h - l + 1;
    return;
  }
  partly[column + k0] += (k0 + 1) * step - l;
  partly[column + k1] += h + 1 - k1 * step;
  ++filled[column + k0 + 1];
  --filled[column + k1];
}

void VolumeReducer::Band::Counts::sum(std::size_t column, int nz, std::uint32_t step) {
  std::uint32_t whole = 0;
  for (std::size_t k = 0; k < static_cast<std::size_t>(nz); ++k) {
    whole += filled[column + k];  // wraps and comes back
    partly[column + k] += whole * step;
  }
}

void VolumeReducer::Band::listen(BandPredictor& predictor,
                                 const std::vector<std::uint32_t>* columns, Print& print) {
  const auto place = [columns](std::size_t k) { return columns ? (*columns)[k] : k; };
  predictor.tell_edges([this, place, &print](std::size_t k, int node, bool upper, double um) {
    mark_error(print, place(k), node, upper, um);
  });
  predictor.tell_states([this, place, &print](std::size_t k, int slice, std::uint8_t coverage,
                                              bool prints, bool prints_above) {
    const std::size_t column = place(k);
    enter(print, column, slice, state_of(coverage, prints));
    if (prints != prints_above) enter(print, column, slice - 1, state_of(coverage, prints_above));
  });
}

void VolumeReducer::Band::enter(Print& print, std::size_t column, int slice, std::uint8_t state) {
  if (state == print.state[column]) return;
  count(print, column, slice + 1);
  print.state[column] = state;
}

void VolumeReducer::Band::count(Print& print, std::size_t column, int low) {
  const int high = print.highest[column];
  if (low > high) return;
  print.highest[column] = low - 1;
  const std::uint8_t state = print.state[column];
  if (state == 0) return;
  const std::uint32_t first = cells_[column];
  if (first == kNoCell) return;
  if (state & kPrints) print.printed.add(volume_, first, low, high);
  if (state & kDesign && &print == &after_) designed_.add(volume_, first, low, high);
  const std::uint8_t flags = flags_of(state);
  if (flags == 0) return;
  if (flags != kCellGrey) print.wrong[column] += static_cast<std::uint32_t>(high - low + 1);
  const std::uint32_t k0 = volume_.cell_layer_[static_cast<std::size_t>(low)];
  const std::uint32_t k1 = volume_.cell_layer_[static_cast<std::size_t>(high)];
  for (std::uint32_t k = k0; k <= k1; ++k) print.flags[first + k] |= flags;
}

/// Colours the cells from the designed edge to the printed one.
void VolumeReducer::Band::mark_error(Print& print, std::size_t column, int node, bool upper,
                                     double um) const {
  if (cells_[column] == kNoCell) return;
  const ReducedVolume& v = volume_.volume_;
  const double printed = node + (upper ? -um : um) / volume_.models_.brightest().layer_um;
  const std::uint8_t code = error_code(um);
  // From the layer of the run beside the edge on to where the print ends.
  const int inside = upper ? node : node - 1;
  const int to = std::clamp(static_cast<int>(printed), 0, v.layers - 1);
  const auto [low, high] = std::minmax(inside, to);
  const std::uint32_t k1 = volume_.cell_layer_[static_cast<std::size_t>(high)];
  for (std::uint32_t k = volume_.cell_layer_[static_cast<std::size_t>(low)]; k <= k1; ++k) {
    std::uint8_t& old = print.error[cells_[column] + k];
    old = worse_error(old, code);
  }
}

/// The pixels of this band that stand best for the columns of cells.
std::vector<VolumeReducer::Band::Chosen> VolumeReducer::Band::choose() const {
  const ReducedVolume& v = volume_.volume_;
  std::vector<Chosen> chosen(static_cast<std::size_t>(j1_ - j0_) * static_cast<std::size_t>(v.nx));
  std::size_t at = 0;
  for (int y = band_.y0; y < band_.y1; ++y) {
    const int j = (y - v.box.y0) / v.step_y;
    const std::int64_t dy = 2 * ((y - v.box.y0) % v.step_y) + 1 - v.step_y;
    for (int x = band_.x0; x < band_.x1; ++x, ++at) {
      if (cells_[at] == kNoCell) continue;
      const int i = (x - v.box.x0) / v.step_x;
      const std::int64_t dx = 2 * ((x - v.box.x0) % v.step_x) + 1 - v.step_x;
      const CellRank rank{after_.wrong[at], before_.wrong[at], -(dx * dx + dy * dy)};
      Chosen& c = chosen[static_cast<std::size_t>(j - j0_) * static_cast<std::size_t>(v.nx) +
                         static_cast<std::size_t>(i)];
      if (rank <= c.rank) continue;
      c.rank = rank;
      c.at = at;
      c.i = i;
      c.j = j;
      c.column.x = x;
      c.column.y = y;
    }
  }
  std::erase_if(chosen, [](const Chosen& c) { return c.column.x < 0; });
  return chosen;
}

/// Fills in the slices and doses of the chosen pixels.
void VolumeReducer::Band::follow(std::vector<Chosen>& chosen, const Reader& shown,
                                 const Reader& design, const Lights& lights) const {
  const ReducedVolume& v = volume_.volume_;
  const LightMap& map = volume_.models_.map();
  std::vector<Pixel> places;
  std::vector<std::uint32_t> columns;
  for (Chosen& c : chosen) {
    places.push_back({c.column.x, c.column.y});
    columns.push_back(static_cast<std::uint32_t>(c.at));
    c.column.light = volume_.models_.curing_factor(map.value(c.column.x, c.column.y));
    for (auto* codes : {&c.dose_before, &c.dose_after, &c.grey_before, &c.grey_after}) {
      codes->assign(static_cast<std::size_t>(v.nz), 0);
    }
  }
  std::array<std::uint8_t, 256> level_of{}, itself{};
  for (std::size_t p = 0; p < 256; ++p) {
    itself[p] = static_cast<std::uint8_t>(p);
    level_of[p] = static_cast<std::uint8_t>(level_of_pixel(static_cast<int>(p), volume_.levels_));
  }
  // Where light spreads, all columns have one model.
  std::pair<Light, Light> light;
  if (lights) light = lights(places);
  const PlaceModels one(lights ? *volume_.of_light_ : volume_.models_.brightest());
  const PlaceModels& models = lights ? one : volume_.models_;
  PlaceDose dose_before(models, places), dose_after(models, places);
  std::vector<std::uint8_t> rows(cells_.size());
  const std::size_t size = chosen.size();
  std::vector<std::uint8_t> pixels(size), cover(size), pixels_below(size), cover_below(size);
  const auto read = [&](const Reader& from, int z, std::vector<std::uint8_t>& values) {
    from(z, rows.data());
    for (std::size_t m = 0; m < size; ++m) values[m] = rows[columns[m]];
  };
  // Until the end `slices` of a run holds the slice at which the run begins, seen from the last
  // one.
  using Runs = ReducedVolume::Runs;
  const auto note = [&](int z, bool first, Runs ReducedVolume::Column::*runs,
                        const std::array<std::uint8_t, 256>& code,
                        const std::vector<std::uint8_t>& now,
                        const std::vector<std::uint8_t>& below) {
    constexpr std::size_t at_once = 32;
    for (std::size_t b = 0; b < size; b += at_once) {
      const std::size_t end = std::min(b + at_once, size);
      if (!first && std::memcmp(&now[b], &below[b], end - b) == 0) continue;
      for (std::size_t m = b; m < end; ++m) {
        const std::uint8_t value = code[now[m]];
        if (!first && value == code[below[m]]) continue;
        (chosen[m].column.*runs).push_back({value, static_cast<std::uint32_t>(z)});
      }
    }
  };
  const auto note_lights = [&](std::span<const ImageShowing> showings,
                               ReducedVolume::LightRuns ReducedVolume::Column::*runs) {
    if (v.under_uv) return;
    for (std::size_t m = 0; m < size; ++m) {
      double phi = 0;
      for (const ImageShowing& showing : showings) phi += showing.light * showing.phi[m];
      note_light(chosen[m].column.*runs, volume_.light_code(phi));
    }
  };
  for (int z = v.layers; z-- > 0;) {
    const bool lit_before = z < volume_.target_layers_, lit_after = z < volume_.stack_layers_;
    cover.swap(cover_below);
    pixels.swap(pixels_below);
    read(design, z, cover);
    read(shown, z, pixels);
    if (lights) {
      const std::span<const ImageShowing> of_before = light.first(z), of_after = light.second(z);
      dose_before.add_slice(z, of_before);
      dose_after.add_slice(z, of_after);
      if (lit_before) note_lights(of_before, &ReducedVolume::Column::light_before);
      if (lit_after) note_lights(of_after, &ReducedVolume::Column::light_after);
    } else {
      dose_before.add_slice(z, lit_before ? cover.data() : nullptr);
      dose_after.add_slice(z, lit_after ? pixels.data() : nullptr);
    }
    if (lit_before) {
      note(z, z + 1 == volume_.target_layers_, &ReducedVolume::Column::coverage, itself, cover,
           cover_below);
    }
    if (lit_after) {
      note(z, z + 1 == volume_.stack_layers_, &ReducedVolume::Column::levels, level_of, pixels,
           pixels_below);
    }
    const auto k = volume_.cell_layer_[static_cast<std::size_t>(z)];
    const int first = static_cast<int>(k) * v.step_z;
    if (z != (first + std::min(first + v.step_z, v.layers)) / 2) continue;
    for (std::size_t m = 0; m < size; ++m) {
      chosen[m].dose_before[k] = dose_code(dose_before.middle()[m]);
      chosen[m].dose_after[k] = dose_code(dose_after.middle()[m]);
      chosen[m].grey_before[k] = cover[m];
      chosen[m].grey_after[k] = pixels[m];
    }
  }
  for (Chosen& c : chosen) {
    count_slices(c.column.coverage);
    count_slices(c.column.levels);
    for (auto* runs : {&c.column.light_before, &c.column.light_after}) {
      std::reverse(runs->begin(), runs->end());
      runs->shrink_to_fit();
    }
  }
}

void VolumeReducer::Band::join(std::vector<Chosen>& chosen) {
  ReducedVolume& v = volume_.volume_;
  const auto nz = static_cast<std::size_t>(v.nz);
  auto next = chosen.begin();
  for (int j = j0_; j < j1_; ++j) {
    CellRow& row = volume_.rows_[static_cast<std::size_t>(j)];
    const std::lock_guard lock(row.mutex);
    const std::size_t cells = static_cast<std::size_t>(v.nx) * nz;
    const std::size_t from = static_cast<std::size_t>(j - j0_) * cells;
    const auto add = [&](const Counts& band, std::vector<std::uint32_t>& counts) {
      counts.resize(cells, 0);
      for (std::size_t c = 0; c < cells; ++c) counts[c] += band.partly[from + c];
    };
    add(designed_, row.designed);
    add(before_.printed, row.printed_before);
    add(after_.printed, row.printed_after);
    for (int i = 0; i < v.nx; ++i) {
      for (std::size_t k = 0; k < nz; ++k) {
        const std::size_t to = volume_.cell(i, j, static_cast<int>(k));
        const std::size_t in = from + static_cast<std::size_t>(i) * nz + k;
        v.before.state[to] |= before_.flags[in];
        v.after.state[to] |= after_.flags[in];
        v.before.error[to] = worse_error(v.before.error[to], before_.error[in]);
        v.after.error[to] = worse_error(v.after.error[to], after_.error[in]);
      }
    }
    const int top = v.box.y0 + j * v.step_y;
    const int bottom = std::min(top + v.step_y, v.box.y1);
    row.pixel_rows_left -= std::min(bottom, band_.y1) - std::max(top, band_.y0);
    if (row.pixel_rows_left == 0) volume_.settle(j);
    for (; next != chosen.end() && next->j == j; ++next) {
      const std::size_t c = static_cast<std::size_t>(j) * static_cast<std::size_t>(v.nx) +
                            static_cast<std::size_t>(next->i);
      ReducedVolume::Column& stands = v.columns[c];
      const bool earlier =
          next->column.y != stands.y ? next->column.y < stands.y : next->column.x < stands.x;
      if (next->rank < volume_.ranks_[c] || (next->rank == volume_.ranks_[c] && !earlier)) {
        continue;
      }
      volume_.ranks_[c] = next->rank;
      stands = std::move(next->column);
      for (std::size_t k = 0; k < nz; ++k) {
        const std::size_t to = volume_.cell(next->i, j, static_cast<int>(k));
        v.before.dose[to] = next->dose_before[k];
        v.after.dose[to] = next->dose_after[k];
        v.before.grey[to] = next->grey_before[k];
        v.after.grey[to] = next->grey_after[k];
      }
    }
  }
}

void VolumeReducer::Band::finish(const Reader& shown, const Reader& design, const Lights& lights) {
  const ReducedVolume& v = volume_.volume_;
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    count(before_, i, 0);
    count(after_, i, 0);
  }
  const std::size_t columns = static_cast<std::size_t>(j1_ - j0_) * static_cast<std::size_t>(v.nx);
  for (std::size_t c = 0; c < columns; ++c) {
    for (Counts* counts : {&before_.printed, &after_.printed, &designed_}) {
      counts->sum(c * static_cast<std::size_t>(v.nz), v.nz, static_cast<std::uint32_t>(v.step_z));
    }
  }
  std::vector<Chosen> chosen = choose();
  follow(chosen, shown, design, lights);
  join(chosen);
}

}  // namespace slicecorr::detail
