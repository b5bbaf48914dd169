#include "slicecorr/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <tuple>

#include "parallel/silent.hpp"
#include "plan/closed.hpp"
#include "plan/search.hpp"
#include "plan/trial.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/limit.hpp"

namespace slicecorr {

namespace {

using detail::DesignColumns;
using detail::PaceRange;
using detail::PartHeights;
using detail::Trials;

/// Digits of speeds and exposures that are tried: what is told reads back as what was tried.
constexpr int kPaceDigits = 6;
/// Slowest speed over the fastest where the light of black sets none.
constexpr double kSlowest = 1e-3;

void check(const SliceSource& target, const Setup& setup, const PlanAsk& ask) {
  const auto expect = [](bool holds, const std::string& what) {
    if (!holds) throw InputError(what);
  };
  expect(ask.tolerance_um > 0 && std::isfinite(ask.tolerance_um),
         fmt::format("a tolerance of {:g} um; expected one above 0", ask.tolerance_um));
  expect(ask.gap_contrast >= 0 && ask.gap_contrast < 1,
         fmt::format("a contrast of {:g}; expected 0 to below 1", ask.gap_contrast));
  expect(ask.light_error >= 0 && ask.light_error < 1,
         fmt::format("an error of the light of {:g}; expected 0 to below 1", ask.light_error));
  expect(ask.least_gap_um >= 0, "a least gap below 0 um");
  expect(!target.doses(), "wanted doses can't be planned for; expected a part without them");
  expect(!target.left_alone(), "what is left alone can't be planned for; expected the part alone");
  const Process& p = setup.process;
  expect(p.even_dead_zone == EvenDeadZone::off,
         "light for an even dead zone can't be planned for; expected UV light of one intensity");
  expect(p.uv.kind == UvKind::off || p.uv.kind == UvKind::constant,
         "UV light that changes can't be planned for; expected one intensity");
  expect(p.layer_exposure_s.empty(),
         "exposures of each layer can't be planned for; expected one of normal layers");
  expect(!ask.free.uv || p.uv.kind == UvKind::constant,
         "UV light is to be chosen; expected its greatest intensity");
  expect(!(ask.free.lamp && p.mode == ExposureMode::layerwise),
         "layer by layer less light only takes longer; expected the lamp not to be free");
}

/// Paces between which resin gels in full light and not in black; what no stage does is not yet left out.
PaceRange gelling(const Setup& setup, double layer_um) {
  Process p = setup.process;
  const bool continuous = p.mode == ExposureMode::continuous;
  constexpr double reference = 100;
  if (continuous) {
    p.speed_mm_h = reference;
  } else {
    p.exposure_s = 1;
    p.bottom_exposure_s = 0;
    p.bottom_layers = p.fade_layers = 0;
  }
  const CureModel model = make_cure_model(setup.printer, setup.resin, p, layer_um);
  double lit = model.steady(model.phi_max()),
         black = model.steady(model.phi_min()) * model.returned(0);
  if (model.inhibited) {
    const InhibitedKernel& kernel = *model.inhibited;
    const int s = kernel.strongest_setting();
    lit = kernel.steady_dose(s, kernel.highest_usable_level(s));
    black = kernel.steady_dose(0, 0);
  } else if (model.gel_time && !continuous) {
    const GelTimeKernel& kernel = *model.gel_time;
    lit = kernel.dose_through_layer(kernel.level_mw_cm2(kernel.levels() - 1), 1);
    const std::vector<std::uint8_t> dark(2 * static_cast<std::size_t>(kernel.reach()), 0);
    black = column_dose(model, dark).lower.front();
  } else if (!continuous) {
    lit = model.phi_max() * model.a;
    black = model.phi_min() / model.one_minus_a;
  }
  const double unit = continuous ? reference : 1;
  PaceRange r{unit * black * (1 + 1e-6), unit * lit * (1 - 1e-6)};
  r.least = std::max(r.least, kSlowest * r.greatest);
  return r;
}

Setup at_pace(Setup setup, double pace) {
  if (setup.process.mode == ExposureMode::continuous) {
    setup.process.speed_mm_h = rounded_down(pace, kPaceDigits);
  } else {
    setup.process.exposure_s = rounded_up(1 / pace, kPaceDigits);
  }
  return setup;
}

/// What a search has tried and found.
class Planner {
 public:
  Planner(const SliceSource& target, const DesignColumns& columns, const PartHeights& heights,
          const Trials& trials, const Setup& setup, const PlanAsk& ask,
          const ExecutionContext& context, std::vector<PlanPoint>& tried)
      : columns_(columns),
        heights_(heights),
        trials_(trials),
        setup_(setup),
        context_(context),
        quiet_(detail::silent(context)),
        tried_(tried),
        gels_(gelling(setup, target.grid().layer_um)),
        which_(critical(ask.most_columns)) {
    // Stages are another limit, and none of the light's.
    setup_.printer.max_speed_mm_h = 0;
    const double layer_um = target.grid().layer_um;
    if (setup.process.mode == ExposureMode::continuous && setup.process.uv.kind == UvKind::off) {
      Process p = setup.process;
      p.speed_mm_h = std::max(1.0, gels_.greatest);
      const CureModel model = make_cure_model(setup.printer, setup.resin, p, layer_um);
      if (model.is_continuous()) {
        light_ = plan_light(model, p.speed_mm_h);
        m_ = model.m;
      }
    }
  }

  const std::optional<PlanLight>& light() const { return light_; }
  double m() const { return m_; }
  const PaceRange& gels() const { return gels_; }
  std::size_t judged() const { return which_.size(); }

  /// The fastest with all columns, at most `most` (a pace); `ranges`: where to look first.
  std::optional<PlanPoint> fastest(const std::vector<PaceRange>& ranges, double most) {
    // Each round adds columns that fail, and what failed stays so: there is an end.
    for (;;) {
      const auto pace = detail::fastest_pace(ranges, most, [&](double p) { return at(p).keeps; });
      if (!pace) return std::nullopt;
      PlanPoint found = at(*pace);
      if (found.all_columns) return found;
      std::vector<std::uint32_t> failing, all(columns_.columns().size());
      std::iota(all.begin(), all.end(), 0U);
      const PlanPoint whole = trials_.correct(at_pace(setup_, *pace), all, &failing, quiet_);
      note(whole);
      if (whole.keeps) return whole;
      if (failing.empty()) return std::nullopt;  // the window, of all columns together
      grow(failing);
      points_[key(*pace)] = whole;
    }
  }
  /// The point of a pace, by the columns that are looked at.
  const PlanPoint& at(double pace) {
    const double k = key(pace);
    const auto found = points_.find(k);
    if (found != points_.end()) return found->second;
    PlanPoint p = trials_.correct(at_pace(setup_, pace), which_, nullptr, quiet_);
    note(p);
    return points_.emplace(k, std::move(p)).first->second;
  }

 private:
  double key(double pace) const {
    const Setup s = at_pace(setup_, pace);
    return setup_.process.mode == ExposureMode::continuous ? s.process.speed_mm_h
                                                           : s.process.exposure_s;
  }
  void note(const PlanPoint& p) {
    tried_.push_back(p);
    // Nobody knows how many it takes: each takes a seventh of what is left.
    context_.report("plan", 1 - std::pow(6.0 / 7, static_cast<double>(tried_.size())));
    context_.check_cancelled();
  }
  /// Columns with the lowest gaps and features, and some of all others.
  std::vector<std::uint32_t> critical(int most) const {
    std::vector<std::uint32_t> all(columns_.columns().size());
    std::iota(all.begin(), all.end(), 0U);
    const auto limit = static_cast<std::size_t>(most);
    if (all.size() <= limit) return all;
    std::stable_sort(all.begin(), all.end(), [&](std::uint32_t a, std::uint32_t b) {
      return heights_.lowest_gap[a] != heights_.lowest_gap[b]
                 ? heights_.lowest_gap[a] < heights_.lowest_gap[b]
                 : heights_.lowest_feature[a] < heights_.lowest_feature[b];
    });
    std::vector<std::uint32_t> some(all.begin(), all.begin() + most / 2);
    const std::size_t rest = limit - some.size();
    for (std::size_t k = 0; k < rest; ++k) {
      some.push_back(all[some.size() + k * (all.size() - limit) / rest]);
    }
    std::sort(some.begin(), some.end());
    some.erase(std::unique(some.begin(), some.end()), some.end());
    return some;
  }
  void grow(std::vector<std::uint32_t> failing) {
    constexpr std::size_t kMost = 4096;
    if (failing.size() > kMost) {
      for (std::size_t k = 0; k < kMost; ++k) failing[k] = failing[k * failing.size() / kMost];
      failing.resize(kMost);
    }
    which_.insert(which_.end(), failing.begin(), failing.end());
    std::sort(which_.begin(), which_.end());
    which_.erase(std::unique(which_.begin(), which_.end()), which_.end());
    // What fails by some columns fails by more.
    std::erase_if(points_, [](const auto& p) { return p.second.keeps; });
  }

  const DesignColumns& columns_;
  const PartHeights& heights_;
  const Trials& trials_;
  Setup setup_;
  const ExecutionContext& context_;
  const ExecutionContext quiet_;
  std::vector<PlanPoint>& tried_;
  PaceRange gels_;
  std::vector<std::uint32_t> which_;
  std::map<double, PlanPoint> points_;
  std::optional<PlanLight> light_;
  double m_ = 1;
};

/// A bound that is none of the light's.
struct Bound {
  double most_mm_h = std::numeric_limits<double>::infinity();
  std::string word, words;
  void take(double mm_h, const std::string& its_word, const std::string& its_words) {
    if (!(mm_h < most_mm_h)) return;
    most_mm_h = mm_h;
    word = its_word;
    words = its_words;
  }
};

std::vector<PaceRange> paces_of(const std::vector<SpeedRange>& ranges) {
  std::vector<PaceRange> paces;
  paces.reserve(ranges.size());
  for (const SpeedRange& r : ranges) paces.push_back({r.least_mm_h, r.greatest_mm_h});
  return paces;
}

/// Why no speed keeps what is asked for.
[[noreturn]] void refuse(const PlanAsk& ask, const std::optional<PlanLight>& light,
                         const std::vector<PlanGap>& gaps, const Trials& trials,
                         const std::vector<PlanPoint>& tried, const Bound& bound) {
  const PlanGap* const gap = detail::limiting_gap(gaps);
  std::string text = "no speed prints this part as asked";
  const auto in_gap = [&](const PlanGap& g) {
    return fmt::format("the gap of {} at pixel {}, {}, slices {} to {} ({} pixels have such)",
                       trials.height_in_words(g.slices), g.place.x, g.place.y, g.place.first,
                       g.place.last, g.count);
  };
  if (light && gap && !gap->at_platform) {
    const BestGap best = best_gap(*light, gap->slices);
    if (best.contrast < ask.gap_contrast) {
      text += fmt::format(
          ": {} keeps a contrast of at most {}, at {:.5g} mm/h, where {:g} is asked for; expected "
          "at most that contrast, or gaps of at least {:g} um to be planned for",
          in_gap(*gap), at_most(best.contrast, 4), best.speed_mm_h, ask.gap_contrast,
          (gap->slices + 1) * light->layer_um);
      throw InfeasibleError(text);
    }
  }
  if (light && !tolerated_speeds(*light, ask.tolerance_um, ask.light_error)) {
    throw InfeasibleError(fmt::format(
        "{}: an error of {:g} % of the light moves edges by more than {:g} um at any speed, where "
        "{:g} um are allowed; expected a greater tolerance, or light that is known better",
        text, 100 * ask.light_error, light->lam_um * ask.light_error, ask.tolerance_um));
  }
  const auto ranges = light ? detail::closed_ranges(*light, gaps, ask) : std::vector<SpeedRange>{};
  if (!ranges.empty() && bound.most_mm_h < ranges.front().least_mm_h) {
    throw InfeasibleError(fmt::format(
        "{}: edges and gaps keep what is asked for from {} mm/h on, and {}; expected less light "
        "(the lamp free), a smaller contrast or a greater tolerance",
        text, at_least(ranges.front().least_mm_h), bound.words));
  }
  // What is lost counts most, then edges, then how dark gaps are.
  const auto misses = [](const PlanPoint& p) {
    return std::tuple(p.lost + p.split, p.off, -p.contrast, p.max_abs_um);
  };
  const PlanPoint* nearest = nullptr;
  for (const PlanPoint& p : tried) {
    if (p.prints && !p.keeps && (!nearest || misses(p) < misses(*nearest))) nearest = &p;
  }
  if (nearest) {
    text += fmt::format(": nearest is {}, where {}",
                        nearest->speed_mm_h > 0 ? fmt::format("{:g} mm/h", nearest->speed_mm_h)
                                                : fmt::format("{:g} s", nearest->exposure_s),
                        nearest->why);
    double contrast = 0, um = std::numeric_limits<double>::infinity();
    for (const PlanPoint& p : tried) {
      if (!p.prints || p.keeps || p.lost + p.split > 0) continue;
      if (p.off == 0) contrast = std::max(contrast, p.contrast);
      if (p.narrow == 0) um = std::min(um, p.max_abs_um);
    }
    if (contrast > 0 && contrast < ask.gap_contrast) {
      text += fmt::format("; expected a contrast of at most {}", at_most(contrast, 4));
    } else if (std::isfinite(um) && um > ask.tolerance_um) {
      text += fmt::format("; expected a tolerance of at least {} um", at_least(um, 4));
    } else {
      text += "; expected a smaller contrast, a greater tolerance or low gaps to be left out";
    }
  } else if (std::isfinite(bound.most_mm_h)) {
    text += fmt::format(": {}", bound.words);
  } else if (!tried.empty()) {
    text += ": " + tried.back().why;
  }
  throw InfeasibleError(text);
}

/// All settings that are to be tried besides the speed, what the setup says first.
struct Candidate {
  Setup setup;
  std::string words;  ///< empty: as it is
};
void add_aims(const Setup& setup, std::vector<Candidate>& all) {
  constexpr std::array<double, 4> aims_um{0.5, 0.2, 1, 2};
  for (const double aim_um : aims_um) {
    all.push_back({setup, fmt::format("edges aimed at to {:g} um", aim_um)});
    all.back().setup.process.edge_aim_um = aim_um;
  }
}
std::vector<Candidate> candidates(const Setup& setup, const PlanFree& free) {
  std::vector<Candidate> all{{setup, ""}};
  if (free.omega_max) {
    constexpr std::array<double, 4> caps{1e300, 1.5, 1.2, 1.05};
    for (const double cap : caps) {
      if (cap == setup.process.omega_max) continue;
      all.push_back({setup, cap >= 1e300 ? std::string("no cap of the dose")
                                         : fmt::format("dose inside features at most {:g}", cap)});
      all.back().setup.process.omega_max = cap;
    }
  }
  if (free.edge_aim) add_aims(setup, all);
  if (free.uv) {
    for (const double share : {0.9, 0.8, 0.7, 0.6, 0.5}) {
      const double uv = rounded_down(share * setup.process.uv.uv_mw_cm2, 4);
      all.push_back({setup, fmt::format("UV light of {:g} mW/cm²", uv)});
      all.back().setup.process.uv.uv_mw_cm2 = uv;
    }
  }
  return all;
}

/// What a print with these settings can do.
struct Found {
  PlanPoint at;
  Setup setup;
  std::string words;
  double lamp_share = 1;
  std::unique_ptr<Planner> planner;
  double most = 0;  ///< pace
};

/// The setup as columns alone see it.
Setup of_columns(Setup setup, std::vector<std::string>& notes) {
  if (!setup.printer.spread.none() || setup.resin.scatter_um2_per_um > 0) {
    setup.printer.spread = {};
    setup.resin.scatter_um2_per_um = 0;
    notes.emplace_back(
        "light spreads: each column is planned as if it stood alone; correct and verify say what "
        "spreading costs");
  }
  setup.process.slice_speed_mm_h.clear();
  return setup;
}

/// Slices that draw more than the vat bears go slower.
void hold_back(const SliceSource& target, PrintPlan& plan, const ExecutionContext& context) {
  Process& p = plan.setup.process;
  const auto limits = slice_speed_limits(target, plan.setup.printer, plan.setup.resin, p,
                                         plan.setup.gap_um, detail::silent(context));
  p.slice_speed_mm_h = plan.slice_speed_mm_h =
      speeds_within(limits, plan.at.speed_mm_h, plan.ask.stage.acceleration_mm_s2, plan.layer_um);
  const double uniform_s = plan.at.time_s * plan.at.speed_mm_h / plan.suction->speed_limit_mm_h;
  plan.at.time_s = light_on_s(p, 1, plan.layer_um, plan.layers + plan.at.extra_slices);
  plan.notes.push_back(fmt::format(
      "{} from slice to slice, for what the vat bears: {:.4g} s, where one speed for all, {} mm/h, takes "
      "{:.4g} s",
      speeds_in_words(p), plan.at.time_s, at_most(plan.suction->speed_limit_mm_h), uniform_s));
}

double pace_of(const PlanPoint& p) { return p.speed_mm_h > 0 ? p.speed_mm_h : 1 / p.exposure_s; }

}  // namespace

PrintPlan plan_print(const SliceSource& whole_target, const Setup& asked, const PlanAsk& ask,
                     const ExecutionContext& context) {
  check(whole_target, asked, ask);
  const SlicesAlone alone(whole_target);
  const SliceSource& target = asked.process.surface == Surface::mesh ? whole_target : alone;
  PrintPlan plan;
  plan.ask = ask;
  plan.mode = asked.process.mode;
  plan.layer_um = target.grid().layer_um;
  plan.layers = target.grid().layers;
  const bool continuous = plan.mode == ExposureMode::continuous;
  const Setup setup = of_columns(asked, plan.notes);
  plan.stage_mm_h = setup.printer.max_speed_mm_h;

  const DesignColumns columns(target, context);
  const Trials trials(target, columns, ask);
  PartHeights heights = detail::heights_of(columns, trials.least_gap_slices());
  plan.part_columns = columns.pixels();
  plan.distinct_columns = columns.columns().size();
  plan.features = heights.features;

  // Bounds that are not the light's.
  Bound bound;
  if (continuous) {
    if (plan.stage_mm_h > 0) {
      bound.take(plan.stage_mm_h, "stage",
                 fmt::format("the stage of '{}' does at most {} mm/h", setup.printer.name,
                             at_most(plan.stage_mm_h, 12)));
    }
    Setup fast = setup;
    fast.process.speed_mm_h = std::max(1.0, gelling(setup, plan.layer_um).greatest);
    if (judges_suction(fast)) {
      plan.suction = print_suction(target, fast.printer, fast.resin, fast.process, fast.gap_um,
                                   detail::silent(context));
    }
    if (plan.suction && plan.suction->limit_given && !ask.stage.variable_speed) {
      bound.take(rounded_down(plan.suction->speed_limit_mm_h, kPaceDigits), "suction",
                 suction_in_words(*plan.suction, plan.suction->speed_limit_mm_h));
    }
    if (ask.stage.variable_speed && !(plan.suction && plan.suction->limit_given)) {
      plan.notes.emplace_back(
          "speeds that change along z: doses are those of one speed, which the light limits; slices "
          "go slower only where the printer's suction_limit_pa and the resin's viscosity_pa_s ask for it");
    }
    if (!plan.suction) {
      plan.notes.emplace_back(
          "resin flow and the pull on the part are not counted: the resin file has no "
          "viscosity_pa_s");
    } else if (!plan.suction->limit_given) {
      plan.notes.push_back(
          fmt::format("the printer file has no suction_limit_pa; at 1 bar, where resin cavitates, "
                      "slice {} bears {:.5g} mm/h",
                      plan.suction->slice, plan.suction->speed_limit_mm_h));
    }
    plan.notes.emplace_back(
        "green strength, heat and the time that diffusion takes are not counted");
  }

  // The fastest of all settings.
  std::unique_ptr<Found> best;
  const PlanGap* gap = detail::limiting_gap(heights.gaps);
  std::optional<PlanLight> light;
  std::vector<Candidate> all = candidates(setup, ask.free);
  bool aims = ask.free.edge_aim || setup.process.edge_aim_um > 0, unasked = false;
  for (std::size_t i = 0;; ++i) {
    if (i == all.size() && !best && light && !aims) {
      // Closed forms know a speed, and levels that place edges so finely spoil it.
      aims = unasked = true;
      add_aims(setup, all);
    }
    // Nobody waits for the best of what was not asked for.
    if (i == all.size() || (unasked && best)) break;
    const Candidate c = all[i];
    auto found = std::make_unique<Found>();
    try {
      found->planner = std::make_unique<Planner>(target, columns, heights, trials, c.setup, ask,
                                                 context, plan.tried);
    } catch (const InfeasibleError&) {
      if (c.words.empty()) throw;
      plan.chosen.push_back(c.words + ": does not print");
      continue;
    }
    Planner& planner = *found->planner;
    if (c.words.empty()) light = planner.light();
    const PaceRange gels = planner.gels();
    std::vector<PaceRange> ranges{gels};
    double most = std::min(gels.greatest, continuous ? bound.most_mm_h : gels.greatest);
    if (light && planner.light()) {
      const auto closed = detail::closed_ranges(*planner.light(), heights.gaps, ask);
      // Slices whose edges have heights of their own have gaps between whole slices.
      const bool proven = !columns.has_heights();
      if (closed.empty() && proven) {
        if (c.words.empty()) refuse(ask, light, heights.gaps, trials, plan.tried, bound);
        continue;
      }
      if (!closed.empty()) ranges = paces_of(closed);
      const auto tolerated = tolerated_speeds(*planner.light(), ask.tolerance_um, ask.light_error);
      if (!tolerated) refuse(ask, light, heights.gaps, trials, plan.tried, bound);
      most = std::min(most, tolerated->greatest_mm_h);
    }
    std::optional<PlanPoint> point = planner.fastest(ranges, most);
    found->setup = c.setup;
    if (!point && continuous && ask.free.lamp && std::isfinite(bound.most_mm_h)) {
      // Less light at the speed of the bound does what more speed would do.
      point = planner.fastest(ranges, gels.greatest);
      if (point && point->speed_mm_h > bound.most_mm_h) {
        found->lamp_share = std::pow(bound.most_mm_h / point->speed_mm_h, 1 / planner.m());
      }
    }
    if (!point) {
      plan.chosen.push_back((c.words.empty() ? std::string("as it is") : c.words) +
                            ": no speed that was tried keeps what is asked for");
      continue;
    }
    found->at = *point;
    found->words = c.words;
    found->most = most;
    const bool faster = !best || pace_of(found->at) > pace_of(best->at) * detail::kPaceStep;
    if (!c.words.empty()) {
      plan.chosen.push_back(c.words + (continuous ? fmt::format(": {:g} mm/h", point->speed_mm_h)
                                                  : fmt::format(": {:g} s", point->exposure_s)));
    }
    if (faster) best = std::move(found);
  }
  if (!best) refuse(ask, light, heights.gaps, trials, plan.tried, bound);

  Planner& planner = *best->planner;
  plan.at = best->at;
  plan.lamp_share = best->lamp_share;
  plan.with = best->words;
  plan.light = planner.light();
  plan.setup = best->setup;
  plan.setup.printer = asked.printer;
  plan.setup.resin = asked.resin;
  (continuous ? plan.setup.process.speed_mm_h : plan.setup.process.exposure_s) =
      continuous ? plan.at.speed_mm_h : plan.at.exposure_s;
  const double pace = pace_of(plan.at);

  // What a little more speed does, and a tenth less.
  const double next = pace * detail::kPaceStep;
  if (continuous && plan.lamp_share < 1) {
    plan.limited_by = bound.word;
    plan.limit = bound.words;
    plan.at.speed_mm_h = plan.setup.process.speed_mm_h = bound.most_mm_h;
    plan.at.time_s *= best->at.speed_mm_h / bound.most_mm_h;
  } else if (next <= best->most) {
    plan.faster = planner.at(next);
    plan.limited_by = plan.faster->limited_by;
    plan.limit = plan.faster->why;
    plan.limit_place = plan.faster->place;
  } else if (continuous && bound.most_mm_h <= best->most * (1 + 1e-9)) {
    plan.limited_by = bound.word;
    plan.limit = bound.words;
  } else if (plan.light && ask.light_error > 0 &&
             next > plan.light->smax_mm_h /
                        (1 + plan.light->lam_um * ask.light_error / ask.tolerance_um)) {
    plan.limited_by = "tolerance";
    plan.limit = fmt::format(
        "an error of {:g} % of the light moves lower edges by {:g} um: full light is only {:.4g} "
        "times what gels",
        100 * ask.light_error, ask.tolerance_um, plan.light->full(pace));
  } else {
    plan.limited_by = "light";
    plan.limit = "full light just gels the resin";
  }
  plan.slower = planner.at(0.9 * pace);

  if (plan.light) {
    plan.ranges = detail::closed_ranges(*plan.light, heights.gaps, ask);
    for (PlanGap& g : heights.gaps) {
      if (g.left_out || g.beside_grey) continue;
      if (g.at_platform) {
        g.ranges = platform_gap_speeds(*plan.light, g.slices, ask.gap_contrast);
      } else {
        g.ranges = gap_speeds(*plan.light, g.slices, ask.gap_contrast);
        g.best = best_gap(*plan.light, g.slices);
      }
    }
    plan.steps = detail::next_steps(*plan.light, planner.m(), gap, ask,
                                    std::isfinite(bound.most_mm_h) ? bound.most_mm_h : 0);
  }
  plan.gaps = heights.gaps;

  // The curve: from the slowest speed that prints to a little beyond the fastest.
  if (ask.curve_points > 0) {
    const double low = std::max(planner.gels().least, 0.02 * pace),
                 high = std::min(planner.gels().greatest, 1.3 * pace);
    std::vector<double> paces{pace, next};
    for (int k = 0; k < ask.curve_points; ++k) {
      paces.push_back(low * std::pow(high / low, (k + 0.5) / ask.curve_points));
    }
    std::sort(paces.begin(), paces.end());
    for (const double p : paces) {
      if (p <= planner.gels().greatest) plan.curve.push_back(planner.at(p));
    }
  }
  if (ask.stage.variable_speed && plan.suction && plan.suction->limit_given &&
      plan.at.speed_mm_h > plan.suction->speed_limit_mm_h) {
    hold_back(target, plan, context);
  }
  plan.judged_columns = planner.judged();
  context.report("plan", 1);
  return plan;
}

}  // namespace slicecorr
