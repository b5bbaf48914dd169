// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Targets and images to be shown, as stacks.
#include <fmt/format.h>

#include <algorithm>

#include "bands/bands.hpp"
#include "pipeline/target_scan.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/file_times.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/write_images.hpp"

namespace slicecorr {

using detail::bands_of;
using detail::SliceRange;
using detail::TargetScan;

namespace {

/// The slice ranges of a band that are read in parallel: where there are few bands, the last of
/// them would keep one thread busy and leave the others idle.
std::vector<SliceRange> slice_ranges_of(const SliceSource& target, std::size_t bands) {
  constexpr int enough = 64, least_slices = 16;
  const int layers = target.grid().layers;
  int count = 1;
  if (target.reads_any_slices() && bands > 0) {
    const int wanted = (enough + static_cast<int>(bands) - 1) / static_cast<int>(bands);
    count = std::clamp(wanted, 1, std::max(1, layers / least_slices));
  }
  std::vector<SliceRange> ranges;
  ranges.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    ranges.push_back({static_cast<int>(std::int64_t{layers} * i / count),
                      static_cast<int>(std::int64_t{layers} * (i + 1) / count)});
  }
  return ranges;
}

/// `image_s`: for how long each image is shown; empty: nobody says.
StackInfo write(const SliceSource& target, const std::vector<double>& image_s,
                const LayerHeights& heights, const StackFile& file,
                const ExecutionContext& context) {
  const Grid& grid = target.grid();
  StackInfo info;
  info.grid = grid;
  detail::set_frame(info, target);
  info.kind = StackKind::target;
  if (!heights.alike()) {
    for (int n = 0; n < grid.layers; ++n) {
      info.layer_heights_um.push_back(heights.of(n, grid.layer_um));
    }
  }
  if (!image_s.empty()) {
    info.exposure_s = image_s.back();
    const bool even =
        std::all_of(image_s.begin(), image_s.end(), [&](double s) { return s == info.exposure_s; });
    if (!even) info.layer_exposure_s = image_s;
  }
  check_file_times(file, info);
  StackWriter writer(file, grid, context);
  const SliceSource* edges = target.edge_heights();
  if (edges != nullptr && !writer.keep_edge_heights()) edges = nullptr;
  TargetScan scan(target, heights);
  const auto bands = bands_of(grid, target.bounds());
  const auto ranges = slice_ranges_of(target, bands.size());
  parallel_for(context, "slice", bands.size() * ranges.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i / ranges.size()];
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    scan.read(band, ranges[i % ranges.size()], [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      encoder.put(n, band.x0, band.x1, rows);
    });
    if (i % ranges.size() == 0) detail::put_edge_heights(edges, band, encoder, context);
  });
  info.has_edge_heights = edges != nullptr;
  scan.fill(info);
  writer.finish(info, scan.picture());
  return info;
}

}  // namespace

StackInfo write_target(const SliceSource& target, const StackFile& file,
                       const ExecutionContext& context) {
  return write(target, {}, {}, file, context);
}

StackInfo write_target(const SliceSource& target, const LayerHeights& heights,
                       const StackFile& file, const ExecutionContext& context) {
  return write(target, {}, heights, file, context);
}

StackInfo write_images(const SliceSource& images, const std::vector<double>& image_s,
                       const StackFile& file, const ExecutionContext& context) {
  if (image_s.size() != static_cast<std::size_t>(images.grid().layers)) {
    throw InputError(fmt::format("{} times for {} images; expected one for each", image_s.size(),
                                 images.grid().layers));
  }
  for (const double s : image_s) {
    if (!(s > 0 && s <= kMostImageS)) {
      throw InputError(
          fmt::format("an image is to be shown for {:g} s; expected more than 0 and at most {:g} s",
                      s, kMostImageS));
    }
  }
  return write(images, image_s, {}, file, context);
}

}  // namespace slicecorr
