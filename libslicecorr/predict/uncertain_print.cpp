// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/uncertain_print.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <tuple>

namespace slicecorr {

namespace {

using nlohmann::ordered_json;

constexpr double kProbabilityUnit = 1152921504606846976.0;  // 2^60
constexpr double kSumUnit = 4294967296.0;                   // 2^32

ErrorSource source_of(UncertainInput input) {
  switch (input) {
    case UncertainInput::light:
    case UncertainInput::stray:
      return ErrorSource::lamp;
    case UncertainInput::speed:
    case UncertainInput::time:
      return ErrorSource::speed;
    case UncertainInput::exchange:
      return ErrorSource::lifts;
    default:
      return ErrorSource::resin;
  }
}

/// Derivative of the dose by an input, in dose, ln_ha, stray, m, light and exchange.
std::array<double, DoseVariance::kTerms> derivative_by(UncertainInput input, double exponent,
                                                       LightActs light) {
  switch (input) {
    case UncertainInput::ha:
      return {0, 1, 0, 0, 0, 0};
    case UncertainInput::dc:
    case UncertainInput::aim:
      return {-1, 0, 0, 0, 0, 0};
    case UncertainInput::speed:
      if (light == LightActs::as_time) return {0, 0, 0, 0, -1, 0};
      return {-1, 0, 0, 0, 0, 0};
    case UncertainInput::time:
      if (light == LightActs::as_time) return {0, 0, 0, 0, 1, 0};
      return {1, 0, 0, 0, 0, 0};
    case UncertainInput::light:
      if (light != LightActs::by_exponent) return {0, 0, 0, 0, 1, 0};
      return {exponent, 0, 0, 0, 0, 0};
    case UncertainInput::stray:
      return {0, 0, 1, 0, 0, 0};
    case UncertainInput::m:
      return {0, 0, 0, 1, 0, 0};
    case UncertainInput::exchange:
      return {0, 0, 0, 0, 0, 1};
  }
  return {};
}

double value_of(const DoseVariance::Form& form, const DoseGradient& g) {
  constexpr std::size_t terms = DoseVariance::kTerms;
  const std::array<double, terms> x{g.dose, g.ln_ha, g.stray, g.m, g.light, g.exchange};
  double sum = 0;
  for (std::size_t a = 0; a < terms; ++a) {
    for (std::size_t b = 0; b < terms; ++b) sum += form[a][b] * x[a] * x[b];
  }
  return sum;
}

/// Most probable first, then in reading order.
bool more_doubtful(const DoubtfulPlace& a, const DoubtfulPlace& b) {
  if (a.probability != b.probability) return a.probability > b.probability;
  return std::tie(a.where, a.gap) < std::tie(b.where, b.gap);
}

}  // namespace

const char* word_of(ErrorSource source) {
  constexpr std::array<const char*, kErrorSources> words = {"resin", "lamp", "speed",
                                                            "lifts", "flat", "noise"};
  return words[static_cast<std::size_t>(source)];
}

DoseVariance::DoseVariance(const Uncertainty& u, double exponent, LightActs light)
    : noise_(exponent * u.noise * exponent * u.noise) {
  const bool light_apart = light != LightActs::by_exponent;
  const std::size_t n = u.inputs.size();
  for (std::size_t i = 0; i < n; ++i) {
    const auto x = derivative_by(u.inputs[i], exponent, light);
    for (std::size_t j = 0; j < n; ++j) {
      const auto y = derivative_by(u.inputs[j], exponent, light);
      const bool same = source_of(u.inputs[i]) == source_of(u.inputs[j]);
      Form& own = by_source_[static_cast<std::size_t>(source_of(u.inputs[i]))];
      for (std::size_t a = 0; a < kTerms; ++a) {
        for (std::size_t b = 0; b < kTerms; ++b) {
          const double term = x[a] * u.covariance[i * n + j] * y[b];
          all_[a][b] += term;
          if (same) own[a][b] += term;
        }
      }
    }
  }
  const double flat = (light_apart ? 1 : exponent) * u.flat;
  const std::size_t of_light = light_apart ? 4 : 0;
  by_source_[static_cast<std::size_t>(ErrorSource::flat)][of_light][of_light] = flat * flat;
  all_[of_light][of_light] += flat * flat;
  const bool as_time = light == LightActs::as_time &&
                       (u.sd(UncertainInput::speed) > 0 || u.sd(UncertainInput::time) > 0);
  wanted_.light = as_time || (light_apart && (u.flat > 0 || u.sd(UncertainInput::light) > 0));
  wanted_.stray = u.sd(UncertainInput::stray) > 0;
  wanted_.m = u.sd(UncertainInput::m) > 0;
  wanted_.noise = u.noise > 0;
  wanted_.exchange_step = u.sd(UncertainInput::exchange);
  wanted_.exchange = wanted_.exchange_step > 0;
  wanted_.reference_mw_cm2 = u.reference_mw_cm2;
}

double DoseVariance::of(const DoseGradient& g) const {
  if (!wanted_.stray && !wanted_.m && !wanted_.light && !wanted_.exchange) {
    const double q = all_[0][0] * g.dose * g.dose + 2 * all_[0][1] * g.dose * g.ln_ha +
                     all_[1][1] * g.ln_ha * g.ln_ha;
    return std::max(0.0, q + noise_ * g.variance);
  }
  return std::max(0.0, value_of(all_, g) + noise_ * g.variance);
}

double DoseVariance::of(const DoseGradient& g, ErrorSource source) const {
  if (source == ErrorSource::noise) return noise_ * g.variance;
  return std::max(0.0, value_of(by_source_[static_cast<std::size_t>(source)], g));
}

double DoseVariance::sd_ln(const DoseGradient& g) const {
  return g.dose > 0 ? std::sqrt(of(g)) / g.dose : std::numeric_limits<double>::infinity();
}

void ExpectedCount::add(double probability) {
  sum_ += static_cast<unsigned __int128>(
      std::llround(std::clamp(probability, 0.0, 1.0) * kProbabilityUnit));
}
double ExpectedCount::value() const { return static_cast<double>(sum_) / kProbabilityUnit; }

void SignedSum::add(double value) { sum_ += std::llround(value * kSumUnit); }
double SignedSum::value() const { return static_cast<double>(sum_) / kSumUnit; }

void EdgeBands::merge(const EdgeBands& o) {
  edges += o.edges;
  half_width_um.merge(o.half_width_um);
  weak_um.merge(o.weak_um);
  strong_um.merge(o.strong_um);
  weak_abs_um.merge(o.weak_abs_um);
  strong_abs_um.merge(o.strong_abs_um);
  expected_abs_um.merge(o.expected_abs_um);
  for (std::size_t s = 0; s < kErrorSources; ++s) by_source_um[s].merge(o.by_source_um[s]);
}

void DoubtfulPlaces::add(const DoubtfulPlace& place) {
  if (heap_.size() == kMost) {
    if (!more_doubtful(place, heap_.front())) return;
    std::pop_heap(heap_.begin(), heap_.end(), more_doubtful);
    heap_.pop_back();
  }
  heap_.push_back(place);
  std::push_heap(heap_.begin(), heap_.end(), more_doubtful);
}

void DoubtfulPlaces::merge(const DoubtfulPlaces& other) {
  for (const DoubtfulPlace& p : other.heap_) add(p);
}

std::vector<DoubtfulPlace> DoubtfulPlaces::sorted() const {
  std::vector<DoubtfulPlace> list = heap_;
  std::sort(list.begin(), list.end(), more_doubtful);
  return list;
}

void RobustFigures::merge(const RobustFigures& o) {
  features += o.features;
  gaps += o.gaps;
  lost += o.lost;
  filled += o.filled;
  moved_edges += o.moved_edges;
}

double UncertainPrint::expected_mean_abs_um() const {
  const std::uint64_t edges = upper.edges + lower.edges;
  if (edges == 0) return 0;
  return (upper.expected_abs_um.value() + lower.expected_abs_um.value()) /
         static_cast<double>(edges);
}

double UncertainPrint::bad_mean_abs_um() const {
  const std::uint64_t edges = upper.edges + lower.edges;
  if (edges == 0) return 0;
  return std::max(upper.weak_abs_um.value() + lower.weak_abs_um.value(),
                  upper.strong_abs_um.value() + lower.strong_abs_um.value()) /
         static_cast<double>(edges);
}

double UncertainPrint::map_scale_um() const {
  double widest = 0.01;
  for (const EdgeBands* b : {&upper, &lower}) {
    if (b->edges) widest = std::max(widest, b->half_width_um.quantile(0.95));
  }
  const double unit = std::pow(10.0, std::floor(std::log10(widest)));
  for (const double times : {1.0, 1.5, 2.0, 3.0, 5.0, 7.5}) {
    if (times * unit >= widest) return times * unit;
  }
  return 10 * unit;
}

void UncertainPrint::merge(const UncertainPrint& o) {
  if (inputs.text.empty() && inputs.inputs.empty()) inputs = o.inputs;
  upper.merge(o.upper);
  lower.merge(o.lower);
  runs += o.runs;
  gaps += o.gaps;
  lost.merge(o.lost);
  filled.merge(o.filled);
  may_vanish += o.may_vanish;
  may_join += o.may_join;
  surely_lost += o.surely_lost;
  surely_filled += o.surely_filled;
  places.merge(o.places);
}

std::string UncertainPrint::to_json() const {
  ordered_json j, sds = ordered_json::object(), covariance = ordered_json::array();
  const std::size_t n = inputs.inputs.size();
  for (std::size_t i = 0; i < n; ++i) {
    sds[word_of(inputs.inputs[i])] = inputs.sd(inputs.inputs[i]);
    ordered_json row = ordered_json::array();
    for (std::size_t k = 0; k < n; ++k) row.push_back(inputs.covariance[i * n + k]);
    covariance.push_back(std::move(row));
  }
  if (inputs.flat > 0) sds["flat"] = inputs.flat;
  if (inputs.noise > 0) sds["noise"] = inputs.noise;
  j["asked"] = inputs.text;
  j["sd"] = std::move(sds);
  j["covariance"] = std::move(covariance);
  j["expected_mean_abs_um"] =
      upper.edges + lower.edges ? ordered_json(expected_mean_abs_um()) : ordered_json();
  j["bad_mean_abs_um"] =
      upper.edges + lower.edges ? ordered_json(bad_mean_abs_um()) : ordered_json();
  for (const auto& [name, bands] :
       {std::pair{"upper_edges", &upper}, std::pair{"lower_edges", &lower}}) {
    const EdgeBands& b = *bands;
    ordered_json& out = j[name];
    out["edges"] = b.edges;
    if (b.edges == 0) continue;
    out["half_width95_um"] = {{"mean", b.half_width_um.mean()},
                              {"p95", b.half_width_um.quantile(0.95)},
                              {"max", b.half_width_um.greatest()}};
    out["band95_um"] = {b.mean(b.weak_um), b.mean(b.strong_um)};
    out["expected_mean_abs_um"] = b.mean(b.expected_abs_um);
    ordered_json& sources = out["half_width95_from_um"];
    for (std::size_t s = 0; s < kErrorSources; ++s) {
      sources[word_of(static_cast<ErrorSource>(s))] = b.mean(b.by_source_um[s]);
    }
  }
  j["lost_features"] = {
      {"expected", lost.value()}, {"may", may_vanish}, {"surely", surely_lost}, {"of", runs}};
  j["merged_features"] = {
      {"expected", filled.value()}, {"may", may_join}, {"surely", surely_filled}, {"of", gaps}};
  if (robust) {
    j["robust"] = {{"features", robust->features},
                   {"gaps", robust->gaps},
                   {"lost", robust->lost},
                   {"filled", robust->filled},
                   {"moved_edges", robust->moved_edges},
                   {"mean_abs_um", robust->mean_abs_um},
                   {"plain_mean_abs_um", robust->plain_mean_abs_um}};
  }
  ordered_json& list = j["doubtful"] = ordered_json::array();
  for (const DoubtfulPlace& p : places.sorted()) {
    list.push_back({{"what", p.gap ? "gap" : "feature"},
                    {"x", p.where.x},
                    {"y", p.where.y},
                    {"slices", {p.where.first, p.where.last}},
                    {"probability", p.probability}});
  }
  return j.dump(2);
}

std::string place_in_words(const DoubtfulPlace& p) {
  const std::string slices = p.where.first == p.where.last
                                 ? fmt::format("slice {}", p.where.first)
                                 : fmt::format("slices {} to {}", p.where.first, p.where.last);
  return fmt::format("the {} in {}", p.gap ? "gap" : "feature", slices);
}

std::string uncertainty_in_words(const UncertainPrint& p) {
  std::string text = fmt::format("  how sure, with {}{}:\n", p.inputs.text,
                                 p.inputs.from_fit ? " (errors of a fit, together)" : "");
  const auto line = [&](const std::string& name, const std::string& value) {
    text += fmt::format("    {:<44}{}\n", name, value);
  };
  if (p.upper.edges + p.lower.edges > 0) {
    line("height error to expect, mean",
         fmt::format("{:.3f} um; in a bad print, 1 of 20, {:.3f} um", p.expected_mean_abs_um(),
                     p.bad_mean_abs_um()));
  }
  for (const auto& [name, bands] :
       {std::pair{"upper edges", &p.upper}, std::pair{"lower edges", &p.lower}}) {
    const EdgeBands& b = *bands;
    if (b.edges == 0) continue;
    std::string sources;
    for (std::size_t s = 0; s < kErrorSources; ++s) {
      const double um = b.mean(b.by_source_um[s]);
      if (!(um > 0)) continue;
      sources += fmt::format("{}{} {:.1f}", sources.empty() ? "" : ", ",
                             word_of(static_cast<ErrorSource>(s)), um);
    }
    line(
        fmt::format("{}, 95 % within", name),
        fmt::format("-+ {:.1f} um in the mean, {:.1f} um at most (from {})", b.half_width_um.mean(),
                    b.half_width_um.greatest(), sources.empty() ? "nothing" : sources));
  }
  line("features that may vanish (2.5 % or more)",
       fmt::format("{} of {}; lost in the mean {:.1f}", p.may_vanish, p.runs, p.lost.value()));
  line("gaps that may fill (2.5 % or more)",
       fmt::format("{} of {}; filled in the mean {:.1f}", p.may_join, p.gaps, p.filled.value()));
  if (p.robust) {
    const RobustFigures& r = *p.robust;
    line("robust: lost or filled in the range",
         fmt::format("{} and {}; {} and {} without", r.lost, r.filled, r.features, r.gaps));
    line("robust: what it costs nominally",
         fmt::format("mean height error {:.3f} um, {:.3f} um without; {} edges moved",
                     r.mean_abs_um, r.plain_mean_abs_um, r.moved_edges));
  }
  const std::vector<DoubtfulPlace> worst = p.places.sorted();
  for (std::size_t i = 0; i < std::min<std::size_t>(3, worst.size()); ++i) {
    const DoubtfulPlace& w = worst[i];
    text += fmt::format("    {:.1f} %: {} of pixel {}, {} {}\n", 100 * w.probability,
                        place_in_words(w), w.where.x, w.where.y, w.gap ? "fills" : "is lost");
  }
  return text;
}

}  // namespace slicecorr
