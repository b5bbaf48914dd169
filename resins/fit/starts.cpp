// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/starts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

/// Sums about the means of weighted pairs and triples, for regressions.
struct Line {
  double slope = 0, intercept = 0;
};
Line regress(const std::vector<double>& x, const std::vector<double>& y) {
  const double n = static_cast<double>(x.size());
  const double mx = std::accumulate(x.begin(), x.end(), 0.0) / n;
  const double my = std::accumulate(y.begin(), y.end(), 0.0) / n;
  double xx = 0, xy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mx) * (x[i] - mx);
    xy += (x[i] - mx) * (y[i] - my);
  }
  const double slope = xx > 0 ? xy / xx : 0;
  return {slope, my - slope * mx};
}

/// y = a u + b v + c; nothing where u and v don't vary apart.
std::optional<std::array<double, 3>> regress(const std::vector<double>& u,
                                             const std::vector<double>& v,
                                             const std::vector<double>& y) {
  const double n = static_cast<double>(u.size());
  const double mu = std::accumulate(u.begin(), u.end(), 0.0) / n;
  const double mv = std::accumulate(v.begin(), v.end(), 0.0) / n;
  const double my = std::accumulate(y.begin(), y.end(), 0.0) / n;
  double uu = 0, uv = 0, vv = 0, uy = 0, vy = 0;
  for (std::size_t i = 0; i < u.size(); ++i) {
    const double p = u[i] - mu, q = v[i] - mv, r = y[i] - my;
    uu += p * p;
    uv += p * q;
    vv += q * q;
    uy += p * r;
    vy += q * r;
  }
  const double determinant = uu * vv - uv * uv;
  if (!(determinant > 1e-12 * uu * vv)) return std::nullopt;
  const double a = (uy * vv - vy * uv) / determinant;
  const double b = (vy * uu - uy * uv) / determinant;
  return std::array<double, 3>{a, b, my - a * mu - b * mv};
}

/// A number from 0 to 1 of the Halton sequence.
double halton(int index, int base) {
  double value = 0, step = 1;
  for (int i = index; i > 0; i /= base) {
    step /= base;
    value += step * (i % base);
  }
  return value;
}

/// h, m and D'c of cured heights: the law is linear in ln I and ln t.
void start_cured(PreparedFit& s, bool with_exponent) {
  std::vector<double> ln_blue, ln_time, ln_dose, height;
  for (const Observation& o : s.problem.observations) {
    if (o.is_dead_zone) continue;
    ln_blue.push_back(o.exposure.ln_blue);
    ln_time.push_back(o.exposure.ln_time);
    ln_dose.push_back(o.exposure.ln_blue + o.exposure.ln_time);
    height.push_back(o.measured_um);
  }
  if (count_different(ln_dose) < 2) {
    refuse_fit(s, fmt::format("all {} cured heights have one dose ({:.4g} mJ/cm2); expected two or "
                              "more doses",
                              height.size(), std::exp(ln_dose.front())));
  }
  const Line line = regress(ln_dose, height);
  if (!(line.slope > 0)) {
    refuse_fit(s,
               fmt::format("the cured heights do not grow with the dose ({:.3g} um per factor of "
                           "10); expected heights that do",
                           line.slope * std::log(10.0)));
  }
  s.start[kHeight] = line.slope;
  s.start[kDose] = std::exp(-line.intercept / line.slope);
  s.start[kExponent] = 1;
  if (!with_exponent) return;
  const auto plane = regress(ln_blue, ln_time, height);
  if (!plane || !((*plane)[0] > 0) || !((*plane)[1] > 0)) return;
  const auto [a, b, c] = *plane;
  s.start[kHeight] = a;
  s.start[kExponent] = a / b;
  s.start[kDose] = std::exp(-c / b);
}

/// A and B from Jacobs' law: each half of it at the mean intensity, then nearly all.
void start_gel_time(PreparedFit& s) {
  double ln_blue = 0;
  for (const Observation& o : s.problem.observations) {
    ln_blue += o.exposure.ln_blue / static_cast<double>(s.problem.observations.size());
  }
  const double dose = s.start[kDose];
  const auto shares = [&](double of_a) {
    Slots guess = s.start;
    guess[kGelA] = of_a * dose;
    guess[kGelB] = (1 - of_a) * dose * std::exp(-0.5 * ln_blue);
    return guess;
  };
  s.start = shares(0.5);
  for (const double of_a : {0.9, 0.1}) s.more_starts.push_back(shares(of_a));
}

/// From Jacobs' law: the resin is fresh at low doses, where heights grow slower, and bleaches at
/// doses from the least to the greatest.
void start_bleaching(PreparedFit& s) {
  double least = std::numeric_limits<double>::infinity(), greatest = 0;
  for (const Observation& o : s.problem.observations) {
    const double dose = std::exp(o.exposure.ln_blue + o.exposure.ln_time);
    least = std::min(least, dose);
    greatest = std::max(greatest, dose);
  }
  const auto guess = [&](double share, double apart) {
    Slots g = s.start;
    g[kHeight] = s.start[kHeight] / apart;
    g[kBleachedHeight] = s.start[kHeight] * apart;
    g[kBleachingDose] = least * std::pow(greatest / least, share);
    return g;
  };
  for (const double share : {0.2, 0.5, 0.8}) {
    for (const double apart : {1.2, 2.0}) s.more_starts.push_back(guess(share, apart));
  }
  s.start = guess(0.5, 1.4);
}

/// beta and huv of dead zones, as if all were steady.
void start_dead_zones(PreparedFit& s, bool both_free) {
  std::vector<double> ln_ratio, height;
  for (const Observation& o : s.problem.observations) {
    if (!o.is_dead_zone) continue;
    ln_ratio.push_back(o.exposure.ln_uv - o.exposure.ln_blue);
    height.push_back(o.measured_um);
  }
  if (count_different(ln_ratio) < 2 && both_free) {
    refuse_fit(s,
               fmt::format("all {} dead zones have one ratio of UV to blue ({:.4g}); expected two "
                           "or more ratios that differ by a factor of 2 or more",
                           height.size(), std::exp(ln_ratio.front())));
  }
  const double h = s.start[kHeight];
  const Line line = regress(ln_ratio, height);
  const double mean =
      std::accumulate(height.begin(), height.end(), 0.0) / static_cast<double>(height.size());
  // Where a regression makes no sense, the front is taken to stand at its mean height.
  const double length = line.slope > 0 ? line.slope : mean;
  const double intercept = line.slope > 0 ? line.intercept : 0;
  s.start[kUvHeight] = 1 / (1 / length + 1 / h);
  s.start[kBeta] = std::exp(std::clamp(intercept / length, -10.0, 10.0));
}

/// For a given exponent the transient law is linear, too: with A = (D'c / t)^(1/m),
/// z = huv ln beta - huv ln((Ib e^(-z/h) - A) / Iuv). Guesses for exponents over the whole range,
/// the present one first; where no line can be drawn the steady guess stays.
void start_transient(PreparedFit& s) {
  const auto guess_for = [&](double m) -> std::optional<Slots> {
    std::vector<double> x, y;
    for (const Observation& o : s.problem.observations) {
      if (!o.is_dead_zone) continue;
      const double level = std::exp((std::log(s.start[kDose]) - o.exposure.ln_time) / m);
      const double net = std::exp(o.exposure.ln_blue - o.measured_um / s.start[kHeight]) - level;
      if (!(net > 0)) continue;
      x.push_back(std::log(net) - o.exposure.ln_uv);
      y.push_back(o.measured_um);
    }
    if (x.size() < 2) return std::nullopt;
    const Line line = regress(x, y);
    if (!(line.slope < 0) || !(-line.slope < 0.99 * s.start[kHeight])) return std::nullopt;
    Slots guess = s.start;
    guess[kUvHeight] = -line.slope;
    guess[kBeta] = std::exp(std::clamp(-line.intercept / line.slope, -10.0, 10.0));
    guess[kUvExponent] = m;
    return guess;
  };
  if (const auto first = guess_for(s.start[kUvExponent])) s.start = *first;
  for (const double m : {1.0, 1.3, 0.7, 1.6, 0.85, 1.9, 0.5}) {
    if (const auto guess = guess_for(m)) s.more_starts.push_back(*guess);
  }
}

}  // namespace

void refuse_fit(const PreparedFit& prepared, const std::string& why) {
  throw InputError(fmt::format("the {} model can't be fitted: {}", name_of(prepared.model), why));
}

void choose_starts(PreparedFit& s, const FitOptions& options) {
  for (const auto& [name, value] : options.fixed) {
    if (name == "h_um") s.start[kHeight] = value;
  }
  if (kind_of(s.model).heights) {
    start_cured(s, s.model == FitModel::kinetic || s.model == FitModel::joint);
  }
  if (s.model == FitModel::gel_time) start_gel_time(s);
  if (s.model == FitModel::bleaching) start_bleaching(s);
  for (const auto& [name, value] : options.fixed) {
    for (const auto& p : s.parameters) {
      if (p.unknown.name != name) continue;
      for (const Slot slot : p.unknown.slots) s.start[slot] = value;
    }
  }
  if (kind_of(s.model).dead_zones) {
    if (s.model == FitModel::joint) s.start[kUvExponent] = s.start[kExponent];
    start_dead_zones(s, !options.fixed.contains("beta") && !options.fixed.contains("huv_um"));
    if (!s.problem.is_steady) start_transient(s);
  }
}

std::vector<double> PreparedFit::inner_of(const Slots& guess) const {
  std::vector<double> inner;
  for (const Unknown& u : problem.unknowns) {
    inner.push_back(u.inner(std::clamp(guess[u.slots.front()], u.low, u.high)));
  }
  return inner;
}

std::vector<std::vector<double>> PreparedFit::starts(int count) const {
  std::vector<std::vector<double>> all = {start_inner()};
  for (const Slots& guess : more_starts) all.push_back(inner_of(guess));
  constexpr std::array<int, 6> bases = {2, 3, 5, 7, 11, 13};
  // Scale parameters are tried from a third to three times their first value.
  constexpr double scale_span = 1.0986, exponent_span = 0.4;
  for (int k = 1; static_cast<int>(all.size()) < count; ++k) {
    std::vector<double> inner = all.front();
    for (std::size_t i = 0; i < inner.size(); ++i) {
      const double span = problem.unknowns[i].is_scale ? scale_span : exponent_span;
      inner[i] += span * (2 * halton(k, bases[i]) - 1);
    }
    all.push_back(std::move(inner));
  }
  all.resize(static_cast<std::size_t>(count));
  return all;
}

}  // namespace slicecorr::resins
