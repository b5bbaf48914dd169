// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/inhibited_layer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/kernels.hpp"
#include "cure/front_profile.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

namespace {

/// Crossings are found to this distance, um.
constexpr double kPrecisionUm = 0.002;
/// Samples are single numbers: they are right to this share of the dose.
constexpr double kSampleError = 1e-6;

// Loops over the samples of a layer, compiled for each instruction set with the same bits.

constexpr int kRow = InhibitedKernel::kSamples;

/// Adds rows of samples to `sum`.
SLICECORR_CLONES
void add_rows(const float* rows, int count, float weight, float* sum) {
  float now[kRow];
  for (int i = 0; i < kRow; ++i) now[i] = sum[i];
  for (int j = 0; j < count; ++j) {
    for (int i = 0; i < kRow; ++i) now[i] += weight * rows[j * kRow + i];
  }
  for (int i = 0; i < kRow; ++i) sum[i] = now[i];
}

/// What may happen in the cells between samples that have no kink.
struct Bends {
  double fall;   ///< of light in a cell
  double least;  ///< dose below which something happens
};
/// `dose`: kRow + 1 samples; `kink`: of each cell, 0: none, with one more cell at either end that
/// has one. `marked`: 1 where the dose may pass 1 or be less than the least, of cells without a kink.
SLICECORR_CLONES
void mark_straight(const double* dose, const double* kink, const Bends& bends,
                   std::int64_t* marked) {
  double rise[kRow + 2] = {};
  for (int i = 0; i < kRow; ++i) rise[i + 1] = dose[i + 1] - dose[i];
  for (int i = 0; i < kRow; ++i) {
    const double a = dose[i], b = dose[i + 1];
    const double error = kSampleError * (a + b);
    double low = a < b ? a : b, high = a < b ? b : a;
    const bool before = kink[i] == 0, after = kink[i + 2] == 0;
    const double from_before = before ? std::abs(rise[i + 1] - rise[i]) : 0.0,
                 to_after = after ? std::abs(rise[i + 2] - rise[i + 1]) : 0.0;
    const double sides = (before & after ? 1.0 : 2.0) * (from_before + to_after) + error;
    const double bend = before | after ? sides : bends.fall * high;
    const bool turns = std::abs(b - a) <= bend;
    low -= turns ? bend : 0.0;
    high += turns ? bend : 0.0;
    const double near = 2.0 * kSampleError;
    const bool passes = (low < 1.0 + near) & (high >= 1.0 - near);
    marked[i] = (passes | (turns & (low < bends.least))) & (kink[i + 1] == 0);
  }
}

}  // namespace

InhibitedLayer::InhibitedLayer(const InhibitedKernel& kernel, bool places)
    : kernel_(kernel),
      fall_(-std::log(kernel.a())),
      precision_(std::min(kPrecisionUm / kernel.layer_um(), 1e-3)),
      places_(places),
      fine_(static_cast<std::size_t>(kernel.settings()), nullptr),
      floor_(kernel) {
  steady_.resize(static_cast<std::size_t>(kernel.settings()));
  for (int i = 0; i < kSamples; ++i) fade_[i] = std::exp(-fall_ * (i + 1) / kSamples);
}

void InhibitedLayer::begin(double far, int layer) {
  far_ = far;
  lights_.clear();
  if (kernel_.alike()) return;
  layer_ = layer;
  const double um = kernel_.height_um(layer);
  fall_ = -std::log(kernel_.fade(um));
  for (int i = 0; i < kSamples; ++i) {
    const double t = static_cast<double>(i + 1) / kSamples;
    fade_[i] = std::exp(-fall_ * t) * kernel_.returned(kernel_.place_um(layer_ + 1 - t));
  }
}

void InhibitedLayer::add(int first, int last, int setting, int level, double weight) {
  if (weight == 0 || kernel_.source(setting, level).amount == 0) return;
  if (!lights_.empty()) {
    Light& before = lights_.back();
    if (before.last + 1 == first && before.setting == setting && before.level == level &&
        before.weight == weight) {
      before.last = last;
      return;
    }
  }
  lights_.push_back({first, last, setting, level, weight});
}

bool InhibitedLayer::stays(const LayerFloor::Doses& doses, double known) {
  if (!floor_.exists()) return false;
  floor_.begin();
  for (const Light& light : lights_) {
    floor_.add(light.first, light.last, light.setting, light.level, light.weight);
  }
  const double least = floor_.least(doses);
  return least >= std::min(known, doses.least()) && (least >= 1.0 || floor_.most(doses) < 1.0);
}

/// `at` where layers are not alike.
double InhibitedLayer::at_own_place(double t) const {
  const double place_um = kernel_.place_um(layer_ + 1 - t);
  const InhibitedKernel::Back back = kernel_.back(place_um);
  double dose = far_ * std::exp(-fall_ * t) * kernel_.returned(place_um);
  const auto away = [&](int n) { return std::max(0.0, kernel_.place_um(n) - place_um); };
  for (const Light& light : lights_) {
    double sum = 0;
    if (kernel_.layer_by_layer()) {
      for (int j = light.first; j <= light.last; ++j) {
        sum += kernel_.rate(light.setting, light.level, away(layer_ + j + 1), back);
      }
    } else {
      sum = kernel_.rest(light.setting, light.level, away(layer_ + light.first), back) -
            kernel_.rest(light.setting, light.level, away(layer_ + light.last + 1), back);
    }
    dose += light.weight * kernel_.source(light.setting, light.level).amount * sum;
  }
  return dose;
}

double InhibitedLayer::at(double t) const {
  if (!kernel_.alike()) return at_own_place(t);
  const double layer_um = kernel_.layer_um();
  double dose = far_ * std::exp(-fall_ * t);
  for (const Light& light : lights_) {
    const InhibitedKernel::Source& from = kernel_.source(light.setting, light.level);
    double sum = 0;
    if (kernel_.layer_by_layer()) {
      for (int j = light.first; j <= light.last; ++j) {
        sum += kernel_.rate(light.setting, light.level, (j + t) * layer_um);
      }
    } else {
      // Slices that follow each other with the same light are one long one.
      const double begin = std::max(0.0, light.first + t - 1.0) * layer_um;
      const double end = (light.last + t) * layer_um;
      sum = kernel_.rest(light.setting, light.level, begin) -
            kernel_.rest(light.setting, light.level, end);
    }
    dose += light.weight * from.amount * sum;
  }
  return dose;
}

void InhibitedLayer::sample(double lower, double middle, double upper) {
  float sum[kSamples] = {};
  const int near = kernel_.near();
  for (const Light& light : lights_) {
    const float*& table = fine_[static_cast<std::size_t>(light.setting)];
    if (!table) table = kernel_.fine(light.setting);
    const float* const fine = table + static_cast<std::size_t>(light.level * near) * kSamples;
    const auto weight = static_cast<float>(light.weight);
    add_rows(fine + static_cast<std::ptrdiff_t>(light.first) * kSamples,
             light.last - light.first + 1, weight, sum);
  }
  for (int i = 0; i < kSamples; ++i) dose_[i + 1] = static_cast<double>(sum[i]) + far_ * fade_[i];
  dose_[0] = lower;
  dose_[kSamples / 2] = middle;
  dose_[kSamples] = upper;
}

/// Where between two points the dose has its least (or greatest) value, by parabolas: there must be
/// no kink between them.
InhibitedLayer::Point InhibitedLayer::turn(const Point& from, const Point& to, bool least) const {
  const double sign = least ? 1.0 : -1.0;
  double x[3] = {from.t, 0.5 * (from.t + to.t), to.t};
  double y[3] = {sign * from.dose, sign * at(x[1]), sign * to.dose};
  for (int step = 0; step < 5; ++step) {
    const double left = (y[1] - y[0]) / (x[1] - x[0]), right = (y[2] - y[1]) / (x[2] - x[1]);
    if (!(right > left)) break;
    // The place t where the slope, linear between the middles of the two stretches, is 0.
    const double a = 0.5 * (x[0] + x[1]), b = 0.5 * (x[1] + x[2]);
    const double edge = 0.05 * (x[2] - x[0]);
    const double t = std::clamp(a - left * (b - a) / (right - left), x[0] + edge, x[2] - edge);
    if (std::abs(t - x[1]) < precision_) break;
    const double dose = sign * at(t);
    // Keep three places of which the middle one is the least.
    const int place = t < x[1] ? 0 : 2;
    if (dose < y[1]) {
      x[2 - place] = x[1];
      y[2 - place] = y[1];
      x[1] = t;
      y[1] = dose;
    } else {
      x[place] = t;
      y[place] = dose;
    }
  }
  const auto found = std::min_element(y, y + 3) - y;
  return {x[found], sign * y[found]};
}

double InhibitedLayer::crossing(double low, double high, bool rises) const {
  if (!places_) return low;
  FalsePosition root{low, high, at(low) - 1.0, at(high) - 1.0};
  while (root.high - root.low > precision_) {
    double t = 0.5 * (root.low + root.high);
    if ((root.at_low < 0) != (root.at_high < 0)) {
      // Not too near an end, or the other end would never move.
      const double edge = 0.25 * precision_;
      t = std::clamp(root.chord(), root.low + edge, root.high - edge);
    }
    const double y = at(t) - 1.0;
    root.take(t, y, (y >= 0) == rises);
  }
  return 0.5 * (root.low + root.high);
}

/// Computes anew, from the integral, the samples that decide something: those near 1, and the
/// least.
void InhibitedLayer::sharpen(double known) {
  const auto known_well = [](int i) { return i == 0 || i == kSamples / 2 || i == kSamples; };
  int least = 0;
  for (int i = 1; i <= kSamples; ++i) {
    if (!known_well(i) && std::abs(dose_[i] - 1.0) < 2.0 * kSampleError) {
      dose_[i] = at(static_cast<double>(i) / kSamples);
    }
    if (dose_[i] < dose_[least]) least = i;
  }
  if (!known_well(least) && dose_[least] < known)
    dose_[least] = at(static_cast<double>(least) / kSamples);
}

/// The place of a light's front in this layer; below 0 if it has none there.
double InhibitedLayer::front(const Light& light) const {
  if (!kernel_.alike()) return front_between(light);
  const double x = kernel_.source(light.setting, light.level).front_um / kernel_.layer_um();
  return x <= light.first || x >= light.last + 1 ? -1.0
                                                 : x - static_cast<double>(static_cast<int>(x));
}

/// `front` where layers are not alike: of the slices of a light one at most has its front in this layer, as they
/// stand no nearer to each other than the layer is high.
double InhibitedLayer::front_between(const Light& light) const {
  const double front_um = kernel_.source(light.setting, light.level).front_um;
  for (int j = light.first; j <= light.last; ++j) {
    const double window_um = kernel_.place_um(layer_ + j + 1);
    // Whether the front of the slice lies beyond a place, towards the platform.
    const auto beyond = [&](double t) {
      const double place_um = kernel_.place_um(layer_ + 1 - t);
      return window_um - place_um + kernel_.back(place_um).nearer_um < front_um;
    };
    if (!beyond(0) || beyond(1)) continue;
    return halved({0.0, 1.0}, 50, beyond).middle();
  }
  return -1;
}

/// Marks the cells between samples in which something may happen: the dose passes 1, or is less
/// than `known`. False if there are none.
bool InhibitedLayer::mark_cells(double known) {
  const double least = std::min(known, *std::min_element(dose_, dose_ + kSamples + 1));
  // How far into a cell its last kink lies, in slices; before it light falls by a in a slice at
  // most. The cells beyond either end of the layer are unknown.
  double kinks[kSamples + 2] = {};
  double* const kink = kinks + 1;
  kinks[0] = kinks[kSamples + 1] = 1;
  bool any_kink = false;
  if (kernel_.layer_by_layer()) {
    for (const Light& light : lights_) {
      const double t = front(light);
      if (t < 0) continue;
      const int i = cell(t);
      kink[i] = std::max(kink[i], t - static_cast<double>(i) / kSamples + 1e-9);
      any_kink = true;
    }
  }
  std::int64_t marked[kSamples];
  mark_straight(dose_, kinks, {fall_ / kSamples, least}, marked);
  bool any = false;
  for (int i = 0; i < kSamples; ++i) {
    marked_[i] = marked[i] != 0;
    any = any || marked_[i];
  }
  if (!any_kink) return any;
  const auto rise = [&](int i) { return dose_[i + 1] - dose_[i]; };
  const auto straight = [&](int i) { return kink[i] == 0; };
  // How far the dose may bend in cell i, judged by the two cells beside it.
  const auto bend = [&](int i, int step) {
    const int next = i + 2 * step;
    return straight(i + step) && next >= 0 && next < kSamples && straight(next)
               ? 2.0 * std::abs(rise(i + step) - rise(next))
               : fall_ / kSamples * std::max(dose_[i], dose_[i + 1]);
  };
  for (int i = 0; i < kSamples; ++i) {
    if (kink[i] == 0) continue;
    const double a = dose_[i], b = dose_[i + 1];
    const double error = kSampleError * (a + b);
    double low = std::min(a, b), high = std::max(a, b);
    // Before the kink the dose goes on as in the cell before, behind it as in the cell after.
    const double share = kink[i] * kSamples;
    double least_there = a * (1.0 - fall_ * kink[i]);
    if (straight(i - 1)) {
      least_there = std::max(least_there, a + share * (rise(i - 1) - bend(i, -1)));
    }
    low = std::min(low, least_there) - bend(i, 1) - error;
    high += fall_ / kSamples * high + error;
    const double near = 2.0 * kSampleError;
    marked_[i] = (low < 1.0 + near && high >= 1.0 - near) || low < least;
    any = any || marked_[i];
  }
  return any;
}

/// Takes as points the samples and, in marked cells, the fronts of lights: layer by layer the dose
/// has kinks there.
void InhibitedLayer::take_points() {
  points_.clear();
  for (int i = 0; i <= kSamples; ++i) {
    points_.push_back({static_cast<double>(i) / kSamples, dose_[i], false});
  }
  if (!kernel_.layer_by_layer()) return;
  for (const Light& light : lights_) {
    const double t = front(light);
    if (t < 0 || !marked_[cell(t)]) continue;
    const auto after = std::lower_bound(points_.begin(), points_.end(), t,
                                        [](const Point& p, double place) { return p.t < place; });
    // Rounding may put a front on the wrong side of a sample; so near to one it changes nothing.
    if (after == points_.begin() || after == points_.end() || after->t - t < precision_ ||
        t - std::prev(after)->t < precision_) {
      continue;
    }
    points_.insert(after, {t, at(t), true});
  }
}

bool InhibitedLayer::steady_above(const Same& light, double far, double known) {
  const auto [layer, setting, level, weight] = light;
  std::vector<Steady>& of_level = steady_[static_cast<std::size_t>(setting)];
  if (of_level.empty()) of_level.resize(static_cast<std::size_t>(kernel_.levels()));
  Steady& steady = of_level[static_cast<std::size_t>(level)];
  if (steady.points.empty()) {
    begin(0, layer);
    add(0, kernel_.near() - 1, setting, level, 1.0);
    sample(at(0), at(0.5), at(1));
    std::fill_n(marked_, kSamples, true);
    take_points();
    double bend = 0;
    for (std::size_t i = 1; i + 1 < points_.size(); ++i) {
      const Point &p = points_[i - 1], &q = points_[i], &r = points_[i + 1];
      if (q.kink) continue;
      const double before = (q.dose - p.dose) / (q.t - p.t),
                   after = (r.dose - q.dose) / (r.t - q.t);
      bend = std::max(bend, std::abs(after - before) / kSamples);
    }
    steady.slack = bend + kSampleError * dose_[kSamples];
    for (const Point& p : points_) steady.points.push_back({p.dose, std::exp(-fall_ * p.t)});
    steady.fall = fall_;
  }
  double low = std::numeric_limits<double>::infinity();
  for (const auto& [shines, fade] : steady.points)
    low = std::min(low, weight * shines + far * fade);
  // Far light fades exponentially: between points it is off a line by the square of its fall in a
  // cell.
  const double slack =
      weight * steady.slack + far * steady.fall * steady.fall / (kSamples * kSamples);
  return low - slack >= std::max(1.0, known);
}

void InhibitedLayer::find(double known, InsideLayer& out) {
  out.crossings.clear();
  if (!mark_cells(known)) {
    out.least = *std::min_element(dose_, dose_ + kSamples + 1);
    return;
  }
  sharpen(known);
  take_points();
  out.least = std::numeric_limits<double>::infinity();
  for (const Point& p : points_) out.least = std::min(out.least, p.dose);
  const std::size_t cells = points_.size() - 1;
  const auto slope = [&](std::size_t c) {
    return (points_[c + 1].dose - points_[c].dose) / (points_[c + 1].t - points_[c].t);
  };
  double before = slope(0), here = before;
  for (std::size_t c = 0; c < cells; ++c) {
    const double from = points_[c].t, a = points_[c].dose;
    const double to = points_[c + 1].t, b = points_[c + 1].dose;
    const double after = c + 1 < cells ? slope(c + 1) : here;
    if (!marked_[cell(from)]) {
      before = here;
      here = after;
      continue;
    }
    // The dose is off the chord by no more than the lines through the neighbouring points are;
    // lines beyond a kink say nothing. Where there are none, light falls by a in a slice at most.
    const bool has_before = c > 0 && !points_[c].kink;
    const bool has_after = c + 1 < cells && !points_[c + 1].kink;
    // Where m is above 1 light begins so softly that it bends most right behind its kink.
    const bool soft = points_[c].kink && kernel_.kinetics().m > 1.0;
    const double bends = (has_before || has_after) && !soft
                             ? (to - from) * (has_before && has_after ? 1.0 : 2.0) *
                                   ((has_before ? std::abs(here - before) : 0.0) +
                                    (has_after ? std::abs(after - here) : 0.0))
                             : (to - from) * fall_ * std::max(a, b);
    before = here;
    here = after;
    const bool printed = a >= 1.0, alike = printed == (b >= 1.0);
    if (std::abs(b - a) <= bends + kSampleError * (a + b)) {
      const double low = std::min(a, b) - bends, high = std::max(a, b) + bends;
      const bool dips = low < std::min(known, out.least) || (alike && printed && low < 1.0);
      const bool peaks = alike && !printed && high >= 1.0;
      double split = -1;
      if (dips) {
        const Point dip = turn(points_[c], points_[c + 1], true);
        out.least = std::min(out.least, dip.dose);
        if (alike && printed && dip.dose < 1.0) split = dip.t;
      }
      if (peaks) {
        const Point peak = turn(points_[c], points_[c + 1], false);
        if (peak.dose >= 1.0) split = peak.t;
      }
      if (split >= 0) {
        out.crossings.push_back(crossing(from, split, !printed));
        out.crossings.push_back(crossing(split, to, printed));
        continue;
      }
    }
    if (!alike) out.crossings.push_back(crossing(from, to, !printed));
  }
}

}  // namespace slicecorr::detail
