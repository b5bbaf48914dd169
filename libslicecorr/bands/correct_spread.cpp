// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/correct_spread.hpp"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "bands/correct_group.hpp"
#include "bands/design_band.hpp"
#include "bands/pixels_of_levels.hpp"
#include "bands/robust_design.hpp"
#include "slicecorr/place_models.hpp"

namespace slicecorr::detail {

namespace {

CoupledOptions options_of(int rounds, const PlaceModels& models, const DoseTarget* doses,
                          const std::string& scratch_folder) {
  CoupledOptions options;
  options.doses = doses;
  options.rounds = rounds;
  options.scratch_folder = scratch_folder;
  if (models.even()) return options;
  options.shares = [&models](const PixelBox& box, double* shares) {
    const LightMap& map = models.map();
    std::vector<std::uint8_t> values(columns_of(box));
    map.values(box, values.data());
    const double m = models.brightest().m;
    for (std::size_t k = 0; k < values.size(); ++k) shares[k] = std::pow(map.factor(values[k]), m);
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
               options_of(rounds, plans.models(), target.doses(), scratch_folder)) {
  CoupledCorrection::ColumnLevels alone;
  if (!plans.even() || target.doses()) {
    alone = [&](const PixelBox& box) {
      CodedBand upwards(columns_of(box));
      std::vector<std::uint8_t> levels(columns_of(box));
      correct_band(target, plans, box, [&](int, const std::uint8_t* pixels) {
        for (std::size_t k = 0; pixels && k < levels.size(); ++k) {
          levels[k] = static_cast<std::uint8_t>(level_of_pixel(pixels[k], plans.levels()));
        }
        upwards.append(pixels ? levels.data() : nullptr);
      });
      return upwards;
    };
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
    context.tell(
        fmt::format("round {} of {}: {} voxels of gaps cure, {} of features do not{}", round.round,
                    rounds, round.through, round.under,
                    round.lifted       ? fmt::format(", {} do not hold at their lift", round.parted)
                    : round.parted > 0 ? fmt::format(", {} part from the layer above", round.parted)
                                       : std::string()));
  };
  if (rounds > 0) tell(coupled_.columns_alone());
  while (coupled_.improve(context)) tell(coupled_.last());
  if (const auto necks = coupled_.hold_necks(context); necks.before > 0) {
    context.tell(
        fmt::format("{} of one voxel {} lost where light spreads; asked for before all else, {}",
                    necks.before == 1 ? "a neck" : fmt::format("{} necks", necks.before),
                    necks.before == 1 ? "was" : "were",
                    necks.after == 0 ? "all hold" : fmt::format("{} still are", necks.after)));
  }
  if (plans.robust()) {
    const RobustCases& cases = plans.cases(plans.models().map().reference());
    const CoupledCorrection::Held held = coupled_.hold_in(cases.weak, cases.strong, context);
    RobustFigures figures;
    figures.features = held.before.lost;
    figures.gaps = held.before.filled;
    figures.lost = held.after.lost;
    figures.filled = held.after.filled;
    figures.moved_edges = held.aims;
    plans.note(figures);
  }
}

void TogetherCorrected::read_band(const PixelBox& band, const SliceSource::Sink& sink) const {
  std::vector<std::uint8_t> room;
  const PixelsOfLevels pixels(plans_.levels());
  coupled_.read(band, [&](int n, const std::uint8_t* rows) {
    sink(n, rows ? pixels(rows, columns_of(band), room) : nullptr);
  });
}

}  // namespace slicecorr::detail
