// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/disc_march.hpp"

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"

namespace slicecorr::disc {

namespace {

/// Each step is two stages of a diagonally implicit Runge-Kutta method of second order (Alexander's),
/// both with the same length and the second at the step's end: it damps what F' = 0 at window and part
/// makes stiff, and takes steps of any lengths.
const double kStage = 1 - std::sqrt(0.5);

/// Bands of the matrix of a stage: level j against j - 2, j - 1, j, j + 1.
struct Bands {
  std::vector<double> low2, low1, diagonal, up;
  explicit Bands(std::size_t n) : low2(n), low1(n), diagonal(n), up(n) {}
};

/// F dY/dq by level: what passes the level's bounds less what Y itself would. Values at bounds come
/// from below with the slope of the three levels around (Fromm's).
Bands transport(const Levels& l) {
  const std::size_t n = l.middle.size();
  Bands b(n);
  const auto row = [&](std::size_t j, std::size_t i, double weight) {
    (i + 2 == j ? b.low2 : i + 1 == j ? b.low1 : i == j ? b.diagonal : b.up)[j] += weight;
  };
  for (std::size_t bound = 1; bound <= n; ++bound) {
    const std::size_t from = bound - 1;
    const std::size_t before = from > 0 ? from - 1 : 0, after = std::min(from + 1, n - 1);
    const double slope = (l.q[bound] - l.middle[from]) / (l.middle[after] - l.middle[before]);
    const double f = l.share[bound];
    // Out of the level below the bound, and into the one above it.
    row(from, after, f * slope);
    row(from, before, -f * slope);
    if (bound < n) {
      row(bound, from, -f);
      row(bound, bound, f);
      row(bound, after, -f * slope);
      row(bound, before, f * slope);
    }
  }
  return b;
}

/// -(c/(S h)) d2Y/dq2 by level, but for the factor; no flux through both ends.
Bands diffusion(const Levels& l) {
  const std::size_t n = l.middle.size();
  Bands b(n);
  for (std::size_t j = 1; j < n; ++j) {
    const double between = 1 / (l.middle[j] - l.middle[j - 1]);
    b.low1[j] -= between;
    b.diagonal[j] += between;
    b.up[j - 1] -= between;
    b.diagonal[j - 1] += between;
  }
  return b;
}

class March {
 public:
  March(const FlowResin& resin, const DiscPrint& print, const DiscGrid& grid, std::size_t lights)
      : resin_(resin),
        speed_(um_s(print.speed_mm_h)),
        clamped_(resin.inhibitor_life_s <= 0),
        solves_for_sign_(!clamped_ && !is_linear(resin)),
        levels_(make_levels(grid.levels)),
        n_(levels_.middle.size()),
        lights_(lights),
        transport_(transport(levels_)),
        diffusion_(diffusion(levels_)),
        matrix_(n_),
        rates_(lights),
        y_(n_ * lights),
        base_(n_ * lights),
        right_(n_ * lights),
        stage_(n_ * lights),
        stored_(n_) {}

  /// One step of dtau; `gap`, blue and uv at the first stage and at the end.
  struct Conditions {
    double gap_um = 0;
    const double* blue = nullptr;  ///< one for each light
    const double* uv = nullptr;
  };
  void step(double dtau, const Conditions& inside, const Conditions& end) {
    base_ = y_;
    solve_stage(dtau, inside);
    for (std::size_t i = 0; i < y_.size(); ++i) {
      base_[i] = y_[i] + (1 - kStage) / kStage * (stage_[i] - y_[i]);
    }
    solve_stage(dtau, end);
    y_.swap(stage_);
  }

  double front(std::size_t light) const {
    const std::size_t j = n_ - 1;
    const double slope = (1 - levels_.middle[j]) / (levels_.middle[j] - levels_.middle[j - 1]);
    return at(y_, j, light) + slope * (at(y_, j, light) - at(y_, j - 1, light));
  }
  double window(std::size_t light) const { return y_[light]; }
  /// Levels in which dose is being undone.
  std::size_t undone(std::size_t light) const {
    if (clamped_) return 0;
    std::size_t count = 0;
    for (std::size_t j = 0; j < n_; ++j) {
      count += static_cast<std::size_t>(at(y_, j, light) > 0 && rates_[light].store[j] < 0);
    }
    return count;
  }

 private:
  double at(const std::vector<double>& y, std::size_t j, std::size_t light) const {
    return y[j * lights_ + light];
  }

  /// dF/(kStage dtau) (Y - base) + transport + diffusion = (h/S) a dq  ->  stage_.
  void solve_stage(double dtau, const Conditions& now) {
    for (std::size_t k = 0; k < lights_; ++k) {
      level_rates(resin_.kinetics, levels_, now.gap_um, now.blue[k], now.uv[k], clamped_,
                  rates_[k]);
    }
    if (!solves_for_sign_) {
      solve_once(dtau, now.gap_um);
      return;
    }
    // Which levels are in store decides what they gain; that is found by trying, from what was. It
    // settles in a few rounds; a level that is just at 0 may go on changing, either way is right.
    for (std::size_t j = 0; j < n_; ++j) stored_[j] = static_cast<char>(y_[j] < 0);
    for (int round = 0; round < 30; ++round) {
      solve_once(dtau, now.gap_um);
      bool same = true;
      for (std::size_t j = 0; j < n_; ++j) {
        const char in_store =
            static_cast<char>(stage_[j] < 0 || (stage_[j] == 0 && rates_.front().store[j] < 0));
        same = same && in_store == stored_[j];
        stored_[j] = in_store;
      }
      if (same) return;
    }
  }

  void solve_once(double dtau, double gap_um) {
    const double spread = diffusion_um2_s(resin_) / (speed_ * gap_um);
    const double turnover = gap_um / speed_;
    for (std::size_t j = 0; j < n_; ++j) {
      const double held = (levels_.share[j + 1] - levels_.share[j]) / (kStage * dtau);
      const double gain = turnover * (levels_.q[j + 1] - levels_.q[j]);
      const bool in_store = solves_for_sign_ && stored_[j] != 0;
      matrix_.low2[j] = transport_.low2[j];
      matrix_.low1[j] = transport_.low1[j] + spread * diffusion_.low1[j];
      matrix_.up[j] = transport_.up[j] + spread * diffusion_.up[j];
      matrix_.diagonal[j] = held + transport_.diagonal[j] + spread * diffusion_.diagonal[j] +
                            (in_store ? gain / resin_.inhibitor_life_s : 0);
      for (std::size_t k = 0; k < lights_; ++k) {
        right_[j * lights_ + k] = held * base_[j * lights_ + k] +
                                  gain * (in_store ? rates_[k].store[j] : rates_[k].dose[j]);
      }
    }
    eliminate();
  }

  /// Gauss' elimination without exchanges, upwards from the window and back.
  void eliminate() {
    for (std::size_t j = 1; j < n_; ++j) {
      if (j > 1) subtract_row(j, j - 2, matrix_.low2[j], matrix_.low1[j]);
      subtract_row(j, j - 1, matrix_.low1[j], matrix_.diagonal[j]);
    }
    for (std::size_t j = n_; j-- > 0;) {
      for (std::size_t k = 0; k < lights_; ++k) {
        const double above = j + 1 < n_ ? matrix_.up[j] * stage_[(j + 1) * lights_ + k] : 0;
        stage_[j * lights_ + k] = (right_[j * lights_ + k] - above) / matrix_.diagonal[j];
      }
    }
  }
  /// Takes row `i` from row j so that `entry`, in column i, is 0; `next` is in column i + 1.
  void subtract_row(std::size_t j, std::size_t i, double entry, double& next) {
    if (entry == 0) return;
    const double factor = entry / matrix_.diagonal[i];
    next -= factor * matrix_.up[i];
    for (std::size_t k = 0; k < lights_; ++k) {
      right_[j * lights_ + k] -= factor * right_[i * lights_ + k];
    }
  }

  const FlowResin& resin_;
  double speed_;
  bool clamped_, solves_for_sign_;
  Levels levels_;
  std::size_t n_, lights_;
  Bands transport_, diffusion_, matrix_;
  std::vector<LevelRates> rates_;  ///< of each light, at the latest stage
  std::vector<double> y_, base_, right_, stage_;
  std::vector<char> stored_;  ///< whether a level is in store, of the only light
};

/// Gap and lights at a place.
struct AtPlace {
  double gap_um = 0;
  std::vector<double> blue, uv;
};
void look_up(double r, const RadialCurve& gap_um, const std::vector<DiscLight>& lights,
             AtPlace& out) {
  out.gap_um = gap_um.at(r);
  out.blue.clear();
  out.uv.clear();
  for (const DiscLight& light : lights) {
    out.blue.push_back(light.blue_mw_cm2.at(r));
    out.uv.push_back(light.uv_mw_cm2.at(r));
  }
}

}  // namespace

Places make_places(DiscShape shape, const DiscGrid& grid) {
  Places p;
  const double most = -turns_of(shape) * std::log(grid.least_r);
  for (int i = 0; i <= grid.steps; ++i) {
    const double part = static_cast<double>(i) / grid.steps;
    p.tau.push_back(most * part * part * part);
    p.r.push_back(std::exp(-p.tau.back() / turns_of(shape)));
  }
  return p;
}

RadialCurve as_curve(const Places& places, const std::vector<double>& value) {
  return {{places.r.rbegin(), places.r.rend()}, {value.rbegin(), value.rend()}};
}

bool is_linear(const FlowResin& resin) {
  return resin.kinetics.m == 1 && std::isinf(resin.inhibitor_life_s);
}

void limit_slope(const std::vector<double>& r, double slope, std::vector<double>& h) {
  for (std::size_t i = 1; i < h.size(); ++i) {
    h[i] = std::min(h[i], h[i - 1] + slope * (r[i] - r[i - 1]));
  }
  for (std::size_t i = h.size(); i-- > 1;) {
    h[i - 1] = std::min(h[i - 1], h[i] + slope * (r[i] - r[i - 1]));
  }
}

std::vector<DiscDose> march(const FlowResin& resin, const DiscPrint& print,
                            const RadialCurve& gap_um, const std::vector<DiscLight>& lights,
                            const DiscGrid& grid) {
  const Places places = make_places(print.shape, grid);
  const double unit = 1 / resin.kinetics.critical_dose_prime;
  March march(resin, print, grid, lights.size());
  std::vector<std::vector<double>> front(lights.size(), {0.0}), window(lights.size(), {0.0});
  std::vector<DiscDose> doses(lights.size());
  AtPlace inside, end;
  for (std::size_t i = 1; i < places.tau.size(); ++i) {
    const double dtau = places.tau[i] - places.tau[i - 1];
    const double stage_r = std::exp(-(places.tau[i - 1] + kStage * dtau) / turns_of(print.shape));
    look_up(stage_r, gap_um, lights, inside);
    look_up(places.r[i], gap_um, lights, end);
    march.step(dtau, {inside.gap_um, inside.blue.data(), inside.uv.data()},
               {end.gap_um, end.blue.data(), end.uv.data()});
    for (std::size_t k = 0; k < lights.size(); ++k) {
      front[k].push_back(unit * march.front(k));
      window[k].push_back(unit * march.window(k));
      doses[k].undone_places += march.undone(k);
    }
  }
  for (std::size_t k = 0; k < lights.size(); ++k) {
    doses[k].front = as_curve(places, front[k]);
    doses[k].window = as_curve(places, window[k]);
  }
  return doses;
}

}  // namespace slicecorr::disc
