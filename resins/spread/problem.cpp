// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "spread/problem.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "fit/statistics.hpp"

namespace slicecorr::resins {

const std::vector<KnownSpread>& known_spread() {
  static const char* const narrow =
      "lines and gaps about as wide as the light spreads: of one to four pixels";
  static const char* const sharp = "the edge magnified further, with more places where it changes";
  static const char* const tail = "the edge with more of both sides, until the light is even";
  static const char* const deep =
      "the same at depths (depth_um) as far apart as light falls to a tenth over";
  static const std::vector<KnownSpread> all = {
      {"sigma_um", "um", narrow, sharp, &SpreadState::sigma_um},
      {"sigma2_um", "um", "lines and gaps of many widths, up to where edges are alone", tail,
       &SpreadState::sigma2_um},
      {"weight2", "", "lines and gaps of many widths, up to where edges are alone", tail,
       &SpreadState::weight2},
      {"scatter_um2_per_um", "um²/um", deep, deep, &SpreadState::scatter},
      {"dose", "",
       "lines and gaps of one to four pixels; or say how they were exposed (--exposure-s, "
       "--speed-mm-h)",
       "", &SpreadState::dose},
      {"dark", "", "lines close beside each other; or take it from --printer", "",
       &SpreadState::dark}};
  return all;
}

const KnownSpread* known_spread(const std::string& name) {
  for (const KnownSpread& k : known_spread()) {
    if (name == k.name) return &k;
  }
  return nullptr;
}

SpreadState SpreadProblem::at(const double* values) const {
  SpreadState s = start;
  for (std::size_t i = 0; i < fitted.size(); ++i) s.*fitted[i]->field = values[i];
  return s;
}

std::vector<double> SpreadProblem::values_of(const SpreadState& state) const {
  std::vector<double> values;
  for (const KnownSpread* k : fitted) values.push_back(state.*k->field);
  own_values(state, values);
  return values;
}

double SpreadProblem::step(std::size_t unknown, double value) const {
  if (unknown >= fitted.size()) return own_step(unknown - fitted.size());
  constexpr double share = 1e-5;
  const std::string_view name = fitted[unknown]->name;
  if (name == "sigma_um" || name == "sigma2_um") {
    return share * std::max(std::abs(value), 0.01 * scale_um_);
  }
  if (name == "scatter_um2_per_um") {
    return share * std::max(std::abs(value), scale_um_ * scale_um_ / std::max(1.0, deepest_um_));
  }
  return name == "dose" ? share * value : share * std::max(0.01, value);
}

bool WidthProblem::residuals(const double* values, double* out) const {
  const SpreadState s = at(values);
  if (!holds(s, 0) || !holds(s, deepest_um())) return false;
  for (const Row& r : rows) {
    *out = (r.printed_um - printed_width_um(s, r.exposure, r.designed_um)) / r.error_um;
    if (!std::isfinite(*out++)) return false;
  }
  return true;
}

EdgeProblem::EdgeProblem(const std::vector<KnifeEdge>& edges, double scale_um, double deepest_um)
    : SpreadProblem(scale_um, deepest_um), edges_(edges) {
  double sigma = 0;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto& all = edges[e].samples;
    const std::size_t n = all.size(), end = std::max<std::size_t>(1, n / 8);
    std::vector<double> first, last;
    for (std::size_t i = 0; i < end; ++i) {
      first.push_back(all[i].intensity);
      last.push_back(all[n - 1 - i].intensity);
    }
    Place guess{median(first), median(last), all[n / 2].at_um};
    double pixels = 0;
    for (const EdgeSample& s : all) pixels += s.pixels / static_cast<double>(n);
    // Where the light is half, and where it changes.
    double nearest = 2, from = all.back().at_um, to = all.front().at_um;
    for (std::size_t i = 0; i < n; ++i) {
      const double share = (all[i].intensity - guess.low) / (guess.high - guess.low);
      if (std::abs(share - 0.5) < nearest) {
        nearest = std::abs(share - 0.5);
        guess.at_um = all[i].at_um;
      }
      if (share > 0.16) from = std::min(from, all[i].at_um);
      if (share < 0.84) to = std::max(to, all[i].at_um);
      samples.push_back({e, i, std::sqrt(all[i].pixels / pixels)});
    }
    sigma += 0.5 * std::abs(to - from) / static_cast<double>(edges.size());
    guesses_.push_back(guess);
  }
  sigma_guess_um_ = std::max(sigma, 1e-3 * scale_um);
}

EdgeProblem::Place EdgeProblem::place_of(const double* values, std::size_t edge) const {
  const double* const v = values + fitted.size() + 3 * edge;
  return {v[0], v[1], v[2]};
}

void EdgeProblem::own_values(const SpreadState&, std::vector<double>& values) const {
  for (const Place& p : guesses_) values.insert(values.end(), {p.low, p.high, p.at_um});
}

double EdgeProblem::own_step(std::size_t unknown) const {
  return unknown % 3 == 2 ? 1e-5 * scale_um() : 1e-5 * std::abs(step_of(unknown / 3));
}

double EdgeProblem::share(const SpreadState& state, double at_um, const Sample& sample) const {
  const KnifeEdge& e = edges_[sample.edge];
  const EdgeSample& s = e.samples[sample.sample];
  return edge_share(state, e.depth_um, s.at_um - at_um, e.box_um[0], e.box_um[1], s.variance_um2);
}

double EdgeProblem::found(const SpreadState& state, const Place& place,
                          const Sample& sample) const {
  return place.low + (place.high - place.low) * share(state, place.at_um, sample);
}

bool EdgeProblem::holds_at(const SpreadState& s) const {
  return holds(s, 0) && holds(s, deepest_um());
}

bool EdgeProblem::residuals(const double* values, double* out) const {
  const SpreadState s = at(values);
  if (!holds_at(s)) return false;
  for (const Sample& sample : samples) {
    const double measured = edges_[sample.edge].samples[sample.sample].intensity;
    *out++ = (measured - found(s, place_of(values, sample.edge), sample)) * sample.weight /
             std::abs(step_of(sample.edge));
  }
  return true;
}

bool EdgeProblem::jacobian(const double* values, Eigen::MatrixXd& out) const {
  const auto n = static_cast<Eigen::Index>(samples.size());
  out.setZero(n, static_cast<Eigen::Index>(unknowns()));
  // Of spread by differences; an edge's own unknowns matter to that edge alone.
  Eigen::VectorXd low(n), high(n);
  std::vector<double> moved(values, values + unknowns());
  for (std::size_t k = 0; k < fitted.size(); ++k) {
    const double value = moved[k], by = step(k, value);
    moved[k] = value - by;
    if (!residuals(moved.data(), low.data())) return false;
    moved[k] = value + by;
    if (!residuals(moved.data(), high.data())) return false;
    moved[k] = value;
    out.col(static_cast<Eigen::Index>(k)) = (high - low) / (2 * by);
  }
  const SpreadState s = at(values);
  const double by = own_step(2);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Sample& sample = samples[static_cast<std::size_t>(i)];
    const Place p = place_of(values, sample.edge);
    const double scale = -sample.weight / std::abs(step_of(sample.edge));
    const double lit = share(s, p.at_um, sample);
    const auto column = static_cast<Eigen::Index>(fitted.size() + 3 * sample.edge);
    out(i, column) = scale * (1 - lit);
    out(i, column + 1) = scale * lit;
    out(i, column + 2) = scale * (p.high - p.low) *
                         (share(s, p.at_um + by, sample) - share(s, p.at_um - by, sample)) /
                         (2 * by);
  }
  return true;
}

}  // namespace slicecorr::resins
