// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/growth.hpp"

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"

namespace slicecorr::detail {

namespace {

/// Of the time in which a cell's resin would leave it whole: what two stages with limited slopes bear.
constexpr double kCourant = 0.45;

/// The slope that two differences allow (van Leer): none where they differ in sign.
double limited(double below, double above) {
  return below * above > 0 ? 2 * below * above / (below + above) : 0;
}

/// What a face carries: the upstream cell's value, half of the limited slope on.
double face_value(double before, double here, double after) {
  return here + 0.5 * limited(here - before, after - here);
}

}  // namespace

GapGrowth::GapGrowth(const FlowResin& resin, const GrowthScale& scale)
    : resin_(resin),
      scale_(scale),
      diffusion_um2_s_(disc::diffusion_um2_s(resin)),
      clamped_(resin.inhibitor_life_s <= 0),
      nz_(scale.levels),
      carried_(nz_) {}

void GapGrowth::set_plan(GrowthPlan plan, std::vector<double> dose) {
  plan_ = std::move(plan);
  y_ = std::move(dose);
  stage_.assign(y_.size(), 0.0);
  change_.assign(y_.size(), 0.0);
  across_.assign(plan_.faces.size() * nz_, 0.0);
  upward_.assign(plan_.cells() * (nz_ + 1), 0.0);
  gap_.assign(plan_.cells(), 0.0);
  felt_ = gap_;
  set_rates();
  find_gap();
}

void GapGrowth::set_fluxes(const std::vector<double>& flux_um3_s) {
  for (std::size_t f = 0; f < plan_.faces.size(); ++f) plan_.faces[f].flux_um3_s = flux_um3_s.at(f);
}

void GapGrowth::set_light(std::vector<double> blue_mw_cm2, std::vector<double> uv_mw_cm2) {
  plan_.blue_mw_cm2 = std::move(blue_mw_cm2);
  plan_.uv_mw_cm2 = std::move(uv_mw_cm2);
  set_rates();
}

void GapGrowth::set_rates() {
  const Kinetics& k = resin_.kinetics;
  const double dz = scale_.level_um, unit = 1 / (dz * k.critical_dose_prime);
  store_.resize(y_.size());
  gain_.resize(y_.size());
  double blue = -1, uv = -1;
  std::size_t like = 0;  // the cell whose light was the last to be worked out
  for (std::size_t i = 0; i < plan_.cells(); ++i) {
    const auto at = [&](std::vector<double>& of, std::size_t cell) {
      return of.begin() + static_cast<std::ptrdiff_t>(cell * nz_);
    };
    if (plan_.blue_mw_cm2[i] == blue && plan_.uv_mw_cm2[i] == uv) {
      std::copy_n(at(store_, like), nz_, at(store_, i));
      std::copy_n(at(gain_, like), nz_, at(gain_, i));
      continue;
    }
    blue = plan_.blue_mw_cm2[i];
    uv = plan_.uv_mw_cm2[i];
    like = i;
    for (std::size_t j = 0; j < nz_; ++j) {
      const double z0 = static_cast<double>(j) * dz, z1 = z0 + dz;
      store_[i * nz_ + j] = unit * disc::rate_integral(k, blue, uv, z0, z1);
      gain_[i * nz_ + j] = unit * (clamped_ ? disc::clamped_dose_integral(k, blue, uv, z0, z1)
                                            : disc::dose_integral(k, blue, uv, z0, z1));
    }
  }
}

void GapGrowth::find_gap() {
  const double dz = scale_.level_um;
  const double most = std::min(platform_um(), static_cast<double>(nz_) * dz);
  for (std::size_t i = 0; i < plan_.cells(); ++i) {
    const double* const y = &y_[i * nz_];
    std::size_t j = 0;
    while (j < nz_ && y[j] < 1) ++j;
    double h = most;
    if (j == 0) {
      h = 0.5 * dz;
    } else if (j < nz_) {
      // Y = 1 between the middles of two levels.
      h = dz * (static_cast<double>(j) - 0.5 + (1 - y[j - 1]) / (y[j] - y[j - 1]));
    }
    gap_[i] = std::min(h, most);
  }
  // Up and down until nothing changes: two passes where neighbours are in a row.
  felt_ = gap_;
  const auto limit = [&](std::size_t i) {
    double h = felt_[i];
    for (const auto& [other, distance_um] : plan_.near[i]) {
      h = std::min(h, felt_[static_cast<std::size_t>(other)] + scale_.slope * distance_um);
    }
    const bool changed = h < felt_[i];
    felt_[i] = h;
    return changed;
  };
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t i = 0; i < felt_.size(); ++i) changed = limit(i) || changed;
    for (std::size_t i = felt_.size(); i-- > 0;) changed = limit(i) || changed;
  }
}

double GapGrowth::face_gap_um(const GrowthFace& face) const {
  const double h = felt_[static_cast<std::size_t>(face.to)];
  // Half way between two cells: so the error goes with the square of a cell.
  if (face.from >= 0) return 0.5 * (h + felt_[static_cast<std::size_t>(face.from)]);
  // At an outline as the front goes on from the cell before; its slope has its bound already.
  const double inner = face.beyond_to >= 0 ? felt_[static_cast<std::size_t>(face.beyond_to)] : h;
  return h + std::max(0.0, 0.5 * (h - inner));
}

void GapGrowth::find_flow() {
  std::fill(upward_.begin(), upward_.end(), 0.0);
  for (std::size_t f = 0; f < plan_.faces.size(); ++f) {
    const GrowthFace& face = plan_.faces[f];
    const double h = face_gap_um(face);
    double* const to = &upward_[static_cast<std::size_t>(face.to) * (nz_ + 1)];
    double* const from =
        face.from >= 0 ? &upward_[static_cast<std::size_t>(face.from) * (nz_ + 1)] : nullptr;
    double below = 0;
    for (std::size_t j = 0; j < nz_; ++j) {
      const double z = static_cast<double>(j + 1) * scale_.level_um;
      const double above = face.flux_um3_s * flow_share(std::min(z / h, 1.0));
      across_[f * nz_ + j] = above - below;
      to[j + 1] += above;
      if (from != nullptr) from[j + 1] -= above;
      below = above;
    }
  }
}

double GapGrowth::longest_step_s() const {
  const double dz = scale_.level_um;
  double most = 0.5 * dz / scale_.speed_um_s;
  if (diffusion_um2_s_ > 0) {
    double across = 0;
    for (const GrowthFace& face : plan_.faces) {
      across = std::max(across, face.exchange / plan_.area_um2[static_cast<std::size_t>(face.to)]);
    }
    most = std::min(most, 0.2 / (diffusion_um2_s_ * (1 / (dz * dz) + across)));
  }
  // What leaves a cell's level through its faces, and through its bounds.
  std::vector<double> out(y_.size(), 0.0);
  for (std::size_t f = 0; f < plan_.faces.size(); ++f) {
    const GrowthFace& face = plan_.faces[f];
    const int source = face.flux_um3_s >= 0 ? face.from : face.to;
    if (source < 0) continue;
    for (std::size_t j = 0; j < nz_; ++j) {
      out[static_cast<std::size_t>(source) * nz_ + j] += std::abs(across_[f * nz_ + j]);
    }
  }
  for (std::size_t i = 0; i < plan_.cells(); ++i) {
    const double volume = dz * plan_.area_um2[i];
    for (std::size_t j = 0; j < nz_; ++j) {
      const double* up = &upward_[i * (nz_ + 1) + j];
      const double leaves = out[i * nz_ + j] + std::max(up[1], 0.0) + std::max(-up[0], 0.0);
      if (leaves > 0) most = std::min(most, kCourant * volume / leaves);
    }
  }
  return most;
}

double GapGrowth::step(double most_s) {
  find_gap();
  find_flow();
  const double dt = std::min(longest_step_s(), most_s);
  find_change(y_);
  for (std::size_t c = 0; c < y_.size(); ++c) stage_[c] = y_[c] + dt * change_[c];
  find_change(stage_);
  for (std::size_t c = 0; c < y_.size(); ++c) {
    y_[c] = 0.5 * (y_[c] + stage_[c] + dt * change_[c]);
  }
  if (!clamped_ && !std::isinf(resin_.inhibitor_life_s)) {
    // The store fades behind both stages.
    const double left = std::exp(-dt / resin_.inhibitor_life_s);
    for (double& y : y_) {
      if (y < 0) y *= left;
    }
  }
  seconds_ += dt;
  return dt;
}

void GapGrowth::find_change(const std::vector<double>& y) {
  const double liquid_top = platform_um();
  for (std::size_t i = 0; i < plan_.cells(); ++i) {
    for (std::size_t j = 0; j < nz_; ++j) {
      const std::size_t c = i * nz_ + j;
      // Above the platform's underside there is no resin to gain anything.
      const double lit =
          std::clamp(liquid_top / scale_.level_um - static_cast<double>(j), 0.0, 1.0);
      change_[c] = lit * (y[c] < 0 && !clamped_ ? store_[c] : gain_[c]);
    }
  }
  add_across(y);
  add_upward(y);
}

void GapGrowth::add_across(const std::vector<double>& y) {
  const std::vector<double> fresh(nz_, 0.0);
  const auto of = [&](int cell, const double* else_) {
    return cell >= 0            ? &y[static_cast<std::size_t>(cell) * nz_]
           : cell == kFreshBath ? fresh.data()
                                : else_;
  };
  for (std::size_t f = 0; f < plan_.faces.size(); ++f) {
    const GrowthFace& face = plan_.faces[f];
    const double* const to = of(face.to, nullptr);
    const double* const from = of(face.from, to);
    const double* const beyond_to = of(face.beyond_to, to);
    const double* const beyond_from = of(face.beyond_from, from);
    const double spread = face.from >= 0 ? diffusion_um2_s_ * scale_.level_um * face.exchange : 0;
    const double* const flux = &across_[f * nz_];
    if (face.flux_um3_s >= 0) {
      for (std::size_t j = 0; j < nz_; ++j) {
        carried_[j] =
            flux[j] * (face.from >= 0 ? face_value(beyond_from[j], from[j], to[j]) : 0.0) +
            spread * (from[j] - to[j]);
      }
    } else {
      for (std::size_t j = 0; j < nz_; ++j) {
        carried_[j] = flux[j] * face_value(beyond_to[j], to[j], face.from >= 0 ? from[j] : to[j]) +
                      spread * (from[j] - to[j]);
      }
    }
    const auto give = [&](int cell, double sign) {
      const auto i = static_cast<std::size_t>(cell);
      const double per_volume = sign / (scale_.level_um * plan_.area_um2[i]);
      for (std::size_t j = 0; j < nz_; ++j) change_[i * nz_ + j] += per_volume * carried_[j];
    };
    give(face.to, 1);
    if (face.from >= 0) give(face.from, -1);
  }
}

void GapGrowth::add_upward(const std::vector<double>& y) {
  const double dz = scale_.level_um;
  for (std::size_t i = 0; i < plan_.cells(); ++i) {
    const double per_volume = 1 / (dz * plan_.area_um2[i]);
    const double spread = diffusion_um2_s_ / (dz * dz);
    const double* const v = &y[i * nz_];
    double* const change = &change_[i * nz_];
    for (std::size_t j = 1; j <= nz_; ++j) {
      const double flux = upward_[i * (nz_ + 1) + j];
      const double below = v[j - 1], above = j < nz_ ? v[j] : below;
      const double value = flux >= 0 ? face_value(j > 1 ? v[j - 2] : below, below, above)
                                     : face_value(j + 1 < nz_ ? v[j + 1] : above, above, below);
      const double carried = per_volume * flux * value + (j < nz_ ? spread * (below - above) : 0);
      change[j - 1] -= carried;
      if (j < nz_) change[j] += carried;
    }
  }
}

std::optional<std::size_t> GapGrowth::stuck() const {
  for (std::size_t i = 0; i < plan_.cells(); ++i) {
    if (window_dose(i) >= 1) return i;
  }
  return {};
}

std::size_t GapGrowth::undone() const {
  std::size_t count = 0;
  for (std::size_t c = 0; c < y_.size(); ++c) {
    count += static_cast<std::size_t>(!clamped_ && y_[c] > 0 && store_[c] < 0);
  }
  return count;
}

}  // namespace slicecorr::detail
