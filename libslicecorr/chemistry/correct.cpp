#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "chemistry/light.hpp"
#include "chemistry/plane_filter.hpp"
#include "slicecorr/chemistry_pattern.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// The time that is taken where none is asked for, over the least one: what full light needs leaves no
/// light to choose where oxygen comes fastest.
constexpr double kTimeToSpare = 1.25;

/// Oxygen that light uses up by T, over that at the start: u = K_T * G * i / O(0), linear while nobody
/// runs out of it.
class Consumption {
 public:
  Consumption(const Chemistry& c, const LightPattern& p, const PatternSetup& s)
      : c_(c),
        s_(s),
        weights_(detail::spread_weights(s.spread_um, s.cell_um)),
        filter_(p.width, p.height, s.sides) {}

  void set_time(double T_s) {
    const double per_cell = *c_.oxygen_um2_s / (s_.cell_um * s_.cell_um);
    const double ri = radicals_mol_l_s(c_, s_.intensity_mw_cm2 * mean_light_share(c_, s_.film_um)) /
                      c_.oxygen_mol_l;
    // The waves of the cells' own diffusion, as `run_pattern` has it, and of their spread of light.
    const auto symbol = [](double theta) {
      const double s2 = std::sin(theta / 2) * std::sin(theta / 2);
      return 4 * (s2 + s2 * s2 / 3);
    };
    const auto spread = [&](double theta) {
      double sum = weights_[0];
      for (std::size_t j = 1; j < weights_.size(); ++j) {
        sum += 2 * weights_[j] * std::cos(static_cast<double>(j) * theta);
      }
      return sum;
    };
    filter_.set([&](double tx, double ty) {
      const double rate = per_cell * (symbol(tx) + symbol(ty));
      const double life = rate * T_s < 1e-9 ? T_s : -std::expm1(-rate * T_s) / rate;
      return ri * life * spread(tx) * spread(ty);
    });
    most_ = ri * T_s;
  }
  void apply(std::vector<double>& light, const ExecutionContext& context) {
    filter_.apply(light, context);
  }
  /// No wave grows by more than this.
  double most() const { return most_; }

 private:
  const Chemistry& c_;
  const PatternSetup& s_;
  std::vector<double> weights_;
  detail::PlaneFilter filter_;
  double most_ = 0;
};

struct Extremes {
  double least_inside = 0, most_outside = 0;
};
Extremes extremes(const std::vector<double>& u, const std::vector<char>& inside) {
  Extremes e{1e300, 0};
  for (std::size_t k = 0; k < u.size(); ++k) {
    if (inside[k]) {
      e.least_inside = std::min(e.least_inside, u[k]);
    } else {
      e.most_outside = std::max(e.most_outside, u[k]);
    }
  }
  return e;
}

/// Projected gradient with momentum, which begins anew where it would climb.
std::vector<double> search(Consumption& A, const std::vector<char>& inside, double margin,
                           int steps, const ExecutionContext& context) {
  const std::size_t n = inside.size();
  std::vector<double> x(inside.begin(), inside.end()), y = x, gradient(n);
  const double length = 1 / (2 * A.most() * A.most());
  double t = 1;
  for (int step = 0; step < steps; ++step) {
    context.check_cancelled();
    context.report("finding light", static_cast<double>(step) / steps);
    gradient = y;
    A.apply(gradient, context);
    for (std::size_t k = 0; k < n; ++k) {
      const double u = gradient[k];
      gradient[k] = 2 * (inside[k] ? u - 1 : std::max(0.0, u - (1 - margin)));
    }
    A.apply(gradient, context);
    const double next_t = (1 + std::sqrt(1 + 4 * t * t)) / 2, w = (t - 1) / next_t;
    double climbs = 0;
    for (std::size_t k = 0; k < n; ++k) {
      const double next = std::clamp(y[k] - length * gradient[k], 0.0, 1.0);
      climbs += gradient[k] * (next - x[k]);
      y[k] = next + w * (next - x[k]);
      x[k] = next;
    }
    t = next_t;
    if (climbs > 0) {
      t = 1;
      y = x;
    }
  }
  context.report("finding light", 1);
  return x;
}

/// The least time in which full light on the target alone uses up its oxygen; infinite where diffusion
/// brings enough for `most_s`.
double least_time(Consumption& A, const std::vector<char>& inside, double start_s, double most_s,
                  const ExecutionContext& context) {
  const auto reached = [&](double T) {
    context.check_cancelled();
    A.set_time(T);
    std::vector<double> u(inside.begin(), inside.end());
    A.apply(u, context);
    return extremes(u, inside).least_inside;
  };
  double low = start_s, high = start_s;
  while (reached(high) < 1) {
    low = high;
    high *= 2;
    if (high > most_s) return std::numeric_limits<double>::infinity();
  }
  for (int k = 0; k < 12 && high / low > 1.003; ++k) {
    const double middle = std::sqrt(low * high);
    (reached(middle) < 1 ? low : high) = middle;
  }
  return high;
}

}  // namespace

CorrectedPattern correct_pattern(const Chemistry& c, const LightPattern& target,
                                 const PatternSetup& setup, const PatternCorrection& correction,
                                 const ExecutionContext& context) {
  detail::check_pattern(c, target, setup);
  if (!(correction.margin > 0 && correction.margin < 1) || correction.steps < 1 ||
      !(correction.used_up_by_s >= 0) || !std::isfinite(correction.used_up_by_s)) {
    throw InputError(
        fmt::format("a correction with a margin of {:g}, {} steps and oxygen used up by "
                    "{:g} s; expected a margin between 0 and 1, some steps, and a time",
                    correction.margin, correction.steps, correction.used_up_by_s));
  }
  if (!(c.oxygen_mol_l > 0)) {
    throw InputError("the resin has no oxygen; expected some: it is what light is balanced by");
  }
  std::vector<char> inside;
  for (const float share : target.share) inside.push_back(share >= 0.5F ? 1 : 0);
  if (std::find(inside.begin(), inside.end(), 1) == inside.end()) {
    throw InputError("nothing of the image is lit; expected pixels of at least half of the light");
  }
  Consumption A(c, target, setup);
  const double begin =
      inhibition_time_s(c, setup.intensity_mw_cm2 * mean_light_share(c, setup.film_um));
  constexpr double most_times = 4096;
  const double least = least_time(A, inside, begin, begin * most_times, context);
  if (!std::isfinite(least)) {
    throw InfeasibleError(
        fmt::format("oxygen comes from around the target faster than {:g} mW/cm² "
                    "use it up; expected more light or larger features",
                    setup.intensity_mw_cm2));
  }
  CorrectedPattern found;
  found.used_up_by_s = correction.used_up_by_s > 0 ? correction.used_up_by_s
                                                   : std::min(kTimeToSpare * least, setup.light_s);
  A.set_time(found.used_up_by_s);
  std::vector<double> u(inside.begin(), inside.end());
  A.apply(u, context);
  // What is left of it at T is used up soon after, while light is on; but much is more than a correction
  // can even out.
  if (extremes(u, inside).least_inside < 1 - 2 * correction.margin) {
    throw InfeasibleError(fmt::format(
        "{:g} mW/cm² do not use up oxygen in the whole target within {:.4g} s; they would within "
        "{:.4g} s, or {:.4g} mW/cm² would",
        setup.intensity_mw_cm2, found.used_up_by_s, least,
        setup.intensity_mw_cm2 / extremes(u, inside).least_inside));
  }
  std::vector<double> light = search(A, inside, correction.margin, correction.steps, context);
  found.light.width = target.width;
  found.light.height = target.height;
  constexpr double levels = 255;
  for (double& v : light) {
    v = std::round(v * levels) / levels;
    found.light.share.push_back(static_cast<float>(v));
  }
  A.apply(light, context);
  const Extremes e = extremes(light, inside);
  found.least_inside = e.least_inside;
  found.most_outside = e.most_outside;
  if (e.most_outside < std::min(1.0, e.least_inside)) return found;
  // Brighter light for a shorter time leaves oxygen less time to come from the sides.
  for (double brighter = 2; brighter <= 64; brighter *= 2) {
    PatternSetup more = setup;
    more.intensity_mw_cm2 *= brighter;
    Consumption B(c, target, more);
    const double T =
        kTimeToSpare * least_time(B, inside, begin / brighter, begin * most_times, context);
    if (!std::isfinite(T)) continue;
    B.set_time(T);
    std::vector<double> tried = search(B, inside, correction.margin, 100, context);
    B.apply(tried, context);
    const Extremes t = extremes(tried, inside);
    if (t.most_outside >= std::min(1.0, t.least_inside)) continue;
    throw InfeasibleError(fmt::format(
        "with {:g} mW/cm² and oxygen used up by {:.4g} s something outside of the target gels as "
        "well; {:g} mW/cm² for {:.4g} s would do",
        setup.intensity_mw_cm2, found.used_up_by_s, more.intensity_mw_cm2, T));
  }
  throw InfeasibleError(fmt::format(
      "something outside of the target gels as well, and brighter light does not help: what is meant "
      "to stay open is too narrow for a spread of {:g} um",
      setup.spread_um));
}

}  // namespace slicecorr
