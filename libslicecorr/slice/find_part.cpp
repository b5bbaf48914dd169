// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A part is looked for on coarse cells first (find_part_coarse.cpp). What comes near is followed over cells
// of half the size, down to voxels (find_part_fine.cpp), and judged there by its surface
// (find_part_agreement.cpp).

#include "slicecorr/find_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include "parallel/silent.hpp"
#include "slice/find_part_parts.hpp"
#include "slice/placing.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/plate.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {

using detail::find::Candidate;
using detail::find::common_box;
using detail::find::size_of;
using detail::find::Voxels;

namespace {

/// Of all turns so many places are followed, those with this share of the best score.
constexpr std::size_t kMostPlaces = 256;
constexpr double kCoarseShare = 0.6, kFineShare = 0.75;
/// Where nothing scores as a part does that is there, so few places are followed: on coarse cells, in
/// which thin walls do not line up, and on those of a pixel or two.
constexpr double kLikely = 0.7;
constexpr std::size_t kMostUnlikely = 64, kMostUnlikelyFine = 16;
/// Where so many of the best were not it, the rest is not looked at.
constexpr int kMostMisses = 32;
/// Places that agree so much alike are told by how natural they are: a ball fits in every turn.
constexpr double kAlike = 0.005;

/// Whether more than half of one box is the other's, too.
bool same_place(const PartPlace& a, const PartPlace& b) {
  const PixelBox both = common_box(a.box, b.box);
  const int high = std::min(a.first_slice + a.slices, b.first_slice + b.slices) -
                   std::max(a.first_slice, b.first_slice);
  if (both.empty() || high <= 0) return false;
  const auto volume = [](const PixelBox& box, int slices) {
    return static_cast<double>(box.width()) * box.height() * slices;
  };
  return 2 * volume(both, high) > std::min(volume(a.box, a.slices), volume(b.box, b.slices));
}

/// Quarter turns counter-clockwise, and whether it is mirrored in x before.
struct TurnWords {
  int quarters = 0;
  bool mirrored = false;
};
TurnWords words_of(const Turn& turn) {
  const Turn quarter = turn_from_plate({true, false, false});
  for (const bool mirrored : {false, true}) {
    Turn t{false, mirrored, false};
    for (int quarters = 0; quarters < 4; ++quarters) {
      if (t == turn) return {quarters, mirrored};
      t = t.then(quarter);
    }
  }
  return {};
}

/// As the part lies on the plate, where that is known, else in the images.
Turn on_plate(const Turn& turn, const ImageFrame& frame) {
  return frame.orientation ? turn.then(turn_from_plate(*frame.orientation).inverse()) : turn;
}

/// Of alike places the one with the least is told.
int unlikely(const Turn& turn, const ImageFrame& frame) {
  const TurnWords words = words_of(on_plate(turn, frame));
  return (words.mirrored ? 4 : 0) + (words.quarters == 0 ? 0 : words.quarters == 2 ? 1 : 2);
}

}  // namespace

std::string in_words(const PartPlace& place, const Grid& grid, const ImageFrame& frame) {
  const PlatePlace middle =
      place_on_plate(grid, frame.orientation.value_or(Orientation{}),
                     0.5 * (place.box.x0 + place.box.x1), 0.5 * (place.box.y0 + place.box.y1));
  const TurnWords turn = words_of(on_plate(place.turn, frame));
  std::string text = fmt::format("x {:.2f}, y {:.2f} mm, ", middle.x_mm, middle.y_mm);
  const double above_mm = std::max(0, place.first_slice) * grid.layer_um * 1e-3;
  text += above_mm > 0 ? fmt::format("from {:.3f} mm above the platform on", above_mm)
                       : std::string("on the platform");
  if (turn.mirrored) text += ", mirrored";
  if (turn.quarters) text += fmt::format(", turned by {} degrees", 90 * turn.quarters);
  return text;
}

struct SoughtPart::Impl {
  Grid grid;
  int slices = 0;
  /// The part as it is, and turned by a quarter; null where it does not fit the images so.
  std::array<std::unique_ptr<const MeshSlices>, 2> sliced;

  const MeshSlices* of(const Turn& turn) const { return sliced[turn.swap_axes ? 1 : 0].get(); }
  /// What the images of the quarter turn are turned by beyond it.
  static Turn flips_of(const Turn& turn) {
    if (!turn.swap_axes) return turn;
    const Turn quarter = turn_from_plate({true, false, false});
    return quarter.inverse().then(turn);
  }
  /// Rows of a box inside the part's own, from the corner of its box on.
  void read(const Turn& turn, const PixelBox& box, const SliceSource::Sink& sink) const {
    const MeshSlices& from = *of(turn);
    const Turn flips = flips_of(turn);
    const PixelBox bounds = from.bounds();
    PixelBox there = turned(box, flips, bounds.width(), bounds.height());
    there = {there.x0 + bounds.x0, there.y0 + bounds.y0, there.x1 + bounds.x0,
             there.y1 + bounds.y0};
    const std::size_t width = size_of(box.width()), height = size_of(box.height());
    std::vector<std::uint8_t> out(width * height);
    from.read_band(there, [&](int n, const std::uint8_t* rows) {
      if (!rows || flips.is_identity()) return sink(n, rows);
      for (std::size_t y = 0; y < height; ++y) {
        const std::uint8_t* row = rows + (flips.flip_y ? height - 1 - y : y) * width;
        if (flips.flip_x) {
          std::reverse_copy(row, row + width, out.data() + y * width);
        } else {
          std::copy_n(row, width, out.data() + y * width);
        }
      }
      sink(n, out.data());
    });
  }
  Voxels voxels(const Turn& turn) const {
    const PixelBox bounds = of(turn)->bounds();
    return {{0, 0, bounds.width(), bounds.height()},
            slices,
            [this, turn](const PixelBox& box, const SliceSource::Sink& sink) {
              read(turn, box, sink);
            }};
  }
};

SoughtPart::SoughtPart(const TriangleMesh& mesh, const Grid& grid,
                       const ExecutionContext& context) {
  auto impl = std::make_unique<Impl>();
  impl->grid = grid;
  Printer images;
  images.name = "the archive";
  images.width_px = grid.width_px;
  images.height_px = grid.height_px;
  images.pixel_x_um = grid.pixel_x_um;
  images.pixel_y_um = grid.pixel_y_um;
  images.travel_mm = 0;
  std::string why;
  for (const int quarters : {0, 1}) {
    ArrangedPart place;
    place.quarters = quarters;
    TriangleMesh turned_mesh = at_place(mesh, place);
    const detail::PartBox box = detail::box_of(turned_mesh, context);
    SliceOptions options;
    options.layer_um = grid.layer_um;
    options.center_mm = {0.5 * box.size(0),
                         grid.height_px * grid.pixel_y_um * 1e-3 - 0.5 * box.size(1)};
    try {
      impl->sliced[size_of(quarters)] = std::make_unique<const MeshSlices>(
          std::move(turned_mesh), images, options, detail::silent(context));
      impl->slices = impl->sliced[size_of(quarters)]->grid().layers;
    } catch (const InputError& e) {
      if (why.empty()) why = e.what();
    }
  }
  if (!impl->sliced[0] && !impl->sliced[1]) throw InputError(why);
  if (impl->slices > grid.layers + 1) {
    throw InputError(
        fmt::format("is {} slices high; the archive has {}", impl->slices, grid.layers));
  }
  impl_ = std::move(impl);
}

SoughtPart::~SoughtPart() = default;
SoughtPart::SoughtPart(SoughtPart&&) noexcept = default;

std::vector<PartPlace> SoughtPart::find(const SliceSource& archive,
                                        const ExecutionContext& context) const {
  const Voxels images{
      archive.bounds(), archive.grid().layers,
      [&](const PixelBox& box, const SliceSource::Sink& sink) { archive.read_band(box, sink); }};
  if (images.valid.empty()) return {};
  std::vector<Turn> turns;
  for (const bool swap : {false, true}) {
    if (!impl_->sliced[swap ? 1 : 0]) continue;
    for (const bool flip_x : {false, true}) {
      for (const bool flip_y : {false, true}) turns.push_back({swap, flip_x, flip_y});
    }
  }
  std::vector<Candidate> places;
  int size = 1, high = 1;
  {
    const detail::find::Coarse coarse = detail::find::coarse_of(images, context);
    size = coarse.at.size;
    high = coarse.at.high;
    for (std::size_t t = 0; t < turns.size(); ++t) {
      context.check_cancelled();
      const auto more = detail::find::coarse_places(coarse, impl_->voxels(turns[t]), t, context);
      places.insert(places.end(), more.begin(), more.end());
    }
  }
  const auto keep = [&](double share) {
    double best = 0;
    for (const Candidate& place : places) best = std::max(best, place.score);
    std::erase_if(places, [&](const Candidate& place) {
      return !(place.score > 0) || place.score < share * best;
    });
    std::stable_sort(places.begin(), places.end(),
                     [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
    std::size_t most = kMostPlaces;
    if (best < kLikely) most = size > 2 ? kMostUnlikely : kMostUnlikelyFine;
    if (places.size() > most) places.resize(most);
  };
  keep(kCoarseShare);
  while (size > 1 || high > 1) {
    size = std::max(1, size / 2);
    high = std::max(1, high / 2);
    const detail::find::AllCells all = detail::find::all_cells(images, size, high, context);
    for (std::size_t t = 0; t < turns.size(); ++t) {
      std::vector<Candidate*> its;
      for (Candidate& place : places) {
        if (place.turn == t) its.push_back(&place);
      }
      if (!its.empty()) detail::find::refine(images, all, impl_->voxels(turns[t]), its, context);
    }
    keep(kFineShare);
  }
  std::vector<PartPlace> found;
  int misses = 0;
  for (const Candidate& c : places) {
    if (misses > kMostMisses) break;
    context.check_cancelled();
    const Voxels part = impl_->voxels(turns[c.turn]);
    PartPlace place;
    place.turn = turns[c.turn];
    place.box = {c.x, c.y, c.x + part.valid.width(), c.y + part.valid.height()};
    place.first_slice = c.z;
    place.slices = impl_->slices;
    place.agreement = detail::find::agreement_of(images, part, c, context);
    misses += place.agreement < kLeastAgreement;
    found.push_back(place);
  }
  std::stable_sort(found.begin(), found.end(), [](const PartPlace& a, const PartPlace& b) {
    return a.agreement > b.agreement;
  });
  std::vector<PartPlace> kept;
  const ImageFrame frame = archive.frame();
  for (const PartPlace& place : found) {
    const auto same = std::find_if(kept.begin(), kept.end(),
                                   [&](const PartPlace& k) { return same_place(k, place); });
    if (same == kept.end()) {
      if (kept.empty() || place.agreement >= kLeastAgreement) kept.push_back(place);
    } else if (place.agreement >= same->agreement - kAlike &&
               unlikely(place.turn, frame) < unlikely(same->turn, frame)) {
      *same = place;
    }
  }
  return kept;
}

void SoughtPart::read_band(const PartPlace& place, const PixelBox& band,
                           const SliceSource::Sink& sink) const {
  const PixelBox inside = common_box(band, place.box);
  const std::size_t width = size_of(band.width());
  std::vector<std::uint8_t> out(width * size_of(band.height()));
  if (inside.empty()) {
    for (int n = 0; n < place.slices; ++n) sink(n, nullptr);
    return;
  }
  const PixelBox own{inside.x0 - place.box.x0, inside.y0 - place.box.y0, inside.x1 - place.box.x0,
                     inside.y1 - place.box.y0};
  impl_->read(place.turn, own, [&](int n, const std::uint8_t* rows) {
    if (!rows) return sink(n, nullptr);
    for (int y = inside.y0; y < inside.y1; ++y) {
      std::copy_n(rows + size_of(y - inside.y0) * size_of(inside.width()), size_of(inside.width()),
                  out.data() + size_of(y - band.y0) * width + size_of(inside.x0 - band.x0));
    }
    sink(n, out.data());
  });
}

}  // namespace slicecorr
