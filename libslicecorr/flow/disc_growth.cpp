// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A print from its first instant: Y on cells of r and z, with the front where it has got to.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"
#include "flow/disc_march.hpp"

namespace slicecorr {

namespace {

/// Of the time in which a cell's resin would leave it whole: what two stages with limited slopes bear.
constexpr double kCourant = 0.45;
constexpr int kMostLevels = 2000;

/// The slope that two differences allow (van Leer): none where they differ in sign.
double limited(double below, double above) {
  return below * above > 0 ? 2 * below * above / (below + above) : 0;
}

class Growth {
 public:
  Growth(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
         const DiscGrowth& growth)
      : k_(resin.kinetics),
        growth_(growth),
        speed_(disc::um_s(print.speed_mm_h)),
        diffusion_(disc::diffusion_um2_s(resin)),
        life_(resin.inhibitor_life_s),
        clamped_(life_ <= 0),
        round_(print.shape == DiscShape::disc),
        nr_(static_cast<std::size_t>(growth.cells)),
        nz_(static_cast<std::size_t>(std::ceil(growth.top_um / growth.level_um))),
        dr_(1e3 * print.radius_mm / growth.cells),
        dz_(growth.level_um),
        store_(nr_ * nz_),
        dose_(nr_ * nz_),
        y_(nr_ * nz_),
        stage_(nr_ * nz_),
        change_(nr_ * nz_),
        inward_((nr_ + 1) * nz_),
        upward_(nr_ * (nz_ + 1)),
        gap_(nr_) {
    for (std::size_t i = 0; i < nr_; ++i) {
      places_.push_back((static_cast<double>(i) + 0.5) / growth.cells);
      const double blue = light.blue_mw_cm2.at(places_[i]), uv = light.uv_mw_cm2.at(places_[i]);
      for (std::size_t k = 0; k < nz_; ++k) set_rates(i, k, blue, uv);
    }
  }

  DiscGrown run() {
    DiscGrown grown;
    while (seconds_ < growth_.seconds && !grown.adhesion) {
      find_gap();
      find_flow();
      const double dt = std::min(step_s(), growth_.seconds - seconds_);
      advance(dt);
      seconds_ += dt;
      for (std::size_t i = 0; i < nr_; ++i) {
        if (y_[cell(i, 0)] >= 1 && !grown.adhesion) grown.adhesion = {seconds_, places_[i]};
      }
    }
    find_gap();
    grown.gap_um = {places_, gap_};
    grown.seconds = seconds_;
    for (std::size_t c = 0; c < y_.size(); ++c) {
      grown.undone_places += static_cast<std::size_t>(!clamped_ && y_[c] > 0 && store_[c] < 0);
    }
    return grown;
  }

 private:
  std::size_t cell(std::size_t i, std::size_t k) const { return i * nz_ + k; }
  double platform_um() const { return growth_.first_gap_um + speed_ * seconds_; }

  void set_rates(std::size_t i, std::size_t k, double blue, double uv) {
    const double z0 = static_cast<double>(k) * dz_, z1 = z0 + dz_;
    const double unit = 1 / (dz_ * k_.critical_dose_prime);
    store_[cell(i, k)] = unit * disc::rate_integral(k_, blue, uv, z0, z1);
    dose_[cell(i, k)] = unit * (clamped_ ? disc::clamped_dose_integral(k_, blue, uv, z0, z1)
                                         : disc::dose_integral(k_, blue, uv, z0, z1));
  }

  /// Where the lowest gelled resin is: Y = 1 between the middles of two cells.
  void find_gap() {
    const double most = std::min(platform_um(), static_cast<double>(nz_) * dz_);
    for (std::size_t i = 0; i < nr_; ++i) {
      std::size_t k = 0;
      while (k < nz_ && y_[cell(i, k)] < 1) ++k;
      double h = most;
      if (k == 0) {
        h = 0.5 * dz_;
      } else if (k < nz_) {
        const double below = y_[cell(i, k - 1)], above = y_[cell(i, k)];
        h = dz_ * (static_cast<double>(k) - 0.5 + (1 - below) / (above - below));
      }
      gap_[i] = std::min(h, most);
    }
  }

  /// S r^2/2 F(z/hf) (strip S x F) at a corner of cells.
  double psi(std::size_t face, double z, double flow_gap) const {
    const double r = static_cast<double>(face) * dr_;
    const double through = speed_ * (round_ ? 0.5 * r * r : r);
    return through * flow_share(std::min(z / flow_gap, 1.0));
  }

  /// hf at the faces of cells, by the slope, from h in their middles.
  std::vector<double> flow_gaps() const {
    std::vector<double> r, h;
    for (std::size_t face = 0; face <= nr_; ++face) {
      r.push_back(static_cast<double>(face) * dr_);
      const double inner = face > 0 ? gap_[face - 1] : gap_.front();
      const double outer = face < nr_ ? gap_[face] : gap_.back();
      h.push_back(std::min(inner, outer) + 0.5 * growth_.slope * dr_);
      if (face < nr_) {
        r.push_back((static_cast<double>(face) + 0.5) * dr_);
        h.push_back(gap_[face]);
      }
    }
    disc::limit_slope(r, growth_.slope, h);
    std::vector<double> faces;
    for (std::size_t j = 0; j < h.size(); j += 2) faces.push_back(h[j]);
    // The axis is a mirror: no higher than the cell beside it.
    faces.front() = std::min(faces.front(), gap_.front());
    return faces;
  }

  void find_flow() {
    const std::vector<double> gaps = flow_gaps();
    for (std::size_t k = 0; k <= nz_; ++k) {
      const double z = static_cast<double>(k) * dz_;
      double inner = psi(0, z, gaps[0]);
      for (std::size_t face = 0; face <= nr_; ++face) {
        if (k < nz_)
          inward_[face * nz_ + k] = psi(face, z + dz_, gaps[face]) - psi(face, z, gaps[face]);
        if (face == nr_) continue;
        const double outer = psi(face + 1, z, gaps[face + 1]);
        upward_[face * (nz_ + 1) + k] = outer - inner;
        inner = outer;
      }
    }
  }

  double volume(std::size_t i) const {
    const double r0 = static_cast<double>(i) * dr_, r1 = r0 + dr_;
    return dz_ * (round_ ? 0.5 * (r1 * r1 - r0 * r0) : dr_);
  }

  double step_s() const {
    double most = 0.5 * dz_ / speed_;
    if (diffusion_ > 0) {
      most = std::min(most, 0.2 / (diffusion_ * (1 / (dz_ * dz_) + 1 / (dr_ * dr_))));
    }
    for (std::size_t i = 0; i < nr_; ++i) {
      for (std::size_t k = 0; k < nz_; ++k) {
        const double* up = &upward_[i * (nz_ + 1) + k];
        const double out = inward_[i * nz_ + k] + std::max(up[1], 0.0) + std::max(-up[0], 0.0);
        if (out > 0) most = std::min(most, kCourant * volume(i) / out);
      }
    }
    return most;
  }

  /// Heun's two stages; the store fades behind them.
  void advance(double dt) {
    find_change(y_);
    for (std::size_t c = 0; c < y_.size(); ++c) stage_[c] = y_[c] + dt * change_[c];
    find_change(stage_);
    for (std::size_t c = 0; c < y_.size(); ++c) {
      y_[c] = 0.5 * (y_[c] + stage_[c] + dt * change_[c]);
    }
    if (clamped_ || std::isinf(life_)) return;
    const double left = std::exp(-dt / life_);
    for (double& y : y_) {
      if (y < 0) y *= left;
    }
  }

  void find_change(const std::vector<double>& y) {
    const double liquid_top = platform_um();
    for (std::size_t i = 0; i < nr_; ++i) {
      for (std::size_t k = 0; k < nz_; ++k) {
        const std::size_t c = cell(i, k);
        // Above the platform's underside there is no resin to gain anything.
        const double lit = std::clamp(liquid_top / dz_ - static_cast<double>(k), 0.0, 1.0);
        change_[c] = lit * (y[c] < 0 && !clamped_ ? store_[c] : dose_[c]);
      }
    }
    add_inward(y);
    add_upward(y);
  }

  void add_inward(const std::vector<double>& y) {
    for (std::size_t face = 1; face <= nr_; ++face) {
      const double between = static_cast<double>(face) * dr_ * diffusion_ * dz_ / dr_;
      const double spread = round_ ? between : diffusion_ * dz_ / dr_;
      for (std::size_t k = 0; k < nz_; ++k) {
        double carried = 0;  // inwards; what comes in at the edge is fresh
        if (face < nr_) {
          const double here = y[cell(face, k)], inner = y[cell(face - 1, k)];
          const double outer = face + 1 < nr_ ? y[cell(face + 1, k)] : 0;
          carried = inward_[face * nz_ + k] * (here - 0.5 * limited(here - inner, outer - here)) +
                    spread * (here - inner);
          change_[cell(face, k)] -= carried / volume(face);
        }
        change_[cell(face - 1, k)] += carried / volume(face - 1);
      }
    }
  }

  void add_upward(const std::vector<double>& y) {
    for (std::size_t i = 0; i < nr_; ++i) {
      const double per_volume = 1 / volume(i), spread = diffusion_ * volume(i) / (dz_ * dz_);
      for (std::size_t k = 1; k <= nz_; ++k) {
        const double flux = upward_[i * (nz_ + 1) + k];
        const double below = y[cell(i, k - 1)], above = k < nz_ ? y[cell(i, k)] : below;
        double value = 0;
        if (flux >= 0) {
          const double before = k > 1 ? y[cell(i, k - 2)] : below;
          value = below + 0.5 * limited(below - before, above - below);
        } else {
          const double after = k + 1 < nz_ ? y[cell(i, k + 1)] : above;
          value = above - 0.5 * limited(above - below, after - above);
        }
        const double carried =
            per_volume * (flux * value + (k < nz_ ? spread * (below - above) : 0));
        change_[cell(i, k - 1)] -= carried;
        if (k < nz_) change_[cell(i, k)] += carried;
      }
    }
  }

  const Kinetics& k_;
  const DiscGrowth& growth_;
  double speed_, diffusion_, life_;
  bool clamped_, round_;
  std::size_t nr_, nz_;
  double dr_, dz_;
  std::vector<double> store_, dose_;  ///< of cells, relative dose per second
  std::vector<double> y_, stage_, change_;
  std::vector<double> inward_, upward_;  ///< through faces of cells, per 2 pi (strip: per width)
  std::vector<double> places_, gap_;
  double seconds_ = 0;
};

void check_growth(const DiscGrowth& g) {
  disc::check_positive(g.first_gap_um, "first_gap_um");
  disc::check_positive(g.seconds, "seconds");
  disc::check_positive(g.slope, "slope");
  disc::check_positive(g.level_um, "level_um");
  disc::check_positive(g.top_um, "top_um");
  if (g.cells < 4 || g.cells > 1000) {
    disc::refuse("cells", fmt::format("is {}; expected 4 to 1000", g.cells));
  }
  const double levels = g.top_um / g.level_um;
  if (!(levels >= 4 && levels <= kMostLevels)) {
    disc::refuse("top_um", fmt::format("is {}; expected 4 to {} levels of {} um", g.top_um,
                                       kMostLevels, g.level_um));
  }
}

}  // namespace

DiscGrown grow_disc(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                    const DiscGrowth& growth) {
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_light(light);
  disc::check_inhibited(light);
  check_growth(growth);
  return Growth(resin, print, light, growth).run();
}

LevelFront level_front(const RadialCurve& gap_um, double radius_mm) {
  disc::check_gap(gap_um);
  disc::check_positive(radius_mm, "radius_mm");
  const double level = std::tan(10 * 3.14159265358979323846 / 180);
  LevelFront front;
  double sum = 0, squares = 0;
  for (std::size_t i = 1; i < gap_um.r.size(); ++i) {
    const double width = gap_um.r[i] - gap_um.r[i - 1];
    const double rise = gap_um.value[i] - gap_um.value[i - 1];
    if (std::abs(rise) > level * 1e3 * radius_mm * width) continue;
    const double h = 0.5 * (gap_um.value[i] + gap_um.value[i - 1]);
    front.share += width;
    sum += width * h;
    squares += width * h * h;
  }
  if (front.share <= 0) return front;
  front.mean_um = sum / front.share;
  front.deviation_um =
      std::sqrt(std::max(0.0, squares / front.share - front.mean_um * front.mean_um));
  return front;
}

}  // namespace slicecorr
