// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <optional>

#include "bands/bands.hpp"
#include "pipeline/relief.hpp"
#include "pipeline/uv_images.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/file_times.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "stack/flat_field_entry.hpp"

namespace slicecorr {

namespace detail {

std::array<std::uint8_t, 256> uv_of_pixels(const CureModel& model, int levels) {
  std::array<std::uint8_t, 256> uv_of_pixel{};
  for (int v = 0; v < 256; ++v) {
    const auto level = static_cast<std::size_t>(level_of_pixel(v, levels));
    uv_of_pixel[static_cast<std::size_t>(v)] =
        static_cast<std::uint8_t>(pixel_of_level(model.inhibited()->uv_levels()[level], levels));
  }
  return uv_of_pixel;
}

void set_uv_images(StackWriter& writer, const PlaceModels& models, const Setup& setup,
                   const ImagesLie& images) {
  if (setup.process.even_light && setup.process.even_light->uv) {
    // Lives as long as the writer asks it.
    struct Made {
      Setup setup;
      EvenUvImages images;
      Made(const Setup& s, const ImagesLie& lie) : setup(s), images(setup, lie.grid, lie.frame) {}
    };
    const auto made = std::make_shared<const Made>(setup, images);
    writer.set_uv_pattern(made->images.of_black(),
                          [made](int slice, int y, std::span<std::uint8_t> pixels) {
                            made->images.make_row(slice, y, pixels);
                          });
    return;
  }
  const CureModel& model = models.brightest();
  if (!model.inhibited() || model.inhibited()->uv_levels().empty()) return;
  writer.set_uv_pattern(uv_of_pixels(model, setup.printer.levels()));
}

}  // namespace detail

double coverage_mm3(const StackReader& stack, const ExecutionContext& context) {
  const StackInfo& info = stack.info();
  const Grid& g = stack.grid();
  if (info.layer_heights_um.empty()) {
    return static_cast<double>(stack.pixel_sum()) / 255.0 * g.pixel_x_um * g.pixel_y_um *
           g.layer_um * 1e-9;
  }
  const PixelBox box = stack.bounds();
  const std::size_t count =
      static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
  double mm3 = 0;
  stack.read_band(box, [&](int layer, const std::uint8_t* rows) {
    context.check_cancelled();
    if (rows == nullptr) return;
    const auto sum = std::accumulate(rows, rows + count, std::uint64_t{0});
    mm3 += static_cast<double>(sum) / 255.0 * g.pixel_x_um * g.pixel_y_um *
           layer_height_um(info, layer) * 1e-9;
  });
  return mm3;
}

void convert_stack(const StackReader& stack, const StackFile& file, const ExecutionContext& context,
                   const SliceSource* turned_slices) {
  const SliceSource& slices = turned_slices ? *turned_slices : stack;
  const Grid& grid = slices.grid();
  refuse_recording(stack);
  StackInfo info = stack.info();
  if (turned_slices && info.process && info.process->even_light) {
    throw InputError(
        "a stack with an even dead zone lies as it was corrected; expected it to be corrected into "
        "the archive for the printer");
  }
  info.original_sha256.clear();  // of an archive of another kind
  if (file.keep_from.empty() && !info.exposures.empty()) {
    const auto spots = std::count_if(info.exposures.begin(), info.exposures.end(),
                                     [](const LayerExposure& e) { return e.spot; });
    context.tell(fmt::format(
        "{}: {} exposures of {} layers become one of each, as long as all of its "
        "together{}",
        file.path, info.exposures.size(), info.grid.layers,
        spots > 0 ? fmt::format("; {} images of a pixel or none are left out", spots) : ""));
    info.exposures.clear();
  }
  if (turned_slices) {
    info.grid = grid;
    detail::set_frame(info, slices);
  }
  if (info.part_volume_mm3 == 0) {
    info.part_volume_mm3 = coverage_mm3(stack, context);
  }
  check_file_times(file, info);
  std::optional<PlaceModels> models;  // the writer asks them for UV images
  StackWriter writer(file, grid, context);
  if (info.printer && info.resin && info.process) {
    models.emplace(*info.printer, *info.resin, *info.process, grid, slices.frame());
    detail::set_uv_images(writer, *models, {*info.printer, *info.resin, *info.process, 0},
                          {grid, slices.frame()});
  }
  const SliceSource* edges = slices.edge_heights();
  if (edges != nullptr && !writer.keep_edge_heights()) edges = nullptr;
  detail::Relief relief(slices.bounds(), grid.layers);
  const auto bands = detail::bands_of(grid, slices.bounds());
  parallel_for(context, "convert", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    detail::LitColumns lit(detail::columns_of(band));
    slices.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      encoder.put(n, band.x0, band.x1, rows);
      lit.add(n, rows);
    });
    detail::put_edge_heights(edges, band, encoder, context);
    relief.add(band, lit.finish());
  });
  if (file.keep_from.empty()) {
    std::vector<std::string> lost;
    for (const std::string& name : stack.other_entries()) {
      // Not told of as lost: what these files say is carried over, or concerns their format alone.
      if (!name.ends_with(".ini") && !name.ends_with(".json") && name != detail::kFlatFieldEntry &&
          name != detail::kUvFlatFieldEntry) {
        lost.push_back(name);
      }
    }
    if (!lost.empty()) {
      const auto shown = static_cast<std::ptrdiff_t>(std::min<std::size_t>(lost.size(), 4));
      context.tell(fmt::format("{}: {} left behind: {}{}", file.path,
                               lost.size() == 1 ? "one other entry is"
                                                : fmt::format("{} other entries are", lost.size()),
                               fmt::join(lost.begin(), lost.begin() + shown, ", "),
                               lost.size() > 4 ? ", ..." : ""));
    }
  }
  writer.finish(info, relief.picture());
}

}  // namespace slicecorr
