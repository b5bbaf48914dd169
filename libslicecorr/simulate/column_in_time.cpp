// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "simulate/column_in_time.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "cure/returned_light.hpp"
#include "simulate/doses_in_time.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

namespace {

using Moment = PrintClock::Moment;

/// Gathers gelled stretches from the window to the platform.
class Stretches {
 public:
  Stretches(double layer_um, std::vector<GelledInterval>& out) : layer_um_(layer_um), out_(out) {}
  /// From `zeta` on towards the platform it is gelled, or not.
  void turn(double zeta, bool gelled) {
    if (gelled == gelled_) return;
    gelled_ = gelled;
    if (gelled) {
      front_ = zeta;
    } else if (front_ > zeta) {
      out_.push_back({front_ * layer_um_, zeta * layer_um_});
    }
  }
  bool gelled() const { return gelled_; }
  void finish() {
    turn(0, false);
    std::reverse(out_.begin(), out_.end());
  }

 private:
  double layer_um_;
  std::vector<GelledInterval>& out_;
  bool gelled_ = false;
  double front_ = 0;
};

/// Without UV light: the recursions, begun at the window.
class ClosedColumn final : public Column {
 public:
  ClosedColumn(const CureModel& model, std::vector<double> phi)
      : model_(model), phi_(std::move(phi)) {
    for (int s = 0; s <= kSamplesPerLayer; ++s) {
      fade_[s] = std::exp(-fall() * s / kSamplesPerLayer);
    }
  }

  std::vector<GelledInterval> gelled(const Moment& now) override {
    std::vector<GelledInterval> out;
    Stretches stretches(model_.layer_um, out);
    if (moving()) {
      double below = 0;
      for (int n = now.slice; n >= 0; --n) {
        const double lower = n == now.slice ? n + now.share : n + 1.0;
        const double upper = top_of(n, now, below);
        // The dose is monotone in a layer: it crosses 1 where the ends lie on different sides.
        if ((upper >= 1.0) != (below >= 1.0)) {
          const double d = model_.crossing(phi(n), below);
          stretches.turn(std::max<double>(n, lower - d), upper >= 1.0);
        }
        below = upper;
      }
    } else {
      double far = 0;
      for (int n = now.slice; n >= 0; --n) {
        const double near = shown(n, now) + far;
        stretches.turn(n + 1.0, near >= 1.0);
        far = near * model_.a;
        if (near >= 1.0 && far < 1.0) {
          stretches.turn(std::max<double>(n, n + 1.0 - std::log(near) / fall()), false);
        }
      }
    }
    stretches.finish();
    return out;
  }

  DoseProfile profile(const Moment& now) override {
    DoseProfile p;
    double below = 0;
    for (int n = now.slice; n >= 0; --n) {
      const double near = moving() ? below : shown(n, now) + below;
      const bool partial = moving() && n == now.slice && now.share < 1.0;
      if (partial) add(p, n + now.share, 0.0);
      for (int s = moving() && n < now.slice ? 1 : 0; s <= kSamplesPerLayer; ++s) {
        // From the layer's lower end upwards.
        const double d = static_cast<double>(s) / kSamplesPerLayer;
        if (!moving()) {
          add(p, n + 1.0 - d, near * fade_[s]);
        } else if (!partial) {
          add(p, n + 1.0 - d,
              s == kSamplesPerLayer ? model_.step(phi(n), below)
                                    : phi(n) + (below - phi(n)) * fade_[s]);
        } else if (1.0 - d < now.share) {
          add(p, n + 1.0 - d, phi(n) * -std::expm1((1.0 - d - now.share) * fall()));
        }
      }
      below = moving() ? top_of(n, now, below) : near * model_.a;
    }
    std::reverse(p.z_um.begin(), p.z_um.end());
    std::reverse(p.dose.begin(), p.dose.end());
    return p;
  }

 private:
  bool moving() const { return model_.mode == ExposureMode::continuous; }
  double fall() const { return model_.eta * units::kLn10; }
  double phi(int n) const { return phi_[static_cast<std::size_t>(n)]; }
  double shown(int n, const Moment& now) const {
    return n < now.slice || now.share >= 1.0 ? phi(n) : phi(n) * now.share;
  }
  /// Dose at node n, continuous.
  double top_of(int n, const Moment& now, double below) const {
    if (n < now.slice || now.share >= 1.0) return model_.step(phi(n), below);
    return phi(n) * -std::expm1(-now.share * fall());
  }
  void add(DoseProfile& p, double zeta, double dose) const {
    p.z_um.push_back(zeta * model_.layer_um);
    p.dose.push_back(dose);
  }

  const CureModel& model_;
  std::vector<double> phi_;
  double fade_[kSamplesPerLayer + 1];
};

/// In a bath that ends, or below a platform that sends light back: layers in pieces, each with a dose
/// in closed form.
class PiecewiseColumn final : public Column {
 public:
  PiecewiseColumn(const CureModel& model, std::vector<double> phi)
      : model_(model), phi_(std::move(phi)) {}

  std::vector<GelledInterval> gelled(const Moment& now) override {
    std::vector<GelledInterval> out;
    Stretches stretches(model_.layer_um, out);
    InsideLayer inside;
    double below = 0;
    for (int n = now.slice; n >= 0; --n) {
      const std::vector<Stretch> pieces = pieces_of(n, now, below);
      below = end_of(pieces);
      const double begin = pieces.front().begin * model_.returned(n + 1 - pieces.front().from);
      const double end = below * model_.returned(n);
      inside.crossings.clear();
      look_along(model_, n, pieces, begin, end, inside);
      bool gels = begin >= 1.0;
      stretches.turn(n + 1 - pieces.front().from, gels);
      for (const double d : inside.crossings) stretches.turn(n + 1 - d, gels = !gels);
    }
    stretches.finish();
    return out;
  }

  DoseProfile profile(const Moment& now) override {
    DoseProfile p;
    double below = 0;
    for (int n = now.slice; n >= 0; --n) {
      const std::vector<Stretch> pieces = pieces_of(n, now, below);
      const double first = pieces.front().from;
      const auto add = [&](double d) {
        const auto piece = std::find_if(pieces.begin(), pieces.end() - 1,
                                        [&](const auto& one) { return d <= one.to; });
        p.z_um.push_back((n + 1 - d) * model_.layer_um);
        p.dose.push_back(dose_at(*piece, d) * model_.returned(n + 1 - d));
      };
      // From the layer's lower end upwards; where the window is, doses begin.
      if (!moving() || n == now.slice) add(first);
      for (int s = 1; s <= kSamplesPerLayer; ++s) {
        const double d = static_cast<double>(s) / kSamplesPerLayer;
        if (d > first) add(d);
      }
      below = end_of(pieces);
    }
    std::reverse(p.z_um.begin(), p.z_um.end());
    std::reverse(p.dose.begin(), p.dose.end());
    return p;
  }

 private:
  bool moving() const { return model_.mode == ExposureMode::continuous; }
  double phi(int n) const { return phi_[static_cast<std::size_t>(n)]; }
  double dose_at(const Stretch& piece, double d) const {
    const double fall = model_.eta * units::kLn10;
    return piece.phi + (piece.begin - piece.phi) * std::exp(-fall * (d - piece.from));
  }
  double end_of(const std::vector<Stretch>& pieces) const {
    return dose_at(pieces.back(), pieces.back().to);
  }
  /// Of layer n, at whose lower end the dose is `below`, without the light that the platform sends
  /// back.
  std::vector<Stretch> pieces_of(int n, const Moment& now, double below) const {
    const int far = n + model_.bath_slices;
    const bool ends = model_.bath_slices > 0 && far <= now.slice;
    if (!moving()) {
      const auto shown = [&](int k) { return phi(k) * (k == now.slice ? now.share : 1.0); };
      const double near = ends ? model_.in_bath(shown(n), shown(far)) : shown(n);
      return {{0, 1, 0, near + below}};
    }
    if (n == now.slice) return {{1 - now.share, 1, phi(n), 0}};
    if (!ends) return {{0, 1, phi(n), below}};
    const double counted = model_.in_bath(phi(n), phi(far));
    if (far < now.slice || now.share >= 1.0) return {{0, 1, counted, below}};
    // The stage has pulled the part of the layer that lies nearer to the platform out of the bath.
    const Stretch in{0, 1 - now.share, phi(n), below};
    return {in, {in.to, 1, counted, dose_at(in, in.to)}};
  }

  const CureModel& model_;
  std::vector<double> phi_;
};

/// With UV light: what complete slices left is kept at all samples, the present one is added.
class SampledColumn final : public Column {
 public:
  SampledColumn(const CureModel& model, std::vector<KernelLight> lights)
      : model_(model),
        kernel_(*model.inhibited()),
        lights_(std::move(lights)),
        full_(lights_.size() * kStride, 0.0) {}

  void finish_slice(int n) override {
    if (n == finished_) return;
    add({n, 1.0}, full_);
    finished_ = n;
  }

  std::vector<GelledInterval> gelled(const Moment& now) override {
    const std::vector<double>& dose = doses(now);
    std::vector<GelledInterval> out;
    Stretches stretches(model_.layer_um, out);
    for (int n = now.slice; n >= 0; --n) {
      const double* y = &dose[static_cast<std::size_t>(n) * kStride];
      stretches.turn(n + 1.0, y[0] >= 1.0);
      for (int s = 1; s <= kSamplesPerLayer; ++s) {
        const bool gels = y[s] >= 1.0;
        if (gels != stretches.gelled()) {
          stretches.turn(n + 1.0 - crossing(y, s) / kSamplesPerLayer, gels);
        }
      }
    }
    stretches.finish();
    return out;
  }

  DoseProfile profile(const Moment& now) override {
    const std::vector<double>& dose = doses(now);
    const bool moving = model_.mode == ExposureMode::continuous;
    const double window = now.slice + (moving ? now.share : 1.0);
    DoseProfile p;
    for (int n = 0; n <= now.slice; ++n) {
      // From the layer's upper end downwards; continuous, its end is the next one's beginning.
      const int last = moving && n < now.slice ? 1 : 0;
      for (int s = kSamplesPerLayer; s >= last; --s) {
        const double zeta = n + 1.0 - static_cast<double>(s) / kSamplesPerLayer;
        if (zeta > window) break;
        p.z_um.push_back(zeta * model_.layer_um);
        p.dose.push_back(dose[static_cast<std::size_t>(n) * kStride + static_cast<std::size_t>(s)]);
      }
    }
    if (p.z_um.empty() || p.z_um.back() < window * model_.layer_um) {
      p.z_um.push_back(window * model_.layer_um);
      p.dose.push_back(0);
    }
    return p;
  }

 private:
  static constexpr std::size_t kStride = kSamplesPerLayer + 1;  ///< from the lower end upwards

  /// What a slice of a level has added at distance q / kSamplesPerLayer slices.
  const std::vector<double>& added(int setting, int level, double share) {
    std::vector<double>& values = added_[{setting, level, share}];
    if (values.empty()) {
      const int count = kernel_.near() * kSamplesPerLayer + 1;
      for (int q = 0; q < count; ++q) {
        values.push_back(
            kernel_.exact(setting, level, static_cast<double>(q) / kSamplesPerLayer, share));
      }
    }
    return values;
  }

  /// `add` where layers are not alike: place by place.
  void add_to_own(const Moment& now, std::vector<double>& dose) const {
    const KernelLight& light = lights_[static_cast<std::size_t>(now.slice)];
    const double ratio = model_.ratio(now.slice) * light.amount;
    for (int k = now.slice; k >= 0; --k) {
      const double um = kernel_.place_um(now.slice) - kernel_.place_um(k);
      if (kernel_.fade(um) < 1e-18) break;
      double* const out = &dose[static_cast<std::size_t>(k) * kStride];
      for (std::size_t s = 0; s < kStride; ++s) {
        const double zeta = k + 1.0 - static_cast<double>(s) / kSamplesPerLayer;
        out[s] += ratio * kernel_.added(now.slice, light.level, zeta, now.share);
      }
    }
  }

  void add(const Moment& now, std::vector<double>& dose) {
    if (!kernel_.alike()) {
      add_to_own(now, dose);
      return;
    }
    const KernelLight& light = lights_[static_cast<std::size_t>(now.slice)];
    const std::vector<double>& values =
        added(kernel_.setting_of_slice(now.slice), light.level, now.share);
    const double ratio = model_.ratio(now.slice) * light.amount;
    const int near = kernel_.near();
    // Beyond the near slices the share of UV is gone: each further layer gets a times as much.
    const double* const last = &values[static_cast<std::size_t>((near - 1) * kSamplesPerLayer)];
    double tail = 1;
    for (int k = now.slice; k >= 0; --k) {
      const int j = now.slice - k;
      double* const out = &dose[static_cast<std::size_t>(k) * kStride];
      const double* from = last;
      if (j < near) {
        from = &values[static_cast<std::size_t>(j * kSamplesPerLayer)];
      } else {
        tail *= kernel_.a();
        if (tail < 1e-18) break;
      }
      for (std::size_t s = 0; s < kStride; ++s) out[s] += ratio * tail * from[s];
    }
  }

  const std::vector<double>& doses(const Moment& now) {
    if (now.slice == finished_) return full_;
    sum_ = full_;
    if (now.share > 0) add(now, sum_);
    return sum_;
  }

  /// Samples s - 1 and s lie on different sides of 1: the place between them, in samples from the
  /// layer's lower end, by the cubic through the four nearest.
  static double crossing(const double* y, int s) {
    const int first = std::clamp(s - 2, 0, kSamplesPerLayer - 3);
    const auto at = [&](double t) {
      double sum = 0;
      for (int p = first; p < first + 4; ++p) {
        double weight = y[p];
        for (int q = first; q < first + 4; ++q) {
          if (q != p) weight *= (t - q) / (p - q);
        }
        sum += weight;
      }
      return sum;
    };
    const bool rises = y[s] >= 1.0;
    return halved({s - 1.0, 1.0 * s}, 40, [&](double z) { return (at(z) >= 1.0) != rises; })
        .middle();
  }

  const CureModel& model_;
  const InhibitedKernel& kernel_;
  std::vector<KernelLight> lights_;
  std::vector<double> full_, sum_;
  int finished_ = -1;
  std::map<std::tuple<int, int, double>, std::vector<double>> added_;
};

/// Where doses are no sums: all anew for each moment.
class AnewColumn final : public Column {
 public:
  AnewColumn(const CureModel& model, std::unique_ptr<DosesInTime> doses)
      : model_(model), column_(std::move(doses)) {}

  std::vector<GelledInterval> gelled(const Moment& now) override {
    std::vector<GelledInterval> out;
    Stretches stretches(model_.layer_um, out);
    column_->begin(now);
    constexpr int parts = 4;
    for (int n = now.slice; n >= 0; --n) {
      const double shown = column_->shown(n), lower = n + shown;
      double before = 0;
      stretches.turn(lower, column_->at(n, 0) >= 1.0);
      for (int s = 1; s <= parts; ++s) {
        const double up = shown * s / parts;
        const bool gels = column_->at(n, up) >= 1.0;
        if (gels != stretches.gelled()) stretches.turn(lower - crossing(n, before, up, gels), gels);
        before = up;
      }
    }
    column_->end();
    stretches.finish();
    return out;
  }

  DoseProfile profile(const Moment& now) override {
    DoseProfile p;
    column_->begin(now);
    const bool moving = model_.mode == ExposureMode::continuous;
    for (int n = 0; n <= now.slice; ++n) {
      const double shown = column_->shown(n);
      const int last = moving && n < now.slice ? 1 : 0;
      for (int s = kSamplesPerLayer; s >= last; --s) {
        const double up = shown * s / kSamplesPerLayer;
        p.z_um.push_back((n + shown - up) * model_.layer_um);
        p.dose.push_back(column_->at(n, up));
      }
    }
    column_->end();
    return p;
  }

 private:
  double crossing(int n, double low, double high, bool rises) {
    return halved({low, high}, 40, [&](double z) { return (column_->at(n, z) >= 1.0) != rises; })
        .middle();
  }

  const CureModel& model_;
  std::unique_ptr<DosesInTime> column_;
};

}  // namespace

std::unique_ptr<Column> make_column(const CureModel& model, std::vector<double> phi,
                                    std::vector<KernelLight> lights) {
  if (model.inhibited()) return std::make_unique<SampledColumn>(model, std::move(lights));
  if (auto doses = make_doses_in_time(model, phi)) {
    return std::make_unique<AnewColumn>(model, std::move(doses));
  }
  if (model.bath_slices > 0 || model.mirrored_slices > 0) {
    return std::make_unique<PiecewiseColumn>(model, std::move(phi));
  }
  return std::make_unique<ClosedColumn>(model, std::move(phi));
}

}  // namespace slicecorr::detail
