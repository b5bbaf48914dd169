// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sweep.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "flow/need.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using detail::need;

constexpr auto kNothingHeld = [](std::size_t) { return false; };

void check_resin(const FlowResin& r) {
  const Kinetics& k = r.kinetics;
  need(std::isfinite(k.hb_um) && k.hb_um > 0, "hb_um", k.hb_um, "more than 0");
  need(std::isfinite(k.m) && k.m > 0, "m", k.m, "more than 0");
  need(std::isfinite(k.critical_dose_prime) && k.critical_dose_prime > 0, "critical_dose_prime",
       k.critical_dose_prime, "more than 0");
  need(std::isfinite(k.beta) && k.beta >= 0, "beta", k.beta, "0 or more");
  if (k.beta > 0) {
    need(k.huv_um > 0 && k.huv_um < k.hb_um, "huv_um", k.huv_um,
         "more than 0 and less than the curing light's absorbance height");
  }
  need(std::isfinite(r.diffusion_m2_s) && r.diffusion_m2_s >= 0, "dose_diffusion_m2_s",
       r.diffusion_m2_s, "0 or more");
  need(r.inhibitor_life_s >= 0, "inhibitor_life_s", r.inhibitor_life_s, "0 or more");
}

int checked_levels(int levels) {
  need(levels >= 8 && levels <= 1000, "levels", levels, "8 to 1000");
  return levels;
}

const FlowSection& checked(const FlowSection& section) {
  check_section(section);
  return section;
}

}  // namespace

/// See sweep.hpp.
class SectionSweep::Impl::Light {
 public:
  explicit Light(const Impl& of) : of_(of) {
    light_.resize(of.levels.size());
    if (of.even) light_.set(of.resin.kinetics, of.levels, of.gap.front(), of.um_s);
  }
  const detail::LevelLight& of(std::size_t node) {
    if (!of_.even) light_.set(of_.resin.kinetics, of_.levels, of_.gap[node], of_.um_s);
    return light_;
  }

 private:
  const Impl& of_;
  detail::LevelLight light_;
};

SectionSweep::Impl::Impl(const FlowSection& section, const GapPressure& pressure,
                         const FlowResin& flow_resin, double speed_mm_h,
                         std::span<const double> gap_um, const SweepOptions& options)
    : cells(checked(section).size()),
      width(section.width),
      resin(flow_resin),
      levels(checked_levels(options.levels)),
      path(section, pressure, gap_um.size() == 1 ? std::span<const double>{} : gap_um),
      even(gap_um.size() == 1) {
  check_resin(resin);
  need(std::isfinite(speed_mm_h) && speed_mm_h > 0, "speed_mm_h", speed_mm_h, "more than 0");
  um_s = 1e4 * units::cm_s_from_mm_h(speed_mm_h);
  for (const std::size_t cell : path.net.cell_of) {
    const double h = even ? gap_um[0] : gap_um[cell];
    need(std::isfinite(h) && h > 0, "gap_um", h, "more than 0");
    gap.push_back(h);
  }
  linear = resin.kinetics.m == 1 && std::isinf(resin.inhibitor_life_s);
  if (!linear) return;
  factors_.resize(3 * levels.size() * path.net.nodes());
  for (std::size_t n = 0; n < path.net.nodes(); ++n) {
    factor(n, factors_.data() + 3 * levels.size() * n);
  }
}

double SectionSweep::Impl::spread(std::size_t node) const {
  return node < path.net.parts() ? resin.diffusion_m2_s * 1e12 / (um_s * gap[node]) : 0;
}

detail::BandView SectionSweep::Impl::factor(std::size_t node, double* rows) const {
  const std::size_t n = levels.size();
  const double across = spread(node);
  const detail::BandFactors<double> band{rows, rows + n, rows + 2 * n, across};
  detail::factor_band(
      levels,
      [&](std::size_t j) {
        return detail::band_row(levels, j, path.rows.diagonal[node], path.net.area[node], across);
      },
      kNothingHeld, band);
  return {rows, rows + n, rows + 2 * n, across};
}

detail::BandView SectionSweep::Impl::kept(std::size_t node) const {
  const std::size_t n = levels.size();
  const double* at = factors_.data() + 3 * n * node;
  return {at, at + n, at + 2 * n, spread(node)};
}

double SectionSweep::Impl::bend_at_window() const {
  const double a = levels.middle[0], b = levels.middle[1];
  return a * a / (b * b - a * a);
}

int SectionSweep::Impl::node_at(int x, int y) const {
  const auto cell = static_cast<std::int64_t>(y) * width + x;
  const bool inside = x >= 0 && x < width && y >= 0 && cell < static_cast<std::int64_t>(cells);
  const int node = inside ? path.net.node_of[static_cast<std::size_t>(cell)] : -1;
  if (node < 0 || static_cast<std::size_t>(node) >= path.net.parts()) {
    throw InputError("flow", "cell", fmt::format("{}, {} is no part", x, y));
  }
  return node;
}

SectionSweep::Impl::NodeLight SectionSweep::Impl::light(std::span<const double> blue,
                                                        std::span<const double> uv) const {
  NodeLight light;
  const auto take = [&](std::span<const double> from, const char* what, std::vector<double>& to) {
    if (from.size() != 1 && from.size() != cells) {
      throw InputError("flow", what,
                       fmt::format("{} numbers; expected 1 or {}", from.size(), cells));
    }
    for (const std::size_t cell : path.net.cell_of) {
      const double v = from.size() == 1 ? from[0] : from[cell];
      need(std::isfinite(v) && v >= 0, what, v, "0 or more");
      to.push_back(v);
    }
  };
  take(blue, "blue_mw_cm2", light.blue);
  take(uv, "uv_mw_cm2", light.uv);
  return light;
}

void SectionSweep::Impl::enter(std::size_t node, const double* y, double* into) const {
  const detail::FlowRows& rows = path.rows;
  const std::size_t at = rows.begin[node];
  detail::mix_profiles(levels, y, rows.from.data() + at, rows.weight.data() + at,
                       rows.begin[node + 1] - at, into);
}

void SectionSweep::Impl::leave(std::size_t node, double* y, double* into) const {
  const detail::FlowRows& rows = path.rows;
  const std::size_t at = rows.begin[node];
  for (std::size_t j = 0; j < levels.size(); ++j) y[j] *= levels.share[j];
  detail::share_profile(levels.size(), y, rows.from.data() + at, rows.weight.data() + at,
                        rows.begin[node + 1] - at, into);
}

template <typename Before, typename Solve, typename SolveOne>
void SectionSweep::Impl::beside(std::size_t from, std::size_t to, double* y, Before before,
                                Solve solve, SolveOne solve_one) const {
  // Nodes that don't depend on each other, four at once.
  const std::size_t n = levels.size();
  std::array<detail::BandView, detail::kBeside> bands{};
  std::array<double*, detail::kBeside> profiles{};
  for (std::size_t k = from; k < to;) {
    const std::size_t count = to - k < detail::kBeside ? 1 : detail::kBeside;
    for (std::size_t l = 0; l < count; ++l) {
      const auto node = static_cast<std::size_t>(path.rows.order[k + l]);
      profiles[l] = y + node * n;
      bands[l] = kept(node);
      before(node, profiles[l]);
    }
    if (count == 1) {
      solve_one(levels, bands[0], kNothingHeld, profiles[0]);
    } else {
      solve(levels, bands.data(), profiles.data());
    }
    k += count;
  }
}

void SectionSweep::Impl::carry_linear(const NodeLight& light, State& state) const {
  const std::size_t n = levels.size();
  Light of_levels(*this);
  const auto begin = [&](std::size_t node, double* y) {
    enter(node, state.y.get(), y);
    if (node >= path.net.parts()) return;
    const detail::LevelLight& gain = of_levels.of(node);
    const double blue = light.blue[node], uv = light.uv[node];
    for (std::size_t j = 0; j < n; ++j) y[j] += gain.blue[j] * blue + gain.uv[j] * uv;
  };
  for (std::size_t s = 0; s + 1 < path.rows.step.size(); ++s) {
    beside(path.rows.step[s], path.rows.step[s + 1], state.y.get(), begin, detail::solve_bands,
           detail::solve_band<decltype(kNothingHeld)>);
  }
}

void SectionSweep::Impl::carry_pieces(const NodeLight& light, State& state) const {
  const std::size_t n = levels.size();
  state.piece.resize(path.net.nodes() * n, detail::DosePiece::dose);
  Light of_levels(*this);
  detail::CellLaw law(resin, levels);
  std::vector<double> scratch(3 * n);
  for (const int order : path.rows.order) {
    const auto node = static_cast<std::size_t>(order);
    double* y = state.y.get() + node * n;
    enter(node, state.y.get(), y);
    if (node >= path.net.parts()) {
      detail::solve_band(levels, factor(node, scratch.data()), kNothingHeld, y);
      continue;
    }
    law.go_to(path.rows.diagonal[node], spread(node), gap[node], um_s, of_levels.of(node),
              light.blue[node], light.uv[node]);
    law.solve(y, state.piece.data() + node * n);
  }
}

SectionSweep::Impl::State SectionSweep::Impl::carry(const NodeLight& light) const {
  State state;
  state.y = profiles();
  linear ? carry_linear(light, state) : carry_pieces(light, state);
  return state;
}

void SectionSweep::Impl::weigh(std::size_t node, std::span<const double> front,
                               std::span<const double> window, double* y) const {
  const std::size_t n = levels.size(), cell = path.net.cell_of[node];
  const double per_dose = 1 / resin.kinetics.critical_dose_prime;
  const double slope = levels.slope[n - 1], bend = bend_at_window();
  y[n - 1] += (1 + slope) * front[cell] * per_dose;
  y[n - 2] -= slope * front[cell] * per_dose;
  y[0] += (1 + bend) * window[cell] * per_dose;
  y[1] -= bend * window[cell] * per_dose;
}

SectionGradient SectionSweep::Impl::back_linear(std::span<const double> front,
                                                std::span<const double> window) const {
  const std::size_t n = levels.size();
  SectionGradient gradient{std::vector<double>(cells, 0.0), std::vector<double>(cells, 0.0)};
  const detail::KeptRoom::Room back = profiles();
  std::fill_n(back.get(), path.net.nodes() * n, 0.0);
  Light of_levels(*this);
  for (std::size_t s = path.rows.step.size() - 1; s-- > 0;) {
    const std::size_t from = path.rows.step[s], to = path.rows.step[s + 1];
    beside(
        from, to, back.get(),
        [&](std::size_t node, double* y) {
          if (node < path.net.parts()) weigh(node, front, window, y);
        },
        detail::solve_bands_transposed, detail::solve_transposed<decltype(kNothingHeld)>);
    for (std::size_t k = from; k < to; ++k) {
      const auto node = static_cast<std::size_t>(path.rows.order[k]);
      double* y = back.get() + node * n;
      if (node < path.net.parts()) {
        const detail::LevelLight& gain = of_levels.of(node);
        const std::size_t cell = path.net.cell_of[node];
        gradient.blue[cell] = detail::level_sum(n, gain.blue.data(), y);
        gradient.uv[cell] = detail::level_sum(n, gain.uv.data(), y);
      }
      leave(node, y, back.get());
    }
  }
  return gradient;
}

SectionGradient SectionSweep::Impl::back_pieces(std::span<const double> front,
                                                std::span<const double> window,
                                                const NodeLight& light, const State& state) const {
  const std::size_t n = levels.size();
  SectionGradient gradient{std::vector<double>(cells, 0.0), std::vector<double>(cells, 0.0)};
  const detail::KeptRoom::Room back = profiles();
  std::fill_n(back.get(), path.net.nodes() * n, 0.0);
  std::vector<double> scratch(3 * n);
  Light of_levels(*this);
  detail::CellLaw law(resin, levels);
  for (std::size_t k = path.rows.order.size(); k-- > 0;) {
    const auto node = static_cast<std::size_t>(path.rows.order[k]);
    double* y = back.get() + node * n;
    if (node < path.net.parts()) {
      weigh(node, front, window, y);
      const std::size_t cell = path.net.cell_of[node];
      law.go_to(path.rows.diagonal[node], spread(node), gap[node], um_s, of_levels.of(node),
                light.blue[node], light.uv[node]);
      law.solve_back(state.piece.data() + node * n, y, gradient.blue[cell], gradient.uv[cell]);
    } else {
      detail::solve_transposed(levels, factor(node, scratch.data()), kNothingHeld, y);
    }
    leave(node, y, back.get());
  }
  return gradient;
}

SectionGradient SectionSweep::Impl::carry_back(std::span<const double> front,
                                               std::span<const double> window,
                                               const NodeLight* light) const {
  for (const auto& [weights, what] :
       {std::pair{front, "front_weight"}, std::pair{window, "window_weight"}}) {
    if (weights.size() != cells) {
      throw InputError("flow", what, fmt::format("{} numbers; expected {}", weights.size(), cells));
    }
  }
  if (light == nullptr || linear) return back_linear(front, window);
  return back_pieces(front, window, *light, carry(*light));
}

SectionDose SectionSweep::Impl::dose_of(const State& state, const NodeLight& light) const {
  const std::size_t n = levels.size();
  const double per_dose = 1 / resin.kinetics.critical_dose_prime;
  SectionDose dose{std::vector<double>(cells, 0.0), std::vector<double>(cells, 0.0)};
  Light of_levels(*this);
  for (std::size_t node = 0; node < path.net.parts(); ++node) {
    const double* y = state.y.get() + node * n;
    const std::size_t cell = path.net.cell_of[node];
    const double slope = levels.slope[n - 1], bend = bend_at_window();
    dose.front[cell] = (y[n - 1] + slope * (y[n - 1] - y[n - 2])) * per_dose;
    dose.window[cell] = (y[0] + bend * (y[0] - y[1])) * per_dose;
    const detail::LevelLight& gain = of_levels.of(node);
    for (std::size_t j = 0; j < n; ++j) {
      if (y[j] > 0 && gain.blue[j] * light.blue[node] + gain.uv[j] * light.uv[node] < 0) {
        ++dose.undone_cells;
        break;
      }
    }
  }
  return dose;
}

SectionSweep::SectionSweep(const FlowSection& section, const GapPressure& pressure,
                           const FlowResin& resin, double speed_mm_h,
                           std::span<const double> gap_um, const SweepOptions& options)
    : impl_(std::make_unique<Impl>(section, pressure, resin, speed_mm_h, gap_um, options)) {}
SectionSweep::~SectionSweep() = default;
SectionSweep::SectionSweep(SectionSweep&&) noexcept = default;

bool SectionSweep::linear() const { return impl_->linear; }

SectionDose SectionSweep::dose(std::span<const double> blue_mw_cm2,
                               std::span<const double> uv_mw_cm2) const {
  const Impl::NodeLight light = impl_->light(blue_mw_cm2, uv_mw_cm2);
  return impl_->dose_of(impl_->carry(light), light);
}

SectionGradient SectionSweep::adjoint(std::span<const double> front_weight,
                                      std::span<const double> window_weight) const {
  if (!impl_->linear) {
    throw InputError("flow", "adjoint",
                     "the law is not linear here; expected m = 1 and an endless inhibitor_life_s");
  }
  return impl_->carry_back(front_weight, window_weight, nullptr);
}

SectionGradient SectionSweep::gradient(std::span<const double> blue_mw_cm2,
                                       std::span<const double> uv_mw_cm2,
                                       std::span<const double> front_weight,
                                       std::span<const double> window_weight) const {
  const Impl::NodeLight light = impl_->light(blue_mw_cm2, uv_mw_cm2);
  return impl_->carry_back(front_weight, window_weight, &light);
}

std::vector<double> SectionSweep::profile(std::span<const double> blue_mw_cm2,
                                          std::span<const double> uv_mw_cm2, int x, int y) const {
  const std::size_t n = impl_->levels.size();
  const int node = impl_->node_at(x, y);
  const Impl::State state = impl_->carry(impl_->light(blue_mw_cm2, uv_mw_cm2));
  const double* from = state.y.get() + n * static_cast<std::size_t>(node);
  std::vector<double> profile(from, from + n);
  for (double& v : profile) v /= impl_->resin.kinetics.critical_dose_prime;
  return profile;
}

std::vector<double> SectionSweep::level_q() const { return impl_->levels.middle; }

DoseSummary summarise(const FlowSection& section, const SectionDose& dose,
                      std::span<const double> weight) {
  if (dose.front.size() != section.size() || dose.window.size() != section.size() ||
      (!weight.empty() && weight.size() != section.size())) {
    throw InputError("flow", "dose", "does not have a number per cell of the section");
  }
  DoseSummary s;
  s.min = std::numeric_limits<double>::infinity();
  s.max = s.max_window = -s.min;
  double total = 0;
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (section.cells[i] != FlowCell::part) continue;
    s.max_window = std::max(s.max_window, dose.window[i]);
    const double w = weight.empty() ? 1 : weight[i], d = dose.front[i];
    if (!(w > 0)) continue;
    s.min = std::min(s.min, d);
    s.max = std::max(s.max, d);
    total += w;
    s.mean += w * d;
    s.mean_square += w * (d - 1) * (d - 1);
    s.within_10 += d >= 0.9 && d <= 1.1 ? w : 0;
  }
  if (!(total > 0)) throw InputError("flow", "weight", "no cell of part counts");
  s.mean /= total;
  s.mean_square /= total;
  s.within_10 /= total;
  return s;
}

}  // namespace slicecorr
