// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light and doses of a patch, a box of pixels through all slices, from the last slice to the first
/// while levels change from slice to slice.
///
/// Nothing is blurred anew where nothing changes: each pixel whose level changes adds its weights to
/// the light around it. Doses are stepped by squares of `kSquare` pixels; a square may fall asleep
/// when its light stays as it is and its doses can't come to matter, and is brought up to date in
/// one step when light around it changes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <memory>
#include <optional>
#include <vector>

#include "correct/coupled_kernels.hpp"
#include "correct/coupled_plan.hpp"
#include "correct/kept_tile.hpp"

namespace slicecorr::detail {

inline std::size_t pixels_of(const PixelBox& box) {
  return static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
}
/// Where a pixel is among those of a box, row by row.
inline std::size_t index_in(const PixelBox& box, int x, int y) {
  return static_cast<std::size_t>(y - box.y0) * static_cast<std::size_t>(box.width()) +
         static_cast<std::size_t>(x - box.x0);
}
inline std::size_t index_in(const PixelBox& box, const Pixel& p) { return index_in(box, p.x, p.y); }

/// Where the pixels of a patch are in its arrays: those `watched`, around them those that shine on
/// them (`shown`), and room for weights around these.
struct PatchPlace {
  PatchPlace(const CoupledPlan& plan, const PixelBox& watched_box)
      : watched(watched_box), shown(grown(watched_box, plan.reach_x, plan.reach_y)) {
    const auto rounded = [](int n) {
      return static_cast<std::size_t>((n + kSquare - 1) / kSquare * kSquare);
    };
    origin = {shown.x0 - plan.reach_x, shown.y0 - plan.reach_y};
    stride = rounded(shown.width() + 2 * plan.reach_x + kTapLanes);
    rows = rounded(shown.height() + 2 * plan.reach_y);
  }
  static PixelBox grown(const PixelBox& box, int x, int y) {
    return {box.x0 - x, box.y0 - y, box.x1 + x, box.y1 + y};
  }
  static PixelBox common(const PixelBox& a, const PixelBox& b) {
    return {std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1), std::min(a.y1, b.y1)};
  }
  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y - origin.y) * stride + static_cast<std::size_t>(x - origin.x);
  }
  Pixel pixel(std::size_t at) const {
    return {origin.x + static_cast<int>(at % stride), origin.y + static_cast<int>(at / stride)};
  }
  std::size_t size() const { return stride * rows; }
  static bool holds(const PixelBox& box, const Pixel& p) {
    return p.x >= box.x0 && p.x < box.x1 && p.y >= box.y0 && p.y < box.y1;
  }

  PixelBox watched, shown;
  Pixel origin{};
  std::size_t stride = 0, rows = 0;
};

/// Shares of intensity that the pixels of a box get, in the arrays of a patch, 1 elsewhere; empty where
/// light is even.
inline std::vector<double> intensity_shares(const CoupledPlan& plan, const PatchPlace& place,
                                            const PixelBox& lit) {
  std::vector<double> of_pixels;
  if (!plan.shares || lit.empty()) return of_pixels;
  of_pixels.assign(place.size(), 1);
  std::vector<double> shares(pixels_of(lit));
  plan.shares(lit, shares.data());
  std::size_t k = 0;
  for (int y = lit.y0; y < lit.y1; ++y) {
    for (int x = lit.x0; x < lit.x1; ++x, ++k) {
      of_pixels[place.at(x, y)] = plan.m == 1 ? shares[k] : std::pow(shares[k], 1 / plan.m);
    }
  }
  return of_pixels;
}

/// What the pixels of a box of the display get of the plan's UV light; empty where it is even.
inline std::vector<double> uv_shares(const CoupledPlan& plan, const PixelBox& box) {
  std::vector<double> shares;
  if (!plan.uv.shares || box.empty()) return shares;
  shares.resize(pixels_of(box));
  plan.uv.shares(box, shares.data());
  return shares;
}

/// Bytes of a patch, of one slice at a time, from the tiles around it.
class PatchBytes {
 public:
  struct Source {
    const KeptTile* tile;
    PixelBox box;
  };
  PatchBytes(const PatchPlace& place, const PixelBox& box, const std::vector<Source>& sources)
      : place_(place), bytes_(place.size(), 0) {
    for (const Source& s : sources) {
      const PixelBox part = PatchPlace::common(s.box, box);
      const auto row = [&](int y) {
        return static_cast<std::size_t>(std::max(0, y - s.box.y0)) *
               static_cast<std::size_t>(s.box.width());
      };
      readers_.push_back({TileReader(*s.tile, {row(part.y0), row(part.y1)}), s.box, part});
    }
  }

  const std::uint8_t* data() const { return bytes_.data(); }
  std::uint8_t operator[](std::size_t at) const { return bytes_[at]; }

  /// Goes to a slice, from the last ones on; one that there is not is black. Tells of each byte that
  /// is another than before: `changed(at, was, is)`.
  template <class Changed>
  void go_to(int slice, const Changed& changed) {
    for (Reader& r : readers_) {
      switch (r.reader.go_to(slice)) {
        case TileReader::Step::same:
          break;
        case TileReader::Step::changes:
          change(r, changed);
          break;
        case TileReader::Step::whole:
          replace(r, changed);
          break;
      }
    }
  }

 private:
  struct Reader {
    TileReader reader;
    PixelBox box, part;  ///< of the tile, and what of it is in the patch
  };
  template <class Changed>
  void change(const Reader& r, const Changed& changed) {
    const auto width = static_cast<std::size_t>(r.box.width());
    const auto left = static_cast<std::size_t>(r.part.x0 - r.box.x0),
               right = static_cast<std::size_t>(std::max(0, r.part.x1 - r.box.x0));
    // Rows follow each other: no need to divide.
    std::size_t row = static_cast<std::size_t>(r.part.y0 - r.box.y0) * width;
    std::size_t first = place_.at(r.part.x0, r.part.y0);
    for (const NonZero& c : r.reader.changes()) {
      for (; c.at >= row + width; row += width) first += place_.stride;
      const std::size_t x = c.at - row;
      if (x < left || x >= right) continue;
      const std::size_t at = first + (x - left);
      const std::uint8_t old = bytes_[at];
      bytes_[at] ^= c.value;
      changed(at, old, bytes_[at]);
    }
  }
  template <class Changed>
  void replace(const Reader& r, const Changed& changed) {
    for (int y = r.part.y0; y < r.part.y1; ++y) {
      const std::uint8_t* const from =
          r.reader.whole() +
          static_cast<std::size_t>(y - r.box.y0) * static_cast<std::size_t>(r.box.width()) +
          static_cast<std::size_t>(r.part.x0 - r.box.x0);
      const std::size_t at = place_.at(r.part.x0, y);
      const auto count = static_cast<std::size_t>(r.part.width());
      std::uint8_t* const to = bytes_.data() + at;
      for (std::size_t k = 0; k < count; ++k) {
        if (count - k >= 8 && std::memcmp(to + k, from + k, 8) == 0) {
          k += 7;
          continue;
        }
        if (to[k] == from[k]) continue;
        const std::uint8_t old = to[k];
        to[k] = from[k];
        changed(at + k, old, from[k]);
      }
    }
  }
  const PatchPlace& place_;
  std::vector<Reader> readers_;
  std::vector<std::uint8_t> bytes_;
};

template <class Real>
class PatchField {
 public:
  struct Change {
    std::size_t at;
    std::uint8_t level;
  };

  PatchField(const PatchField&) = delete;
  PatchField& operator=(const PatchField&) = delete;
  PatchField(const CoupledPlan& plan, const PixelBox& watched)
      : plan_(plan),
        place_(plan, watched),
        light_(place_.size()),
        shine_(place_.size(), 0),
        dose_(place_.size(), 0),
        seen_(plan.m == 1 && plan.bath == 0 ? 0 : place_.size(), 0),
        scattered_(plan.distances ? place_.size() : 0, 0),
        levels_(place_.size(), 0) {
    const PixelBox lit = PatchPlace::common(place_.shown, plan.display);
    share_ = intensity_shares(plan, place_, lit);
    for (int y = lit.y0; y < lit.y1; ++y) {
      for (int x = lit.x0; x < lit.x1; ++x) {
        shine_[place_.at(x, y)] = shine_of(0, place_.at(x, y));
      }
    }
    blur_all();
    if (plan.distances) sum_by_distance(lit);
    across_ = static_cast<int>(place_.stride) / kSquare;
    const int down = static_cast<int>(place_.rows) / kSquare;
    squares_.resize(static_cast<std::size_t>(across_) * static_cast<std::size_t>(down));
    for (int k = 0; k < static_cast<int>(squares_.size()); ++k) {
      const int x = place_.origin.x + k % across_ * kSquare,
                y = place_.origin.y + k / across_ * kSquare;
      if (PatchPlace::common({x, y, x + kSquare, y + kSquare}, watched).empty()) continue;
      squares_[static_cast<std::size_t>(k)].watched = true;
      watched_.push_back(k);
    }
    kept_.push_back(1);
    for (int k = 0; k < plan.slices; ++k) kept_.push_back(kept_.back() * static_cast<Real>(plan.a));
    const CureModel& model = plan.columns.model;
    for (int n = 0; n <= plan.slices && !model.heights.alike(); ++n)
      depths_.push_back(model.depth(n));
  }

  const PatchPlace& place() const { return place_; }

 protected:
  struct Square {
    bool watched = false, asleep = false;
    int since = 0;       ///< asleep: at this slice it was stepped last
    int touched_at = 0;  ///< slice at which its light changed last
  };

  /// First pixel of a square in the arrays.
  std::size_t first_of(int square) const {
    return static_cast<std::size_t>(square / across_) * kSquare * place_.stride +
           static_cast<std::size_t>(square % across_) * kSquare;
  }
  int square_of(std::size_t at) const {
    return static_cast<int>(at / place_.stride) / kSquare * across_ +
           static_cast<int>(at % place_.stride) / kSquare;
  }
  Square& square(int k) { return squares_[static_cast<std::size_t>(k)]; }
  const std::vector<int>& watched() const { return watched_; }
  /// From now on only these squares and their neighbours are watched, and light around them.
  void watch_around(std::vector<int> squares) {
    std::sort(squares.begin(), squares.end());
    squares.erase(std::unique(squares.begin(), squares.end()), squares.end());
    const auto mark = [&](const std::vector<int>& of, std::vector<std::uint8_t>& marks) {
      const int down = static_cast<int>(squares_.size()) / across_;
      for (const int k : of) {
        for (int y = std::max(0, k / across_ - 1); y <= std::min(down - 1, k / across_ + 1); ++y) {
          for (int x = std::max(0, k % across_ - 1); x <= std::min(across_ - 1, k % across_ + 1);
               ++x) {
            marks[static_cast<std::size_t>(y * across_ + x)] = 1;
          }
        }
      }
    };
    std::vector<std::uint8_t> wanted(squares_.size(), 0);
    mark(squares, wanted);
    watched_.clear();
    for (std::size_t k = 0; k < squares_.size(); ++k) {
      squares_[k].watched = squares_[k].watched && wanted[k];
      if (squares_[k].watched) watched_.push_back(static_cast<int>(k));
    }
    if (plan_.reach_x > kSquare || plan_.reach_y > kSquare) return;
    matters_.assign(squares_.size(), 0);
    mark(watched_, matters_);
  }
  int across() const { return across_; }
  int slice() const { return slice_; }

  /// To be called first for each slice. Scatter takes place here.
  void begin(int slice) {
    if (plan_.bath > 0) pass_bath(slice);
    if (sums_) pass_image(slice);
    slice_ = slice;
    guides_stepped_ = false;
    // From here on each slice has factors of its own.
    if (plan_.mirrored(slice) && !plan_.mirrored(slice + 1)) {
      for (const int k : watched_) rouse(k);
    }
    expose(plan_.ratio(slice));
    if (sums_) take_scattered(sums_->next());
  }
  /// From now on slices are exposed `ratio` times as long as normal ones.
  void expose(double ratio) {
    if (ratio == ratio_) return;
    for (const int k : watched_) wake(k);
    const double more = ratio / ratio_, shines = plan_.m == 1 ? more : std::pow(more, 1 / plan_.m);
    for (auto* field : {&shine_, &light_}) {
      for (Real& v : *field) v *= static_cast<Real>(shines);
    }
    for (Real& v : own_) v *= static_cast<Real>(more);
    ratio_ = ratio;
    scale_ = plan_.m == 1 ? ratio : std::pow(ratio, 1 / plan_.m);
  }
  /// Shows levels in place of those before.
  void show(const std::vector<Change>& changes) {
    if (changes.size() * static_cast<std::size_t>(plan_.taps_width * plan_.taps_rows) >
        12 * place_.size()) {
      for (const Change& c : changes) {
        wake_around(c.at);
        levels_[c.at] = c.level;
        shine_[c.at] = shine_of(c.level, c.at);
      }
      blur_all();
      return;
    }
    for (const Change& c : changes) show(c.at, c.level);
  }
  void show(std::size_t at, std::uint8_t level) {
    levels_[at] = level;
    const Real shine = shine_of(level, at);
    if (shine == shine_[at]) return;
    if (!matters_.empty() && !matters_[static_cast<std::size_t>(square_of(at))]) {
      shine_[at] = shine;
      return;
    }
    wake_around(at);
    shine_more(at, shine - shine_[at]);
    shine_[at] = shine;
  }
  /// The light around a pixel when it shines by `change` more; squares around it must be awake.
  void shine_more(std::size_t at, Real change) {
    const std::size_t first = at - static_cast<std::size_t>(plan_.reach_y) * place_.stride -
                              static_cast<std::size_t>(plan_.reach_x);
    add_taps(light_.data() + first, place_.stride, taps(), plan_.taps_rows, plan_.taps_width,
             change);
  }
  /// Squares, the last ones included.
  struct SquareBox {
    int x0 = 0, y0 = 0, x1 = -1, y1 = -1;
    bool operator==(const SquareBox&) const = default;
  };
  /// Those whose light a pixel reaches.
  SquareBox squares_around(std::size_t at) const {
    const int x = static_cast<int>(at % place_.stride), y = static_cast<int>(at / place_.stride);
    const int last_row = static_cast<int>(place_.rows) / kSquare - 1;
    return {std::max(0, (x - plan_.reach_x) / kSquare), std::max(0, (y - plan_.reach_y) / kSquare),
            std::min(across_ - 1, (x + plan_.reach_x) / kSquare),
            std::min(last_row, (y + plan_.reach_y) / kSquare)};
  }
  void wake_around(std::size_t at) {
    const SquareBox around = squares_around(at);
    for (int j = around.y0; j <= around.y1; ++j) {
      for (int i = around.x0; i <= around.x1; ++i) wake(j * across_ + i);
    }
  }
  /// Wakes a square whose light or aims change.
  void wake(int k) {
    rouse(k);
    square(k).touched_at = slice_;
  }
  /// Brings a square up to date: to the node below the slice, guides to the one above it where they
  /// have been stepped.
  void rouse(int k) {
    Square& s = square(k);
    if (!s.watched || !s.asleep) return;
    s.asleep = false;
    const int steps = s.since - slice_ - 1, guide_steps = steps + (guides_stepped_ ? 1 : 0);
    const std::size_t first = first_of(k);
    const Real* const seen = seen_light(k);
    towards(dose_.data() + first, seen + first, s.since, steps);
    if (!guide_.empty()) towards(guide_.data() + first, own_.data() + first, s.since, guide_steps);
  }
  void sleep(int k) {
    square(k).asleep = true;
    square(k).since = slice_;
  }
  /// Whether doses of squares that are asleep can be told without looking at each slice.
  bool may_sleep() const {
    return scattered_.empty() && plan_.bath == 0 && !plan_.mirrored(slice_);
  }
  /// What of the light of a slice is taken from that of this one, since it leaves the bath, as the dose
  /// takes light.
  Real taken(std::size_t at) const {
    if (!leaving_) return 0;
    const Real far = (*leaving_)[at];
    return static_cast<Real>(plan_.beyond) *
           (plan_.m == 1 ? far : std::pow(std::max(far, Real{0}), static_cast<Real>(plan_.m)));
  }
  /// Light as the dose takes it: raised to m, without what leaves the bath. All of the arrays; what of them is up to date is the
  /// square.
  const Real* seen_light(int k) {
    if (seen_.empty()) return light_.data();
    const std::size_t first = first_of(k);
    for (int y = 0; y < kSquare; ++y) {
      const std::size_t at = first + static_cast<std::size_t>(y) * place_.stride;
      for (std::size_t i = at; i < at + kSquare; ++i) {
        seen_[i] = plan_.m == 1
                       ? light_[i]
                       : std::pow(std::max(light_[i], Real{0}), static_cast<Real>(plan_.m));
      }
      for (std::size_t i = at; leaving_ && i < at + kSquare; ++i) seen_[i] -= taken(i);
    }
    return seen_.data();
  }
  /// What of the doses below reaches the slice.
  const Real* below() const { return scattered_.empty() ? dose_.data() : scattered_.data(); }

  /// What a pixel shines at a level, and its light.
  Real shine_of(std::uint8_t level, std::size_t at) const {
    const double shine = plan_.shine_of[level] * scale_;
    return static_cast<Real>(share_.empty() ? shine : shine * share_[at]);
  }
  Real light_of(std::uint8_t level, std::size_t at) const {
    const double light = plan_.light_of[level] * ratio_;
    if (share_.empty()) return static_cast<Real>(light);
    return static_cast<Real>(light * (plan_.m == 1 ? share_[at] : std::pow(share_[at], plan_.m)));
  }
  /// phi of the level at which a pixel shines so.
  double phi_at(std::size_t at, double shine) const {
    const double light = shine / share_at(at);
    return (plan_.m == 1 ? light : std::pow(light, plan_.m)) / (plan_.unit * ratio_);
  }
  /// Share of the plan's light that a pixel gets, to 1/m; 1 where light is even.
  double share_at(std::size_t at) const { return share_.empty() ? 1 : share_[at]; }

  const CoupledPlan& plan_;
  const PatchPlace place_;
  std::vector<Real> light_;        ///< blurred
  std::vector<Real> shine_;        ///< of the pixels themselves
  std::vector<Real> dose_;         ///< at the node that was come to
  std::vector<Real> guide_, own_;  ///< doses and lights of columns alone; may be empty
  std::vector<Real> seen_, scattered_;
  std::vector<double> share_;  ///< of light, to 1/m; empty where it is even
  std::vector<std::uint8_t> levels_;
  double ratio_ = 1, scale_ = 1;  ///< of the slice's light, and of what shines, to normal ones
  bool guides_stepped_ = false;   ///< guides of squares that are awake are at the node above
  /// Light of the slice that leaves the bath; null: none does.
  std::shared_ptr<const std::vector<Real>> leaving_;

 private:
  const Real* taps() const;
  /// Through so many slices after `since`.
  void towards(Real* field, const Real* goal, int since, int steps) const {
    if (steps <= 0) return;
    const auto from = static_cast<std::size_t>(since), count = static_cast<std::size_t>(steps);
    const Real left =
        depths_.empty()
            ? kept_[count]
            : static_cast<Real>(std::pow(plan_.a, depths_[from] - depths_[from - count]));
    for (int y = 0; y < kSquare; ++y, field += place_.stride, goal += place_.stride) {
      for (int i = 0; i < kSquare; ++i) field[i] = goal[i] + (field[i] - goal[i]) * left;
    }
  }
  /// Keeps the light of the slice before `slice` while it is in the bath, and finds the light that leaves
  /// it.
  void pass_bath(int slice) {
    if (slice + 1 == plan_.slices) return;
    const auto bath = static_cast<std::size_t>(plan_.bath);
    const bool same = !held_.empty() && *held_.front() == light_;
    held_.push_front(same ? held_.front() : std::make_shared<const std::vector<Real>>(light_));
    if (held_.size() > bath) held_.pop_back();
    if (held_.size() == bath) leaving_ = held_.back();
  }
  /// Light of each distance, which shines from the pixels of `lit`.
  void sum_by_distance(const PixelBox& lit) {
    sums_.emplace(
        *plan_.distances,
        DistanceSums::Scene{
            place_.watched, lit, lit, plan_.a, plan_.m, plan_.b,
            [this, lit](const DistanceSums::Image* image, const PixelBox& box, double* light) {
              for (int y = box.y0; y < box.y1; ++y) {
                for (int x = box.x0; x < box.x1; ++x) {
                  const int level = image ? (*image)[index_in(lit, x, y)] : 0;
                  *light++ =
                      plan_.shine_of[static_cast<std::size_t>(level)] * share_at(place_.at(x, y));
                }
              }
            }});
    image_.resize(pixels_of(lit));
    lit_ = lit;
  }
  /// Keeps what the slice before `slice` shows.
  void pass_image(int slice) {
    if (slice + 1 == plan_.slices) return;
    std::size_t k = 0;
    for (int y = lit_.y0; y < lit_.y1; ++y) {
      for (int x = lit_.x0; x < lit_.x1; ++x) image_[k++] = levels_[place_.at(x, y)];
    }
    sums_->add({{std::make_shared<const DistanceSums::Image>(image_), ratio_}});
  }
  void blur_all() {
    const auto width = static_cast<std::size_t>(place_.shown.width());
    std::vector<double> in(width * static_cast<std::size_t>(place_.shown.height())), out(in.size());
    std::size_t k = 0;
    const auto rows = [&](const auto& each) {
      k = 0;
      for (int y = place_.shown.y0; y < place_.shown.y1; ++y) {
        for (int x = place_.shown.x0; x < place_.shown.x1; ++x) each(place_.at(x, y), k++);
      }
    };
    rows([&](std::size_t at, std::size_t i) { in[i] = shine_[at]; });
    plan_.blur.apply(in.data(), place_.shown, out.data(), place_.shown);
    rows([&](std::size_t at, std::size_t i) { light_[at] = static_cast<Real>(out[i]); });
  }
  void take_scattered(const std::vector<double>& watched) {
    std::size_t k = 0;
    for (int y = place_.watched.y0; y < place_.watched.y1; ++y) {
      for (int x = place_.watched.x0; x < place_.watched.x1; ++x) {
        scattered_[place_.at(x, y)] = static_cast<Real>(watched[k++]);
      }
    }
  }

  int slice_ = 0, across_ = 0;
  std::vector<Square> squares_;
  std::vector<int> watched_;
  std::vector<std::uint8_t> matters_;  ///< squares whose light may reach watched ones; empty: all
  std::vector<Real> kept_;             ///< a^k
  std::vector<double> depths_;         ///< of nodes, in layers; empty: layers are alike
  /// Where the bath ends: the light of the slices that are in it, the last one first.
  std::deque<std::shared_ptr<const std::vector<Real>>> held_;
  /// Where light scatters by distance: the light of the slices that have been, and the one that was.
  std::optional<DistanceSums> sums_;
  PixelBox lit_{};
  DistanceSums::Image image_;
};

template <>
inline const float* PatchField<float>::taps() const {
  return plan_.taps_single.data();
}
template <>
inline const double* PatchField<double>::taps() const {
  return plan_.taps.data();
}

}  // namespace slicecorr::detail
