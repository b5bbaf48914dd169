// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/light_map.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// The turn from a stack's images to the frame that the flat-field is in.
Turn turn_to_field(const Printer& printer, const ImageFrame& frame) {
  const Orientation display = printer.orientation.value_or(Orientation{});
  const Turn to_display = turn_to_display(frame, printer);
  if (!printer.flat_field->of_plate) return to_display;
  // How the plate lies in what the display shows: the printer's word, or the archive's.
  if (!frame.orientation) return to_display.then(turn_from_plate(display).inverse());
  const Orientation archive = turned(*frame.orientation, to_display);
  if (printer.orientation && archive != display) {
    throw InputError(fmt::format(
        "the flat-field of printer '{}' lies like its plate, and how that lies in images is not "
        "clear: {} by the printer file, {} by the archive; expected the same, or a flat-field with "
        "flat_field_frame = \"image\"",
        printer.name, in_words(display), in_words(archive)));
  }
  return turn_from_plate(*frame.orientation).inverse();
}

}  // namespace

Turn turn_to_display(const ImageFrame& frame, const Printer& printer) {
  return frame.to_display.value_or(turn_between(frame.orientation.value_or(Orientation{}),
                                                printer.orientation.value_or(Orientation{})));
}

Grid images_of(const Printer& printer, const ImageFrame& frame) {
  Grid display;
  display.width_px = printer.width_px;
  display.height_px = printer.height_px;
  display.pixel_x_um = printer.pixel_x_um;
  display.pixel_y_um = printer.pixel_y_um;
  return turned(display, turn_to_display(frame, printer).inverse());
}

LightMap::LightMap(const Printer& printer, const Grid& images, const ImageFrame& frame)
    : width_px_(images.width_px), height_px_(images.height_px) {
  if (!printer.flat_field) return;
  field_ = *printer.flat_field;
  reference_ = field_.reference;
  greatest_ = field_.greatest();
  turn_ = turn_to_field(printer, frame);
  const Grid covered = turned(images, turn_);
  const Grid plate = plate_grid(printer);
  const int width = field_.of_plate ? plate.width_px : printer.width_px;
  const int height = field_.of_plate ? plate.height_px : printer.height_px;
  if (covered.width_px != width || covered.height_px != height) {
    throw InputError(fmt::format(
        "the images are {} x {} pixels; those for printer '{}' have {} x {}, of which its "
        "flat-field says the light",
        images.width_px, images.height_px, printer.name, turn_.swap_axes ? height : width,
        turn_.swap_axes ? width : height));
  }
  fine_ = field_.width_px == width && field_.height_px == height;
  if (!fine_) {
    across_ = between(width, field_.width_px);
    down_ = between(height, field_.height_px);
    whole_ = std::int64_t{4} * width * height;
  }
  // Between values that are alike interpolation gives the same, so the picture decides.
  even_ = field_.least() == reference_ && greatest_ == reference_;
}

LightMap uv_light_map(Printer printer, const Grid& images, const ImageFrame& frame) {
  printer.flat_field = printer.uv_flat_field;
  return {printer, images, frame};
}

std::vector<LightMap::Between> LightMap::between(int pixels, int samples) {
  std::vector<Between> all(static_cast<std::size_t>(pixels));
  const std::int64_t unit = std::int64_t{2} * pixels;
  for (int i = 0; i < pixels; ++i) {
    // The middle of the pixel in samples, from the middle of the first, times `unit`.
    const std::int64_t at = std::clamp((std::int64_t{2} * i + 1) * samples - pixels,
                                       std::int64_t{0}, unit * (samples - 1));
    Between& b = all[static_cast<std::size_t>(i)];
    b.first = static_cast<std::int32_t>(at / unit);
    b.second = std::min(b.first + 1, samples - 1);
    b.share = at % unit;
  }
  return all;
}

std::uint8_t LightMap::sample(int x, int y) const {
  const std::vector<std::uint8_t>& v = *field_.values;
  const auto width = static_cast<std::size_t>(field_.width_px);
  if (fine_) return v[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)];
  const Between& a = across_[static_cast<std::size_t>(x)];
  const Between& d = down_[static_cast<std::size_t>(y)];
  const auto row = [&](std::int32_t j) {
    const std::uint8_t* at = v.data() + static_cast<std::size_t>(j) * width;
    const auto unit = static_cast<std::int64_t>(2 * across_.size());
    return at[a.first] * (unit - a.share) + at[a.second] * a.share;
  };
  const auto unit = static_cast<std::int64_t>(2 * down_.size());
  const std::int64_t sum = row(d.first) * (unit - d.share) + row(d.second) * d.share;
  return static_cast<std::uint8_t>((sum + whole_ / 2) / whole_);
}

std::uint8_t LightMap::value(int x, int y) const {
  if (even_) return reference();
  const Pixel p = turned(Pixel{x, y}, turn_, width_px_, height_px_);
  const std::uint8_t v = sample(p.x, p.y);
  if (step_ == 1 || v == 0) return v;
  return static_cast<std::uint8_t>(std::min(255, v / step_ * step_ + step_ / 2));
}

void LightMap::values(const PixelBox& box, std::uint8_t* out) const {
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) *out++ = value(x, y);
  }
}

std::array<std::uint64_t, 256> LightMap::counts(const PixelBox& box) const {
  std::array<std::uint64_t, 256> counts{};
  if (even_) {
    counts[reference()] =
        static_cast<std::uint64_t>(box.width()) * static_cast<std::uint64_t>(box.height());
    return counts;
  }
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) ++counts[value(x, y)];
  }
  return counts;
}

std::vector<LightGroup> light_groups(const LightMap& map, const PixelBox& box,
                                     const std::uint8_t* keep) {
  std::array<std::vector<std::uint32_t>, 256> columns;
  std::uint32_t at = 0;
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x, ++at) {
      if (!keep || keep[at]) columns[map.value(x, y)].push_back(at);
    }
  }
  std::vector<LightGroup> groups;
  for (std::size_t v = 0; v < columns.size(); ++v) {
    if (!columns[v].empty()) {
      groups.push_back({static_cast<std::uint8_t>(v), std::move(columns[v])});
    }
  }
  return groups;
}

}  // namespace slicecorr
