// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "correct/coupled_patch.hpp"
#include "correct/inhibited_column.hpp"

namespace slicecorr::detail {

namespace {

/// Bytes of all slices of some pixels of a box, pixel by pixel.
class ByColumn {
 public:
  /// `wanted`: of each pixel of `box`, not 0 where its bytes are kept.
  ByColumn(const PatchPlace& place, const PixelBox& box,
           const std::vector<PatchBytes::Source>& sources, std::vector<std::uint8_t> wanted,
           int slices)
      : box_(box), slices_(static_cast<std::size_t>(slices)), at_(pixels_of(box), kNone) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < at_.size(); ++i) {
      if (wanted[i] != 0) at_[i] = count++;
    }
    bytes_.resize(count * slices_);
    PatchBytes bytes(place, box, sources);
    // A byte stands from the slice at which it came down to the one after which another comes.
    std::vector<int> since(count, slices);
    const auto fill = [&](std::size_t i, std::uint8_t byte, int to) {
      if (i == kNone) return;
      if (byte != 0) std::fill(column(i) + to, column(i) + since[i], byte);
      since[i] = to;
    };
    for (int n = slices; n-- > 0;) {
      bytes.go_to(n, [&](std::size_t at, std::uint8_t was, std::uint8_t) {
        const Pixel p = place.pixel(at);
        if (PatchPlace::holds(box_, p)) fill(at_[index_in(box_, p)], was, n + 1);
      });
    }
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) {
        fill(at_[index_in(box, {x, y})], bytes[place.at(x, y)], 0);
      }
    }
  }
  const std::uint8_t* of(const Pixel& p) const {
    return bytes_.data() + at_[index_in(box_, p)] * slices_;
  }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  std::uint8_t* column(std::size_t i) { return bytes_.data() + i * slices_; }

  PixelBox box_;
  std::size_t slices_;
  std::vector<std::size_t> at_;
  std::vector<std::uint8_t> bytes_;
};

/// Solves columns of a patch again.
class WantedLight {
 public:
  WantedLight(const CoupledPlan& plan, const PixelBox& box, const PatchSources& sources,
              const std::vector<Pixel>& wrong)
      : plan_(plan),
        wants_(*plan.wants),
        wrong_(wrong),
        place_(plan, box),
        shown_(PatchPlace::common(place_.shown, plan.display)),
        runs_(pixels_of(box)),
        levels_(place_, shown_, sources.levels, lit_around(), plan.slices),
        alone_(place_, shown_, sources.columns, lit_around(), plan.slices),
        column_(wants_.solver()),
        share_(intensity_shares(plan, place_, shown_)),
        light_(static_cast<std::size_t>(plan.slices)),
        bright_(light_.size()) {
    read_design(box, sources);
    read_doses(box);
  }

  /// Calls `sink` with each pixel and the levels that its column wants.
  template <class Sink>
  void solve(const PixelBox& box, const Sink& sink) {
    std::vector<std::uint8_t> levels(light_.size());
    for (const Pixel& p : wrong_) {
      if (runs_[index_in(box, p)].empty()) continue;
      const InhibitedPlan* const own = plan_.own_plan(p);
      find_bounds(p, own ? share_at(p) : 1);
      want_doses(p, runs_[index_in(box, p)]);
      ColumnSolver& column = own ? solver_of(*own) : *column_;
      const std::vector<Level>& wanted = column.solve(runs_[index_in(box, p)], bounds_);
      for (std::size_t n = 0; n < levels.size(); ++n) {
        levels[n] = wanted[n] <= bounds_.floors[n]
                        ? std::uint8_t{0}
                        : (own ? wanted[n] : own_level(p, static_cast<int>(n), wanted[n]));
      }
      sink(p, levels);
    }
  }

 private:
  std::vector<std::uint8_t> lit_around() const {
    std::vector<std::uint8_t> marks(pixels_of(shown_), 0);
    for (const Pixel& p : wrong_) {
      around(p, [&](const Pixel& q, double) { marks[index_in(shown_, q)] = 1; });
    }
    return marks;
  }

  /// Of columns whose UV light is their place's.
  ColumnSolver& solver_of(const InhibitedPlan& plan) {
    std::unique_ptr<ColumnSolver>& made = own_[&plan];
    if (!made) made = std::make_unique<InhibitedColumn>(plan);
    return *made;
  }
  double share_at(const Pixel& p) const { return share_.empty() ? 1 : share_[place_.at(p.x, p.y)]; }
  /// The least level of a pixel that has at least the light of `level` where all light comes.
  std::uint8_t own_level(const Pixel& p, int n, Level level) const {
    const double share = share_at(p);
    if (share_.empty() || !(share > 0)) return level;
    const auto end = wants_.light.begin() + wants_.cap_of(n);
    const auto least = std::lower_bound(wants_.light.begin(), end, wants_.light[level] / share);
    return static_cast<std::uint8_t>(least - wants_.light.begin());
  }
  /// Calls `visit` with each pixel that shines on `p`, and its weight there.
  template <class Visit>
  void around(const Pixel& p, const Visit& visit) const {
    for (int y = p.y - plan_.reach_y; y <= p.y + plan_.reach_y; ++y) {
      for (int x = p.x - plan_.reach_x; x <= p.x + plan_.reach_x; ++x) {
        if (!PatchPlace::holds(shown_, {x, y})) continue;
        visit(Pixel{x, y},
              plan_.taps[static_cast<std::size_t>((p.y - y + plan_.reach_y) * plan_.taps_width +
                                                  p.x - x + plan_.reach_x)]);
      }
    }
  }

  /// Runs of covered layers, first layer first.
  void read_design(const PixelBox& box, const PatchSources& sources) {
    PatchBytes coverage(place_, box, sources.coverage), heights(place_, box, sources.heights);
    const auto turn = [&](std::size_t at, std::uint8_t was, std::uint8_t is, int node) {
      std::vector<CoverageRun>& runs = runs_[index_in(box, place_.pixel(at))];
      const std::uint8_t height = taken_height(wants_.facts, heights[at]);
      if (was != 0) {
        runs.back().first = node;
        runs.back().upper_height = height;
      }
      if (is == 0) return;
      CoverageRun run;
      run.end = node;
      run.coverage = is;
      // Layer by layer, lower edges lie at the window.
      run.lower_height = plan_.layerwise ? std::uint8_t{0} : height;
      runs.push_back(run);
    };
    for (int n = plan_.slices; n-- > 0;) {
      // `heights` are still those of node n + 1.
      coverage.go_to(
          n, [&](std::size_t at, std::uint8_t was, std::uint8_t is) { turn(at, was, is, n + 1); });
      heights.go_to(n, [](std::size_t, std::uint8_t, std::uint8_t) {});
    }
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) {
        const std::size_t at = place_.at(x, y);
        turn(at, coverage[at], 0, 0);
        std::vector<CoverageRun>& runs = runs_[index_in(box, {x, y})];
        std::reverse(runs.begin(), runs.end());
      }
    }
  }

  /// Doses that wrong columns want, as bytes of all layers.
  void read_doses(const PixelBox& box) {
    if (!plan_.doses) return;
    const PixelBox band = PatchPlace::common(box, plan_.display);
    for (const Pixel& p : wrong_) {
      doses_[{p.x, p.y}].resize(static_cast<std::size_t>(plan_.layers), 0);
    }
    plan_.doses->images->read_band(band, [&](int n, const std::uint8_t* rows) {
      if (!rows || n >= plan_.layers) return;
      for (auto& [place, bytes] : doses_) {
        if (!PatchPlace::holds(band, {place.first, place.second})) continue;
        bytes[static_cast<std::size_t>(n)] = rows[index_in(band, {place.first, place.second})];
      }
    });
  }
  void want_doses(const Pixel& p, const std::vector<CoverageRun>& runs) {
    bounds_.wanted.clear();
    if (!plan_.doses) return;
    const DoseScale& scale = plan_.doses->scale;
    const std::vector<std::uint8_t>& bytes = doses_.at({p.x, p.y});
    bounds_.side = scale.side;
    std::vector<double> wanted(bytes.size(), 1.0);
    bool any = false;
    for (const CoverageRun& run : runs) {
      if (run.coverage != 255) continue;
      for (auto n = static_cast<std::size_t>(run.first);
           n < std::min(bytes.size(), static_cast<std::size_t>(run.end)); ++n) {
        wanted[n] = scale.dose[bytes[n]];
        any = any || wanted[n] > 1;
      }
    }
    // Nothing more than enough: as without.
    if (any) bounds_.wanted = std::move(wanted);
  }

  /// Where the column wants light itself, its neighbours make room for it, and those that want light,
  /// too, can shine as bright as they can. What is shone into its dark slices stays.
  /// `unit`: the share of light that the levels of the column's plan stand for.
  void find_bounds(const Pixel& p, double unit) {
    const std::size_t slices = bright_.size();
    std::fill(light_.begin(), light_.end(), 0.0);
    std::fill(bright_.begin(), bright_.end(), 0.0);
    around(p, [&](const Pixel& from, double weight) {
      const std::uint8_t *const shown = levels_.of(from), *const alone = alone_.of(from);
      const bool own = from.x == p.x && from.y == p.y;
      const double share = weight * share_at(from);
      for (std::size_t n = 0; n < slices; ++n) {
        const double light = share * wants_.light[own ? 0 : shown[n]];
        light_[n] += light;
        bright_[n] += own || alone[n] != 0 ? share * brightest(n) : light;
      }
    });
    const std::uint8_t* const alone = alone_.of(p);
    bounds_.floors.resize(slices);
    bounds_.caps.resize(slices);
    for (std::size_t n = 0; n < slices; ++n) {
      bounds_.floors[n] = static_cast<Level>(alone[n] == 0 ? wants_.level_of(light_[n] / unit) : 0);
      const int cap = wants_.cap_of(static_cast<int>(n));
      bounds_.caps[n] = std::max(
          bounds_.floors[n], static_cast<Level>(std::min(cap, wants_.level_of(bright_[n] / unit))));
    }
  }
  double brightest(std::size_t n) const {
    return wants_.light[static_cast<std::size_t>(wants_.cap_of(static_cast<int>(n)))];
  }

  const CoupledPlan& plan_;
  const CoupledColumns& wants_;
  const std::vector<Pixel>& wrong_;
  PatchPlace place_;
  PixelBox shown_;  ///< what shines on the patch
  std::vector<std::vector<CoverageRun>> runs_;
  ByColumn levels_, alone_;
  std::unique_ptr<ColumnSolver> column_;
  std::map<const InhibitedPlan*, std::unique_ptr<ColumnSolver>> own_;
  ColumnBounds bounds_;
  std::map<std::pair<int, int>, std::vector<std::uint8_t>> doses_;  ///< by pixel of a wrong column
  std::vector<double> share_;  ///< of intensity; empty where light is even
  /// By slice: of a column's neighbours and its own black, and the most that can be.
  std::vector<double> light_, bright_;
};

}  // namespace

KeptTile want_again(const CoupledPlan& plan, const PixelBox& box, const KeptTile& wanted,
                    const std::vector<Pixel>& wrong, const PatchSources& sources,
                    BlobStore& store) {
  std::vector<std::vector<std::uint8_t>> again(pixels_of(box));
  WantedLight(plan, box, sources, wrong)
      .solve(box, [&](const Pixel& p, const std::vector<std::uint8_t>& levels) {
        again[index_in(box, p)] = levels;
      });
  const PatchPlace place(plan, box);
  PatchBytes before(place, box, {{&wanted, box}});
  TileWriter writer(store, pixels_of(box), plan.slices, TileWriter::From::last, &wanted);
  std::vector<std::uint8_t> rows(pixels_of(box));
  for (int n = plan.slices; n-- > 0;) {
    before.go_to(n, [&](std::size_t at, std::uint8_t, std::uint8_t is) {
      rows[index_in(box, place.pixel(at))] = is;
    });
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (!again[i].empty()) rows[i] = again[i][static_cast<std::size_t>(n)];
    }
    writer.put(rows.data());
  }
  return writer.finish();
}

}  // namespace slicecorr::detail
