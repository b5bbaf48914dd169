// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "cure/front_profile.hpp"
#include "cure/limits.hpp"
#include "cure/walkers.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

double uv_for_dead_zone(const Kinetics& k, double blue_mw_cm2, double dead_zone_um) {
  return blue_mw_cm2 / k.beta * std::exp(dead_zone_um * (1.0 / k.huv_um - 1.0 / k.hb_um));
}

namespace {

/// Throws where the lamp can't give an intensity, with what would work.
struct LampCheck {
  const Kinetics& kinetics;
  double layer_um;
  const std::vector<double>& blue_mw_cm2;  ///< by level
  double full_mw_cm2;                      ///< the brightest that dead zones are held against
  const Printer& printer;
  const Process& process;

  void operator()(double intensity, const std::string& what) const {
    const double least = printer.uv->min_mw_cm2(), most = printer.uv->max_mw_cm2();
    if (intensity <= most * (1 + 1e-9) && intensity >= least * (1 - 1e-9)) return;
    std::string text = fmt::format(
        "{} needs {:.4g} mW/cm² of UV light; the lamp of printer '{}' gives {} to {} mW/cm²", what,
        intensity, printer.name, at_least(least, 12), at_most(most, 12));
    const auto works = [&](const std::optional<double>& value, const char* words) {
      text += value ? fmt::format(fmt::runtime(words), *value)
                    : std::string("; none of its intensities works here");
    };
    // What would do in resin that ends is not looked for.
    if (printer.resin_depth_um > 0) throw InfeasibleError(text);
    if (process.uv.dead_zone_um > 0) {
      works(detail::working_dead_zone_um(kinetics, layer_um, blue_mw_cm2, full_mw_cm2, *printer.uv,
                                         process),
            "; a dead zone of {} um works");
    } else if (process.uv.kind == UvKind::constant) {
      works(detail::working_uv(kinetics, layer_um, blue_mw_cm2, *printer.uv, process),
            "; UV light of {} mW/cm² works");
    }
    throw InfeasibleError(text);
  }
};

/// Distances from the window that differ by less of themselves are the same.
constexpr double kSameDepth = 1e-9;

/// Slices above the window in which UV light still takes more than
/// `InhibitedKernel::kTailShare` of the dose.
int slices_near_window(const Kinetics& kinetics, double uv_mw_cm2, double blue_mw_cm2,
                       double layer_um) {
  // A place without light has nothing to lose.
  const double share = blue_mw_cm2 > 0 ? kinetics.beta * uv_mw_cm2 / blue_mw_cm2 : 0;
  const double slope = 1.0 / kinetics.huv_um - 1.0 / kinetics.hb_um;
  return share > InhibitedKernel::kTailShare
             ? 2 + static_cast<int>(std::ceil(std::log(share / InhibitedKernel::kTailShare) /
                                              (slope * layer_um)))
             : 2;
}

/// The least height of a layer, um.
double thinnest_um(const Process& process, double layer_um) {
  const std::vector<double>& um = process.layer_heights_um;
  return um.empty() ? layer_um : *std::min_element(um.begin(), um.end());
}

/// What there is of usual blue light in a slice, and that over the share of UV light that comes.
using Shares = std::vector<InhibitedKernel::BlueShare>;

/// Empty: of all slices all.
Shares blue_shares(const Process& process) {
  Shares shares;
  // Only of lamps that show patterns it is not in what they are asked for (`as_lamp_shines`).
  const std::vector<double>& lamp = process.uv_lamp_share;
  if (!light_differs(process) && lamp.empty()) return shares;
  for (std::size_t n = 0; n < std::max(process.light_share.size(), lamp.size()); ++n) {
    const double comes = lamp.empty() ? 1 : lamp[std::min(n, lamp.size() - 1)];
    const double blue = light_share(process, static_cast<int>(n)) / usual_light_share(process);
    shares.push_back({blue, blue / comes});
  }
  return shares;
}

double most_over_uv(const Shares& shares) {
  double most = shares.empty() ? 1 : 0;
  for (const InhibitedKernel::BlueShare& share : shares) most = std::max(most, share.over_uv);
  return most;
}

}  // namespace

InhibitedKernel::InhibitedKernel(const Kinetics& kinetics, const Kinetics& gel,
                                 const Printer& printer, const Process& process, double layer_um,
                                 std::vector<double> level_mw_cm2,
                                 const std::vector<double>& brightest_mw_cm2)
    : kinetics_(kinetics),
      gel_(gel),
      mode_(process.mode),
      allow_window_cure_(process.allow_window_cure),
      layer_um_(layer_um),
      blue_(std::move(level_mw_cm2)) {
  if (!printer.uv) {
    throw InputError(printer.name, "uv",
                     "the printer has no UV lamp; expected a [uv] table with its calibration");
  }
  const UvSchedule& uv = process.uv;
  wanted_um_ = uv.dead_zone_um;
  const double most = printer.uv->max_mw_cm2();
  const std::vector<double>& held = brightest_mw_cm2.empty() ? blue_ : brightest_mw_cm2;
  const Shares shares = blue_shares(process);
  const double most_share = most_over_uv(shares);
  // Of pixels with UV light of their own, which must hold their dead zone where most light comes back, too.
  const double most_back = 1 + printer.platform_reflectance;
  const double full = held.back() * most_share;
  const double most_held = uv.kind == UvKind::patterned ? full * most_back : full;
  const LampCheck check{kinetics_, layer_um, blue_, most_held, printer, process};
  switch (uv.kind) {
    case UvKind::off:
      throw InputError("UV light is off in this schedule; expected an intensity or a dead zone");
    case UvKind::constant: {
      const double asked =
          uv.uv_mw_cm2 > 0 ? uv.uv_mw_cm2 : uv_for_dead_zone(kinetics_, full, uv.dead_zone_um);
      check(asked, uv.uv_mw_cm2 > 0
                       ? std::string("the schedule")
                       : fmt::format("a dead zone of {:g} um under full light", uv.dead_zone_um));
      take_settings({asked}, shares);
      break;
    }
    case UvKind::per_slice: {
      if (uv.slice_mw_cm2.empty()) {
        // Until the slices are known, the UV light that full blue light needs.
        const double asked =
            uv.dead_zone_um > 0 ? uv_for_dead_zone(kinetics_, full, uv.dead_zone_um) : uv.uv_mw_cm2;
        check(asked, fmt::format("a dead zone of {:g} um under full light", uv.dead_zone_um));
        setting_uv_ = {asked / most_share};
        break;
      }
      for (const double asked : uv.slice_mw_cm2) check(asked, "a slice of the schedule");
      take_settings(uv.slice_mw_cm2, shares);
      break;
    }
    case UvKind::patterned: {
      if (process.even_light) {
        // The dose beside the part's place in the flow depends on it little: the mean stands for all.
        for (const double mean : uv.slice_mw_cm2) check(mean, "a slice of the schedule");
        take_settings(uv.slice_mw_cm2, shares);
        break;
      }
      const LevelTable lamp(uv_level_intensities(printer));
      check(uv_for_dead_zone(kinetics_, full * most_back, uv.dead_zone_um),
            fmt::format("a dead zone of {:g} um under full light", uv.dead_zone_um));
      for (const double of_level : held) {
        // Of pulses each that is not black is full light.
        const bool full_light = printer.grey == GreyLight::pulsed && of_level > held.front();
        const double blue = full_light ? held.back() : of_level;
        // The next level up, so that the dead zone is no thinner than asked for: not in the slice with the most
        // blue light over its UV light either.
        uv_levels_.push_back(lamp.at_least(
            uv_for_dead_zone(kinetics_, blue * most_share * most_back, uv.dead_zone_um) *
            (1 - 1e-12)));
        level_uv_.push_back(lamp.phi(uv_levels_.back()));
      }
      const double whole = level_uv_.back();
      take_settings(uv.slice_mw_cm2.empty() ? std::vector{most} : uv.slice_mw_cm2, shares);
      for (double& setting : setting_uv_) {
        setting_share_.push_back(setting / most);
        setting = whole * setting_share_.back();
      }
      break;
    }
  }

  a_ = std::exp(-kinetics_.m * layer_um / kinetics_.hb_um);
  if (mode_ == ExposureMode::layerwise) {
    scale_ = process.exposure_s / kinetics_.critical_dose_prime;
    gel_scale_ = process.exposure_s / gel_.critical_dose_prime;
  } else {
    const double speed_um_s = units::cm_s_from_mm_h(process.speed_mm_h) * 1e4;
    scale_ = 1.0 / (speed_um_s * kinetics_.critical_dose_prime);
    gel_scale_ = layer_um / (speed_um_s * gel_.critical_dose_prime);
  }
  const double strongest = *std::max_element(setting_uv_.begin(), setting_uv_.end());
  near_ = slices_near_window(kinetics_, strongest, blue_.back(), thinnest_um(process, layer_um));
  profile_ = std::make_shared<const detail::FrontProfile>(kinetics_);
  take_sources(printer.grey == GreyLight::pulsed);
  if (process.even_light) {
    if (mode_ == ExposureMode::layerwise) {
      throw InputError(
          "even light is for continuous exposure; layer by layer the part stands still");
    }
    count_flow(*process.even_light, level_intensities(printer).back() * usual_light_share(process));
    near_ =
        std::max(near_, 2 + static_cast<int>(std::ceil(gap_um_ / thinnest_um(process, layer_um))));
  }
  end_resin(printer.resin_depth_um);
  surround(printer, process);
  make_tables();
}

void InhibitedKernel::take_sources(bool pulsed) {
  const double black = blue_.front(), full = blue_.back();
  const auto source_of = [&](double light, double uv) -> Source {
    const double front = profile_->front_um(light, kinetics_.beta * uv);
    return {scale_ * profile_->amount(light, front), front};
  };
  for (int s = 0; s < settings(); ++s) {
    for (int l = 0; l < levels(); ++l) {
      const double light = blue_[static_cast<std::size_t>(l)], uv = uv_of(s, l);
      if (!pulsed || !(full > black)) {
        sources_.push_back(source_of(light, uv));
        continue;
      }
      const double share = (light - black) / (full - black);
      Pulses pulses{source_of(full, uv), source_of(black, uv)};
      pulses.full.amount *= share / scale_;
      pulses.black.amount *= (1 - share) / scale_;
      sources_.push_back({scale_, share > 0 ? pulses.full.front_um : pulses.black.front_um});
      pulses_.push_back(pulses);
    }
  }
}

void InhibitedKernel::end_resin(double depth_um) {
  if (!(depth_um > 0)) return;
  // A depth of so many slices must not become one less by rounding.
  const double slices = std::floor(depth_um / layer_um_ * (1 + 1e-12));
  // Less than this of a slice's light is nothing (cure_model.cpp).
  constexpr double no_light = 1e-12;
  if (slices < 1 || std::pow(a_, slices) < no_light) return;
  depth_um_ = slices * layer_um_;
  if (depth_um_ <= gap_um_) {
    throw InputError(fmt::format(
        "the resin is {:g} um deep, no more than the dead zone of {:g} um that light is for; expected more resin, or "
        "a thinner dead zone",
        depth_um_, gap_um_));
  }
  // The last row of the tables is 0, and so is what follows from it further away.
  near_ = static_cast<int>(slices) + 2;
}

void InhibitedKernel::make_tables() {
  fine_.resize(static_cast<std::size_t>(settings()));
  fine_made_ = std::make_unique<std::once_flag[]>(fine_.size());
  tables_.resize(static_cast<std::size_t>(settings() * kPlaces));
  last_rows_.resize(slice_of_setting_.empty() ? 0 : tables_.size());
  for (int s = 0; s < settings(); ++s) tabulate(s);
}

/// How often the light of the gap counts at each level. Light between the least and the greatest even
/// light is the even light of its place.
void InhibitedKernel::count_flow(const EvenLight& light, double full_mw_cm2) {
  gap_um_ = light.gap_um;
  least_even_mw_cm2_ = light.least_blue() / 255.0 * full_mw_cm2;
  greatest_even_mw_cm2_ = light.greatest_blue() / 255.0 * full_mw_cm2;
  while (least_even_level_ + 1 < levels() &&
         blue_[static_cast<std::size_t>(least_even_level_) + 1] <=
             least_even_mw_cm2_ * (1 + 1e-9)) {
    ++least_even_level_;
  }
  for (int s = 0; s < settings(); ++s) {
    for (int l = 0; l < levels(); ++l) {
      flow_factor_.push_back(flow_factor_with(s, l, 1.0));
      rest_at_gap_.push_back(profile_->rest(gap_um_ - source(s, l).front_um));
    }
  }
}

/// The same where the platform sends back so much that blue light counts `back` times.
double InhibitedKernel::flow_factor_with(int setting, int level, double back) const {
  const double share = blue_share(setting);
  const double blue = std::clamp(blue_[static_cast<std::size_t>(level)] * share * back,
                                 least_even_mw_cm2_, greatest_even_mw_cm2_) /
                      share;
  const double front = profile_->front_um(blue, kinetics_.beta * uv_of(setting, level));
  const double still = scale_ * std::pow(share, kinetics_.m) * profile_->amount(blue, front) *
                       (profile_->rest(-front) - profile_->rest(gap_um_ - front));
  return std::clamp(1.0 / std::max(still, 1e-9), 1.0 / kMostFlowFactor, kMostFlowFactor);
}

double InhibitedKernel::rest(int setting, int level, double d_um, const Back& back) const {
  if (!ends()) return rest_beyond(setting, level, d_um, back);
  if (d_um >= depth_um_) return 0;
  return rest_beyond(setting, level, d_um, back) - rest_beyond(setting, level, depth_um_, back);
}

double InhibitedKernel::rate(int setting, int level, double d_um, const Back& back) const {
  if (ends() && d_um > depth_um_ * (1 + kSameDepth)) return 0;
  const double d = d_um + back.nearer_um;
  if (!pulses_.empty()) {
    const Pulses& both = pulses_[static_cast<std::size_t>(setting * levels() + level)];
    return back.times * (both.full.amount * profile_->rate(d - both.full.front_um) +
                         both.black.amount * profile_->rate(d - both.black.front_um));
  }
  return back.times * profile_->rate(d - source(setting, level).front_um);
}

double InhibitedKernel::rest_beyond(int setting, int level, double d_um, const Back& back) const {
  const double d = d_um + back.nearer_um;
  if (!pulses_.empty()) {
    const Pulses& both = pulses_[static_cast<std::size_t>(setting * levels() + level)];
    return back.times * (both.full.amount * profile_->rest(d - both.full.front_um) +
                         both.black.amount * profile_->rest(d - both.black.front_um));
  }
  const double front = source(setting, level).front_um;
  if (flow_factor_.empty()) return back.times * profile_->rest(d - front);
  // Out of line: where nothing flows this is called for each number of all tables.
  const auto flowing = [&]() __attribute__((noinline)) {
    const double at = back.times * profile_->rest(d - front);
    if (d_um >= gap_um_) return at;
    const bool sent_back = back.nearer_um > 0;
    const double at_gap =
        back.times * (sent_back
                          ? profile_->rest(gap_um_ + back.nearer_um - front)
                          : rest_at_gap_[static_cast<std::size_t>(setting * levels() + level)]);
    const double often =
        sent_back ? flow_factor_with(setting, level, back.blue) : flow_factor(setting, level);
    return at_gap + often * (at - at_gap);
  };
  return flowing();
}

/// One setting for each different intensity over usual blue light.
void InhibitedKernel::take_settings(const std::vector<double>& asked_mw_cm2,
                                    const std::vector<BlueShare>& shares) {
  for (std::size_t n = 0; n < std::max(asked_mw_cm2.size(), shares.size()); ++n) {
    const BlueShare share = shares.empty() ? BlueShare{} : shares[std::min(n, shares.size() - 1)];
    const double intensity = asked_mw_cm2[std::min(n, asked_mw_cm2.size() - 1)] / share.over_uv;
    // What light of a place stands for counts, too, where it is even.
    std::size_t found = 0;
    while (found < setting_uv_.size() &&
           (setting_uv_[found] != intensity || blue_share_[found] != share.blue)) {
      ++found;
    }
    slice_setting_.push_back(static_cast<std::uint16_t>(found));
    if (found == setting_uv_.size()) {
      setting_uv_.push_back(intensity);
      blue_share_.push_back(share.blue);
    }
    if (setting_uv_.size() > 4096) {
      throw InputError("the schedule has more than 4096 different UV intensities");
    }
  }
}

int InhibitedKernel::setting_of_slice(int slice) const {
  if (slice_setting_.empty()) return 0;
  const auto n = static_cast<std::size_t>(std::max(slice, 0));
  return n < slice_setting_.size() ? slice_setting_[n] : slice_setting_.back();
}

void InhibitedKernel::tabulate(int setting) {
  if (slice_of(setting) >= 0) {
    tabulate_around(setting);
    return;
  }
  const auto rows = static_cast<std::size_t>(near_), count = blue_.size();
  double* at[kPlaces];
  for (int place = 0; place < kPlaces; ++place) {
    auto& table = tables_[static_cast<std::size_t>(setting * kPlaces + place)];
    table.assign(rows * count, 0.0);
    at[place] = table.data();
  }
  for (std::size_t l = 0; l < count; ++l) {
    const Source& from = source(setting, static_cast<int>(l));
    const auto put = [&](std::size_t i, double value) {
      if (i < 4 * rows) at[i % 4][i / 4 * count + l] = value;
      if (i % 4 == 0 && i > 0) at[upper_end][(i / 4 - 1) * count + l] = value;
    };
    if (mode_ == ExposureMode::layerwise) {
      for (std::size_t i = 0; i <= 4 * rows; ++i) {
        const double d = 0.25 * static_cast<double>(i) * layer_um_;
        put(i, from.amount * rate(setting, static_cast<int>(l), d));
      }
      // At a layer's lower end its inside counts, which lies beyond the end already.
      const auto end = static_cast<std::size_t>(std::lround(depth_um_ / layer_um_));
      if (ends() && end < rows) at[lower_end][end * count + l] = 0;
      continue;
    }
    const auto level = static_cast<int>(l);
    double last[4];  // what lies beyond the places one slice and less before
    std::fill_n(last, 4, rest(setting, level, 0));
    for (std::size_t i = 0; i <= 4 * rows; ++i) {
      const double beyond = rest(setting, level, 0.25 * static_cast<double>(i) * layer_um_);
      put(i, from.amount * (last[i % 4] - beyond));
      last[i % 4] = beyond;
    }
  }
}

const float* InhibitedKernel::fine(int setting) const {
  std::vector<float>& table = fine_[static_cast<std::size_t>(setting)];
  std::call_once(fine_made_[static_cast<std::size_t>(setting)], [&] {
    const auto rows = static_cast<std::size_t>(near_), count = blue_.size();
    table.resize(rows * count * kSamples);
    if (const int slice = slice_of(setting); slice >= 0) {
      for (std::size_t at = 0; at < table.size(); ++at) {
        const auto level = static_cast<int>(at / kSamples / rows);
        const int layer = slice - static_cast<int>(at / kSamples % rows);
        const double below = static_cast<double>(at % kSamples + 1) / kSamples;
        table[at] = static_cast<float>(added_by(setting, slice, level, layer + 1 - below, 1.0));
      }
      return;
    }
    const double step = layer_um_ / kSamples;
    for (std::size_t l = 0; l < count; ++l) {
      const Source& from = source(setting, static_cast<int>(l));
      const auto level = static_cast<int>(l);
      double last[kSamples];
      std::fill_n(last, kSamples, layer_by_layer() ? 0.0 : rest(setting, level, 0));
      for (std::size_t j = 0; j < rows; ++j) {
        float* const out = &table[(l * rows + j) * kSamples];
        for (std::size_t i = 0; i < kSamples; ++i) {
          const double d = static_cast<double>(j * kSamples + i + 1) * step;
          if (layer_by_layer()) {
            out[i] = static_cast<float>(from.amount * rate(setting, level, d));
            continue;
          }
          const double beyond = rest(setting, level, d);
          out[i] = static_cast<float>(from.amount * (last[i] - beyond));
          last[i] = beyond;
        }
      }
    }
  });
  return table.data();
}

double InhibitedKernel::exact(int setting, int level, double x, double share) const {
  if (const int slice = slice_of(setting); slice >= 0) {
    return added_by(setting, slice, level, slice + 1 - x, share);
  }
  const Source& from = source(setting, level);
  const double to = x * layer_um_;
  if (mode_ == ExposureMode::layerwise) {
    return share * from.amount * rate(setting, level, to);
  }
  const double begin = std::max(0.0, x - 1.0) * layer_um_;
  const double end = share < 1.0 ? to - (1.0 - share) * layer_um_ : to;
  if (!(end > begin)) return 0;
  return from.amount * (rest(setting, level, begin) - rest(setting, level, end));
}

double InhibitedKernel::steady_at(LayerPosition place, int setting, int level) const {
  if (const int slice = slice_of(setting); slice >= 0) {
    // Of layers like the slice's, far from the platform.
    return steady_dose_at(setting, level, {height_um(slice), 1e9, 0.25 * static_cast<int>(place)});
  }
  const double* upper = table(setting, place);
  const auto count = blue_.size();
  double sum = 0;
  for (int j = near_; j-- > 0;) {
    sum += upper[static_cast<std::size_t>(j) * count + static_cast<std::size_t>(level)];
  }
  const double last =
      upper[static_cast<std::size_t>(near_ - 1) * count + static_cast<std::size_t>(level)];
  return sum + last * a_ / (1.0 - a_);
}

double InhibitedKernel::setting_dead_zone_um(int setting, int level) const {
  if (fronts_per_um_ > 0) return std::max(0.0, source(setting, level).front_um);
  if (gap_um_ > 0 && is_even(setting, level)) return gap_um_;
  const double blue = brightest_of(level), uv = uv_of(setting, level);
  return steady_dead_zone_um(kinetics_, front_blue(slice_of(setting), blue, uv), uv);
}

bool InhibitedKernel::level_keeps_dead_zone(int setting, int level) const {
  if (gap_um_ > 0) return true;
  if (fronts_per_um_ > 0) return source(setting, level).front_um > 0;
  return keeps_dead_zone(kinetics_, window_blue(setting, brightest_of(level)),
                         uv_of(setting, level));
}

double InhibitedKernel::first_gel_um(int slice, int level) const {
  if (fronts_per_um_ > 0) {
    // The rate is greatest so far above the front.
    const double above = std::log(kinetics_.hb_um / kinetics_.huv_um) /
                         (1.0 / kinetics_.huv_um - 1.0 / kinetics_.hb_um);
    return std::max(0.0, source(0, level).front_um + above);
  }
  const double uv = uv_mw_cm2(slice, level), blue = brightest_of(level);
  return first_gel(kinetics_, front_blue(slice_of(setting_of_slice(slice)), blue, uv), uv).z_um;
}

double InhibitedKernel::setting_window_dose(int setting, int level) const {
  if (fronts_per_um_ > 0) return gel_scale_ * profile_->rate(-source(setting, level).front_um);
  const auto window_dose = [&](double blue) {
    const double net = window_blue(setting, blue) - kinetics_.beta * uv_of(setting, level);
    return net > 0 ? gel_scale_ * std::pow(net, gel_.m) : 0.0;
  };
  const double light = blue_[static_cast<std::size_t>(level)];
  if (pulses_.empty()) return window_dose(light);
  const double share = (light - blue_.front()) / (blue_.back() - blue_.front());
  return share * window_dose(blue_.back()) + (1 - share) * window_dose(blue_.front());
}

int InhibitedKernel::highest_usable_level(int setting) const {
  int level = levels() - 1;
  if (allow_window_cure_ || gap_um_ > 0) return level;
  for (; level > 0; --level) {
    const double blue = brightest_of(level), uv = uv_of(setting, level);
    // A pattern is made for just its dead zone: rounding must not make it fail.
    if (keeps_dead_zone(kinetics_, window_blue(setting, blue), uv) &&
        setting_dead_zone_um(setting, level) >= wanted_um_ * (1 - 1e-9)) {
      break;
    }
  }
  return level;
}

int InhibitedKernel::strongest_setting() const {
  return static_cast<int>(std::max_element(setting_uv_.begin(), setting_uv_.end()) -
                          setting_uv_.begin());
}

bool InhibitedKernel::any_level_cures_to_window() const {
  for (int s = 0; s < settings(); ++s) {
    for (int level = 0; level < levels(); ++level) {
      if (!level_keeps_dead_zone(s, level)) return true;
    }
  }
  return false;
}

double InhibitedKernel::critical_intensity_mw_cm2(int setting) const {
  double before = 0, at = 0;
  for (int level = 0; level < levels(); ++level) {
    const double dose = steady_dose(setting, level);
    const double blue = blue_[static_cast<std::size_t>(level)];
    if (dose >= 1.0) {
      if (level == 0 || dose == before) return blue;
      return at + (blue - at) * (1.0 - before) / (dose - before);
    }
    before = dose;
    at = blue;
  }
  return std::numeric_limits<double>::infinity();
}

namespace detail {

std::shared_ptr<const InhibitedKernel> make_inhibited_kernel(
    const Printer& printer, const Resin& resin, const Process& process, double layer_um,
    const std::vector<double>& level_mw_cm2, double brightest) {
  const std::vector<double> held =
      level_intensities(brightest == 1 ? printer : dimmed(printer, brightest));
  return std::make_shared<const InhibitedKernel>(make_kinetics(resin, true, true),
                                                 make_kinetics(resin, true, false), printer,
                                                 process, layer_um, level_mw_cm2, held);
}

}  // namespace detail

}  // namespace slicecorr
