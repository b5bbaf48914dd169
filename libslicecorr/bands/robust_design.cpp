// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/robust_design.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include "bands/pixels_of_levels.hpp"
#include "bands/robust_edges.hpp"
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

/// 95 % of all draws of so many inputs lie in an ellipsoid of so many standard deviations: roots of
/// the quantiles of chi².
double chi_of(std::size_t inputs) {
  constexpr std::array<double, 8> chi = {1.960, 2.448, 2.796, 3.080, 3.327, 3.548, 3.751, 3.938};
  return chi[std::clamp<std::size_t>(inputs, 1, chi.size()) - 1];
}

/// Doses of a band in both cases, at the nodes of each layer.
class CaseDoses {
 public:
  CaseDoses(const CureModel& model, const RobustAsk& ask, std::size_t columns)
      : variance_(ask.uncertainty, model.m, light_acts(model, ask.cases.nearby.get())),
        chi_(chi_of(ask.uncertainty.inputs.size())) {
    if (ask.uncertainty.from_fit) {
      derivatives_ = std::make_unique<BandDerivatives>(model, columns, variance_.wanted(),
                                                       ask.cases.nearby.get());
      for (auto* dose : {&weak_[0], &weak_[1], &strong_[0], &strong_[1]})
        dose->assign(columns, 0.0);
      return;
    }
    weak_dose_ = std::make_unique<BandDose>(ask.cases.weak, columns);
    strong_dose_ = std::make_unique<BandDose>(ask.cases.strong, columns);
  }
  CaseDoses(const CaseDoses&) = delete;
  CaseDoses& operator=(const CaseDoses&) = delete;

  void add_slice(int slice, const std::uint8_t* pixels) {
    if (!derivatives_) {
      weak_dose_->add_slice(slice, pixels);
      strong_dose_->add_slice(slice, pixels);
      return;
    }
    derivatives_->add_slice(slice, pixels);
    const bool jumps = derivatives_->model().mode == ExposureMode::layerwise;
    for (auto* dose : {&weak_, &strong_}) std::swap((*dose)[0], (*dose)[1]);
    for (std::size_t at = jumps ? 0 : 1; at < 2; ++at) {
      for (std::size_t i = 0; i < weak_[at].size(); ++i) {
        const DoseGradient g = derivatives_->at(i, static_cast<double>(at));
        const double share = g.dose > 0 ? std::exp(chi_ * variance_.sd_ln(g)) : 1.0;
        weak_[at][i] = g.dose / share;
        strong_[at][i] = g.dose * share;
      }
    }
  }
  const double* weak_lower() const { return weak_dose_ ? weak_dose_->lower() : weak_[0].data(); }
  const double* weak_upper() const { return weak_dose_ ? weak_dose_->upper() : weak_[1].data(); }
  const double* strong_lower() const {
    return strong_dose_ ? strong_dose_->lower() : strong_[0].data();
  }
  const double* strong_upper() const {
    return strong_dose_ ? strong_dose_->upper() : strong_[1].data();
  }

 private:
  const DoseVariance variance_;
  const double chi_;
  std::unique_ptr<BandDose> weak_dose_, strong_dose_;
  std::unique_ptr<BandDerivatives> derivatives_;
  std::array<std::vector<double>, 2> weak_, strong_;
};

/// Finds what fails in the cases, and with inputs as said, slices from the last to the first.
class Watch {
 public:
  Watch(const CorrectionPlan& plan, const RobustAsk& ask, std::size_t columns)
      : merged_(plan.merge_one_slice_gaps),
        doses_(plan.model, ask, columns),
        as_said_(plan.model, columns),
        columns_(columns) {
    for (Column& c : columns_) c.bottom = plan.all_layers;
  }
  void add_slice(int slice, const std::uint8_t* pixels, const std::uint8_t* coverage) {
    doses_.add_slice(slice, pixels);
    as_said_.add_slice(slice, pixels);
    const double* const said[2] = {as_said_.lower(), as_said_.upper()};
    const double* const weak[2] = {doses_.weak_lower(), doses_.weak_upper()};
    const double* const strong[2] = {doses_.strong_lower(), doses_.strong_upper()};
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      Column& c = columns_[i];
      const CoverKind kind = cover_kind(coverage[i]);
      if (kind != c.kind) {
        close(i, slice + 1);
        c.run_below = kind == CoverKind::gap && c.kind == CoverKind::run;
        c.kind = kind;
        c.bottom = slice + 1;
        c.extreme = c.as_said =
            kind == CoverKind::run ? 0.0 : std::numeric_limits<double>::infinity();
      }
      if (kind == CoverKind::run) {
        c.extreme = std::max({c.extreme, weak[0][i], weak[1][i]});
        c.as_said = std::max({c.as_said, said[0][i], said[1][i]});
      }
      if (kind == CoverKind::gap) {
        c.extreme = std::min({c.extreme, strong[0][i], strong[1][i]});
        c.as_said = std::min({c.as_said, said[0][i], said[1][i]});
      }
    }
  }
  std::vector<RobustTrouble> finish() {
    for (std::size_t i = 0; i < columns_.size(); ++i) close(i, 0);
    return std::move(troubles_);
  }

 private:
  struct Column {
    CoverKind kind = CoverKind::gap;
    bool run_below = false;
    int bottom = 0;
    double extreme = std::numeric_limits<double>::infinity();
    double as_said = std::numeric_limits<double>::infinity();
  };
  void close(std::size_t i, int top) {
    const Column& c = columns_[i];
    const double miss = std::abs(std::log(std::max(c.extreme, 1e-9)));
    if (c.kind == CoverKind::run && c.extreme < 1) {
      troubles_.push_back({i, false, top, c.bottom, miss, c.as_said < 1});
    }
    const bool meant = merged_ && c.bottom - top == 1;
    if (c.kind == CoverKind::gap && c.run_below && c.extreme >= 1 && !meant) {
      troubles_.push_back({i, true, top, c.bottom, miss, c.as_said >= 1});
    }
  }
  const bool merged_;  ///< gaps of one slice are to fill
  CaseDoses doses_;
  BandDose as_said_;
  std::vector<Column> columns_;
  std::vector<RobustTrouble> troubles_;
};

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

/// The columns of a band that are in trouble, and how their edges are moved.
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
    // Errors of a fit go together in all directions; a cap leaves the peaks of features to the levels.
    // Light that doses want is light that no closed form knows.
    if (ask.doses || ask.uncertainty.from_fit || plan.process.omega_max < kNoCap ||
        plan.merge_one_slice_gaps || !plan.model.is_plain()) {
      return;
    }
    const auto light = [](const CureModel& m) {
      return EdgeCases::Light{m.phi_min(), m.phi_max(), m.eta * units::kLn10};
    };
    plan_cases_ = EdgeCases{light(plan.model), light(ask.cases.weak), light(ask.cases.strong),
                            plan.all_layers};
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
  void repair(const std::vector<std::size_t>& which, std::vector<MovedEdges>& columns,
              RobustFigures& counts);

  const CorrectionPlan plan_;
  const RobustAsk ask_;
  const CodedDesign& design_;
  const ExecutionContext& context_;
  const PixelsOfLevels pixels_;
  const EdgeMover mover_;
  std::optional<EdgeCases> plan_cases_;  ///< nothing: edges are not planned
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
  Watch watch(plan_, ask_, columns);
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

void RobustBand::repair(const std::vector<std::size_t>& which, std::vector<MovedEdges>& columns,
                        RobustFigures& counts) {
  load(which, columns);
  const std::size_t all = design_.coverage.columns();
  std::vector<AimSearch> searches;
  searches.reserve(which.size());
  for (MovedEdges& c : columns) {
    searches.emplace_back(mover_, plan_cases_ ? &*plan_cases_ : nullptr, std::move(c));
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
  for (std::size_t i = 0; i < which.size(); ++i) {
    for (const RobustTrouble& t : searches[i].troubles()) ++(t.gap ? counts.filled : counts.lost);
    columns[i] = searches[i].best();
    for (const MovedEdge& b : columns[i]) counts.moved_edges += b.moved();
  }
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
    repair(part, columns, own);
    std::vector<const MovedEdges*> moved;
    moved.reserve(columns.size());
    for (const MovedEdges& c : columns) moved.push_back(&c);
    MovedColumns rows(moved, [&](int n, std::uint8_t* out) {
      read_coverage(n, room.data());
      for (std::size_t k = 0; k < part.size(); ++k) out[k] = room[part[k]];
    });
    CodedBand& levels = repaired.emplace_back(part.size());
    solve(
        plan_, solved(part),
        [&](int n, std::uint8_t* coverage, std::uint8_t* heights, std::uint8_t* left) {
          rows.row(n, coverage, heights);
          read_left_alone(n, room.data());
          for (std::size_t k = 0; k < part.size(); ++k) left[k] = room[part[k]];
        },
        [&](int, const std::uint8_t* its_levels) { levels.append(its_levels); }, context_);
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
