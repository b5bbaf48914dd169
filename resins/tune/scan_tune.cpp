// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/scan_tune.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "slicecorr/error.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/solid.hpp"
#include "tune/matrix.hpp"
#include "tune/printed_resin.hpp"

namespace slicecorr::resins {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kShrinkPlane = 4, kShrinkZ = 5, kWalls = 6, kFirstLayers = 7;
/// What is known of shrinkage and offsets before any scan: a share, and mm.
constexpr double kShrinkageSd = 0.01, kWallsSdMm = 0.03, kFirstSdMm = 0.1;
/// Differences are taken over this share of the standard deviation before.
constexpr double kDifferenceStep = 0.2;
/// The least noise that points are believed to have, mm: edges of predicted surfaces are as sharp.
constexpr double kLeastNoiseMm = 5e-4;
/// To which surfaces are known where they move by less, mm: vertices are rounded to a thousandth of a layer.
constexpr double kRoundingMm = 3e-4;
/// Of a predicted surface: what is more is taken at every second pixel (third, ...), where walls are rougher.
constexpr double kMostTriangles = 5e6;
constexpr std::size_t kMostUnexplained = 5;
/// A cube of fewer points says nothing of itself.
constexpr std::size_t kLeastInCube = 8;

Eigen::Vector3d vector_of(const Point3& p) { return {p[0], p[1], p[2]}; }

/// The surface that is printed when inputs are so.
struct PredictedSurface {
  TriangleMesh mesh;
  std::optional<MeshDistance> distance;
};

/// A point after the pose, with all that moves its distance.
struct ScanRow {
  Point3 place{};
  std::array<double, kScanInputs + 6> by{};  ///< of the distance, mm
  double off_mm = 0;
  bool counts = false;
  bool apart = false;  ///< lies where something else sticks to the surface: pulls at nothing
};

/// One print: its scan's points, pose and frame.
struct ScannedPrint {
  const SliceSource* shown;
  Setup setup;                          ///< as it was printed, by what was believed
  bool layerwise = false;               ///< with lifts that exchange resin
  std::vector<Point3> points, normals;  ///< normals where they are heeded
  Registration registration;
  Point3 middle{};  ///< about which it shrinks in the plane; z from the platform
  double diagonal = 0, reach = 0;
  int reduce = 1;  ///< the same for all its surfaces, or they would differ by it
};

class ScanFit {
 public:
  ScanFit(const std::vector<PrintScan>& prints, const Setup& setup, const TunePrior& prior,
          const ScanTuneOptions& options, const ExecutionContext& context)
      : setup_(setup),
        context_(context),
        quiet_(context),
        unknowns_(static_cast<Index>(kScanInputs + 6 * prints.size())) {
    first_mm_ = 1e-3 * setup.resin.shrinkage.height_um;
    quiet_.progress = nullptr;
    before_ = MatrixXd::Zero(kScanInputs, kScanInputs);
    before_.topLeftCorner(kUnknowns, kUnknowns) = matrix_of(prior.covariance);
    const auto square = [](double sd) { return sd * sd; };
    before_(kShrinkPlane, kShrinkPlane) = before_(kShrinkZ, kShrinkZ) = square(kShrinkageSd);
    before_(kWalls, kWalls) = square(kWallsSdMm);
    before_(kFirstLayers, kFirstLayers) = square(kFirstSdMm);
    mean_ = VectorXd::Zero(kScanInputs);
    for (std::size_t k = 0; k < kTuned; ++k) mean_[static_cast<Index>(k)] = prior.mean[k];
    theta_ = mean_;
    for (const PrintScan& p : prints) add(p, options.points);
  }

  ScanTuneResult solve(int rounds) {
    ScanTuneResult result;
    for (int round = 0; round < rounds; ++round) {
      context_.report("tuning by scans", static_cast<double>(round) / rounds);
      linearise();
      if (round == 0) result.before_um = 1e3 * smooth_mm(*this);
      noise_mm_ = noise();
      const VectorXd step = solve_step();
      take(step);
      // A tenth of a standard deviation before is less than what linear surfaces are right to.
      double most = 0;
      for (Index k = 0; k < static_cast<Index>(kScanInputs); ++k) {
        most = std::max(most, std::abs(step[k]) / std::sqrt(before_(k, k)));
      }
      if (most < 0.01 && last_) break;
      // Only near to the answer may what lies far off be forgotten: far from it, that is the whole of what is off.
      last_ = most < 0.1 || round > 2;
    }
    last_ = true;
    linearise();
    finish(result);
    context_.report("tuning by scans", 1);
    return result;
  }

 private:
  void add(const PrintScan& p, std::size_t most) {
    ScannedPrint print{p.shown, setup_, false, {}, {}, {}, {}, 0, 0, 1};
    if (p.process) print.setup.process = *p.process;
    const Process& process = print.setup.process;
    print.layerwise = process.mode == ExposureMode::layerwise && process.lifts == Lifts::each;
    layerwise_ = layerwise_ || print.layerwise;
    print.reduce =
        size_of_solid(*p.shown, models_of(*p.shown, print.setup), quiet_).reduction(kMostTriangles);
    if (print.reduce > 1) {
      context_.tell(fmt::format(
          "what is predicted to print is taken at one pixel in {} along x and y: walls are known "
          "to as much",
          print.reduce));
    }
    const PredictedSurface now = predicted(print, x());
    print.registration = register_scan(*p.scan, now.mesh, *now.distance, quiet_);
    print.reach = 1e-3 * print.registration.reach_um;
    Point3 low, high;
    low.fill(1e300);
    high.fill(-1e300);
    widen_box(now.mesh, low, high);
    print.diagonal = (vector_of(high) - vector_of(low)).norm();
    print.middle = {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0};
    const std::size_t all = p.scan->points.size(), taken = std::min(most, all);
    for (std::size_t i = 0; i < taken; ++i) {
      print.points.push_back(p.scan->points[i * all / taken]);
      if (print.registration.sided) print.normals.push_back(p.scan->normals[i * all / taken]);
    }
    prints_.push_back(std::move(print));
  }

  static PlaceModels models_of(const SliceSource& shown, const Setup& setup) {
    return {setup.printer, setup.resin, setup.process, shown.grid(), shown.frame()};
  }

  PredictedSurface predicted(const ScannedPrint& print, const TuneVector& x) const {
    SolidOptions options;
    options.reduce = print.reduce;
    PredictedSurface p{
        solid_mesh(*print.shown, models_of(*print.shown, tuned_setup(print.setup, x)), options,
                   quiet_),
        {}};
    p.distance.emplace(p.mesh);
    return p;
  }

  TuneVector x() const {
    TuneVector x{};
    for (std::size_t k = 0; k < kTuned; ++k) x[k] = theta_[static_cast<Index>(k)];
    return x;
  }

  /// Points with their distances and derivatives at what is believed now.
  void linearise() {
    rows_.clear();
    for (const ScannedPrint& print : prints_) {
      std::vector<ScanRow> rows = rows_of(print);
      rows_.push_back(std::move(rows));
    }
    if (last_) set_apart();
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

  std::vector<ScanRow> rows_of(const ScannedPrint& print) const {
    std::vector<ScanRow> rows(print.points.size());
    std::vector<Point3> on_surface(rows.size());
    {
      const PredictedSurface now = predicted(print, x());
      over_points(rows.size(),
                  [&](std::size_t i) { begin_row(print, now, i, rows[i], on_surface[i]); });
    }
    for (std::size_t k = 0; k < kTuned; ++k) {
      if (k == kExchange && !print.layerwise) continue;
      const double sd = std::sqrt(before_(static_cast<Index>(k), static_cast<Index>(k)));
      std::vector<std::array<double, 2>> off(rows.size());
      for (const int side : {0, 1}) {
        TuneVector there = x();
        there[k] += (side ? 1 : -1) * kDifferenceStep * sd;
        const PredictedSurface other = predicted(print, there);
        over_points(rows.size(), [&](std::size_t i) {
          if (!rows[i].counts) return;
          const auto near = other.distance->nearest(on_surface[i], print.reach);
          off[i][static_cast<std::size_t>(side)] = near ? near->signed_mm : 2 * print.reach;
        });
      }
      for (std::size_t i = 0; i < rows.size(); ++i) {
        // A surface that comes and goes moves to one side alone, or far: no derivative says when. What is left is
        // straight to a third, but for the rounding of vertices.
        const double minus = off[i][0], plus = off[i][1],
                     most = std::max(std::abs(minus), std::abs(plus));
        if (most > print.reach || std::abs(plus + minus) > 0.3 * most + kRoundingMm) {
          rows[i].counts = false;
          continue;
        }
        // What moves outwards has the point inside: its distance to it falls.
        rows[i].by[k] = (off[i][1] - off[i][0]) / (2 * kDifferenceStep * sd);
      }
    }
    return rows;
  }

  template <class Body>
  void over_points(std::size_t count, const Body& body) const {
    constexpr std::size_t chunk_points = 512;
    parallel_for(quiet_, "", (count + chunk_points - 1) / chunk_points, [&](std::size_t chunk) {
      for (std::size_t i = chunk * chunk_points; i < std::min(count, (chunk + 1) * chunk_points);
           ++i) {
        body(i);
      }
    });
  }

  void begin_row(const ScannedPrint& print, const PredictedSurface& now, std::size_t i,
                 ScanRow& row, Point3& on_surface) const {
    Point3 p = print.registration.pose.of(print.points[i]);
    // As long as it would be had it not shrunk.
    for (std::size_t k = 0; k < 3; ++k) {
      const double shrunk = theta_[static_cast<Index>(k < 2 ? kShrinkPlane : kShrinkZ)];
      p[k] = print.middle[k] + (p[k] - print.middle[k]) / (1 - shrunk);
    }
    const auto near = now.distance->nearest(p, print.reach);
    if (!near) return;
    const Eigen::Vector3d normal = vector_of(near->normal);
    if (!print.normals.empty() &&
        vector_of(print.registration.pose.turned(print.normals[i])).dot(normal) < -0.2) {
      return;
    }
    if (last_ && !flat_around(now, p, normal)) return;
    const Eigen::Vector3d off = vector_of(p) - vector_of(near->point);
    const double size = off.norm();
    const Eigen::Vector3d way =
        size > 1e-9 ? Eigen::Vector3d(off * std::copysign(1 / size, near->signed_mm))
                    : vector_of(near->normal);
    // From the surface: noise of the point in what it is multiplied with would make the part larger.
    const Eigen::Vector3d arm = vector_of(near->point) - vector_of(print.middle);
    const double level = std::hypot(near->normal[0], near->normal[1]);
    const double first = level * std::max(0.0, 1 - near->point[2] / first_mm_);
    row.place = near->point;
    row.by[kShrinkPlane] = way[0] * arm[0] + way[1] * arm[1];
    row.by[kShrinkZ] = way[2] * arm[2];
    row.by[kWalls] = -level;
    row.by[kFirstLayers] = -first;
    const Eigen::Vector3d turn = arm.cross(way);
    for (int k = 0; k < 3; ++k) {
      row.by[kScanInputs + static_cast<std::size_t>(k)] = turn[k];
      row.by[kScanInputs + 3 + static_cast<std::size_t>(k)] = way[k];
    }
    row.off_mm = near->signed_mm - level * theta_[kWalls] - first * theta_[kFirstLayers];
    row.counts = true;
    on_surface = near->point;
  }

  /// Whether the surface faces the same way three standard deviations of noise aside. Beside an edge noise lets points
  /// lie outside more than inside, and edges all around would make the part larger.
  bool flat_around(const PredictedSurface& now, const Point3& p,
                   const Eigen::Vector3d& normal) const {
    const double aside = 3 * noise_mm_;
    const Eigen::Vector3d across =
        normal
            .cross(std::abs(normal[2]) < 0.7 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX())
            .normalized();
    const Eigen::Vector3d along = normal.cross(across);
    for (const Eigen::Vector3d& way :
         {across, Eigen::Vector3d(-across), along, Eigen::Vector3d(-along)}) {
      const Eigen::Vector3d there = vector_of(p) + aside * way;
      const auto near = now.distance->nearest({there[0], there[1], there[2]}, 4 * aside + 0.05);
      if (!near || vector_of(near->normal).dot(normal) < 0.9) return false;
    }
    return true;
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

  /// The weight of a row: Cauchy's in the first rounds, then Tukey's, which forgets what lies beyond 4.685 standard
  /// deviations.
  double weight(const ScanRow& row, double noise_mm) const {
    if (row.apart) return 0;
    const double share = row.off_mm / (last_ ? 4.685 : 2.385) / noise_mm;
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
      constexpr auto size = static_cast<Index>(kScanInputs + 6);
      MatrixXd own = MatrixXd::Zero(size, size);
      VectorXd pull = VectorXd::Zero(size);
      for (const ScanRow& row : rows_[p]) {
        if (!row.counts) continue;
        const double w =
            (slopes ? slope(row, noise_mm) : weight(row, noise_mm)) / (noise_mm * noise_mm);
        const Eigen::Map<const VectorXd> by(row.by.data(), size);
        own.selfadjointView<Eigen::Lower>().rankUpdate(by, w);
        pull -= w * row.off_mm * by;
      }
      own = MatrixXd(own.selfadjointView<Eigen::Lower>());
      for (Index i = 0; i < size; ++i) {
        const Index to = place(p, static_cast<std::size_t>(i));
        b[to] += pull[i];
        for (Index j = 0; j < size; ++j) a(to, place(p, static_cast<std::size_t>(j))) += own(i, j);
      }
    }
    const MatrixXd known = before_.inverse();
    constexpr auto inputs = static_cast<Index>(kScanInputs);
    a.topLeftCorner(inputs, inputs) += known;
    b.head(inputs) -= known * (theta_ - mean_);
    // A pose that no point holds is left as it is.
    a.diagonal().tail(unknowns_ - inputs).array() += 1e-3;
  }

  VectorXd solve_step() const {
    MatrixXd a;
    VectorXd b;
    sums(noise_mm_, false, a, b);
    VectorXd step = a.ldlt().solve(b);
    // Surfaces are believed to be linear over a standard deviation and a half before.
    double most = 1;
    for (Index k = 0; k < static_cast<Index>(kScanInputs); ++k) {
      most = std::max(most, std::abs(step[k]) / (1.5 * std::sqrt(before_(k, k))));
    }
    return step / most;
  }

  void take(const VectorXd& step) {
    theta_ += step.head(static_cast<Index>(kScanInputs));
    for (std::size_t p = 0; p < prints_.size(); ++p) {
      ScannedPrint& print = prints_[p];
      const Eigen::Vector3d turn = step.segment<3>(place(p, kScanInputs));
      const Eigen::Vector3d shift = step.segment<3>(place(p, kScanInputs + 3));
      const double angle = turn.norm();
      Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
      if (angle > 0) rotation = Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
      Pose& pose = print.registration.pose;
      Eigen::Matrix3d now;
      for (std::size_t i = 0; i < 3; ++i) now.row(static_cast<Index>(i)) = vector_of(pose.turn[i]);
      const Eigen::Vector3d middle = vector_of(print.middle);
      const Eigen::Vector3d moved = rotation * (vector_of(pose.shift) - middle) + middle + shift;
      now = Eigen::Matrix3d(rotation * now);
      for (std::size_t i = 0; i < 3; ++i) {
        const auto row = static_cast<Index>(i);
        pose.turn[i] = {now(row, 0), now(row, 1), now(row, 2)};
        pose.shift[i] = moved[row];
      }
    }
  }

  /// The cube of a twentieth of the diagonal in which a row lies.
  std::array<long, 4> cube_of(std::size_t print, const ScanRow& row) const {
    const double side = prints_[print].diagonal / 20;
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
  static double smooth_mm(const ScanFit& fit) {
    double squares = 0, points = 0;
    for (const auto& [at, cube] : fit.cubes()) {
      const auto n = static_cast<double>(cube.points);
      squares += cube.off_mm * cube.off_mm / n;
      points += n;
    }
    return points > 0 ? std::sqrt(squares / points) : 0;
  }

  /// The covariance of all unknowns: what points that are off together pull, not each alone.
  MatrixXd covariance(const MatrixXd& a, double noise_mm) const {
    std::map<std::array<long, 4>, VectorXd> pulls;
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      for (const ScanRow& row : rows_[p]) {
        if (!row.counts) continue;
        VectorXd& pull =
            pulls.try_emplace(cube_of(p, row), VectorXd::Zero(unknowns_)).first->second;
        const double w = weight(row, noise_mm) * row.off_mm / (noise_mm * noise_mm);
        for (std::size_t k = 0; k < row.by.size(); ++k) pull[place(p, k)] += w * row.by[k];
      }
    }
    MatrixXd meat = MatrixXd::Zero(unknowns_, unknowns_);
    for (const auto& [at, pull] : pulls) meat += pull * pull.transpose();
    // Cubes of which few are left say less of themselves than they should.
    const auto count = static_cast<double>(pulls.size());
    meat *= count / std::max(1.0, count - static_cast<double>(kScanInputs + 6));
    constexpr auto inputs = static_cast<Index>(kScanInputs);
    meat.topLeftCorner(inputs, inputs) += before_.inverse();
    const MatrixXd bread = a.ldlt().solve(MatrixXd::Identity(unknowns_, unknowns_));
    return bread * meat * bread.transpose();
  }

  void finish(ScanTuneResult& result) const {
    constexpr auto inputs = static_cast<Index>(kScanInputs);
    const double noise_mm = noise();
    MatrixXd a;
    VectorXd b;
    sums(noise_mm, true, a, b);
    const MatrixXd after = covariance(a, noise_mm);
    for (Index k = 0; k < inputs; ++k) {
      result.findings.push_back({theta_[k], std::sqrt(after(k, k)), std::sqrt(before_(k, k))});
    }
    result.tuned.x = x();
    const TunedMatrix own = after.topLeftCorner(kUnknowns, kUnknowns);
    result.tuned.covariance = matrix_of(own);
    const TunedMatrix prior = before_.topLeftCorner(kUnknowns, kUnknowns);
    result.tuned.gain_nat = 0.5 * std::log(prior.determinant() / own.determinant());
    result.noise_um = 1e3 * noise_mm;
    result.after_um = result.tuned.rms_um = 1e3 * smooth_mm(*this);
    for (const auto& rows : rows_) {
      for (const ScanRow& row : rows) ++(row.counts ? result.points : result.left_out);
    }
    result.tuned.used = result.points;
    if (layerwise_ && result.findings[kExchange].sd < 0.15) {
      result.tuned.lift_exchange = tuned_exchange(setup_.printer, result.tuned.x);
    }
    result.tuned.shrinkage = found_shrinkage(result.findings, setup_.resin.shrinkage);
    for (const ScannedPrint& print : prints_) result.registrations.push_back(print.registration);
    say_not_apart(a, result);
    std::vector<Unexplained> places;
    for (const auto& [at, cube] : cubes()) {
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
    constexpr auto inputs = static_cast<Index>(kScanInputs);
    const Index poses = unknowns_ - inputs;
    const MatrixXd cross = a.topRightCorner(inputs, poses);
    MatrixXd told = a.topLeftCorner(inputs, inputs) - before_.inverse() -
                    cross * a.bottomRightCorner(poses, poses).ldlt().solve(cross.transpose());
    const VectorXd sd = before_.diagonal().cwiseSqrt();
    told = sd.asDiagonal() * told * sd.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(told);
    constexpr std::array<const char*, kScanInputs> names{
        "absorbance height", "light over dose",           "stray light",
        "exchange at lifts", "shrinkage in the plane",    "shrinkage along z",
        "offset of walls",   "growth of the first layers"};
    for (Index k = 0; k < inputs; ++k) {
      if (solver.eigenvalues()[k] > 3) continue;
      std::string words;
      for (Index i = 0; i < inputs; ++i) {
        const double share = solver.eigenvectors()(i, k);
        if (std::abs(share) < 0.25) continue;
        words += fmt::format("{}{} {:.2g}", words.empty() ? "" : ", ",
                             names[static_cast<std::size_t>(i)], share);
      }
      // The exchange at lifts is nothing that other prints have.
      if (!layerwise_ && words.starts_with("exchange") && words.find(',') == std::string::npos)
        continue;
      result.not_apart.push_back(words);
    }
  }

  const Setup& setup_;
  const ExecutionContext& context_;
  ExecutionContext quiet_;  ///< the same, whose stages are not told
  Index unknowns_;
  bool layerwise_ = false, last_ = false;
  double first_mm_ = 0;  ///< up to where the first layers grow
  double noise_mm_ = 0;
  MatrixXd before_;
  VectorXd mean_, theta_;  ///< known before, believed now
  std::vector<ScannedPrint> prints_;
  std::vector<std::vector<ScanRow>> rows_;
};

}  // namespace

std::optional<Shrinkage> found_shrinkage(const std::vector<ScanFinding>& findings,
                                         const Shrinkage& before) {
  Shrinkage now = before;
  const auto sure = [&](std::size_t k) {
    const ScanFinding& f = findings[k];
    return f.told() && std::abs(f.value) > 1.96 * f.sd;
  };
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
  return ScanFit(prints, setup, prior, options, context).solve(options.rounds);
}

}  // namespace slicecorr::resins
