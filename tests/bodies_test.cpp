// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies, cavities and cups of small grids against a flood fill of every moment of the print, which
/// shares no code with the library; and shapes whose answers are known.
#include "slicecorr/bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <random>
#include <tuple>
#include <vector>

#include "bodies/kept_voxels.hpp"
#include "bodies_grid.hpp"
#include "memory_slices.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

/// Voxels with a ring of empty ones around, filled from one to the next.
class Flood {
 public:
  explicit Flood(const MemorySlices& slices)
      : width_(slices.grid().width_px + 2),
        height_(slices.grid().height_px + 2),
        layers_(slices.grid().layers),
        solid_(static_cast<std::size_t>(width_ * height_ * layers_), false) {
    for (int n = 0; n < layers_; ++n) {
      for (int y = 0; y + 2 < height_; ++y) {
        for (int x = 0; x + 2 < width_; ++x) {
          solid_[index(n, x + 1, y + 1)] = slices.at(n, x, y) >= 128;
        }
      }
    }
  }
  /// With slices after its own until each voxel gels.
  Flood(const MemorySlices& slices, const MemorySlices& delays) : Flood(slices) {
    delays_ = &delays;
  }

  /// A body of voxels of one kind, of those that are there when some slice is done.
  struct Part {
    std::vector<std::array<int, 3>> voxels;  ///< slice, row, column, sorted
    bool beside = false;                     ///< has voxels of the ring
    int first() const { return voxels.front()[0]; }
    std::size_t in(int slice) const {
      return static_cast<std::size_t>(std::count_if(
          voxels.begin(), voxels.end(), [slice](const auto& v) { return v[0] == slice; }));
    }
    bool has(const std::array<int, 3>& v) const {
      return std::binary_search(voxels.begin(), voxels.end(), v);
    }
    /// What it is known by.
    std::array<int, 3> name() const { return voxels.front(); }
    double mean(std::size_t axis) const {
      double sum = 0;
      for (const auto& v : voxels) sum += v[axis] + 0.5;
      return sum / static_cast<double>(voxels.size());
    }
  };
  std::vector<Part> parts(bool solid, int last) const {
    std::vector<Part> found;
    std::vector<bool> seen(solid_.size(), false);
    for (int n = 0; n <= last; ++n) {
      for (int y = 0; y < height_; ++y) {
        for (int x = 0; x < width_; ++x) {
          if (seen[index(n, x, y)] || !is(solid, last, n, x, y)) continue;
          found.push_back(fill(solid, last, n, x, y, seen));
        }
      }
    }
    return found;
  }
  int layers() const { return layers_; }

 private:
  /// Voids are those of the end.
  bool is(bool solid, int last, int n, int x, int y) const {
    if (solid_[index(n, x, y)] != solid) return false;
    return !solid || !delays_ || n + delays_->at(n, x - 1, y - 1) <= last;
  }
  std::size_t index(int n, int x, int y) const {
    return static_cast<std::size_t>((n * height_ + y) * width_ + x);
  }
  Part fill(bool solid, int last, int n0, int x0, int y0, std::vector<bool>& seen) const {
    Part part;
    std::vector<std::array<int, 3>> todo{{n0, y0, x0}};
    seen[index(n0, x0, y0)] = true;
    while (!todo.empty()) {
      const auto [n, y, x] = todo.back();
      todo.pop_back();
      part.beside |= x == 0 || y == 0 || x + 1 == width_ || y + 1 == height_;
      part.voxels.push_back({n, y - 1, x - 1});
      const int steps[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
      for (const auto& step : steps) {
        const int m = n + step[0], v = y + step[1], u = x + step[2];
        if (m < 0 || m > last || v < 0 || v >= height_ || u < 0 || u >= width_) continue;
        if (seen[index(m, u, v)] || !is(solid, last, m, u, v)) continue;
        seen[index(m, u, v)] = true;
        todo.push_back({m, v, u});
      }
    }
    std::sort(part.voxels.begin(), part.voxels.end());
    return part;
  }
  int width_, height_, layers_;
  std::vector<bool> solid_;
  const MemorySlices* delays_ = nullptr;  ///< null: all gel in their own slices
};

using Tuple = std::tuple<int, int, int, int, std::uint64_t, int, int>;  // of whole numbers, sorted

struct Expected {
  std::vector<Tuple> islands, sealed, cups;
  std::map<Tuple, std::pair<double, double>> middles;  ///< of islands: column and row
  std::uint64_t on_platform = 0, loose = 0, sealed_voxels = 0;
};

void look_at_solids(const Flood& flood, Expected& e) {
  /// An island as it was before it joined another; or as it is, when it has not.
  struct Told {
    std::array<int, 3> low;
    std::size_t voxels;
    double column, row;
  };
  struct Open {
    int first;  ///< slice at hand when it began
    Flood::Part part;
    std::vector<Told> joined;
  };
  const auto told = [](const Flood::Part& part) {
    return Told{part.name(), part.voxels.size(), part.mean(2), part.mean(1)};
  };
  const auto tell = [&](const Told& t, int until) {
    e.islands.emplace_back(t.low[0], until, t.low[1], t.low[2], t.voxels, 0, 0);
    e.middles[e.islands.back()] = {t.column, t.row};
  };
  std::vector<Open> open;
  for (int n = 0; n < flood.layers(); ++n) {
    std::vector<Open> next;
    for (const Flood::Part& part : flood.parts(true, n)) {
      std::vector<const Open*> in;
      for (const Open& o : open) {
        if (part.has(o.part.name())) in.push_back(&o);
      }
      if (part.first() == 0) {
        for (const Open* o : in) {
          tell(told(o->part), n);
          for (const Told& t : o->joined) tell(t, n);
        }
        continue;
      }
      Open now{n, part, {}};
      if (!in.empty()) {
        std::sort(in.begin(), in.end(), [](const Open* a, const Open* b) {
          return std::pair(a->first, a->part.name()) < std::pair(b->first, b->part.name());
        });
        now.first = in.front()->first;
        for (const Open* o : in) {
          now.joined.insert(now.joined.end(), o->joined.begin(), o->joined.end());
          if (o != in.front()) now.joined.push_back(told(o->part));
        }
      }
      next.push_back(now);
    }
    open = std::move(next);
  }
  for (const Open& o : open) {
    tell(told(o.part), -1);
    for (const Told& t : o.joined) tell(t, -1);
  }
  e.loose = open.size();
  e.on_platform = flood.parts(true, flood.layers() - 1).size() - open.size();
}

void look_at_voids(const Flood& flood, Expected& e) {
  struct Pull {
    std::array<int, 3> name;
    std::size_t widest;
    int widest_slice;
  };
  std::vector<Pull> pulling;
  const auto tell = [&](const Pull& p, CupEnd end, int past) {
    e.cups.emplace_back(p.name[0], past, p.name[1], p.name[2], p.widest, p.widest_slice,
                        static_cast<int>(end));
  };
  for (int n = 0; n < flood.layers(); ++n) {
    std::vector<Pull> next;
    for (const Flood::Part& part : flood.parts(false, n)) {
      std::vector<Pull> joined;
      for (const Pull& p : pulling) {
        if (part.has(p.name)) joined.push_back(p);
      }
      if (part.beside) {
        for (const Pull& p : joined) tell(p, CupEnd::opened, n);
        continue;
      }
      const std::size_t open = part.in(n);
      if (open == 0) {
        if (joined.empty()) continue;  // closed long ago
        tell(joined.front(), CupEnd::closed, n);
        if (part.first() > 0) {
          e.sealed.emplace_back(part.first(), n, part.name()[1], part.name()[2], part.voxels.size(),
                                0, 0);
          e.sealed_voxels += part.voxels.size();
        }
        continue;
      }
      Pull p{part.name(), open, n};
      for (const Pull& j : joined) {
        if (j.widest > p.widest || (j.widest == p.widest && j.widest_slice < p.widest_slice)) {
          p.widest = j.widest;
          p.widest_slice = j.widest_slice;
        }
      }
      next.push_back(p);
    }
    pulling = std::move(next);
  }
  for (const Pull& p : pulling) tell(p, CupEnd::print_ends, flood.layers());
  // What opens because nothing is printed any more is no hole in a wall.
  const auto solid = flood.parts(true, flood.layers() - 1);
  int past = 0;
  for (const auto& part : solid) past = std::max(past, part.voxels.back()[0] + 1);
  for (Tuple& cup : e.cups) {
    int& end = std::get<6>(cup);
    if (std::get<1>(cup) == past && end == static_cast<int>(CupEnd::opened)) {
      end = static_cast<int>(CupEnd::print_ends);
    }
  }
}

Expected expected_of(const Flood& flood) {
  Expected e;
  look_at_solids(flood, e);
  look_at_voids(flood, e);
  for (auto* list : {&e.islands, &e.sealed, &e.cups}) std::sort(list->begin(), list->end());
  return e;
}

void expect_same(const Bodies& b, const Expected& e) {
  std::vector<Tuple> islands, sealed, cups;
  for (const Island& i : b.islands) {
    islands.emplace_back(i.first, i.until, i.y, i.x, i.voxels, 0, 0);
    const auto middle = e.middles.find(islands.back());
    ASSERT_NE(middle, e.middles.end());
    EXPECT_NEAR(i.column, middle->second.first, 1e-9);
    EXPECT_NEAR(i.row, middle->second.second, 1e-9);
  }
  for (const SealedCavity& c : b.sealed_cavities) {
    sealed.emplace_back(c.first, c.past, c.y, c.x, c.voxels, 0, 0);
  }
  for (const Cup& c : b.cups) {
    cups.emplace_back(c.first, c.past, c.y, c.x, c.opening, c.widest, static_cast<int>(c.end));
  }
  for (auto* list : {&islands, &sealed, &cups}) std::sort(list->begin(), list->end());
  EXPECT_EQ(islands, e.islands);
  EXPECT_EQ(sealed, e.sealed);
  EXPECT_EQ(cups, e.cups);
  EXPECT_EQ(b.islands_in_all, e.islands.size());
  EXPECT_EQ(b.sealed_in_all, e.sealed.size());
  EXPECT_EQ(b.cups_in_all, e.cups.size());
  EXPECT_EQ(b.on_platform, e.on_platform);
  EXPECT_EQ(b.loose_bodies, e.loose);
  EXPECT_EQ(b.sealed_voxels, e.sealed_voxels);
}

Expected expected_of(const MemorySlices& slices) { return expected_of(Flood(slices)); }

/// Voxels lit with a probability; patches that stay from slice to slice with another.
MemorySlices random_slices(std::mt19937& random, int most_x = 9, int most_layers = 8) {
  const auto number = [&](int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random);
  };
  MemorySlices slices(grid_of(number(1, most_x), number(1, 7), number(1, most_layers)));
  const Grid& g = slices.grid();
  const int density = number(10, 95), stays = number(0, 90);
  for (int n = 0; n < g.layers; ++n) {
    for (int y = 0; y < g.height_px; ++y) {
      for (int x = 0; x < g.width_px; ++x) {
        const bool again = n > 0 && number(0, 99) < stays;
        const int lit = number(128, 255), dark = number(0, 127);
        slices.at(n, x, y) = again                     ? slices.at(n - 1, x, y)
                             : number(0, 99) < density ? static_cast<std::uint8_t>(lit)
                                                       : static_cast<std::uint8_t>(dark);
      }
    }
  }
  return slices;
}

/// The same by hand, rows in any order, whole or by what changes, rows that stay left out or not.
Bodies tracked(const MemorySlices& slices, std::mt19937& random) {
  const Grid& g = slices.grid();
  const PixelBox box{0, 0, g.width_px, g.height_px};
  BodyTracker tracker(box, g, slices.frame());
  std::vector<int> rows(static_cast<std::size_t>(g.height_px));
  std::iota(rows.begin(), rows.end(), 0);
  const auto runs_of = [&](auto solid) {
    std::vector<BodyTracker::Run> runs;
    for (int x = 0; x < g.width_px; ++x) {
      if (!solid(x)) continue;
      if (!runs.empty() && runs.back().end == x) {
        ++runs.back().end;
      } else {
        runs.push_back({x, x + 1});
      }
    }
    return runs;
  };
  for (int n = 0; n < g.layers; ++n) {
    std::shuffle(rows.begin(), rows.end(), random);
    for (const int y : rows) {
      const auto lit = [&](int slice, int x) {
        return slice >= 0 && slices.at(slice, x, y) >= 128;
      };
      const auto flips = runs_of([&](int x) { return lit(n, x) != lit(n - 1, x); });
      if (flips.empty() && random() % 2 == 0) continue;
      if (random() % 2 == 0) {
        tracker.flip_row(y, flips);
      } else {
        tracker.set_row(y, runs_of([&](int x) { return lit(n, x); }));
      }
    }
    tracker.end_slice();
  }
  return tracker.finish();
}

TEST(Bodies, AreThoseOfAFloodFillAtEveryMoment) {
  std::mt19937 random(58);
  std::uint64_t islands = 0, joined = 0, sealed = 0, cups = 0;
  for (int round = 0; round < rounds(1500); ++round) {
    SCOPED_TRACE(round);
    const MemorySlices slices = random_slices(random);
    const Expected expected = expected_of(slices);
    expect_same(find_bodies(slices), expected);
    expect_same(tracked(slices, random), expected);
    if (HasFailure()) return;
    islands += expected.islands.size();
    for (const Tuple& i : expected.islands) joined += std::get<1>(i) >= 0;
    sealed += expected.sealed.size();
    cups += expected.cups.size();
  }
  // The random ones are of every kind.
  EXPECT_GT(islands, 1000U);
  EXPECT_GT(joined, 200U);
  EXPECT_GT(sealed, 100U);
  EXPECT_GT(cups, 500U);
}

/// Delays that are alike in patches; all has gelled when the last slice is done.
MemorySlices random_delays(const MemorySlices& slices, std::mt19937& random) {
  const auto number = [&](int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random);
  };
  MemorySlices delays(slices.grid());
  const Grid& g = slices.grid();
  const int stays = number(0, 95), most = number(0, 5);
  for (int n = 0; n < g.layers; ++n) {
    for (int y = 0; y < g.height_px; ++y) {
      for (int x = 0; x < g.width_px; ++x) {
        const bool again = n > 0 && number(0, 99) < stays;
        const int delay = again ? delays.at(n - 1, x, y) : number(0, most);
        delays.at(n, x, y) = static_cast<std::uint8_t>(std::min(delay, g.layers - 1 - n));
      }
    }
  }
  return delays;
}

/// Until the end of the step in which voxels gel, or of the last slice.
MemorySlices in_steps(const MemorySlices& delays, int step) {
  MemorySlices found = delays;
  const Grid& g = delays.grid();
  for (int n = 0; n < g.layers; ++n) {
    for (int y = 0; y < g.height_px; ++y) {
      for (int x = 0; x < g.width_px; ++x) {
        const int gels = (n + delays.at(n, x, y)) / step * step + step - 1;
        found.at(n, x, y) = static_cast<std::uint8_t>(std::min(gels, g.layers - 1) - n);
      }
    }
  }
  return found;
}

TEST(Bodies, InTimeAreThoseOfAFloodFillAtEveryMoment) {
  std::mt19937 random(62);
  std::uint64_t islands = 0, joined = 0, late = 0;
  for (int round = 0; round < rounds(1500); ++round) {
    SCOPED_TRACE(round);
    const MemorySlices slices = random_slices(random);
    const MemorySlices delays = random_delays(slices, random);
    const Grid& g = slices.grid();
    const int step = 1 << random() % 3;
    const MemorySlices looked = in_steps(delays, step);
    const Expected expected = expected_of(Flood(slices, looked));
    BodyAsk ask{true, 0, step};
    ask.strip_rows = static_cast<int>(random() % 4);
    BodyTracker whole({0, 0, g.width_px, g.height_px}, g, slices.frame(), ask),
        by_changes({0, 0, g.width_px, g.height_px}, g, slices.frame(), ask);
    const auto runs_of = [&](auto delay_at) {
      std::vector<BodyTracker::Run> runs;
      for (int x = 0; x < g.width_px; ++x) {
        const int delay = delay_at(x);
        if (delay < 0) continue;
        if (!runs.empty() && runs.back().end == x && runs.back().delay == delay) {
          ++runs.back().end;
        } else {
          runs.push_back({x, x + 1, delay});
        }
      }
      return runs;
    };
    struct Said {
      int slice = 0, delay = 0;
      bool at_once = false;
    };
    std::vector<Said> said_of(static_cast<std::size_t>(g.width_px * g.height_px));
    for (int n = 0; n < g.layers; ++n) {
      for (int y = 0; y < g.height_px; ++y) {
        const auto at = [&](int slice, int x) {
          return slice < 0 || slices.at(slice, x, y) < 128 ? -1 : delays.at(slice, x, y);
        };
        whole.set_row(y, runs_of([&](int x) { return at(n, x); }));
        // What changes alone: voxels, and delays that do not go on as they were said to. What is empty may be
        // told anything.
        std::vector<BodyTracker::Run> flips, timed;
        for (int x = 0; x < g.width_px; ++x) {
          const int now = at(n, x), before = at(n - 1, x);
          if ((now < 0) != (before < 0)) flips.push_back({x, x + 1});
          Said& said = said_of[static_cast<std::size_t>(y * g.width_px + x)];
          if (now < 0 || before < 0) said = {};
          const int expected_delay = said.at_once ? said.delay - (n - said.slice) : said.delay;
          const bool needless = random() % 8 == 0;
          if (now < 0 ? !needless : now == expected_delay && !needless) continue;
          said = {n, now < 0 ? 0 : now, random() % 2 == 0};
          timed.push_back(
              {x, x + 1, now < 0 ? static_cast<int>(random() % 5) : said.delay, said.at_once});
        }
        if (!flips.empty()) by_changes.flip_row(y, flips);
        if (!timed.empty()) by_changes.set_delays(y, timed);
      }
      whole.end_slice();
      by_changes.end_slice();
    }
    const Bodies found = whole.finish();
    expect_same(found, expected);
    expect_same(by_changes.finish(), expected);
    if (HasFailure()) return;
    islands += expected.islands.size();
    for (const Tuple& i : expected.islands) joined += std::get<1>(i) >= 0;
    late += expected.islands != expected_of(slices).islands;
  }
  EXPECT_GT(islands, 1000U);
  EXPECT_GT(joined, 200U);
  EXPECT_GT(late, 200U);  // rounds in which delays matter
}

/// What is kept of bands, as predictions tell it, which may be as low as a row.
Bodies kept(const MemorySlices& slices, const MemorySlices& delays, int step,
            std::mt19937& random) {
  const Grid& g = slices.grid();
  std::vector<PixelBox> bands;
  for (int y = 0; y < g.height_px;) {
    const int end = std::min(g.height_px, y + 1 + static_cast<int>(random() % 3));
    bands.push_back({0, y, g.width_px, end});
    y = end;
  }
  const ExecutionContext context;
  detail::KeptVoxels voxels(bands, g.layers, context);
  detail::KeptVoxels::Stream changes, moments;
  for (const PixelBox& band : bands) {
    const auto columns = static_cast<std::size_t>(g.width_px * band.height());
    detail::VoxelChanges flips(columns);
    detail::MomentChanges told;
    for (std::size_t column = 0; column < columns; ++column) {
      const int x = static_cast<int>(column) % g.width_px;
      const int y = band.y0 + static_cast<int>(column) / g.width_px;
      bool before = false;
      for (int n = 0; n < g.layers; ++n) {
        const bool now = slices.at(n, x, y) >= 128;
        if (now != before) flips.flip(n, column);
        if (now) told.add(n, column, delays.at(n, x, y), random() % 2 == 0);
        before = now;
      }
    }
    changes.push_back(voxels.keep(flips.code(g.layers)));
    moments.push_back(voxels.keep(told.code(g.layers), true));
  }
  return voxels.follow({changes, nullptr, &moments}, g, slices.frame(), {true, 0, step});
}

TEST(Bodies, OfKeptBandsAreThoseOfAFloodFillAtEveryMoment) {
  std::mt19937 random(63);
  std::uint64_t islands = 0, bands = 0;
  for (int round = 0; round < rounds(150); ++round) {
    SCOPED_TRACE(round);
    const MemorySlices slices = random_slices(random, 3, 75);
    const MemorySlices delays = random_delays(slices, random);
    const int step = 1 << random() % 3;
    const Expected expected = expected_of(Flood(slices, in_steps(delays, step)));
    if (std::max(expected.islands.size(), expected.cups.size()) > Bodies::kMost) continue;
    expect_same(kept(slices, delays, step, random), expected);
    if (HasFailure()) return;
    islands += expected.islands.size();
    bands += slices.grid().height_px > 3;
  }
  EXPECT_GT(islands, 1000U);
  EXPECT_GT(bands, 20U);  // rounds in which there are more than one
}

TEST(Bodies, TheSameForAnyNumberOfThreads) {
  std::mt19937 random(59);
  MemorySlices slices(grid_of(130, 50, 12));
  for (int n = 0; n < 12; ++n) {
    for (int y = 0; y < 50; ++y) {
      for (int x = 0; x < 130; ++x) slices.at(n, x, y) = random() % 100 < 35 ? 255 : 0;
    }
  }
  ExecutionContext one, eight;
  one.threads = 1;
  eight.threads = 8;
  const Bodies a = find_bodies(slices, one), b = find_bodies(slices, eight);
  EXPECT_EQ(a.to_json(), b.to_json());
  // More than are listed, the largest first.
  EXPECT_GT(a.islands_in_all, Bodies::kMost);
  ASSERT_EQ(a.islands.size(), Bodies::kMost);
  EXPECT_TRUE(std::is_sorted(a.islands.begin(), a.islands.end(),
                             [](auto& l, auto& r) { return l.voxels > r.voxels; }));
  const Expected all = expected_of(slices);
  EXPECT_EQ(a.islands_in_all, all.islands.size());
  EXPECT_EQ(a.loose_bodies, all.loose);
  EXPECT_EQ(a.sealed_in_all, all.sealed.size());
  EXPECT_EQ(a.cups_in_all, all.cups.size());
}

TEST(Bodies, ABlockThatFloatsIsToldInMillimetres) {
  MemorySlices slices(grid_of(60, 40, 20));
  fill(slices, {5, 5, 0}, {55, 35, 5});
  fill(slices, {20, 10, 10}, {30, 30, 20});
  const Bodies b = find_bodies(slices);
  EXPECT_EQ(b.loose_bodies, 1U);
  EXPECT_EQ(b.on_platform, 1U);
  const auto j = nlohmann::json::parse(b.to_json());
  ASSERT_EQ(j["islands"].size(), 1U);
  const auto& i = j["islands"][0];
  EXPECT_EQ(i["first_um"], 1000);
  EXPECT_TRUE(i["until_um"].is_null());
  EXPECT_NEAR(i["volume_mm3"].get<double>(), 0.5 * 1 * 1, 1e-12);
  EXPECT_NEAR(i["x_mm"].get<double>(), 25 * 0.05, 1e-12);
  // Row 0 lies at the largest y.
  EXPECT_NEAR(i["y_mm"].get<double>(), 20 * 0.05, 1e-12);
  const auto words = bodies_in_words(b);
  ASSERT_EQ(words.size(), 1U);
  EXPECT_THAT(words[0], HasSubstr("1 body hangs on nothing when it begins: from 1000 um on"));
  EXPECT_THAT(words[0], HasSubstr("never joined"));
}

TEST(Bodies, AnIslandThatIsJoinedLaterSaysUntilWhen) {
  MemorySlices slices(grid_of(60, 40, 20));
  fill(slices, {5, 5, 0}, {10, 35, 20});    // a wall
  fill(slices, {30, 10, 4}, {40, 30, 12});  // begins beside it
  fill(slices, {5, 10, 12}, {40, 30, 20});  // a roof joins both
  const Bodies b = find_bodies(slices);
  EXPECT_EQ(b.loose_bodies, 0U);
  ASSERT_EQ(b.islands.size(), 1U);
  EXPECT_EQ(b.islands[0].first, 4);
  EXPECT_EQ(b.islands[0].until, 12);
  EXPECT_EQ(b.islands[0].voxels, 10U * 20 * 8);
  EXPECT_THAT(bodies_in_words(b).front(), HasSubstr("from 400 um on"));
  EXPECT_THAT(bodies_in_words(b).front(), HasSubstr("until 1200 um"));
}

TEST(Bodies, APlateBehindEmptySlicesHangsOnNothing) {
  MemorySlices slices(grid_of(20, 20, 15));
  fill(slices, {5, 5, 10}, {15, 15, 15});
  const Bodies b = find_bodies(slices);
  EXPECT_EQ(b.on_platform, 0U);
  EXPECT_EQ(b.loose_bodies, 1U);
  ASSERT_EQ(b.islands.size(), 1U);
  EXPECT_EQ(b.islands[0].first, 10);
}

TEST(Bodies, ABlankSliceCutsLooseWhatComesAfterIt) {
  MemorySlices slices(grid_of(20, 20, 15));
  fill(slices, {5, 5, 0}, {15, 15, 15});
  fill(slices, {0, 0, 7}, {20, 20, 8}, 0);
  const Bodies b = find_bodies(slices);
  EXPECT_EQ(b.on_platform, 1U);
  EXPECT_EQ(b.loose_bodies, 1U);
  EXPECT_EQ(b.islands.at(0).first, 8);
}

TEST(Bodies, ASealedBoxKeepsItsResinAndPullsUntilItCloses) {
  MemorySlices slices(grid_of(20, 20, 20));
  fill(slices, {4, 4, 0}, {16, 16, 16});
  fill(slices, {6, 7, 3}, {14, 13, 12}, 0);
  const Bodies b = find_bodies(slices);
  ASSERT_EQ(b.sealed_cavities.size(), 1U);
  EXPECT_EQ(b.sealed_cavities[0], (SealedCavity{3, 12, 8 * 6 * 9, 10, 10, 6, 7}));
  ASSERT_EQ(b.cups.size(), 1U);
  EXPECT_EQ(b.cups[0], (Cup{3, 12, CupEnd::closed, 3, 8 * 6, 10, 10, 6, 7}));
  const auto j = nlohmann::json::parse(b.to_json());
  EXPECT_NEAR(j["sealed_cavities"][0]["volume_mm3"].get<double>(), 8 * 6 * 9 * 0.05 * 0.05 * 0.1,
              1e-12);
  EXPECT_EQ(j["sealed_cavities"][0]["first_um"], 300);
  EXPECT_EQ(j["sealed_cavities"][0]["last_um"], 1200);
  EXPECT_NEAR(j["cups"][0]["area_mm2"].get<double>(), 8 * 6 * 0.05 * 0.05, 1e-12);
  EXPECT_EQ(j["cups"][0]["closes_um"], 1200);
}

TEST(Bodies, CupsOpenTowardsTheWindowOrThePlatform) {
  MemorySlices window(grid_of(20, 20, 20));
  fill(window, {4, 4, 0}, {16, 16, 16});
  fill(window, {6, 7, 3}, {14, 13, 16}, 0);
  Bodies b = find_bodies(window);
  EXPECT_EQ(b.sealed_in_all, 0U);
  ASSERT_EQ(b.cups.size(), 1U);
  EXPECT_EQ(b.cups[0].end, CupEnd::print_ends);  // black slices come after it
  EXPECT_EQ(b.cups[0].past, 16);
  EXPECT_EQ(b.cups[0].opening, 48U);

  // Open to the platform: taken off, it drains.
  MemorySlices platform(grid_of(20, 20, 20));
  fill(platform, {4, 4, 0}, {16, 16, 16});
  fill(platform, {6, 7, 0}, {14, 13, 12}, 0);
  b = find_bodies(platform);
  EXPECT_EQ(b.sealed_in_all, 0U);
  ASSERT_EQ(b.cups.size(), 1U);
  EXPECT_EQ(b.cups[0].end, CupEnd::closed);
  EXPECT_EQ(b.cups[0].past, 12);

  // A hole in the wall lets the resin out from there on; one at the platform makes it no cup at all.
  MemorySlices vented = platform;
  fill(vented, {0, 9, 5}, {8, 10, 6}, 0);
  b = find_bodies(vented);
  ASSERT_EQ(b.cups.size(), 1U);
  EXPECT_EQ(b.cups[0].end, CupEnd::opened);
  EXPECT_EQ(b.cups[0].past, 5);
  fill(vented, {0, 9, 0}, {8, 10, 1}, 0);
  EXPECT_EQ(find_bodies(vented).cups_in_all, 0U);
}

TEST(Bodies, OfNothing) {
  const Bodies b = find_bodies(MemorySlices(grid_of(20, 20, 20)));
  EXPECT_EQ(b.on_platform + b.loose_bodies + b.islands_in_all + b.cups_in_all, 0U);
  EXPECT_TRUE(bodies_in_words(b).empty());
}

TEST(Bodies, WithoutScaleAreCountedAndHaveNoSizes) {
  MemorySlices slices(Grid{20, 20, 15, 0, 0, 0});
  fill(slices, {5, 5, 10}, {15, 15, 15});
  const auto j = nlohmann::json::parse(find_bodies(slices).to_json());
  EXPECT_EQ(j["loose_bodies"], 1);
  EXPECT_TRUE(j["islands"][0]["volume_mm3"].is_null());
  EXPECT_TRUE(j["islands"][0]["first_um"].is_null());
  EXPECT_TRUE(j["islands"][0]["x_mm"].is_null());
  EXPECT_EQ(j["islands"][0]["first_slice"], 10);
}

/// Boxes of whole voxels, some of them cut out again.
MemorySlices random_boxes(std::mt19937& random) {
  MemorySlices slices(grid_of(16, 16, 40));
  const auto number = [&](int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random);
  };
  for (int k = number(3, 14); k-- > 0;) {
    const int x = number(0, 13), y = number(0, 13), n = k < 2 ? 0 : number(0, 36);
    fill(slices, {x, y, n},
         {std::min(16, x + number(1, 9)), std::min(16, y + number(1, 9)),
          std::min(40, n + number(1, 9))},
         number(0, 3) > 0 ? 255 : 0);
  }
  return slices;
}

/// Continuous; in a resin in which light reaches over many slices; layer by layer.
std::array<slicecorr::Setup, 3> ways_to_print() {
  slicecorr::Setup continuous{linear_printer(1, 100), resin(576, 2000), process(1000)};
  continuous.printer.pixel_x_um = continuous.printer.pixel_y_um = kPixelUm;
  slicecorr::Setup clear = continuous, layerwise = continuous;
  clear.resin = resin(100, 6000);
  layerwise.printer = linear_printer(0, 100);
  layerwise.resin = resin(20, 400);
  layerwise.process.mode = ExposureMode::layerwise;
  return {continuous, clear, layerwise};
}

TEST(Bodies, ACorrectionCutsNothingLoose) {
  std::mt19937 random(61);
  auto [continuous, clear, lifted] = ways_to_print();
  lifted.process.exposure_s = 0.6;
  lifted.process.lifts = Lifts::each;
  std::uint64_t islands = 0, judged = 0;
  for (int round = 0; round < rounds(60); ++round) {
    const MemorySlices design = random_boxes(random);
    const Bodies sliced = find_bodies(design);
    if (design.bounds().empty()) continue;
    for (const slicecorr::Setup& setup : {continuous, clear, lifted}) {
      SCOPED_TRACE(testing::Message() << round << " " << static_cast<int>(setup.process.mode));
      const CorrectedSlices corrected(design, setup);
      const Prediction p = verify_stack(corrected, design, setup);
      ASSERT_TRUE(p.bodies);
      EXPECT_EQ(p.bodies->cut_loose(), 0U);
      EXPECT_EQ(p.bodies->joined_in_part(), 0U);
      EXPECT_EQ(p.bodies->designed.loose_bodies, sliced.loose_bodies);
      EXPECT_FALSE(p.bodies->loose_whole);  // nobody looks where the print has no more
      EXPECT_EQ(p.bodies->designed.islands, sliced.islands);
      if (p.cure_through_voxels + p.undercure_voxels == 0) {
        // What a body hangs on may gel later.
        EXPECT_EQ(p.bodies->printed.loose_bodies, sliced.loose_bodies);
        EXPECT_GE(p.bodies->printed.islands_in_all, sliced.loose_bodies);
        EXPECT_EQ(p.bodies->printed.cups, sliced.cups);
        ++judged;
      }
      islands += sliced.islands_in_all;
    }
    if (HasFailure()) return;
  }
  EXPECT_GT(islands, 100U);
  EXPECT_GT(judged, 20U);
}

TEST(Bodies, ANeckOfOneVoxelHoldsHoweverItIsCorrected) {
  auto [continuous, clear, lifted] = ways_to_print();
  lifted.process.exposure_s = 0.6;
  lifted.process.lifts = Lifts::each;
  slicecorr::Setup capped = continuous, early = continuous;
  capped.process.omega_max = 2;
  early.process.overhangs = Overhangs::early;
  for (const int height : {1, 3}) {
    MemorySlices design(grid_of(16, 16, 40));
    fill(design, {2, 2, 0}, {14, 14, 8});
    fill(design, {7, 7, 8}, {8, 8, 8 + height});
    fill(design, {4, 4, 8 + height}, {12, 12, 14});
    fill(design, {8, 9, 14}, {9, 10, 14 + height});
    fill(design, {3, 3, 14 + height}, {13, 13, 40});
    for (const slicecorr::Setup& setup : {continuous, clear, lifted, capped, early}) {
      const CorrectedSlices corrected(design, setup);
      const Prediction p = verify_stack(corrected, design, setup);
      ASSERT_TRUE(p.bodies);
      EXPECT_EQ(p.bodies->designed.loose_bodies, 0U);
      EXPECT_EQ(p.bodies->printed.loose_bodies, 0U) << height;
      EXPECT_EQ(p.bodies->cut_loose(), 0U) << height;
    }
  }
}

/// Slices after its own until the sum of light in the middle of a voxel reaches the dose that gels, slice
/// by slice; prints nothing where it never does.
struct Gelling {
  MemorySlices printed, delays;
  bool close = false;  ///< some sum is nearly that dose: rounding decides
  bool late = false;   ///< something gels after its own slice
};
Gelling gelling_of(const MemorySlices& images, const slicecorr::Setup& setup) {
  const Grid& g = images.grid();
  const CureModel model =
      make_cure_model(setup.printer, setup.resin, setup.process, g.layer_um, {});
  const PixelCurve curve = pixel_curve(model);
  Gelling found{MemorySlices(g), MemorySlices(g)};
  for (int y = 0; y < g.height_px; ++y) {
    for (int x = 0; x < g.width_px; ++x) {
      for (int m = 0; m < g.layers; ++m) {
        double dose = 0;
        for (int n = m; n < g.layers && dose < 1; ++n) {
          // The window passes from n - 1/2 to n + 1/2 slices, or stands half a slice away.
          const double near = std::pow(10.0, -model.eta * std::max(0.0, n - m - 0.5)),
                       far = std::pow(10.0, -model.eta * (n - m + 0.5));
          const double light = model.ratio(n) * curve[images.at(n, x, y)];
          dose += light * (setup.process.mode == ExposureMode::continuous ? near - far : far);
          found.close |= std::abs(dose - 1) < 2e-6;
          if (dose < 1) continue;
          found.printed.at(m, x, y) = 255;
          found.delays.at(m, x, y) = static_cast<std::uint8_t>(n - m);
          found.late |= n > m;
        }
      }
    }
  }
  return found;
}

TEST(Bodies, HangOnWhatHasGelledSoFar) {
  std::mt19937 random(63);
  auto [continuous, clear, standing] = ways_to_print();
  standing.process.exposure_s = 0.3;
  slicecorr::Setup longer = standing;  // first layers
  longer.process.bottom_layers = 3;
  longer.process.bottom_exposure_s = 0.9;
  std::uint64_t islands = 0, late = 0, in_time = 0, stepped = 0;
  for (int round = 0; round < rounds(10); ++round) {
    MemorySlices images = random_boxes(random);
    for (int n = 0; n < images.grid().layers; ++n) {
      const int grey = random() % 3 == 0 ? static_cast<int>(random() % 256) : 255;
      for (int y = 0; y < 16; ++y) {
        for (int x = 0; x < 16; ++x) {
          images.at(n, x, y) = static_cast<std::uint8_t>(images.at(n, x, y) * grey / 255);
        }
      }
    }
    if (images.bounds().empty()) continue;
    for (const slicecorr::Setup& setup : {continuous, clear, standing, longer}) {
      SCOPED_TRACE(testing::Message() << round << " " << setup.process.exposure_s);
      const Gelling gelling = gelling_of(images, setup);
      if (gelling.close) continue;
      const Prediction p = verify_stack(images, images, setup);
      ASSERT_TRUE(p.bodies);
      EXPECT_TRUE(p.bodies->printed.in_time);
      // It is looked at ends of steps alone.
      const int step = p.bodies->printed.time_step;
      stepped += step > 1;
      const MemorySlices delays = in_steps(gelling.delays, step);
      const Expected expected = expected_of(Flood(gelling.printed, delays));
      expect_same(p.bodies->printed, expected);
      islands += expected.islands.size();
      late += gelling.late;
      in_time += expected.islands != expected_of(gelling.printed).islands;
    }
    if (HasFailure()) return;
  }
  EXPECT_GT(islands, 20U);
  EXPECT_GT(late, 10U);
  EXPECT_GT(in_time, 2U);
  EXPECT_GT(stepped, 5U);
}

}  // namespace
}  // namespace slicecorr::test
