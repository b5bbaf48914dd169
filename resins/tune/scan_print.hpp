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
  bool apart = false;  ///< lies where something else sticks to the surface: pulls at nothing
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
            std::size_t most_points, const ExecutionContext& context);

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
    std::optional<std::array<int, 2>> rows;  ///< nothing: all of the image
    std::vector<std::size_t> points;
  };
  std::vector<Strip> strips(const ScanVector& change) const;
  std::optional<MeshDistance> predicted(const ScanVector& change, const Strip& strip,
                                        const ExecutionContext& context) const;
  void begin_row(const MeshDistance& now, const ScanState& state, std::size_t i,
                 ScanRow& row) const;
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
  int strips_ = 1;
};

}  // namespace slicecorr::resins
