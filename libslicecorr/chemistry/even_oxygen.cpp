// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

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

/// What one image is asked: oxygen that each cell is to use up, below 0 where it is not to gel; and where it
/// would gel alone in the exposure the end groups that it would use up, and when it would gel.
struct Asked {
  std::vector<double> used_up, cure, gel_s;
};

/// The oxygen that light uses up against what is asked.
void tally_oxygen(const std::vector<double>& share, const Asked& asked, double margin,
                  Consumption& A, const ExecutionContext& context, OxygenTally& tally,
                  std::size_t* short_of_light) {
  std::vector<double> u = share;
  A.apply(u, context);
  for (std::size_t k = 0; k < u.size(); ++k) {
    if (asked.used_up[k] < 0) continue;
    const double got = u[k] / asked.used_up[k];
    tally.missed += std::abs(got - 1);
    tally.least = std::min(tally.least, got);
    if (short_of_light && got < 1 - margin) ++*short_of_light;
  }
}

/// When a cell gelled; what has not by the end of the exposure counts as so late.
constexpr double kLate = 1.25;
double gel_or_late(const PatternRun& run, std::size_t k, double exposure_s) {
  return std::min(run.gel_time_s[k], kLate * exposure_s);
}

/// What has cured at the end of the exposure.
void tally_cure(const Chemistry& c, const OxygenImage& image, const Asked& asked,
                const PatternRun& run, double exposure_s, OxygenTally& tally) {
  for (std::size_t k = 0; k < asked.cure.size(); ++k) {
    const auto used = static_cast<double>(run.used_up[k]);
    if (image.solid[k] == 0) {
      tally.dark_gelled += used >= c.gel_conversion;
    } else if (asked.cure[k] > 0) {
      tally.cure += std::min(1.0, used / asked.cure[k]);
      tally.behind += used < asked.cure[k] / 2;
      tally.off += std::abs(std::log(gel_or_late(run, k, exposure_s) / asked.gel_s[k]));
    }
  }
}

/// Cells that gel late by the full equations get more light, those that gel early less: after T oxygen still
/// comes from beside, which the linear theory does not see.
void nudge(const OxygenImage& image, const Asked& asked, const PatternRun& run, double exposure_s,
           const LightWanted& bounds, std::vector<double>& share) {
  // A cell's light is oxygen to its neighbours, too: all of a step would be too much.
  constexpr double most = 1.25, part = 0.7;
  for (std::size_t k = 0; k < share.size(); ++k) {
    if (image.solid[k] == 0 || !(asked.cure[k] > 0)) continue;
    const double late = gel_or_late(run, k, exposure_s) / asked.gel_s[k];
    share[k] = std::clamp(share[k] * std::clamp(std::pow(late, part), 1 / most, most),
                          bounds.least[k], bounds.most[k]);
  }
}

}  // namespace

void OxygenTally::add(const OxygenTally& o) {
  missed += o.missed;
  least = std::min(least, o.least);
  cure += o.cure;
  off += o.off;
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
  const GelTime gel = gel_time_of(c);
  Asked asked;
  asked.used_up.assign(n, -1.0);
  asked.cure.assign(n, 0.0);
  asked.gel_s.assign(n, 0.0);
  LightWanted wanted;
  wanted.least.assign(shown.share.begin(), shown.share.end());
  wanted.most = wanted.least;
  wanted.most_elsewhere = 1 - light.margin;
  for (std::size_t k = 0; k < n; ++k) {
    if (image.solid[k] == 0) continue;
    const auto i = static_cast<double>(own[k]);
    asked.used_up[k] = found.by_s * radicals_mol_l_s(c, i) / c.oxygen_mol_l;
    wanted.least[k] = std::max(black, light.least_share * static_cast<double>(shown.share[k]));
    wanted.most[k] = 1;
    const double left_s = exposure_s - inhibition_time_s(c, i);
    const double cure = left_s > 0 ? conversion_after_inhibition(c, i, left_s) : 0;
    if (cure < c.gel_conversion) continue;
    asked.cure[k] = cure;
    asked.gel_s[k] = gel_time_s(gel, i);
    ++found.judged;
  }
  wanted.used_up = asked.used_up;
  // What shines beside the part does so whatever the part gets: nothing is asked of it.
  for (std::size_t k = 0; k < n; ++k) {
    if (image.solid[k] == 0 && image.level[k] > 0) wanted.used_up[k] = kNothing;
  }
  Consumption A(c, image.width, image.height, setup.sides, light.cell_um, light.spread_um, full);
  A.set_time(found.by_s);
  std::vector<double> share{shown.share.begin(), shown.share.end()};
  tally_oxygen(share, asked, light.margin, A, context, found.before, nullptr);
  tally_cure(c, image, asked, run_pattern(c, shown, setup, context), exposure_s, found.before);
  share = find_light(A, wanted, std::move(share), light.steps, context);
  OxygenTally oxygen;
  for (int round = 0; round <= light.rounds; ++round) {
    std::vector<std::uint8_t> level = image.level;
    for (std::size_t k = 0; k < n; ++k) {
      if (image.solid[k] != 0) level[k] = nearest_level(light.level_mw_cm2, share[k] * full);
    }
    const LightPattern pattern = pattern_of(image, level, light);
    if (round == 0) {
      tally_oxygen({pattern.share.begin(), pattern.share.end()}, asked, light.margin, A, context,
                   oxygen, &found.short_of_light);
    }
    const PatternRun run = run_pattern(c, pattern, setup, context);
    OxygenTally tally = oxygen;
    tally_cure(c, image, asked, run, exposure_s, tally);
    // A dark cell that gels is as bad as one that gels at e times its time.
    const auto wrong = [](const OxygenTally& t) {
      return t.off + static_cast<double>(t.dark_gelled);
    };
    if (round == 0 || wrong(tally) < wrong(found.after)) {
      found.after = tally;
      found.level = std::move(level);
    }
    if (found.judged == 0) break;
    nudge(image, asked, run, exposure_s, wanted, share);
  }
  for (std::size_t k = 0; k < n; ++k) {
    const double had = light.level_mw_cm2[image.level[k]];
    if (image.solid[k] != 0 && had > 0) {
      found.brightest = std::max(found.brightest, light.level_mw_cm2[found.level[k]] / had);
    }
  }
  return found;
}

}  // namespace slicecorr::detail
