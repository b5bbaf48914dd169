// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/layer_places.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string_view>

#include "slicecorr/error.hpp"
#include "stack/coded_images.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/png/png.hpp"

namespace slicecorr::detail {
namespace {

/// Heights are told in single-precision millimetres and to tenths of micrometres: less is no difference.
double tidy_height_um(double um) { return std::round(um * 10) / 10; }

/// What an image shows, without the image.
struct Seen {
  std::uint64_t lit = 0, crc = 0;
  void add(const std::uint8_t* pixels, std::size_t count) {
    lit += count - static_cast<std::size_t>(std::count(pixels, pixels + count, std::uint8_t{0}));
    const std::string_view bytes(reinterpret_cast<const char*>(pixels), count);
    crc = crc * 0x9e3779b97f4a7c15u + std::hash<std::string_view>{}(bytes);
  }
};

Seen see(const Container& archive, const ArchiveContents& contents, std::size_t image) {
  const Grid& grid = contents.info.grid;
  Seen seen;
  if (contents.codec) {
    const std::size_t count = contents.codec->pixel_count();
    const auto pixels = std::make_unique_for_overwrite<std::uint8_t[]>(count);
    decode_image(archive, contents, image, pixels.get());
    seen.add(pixels.get(), count);
    return seen;
  }
  const std::string& name = contents.images[image];
  std::vector<std::uint8_t> png;
  archive.read(*archive.find(name), std::uint64_t{1} << 32, png);
  const std::size_t stride = raw_stride(grid.width_px);
  constexpr int rows = 64;
  const std::vector<std::uint8_t> black(stride * rows);
  decode_png_bands(
      png, grid.width_px, grid.height_px, rows, {archive.path(), name},
      [&](int y0, int y1, const std::uint8_t* raw) {
        seen.add(raw ? raw : black.data(), stride * static_cast<std::size_t>(y1 - y0));
      },
      contents.packed_rgb, contents.packed_bgr);
  return seen;
}

/// Joins the images at one height: their light adds up.
void join_exposures(const Container& archive, const std::vector<int>& layer_of,
                    ArchiveContents& contents) {
  StackInfo& info = contents.info;
  const std::size_t images = layer_of.size();
  const auto layers = static_cast<std::size_t>(layer_of.back()) + 1;
  std::vector<LayerExposure> exposures(images);
  for (std::size_t k = 0; k < images; ++k) {
    const SliceLight light = light_of_layer(info, static_cast<int>(k));
    exposures[k] = {layer_of[k], light.time_s, light.share, false};
  }
  std::vector<double> times_s(layers), shares(layers);
  std::vector<LiftMotion> lifts;
  for (std::size_t first = 0; first < images;) {
    std::size_t end = first + 1;
    while (end < images && layer_of[end] == layer_of[first]) ++end;
    // Where all of a layer's images are next to black, the last of them is no spot.
    if (end - first > 1) {
      std::size_t spots = 0;
      for (std::size_t k = first; k < end; ++k) {
        exposures[k].spot = see(archive, contents, k).lit <= 1;
        spots += exposures[k].spot;
      }
      if (spots == end - first) exposures[end - 1].spot = false;
    }
    const auto layer = static_cast<std::size_t>(layer_of[first]);
    for (std::size_t k = first; k < end; ++k) {
      if (!exposures[k].spot) shares[layer] = std::max(shares[layer], exposures[k].light_share);
    }
    for (std::size_t k = first; k < end; ++k) {
      if (exposures[k].spot) continue;
      times_s[layer] += exposures[k].time_s * (exposures[k].light_share / shares[layer]);
    }
    if (info.lift_times) lifts.push_back(info.lift_times->of(static_cast<int>(end - 1)));
    first = end;
  }
  info.exposures = std::move(exposures);
  info.grid.layers = static_cast<int>(layers);
  info.target_layers = std::min(info.target_layers, info.grid.layers);
  info.light_share.clear();
  take_light(shares, 1, archive.path(), "", info);
  // The same times by layers.
  info.layer_exposure_s.clear();
  info.fade_layers = 0;
  if (info.exposure_s > 0 && times_s.front() != info.exposure_s) {
    info.bottom_exposure_s = times_s.front();
    const auto other = std::find_if(times_s.begin(), times_s.end(),
                                    [&](double t) { return t != times_s.front(); });
    info.bottom_layers = static_cast<int>(other - times_s.begin());
  } else {
    info.bottom_exposure_s = 0;
    info.bottom_layers = 0;
  }
  if (std::any_of(times_s.begin(), times_s.end(), [](double t) { return t > 0; })) {
    take_layer_times(std::move(times_s), info);
  }
  if (info.lift_times && !info.lift_times->layers.empty()) info.lift_times->layers = lifts;
}

void take_places(const Container& archive, ArchiveContents& contents) {
  StackInfo& info = contents.info;
  const std::vector<double>& z_mm = contents.z_mm;
  const double layer_um = info.grid.layer_um;
  if (z_mm.size() != static_cast<std::size_t>(info.grid.layers) || !(layer_um > 0)) return;
  const double close_um = 0.01 * layer_um + std::max(0.5, contents.z_step_um);
  // Some programs count from the first layer's place, not from the platform.
  double below_mm = z_mm.front() * 1e3 < 1e-3 * layer_um ? -layer_um * 1e-3 : 0;
  std::vector<double> heights_um;
  std::vector<int> layer_of;
  bool even = true;
  for (std::size_t n = 0; n < z_mm.size(); ++n) {
    const double rise_um = (z_mm[n] - below_mm) * 1e3;
    if (rise_um < -1e-3 * layer_um) {
      throw InputError(
          archive.path(), fmt::format("layer {}", n),
          fmt::format("is at {:g} mm, below the one before it, at {:g} mm", z_mm[n], below_mm));
    }
    // At the place of the one before: another exposure of that layer.
    if (n > 0 && rise_um <= 1e-3 * layer_um) {
      layer_of.push_back(layer_of.back());
      continue;
    }
    layer_of.push_back(static_cast<int>(heights_um.size()));
    const bool usual = std::abs(rise_um - layer_um) <= close_um;
    heights_um.push_back(usual ? layer_um : tidy_height_um(rise_um));
    even = even && usual;
    below_mm = z_mm[n];
  }
  const auto high = std::find_if(heights_um.begin(), heights_um.end(),
                                 [](double um) { return !(um > 0 && um <= 1000); });
  if (high != heights_um.end()) {
    throw InputError(archive.path(), fmt::format("layer {}", high - heights_um.begin()),
                     fmt::format("is {:g} um high, expected up to 1000 um", *high));
  }
  if (!even) info.layer_heights_um = heights_um;
  if (heights_um.size() < z_mm.size()) join_exposures(archive, layer_of, contents);
}

}  // namespace

ArchiveContents read_with_places(const ArchiveFormat& format, const Container& archive) {
  ArchiveContents contents = format.read(archive);
  take_places(archive, contents);
  return contents;
}

int layer_of_image(const ArchiveContents& kept, std::size_t image) {
  const std::vector<LayerExposure>& exposures = kept.info.exposures;
  if (exposures.empty()) return static_cast<int>(image);
  if (image < exposures.size()) return exposures[image].layer;
  return static_cast<int>(image - exposures.size()) + kept.info.grid.layers;
}

bool is_spot(const ArchiveContents& kept, std::size_t image) {
  return image < kept.info.exposures.size() && kept.info.exposures[image].spot;
}

StackInfo image_by_image(const StackInfo& info, const ArchiveContents& kept) {
  if (kept.info.exposures.empty()) return info;
  StackInfo out = info;
  const std::size_t images = kept.info.exposures.size() +
                             static_cast<std::size_t>(info.grid.layers - kept.info.grid.layers);
  std::vector<double> times_s, shares, heights_um;
  for (std::size_t k = 0; k < images; ++k) {
    const int layer = layer_of_image(kept, k);
    SliceLight light = light_of_layer(info, layer);
    if (k < kept.info.exposures.size()) {
      // Each exposure keeps its part of the layer's light.
      const LayerExposure& own = kept.info.exposures[k];
      const SliceLight before = light_of_layer(kept.info, layer);
      light.time_s = own.spot || !(before.time_s > 0) ? own.time_s
                                                      : own.time_s * (light.time_s / before.time_s);
      light.share = own.spot ? own.light_share : own.light_share * (light.share / before.share);
    }
    times_s.push_back(light.time_s);
    shares.push_back(light.share);
    heights_um.push_back(layer_height_um(info, layer));
  }
  out.grid.layers = static_cast<int>(images);
  out.exposures.clear();
  const auto put = [&](auto& to) {
    to.bottom_exposure_s = 0;
    to.bottom_layers = to.fade_layers = 0;
    to.layer_exposure_s = times_s;
    if (!times_s.empty()) to.exposure_s = times_s.back();
    to.light_share = shares;
    if (!to.layer_heights_um.empty()) to.layer_heights_um = heights_um;
  };
  put(out);
  if (out.process) put(*out.process);
  return out;
}

ArchiveContents image_by_image(const ArchiveContents& contents) {
  ArchiveContents out = contents;
  out.info = image_by_image(contents.info, contents);
  return out;
}

}  // namespace slicecorr::detail
