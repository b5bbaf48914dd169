// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/left_alone.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "bands/bands.hpp"
#include "bands/design_band.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

bool is_left_alone(std::uint8_t covered, std::uint8_t of_target) {
  return covered > 0 && 2 * covered >= of_target;
}

void check_like(const SliceSource& target, const LeftAlone& left) {
  const Grid &wanted = target.grid(), &given = left.slices->grid();
  const auto fail = [&](const std::string& what) {
    throw InputError(left.name, "",
                     fmt::format("{}; what is left alone must fit the target", what));
  };
  if (given.width_px != wanted.width_px || given.height_px != wanted.height_px) {
    fail(fmt::format("is {} x {} pixels, the target {} x {}", given.width_px, given.height_px,
                     wanted.width_px, wanted.height_px));
  }
  const auto differ = [](double a, double b) { return std::abs(a - b) > 1e-4 * b; };
  if (differ(given.layer_um, wanted.layer_um) || differ(given.pixel_x_um, wanted.pixel_x_um) ||
      differ(given.pixel_y_um, wanted.pixel_y_um)) {
    fail(fmt::format("has voxels of {:g} x {:g} x {:g} um, the target of {:g} x {:g} x {:g}",
                     given.pixel_x_um, given.pixel_y_um, given.layer_um, wanted.pixel_x_um,
                     wanted.pixel_y_um, wanted.layer_um));
  }
  if (given.layers > wanted.layers || (given.layers < wanted.layers && !left.may_end_early)) {
    fail(fmt::format("has {} slices, the target {}", given.layers, wanted.layers));
  }
  if (left.slices->recording()) fail("is a recording of a print");
}

}  // namespace

LeavingAlone::LeavingAlone(const SliceSource& target, std::vector<LeftAlone> left_alone)
    : target_(target), left_alone_(std::move(left_alone)), bounds_(target.bounds()) {
  for (const LeftAlone& left : left_alone_) {
    check_like(target, left);
    bounds_ = bounds_.united(left.slices->bounds());
  }
}

template <typename Take>
void LeavingAlone::read_both(const PixelBox& band, Take take) const {
  std::vector<detail::CodedBand> coded;
  for (const LeftAlone& left : left_alone_) {
    coded.push_back(detail::coded_band_of(*left.slices, band));
  }
  const std::size_t columns = detail::columns_of(band);
  std::vector<std::uint8_t> sum(columns), one(columns);
  target_.read_band(band, [&](int n, const std::uint8_t* rows) {
    bool any = false;
    for (const detail::CodedBand& left : coded) {
      if (n >= left.slices() || left.black(n)) continue;
      left.read(n, any ? one.data() : sum.data());
      for (std::size_t i = 0; any && i < columns; ++i) sum[i] = std::max(sum[i], one[i]);
      any = true;
    }
    take(n, rows, any ? sum.data() : nullptr);
  });
}

void LeavingAlone::read_band(const PixelBox& band, const Sink& sink) const {
  std::vector<std::uint8_t> out(detail::columns_of(band));
  read_both(band, [&](int n, const std::uint8_t* rows, const std::uint8_t* left) {
    if (!rows || !left) return sink(n, rows);
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = is_left_alone(left[i], rows[i]) ? std::uint8_t{0} : rows[i];
    }
    sink(n, out.data());
  });
}

void LeavingAlone::LeftPixels::read_band(const PixelBox& band, const Sink& sink) const {
  std::vector<std::uint8_t> out(detail::columns_of(band));
  whole_.read_both(band, [&](int n, const std::uint8_t* rows, const std::uint8_t* left) {
    if (!rows || !left) return sink(n, left);
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = is_left_alone(left[i], rows[i]) ? std::max(left[i], rows[i]) : std::uint8_t{0};
    }
    sink(n, out.data());
  });
}

void AsSliced::read_band(const PixelBox& band, const Sink& sink) const {
  detail::read_as_sliced(target_, band, sink);
}

}  // namespace slicecorr
