// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "even/kept_images.hpp"

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>

#include "bands/bands.hpp"
#include "bands/correct_group.hpp"

namespace slicecorr::detail {

KeptImages::KeptImages(const SliceSource& target, const std::vector<int>& whole,
                       const std::vector<PixelBox>& bands)
    : target_(target), whole_(static_cast<std::size_t>(target.grid().layers), 0) {
  for (const int n : whole) {
    if (n < target.grid().layers) whole_[static_cast<std::size_t>(n)] = 1;
  }
  for (const PixelBox& box : bands) {
    bands_.push_back({box, CodedBand(columns_of(box)), std::vector<std::uint8_t>(columns_of(box))});
  }
}

void KeptImages::put(std::size_t band, int slice, const std::uint8_t* pixels) {
  if (slice >= target_.grid().layers) return;
  Band& b = bands_[band];
  if (pixels && !whole_[static_cast<std::size_t>(slice)]) {
    std::transform(pixels, pixels + b.room.size(), b.room.begin(),
                   [](std::uint8_t p) { return static_cast<std::uint8_t>(p != 0); });
    pixels = b.room.data();
  }
  b.upwards.append(pixels);
  if (slice == 0) b.upwards.trim();
}

void KeptImages::read_band(const PixelBox& box, const Sink& sink) const {
  std::vector<const Band*> within;
  std::size_t most = 0;
  for (const Band& b : bands_) {
    const bool apart = b.box.y1 <= box.y0 || b.box.y0 >= box.y1;
    if (apart) continue;
    within.push_back(&b);
    most = std::max(most, columns_of(b.box));
  }
  const auto width = static_cast<std::size_t>(box.width());
  std::vector<std::uint8_t> rows(columns_of(box)), band(most);
  const int layers = target_.grid().layers;
  for (int n = 0; n < layers; ++n) {
    bool black = true;
    std::fill(rows.begin(), rows.end(), std::uint8_t{0});
    for (const Band* b : within) {
      const int at = layers - 1 - n;
      if (b->upwards.black(at)) continue;
      black = false;
      b->upwards.read(at, band.data());
      const int x0 = std::max(box.x0, b->box.x0), x1 = std::min(box.x1, b->box.x1);
      for (int y = std::max(box.y0, b->box.y0); y < std::min(box.y1, b->box.y1) && x0 < x1; ++y) {
        const auto from =
            static_cast<std::size_t>(y - b->box.y0) * static_cast<std::size_t>(b->box.width()) +
            static_cast<std::size_t>(x0 - b->box.x0);
        const std::size_t to =
            static_cast<std::size_t>(y - box.y0) * width + static_cast<std::size_t>(x0 - box.x0);
        std::copy_n(&band[from], x1 - x0, &rows[to]);
      }
    }
    sink(n, black ? nullptr : rows.data());
  }
}

namespace {

/// A target of which one column in so many across and down is left.
class SomeColumns final : public SliceSource {
 public:
  SomeColumns(const SliceSource& whole, int every) : whole_(whole), every_(every) {
    if (whole.edge_heights())
      heights_ = std::make_unique<SomeColumns>(*whole.edge_heights(), every);
    if (whole.left_alone()) left_alone_ = std::make_unique<SomeColumns>(*whole.left_alone(), every);
  }
  const Grid& grid() const override { return whole_.grid(); }
  PixelBox bounds() const override { return whole_.bounds(); }
  ImageFrame frame() const override { return whole_.frame(); }
  LayerHeights heights() const override { return whole_.heights(); }
  const SliceSource* edge_heights() const override { return heights_.get(); }
  const SliceSource* left_alone() const override { return left_alone_.get(); }
  bool ends_below_last_node() const override { return whole_.ends_below_last_node(); }
  const DoseTarget* doses() const override { return whole_.doses(); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    std::vector<std::uint8_t> some(columns_of(band), 0);
    const int y0 = (band.y0 + every_ - 1) / every_ * every_;
    const int x0 = (band.x0 + every_ - 1) / every_ * every_;
    whole_.read_band(band, [&](int n, const std::uint8_t* rows) {
      if (!rows) return sink(n, nullptr);
      for (int y = y0; y < band.y1; y += every_) {
        const std::size_t row =
            static_cast<std::size_t>(y - band.y0) * static_cast<std::size_t>(band.width());
        for (int x = x0; x < band.x1; x += every_) {
          const std::size_t at = row + static_cast<std::size_t>(x - band.x0);
          some[at] = rows[at];
        }
      }
      sink(n, some.data());
    });
  }

 private:
  const SliceSource& whole_;
  int every_;
  std::unique_ptr<SomeColumns> heights_, left_alone_;
};

/// Corrects band by band. `put`: where pixels go, by band; `left`: counts what is left unprinted, or null.
void correct_bands(
    const SliceSource& target, const PlacePlans& plans, const std::vector<PixelBox>& bands,
    const std::function<void(std::size_t band, int slice, const std::uint8_t* pixels)>& put,
    Undercured* left, const ExecutionContext& context) {
  std::atomic<std::uint64_t> voxels{0}, of{0};
  parallel_for(context, "try the light", bands.size(), [&](std::size_t i) {
    const PutRows put_band = [&](int n, const std::uint8_t* pixels) { put(i, n, pixels); };
    if (!left) return correct_band(target, plans, bands[i], put_band, context);
    DesignBand(target, plans.models().map(), bands[i])
        .each(
            plans.all_layers(),
            [&](const DesignGroup& group, const PutRows& put_rows) {
              BandPredictor after(plans.plan(group.value).model, plans.models().curve(group.value),
                                  plans.all_layers(), group.columns);
              correct_group(plans, group, {.put = put_rows, .after = &after}, context);
              const Prediction here = after.finish(group.place);
              voxels += here.undercure_voxels;
              of += here.target_voxels;
            },
            put_band);
  });
  if (left) *left = {voxels, of};
}

KeptImages images_of(const SliceSource& target, const PlacePlans& plans,
                     const std::vector<int>& whole, Undercured* left,
                     const ExecutionContext& context) {
  const auto bands = bands_of(target.grid(), target.bounds());
  KeptImages images(target, whole, bands);
  correct_bands(
      target, plans, bands,
      [&](std::size_t i, int n, const std::uint8_t* pixels) { images.put(i, n, pixels); }, left,
      context);
  return images;
}

}  // namespace

KeptImages solved_images(const SliceSource& target, const Setup& setup,
                         const std::vector<int>& whole, Undercured* left,
                         const ExecutionContext& context) {
  return images_of(target, PlacePlans(target, setup, context), whole, left, context);
}

KeptImages nearly_solved_images(const SliceSource& target, const Setup& setup,
                                const std::vector<int>& whole, const ExecutionContext& context) {
  PlacePlans plans(target, setup, context);
  plans.keep_as_planned();
  return images_of(target, plans, whole, nullptr, context);
}

Undercured undercured_by(const SliceSource& target, const Setup& setup, int every,
                         const ExecutionContext& context) {
  const SomeColumns some(target, every);
  Undercured left;
  correct_bands(
      some, PlacePlans(some, setup, context), bands_of(target.grid(), target.bounds()),
      [](std::size_t, int, const std::uint8_t*) {}, &left, context);
  return left;
}

}  // namespace slicecorr::detail
