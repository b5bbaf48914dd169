// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/correct_spread.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "pipeline/bands.hpp"
#include "pipeline/columns_alone.hpp"
#include "pipeline/corrected_info.hpp"
#include "pipeline/design_band.hpp"
#include "pipeline/shortcomings.hpp"
#include "pipeline/target_scan.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/volume.hpp"

namespace slicecorr::detail {

namespace {

CoupledOptions options_of(int rounds, const PlaceModels& models,
                          const std::string& scratch_folder) {
  CoupledOptions options;
  options.rounds = rounds;
  options.scratch_folder = scratch_folder;
  if (models.even()) return options;
  options.shares = [&models](const PixelBox& box, double* shares) {
    const LightMap& map = models.map();
    std::vector<std::uint8_t> values(columns_of(box));
    map.values(box, values.data());
    for (std::size_t k = 0; k < values.size(); ++k) shares[k] = map.factor(values[k]);
  };
  return options;
}

}  // namespace

TogetherCorrected::TogetherCorrected(const SliceSource& target, const PlacePlans& plans, int rounds,
                                     const std::string& scratch_folder,
                                     const ExecutionContext& context)
    : plans_(plans),
      light_(plans.models(), target.grid(), target.frame()),
      coupled_(plans.plan(), light_.blur(), light_.scatter(), target.bounds(), light_.display(),
               options_of(rounds, plans.models(), scratch_folder)) {
  CoupledCorrection::ColumnLevels alone;
  if (!plans.even()) {
    alone = [&](const PixelBox& box) { return levels_alone(target, plans, box); };
  }
  coupled_.solve_columns(
      [&](const PixelBox& box, const CoupledCorrection::LayerSink& sink) {
        const auto heights = edge_heights_of(target, box);
        const auto left_alone = left_alone_of(target, box);
        LeftAloneRows left(left_alone ? &*left_alone : nullptr);
        read_design(reader_of(target, box), heights ? &*heights : nullptr, Surface::mesh,
                    [&](int n, const std::uint8_t* rows, const std::uint8_t* its_heights) {
                      sink(n, rows, its_heights, left.at(n));
                    });
      },
      target.left_alone() != nullptr, context, alone);
  const auto tell = [&](const CoupledRound& round) {
    context.tell(fmt::format("round {} of {}: {} voxels of gaps cure, {} of features do not{}",
                             round.round, rounds, round.through, round.under,
                             round.parted > 0
                                 ? fmt::format(", {} part from the layer above", round.parted)
                                 : std::string()));
  };
  if (rounds > 0) tell(coupled_.columns_alone());
  while (coupled_.improve(context)) tell(coupled_.last());
}

void TogetherCorrected::read_band(const PixelBox& band, const SliceSource::Sink& sink) const {
  std::vector<std::uint8_t> pixels(columns_of(band));
  std::array<std::uint8_t, 256> pixel_of{};
  const int levels = plans_.levels();
  for (int level = 0; level < levels; ++level) {
    pixel_of[static_cast<std::size_t>(level)] =
        static_cast<std::uint8_t>(pixel_of_level(level, levels));
  }
  coupled_.read(band, [&](int n, const std::uint8_t* rows) {
    if (rows) {
      std::transform(rows, rows + pixels.size(), pixels.begin(),
                     [&](std::uint8_t level) { return pixel_of[level]; });
    }
    sink(n, rows ? pixels.data() : nullptr);
  });
}

Correction correct_spread_stack(const SliceSource& target, const Setup& setup,
                                const StackFile& file, const CorrectionAsk& ask,
                                const ExecutionContext& context) {
  TargetScan scan(target);
  const std::vector<PixelBox> target_bands = bands_of(target.grid(), target.bounds());
  parallel_for(context, "look", target_bands.size(), [&](std::size_t i) {
    scan.read(target_bands[i], [&](int n, const std::uint8_t*) {
      if ((n & 63) == 0) context.check_cancelled();
    });
    if (const auto left_alone = left_alone_of(target, target_bands[i])) scan.add(*left_alone);
  });
  Correction result;
  scan.fill(result.info);
  const auto stack = std::make_shared<const CorrectedSlices>(
      target, setup, context, std::filesystem::path(file.path).parent_path().string());
  result.slices = stack;
  const Grid& grid = stack->grid();
  StackWriter writer(file, grid, context);
  const std::vector<PixelBox> bands = bands_of(grid, stack->bounds());
  parallel_for(context, "encode", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    stack->read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      encoder.put(n, band.x0, band.x1, rows);
    });
  });

  StackInfo& info = result.info;
  fill_corrected(info, grid, target, setup, file);
  result.after = verify_stack(*stack, target, setup, context);
  if (ask.before || ask.volume_cells > 0) {
    const AsSliced shown(target);
    result.before = verify_stack(shown, target, setup, context);
  }
  if (ask.volume_cells > 0) {
    result.volume = std::make_shared<ReducedVolume>(
        reduce_volume(*stack, target, setup, ask.volume_cells, context));
  }
  const PlaceModels models(setup.printer, setup.resin, setup.process, grid, target.frame());
  tell_shortcomings(result.after, models.brightest(), setup.process, setup.printer.levels(),
                    context);
  if (ask.before_writing) ask.before_writing(result);
  writer.finish(info, scan.picture());
  return result;
}

}  // namespace slicecorr::detail
