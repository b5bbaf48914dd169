#include "chemistry/even_oxygen.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "chemistry/consumption.hpp"
#include "chemistry/light.hpp"

namespace slicecorr::detail {

namespace {

/// Oxygen comes from so many diffusion lengths sqrt(4 D T) away, or light from so many sigmas: what is
/// further is below a thousandth.
constexpr double kReachLengths = 2.5, kReachSigmas = 3;

/// What is wanted of a cell that may use up what it likes.
constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

/// The level whose light is nearest, no darker than black.
std::uint8_t nearest_level(const std::vector<double>& of_level, double mw_cm2) {
  const auto above = std::lower_bound(of_level.begin(), of_level.end(), mw_cm2);
  if (above == of_level.begin()) return 0;
  if (above == of_level.end()) {
    // On a plateau the lowest level is used.
    return static_cast<std::uint8_t>(
        std::lower_bound(of_level.begin(), of_level.end(), of_level.back()) - of_level.begin());
  }
  const auto below = above - 1;
  const bool up = *above - mw_cm2 < mw_cm2 - *below;
  const auto first = std::lower_bound(of_level.begin(), of_level.end(), up ? *above : *below);
  return static_cast<std::uint8_t>(first - of_level.begin());
}

LightPattern pattern_of(const OxygenImage& image, const std::vector<std::uint8_t>& level,
                        const OxygenLight& light) {
  LightPattern p{image.width, image.height, {}};
  const double full = light.level_mw_cm2.back();
  for (const std::uint8_t l : level) {
    p.share.push_back(static_cast<float>(std::min(1.0, light.level_mw_cm2[l] / full)));
  }
  return p;
}

/// What one image is asked: oxygen that each cell is to use up, below 0 where it is not to gel, and the end
/// groups that it would use up alone, 0 where that would not gel.
struct Asked {
  std::vector<double> used_up, cure;
};

OxygenTally tally_of(const Chemistry& c, const OxygenImage& image, const Asked& asked,
                     const OxygenLight& light, Consumption& A,
                     const std::vector<std::uint8_t>& level, double exposure_s,
                     const ExecutionContext& context, EvenOxygen* found) {
  OxygenTally tally;
  const LightPattern pattern = pattern_of(image, level, light);
  std::vector<double> u(pattern.share.begin(), pattern.share.end());
  A.apply(u, context);
  for (std::size_t k = 0; k < u.size(); ++k) {
    const double want = asked.used_up[k];
    if (want < 0) continue;
    const double share = u[k] / want;
    tally.missed += std::abs(share - 1);
    tally.least = std::min(tally.least, share);
    if (found && share < 1 - light.margin) ++found->short_of_light;
  }
  const PatternRun run = run_pattern(c, pattern, judging_setup(light, exposure_s), context);
  for (std::size_t k = 0; k < u.size(); ++k) {
    const auto used = static_cast<double>(run.used_up[k]);
    if (image.solid[k] == 0) {
      tally.dark_gelled += used >= c.gel_conversion;
    } else if (asked.cure[k] > 0) {
      tally.cure += std::min(1.0, used / asked.cure[k]);
      tally.behind += used < asked.cure[k] / 2;
    }
  }
  return tally;
}

}  // namespace

void OxygenTally::add(const OxygenTally& o) {
  missed += o.missed;
  least = std::min(least, o.least);
  cure += o.cure;
  behind += o.behind;
  dark_gelled += o.dark_gelled;
}

int oxygen_reach(const Chemistry& c, const OxygenLight& light, double exposure_s) {
  const double T = oxygen_time_s(c, light.level_mw_cm2.back(), exposure_s);
  const double um = kReachLengths * std::sqrt(4 * c.oxygen_um2_s.value_or(0) * T) +
                    kReachSigmas * light.spread_um;
  return static_cast<int>(std::ceil(um / light.cell_um)) + 1;
}

double oxygen_time_s(const Chemistry& c, double mw_cm2, double exposure_s) {
  return std::min(exposure_s, inhibition_time_s(c, mw_cm2));
}

PatternSetup judging_setup(const OxygenLight& light, double exposure_s) {
  PatternSetup s;
  s.cell_um = light.cell_um;
  s.intensity_mw_cm2 = light.level_mw_cm2.back();
  s.light_s = exposure_s;
  s.sides = Sides::walls;
  s.spread_um = light.spread_um;
  return s;
}

EvenOxygen even_oxygen(const Chemistry& c, const OxygenImage& image, const OxygenLight& light,
                       double exposure_s, const ExecutionContext& context) {
  const PatternSetup setup = judging_setup(light, exposure_s);
  const LightPattern shown = pattern_of(image, image.level, light);
  const std::vector<float> own = light_of(c, shown, setup, context);
  const std::size_t n = shown.share.size();
  EvenOxygen found;
  double brightest = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (image.solid[k] == 0) continue;
    ++found.solid;
    brightest = std::max(brightest, static_cast<double>(own[k]));
  }
  found.by_s = oxygen_time_s(c, brightest, exposure_s);

  const double full = light.level_mw_cm2.back(), black = light.level_mw_cm2.front() / full;
  Asked asked;
  asked.used_up.assign(n, -1.0);
  asked.cure.assign(n, 0.0);
  LightWanted wanted;
  wanted.least.assign(shown.share.begin(), shown.share.end());
  wanted.most = wanted.least;
  wanted.most_elsewhere = 1 - light.margin;
  for (std::size_t k = 0; k < n; ++k) {
    if (image.solid[k] == 0) continue;
    const auto i = static_cast<double>(own[k]);
    asked.used_up[k] = found.by_s * radicals_mol_l_s(c, i) / c.oxygen_mol_l;
    wanted.least[k] = black;
    wanted.most[k] = 1;
    const double left_s = exposure_s - inhibition_time_s(c, i);
    const double cure = left_s > 0 ? conversion_after_inhibition(c, i, left_s) : 0;
    if (cure < c.gel_conversion) continue;
    asked.cure[k] = cure;
    ++found.judged;
  }
  wanted.used_up = asked.used_up;
  // What shines beside the part does so whatever the part gets: nothing is asked of it.
  for (std::size_t k = 0; k < n; ++k) {
    if (image.solid[k] == 0 && image.level[k] > 0) wanted.used_up[k] = kNothing;
  }
  Consumption A(c, image.width, image.height, setup.sides, light.cell_um, light.spread_um, full);
  A.set_time(found.by_s);
  const std::vector<double> x =
      find_light(A, wanted, {shown.share.begin(), shown.share.end()}, light.steps, context);
  found.level = image.level;
  for (std::size_t k = 0; k < n; ++k) {
    if (image.solid[k] == 0) continue;
    found.level[k] = nearest_level(light.level_mw_cm2, x[k] * full);
    const double had = light.level_mw_cm2[image.level[k]];
    if (had > 0) {
      found.brightest = std::max(found.brightest, light.level_mw_cm2[found.level[k]] / had);
    }
  }
  found.before = tally_of(c, image, asked, light, A, image.level, exposure_s, context, nullptr);
  found.after = tally_of(c, image, asked, light, A, found.level, exposure_s, context, &found);
  return found;
}

}  // namespace slicecorr::detail
