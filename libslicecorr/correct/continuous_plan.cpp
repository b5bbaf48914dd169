// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/continuous_plan.hpp"

#include <algorithm>
#include <map>

#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// Each phi of a model once, rising.
std::vector<double> distinct(const std::vector<double>& level_phi) {
  std::vector<double> phi;
  for (const double p : level_phi) {
    if (phi.empty() || p > phi.back()) phi.push_back(p);
  }
  return phi;
}

/// The tolerance of edges aimed at is `kTargetUm`, which is finer than any printer or measurement.
/// With `kMany` levels or more it is at least 1 / `kOfStep` of what a level step moves an edge by,
/// but for that no more than a hundredth of a slice; and as much as the process asks for.
constexpr double kTargetUm = 0.05, kOfStep = 25;
constexpr int kMany = 128;

/// Corners nearer to a lower node than this, in slices, would divide by nearly nothing: the layer
/// below that node has them.
constexpr double kNearNode = 1e-4;

}  // namespace

Corner LayerFactors::corner(double f) const {
  Corner c;
  const double exponent = -f * std::log(a);
  c.grown = std::exp(exponent);
  c.excess = std::expm1(exponent);
  c.per_excess = 1.0 / c.excess;
  return c;
}

namespace {

Corner corner_of(double grown) {
  const double excess = grown - 1.0;
  return {grown, excess, 1.0 / excess};
}

/// a^-j. By exp, not by repeated division: entry j must be the same however long the table is.
std::shared_ptr<const std::vector<double>> powers(double eta, std::size_t count) {
  auto grown = std::make_shared<std::vector<double>>(count);
  for (std::size_t j = 0; j < count; ++j) {
    (*grown)[j] = std::exp(static_cast<double>(j) * eta * units::kLn10);
  }
  return grown;
}

}  // namespace

EdgeCorners ContinuousPlan::corners_of(const LayerFactors& layer, double tolerance) const {
  const double t = std::min(tolerance / layer.height, kWidest);
  const double slit = std::max(t, std::min(shortfall, kWidest));
  return {layer.corner(1.0 - t), layer.corner(t), layer.corner(slit), t, slit};
}

double ContinuousPlan::grown_unevenly(int node, int slices) const {
  return std::exp((heights_.place_um(node + slices, layer_um) - heights_.place_um(node, layer_um)) *
                  per_um_);
}

EdgeAsk ContinuousPlan::ask(std::uint8_t height, const EdgeCorners& at, bool slit) const {
  EdgeAsk ask;
  const Corner& up = slit ? at.slit : at.lower;  // a^-(tolerance upwards)
  if (height == kEdgeAtNode) {
    ask.above = {true, false, up, {}};
    ask.below = {true, false, at.upper, {}};
    return ask;
  }
  // The edge may lie from `first` to `last` below its node. Beyond the middles of the layers these
  // two ask enough themselves.
  const double d = edge_height_slices(height);
  const double first = d - (slit ? at.slit_tolerance : at.tolerance), last = d + at.tolerance;
  const double grown_d = height_grown_[height];
  const double first_grown = grown_d / up.grown, last_grown = grown_d * at.lower.grown;
  if (first > -kNearNode) {
    ask.below.other = true;
    ask.below.of_other = corner_of(per_a / std::max(first_grown, 1.0));
  } else if (first > -kWidest) {
    ask.above.own = true;
    ask.above.of_own = corner_of(1.0 / first_grown);
  }
  if (last < -kNearNode) {
    ask.above.other = true;
    ask.above.of_other = corner_of(1.0 / last_grown);
  } else if (last < kWidest) {
    ask.below.own = true;
    ask.below.of_own = corner_of(per_a / std::max(last_grown, 1.0));
  }
  return ask;
}

double ContinuousPlan::most_at_edge(int node, std::uint8_t height, int rung) const {
  const auto r = static_cast<std::size_t>(rung);
  if (height == kEdgeAtNode) return of(node).edge_most[r];
  const double open_at = edge_height_slices(height) + tolerance[r];
  if (open_at <= 0) return open;
  // From there on down, a^(open_at).
  const double left = 1.0 / (height_grown_[height] * near[r].lower.grown);
  return left + greatest_ * phi_max * (1.0 - left) + edge_room;
}

void ContinuousPlan::set_edges(LayerFactors& layer) const {
  layer.middle = layer.corner(0.5);
  for (std::size_t r = 0; r < kRungs; ++r) {
    layer.near[r] = corners_of(layer, tolerance[r]);
    const double left = 1.0 / layer.near[r].lower.grown;  // a^eps
    // What layers ask is exact: of slices that differ the greatest will do.
    layer.edge_most[r] = left + greatest_ * phi_max * (1.0 - left) + edge_room;
    layer.grey_edge_most[r] = prints + layer.near[r].lower.excess * (1.0 - phi_min);
  }
}

void ContinuousPlan::set_own(const CureModel& model) {
  heights_ = model.heights;
  per_um_ = model.eta * units::kLn10 / model.layer_um;
  const std::vector<double>& um = heights_.um();
  std::map<double, std::size_t> known;
  for (std::size_t n = 0; n < um.size(); ++n) {
    const auto [found, is_new] = known.try_emplace(um[n], own_.size());
    own_of_.push_back(found->second);
    if (!is_new) continue;
    own_.emplace_back(model.own_a[n], model.own_one_minus_a[n], model.own_root_a[n]);
    own_.back().height = um[n] / model.layer_um;
  }
}

void ContinuousPlan::set_steady() {
  const std::size_t count = std::max(ratios_.size(), own_of_.size());
  steady_.assign(count, count > 0 ? ratio(static_cast<int>(count) - 1) : 1.0);
  for (std::size_t k = count; k-- > 1;) {
    const auto slice = static_cast<int>(k) - 1;
    steady_[k - 1] = ratio(slice) * of(slice).b + of(slice).a * steady_[k];
  }
}

ContinuousPlan::ContinuousPlan(const CureModel& model, const Process& process, int slices,
                               bool is_exact, const ContinuousPlan* like)
    : LayerFactors(model.a, model.one_minus_a, model.root_a),
      phi_min(model.phi_min()),
      phi_max(model.phi_max()),
      climb_max(model.steady(model.phi_max())),
      layer_um(model.layer_um),
      exact(is_exact),
      shortfall(process.gap_shortfall),
      levels(distinct(model.level_phi)) {
  for (std::size_t l = 0; l < model.level_phi.size(); ++l) {
    if (l == 0 || model.level_phi[l] > model.level_phi[l - 1]) {
      level_of.push_back(static_cast<std::uint8_t>(l));
    }
  }
  ratios_ = model.exposure_ratio;
  if (!model.heights.alike()) set_own(model);
  set_steady();
  greatest_ = model.greatest_ratio();
  double most_b = b;
  for (const LayerFactors& layer : own_) most_b = std::max(most_b, layer.b);
  const int count = levels.size();
  largest_step = 0;
  for (int l = 1; l < count; ++l) {
    largest_step = std::max(largest_step, (levels.phi(l) - levels.phi(l - 1)) * most_b);
  }
  largest_step *= greatest_;
  // Rounding of a step is below 1e-13 for any dose that light can give.
  const double margin = exact ? 0.0 : 2e-9;
  slack = exact ? 1e-12 : 1e-9;
  edge_room = exact ? 1e-14 : 1e-8;
  close = count > 1 ? 0.99 * (levels.phi(1) - levels.phi(0)) * b - 4 * slack : 0.0;
  prints = 1.0 + margin;
  open = 1.0 - margin;
  most = std::max(phi_max * greatest_, 1.0) * (1.0 + 1e-9);
  platform_cap = process.cap_platform_features ? process.omega_max : most;
  cap = process.omega_max;
  least_cap = 0;
  if (!exact) {
    // With a lower cap no level could hold a dose between 1 and the cap.
    const double step = greatest_ * (phi_max - phi_min) / std::max(1, count - 1);
    cap = std::max(cap, 1.0 + 3.0 * most_b * step);
    platform_cap = std::max(platform_cap, 1.0 + 3.0 * most_b * step);
    least_cap = std::min(1.0 + 3.0 * step, most);
  }
  cap = std::min(cap, most);
  platform_cap = std::min(platform_cap, most);

  // A small part of what a level step moves an edge by: a finer tolerance costs more time than it
  // gains.
  const double vernier =
      count >= kMany ? std::min(model.level_step_um() / kOfStep, layer_um / 100) : 0.0;
  const double target =
      exact ? 1e-13
            : std::min(kWidest,
                       std::max(std::max({kTargetUm, vernier, process.edge_aim_um}) / layer_um,
                                1.0 / 1000));
  const double first = exact ? 1e-4 : target;
  tolerance[0] = target;
  for (int r = 1; r < kRungs; ++r) {
    tolerance[static_cast<std::size_t>(r)] =
        first * std::pow(kWidest / first, (r - 1) / static_cast<double>(kRungs - 2));
  }
  tolerance.back() = kWidest;
  together = exact ? 0 : count >= kMany ? 3 : count >= 48 ? 4 : 6;
  const int kept = std::min(std::max(1, static_cast<int>(std::lround(0.04 * count))), count - 1);
  shelves = !exact && process.overhangs == Overhangs::early;
  feature_reserve = exact ? 0 : (levels.phi(kept) - phi_min) * b * together / 2;
  gap_reserve = exact ? 0 : (phi_max - levels.phi(count - 1 - kept)) * b * together / 2;

  all_grown_ = like ? like->all_grown_ : powers(model.eta, static_cast<std::size_t>(slices) + 2);
  grown = *all_grown_;
  for (std::size_t h = 0; h < height_grown_.size(); ++h) {
    const double d = edge_height_slices(static_cast<std::uint8_t>(h));
    height_grown_[h] = std::exp(d * model.eta * units::kLn10);
  }
  for (double t = target; !exact; t *= 1.2) {
    ladder.push_back(corners_of(*this, t));
    if (t * 1.2 >= kWidest) break;
  }
  set_edges(*this);
  for (LayerFactors& layer : own_) set_edges(layer);
  const LevelTable::Around one = levels.around(1.0);
  const int next = std::min(one.at_least + 1, count - 1);
  const double step_at_one = levels.phi(next) - levels.phi(one.at_most);
  grey_rung = 0;
  const auto widen = [&](const LayerFactors& layer) {
    while (grey_rung + 1 < kRungs &&
           layer.grey_edge_most[static_cast<std::size_t>(grey_rung)] - prints <
               step_at_one * layer.b) {
      ++grey_rung;
    }
  };
  if (own_.empty()) widen(*this);
  for (const LayerFactors& layer : own_) widen(layer);
}

}  // namespace slicecorr::detail
