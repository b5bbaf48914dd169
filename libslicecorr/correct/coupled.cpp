// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/coupled.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <set>
#include <utility>

#include "base/coded_band.hpp"
#include "correct/coupled_tile.hpp"
#include "parallel/silent.hpp"

namespace slicecorr::detail {

namespace {

/// Patches that gain ask for more each time, up to a limit; others for less, until they are given up.
constexpr double kMoreUrgent = 1.4, kLessUrgent = 0.4, kMostUrgent = 32, kLeastUrgent = 0.3;

/// Misses that are kept with their places, of a patch.
constexpr std::size_t kMostMisses = 50000;
/// Columns that are solved together, by one thread, and their voxels.
constexpr std::size_t kColumnsTogether = std::size_t{1} << 17,
                      kVoxelsTogether = std::size_t{64} << 20;
/// Rounds without gain after which nothing is expected any more.
constexpr int kMostWithoutGain = 5;

PixelBox common(const PixelBox& a, const PixelBox& b) { return PatchPlace::common(a, b); }

Pixel pixel_in(const PixelBox& box, std::size_t index) {
  const auto width = static_cast<std::size_t>(box.width());
  return {box.x0 + static_cast<int>(index % width), box.y0 + static_cast<int>(index / width)};
}

bool is_black(const KeptTile& tile) {
  return std::all_of(tile.pieces.begin(), tile.pieces.end(),
                     [](const Kept& piece) { return piece == nullptr; });
}

/// Copies what two boxes have in common from one field of bytes to the other.
void copy_common(const std::uint8_t* from, const PixelBox& from_box, std::uint8_t* to,
                 const PixelBox& to_box) {
  const PixelBox both = common(from_box, to_box);
  if (both.empty()) return;
  for (int y = both.y0; y < both.y1; ++y) {
    std::copy_n(from + index_in(from_box, both.x0, y), both.width(),
                to + index_in(to_box, both.x0, y));
  }
}

}  // namespace

CoupledCorrection::CoupledCorrection(const CorrectionPlan& columns, const LightBlur& blur,
                                     const PixelBox& bounds, const PixelBox& display,
                                     const CoupledOptions& options)
    : plan_(columns, blur, display, options.margin, options.shares),
      options_(options),
      bounds_(common(bounds, display)) {
  if (options.distances) plan_.scatter_by(*options.distances);
  box_ =
      common(PatchPlace::grown(bounds_, plan_.reach_x + plan_.halo_x, plan_.reach_y + plan_.halo_y),
             display);
  plan_.hands_on = plan_.hands_on && options.hand_on;
  if (options.uv.shares) plan_.differ(options.uv);
  if (options.doses) plan_.want(*options.doses);
  now_.lifted = plan_.joint > 0;
  if (bounds_.empty()) return;
  const int side = options_.patch_px;
  across_ = (box_.width() + side - 1) / side;
  for (int y = box_.y0; y < box_.y1; y += side) {
    for (int x = box_.x0; x < box_.x1; x += side) {
      Tile& tile = tiles_.emplace_back();
      tile.box = common({x, y, x + side, y + side}, box_);
    }
  }
}

CoupledCorrection::~CoupledCorrection() = default;

void CoupledCorrection::solve_columns(const DesignReader& read, bool leaves_alone,
                                      const ExecutionContext& context, const ColumnLevels& levels) {
  if (tiles_.empty()) return;
  store_ = std::make_unique<BlobStore>(options_.scratch_folder, options_.memory_bytes, context);
  const auto across = static_cast<std::size_t>(across_);
  const std::size_t of_tile = pixels_of(tiles_.front().box);
  const std::size_t most =
      std::min(kColumnsTogether, kVoxelsTogether / static_cast<std::size_t>(plan_.slices));
  const std::size_t together = std::clamp<std::size_t>(most / of_tile, 1, across),
                    parts = (across + together - 1) / together;
  parallel_for(context, "columns", tiles_.size() / across * parts, [&](std::size_t i) {
    const std::size_t first = i % parts * together;
    solve_tiles(tiles_.data() + i / parts * across + first, std::min(together, across - first),
                {read, leaves_alone, levels}, context);
  });
  std::vector<std::size_t> all;
  for (std::size_t k = 0; k < tiles_.size(); ++k) all.push_back(k);
  judge(all, context);
  first_ = best_ = now_;
  keep_best();
}

void CoupledCorrection::solve_tiles(Tile* tiles, std::size_t count, const Columns& columns,
                                    const ExecutionContext& context) {
  const PixelBox rows =
      common({tiles->box.x0, tiles->box.y0, tiles[count - 1].box.x1, tiles->box.y1}, bounds_);
  std::vector<TileWriter> coverage, levels, left_alone, edges;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t pixels = pixels_of(tiles[k].box);
    coverage.emplace_back(*store_, pixels, plan_.slices, TileWriter::From::first);
    left_alone.emplace_back(*store_, pixels, plan_.slices, TileWriter::From::first);
    edges.emplace_back(*store_, pixels, plan_.slices, TileWriter::From::first);
    levels.emplace_back(*store_, pixels, plan_.slices, TileWriter::From::last);
  }
  std::vector<std::uint8_t> part;
  const auto put = [&](const std::uint8_t* bytes, std::vector<TileWriter>& writers) {
    for (std::size_t k = 0; k < count; ++k) {
      if (!bytes) {
        writers[k].put(nullptr);
        continue;
      }
      part.assign(pixels_of(tiles[k].box), 0);
      copy_common(bytes, rows, part.data(), tiles[k].box);
      writers[k].put(part.data());
    }
  };
  if (!rows.empty()) {
    std::optional<BandCorrector> corrector;
    if (!columns.levels) corrector.emplace(plan_.columns, pixels_of(rows), columns.leaves_alone);
    columns.read(rows, [&](int layer, const std::uint8_t* cover, const std::uint8_t* heights,
                           const std::uint8_t* left) {
      if ((layer & 63) == 0) context.check_cancelled();
      if (corrector) corrector->add_layer(cover, heights, left);
      // Heights of the node after the last layer come with a layer more.
      if (plan_.wants && layer < plan_.slices) put(heights, edges);
      if (layer >= plan_.layers) return;
      put(cover, coverage);
      if (columns.leaves_alone) put(left, left_alone);
    });
    if (corrector) {
      corrector->solve([&](int n, const std::uint8_t* its_levels, const std::uint8_t*, bool dark) {
        if ((n & 63) == 0) context.check_cancelled();
        put(dark ? nullptr : its_levels, levels);
      });
    } else {
      const CodedBand band = columns.levels(rows);
      std::vector<std::uint8_t> row(band.columns());
      for (int k = 0; k < band.slices(); ++k) {
        const bool dark = band.black(k);
        if (!dark) band.read(k, row.data());
        put(dark ? nullptr : row.data(), levels);
      }
    }
  }
  for (std::size_t k = 0; k < count; ++k) {
    tiles[k].coverage = coverage[k].finish();
    tiles[k].left_alone = left_alone[k].finish();
    tiles[k].heights = edges[k].finish();
    tiles[k].columns = tiles[k].wanted = tiles[k].now = tiles[k].best = levels[k].finish();
  }
}

std::vector<std::size_t> CoupledCorrection::tiles_in(const PixelBox& box) const {
  std::vector<std::size_t> found;
  const PixelBox inside = common(box, box_);
  if (inside.empty()) return found;
  const int side = options_.patch_px;
  for (int y = (inside.y0 - box_.y0) / side; y <= (inside.y1 - 1 - box_.y0) / side; ++y) {
    for (int x = (inside.x0 - box_.x0) / side; x <= (inside.x1 - 1 - box_.x0) / side; ++x) {
      found.push_back(static_cast<std::size_t>(y * across_ + x));
    }
  }
  return found;
}

std::vector<PatchBytes::Source> CoupledCorrection::sources(const PixelBox& box,
                                                           KeptTile Tile::*which) const {
  std::vector<PatchBytes::Source> found;
  for (const std::size_t k : tiles_in(box)) {
    const KeptTile& tile = tiles_[k].*which;
    const bool may_be_none =
        which == &Tile::left_alone || which == &Tile::heights || which == &Tile::aims;
    if (may_be_none && is_black(tile)) continue;
    found.push_back({&tile, tiles_[k].box});
  }
  return found;
}

PatchSources CoupledCorrection::sources_of(const PixelBox& watched) const {
  const PixelBox shown = PatchPlace::grown(watched, plan_.reach_x, plan_.reach_y);
  return {sources(watched, &Tile::coverage), sources(shown, &Tile::now),
          sources(watched, &Tile::columns),  sources(watched, &Tile::left_alone),
          sources(watched, &Tile::aims),     sources(watched, &Tile::heights)};
}

void CoupledCorrection::judge(const std::vector<std::size_t>& which,
                              const ExecutionContext& context) {
  parallel_for(context, "judge", which.size(), [&](std::size_t i) {
    Tile& tile = tiles_[which[i]];
    const PatchFigures found = (plan_.wants ? judge_patch_by_columns : judge_patch)(
        plan_, tile.box, sources_of(PatchPlace::grown(tile.box, plan_.halo_x, plan_.halo_y)),
        kMostMisses);
    Figures& figures = tile.figures;
    figures = {found.through, found.under, found.parted,    found.unmet,
               found.loss,    nullptr,     found.all_misses};
    if (found.misses.empty()) return;
    std::vector<std::uint8_t> bytes(found.misses.size() * sizeof(Miss));
    std::memcpy(bytes.data(), found.misses.data(), bytes.size());
    figures.misses = std::make_shared<const KeptBytes>(*store_, bytes);
  });
  now_.through = now_.under = now_.parted = now_.unmet = 0;
  now_.loss = 0;
  for (const Tile& tile : tiles_) {
    now_.through += tile.figures.through;
    now_.under += tile.figures.under;
    now_.parted += tile.figures.parted;
    now_.unmet += tile.figures.unmet;
    now_.loss += tile.figures.loss;
  }
}

std::vector<Miss> CoupledCorrection::misses_of(const Figures& figures) const {
  std::vector<Miss> misses;
  if (!figures.misses) return misses;
  std::vector<std::uint8_t> bytes;
  figures.misses->get(bytes);
  misses.resize(bytes.size() / sizeof(Miss));
  std::memcpy(misses.data(), bytes.data(), bytes.size());
  return misses;
}

bool CoupledCorrection::is_wanted(const Tile& tile) const {
  const PixelBox watched = PatchPlace::grown(tile.box, plan_.overlap_x, plan_.overlap_y);
  if (common(watched, bounds_).empty() || tile.urgency < kLeastUrgent) return false;
  const std::vector<std::size_t> around = tiles_in(watched);
  return std::any_of(around.begin(), around.end(), [&](std::size_t k) {
    const Figures& figures = tiles_[k].figures;
    return figures.wrong() > 0 || (now_.round == 0 && figures.loss > 0);
  });
}

PatchTask CoupledCorrection::task_of(const Tile& tile) const {
  PatchTask task;
  task.box = tile.box;
  task.before = &tile.now;
  task.free = bounds_;
  // Where too much is wrong to be mended voxel by voxel, it is as in the first round.
  task.first = now_.round == 0 || !tile.figures.all_misses;
  if (task.first || plan_.wants) return task;
  const PixelBox watched = PatchPlace::grown(tile.box, plan_.overlap_x, plan_.overlap_y);
  std::vector<Miss> misses;
  for (const std::size_t k : tiles_in(watched)) {
    if (tiles_[k].figures.wrong() == 0) continue;
    for (const Miss& miss : misses_of(tiles_[k].figures)) {
      // Of features only those that are wrong ask: what their ends lack is seldom to be had.
      if (PatchPlace::holds(watched, {miss.x, miss.y}) && (miss.wrong || miss.excess > 0)) {
        misses.push_back(miss);
      }
    }
  }
  task.requests = requests_of(plan_, misses, tile.urgency);
  return task;
}

std::vector<std::size_t> CoupledCorrection::seen_from(
    const std::vector<std::size_t>& changed) const {
  std::vector<std::uint8_t> marks(tiles_.size(), 0);
  for (const std::size_t i : changed) {
    for (const std::size_t k : tiles_in(PatchPlace::grown(
             tiles_[i].box, plan_.reach_x + plan_.halo_x, plan_.reach_y + plan_.halo_y))) {
      marks[k] = 1;
    }
  }
  std::vector<std::size_t> seen;
  for (std::size_t k = 0; k < marks.size(); ++k) {
    if (marks[k]) seen.push_back(k);
  }
  return seen;
}

/// Where columns want their light, after the first round: has columns with wrong voxels want other light. What all
/// tiles wanted before; empty where nothing is changed.
std::vector<KeptTile> CoupledCorrection::want_again_of_columns(
    const std::vector<std::size_t>& which, const ExecutionContext& context) {
  if (!plan_.wants || now_.round == 0) return {};
  std::vector<KeptTile> before;
  before.reserve(tiles_.size());
  for (const Tile& tile : tiles_) before.push_back(tile.wanted);
  parallel_for(context, "round", which.size(), [&](std::size_t i) {
    Tile& tile = tiles_[which[i]];
    std::vector<Pixel> wrong;
    std::vector<std::uint8_t> listed(pixels_of(tile.box), 0);
    for (const Miss& miss : misses_of(tile.figures)) {
      if (!miss.wrong) continue;
      std::uint8_t& is_listed = listed[index_in(tile.box, miss.x, miss.y)];
      if (is_listed == 0) wrong.push_back({miss.x, miss.y});
      is_listed = 1;
    }
    if (wrong.empty()) return;
    PatchSources from = sources_of(tile.box);
    from.columns =
        sources(PatchPlace::grown(tile.box, plan_.reach_x, plan_.reach_y), &Tile::columns);
    tile.wanted = want_again(plan_, tile.box, before[which[i]], wrong, from, *store_);
  });
  return before;
}

bool CoupledCorrection::improve(const ExecutionContext& context) {
  const bool graded = plan_.graded && now_.round == 0 && now_.loss > 0;
  if ((now_.wrong() == 0 && !graded) || now_.round >= options_.rounds ||
      without_gain_ >= kMostWithoutGain) {
    return false;
  }
  std::vector<std::size_t> solved;
  for (std::size_t k = 0; k < tiles_.size(); ++k) {
    if (is_wanted(tiles_[k])) solved.push_back(k);
  }
  if (solved.empty()) return false;
  std::vector<KeptTile> next(solved.size());
  const ExecutionContext quiet = silent(context);
  const std::vector<KeptTile> wanted_before = want_again_of_columns(solved, quiet);
  parallel_for(quiet, "round", solved.size(), [&](std::size_t i) {
    const PatchTask task = task_of(tiles_[solved[i]]);
    const PixelBox watched = PatchPlace::grown(task.box, plan_.overlap_x, plan_.overlap_y);
    if (plan_.wants) {
      PatchSources from = sources_of(watched);
      from.columns = sources(watched, &Tile::wanted);
      next[i] = solve_patch_for_columns(plan_, task, from, *store_);
    } else if (!task.first && task.requests.empty()) {
      next[i] = *task.before;
    } else {
      next[i] = solve_patch(plan_, task, sources_of(watched), *store_);
    }
  });
  std::vector<std::size_t> changed;
  std::vector<KeptTile> before(tiles_.size());  // of tiles that changed
  std::vector<std::uint8_t> differs(tiles_.size(), 0);
  for (std::size_t i = 0; i < solved.size(); ++i) {
    Tile& tile = tiles_[solved[i]];
    if (next[i] == tile.now) {
      tile.urgency *= kMoreUrgent;
      if (tile.urgency > kMostUrgent) tile.urgency = 0;
      continue;
    }
    changed.push_back(solved[i]);
    differs[solved[i]] = 1;
    before[solved[i]] = std::exchange(tile.now, std::move(next[i]));
  }
  const std::vector<std::size_t> seen = seen_from(changed);
  std::vector<Figures> figures(tiles_.size());
  for (const std::size_t k : seen) figures[k] = tiles_[k].figures;
  judge(seen, quiet);
  // Patches that have become worse go back to what they were.
  std::vector<std::size_t> back;
  for (const std::size_t k : changed) {
    Tile& tile = tiles_[k];
    if (!tile.figures.gains_on(figures[k], now_)) {
      tile.now = std::move(before[k]);
      if (!wanted_before.empty()) tile.wanted = wanted_before[k];
      differs[k] = 0;
      tile.urgency *= kLessUrgent;
      back.push_back(k);
    } else if (now_.round > 0) {
      tile.urgency = std::min(kMostUrgent, tile.urgency * kMoreUrgent);
    }
  }
  // Tiles all around which nothing has changed in the end are as wrong as they were.
  std::vector<std::size_t> to_judge;
  for (const std::size_t k : seen_from(back)) {
    const std::vector<std::size_t> around = seen_from({k});
    if (std::any_of(around.begin(), around.end(), [&](std::size_t i) { return differs[i] != 0; })) {
      to_judge.push_back(k);
    } else {
      tiles_[k].figures = figures[k];
    }
  }
  if (!back.empty()) judge(to_judge, quiet);
  ++now_.round;
  now_.patches = solved.size();
  context.report("round", static_cast<double>(now_.round) / options_.rounds);
  if (now_.better_than(best_)) {
    best_ = now_;
    without_gain_ = 0;
    keep_best();
  } else {
    ++without_gain_;
  }
  return true;
}

void CoupledCorrection::keep_best() {
  for (Tile& tile : tiles_) {
    tile.best = tile.now;
    tile.best_figures = tile.figures;
  }
}

void CoupledCorrection::read(const PixelBox& box, const LevelSink& sink) const {
  const std::size_t pixels = pixels_of(box);
  const std::vector<std::size_t> tiles = tiles_in(box);
  std::vector<std::uint8_t> slices(pixels * kPieceSlices);
  for (int first = 0; first < plan_.slices; first += kPieceSlices) {
    const int past = std::min(plan_.slices, first + kPieceSlices);
    std::fill(slices.begin(), slices.end(), std::uint8_t{0});
    for (const std::size_t k : tiles) {
      if (!tiles_[k].best.pieces[static_cast<std::size_t>(first / kPieceSlices)]) continue;
      const PixelBox& of = tiles_[k].box;
      const PixelBox both = common(of, box);
      TileReader reader(tiles_[k].best);
      for (int n = past; n-- > first;) {
        std::uint8_t* const slice = slices.data() + static_cast<std::size_t>(n - first) * pixels;
        const TileReader::Step step = reader.go_to(n);
        if (step == TileReader::Step::whole) {
          copy_common(reader.whole(), of, slice, box);
          continue;
        }
        for (int y = both.y0; y < both.y1; ++y) {
          const std::size_t at = index_in(box, both.x0, y);
          std::copy_n(slice + pixels + at, both.width(), slice + at);
        }
        if (step == TileReader::Step::same) continue;
        for (const NonZero& change : reader.changes()) {
          const Pixel p = pixel_in(of, change.at);
          if (PatchPlace::holds(both, p)) slice[index_in(box, p.x, p.y)] ^= change.value;
        }
      }
    }
    for (int n = first; n < past; ++n) {
      const std::uint8_t* const slice =
          slices.data() + static_cast<std::size_t>(n - first) * pixels;
      sink(n, all_zero(slice, pixels) ? nullptr : slice);
    }
  }
}

std::vector<Miss> CoupledCorrection::wrong_voxels(std::size_t most) const {
  std::vector<Miss> wrong;
  for (const Tile& tile : tiles_) {
    for (const Miss& miss : misses_of(tile.best_figures)) {
      if (wrong.size() == most) return wrong;
      if (miss.wrong) wrong.push_back(miss);
    }
  }
  return wrong;
}

std::size_t CoupledCorrection::bytes() const {
  std::set<const KeptBytes*> held;
  for (const Tile& tile : tiles_) {
    for (const KeptTile* const kept :
         {&tile.coverage, &tile.columns, &tile.now, &tile.best, &tile.left_alone, &tile.heights}) {
      for (const Kept& piece : kept->pieces) held.insert(piece.get());
    }
    held.insert(tile.figures.misses.get());
    held.insert(tile.best_figures.misses.get());
  }
  held.erase(nullptr);
  std::size_t sum = 0;
  for (const KeptBytes* const kept : held) sum += kept->size();
  return sum;
}

}  // namespace slicecorr::detail
