// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/peel.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "flow/rubber.hpp"

namespace slicecorr::detail {

namespace {

// Cells of rubber all know each other: fewer.
constexpr std::size_t kPeelCells = 160, kRubberCells = 64;
constexpr double kFirstStep = 2e-5, kStepGrowth = 1.012;
constexpr int kMostSteps = 1600, kMostRounds = 40;

using CellPair = std::array<double, 2>;  // sigma and W of a cell
using CellBlock = std::array<double, 4>;

CellPair times(const CellBlock& b, const CellPair& p) {
  return {b[0] * p[0] + b[1] * p[1], b[2] * p[0] + b[3] * p[1]};
}
CellBlock times(const CellBlock& a, const CellBlock& b) {
  return {a[0] * b[0] + a[1] * b[2], a[0] * b[1] + a[1] * b[3], a[2] * b[0] + a[3] * b[2],
          a[2] * b[1] + a[3] * b[3]};
}
CellBlock inverse(const CellBlock& b) {
  const double d = b[0] * b[3] - b[1] * b[2];
  return {b[3] / d, -b[1] / d, -b[2] / d, b[0] / d};
}

/// The state of a disc that is pulled, cell by cell.
class PulledDisc {
 public:
  explicit PulledDisc(const Softness& softness)
      : soft_(softness), cells_(softness.rubber > 0 ? kRubberCells : kPeelCells) {
    for (std::size_t i = 0; i <= cells_; ++i) {
      // Quadratic: the outermost of n cells is 1/n² wide.
      const double from_edge = 1 - static_cast<double>(i) / static_cast<double>(cells_);
      edge_.push_back(1 - from_edge * from_edge);
    }
    for (std::size_t i = 0; i < cells_; ++i) {
      middle_.push_back((edge_[i] + edge_[i + 1]) / 2);
      volume_.push_back((edge_[i + 1] * edge_[i + 1] - edge_[i] * edge_[i]) / 2);
    }
    now_.assign(cells_, {0, 0});
    before_ = last_ = height_ = std::vector<double>(cells_, 1.0);
    if (soft_.rubber > 0) {
      std::vector<double> at = middle_;
      at.push_back(1);
      rise_ = soft_.rubber * rubber_rise(edge_, at, soft_.thickness);
    }
  }

  /// One step: to `tau`, `step` after the last one, which was `step_before` long (0: none).
  void advance(double tau, double step, double step_before) {
    const double r = step_before > 0 ? step / step_before : 0;
    const double a0 = (1 + 2 * r) / (1 + r) / step, a1 = (1 + r) / step,
                 a2 = r * r / (1 + r) / step;
    before_.swap(last_);
    last_ = height_;
    for (int round = 0; round < kMostRounds; ++round) {
      if (solve(tau, {a0, a1, a2}) < 1e-9 * (1 + tau)) break;
    }
  }
  /// Over that of a rigid window at the beginning.
  double force() const {
    double sum = 0;
    for (std::size_t i = 0; i < cells_; ++i) sum += 4 * now_[i][0] * volume_[i];
    return sum;
  }

 private:
  /// The weights of this step, the last and the one before in dH/dtau.
  struct Step {
    double now = 0, last = 0, before = 0;
  };
  /// What does not depend on how the window gives way: conductances from each cell outwards.
  struct Ways {
    std::vector<double> across, through;  ///< of resin, with H³; of the film, without
  };

  Ways ways() const {
    Ways w{std::vector<double>(cells_), std::vector<double>(cells_)};
    for (std::size_t i = 0; i < cells_; ++i) {
      const bool inside = i + 1 < cells_;
      const double h = height_[i], next = inside ? height_[i + 1] : outline_;
      // With this mean springs obey lap(H⁴) from cell to cell.
      const double cubed = (h * h + next * next) * (h + next) / 4;
      const double way = (inside ? middle_[i + 1] : 1) - middle_[i];
      w.across[i] = edge_[i + 1] * cubed / way / 4;
      w.through[i] = edge_[i + 1] / way;
    }
    return w;
  }
  /// What a cell holds without the arm.
  double held(std::size_t i, double tau, const Step& step) const {
    return -volume_[i] * (step.now * (1 + tau) - step.last * last_[i] + step.before * before_[i]);
  }

  /// Suction and rise of the window without the arm, and what each unit of the arm's adds to them.
  void solve_chain(double tau, const Step& step, std::vector<CellPair>& plain,
                   std::vector<CellPair>& by_arm) const {
    const Ways w = ways();
    const std::size_t n = cells_;
    std::vector<CellBlock> upper(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double in = i > 0 ? w.across[i - 1] : 0, out = w.across[i];
      const double next = i + 1 < n ? 1 : 0;
      CellBlock own{-(in + out), -step.now * volume_[i], -soft_.springs, 1}, lower{in, 0, 0, 0},
          above{next * out, 0, 0, 0};
      if (soft_.film > 0) {  // with the tension as it is now
        const double film_in = i > 0 ? w.through[i - 1] : 0,
                     film_out = i + 1 < n ? w.through[i] : to_frame();
        own[2] = -soft_.film / tension_ * volume_[i];
        own[3] = film_in + film_out;
        lower[3] = -film_in;
        above[3] = -next * film_out;
      }
      CellPair right{held(i, tau, step), 0}, arm{volume_[i] * step.now, 0};
      if (i > 0) {
        const CellBlock at = times(lower, upper[i - 1]);
        const CellPair a = times(lower, plain[i - 1]), b = times(lower, by_arm[i - 1]);
        for (std::size_t k = 0; k < 4; ++k) own[k] -= at[k];
        for (std::size_t k = 0; k < 2; ++k) {
          right[k] -= a[k];
          arm[k] -= b[k];
        }
      }
      const CellBlock inv = inverse(own);
      upper[i] = times(inv, above);
      plain[i] = times(inv, right);
      by_arm[i] = times(inv, arm);
    }
    for (std::size_t i = n - 1; i-- > 0;) {
      const CellPair a = times(upper[i], plain[i + 1]), b = times(upper[i], by_arm[i + 1]);
      for (std::size_t k = 0; k < 2; ++k) {
        plain[i][k] -= a[k];
        by_arm[i][k] -= b[k];
      }
    }
  }

  /// The same where each cell's suction moves all of the rubber.
  void solve_rubber(double tau, const Step& step, std::vector<CellPair>& plain,
                    std::vector<CellPair>& by_arm) const {
    const Ways w = ways();
    const auto n = static_cast<Eigen::Index>(cells_);
    Eigen::MatrixXd all(n, n), right(n, 2);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      all.row(i) = -step.now * volume_[k] * rise_.row(i);
      const double in = i > 0 ? w.across[k - 1] : 0;
      all(i, i) -= in + w.across[k];
      if (i > 0) all(i, i - 1) += in;
      if (i + 1 < n) all(i, i + 1) += w.across[k];
      right(i, 0) = held(k, tau, step);
      right(i, 1) = volume_[k] * step.now;
    }
    const Eigen::MatrixXd suction = all.partialPivLu().solve(right), rise = rise_ * suction;
    for (std::size_t k = 0; k < cells_; ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      plain[k] = {suction(i, 0), rise(i, 0)};
      by_arm[k] = {suction(i, 1), rise(i, 1)};
    }
  }

  /// A round with the heights of the round before; the greatest change of a height.
  double solve(double tau, const Step& step) {
    std::vector<CellPair> plain(cells_), by_arm(cells_);
    if (soft_.rubber > 0) {
      solve_rubber(tau, step, plain, by_arm);
    } else {
      solve_chain(tau, step, plain, by_arm);
    }
    // The arm yields by its share of a force that depends on how far it yields: one equation.
    double force_plain = 0, force_arm = 0;
    for (std::size_t i = 0; i < cells_; ++i) {
      force_plain += 4 * plain[i][0] * volume_[i];
      force_arm += 4 * by_arm[i][0] * volume_[i];
    }
    const double arm = soft_.arm * force_plain / (1 - soft_.arm * force_arm);
    double change = 0;
    for (std::size_t i = 0; i < cells_; ++i) {
      for (std::size_t k = 0; k < 2; ++k) now_[i][k] = plain[i][k] + arm * by_arm[i][k];
      // A gap does not close: a round that goes too far is drawn back.
      const double h = std::max(1 + tau - now_[i][1] - arm, height_[i] / 2);
      change = std::max(change, std::abs(h - height_[i]));
      height_[i] = h;
    }
    const double rim = rim_rise();
    outline_ = std::max(1 + tau - rim - arm, outline_ / 2);
    if (soft_.stretch > 0) change = std::max(change, stretch(rim));
    return change;
  }

  /// The film's slope at the outline, as it goes on to its frame, over its rise in the outermost cell.
  double to_frame() const { return 1 / (1 - middle_.back() + std::log(soft_.span_ratio)); }

  /// Of the window at the outline.
  double rim_rise() const {
    if (soft_.film > 0) return now_.back()[1] * std::log(soft_.span_ratio) * to_frame();
    double rise = 0;
    for (Eigen::Index j = 0; j < rise_.cols(); ++j) {
      rise += rise_(rise_.rows() - 1, j) * now_[static_cast<std::size_t>(j)][0];
    }
    return rise;
  }

  /// The tension that the film's rise makes; how much that changed it, as a share.
  double stretch(double rim) {
    double squares = rim * rim / std::log(soft_.span_ratio);
    for (std::size_t i = 0; i + 1 < cells_; ++i) {
      const double way = middle_[i + 1] - middle_[i], slope = (now_[i + 1][1] - now_[i][1]) / way;
      squares += slope * slope * edge_[i + 1] * way;
    }
    const double wanted = 1 + soft_.stretch / (soft_.span_ratio * soft_.span_ratio) * squares;
    // The rise goes down as the tension goes up: half of the way, in logarithms, comes to rest.
    const double next = std::sqrt(tension_ * wanted), changed = std::abs(next / tension_ - 1);
    tension_ = next;
    return changed;
  }

  Softness soft_;
  std::size_t cells_;
  Eigen::MatrixXd rise_;  ///< of rubber: W of cells, and of the outline, by sigma of cells
  std::vector<double> edge_, middle_, volume_;
  std::vector<CellPair> now_;
  std::vector<double> height_, last_, before_;  ///< H of this step, of the last, of that before
  double outline_ = 1, tension_ = 1;
};

}  // namespace

Peel peel(const Softness& softness) {
  const double soft = softness.springs + softness.film + softness.arm + softness.rubber;
  if (!(soft > 0)) return {1, 0};
  PulledDisc disc(softness);
  Peel best{0, 0};
  double tau = 0, step = kFirstStep, before = 0;
  for (int k = 0; k < kMostSteps; ++k) {
    tau += step;
    disc.advance(tau, step, before);
    const double force = disc.force();
    if (force > best.share) best = {force, tau};
    if (force < 0.8 * best.share) break;
    before = step;
    step *= kStepGrowth;
  }
  return best;
}

}  // namespace slicecorr::detail
