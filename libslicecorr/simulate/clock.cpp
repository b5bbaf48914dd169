// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <limits>

#include "slicecorr/inhibited.hpp"
#include "slicecorr/simulate.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

PrintClock::PrintClock(const Process& process, double m, double layer_um, int slices) {
  start_s_.reserve(static_cast<std::size_t>(slices) + 1);
  start_s_.push_back(0);
  for (int n = 0; n < slices; ++n) {
    start_s_.push_back(start_s_.back() + slice_light(process, m, layer_um, n, slices).time_s);
  }
}

PrintClock::Moment PrintClock::at(double time_s) const {
  if (!(time_s > 0)) return {0, 0};
  if (time_s >= total_s()) return {slices() - 1, 1};
  const auto end = std::lower_bound(start_s_.begin(), start_s_.end(), time_s);
  const auto n = static_cast<int>(end - start_s_.begin()) - 1;
  const double start = *(end - 1);
  return {n, *end == time_s ? 1.0 : (time_s - start) / (*end - start)};
}

double PrintClock::time_s(const Moment& moment) const {
  const auto n = static_cast<std::size_t>(moment.slice);
  if (moment.share >= 1) return start_s_[n + 1];
  return start_s_[n] + moment.share * (start_s_[n + 1] - start_s_[n]);
}

PrintClock print_clock(const Setup& setup, const Grid& grid) {
  const CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, grid.layer_um);
  return {setup.process, model.m, grid.layer_um, grid.layers};
}

std::vector<double> group_times_s(const PrintClock& clock, int groups) {
  std::vector<double> times;
  const int count = std::clamp(groups, 1, std::max(1, clock.slices()));
  for (int g = 1; g <= count; ++g) {
    const auto slices = static_cast<std::int64_t>(clock.slices()) * g / count;
    times.push_back(clock.time_s({static_cast<int>(slices) - 1, 1}));
  }
  return times;
}

double added_dose(const CureModel& model, const PrintClock::Moment& moment, int level, double x) {
  const double f = moment.share;
  if (f <= 0) return 0;
  if (model.inhibited()) {
    return model.ratio(moment.slice) *
           model.inhibited()->added(moment.slice, level, moment.slice + 1 - x, f);
  }
  return added_dose_of_light(model, moment, model.level_phi[static_cast<std::size_t>(level)], x);
}

double added_dose(const CureModel& model, const PrintClock::Moment& moment, const FrontLight& light,
                  double x) {
  if (moment.share <= 0 || light.amount == 0) return 0;
  return model.ratio(moment.slice) * static_cast<double>(light.amount) *
         model.inhibited()->added(moment.slice, light.front, moment.slice + 1 - x, moment.share);
}

double added_dose_of_light(const CureModel& model, const PrintClock::Moment& moment, double phi,
                           double x) {
  const double f = moment.share;
  if (f <= 0) return 0;
  phi *= model.returned(moment.slice + 1 - x) * model.ratio(moment.slice);
  const double fall = model.eta * units::kLn10;
  const double depth =
      model.bath_slices > 0 ? model.bath_slices : std::numeric_limits<double>::infinity();
  if (model.mode == ExposureMode::layerwise) {
    if (x > depth) return 0;
    return f * phi * std::exp(-x * fall);
  }
  // The window went from `from` to x - 1 + f slices above the point.
  const double from = std::max(0.0, x - 1.0), to = std::min(x - 1.0 + f, depth);
  return to > from ? phi * std::exp(-from * fall) * -std::expm1((from - to) * fall) : 0.0;
}

}  // namespace slicecorr
