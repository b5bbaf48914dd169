// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resin and light from measured parts and what was known before.
#include "slicecorr/resins/tune.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/least_squares.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/supports.hpp"
#include "tune/matrix.hpp"

namespace slicecorr::resins {

namespace {

/// A measured edge that counts.
struct Row {
  std::size_t part, edge;
};

/// An exchange that is known better than this is told: half of what it is known to before. It must be told by
/// what was measured: with errors of ha and light so many times as great, too. Each edge alone tells it
/// from what was known of them.
constexpr double kToldSd = 0.15, kWider = 10;

double told_sd(const TunedMatrix& prior, const Eigen::MatrixXd& measured) {
  const TunedVector wider{kWider, kWider, 1, 1};
  const TunedMatrix before = wider.asDiagonal() * prior * wider.asDiagonal();
  const TunedMatrix after = (before.inverse() + measured.transpose() * measured).inverse();
  return std::sqrt(
      after(static_cast<Eigen::Index>(kExchange), static_cast<Eigen::Index>(kExchange)));
}

/// Residuals in standard deviations, the prior's first.
class Problem : public LeastSquares {
 public:
  Problem(const std::vector<MeasuredPart>& parts, const Printer& printer, const Resin& resin,
          const TunedMatrix& root, double sigma_um, const std::vector<Row>& rows,
          std::optional<double> held)
      : parts_(parts),
        printer_(printer),
        resin_(resin),
        root_(root),
        sigma_um_(sigma_um),
        rows_(rows),
        held_(held) {}
  std::size_t count() const override { return kTuned + rows_.size(); }
  std::size_t unknowns() const override { return kTuned; }
  double step(std::size_t, double) const override { return 1e-4; }
  bool residuals(const double* values, double* out) const override {
    return evaluate(values, out, nullptr);
  }
  bool jacobian(const double* values, Eigen::MatrixXd& out) const override {
    std::vector<double> unused(count());
    out.resize(static_cast<Eigen::Index>(count()), kUnknowns);
    return evaluate(values, unused.data(), &out);
  }

 private:
  bool evaluate(const double* values, double* out, Eigen::MatrixXd* j) const {
    TuneVector x{};
    std::copy_n(values, kTuned, x.begin());
    if (held_) x[kExchange] = *held_;
    Eigen::Map<TunedVector> known(out);
    known = root_ * Eigen::Map<const TunedVector>(x.data());
    if (j) j->topRows(kUnknowns) = root_;
    std::vector<std::vector<double>> z;
    std::vector<std::vector<TuneVector>> by(parts_.size());
    for (std::size_t p = 0; p < parts_.size(); ++p) {
      z.push_back(predict_edges(parts_[p], printer_, resin_, x, &by[p]));
    }
    for (std::size_t r = 0; r < rows_.size(); ++r) {
      const auto [p, e] = rows_[r];
      if (std::isnan(z[p][e])) return false;
      out[kTuned + r] = (z[p][e] - parts_[p].edges[e].measured_um) / sigma_um_;
      if (!j) continue;
      for (int k = 0; k < kUnknowns; ++k) {
        (*j)(static_cast<Eigen::Index>(kTuned + r), k) =
            by[p][e][static_cast<std::size_t>(k)] / sigma_um_;
      }
    }
    if (j && held_) j->col(static_cast<Eigen::Index>(kExchange)).setZero();
    return true;
  }
  const std::vector<MeasuredPart>& parts_;
  const Printer& printer_;
  const Resin& resin_;
  TunedMatrix root_;
  double sigma_um_;
  const std::vector<Row>& rows_;
  std::optional<double> held_;  ///< the change of the exchange, at the end of what can be
};

std::string name_in(const MeasuredPart& part, const MeasuredEdge& e) {
  return part.source.empty() ? e.name : part.source + ": " + e.name;
}

/// Of two plugs in the same light the one that was lit longer is higher.
void check_plugs(const MeasuredPart& part, const std::vector<double>& expected, double sigma_um) {
  for (std::size_t i = 0; i < part.edges.size(); ++i) {
    for (std::size_t k = 0; k < part.edges.size(); ++k) {
      const MeasuredEdge &low = part.edges[i], &high = part.edges[k];
      if (low.kind != MeasuredKind::plug || high.kind != MeasuredKind::plug) continue;
      if (low.intensity_mw_cm2 != high.intensity_mw_cm2 || !(expected[i] < expected[k])) continue;
      if (!(low.measured_um > high.measured_um + 5 * sigma_um)) continue;
      throw InputError(part.source, low.name,
                       fmt::format("is {:g} um high and {} is {:g} um, which was lit for longer; "
                                   "expected it to be higher: are two swapped?",
                                   low.measured_um, high.name, high.measured_um));
    }
  }
}

/// What can't have been measured on this part.
void check_part(const MeasuredPart& part, const std::vector<double>& expected, double sigma_um) {
  std::vector<double> ratios;
  double before = -std::numeric_limits<double>::infinity();
  std::string before_name;
  check_plugs(part, expected, sigma_um);
  for (std::size_t i = 0; i < part.edges.size(); ++i) {
    const MeasuredEdge& e = part.edges[i];
    if (std::isnan(e.measured_um)) continue;
    if (!std::isnan(expected[i]) && expected[i] > 0) ratios.push_back(e.measured_um / expected[i]);
    if (e.kind == MeasuredKind::plug) continue;
    // Edges that all but meet may change places by what measuring is off; swapped ones are far apart.
    if (e.measured_um < before - 5 * sigma_um) {
      throw InputError(part.source, e.name,
                       fmt::format("is at {:g} um and {} at {:g} um; expected edges that follow "
                                   "each other from the platform on: are two swapped?",
                                   e.measured_um, before_name, before));
    }
    before = e.measured_um;
    before_name = e.name;
  }
  if (ratios.empty()) return;
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2),
                   ratios.end());
  const double middle = ratios[ratios.size() / 2];
  if (middle < 0.02 || middle > 50) {
    throw InputError(
        part.source,
        part.edges.front().kind == MeasuredKind::plug ? "cured_height_um" : "measured_um",
        fmt::format("is {:.3g} times what was to be expected in the middle; expected "
                    "lengths in um{}",
                    middle, middle < 0.02 ? ": are these mm?" : ""));
  }
}

/// The edges that lie furthest from what was expected before: where to look for a slip in a table.
std::string furthest(const std::vector<MeasuredPart>& parts, const std::vector<Row>& rows,
                     const Printer& printer, const Resin& resin) {
  struct Off {
    double um;
    std::string words;
  };
  std::vector<Off> all;
  for (std::size_t p = 0; p < parts.size(); ++p) {
    const std::vector<double> expected = predict_edges(parts[p], printer, resin, {});
    for (const Row& row : rows) {
      if (row.part != p) continue;
      const MeasuredEdge& e = parts[p].edges[row.edge];
      all.push_back({std::abs(e.measured_um - expected[row.edge]),
                     fmt::format("{} ({:g} um, expected {:.4g})", name_in(parts[p], e),
                                 e.measured_um, expected[row.edge])});
    }
  }
  std::stable_sort(all.begin(), all.end(), [](const Off& a, const Off& b) { return a.um > b.um; });
  if (all.size() > 3) all.resize(3);
  std::vector<std::string> words;
  words.reserve(all.size());
  for (const Off& off : all) words.push_back(off.words);
  return fmt::format("what was expected: {}: are cells in the wrong rows?", fmt::join(words, ", "));
}

}  // namespace

TuneGain gain_of(const TuneMatrix& prior, const std::vector<TuneVector>& jacobian,
                 double sigma_um) {
  const TunedMatrix s0 = matrix_of(prior);
  TunedMatrix information = s0.inverse();
  for (const TuneVector& row : jacobian) {
    const TunedVector j = Eigen::Map<const TunedVector>(row.data());
    information += j * j.transpose() / (sigma_um * sigma_um);
  }
  return {0.5 * std::log(s0.determinant() * information.determinant()),
          matrix_of(TunedMatrix(information.inverse()))};
}

TuneResult tune(const std::vector<MeasuredPart>& parts, const Printer& printer, const Resin& resin,
                const TunePrior& prior, double sigma_um) {
  refuse_law(resin, LawUse::part_tuning);
  check_same_unit(printer, resin);
  check_prior(prior);
  if (!(sigma_um > 0) || !std::isfinite(sigma_um)) {
    throw InputError(fmt::format("edges are measured to {:g} um; expected more than 0", sigma_um));
  }
  TuneResult result;
  std::vector<Row> rows;
  for (std::size_t p = 0; p < parts.size(); ++p) {
    const std::vector<double> expected = predict_edges(parts[p], printer, resin, {});
    check_part(parts[p], expected, sigma_um);
    for (std::size_t e = 0; e < parts[p].edges.size(); ++e) {
      const MeasuredEdge& edge = parts[p].edges[e];
      if (std::isnan(edge.measured_um)) {
        result.missing.push_back(name_in(parts[p], edge) + ": not measured");
      } else if (std::isnan(expected[e])) {
        result.missing.push_back(name_in(parts[p], edge) + ": nothing ends there by the model");
      } else {
        rows.push_back({p, e});
      }
    }
  }
  if (rows.empty()) throw InputError("nothing was measured; expected one edge or plug at least");
  const TunedMatrix s0 = matrix_of(prior.covariance);
  const TunedMatrix factor = s0.llt().matrixL();
  const TunedMatrix root = factor.inverse();
  const std::size_t all = rows.size();
  std::vector<double> x;
  Eigen::MatrixXd j;
  while (true) {
    const auto problem_with = [&](std::optional<double> held) {
      return Problem(parts, printer, resin, root, sigma_um, rows, held);
    };
    const Problem problem = problem_with({});
    x.assign(kTuned, 0.0);
    bool found = std::isfinite(minimise(problem, x, kFine, 200));
    // No less than nothing is exchanged, and no more than all.
    TuneVector at{};
    std::copy_n(x.begin(), kTuned, at.begin());
    const double share = tuned_exchange(printer, at), before = exchange_before(printer);
    if (found && share != before + x[kExchange]) {
      const double held = share - before;
      found = std::isfinite(minimise(problem_with(held), x, kFine, 200));
      x[kExchange] = held;
    }
    if (!found || !problem.jacobian(x.data(), j)) {
      throw InputError(
          "no resin and light were found that print what was measured; furthest from " +
          furthest(parts, rows, printer, resin));
    }
    std::vector<double> residual(problem.count());
    problem.residuals(x.data(), residual.data());
    const TunedMatrix after = (j.transpose() * j).inverse();
    std::size_t worst = rows.size();
    double most = 4, squares = 0;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const auto row = j.row(static_cast<Eigen::Index>(kTuned + r));
      const double left = std::max(1e-6, 1 - (row * after * row.transpose()).value());
      const double off = std::abs(residual[kTuned + r]) / std::sqrt(left);
      squares += residual[kTuned + r] * residual[kTuned + r];
      if (off <= most) continue;
      most = off;
      worst = r;
    }
    result.rms_um = sigma_um * std::sqrt(squares / static_cast<double>(rows.size()));
    result.covariance = matrix_of(after);
    if (worst == rows.size() || 5 * (result.outliers.size() + 1) > all) break;
    const MeasuredPart& part = parts[rows[worst].part];
    result.outliers.push_back(fmt::format("{}: {:.1f} standard deviations off",
                                          name_in(part, part.edges[rows[worst].edge]), most));
    rows.erase(rows.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  std::copy(x.begin(), x.end(), result.x.begin());
  result.used = rows.size();
  if (told_sd(s0, j.bottomRows(j.rows() - kUnknowns)) < kToldSd) {
    result.lift_exchange = tuned_exchange(printer, result.x);
  }
  result.gain_nat = -0.5 * std::log(matrix_of(result.covariance).determinant() / s0.determinant());
  for (std::size_t i = 0; i < kTuned; ++i) {
    const double sds = std::abs(x[i]) / std::sqrt(prior.covariance[i][i]);
    if (sds <= 3) continue;
    result.remarks.push_back(fmt::format(
        "{} is {:.1f} standard deviations from what was known before: look at the printer and the "
        "table before you trust it",
        kTunedNames[i], sds));
  }
  return result;
}

}  // namespace slicecorr::resins
