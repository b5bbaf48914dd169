// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "chemistry/diffusion.hpp"
#include "chemistry/light.hpp"
#include "chemistry/reaction_kernels.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/chemistry_cell.hpp"
#include "slicecorr/chemistry_pattern.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

using detail::kCellBlock;

constexpr double kNever = std::numeric_limits<double>::infinity();
/// Rows that a thread takes at a time.
constexpr std::size_t kRows = 4;
/// Cells that make a thread worth while: some 0.1 ms a step.
constexpr std::size_t kCellsAThread = 3000;

double fastest_um2_s(const Chemistry& c) {
  return std::max({c.oxygen_um2_s.value_or(0), c.initiator_um2_s.value_or(0),
                   c.inhibitor_mol_l > 0 ? c.inhibitor_um2_s.value_or(0) : 0});
}

/// Radicals of the initiator live 1 / (kI P0), and where they get over a twentieth of a cell meanwhile
/// they diffuse. Where they don't, a step of diffusion beside that of reaction would carry farther than
/// they go.
double radicals_um2_s(const Chemistry& c, double cell_um) {
  const double d = c.radical_um2_s.value_or(0);
  const double way_um = std::sqrt(d / (c.initiation_l_mol_s * c.groups_mol_l));
  return way_um > cell_um / 20 ? d : 0;
}

void check_number(double value, double least, bool above, const char* what) {
  if (std::isfinite(value) && (above ? value > least : value >= least)) return;
  throw InputError(fmt::format("{} is {:g}; expected {} {:g}", what, value,
                               above ? "more than" : "at least", least));
}

/// The fields of all cells, row by row, with rows as long as blocks of cells ask for.
class Plane {
 public:
  Plane(const Chemistry& c, double radical_um2_s, int width, int height, Sides sides)
      : width_(static_cast<std::size_t>(width)),
        height_(static_cast<std::size_t>(height)),
        stride_((width_ + kCellBlock - 1) / kCellBlock * kCellBlock),
        walls_(sides == Sides::walls),
        inhibitor_(c.inhibitor_mol_l > 0) {
    const std::size_t n = stride_ * height_;
    I_ = spreading(n, c.initiator_mol_l, c.initiator_um2_s);
    Ir_ = spreading(n, 0, radical_um2_s);
    O_ = spreading(n, c.oxygen_mol_l, c.oxygen_um2_s);
    if (inhibitor_) Q_ = spreading(n, c.inhibitor_mol_l, c.inhibitor_um2_s);
    P0.assign(n, c.groups_mol_l);
    P1.assign(n, 0);
    P2.assign(n, 0);
    P3.assign(n, 0);
    gel_time.assign(n, kNever);
    broken.assign(n, 0);
  }

  std::size_t stride() const { return stride_; }

  /// What is exchanged in a time.
  void diffuse_for(double seconds, double cell_um) {
    for (Spreading* f : fields()) {
      f->shares = detail::exchange_shares(f->um2_s * seconds / (cell_um * cell_um));
    }
  }

  /// Diffusion where `diffuse`, then reaction where there is a step, of all rows.
  void step(const detail::ReactionStep* reaction, bool diffuse, const ExecutionContext& context) {
    const std::size_t blocks = (height_ + kRows - 1) / kRows;
    parallel_for(context, "reacting", blocks, [&](std::size_t block) {
      const std::size_t first = block * kRows, end = std::min(height_, first + kRows);
      for (std::size_t y = first; y < end; ++y) {
        if (diffuse) {
          for (Spreading* f : fields()) diffuse_row(*f, y);
        }
      }
      if (!reaction) return;
      const std::size_t at = first * stride_;
      const auto of = [&](Spreading& f) { return (diffuse ? f.next : f.now).data() + at; };
      const detail::CellArrays cells{
          of(I_),         of(Ir_),        P0.data() + at, P1.data() + at,
          P2.data() + at, P3.data() + at, of(O_),         inhibitor_ ? of(Q_) : nullptr};
      detail::react(*reaction, broken.data() + at, cells, (end - first) * stride_,
                    gel_time.data() + at, nullptr);
    });
    if (!diffuse) return;
    for (Spreading* f : fields()) std::swap(f->now, f->next);
  }

  const std::vector<double>& oxygen() const { return O_.now; }
  const std::vector<double>& initiator() const { return I_.now; }
  std::vector<double> P0, P1, P2, P3, gel_time, broken;

 private:
  struct Spreading {
    double um2_s = 0;
    std::vector<double> now, next, shares;
  };
  static Spreading spreading(std::size_t n, double start, std::optional<double> um2_s) {
    Spreading f;
    f.um2_s = um2_s.value_or(0);
    f.now.assign(n, start);
    f.next = f.now;
    return f;
  }
  std::vector<Spreading*> fields() {
    std::vector<Spreading*> all{&I_, &Ir_, &O_};
    if (inhibitor_) all.push_back(&Q_);
    return all;
  }

  /// Row y of `next`: down the columns from `now`, then along the row.
  void diffuse_row(Spreading& f, std::size_t y) {
    static thread_local std::vector<double> line;
    static thread_local std::vector<const double*> before, after;
    double* out = f.next.data() + y * stride_;
    const double* mid = f.now.data() + y * stride_;
    const std::size_t reach = f.shares.size();
    if (reach == 0) {
      std::copy_n(mid, stride_, out);
      return;
    }
    before.resize(reach);
    after.resize(reach);
    for (std::size_t j = 0; j < reach; ++j) {
      const auto by = static_cast<std::ptrdiff_t>(j + 1), here = static_cast<std::ptrdiff_t>(y);
      before[j] = f.now.data() + detail::wrapped_cell(here - by, height_, walls_) * stride_;
      after[j] = f.now.data() + detail::wrapped_cell(here + by, height_, walls_) * stride_;
    }
    line.resize(stride_ + 2 * reach);
    double* centre = line.data() + reach;
    detail::exchange(centre, mid, before.data(), after.data(), f.shares, stride_);
    // Beyond its sides the row goes on.
    const auto width = static_cast<std::ptrdiff_t>(width_);
    for (std::ptrdiff_t j = 1; j <= static_cast<std::ptrdiff_t>(reach); ++j) {
      const double left = centre[detail::wrapped_cell(-j, width_, walls_)];
      const double right = centre[detail::wrapped_cell(width - 1 + j, width_, walls_)];
      centre[-j] = left;
      centre[width - 1 + j] = right;
    }
    for (std::size_t j = 0; j < reach; ++j) {
      before[j] = centre - (j + 1);
      after[j] = centre + (j + 1);
    }
    detail::exchange(out, centre, before.data(), after.data(), f.shares, width_);
  }

  std::size_t width_, height_, stride_;
  bool walls_, inhibitor_;
  Spreading I_, Ir_, O_, Q_;
};

/// The share of the initiator that breaks in half a step of `h` in each cell: what the reaction is told.
class Breaking {
 public:
  /// `intensity`: in each cell, mW/cm², with the mean over the film as it is at first.
  Breaking(const Chemistry& c, const PatternSetup& s, const std::vector<float>& intensity,
           int width, double h)
      : c_(c), intensity_(intensity), width_(static_cast<std::size_t>(width)), half_(h / 2) {
    if (s.bleaches && s.film_um > 0) film_um_ = s.film_um;
  }
  bool changes() const { return film_um_ > 0; }
  void set(Plane& plane, const ExecutionContext& context) const {
    const double first = film_um_ > 0 ? mean_light_share(c_, film_um_) : 1;
    parallel_for(context, "reacting", intensity_.size() / width_, [&](std::size_t y) {
      Chemistry now = c_;
      for (std::size_t x = 0; x < width_; ++x) {
        const std::size_t at = y * plane.stride() + x;
        double i = intensity_[y * width_ + x];
        if (film_um_ > 0 && i > 0) {
          now.initiator_mol_l = plane.initiator()[at];
          i *= mean_light_share(now, film_um_) / first;
        }
        plane.broken[at] = -std::expm1(-initiation_per_s(c_, i) * half_);
      }
    });
  }

 private:
  const Chemistry& c_;
  const std::vector<float>& intensity_;
  std::size_t width_;
  double half_, film_um_ = 0;
};

/// Light on, or off, for some seconds: so many equal steps.
void walk(Plane& plane, const Chemistry& c, const PatternSetup& s, double seconds, double step_s,
          double& time, const PatternRun* lit, double whole_s, const ExecutionContext& context,
          std::size_t& steps) {
  if (!(seconds > 0)) return;
  const auto count = static_cast<std::size_t>(std::ceil(seconds / step_s * (1 - 1e-12)));
  const double h = seconds / static_cast<double>(count);
  detail::ReactionStep reaction = detail::reaction_of(c);
  reaction.h = h;
  reaction.supply_per_s = s.supply_per_s;
  reaction.outside_mol_l = c.oxygen_mol_l;
  const ExecutionContext quiet = detail::silent(context, plane.broken.size(), kCellsAThread);
  std::fill(plane.broken.begin(), plane.broken.end(), 0.0);
  std::optional<Breaking> light;
  if (lit) {
    light.emplace(c, s, lit->intensity_mw_cm2, lit->width, h);
    light->set(plane, quiet);
  }
  const double begin = time;
  // Two halves of diffusion that meet are one whole.
  plane.diffuse_for(h / 2, s.cell_um);
  for (std::size_t k = 0; k < count; ++k) {
    reaction.time = begin + static_cast<double>(k) * h;
    if (k > 0 && light && light->changes()) light->set(plane, quiet);
    plane.step(&reaction, true, quiet);
    if (k == 0) plane.diffuse_for(h, s.cell_um);
    if (k % 16 == 0) context.report("reacting", (reaction.time + h) / whole_s);
  }
  plane.diffuse_for(h / 2, s.cell_um);
  plane.step(nullptr, true, quiet);
  time = begin + seconds;
  steps += count;
}

bool meant(float share) { return share >= 0.5F; }

}  // namespace

void detail::check_pattern(const Chemistry& c, const LightPattern& p, const PatternSetup& s) {
  if (p.width < 1 || p.height < 1 ||
      p.share.size() != static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.height)) {
    throw InputError(fmt::format("an image of {} x {} cells with {} figures; expected one for each",
                                 p.width, p.height, p.share.size()));
  }
  for (const float v : p.share) {
    if (!(v >= 0 && v <= 1)) {
      throw InputError(fmt::format("the image has a share of light of {:g}; expected 0 to 1", v));
    }
  }
  check_number(s.cell_um, 0, true, "the side of a cell, um,");
  check_number(s.intensity_mw_cm2, 0, true, "the intensity, mW/cm²,");
  check_number(s.light_s, 0, true, "the time of light, s,");
  check_number(s.dark_s, 0, false, "the time in the dark, s,");
  check_number(s.spread_um, 0, false, "the spread of light, um,");
  check_number(s.film_um, 0, false, "the thickness of the film, um,");
  check_number(s.supply_per_s, 0, false, "the resupply of oxygen, 1/s,");
  check_number(s.step_s, 0, false, "the step, s,");
  if (!c.oxygen_um2_s || !c.initiator_um2_s) {
    throw InputError(fmt::format(
        "the resin does not say how fast {} diffuses; expected [chemistry] "
        "viscosity_pa_s with {}_radius_angstrom, or {}_diffusion_um2_s",
        c.oxygen_um2_s ? "initiator" : "oxygen", c.oxygen_um2_s ? "initiator" : "oxygen",
        c.oxygen_um2_s ? "initiator" : "oxygen"));
  }
  if (s.step_s > longest_step_s(c, s)) {
    throw InputError(
        fmt::format("the step is {:g} s; cells of {:g} um with a diffusivity of {:.4g} "
                    "um²/s allow at most dx²/4D = {:.4g} s",
                    s.step_s, s.cell_um, fastest_um2_s(c), longest_step_s(c, s)));
  }
}

LightPattern pattern_of_grey(int width_px, int height_px, const std::vector<std::uint8_t>& grey,
                             int refine) {
  LightPattern p;
  p.width = width_px * refine;
  p.height = height_px * refine;
  p.share.reserve(static_cast<std::size_t>(p.width) * static_cast<std::size_t>(p.height));
  for (int y = 0; y < p.height; ++y) {
    const std::size_t row =
        static_cast<std::size_t>(y / refine) * static_cast<std::size_t>(width_px);
    for (int x = 0; x < p.width; ++x) {
      p.share.push_back(static_cast<float>(grey[row + static_cast<std::size_t>(x / refine)]) / 255);
    }
  }
  return p;
}

double longest_step_s(const Chemistry& c, const PatternSetup& s) {
  const double d = fastest_um2_s(c);
  return d > 0 ? s.cell_um * s.cell_um / (4 * d) : kNever;
}

double step_of(const Chemistry& c, const PatternSetup& s) {
  if (s.step_s > 0) return s.step_s;
  const double i = s.intensity_mw_cm2 * mean_light_share(c, s.film_um);
  return std::min({longest_step_s(c, s), gel_time_s(gel_time_of(c), i) / 150, rise_time_s(c, i) / 3,
                   s.light_s});
}

std::size_t pattern_bytes(int width, int height, const Chemistry& c) {
  const std::size_t stride =
      (static_cast<std::size_t>(width) + kCellBlock - 1) / kCellBlock * kCellBlock;
  // P0 to P3, time and light; I, Ir, O and Q twice; image, light, and what comes back.
  const std::size_t doubles = 6 + 2 * (c.inhibitor_mol_l > 0 ? 4 : 3) + 1, floats = 4;
  return stride * static_cast<std::size_t>(height) * (8 * doubles + 4 * floats);
}

int thinnest_cells(const LightPattern& p, Sides sides) {
  int least = std::numeric_limits<int>::max();
  const auto scan = [&](int n, const auto& lit) {
    int first_dark = 0;
    while (first_dark < n && lit(first_dark)) ++first_dark;
    if (first_dark == n) return;
    // A run that goes over the side of a periodic image is one run; at a wall it is mirrored.
    const bool round = sides == Sides::periodic;
    int run = 0;
    for (int k = 1; k <= n; ++k) {
      const int at = round ? (first_dark + k) % n : k - 1;
      if (lit(at)) {
        ++run;
      } else if (run > 0) {
        const bool mirrored = !round && at == run;
        least = std::min(least, mirrored ? 2 * run : run);
        run = 0;
      }
    }
    if (!round && run > 0) least = std::min(least, 2 * run);
  };
  for (int y = 0; y < p.height; ++y) scan(p.width, [&](int x) { return meant(p.at(x, y)); });
  for (int x = 0; x < p.width; ++x) scan(p.height, [&](int y) { return meant(p.at(x, y)); });
  const bool any = std::any_of(p.share.begin(), p.share.end(), meant);
  return !any ? 0 : least == std::numeric_limits<int>::max() ? std::min(p.width, p.height) : least;
}

PatternRun run_pattern(const Chemistry& c, const LightPattern& pattern, const PatternSetup& setup,
                       const ExecutionContext& context) {
  detail::check_pattern(c, pattern, setup);
  PatternRun run;
  run.width = pattern.width;
  run.height = pattern.height;
  run.intensity_mw_cm2 = detail::light_of(c, pattern, setup, context);
  run.step_s = step_of(c, setup);
  Plane plane(c, radicals_um2_s(c, setup.cell_um), pattern.width, pattern.height, setup.sides);
  double time = 0;
  const double whole = setup.light_s + setup.dark_s;
  walk(plane, c, setup, setup.light_s, run.step_s, time, &run, whole, context, run.steps);
  walk(plane, c, setup, setup.dark_s, run.step_s, time, nullptr, whole, context, run.steps);
  context.report("reacting", 1);

  const std::size_t n = pattern.share.size(), width = static_cast<std::size_t>(pattern.width);
  run.gel_time_s.resize(n);
  run.oxygen_left.resize(n);
  run.used_up.resize(n);
  double oxygen = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t at = k / width * plane.stride() + k % width;
    run.gel_time_s[k] = plane.gel_time[at];
    const double left = plane.oxygen()[at];
    run.oxygen_left[k] = c.oxygen_mol_l > 0 ? static_cast<float>(left / c.oxygen_mol_l) : 0.0F;
    run.used_up[k] = static_cast<float>(1 - plane.P0[at] / c.groups_mol_l);
    const double groups = plane.P0[at] + plane.P1[at] + plane.P2[at] + plane.P3[at];
    run.balance_error =
        std::max(run.balance_error, std::abs(groups - c.groups_mol_l) / c.groups_mol_l);
    oxygen += left + plane.P3[at];
  }
  const bool only_chains = c.inhibitor_mol_l == 0 && c.initiator_oxygen_l_mol_s == 0;
  if (only_chains && setup.supply_per_s == 0 && c.oxygen_mol_l > 0) {
    run.oxygen_balance_error = std::abs(oxygen / (static_cast<double>(n) * c.oxygen_mol_l) - 1);
  }
  return run;
}

std::vector<Overlap> overlap_over_time(const PatternRun& run, const LightPattern& target,
                                       double end_s, int count) {
  std::vector<double> in, out;
  std::size_t wanted = 0;
  for (std::size_t k = 0; k < run.gel_time_s.size(); ++k) {
    const bool want = meant(target.share[k]);
    wanted += want;
    if (std::isfinite(run.gel_time_s[k])) (want ? in : out).push_back(run.gel_time_s[k]);
  }
  std::sort(in.begin(), in.end());
  std::sort(out.begin(), out.end());
  const auto by = [](const std::vector<double>& v, double t) {
    return static_cast<double>(std::upper_bound(v.begin(), v.end(), t) - v.begin());
  };
  std::vector<Overlap> overlaps;
  for (int k = 0; k <= count; ++k) {
    const double t = end_s * k / count;
    const double either = static_cast<double>(wanted) + by(out, t);
    overlaps.push_back({t, either > 0 ? by(in, t) / either : 0});
  }
  return overlaps;
}

Overlap best_overlap(const PatternRun& run, const LightPattern& target) {
  std::vector<std::pair<double, bool>> events;
  std::size_t wanted = 0;
  for (std::size_t k = 0; k < run.gel_time_s.size(); ++k) {
    const bool want = meant(target.share[k]);
    wanted += want;
    if (std::isfinite(run.gel_time_s[k])) events.emplace_back(run.gel_time_s[k], want);
  }
  std::sort(events.begin(), events.end());
  Overlap best;
  std::size_t in = 0, out = 0;
  for (std::size_t k = 0; k < events.size(); ++k) {
    (events[k].second ? in : out) += 1;
    if (k + 1 < events.size() && events[k + 1].first == events[k].first) continue;
    const double jaccard = static_cast<double>(in) / static_cast<double>(wanted + out);
    if (jaccard > best.jaccard) best = {events[k].first, jaccard};
  }
  return best;
}

PatternFigures figures_of(const PatternRun& run, const LightPattern& target) {
  PatternFigures f;
  double first = kNever;
  for (std::size_t k = 0; k < run.gel_time_s.size(); ++k) {
    const double t = run.gel_time_s[k];
    const bool gelled = std::isfinite(t), lit = meant(target.share[k]);
    f.lit += lit;
    f.gelled += gelled;
    if (!gelled) continue;
    if (lit) {
      ++f.lit_gelled;
      first = std::min(first, t);
      f.last_lit_s = std::max(f.last_lit_s, t);
    } else {
      ++f.dark_gelled_at_end;
    }
  }
  f.first_s = std::isfinite(first) ? first : 0;
  for (std::size_t k = 0; k < run.gel_time_s.size(); ++k) {
    f.dark_gelled += !meant(target.share[k]) && run.gel_time_s[k] <= f.last_lit_s;
  }
  return f;
}

}  // namespace slicecorr
