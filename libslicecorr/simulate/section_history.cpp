// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>

#include "cure/spread_band.hpp"
#include "simulate/doses_in_time.hpp"
#include "simulate/refuse.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/recording.hpp"
#include "slicecorr/simulate.hpp"

namespace slicecorr {

namespace {

/// The light of a slice that is not over yet, per column: one of both.
struct UnfinishedLight {
  std::vector<double> phi;
  std::vector<FrontLight> fronts;
};

UnfinishedLight light_of(const ImageShowing& showing, std::size_t columns) {
  if (showing.fronts) return {{}, {showing.fronts, showing.fronts + columns}};
  return {{showing.phi, showing.phi + columns}, {}};
}

}  // namespace

SectionHistory simulate_section(const SliceSource& stack, const SliceSource* target,
                                const Setup& setup, int y, const std::vector<double>& times_s,
                                const ExecutionContext& context) {
  refuse_recording(stack);
  refuse_own_heights(setup.process);
  refuse_scatter(setup.resin);
  const Grid& grid = stack.grid();
  if (target) check_same_voxels(grid, target->grid());
  if (y < 0 || y >= grid.height_px) {
    throw InputError(
        fmt::format("row {} is outside the image; expected 0..{}", y, grid.height_px - 1));
  }
  PixelBox box = stack.bounds();
  if (target) box = box.united(target->bounds());
  const PlaceModels models(setup.printer, setup.resin, setup.process, grid, stack.frame());
  const detail::SpreadLight spread(models, grid, stack.frame());
  const CureModel& model = spread.model();
  const PlaceModels one(model);
  const detail::ShownSlices slices(stack);
  if (!spread.none()) box = spread.around(box);
  if (box.empty()) throw InputError("nothing is shown in the stack; expected a pixel above black");

  SectionHistory s;
  s.y = y;
  s.x0 = box.x0;
  s.width = box.width();
  s.layers = target ? std::max(grid.layers, target->grid().layers) : grid.layers;
  s.pixel_x_um = grid.pixel_x_um;
  s.layer_um = grid.layer_um;
  const auto width = static_cast<std::size_t>(s.width);
  const std::size_t size = width * static_cast<std::size_t>(s.layers);
  const PixelBox row{box.x0, y, box.x1, y + 1};
  const auto read = [&](const SliceSource& source) {
    std::vector<std::uint8_t> values(size, 0);
    source.read_band(row, [&](int n, const std::uint8_t* rows) {
      if (rows)
        std::copy_n(
            rows, width,
            values.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(n) * width));
    });
    return values;
  };
  const std::vector<std::uint8_t> pixels = read(stack);
  if (target) s.coverage = read(*target);

  std::vector<std::uint8_t> light(width);
  models.map().values(row, light.data());
  const PrintClock clock(setup.process, model.m, grid.layer_um, grid.layers);
  const int levels = static_cast<int>(model.level_phi.size());
  // Of a resin whose doses are no sums.
  std::vector<std::unique_ptr<detail::DosesInTime>> columns;
  if (detail::make_doses_in_time(model, {})) {
    std::vector<std::vector<double>> shown(
        width, std::vector<double>(static_cast<std::size_t>(grid.layers)));
    std::optional<detail::SpreadBand> lights;
    if (!spread.none()) lights.emplace(spread, stack, slices, row);
    for (int n = grid.layers; n-- > 0;) {
      const double* const spread_phi = lights ? lights->of(n).front().phi : nullptr;
      const auto at = static_cast<std::size_t>(n);
      for (std::size_t x = 0; x < width; ++x) {
        const CureModel& here = lights ? model : models.model(light[x]);
        const auto level = static_cast<std::size_t>(level_of_pixel(pixels[at * width + x], levels));
        shown[x][at] = here.ratio(n) * (spread_phi ? spread_phi[x] : here.level_phi[level]);
      }
    }
    for (std::size_t x = 0; x < width; ++x) {
      const CureModel& here = spread.none() ? models.model(light[x]) : model;
      columns.push_back(detail::make_doses_in_time(here, std::move(shown[x])));
    }
  }
  for (const double time_s : times_s) {
    context.check_cancelled();
    const PrintClock::Moment now = clock.at(time_s);
    SectionHistory::Still frame;
    frame.time_s = clock.time_s(now);
    frame.slice = now.slice;
    frame.share = now.share;
    frame.ended = now.share >= 1.0 && now.slice + 1 == grid.layers;
    frame.gelled.assign(size, 0);
    const bool moving = model.mode == ExposureMode::continuous;
    frame.z_window_um = (now.slice + (moving ? now.share : 1.0)) * grid.layer_um;
    if (!columns.empty()) {
      for (std::size_t x = 0; x < width; ++x) {
        detail::DosesInTime& column = *columns[x];
        column.begin(now);
        for (int n = now.slice; n >= 0; --n) {
          // The middle of the layer, as far as light has come there.
          const double up = column.shown(n) - 0.5;
          const bool gels = up >= 0 && column.at(n, up) >= 1.0;
          frame.gelled[static_cast<std::size_t>(n) * width + x] = gels ? 1 : 0;
        }
        column.end();
      }
      s.frames.push_back(std::move(frame));
      continue;
    }
    // Slices shown whole as ever, and what the present one has added so far.
    const bool whole = now.share >= 1.0;
    const int complete = now.slice + (whole ? 1 : 0);
    // Where light spreads all columns have one model.
    PlaceDose dose(spread.none() ? models : one, row);
    std::optional<detail::SpreadBand> lights;
    if (!spread.none()) lights.emplace(spread, stack, slices, row);
    UnfinishedLight unfinished;  // of the present slice
    const std::uint8_t* shown = pixels.data() + static_cast<std::size_t>(now.slice) * width;
    for (int n = now.slice; n >= 0; --n) {
      if ((n & 63) == 0) context.check_cancelled();
      const std::size_t at = static_cast<std::size_t>(n) * width;
      if (lights) {
        const std::span<const ImageShowing> shown_light = lights->of(n);
        dose.add_slice(n, n < complete ? shown_light : std::span<const ImageShowing>{});
        if (n == now.slice) unfinished = light_of(shown_light.front(), width);
      } else {
        dose.add_slice(n, n < complete ? pixels.data() + at : nullptr);
      }
      std::map<std::pair<int, int>, double> added;  // by pixel value and light
      for (std::size_t x = 0; x < width; ++x) {
        double sum = dose.middle()[x];
        if (!whole && lights) {
          sum += unfinished.fronts.empty()
                     ? added_dose_of_light(model, now, unfinished.phi[x], now.slice + 0.5 - n)
                     : added_dose(model, now, unfinished.fronts[x], now.slice + 0.5 - n);
        } else if (!whole) {
          const auto [entry, is_new] = added.try_emplace({shown[x], light[x]}, 0.0);
          if (is_new) {
            entry->second = added_dose(models.model(light[x]), now,
                                       level_of_pixel(shown[x], levels), now.slice + 0.5 - n);
          }
          sum += entry->second;
        }
        frame.gelled[at + x] = sum >= 1.0 ? 1 : 0;
      }
    }
    s.frames.push_back(std::move(frame));
  }
  return s;
}

}  // namespace slicecorr
