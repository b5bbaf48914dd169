// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "parallel/silent.hpp"
#include "scan/coarse.hpp"
#include "scan/vectors.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

using namespace detail;

namespace {

constexpr std::size_t kChunk = 1024;
constexpr int kMostRounds = 60;
/// Points of the close search: more of them make the pose no better than the scan is.
constexpr std::size_t kClosePoints = 24'000;
constexpr std::size_t kCoarsePoints = 400;

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

/// A point with the nearest place, and the way in which the distance grows.
struct Residual {
  Point3 at{}, way{};
  double off_mm = 0;
  bool near = false;
};

/// Points, and where known which way their surface faces.
struct ScanPoints {
  std::vector<Point3> points, normals;
};

std::vector<Residual> residuals_of(const ScanPoints& scan, const MeshDistance& distance,
                                   const Pose& pose, double reach_mm,
                                   const ExecutionContext& context) {
  const std::vector<Point3>& points = scan.points;
  std::vector<Residual> found(points.size());
  const std::size_t chunks = (points.size() + kChunk - 1) / kChunk;
  parallel_for(silent(context), "", chunks, [&](std::size_t chunk) {
    const std::size_t end = std::min(points.size(), (chunk + 1) * kChunk);
    for (std::size_t i = chunk * kChunk; i < end; ++i) {
      const Point3 p = pose.of(points[i]);
      const std::optional<NearestPlace> place = distance.nearest(p, reach_mm);
      if (!place) continue;
      // What faces the other way is another surface: a support beside a wall, the back of a thin one.
      if (!scan.normals.empty() && product(pose.turned(scan.normals[i]), place->normal) < -0.2) {
        continue;
      }
      // The gradient of the distance; on the surface itself its normal.
      const Point3 off = difference(p, place->point);
      const double size = length(off);
      const Point3 way =
          size > 1e-9 ? scaled(off, std::copysign(1 / size, place->signed_mm)) : place->normal;
      found[i] = {p, way, place->signed_mm, true};
    }
  });
  return found;
}

struct Close {
  Pose pose;
  int rounds = 0;
};

/// The weight of a point so many standard deviations away: Cauchy's, which leads from far away, or Tukey's, which forgets
/// what lies beyond 4.685 of them.
double weight_of(double deviations, bool last) {
  if (!last) return 1 / (1 + deviations * deviations / (2.385 * 2.385));
  const double share = deviations * deviations / (4.685 * 4.685);
  return share < 1 ? (1 - share) * (1 - share) : 0;
}

/// Distances made least, from `begin` on.
Close close_search(const ScanPoints& points, const MeshDistance& distance, const Pose& begin,
                   double reach_mm, int most, const ExecutionContext& context) {
  Close found{begin, 0};
  bool last = false;
  for (; found.rounds < most; ++found.rounds) {
    context.check_cancelled();
    const std::vector<Residual> residuals =
        residuals_of(points, distance, found.pose, reach_mm, context);
    std::vector<double> off;
    Point3 middle{};
    for (const Residual& r : residuals) {
      if (!r.near) continue;
      off.push_back(std::abs(r.off_mm));
      middle = sum(middle, r.at);
    }
    if (off.size() < 12) break;
    middle = scaled(middle, 1 / static_cast<double>(off.size()));
    const double deviation = std::max(1.4826 * value_at(off, 0.5), 1e-6 * reach_mm);
    Matrix6 a = Matrix6::Zero();
    Vector6 b = Vector6::Zero();
    for (const Residual& r : residuals) {
      if (!r.near) continue;
      const Point3 arm = crossed(difference(r.at, middle), r.way);
      Vector6 row;
      row << arm[0], arm[1], arm[2], r.way[0], r.way[1], r.way[2];
      const double weight = weight_of(r.off_mm / deviation, last);
      a += weight * row * row.transpose();
      b -= weight * r.off_mm * row;
    }
    // Turns and shifts that change nothing, of a cylinder about its axis, are left as they are.
    a.diagonal() += 1e-9 * a.diagonal() + Vector6::Constant(1e-12 * a.trace());
    const Vector6 step = a.ldlt().solve(b);
    if (!step.allFinite()) break;
    const Eigen::Vector3d turn = step.head<3>();
    const double angle = turn.norm();
    const Eigen::Matrix3d rotation = angle > 0
                                         ? Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix()
                                         : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
    Pose next = found.pose;
    const Point3 arm = difference(found.pose.shift, middle);
    for (std::size_t i = 0; i < 3; ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      next.shift[i] = middle[i] + step[3 + row];
      for (std::size_t j = 0; j < 3; ++j) {
        next.turn[i][j] = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          next.turn[i][j] += rotation(row, static_cast<Eigen::Index>(k)) * found.pose.turn[k][j];
        }
        next.shift[i] += rotation(row, static_cast<Eigen::Index>(j)) * arm[j];
      }
    }
    found.pose = next;
    if (angle < 1e-9 && step.tail<3>().norm() < 1e-8 * reach_mm) break;
    // Where little moves any more, what is no part of the print is left out altogether.
    last = last || (angle < 1e-4 && step.tail<3>().norm() < 1e-3 * reach_mm);
  }
  return found;
}

ScanPoints thinned(const Scan& scan, std::size_t count) {
  ScanPoints out;
  const std::size_t all = scan.points.size(), taken = std::min(count, all);
  for (std::size_t i = 0; i < taken; ++i) {
    out.points.push_back(scan.points[i * all / taken]);
    if (!scan.normals.empty()) out.normals.push_back(scan.normals[i * all / taken]);
  }
  return out;
}

struct Found {
  Pose pose;
  double median_mm = 0, within = 0, rating = 1;
  int rounds = 0;
};

/// Distances after a pose: their median among all points, those beyond reach counted as reach.
Found judged(const ScanPoints& points, const MeshDistance& distance, const Close& close,
             double reach_mm, const ExecutionContext& context) {
  Found found;
  found.pose = close.pose;
  found.rounds = close.rounds;
  std::vector<double> off;
  double squares = 0;
  for (const Residual& r : residuals_of(points, distance, close.pose, reach_mm, context)) {
    off.push_back(r.near ? std::abs(r.off_mm) : reach_mm);
    found.within += r.near ? 1 : 0;
    squares += off.back() * off.back();
  }
  found.within /= static_cast<double>(points.points.size());
  found.rating = squares / (reach_mm * reach_mm * static_cast<double>(points.points.size()));
  found.median_mm = value_at(off, 0.5);
  return found;
}

/// The best pose of all candidates, each searched closely from.
Found best_pose(const OrientedPoints& points, const CoarseTarget& target,
                const MeshDistance& distance, double reach_mm, const ExecutionContext& context) {
  const std::vector<RatedPose> candidates = target.candidates(points, context);
  const ScanPoints all{points.points, {}};
  std::vector<Found> found(candidates.size());
  parallel_for(silent(context), "", candidates.size(), [&](std::size_t i) {
    ExecutionContext one = silent(context);
    one.threads = 1;
    // From far to near: a wide reach first finds the way.
    Close close = close_search(all, distance, candidates[i].pose, 3 * reach_mm, 8, one);
    close = close_search(all, distance, close.pose, reach_mm, 8, one);
    found[i] = judged(all, distance, close, 0.4 * reach_mm, one);
  });
  return *std::min_element(found.begin(), found.end(),
                           [](const Found& a, const Found& b) { return a.rating < b.rating; });
}

/// How far points lie from the surface: the mean square of distances, none counted as more than `most_mm`.
double mean_square_mm2(const ScanPoints& points, const MeshDistance& distance, const Pose& pose,
                       double most_mm, const ExecutionContext& context) {
  double squares = 0;
  for (const Residual& r : residuals_of(points, distance, pose, most_mm, context)) {
    const double mm = r.near ? std::min(std::abs(r.off_mm), most_mm) : most_mm;
    squares += mm * mm;
  }
  return squares / static_cast<double>(points.points.size());
}

/// Looks closely whether the mirror image fits better: parts whose halves differ by little fit both ways.
/// A print fits its own part best, whatever it is off by, and a symmetric part both ways alike.
void check_mirror_image(const std::string& source, const ScanPoints& points,
                        const MeshDistance& distance, const Found& found, const Found& other,
                        double reach_mm, const ExecutionContext& context) {
  ScanPoints mirrored = points;
  for (auto* list : {&mirrored.points, &mirrored.normals}) {
    for (Point3& p : *list) p[0] = -p[0];
  }
  const Found close =
      judged(mirrored, distance,
             close_search(mirrored, distance, other.pose, reach_mm, kMostRounds, context), reach_mm,
             context);
  // What differs shows as more than the scatter of the one that fits.
  const double most_mm = 6 * std::max(std::min(found.median_mm, close.median_mm), 1e-4 * reach_mm);
  const double as_it_is = mean_square_mm2(points, distance, found.pose, most_mm, context);
  const double turned = mean_square_mm2(mirrored, distance, close.pose, most_mm, context);
  constexpr double surely = 1.5, perhaps = 1.15;
  if (as_it_is < perhaps * turned) return;
  const std::string words = fmt::format(
      "fits better as its mirror image: its points then lie {:.3g} um from the surface (rms, "
      "none counted as more than {:.3g} um), as it is {:.3g} um",
      1e3 * std::sqrt(turned), 1e3 * most_mm, 1e3 * std::sqrt(as_it_is));
  if (as_it_is > surely * turned) {
    throw InputError(source, "",
                     words + "; expected a scan that is not mirrored, of a print that is not");
  }
  context.tell(source + ": " + words + ": is it mirrored, or the printer's display?");
}

}  // namespace

Registration register_scan(const Scan& scan, const TriangleMesh& surface,
                           const MeshDistance& distance, const ExecutionContext& context) {
  const CoarseTarget target(surface);
  const double reach = 0.05 * target.diagonal();
  const OrientedPoints points = oriented(scan.points, scan.normals, kCoarsePoints);
  OrientedPoints mirrored = points;
  for (auto* list : {&mirrored.points, &mirrored.normals}) {
    for (Point3& p : *list) p[0] = -p[0];
  }
  const Found coarse = best_pose(points, target, distance, reach, context);
  const Found other = best_pose(mirrored, target, distance, reach, context);
  ScanPoints close_points = thinned(scan, kClosePoints);
  // Meshes whose triangles face inwards, or either way, say nothing of what faces where.
  const Close begin{coarse.pose, 0};
  const double facing = judged(close_points, distance, begin, reach, context).within;
  const bool sided =
      !close_points.normals.empty() &&
      facing > 0.75 * judged({close_points.points, {}}, distance, begin, reach, context).within;
  if (!sided) close_points.normals.clear();
  const Found found =
      judged(close_points, distance,
             close_search(close_points, distance, coarse.pose, reach, kMostRounds, context), reach,
             context);
  Registration r;
  r.pose = found.pose;
  r.rounds = found.rounds;
  r.sided = sided;
  r.median_um = 1e3 * found.median_mm;
  r.within_share = found.within;
  r.reach_um = 1e3 * reach;
  r.mirrored_um = 1e3 * other.median_mm;
  if (coarse.rating > 2 * other.rating && coarse.rating > 2e-3) {
    throw InputError(
        scan.source, "",
        fmt::format("fits as its mirror image: half of its points then lie within {:.4g} um of the "
                    "surface, as it is within {:.4g} um; expected a scan that is not mirrored",
                    r.mirrored_um, 1e3 * coarse.median_mm));
  }
  const double most_mm = 0.01 * target.diagonal() + 0.05;
  if (found.median_mm > most_mm || found.within < 0.5) {
    throw InputError(
        scan.source, "",
        fmt::format(
            "is another part, or mostly something else: where it fits best, {:.3g} % of its points lie "
            "within {:.4g} mm of the surface, half of all within {:.4g} um; expected half within "
            "{:.4g} um",
            100 * found.within, reach, r.median_um, 1e3 * most_mm));
  }
  check_mirror_image(scan.source, close_points, distance, found, other, reach, context);
  return r;
}

}  // namespace slicecorr
