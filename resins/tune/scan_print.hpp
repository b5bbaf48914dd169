// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The points of one print's scan beside what the print is predicted to be.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "slicecorr/solid.hpp"
#include "tune/scan_inputs.hpp"

namespace slicecorr::resins {

inline Eigen::Vector3d vector_of(const Point3& p) { return {p[0], p[1], p[2]}; }

/// All inputs, then the pose: a turn about `ScanPrint::middle`, and a shift.
inline constexpr std::size_t kRowUnknowns = kScanInputs + 6;

/// A point after the pose, with all that moves its distance.
struct ScanRow {
  Point3 place{};
  std::array<double, kRowUnknowns> by{};  ///< of the distance, mm
  double off_mm = 0;
  bool counts = false;
  double near_mm = -1;  ///< how far the surface is from the point; below 0 where there is none
  bool apart = false;   ///< lies where something else sticks to the surface: pulls at nothing
};

/// What rows are asked for at.
struct ScanState {
  ScanVector change{};
  bool anew = true;  ///< derivatives are taken anew; else those of before hold
  /// Above 0: points this near to an edge do not count, mm.
  double flat_mm = 0;
};

/// A print with its scan. What is predicted of a large one is made in strips of image rows, one after the other, so
/// that memory is that of a strip.
class ScanPrint {
 public:
  /// Throws as `register_scan`.
  ScanPrint(const PrintScan& print, const Setup& setup, const ScanInputs& inputs,
            const ScanTuneOptions& options, const ExecutionContext& context);

  std::vector<ScanRow> rows(const ScanState& state, const ExecutionContext& context);
  /// Turned about `middle`, then shifted.
  void move(const Eigen::Vector3d& turn, const Eigen::Vector3d& shift);

  const Registration& registration() const { return registration_; }
  /// About which it shrinks in the plane; z from the platform.
  const Point3& middle() const { return middle_; }
  double diagonal_mm() const { return diagonal_; }

 private:
  struct Derived {
    std::array<float, kScanInputs> by{};
    enum class State : std::uint8_t { unknown, good, comes_and_goes } state = State::unknown;
  };
  struct Strip {
    std::array<double, 2> rows{};  ///< of the image
    std::vector<std::size_t> points;
  };
  /// Where a surface is needed.
  struct Around {
    std::vector<Point3> places;
    double within_mm = 0;
  };
  std::vector<Strip> strips(const ScanVector& change) const;
  std::optional<MeshDistance> predicted(const ScanVector& change, const Strip& strip,
                                        const Around& around,
                                        const ExecutionContext& context) const;
  /// All rows without what is predicted to move them, of surfaces within `aside_mm` of points.
  void begin_rows(const std::vector<Strip>& strips, const ScanState& state,
                  std::vector<ScanRow>& rows, const ExecutionContext& context) const;
  void begin_row(const MeshDistance& now, const ScanState& state, std::size_t i,
                 ScanRow& row) const;
  double least_aside_mm(const ScanState& state) const;
  void look_aside(const ScanState& state, const std::vector<ScanRow>& rows);
  void derive(const Strip& strip, const ScanState& state, const std::vector<ScanRow>& rows,
              const ExecutionContext& context);
  Point3 unshrunk(std::size_t i, const ScanVector& change) const;
  bool flat_around(const MeshDistance& now, const Point3& p, const Eigen::Vector3d& normal,
                   double aside_mm) const;
  double first_mm() const { return 1e-3 * setup_.resin.shrinkage.height_um; }

  const SliceSource& shown_;
  Setup setup_;  ///< as it was printed, by what was believed
  const ScanInputs& inputs_;
  std::vector<Point3> points_, normals_;  ///< normals where they are heeded
  std::vector<Derived> derived_;
  Registration registration_;
  Point3 middle_{};
  double diagonal_ = 0, reach_ = 0;
  double aside_ = 0;       ///< surfaces are sought so far from points, mm: at most `reach_`
  std::size_t found_ = 0;  ///< points that had a surface so near, when they were most
  int strips_ = 1;
};

}  // namespace slicecorr::resins
