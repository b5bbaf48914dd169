// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "base/kernels.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/target.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

/// Doses more of their standard deviations away from 1 are on one side of it: a share of 3e-6.
constexpr double kFarSds = 4.5;
/// Doses more of them away are on one side of 1 in all prints that are looked at.
constexpr double kClearSds = 2.0;
/// Weak, nominal and strong print, in this order.
constexpr std::array<double, 3> kSds = {-kSdsOf95, 0.0, kSdsOf95};
constexpr std::size_t kPrints = 3;

/// What the dose at a point says without a look: prints differ, all print, or none does; `far`: by
/// kFarSds.
enum Clear : std::uint8_t { near = 0, prints = 1, open = 2, side = 3, far = 4 };
enum Class : std::uint8_t { gap = 0, run = 1, grey = 2 };

Class class_of(std::uint8_t coverage) {
  return coverage == 0 ? Class::gap : coverage == 255 ? Class::run : Class::grey;
}

/// Where a dose is so far from 1 that its standard deviation does not matter: sd(ln Omega) times a
/// number is less than |ln Omega|, of which Omega - 1 (above) and Omega (1 - Omega) (below) bound
/// Omega |ln Omega| from below. `q`: the variance of Omega.
SLICECORR_CLONES
void find_clear(const double* __restrict dose, const double* __restrict q,
                std::uint8_t* __restrict clear, std::size_t n) {
  constexpr std::size_t block = 64;
  constexpr double near_reach = kClearSds * kClearSds, far_reach = kFarSds * kFarSds;
  for (std::size_t b = 0; b < n; b += block) {
    const std::size_t size = std::min(block, n - b);
    // One comparison a loop, all as wide as the doses: loops that compilers do in vectors.
    double square[block], code[block];
    for (std::size_t i = 0; i < size; ++i) {
      const double excess = dose[b + i] - 1.0, below = -dose[b + i] * excess;
      const double away = excess > below ? excess : below;
      square[i] = away * away;
    }
    for (std::size_t i = 0; i < size; ++i) code[i] = dose[b + i] > 1.0 ? 1.0 : 2.0;
    for (std::size_t i = 0; i < size; ++i) {
      code[i] = square[i] >= near_reach * q[b + i] ? code[i] : 0.0;
    }
    for (std::size_t i = 0; i < size; ++i) {
      code[i] += square[i] >= far_reach * q[b + i] ? 4.0 : 0.0;
    }
    static_assert(Clear::prints == 1 && Clear::open == 2 && Clear::far == 4);
    for (std::size_t i = 0; i < size; ++i) {
      clear[b + i] = static_cast<std::uint8_t>(static_cast<std::int32_t>(code[i]));
    }
  }
}

SLICECORR_CLONES
void add_product(const double* __restrict x, const double* __restrict y, double factor,
                 double* __restrict q, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) q[i] += factor * x[i] * y[i];
}
SLICECORR_CLONES
void first_terms(const double* __restrict dose, const double* __restrict ln_ha, double dd,
                 double dh, double hh, double* __restrict q, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) {
    q[i] = dd * dose[i] * dose[i] + dh * dose[i] * ln_ha[i] + hh * ln_ha[i] * ln_ha[i];
  }
}
SLICECORR_CLONES
void add_variance(const double* __restrict variance, double factor, double* __restrict q,
                  std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) q[i] += factor * variance[i];
}

double normal_below(double sds) { return 0.5 * std::erfc(-sds / std::sqrt(2.0)); }

/// Expected |x| of x that lies `nominal` and goes up and down by halves of normal distributions with
/// the standard deviations `up` and `down`.
double expected_size(double nominal, double up, double down) {
  const auto half = [](double e, double s) {
    // Integral of |e + s z| over z > 0, the density of the normal distribution as weight.
    constexpr double density_at_0 = 0.3989422804014327;
    if (e >= 0 || !(s > 0)) return std::abs(e) / 2 + s * density_at_0 * (e >= 0 ? 1.0 : 0.0);
    const double z = -e / s;
    const double density = density_at_0 * std::exp(-z * z / 2);
    return -e * (normal_below(z) - 0.5) - s * (density_at_0 - density) + e * normal_below(-z) +
           s * density;
  };
  return half(nominal, up) + half(-nominal, down);
}

}  // namespace

namespace {

/// The class of each voxel, which columns are to be looked at, and of which all prints agree that their
/// run prints or their gap is open. `state`: Clear of the layer below, of the nominal print.
SLICECORR_CLONES
void find_needs(const std::uint8_t* __restrict coverage, const std::uint8_t* __restrict lower,
                const std::uint8_t* __restrict upper, const std::uint8_t* __restrict state,
                const std::uint8_t* __restrict before, std::uint8_t* __restrict certain,
                std::uint8_t* __restrict need, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint8_t c = coverage[i];
    const std::uint8_t now = c == 0 ? Class::gap : c == 255 ? Class::run : Class::grey;
    const std::uint8_t l = lower[i] & Clear::side, u = upper[i] & Clear::side;
    const std::uint8_t wants = now == Class::run ? Clear::prints : Clear::open;
    const std::uint8_t is_far = lower[i] & upper[i] & Clear::far;
    const std::uint8_t known = certain[i] | is_far | (now == Class::grey ? 1 : 0);
    const auto looks = static_cast<std::uint8_t>((l ^ u) | (l ^ state[i]) | (now ^ before[i]) |
                                                 (l == Clear::near ? 1 : 0) | (known == 0 ? 1 : 0));
    need[i] = looks;
    certain[i] |= static_cast<std::uint8_t>(looks == 0 && is_far != 0 && l == wants ? 1 : 0);
  }
}

}  // namespace

LightActs light_acts(const CureModel& model, const NearbyModels* nearby) {
  return !nearby             ? LightActs::by_exponent
         : model.bleaching() ? LightActs::as_time
                             : LightActs::by_itself;
}

struct UncertainBand::State {
  State(const CureModel& model, const Uncertainty& uncertainty, int all_layers, std::size_t columns,
        const NearbyModels* nearby)
      : model_(model),
        variance_(uncertainty, model.m, light_acts(model, nearby)),
        derivatives_(model, columns, variance_.wanted(), nearby),
        layerwise_(model.mode == ExposureMode::layerwise),
        variances_{std::vector<double>(columns), std::vector<double>(columns)},
        clear_{std::vector<std::uint8_t>(columns, Clear::open | Clear::far),
               std::vector<std::uint8_t>(columns, Clear::open | Clear::far)},
        classes_(columns, Class::gap),
        state_(columns, Clear::open),
        certain_(columns, 0),
        need_(columns),
        ln_upper_(columns, LnDose{-std::numeric_limits<double>::infinity(), 0}),
        ln_slice_(columns, std::numeric_limits<int>::max()),
        columns_(columns),
        empty_(columns, 0),
        lower_heights_(columns, 0) {
    own_.inputs = uncertainty;
    for (Column& c : columns_) c.lower = all_layers;
    constexpr float none = std::numeric_limits<float>::quiet_NaN();
    sides_.below_um.assign(columns, none);
    sides_.above_um.assign(columns, none);
    if (variance_.wanted().stray && !nearby &&
        std::isinf(light_gradient(model, model.phi_min()).stray)) {
      throw InputError(
          "stray light is off, and by how much the dose then is can't be said of an exponent below 1 "
          "and levels without light; expected no error of stray");
    }
  }

  /// ln Omega and its standard deviation.
  struct LnDose {
    double ln = 0, sd = 0;
    double sds() const { return ln / std::max(sd, 1e-12); }
    /// As a print sees it.
    double seen(std::size_t print) const { return ln + kSds[print] * sd; }
  };
  LnDose ln_dose(const DoseGradient& g) const {
    if (!(g.dose > 0)) return {-std::numeric_limits<double>::infinity(), 0};
    return {std::log(g.dose), variance_.sd_ln(g)};
  }
  /// An edge whose height errors are being found.
  struct Edge {
    bool open = false;
    int node = 0;
    std::uint8_t height = 0;
    std::array<double, kPrints> error{};        ///< slices, beyond the node
    std::array<bool, kPrints> seeks{};          ///< not known yet
    std::array<double, kErrorSources> share{};  ///< of the half width, from each source
  };
  struct Column {
    std::int32_t lower = 0;  ///< node where the present class begins
    bool run_below = false;  ///< there is a run further down
    /// What lies above that run: layers of coverage 0, maybe greys between.
    struct Gap {
      bool seen = false;
      int bottom = 0;
      double least = std::numeric_limits<double>::infinity();  ///< ln Omega / sd
    } gap;
    std::array<bool, kPrints> printed{};
    std::array<double, kPrints> last{};  ///< where each print changed last, slices
    std::array<bool, kPrints> any{};     ///< changed in the present class
    /// Greatest (run) or least (gap) ln Omega / sd of the present class.
    double extreme = 0;
    Edge upper, lower_edge;
  };

  /// The slice whose light `derivatives_` have taken last.
  void judge(int slice, const std::uint8_t* coverage, const std::uint8_t* heights);
  void look(std::size_t i, int slice, Class now, bool enters);
  void enter(std::size_t i, int node, std::uint8_t height, Class next, const DoseGradient& at_node);
  void close_class(std::size_t i, int top);
  void close_gap(std::size_t i, int top);
  void doubt(std::size_t i, bool gap, int top, int bottom, double p);
  void pass(Column& c, std::size_t print, double zeta);
  void complete(std::size_t i, Edge& edge, bool upper);
  void note_extreme(Column& c, Class cls, double sds) const {
    c.extreme = cls == Class::run ? std::max(c.extreme, sds) : std::min(c.extreme, sds);
  }
  void begin_extreme(Column& c, Class cls) const {
    constexpr double far = std::numeric_limits<double>::infinity();
    c.extreme = cls == Class::run ? -far : far;
  }
  static DoseGradient end_of(const BandDerivatives::Fields& f, std::size_t i) {
    const auto value = [i](const std::vector<double>& of) { return of.empty() ? 0.0 : of[i]; };
    return {f.dose[i],         f.ln_ha[i],     value(f.stray),   value(f.m),
            value(f.variance), value(f.light), value(f.exchange)};
  }
  double crossing(std::size_t i, std::size_t print, double at_lower, double at_upper) const;
  void find_variances(const BandDerivatives::Fields& f, std::vector<double>& q) const;

  const CureModel& model_;
  const DoseVariance variance_;
  BandDerivatives derivatives_;
  const bool layerwise_;
  bool at_heights_ = false;
  std::array<std::vector<double>, 2> variances_;    ///< of Omega at lower and upper ends
  std::array<std::vector<std::uint8_t>, 2> clear_;  ///< Clear, the same
  std::vector<std::uint8_t> classes_;               ///< Class
  std::vector<std::uint8_t> state_;  ///< whether the nominal print is there: prints or open
  /// Not 0 where all prints agree somewhere in the present class that a run prints, a gap is open.
  std::vector<std::uint8_t> certain_;
  std::vector<std::uint8_t> need_;
  std::vector<LnDose> ln_upper_;  ///< at the upper end of the layer `ln_slice_`
  std::vector<int> ln_slice_;
  std::vector<Column> columns_;
  std::vector<std::uint8_t> empty_, lower_heights_;
  EdgeSink edge_sink_;
  DoubtSink doubt_sink_;
  EdgeSides sides_;
  UncertainPrint own_;
  UncertainPrint* figures_ = &own_;
  /// Places whose y is the column, until `finish` knows where it lies.
  DoubtfulPlaces doubts_;
};

void UncertainBand::State::find_variances(const BandDerivatives::Fields& f,
                                          std::vector<double>& q) const {
  const DoseVariance::Form& r = variance_.form();
  const std::size_t n = q.size();
  first_terms(f.dose.data(), f.ln_ha.data(), r[0][0], 2 * r[0][1], r[1][1], q.data(), n);
  const auto add = [&](const std::vector<double>& x, const std::vector<double>& y, double factor) {
    if (factor != 0) add_product(x.data(), y.data(), factor, q.data(), n);
  };
  add(f.dose, f.stray, 2 * r[0][2]);
  add(f.ln_ha, f.stray, 2 * r[1][2]);
  add(f.stray, f.stray, r[2][2]);
  add(f.dose, f.m, 2 * r[0][3]);
  add(f.ln_ha, f.m, 2 * r[1][3]);
  add(f.stray, f.m, 2 * r[2][3]);
  add(f.m, f.m, r[3][3]);
  // With what else comes together only a fit says, and none says it of the light.
  add(f.light, f.light, r[4][4]);
  add(f.dose, f.exchange, 2 * r[0][5]);
  add(f.ln_ha, f.exchange, 2 * r[1][5]);
  add(f.stray, f.exchange, 2 * r[2][5]);
  add(f.m, f.exchange, 2 * r[3][5]);
  add(f.exchange, f.exchange, r[5][5]);
  if (variance_.noise() > 0) add_variance(f.variance.data(), variance_.noise(), q.data(), n);
}

/// Where a print's dose passes 1 in a layer, as the distance from its lower node: between 0, where it
/// is `at_lower`, and 1, where it is `at_upper`, on the other side of 0. Bisection that goes by the
/// chord where that is inside (Illinois).
double UncertainBand::State::crossing(std::size_t i, std::size_t print, double at_lower,
                                      double at_upper) const {
  if (kSds[print] == 0 && !derivatives_.by_differences()) {
    if (!layerwise_) return model_.crossing(derivatives_.phi(i), derivatives_.lower().dose[i]);
    return std::clamp(std::log(derivatives_.lower().dose[i]) / (model_.eta * units::kLn10), 0.0,
                      1.0);
  }
  constexpr double least = -50;  // of a dose of 0: any will do
  FalsePosition root{0, 1, std::max(at_lower, least), std::max(at_upper, least)};
  for (int k = 0; k < 100 && root.high - root.low > 1e-8; ++k) {
    double t = root.chord();
    if (!(t > root.low && t < root.high)) t = 0.5 * (root.low + root.high);
    const double f = std::max(ln_dose(derivatives_.at(i, t)).seen(print), least);
    // Of a dose: some 1e-5 um of an edge.
    if (std::abs(f) < 1e-8) return t;
    root.take(t, f, (f >= 0) == (root.at_high >= 0));
  }
  return 0.5 * (root.low + root.high);
}

/// A print changes at `zeta`; from there on upwards it is on the other side.
void UncertainBand::State::pass(Column& c, std::size_t print, double zeta) {
  c.printed[print] = !c.printed[print];
  c.last[print] = zeta;
  c.any[print] = true;
  // The end of what reaches into a gap from below; the first that prints of a run.
  if (c.upper.open && c.upper.seeks[print] && !c.printed[print]) {
    c.upper.error[print] = c.upper.node - zeta;
    c.upper.seeks[print] = false;
  }
  if (c.lower_edge.open && c.lower_edge.seeks[print] && c.printed[print]) {
    c.lower_edge.error[print] = zeta - c.lower_edge.node;
    c.lower_edge.seeks[print] = false;
  }
}

void UncertainBand::State::complete(std::size_t i, Edge& edge, bool upper) {
  if (!edge.open) return;
  edge.open = false;
  EdgeBand band{i, edge.node, upper, edge.error[0], edge.error[1], edge.error[2]};
  if (at_heights_ && edge.height != 0 && (upper || !layerwise_)) {
    const double below = edge_height_slices(edge.height);
    for (double* e : {&band.weak, &band.nominal, &band.strong}) *e += upper ? below : -below;
  }
  // Where layers differ in height, an edge goes through those that it meets.
  if (!model_.heights.alike()) {
    const double node = model_.depth(edge.node);
    for (double* e : {&band.weak, &band.nominal, &band.strong}) {
      *e = upper ? node - model_.depth(edge.node - *e) : model_.depth(edge.node + *e) - node;
    }
  }
  if (edge_sink_) edge_sink_(band);
  const double um = model_.layer_um;
  const double half = std::max(0.0, 0.5 * (band.strong - band.weak)) * um;
  EdgeBands& out = upper ? figures_->upper : figures_->lower;
  ++out.edges;
  out.half_width_um.add(half);
  out.weak_um.add(band.weak * um);
  out.strong_um.add(band.strong * um);
  out.weak_abs_um.add(std::abs(band.weak) * um);
  out.strong_abs_um.add(std::abs(band.strong) * um);
  out.expected_abs_um.add(um * expected_size(band.nominal,
                                             std::max(0.0, band.strong - band.nominal) / kSdsOf95,
                                             std::max(0.0, band.nominal - band.weak) / kSdsOf95));
  for (std::size_t s = 0; s < kErrorSources; ++s) out.by_source_um[s].add(half * edge.share[s]);
  float& widest = (upper ? sides_.below_um : sides_.above_um)[i];
  const auto here = static_cast<float>(half);
  if (std::isnan(widest) || here > widest) widest = here;
}

/// The present class ends at the node `top`.
void UncertainBand::State::close_class(std::size_t i, int top) {
  Column& c = columns_[i];
  const auto cls = static_cast<Class>(classes_[i]);
  constexpr double far = std::numeric_limits<double>::infinity();
  if (certain_[i]) c.extreme = cls == Class::run ? far : -far;
  const double length = c.lower - top;
  if (cls == Class::run) {
    ++figures_->runs;
    doubt(i, false, top, c.lower, normal_below(-c.extreme));
    for (std::size_t p = 0; p < kPrints; ++p) {
      if (c.lower_edge.seeks[p]) c.lower_edge.error[p] = -length;
    }
    complete(i, c.lower_edge, false);
    c.run_below = true;
    c.gap = {};
    c.gap.bottom = top;
  } else if (cls == Class::gap) {
    for (std::size_t p = 0; p < kPrints; ++p) {
      if (c.upper.seeks[p]) c.upper.error[p] = length;
    }
    complete(i, c.upper, true);
    c.gap.seen = true;
    c.gap.least = std::min(c.gap.least, c.extreme);
  }
}

/// What lies between the run below and a run, or the platform, at `top`.
void UncertainBand::State::close_gap(std::size_t i, int top) {
  const Column& c = columns_[i];
  if (!c.run_below || !c.gap.seen) return;
  ++figures_->gaps;
  doubt(i, true, top, c.gap.bottom, normal_below(c.gap.least));
}

/// A run (or gap) of the layers between two nodes is lost (filled) with the probability `p`.
void UncertainBand::State::doubt(std::size_t i, bool gap, int top, int bottom, double p) {
  if (doubt_sink_) doubt_sink_(i, gap, top, bottom - 1, p);
  (gap ? figures_->filled : figures_->lost).add(p);
  if (p < 0.025) return;
  ++(gap ? figures_->may_join : figures_->may_vanish);
  if (p >= 0.975) ++(gap ? figures_->surely_filled : figures_->surely_lost);
  doubts_.add({p, gap, {0, static_cast<int>(i), top, bottom - 1}});
}

/// The class changes at `node`, to `next` above it.
void UncertainBand::State::enter(std::size_t i, int node, std::uint8_t height, Class next,
                                 const DoseGradient& at_node) {
  Column& c = columns_[i];
  const auto before = static_cast<Class>(classes_[i]);
  const double length = c.lower - node;
  close_class(i, node);
  if (next == Class::run) close_gap(i, node);
  const bool edge =
      (before == Class::gap && next == Class::run) || (before == Class::run && next == Class::gap);
  if (edge) {
    Edge made;
    made.open = true;
    made.node = node;
    made.height = height;
    const double all = variance_.of(at_node);
    for (std::size_t s = 0; s < kErrorSources; ++s) {
      made.share[s] =
          all > 0
              ? std::sqrt(std::max(0.0, variance_.of(at_node, static_cast<ErrorSource>(s))) / all)
              : 0.0;
    }
    const bool upper = next == Class::gap;
    for (std::size_t p = 0; p < kPrints; ++p) {
      if (upper) {
        made.seeks[p] = c.printed[p];
        // What stays behind: up to the last that printed of the run.
        if (!c.printed[p]) made.error[p] = c.any[p] ? -std::min(length, c.last[p] - node) : -length;
      } else {
        made.seeks[p] = !c.printed[p];
        if (c.printed[p]) made.error[p] = c.any[p] ? std::min(length, c.last[p] - node) : length;
      }
    }
    (upper ? c.upper : c.lower_edge) = made;
  }
  c.lower = node;
  c.any = {};
  classes_[i] = next;
  certain_[i] = 0;
  begin_extreme(c, next);
}

void UncertainBand::State::look(std::size_t i, int slice, Class now, bool enters) {
  Column& c = columns_[i];
  const int node = slice + 1;
  const DoseGradient lower = end_of(derivatives_.lower(), i);
  const std::uint8_t height = lower_heights_[i];
  const bool known = !layerwise_ && ln_slice_[i] == node;
  const LnDose ln_lower = known ? ln_upper_[i] : ln_dose(lower);
  std::array<double, kPrints> at_lower{};
  for (std::size_t p = 0; p < kPrints; ++p) at_lower[p] = ln_lower.seen(p);
  // Upper edges are judged by the dose above the node, lower ones by that below it: both on the side
  // of the gap. Where the dose does not jump it is all the same.
  const auto jump = [&] {
    for (std::size_t p = 0; p < kPrints; ++p) {
      if (c.printed[p] != (at_lower[p] >= 0)) pass(c, p, node);
    }
  };
  if (enters) {
    if (now == Class::run && layerwise_) {
      enter(i, node, height, now, lower);
      jump();
    } else {
      jump();
      if (!layerwise_) note_extreme(c, static_cast<Class>(classes_[i]), ln_lower.sds());
      enter(i, node, height, now, lower);
    }
  } else {
    jump();
  }
  note_extreme(c, now, ln_lower.sds());
  const LnDose ln_upper = ln_dose(end_of(derivatives_.upper(), i));
  ln_upper_[i] = ln_upper;
  ln_slice_[i] = slice;
  note_extreme(c, now, ln_upper.sds());
  std::array<double, kPrints> at_upper{};
  for (std::size_t p = 0; p < kPrints; ++p) {
    at_upper[p] = ln_upper.seen(p);
    if ((at_lower[p] >= 0) == (at_upper[p] >= 0)) continue;
    pass(c, p, slice + 1 - crossing(i, p, at_lower[p], at_upper[p]));
  }
  state_[i] = c.printed[1] ? Clear::prints : Clear::open;
}

void UncertainBand::State::judge(int slice, const std::uint8_t* coverage,
                                 const std::uint8_t* heights) {
  const std::size_t n = columns_.size();
  if (!coverage) coverage = empty_.data();
  if (layerwise_) {
    find_variances(derivatives_.lower(), variances_[0]);
    find_clear(derivatives_.lower().dose.data(), variances_[0].data(), clear_[0].data(), n);
  } else {
    std::swap(clear_[0], clear_[1]);
  }
  find_variances(derivatives_.upper(), variances_[1]);
  find_clear(derivatives_.upper().dose.data(), variances_[1].data(), clear_[1].data(), n);
  find_needs(coverage, clear_[0].data(), clear_[1].data(), state_.data(), classes_.data(),
             certain_.data(), need_.data(), n);
  constexpr std::size_t word = 8;
  for (std::size_t b = 0; b < n; b += word) {
    const std::size_t end = std::min(n, b + word);
    if (end == b + word) {
      std::uint64_t any = 0;
      std::memcpy(&any, &need_[b], word);
      if (any == 0) continue;
    }
    for (std::size_t i = b; i < end; ++i) {
      if (need_[i] == 0) continue;
      const Class now = class_of(coverage[i]);
      look(i, slice, now, now != classes_[i]);
    }
  }
  if (heights) {
    std::copy_n(heights, n, lower_heights_.data());
  } else {
    std::fill(lower_heights_.begin(), lower_heights_.end(), std::uint8_t{0});
  }
}

UncertainBand::UncertainBand(const CureModel& model, const Uncertainty& uncertainty, int all_layers,
                             std::size_t columns, const NearbyModels* nearby)
    : state_(std::make_unique<State>(model, uncertainty, all_layers, columns, nearby)) {}
UncertainBand::~UncertainBand() = default;
UncertainBand::UncertainBand(UncertainBand&&) noexcept = default;

void UncertainBand::add_slice(int slice, const std::uint8_t* pixels, const std::uint8_t* coverage,
                              const std::uint8_t* heights) {
  state_->derivatives_.add_slice(slice, pixels);
  state_->judge(slice, coverage, heights);
}
void UncertainBand::add_slice(int slice, std::span<const ImageShowing> showings,
                              const std::uint8_t* coverage, const std::uint8_t* heights) {
  state_->derivatives_.add_slice(slice, showings);
  state_->judge(slice, coverage, heights);
}
void UncertainBand::add_to(UncertainPrint& figures) { state_->figures_ = &figures; }
void UncertainBand::aim_at_heights() { state_->at_heights_ = true; }
void UncertainBand::tell_edges(EdgeSink sink) { state_->edge_sink_ = std::move(sink); }
void UncertainBand::tell_doubts(DoubtSink sink) { state_->doubt_sink_ = std::move(sink); }
const EdgeSides& UncertainBand::sides() const { return state_->sides_; }

void UncertainBand::finish(const BandPredictor::PixelOfColumn& place, UncertainPrint& into) {
  State& s = *state_;
  for (std::size_t i = 0; i < s.columns_.size(); ++i) {
    s.close_class(i, 0);
    if (s.classes_[i] != Class::run) s.close_gap(i, 0);
  }
  for (DoubtfulPlace& d : s.doubts_.sorted()) {
    const Pixel at = place(static_cast<std::size_t>(d.where.y));
    d.where.x = at.x;
    d.where.y = at.y;
    s.figures_->places.add(d);
  }
  if (s.figures_ == &s.own_) into.merge(s.own_);
}

}  // namespace slicecorr
