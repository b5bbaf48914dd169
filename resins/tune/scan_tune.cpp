// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/scan_tune.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/supports.hpp"
#include "tune/matrix.hpp"
#include "tune/scan_inputs.hpp"
#include "tune/scan_print.hpp"

namespace slicecorr::resins {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kShrinkPlane = at(ScanInput::shrinkage_plane),
                      kShrinkZ = at(ScanInput::shrinkage_z),
                      kFirstLayers = at(ScanInput::first_layers),
                      kDeadZone = at(ScanInput::dead_zone);
constexpr auto kInputs = static_cast<Index>(kScanInputs);
constexpr auto kOwn = static_cast<Index>(kRowUnknowns);
/// The least noise that points are believed to have, mm: edges of predicted surfaces are as sharp.
constexpr double kLeastNoiseMm = 5e-4;
constexpr std::size_t kMostUnexplained = 5;
/// A cube of fewer points says nothing of itself.
constexpr std::size_t kLeastInCube = 8;
/// Derivatives are taken anew where an input moved by more than this share of its scale; near to the answer by less.
constexpr double kStraight = 0.25, kStraightAtLast = 0.05;
/// Points count at most this share of the diagonal away from edges.
constexpr double kMostFlat = 0.02;
/// Where searches for the dead zone begin, as changes of the logarithm of beta, and how long the short ones are.
constexpr std::array<double, 5> kDeadZoneBegins{0, 0.1, -0.1, 0.2, -0.2};
constexpr int kShortRounds = 4;
/// How far inputs may still move: so many squares of their last step.
constexpr double kStillMoves = 4;

class ScanFit {
 public:
  ScanFit(const std::vector<PrintScan>& prints, const Setup& setup, const TunePrior& prior,
          const ScanTuneOptions& options, const ExecutionContext& context)
      : setup_(setup),
        context_(context),
        quiet_(context),
        inputs_(setup, prior, options, any(prints, setup, by_lifts), any(prints, setup, under_uv)),
        unknowns_(static_cast<Index>(kScanInputs + 6 * prints.size())),
        before_(inputs_.before()),
        known_(before_.inverse()),
        theta_(inputs_.mean()) {
    quiet_.progress = nullptr;
    prints_.reserve(prints.size());
    for (const PrintScan& p : prints) prints_.emplace_back(p, setup, inputs_, options, quiet_);
  }

  ScanTuneResult solve(int rounds) {
    const bool several = inputs_.sought(kDeadZone);
    rounds_ = rounds + (several ? static_cast<int>(kDeadZoneBegins.size()) * kShortRounds : 0);
    if (several) begin_where_most_is_explained(rounds);
    for (int round = 0; round < rounds; ++round) {
      if (round_ends(round, rounds)) break;
    }
    last_ = true;
    linearise();
    ScanTuneResult result;
    finish(result);
    context_.report("tuning by scans", 1);
    return result;
  }

 private:
  static bool by_lifts(const Process& p) {
    return p.mode == ExposureMode::layerwise && p.lifts == Lifts::each;
  }
  static bool under_uv(const Process& p) { return p.uv.kind != UvKind::off; }
  static bool any(const std::vector<PrintScan>& prints, const Setup& setup,
                  bool (*is)(const Process&)) {
    return std::any_of(prints.begin(), prints.end(), [&](const PrintScan& p) {
      return is(p.process ? *p.process : setup.process);
    });
  }

  /// Under UV light edges stay at layers and jump to the next, so a search may end beside the answer. Where the dead zone
  /// is sought, short searches from several of it say where the long one begins.
  void begin_where_most_is_explained(int rounds) {
    const std::vector<ScanPrint> placed = prints_;
    const auto restart = [&](double dead_zone) {
      prints_.clear();
      for (const ScanPrint& print : placed) prints_.push_back(print);
      theta_ = inputs_.mean();
      theta_[static_cast<Index>(kDeadZone)] += dead_zone;
      derived_at_.reset();
      last_ = false;
      trust_ = 1;
    };
    double best = 0, least_mm = std::numeric_limits<double>::infinity();
    for (const double dead_zone : kDeadZoneBegins) {
      restart(dead_zone);
      try {
        for (int round = 0; round < kShortRounds; ++round) round_ends(round, rounds);
        linearise();
      } catch (const InputError&) {
        continue;  // nothing prints there that was scanned
      }
      const double left_mm = smooth().off_mm;
      if (left_mm >= least_mm) continue;
      least_mm = left_mm;
      best = dead_zone;
    }
    restart(best);
  }

  /// Whether nothing changes any more.
  bool round_ends(int round, int rounds) {
    context_.report("tuning by scans", static_cast<double>(done_++) / rounds_);
    linearise();
    const Smooth smooth_now = smooth();
    if (!smooth_before_) smooth_before_ = smooth_now;
    // Far from the answer, most points may fit although what tells an input does not.
    noise_mm_ = last_ ? noise() : std::max(noise(), smooth_now.off_mm);
    const VectorXd step = solve_step();
    take(step);
    double most = 0, of_before = 0;
    for (Index k = 0; k < kInputs; ++k) {
      most = std::max(most, std::abs(step[k]) / straight_over(k));
      of_before = std::max(of_before, std::abs(step[k]) / std::sqrt(before_(k, k)));
    }
    if (most < 0.01 && last_) return true;
    trust_ = std::min(trust_, kStillMoves * of_before * of_before);
    // Only near to the answer may what lies far off be forgotten: far from it, that is the whole of what is off.
    last_ = last_ || most < 0.03 || 2 * round > rounds;
    if (last_) noise_mm_ = noise();
    return false;
  }

  ScanVector change() const {
    ScanVector all{};
    std::copy(theta_.begin(), theta_.end(), all.begin());
    return all;
  }

  /// Points with their distances and derivatives at what is believed now.
  void linearise() {
    ScanState state{change(), !straight(), 0};
    if (state.anew) derived_at_ = theta_;
    rows_.clear();
    for (ScanPrint& print : prints_) {
      // Where much is off that nothing explains, a part would be all edges.
      if (last_) state.flat_mm = std::min(3 * noise_mm_, kMostFlat * print.diagonal_mm());
      rows_.push_back(print.rows(state, quiet_));
    }
    if (last_) set_apart();
  }

  /// Whether derivatives of before hold.
  bool straight() const {
    if (!derived_at_) return false;
    for (std::size_t k = 0; k < kScanInputs; ++k) {
      const auto i = static_cast<Index>(k);
      if (!inputs_.predicted(k)) continue;
      const double moved = std::abs(theta_[i] - (*derived_at_)[i]) / inputs_.scale(k);
      if (moved > (last_ ? kStraightAtLast : kStraight)) return false;
    }
    return true;
  }

  /// Where a twentieth of a cube's points lie farther off than noise ever is, something else is there, whose points lie
  /// nearer, too: stubs of supports, edges that broke.
  void set_apart() {
    struct Counted {
      std::size_t all = 0, far = 0;
    };
    std::map<std::array<long, 4>, Counted> counted;
    const double far_mm = 4.685 * noise();
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      for (const ScanRow& row : rows_[p]) {
        if (!row.counts) continue;
        Counted& cube = counted[cube_of(p, row)];
        ++cube.all;
        cube.far += std::abs(row.off_mm) > far_mm;
      }
    }
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      for (ScanRow& row : rows_[p]) {
        if (!row.counts) continue;
        const Counted& cube = counted[cube_of(p, row)];
        row.apart = cube.far >= 2 && 20 * cube.far >= cube.all;
      }
    }
  }

  /// The place of a row's unknown k among all.
  Index place(std::size_t print, std::size_t k) const {
    return static_cast<Index>(k < kScanInputs ? k : k + 6 * print);
  }

  double noise() const {
    std::vector<double> off;
    for (const auto& rows : rows_) {
      for (const ScanRow& r : rows) {
        if (r.counts) off.push_back(std::abs(r.off_mm));
      }
    }
    if (off.size() < 50) {
      throw InputError(
          "less than 50 points of the scans lie on what was predicted to print; expected scans of it");
    }
    std::nth_element(off.begin(), off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2),
                     off.end());
    return std::max(kLeastNoiseMm, 1.4826 * off[off.size() / 2]);
  }

  /// How far off a row may be for what its inputs may still move it, and noise: a point that an input explains is no
  /// stub. `trust_` falls as steps
  /// get shorter.
  double scale_mm(const ScanRow& row, double noise_mm) const {
    if (last_) return noise_mm;
    const Eigen::Map<const VectorXd> by(row.by.data(), kInputs);
    return std::sqrt(noise_mm * noise_mm + trust_ * by.dot(before_ * by));
  }
  /// The weight of a row: Cauchy's in the first rounds, then Tukey's, which forgets what lies beyond 4.685 standard
  /// deviations.
  double weight(const ScanRow& row, double noise_mm) const {
    if (row.apart) return 0;
    const double share = row.off_mm / (last_ ? 4.685 : 2.385) / scale_mm(row, noise_mm);
    if (!last_) return 1 / (1 + share * share);
    return share * share < 1 ? (1 - share * share) * (1 - share * share) : 0;
  }
  /// How a row's pull grows with what is off, by Tukey's weights: what a covariance is made from.
  static double slope(const ScanRow& row, double noise_mm) {
    if (row.apart) return 0;
    const double square = std::pow(row.off_mm / 4.685 / noise_mm, 2);
    return square < 1 ? (1 - square) * (1 - 5 * square) : 0;
  }

  /// Information and pull of all points and of what was known before. `slopes`: for a covariance.
  void sums(double noise_mm, bool slopes, MatrixXd& a, VectorXd& b) const {
    a = MatrixXd::Zero(unknowns_, unknowns_);
    b = VectorXd::Zero(unknowns_);
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      MatrixXd own = MatrixXd::Zero(kOwn, kOwn);
      VectorXd pull = VectorXd::Zero(kOwn);
      for (const ScanRow& row : rows_[p]) {
        if (!row.counts) continue;
        const double w =
            (slopes ? slope(row, noise_mm) : weight(row, noise_mm)) / (noise_mm * noise_mm);
        const Eigen::Map<const VectorXd> by(row.by.data(), kOwn);
        own.selfadjointView<Eigen::Lower>().rankUpdate(by, w);
        pull -= w * row.off_mm * by;
      }
      own = MatrixXd(own.selfadjointView<Eigen::Lower>());
      for (Index i = 0; i < kOwn; ++i) {
        const Index to = place(p, static_cast<std::size_t>(i));
        b[to] += pull[i];
        for (Index j = 0; j < kOwn; ++j) a(to, place(p, static_cast<std::size_t>(j))) += own(i, j);
      }
    }
    a.topLeftCorner(kInputs, kInputs) += known_;
    b.head(kInputs) -= known_ * (theta_ - inputs_.mean());
    // A pose that no point holds is left as it is.
    a.diagonal().tail(unknowns_ - kInputs).array() += 1e-3;
  }

  VectorXd solve_step() const {
    MatrixXd a;
    VectorXd b;
    sums(noise_mm_, false, a, b);
    VectorXd step = a.ldlt().solve(b);
    // What would become less than nothing stays at nothing, and the others are found once more.
    for (std::size_t k = 0; k < kScanInputs; ++k) {
      const auto i = static_cast<Index>(k);
      const double held = inputs_.within(k, theta_[i] + step[i]) - theta_[i];
      if (held == step[i]) continue;
      b -= a.col(i) * held;
      a.row(i).setZero();
      a.col(i).setZero();
      a(i, i) = 1;
      b[i] = held;
      step = a.ldlt().solve(b);
    }
    // Surfaces are believed to be linear over one and a half times that.
    double most = 1;
    for (Index k = 0; k < kInputs; ++k) {
      most = std::max(most, std::abs(step[k]) / (1.5 * straight_over(k)));
    }
    return step / most;
  }

  /// A change of an input over which surfaces are straight: what is known before, where that is not far more than usual.
  double straight_over(Index k) const {
    return std::min(inputs_.scale(static_cast<std::size_t>(k)), std::sqrt(before_(k, k)));
  }

  void take(const VectorXd& step) {
    theta_ += step.head(kInputs);
    for (std::size_t k = 0; k < kScanInputs; ++k) {
      const auto i = static_cast<Index>(k);
      theta_[i] = inputs_.within(k, theta_[i]);
    }
    for (std::size_t p = 0; p < prints_.size(); ++p) {
      prints_[p].move(step.segment<3>(place(p, kScanInputs)),
                      step.segment<3>(place(p, kScanInputs + 3)));
    }
  }

  /// The cube of a twentieth of the diagonal in which a row lies.
  std::array<long, 4> cube_of(std::size_t print, const ScanRow& row) const {
    const double side = prints_[print].diagonal_mm() / 20;
    std::array<long, 4> cube{static_cast<long>(print)};
    for (std::size_t k = 0; k < 3; ++k) cube[k + 1] = std::lround(std::floor(row.place[k] / side));
    return cube;
  }

  /// By cubes: sums of what is off, and of places.
  struct Cube {
    double off_mm = 0;
    std::size_t points = 0;
    Point3 places{};
  };
  std::map<std::array<long, 4>, Cube> cubes() const {
    std::map<std::array<long, 4>, Cube> found;
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      for (const ScanRow& row : rows_[p]) {
        if (!row.counts) continue;
        Cube& cube = found[cube_of(p, row)];
        cube.off_mm += row.off_mm;
        ++cube.points;
        for (std::size_t k = 0; k < 3; ++k) cube.places[k] += row.place[k];
      }
    }
    return found;
  }
  /// The root of the mean square of means over cubes, and which share of the square of a point's noise is in its square.
  struct Smooth {
    double off_mm = 0, noise_share = 0;
    /// Without the noise of points.
    double without_um(double noise_mm) const {
      return 1e3 * std::sqrt(std::max(0.0, off_mm * off_mm - noise_share * noise_mm * noise_mm));
    }
  };
  Smooth smooth() const {
    double squares = 0, points = 0;
    const auto all = cubes();
    for (const auto& [where, cube] : all) {
      const auto n = static_cast<double>(cube.points);
      squares += cube.off_mm * cube.off_mm / n;
      points += n;
    }
    if (!(points > 0)) return {};
    return {std::sqrt(squares / points), static_cast<double>(all.size()) / points};
  }

  /// The covariance of all inputs: by how much the answer changes when a cube is left out (a jackknife over cubes, whose
  /// points are off together), and what was known before. Where few cubes tell an input, their scatter is known badly: its
  /// standard deviation is the longer by Student's t. It is never less than if every point were off by itself.
  MatrixXd covariance(const MatrixXd& a, double noise_mm) const {
    struct Witness {
      VectorXd pull = VectorXd::Zero(kOwn);
      MatrixXd tells = MatrixXd::Zero(kOwn, kOwn);
    };
    std::map<std::array<long, 4>, Witness> witnesses;
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      for (const ScanRow& row : rows_[p]) {
        if (!row.counts) continue;
        Witness& one = witnesses[cube_of(p, row)];
        const Eigen::Map<const VectorXd> by(row.by.data(), kOwn);
        const double square = noise_mm * noise_mm;
        one.pull -= weight(row, noise_mm) / square * row.off_mm * by;
        one.tells += slope(row, noise_mm) / square * by * by.transpose();
      }
    }
    const MatrixXd bread = a.ldlt().solve(MatrixXd::Identity(unknowns_, unknowns_));
    MatrixXd left_out = MatrixXd::Zero(kInputs, kInputs);
    VectorXd fourth = VectorXd::Zero(kInputs);
    for (const auto& [where, one] : witnesses) {
      MatrixXd columns(unknowns_, kOwn);
      for (Index i = 0; i < kOwn; ++i) {
        columns.col(i) =
            bread.col(place(static_cast<std::size_t>(where[0]), static_cast<std::size_t>(i)));
      }
      MatrixXd own(kOwn, kOwn);
      for (Index i = 0; i < kOwn; ++i) {
        own.row(i) =
            columns.row(place(static_cast<std::size_t>(where[0]), static_cast<std::size_t>(i)));
      }
      const MatrixXd others = MatrixXd::Identity(kOwn, kOwn) - one.tells * own;
      const VectorXd moved = columns.topRows(kInputs) * others.partialPivLu().solve(one.pull);
      left_out += moved * moved.transpose();
      fourth += moved.cwiseAbs2().cwiseAbs2();
    }
    const MatrixXd top = bread.topLeftCorner(kInputs, kInputs);
    MatrixXd all = left_out + top * known_ * top.transpose();
    VectorXd wider = VectorXd::Ones(kInputs);
    for (Index k = 0; k < kInputs; ++k) {
      const double of_points = left_out(k, k), of_before = all(k, k) - of_points;
      // Squares of normal numbers have three times the mean square in their squares.
      const double freedom =
          fourth[k] > 0 ? std::max(2.0, 3 * of_points * of_points / fourth[k]) : 2.0;
      const double t = student_t_quantile(0.975, freedom) / 1.96;
      const double square = std::max(t * t * of_points + of_before, top(k, k));
      wider[k] = std::sqrt(square / all(k, k));
    }
    return wider.asDiagonal() * all * wider.asDiagonal();
  }

  void finish(ScanTuneResult& result) const {
    const double noise_mm = noise();
    MatrixXd a;
    VectorXd b;
    sums(noise_mm, true, a, b);
    const MatrixXd after = covariance(a, noise_mm);
    for (std::size_t k = 0; k < kScanInputs; ++k) {
      const auto i = static_cast<Index>(k);
      const double sd_before = std::sqrt(before_(i, i));
      result.findings.push_back({theta_[i], inputs_.sought(k) ? std::sqrt(after(i, i)) : sd_before,
                                 sd_before, inputs_.sought(k)});
    }
    const ScanVector found = change();
    std::copy_n(found.begin(), kTuned, result.tuned.x.begin());
    const TunedMatrix own = after.topLeftCorner(kUnknowns, kUnknowns);
    result.tuned.covariance = matrix_of(own);
    const TunedMatrix prior = before_.topLeftCorner(kUnknowns, kUnknowns);
    result.tuned.gain_nat = 0.5 * std::log(prior.determinant() / own.determinant());
    result.noise_um = 1e3 * noise_mm;
    result.before_um = smooth_before_ ? smooth_before_->without_um(noise_mm) : 0;
    result.after_um = result.tuned.rms_um = smooth().without_um(noise_mm);
    for (const auto& rows : rows_) {
      for (const ScanRow& row : rows) ++(row.counts ? result.points : result.left_out);
    }
    result.tuned.used = result.points;
    if (inputs_.sought(kExchange) && result.findings[kExchange].sd < 0.15) {
      result.tuned.lift_exchange = tuned_exchange(setup_.printer, result.tuned.x);
    }
    result.tuned.shrinkage = found_shrinkage(result.findings, setup_.resin.shrinkage);
    take_light(result);
    for (const ScanPrint& print : prints_) result.registrations.push_back(print.registration());
    say_not_apart(a, result);
    say_unexplained(noise_mm, result);
  }

  /// Of spread, scatter and dead zone, as of shrinkage, what is told and lies beyond its 95 % is for the files.
  void take_light(ScanTuneResult& result) const {
    const Setup found = inputs_.setup_at(setup_, change());
    const auto sure = [&](ScanInput input) { return result.finding(input).sure(); };
    if (sure(ScanInput::spread)) result.tuned.spread = found.printer.spread;
    if (sure(ScanInput::scatter)) {
      result.tuned.scatter_um2_per_um = found.resin.scatter_um2_per_um;
    }
    if (sure(ScanInput::dead_zone)) result.tuned.uv_beta = found.resin.inhibition->beta;
  }

  void say_unexplained(double noise_mm, ScanTuneResult& result) const {
    std::vector<Unexplained> places;
    for (const auto& [where, cube] : cubes()) {
      const auto n = static_cast<double>(cube.points);
      const double mean = cube.off_mm / n;
      if (cube.points < kLeastInCube || std::abs(mean) < 4 * noise_mm / std::sqrt(n)) continue;
      places.push_back(
          {{cube.places[0] / n, cube.places[1] / n, cube.places[2] / n}, 1e3 * mean, cube.points});
    }
    std::stable_sort(places.begin(), places.end(),
                     [](const Unexplained& one, const Unexplained& other) {
                       return std::abs(one.mean_um) > std::abs(other.mean_um);
                     });
    places.resize(std::min(places.size(), kMostUnexplained));
    result.unexplained = std::move(places);
  }

  /// Directions among the inputs of which points tell less than was known: eigenvectors of what they tell, once poses
  /// are free, in units of what was known.
  void say_not_apart(const MatrixXd& a, ScanTuneResult& result) const {
    const Index poses = unknowns_ - kInputs;
    const MatrixXd cross = a.topRightCorner(kInputs, poses);
    MatrixXd told = a.topLeftCorner(kInputs, kInputs) - known_ -
                    cross * a.bottomRightCorner(poses, poses).ldlt().solve(cross.transpose());
    const VectorXd sd = before_.diagonal().cwiseSqrt();
    told = sd.asDiagonal() * told * sd.asDiagonal();
    // What is not sought is nothing of these prints.
    for (std::size_t k = 0; k < kScanInputs; ++k) {
      if (!inputs_.sought(k)) told(static_cast<Index>(k), static_cast<Index>(k)) = 1e12;
    }
    const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(told);
    for (Index k = 0; k < kInputs; ++k) {
      if (solver.eigenvalues()[k] > 3) continue;
      std::string words;
      for (Index i = 0; i < kInputs; ++i) {
        const double share = solver.eigenvectors()(i, k);
        if (std::abs(share) < 0.25) continue;
        words += fmt::format("{}{} {:.2g}", words.empty() ? "" : ", ",
                             kScanNames[static_cast<std::size_t>(i)], share);
      }
      result.not_apart.push_back(words);
    }
  }

  const Setup& setup_;
  const ExecutionContext& context_;
  ExecutionContext quiet_;  ///< the same, whose stages are not told
  ScanInputs inputs_;
  Index unknowns_;
  MatrixXd before_, known_;  ///< covariance known before, and its inverse
  VectorXd theta_;           ///< believed now
  std::optional<VectorXd> derived_at_;
  bool last_ = false;
  double trust_ = 1;
  double noise_mm_ = 0;
  std::optional<Smooth> smooth_before_;  ///< of what was believed
  int done_ = 0, rounds_ = 1;            ///< of all searches
  std::vector<ScanPrint> prints_;
  std::vector<std::vector<ScanRow>> rows_;
};

}  // namespace

std::optional<Shrinkage> found_shrinkage(const std::vector<ScanFinding>& findings,
                                         const Shrinkage& before) {
  Shrinkage now = before;
  const auto sure = [&](std::size_t k) { return findings[k].sure(); };
  const auto together = [&](double per_cent, std::size_t k) {
    if (!sure(k)) return per_cent;
    return std::clamp(100 - (100 - per_cent) * (1 - findings[k].value), Shrinkage::kLeast,
                      Shrinkage::kMost);
  };
  now.plane_per_cent = together(before.plane_per_cent, kShrinkPlane);
  now.z_per_cent = together(before.z_per_cent, kShrinkZ);
  if (sure(kFirstLayers)) {
    now.growth_um = std::clamp(before.growth_um + 1e3 * findings[kFirstLayers].value, 0.0,
                               Shrinkage::kMostGrowthUm);
  }
  if (now == before) return std::nullopt;
  return now;
}

Setup tuned_setup(const Setup& setup, const TuneVector& x) {
  Setup tuned = setup;
  tuned.printer = tuned_printer(setup.printer, setup.resin.m, x);
  tuned.resin = tuned_resin(setup.resin, x);
  if (x[kExchange] != 0) tuned.process.lift_exchange = tuned_exchange(setup.printer, x);
  return tuned;
}

ScanTuneResult tune_by_scans(const std::vector<PrintScan>& prints, const Setup& setup,
                             const TunePrior& prior, const ScanTuneOptions& options,
                             const ExecutionContext& context) {
  if (prints.empty()) throw InputError("no scan; expected one or more");
  check_prior(prior);
  refuse_law(setup.resin, LawUse::scan_tuning);
  refuse_relative(setup.resin, "tuning by scans");
  return ScanFit(prints, setup, prior, options, context).solve(options.rounds);
}

}  // namespace slicecorr::resins
