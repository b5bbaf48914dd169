#include "correct/coupled.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "parallel/silent.hpp"

namespace slicecorr::detail {

namespace {

/// How much more is asked for than would do if every slice gave it: many can't, being dark or bright
/// already. Patches that gain ask for more each time, up to a limit; others for less, until they are
/// given up.
constexpr double kUrgency = 4, kMoreUrgent = 1.4, kLessUrgent = 0.4, kMostUrgent = 32,
                 kLeastUrgent = 0.3;
/// By this factor the loss of a patch may rise where fewer voxels are wrong.
constexpr double kMostLossRise = 2;

/// Misses that are kept with their places: of all patches together some 80 MB.
constexpr std::size_t kMostMisses = 4000000, kLeastMisses = 2000, kMostOfPatch = 50000;
/// Rounds without gain after which nothing is expected any more.
constexpr int kMostWithoutGain = 5;

PixelBox common(const PixelBox& a, const PixelBox& b) { return PatchPlace::common(a, b); }

std::size_t pixels_of(const PixelBox& box) {
  return static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
}

/// Copies what two boxes have in common from one field of bytes to the other.
void copy_common(const std::uint8_t* from, const PixelBox& from_box, std::uint8_t* to,
                 const PixelBox& to_box) {
  const PixelBox both = common(from_box, to_box);
  if (both.empty()) return;
  for (int y = both.y0; y < both.y1; ++y) {
    const auto at = [&](const PixelBox& box) {
      return static_cast<std::size_t>(y - box.y0) * static_cast<std::size_t>(box.width()) +
             static_cast<std::size_t>(both.x0 - box.x0);
    };
    std::copy_n(from + at(from_box), both.width(), to + at(to_box));
  }
}

}  // namespace

struct CoupledCorrection::Tile {
  PixelBox box;
  Band coverage, columns, now, best;
  PatchFigures figures, best_figures;  ///< of `now` and of `best`
  double urgency = kUrgency;
};

namespace {

/// Fewer wrong voxels or a smaller loss: some voxels that are wrong by little may be the way to none.
bool gains(const PatchFigures& now, const PatchFigures& before) {
  return now.loss < before.loss ||
         (now.wrong() < before.wrong() && now.loss <= kMostLossRise * before.loss);
}

}  // namespace

CoupledCorrection::CoupledCorrection(const CorrectionPlan& columns, const LightBlur& blur,
                                     const SliceScatter& scatter, const PixelBox& bounds,
                                     const PixelBox& display, const CoupledOptions& options)
    : plan_(columns, blur, scatter, display, options.margin),
      options_(options),
      bounds_(common(bounds, display)),
      box_(common(
          PatchPlace::grown(bounds_, plan_.reach_x + plan_.halo_x, plan_.reach_y + plan_.halo_y),
          display)) {
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

void CoupledCorrection::solve_columns(const DesignReader& read, const ExecutionContext& context) {
  if (tiles_.empty()) return;
  const auto across = static_cast<std::size_t>(across_);
  parallel_for(context, "columns", tiles_.size() / across, [&](std::size_t row) {
    Tile* const tiles = tiles_.data() + row * across;
    const PixelBox rows = common({box_.x0, tiles->box.y0, box_.x1, tiles->box.y1}, bounds_);
    std::vector<CodedBand> coverage, levels;
    for (std::size_t k = 0; k < across; ++k) {
      coverage.emplace_back(pixels_of(tiles[k].box));
      levels.emplace_back(pixels_of(tiles[k].box));
    }
    std::vector<std::uint8_t> part;
    const auto append = [&](const std::uint8_t* bytes, std::vector<CodedBand>& bands) {
      for (std::size_t k = 0; k < across; ++k) {
        if (!bytes) {
          bands[k].append(nullptr);
          continue;
        }
        part.assign(pixels_of(tiles[k].box), 0);
        copy_common(bytes, rows, part.data(), tiles[k].box);
        bands[k].append(part.data());
      }
    };
    if (!rows.empty()) {
      BandCorrector corrector(plan_.columns, pixels_of(rows));
      read(rows, [&](int layer, const std::uint8_t* cover, const std::uint8_t* heights) {
        if ((layer & 63) == 0) context.check_cancelled();
        corrector.add_layer(cover, heights);
        if (layer < plan_.layers) append(cover, coverage);
      });
      corrector.solve([&](int n, const std::uint8_t* its_levels, const std::uint8_t*, bool dark) {
        if ((n & 63) == 0) context.check_cancelled();
        append(dark ? nullptr : its_levels, levels);
      });
    }
    for (std::size_t k = 0; k < across; ++k) {
      coverage[k].trim();
      levels[k].trim();
      tiles[k].coverage = std::make_shared<const CodedBand>(std::move(coverage[k]));
      tiles[k].columns = tiles[k].now = tiles[k].best =
          std::make_shared<const CodedBand>(std::move(levels[k]));
    }
  });
  std::vector<std::size_t> all;
  for (std::size_t k = 0; k < tiles_.size(); ++k) all.push_back(k);
  judge(all, context);
  first_ = best_ = now_;
  keep_best();
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
                                                           Band Tile::*which) const {
  std::vector<PatchBytes::Source> found;
  for (const std::size_t k : tiles_in(box)) {
    found.push_back({(tiles_[k].*which).get(), tiles_[k].box});
  }
  return found;
}

PatchSources CoupledCorrection::sources_of(const PixelBox& watched) const {
  const PixelBox shown = PatchPlace::grown(watched, plan_.reach_x, plan_.reach_y);
  return {sources(watched, &Tile::coverage), sources(shown, &Tile::now),
          sources(watched, &Tile::columns)};
}

void CoupledCorrection::judge(const std::vector<std::size_t>& which,
                              const ExecutionContext& context) {
  parallel_for(context, "judge", which.size(), [&](std::size_t i) {
    Tile& tile = tiles_[which[i]];
    tile.figures = judge_patch(plan_, tile.box,
                               sources_of(PatchPlace::grown(tile.box, plan_.halo_x, plan_.halo_y)),
                               std::clamp(kMostMisses / tiles_.size(), kLeastMisses, kMostOfPatch));
  });
  now_.through = now_.under = 0;
  now_.loss = 0;
  for (const Tile& tile : tiles_) {
    now_.through += tile.figures.through;
    now_.under += tile.figures.under;
    now_.loss += tile.figures.loss;
  }
}

std::optional<PatchTask> CoupledCorrection::task_of(const Tile& tile) const {
  const PixelBox watched = PatchPlace::grown(tile.box, plan_.overlap_x, plan_.overlap_y);
  if (common(watched, bounds_).empty() || tile.urgency < kLeastUrgent) return std::nullopt;
  PatchTask task;
  task.box = tile.box;
  task.before = tile.now.get();
  task.free = bounds_;
  // Where too much is wrong to be mended voxel by voxel, it is as in the first round.
  task.first = now_.round == 0 || !tile.figures.all_misses;
  bool wrong = false;
  std::vector<Miss> misses;
  for (const std::size_t k : tiles_in(watched)) {
    const PatchFigures& figures = tiles_[k].figures;
    if (task.first) wrong = wrong || figures.loss > 0 || figures.wrong() > 0;
    if (task.first || figures.wrong() == 0 || !figures.misses) continue;
    for (const Miss& miss : *figures.misses) {
      if (PatchPlace::holds(watched, {miss.x, miss.y})) misses.push_back(miss);
    }
    wrong = wrong || !misses.empty();
  }
  if (!wrong) return std::nullopt;
  if (!task.first) {
    task.requests = requests_of(plan_, misses, tile.urgency);
  }
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

bool CoupledCorrection::improve(const ExecutionContext& context) {
  if (now_.wrong() == 0 || now_.round >= options_.rounds || without_gain_ >= kMostWithoutGain) {
    return false;
  }
  std::vector<std::size_t> solved;
  std::vector<PatchTask> tasks;
  for (std::size_t k = 0; k < tiles_.size(); ++k) {
    if (auto task = task_of(tiles_[k])) {
      solved.push_back(k);
      tasks.push_back(std::move(*task));
    }
  }
  if (solved.empty()) return false;
  std::vector<Band> next(solved.size());
  const ExecutionContext quiet = silent(context);
  parallel_for(quiet, "round", solved.size(), [&](std::size_t i) {
    const PixelBox watched = PatchPlace::grown(tasks[i].box, plan_.overlap_x, plan_.overlap_y);
    next[i] = std::make_shared<const CodedBand>(solve_patch(plan_, tasks[i], sources_of(watched)));
  });
  std::vector<std::size_t> changed;
  std::vector<Band> before(tiles_.size());  // of tiles that changed
  for (std::size_t i = 0; i < solved.size(); ++i) {
    Tile& tile = tiles_[solved[i]];
    if (next[i]->code() == tile.now->code() && next[i]->ends() == tile.now->ends()) {
      tile.urgency *= kMoreUrgent;
      if (tile.urgency > kMostUrgent) tile.urgency = 0;
      continue;
    }
    changed.push_back(solved[i]);
    before[solved[i]] = std::exchange(tile.now, std::move(next[i]));
  }
  const std::vector<std::size_t> seen = seen_from(changed);
  std::vector<PatchFigures> figures(tiles_.size());
  for (const std::size_t k : seen) figures[k] = tiles_[k].figures;
  judge(seen, quiet);
  // Patches that have become worse go back to what they were.
  std::vector<std::size_t> back;
  for (const std::size_t k : changed) {
    Tile& tile = tiles_[k];
    if (!gains(tile.figures, figures[k])) {
      tile.now = std::move(before[k]);
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
    if (std::any_of(around.begin(), around.end(),
                    [&](std::size_t i) { return before[i] != nullptr; })) {
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

void CoupledCorrection::read(int slice, const PixelBox& box, std::uint8_t* levels) const {
  std::fill_n(levels, pixels_of(box), std::uint8_t{0});
  std::vector<std::uint8_t> part;
  for (const std::size_t k : tiles_in(box)) {
    const Tile& tile = tiles_[k];
    part.resize(pixels_of(tile.box));
    tile.best->read(plan_.slices - 1 - slice, part.data());
    copy_common(part.data(), tile.box, levels, box);
  }
}

CodedBand CoupledCorrection::levels_of(const PixelBox& box) const {
  CodedBand band(pixels_of(box));
  const PatchPlace place(plan_, box);
  PatchBytes bytes(place, box, sources(box, &Tile::best));
  std::vector<std::uint8_t> rows(pixels_of(box), 0);
  for (int index = 0; index < plan_.slices; ++index) {
    bool changed = index == 0;
    bytes.go_to(index, [&](std::size_t, std::uint8_t, std::uint8_t) { changed = true; });
    if (!changed) {
      band.append_again();
      continue;
    }
    for (int y = box.y0; y < box.y1; ++y) {
      std::copy_n(bytes.data() + place.at(box.x0, y), box.width(),
                  rows.data() + pixels_of({box.x0, box.y0, box.x1, y}));
    }
    band.append(rows.data());
  }
  return band;
}

std::vector<Miss> CoupledCorrection::wrong_voxels(std::size_t most) const {
  std::vector<Miss> wrong;
  for (const Tile& tile : tiles_) {
    if (!tile.best_figures.misses) continue;
    for (const Miss& miss : *tile.best_figures.misses) {
      if (wrong.size() == most) return wrong;
      if (miss.wrong) wrong.push_back(miss);
    }
  }
  return wrong;
}

std::size_t CoupledCorrection::bytes() const {
  std::size_t sum = 0;
  for (const Tile& tile : tiles_) {
    const Band bands[] = {tile.coverage, tile.columns, tile.now, tile.best};
    for (std::size_t k = 0; k < std::size(bands); ++k) {
      const auto* const before = bands + k;
      if (*before && std::find(bands, before, *before) == before) sum += (*before)->bytes();
    }
    const auto &misses = tile.figures.misses, &of_best = tile.best_figures.misses;
    if (misses) sum += misses->size() * sizeof(Miss);
    if (of_best && of_best != misses) sum += of_best->size() * sizeof(Miss);
  }
  return sum;
}

}  // namespace slicecorr::detail
