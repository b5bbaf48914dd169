// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cell_law.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::detail {
namespace {

/// Pieces settle within a few rounds; with m other than 1 a level may hesitate between two, and is
/// held at 0 then.
constexpr int kRounds = 40, kPatience = 20;

/// Integrals of e^(-z/height) over levels of a gap, over the speed.
void fill(std::vector<double>& into, double height_um, double gap_um, const GapLevels& levels,
          double factor) {
  double last = 1;
  for (std::size_t j = 0; j < into.size(); ++j) {
    const double across = gap_um * (levels.face[j + 1] - levels.face[j]) / height_um;
    into[j] = -factor * height_um * last * std::expm1(-across);
    last *= std::exp(-across);
  }
}

}  // namespace

void LevelLight::set(const Kinetics& k, const GapLevels& levels, double gap_um, double um_s) {
  fill(blue, k.hb_um, gap_um, levels, 1 / um_s);
  if (k.beta > 0) {
    fill(uv, k.huv_um, gap_um, levels, -k.beta / um_s);
  } else {
    std::fill(uv.begin(), uv.end(), 0.0);
  }
}

CellLaw::CellLaw(const FlowResin& resin, const GapLevels& levels) : resin_(resin), levels_(levels) {
  for (auto* v :
       {&stored_, &gained_, &gained_blue_, &gained_uv_, &below2_, &below_, &inverse_, &in_}) {
    v->resize(levels.size());
  }
}

void CellLaw::go_to(double diagonal, double spread, double gap_um, double um_s,
                    const LevelLight& light, double blue, double uv) {
  const Kinetics& k = resin_.kinetics;
  light_ = &light;
  diagonal_ = diagonal;
  spread_ = spread;
  decay_ = resin_.inhibitor_life_s > 0 ? gap_um / (um_s * resin_.inhibitor_life_s) : 0;
  for (std::size_t j = 0; j < levels_.size(); ++j) {
    stored_[j] = light.blue[j] * blue + light.uv[j] * uv;
  }
  if (k.m == 1) {
    gained_ = stored_;
    gained_blue_ = light.blue;
    gained_uv_ = light.uv;
    return;
  }
  // sign(a) |a|^m at Gauss' two places of each level.
  for (std::size_t j = 0; j < levels_.size(); ++j) {
    const double dz = gap_um * thick(j), apart = dz * std::sqrt(1.0 / 12);
    gained_[j] = gained_blue_[j] = gained_uv_[j] = 0;
    for (const double side : {-1.0, 1.0}) {
      const double z = gap_um * levels_.middle[j] + side * apart;
      const double eb = std::exp(-z / k.hb_um);
      const double eu = k.beta > 0 ? -k.beta * std::exp(-z / k.huv_um) : 0;
      const double a = eb * blue + eu * uv, size = std::abs(a);
      const double half = 0.5 * dz / um_s;
      gained_[j] += half * std::copysign(std::pow(size, k.m), a);
      const double slope = size > 0 ? half * k.m * std::pow(size, k.m - 1) : 0;
      gained_blue_[j] += slope * eb;
      gained_uv_[j] += slope * eu;
    }
  }
}

BandRow CellLaw::row(std::size_t j, DosePiece piece) const {
  BandRow r = band_row(levels_, j, diagonal_, 1, spread_);
  if (piece == DosePiece::store) r.diagonal += decay_ * thick(j);
  return r;
}

double CellLaw::source(std::size_t j, DosePiece piece) const {
  return piece == DosePiece::dose ? gained_[j] : piece == DosePiece::store ? stored_[j] : 0.0;
}

void CellLaw::factor(const DosePiece* piece) {
  factor_band(
      levels_, [&](std::size_t j) { return row(j, piece[j]); },
      [&](std::size_t j) { return piece[j] == DosePiece::empty; },
      {below2_.data(), below_.data(), inverse_.data(), spread_});
}

void CellLaw::march(double* y, DosePiece* piece) const {
  // Nothing comes from above, so levels follow one after the other.
  for (std::size_t j = 0; j < levels_.size(); ++j) {
    const BandRow r = row(j, DosePiece::dose);
    const double in = y[j] - (j > 0 ? r.below * y[j - 1] : 0) - (j > 1 ? r.below2 * y[j - 2] : 0);
    piece[j] = DosePiece::dose;
    y[j] = (in + gained_[j]) / r.diagonal;
    if (y[j] >= 0) continue;
    const double stored = (in + stored_[j]) / (r.diagonal + decay_ * thick(j));
    piece[j] = stored < 0 ? negative() : DosePiece::empty;
    y[j] = piece[j] == DosePiece::store ? stored : 0;
  }
}

bool CellLaw::better(const double* in, const double* y, DosePiece* piece) const {
  bool changed = false;
  for (std::size_t j = 0; j < levels_.size(); ++j) {
    DosePiece next = piece[j];
    if (piece[j] == DosePiece::empty) {
      const BandRow r = row(j, DosePiece::dose);
      const double rest = in[j] - (j > 0 ? r.below * y[j - 1] : 0) -
                          (j > 1 ? r.below2 * y[j - 2] : 0) +
                          (j + 1 < levels_.size() ? spread_ * levels_.per_step[j] * y[j + 1] : 0);
      if (rest + gained_[j] > 0) {
        next = DosePiece::dose;
      } else if (rest + stored_[j] < 0) {
        next = negative();
      }
    } else if ((piece[j] == DosePiece::dose) != (y[j] >= 0)) {
      next = y[j] >= 0 ? DosePiece::dose : negative();
    }
    changed = changed || next != piece[j];
    piece[j] = next;
  }
  return changed;
}

void CellLaw::solve(double* y, DosePiece* piece) {
  if (spread_ == 0) return march(y, piece);
  const std::size_t n = levels_.size();
  std::copy_n(y, n, in_.begin());
  for (std::size_t j = 0; j < n; ++j) {
    piece[j] = in_[j] + gained_[j] >= 0 ? DosePiece::dose : negative();
  }
  for (int round = 0;; ++round) {
    factor(piece);
    for (std::size_t j = 0; j < n; ++j) {
      y[j] = piece[j] == DosePiece::empty ? 0 : in_[j] + source(j, piece[j]);
    }
    solve_band(
        levels_, {below2_.data(), below_.data(), inverse_.data(), spread_},
        [&](std::size_t j) { return piece[j] == DosePiece::empty; }, y);
    if (round >= kRounds) return;
    if (round >= kPatience) {
      bool changed = false;
      for (std::size_t j = 0; j < n; ++j) {
        if (piece[j] == DosePiece::empty || (piece[j] == DosePiece::dose) == (y[j] >= 0)) continue;
        piece[j] = DosePiece::empty;
        changed = true;
      }
      if (!changed) return;
    } else if (!better(in_.data(), y, piece)) {
      return;
    }
  }
}

void CellLaw::solve_back(const DosePiece* piece, double* y, double& slope_blue, double& slope_uv) {
  factor(piece);
  const std::size_t n = levels_.size();
  solve_transposed(
      levels_, {below2_.data(), below_.data(), inverse_.data(), spread_},
      [&](std::size_t j) { return piece[j] == DosePiece::empty; }, y);
  slope_blue = slope_uv = 0;
  for (std::size_t j = 0; j < n; ++j) {
    if (piece[j] == DosePiece::empty) {
      y[j] = 0;
    } else if (piece[j] == DosePiece::store) {
      slope_blue += light_->blue[j] * y[j];
      slope_uv += light_->uv[j] * y[j];
    } else {
      slope_blue += gained_blue_[j] * y[j];
      slope_uv += gained_uv_[j] * y[j];
    }
  }
}

}  // namespace slicecorr::detail
