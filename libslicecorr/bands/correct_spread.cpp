// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/correct_spread.hpp"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "bands/correct_group.hpp"
#include "bands/design_band.hpp"
#include "bands/pixels_of_levels.hpp"
#include "bands/robust_design.hpp"
#include "slicecorr/place_models.hpp"

namespace slicecorr::detail {

namespace {

/// `share` of each pixel's place.
LightShares shares_of(const PlaceModels& models, std::function<double(std::uint8_t)> share) {
  return [&models, share = std::move(share)](const PixelBox& box, double* shares) {
    std::vector<std::uint8_t> values(columns_of(box));
    models.map().values(box, values.data());
    for (std::size_t k = 0; k < values.size(); ++k) shares[k] = share(values[k]);
  };
}

/// The place that all columns are counted from: where UV light is uneven the one that keeps the thinnest dead zone.
const CorrectionPlan& base_plan(const PlacePlans& plans) {
  const PlaceModels& models = plans.models();
  return models.of_uv() ? plans.plan(models.map().greatest()) : plans.plan();
}

CoupledOptions options_of(int rounds, const PlacePlans& plans, const DoseTarget* doses,
                          const std::string& scratch_folder) {
  CoupledOptions options;
  options.doses = doses;
  options.rounds = rounds;
  options.scratch_folder = scratch_folder;
  const PlaceModels& models = plans.models();
  if (models.even()) return options;
  if (models.of_uv()) {
    options.uv = {shares_of(models, [&](std::uint8_t v) { return uv_share(models, v); }),
                  most_uv_share(models),
                  [&plans, &models](const Pixel& p) -> const CorrectionPlan& {
                    return plans.plan(models.map().value(p.x, p.y));
                  }};
    const double base = models.curing_factor(models.map().greatest()), m = models.brightest().m;
    if (models.paired()) {
      options.shares = shares_of(models, [&models, base, m](std::uint8_t v) {
        return std::pow(models.curing_factor(v) / base, m);
      });
    }
    return options;
  }
  const double m = models.brightest().m;
  options.shares = shares_of(
      models, [&models, m](std::uint8_t v) { return std::pow(models.map().factor(v), m); });
  return options;
}

CoupledOptions with_distances(CoupledOptions options, const SpreadLight& light) {
  if (!light.distances().empty()) options.distances = &light.distances();
  return options;
}

}  // namespace

TogetherCorrected::TogetherCorrected(const SliceSource& target, const PlacePlans& plans, int rounds,
                                     const std::string& scratch_folder,
                                     const ExecutionContext& context)
    : plans_(plans),
      light_(plans.models(), target.grid(), target.frame()),
      coupled_(base_plan(plans), light_.blur(), target.bounds(), light_.display(),
               with_distances(options_of(rounds, plans, target.doses(), scratch_folder), light_)) {
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
