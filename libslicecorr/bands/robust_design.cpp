// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/robust_design.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include "bands/light_plan.hpp"
#include "bands/pixels_of_levels.hpp"
#include "bands/robust_edges.hpp"
#include "bands/robust_watch.hpp"
#include "bands/uncertain_walk.hpp"
#include "correct/coverage.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// How often a column is corrected at most.
constexpr int kPasses = 500;
/// Columns that are corrected again and again at once: their slices are not coded meanwhile.
constexpr std::size_t kTogether = 1024;

/// A design of columns that are moved: coverage and edge heights, slice by slice.
class MovedColumns {
 public:
  /// `read`: writes a row of the design's coverage for these columns.
  using ReadRow = std::function<void(int slice, std::uint8_t* out)>;
  MovedColumns(const std::vector<const MovedEdges*>& columns, ReadRow read)
      : columns_(columns), next_(columns.size(), 0), read_(std::move(read)) {}
  /// Slices rise.
  void row(int slice, std::uint8_t* coverage, std::uint8_t* heights) {
    read_(slice, coverage);
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const MovedEdges& c = *columns_[i];
      std::size_t& k = next_[i];
      heights[i] = 0;
      while (k < c.size() && c[k].at_node <= slice) {
        heights[i] = c[k].at_node == slice ? c[k].at_height : std::uint8_t{0};
        ++k;
      }
      const std::uint8_t cover = k > 0 ? c[k - 1].below : std::uint8_t{0};
      if (cover_kind(cover) != CoverKind::grey) coverage[i] = cover;
    }
  }

 private:
  const std::vector<const MovedEdges*>& columns_;
  std::vector<std::size_t> next_;
  ReadRow read_;
};

/// Columns that are corrected together.
struct Solved {
  std::size_t columns = 0;
  bool leaves_alone = false;
  std::optional<BandDoses> doses;  ///< that are wanted
};

/// Corrects columns; gives levels from the last slice to the first. `rows`: see MovedColumns; also writes
/// what is left alone, if anything is.
template <typename Rows, typename Sink>
void solve(const CorrectionPlan& plan, const Solved& what, Rows rows, Sink sink,
           const ExecutionContext& context) {
  const std::size_t columns = what.columns;
  const bool leaves_alone = what.leaves_alone;
  BandCorrector corrector = what.doses ? BandCorrector(plan, columns, *what.doses)
                                       : BandCorrector(plan, columns, leaves_alone);
  std::vector<std::uint8_t> coverage(columns), heights(columns), left(columns);
  for (int n = 0; n < plan.layers; ++n) {
    if ((n & 63) == 0) context.check_cancelled();
    rows(n, coverage.data(), heights.data(), left.data());
    corrector.add_layer(coverage.data(), heights.data(), leaves_alone ? left.data() : nullptr);
  }
  corrector.solve([&](int n, const std::uint8_t* levels, const std::uint8_t*, bool dark) {
    sink(n, dark ? nullptr : levels);
  });
}

/// All slices that are shown are layers: edges may lie beyond the design's last one.
CorrectionPlan of_all_slices(const CorrectionPlan& plan) {
  CorrectionPlan all = plan;
  all.layers = all.all_layers;
  if (plan.model.is_continuous() || plan.layers == plan.all_layers) return all;
  all = CorrectionPlan(plan.model, plan.process, plan.all_layers, plan.all_layers);
  all.most_exchange = plan.most_exchange;
  return all;
}

/// The levels of a column, the first slice first, and what fails with them.
struct ColumnLight {
  std::vector<std::uint8_t> levels;  ///< empty: those of its edges
  std::vector<RobustTrouble> troubles;
};

/// The columns of a band that are in trouble, and how their edges are moved, or their light is chosen.
class RobustBand {
 public:
  RobustBand(const CorrectionPlan& plan, const RobustAsk& ask, const CodedDesign& design,
             const ExecutionContext& context)
      : plan_(of_all_slices(plan)),
        ask_(ask),
        design_(design),
        context_(context),
        pixels_(plan.levels.size()),
        mover_(plan_.model),
        left_rows_(design.left_alone) {
    // Errors of a fit go together in all directions. Light that doses want is light that no plan knows.
    if (!ask.doses && !ask.uncertainty.from_fit && LightPlan::can_plan(plan_.model)) {
      light_.emplace(plan_, ask.cases.weak, ask.cases.strong);
    }
  }

  RobustLevels run();

 private:
  /// What is left alone; 0: corrected.
  void read_left_alone(int n, std::uint8_t* left) {
    const std::uint8_t* const row = left_rows_.at(n);
    if (row) return static_cast<void>(std::copy_n(row, design_.coverage.columns(), left));
    std::fill_n(left, design_.coverage.columns(), std::uint8_t{0});
  }
  /// Of what is left alone a grey that asks nothing.
  void read_coverage(int n, std::uint8_t* coverage) {
    design_.coverage.read(n, coverage);
    const std::uint8_t* const left = left_rows_.at(n);
    for (std::size_t i = 0; left && i < design_.coverage.columns(); ++i) {
      if (left[i] != 0) coverage[i] = kLeftAlone;
    }
  }
  void read_design(int n, std::uint8_t* coverage, std::uint8_t* heights) {
    read_coverage(n, coverage);
    if (const std::uint8_t* at = design_.heights_at(n, heights); at == nullptr) {
      std::fill_n(heights, design_.coverage.columns(), std::uint8_t{0});
    }
  }
  /// Some columns of the band, or all of them.
  Solved solved(std::vector<std::size_t> which) const;
  /// Levels of the last slices first, and what fails with them.
  template <typename Rows, typename Cover, typename Keep>
  std::vector<RobustTrouble> try_columns(const Solved& what, Rows rows, Cover cover,
                                         Keep keep) const;
  void load(const std::vector<std::size_t>& which, std::vector<MovedEdges>& columns);
  /// Finds aims for some columns of the band.
  std::vector<ColumnLight> repair(const std::vector<std::size_t>& which,
                                  std::vector<MovedEdges>& columns, RobustFigures& counts);
  /// Plans the light of those in which something still fails; empty where nothing is gained.
  std::vector<ColumnLight> plan_light(const std::vector<std::size_t>& which,
                                      const std::vector<AimSearch>& searches);

  const CorrectionPlan plan_;
  const RobustAsk ask_;
  const CodedDesign& design_;
  const ExecutionContext& context_;
  const PixelsOfLevels pixels_;
  const EdgeMover mover_;
  std::optional<LightPlan> light_;  ///< nothing: light is not planned
  LeftAloneRows left_rows_;
};

Solved RobustBand::solved(std::vector<std::size_t> which) const {
  Solved what{which.size(), design_.left_alone != nullptr, std::nullopt};
  if (!ask_.doses) return what;
  const CodedBand* const bytes = ask_.doses->bytes;
  // After the last layer there is nothing of the part: an edge that was moved there asks for what just gels.
  what.doses = BandDoses{
      &ask_.doses->doses->scale,
      [bytes, which = std::move(which), row = std::vector<std::uint8_t>(bytes->columns())](
          int n, std::uint8_t* out) mutable {
        if (n >= bytes->slices())
          return static_cast<void>(std::fill_n(out, which.size(), std::uint8_t{0}));
        bytes->read(n, row.data());
        for (std::size_t i = 0; i < which.size(); ++i) out[i] = row[which[i]];
      }};
  return what;
}

template <typename Rows, typename Cover, typename Keep>
std::vector<RobustTrouble> RobustBand::try_columns(const Solved& what, Rows rows, Cover cover,
                                                   Keep keep) const {
  const std::size_t columns = what.columns;
  RobustWatch watch(plan_, ask_, columns);
  std::vector<std::uint8_t> shown(columns), coverage(columns);
  solve(
      plan_, what, rows,
      [&](int n, const std::uint8_t* levels) {
        keep(levels);
        for (std::size_t i = 0; i < columns; ++i)
          shown[i] = pixels_(levels ? levels[i] : std::uint8_t{0});
        cover(n, coverage.data());
        watch.add_slice(n, shown.data(), coverage.data());
      },
      context_);
  return watch.finish();
}

/// The boundaries of some columns of the design.
void RobustBand::load(const std::vector<std::size_t>& which, std::vector<MovedEdges>& columns) {
  const std::size_t all = design_.coverage.columns();
  std::vector<std::uint8_t> coverage(all), heights(all), before(which.size(), 0);
  columns.assign(which.size(), {});
  for (int n = 0; n < plan_.all_layers; ++n) {
    read_design(n, coverage.data(), heights.data());
    for (std::size_t i = 0; i < which.size(); ++i) {
      const std::uint8_t now = coverage[which[i]];
      const CoverKind kind = cover_kind(now), last = cover_kind(before[i]);
      before[i] = now;
      if (n > 0 && kind == last) continue;
      MovedEdge b;
      b.node = b.at_node = n;
      b.height = b.at_height = n > 0 ? heights[which[i]] : std::uint8_t{0};
      b.below = kind == CoverKind::grey ? std::uint8_t{1} : now;
      b.movable = n > 0 && kind != CoverKind::grey && last != CoverKind::grey;
      b.upper = kind == CoverKind::run;
      columns[i].push_back(b);
    }
  }
}

std::vector<ColumnLight> RobustBand::plan_light(const std::vector<std::size_t>& which,
                                                const std::vector<AimSearch>& searches) {
  std::vector<ColumnLight> lights(which.size());
  std::vector<std::size_t> failing;
  for (std::size_t i = 0; i < which.size(); ++i) {
    if (!searches[i].troubles().empty()) failing.push_back(i);
  }
  // What is left alone is lit as it is.
  if (!light_ || design_.left_alone || failing.empty()) return lights;
  const auto slices = static_cast<std::size_t>(plan_.all_layers);
  std::vector<std::vector<std::uint8_t>> designs(failing.size(), std::vector<std::uint8_t>(slices));
  std::vector<std::uint8_t> row(design_.coverage.columns());
  for (std::size_t n = 0; n < slices; ++n) {
    read_coverage(static_cast<int>(n), row.data());
    for (std::size_t k = 0; k < failing.size(); ++k) designs[k][n] = row[which[failing[k]]];
  }
  // Many columns of a part are alike.
  std::map<std::vector<std::uint8_t>, std::vector<std::uint8_t>> planned;
  std::vector<const std::vector<std::uint8_t>*> levels;
  levels.reserve(failing.size());
  for (const auto& design : designs) {
    context_.check_cancelled();
    std::vector<std::uint8_t>& its_levels = planned[design];
    if (its_levels.empty()) its_levels = light_->levels(design);
    levels.push_back(&its_levels);
  }
  RobustWatch watch(plan_, ask_, failing.size());
  std::vector<std::uint8_t> shown(failing.size()), coverage(failing.size());
  for (std::size_t n = slices; n-- > 0;) {
    for (std::size_t k = 0; k < failing.size(); ++k) {
      shown[k] = pixels_((*levels[k])[n]);
      coverage[k] = designs[k][n];
    }
    watch.add_slice(static_cast<int>(n), shown.data(), coverage.data());
  }
  std::vector<std::vector<RobustTrouble>> of(failing.size());
  for (const RobustTrouble& t : watch.finish()) of[t.column].push_back(t);
  for (std::size_t k = 0; k < failing.size(); ++k) {
    const RobustScore planned_score(of[k]), moved_score(searches[failing[k]].troubles());
    // Edges that are moved keep closer to the design: as many failures are no reason to plan.
    if (planned_score.count() < moved_score.count()) {
      lights[failing[k]] = {*levels[k], std::move(of[k])};
    }
  }
  return lights;
}

std::vector<ColumnLight> RobustBand::repair(const std::vector<std::size_t>& which,
                                            std::vector<MovedEdges>& columns,
                                            RobustFigures& counts) {
  load(which, columns);
  const std::size_t all = design_.coverage.columns();
  std::vector<AimSearch> searches;
  searches.reserve(which.size());
  for (MovedEdges& c : columns) {
    searches.emplace_back(mover_, !light_ || design_.left_alone, std::move(c));
  }
  std::vector<std::size_t> active(which.size());
  for (std::size_t i = 0; i < which.size(); ++i) active[i] = i;
  std::vector<std::uint8_t> whole(all);
  for (int pass = 0; pass <= kPasses && !active.empty(); ++pass) {
    std::vector<const MovedEdges*> moved;
    moved.reserve(active.size());
    for (const std::size_t i : active) moved.push_back(&searches[i].tried());
    const auto design_row = [&](int n, std::uint8_t* out) {
      read_coverage(n, whole.data());
      for (std::size_t k = 0; k < active.size(); ++k) out[k] = whole[which[active[k]]];
    };
    MovedColumns rows(moved, design_row);
    std::vector<std::size_t> of_band;
    of_band.reserve(active.size());
    for (const std::size_t i : active) of_band.push_back(which[i]);
    const std::vector<RobustTrouble> troubles = try_columns(
        solved(of_band),
        [&](int n, std::uint8_t* coverage, std::uint8_t* heights, std::uint8_t* left) {
          rows.row(n, coverage, heights);
          read_left_alone(n, whole.data());
          for (std::size_t k = 0; k < active.size(); ++k) left[k] = whole[which[active[k]]];
        },
        design_row, [](const std::uint8_t*) {});
    std::vector<std::vector<RobustTrouble>> of(active.size());
    for (const RobustTrouble& t : troubles) of[t.column].push_back(t);
    std::vector<std::size_t> left;
    for (std::size_t k = 0; k < active.size(); ++k) {
      if (searches[active[k]].go_on(of[k])) left.push_back(active[k]);
    }
    active = std::move(left);
  }
  std::vector<ColumnLight> lights = plan_light(which, searches);
  for (std::size_t i = 0; i < which.size(); ++i) {
    const bool planned = !lights[i].levels.empty();
    for (const RobustTrouble& t : planned ? lights[i].troubles : searches[i].troubles()) {
      ++(t.gap ? counts.filled : counts.lost);
    }
    columns[i] = searches[i].best();
    for (const MovedEdge& b : columns[i]) {
      counts.moved_edges += planned ? b.movable : b.moved();
    }
  }
  return lights;
}

RobustLevels RobustBand::run() {
  const std::size_t all = design_.coverage.columns();
  CodedBand plain(all);
  std::vector<std::uint8_t> room(all);
  std::vector<std::size_t> every(all);
  std::iota(every.begin(), every.end(), std::size_t{0});
  const std::vector<RobustTrouble> troubles = try_columns(
      solved(every),
      [&](int n, std::uint8_t* coverage, std::uint8_t* heights, std::uint8_t* left) {
        read_design(n, coverage, heights);
        read_left_alone(n, left);
      },
      [&](int n, std::uint8_t* out) { read_coverage(n, out); },
      [&](const std::uint8_t* levels) { plain.append(levels); });
  RobustFigures own;
  std::vector<std::size_t> which;
  for (const RobustTrouble& t : troubles) {
    ++(t.gap ? own.gaps : own.features);
    which.push_back(t.column);
  }
  std::sort(which.begin(), which.end());
  which.erase(std::unique(which.begin(), which.end()), which.end());
  if (which.empty()) return {plain, plain, own};
  // Only these columns change: their levels are put in place of the plain ones.
  std::vector<CodedBand> repaired;
  std::vector<std::vector<std::size_t>> parts;
  for (std::size_t from = 0; from < which.size(); from += kTogether) {
    const std::size_t to = std::min(which.size(), from + kTogether);
    parts.emplace_back(which.begin() + static_cast<std::ptrdiff_t>(from),
                       which.begin() + static_cast<std::ptrdiff_t>(to));
    const std::vector<std::size_t>& part = parts.back();
    std::vector<MovedEdges> columns;
    const std::vector<ColumnLight> lights = repair(part, columns, own);
    std::vector<const MovedEdges*> moved;
    moved.reserve(columns.size());
    for (const MovedEdges& c : columns) moved.push_back(&c);
    MovedColumns rows(moved, [&](int n, std::uint8_t* out) {
      read_coverage(n, room.data());
      for (std::size_t k = 0; k < part.size(); ++k) out[k] = room[part[k]];
    });
    CodedBand& levels = repaired.emplace_back(part.size());
    std::vector<std::uint8_t> its_row(part.size());
    solve(
        plan_, solved(part),
        [&](int n, std::uint8_t* coverage, std::uint8_t* heights, std::uint8_t* left) {
          rows.row(n, coverage, heights);
          read_left_alone(n, room.data());
          for (std::size_t k = 0; k < part.size(); ++k) left[k] = room[part[k]];
        },
        [&](int n, const std::uint8_t* its_levels) {
          if (!its_levels) {
            std::fill(its_row.begin(), its_row.end(), std::uint8_t{0});
          } else {
            std::copy_n(its_levels, part.size(), its_row.begin());
          }
          for (std::size_t k = 0; k < part.size(); ++k) {
            if (!lights[k].levels.empty()) {
              its_row[k] = lights[k].levels[static_cast<std::size_t>(n)];
            }
          }
          levels.append(its_row.data());
        },
        context_);
  }
  CodedBand out(all);
  std::vector<std::uint8_t> row(all), some(kTogether);
  for (int k = 0; k < plan_.all_layers; ++k) {
    plain.read(k, row.data());
    for (std::size_t p = 0; p < parts.size(); ++p) {
      repaired[p].read(k, some.data());
      for (std::size_t i = 0; i < parts[p].size(); ++i) row[parts[p][i]] = some[i];
    }
    out.append(row.data());
  }
  return {std::move(out), std::move(plain), own};
}

}  // namespace

CureModel case_model(const CureModel& model, const Uncertainty& u, bool weak) {
  const double sign = weak ? -1.0 : 1.0;
  const auto more = [&](UncertainInput input) { return std::exp(sign * u.sd(input)); };
  const auto less = [&](UncertainInput input) { return std::exp(-sign * u.sd(input)); };
  CureModel off = model;
  const double ha = more(UncertainInput::ha);
  off.eta = model.eta / ha;
  off.a = std::exp(-off.eta * units::kLn10);
  off.one_minus_a = -std::expm1(-off.eta * units::kLn10);
  off.root_a = std::exp(-0.5 * off.eta * units::kLn10);
  // The areal dose is what stays: phi grows with ha.
  const double dose =
      ha / (less(UncertainInput::dc) * less(UncertainInput::aim) * less(UncertainInput::speed));
  const double light = more(UncertainInput::light) * std::exp(sign * u.flat);
  const double stray = sign * u.sd(UncertainInput::stray) / model.critical_intensity_mw_cm2;
  for (double& phi : off.level_phi) {
    const double intensity = std::pow(phi, 1.0 / model.m) * light + stray;
    phi = dose * std::pow(std::max(0.0, intensity), model.m);
  }
  return off;
}

namespace {

/// The same of any model, by what it is made of.
CureModel case_of_place(const PlaceModels& models, std::uint8_t value, const Uncertainty& u,
                        bool weak) {
  const CureModel& said = models.model(value);
  if (said.is_plain() && !pulses_differ(models, u)) return case_model(said, u, weak);
  const double sign = weak ? -1.0 : 1.0;
  const auto more = [&](UncertainInput input) { return std::exp(sign * u.sd(input)); };
  Resin resin = with_height_times(models.resin(), more(UncertainInput::ha));
  const double dose = 1 / (more(UncertainInput::dc) * more(UncertainInput::aim));
  for (double* const d : {&resin.critical_dose_mj_cm3, &resin.critical_dose_prime,
                          &resin.gel_a_mj_cm2, &resin.gel_b_sqrt_mw_cm2_s}) {
    *d *= dose;
  }
  if (resin.inhibition) resin.inhibition->critical_dose_prime *= dose;
  const double brighter = more(UncertainInput::light) * std::exp(sign * u.flat);
  Process process =
      with_pattern_held(with_known_uv(models, value), models.resin(), resin, brighter);
  const double slower = 1 / more(UncertainInput::speed);
  process.speed_mm_h *= slower;
  for (double& mm_h : process.slice_speed_mm_h) mm_h *= slower;
  const double longer = more(UncertainInput::time);
  process.exposure_s *= longer;
  process.bottom_exposure_s *= longer;
  for (double& s : process.layer_exposure_s) s *= longer;
  if (process.lift_exchange >= 0) {
    process.lift_exchange =
        std::clamp(process.lift_exchange - sign * u.sd(UncertainInput::exchange), 0.0, 1.0);
  }
  Printer printer = dimmed(models.printer_at(value), brighter);
  for (CalibrationPoint& point : printer.calibration) {
    point.intensity_mw_cm2 =
        std::max(0.0, point.intensity_mw_cm2 + sign * u.sd(UncertainInput::stray));
  }
  return make_cure_model(printer, resin, process, said.layer_um);
}

}  // namespace

RobustCases::RobustCases(const PlaceModels& models, std::uint8_t value, const Uncertainty& u) {
  if (u.from_fit) {
    nearby = nearby_of_place(models, value, u);
    return;
  }
  weak = case_of_place(models, value, u, true);
  strong = case_of_place(models, value, u, false);
}

RobustCases::RobustCases(const CureModel& plain, const Uncertainty& u)
    : weak(case_model(plain, u, true)), strong(case_model(plain, u, false)) {}

void check_cases(const CureModel& model, const RobustCases& cases, const Uncertainty& u) {
  if (u.from_fit || model.mode == ExposureMode::layerwise) return;
  const CureModel &weak = cases.weak, &strong = cases.strong;
  if (weak.steady(weak.phi_max()) <= 1) {
    throw InfeasibleError(fmt::format(
        "with {} off to the weak side full light comes to {:.4g} of the dose to aim at and never gels "
        "the resin; a speed below {:.4g} of this one would do, or inputs that are surer",
        u.text, weak.steady(weak.phi_max()), weak.steady(weak.phi_max())));
  }
  if (strong.phi_min() >= 1) {
    throw InfeasibleError(fmt::format(
        "with {} off to the strong side black comes to {:.4g} of the dose to aim at and gels the "
        "resin; a speed above {:.4g} of this one would do, or inputs that are surer",
        u.text, strong.phi_min(), strong.phi_min()));
  }
}

int robust_slices(const CureModel& model) {
  // Layer by layer each layer has its own light.
  if (model.mode == ExposureMode::layerwise) return 0;
  const double most = EdgeMover::most_aim(model), p1 = model.phi_max();
  // The edge lies further down, and the burst after it begins there.
  const double slices = std::log((p1 - 1) / (p1 - most)) / (model.eta * units::kLn10);
  return static_cast<int>(std::ceil(slices)) + 1;
}

RobustLevels robust_levels(const CorrectionPlan& plan, const RobustAsk& ask,
                           const CodedDesign& design, const ExecutionContext& context) {
  return RobustBand(plan, ask, design, context).run();
}

}  // namespace slicecorr::detail
