// Resin and light from measured parts and what was known before.
#include "slicecorr/resins/tune.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "database/toml_edit.hpp"
#include "fit/least_squares.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/uncertainty.hpp"
#include "slicecorr/units.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

constexpr std::array<const char*, kTuned> kNames = {"ha", "light", "stray"};
constexpr double kLightSd = 0.03, kStraySd = 0.3;

Eigen::Matrix3d matrix_of(const TuneMatrix& m) {
  Eigen::Matrix3d out;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out(i, j) = m[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
    }
  }
  return out;
}
TuneMatrix matrix_of(const Eigen::Matrix3d& m) {
  TuneMatrix out{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = m(i, j);
    }
  }
  return out;
}

/// A measured edge that counts.
struct Row {
  std::size_t part, edge;
};

/// Residuals in standard deviations, the prior's three first.
class Problem : public LeastSquares {
 public:
  Problem(const std::vector<MeasuredPart>& parts, const Printer& printer, const Resin& resin,
          const Eigen::Matrix3d& root, double sigma_um, const std::vector<Row>& rows)
      : parts_(parts),
        printer_(printer),
        resin_(resin),
        root_(root),
        sigma_um_(sigma_um),
        rows_(rows) {}
  std::size_t count() const override { return kTuned + rows_.size(); }
  std::size_t unknowns() const override { return kTuned; }
  double step(std::size_t, double) const override { return 1e-4; }
  bool residuals(const double* values, double* out) const override {
    return evaluate(values, out, nullptr);
  }
  bool jacobian(const double* values, Eigen::MatrixXd& out) const override {
    std::vector<double> unused(count());
    out.resize(static_cast<Eigen::Index>(count()), 3);
    return evaluate(values, unused.data(), &out);
  }

 private:
  bool evaluate(const double* values, double* out, Eigen::MatrixXd* j) const {
    const TuneVector x{values[0], values[1], values[2]};
    Eigen::Map<Eigen::Vector3d>(out, 3) = root_ * Eigen::Map<const Eigen::Vector3d>(values, 3);
    if (j) j->topRows(3) = root_;
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
      for (int k = 0; k < 3; ++k) {
        (*j)(static_cast<Eigen::Index>(kTuned + r), k) =
            by[p][e][static_cast<std::size_t>(k)] / sigma_um_;
      }
    }
    return true;
  }
  const std::vector<MeasuredPart>& parts_;
  const Printer& printer_;
  const Resin& resin_;
  Eigen::Matrix3d root_;
  double sigma_um_;
  const std::vector<Row>& rows_;
};

std::string name_in(const MeasuredPart& part, const MeasuredEdge& e) {
  return part.source.empty() ? e.name : part.source + ": " + e.name;
}

/// What can't have been measured on this part.
void check_part(const MeasuredPart& part, const std::vector<double>& expected, double sigma_um) {
  std::vector<double> ratios;
  double before = -std::numeric_limits<double>::infinity();
  std::string before_name;
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
    throw InputError(part.source, "measured_um",
                     fmt::format("is {:.3g} times what was to be expected in the middle; expected "
                                 "lengths in um",
                                 middle));
  }
}

}  // namespace

TunePrior default_prior() {
  return {{{{0.01, 0, 0}, {0, 0.01, 0}, {0, 0, kStraySd * kStraySd}}},
          "ha 10 %, light over dose 10 %, stray light 0.3 mW/cm² (nothing better is known)"};
}

TunePrior prior_of(const std::string& resin_text, const std::string& resin_source) {
  const toml::table root = parse_toml(resin_text, resin_source);
  const auto provenance = TomlTable(root, resin_source).table("provenance");
  TunePrior prior = default_prior();
  if (!provenance || !provenance->has("covariance") ||
      provenance->text("covariance", "") == "unknown") {
    return prior;
  }
  const Uncertainty u =
      parse_uncertainty("fit", ExposureMode::continuous, 1, {resin_text, resin_source});
  using enum UncertainInput;
  if (u.sd(ha) == 0 || u.sd(dc) == 0) return prior;
  prior.covariance[0][0] = u.variance(ha, ha);
  prior.covariance[1][1] = u.variance(dc, dc) + kLightSd * kLightSd;
  prior.covariance[0][1] = prior.covariance[1][0] = -u.variance(ha, dc);
  prior.text = "the covariance in the resin's file, light 3 %, stray light 0.3 mW/cm²";
  check_prior(prior);
  return prior;
}

void check_prior(const TunePrior& prior) {
  const TuneMatrix& s = prior.covariance;
  for (std::size_t i = 0; i < kTuned; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      const bool pair = i != j;
      const double limit = std::sqrt(std::max(0.0, s[i][i] * s[j][j]));
      const bool sound = std::isfinite(s[i][j]) && (pair ? std::abs(s[i][j]) < limit : s[i][i] > 0);
      if (sound && std::abs(s[i][j] - s[j][i]) <= 1e-12 * limit) continue;
      throw InputError(fmt::format(
          "the covariance of {} and {} is {:g}, and {:g} the other way; expected a symmetric one of "
          "errors that are above 0 and don't follow from each other",
          kNames[i], kNames[j], s[i][j], s[j][i]));
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(matrix_of(s));
  if (!(solver.eigenvalues()[0] > 0)) {
    throw InputError(
        fmt::format("the covariance of ha, light and stray has the eigenvalue {:g}; expected all "
                    "above 0",
                    solver.eigenvalues()[0]));
  }
}

TuneGain gain_of(const TuneMatrix& prior, const std::vector<TuneVector>& jacobian,
                 double sigma_um) {
  const Eigen::Matrix3d s0 = matrix_of(prior);
  Eigen::Matrix3d information = s0.inverse();
  for (const TuneVector& row : jacobian) {
    const Eigen::Vector3d j(row[0], row[1], row[2]);
    information += j * j.transpose() / (sigma_um * sigma_um);
  }
  return {0.5 * std::log(s0.determinant() * information.determinant()),
          matrix_of(Eigen::Matrix3d(information.inverse()))};
}

TuneResult tune(const std::vector<MeasuredPart>& parts, const Printer& printer, const Resin& resin,
                const TunePrior& prior, double sigma_um) {
  if (resin.has_gel_time()) {
    throw InputError(resin.name, "cure.model",
                     "is \"gel-time\"; parts tune a resin of one law of dose: expected one that "
                     "resinctl derive made for the intensities of the printer");
  }
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
  const Eigen::Matrix3d s0 = matrix_of(prior.covariance);
  const Eigen::Matrix3d factor = s0.llt().matrixL();
  const Eigen::Matrix3d root = factor.inverse();
  const std::size_t all = rows.size();
  std::vector<double> x;
  Eigen::MatrixXd j;
  while (true) {
    const Problem problem(parts, printer, resin, root, sigma_um, rows);
    x.assign(kTuned, 0.0);
    if (!std::isfinite(minimise(problem, x, kFine, 200)) || !problem.jacobian(x.data(), j)) {
      throw InputError("no resin and light were found that print what was measured");
    }
    std::vector<double> residual(problem.count());
    problem.residuals(x.data(), residual.data());
    const Eigen::Matrix3d after = (j.transpose() * j).inverse();
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
  result.gain_nat = -0.5 * std::log(matrix_of(result.covariance).determinant() / s0.determinant());
  for (std::size_t i = 0; i < kTuned; ++i) {
    const double sds = std::abs(x[i]) / std::sqrt(prior.covariance[i][i]);
    if (sds <= 3) continue;
    result.remarks.push_back(fmt::format(
        "{} is {:.1f} standard deviations from what was known before: look at the printer and the "
        "table before you trust it",
        kNames[i], sds));
  }
  return result;
}

std::string TuneResult::to_text(const Resin& resin, const TunePrior& prior) const {
  const auto sd = [&](std::size_t i) { return std::sqrt(covariance[i][i]); };
  const Resin after = tuned_resin(resin, x);
  std::string out = fmt::format("known before: {}\n", prior.text);
  out += fmt::format(
      "absorbance height (base 10): {:.1f} -> {:.1f} um, {:+.2f} % +- {:.2f} %\n"
      "light over dose:             {:+.2f} % +- {:.2f} %\n"
      "stray light:                 {:+.3f} +- {:.3f} mW/cm²\n",
      resin.absorbance_height10_um, after.absorbance_height10_um, 100 * std::expm1(x[0]),
      196 * sd(0), 100 * std::expm1(x[1]), 196 * sd(1), x[2], 1.96 * sd(2));
  out += fmt::format("{} edges, {:.1f} um rms; gain {:.2f} nat (intervals of 95 %)\n", used, rms_um,
                     gain_nat);
  for (const std::string& text : missing) out += "missing: " + text + "\n";
  for (const std::string& text : outliers) out += "left out: " + text + "\n";
  for (const std::string& text : remarks) out += "warning: " + text + "\n";
  return out;
}

std::string resin_with_tuning(const std::string& text, const std::string& source,
                              const TuneResult& result) {
  TomlEdit edit(text, source);
  const toml::table parsed = parse_toml(text, source);
  const TomlTable cure = TomlTable(parsed, source).required_table("cure");
  const Resin before = parse_resin(text, source);
  const Resin after = tuned_resin(before, result.x);
  const double height = std::exp(result.x[0]), areal = std::exp(-before.m * result.x[1]);
  const auto scale = [&](const char* key, double by) {
    if (!cure.has(key)) return;
    edit.set("cure", key, toml_number(cure.required_number(key, 0, 1e12) * by));
    edit.set_comment("cure", key, "");
  };
  if (!cure.has("absorbance_height_um")) {
    throw InputError(source, "cure.absorbance_height_um", "missing, which tune changes");
  }
  scale("absorbance_height_um", height);
  for (const char* key : {"critical_dose_mj_cm3", "gel_dose_mj_cm3"}) scale(key, areal / height);
  for (const char* key : {"critical_dose_mj_cm2", "gel_dose_mj_cm2", "critical_dose_prime"}) {
    scale(key, areal);
  }
  if (after.gel_dose_mj_cm3 > 0 && before.m == 1) {
    const double h = units::height_e_from_10(after.absorbance_height10_um);
    const double d = units::areal_from_volumetric(after.gel_dose_mj_cm3, dose_height_e_um(after));
    const TuneMatrix& c = result.covariance;
    edit.set("provenance", "covariance",
             toml_text(fmt::format("h_um, dc_mj_cm2: [[{:.6g}, {:.6g}], [{:.6g}, {:.6g}]]",
                                   c[0][0] * h * h, -c[0][1] * h * d, -c[0][1] * h * d,
                                   c[1][1] * d * d)));
  }
  return edit.text();
}

}  // namespace slicecorr::resins
