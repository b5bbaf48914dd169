// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tune/scan_print.hpp"

#include <algorithm>
#include <cmath>

#include "slicecorr/place_models.hpp"
#include "tune/near_places.hpp"

namespace slicecorr::resins {

using Eigen::Vector3d;

namespace {

/// To which surfaces are known where they move by less, mm: vertices are rounded to a thousandth of a layer.
constexpr double kRoundingMm = 3e-4;
/// Where an input changes by a step of its difference, surfaces that have a derivative move by less: so many pixels, and
/// mm.
constexpr double kMovesPixels = 4, kMovesMm = 0.2;
/// A surface is sought so many times as far from points as 95 % of them lie from it.
constexpr double kAsideTimes = 4;
/// Where fewer points than this share of what it was have a surface that near, all that is within reach is drawn.
constexpr double kLostShare = 0.98;
/// Steepness below which first layers stand out less than walls do (as solid/after_print.cpp has it).
constexpr double kWallSteep = 0.5;

PlaceModels models_of(const SliceSource& shown, const Setup& setup) {
  return {setup.printer, setup.resin, setup.process, shown.grid(), shown.frame()};
}

template <class Body>
void over_points(const std::vector<std::size_t>& points, const ExecutionContext& context,
                 const Body& body) {
  constexpr std::size_t chunk_points = 512;
  parallel_for(context, "", (points.size() + chunk_points - 1) / chunk_points,
               [&](std::size_t chunk) {
                 const std::size_t end = std::min(points.size(), (chunk + 1) * chunk_points);
                 for (std::size_t i = chunk * chunk_points; i < end; ++i) body(points[i]);
               });
}

/// The gradient of the distance of a point; on the surface itself its normal.
Vector3d way_of(const Point3& p, const NearestPlace& near) {
  const Vector3d off = vector_of(p) - vector_of(near.point);
  const double size = off.norm();
  if (size < 1e-9) return vector_of(near.normal);
  return off * std::copysign(1 / size, near.signed_mm);
}

}  // namespace

ScanPrint::ScanPrint(const PrintScan& print, const Setup& setup, const ScanInputs& inputs,
                     const ScanTuneOptions& options, const ExecutionContext& context)
    : shown_(*print.shown), setup_(setup), inputs_(inputs) {
  if (print.process) setup_.process = *print.process;
  ScanVector mean{};
  for (std::size_t k = 0; k < kScanInputs; ++k) {
    mean[k] = inputs.mean()[static_cast<Eigen::Index>(k)];
  }
  const Setup begin = inputs.setup_at(setup_, mean);
  const SolidSize size = size_of_solid(shown_, models_of(shown_, setup_), context);
  strips_ = std::max(1, static_cast<int>(std::ceil(size.triangles(1) / options.most_triangles)));
  SolidOptions coarse;
  coarse.reduce = size.reduction(options.most_triangles);
  {
    const TriangleMesh surface = solid_mesh(shown_, models_of(shown_, begin), coarse, context);
    registration_ = register_scan(*print.scan, surface, MeshDistance(surface), context);
    Point3 low, high;
    low.fill(1e300);
    high.fill(-1e300);
    widen_box(surface, low, high);
    diagonal_ = (vector_of(high) - vector_of(low)).norm();
    middle_ = {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0};
  }
  reach_ = 1e-3 * registration_.reach_um;
  aside_ = reach_;
  const std::size_t all = print.scan->points.size(), taken = std::min(options.points, all);
  for (std::size_t i = 0; i < taken; ++i) {
    points_.push_back(print.scan->points[i * all / taken]);
    if (registration_.sided) normals_.push_back(print.scan->normals[i * all / taken]);
  }
  derived_.resize(taken);
}

Point3 ScanPrint::unshrunk(std::size_t i, const ScanVector& change) const {
  Point3 p = registration_.pose.of(points_[i]);
  for (std::size_t k = 0; k < 3; ++k) {
    const double shrunk = change[at(k < 2 ? ScanInput::shrinkage_plane : ScanInput::shrinkage_z)];
    p[k] = middle_[k] + (p[k] - middle_[k]) / (1 - shrunk);
  }
  return p;
}

std::vector<ScanPrint::Strip> ScanPrint::strips(const ScanVector& change) const {
  std::vector<Strip> strips(static_cast<std::size_t>(strips_));
  const PixelBox lit = shown_.bounds();
  const double each = static_cast<double>(lit.height()) / strips_;
  for (int s = 0; s < strips_; ++s) {
    strips[static_cast<std::size_t>(s)].rows = {lit.y0 + s * each, lit.y0 + (s + 1) * each};
  }
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const Point3 p = unshrunk(i, change);
    const double strip = std::floor((image_row_of(shown_, p[0], p[1]) - lit.y0) / each);
    strips[static_cast<std::size_t>(std::clamp(strip, 0.0, strips_ - 1.0))].points.push_back(i);
  }
  return strips;
}

std::optional<MeshDistance> ScanPrint::predicted(const ScanVector& change, const Strip& strip,
                                                 const Around& around,
                                                 const ExecutionContext& context) const {
  SolidOptions options;
  if (strips_ > 1) {
    // Far enough that no point of a strip has its nearest place beyond it; a file's shrinkage moves rows a little.
    const Grid& g = shown_.grid();
    const double beside =
        std::ceil(1.2e3 * around.within_mm / std::min(g.pixel_x_um, g.pixel_y_um)) + 8;
    options.rows = {static_cast<int>(strip.rows[0] - beside),
                    static_cast<int>(strip.rows[1] + beside) + 1};
  }
  const NearPlaces near(around.places, around.within_mm);
  options.wanted = [&](const Point3& low, const Point3& high) { return near.meets(low, high); };
  const TriangleMesh mesh =
      solid_mesh(shown_, models_of(shown_, inputs_.setup_at(setup_, change)), options, context);
  if (mesh.triangles.empty()) return {};
  return MeshDistance(mesh);
}

void ScanPrint::begin_rows(const std::vector<Strip>& strips, const ScanState& state,
                           std::vector<ScanRow>& rows, const ExecutionContext& context) const {
  std::fill(rows.begin(), rows.end(), ScanRow{});
  for (const Strip& strip : strips) {
    if (strip.points.empty()) continue;
    Around around{{}, aside_};
    for (const std::size_t i : strip.points) around.places.push_back(unshrunk(i, state.change));
    const std::optional<MeshDistance> now = predicted(state.change, strip, around, context);
    if (!now) continue;
    over_points(strip.points, context, [&](std::size_t i) { begin_row(*now, state, i, rows[i]); });
  }
}

double ScanPrint::least_aside_mm(const ScanState& state) const {
  const Grid& g = shown_.grid();
  const double moves =
      std::max(kMovesMm, 1e-3 * kMovesPixels * std::max(g.pixel_x_um, g.pixel_y_um));
  // What is beside a point is looked at, too.
  return std::min(reach_, std::max(moves, 6 * state.flat_mm + 0.05));
}

/// How far surfaces are sought from points from now on.
void ScanPrint::look_aside(const ScanState& state, const std::vector<ScanRow>& rows) {
  std::vector<double> off;
  for (const ScanRow& row : rows) {
    if (row.near_mm >= 0) off.push_back(row.near_mm);
  }
  found_ = std::max(found_, off.size());
  if (off.empty()) return;
  const auto most =
      off.begin() + static_cast<std::ptrdiff_t>(0.95 * static_cast<double>(off.size() - 1));
  std::nth_element(off.begin(), most, off.end());
  aside_ = std::clamp(kAsideTimes * *most, least_aside_mm(state), reach_);
}

std::vector<ScanRow> ScanPrint::rows(const ScanState& state, const ExecutionContext& context) {
  std::vector<ScanRow> rows(points_.size());
  const std::vector<Strip> all = strips(state.change);
  aside_ = std::max(aside_, least_aside_mm(state));
  begin_rows(all, state, rows, context);
  const auto found =
      std::count_if(rows.begin(), rows.end(), [](const ScanRow& row) { return row.near_mm >= 0; });
  if (aside_ < reach_ && static_cast<double>(found) < kLostShare * static_cast<double>(found_)) {
    aside_ = reach_;
    begin_rows(all, state, rows, context);
  }
  look_aside(state, rows);
  if (state.anew) {
    std::fill(derived_.begin(), derived_.end(), Derived{});
    for (const Strip& strip : all) derive(strip, state, rows, context);
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    ScanRow& row = rows[i];
    row.counts = row.counts && derived_[i].state == Derived::State::good;
    for (std::size_t k = 0; k < kScanInputs; ++k) {
      if (inputs_.predicted(k)) row.by[k] = static_cast<double>(derived_[i].by[k]);
    }
  }
  return rows;
}

void ScanPrint::derive(const Strip& strip, const ScanState& state, const std::vector<ScanRow>& rows,
                       const ExecutionContext& context) {
  Around around{{}, least_aside_mm(state)};
  for (const std::size_t i : strip.points) {
    if (!rows[i].counts) continue;
    derived_[i].state = Derived::State::good;
    around.places.push_back(rows[i].place);
  }
  if (around.places.empty()) return;
  for (std::size_t k = 0; k < kScanInputs; ++k) {
    if (!inputs_.predicted(k)) continue;
    const std::array<double, 2> steps = inputs_.steps(k, state.change[k]);
    std::vector<std::array<double, 2>> off(points_.size());
    for (const std::size_t side : {std::size_t{0}, std::size_t{1}}) {
      if (!(steps[side] > 0)) continue;
      ScanVector there = state.change;
      there[k] += side ? steps[1] : -steps[0];
      const std::optional<MeshDistance> other = predicted(there, strip, around, context);
      over_points(strip.points, context, [&](std::size_t i) {
        if (!rows[i].counts) return;
        const auto near =
            other ? other->nearest(rows[i].place, around.within_mm) : std::optional<NearestPlace>{};
        off[i][side] = near ? near->signed_mm : 2 * reach_;
      });
    }
    const bool both = steps[0] > 0 && steps[1] > 0;
    for (const std::size_t i : strip.points) {
      Derived& d = derived_[i];
      if (d.state != Derived::State::good) continue;
      // A surface that comes and goes moves to one side alone, or far: no derivative says when. What is left is straight
      // to a third, but for the rounding of vertices.
      const double minus = off[i][0], plus = off[i][1],
                   most = std::max(std::abs(minus), std::abs(plus));
      if (most > reach_ || (both && std::abs(plus + minus) > 0.3 * most + kRoundingMm)) {
        d.state = Derived::State::comes_and_goes;
        continue;
      }
      // What moves outwards has the point inside: its distance to it falls.
      d.by[k] = static_cast<float>((plus - minus) / (steps[0] + steps[1]));
    }
  }
}

void ScanPrint::begin_row(const MeshDistance& now, const ScanState& state, std::size_t i,
                          ScanRow& row) const {
  // As long as it would be had it not shrunk.
  const Point3 p = unshrunk(i, state.change);
  const auto near = now.nearest(p, aside_);
  if (!near) return;
  row.near_mm = std::abs(near->signed_mm);
  const Vector3d normal = vector_of(near->normal);
  if (!normals_.empty() && vector_of(registration_.pose.turned(normals_[i])).dot(normal) < -0.2) {
    return;
  }
  if (state.flat_mm > 0 && !flat_around(now, p, normal, state.flat_mm)) return;
  const Vector3d way = way_of(p, *near);
  // From the surface: noise of the point in what it is multiplied with would make the part larger.
  const Vector3d arm = vector_of(near->point) - vector_of(middle_);
  const double level = std::hypot(near->normal[0], near->normal[1]);
  const double first =
      level * std::min(1.0, level / kWallSteep) * std::max(0.0, 1 - near->point[2] / first_mm());
  row.place = near->point;
  row.by[at(ScanInput::shrinkage_plane)] = way[0] * arm[0] + way[1] * arm[1];
  row.by[at(ScanInput::shrinkage_z)] = way[2] * arm[2];
  row.by[at(ScanInput::walls)] = -level;
  row.by[at(ScanInput::first_layers)] = -first;
  const Vector3d turn = arm.cross(way);
  for (int k = 0; k < 3; ++k) {
    row.by[kScanInputs + static_cast<std::size_t>(k)] = turn[k];
    row.by[kScanInputs + 3 + static_cast<std::size_t>(k)] = way[k];
  }
  row.off_mm = near->signed_mm - level * state.change[at(ScanInput::walls)] -
               first * inputs_.growth_left_mm(state.change[at(ScanInput::first_layers)]);
  row.counts = true;
}

/// Whether the surface faces the same way so far aside. Beside an edge noise lets points lie outside more than inside,
/// and edges all around would make the part larger.
bool ScanPrint::flat_around(const MeshDistance& now, const Point3& p, const Vector3d& normal,
                            double aside_mm) const {
  const Vector3d across =
      normal.cross(std::abs(normal[2]) < 0.7 ? Vector3d::UnitZ() : Vector3d::UnitX()).normalized();
  const Vector3d along = normal.cross(across);
  for (const Vector3d& way : {across, Vector3d(-across), along, Vector3d(-along)}) {
    const Vector3d there = vector_of(p) + aside_mm * way;
    const auto near = now.nearest({there[0], there[1], there[2]}, 4 * aside_mm + 0.05);
    if (!near || vector_of(near->normal).dot(normal) < 0.9) return false;
  }
  return true;
}

void ScanPrint::move(const Vector3d& turn, const Vector3d& shift) {
  const double angle = turn.norm();
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  if (angle > 0) rotation = Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
  Pose& pose = registration_.pose;
  Eigen::Matrix3d now;
  for (std::size_t i = 0; i < 3; ++i) {
    now.row(static_cast<Eigen::Index>(i)) = vector_of(pose.turn[i]);
  }
  const Vector3d middle = vector_of(middle_);
  const Vector3d moved = rotation * (vector_of(pose.shift) - middle) + middle + shift;
  now = Eigen::Matrix3d(rotation * now);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    pose.turn[i] = {now(row, 0), now(row, 1), now(row, 2)};
    pose.shift[i] = moved[row];
  }
}

}  // namespace slicecorr::resins
