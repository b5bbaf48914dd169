// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/light_goal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/shown_light.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// How many times the least turns light may take, attempt by attempt.
constexpr std::array<double, 2> kTimesLeast{4, 64};
/// Contrast that is enough: a fifth more time until void gels.
constexpr double kEnough = 1.2;
/// More contrast than this share above what was found is worth more time.
constexpr double kWorthMore = 1.02;
/// With a time that is fixed light stays this far below the brightest, for what rounding costs.
constexpr double kBelowCap = 0.98;

/// Of the calibration's light: where the projector is dimmest before the resin, and in the mean.
struct Shares {
  double least = 1, mean = 1;
};
Shares shares_of(const Bench& bench) {
  if (!bench.places.uneven()) return {};
  double least = std::numeric_limits<double>::infinity(), sum = 0, count = 0;
  for (int m = 0; m < bench.grid.angles; ++m) {
    for (int c = 0; c < bench.grid.pixels; ++c) {
      for (int z = 0; z < bench.grid.light_rows(); ++z) {
        const double share = bench.places.share(m, c, z);
        if (!(share > 0)) continue;
        least = std::min(least, share);
        sum += share;
        ++count;
      }
    }
  }
  return {least, sum / count};
}

/// Most light that prints in so many turns where the projector shines as its calibration says.
double cap_of_calibration(const Bench& bench, int turns) {
  return kBelowCap * dose_of_turn(bench.grid, bench.exposure) * turns * bench.mw_cm2.back() /
         (bench.exposure.critical_mj_cm3 + bench.resupply_mj_cm3_s * bench.exposure.turn_s * turns);
}

}  // namespace

LightGoal::LightGoal(const Bench& bench, double turns)
    : critical_mj_cm3_(bench.exposure.critical_mj_cm3),
      back_mj_cm3_(bench.resupply_mj_cm3_s * bench.exposure.turn_s),
      least_turns_(turns) {}

int LightGoal::turns() const {
  const double turns =
      std::ceil(kTimesLeast[static_cast<std::size_t>(attempt_)] * least_turns_ * (1 - 1e-9));
  return static_cast<int>(std::clamp(turns, 1.0, 1e6));
}

bool LightGoal::last() const { return attempt_ + 1 == static_cast<int>(kTimesLeast.size()); }

bool LightGoal::enough(const FoundLight& found, double contrast, int turns) const {
  if (found.contrast_bound < kWorthMore * contrast) return true;
  // Inhibitors take as much in void.
  const double back = back_mj_cm3_ * turns;
  return critical_mj_cm3_ >= kEnough * ((critical_mj_cm3_ + back) / contrast - back);
}

double likely_cap(const Bench& bench, int turns) {
  return cap_of_calibration(bench, turns) * shares_of(bench).mean;
}

double cap_of_turns(const Bench& bench, int turns) {
  return cap_of_calibration(bench, turns) * shares_of(bench).least;
}

double least_turns(const Bench& bench, const Projector& projector, const Target& target,
                   bool spreads, const ExecutionContext& context) {
  const auto brightest = static_cast<std::uint16_t>(bench.mw_cm2.size() - 1);
  const std::vector<std::uint16_t> levels(bench.grid.blocks() * bench.grid.light_of_block(),
                                          brightest);
  const Field dose = adjoint(projector, context, shown_light(bench, levels));
  const WeakVoxel weakest = weakest_voxel(target, dose.values);
  // Such a voxel is named by who looks for light.
  if (!(weakest.dose > 0)) return 1;
  const double unit = dose_of_turn(bench.grid, bench.exposure);
  const double back = bench.resupply_mj_cm3_s * bench.exposure.turn_s;
  const double most =
      spreads ? *std::max_element(dose.values.begin(), dose.values.end()) : weakest.dose;
  if (!(unit * most > back)) {
    throw InfeasibleError(fmt::format(
        "inhibitor comes back as fast as light takes it: {:.4g} mJ/cm³ a second, and {} gets {:.4g} "
        "where all pixels are at their brightest; expected more light",
        bench.resupply_mj_cm3_s, spreads ? "no voxel more than another that" : weakest.name,
        unit * most / bench.exposure.turn_s));
  }
  const double turn = std::max(unit * weakest.dose, 1e-6 * unit * most) - back;
  return turn > 0 ? bench.exposure.critical_mj_cm3 / turn : 1e6;
}

void check_turns(const Bench& bench, double least_turns, int most_turns) {
  // What is printed is judged by sums of its own, which may differ by so much.
  constexpr double kSure = 1.02;
  if (least_turns <= kSure * most_turns) return;
  const double turns = std::ceil(least_turns / kSure);
  throw InfeasibleError(fmt::format(
      "printing takes {:.0f} turns or more, {:g} s, with all pixels at their brightest, longer than allowed; "
      "more light would shorten it",
      turns, turns * bench.exposure.turn_s));
}

Turns turns_for(const Bench& bench, double turn_mj_cm3, int planned) {
  const double back = bench.resupply_mj_cm3_s * bench.exposure.turn_s;
  if (!(turn_mj_cm3 > back)) {
    return {planned, bench.exposure.critical_mj_cm3 + back * planned, true};
  }
  const double turns =
      std::ceil(bench.exposure.critical_mj_cm3 / (turn_mj_cm3 - back) * (1 - 1e-9));
  if (!(turns < 1e9)) throw InfeasibleError("the part gets too little light to gel in any time");
  const int count = std::max(1, static_cast<int>(turns));
  return {count, bench.exposure.critical_mj_cm3 + back * count};
}

void tell_levels(const ExecutionContext& context, const Bench& bench, double contrast_of_light,
                 const PrintFigures& figures, std::uint16_t top) {
  constexpr double kLost = 0.97;
  const double back = bench.resupply_mj_cm3_s * figures.print_time_s;
  const double part = figures.gel_dose_mj_cm3, empty = (part + back) / contrast_of_light - back;
  const std::size_t levels = bench.mw_cm2.size();
  if (2 * std::size_t{top} >= levels || figures.turns > 1 || !(empty > 0)) return;
  if (figures.metrics.contrast >= kLost * part / empty) return;
  context.tell(fmt::format(
      "the projector is so bright that the print takes {} of its {} levels: contrast {:.4g}, where "
      "the light that was found has {:.4g}; expected a lamp dimmed to {:.2g} %, with that in the "
      "printer's calibration, or a stage that turns faster",
      top + 1, levels, figures.metrics.contrast, part / empty,
      100 * bench.mw_cm2[top] / bench.mw_cm2.back()));
}

}  // namespace slicecorr::tomo::detail
