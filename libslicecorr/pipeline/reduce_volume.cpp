// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <memory>
#include <utility>
#include <vector>

#include "bands/bands.hpp"
#include "bands/design_band.hpp"
#include "bands/design_groups.hpp"
#include "base/coded_band.hpp"
#include "cure/spread_band.hpp"
#include "pipeline/volume_reducer.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/volume.hpp"

namespace slicecorr {

using detail::CodedBand;
using detail::columns_of;

namespace {

/// What the bands of a volume share where light spreads.
struct SpreadLook {
  const detail::SpreadLight& light;
  const detail::ShownSlices &of_target, &of_stack;
};

void look_at_spread(const SpreadLook& look, const SliceSource& target,
                    const SliceSource& uncorrected, const SliceSource& stack,
                    detail::VolumeReducer& reducer, const PixelBox& band, int all,
                    const ExecutionContext& context) {
  const CodedBand design = detail::marked_band_of(target, band);
  const CodedBand shown = detail::coded_band_of(stack, band);
  const CureModel& model = look.light.model();
  const PixelCurve curve = pixel_curve(model);
  BandPredictor before(model, curve, all, columns_of(band), true),
      after(model, curve, all, columns_of(band), true);
  detail::VolumeReducer::Band reduced(reducer, band);
  before.keep_no_histograms();
  after.keep_no_histograms();
  reduced.listen_before(before, nullptr);
  reduced.listen_after(after, nullptr);
  detail::SpreadBand lit_before(look.light, uncorrected, look.of_target, band),
      lit_after(look.light, stack, look.of_stack, band);
  std::vector<std::uint8_t> cover(columns_of(band));
  for (int z = all; z-- > 0;) {
    if ((z & 63) == 0) context.check_cancelled();
    design.read(z, cover.data());
    before.add_slice(z, lit_before.of(z), cover.data());
    after.add_slice(z, lit_after.of(z), cover.data());
  }
  before.finish(0, 0, 1);
  after.finish(0, 0, 1);
  reduced.finish(
      [&](int z, std::uint8_t* out) { shown.read(z, out); },
      [&](int z, std::uint8_t* out) { design.read(z, out); },
      [&](const std::vector<Pixel>& places) {
        using Light = detail::VolumeReducer::Band::Light;
        const auto of = [&](const SliceSource& source, const detail::ShownSlices& slices) -> Light {
          auto light =
              std::make_shared<detail::SpreadBand>(look.light, source, slices, band, places);
          return [light](int z) { return light->of(z); };
        };
        return std::pair{of(uncorrected, look.of_target), of(stack, look.of_stack)};
      });
}

}  // namespace

ReducedVolume reduce_volume(const SliceSource& stack, const SliceSource& target, const Setup& setup,
                            int most_cells, const ExecutionContext& context) {
  refuse_recording(stack);
  check_same_voxels(stack.grid(), target.grid());
  const PlaceModels models(setup.printer, setup.resin, setup.process, stack.grid(), stack.frame());
  const int shown_layers = stack.grid().layers, layers = target.grid().layers;
  const int all = std::max(shown_layers, layers);
  const detail::SpreadLight spread(models, stack.grid(), stack.frame());
  PixelBox box = stack.bounds().united(target.bounds());
  if (!spread.none()) box = spread.around(box);
  detail::VolumeReducer reducer(models, box, layers, shown_layers, setup.printer.levels(),
                                most_cells);
  const auto bands = detail::bands_of(stack.grid(), box);
  const AsSliced uncorrected(target);
  const detail::ShownSlices of_target(uncorrected), of_stack(stack);
  if (!spread.none()) reducer.keep_light(spread.model());
  parallel_for(context, "look", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    if (!spread.none())
      return look_at_spread({spread, of_target, of_stack}, target, uncorrected, stack, reducer,
                            band, all, context);
    const CodedBand design = detail::marked_band_of(target, band);
    const CodedBand shown = detail::coded_band_of(stack, band);
    detail::VolumeReducer::Band reduced(reducer, band);
    const detail::DesignBand grouped(target, models.map(), band,
                                     {.beside = &stack, .doses = false});
    for (const detail::DesignGroup& g : grouped.groups()) {
      CodedBand coverage(g.columns);
      g.coverage([&](int, const std::uint8_t* rows) { coverage.append(rows); });
      detail::LeftAloneRows left_rows(g.left_alone);
      BandPredictor before(models.model(g.value), models.curve(g.value), all, g.columns),
          after(models.model(g.value), models.curve(g.value), all, g.columns);
      before.keep_no_histograms();
      after.keep_no_histograms();
      reduced.listen_before(before, g.of_band);
      reduced.listen_after(after, g.of_band);
      std::vector<std::uint8_t> rows(g.columns), pixels(g.columns), sliced(g.columns),
          judged(g.columns);
      for (int z = all; z-- > 0;) {
        if ((z & 63) == 0) context.check_cancelled();
        coverage.read(z, rows.data());
        g.beside->read(z, pixels.data());
        const std::uint8_t* const left = left_rows.at(z);
        const std::uint8_t* const cover = detail::marked(rows.data(), left, judged);
        before.add_slice(z, z < layers ? detail::as_sliced(rows.data(), left, sliced) : nullptr,
                         cover);
        after.add_slice(z, z < shown_layers ? pixels.data() : nullptr, cover);
      }
      before.finish(0, 0, 1);
      after.finish(0, 0, 1);
    }
    reduced.finish([&](int z, std::uint8_t* out) { shown.read(z, out); },
                   [&](int z, std::uint8_t* out) { design.read(z, out); });
  });
  return reducer.take();
}

ReducedVolume coarser(const ReducedVolume& fine) {
  ReducedVolume v;
  v.box = fine.box;
  v.layers = fine.layers;
  v.least_light = fine.least_light;
  v.greatest_light = fine.greatest_light;
  v.under_uv = fine.under_uv;
  v.step_x = fine.step_x * 2;
  v.step_y = fine.step_y * 2;
  v.step_z = fine.step_z * 2;
  v.nx = (fine.nx + 1) / 2;
  v.ny = (fine.ny + 1) / 2;
  v.nz = (fine.nz + 1) / 2;
  const auto join = [&](const ReducedPrint& from, ReducedPrint& to) {
    for (auto* grid : {&to.state, &to.dose, &to.grey, &to.error}) grid->assign(v.cells(), 0);
    std::vector<std::uint8_t> printed(v.cells(), 0), designed(v.cells(), 0), all(v.cells(), 0);
    std::size_t at = 0;
    for (int k = 0; k < fine.nz; ++k) {
      for (int j = 0; j < fine.ny; ++j) {
        for (int i = 0; i < fine.nx; ++i, ++at) {
          const std::size_t c = (static_cast<std::size_t>(k / 2) * static_cast<std::size_t>(v.ny) +
                                 static_cast<std::size_t>(j / 2)) *
                                    static_cast<std::size_t>(v.nx) +
                                static_cast<std::size_t>(i / 2);
          const std::uint8_t s = from.state[at];
          to.state[c] |= s & (kCellCureThrough | kCellUndercure | kCellGrey);
          printed[c] = static_cast<std::uint8_t>(printed[c] + ((s & kCellPrinted) != 0));
          designed[c] = static_cast<std::uint8_t>(designed[c] + ((s & kCellDesigned) != 0));
          ++all[c];
          const std::uint8_t e = from.error[at];
          if (e && (!to.error[c] || std::abs(e - 128) > std::abs(to.error[c] - 128)))
            to.error[c] = e;
          if (i % 2 == 0 && j % 2 == 0 && k % 2 == 0) {
            to.dose[c] = from.dose[at];
            to.grey[c] = from.grey[at];
          }
        }
      }
    }
    for (std::size_t c = 0; c < v.cells(); ++c) {
      if (2 * printed[c] >= all[c]) to.state[c] |= kCellPrinted;
      if (2 * designed[c] >= all[c]) to.state[c] |= kCellDesigned;
    }
  };
  join(fine.before, v.before);
  join(fine.after, v.after);
  v.columns.reserve(static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny));
  for (int j = 0; j < v.ny; ++j) {
    for (int i = 0; i < v.nx; ++i) {
      v.columns.push_back(
          fine.columns[static_cast<std::size_t>(2 * j) * static_cast<std::size_t>(fine.nx) +
                       static_cast<std::size_t>(2 * i)]);
    }
  }
  return v;
}

}  // namespace slicecorr
